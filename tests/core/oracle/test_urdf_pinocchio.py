"""A URDF read here and by Pinocchio is one machine: D, C v + G and G to rounding."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from patagium.dynamics import equations
from patagium.errors import RobotFileWarning
from patagium.robot import Robot, load_urdf_text

ROUNDING = 1e-12  # relative to the largest entry: another order of summation
MIMIC = 4  # the last joint of this tree moves
KINDS = ("revolute", "continuous", "prismatic", "fixed")


def _numbers(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)


def _inertial(rng: np.random.Generator) -> str:
    points = rng.normal(size=(6, 3)) * 0.1
    points -= points.mean(axis=0)
    tensor = sum(p @ p * np.eye(3) - np.outer(p, p) for p in points)
    names = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2)}
    names["iyz"] = (1, 2)
    moments = " ".join(f'{name}="{float(tensor[k])!r}"' for name, k in names.items())
    return (
        f'<inertial><origin xyz="{_numbers(rng.normal(size=3) * 0.1)}" '
        f'rpy="{_numbers(rng.uniform(-3, 3, 3))}"/><mass value="{rng.uniform(0.5, 2)!r}"/>'
        f"<inertia {moments}/></inertial>"
    )


def _urdf(seed: int) -> str:
    """A random tree with every kind of joint; a fixed link now and then has no mass."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4, 8))
    parts = [f'<robot name="tree {seed}">', f'<link name="L0">{_inertial(rng)}</link>']
    for k in range(1, count):
        kind = "revolute" if k == 1 else KINDS[int(rng.integers(4))]
        bare = kind == "fixed" and rng.random() < 0.5
        parts.append(f'<link name="L{k}">{"" if bare else _inertial(rng)}</link>')
        axis = rng.normal(size=3) if rng.random() < 0.6 else np.eye(3)[rng.integers(3)]
        axis = axis / np.linalg.norm(axis)
        parts.append(
            f'<joint name="J{k}" type="{kind}"><parent link="L{int(rng.integers(0, k))}"/>'
            f'<child link="L{k}"/><origin xyz="{_numbers(rng.normal(size=3) * 0.3)}" '
            f'rpy="{_numbers(rng.uniform(-3, 3, 3))}"/><axis xyz="{_numbers(axis)}"/>'
            '<limit lower="-3" upper="2" effort="10" velocity="4"/>'
            '<dynamics damping="0.1"/></joint>'
        )
    return "".join([*parts, "</robot>"])


def _ours(robot: Robot) -> ca.Function:
    q, v = (ca.SX.sym(name, robot.dof) for name in "qv")
    found = [
        equations.mass_matrix(robot, q),
        equations.bias(robot, q, v),
        equations.gravity_force(robot, q),
    ]
    return ca.Function("ours", [q, v], [ca.densify(k) for k in found])


def _compare(urdf: str, rng: np.random.Generator, floating: bool) -> None:
    pin = pytest.importorskip("pinocchio", reason="Pinocchio comes with the extra `bench`")
    robot = load_urdf_text(urdf, base="floating" if floating else "fixed")
    root = pin.JointModelComposite()
    root.addJoint(pin.JointModelTranslation())
    root.addJoint(pin.JointModelSphericalZYX())
    model = pin.buildModelFromXML(urdf, root) if floating else pin.buildModelFromXML(urdf)
    place, circular = _places(model, robot.dof_names, floating)
    ours, model_data = _ours(robot), model.createData()
    for _ in range(4):
        q, v = rng.uniform(-1.2, 1.2, robot.dof), rng.normal(size=robot.dof) * 3
        theirs_q, theirs_v = np.zeros(model.nq), np.zeros(model.nv)
        for i, (at_q, at_v) in enumerate(place):
            theirs_v[at_v] = v[i]
            if i in circular:
                theirs_q[at_q : at_q + 2] = np.cos(q[i]), np.sin(q[i])
            else:
                theirs_q[at_q] = q[i]
        order = [at_v for _, at_v in place]
        upper = np.triu(pin.crba(model, model_data, theirs_q))
        matrix = (upper + np.triu(upper, 1).T)[np.ix_(order, order)]
        bias = pin.nonLinearEffects(model, model_data, theirs_q, theirs_v)[order]
        gravity = pin.computeGeneralizedGravity(model, model_data, theirs_q)[order]
        for found, expected in zip(ours(q, v), (matrix, bias, gravity), strict=True):
            difference = np.array(found).reshape(expected.shape) - expected
            assert np.abs(difference).max() <= ROUNDING * np.abs(expected).max()


def _places(model, names: tuple[str, ...], floating: bool) -> tuple[list, set[int]]:
    """Where each of our coordinates is in Pinocchio's q and v, and which turn without end."""
    place, circular = [], set()
    for i, name in enumerate(names):
        if floating and i < 6:  # x, y, z, then yaw, pitch, roll
            k = {3: 5, 4: 4, 5: 3}.get(i, i)
            place.append((k, k))
            continue
        joint = model.getJointId(name.upper())
        place.append((model.joints[joint].idx_q, model.joints[joint].idx_v))
        if model.joints[joint].nq == 2:
            circular.add(i)
    return place, circular


@pytest.mark.parametrize("seed", range(6))
def test_random_trees_on_the_world(seed: int, rng: np.random.Generator) -> None:
    _compare(_urdf(seed), rng, floating=False)


@pytest.mark.parametrize("seed", (10, 11))
def test_random_trees_that_float(seed: int, rng: np.random.Generator) -> None:
    _compare(_urdf(seed), rng, floating=True)


def test_a_mimic_joint_is_a_coordinate_of_its_own_in_both(rng: np.random.Generator) -> None:
    tie = '<mimic joint="J1" multiplier="-2" offset="0.1"/></joint></robot>'
    urdf = _urdf(MIMIC).replace("</joint></robot>", tie)
    with pytest.warns(RobotFileWarning, match=r"tie j\d = -2 J1 \+ 0.1 in the gait"):
        _compare(urdf, rng, floating=False)

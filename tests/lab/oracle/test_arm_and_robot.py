"""A robot on an arm: its two halves coupled, Pinocchio's model of the same, the maker's table."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest

from patagium.dynamics import equations
from patagium.dynamics.kinematics import body_poses
from patagium.robot import Robot, load_robot

ROUNDING = 1e-12  # relative to the largest entry: another order of summation
TURN, SHIFT = (0.4, -1.1, 0.3), (0.01, 0.02, 0.1)


@pytest.fixture(scope="module")
def halves() -> tuple[Robot, Robot, Robot]:
    arm = load_robot("ur5e").with_parameters({"gravity": 9.8})  # as the robot's
    robot = load_robot("aerobat")
    return robot, arm, robot.mounted_on(arm, "tool", position=SHIFT, orientation=TURN)


def _pose(robot: Robot, q: np.ndarray, body: str) -> tuple[np.ndarray, np.ndarray]:
    position, rotation = _pose_function(robot, body)(q)
    return np.array(position)[:, 0], np.array(rotation)


@cache
def _pose_function(robot: Robot, body: str) -> ca.Function:
    q = ca.SX.sym("q", robot.dof)
    pose = body_poses(robot, q)[robot.body_index(body)]
    return ca.Function("pose", [q], [ca.densify(pose.position), ca.densify(pose.rotation)])


def _euler(rotation: np.ndarray) -> np.ndarray:
    """Roll, pitch, yaw."""
    return np.array(
        [
            np.arctan2(rotation[2, 1], rotation[2, 2]),
            -np.arcsin(rotation[2, 0]),
            np.arctan2(rotation[1, 0], rotation[0, 0]),
        ]
    )


def _base_of(arm_q: np.ndarray, composed: Robot, n: int) -> np.ndarray:
    """x, y, z, roll, pitch, yaw of the robot's body where the arm holds it."""
    q = np.zeros(composed.dof)
    q[:n] = arm_q
    position, rotation = _pose(composed, q, "body")
    return np.concatenate([position, _euler(rotation)])


def _ours(robot: Robot) -> ca.Function:
    """D, C v + G, G, D a + C v + G and U of (q, v, a)."""
    q, v, a = (ca.SX.sym(name, robot.dof) for name in "qva")
    found = [
        equations.mass_matrix(robot, q),
        equations.bias(robot, q, v),
        equations.gravity_force(robot, q),
        equations.inverse(robot, q, v, a),
        equations.potential_energy(robot, q),
    ]
    return ca.Function("ours", [q, v, a], [ca.densify(k) for k in found])


def _tie(arm_q: np.ndarray, composed: Robot) -> np.ndarray:
    """Base's coordinates by the arm's, (6, 6), by central differences."""
    step = 1e-6
    columns = [
        (_base_of(arm_q + d, composed, 6) - _base_of(arm_q - d, composed, 6)) / (2 * step)
        for d in step * np.eye(6)
    ]
    return np.column_stack(columns)


def test_composed_tree_is_the_two_halves_coupled(halves, rng) -> None:
    """T^T D T with T from the arm's joints to the floating base: virtual work at the coupling."""
    of_robot, of_arm, of_both = (_ours(k) for k in halves)
    robot, _, composed = halves
    for _ in range(3):
        q = rng.uniform(-0.8, 0.8, composed.dof)
        tie = np.zeros((robot.dof, composed.dof))
        tie[:6, :6] = _tie(q[:6], composed)
        tie[6:, 6:] = np.eye(robot.dof - 6)
        full = np.concatenate([_base_of(q[:6], composed, 6), q[6:]])
        theirs, arms, found = of_robot(full, 0, 0), of_arm(q[:6], 0, 0), of_both(q, 0, 0)
        matrix = tie.T @ np.array(theirs[0]) @ tie
        matrix[:6, :6] += np.array(arms[0])
        gravity = tie.T @ np.array(theirs[2])
        gravity[:6] += np.array(arms[2])
        for ours, expected in ((found[0], matrix), (found[2], gravity)):
            # central differences of the base's pose
            assert np.abs(np.array(ours) - expected).max() <= 1e-9 * np.abs(expected).max()
        assert float(found[4]) == pytest.approx(float(theirs[4] + arms[4]), rel=1e-12)


def test_the_force_at_the_coupling_moves_either_half(halves, rng) -> None:
    """Arm and robot apart, with a wrench between them that keeps the base on the tool."""
    of_robot, of_arm, of_both = (_ours(k) for k in halves)
    composed = halves[2]
    q, v, f = (rng.normal(size=composed.dof) * k for k in (0.5, 1.0, 0.01))
    matrix, bias, *_ = of_both(q, v, 0)
    a = np.linalg.solve(np.array(matrix), f - np.array(bias)[:, 0])

    def base(time: float) -> np.ndarray:
        return _base_of(q[:6] + v[:6] * time + a[:6] * time**2 / 2, composed, 6)

    step = 1e-3
    near = [base(k * step) for k in range(-3, 4)]
    base_v = np.array([-1, 9, -45, 0, 45, -9, 1]) @ near / (60 * step)
    base_a = np.array([2, -27, 270, -490, 270, -27, 2]) @ near / (180 * step**2)
    motion = ((near[3], q), (base_v, v), (base_a, a))
    on_robot = np.array(of_robot(*(np.concatenate([x, y[6:]]) for x, y in motion))[3])[:, 0]
    # what the coupling gives the robot acts back on the arm through the base's Jacobian
    on_arm = np.array(of_arm(q[:6], v[:6], a[:6])[3])[:, 0]
    found = np.concatenate([on_arm + _tie(q[:6], composed).T @ on_robot[:6], on_robot[6:]])
    # sixth-order differences, relative to the forces at work
    assert np.abs(found - f).max() <= 1e-7 * np.abs(np.array(bias)).max()


def test_pinocchio_has_the_same_composed_machine(halves, rng) -> None:
    pytest.importorskip("pinocchio", reason="Pinocchio comes with the extra `bench`")
    from patagium_lab.rivals.pinocchio_model import PinocchioModel

    theirs, ours = PinocchioModel(halves[2]), _ours(halves[2])
    for _ in range(4):
        q, v, a = (rng.normal(size=halves[2].dof) * k for k in (1, 3, 10))
        expected = theirs.mass_matrix(q), theirs.bias(q, v), theirs.inverse(q, v, a)
        matrix, bias, _, inverse, _ = ours(q, v, a)
        for found, of_theirs in zip((matrix, bias, inverse), expected, strict=True):
            difference = np.array(found).reshape(of_theirs.shape) - of_theirs
            assert np.abs(difference).max() <= ROUNDING * np.abs(of_theirs).max()


# a, d, alpha, mass and center of mass of each link, as Universal Robots publishes them
MAKER = (
    (0, 0.1625, np.pi / 2, 3.761, (0, -0.02561, 0.00193)),
    (-0.425, 0, 0, 8.058, (0.2125, 0, 0.11336)),
    (-0.3922, 0, 0, 2.846, (0.15, 0, 0.0265)),
    (0, 0.1333, np.pi / 2, 1.37, (0, -0.0018, 0.01634)),
    (0, 0.0997, -np.pi / 2, 1.3, (0, 0.0018, 0.01634)),
    (0, 0.0996, 0, 0.365, (0, 0, -0.001159)),
)


def _link(a: float, d: float, alpha: float, theta: float) -> np.ndarray:
    """Denavit and Hartenberg's Rz(theta) Tz(d) Tx(a) Rx(alpha), (4, 4)."""
    ct, st, ca_, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array(
        [
            [ct, -st * ca_, st * sa, a * ct],
            [st, ct * ca_, -ct * sa, a * st],
            [0, sa, ca_, d],
            [0, 0, 0, 1],
        ]
    )


def test_the_arm_is_the_makers_table(rng) -> None:
    arm = load_robot("ur5e")
    for _ in range(3):
        q = rng.uniform(-3, 3, 6)
        frame, centers = np.eye(4), []
        for angle, (a, d, alpha, _, center) in zip(q, MAKER, strict=True):
            frame = frame @ _link(a, d, alpha, angle)
            centers.append((frame @ np.array([*center, 1]))[:3])
        position, rotation = _pose(arm, q, "tool")
        np.testing.assert_allclose(position, frame[:3, 3], atol=1e-14)
        np.testing.assert_allclose(rotation, frame[:3, :3], atol=1e-14)
        masses = np.array([row[3] for row in MAKER])
        expected = masses @ np.array(centers) / masses.sum()
        center = np.array(ca.DM(equations.center_of_mass(arm, ca.SX(q))))[:, 0]
        np.testing.assert_allclose(center, expected, atol=1e-14)

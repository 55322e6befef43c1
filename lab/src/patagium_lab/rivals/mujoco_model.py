"""The robot as a MuJoCo model with the coordinates of q: oracle and rival.

A floating base is three slides and three hinges (yaw, pitch, roll), or MuJoCo's free joint where
its attitude is a quaternion, so that D and the bias compare entry by entry. Damping, contacts and
limits are left out. Needs `mujoco`; every moving body needs a mass and inertia above MuJoCo's
smallest.
"""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import numpy as np

from patagium.arrays import Array
from patagium.dynamics.chain import chain_of
from patagium.robot.model import Robot


def mujoco_xml(robot: Robot) -> str:
    """The robot as MJCF text.

    Args:
        robot: Machine with numbers, not symbols.
    """
    root = ElementTree.Element("mujoco", model=robot.name)
    ElementTree.SubElement(root, "compiler", angle="radian", balanceinertia="false")
    option = ElementTree.SubElement(root, "option", gravity=f"0 0 {-float(robot.gravity)!r}")
    ElementTree.SubElement(option, "flag", contact="disable", constraint="disable")
    elements = [ElementTree.SubElement(root, "worldbody")]
    for body in robot.bodies:
        orientation = np.array(body.orientation, float)
        element = ElementTree.SubElement(
            elements[body.parent + 1],
            "body",
            name=body.name,
            pos=numbers_text(body.position),
            xyaxes=numbers_text([*orientation[:, 0], *orientation[:, 1]]),
        )
        elements.append(element)
        if body.by_quaternion:
            ElementTree.SubElement(element, "freejoint", name=body.name)
        for step in () if body.by_quaternion else chain_of(robot, body):
            kind, name = "hinge" if step.turns else "slide", f"coordinate {step.dofs[0]}"
            axis = numbers_text(step.axes[0])
            ElementTree.SubElement(element, "joint", name=name, type=kind, axis=axis)
        if float(body.mass):
            ElementTree.SubElement(
                element,
                "inertial",
                pos=numbers_text(body.center_of_mass),
                mass=repr(float(body.mass)),
                fullinertia=numbers_text(body.inertia),
            )
    return ElementTree.tostring(root, encoding="unicode")


class MujocoModel:
    """A robot's dynamics by MuJoCo, called from Python.

    Args:
        robot: Machine with numbers, not symbols.
        xml: The robot as MJCF text, with more than `mujoco_xml` writes; None: as that writes it.

    Attributes:
        model: The `mujoco.MjModel`.
        order: Index in v of each velocity of the model, (n,) [1].
        places: Index in q of each coordinate of the model, (n_q,) [1].
    """

    def __init__(self, robot: Robot, xml: str | None = None) -> None:
        import mujoco

        self.mujoco: Any = mujoco
        self.model: Any = mujoco.MjModel.from_xml_string(xml or mujoco_xml(robot))
        self.data: Any = mujoco.MjData(self.model)
        names = [self.model.joint(k).name for k in range(self.model.njnt)]
        self.order = np.array([k for name in names for k in _dofs(robot, name)], dtype=np.intp)
        coordinates = [k for name in names for k in _coordinates(robot, name)]
        self.places = np.array(coordinates, dtype=np.intp)

    def mass_matrix(self, q: Array) -> Array:
        """D by the composite-rigid-body algorithm, (n, n) [kg, kg m, kg m^2]."""
        n = len(self.order)
        self._place(q, np.zeros(n))
        self.mujoco.mj_crb(self.model, self.data)
        found = np.zeros((n, n))
        for column, unit in zip(found, np.eye(n), strict=True):
            self.mujoco.mj_mulM(self.model, self.data, column, unit)
        matrix = np.empty_like(found)
        matrix[np.ix_(self.order, self.order)] = found
        return matrix

    def bias(self, q: Array, v: Array) -> Array:
        """C v + G by the recursive Newton-Euler algorithm, (n,) [N, N m]."""
        self._place(q, v)
        found = np.zeros(len(v))
        self.mujoco.mj_comVel(self.model, self.data)
        self.mujoco.mj_rne(self.model, self.data, 0, found)
        vector = np.empty_like(found)
        vector[self.order] = found
        return vector

    def _place(self, q: Array, v: Array) -> None:
        self.data.qpos[:], self.data.qvel[:] = q[self.places], v[self.order]
        self.mujoco.mj_kinematics(self.model, self.data)
        self.mujoco.mj_comPos(self.model, self.data)


def _dofs(robot: Robot, name: str) -> tuple[int, ...]:
    """Places in v of a joint of the model, by its name."""
    if name.startswith("coordinate "):
        return (int(name.split()[-1]),)
    return robot.bodies[robot.body_index(name)].floating_dofs or ()


def _coordinates(robot: Robot, name: str) -> tuple[int, ...]:
    """Places in q of a joint of the model, by its name."""
    if name.startswith("coordinate "):
        return (robot.coordinate_indices[_dofs(robot, name)[0]],)
    return robot.floating_coordinates(robot.bodies[robot.body_index(name)])


def numbers_text(values: Any) -> str:
    """Numbers as an attribute of MJCF.

    Args:
        values: Numbers in order.
    """
    return " ".join(repr(float(value)) for value in values)

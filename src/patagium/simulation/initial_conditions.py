"""Initial conditions of a flight, and checks that its parts are of one robot."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics import AddedMass, Aerodynamics
from patagium.errors import ParameterError, ShapeError
from patagium.robot import Robot
from patagium.simulation.runge_kutta import Array


def whole_steps(duration: float, time_step: float) -> int:
    """Number of time steps in a duration.

    Raises:
        ParameterError: If either is not positive, or they do not divide.
    """
    for name, value in (("duration", duration), ("time_step", time_step)):
        if not (np.isfinite(value) and value > 0):
            raise ParameterError(name, "a positive number of seconds", value)
    steps = round(duration / time_step)
    if steps < 1 or abs(duration / time_step - steps) > 1e-6 * steps:
        raise ParameterError("duration", f"a whole number of time steps of {time_step} s", duration)
    return steps


def check_robots(robot: Robot, aero: Aerodynamics) -> None:
    """Refuse a model of the air around another robot.

    Raises:
        ParameterError: If its coordinates or strips are not the robot's.
    """
    if _shape(aero.robot) != _shape(robot):
        raise ParameterError(
            "aero", f"a model of the air around {_named(robot)}", _named(aero.robot)
        )


def check_added_mass(robot: Robot, aero: Aerodynamics, added_mass: AddedMass | None) -> None:
    """Refuse added mass of another robot, or in other air.

    Raises:
        ParameterError: If its coordinates, strips or air are not those of robot and model.
    """
    if added_mass is None:
        return
    if _shape(added_mass.robot) != _shape(robot):
        raise ParameterError("added_mass", f"that of {_named(robot)}", _named(added_mass.robot))
    if added_mass.air != aero.air:
        raise ParameterError("added_mass.air", f"the air of aero, {aero.air}", added_mass.air)


def _shape(robot: Robot) -> tuple[tuple[str, ...], tuple[str, ...], int]:
    return robot.dof_names, robot.coordinate_names, len(robot.strips)


def _named(robot: Robot) -> str:
    return robot.name + (" with a quaternion" if robot.attitude == "quaternion" else "")


def initial_coordinates(robot: Robot, values: ArrayLike | None) -> Array:
    """Initial coordinates, those of zero angles by default, (n_q,); quaternions of length one.

    Args:
        robot: The machine.
        values: Coordinates, (n_q,) [m, rad, 1], or None.

    Raises:
        ShapeError: If they are not (n_q,).
        ParameterError: If they are not finite, or a quaternion's length is not one.
    """
    q = _finite("q", robot.coordinates() if values is None else values, robot.coordinate_names)
    for body in robot.bodies:
        if body.by_quaternion:
            places = list(robot.floating_coordinates(body)[3:])
            length = float(np.linalg.norm(q[places]))
            if abs(length - 1) > _LENGTH_TOLERANCE:
                raise ParameterError("q", "a quaternion of length 1", f"one of {length:.6g}")
            q[places] /= length
    return q


_LENGTH_TOLERANCE = 1e-6
"""Of a quaternion as written: six digits."""


def initial_velocities(robot: Robot, values: ArrayLike | None) -> Array:
    """Initial velocities, zero by default, (n,).

    Args:
        robot: The machine.
        values: Velocities, (n,) [m/s, rad/s], or None.

    Raises:
        ShapeError: If they are not (n,).
        ParameterError: If they are not finite.
    """
    return _finite("v", np.zeros(robot.dof) if values is None else values, robot.dof_names)


def _finite(name: str, values: ArrayLike, names: tuple[str, ...]) -> Array:
    vector = np.array(values, float)
    if vector.shape != (len(names),):
        raise ShapeError(name, (len(names),), vector.shape)
    if not np.isfinite(vector).all():
        wrong = names[int(np.argmin(np.isfinite(vector)))]
        raise ParameterError(name, "finite numbers", f"not finite at {wrong}")
    return vector

"""True motion and forces of a flight at any time and any point of the robot.

Between the samples of a flight the coordinates are cubics that meet positions and rates; all
other quantities are cubics through the samples. Neglected: motion between samples that is too
fast for the time step of the flight.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import xarray as xr
from scipy.interpolate import CubicHermiteSpline, make_interp_spline

from patagium.arrays import Array, median_step, stored
from patagium.dynamics.kinematics import body_poses
from patagium.dynamics.rnea import body_accelerations
from patagium.errors import FlightError
from patagium.native import NativeFunction, load_functions, named_function
from patagium.robot import Robot
from patagium.simulation.flight import robot_of


@dataclass(frozen=True)
class FrameMotion:
    """Motion of a frame that is fixed to a body.

    Attributes:
        position: Position of its origin, world axes, (N, 3) [m].
        rotation: Rotation from its axes to world axes, (N, 3, 3) [-].
        angular_velocity: Angular velocity in its own axes, (N, 3) [rad/s].
        specific_force: Acceleration of its origin less gravity, in its own axes, (N, 3) [m/s^2].
    """

    position: Array
    rotation: Array
    angular_velocity: Array
    specific_force: Array


class Scene:
    """Interpolated flight that sensors measure.

    Args:
        flight: Record with q, v, a.
        robot: The machine; by default the one whose text the flight carries.

    Raises:
        FlightError: If the flight has no robot, lacks a quantity or has less than 4 samples.
    """

    def __init__(self, flight: xr.Dataset, robot: Robot | None = None) -> None:
        self.flight, self.robot = flight, robot or robot_of(flight)
        self.time = stored(flight, "time")
        if len(self.time) < 4:
            raise FlightError("flight", "at least 4 samples", len(self.time))
        q, v, a = (self.values(name) for name in ("q", "v", "a"))
        alike = q.shape == v.shape  # but for a quaternion, whose rates are no velocities
        self._q = CubicHermiteSpline(self.time, q, v) if alike else make_interp_spline(self.time, q)
        self._v, self._a = CubicHermiteSpline(self.time, v, a), make_interp_spline(self.time, a)

    def values(self, name: str, needed_by: str = "sensors") -> Array:
        """Variable of the flight with time as the first axis, (N, ...), in its own unit.

        Raises:
            FlightError: If the flight has no such variable, or the variable is not finite.
        """
        if name not in self.flight:
            held = ", ".join(map(str, self.flight.data_vars))
            raise FlightError(
                f"flight: expected {name} (time, ...) for {needed_by}, but it holds {held}"
            )
        values = stored(self.flight, name, "time", ...)
        if not np.isfinite(values).all():
            raise FlightError(f"{name}: expected finite numbers for {needed_by}")
        return values

    def coordinates(self, times: Array) -> tuple[Array, Array, Array]:
        """Coordinates q, (N, n_q), v and a, (N, n), at given times [m, rad and their rates]."""
        return tuple(np.asarray(part(times)) for part in (self._q, self._v, self._a))  # type: ignore[return-value]

    def through(self, values: Array, times: Array, bandwidth: float | None) -> Array:
        """Cubic through values at the samples of the flight, at given times, (N, ...).

        Args:
            values: Values at the samples of the flight, (M, ...) [any unit].
            times: Times, (N,) [s].
            bandwidth: Frequency at which a first-order low-pass before it halves the power [Hz];
                None for no low-pass.
        """
        if bandwidth is not None:
            values = low_pass(self.time, values, bandwidth)
        return np.asarray(make_interp_spline(self.time, values, k=3)(times))

    def frame(self, body: str, position: Array, rotation: Array, times: Array) -> FrameMotion:
        """Motion of a frame fixed to a body.

        Args:
            body: Name of the body.
            position: Position of the frame's origin, body axes, (3,) [m].
            rotation: Rotation from the frame's axes to body axes, (3, 3) [-].
            times: Times, (N,) [s].

        Raises:
            ParameterError: If there is no such body.
        """
        index, position = self.robot.place(body, position)
        function = _frame_function(self.robot, index)
        q, v, a = self.coordinates(times)
        origin, turn, spin, felt = (
            np.array(part) for part in function.batch(q, v, a, position, self.robot.parameters)
        )
        return FrameMotion(origin, turn @ rotation, spin @ rotation, felt @ rotation)


def _frame_function(robot: Robot, body: int) -> NativeFunction:
    """Compiled function (q, v, a, offset, parameters) -> motion of a frame on a body.

    Returns:
        Position of the offset point in world axes (3,) [m], body axes to world axes (3, 3),
        angular velocity (3,) [rad/s] and specific force (3,) [m/s^2] in body axes.
    """

    def build() -> list[ca.Function]:
        machine, p = robot.symbolic()
        q = ca.SX.sym("q", robot.coordinate_count)
        v, a = ca.SX.sym("v", robot.dof), ca.SX.sym("a", robot.dof)
        offset = ca.SX.sym("offset", 3)
        pose = body_poses(machine, q)[body]
        w, dw, origin = body_accelerations(machine, q, v, a, ca.SX(machine.gravity))[body]
        felt = origin + ca.cross(dw, offset) + ca.cross(w, ca.cross(w, offset))
        inputs = {"q": q, "v": v, "a": a, "offset_parameters": offset, "parameters": p}
        motion = {"position": pose.at(offset), "rotation": pose.rotation}
        motion |= {"angular_velocity": w, "specific_force": felt}
        return [named_function("frame", inputs, motion)]

    name = robot.bodies[body].name
    key = f"frame of body {body} {robot.structure}"
    return load_functions(key, build, label=f"{robot.name} frame on {name}")["frame"]


def low_pass(time: Array, values: Array, bandwidth: float) -> Array:
    """Values after a first-order low-pass that starts settled, (N, ...), in their unit.

    y' = w (u - y), w = 2 pi times the bandwidth; exact for inputs linear between samples.

    Args:
        time: Times at equal steps, (N,) [s].
        values: Input, (N, ...) [any unit].
        bandwidth: Frequency at which the power is halved [Hz].
    """
    from scipy.signal import lfilter  # slow to load and rarely needed

    step = median_step(time)
    reach = 2 * np.pi * bandwidth * step
    kept = np.exp(-reach)
    share = (1 - kept) / reach
    start = values[:1]
    moved = values - start
    return np.asarray(lfilter([1 - share, share - kept], [1.0, -kept], moved, axis=0) + start)

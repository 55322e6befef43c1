"""Kinematics of a sensor's frame on a robot, with derivatives with respect to the motion.

The attitude of a floating body is a reference rotation and a small rotation vector about it, in
body axes, so that Euler angles are never differenced. The equations are evaluated in the axes of
the reference, where their Euler angles are zero and cannot be singular. A robot may have one
floating body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from patagium.arrays import Array, Indices
from patagium.dynamics.kinematics import body_poses, body_velocities, in_body_axes
from patagium.dynamics.rnea import body_accelerations
from patagium.errors import ParameterError
from patagium.native import NativeFunction, load_functions, named_function
from patagium.robot import Robot
from patagium.sensing.sensors import Imu, MotionCapture


@dataclass(frozen=True)
class FloatingBase:
    """Indices of the coordinates of a floating body in q.

    Attributes:
        place: Places of x, y, z in q, indices (3,).
        turn: Places of roll, pitch, yaw in q, indices (3,).
    """

    place: tuple[int, ...]
    turn: tuple[int, ...]


@dataclass(frozen=True)
class Motion:
    """Motion at one instant, without singularities.

    Attributes:
        levels: Position, velocity, acceleration (, jerk) of each coordinate, (m, n) [m, rad,
            per s, per s^2 ...]; for attitude zero, angular velocity in body axes, its derivatives.
        attitude: Rotation from body to world axes, (3, 3) [-]; the identity without a floating
            body.
    """

    levels: Array
    attitude: Array


def with_euler_angles(robot: Robot) -> Robot:
    """Robot with roll, pitch and yaw for the attitude of its floating body."""
    return robot if robot.coordinate_count == robot.dof else robot.with_attitude("euler")


def floating_base(robot: Robot) -> FloatingBase | None:
    """Coordinates of the floating body; None without one.

    Raises:
        ParameterError: If there are several floating bodies.
    """
    found = robot.floating_dofs
    if len(found) > 6:
        raise ParameterError("robot", "one floating body at most", f"{len(found) // 6} of them")
    return FloatingBase(found[:3], found[3:]) if found else None


def turn_places(base: FloatingBase | None, columns: Sequence[int]) -> Indices | None:
    """Places of roll, pitch, yaw among some coordinates, (3,); None where they are not there."""
    if base is None or not set(base.turn) <= set(columns):
        return None
    return np.array([list(columns).index(i) for i in base.turn])


class FrameModel:
    """Frame of a sensor on a body as a function of the motion.

    Args:
        robot: The machine.
        sensor: The sensor, which says on which body it sits, where and how.

    Attributes:
        offset: Position of the frame on the body that moves with it, that body's axes, (3,) [m].
        mount: Rotation from the frame's axes to that body's, (3, 3) [-].
        on_base: Whether the frame moves with the floating body.

    Raises:
        ParameterError: If the robot has no such body, or several floating bodies.
    """

    def __init__(self, robot: Robot, sensor: Imu | MotionCapture) -> None:
        self.robot, self.base = robot, floating_base(robot)
        index, self.offset = robot.place(sensor.body, sensor.position)
        self.mount = np.asarray(sensor.orientation, float)
        while (held := robot.bodies[index]).parent >= 0 and not held.joints:  # a fixed frame
            index, turn = held.parent, np.array(held.orientation, float)
            self.offset, self.mount = held.position + turn @ self.offset, turn @ self.mount
        self._both = np.kron(np.eye(2), self.mount.T)
        functions = load_functions(
            f"motion of body {index} {robot.structure}",
            lambda: _functions(robot, index),
            label=f"{robot.name} motion of {robot.bodies[index].name}",
        )
        self.inertial_function, self.pose_function = functions["inertial"], functions["pose"]
        self.parameters = robot.parameters
        self.on_base = robot.bodies[index].floating_dofs is not None

    def inertials(self, levels: Array, attitude: Rotation) -> tuple[Array, Array]:
        """Specific force and angular rate in the frame's axes at many instants, and the slopes.

        Args:
            levels: Position, velocity, acceleration of each coordinate, (N, 3, n) [m, rad, per s,
                per s^2].
            attitude: Rotations from body to world axes, N.

        Returns:
            Both, (N, 6) [m/s^2, rad/s], and the derivatives with respect to the levels,
            (N, 6, 3, n).
        """
        seen, turn = self._in_reference(levels, attitude)
        parts = [seen[:, k] for k in range(3)]
        found = self.inertial_function.batch(*parts, turn[:, 2], self.offset, self.parameters)
        value, slope = (np.array(part) for part in found)
        shown = value.reshape(-1, 2, 3) @ self.mount
        both = (self._both @ slope).reshape(len(value), 6, 3, self.robot.dof)
        return shown.reshape(-1, 6), self._to_world(both, turn)

    def poses(self, levels: Array, attitude: Rotation) -> tuple[Array, Rotation, Array]:
        """Poses of the frame in the world at many instants, and the slopes.

        Args:
            levels: Position, velocity, acceleration of each coordinate, (N, 3, n) [m, rad, per s,
                per s^2].
            attitude: Rotations from body to world axes, N.

        Returns:
            Positions (N, 3) [m]; rotations from the frame's axes to world axes, N; derivatives
            of position in world axes and of attitude in the frame's axes, (N, 6, n).
        """
        seen, turn = self._in_reference(levels, attitude)
        found = self.pose_function.batch(seen[:, 0], self.offset, self.parameters)
        position, rotation, moved, turned = (np.array(part) for part in found)
        slope = np.concatenate([turn @ moved, self.mount.T @ turned], axis=1)
        world = (turn @ position.reshape(-1, 3, 1))[:, :, 0]
        jacobian = self._to_world(slope[:, :, None], turn)[:, :, 0]
        return world, Rotation.from_matrix(turn @ rotation @ self.mount), jacobian

    def _in_reference(self, levels: Array, attitude: Rotation) -> tuple[Array, Array]:
        """Levels in axes of the floating body, (N, 3, n), and its rotation to the world."""
        seen, turn = levels.copy(), attitude.as_matrix()
        if self.base is not None:
            place = list(self.base.place)
            seen[..., place] = levels[..., place] @ turn
        return seen, turn

    def _to_world(self, slope: Array, turn: Array) -> Array:
        if self.base is not None:
            place = list(self.base.place)
            slope[..., place] = slope[..., place] @ np.swapaxes(turn, 1, 2)[:, None]
        return slope


def _functions(robot: Robot, body: int) -> list[ca.Function]:
    """Functions `inertial` and `pose` of a body in the axes of the reference attitude.

    To first order the components of a rotation vector are roll, pitch and yaw.
    """
    machine, p = robot.symbolic()
    levels = [ca.SX.sym(name, robot.dof) for name in ("position", "velocity", "acceleration")]
    up, offset = ca.SX.sym("up", 3), ca.SX.sym("offset", 3)
    q, v, a = map(ca.SX, levels)
    if (base := floating_base(robot)) is not None:
        turn = list(base.turn)
        v[turn], a[turn] = euler_rates(q[turn], v[turn], a[turn])
    w, dw, origin = body_accelerations(machine, q, v, a, ca.SX(0))[body]
    ground = in_body_axes(machine, q, up * machine.gravity)[body]
    felt = origin + ground + ca.cross(dw, offset) + ca.cross(w, ca.cross(w, offset))
    shown = ca.vertcat(felt, w)
    slope = ca.jacobian(shown, ca.vertcat(*levels))
    pose = body_poses(machine, q)[body]
    rate = body_velocities(machine, q, v)[body].angular
    position = pose.at(offset)
    moved, turned = ca.jacobian(position, levels[0]), ca.jacobian(rate, levels[1])
    own = {"offset_parameters": offset, "parameters": p}
    motion = dict(zip(("position", "velocity", "acceleration"), levels, strict=True))
    placed = {"place": position, "rotation": pose.rotation, "moved": moved, "turned": turned}
    return [
        named_function("inertial", motion | {"up": up} | own, {"shown": shown, "slope": slope}),
        named_function("pose", {"position": levels[0], **own}, placed),
    ]


def euler_rates(angles: ca.SX, spin: ca.SX, spin_rate: ca.SX) -> tuple[ca.SX, ca.SX]:
    """First and second derivatives of roll, pitch, yaw, (3, 1) each [rad/s, rad/s^2].

    Args:
        angles: Roll, pitch, yaw, (3,) [rad].
        spin: Angular velocity in body axes, (3,) [rad/s].
        spin_rate: Derivative of the angular velocity, (3,) [rad/s^2].
    """
    turned = ca.SX.sym("angles", 3)
    roll, pitch = turned[0], turned[1]
    to_rates = ca.vertcat(
        ca.horzcat(1, ca.sin(roll) * ca.tan(pitch), ca.cos(roll) * ca.tan(pitch)),
        ca.horzcat(0, ca.cos(roll), -ca.sin(roll)),
        ca.horzcat(0, ca.sin(roll) / ca.cos(pitch), ca.cos(roll) / ca.cos(pitch)),
    )
    rates = to_rates @ spin
    second = ca.jtimes(rates, turned, rates) + to_rates @ spin_rate
    return ca.substitute(rates, turned, angles), ca.substitute(second, turned, angles)


def euler_function() -> NativeFunction:
    """Compiled function (angles, spin, spin rate) -> rates, second rates, and their Jacobian.

    The Jacobian, (9, 9), is of (roll, pitch, yaw and both derivatives) with respect to (small
    rotation in body axes, angular velocity, its derivative).
    """

    def build() -> list[ca.Function]:
        given = {name: ca.SX.sym(name, 3) for name in ("angles", "spin", "spin_rate")}
        angles, spin, spin_rate = given.values()
        small = ca.SX.sym("small", 3)
        moved = angles + euler_rates(angles, small, ca.SX.zeros(3, 1))[0]
        first, second = euler_rates(moved, spin, spin_rate)
        whole = ca.vertcat(moved, first, second)
        slope = ca.jacobian(whole, ca.vertcat(small, spin, spin_rate))
        found = {"rates": first, "second_rates": second, "slope": slope}
        still = {k: ca.substitute(x, small, [0, 0, 0]) for k, x in found.items()}
        return [named_function("euler", given, still)]

    return load_functions("euler rates of a body", build, label="Euler angles")["euler"]

"""Arm that carries a robot along a path: kinematics, limits, and the plan of its joints.

The tool is a frame fixed to a body of the arm; its functions are compiled, many states at a
time. Inverse kinematics goes by Newton's method on the compiled Jacobian: along the path from
one knot to the next on the same branch, then at any time from a spline through the knots, so
that position, velocity and acceleration are those of the path to rounding. Near a
singularity the arm is refused, never damped. Where it may start in several ways, each is
tried. Neglected: collisions; the load on the tool; jerk, power, elasticity and friction of the
joints; control errors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from operator import itemgetter
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from patagium.arguments import checked
from patagium.arrays import Array, brief, real_array, thin
from patagium.dynamics.equations import damping_force, inverse
from patagium.dynamics.kinematics import body_poses, body_velocities
from patagium.errors import ParameterError, PathError
from patagium.native import load_functions, named_function
from patagium.robot import Robot
from patagium.robot.attitude import body_accelerations, body_rates, rotation_from_angles
from patagium.robot.model import Axis, capacity_units
from patagium.simulation.gait_models import Gait, PrescribedMotion, asked_times
from patagium.simulation.paths import Path, span_of


class Tool:
    """A frame on an arm as functions of its joints.

    Args:
        arm: The arm.
        at: Name of the body that carries the frame.
        position: Its origin in that body's axes, (3,) [m].
        orientation: Roll, pitch, yaw of its axes in that body's, (3,) [rad].

    Raises:
        ParameterError: If there is no such body.
    """

    def __init__(self, arm: Robot, at: str, position: Axis, orientation: Axis) -> None:
        body = arm.body_index(at)
        placed = np.concatenate([position, rotation_from_angles(orientation).ravel(order="F")])
        self._parameters = np.concatenate([arm.parameters, placed])
        self._functions = load_functions(
            f"tool {arm.structure} {body}",
            lambda: _functions(arm, body),
            label=f"tool of {arm.name}",
            many_only=["pose", "drift", "torque"],
        )

    def pose(self, q: Array) -> tuple[Array, Array, Array]:
        """Position (N, 3) [m], rotation to the world (N, 3, 3) and Jacobian (N, 6, n).

        Args:
            q: Joint positions, (N, n) [rad, m].
        """
        position, turn, jacobian = self._functions["pose"].batch(q, self._parameters)
        return np.array(position), np.array(turn), np.array(jacobian)

    def drift(self, q: Array, v: Array) -> Array:
        """Acceleration of the tool without that of the joints, dJ/dt v, (N, 6).

        Args:
            q: Joint positions, (N, n) [rad, m].
            v: Joint velocities, (N, n) [rad/s, m/s].
        """
        return np.array(self._functions["drift"].batch(q, v, self._parameters))

    def follow(self, q: Array, target: PrescribedMotion) -> PrescribedMotion:
        """Motion of the joints that keeps the tool on a path.

        v = J^-1 twist, a = J^-1 (its rate - dJ/dt v).

        Args:
            q: Joint positions that put it there, (N, n) [rad, m].
            target: The path, x, y, z, roll, pitch, yaw, (N, 6) each [m, rad].
        """
        twist, change = _path_twist(target)
        _, _, jacobian = self.pose(q)
        v = solve_each(jacobian, twist)
        return PrescribedMotion(q, v, solve_each(jacobian, change - self.drift(q, v)))

    def torque(self, motion: PrescribedMotion) -> Array:
        """Force or torque of each joint, load left out, (N, n) [N m, N]."""
        return np.array(self._functions["torque"].batch(*motion, self._parameters))


def _functions(arm: Robot, body: int) -> list[ca.Function]:
    machine, own = arm.symbolic()
    placed = ca.SX.sym("placed", 12)
    p, offset, turn = ca.vertcat(own, placed), placed[:3], ca.reshape(placed[3:], 3, 3)
    q, v, a = (ca.SX.sym(name, arm.dof) for name in "qva")
    pose, twist = body_poses(machine, q)[body], body_velocities(machine, q, v)[body]
    place = pose.at(offset)
    linear = pose.rotation @ twist.at(offset)
    moves = ca.vertcat(linear, pose.rotation @ twist.angular)
    placing = {"place": place, "turn": pose.rotation @ turn, "jacobian": ca.jacobian(moves, v)}
    drift = ca.jtimes(moves, q, v)
    torque = inverse(machine, q, v, a) - damping_force(machine, v)
    return [
        named_function("pose", {"q": q, "parameters": p}, placing),
        named_function("drift", {"q": q, "v": v, "parameters": p}, {"drift": drift}),
        named_function("torque", {"q": q, "v": v, "a": a, "parameters": p}, {"torque": torque}),
    ]


def solve_each(matrices: Array, right: Array) -> Array:
    """Solutions, (N, n), of N linear systems (N, n, n) [SI] with right-hand sides (N, n)."""
    return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0], np.float64)


def _path_twist(motion: PrescribedMotion) -> tuple[Array, Array]:
    """Velocity and acceleration of a path: linear, then angular, world axes, (N, 6) each [SI]."""
    angles, rates, second = (part[:, 3:] for part in motion)
    turned = rotation_from_angles(angles)
    spin = body_rates(angles, rates), body_accelerations(angles, rates, second)
    world = [(turned @ part[..., None])[..., 0] for part in spin]
    linear = motion.velocity[:, :3], motion.acceleration[:, :3]
    return np.hstack([linear[0], world[0]]), np.hstack([linear[1], world[1]])


def rotation_vector(matrix: Array) -> Array:
    """Axis times angle, (N, 3) [rad], of rotations, (N, 3, 3); of a half turn one of two axes."""
    skew = matrix[:, [2, 0, 1], [1, 2, 0]] - matrix[:, [1, 2, 0], [2, 0, 1]]
    sine = np.linalg.norm(skew, axis=1) / 2
    cosine = (np.trace(matrix, axis1=1, axis2=2) - 1) / 2
    angle = np.arctan2(sine, cosine)
    scale = np.where(sine > 1e-9, angle / np.where(sine > 1e-9, 2 * sine, 1.0), 0.5)
    return skew * scale[:, None]


CLEARANCE = 0.03
"""Least singular value of the Jacobian, lengths in reaches of the arm, that is no singularity."""
CLOSED = 1e-10
"""How far the tool may be from the path [m, rad]."""


def _away(time: float, distance: float = np.inf, of: str = "path") -> PathError:
    """Error of a tool that is not where it ought to be."""
    return PathError(time, "", f"distance of the tool from the {of}", distance, CLOSED, "m")


def _check_branch(
    arm: Robot, tool: Tool, time: Array, target: PrescribedMotion, q: Array, period: float | None
) -> float:
    """Least singular value of the Jacobian, lengths in reaches of the arm, along a branch.

    A `PathError` says when it cannot follow the branch q, (K, n) [rad, m], first; q is not
    finite from where there is none. A periodic path must bring every joint back: a turn too
    many cannot go on for ever.
    """
    sound = np.isfinite(q).all(axis=1)
    count = len(time) if sound.all() else int(np.argmin(sound))
    _, _, jacobian = tool.pose(q[:count])
    reach = sum(float(np.linalg.norm(np.asarray(b.position, float))) for b in arm.bodies)
    scaled = jacobian / np.array([reach] * 3 + [1.0] * 3)[:, None]
    clearance = np.linalg.svd(scaled, compute_uv=False)[:, -1]
    if clearance.min() < CLEARANCE:
        k = int(np.argmax(clearance < CLEARANCE))
        quantity = "inverse clearance from a singularity"
        raise PathError(time[k], "", quantity, 1 / clearance[k], 1 / CLEARANCE, "")
    if count < len(time):
        raise _away(time[count])
    part = PrescribedMotion(*(k[:count] for k in target))
    _check_limits(arm, tool, time, tool.follow(q[:count], part))
    gone = np.abs(q[-1] - q[0])
    joint = int(np.argmax(gone))
    if period and gone[joint] > 1e-6:
        name, unit = arm.dof_names[joint], arm.dof_units[joint]
        raise PathError(period, name, "gain a period", gone[joint], 0.0, unit)
    return float(clearance.min())


def _check_limits(arm: Robot, tool: Tool, time: Array, motion: PrescribedMotion) -> None:
    """Refuse a motion beyond a limit of the arm's joints, with the time and by how much."""
    none, lowest = (np.inf,) * arm.dof, tuple(-k for k in arm.lower)
    quantities: list[tuple[str, Array, Sequence[float]]] = [
        ("position", motion.position, arm.upper),
        ("position", -motion.position, lowest),
        ("speed", np.abs(motion.velocity), arm.speed_limit or none),
        ("acceleration", np.abs(motion.acceleration), arm.acceleration_limit or none),
    ]
    if arm.effort_limit:
        quantities.append(("torque", np.abs(tool.torque(motion)), arm.effort_limit))
    for place, (name, values, most) in enumerate(quantities):
        beyond = values > np.array(most)
        if beyond.any():
            k = int(np.argmax(beyond.any(axis=1)))
            joint = int(np.argmax(beyond[k]))
            own, sign = arm.dof_units[joint], -1.0 if most is lowest else 1.0
            unit = (own, own, *capacity_units(own))[place]
            value, limit = sign * values[k, joint], sign * most[joint]
            raise PathError(time[k], arm.dof_names[joint], name, value, limit, unit)


AXES = 6
"""Joints of an arm: as many as a tool has ways to move."""
KNOTS = 401
"""Times along a path, or along each way-point's share of it, where the arm is placed."""
_SEEDS, _SEARCH, _STARTS = 96, 80, 24


@dataclass(frozen=True)
class ArmPlan:
    """Joint motion of an arm whose tool follows a path.

    Attributes:
        arm: The arm.
        path: Path of the tool.
        at: Body that carries the tool.
        position: Tool's origin in that body's axes, (3,) [m].
        orientation: Roll, pitch, yaw of the tool in that body's axes, (3,) [rad].
        time: Knots, (K,) [s].
        knots: Joint positions there, (K, 6) [rad, m].
        clearance: Least singular value of the Jacobian along the path, lengths in reaches.
    """

    arm: Robot
    path: Path
    at: str
    position: Axis
    orientation: Axis
    time: Array
    knots: Array
    clearance: float
    tool: Tool = field(repr=False, compare=False)
    __repr__ = brief

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the arm's joints."""
        return self.arm.dof_names

    @property
    def period(self) -> float | None:
        """Time after which it repeats [s]; None if it ends."""
        return self.path.period

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import CubicSpline  # slow to import, rarely needed

        ends = "periodic" if self.period else "clamped"
        return CubicSpline(self.time, self.knots, bc_type=ends)

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Joint motion at the times asked for, (N,) [s], exact to rounding."""
        asked = asked_times(time)
        end = self.time[-1]
        inside = np.mod(asked, end) if self.period else np.clip(asked, 0.0, end)
        guess = self._spline(inside)
        target = self.path.motion(asked)
        turned = rotation_from_angles(target.position[:, 3:])
        return self.tool.follow(_newton(self.tool, guess, target.position, turned, 6), target)

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values."""
        return {
            "name": self.arm.name,
            "source": self.arm.source,
            "at": self.at,
            "position": list(self.position),
            "orientation": list(self.orientation),
            "start": self.knots[0].tolist(),
            "clearance": self.clearance,
        }

    def demands(self) -> dict[str, dict[str, float]]:
        """Least and greatest position, speed, acceleration and torque of each joint [SI]."""
        motion = self.motion(np.linspace(0.0, self.time[-1], 4 * len(self.time)))
        torque = self.tool.torque(motion)
        return {
            name: {
                "least": float(motion.position[:, k].min()),
                "greatest": float(motion.position[:, k].max()),
                "speed": float(np.abs(motion.velocity[:, k]).max()),
                "acceleration": float(np.abs(motion.acceleration[:, k]).max()),
                "torque": float(np.abs(torque[:, k]).max()),
            }
            for k, name in enumerate(self.joints)
        }


def plan_arm(
    arm: Robot,
    path: Path,
    *,
    at: str = "tool",
    position: Axis = (0.0, 0.0, 0.0),
    orientation: Axis = (0.0, 0.0, 0.0),
    start: ArrayLike | None = None,
) -> ArmPlan:
    """Joint motion that carries a tool along a path, within the arm's limits.

    Args:
        arm: Six joints on the world, its limits of position, speed, acceleration and
            effort those of its file.
        path: Path of the tool in the world.
        at: Body that carries the tool.
        position: Tool's origin in that body's axes, (3,) [m].
        orientation: Roll, pitch, yaw of the tool in that body's axes, (3,) [rad].
        start: Joint positions near which to begin, (6,) [rad, m]; by default the ways to
            begin are searched, and the one farthest from singularities is taken.

    Raises:
        ParameterError: If the arm has not six joints, floats, or lacks the body.
        ShapeError: If `start` is not (6,).
        PathError: If no way to begin leads along the path: what stops the one that gets
            farthest, which joint, when, how much and how much would be allowed.
    """
    if arm.dof != AXES or arm.floating:
        raise ParameterError("arm", f"one of {AXES} joints on the world", f"{arm.name}, {arm.dof}")
    tool = Tool(arm, at, position, orientation)
    span = span_of(path)
    count = max(KNOTS, min(20_001, 20 * len(getattr(path, "time", ())) + 1))
    time = np.linspace(0.0, span, count)
    target = path.motion(time)
    planned: list[tuple[float, Array]] = []
    refused: list[PathError] = []
    for branch in _branches(arm, tool, time, target, start):
        try:
            clearance = _check_branch(arm, tool, time, target, branch, path.period)
            planned.append((clearance, branch))
        except PathError as error:
            refused.append(error)
    if not planned:
        raise max(refused, key=lambda error: error.time, default=_away(0.0))
    clearance, knots = max(planned, key=itemgetter(0))
    if path.period:
        knots[-1] = knots[0]
    return ArmPlan(arm, path, at, position, orientation, time, knots, clearance, tool)


@dataclass(frozen=True)
class CarriedGait:
    """Gait of a robot composed with its arm: the arm's plan, then the robot's own gait.

    Attributes:
        joints: Actuated joints of the composed robot.
        plan: Plan of the arm.
        gait: Gait of the robot.
    """

    joints: tuple[str, ...]
    plan: ArmPlan
    gait: Gait

    @property
    def period(self) -> float | None:
        """Never, as a whole, unless one of the two stands still."""
        still = self.gait.period is None
        return self.plan.period if still else None

    def motion(self, time: ArrayLike) -> PrescribedMotion:
        """Motion of arm and robot at the times asked for, (N,) [s]."""
        parts = zip(self.plan.motion(time), self.gait.motion(time), strict=True)
        return PrescribedMotion(*map(np.hstack, parts))

    def describe(self) -> dict[str, Any]:
        """Description, as JSON-able values."""
        return {
            "kind": "carried",
            "joints": list(self.joints),
            "path": self.plan.path.describe(),
            "arm": self.plan.describe(),
            "gait": self.gait.describe(),
        }


@checked
def carried_gait(robot: Robot, plan: ArmPlan, gait: Gait) -> CarriedGait:
    """Gait of a composed robot (`Robot.mounted_on`): its arm follows a plan.

    Raises:
        ParameterError: If the joints are not those of the two.
    """
    names, parts = robot.actuated_names, (*plan.joints, *gait.joints)
    if len(names) != len(parts) or any(
        not own.endswith(part) for own, part in zip(names, parts, strict=True)
    ):
        raise ParameterError("gait", f"joints {', '.join(names)}", ", ".join(parts))
    return CarriedGait(names, plan, gait)


def track_tool(
    tool: Tool, time: Array, placed: tuple[Array, Array], start: Array, knots: int
) -> Array:
    """Joint positions that hold a tool where it was, from one time to the next, (N, 6).

    Args:
        tool: Tool of the arm.
        time: Increasing, (N,) [s].
        placed: Where it was, (N, 3) [m], and its rotations to the world, (N, 3, 3).
        start: Joint positions near which it began, (6,) [rad, m].
        knots: Times followed one by one; the others from a spline through them.

    Raises:
        PathError: If the arm does not reach.
    """
    from scipy.interpolate import CubicSpline  # slow to import, rarely needed

    place, turned = placed
    chosen = thin(np.arange(len(place)), knots)
    found = [_damped_newton(tool, start[None], place[:1], turned[:1])[0]]
    for k in chosen[1:]:
        here = slice(k, k + 1)
        found.append(_newton(tool, found[-1][None], place[here], turned[here], 12)[0])
    guess = np.array(found)
    if len(chosen) < len(place):
        guess = CubicSpline(time[chosen], guess)(time)
    q = _newton(tool, guess, place, turned, 6)
    error, _ = _error(tool, q, place, turned)
    if not np.abs(error).max() < CLOSED:
        lost = int(np.argmax(~(np.abs(error).max(axis=1) < CLOSED)))
        raise _away(float(time[lost]), float(np.linalg.norm(error[lost, :3])), "robot")
    return q


def _newton(tool: Tool, q: Array, place: Array, turned: Array, steps: int) -> Array:
    """Joint positions that put the tool on the path, by Newton's method, (N, 6)."""
    for _ in range(steps):
        error, jacobian = _error(tool, q, place, turned)
        if not np.isfinite(error).all() or np.abs(error).max() < 1e-13:
            break
        q = q + solve_each(jacobian, error)
    return q


def _damped_newton(tool: Tool, q: Array, place: Array, turned: Array) -> Array:
    """Joint positions that put the tool there, from afar, (S, 6).

    Damped far away, Newton's method at the end.
    """
    for _ in range(_SEARCH):
        error, jacobian = _error(tool, q, place, turned)
        size = np.linalg.norm(error, axis=1)[:, None, None]
        across = np.swapaxes(jacobian, 1, 2)
        square = across @ jacobian + 1e-2 * np.minimum(size, 1.0) ** 2 * np.eye(AXES)
        square = square + 1e-15 * np.eye(AXES)
        step = solve_each(square, (across @ error[..., None])[..., 0])
        q = q + step / np.maximum(1.0, np.abs(step).max(axis=1, keepdims=True) / 0.5)
    return q


def _error(tool: Tool, q: Array, place: Array, turned: Array) -> tuple[Array, Array]:
    """From tool to path, linear then angular, (N, 6), and the Jacobian, (N, 6, 6)."""
    position, rotation, jacobian = tool.pose(q)
    turn = rotation_vector(turned @ np.swapaxes(rotation, 1, 2))
    return np.hstack([place[:, :3] - position, turn]), jacobian


def _branches(
    arm: Robot, tool: Tool, time: Array, target: PrescribedMotion, start: ArrayLike | None
) -> Iterator[Array]:
    """Joint positions along the path for each way to begin, (K, 6) each; NaN where it ends."""
    starts = _starts(arm, tool, target, start)
    turned = rotation_from_angles(target.position[:, 3:])
    knots = np.full((len(time), *starts.shape), np.nan)
    knots[0] = starts
    for k in range(1, len(time)):
        q = 2 * knots[k - 1] - knots[max(k - 2, 0)]
        place = np.broadcast_to(target.position[k], (len(q), 6))
        aim = np.broadcast_to(turned[k], (len(q), 3, 3))
        for _ in range(6):
            error, jacobian = _error(tool, np.nan_to_num(q), place, aim)
            step, sound = np.zeros_like(error), np.abs(np.linalg.det(jacobian)) > 1e-12
            step[sound] = solve_each(jacobian[sound], error[sound])
            q = q + step
            if np.nanmax(np.abs(step), initial=0.0) < 1e-12:
                break
        error, _ = _error(tool, np.nan_to_num(q), place, aim)
        lost = (np.abs(error).max(axis=1) > CLOSED) | (np.abs(q - knots[k - 1]).max(axis=1) > 0.5)
        q[lost] = np.nan  # it jumped to another branch, or cannot reach
        knots[k] = q
    yield from np.swapaxes(knots, 0, 1)


def _starts(arm: Robot, tool: Tool, target: PrescribedMotion, start: ArrayLike | None) -> Array:
    """Ways to put the tool where the path begins, (S, 6), each within the limits if it can."""
    if start is not None:
        seeds = real_array("start", start, (AXES,))[None]
    else:
        low, high = np.clip([arm.lower, arm.upper], -np.pi, np.pi)
        seeds = np.random.default_rng(0).uniform(low, high, (_SEEDS, AXES))
    place = np.broadcast_to(target.position[0], (len(seeds), 6))
    turned = rotation_from_angles(place[:, 3:])
    q = _damped_newton(tool, seeds, place, turned)
    error, _ = _error(tool, q, place, turned)
    found = q[np.abs(error).max(axis=1) < 1e-8]
    if start is None:
        found = _without_repeats(_unwind(arm, found))
    if not len(found):
        near = float(np.linalg.norm(error[:, :3], axis=1).min())
        raise _away(0.0, near, "path's start")
    return np.asarray(found[:_STARTS])


def _unwind(arm: Robot, q: Array) -> Array:
    """Angles by whole turns nearest to the middle of their limits."""
    low, high = np.array(arm.lower), np.array(arm.upper)
    middle = np.where(np.isfinite(low + high), (low + high) / 2, 0.0)
    turns = np.array([unit == "rad" for unit in arm.dof_units])
    return q - turns * 2 * np.pi * np.round((q - middle) / (2 * np.pi))


def _without_repeats(q: Array) -> Array:
    kept: list[Array] = []
    for one in q:
        if all(np.abs(one - other).max() > 1e-4 for other in kept):
            kept.append(one)
    return np.array(kept).reshape(-1, AXES)

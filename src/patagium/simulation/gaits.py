"""Gaits: position, velocity and acceleration of the actuated joints at any time.

A gait prescribes its joints exactly; the torques that this takes come out of the
dynamics. A name such as `plunge` addresses `left_plunge` and `right_plunge`
together (the coordinates are mirrored, so equal values are a symmetric motion);
an exact coordinate name addresses that one. Neglected: actuator dynamics, start-up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from patagium.arguments import checked, of_kind
from patagium.arrays import Array
from patagium.errors import ParameterError, finite, positive, suggest_names
from patagium.robot import Robot
from patagium.robot.assembly import beyond_limits
from patagium.robot.linkage import Linkage
from patagium.simulation.arm import carried_gait
from patagium.simulation.gait_models import (
    FourierGait,
    Gait,
    LinkageGait,
    PrescribedMotion,
    SuperposedGait,
    TableGait,
    leads,
    read_gait_table,
    superposition,
)
from patagium.whole_file import write_whole

__all__ = [
    "Gait",
    "PrescribedMotion",
    "carried_gait",
    "check_gait",
    "cruise",
    "fourier",
    "from_csv",
    "linkage",
    "sinusoidal",
    "still",
    "superposed",
    "to_csv",
]
suggest_names(__name__)


AnyGait = TypeVar("AnyGait", bound=Gait)
LIMIT_SAMPLES = 2001
"""Times in one period at which a gait is held against the joint limits."""
FOUND = 1e-3
"""Excess over a limit that a gait found by a search may have between its nodes [rad, m]."""


@checked
def sinusoidal(
    robot: Robot,
    *,
    frequency: float,
    phase: Mapping[str, float] | None = None,
    offset: Mapping[str, float] | None = None,
    **amplitude: float,
) -> FourierGait:
    """Gait of one sine a joint: offset + amplitude sin(2 pi f t + phase).

    Args:
        robot: The machine.
        frequency: Beats a second f [Hz].
        phase: Lead of joints by name [rad]; 0 where not named.
        offset: Mean of joints by name [rad, m]; 0 where not named.
        **amplitude: Amplitude of joints by name, such as `plunge=0.6` [rad, m].

    Raises:
        ParameterError: If no actuated joint bears a name, or a limit or a turn is exceeded.
    """
    lead, size = _by_joint(robot, leads(phase)), _by_joint(robot, amplitude)
    rate, mean = positive("frequency", frequency), _by_joint(robot, offset or {})
    return _series(robot, rate, mean, (size * np.sin(lead))[None], (size * np.cos(lead))[None])


@checked
def fourier(
    robot: Robot,
    *,
    frequency: float,
    **series: tuple[float, Sequence[tuple[float, float]]],
) -> FourierGait:
    """Gait of a Fourier series a joint: mean + sum_k c_k cos(k x) + s_k sin(k x), x = 2 pi f t.

    Args:
        robot: The machine.
        frequency: Beats a second f [Hz].
        **series: Series of joints by name: mean, pairs (c_k, s_k), k = 1, 2, ... [rad, m].

    Raises:
        ParameterError: If no actuated joint bears a name, or a limit is exceeded.
    """
    order = max((len(pairs) for _, pairs in series.values()), default=0)

    def coefficients(part: int) -> Array:
        found = np.zeros((order, len(robot.actuated)))
        for k in range(order):
            named = {n: pairs[k][part] for n, (_, pairs) in series.items() if k < len(pairs)}
            found[k] = _by_joint(robot, named)
        return found

    rate = positive("frequency", frequency)
    mean = _by_joint(robot, {name: mean for name, (mean, _) in series.items()})
    return _series(robot, rate, mean, coefficients(0), coefficients(1))


@checked
def linkage(
    robot: Robot,
    *,
    frequency: float,
    linkage: Linkage | None = None,
    plunge_offset: float = 0.0,
    elbow_offset: float = 0.0,
) -> LinkageGait:
    """Gait of the seven-bar linkage, its crank turning at a constant rate.

    The linkage gives the absolute angles of humerus J5 and radius J6 in the plane
    across the body, positive upwards on either side as plunge and elbow are. So
    plunge = J5 + plunge_offset and elbow = J6 - J5 + elbow_offset; an offset is how
    the linkage is mounted on the body. The wing is spread on the way down and folded
    on the way up. Other joints stay at zero; add a gait with `superposed`.

    Args:
        robot: The machine; it needs the joints plunge and elbow on either side.
        frequency: Turns of the crank a second [Hz].
        linkage: Lengths of the bars, the Aerobat's by default.
        plunge_offset: Added to both plunge angles [rad].
        elbow_offset: Added to both elbow angles [rad].

    Raises:
        ParameterError: If a joint is missing, or a limit is exceeded.
    """
    check_linkage(robot)
    offset = _by_joint(robot, {"plunge": plunge_offset, "elbow": elbow_offset})
    gait = LinkageGait(
        joints=_joints(robot),
        frequency=positive("frequency", frequency),
        linkage=linkage if linkage is not None else Linkage(),
        offset=offset,
        plunge=_by_joint(robot, {"plunge": 1.0}) != 0,
        elbow=_by_joint(robot, {"elbow": 1.0}) != 0,
    )
    return _within_limits(robot, gait)


def check_linkage(robot: Robot) -> None:
    """Refuse a robot without the joints of the linkage.

    Raises:
        ParameterError: If it has no plunge or no elbow.
    """
    if not (robot.joints_named("plunge") and robot.joints_named("elbow")):
        expected = "joints plunge and elbow on either side for a linkage"
        raise ParameterError("gait", expected, f"{robot.name} with {', '.join(_joints(robot))}")


@checked
def from_csv(robot: Robot, path: str | Path, *, period: float | None = None) -> TableGait:
    """Gait measured or designed elsewhere: one period in a table, repeated for ever.

    Splined by a periodic cubic: position and velocity are smooth, the acceleration
    is continuous. Joints without a column stay at zero. Time counts from the first row.

    Args:
        robot: The machine.
        path: CSV file with a header: a time column and columns named as joints, each
            with its unit in brackets, such as `time [s], plunge [deg]`.
        period: Time after which it repeats [s]. Without it the last row must repeat the first one.

    Raises:
        LogError: If the table cannot be used as it stands; it says why.
        ParameterError: If a column is no actuated joint, or a limit is exceeded.
    """
    time, positions = read_gait_table(robot, Path(path), period)
    rows = zip(*positions.values(), strict=True)
    position = [_by_joint(robot, dict(zip(positions, row, strict=True))) for row in rows]
    gait = TableGait(
        joints=_joints(robot), source=Path(path).name, time=time, position=np.array(position)
    )
    return _within_limits(robot, gait)


@checked
def to_csv(robot: Robot, gait: Gait, path: str | Path) -> None:
    """Table of one period of a gait, as `from_csv` reads it; whole or not at all.

    Raises:
        ParameterError: If the gait does not move, or is another robot's.
        OutputError: If the file cannot be written.
    """
    check_gait(robot, gait)
    if gait.period is None:
        raise ParameterError("gait", "a gait that moves", gait)
    time = gait.period * np.arange(_ROWS + 1) / _ROWS
    position = gait.motion(time).position
    position[-1] = position[0]  # of a period, to the last bit
    units = [robot.dof_units[i] for i in robot.actuated]
    named = zip(gait.joints, units, strict=True)
    heads = ["time [s]", *(f"{joint} [{unit}]" for joint, unit in named)]
    rows = [",".join(map(repr, row)) for row in np.column_stack([time, position]).tolist()]
    write_whole(path, "\n".join([",".join(heads), *rows, ""]))


_ROWS = 400
"""Rows of a period, whose spline is off by 1e-8 of a third harmonic."""


@checked
def still(robot: Robot, **position: float) -> FourierGait:
    """Gait of a robot that holds its joints.

    Args:
        robot: The machine.
        **position: Position of joints by name [rad, m]; 0 where not named.

    Raises:
        ParameterError: If no actuated joint bears a name, or a limit is exceeded.
    """
    none = np.zeros((0, len(robot.actuated)))
    return _series(robot, 0.0, _by_joint(robot, position), none, none)


@checked
def cruise(robot: Robot, frequency: float | None = None) -> FourierGait:
    """Gait of the section `cruise` in the robot's file: one sine a joint, or joints held.

    Args:
        robot: The machine.
        frequency: Beats a second [Hz]; the file's by default.

    Raises:
        ParameterError: If the robot's file has no such section, or a joint's limit is exceeded.
    """
    own = robot.cruise
    if own is None:
        kind = "a robot" if robot.strips else "a robot with wings"
        expected = f"{kind} whose file has a section cruise, as patagium robots --new writes it"
        raise ParameterError("robot", expected, robot.name)
    frequency = own.frequency if frequency is None else frequency
    if frequency is None:
        return still(robot, **own.offset)
    return sinusoidal(
        robot, frequency=frequency, phase=own.phase, offset=own.offset, **own.amplitude
    )


def level_start(robot: Robot, speed: float, pitch: float) -> tuple[Array, Array]:
    """Coordinates and velocities of a flight that begins level, springs at rest [SI].

    Args:
        robot: The machine.
        speed: Forward [m/s].
        pitch: Angle of the body, positive nose down [rad].

    Raises:
        ParameterError: If it does not float, and has a speed or pitch.
    """
    if base := robot.floating_dofs:
        ahead, nose = robot.dof_names[base[0]], robot.dof_names[base[4]]
        q = robot.coordinates(**robot.resting, **{nose: pitch})
        return q, robot.velocities(**{ahead: speed})
    if speed or pitch:
        name = "speed" if speed else "pitch"
        raise ParameterError(name, "a robot that floats; use a wind", robot.name)
    return robot.coordinates(**robot.resting), robot.velocities()


def superposed(robot: Robot, *parts: Gait) -> SuperposedGait:
    """Gait whose joint positions are the sum of its parts, such as linkage and feathering.

    Args:
        robot: The machine.
        *parts: Gaits of the same robot, at least one; the longest of their periods is a
            whole number of each of the others.

    Raises:
        ParameterError: If a part moves another robot's joints, the sum does not repeat,
            or a limit is exceeded.
    """
    return _within_limits(robot, superposition(parts, partial(check_gait, robot)))


@checked
def check_gait(robot: Robot, gait: Gait) -> None:
    """Refuse a gait of another robot's joints.

    Raises:
        ParameterError: If its joints are not the robot's actuated ones.
    """
    if tuple(gait.joints) != _joints(robot):
        expected = f"a gait of {robot.name!r}, of the joints {', '.join(_joints(robot))}"
        raise ParameterError("gait", expected, ", ".join(gait.joints))


def _joints(robot: Robot) -> tuple[str, ...]:
    of_kind("robot", robot, Robot)
    return robot.actuated_names


def _by_joint(robot: Robot, values: Mapping[str, float]) -> Array:
    """Values by name as a vector over the actuated joints, (n_a,); 0 where not named."""
    joints = _joints(robot)
    out: Array = np.zeros(len(joints))
    named: dict[str, str] = {}
    for name, value in values.items():
        targets = robot.joints_named(name)
        if not targets:
            known = [*joints, *robot.joint_groups]
            expected = f"an actuated joint of {robot.name} ({', '.join(joints)}) or a pair"
            raise ParameterError(name, expected, name, known)
        for joint in targets:
            if joint in named:
                raise ParameterError(name, f"{joint} named once", f"also as {named[joint]!r}")
            named[joint] = name
            out[joints.index(joint)] = finite(name, value)
    return out


def _series(robot: Robot, frequency: float, mean: Array, cosine: Array, sine: Array) -> FourierGait:
    """Fourier series of the joints, within their limits."""
    return _within_limits(robot, FourierGait(_joints(robot), frequency, mean, cosine, sine))


def _within_limits(robot: Robot, gait: AnyGait) -> AnyGait:
    check_limits(robot, gait, 0.0, 0.0)
    return gait


def check_limits(robot: Robot, gait: Gait, duration: float, margin: float = FOUND) -> None:
    """Refuse a gait that takes a joint beyond its limits.

    Args:
        robot: The machine.
        gait: Gait of its joints.
        duration: Time that is flown, of which a gait without a period is looked at [s].
        margin: Excess that is no error: that of gaits which a search found [rad, m].

    Raises:
        ParameterError: If a joint goes beyond.
    """
    times = np.linspace(0.0, gait.period or duration, LIMIT_SAMPLES)
    position = gait.motion(times).position
    ends = np.nanmin(position, axis=0), np.nanmax(position, axis=0)
    for joint, dof, low, high in zip(gait.joints, robot.actuated, *ends, strict=True):
        least, most = min(low + margin, high), max(high - margin, low)
        if beyond_limits(robot, dof, least, most) and (
            seen := beyond_limits(robot, dof, low, high)
        ):
            raise ParameterError(joint, *seen)

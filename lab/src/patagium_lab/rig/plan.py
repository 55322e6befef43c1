"""Plan of the rig: a robot in front of a fan, an arm that carries it, and instruments.

The arm carries the robot along a lying eight across the wind while its linkage flaps. Instruments
have the figures of their data sheets, each its own clock and delay. Neglected: the arm's own
errors and what a fan does to the air besides moving it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from math import ceil, pi
from typing import Any

from patagium.aerodynamics import Air
from patagium.errors import ParameterError
from patagium.robot import Robot, load_robot
from patagium.sensing.sensors import MotorCurrent, Sensor, presets
from patagium.simulation import gaits, mounts, paths
from patagium.simulation.gaits import Gait
from patagium.simulation.mounts import Mount
from patagium_lab.jobs import WORKERS

CENTER = (0.65, 0.0, 0.2)
"""Center of all paths, relative to the arm's foot [m]."""
EIGHT = (0.9, 0.3)
"""Length (to the side) and width (up) of the lying eight [m]."""
CIRCLE = (0.25, 0.75)
"""Radius of the circle never seen [m], and its speed over that of the eight."""
SLOWER = 0.8
"""Frequency of the gait never seen over that of the one learned."""
TOOL = (0.0, -pi / 2, 0.0)
"""Roll, pitch, yaw of the robot on the arm's flange: its nose looks into the wind [rad]."""
STEPS = 1000
"""Steps of the simulation in a wingbeat."""
UNSEEN = ("gait", "path", "path and gait")
"""Flights that are not learned, by what is new in them."""
LATE = {"encoders": 0.012, "cameras": -0.007}
"""Clock offsets that the second half of the program does not know [s]."""
UNIT, WING_UNIT, ENCODERS, CAMERAS = "unit", "wing_unit", "encoders", "cameras"
CELL, MOTORS = "cell", "motors"
"""Names of the instruments in a log."""

_SHUNT, _TORQUE_CONSTANT, _RESERVE = 0.05, 1.5e-3, 1.5


MISTAKE = 1e-3
"""Error of a clock in the cases of a wrong clock [s]."""


@dataclass(frozen=True)
class LimitCase:
    """One thing that is changed against the rig as it is.

    Attributes:
        name: The change in words.
        ideal: Instruments with a tenth of their errors.
        wrong: Errors of clocks that nobody corrects, by instrument [s].
        order: Order of the smoother of motion.
    """

    name: str
    ideal: tuple[str, ...] = ()
    wrong: tuple[tuple[str, float], ...] = ()
    order: int = 4


LIMIT_CASES = (
    LimitCase("as on the data sheets, clocks known"),
    LimitCase("encoders, a tenth of the errors", (ENCODERS,)),
    LimitCase("inertial units, a tenth of the errors", (UNIT, WING_UNIT)),
    LimitCase("cameras, a tenth of the errors", (CAMERAS,)),
    LimitCase("load cell and motors, a tenth of the errors", (CELL, MOTORS)),
    LimitCase("encoders .1 ms late", wrong=((ENCODERS, 1e-4),)),
    LimitCase("encoders 1 ms late", wrong=((ENCODERS, MISTAKE),)),
    LimitCase("cameras 1 ms late", wrong=((CAMERAS, MISTAKE),)),
    LimitCase("load cell 1 ms late", wrong=((CELL, MISTAKE),)),
    LimitCase("white jerk in the smoother, not snap", order=3),
)


@dataclass(frozen=True)
class RigPlan:
    """Flights, instruments and learner of the rig.

    Args:
        robot: Preset or file, with plunge and elbow on either side.
        arm: Preset or file of the arm.
        frequency: Frequency of the wingbeat [Hz].
        speed: Largest speed of the arm along the eight [m/s].
        wind: Speed of the fan's wind, against the nose [m/s].
        noise: Errors of the instruments over those of their data sheets [1].
        eights: Number of eights that are flown, rounded up to a whole wingbeat.
        unseen_beats: Wingbeats of each flight that is not learned.
        rate: Rate of all instruments except the cameras [Hz].
        every: One sample in this many is learned.
        seed: Seed of the instruments' errors.
        limits: Names of the `LIMIT_CASES` that are run.
        workers: Number of processes; 0: everything runs in this process.

    Raises:
        ParameterError: If a number is out of its range.
    """

    robot: str = "aerobat"
    arm: str = "ur5e"
    frequency: float = 5.0
    speed: float = 2.0
    wind: float = 3.0
    noise: tuple[float, ...] = (0.0, 1.0, 2.0, 4.0)
    eights: float = 2.0
    unseen_beats: int = 6
    rate: float = 500.0
    every: int = 2
    seed: int = 0
    limits: tuple[str, ...] = tuple(case.name for case in LIMIT_CASES)
    workers: int = WORKERS

    def __post_init__(self) -> None:
        for name in ("frequency", "speed", "wind", "eights", "rate"):
            if not getattr(self, name) > 0:
                raise ParameterError(name, "a positive number", getattr(self, name))
        if not self.noise or min(self.noise) < 0 or len(set(self.noise)) < len(self.noise):
            raise ParameterError("noise", "different factors, zero or more", self.noise)
        if self.unseen_beats < 2:
            raise ParameterError("unseen_beats", "at least 2 wingbeats", self.unseen_beats)

    @property
    def beat(self) -> float:
        """Time of a wingbeat [s]."""
        return 1.0 / self.frequency

    def air(self) -> Air:
        """Still air moved by the fan."""
        return Air(wind=(-self.wind, 0.0, 0.0))

    def describe(self) -> dict[str, Any]:
        """All choices, JSON-able."""
        return asdict(self) | {"limits": bool(self.limits)}


@dataclass(frozen=True)
class Motion:
    """One flight of the rig.

    Attributes:
        mount: The arm on its path.
        gait: Motion of the wings.
        duration: Duration, whole wingbeats [s].
        time_step: Time step of the simulation [s].
    """

    mount: Mount
    gait: Gait
    duration: float
    time_step: float


def learned_motion(plan: RigPlan, robot: Robot) -> Motion:
    """The flight that is learned: the lying eight.

    Args:
        plan: Plan of the rig.
        robot: The machine.

    Raises:
        PathError: If the arm cannot follow at that speed.
    """
    mount = _on_arm(plan, _eight(plan))
    period = mount.path.period if mount.path is not None else None
    beats = ceil(plan.eights * (period or plan.beat) / plan.beat - 1e-9)
    return _motion(robot, mount, plan.frequency, beats)


def unseen_motion(plan: RigPlan, robot: Robot, name: str) -> Motion:
    """A flight that is not learned.

    Args:
        plan: Plan of the rig.
        robot: The machine.
        name: One of `UNSEEN`.
    """
    path = _circle(plan) if "path" in name else _eight(plan)
    frequency = plan.frequency * (SLOWER if "gait" in name else 1.0)
    return _motion(robot, _on_arm(plan, path), frequency, plan.unseen_beats)


def instruments(plan: RigPlan, robot: Robot, largest_torque: float) -> list[Sensor]:
    """Instruments that measure the flight, with the errors of their data sheets.

    The unit on the body is the clock of the rig, and triggers load cell and amplifiers.

    Args:
        plan: Plan of the rig.
        robot: The machine.
        largest_torque: Largest torque of a joint, for which the gears are chosen [N m].
    """
    body, wing = carriers(robot)
    cameras = presets.prime_x_13(body)
    amplifier = presets.ina226(
        torque_constant=_TORQUE_CONSTANT, gear_ratio=1.0, shunt=_SHUNT, rate=plan.rate
    )
    return [
        replace(presets.icm_42688_p(body, plan.rate), name=UNIT),
        replace(presets.icm_42688_p(wing, plan.rate), name=WING_UNIT),
        replace(presets.as5600(rate=plan.rate), name=ENCODERS, clock_offset=LATE[ENCODERS]),
        replace(cameras, name=CAMERAS, clock_offset=LATE[CAMERAS]),
        replace(presets.nano17(body, plan.rate), name=CELL),
        replace(amplifier, name=MOTORS, gear_ratio=_gear(amplifier, largest_torque)),
    ]


def scaled(sensors: Sequence[Sensor], factor: float) -> list[Sensor]:
    """Instruments with all errors, except clocks and delays, times a factor."""
    return [sensor.scaled(factor) for sensor in sensors]


def carriers(robot: Robot) -> tuple[str, str]:
    """Bodies that carry the inertial units: the floating one, and the first that it moves.

    Raises:
        ParameterError: If there is none of either.
    """
    base = [body.name for body in robot.bodies if body.floating_dofs is not None]
    moved = [body.name for body in robot.bodies if body.floating_dofs is None and body.joints]
    if len(base) != 1 or not moved:
        raise ParameterError("robot", "one floating body with joints on it", robot.name)
    return base[0], moved[0]


def _gear(amplifier: MotorCurrent, largest: float) -> float:
    """Ratio with which the amplifier's range holds the largest torque, with a reserve."""
    held = amplifier.force_per_current * (amplifier.range or 1.0)
    return max(1.0, _RESERVE * largest / held)


def _motion(robot: Robot, mount: Mount, frequency: float, beats: int) -> Motion:
    gait = gaits.linkage(robot, frequency=frequency)
    return Motion(mount, gait, beats / frequency, 1.0 / (STEPS * frequency))


def _eight(plan: RigPlan) -> paths.Path:
    side, up = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    return paths.figure_of_eight(CENTER, *EIGHT, speed=plan.speed, along=side, across=up)


def _circle(plan: RigPlan) -> paths.Path:
    radius, share = CIRCLE
    return paths.circle(CENTER, radius, speed=share * plan.speed, normal=(1.0, 0.0, 0.0))


def _on_arm(plan: RigPlan, path: paths.Path) -> Mount:
    return mounts.on_arm(load_robot(plan.arm), path, orientation=TOOL)

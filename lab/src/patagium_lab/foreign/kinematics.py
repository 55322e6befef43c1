"""Wingbeats of the foreign flights: a seeded set that fills the space of gaits evenly.

Each wingbeat has a frequency, a speed, a body pitch, and amplitude, phase and mean of each joint,
from a Latin hypercube whose rows are spread by its discrepancy. Neglected: harmonics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from patagium.errors import ParameterError
from patagium.robot import Robot
from patagium.simulation import gaits
from patagium.simulation.gait_models import FourierGait

Range = tuple[float, float]

FARTHEST = 0.4
"""Largest distance of a wingbeat near another one [1]."""
_DRAWS = 1000  # of a direction, at most


@dataclass(frozen=True)
class JointRange:
    """Range of a joint's sine: offset + amplitude sin(2 pi f t + phase).

    Attributes:
        name: Name of the joint or, without its side, of the pair of joints.
        amplitude: Least and largest amplitude [rad].
        phase: Least and largest phase [rad].
        offset: Least and largest mean [rad].
    """

    name: str
    amplitude: Range
    phase: Range = (0.0, 0.0)
    offset: Range = (0.0, 0.0)


@dataclass(frozen=True)
class GaitRange:
    """Range of the wingbeats of a robot.

    Attributes:
        frequency: Least and largest frequency [Hz].
        speed: Least and largest forward speed [m/s].
        incidence: Least and largest angle of the nose above the path [rad].
        joints: Ranges of the joints; others hold still.
    """

    frequency: Range
    speed: Range
    incidence: Range
    joints: tuple[JointRange, ...]

    @property
    def rows(self) -> tuple[Range, ...]:
        """Range of each number of a wingbeat, in the order of `Wingbeat.of`."""
        parts = [(one.amplitude, one.phase, one.offset) for one in self.joints]
        return (
            self.frequency,
            self.speed,
            self.incidence,
            *(row for part in parts for row in part),
        )


@dataclass(frozen=True)
class Wingbeat:
    """A gait with the speed and the attitude of the body.

    Attributes:
        frequency: Frequency [Hz].
        speed: Forward speed [m/s].
        incidence: Angle of the nose above the path [rad].
        amplitude: Amplitude of each joint by name [rad].
        phase: Phase of each joint by name [rad].
        offset: Mean of each joint by name [rad].
    """

    frequency: float
    speed: float
    incidence: float
    amplitude: dict[str, float]
    phase: dict[str, float]
    offset: dict[str, float]

    @classmethod
    def of(cls, numbers: Sequence[float], names: Sequence[str]) -> Wingbeat:
        """Wingbeat of its numbers.

        Args:
            numbers: Frequency, speed, incidence, then amplitude, phase and offset of each joint.
            names: Names of the joints.
        """
        frequency, speed, incidence, *rest = (float(value) for value in numbers)
        series = (dict(zip(names, rest[k::3], strict=True)) for k in range(3))
        return cls(frequency, speed, incidence, *series)

    def gait(self, robot: Robot) -> FourierGait:
        """Gait of a robot.

        Args:
            robot: The machine.

        Raises:
            ParameterError: If the robot lacks a joint, or a limit is exceeded.
        """
        return gaits.sinusoidal(
            robot,
            frequency=self.frequency,
            phase=self.phase,
            offset=self.offset,
            **self.amplitude,
        )


@cache
def draw_wingbeats(ranges: GaitRange, count: int, seed: int) -> tuple[Wingbeat, ...]:
    """Wingbeats that fill the ranges evenly.

    Args:
        ranges: Ranges of the wingbeats.
        count: Number of wingbeats.
        seed: Seed of the set.
    """
    low, high = np.array(ranges.rows).T
    cube = qmc.LatinHypercube(len(low), optimization="random-cd", seed=seed)
    points = low + cube.random(count) * (high - low)
    names = [one.name for one in ranges.joints]
    return tuple(Wingbeat.of(row, names) for row in points)


def near_wingbeat(
    wingbeat: Wingbeat, distance: float, seed: Sequence[int], robot: Robot
) -> Wingbeat:
    """Wingbeat near another one, in a direction that the seed draws.

    Frequency, speed and amplitudes are multiplied by 1 + d e, phases change by d e rad, the body
    pitch and the means of joints by d e times the largest amplitude, with d the distance and e of
    each number from -1 to 1, the largest of them 1 or -1. Joints that hold still stay so, and
    means of joints that have none. A direction that leads beyond a joint's limit within
    `FARTHEST` is drawn again, so that all distances share their directions.

    Args:
        wingbeat: The other wingbeat.
        distance: Largest change d, at most `FARTHEST` [1].
        seed: Seed of the direction.
        robot: Robot whose joints' limits hold.

    Raises:
        ParameterError: If no direction stays within the limits.
    """
    draw = np.random.default_rng(seed)
    for _ in range(_DRAWS):
        drawn = draw.uniform(-1.0, 1.0, 3 + 3 * len(wingbeat.amplitude))
        drawn /= np.abs(drawn).max()
        try:
            _moved(wingbeat, FARTHEST * drawn).gait(robot)
        except ParameterError:
            continue
        return _moved(wingbeat, distance * drawn)
    raise ParameterError("wingbeat", "one with room to the limits of the joints", wingbeat)


def _moved(wingbeat: Wingbeat, by: NDArray[np.float64]) -> Wingbeat:
    """Wingbeat whose numbers change by given shares, in the order of `Wingbeat.of`."""
    largest = max(wingbeat.amplitude.values())
    amplitude, phase, offset = (by[3 + k :: 3] for k in range(3))
    names = list(wingbeat.amplitude)
    means = [wingbeat.offset[name] for name in names]
    return Wingbeat(
        float(wingbeat.frequency * (1 + by[0])),
        float(wingbeat.speed * (1 + by[1])),
        float(wingbeat.incidence + largest * by[2]),
        {n: float(wingbeat.amplitude[n] * (1 + e)) for n, e in zip(names, amplitude, strict=True)},
        {n: float(wingbeat.phase[n] + e) for n, e in zip(names, phase, strict=True)},
        {
            n: float(mean + largest * e if mean else 0.0)
            for n, mean, e in zip(names, means, offset, strict=True)
        },
    )

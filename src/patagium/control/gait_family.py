"""Gait family: gaits that differ in frequency, amplitudes, offsets and phases.

Parameters bear the names of `SteeredGait`'s commands and mean the same: `frequency` [Hz],
`amplitude` and `plunge_amplitude` (over the gait's own), `plunge_offset` (added to the mean)
[rad, m], `plunge_phase` (lead) [rad]; `plunge_cosine_2` and `plunge_sine_2` are added to the
coefficients of the second harmonic [rad, m]; a name ending in `_difference` is left less right.
With phase x = 2 pi f t, a joint is at q = m + o + A (g(x + l) - m) + sum_k c_k cos(k x) +
s_k sin(k x), where g is the Fourier series of the gait; of a gait that is none (a table's spline)
its first harmonics are taken.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.aerodynamics import Air
from patagium.arguments import checked
from patagium.arrays import Array, brief, real_array
from patagium.control.wingbeat import PrescribedRows
from patagium.errors import ParameterError
from patagium.robot import Robot
from patagium.robot.model import COMMANDS, Actuator
from patagium.simulation.gait_models import FourierGait, Gait
from patagium.simulation.gaits import check_gait

DIFFERENCE = "_difference"
"""End of the name of a parameter that is the left joint's value less the right one's."""
STILL_BEAT = 0.1
"""Length of a beat of a gait that stands still [s]."""
MOST_STEPS = 100_000
"""Time steps of a beat, at most: a thousandth of the usual step, and 1 GB of slopes."""
_SAMPLES = 1024  # of a period
_MOST = 64  # harmonics
_NEGLIGIBLE = 1e-13  # of the largest coefficient


def fourier_series(gait: Gait) -> FourierGait:
    """Fourier series of a gait, or itself; a gait that stands still beats without moving."""
    if isinstance(gait, FourierGait) and gait.frequency:
        return gait
    period = gait.period or STILL_BEAT
    position = gait.motion(period * np.arange(_SAMPLES) / _SAMPLES).position
    found = np.fft.rfft(position, axis=0)[: _MOST + 1] * 2.0 / _SAMPLES
    large = np.abs(found[1:]).max(axis=1, initial=0.0) > _NEGLIGIBLE * max(1.0, np.abs(found).max())
    order = int(np.flatnonzero(large)[-1]) + 1 if large.any() else 0
    harmonics = found[1 : order + 1]
    mean = found[0].real / 2
    return FourierGait(tuple(gait.joints), 1.0 / period, mean, harmonics.real, -harmonics.imag)


class _Shape(NamedTuple):
    """Frequency; amplitudes, means, leads, (n_a,); series at amplitude one, and whole series."""

    frequency: float
    amplitude: Array
    mean: Array
    lead: Array
    unscaled: NDArray[np.complex128]
    series: NDArray[np.complex128]


@dataclass(frozen=True)
class GaitFamily:
    """Gaits reached from one by some parameters.

    Attributes:
        robot: The machine.
        base: Gait whose parameters are all neutral.
        names: Names of the parameters.
        directions: What each moves: frequency, then amplitudes, offsets and phases of all
            joints, then cosines and sines of each harmonic, (p, 1 + 3 n_a + 2 order n_a).
    """

    robot: Robot
    base: FourierGait
    names: tuple[str, ...]
    directions: Array
    __repr__ = brief

    @cached_property
    def neutral(self) -> Array:
        """Values at which the gait is the base, (p,); read only."""
        known = {"frequency": self.base.frequency, "amplitude": 1.0}
        found = np.array([known.get(name.rpartition("_")[2], 0.0) for name in self.names])
        found.setflags(write=False)
        return found

    @cached_property
    def commanded(self) -> list[tuple[str, Actuator, str, int]]:
        """Actuators with their names, the kind of their commands, and the place of each joint."""
        found = []
        for name, actuator in self.robot.actuators.items():
            kind, joints = self.robot.command(name)
            found += [(name, actuator, kind, self.base.joints.index(joint)) for joint in joints]
        return found

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each parameter; amplitudes are shares of the base's."""
        known, joints = {"frequency": "Hz", "amplitude": "1", "phase": "rad"}, self.robot.actuated
        found = []
        for name, way in zip(self.names, self.directions, strict=True):
            kind = name.removesuffix(DIFFERENCE).rpartition("_")[2]
            joint = joints[(int(np.flatnonzero(way)[0]) - 1) % len(joints)]
            found.append(known.get(kind) or self.robot.dof_units[joint])
        return tuple(found)

    def gait(self, values: ArrayLike) -> FourierGait:
        """Gait for given values of the parameters, (p,) [Hz, 1, rad or m, rad]."""
        shape = self._shape(values)
        own = shape.frequency, shape.mean, shape.series.real, -shape.series.imag
        return FourierGait(self.base.joints, *own)

    def swings(self, values: ArrayLike) -> tuple[float, Array, Array, Array, Array]:
        """Frequency, amplitudes over the base's, means, leads, and positions at 513 phases.

        These are [Hz], (n_a,) [1], (n_a,) [rad, m], (n_a,) [rad] and (513, n_a) [rad, m].

        Args:
            values: (p,) [Hz, 1, rad or m, rad].
        """
        shape = self._shape(values)
        wave = _waves(256, len(shape.series)) @ shape.series
        return shape.frequency, shape.amplitude, shape.mean, shape.lead, shape.mean + wave.real

    def _shape(self, values: ArrayLike) -> _Shape:
        base, n, neutral = self.base, len(self.base.joints), self.neutral
        given = real_array("values", values, neutral.shape)
        theta = np.zeros(self.directions.shape[1])
        theta[0], theta[1 : 1 + n] = base.frequency, 1.0
        theta = theta + (given - neutral) @ self.directions
        cosine, sine = theta[1 + 3 * n :].reshape(-1, 2, n).swapaxes(0, 1)
        amplitude, offset, lead = theta[1 : 1 + 3 * n].reshape(3, n)
        order = np.arange(1, len(base.sine) + 1)[:, None]
        unscaled = (base.cosine - 1j * base.sine) * np.exp(1j * order * lead)
        mean, series = base.mean + offset, amplitude * unscaled + (cosine - 1j * sine)
        return _Shape(float(theta[0]), amplitude, mean, lead, unscaled, series)

    @checked
    def rows(self, values: ArrayLike, steps: int, air: Air) -> PrescribedRows:
        """Prescribed rows of one beat, and their derivatives by the parameters.

        Args:
            values: (p,) [Hz, 1, rad or m, rad].
            steps: Time steps of the beat, 1 to `MOST_STEPS`.
            air: The air, whose wind the rows carry.

        Raises:
            ShapeError: If there is not a value for each parameter.
            ParameterError: If there is no beat, the steps are others, or `frequency` meets a gust.
        """
        n, shape = len(self.base.joints), self._shape(values)
        frequency, way = shape.frequency, self.directions
        if not (frequency > 0 and 0 < steps <= MOST_STEPS):
            expected = f"a frequency above 0, and 1 to {MOST_STEPS} steps"
            raise ParameterError("values and steps", expected, (values, steps))
        if way[:, 0].any() and air.gust is not None:
            raise ParameterError("air", "air without a gust, for derivatives by frequency", air)
        phase = np.pi * np.arange(2 * steps + 1) / steps
        pace = 2.0 * np.pi * frequency
        order = 1j * np.arange(1, len(self.base.sine) + 1)[:, None]
        wave = _waves(steps, len(order))

        def derived(series: NDArray[np.complex128], count: int) -> Array:
            """Fourier series of the joints and its derivatives by the phase, `count` in all."""
            powers = np.hstack([series * order**k for k in range(count)])
            return np.asarray((wave @ powers).real.reshape(len(phase), count, -1))

        paced = pace ** np.arange(3)[:, None]
        own = derived(shape.unscaled, 4)
        joints = paced * derived(shape.series, 3)

        @cache
        def effect(kind: int) -> Array:
            """Derivative by amplitudes, offsets, phases, or a cosine or sine of the series."""
            if kind == 1:
                return np.tile(np.eye(3)[:, :1], (len(phase), 1, n))
            if kind > 2:
                unit = np.zeros(order.shape, complex)
                unit[(kind - 3) // 2] = 1.0 if kind % 2 else -1j
                return np.tile(paced * derived(unit, 3), n)
            return paced * (shape.amplitude * own[:, 1:] if kind else own[:, :3])

        slopes = np.zeros((len(phase), len(way), 3, n))
        for i in np.flatnonzero(way[:, 0]):
            slopes[:, i] = way[i, 0] * np.arange(3)[:, None] / frequency * joints
        for i, column in np.argwhere(way[:, 1:]):
            kind, k = divmod(column, n)
            slopes[:, i, :, k] += way[i, 1 + column] * effect(int(kind))[:, :, k]
        joints[:, 0] += shape.mean
        motion = joints.reshape(len(phase), 3 * n)
        table = np.column_stack([motion, air.uniform_wind_at(phase / pace)])
        flat, step = slopes.reshape(len(phase), len(way), 3 * n), 1.0 / (frequency * steps)
        return PrescribedRows(table, flat, step, -step / frequency * way[:, 0])


@lru_cache(maxsize=4)
def _waves(steps: int, order: int) -> NDArray[np.complex128]:
    """Harmonics of a beat every half step, (2 steps + 1, order)."""
    phase = np.pi * np.arange(2 * steps + 1) / steps
    return np.asarray(np.exp(1j * np.outer(phase, np.arange(1, order + 1))))


@checked
def gait_family(
    robot: Robot, gait: Gait, names: Mapping[str, float] | tuple[str, ...]
) -> GaitFamily:
    """Family of gaits around one.

    Args:
        robot: The machine.
        gait: Gait whose parameters are neutral.
        names: Names of the parameters.

    Raises:
        ParameterError: If a name is no parameter of this gait.
    """
    check_gait(robot, gait)
    if not 0 < len(names) == len(set(names)):
        raise ParameterError("names", "one gait parameter at least, and each once", names)
    base, still = fourier_series(gait), gait.period is None
    series = [found for name in names if (found := _SERIES.match(name))]
    order = max((int(found["harmonic"]) for found in series), default=0)
    missing = ((0, max(0, order - len(base.sine))), (0, 0))
    base = replace(base, cosine=np.pad(base.cosine, missing), sine=np.pad(base.sine, missing))
    ways = np.array([_direction(robot, base, still, name) for name in names])
    return GaitFamily(robot, base, tuple(names), ways.reshape(len(names), -1))


def symmetric_parameters(robot: Robot, gait: Gait) -> tuple[str, ...]:
    """Names of all parameters that keep a mirrored robot's gait mirrored."""
    base, found = fourier_series(gait), ["frequency"] if gait.period else []
    for name, joints in robot.joint_groups.items():
        if joints[0] in base.moving:
            found += [f"{name}_amplitude", f"{name}_phase"]
        found.append(f"{name}_offset")
    return tuple(found)


_SERIES = re.compile(r"(?P<joint>.+)_(?P<part>cosine|sine)_(?P<harmonic>[1-9]\d?)(_difference)?$")
"""Name of a parameter that adds to a coefficient of the Fourier series."""


def _direction(robot: Robot, base: FourierGait, still: bool, name: str) -> Array:
    """Direction of a parameter, (1 + 3 n_a + 2 order n_a,), as in `GaitFamily.directions`."""
    joints, n = base.joints, len(base.joints)
    way = np.zeros(1 + (3 + 2 * len(base.sine)) * n)
    if name == "frequency" and not still:
        way[0] = 1.0
        return way
    kind, answering = robot.command(name.removesuffix(DIFFERENCE))
    series, block = _SERIES.match(name), None
    if series and not still:
        kind, answering = "series", robot.joints_named(series["joint"])
        block = 1 + 2 * int(series["harmonic"]) + (series["part"] == "sine")
    elif kind in COMMANDS:
        block = COMMANDS.index(kind)
    moved = joints if kind in ("offset", "series") else base.moving
    differs = name.endswith(DIFFERENCE)
    for one in answering:
        if block is not None and one in moved:
            way[1 + block * n + joints.index(one)] = robot.side(one) / 2 if differs else 1.0
    if not way.any() or (differs and np.count_nonzero(way) != 2):
        groups = robot.joint_groups | {one: (one,) for one in joints}
        moving = [one for one, own in groups.items() if own[0] in base.moving]
        valid = [f"{k}_{kind}" for kind in COMMANDS for k in (groups, moving)[kind != "offset"]]
        known = {k.rpartition("_")[0]: k for k in valid[::-1]} | {k: k for k in valid}
        expected = (
            "frequency, amplitude, or <joint>_offset, _cosine_1, _sine_1 ... of "
            f"{', '.join(robot.joint_groups)}, or of one side, such as {joints[0]}; _amplitude or "
            f"_phase of {', '.join(k for k in moving if k in robot.joint_groups) or 'none'}; "
            f"<pair>_<kind>{DIFFERENCE}"
        )
        raise ParameterError("free", expected, name, {"frequency": "frequency", **known})
    return way

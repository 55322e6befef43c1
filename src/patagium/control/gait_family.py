"""Gait family: gaits that differ in frequency, amplitudes, offsets and phases.

Parameters bear the names of `SteeredGait`'s commands and mean the same: `frequency` [Hz],
`amplitude` and `plunge_amplitude` (over the gait's own), `plunge_offset` (added to the mean)
[rad, m], `plunge_phase` (lead) [rad]; a name ending in `_difference` is left less right. With
phase x = 2 pi f t, a joint is at q = m + o + A (g(x + l) - m), where g is the Fourier series of
the gait; of a gait that is none (a table's spline) its first harmonics are taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from patagium.aerodynamics import Air
from patagium.control.wingbeat import PrescribedRows
from patagium.errors import ParameterError
from patagium.robot import Robot
from patagium.robot.model import COMMANDS
from patagium.simulation.gait_models import FourierGait, Gait
from patagium.simulation.gaits import check_gait

Array = NDArray[np.float64]

DIFFERENCE = "_difference"
"""End of the name of a parameter that is the left joint's value less the right one's."""
STILL_BEAT = 0.1
"""Length of a beat of a gait that stands still [s]."""
_SAMPLES = 1024  # of a period
_MOST = 64  # harmonics
_NEGLIGIBLE = 1e-13  # of the largest coefficient


def fourier_series(gait: Gait) -> FourierGait:
    """Fourier series of a gait: itself if it is one; a gait that stands still beats without moving.

    Args:
        gait: Any gait.
    """
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


@dataclass(frozen=True)
class GaitFamily:
    """Gaits reached from one by some parameters.

    Attributes:
        robot: The machine.
        base: Gait whose parameters are all neutral.
        names: Names of the parameters.
        directions: What each moves: frequency, then amplitudes, offsets and phases of all
            joints, (p, 1 + 3 n_a).
    """

    robot: Robot
    base: FourierGait
    names: tuple[str, ...]
    directions: Array

    @property
    def neutral(self) -> Array:
        """Values at which the gait is the base, (p,)."""
        return np.array([self._neutral(name) for name in self.names])

    def _neutral(self, name: str) -> float:
        if name == "frequency":
            return self.base.frequency
        return float(name == "amplitude" or name.endswith("_amplitude"))

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each parameter; amplitudes are shares of the base's."""
        joints = dict(zip(self.base.joints, self.robot.actuated, strict=True))
        found = []
        for name, way in zip(self.names, self.directions, strict=True):
            kind, place = _kind(name), int(np.flatnonzero(way)[0]) - 1
            joint = self.base.joints[place % len(joints)]
            unit = {"frequency": "Hz", "amplitude": "1", "phase": "rad"}.get(kind)
            found.append(unit or self.robot.dof_units[joints[joint]])
        return tuple(found)

    def gait(self, values: Array) -> FourierGait:
        """Gait at some values of the parameters.

        Args:
            values: (p,) [Hz, 1, rad or m, rad].
        """
        frequency, amplitude, offset, lead = self._shape(values)
        order = np.arange(1, len(self.base.sine) + 1)[:, None]
        turned = (self.base.cosine - 1j * self.base.sine) * amplitude * np.exp(1j * order * lead)
        mean = self.base.mean + offset
        return replace(
            self.base, frequency=frequency, mean=mean, cosine=turned.real, sine=-turned.imag
        )

    def _shape(self, values: Array) -> tuple[float, Array, Array, Array]:
        """Frequency, and amplitude, offset and phase of every joint, (n_a,) each."""
        n = len(self.base.joints)
        theta = np.r_[self.base.frequency, np.ones(n), np.zeros(2 * n)]
        theta = theta + (np.asarray(values, float) - self.neutral) @ self.directions
        return float(theta[0]), theta[1 : 1 + n], theta[1 + n : 1 + 2 * n], theta[1 + 2 * n :]

    def rows(self, values: Array, steps: int, air: Air) -> PrescribedRows:
        """Prescribed rows of one beat, and their derivatives by the parameters.

        Args:
            values: (p,) [Hz, 1, rad or m, rad].
            steps: Time steps of the beat.
            air: The air, whose wind the rows carry.
        """
        gait, n = self.gait(values), len(self.base.joints)
        frequency, amplitude, _, _ = self._shape(values)
        phase = np.pi * np.arange(2 * steps + 1) / steps
        pace = 2.0 * np.pi * frequency
        order = 1j * np.arange(1, len(gait.sine) + 1)[:, None]
        wave = np.exp(np.outer(phase, order))
        series = gait.cosine - 1j * gait.sine
        waves = (wave @ np.hstack([series * order**k for k in range(4)])).real
        g = waves.reshape(len(phase), 4, n) * pace ** np.arange(4)[:, None]
        joints, leads = g[:, :3], g[:, 1:] / pace
        own = np.divide(1.0, amplitude, out=np.zeros(n), where=amplitude != 0)
        way = self.directions
        slopes = way[:, None, None, 1 : 1 + n] * own * joints
        slopes = slopes + way[:, None, None, 1 + 2 * n :] * leads
        slopes += way[:, :1, None, None] * (np.arange(3)[:, None] / frequency * joints)
        slopes[:, :, 0] += way[:, None, 1 + n : 1 + 2 * n]
        flat = np.ascontiguousarray(slopes.swapaxes(0, 1)).reshape(len(phase), len(way), 3 * n)
        position = joints.reshape(len(phase), 3 * n).copy()
        position[:, :n] += gait.mean
        table = np.column_stack([position, air.uniform_wind_at(phase / pace)])
        step = 1.0 / (frequency * steps)
        return PrescribedRows(table, flat, step, -step / frequency * way[:, 0])


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
    base = fourier_series(gait)
    still = gait.period is None
    ways = np.array([_direction(robot, base, still, name) for name in names])
    return GaitFamily(robot, base, tuple(names), ways.reshape(len(names), -1))


def symmetric_parameters(robot: Robot, gait: Gait) -> tuple[str, ...]:
    """Names of all parameters that keep a mirrored robot's gait mirrored.

    Args:
        robot: The machine.
        gait: Its gait.
    """
    base, joints = fourier_series(gait), [robot.dof_names[i] for i in robot.actuated]
    moving = np.abs(np.r_[base.cosine, base.sine]).max(axis=0, initial=0.0) > 0
    found = ["frequency"] if gait.period else []
    for joint in joints:
        name = joint.removeprefix("left_")
        if joint.startswith("right_") and f"left_{joint[6:]}" in joints:
            continue
        if moving[joints.index(joint)]:
            found += [f"{name}_amplitude", f"{name}_phase"]
        found.append(f"{name}_offset")
    return tuple(found)


def _kind(name: str) -> str:
    return name.removesuffix(DIFFERENCE).rpartition("_")[2]


def _direction(robot: Robot, base: FourierGait, still: bool, name: str) -> Array:
    """Direction of a parameter: frequency, amplitudes, offsets, phases, (1 + 3 n_a,)."""
    joints, n = base.joints, len(base.joints)
    moving = np.abs(np.r_[base.cosine, base.sine]).max(axis=0, initial=0.0) > 0
    way = np.zeros(1 + 3 * n)
    if name == "frequency" and not still:
        way[0] = 1.0
        return way
    kind, answering = robot.command(name.removesuffix(DIFFERENCE))
    for k, one in enumerate(joints):
        if kind in COMMANDS and one in answering and (kind == "offset" or moving[k]):
            side = 0.5 if one.startswith("left_") else -0.5
            way[1 + COMMANDS.index(kind) * n + k] = side if name.endswith(DIFFERENCE) else 1.0
    if not way.any() or (name.endswith(DIFFERENCE) and np.count_nonzero(way) != 2):
        flapping = ", ".join(one for k, one in enumerate(joints) if moving[k]) or "none"
        expected = (
            f"<joint>_offset of {', '.join(joints)}; frequency, amplitude, <joint>_amplitude or "
            f"_phase of what flaps: {flapping}; <pair>_<kind>{DIFFERENCE} of a left and right one"
        )
        raise ParameterError("gait parameter", expected, name)
    return way

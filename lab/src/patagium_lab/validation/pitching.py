"""Measured coefficients of sections pitching through stall, each reduced to one file.

The raw records of the S809 are incidence and lift coefficient, sample by sample over three or four
oscillations, without their times. The times come from the sine that fits the incidences
best. Neglected: what the motion has beside that sine, and the S809's drag and moment.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import ArrayLike

from patagium.arrays import Array
from patagium.errors import LogError


@dataclass(frozen=True)
class PitchLoop:
    """Lift of a section that pitches about its quarter chord.

    Attributes:
        name: Name of the measurement.
        frequency: Frequency of the oscillation [Hz].
        mean: Mean of the fitted incidence, mean + amplitude cos(phase) [rad].
        amplitude: Amplitude of the fitted incidence [rad].
        samples_per_cycle: Samples of the record in an oscillation, fitted.
        first_phase: Phase of the first sample, fitted [rad].
        incidence: Measured incidence, (N,) [rad].
        lift: Measured C_L, (N,) [1].
        drag: Measured C_D, (N,) [1]; None where it is not at hand.
        moment: Measured C_m about the quarter chord, (N,) [1]; None where it is not at hand.
    """

    name: str
    frequency: float
    mean: float
    amplitude: float
    samples_per_cycle: float
    first_phase: float
    incidence: Array
    lift: Array
    drag: Array | None = None
    moment: Array | None = None

    @property
    def phase(self) -> Array:
        """Phase of each sample in the oscillation, (N,) [rad]."""
        step = 2.0 * np.pi / self.samples_per_cycle
        return np.asarray(self.first_phase + step * np.arange(len(self.lift)))

    def motion(self, phase: ArrayLike) -> Array:
        """The fitted incidence and its derivatives by the phase, (3, N) [rad].

        Args:
            phase: (N,) [rad].
        """
        cosine, sine = np.cos(phase), np.sin(phase)
        swing = self.amplitude * np.array([cosine, -sine, -cosine])
        return np.asarray(swing + np.array([[self.mean], [0.0], [0.0]]))


@dataclass(frozen=True)
class PitchingCase:
    """A section in a wind tunnel: its static polar, and its lift when it pitched.

    Attributes:
        source: Source of the data.
        licence: Licence of the data.
        chord: Chord [m].
        airspeed: Airspeed of the tunnel [m/s].
        angle: Angles of attack of the static polar, (n,) [rad].
        static_lift: C_L at each angle, (n,) [1].
        static_drag: C_D at each angle, (n,) [1].
        loops: The pitching records.
        static_moment: C_m about the quarter chord at each angle, (n,) [1]; None where it is not
            at hand.
        remark: What the records show that models miss, in sentences.
    """

    source: str
    licence: str
    chord: float
    airspeed: float
    angle: Array
    static_lift: Array
    static_drag: Array
    loops: tuple[PitchLoop, ...]
    static_moment: Array | None = None
    remark: str = ""


def load_pitching_case(name: str = "osu_s809") -> PitchingCase:
    """A reduced case from the file in this package.

    Args:
        name: "osu_s809" or "glasgow_naca23012a".
    """
    text = files("patagium_lab").joinpath(f"cases/{name}.yaml").read_text(encoding="utf-8")
    words = yaml.safe_load(text)
    loops = words.pop("loops")
    for numbers in (words, *loops):
        arrays = {key: np.array(x, float) for key, x in numbers.items() if isinstance(x, list)}
        numbers |= arrays
    return PitchingCase(**words, loops=tuple(PitchLoop(**loop) for loop in loops))


def measured_loop(file: str | Path, name: str, frequency: float) -> PitchLoop:
    """A raw record with the sine that fits its incidences best.

    Args:
        file: Columns of incidence [deg] and lift coefficient, one line of words above.
        name: Name of the measurement.
        frequency: Frequency of the oscillation [Hz].

    Raises:
        LogError: If the file is missing.
    """
    try:
        record = np.loadtxt(file, skiprows=1, usecols=(0, 1))
    except FileNotFoundError as problem:
        raise LogError(f"{file}: no such file") from problem
    incidence = np.deg2rad(record[:, 0])
    fits = [(*_fit(incidence, period), period) for period in np.arange(28.0, 44.0, 0.005)]
    _, fit, period = min(fits, key=lambda x: x[0])
    return PitchLoop(
        name,
        frequency,
        mean=float(fit[0]),
        amplitude=float(np.hypot(fit[1], fit[2])),
        samples_per_cycle=round(float(period), 3),
        first_phase=float(np.arctan2(-fit[2], fit[1])),
        incidence=incidence,
        lift=record[:, 1],
    )


def _fit(incidence: Array, period: float) -> tuple[float, Array]:
    """Squared error and coefficients of constant, cosine and sine of a period in samples."""
    phase = 2.0 * np.pi * np.arange(len(incidence)) / period
    basis = np.column_stack([np.ones(len(phase)), np.cos(phase), np.sin(phase)])
    fit = np.linalg.lstsq(basis, incidence, rcond=None)[0]
    return float(np.sum((basis @ fit - incidence) ** 2)), fit

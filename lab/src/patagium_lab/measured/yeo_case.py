"""The measured flapping wing of Yeo, Atkins and Shyy (2011), case C, reduced to one file.

The raw record is the flap angle and nine pressure histories over one cycle. The lift of
both wings is 2 cos(phi) sum_i p_i A_i, each pressure (lower minus upper) standing for the
area around its port. Neglected: suction at the leading edge, the area no port stands for,
and the wing's weight and inertia (pressures feel neither).
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

INCH_OF_WATER = 248.84
"""Pressure of one inch of water at 20 degrees Celsius [Pa]."""
FLAP_ORDER = 4
"""Harmonics kept of the measured flap angle."""
PORT_AREAS = {
    "blue": (0.072 * 0.024, 0.072 * 0.024, 0.072 * 0.024),
    "orange": (0.07 * 0.02112, 0.07 * 0.02112, 0.07 * 0.02112),
    "green": (0.071 * 0.015, 0.06565 * 0.015, 0.04165 * 0.015),
}
"""Area that the leading, middle and trailing port of each row stands for [m^2]."""


@dataclass(frozen=True)
class FourierSeries:
    """A periodic angle: mean + sum_k cosine_k cos(k x) + sine_k sin(k x).

    Attributes:
        mean: Mean [rad].
        cosine: Coefficients from the first harmonic on [rad].
        sine: Coefficients from the first harmonic on [rad].
    """

    mean: float
    cosine: tuple[float, ...]
    sine: tuple[float, ...]

    def __call__(self, phase: ArrayLike) -> Array:
        """The angle [rad] at phases x, (N,) [rad]."""
        harmonic = np.outer(np.asarray(phase, float), np.arange(1, len(self.sine) + 1))
        return np.asarray(
            self.mean + np.cos(harmonic) @ self.cosine + np.sin(harmonic) @ self.sine, float
        )


@dataclass(frozen=True)
class YeoCase:
    """A rigid wing pair flapping in a wind tunnel, and its measured lift.

    Attributes:
        source: Source of the data.
        licence: Licence of the data.
        frequency: Wingbeat frequency [Hz].
        airspeed: Airspeed of the tunnel [m/s].
        density: Density of the air [kg/m^3].
        area: Area of both wings [m^2].
        flap_angle: Flap angle as Yeo et al. state it, wing up positive.
        digitized_flap_angle: Flap angle fitted to the digitized record of the wing's position.
        lift: Lift of both wings at evenly spaced phases from 0, (100,) [N].
        published_error: Mean absolute error against this lift that others reached [N].
    """

    source: str
    licence: str
    frequency: float
    airspeed: float
    density: float
    area: float
    flap_angle: FourierSeries
    digitized_flap_angle: FourierSeries
    lift: Array
    published_error: dict[str, float]

    @property
    def phase(self) -> Array:
        """Phase of each sample of the lift, (100,) [rad]."""
        return 2.0 * np.pi * np.arange(len(self.lift)) / len(self.lift)


def load_yeo_case() -> YeoCase:
    """The reduced case from the file in this package."""
    text = files("patagium_lab").joinpath("cases/yeo2011.yaml").read_text(encoding="utf-8")
    words = yaml.safe_load(text)
    series = words.pop("flap_angle")
    return YeoCase(
        **{**words, "lift": np.array(words["lift"], float)},
        flap_angle=_series(series["stated"]),
        digitized_flap_angle=_series(series["digitized"]),
    )


def digitized_flap_angle(folder: str | Path) -> FourierSeries:
    """Least-squares Fourier series of the digitized wing position.

    Args:
        folder: Raw files of the case.
    """
    record = _read(Path(folder) / "measured_wing_positions.csv")
    harmonic = np.outer(2.0 * np.pi * record[:, 0], np.arange(1, FLAP_ORDER + 1))
    basis = np.column_stack([np.ones(len(record)), np.cos(harmonic), np.sin(harmonic)])
    fit = np.linalg.lstsq(basis, np.deg2rad(record[:, 1]), rcond=None)[0]
    cosine, sine = fit[1 : FLAP_ORDER + 1], fit[FLAP_ORDER + 1 :]
    return FourierSeries(float(fit[0]), tuple(cosine.tolist()), tuple(sine.tolist()))


def measured_lift(folder: str | Path, flap_angle: FourierSeries) -> Array:
    """Lift of both wings from the nine pressure histories, (100,) [N].

    L = 2 cos(phi) sum_i p_i A_i.

    Args:
        folder: Raw files of the case.
        flap_angle: phi.

    Raises:
        LogError: If a file is missing or the histories differ in phase.
    """
    normal_force, cycle = np.zeros(100), np.arange(100) / 100
    for row, areas in PORT_AREAS.items():
        for place, area in zip(("leading", "middle", "trailing"), areas, strict=True):
            record = _read(Path(folder) / f"{row}_{place}_point_experimental_pressures.csv")
            if record.shape != (100, 2) or np.abs(record[:, 0] - cycle).max() > 1e-9:
                raise LogError(f"{row} {place}: expected 100 phases from 0 to 0.99")
            normal_force += INCH_OF_WATER * record[:, 1] * area
    return 2.0 * np.cos(flap_angle(2.0 * np.pi * cycle)) * normal_force


def planform_area(folder: str | Path) -> float:
    """Area of both wings from the digitized outline [m^2].

    Args:
        folder: Raw files of the case.
    """
    span, chord = 1e-3 * _read(Path(folder) / "extracted_planform_coordinates.csv").T
    return float(np.abs(np.dot(span, np.roll(chord, 1)) - np.dot(chord, np.roll(span, 1))))


def _series(words: dict[str, object]) -> FourierSeries:
    return FourierSeries(words["mean"], tuple(words["cosine"]), tuple(words["sine"]))  # type: ignore[arg-type]


def _read(file: Path) -> Array:
    try:
        return np.genfromtxt(file, delimiter=",", encoding="utf-8-sig")
    except FileNotFoundError as problem:
        raise LogError(f"{file}: no such file") from problem

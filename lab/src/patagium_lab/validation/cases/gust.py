"""A section that flies into a gust which the air carries: Kuessner's and Sears' functions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from patagium.aerodynamics import (
    AddedMass,
    Air,
    Indicial,
    LiftingLine,
    RampGust,
    Section,
    TravelingGust,
)
from patagium.aerodynamics.gusts import gusts_at_strips
from patagium.aerodynamics.indicial import FOUR_STATE, TWO_STATE
from patagium.arrays import Array
from patagium.simulation import gaits, mounts, simulate
from patagium_lab.validation.cases.case import CaseResult, ErrorLimit, largest_difference
from patagium_lab.validation.cases.theodorsen import section_transfer
from patagium_lab.validation.cases.wings import AIRSPEED, INFINITE, rectangular_wing
from patagium_lab.validation.exact_functions import kussner_function, sears_function

REDUCED_FREQUENCY = np.array([0.1, 0.2, 0.5, 1.0, 2.0])
STEPS = 100
"""Time steps a semichord."""
VELOCITY = 1e-3
"""Velocity of the gust, small beside the airspeed [m/s]."""

_UPSTREAM, _UP = (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
_SEMICHORD = 0.5
_LAGS = {"two states": TWO_STATE, "four states": FOUR_STATE}


@dataclass(frozen=True)
class _Sine:
    """cos(w t) along z."""

    frequency: float

    def velocity_at(self, time: Array) -> Array:
        return np.outer(np.cos(self.frequency * time), _UP)

    def knots(self, first: float, last: float) -> Array:
        step = 2 * np.pi / self.frequency / 64
        return step * np.arange(np.floor(first / step), np.ceil(last / step) + 2)

    def describe(self) -> dict[str, Any]:
        return {"frequency": self.frequency}


def compute() -> list[CaseResult]:
    """Lift of a wing without end in a sharp-edged gust, and in one that goes up and down."""
    s = np.arange(20 * STEPS + 1) / STEPS
    expected = kussner_function(s[:: STEPS // 5])
    models = {name: _edge_lift(lag)[:: STEPS // 5] for name, lag in _LAGS.items()}
    k, waves = REDUCED_FREQUENCY, sears_function(REDUCED_FREQUENCY)
    found = {name: _wave_lift(lag) for name, lag in _LAGS.items()}
    return [
        CaseResult(
            "Sharp-edged gust",
            "Kuessner (1936), by quadrature",
            "distance travelled [semichords]",
            "lift over its final value [1]",
            s[:: STEPS // 5],
            expected,
            models,
            "largest difference [1]",
            largest_difference(expected, models),
            {},
            "A flight: the wing stands in the wind that carries the gust, with its added mass. The "
            "gust travels along the chord; its mean weighted toward the trailing edge drives the "
            "lags, and its growth pushes the air carried along. What is left is the error of the "
            "lags. A gust that is the same everywhere begins with half of the lift instead.",
            {
                "two states": ErrorLimit(0.010, "the error of these lags on Wagner's function"),
                "four states": ErrorLimit(0.005, "half of it"),
            },
        ),
        CaseResult(
            "Gust that goes up and down",
            "Sears (1941), closed form",
            "reduced frequency [1]",
            "|lift| over quasi-steady [1]",
            k,
            np.abs(waves),
            {name: np.abs(values) for name, values in found.items()},
            "largest difference, phase included [1]",
            {name: float(np.abs(values - waves).max()) for name, values in found.items()},
            {},
            "Phase at mid-chord. What the chord meets goes through the lags and the added mass.",
            {
                "two states": ErrorLimit(0.015, "the error of these lags on Theodorsen's function"),
                "four states": ErrorLimit(0.005, "a third of it"),
            },
        ),
    ]


def _edge_lift(lags: Indicial) -> Array:
    """Lift over 2 pi rho U w A / 2 after the leading edge met the gust, (N,)."""
    step = _SEMICHORD / AIRSPEED / STEPS
    edge = RampGust((0.0, 0.0, VELOCITY), 0.0, 1e-3 * step)
    wing = rectangular_wing(INFINITE, 3)
    leading = (wing.strips[0].chord / 4, 0.0, 0.0)
    gust = TravelingGust(edge, _UPSTREAM, AIRSPEED, leading)
    air = Air(wind=(-AIRSPEED, 0.0, 0.0), gust=gust)
    model = LiftingLine(wing, air, lags, Section(profile_drag=0.0), surface_constant=0.0)
    flight = simulate(
        wing,
        model,
        gaits.still(wing),
        duration=20 * STEPS * step,
        time_step=step,
        added_mass=AddedMass(wing, air),
        mount=mounts.fixed(),
    )
    force = flight["aero_force"].to_numpy()[:, 2] + flight["added_mass_force"].to_numpy()[:, 2]
    area = sum(float(strip.chord * strip.width) for strip in wing.strips)
    return np.asarray(force / (np.pi * air.density * AIRSPEED * VELOCITY * area))


def _wave_lift(lags: Indicial) -> Array:
    """Lift over its quasi-steady value, complex, (N,)."""
    mean, push = np.transpose([_wave(k * AIRSPEED / _SEMICHORD) for k in REDUCED_FREQUENCY])
    return np.asarray(section_transfer(lags, REDUCED_FREQUENCY) * mean + push)


def _wave(frequency: float) -> tuple[complex, complex]:
    """Complex amplitudes of what drives the lags and of the push, over w and 2 pi rho U b w."""
    gust = TravelingGust(_Sine(frequency), _UPSTREAM, AIRSPEED)
    time = 2 * np.pi / frequency * np.arange(16) / 16
    delays = np.zeros((len(time), 4, 1))
    delays[:, 1] = -_SEMICHORD / AIRSPEED
    pieces = gust.pieces(time[0] - 1.0, time[-1] + 1.0)
    met = gusts_at_strips(pieces, time, delays)[:, :, 0]
    turn = 2 * np.exp(-1j * frequency * time) / len(time)
    return turn @ (met[:, 2] - met[:, 5]), turn @ met[:, 8] * _SEMICHORD / (2 * AIRSPEED)

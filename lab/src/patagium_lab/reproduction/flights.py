"""Flights of the reproduction: published, corrected, and gaits that are not learned.

The published experiment flaps at 15 Hz, far outside of quasi-steady theory (E8), and is
stepped as published (E3). The corrected robot flies freely at a gait within its means: the
linkage drives plunge and elbow, the plates feather, and the start is near level flight.
Neglected: control; a flight slowly departs from where it starts.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import xarray as xr

from patagium.aerodynamics import QuasiSteady
from patagium.arrays import Array
from patagium.robot import Robot, load_robot
from patagium.robot.linkage import Linkage
from patagium.simulation import gaits, robot_of, simulate
from patagium.simulation.gaits import Gait
from patagium_lab.published.aerodynamics import PUBLISHED_ERRORS, Published
from patagium_lab.published.stepping import simulate_published

Flights = tuple[xr.Dataset, dict[str, xr.Dataset]]

TIME_STEP = 1e-4
"""Time step of both experiments, that of the published one [s]."""
PUBLISHED_GAIT = {"frequency": 15.0, "amplitude": 1.0, "speed": 2.0}
"""Wingbeat frequency [Hz], plunge [rad] and initial speed [m/s] of the published experiment."""


@dataclass(frozen=True)
class Wingbeat:
    """A gait of the corrected robot and its first state.

    Attributes:
        frequency: Frequency of the crank [Hz].
        plunge_offset: Angle of the linkage on the body [rad].
        elbow_offset: Angle of the radius on the humerus [rad].
        feather: Amplitude of feathering [rad].
        feather_phase: Lead of feathering on the crank [rad].
        feather_offset: Mean of feathering [rad].
        plunge: Amplitude of a sine added to plunge [rad].
        elbow: Amplitude of a sine added to the elbow [rad].
        speed: Forward speed at the start [m/s].
        climb: Upward speed at the start [m/s].
        pitch: Pitch angle at the start [rad].
        pitch_rate: Pitch rate at the start [rad/s].
        linkage: Lengths that differ from the Aerobat's [m].
    """

    frequency: float = 5.9048
    plunge_offset: float = -0.4105
    elbow_offset: float = -0.0099
    feather: float = 0.5378
    feather_phase: float = 1.6692
    feather_offset: float = -0.0013
    plunge: float = 0.0
    elbow: float = 0.0
    speed: float = 4.4728
    climb: float = -0.3183
    pitch: float = 0.2443
    pitch_rate: float = 0.1717
    linkage: dict[str, float] = field(default_factory=dict)

    def gait(self, robot: Robot) -> Gait:
        """Gait of linkage, feathering and added sines, for a robot with those joints."""
        driven = gaits.linkage(
            robot,
            frequency=self.frequency,
            linkage=Linkage(**self.linkage),  # type: ignore[arg-type]
            plunge_offset=self.plunge_offset,
            elbow_offset=self.elbow_offset,
        )
        added = gaits.sinusoidal(
            robot,
            frequency=self.frequency,
            phase={"feather": self.feather_phase},
            offset={"feather": self.feather_offset},
            feather=self.feather,
            plunge=self.plunge,
            elbow=self.elbow,
        )
        return gaits.superposed(robot, driven, added)

    def start(self, robot: Robot) -> tuple[Array, Array]:
        """Initial q and v, (n,) each."""
        v = robot.coordinates(x=self.speed, z=self.climb, pitch=self.pitch_rate)
        return robot.coordinates(pitch=self.pitch), v


LEARNED = Wingbeat()
"""The wingbeat that is learned: found by a search for level flight."""
UNSEEN = {
    "frequency 4.5 Hz": replace(LEARNED, frequency=4.5),
    "plunge 0.2 rad larger": replace(LEARNED, plunge=0.2),
    "regulator l3b 8 mm": replace(LEARNED, linkage={"l3b": 8e-3}),
    "elbow 0.3 rad more": replace(LEARNED, elbow=0.3),
    "feather 0.4 rad, 0.3 rad earlier": replace(
        LEARNED, feather=0.4, feather_phase=LEARNED.feather_phase + 0.3
    ),
    "feather halved, a quarter beat later": replace(
        LEARNED, feather=0.27, feather_phase=LEARNED.feather_phase - np.pi / 2
    ),
    "speed 6 m/s": replace(LEARNED, speed=6.0),
}
"""Gaits of the corrected robot that are not learned, each flown on its own."""
UNSEEN_PUBLISHED = {
    "frequency 12 Hz": {**PUBLISHED_GAIT, "frequency": 12.0},
    "amplitude 0.8 rad": {**PUBLISHED_GAIT, "amplitude": 0.8},
    "speed 20 m/s": {**PUBLISHED_GAIT, "speed": 20.0},
    "12 Hz, 0.8 rad, 20 m/s": {"frequency": 12.0, "amplitude": 0.8, "speed": 20.0},
}
"""Gaits of the published robot that are not learned; its elbow and feather are held at zero."""

MARGIN = 1.15
"""Ratio of largest incidences up to which a gait is within what was learned."""


def published_flight(duration: float, **gait: float) -> xr.Dataset:
    """Flight of the published experiment with all its errors.

    Args:
        duration: Duration [s].
        **gait: Values that differ from `PUBLISHED_GAIT`.
    """
    robot = load_robot("aerobat-published")
    return simulate_published(
        robot,
        Published(robot, errors=PUBLISHED_ERRORS),
        duration=duration,
        time_step=TIME_STEP,
        throw=False,
        **{**PUBLISHED_GAIT, **gait},  # type: ignore[arg-type]
    )


def corrected_flight(duration: float, wingbeat: Wingbeat = LEARNED) -> xr.Dataset:
    """Free flight of the corrected robot through quasi-steady air.

    Args:
        duration: Duration [s].
        wingbeat: Gait and start.
    """
    robot = load_robot("aerobat")
    q, v = wingbeat.start(robot)
    return simulate(
        robot,
        QuasiSteady(robot),
        wingbeat.gait(robot),
        duration=duration,
        time_step=TIME_STEP,
        q=q,
        v=v,
        throw=False,
    )


def published_flights(duration: float, unseen_duration: float) -> Flights:
    """Flight of the published experiment, and flights of gaits that are not learned, by name.

    Args:
        duration: Duration of the flight that is learned [s].
        unseen_duration: Duration of each other flight [s].
    """
    others = {n: published_flight(unseen_duration, **gait) for n, gait in UNSEEN_PUBLISHED.items()}
    return published_flight(duration), others


def corrected_flights(duration: float, unseen_duration: float) -> Flights:
    """Flight of the corrected robot, and flights of gaits that are not learned, by name.

    Args:
        duration: Duration of the flight that is learned [s].
        unseen_duration: Duration of each other flight [s].
    """
    others = {n: corrected_flight(unseen_duration, wingbeat) for n, wingbeat in UNSEEN.items()}
    return corrected_flight(duration), others


FLIGHTS: dict[str, Callable[[float, float], Flights]] = {
    "published": published_flights,
    "corrected": corrected_flights,
}
"""Flights through air without memory, by key."""


def summary(flight: xr.Dataset) -> dict[str, Any]:
    """Figures of a flight.

    Args:
        flight: The flight.

    Returns:
        duration [s], largest and last speed through the air [m/s], largest force of the air [N],
        mean lift over the weight in the second half, height lost [m], incidences [rad], how it
        ended.
    """
    v, force = flight["v"].to_numpy(), flight["aero_force"].to_numpy()
    weight = weight_of(flight)
    speed = np.linalg.norm(v[:, :3] - flight["wind"].to_numpy(), axis=1)
    half = len(speed) // 2
    incidence = np.abs(flight["effective_angle_of_attack"].to_numpy())
    return {
        "duration": float(flight["time"][-1]),
        "beat_frequency": beat_frequency(flight),
        "speed_start": float(speed[0]),
        "speed_largest": float(speed.max()),
        "speed_end": float(speed[-1]),
        "force_largest": float(np.linalg.norm(force[:, :3], axis=1).max()),
        "lift_over_weight": float(force[half:, 2].mean() / weight),
        "height_change": float(flight["q"].to_numpy()[-1, 2] - flight["q"].to_numpy()[0, 2]),
        "distance": float(flight["q"].to_numpy()[-1, 0] - flight["q"].to_numpy()[0, 0]),
        "incidence_largest": float(incidence.max()),
        "incidence_median": float(np.median(incidence)),
        "reduced_frequency_start": reduced_frequency(flight, float(speed[0])),
        "reduced_frequency_end": reduced_frequency(flight, float(speed[-1])),
        "energy_audit": float(flight.attrs["energy_audit"]),
        "momentum_audit": float(flight.attrs["momentum_audit"]),
        "aero_power_largest": float(flight.attrs["aero_power_largest"]),
        "outcome": str(flight.attrs["outcome"]),
    }


def weight_of(flight: xr.Dataset) -> float:
    """Weight of the machine of a flight [N]."""
    robot = robot_of(flight)
    return float(robot.gravity * robot.mass)


def beat_frequency(flight: xr.Dataset) -> float:
    """Wingbeat frequency of a flight, that of the fastest part of its gait [Hz]."""
    gait = json.loads(flight.attrs["gait"])
    parts = gait["parts"] if gait["kind"] == "superposed" else [gait]
    return float(max(part["frequency"] for part in parts))


def reduced_frequency(flight: xr.Dataset, speed: float) -> float:
    """Reduced frequency k = pi f c / U [1]; quasi-steady theory needs k well below 0.1.

    Args:
        flight: The flight.
        speed: U [m/s].
    """
    chord = max(float(strip.chord) for strip in robot_of(flight).strips)
    return float(np.pi * beat_frequency(flight) * chord / speed)


def unseen_gaits(
    learned: Mapping[str, Any], others: Mapping[str, Mapping[str, Any]], where: str
) -> list[str]:
    """Names of gaits whose incidences stay within those that were learned, or leave them.

    Args:
        learned: Figures of the flight that is learned.
        others: Figures of the flight of each gait.
        where: "within" or "beyond".
    """
    most = MARGIN * learned["incidence_largest"]
    inside = {name: one["incidence_largest"] <= most for name, one in others.items()}
    return [name for name, fits in inside.items() if fits == (where == "within")]

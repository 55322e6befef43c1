"""Plan of the study of a lost wing: the robot, its controllers, and what happens to them.

The loss is chosen by the authority of the commands (`authority`), not by how flights come out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from patagium.sensing.sensors.presets import STANDARD_GRAVITY

COMMANDS = (
    *("left_plunge_amplitude", "right_plunge_amplitude"),
    *("left_feather_offset", "right_feather_offset", "feather_amplitude"),
)
"""Commands of the Aerobat; its frequency stays."""
TOLERABLE = {
    "z": 0.1,
    "roll": 0.1,
    "pitch": 0.3,
    "yaw": 0.1,
    "velocity of x": 0.25,
    "velocity of y": 1.0,
    "velocity of z": 1.0,
    **{f"velocity of {name}": 10.0 for name in ("roll", "pitch", "yaw")},
}
"""Departures that cost as much as a command over half its range [m, rad, m/s, rad/s]."""
CHANGE_COST = 0.0
"""Cost of changes of the commands: free, since these departures are small and are to be damped."""
NOISE = {
    "x": 1e-3,
    "y": 1e-3,
    "z": 1e-3,
    **{name: 5e-3 for name in ("roll", "pitch", "yaw")},
    **{f"velocity of {name}": 0.02 for name in ("x", "y", "z", "roll", "pitch", "yaw")},
}
"""Standard deviations of the measured state [m, rad, m/s, rad/s]."""
IMU: Mapping[str, Any] = {
    "accelerometer_range": 30 * STANDARD_GRAVITY,
    "gyroscope_range": math.radians(4000.0),
    "accelerometer_density": 285e-6 * STANDARD_GRAVITY,
    "gyroscope_density": math.radians(0.0175),
    "accelerometer_bias": 50e-3 * STANDARD_GRAVITY,
    "gyroscope_bias": math.radians(5.0),
    "accelerometer_step": STANDARD_GRAVITY / 1024,
    "gyroscope_step": math.radians(1 / 8.2),
}
"""Inertial unit where sensors are in the loop [SI]: ranges of TDK's ICM-20649, since the body of
the Aerobat shakes with 22 g; noise and biases of that class."""
ENCODERS = 500.0
"""Samples a second of the encoders there [Hz]."""
SCALES = {
    "z": 0.1,
    "yaw": 0.1,
    "velocity of x": 0.3,
}
"""Errors of the mean of a beat that count as 1: height [m], heading [rad], speed [m/s]."""
LOST = {
    "z": 0.5,
    "yaw": 0.5,
    "roll": 1.0,
    "velocity of x": 1.0,
}
"""Departures of the mean of a beat beyond which a flight counts as lost [m, rad, m/s]."""
MARGIN = 1.5
"""Error over that before the loss within which a flight is back."""
MASSES = 0.02
"""Standard deviation of masses and inertias of the truth over those of the model [1]."""

UNDAMAGED, GUSTY = 780, 200
"""Beats of a flight without damage in still air, 60 s, and in turbulence, 15 s."""

OFF, LEARNING, FROZEN, KNOWN = "off", "learning", "frozen at the loss", "loss known"
FORGETTING, GRADIENT = "forgetting only", "gradient learner"


@dataclass(frozen=True)
class Flight:
    """Flight of the study.

    Attributes:
        group: Table in which it is counted: damage, sensed (the same with sensors and a tracker in
            the loop), no harm, gusts.
        law: Controller: linear or predictive.
        learner: `OFF`, `LEARNING`, `FROZEN`, `KNOWN`, `FORGETTING` or `GRADIENT`.
        seed: Seed of masses, noise, side and time of the loss.
        share: Share of the wing that is lost, 0 for none [1].
        gust: Standard deviation of the turbulence [m/s].
        before: Beats before that in which the wing is lost.
        after: Beats from that one on.
    """

    group: str
    law: str
    learner: str
    seed: int
    share: float = 0.0
    gust: float = 0.0
    before: int = 20
    after: int = 25


@dataclass(frozen=True)
class DamagePlan:
    """Plan of the study.

    Attributes:
        share: Share of the span of one wing that is lost [1].
        seed: First seed.
        flights: Flights with learning and without, by the linear regulator: with sensors in the
            loop, and with a noisy state.
        pairs: Undamaged flights with learning and without, by the linear regulator.
        ablations: Flights of each ablation.
        few: Flights of each of the predictive controller's rows and of each gust.
        gusts: Standard deviations of the turbulence [m/s].
        undamaged: Beats of an undamaged flight in still air.
        workers: Number of processes.
    """

    share: float = 1 / 3
    seed: int = 100
    flights: int = 100
    pairs: int = 100
    ablations: int = 20
    few: int = 10
    gusts: tuple[float, ...] = (0.2, 0.4, 0.8)
    undamaged: int = UNDAMAGED
    workers: int = 2

    def listed(self) -> list[Flight]:
        """All flights, those of the main comparison first."""
        rows = [
            ("sensed", "linear", LEARNING, self.flights, self.share, 0.0),
            ("sensed", "linear", OFF, self.flights, self.share, 0.0),
            ("damage", "linear", LEARNING, self.flights, self.share, 0.0),
            ("damage", "linear", OFF, self.flights, self.share, 0.0),
            ("no harm", "linear", LEARNING, self.pairs, 0.0, 0.0),
            ("no harm", "linear", OFF, self.pairs, 0.0, 0.0),
            *(
                ("damage", "linear", one, self.ablations, self.share, 0.0)
                for one in (FROZEN, FORGETTING, GRADIENT, KNOWN)
            ),
            ("damage", "predictive", OFF, self.few, self.share, 0.0),
            ("damage", "predictive", LEARNING, self.few, self.share, 0.0),
        ]
        rows += [
            ("gusts", "linear", learner, self.few, 0.0, gust)
            for gust in self.gusts
            for learner in (OFF, LEARNING)
        ]
        longer = {"no harm": self.undamaged, "gusts": GUSTY}
        after = {group: beats - Flight.before for group, beats in longer.items()}
        return [
            Flight(
                *(group, law, learner, self.seed + k, share, gust),
                after=after.get(group, Flight.after),
            )
            for group, law, learner, count, share, gust in rows
            for k in range(count)
        ]

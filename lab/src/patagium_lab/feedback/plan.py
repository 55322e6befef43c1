"""Plan of the study of feedback: robots and their commands, delays, rates, and starts."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

PERIODIC, AVERAGED, PREDICTIVE = "periodic LQR", "averaged LQR", "predictive"
"""Controllers: linear-quadratic regulators with gains over the phase and of the averaged beat, and
the model predictive controller."""

NOISE = MappingProxyType(
    {
        "z": 1e-3,
        **{name: 5e-3 for name in ("roll", "pitch", "yaw")},
        **{f"velocity of {name}": 0.02 for name in ("x", "y", "z", "roll", "pitch", "yaw")},
    }
)
"""Standard deviations of the measured state [m, rad, m/s, rad/s]."""
PUSHED = MappingProxyType(
    {
        "z": 0.05,
        **{name: 0.05 for name in ("roll", "pitch", "yaw")},
        **{f"velocity of {name}": 0.1 for name in ("x", "y", "z")},
    }
)
"""Standard deviations of the start of a flight with a delay or a rate [m, rad, m/s]."""
IN_FLIGHT = MappingProxyType(
    {
        "z": 1.0,
        **{name: 0.6 for name in ("roll", "pitch", "yaw")},
        **{f"velocity of {name}": 2.0 for name in ("x", "y", "z")},
    }
)
"""Departures beyond which a flight counts as lost [m, rad, m/s]."""
STARTS = MappingProxyType(
    {
        "z": 0.5,
        **{name: 0.8 for name in ("roll", "yaw")},
        "pitch": 0.4,
        **{f"velocity of {name}": 1.5 for name in ("x", "y", "z")},
        **{f"velocity of {name}": 6.0 for name in ("roll", "pitch", "yaw")},
    }
)
"""Departures of a start of size 1, each at most [m, rad, m/s, rad/s]."""
OUTSIDE = MappingProxyType(
    {
        "z": 5.0,
        "roll": 1.5,
        "pitch": 1.0,
        "yaw": 3.0,
        **{f"velocity of {name}": 6.0 for name in ("x", "y", "z")},
    }
)
"""Departures beyond which a start counts as not recovered [m, rad, m/s]."""
RECOVERED = MappingProxyType(
    {
        "z": 0.2,
        **{name: 0.2 for name in ("roll", "pitch", "yaw")},
        **{f"velocity of {name}": 0.4 for name in ("x", "y", "z")},
    }
)
"""Departures at the end within which a start is recovered [m, rad, m/s]."""
MASSES = 0.02
"""Standard deviation of masses and inertias of the truth over those of the model [1]."""
PARTS = 10
"""Intervals of a beat, and commands each, where it is not the rate that is sought."""


@dataclass(frozen=True)
class Case:
    """Robot with its orbit and commands.

    Attributes:
        robot: Preset.
        speed: Mean speed [m/s]; None: near that of the cruise.
        commands: Commands of its controllers.
        amplitude: Range of the amplitude of each plunging joint, where the preset has no actuators
            [rad].
        offset: Range of the mean of each feathering joint, likewise [rad].
        share: Share of the starts of the study that it is flown from [1].
    """

    robot: str
    commands: tuple[str, ...]
    speed: float | None = None
    amplitude: tuple[float, float] | None = None
    offset: tuple[float, float] | None = None
    share: float = 1.0

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.robot}, hover" if self.speed == 0 else self.robot


_WINGS = ("left_fore", "right_fore", "left_hind", "right_hind")
AEROBAT = Case(
    "aerobat",
    (
        *("left_plunge_amplitude", "right_plunge_amplitude"),
        *("left_feather_offset", "right_feather_offset", "feather_amplitude"),
    ),
)
ORNITHOPTER = Case(
    "ornithopter",
    ("frequency", "plunge_amplitude", "elevation_offset", "rudder_offset"),
    share=0.2,
)
DRAGONFLY = Case(
    "dragonfly",
    tuple(
        f"{wing}_{command}" for command in ("plunge_amplitude", "feather_offset") for wing in _WINGS
    ),
    speed=0.0,
    amplitude=(0.0, 0.8),
    offset=(-0.9, 0.9),
    share=0.2,
)


@dataclass(frozen=True)
class FeedbackPlan:
    """Plan of the study.

    Attributes:
        seed: First seed; seeds from 0 on are those that settings were chosen with.
        flights: Flights of each delay and each rate.
        starts: Starts of each regulator.
        few: Of these the first that the predictive controller flies, which takes longer.
        beats: Beats of a flight.
        longest: Longest delay that is tried [beats].
        shares: Delays that are tried to a beat.
        rates: Commands a beat, from the fastest.
        waits: Beats from one command to the next, of the rates below one a beat.
        margins: Robots whose delays and rates are sought.
        regions: Robots whose region of attraction is sought.
        workers: Number of processes.
    """

    seed: int = 1000
    flights: int = 6
    starts: int = 200
    few: int = 60
    beats: int = 40
    longest: float = 3.0
    shares: int = 10
    rates: tuple[int, ...] = (10, 5, 4, 2, 1)
    waits: tuple[int, ...] = (2, 3, 4, 6, 8, 12)
    margins: tuple[Case, ...] = (AEROBAT, ORNITHOPTER, DRAGONFLY)
    regions: tuple[Case, ...] = (AEROBAT, ORNITHOPTER, DRAGONFLY)
    workers: int = 2

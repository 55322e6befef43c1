"""Effects of each error of the published experiment on the flight.

Two baselines: the corrected model, into which each error is put alone, at a gait within the
robot's means; and the published model, from which each is taken away, at the published gait.
All flap plunge alone, because the published stepping knows no other joint. Neglected: pairs
of errors.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from patagium.aerodynamics import Aerodynamics
from patagium.aerodynamics.model import aero_functions
from patagium.report import Table
from patagium.robot import load_robot
from patagium.simulation import gaits, simulate
from patagium_lab.published.aerodynamics import PUBLISHED_ERRORS, Published
from patagium_lab.published.stepping import simulate_published
from patagium_lab.reproduction.flights import PUBLISHED_GAIT, TIME_STEP, weight_of

GENTLE_GAIT = {"frequency": 5.0, "amplitude": 0.6, "speed": 3.0}
"""The corrected baseline: beats a second [Hz], plunge [rad], initial speed [m/s]."""
DIRECTIONS = 10_000
"""Number of velocity directions in which the sign of the air's power is computed."""
AIR_ERRORS = {
    "E1 sign of incidence": "sign",
    "E2 drag pushes backwards": "backwards_drag",
    "E4 factor 5": "factor",
    "E5 polar at negative incidence": "polar",
    "E9 incidence at mid-chord": "midchord",
}
"""Name in the tables to the name in `Published`."""
MEANINGS = {
    "E1": "a wing that moves down is pushed down: the angle of attack has the wrong sign",
    "E2": "drag pushes on a wing that moves backwards",
    "E3": "joints are overwritten at each step: momentum and energy come from nowhere",
    "E4": "both coefficients of the air have a factor of 5 that nothing explains",
    "E5": "a polar for 0 to 90 degrees is used at negative incidence too",
    "E6": "two moments of inertia are swapped: feathering is 2.4 times too heavy",
    "E7": "the yaw at the start is 2 pi: no other motion, but 6.28 goes into the network",
    "E8": "15 Hz at 2 m/s is far outside of the quasi-steady theory that computes the air",
    "E9": "the incidence is that of mid-chord, the force acts at a quarter chord",
    "E10": "the filter's points are shrunk 20 times and P is lost each step: no cubature rule",
    "E11": "the correction of the weights is written with the wrong sign",
    "E12": "the error of 0.04 % is not said to be over anything, and pitch is visibly wrong",
    "E13": "first calls of an interpreted model are compared with compiled code of another",
}
"""What each error of the published experiment is."""
STEPPING, INERTIA, HEADING = "E3 overwritten joints", "E6 swapped inertia", "E7 yaw of 2 pi"


def cited_errors(blocks: Sequence[object]) -> Table:
    """Table of what the errors are that some text cites.

    Args:
        blocks: Blocks of a page.
    """
    cited = set(re.findall(r"E\d+", " ".join(str(block) for block in blocks)))
    return Table(("error", "what it is"), [row for row in MEANINGS.items() if row[0] in cited])


@dataclass(frozen=True)
class Variant:
    """A robot, air and stepping with some of the errors.

    Attributes:
        errors: Errors of the air, names in `Published`.
        overwritten: Whether joints are overwritten (E3).
        swapped: Whether the inertia is swapped (E6).
        turned: Whether the robot starts at a yaw of 2 pi (E7).
    """

    errors: frozenset[str] = frozenset()
    overwritten: bool = False
    swapped: bool = False
    turned: bool = False

    def air(self) -> Aerodynamics:
        """The model of the air, around the robot."""
        robot = load_robot("aerobat-published" if self.swapped else "aerobat")
        return Published(robot, errors=self.errors)

    def fly(self, gait: dict[str, float], duration: float) -> xr.Dataset:
        """The flight, up to where it ends.

        Args:
            gait: frequency [Hz], amplitude [rad], speed [m/s].
            duration: Duration of the flight [s].
        """
        aero = self.air()
        span: dict[str, Any] = {"duration": duration, "time_step": TIME_STEP, "throw": False}
        if self.overwritten:
            return simulate_published(aero.robot, aero, **span, **gait)  # type: ignore[arg-type]
        robot = aero.robot
        plunge = gaits.sinusoidal(robot, frequency=gait["frequency"], plunge=gait["amplitude"])
        q = robot.coordinates(yaw=2 * np.pi if self.turned else 0.0)
        return simulate(robot, aero, plunge, q=q, v=robot.coordinates(x=gait["speed"]), **span)


EVERYTHING = frozenset(PUBLISHED_ERRORS)


def put_in() -> dict[str, Variant]:
    """The corrected model, and each error alone in it."""
    return {
        "corrected": Variant(),
        **{name: Variant(frozenset({error})) for name, error in AIR_ERRORS.items()},
        STEPPING: Variant(overwritten=True),
        INERTIA: Variant(swapped=True),
        HEADING: Variant(turned=True),
        "all of them": Variant(EVERYTHING, overwritten=True, swapped=True),
    }


def taken_away() -> dict[str, Variant]:
    """The published model, and each error alone taken from it; E7 comes with the stepping."""
    published = {"overwritten": True, "swapped": True}
    return {
        "published": Variant(EVERYTHING, **published),
        **{
            f"without {name}": Variant(EVERYTHING - {error}, **published)
            for name, error in AIR_ERRORS.items()
        },
        f"without {STEPPING}": Variant(EVERYTHING, swapped=True, turned=True),
        f"without {INERTIA}": Variant(EVERYTHING, overwritten=True),
        "corrected": Variant(),
    }


@dataclass(frozen=True)
class ErrorCase:
    """A flight with some of the errors.

    Attributes:
        table: Table of its row, "put_in" or "taken_away".
        name: Name of the variant.
        variant: Robot, air and stepping.
        gait: frequency [Hz], amplitude [rad], speed [m/s].
    """

    table: str
    name: str
    variant: Variant
    gait: dict[str, float]


def error_cases() -> list[ErrorCase]:
    """Flights of both tables."""
    return [
        ErrorCase(table, name, variant, gait)
        for table, gait, variants in (
            ("put_in", GENTLE_GAIT, put_in()),
            ("taken_away", dict(PUBLISHED_GAIT), taken_away()),
        )
        for name, variant in variants.items()
    ]


def fly_case(case: ErrorCase, duration: float) -> dict[str, Any]:
    """Name of a variant, and the figures of its flight as `measure` gives them.

    Args:
        case: The flight.
        duration: Duration of the flight [s].
    """
    flight = case.variant.fly(case.gait, duration)
    return {"variant": case.name, **measure(case.variant, flight)}


def measure(variant: Variant, flight: xr.Dataset) -> dict[str, Any]:
    """Figures that show the errors of a flight.

    Args:
        variant: Robot, air and stepping of the flight.
        flight: The flight.

    Returns:
        peak_speed [m/s], peak_force [N], mean lift over weight, energy residual over the energy
        exchanged, momentum residual over the impulse exchanged, work that the joints did in all
        [J] (None where they are overwritten), share of the time in which the air does work on the
        robot, share of all velocity directions in which it does on a
        strip, seconds flown and how it ended.
    """
    v, force = flight["v"].to_numpy(), flight["aero_force"].to_numpy()
    return {
        "peak_speed": float(np.linalg.norm(v[:, :3], axis=1).max()),
        "peak_force": float(np.linalg.norm(force[:, :3], axis=1).max()),
        "lift_over_weight": float(force[:, 2].mean() / weight_of(flight)),
        "energy_residual": float(flight.attrs["energy_audit"]),
        "momentum_residual": float(flight.attrs["momentum_audit"]),
        "joint_work": None if variant.overwritten else float(flight["joint_work"][-1]),
        "driven_time": float((flight["aero_power"].to_numpy() > 0).mean()),
        "driven_directions": driven_directions(variant.air()),
        "seconds": float(flight["time"][-1]),
        "outcome": str(flight.attrs["outcome"]),
    }


def driven_directions(aero: Aerodynamics) -> float:
    """Share of the directions of motion in which the air does work on a strip, F . v > 0.

    The robot translates in its plane of symmetry, wings flat, so that all strips move alike.

    Args:
        aero: The model, in still air.
    """
    angle = 2 * np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    v = np.zeros((DIRECTIONS, aero.robot.dof))
    v[:, aero.robot.index("x")], v[:, aero.robot.index("z")] = np.cos(angle), np.sin(angle)
    function = next(f for f in aero_functions(aero) if f.name() == "strips")
    strips = function(
        q=np.zeros(aero.robot.dof),
        v=v.T,
        wind=np.zeros(3),
        robot_parameters=aero.robot.parameters,
        aero_parameters=np.asarray(aero.parameters, float),
    )
    power = np.asarray(strips["power"])
    return float((power > 0).mean())


COLUMNS = {
    "variant": "variant",
    "peak speed [m/s]": "peak_speed",
    "peak force [N]": "peak_force",
    "mean lift / weight [1]": "lift_over_weight",
    "energy residual / exchanged [1]": "energy_residual",
    "momentum residual / exchanged [1]": "momentum_residual",
    "work of the joints [J]": "joint_work",
    "share of time driven by the air [1]": "driven_time",
    "share of directions with F·v > 0 [1]": "driven_directions",
    "flown [s]": "seconds",
}
"""Headings of the tables, and the figures under them."""

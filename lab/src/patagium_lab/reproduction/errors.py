"""What each error of the published experiment does to the flight.

Two baselines: the corrected model, into which each error is put alone, at a gait within the
robot's means; and the published model, from which each is taken away, at the published gait.
All flap plunge alone, because the published stepping knows no other joint. Neglected: pairs
of errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.aerodynamics import Aerodynamics
from patagium.aerodynamics.model import aero_functions
from patagium.report import Table
from patagium.robot import load_robot
from patagium.simulation import gaits, simulate
from patagium_lab.published.aerodynamics import PUBLISHED_ERRORS, Published
from patagium_lab.published.stepping import simulate_published
from patagium_lab.reproduction.flights import PUBLISHED_GAIT, TIME_STEP, weight_of

Array = NDArray[np.float64]

GENTLE_GAIT = {"frequency": 5.0, "amplitude": 0.6, "speed": 3.0}
"""The corrected baseline: beats a second [Hz], plunge [rad], initial speed [m/s]."""
DIRECTIONS = 10_000
"""Velocity directions in which the sign of the air's power is asked."""
AIR_ERRORS = {
    "E1 sign of incidence": "sign",
    "E2 drag pushes backwards": "backwards_drag",
    "E4 factor 5": "factor",
    "E5 polar at negative incidence": "polar",
    "E9 incidence at mid-chord": "midchord",
}
"""Name in the tables to the name in `Published`."""
STEPPING, INERTIA, HEADING = "E3 overwritten joints", "E6 swapped inertia", "E7 yaw of 2 pi"


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
        """The flight, or what there is of it.

        Args:
            gait: frequency [Hz], amplitude [rad], speed [m/s].
            duration: [s].
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
class Case:
    """A variant to fly, and where its row stands.

    Attributes:
        table: "put_in" or "taken_away".
        name: Of the variant.
        variant: What is flown.
        gait: frequency [Hz], amplitude [rad], speed [m/s].
    """

    table: str
    name: str
    variant: Variant
    gait: dict[str, float]


def error_cases() -> list[Case]:
    """Every variant of both tables."""
    return [
        Case(table, name, variant, gait)
        for table, gait, variants in (
            ("put_in", GENTLE_GAIT, put_in()),
            ("taken_away", dict(PUBLISHED_GAIT), taken_away()),
        )
        for name, variant in variants.items()
    ]


def fly_case(case: Case, duration: float) -> dict[str, Any]:
    """A variant flown: its name and what `measure` finds.

    Args:
        case: What to fly.
        duration: [s].
    """
    flight = case.variant.fly(case.gait, duration)
    return {"table": case.table, "variant": case.name, **measure(case.variant, flight)}


def measure(variant: Variant, flight: xr.Dataset) -> dict[str, Any]:
    """What a flight shows of its errors.

    Args:
        variant: What was flown.
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
    "peak_speed": "peak speed [m/s]",
    "peak_force": "peak force [N]",
    "lift_over_weight": "mean lift / weight",
    "energy_residual": "energy residual / exchanged",
    "momentum_residual": "momentum residual / exchanged",
    "joint_work": "work of the joints [J]",
    "driven_time": "time driven by the air",
    "driven_directions": "directions with F·v > 0",
    "seconds": "flown [s]",
}


def error_table(rows: list[dict[str, Any]], caption: str) -> Table:
    """Rows of `fly_case` as a table.

    Args:
        rows: One dictionary a variant.
        caption: What it shows.
    """
    return Table(list(COLUMNS.values()), [[row[key] for key in COLUMNS] for row in rows], caption)

"""The measured flapping wing of Yeo et al. (2011): lift over a cycle, nothing tuned."""

from __future__ import annotations

import numpy as np

from patagium.aerodynamics import (
    FOUR_STATE,
    TWO_STATE,
    AddedMass,
    Air,
    Indicial,
    LiftingLine,
    QuasiSteady,
)
from patagium.robot import load_robot
from patagium.simulation import gaits, simulate
from patagium.studies.validation_cases.case import Array, CaseResult, mean_difference
from patagium.studies.yeo_case import YeoCase, load_yeo_case

STEPS = 1000
"""Time steps a cycle."""
CYCLES = 2


def compute() -> list[CaseResult]:
    """Lift of both wings over the last of the cycles."""
    case = load_yeo_case()
    two, two_carried = _lift(case, TWO_STATE)
    four, four_carried = _lift(case, FOUR_STATE)
    models = {
        "quasi-steady": _lift(case, None)[0],
        "lifting line, two states": two,
        "the same with added mass": two + two_carried,
        "four states and added mass": four + four_carried,
    }
    return [
        CaseResult(
            "A measured flapping wing",
            case.source,
            "phase of the beat [rad]",
            "lift of both wings [N]",
            case.phase,
            case.lift,
            models,
            "mean absolute difference [N]",
            mean_difference(case.lift, models),
            case.published_error,
            "No constant is fitted to this case. The lift is that of nine pressure ports a wing.",
        )
    ]


def _lift(case: YeoCase, lags: Indicial | None) -> tuple[Array, Array]:
    """Lift of the strips over the last cycle, and that of the air carried along, (100,) [N].

    The wings follow the measured flap angle: what the air does cannot change the motion.
    """
    robot = load_robot("yeo-wing")
    air = Air(density=case.density, wind=(-case.airspeed, 0.0, 0.0))
    aero = QuasiSteady(robot, air) if lags is None else LiftingLine(robot, air, lags=lags)
    angle = case.flap_angle
    flap = (angle.mean, list(zip(angle.cosine, angle.sine, strict=True)))
    flight = simulate(
        robot,
        aero,
        gaits.fourier(robot, frequency=case.frequency, plunge=flap),
        duration=CYCLES / case.frequency,
        time_step=1 / (STEPS * case.frequency),
        added_mass=AddedMass(robot, air),
    )
    momentum = flight["fluid_momentum"].to_numpy()[:, 2]
    carried = -np.gradient(momentum, flight["time"].to_numpy())
    strips = flight["strip_force"].to_numpy()[:, :, 2].sum(axis=1)
    last = slice((CYCLES - 1) * STEPS, CYCLES * STEPS, STEPS // len(case.lift))
    return strips[last], carried[last]

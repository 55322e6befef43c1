"""The measured flapping wing of Yeo et al. (2011): lift over a cycle, nothing tuned."""

from __future__ import annotations

import numpy as np

from patagium.aerodynamics import AddedMass, Aerodynamics, Air, DeLaurier, LiftingLine, QuasiSteady
from patagium.aerodynamics.indicial import FOUR_STATE, TWO_STATE
from patagium.arrays import Array
from patagium.robot import load_robot
from patagium.simulation import gaits, simulate
from patagium_lab.measured.yeo_case import YeoCase, load_yeo_case
from patagium_lab.validation.cases.case import CaseResult, ErrorLimit, mean_difference

STEPS = 1000
"""Time steps a cycle."""
CYCLES = 2


def compute() -> list[CaseResult]:
    """Lift of both wings over the last of the cycles."""
    case, robot = load_yeo_case(), load_robot("yeo-wing")
    air = Air(density=case.density, wind=(-case.airspeed, 0.0, 0.0))
    two, two_carried = _lift(case, LiftingLine(robot, air, lags=TWO_STATE))
    four, four_carried = _lift(case, LiftingLine(robot, air, lags=FOUR_STATE))
    strips, strips_carried = _lift(case, DeLaurier(robot, air))
    models = {
        "quasi-steady": _lift(case, QuasiSteady(robot, air))[0],
        "DeLaurier's strips and added mass": strips + strips_carried,
        "lifting line, two states": two,
        "lifting line, two states and added mass": two + two_carried,
        "lifting line, four states and added mass": four + four_carried,
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
            {
                "lifting line, two states and added mass": ErrorLimit(
                    0.027, "the best quasi-steady model known; a vortex lattice has .0291"
                )
            },
        )
    ]


def _lift(case: YeoCase, aero: Aerodynamics) -> tuple[Array, Array]:
    """Lift of the strips over the last cycle, and that of the air carried along, (100,) [N].

    The wings follow the measured flap angle: what the air does cannot change the motion.
    """
    angle = case.flap_angle
    flap = (angle.mean, list(zip(angle.cosine, angle.sine, strict=True)))
    flight = simulate(
        aero.robot,
        aero,
        gaits.fourier(aero.robot, frequency=case.frequency, plunge=flap),
        duration=CYCLES / case.frequency,
        time_step=1 / (STEPS * case.frequency),
        added_mass=AddedMass(aero.robot, aero.air),
    )
    momentum = flight["fluid_momentum"].to_numpy()[:, 2]
    carried = -np.gradient(momentum, flight["time"].to_numpy())
    strips = flight["strip_force"].to_numpy()[:, :, 2].sum(axis=1)
    last = slice((CYCLES - 1) * STEPS, CYCLES * STEPS, STEPS // len(case.lift))
    return strips[last], carried[last]

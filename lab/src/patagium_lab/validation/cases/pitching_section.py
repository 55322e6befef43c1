"""The measured S809 section pitching through stall: lift loops beside the static polar."""

from __future__ import annotations

import numpy as np

from patagium.aerodynamics import LiftingLine, StallDelay, measured_section, section_history
from patagium.aerodynamics.indicial import TWO_STATE
from patagium_lab.validation.cases.case import Array, CaseResult, ErrorLimit, mean_difference
from patagium_lab.validation.pitching import PitchingCase, PitchLoop, load_pitching_case

STEPS = 180
"""Time steps an oscillation."""
CYCLES = 2


def compute() -> list[CaseResult]:
    """Lift coefficient over the last of the oscillations, with and without a stall delay."""
    case = load_pitching_case()
    return [_result(case, loop) for loop in case.loops]


def _result(case: PitchingCase, loop: PitchLoop) -> CaseResult:
    static = np.interp(loop.incidence, case.angle, case.static_lift)
    models = {
        "lifting line with stall delay": lift_loop(case, loop, StallDelay()),
        "without delay": lift_loop(case, loop, None),
        "static polar": static,
    }
    errors = mean_difference(loop.lift, models)
    known = {"static polar at the measured incidence": errors.pop("static polar")}
    k = np.pi * loop.frequency * case.chord / case.airspeed
    return CaseResult(
        f"A pitching section, {loop.name}",
        case.source,
        "incidence [rad]",
        "lift coefficient [1]",
        loop.incidence,
        loop.lift,
        models,
        "mean absolute difference [1]",
        errors,
        known,
        f"Reduced frequency {k:.3f}, {np.degrees(loop.mean):.1f} +- "
        f"{np.degrees(loop.amplitude):.1f} degrees. The section is made of its static polar; the "
        "lags of stall are Leishman and Beddoes' (1.7, 3.0 and 6.0 semichords), those of the "
        "wake Jones'.",
        {
            "lifting line with stall delay": ErrorLimit(
                min(known.values()) / 2, "half of that of the static polar"
            ),
            "without delay": ErrorLimit(min(known.values()), "that of the static polar"),
        },
    )


def lift_loop(case: PitchingCase, loop: PitchLoop, stall_delay: StallDelay | None) -> Array:
    """Lift coefficient at the phases of a record, added mass included, (N,).

    Args:
        case: Section with its static polar.
        loop: Motion of the section.
        stall_delay: Dynamic stall, or None.
    """
    section = measured_section(case.angle, case.static_lift, case.static_drag)
    phases = np.arange(CYCLES * STEPS + 1) * 2 * np.pi / STEPS
    history = section_history(
        lambda wing, air: LiftingLine(wing, air, TWO_STATE, section, stall_delay=stall_delay),
        phases / (2 * np.pi * loop.frequency),
        pitch=loop.motion(phases)[0],
        airspeed=case.airspeed,
        chord=case.chord,
    )
    last = slice((CYCLES - 1) * STEPS, CYCLES * STEPS)
    lift = history["lift"].to_numpy()[last]
    return np.asarray(np.interp(loop.phase, phases[:STEPS], lift, period=2 * np.pi))

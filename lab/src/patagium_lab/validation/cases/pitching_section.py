"""Measured sections that pitch through stall, beside their static polars."""

from __future__ import annotations

import numpy as np

from patagium.aerodynamics import LiftingLine, StallDelay, measured_section, section_history
from patagium.aerodynamics.indicial import TWO_STATE
from patagium.arrays import Array
from patagium_lab.validation.cases.case import CaseResult, ErrorLimit, mean_difference
from patagium_lab.validation.pitching import PitchingCase, PitchLoop, load_pitching_case

STEPS = 180
"""Time steps an oscillation."""
CYCLES = 2
DELAYED = "lifting line with stall delay"


def compute() -> list[CaseResult]:
    """Coefficients over the last of the oscillations, with and without a stall delay."""
    cases = (load_pitching_case(name) for name in ("osu_s809", "glasgow_naca23012a"))
    return [result for case in cases for loop in case.loops for result in _results(case, loop)]


def _results(case: PitchingCase, loop: PitchLoop) -> list[CaseResult]:
    delayed, at_once = (history(case, loop, delay) for delay in (StallDelay(), None))
    measured = {"lift": loop.lift, "drag": loop.drag, "moment": loop.moment}
    static = {"lift": case.static_lift, "drag": case.static_drag, "moment": case.static_moment}
    k = np.pi * loop.frequency * case.chord / case.airspeed
    note = (
        f"Reduced frequency {k:.3f}, {np.degrees(loop.mean):.1f} +- "
        f"{np.degrees(loop.amplitude):.1f} degrees. The section is made of its static polar; the "
        "lags of stall are Leishman and Beddoes' (1.7, 3.0 and 6.0 semichords), those of the "
        f"wake Jones'.{case.remark and ' '}{case.remark}"
    )
    results = []
    for quantity, expected in measured.items():
        polar = static[quantity]
        if expected is None or polar is None:
            continue
        models = {
            DELAYED: delayed[quantity],
            "without delay": at_once[quantity],
            "static polar": np.interp(loop.incidence, case.angle, polar),
        }
        errors = mean_difference(expected, models)
        held = errors.pop("static polar")
        targets = {DELAYED: ErrorLimit(held, "that of the static polar")}
        if quantity == "lift":
            targets = {
                DELAYED: ErrorLimit(held / 2, "half of that of the static polar"),
                "without delay": ErrorLimit(held, "that of the static polar"),
            }
        results.append(
            CaseResult(
                f"A pitching section, {loop.name}{'' if loop.drag is None else ', ' + quantity}",
                case.source,
                "incidence [rad]",
                f"{quantity} coefficient [1]",
                loop.incidence,
                expected,
                models,
                "mean absolute difference [1]",
                errors,
                {"static polar at the measured incidence": held},
                note,
                targets,
            )
        )
    return results


def history(
    case: PitchingCase, loop: PitchLoop, stall_delay: StallDelay | None
) -> dict[str, Array]:
    """Coefficients of lift, drag and moment at the phases of a record, added mass included.

    Args:
        case: Section with its static polar.
        loop: Motion of the section.
        stall_delay: Dynamic stall, or None.

    Returns:
        Arrays (N,) [1] by the names lift, drag and moment.
    """
    polar = (case.angle, case.static_lift, case.static_drag, case.static_moment)
    section = measured_section(*polar)
    phases = np.arange(CYCLES * STEPS + 1) * 2 * np.pi / STEPS
    flown = section_history(
        lambda wing, air: LiftingLine(wing, air, TWO_STATE, section, stall_delay=stall_delay),
        phases / (2 * np.pi * loop.frequency),
        pitch=loop.motion(phases)[0],
        airspeed=case.airspeed,
        chord=case.chord,
    )
    last = slice((CYCLES - 1) * STEPS, CYCLES * STEPS)
    return {
        name: np.interp(loop.phase, phases[:STEPS], flown[name].to_numpy()[last], period=2 * np.pi)
        for name in ("lift", "drag", "moment")
    }

"""The measured S809 section pitching through stall: lift loops beside the static polar."""

from __future__ import annotations

import numpy as np

from patagium.aerodynamics import (
    TWO_STATE,
    AddedMass,
    Air,
    LiftingLine,
    StallDelay,
    measured_section,
)
from patagium.robot import Robot
from patagium_lab.validation.cases.case import Array, CaseResult, ErrorLimit, mean_difference
from patagium_lab.validation.cases.wings import INFINITE, flat_wing
from patagium_lab.validation.pitching import PitchingCase, PitchLoop, load_pitching_case

STEPS = 180
"""Time steps an oscillation."""
CYCLES = 2
PITCH = 4
"""Coordinate of the wing, positive nose down."""


def compute() -> list[CaseResult]:
    """Lift coefficient over the last of the oscillations, with and without a stall delay."""
    case = load_pitching_case()
    ends = np.linspace(-0.5, 0.5, 4) * INFINITE * case.chord
    wing = flat_wing(ends, np.full(3, case.chord))
    return [_result(case, loop, wing) for loop in case.loops]


def _result(case: PitchingCase, loop: PitchLoop, wing: Robot) -> CaseResult:
    static = np.interp(loop.incidence, case.angle, case.static_lift)
    models = {
        "lifting line with stall delay": lift_loop(case, loop, wing, StallDelay()),
        "without delay": lift_loop(case, loop, wing, None),
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
        "lags of stall are Leishman and Beddoes' (1.7 and 3.0 semichords), those of the wake "
        "Jones'. The vortex of deep dynamic stall is no part of the model.",
        dict.fromkeys(errors, ErrorLimit(min(known.values()), "that of the static polar")),
    )


def lift_loop(
    case: PitchingCase, loop: PitchLoop, wing: Robot, stall_delay: StallDelay | None
) -> Array:
    """Lift coefficient at the phases of a record, added mass included, (N,).

    Args:
        case: Section with its static polar.
        loop: Motion of the section.
        wing: A wing without end of the section's chord.
        stall_delay: Lags of separation, or None.
    """
    air = Air(wind=(-case.airspeed, 0.0, 0.0))
    section = measured_section(case.angle, case.static_lift, case.static_drag)
    aero = LiftingLine(wing, air, TWO_STATE, section, 0.0, stall_delay)
    carried, omega = AddedMass(wing, air), 2 * np.pi * loop.frequency
    step = 2 * np.pi / STEPS

    def state_of(phase: float) -> tuple[Array, Array, Array]:
        q, v, a = np.zeros((3, wing.dof))
        # the coordinate is nose down
        q[PITCH], v[PITCH], a[PITCH] = -loop.motion([phase])[:, 0] * [1.0, omega, omega**2]
        return q, v, a

    def rate(phase: float, z: Array) -> Array:
        q, v, _ = state_of(phase)
        return aero.state_derivative(q, v, z) / omega

    z, lift = np.zeros(aero.state_size), np.zeros(STEPS)
    for k in range(CYCLES * STEPS):
        phase = k * step
        if k >= (CYCLES - 1) * STEPS:
            q, v, a = state_of(phase)
            force = aero.generalized_force(q, v, z) + carried.generalized_force(q, v, a)
            lift[k % STEPS] = (force + carried.circulatory_force(q, v))[2]
        first = rate(phase, z)
        second = rate(phase + step / 2, z + step / 2 * first)
        third = rate(phase + step / 2, z + step / 2 * second)
        fourth = rate(phase + step, z + step * third)
        z = z + step / 6 * (first + 2 * second + 2 * third + fourth)
    area = sum(float(strip.chord * strip.width) for strip in wing.strips)
    coefficient = lift / (0.5 * air.density * case.airspeed**2 * area)
    phases = np.arange(STEPS) * step
    return np.asarray(np.interp(loop.phase, phases, coefficient, period=2 * np.pi))

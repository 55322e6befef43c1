"""Thrust of wings that heave and pitch: Garrick's closed form, and a vortex lattice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from patagium.aerodynamics import AddedMass, Air, Indicial, LiftingLine, Section
from patagium.aerodynamics.indicial import FOUR_STATE, TWO_STATE
from patagium.aerodynamics.trailing_vortices import SURFACE_CONSTANT
from patagium.arrays import Array
from patagium.robot import load_robot_text
from patagium.simulation import gaits, simulate
from patagium_lab.validation.cases.case import CaseResult, ErrorLimit, largest_difference
from patagium_lab.validation.cases.wings import AIRSPEED, INFINITE
from patagium_lab.validation.exact_functions import theodorsen_function

STEPS, BEATS = 200, 6
"""Time steps a beat, and beats, of which the last counts."""
STRIPS = 16


@dataclass(frozen=True)
class Motion:
    """Heave z = h cos wt and pitch theta cos(wt + phase), nose up, about the quarter chord.

    Attributes:
        frequency: Reduced, k = w c / 2U [1].
        heave: Amplitude h, chord 1 m [m].
        pitch: Amplitude [rad].
        phase: Of the pitch, before the heave [rad].
    """

    frequency: float
    heave: float
    pitch: float = 0.0
    phase: float = 0.0


SMALL = (
    (0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.01, 0.01, np.pi / 2), (0.01, 0.01, -np.pi / 2)
)  # fmt: skip
SECTIONS = tuple(Motion(k, h, th, phase) for k in (0.1, 0.3, 0.6, 1.0) for h, th, phase in SMALL)
RATIOS, FREQUENCIES = (4.0, 8.0), (0.1, 0.3, 0.6)
"""Aspect ratios of the wings of finite span, and reduced frequencies of their heave."""
HEAVE = 0.25
"""Amplitude of this heave [chords]."""
LONG = 100.0
"""Aspect ratio of the wing that they are compared with."""
LATTICE = (
    ((0.00562, 0.03375, 0.10557), (0.00325, 0.02451, 0.08358), (0.00435, 0.02938, 0.09519)),
    ((0.26874, 0.64833, 1.26582), (0.18891, 0.52227, 1.08763), (0.22797, 0.58931, 1.18204)),
)
"""Thrust, then amplitude of lift, in a vortex lattice, over rho U^2 S / 2: a row for each aspect
ratio, `LONG` first, a column for each frequency [1].

By PteraSoftware 5.1: ring vortices, 8 along the chord and 16 along the span, a wake of fixed
shape, 80 steps a beat, the last of four beats. At the highest frequency the long wing has 1.055
times the thrust and 1.12 times the lift of a section, so that what a finite span takes away is
compared; 6 and 12 rings and 40 steps change these shares by .011 at most."""
FOIL = """
name: foil
gravity: 9.81 m/s^2
bodies:
  carriage:
    joints:
      - {{name: surge, type: prismatic, axis: x}}
      - {{name: heave, type: prismatic, axis: z}}
    mass: 1e-6 kg
    inertia: {{xx: 1e-6 kg m^2, yy: 1e-6 kg m^2, zz: 1e-6 kg m^2}}
  wing:
    parent: carriage
    joints: [{{name: pitch, axis: -y}}]
    mass: 1e-6 kg
    inertia: {{xx: 1e-6 kg m^2, yy: 1e-6 kg m^2, zz: 1e-6 kg m^2}}
wings:
  - name: wing
    segments:
      - body: wing
        strips: {strips}
        at: [0, {root}, 0]
        stations:
          - {{span: 0 m, leading: 0.25 m, trailing: -0.75 m}}
          - {{span: {span} m, leading: 0.25 m, trailing: -0.75 m}}
"""


def garrick(motion: Motion) -> float:
    """Thrust coefficient of a section: leading-edge suction less lift times pitch angle.

    Garrick (1936), NACA Report 567.

    Args:
        motion: Its motion.
    """
    half, pitch = 0.5, motion.pitch * np.exp(1j * motion.phase)
    omega = motion.frequency * AIRSPEED / half
    sinking, turning = -1j * omega * motion.heave, 1j * omega * pitch
    late = theodorsen_function(motion.frequency) * (AIRSPEED * pitch + sinking + half * turning)
    carried = 1j * omega * (sinking + half / 2 * turning) + AIRSPEED * turning
    lift = np.pi * half * (half * carried + 2 * AIRSPEED * late)
    suction = np.pi * half * np.abs(2 * late - half * turning) ** 2 / 2
    return float(np.squeeze(suction - np.real(pitch * np.conj(lift))) / AIRSPEED**2)


def compute() -> list[CaseResult]:
    """Thrust of sections, and what a finite span takes from thrust and lift of a heave."""
    lags = {"two states": TWO_STATE, "four states": FOUR_STATE}
    sections = {
        name: np.array([coefficients(motion, INFINITE, lag)[0] for motion in SECTIONS])
        for name, lag in lags.items()
    }
    exact = np.array([garrick(motion) for motion in SECTIONS])
    spans = {
        "two states, lags of a section": lambda ratio: TWO_STATE,
        "two states, lags of a finite span": TWO_STATE.finite_span,
        "four states, lags of a finite span": FOUR_STATE.finite_span,
    }
    heaves = [Motion(k, HEAVE) for k in FREQUENCIES]
    finite = {
        name: [[coefficients(one, a, lag(a)) for one in heaves] for a in (LONG, *RATIOS)]
        for name, lag in spans.items()
    }
    shares = {name: _shares(np.moveaxis(np.array(found), 2, 0)) for name, found in finite.items()}
    return [_section(exact, sections), _finite(_shares(np.array(LATTICE)), shares)]


def _shares(found: Array) -> Array:
    """Thrust, then lift, over those of the long wing: aspect ratio by aspect ratio, (12,)."""
    return np.asarray(found[:, 1:] / found[:, :1]).ravel()


def _section(exact: Array, models: dict[str, Array]) -> CaseResult:
    scaled = {name: found / exact.max() for name, found in models.items()}
    return CaseResult(
        "Thrust of a section that heaves and pitches",
        "Garrick (1936), NACA Report 567",
        "motion [1]",
        "thrust over that of the largest [1]",
        np.arange(1.0, len(exact) + 1),
        exact / exact.max(),
        scaled,
        "largest difference [1]",
        largest_difference(exact / exact.max(), scaled),
        {},
        "Motions: heave; pitch about the quarter chord; both, pitch 90 degrees ahead and behind; "
        "at reduced frequencies of .1, .3, .6 and 1. With added mass.",
        {
            "two states": ErrorLimit(
                0.06, "twice the lags' error on Theodorsen's function, over it"
            ),
            "four states": ErrorLimit(0.01, "the error of the amplitude, of second order"),
        },
    )


def _finite(expected: Array, models: dict[str, Array]) -> CaseResult:
    limit = ErrorLimit(0.055, "what the lattice's thrust of a section is off at most")
    return CaseResult(
        "Heaving wings of finite span",
        "PteraSoftware 5.1, an unsteady lattice of ring vortices",
        "wing and reduced frequency [1]",
        f"share of the thrust (1 to 6) and lift of a wing of aspect ratio {LONG:g} [1]",
        np.arange(1.0, len(expected) + 1),
        expected,
        models,
        "largest difference [1]",
        largest_difference(expected, models),
        {},
        "Rectangular wings of aspect ratio 4, then 8, that heave by a quarter chord at reduced "
        "frequencies of .1, .3 and .6. The lags of a section hold back too much of a finite wing's "
        "force; `Indicial.finite_span` gives those of its span. With added mass and the gain of a "
        "surface.",
        {name: limit for name in models if "finite" in name},
    )


def coefficients(motion: Motion, aspect_ratio: float, lags: Indicial) -> tuple[float, float]:
    """Thrust and amplitude of lift of a rectangular wing of chord 1 m, over rho U^2 S / 2 [1].

    Args:
        motion: Its motion.
        aspect_ratio: Its span over its chord.
        lags: Memory of its strips.
    """
    endless = aspect_ratio == INFINITE
    text = FOIL.format(strips=3 if endless else STRIPS, root=-aspect_ratio / 2, span=aspect_ratio)
    robot, air = load_robot_text(text, "foil"), Air(wind=(-AIRSPEED, 0.0, 0.0))
    constant = 0.0 if endless else SURFACE_CONSTANT
    wing = LiftingLine(robot, air, lags, Section(profile_drag=0.0), surface_constant=constant)
    turn = motion.pitch * np.exp(1j * motion.phase)
    beat = np.pi / (motion.frequency * AIRSPEED)
    gait = gaits.fourier(
        robot,
        frequency=1 / beat,
        surge=(0.0, []),
        heave=(0.0, [(motion.heave, 0.0)]),
        pitch=(0.0, [(turn.real, -turn.imag)]),
    )
    added = AddedMass(robot, air)
    flight = simulate(
        robot, wing, gait, duration=BEATS * beat, time_step=beat / STEPS, added_mass=added
    )
    push = -flight["u1"].to_numpy()[-STEPS:, :2] / (air.density * AIRSPEED**2 * aspect_ratio / 2)
    return float(push[:, 0].mean()), float(2 * abs(np.fft.rfft(push[:, 1])[1]) / STEPS)

"""Measured force over a wingbeat on a robotic wing that moves as a hovering fruit fly's does.

Size, motion and force are those of a fruit fly to which the robot, in oil, was scaled by its
Reynolds number. Assumed: the wing is a flat plate whose chord follows a beta distribution, as in
`hover`, and keeps to its stroke plane; the robot followed the fly's deviation from it too, which
the source that was at hand does not give.
"""

from __future__ import annotations

import numpy as np

from patagium.aerodynamics import Aerodynamics, Air, Inflow, QuasiSteady, ReynoldsPolar
from patagium.arrays import Array
from patagium.robot import Robot
from patagium.simulation import simulate
from patagium_lab.validation.cases.case import CaseResult, ErrorLimit
from patagium_lab.validation.cases.hover import (
    BEATS,
    MODELS,
    STEPS,
    Insect,
    InsectWing,
    hoverer,
    insect_gait,
    motion_of,
)

DENSITY = 1.22521
"""Density of the air to which the forces were scaled [kg/m^3]."""
PHASES = 100
"""Samples of the figure."""
FLY = Insect(
    "robotic fruit fly",
    1.8e-6,
    188.7,
    (0.0, 0.0),
    (
        InsectWing(
            "fore",
            2.99e-3,
            2.99e-3**2 / 3.1519,
            0.0,
            (0.0, ()),
            motion_of(3.9008, (65.0445, 3.5806, 0.1319, 0.7844), (4.2642, -2.9492, 0.3639, 0.2098)),
            motion_of(
                85.7064,
                (-1.8536, -5.1852, 8.4569, -3.9562, 3.0337, 2.8771, -0.8649, -0.0771),
                (-59.6529, -1.6095, -9.8057, -5.8064, 2.8749, -0.6686, 0.6137, 1.0007),
            ),
        ),
    ),
    0.58,
)
"""Both wings of the fly: kinematics as fitted by X. Ke to the records of Muijres and others."""
HORIZONTAL = (
    0.037,
    (-0.035, -0.399, 0.184, 0.279, -0.185, -0.077, -0.010, -0.012),
    (-1.852, -0.211, 0.620, -0.192, 0.020, 0.163, -0.026, -0.021),
)
"""Force of both wings over the weight, forward: mean, cosines and sines of the beat [1].

Reduced from the record of a beat; eight harmonics leave .01 of it (root mean square)."""
VERTICAL = (
    1.022,
    (0.193, -1.022, -0.046, -0.122, -0.435, 0.140, 0.094, -0.008),
    (-0.010, -0.017, 0.170, -0.334, -0.208, 0.024, -0.069, 0.006),
)
"""The same, upward [1]."""
SOURCE = (
    "Muijres, Elzinga, Melis & Dickinson (2014), Science 344, 172-177: steady wingbeat of "
    "Drosophila hydei on a robotic wing, as in the public programs of the authors' laboratory and "
    "of X. Ke"
)


def measured(series: tuple[float, tuple[float, ...], tuple[float, ...]], phase: Array) -> Array:
    """Measured force over weight at phases of the beat, (N,) [1].

    Args:
        series: Mean, cosines and sines.
        phase: Shares of the beat, from the end of the backward stroke, (N,) [1].
    """
    mean, cosines, sines = series
    angles = 2 * np.pi * np.outer(phase, np.arange(1, len(cosines) + 1))
    return np.asarray(mean + np.cos(angles) @ cosines + np.sin(angles) @ sines)


def compute() -> list[CaseResult]:
    """Vertical and horizontal force of a beat by the models for hover, and by others."""
    makes = MODELS | {
        "quasi-steady, inflow and rotational circulation": lambda robot, air: Inflow(
            QuasiSteady(robot, air, polar=ReynoldsPolar(), rotational=True)
        ),
        "Dickinson's polar": lambda robot, air: QuasiSteady(robot, air),
        "Dickinson's polar and inflow": lambda robot, air: Inflow(QuasiSteady(robot, air)),
    }
    robot, air, phase = hoverer(FLY), Air(density=DENSITY), np.arange(PHASES) / PHASES
    found = {name: _force(robot, make(robot, air)) for name, make in makes.items()}
    up, forward = measured(VERTICAL, phase), measured(HORIZONTAL, phase)
    lifts = {name: force[:, 2] for name, force in found.items()}
    pushes = {name: force[:, 0] for name, force in found.items()}
    means = "; ".join(f"{name} {lift.mean() / up.mean():.2f}" for name, lift in lifts.items())
    return [
        CaseResult(
            "Robotic wing of a fruit fly, vertical force",
            SOURCE,
            "share of a wingbeat [1]",
            "force upward over weight [1]",
            phase,
            up,
            lifts,
            "difference of the means, over the measured one [1]",
            {name: float(abs(lift.mean() / up.mean() - 1)) for name, lift in lifts.items()},
            {},
            f"Mean force over the measured one: {means}. Largest forces come early in each stroke, "
            "while the wing still turns, where no model here has them: they are those of rotation "
            "and of the wake of the stroke before. The fly's deviation from its stroke plane is "
            "left out.",
            {"quasi-steady and inflow": ErrorLimit(0.15, "that of hovering insects")},
        ),
        CaseResult(
            "Robotic wing of a fruit fly, horizontal force",
            SOURCE,
            "share of a wingbeat [1]",
            "force forward over weight [1]",
            phase,
            forward,
            pushes,
            "root mean square of the difference, over that of the force [1]",
            {
                name: float(np.sqrt(np.mean((push - forward) ** 2) / np.mean(forward**2)))
                for name, push in pushes.items()
            },
            {},
            "This is the drag of the strokes, against which the fly works.",
        ),
    ]


def _force(robot: Robot, model: Aerodynamics) -> Array:
    """Force of all strips over the weight in the last beat, (PHASES, 3) [1]."""
    flight = simulate(
        robot,
        model,
        insect_gait(FLY, robot),
        duration=BEATS / FLY.frequency,
        time_step=1 / (STEPS * FLY.frequency),
    )
    beat = flight["strip_force"].to_numpy()[-STEPS - 1 : -1].sum(axis=1)
    return np.asarray(beat[:: STEPS // PHASES] / (9.81 * FLY.mass))

"""A wing whose tips fold by themselves about hinges that are not along the flow.

A tip that folds up turns its nose down, so that its angle tells how the weight of the tip and the
air balance. The wing is rigid, on a turning stand. Assumed: the model is one half of a wing, at a
wall that mirrors it; the mass of a tip is its fifth of the table of masses, and nothing else.
"""

from __future__ import annotations

import numpy as np

from patagium.aerodynamics import Aerodynamics, LiftingLine, QuasiSteady
from patagium.aerodynamics.indicial import NO_STATE
from patagium.robot import Robot, load_robot_text
from patagium_lab.validation.cases.bent_wing import at_rest, forces_at_rest
from patagium_lab.validation.cases.case import CaseResult, mean_difference

SPEED = 22.0
"""Speed of the air [m/s]."""
INCIDENCES = tuple(range(-18, 31, 3))
"""Of the root [deg]."""
FOLDS = {
    10.0: (
        *(-73.005, -70.579, -67.425, -62.249, -54.243, -43.569, -29.337, -12.275, 7.2945),
        *(23.548, 36.891, 48.131, 54.115, 59.695, 64.709, 67.701, 72.068),
    ),
    20.0: (
        *(-57.073, -53.525, -48.705, -43.215, -35.784, -26.881, -17.509, -7.2669, 3.7785),
        *(13.753, 22.589, 30.823, 36.982, 43.007, 47.626, 51.844, 57.267),
    ),
}
"""Measured angle of the tip by the angle of its hinge from the flow, tip up [deg]."""
SOURCE = (
    "Healy (2023), thesis at the University of Bristol: wind tunnel, as in the public data of "
    "AeroBeams"
)
NOTE = (
    "The measured angles are those of a tip whose incidence is some two degrees less: at a hinge "
    "of 10 degrees and roots of 0 and 5 degrees, speeds of 12 to 33 m/s, they fit a lift slope of "
    "4.3 to 4.6 and an incidence of 2.3 to 2.6 degrees less at every speed, which a heavier tip or "
    "another lift slope cannot be. What it is, the data do not say. AeroBeams was fitted to them "
    "by a loss of lift towards the tip."
)
TEXT = """
name: folding_wing
gravity: 9.80665 m/s^2
mirror: [{{from: left, to: right}}]
bodies:
  stand: {{parent: world, massless: true, joints: [{{name: incidence, axis: -y}}]}}
  left_tip:
    parent: stand
    at: [0 mm, 365 mm, 0 mm]
    joints: [{{name: left_fold, axis: [{along}, {across}, 0], passive: true}}]
    mass: 61 g
    center_of_mass: [-13.9 mm, 59 mm, 0 mm]
    inertia: {{xx: 1160 g cm^2, yy: 189 g cm^2, zz: 1300 g cm^2}}
wings:
  - name: left
    segments:
      - body: stand
        strips: 8
        stations:
          - {{span: 0 mm, leading: 19.5 mm, trailing: -58.5 mm}}
          - {{span: 365 mm, leading: 19.5 mm, trailing: -58.5 mm}}
      - body: left_tip
        strips: 5
        stations:
          - {{span: 0 mm, leading: 19.5 mm, trailing: -58.5 mm}}
          - {{span: 135 mm, leading: 19.5 mm, trailing: -58.5 mm}}
"""


def compute() -> list[CaseResult]:
    """Angle of the tip by the incidence of the root, for each hinge."""
    return [_case(hinge) for hinge in FOLDS]


def wing(hinge: float) -> Robot:
    """The wing on its stand.

    Args:
        hinge: Angle from the flow to the hinge of a tip, its front outwards [deg].
    """
    angle = np.radians(hinge)
    return load_robot_text(TEXT.format(along=np.cos(angle), across=np.sin(angle)))


def _case(hinge: float) -> CaseResult:
    robot = wing(hinge)
    names = robot.dof_names
    models: dict[str, Aerodynamics] = {
        "lifting line": LiftingLine(robot, lags=NO_STATE),
        "quasi-steady": QuasiSteady(robot),
    }
    incidences = np.array(INCIDENCES, float)
    wind = np.array([-SPEED, 0.0, 0.0])
    found = {}
    for name, model in models.items():
        forces, q, folds = forces_at_rest(robot, model), np.zeros(robot.dof), []
        for incidence in incidences:
            q[names.index("incidence")] = np.radians(incidence)
            q = at_rest(forces, robot, q, wind)
            folds.append(np.degrees(q[names.index("left_fold")]))
        found[name] = np.array(folds)
    expected = np.array(FOLDS[hinge])
    return CaseResult(
        f"A folding wing tip, hinge at {hinge:g} degrees",
        SOURCE,
        "incidence of the root [deg]",
        "angle of the tip, up [deg]",
        incidences,
        expected,
        found,
        "mean absolute difference [deg]",
        mean_difference(expected, found),
        {},
        NOTE,
    )

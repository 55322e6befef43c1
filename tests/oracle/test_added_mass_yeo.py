"""The measured flapping wing: lifting line and added mass, nothing tuned."""

from __future__ import annotations

import numpy as np

import patagium as pt
from patagium.aerodynamics import TWO_STATE
from patagium.studies.yeo_case import load_yeo_case


def test_lift_of_the_measured_wing_within_the_target() -> None:
    """Mean absolute error against nine pressure ports a wing; a vortex lattice has .0291 N."""
    case, robot = load_yeo_case(), pt.load_robot("yeo-wing")
    air = pt.Air(density=case.density, wind=(-case.airspeed, 0.0, 0.0))
    angle = case.flap_angle
    flap = (angle.mean, list(zip(angle.cosine, angle.sine, strict=True)))
    flight = pt.simulate(
        robot,
        pt.LiftingLine(robot, air, lags=TWO_STATE),
        pt.gaits.fourier(robot, frequency=case.frequency, plunge=flap),
        duration=2 / case.frequency,
        time_step=1 / (1000 * case.frequency),
        added_mass=pt.AddedMass(robot, air),
    )
    carried = -np.gradient(flight.fluid_momentum.values[:, 2], flight.time.values)
    circulatory = flight.strip_force.values[:, :, 2].sum(axis=1)
    cycle = slice(1000, 2000, 10)
    error = np.abs(circulatory[cycle] + carried[cycle] - case.lift).mean()
    assert error <= 0.027  # measured .0268, and .0281 without added mass
    assert error < np.abs(circulatory[cycle] - case.lift).mean()

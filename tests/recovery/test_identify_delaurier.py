"""A flight through DeLaurier's air, learned: models with states of their own are no exception."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.identification.training_data import training_data


@pytest.mark.parametrize("mass", [False, True], ids=["alone", "with added mass"])
def test_strips_learn_a_flight_flown_with_delaurier(mass: bool) -> None:
    robot = pt.load_robot("aerobat")
    aero = pt.DeLaurier(robot)
    flight = pt.simulate(
        robot,
        aero,
        pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.3),
        duration=0.4,
        time_step=5e-4,
        added_mass=pt.AddedMass(robot) if mass else None,
        q=robot.coordinates(pitch=0.1),
        v=robot.coordinates(x=4.0),
    )
    _, _, force = training_data(flight)
    known = flight["aero_force"].values
    if not mass:  # with it y also holds the apparent force of circulation
        assert np.allclose(force, known, rtol=1e-6, atol=1e-9 * np.abs(known).max())
    learner = pt.CubatureLearner(
        pt.StripNetwork(robot, (4,)), prior_deviation=0.3, measurement_deviation=3e-3
    )
    scores = pt.identify(flight, learner, every=10).scores
    # strips without memory explain nine tenths of a strip model with one lag a strip
    assert scores["nmse_second_half_mean"] < 0.1

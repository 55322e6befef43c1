"""A flight through DeLaurier's air, learned: models with states of their own are no exception."""

from __future__ import annotations

import numpy as np

import patagium as pt
from patagium.sensing.force.air_force import training_data


def test_strips_learn_a_flight_flown_with_delaurier_and_added_mass() -> None:
    robot = pt.load_robot("aerobat")
    flight = pt.simulate(
        robot,
        pt.DeLaurier(robot),
        pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.3),
        duration=0.4,
        time_step=5e-4,
        added_mass=pt.AddedMass(robot),
        q=robot.coordinates(pitch=0.1),
        v=robot.coordinates(x=4.0),
    )
    _, _, force = training_data(flight)
    known = flight["aero_force"].values
    assert np.abs(force - known).max() < 1e-9 * np.abs(known).max()  # rounding
    learner = pt.CubatureLearner(pt.StripNetwork(robot, (4,)), prior_std=0.3, measurement_std=3e-3)
    scores = pt.identify(flight, learner, every=10).scores
    # twice what it was: strips without memory learn strips with one lag each
    assert scores["nmse_second_half_mean"] < 0.05

"""Predicted forces of a flight: those of another flight are refused, other wings are told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import patagium as pt
from patagium.errors import LogError
from patagium.learning.model_file import save_model
from patagium.learning.result import load_identification
from patagium.viewer.predicted_forces import predict_flight

FRAMES = np.arange(0, 100, 10)


def fly(robot, added_mass=False, frequency=5.0):
    model = pt.QuasiSteady(robot)
    gait = pt.gaits.sinusoidal(robot, frequency=frequency, plunge=0.3)
    carried = pt.air.AddedMass(robot) if added_mass else None
    return pt.simulate(robot, model, gait, duration=0.1, time_step=1e-3, added_mass=carried)


@pytest.fixture(scope="module")
def robot():
    return pt.load_robot("aerobat")


def learn(flight, robot, tmp_path, network=None):
    network = network or pt.DenseNetwork(robot.state_size, (3,), robot.dof_names)
    result = pt.identify(flight, pt.ExtendedLearner(network), every=10)
    result.save(tmp_path / "predictions.nc")
    return load_identification(tmp_path / "predictions.nc")


@pytest.mark.parametrize("added_mass", [False, True])
def test_predictions_of_another_flight_are_refused(robot, tmp_path, added_mass):
    """Predictions of any other flight with the same sample times were drawn."""
    flight, other = (fly(robot, added_mass, frequency) for frequency in (5.0, 5.1))
    network = pt.learning.LinearStripNetwork(robot) if added_mass else None
    kept = learn(flight, robot, tmp_path, network)
    shown = predict_flight(flight, robot, kept, FRAMES)
    expected = kept.prediction["prediction"].values[FRAMES]
    np.testing.assert_array_equal(shown.generalized, expected)
    with pytest.raises(LogError, match="expected those of this flight, found other measured"):
        predict_flight(other, robot, kept, FRAMES)


def test_predictions_of_another_robot_are_refused(robot, tmp_path):
    """Predictions of unknown coordinates were omitted without a message."""
    kept = learn(fly(robot), robot, tmp_path)
    names = [f"{name}_" for name in robot.dof_names]
    renamed = replace(kept, prediction=kept.prediction.assign_coords(output=names))
    with pytest.raises(LogError, match="expected forces of coordinates of aerobat, found x_, y_"):
        predict_flight(fly(robot), robot, renamed, FRAMES)


@pytest.mark.usefixtures("interpreted")
def test_forces_by_other_numbers_of_the_robot_are_shown(robot, tmp_path):
    """Numbers of the robot that are learned change what the force is: it is not compared."""
    flight = fly(robot)
    believed = robot.with_parameters({"body.mass": 1.2 * robot.bodies[0].mass})
    network = pt.GreyBox(pt.QuasiSteady(believed), {"body.mass": 0.01})
    kept = learn(flight, robot, tmp_path, network)
    assert np.isfinite(predict_flight(flight, robot, kept, FRAMES).generalized).all()


def test_a_page_tells_that_the_wings_are_others(robot, tmp_path, speak):
    """Only `evaluate` warned of other wings; `view` and `export` did not."""
    wider = robot.with_parameters({"left_wing[0].chord": 0.12})
    model = save_model(
        tmp_path / "m.json", pt.ExtendedLearner(pt.learning.LinearStripNetwork(wider))
    )
    flight = pt.save_flight(fly(robot), tmp_path / "f.nc")
    told = "Warning: the wings of aerobat are not those that the model learned."
    for name in ("view", "export"):
        out = tmp_path / {"view": "f.html", "export": "f.mcap"}[name]
        assert told in speak(name, flight, "--model", model, "-o", out).err
    assert told in (tmp_path / "f.html").read_text("utf-8")

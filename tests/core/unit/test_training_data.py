import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.own_learner import OwnLearner

import patagium as pt
from patagium.errors import FlightError, LogError, ParameterError, PatagiumError, ShapeError
from patagium.learning.identify import (
    evaluate,
    identify,
    samples,
)
from patagium.learning.model_file import load_model, model_of, save_model
from patagium.sensing.force.air_force import state_columns, training_data
from patagium.simulation import gait_period


@pytest.fixture(scope="module")
def flight() -> Iterator[xr.Dataset]:
    robot = pt.load_robot("aerobat")
    aero = pt.QuasiSteady(robot, pt.Air())
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5)
    start = robot.coordinates(x=3.0)
    yield pt.simulate(robot, aero, gait, duration=0.25, time_step=1e-3, v=start)


def test_inverse_dynamics_gives_back_the_simulated_force_of_the_air(flight: xr.Dataset) -> None:
    time, x, y = training_data(flight)
    n = flight.sizes["dof"]
    assert x.shape == (len(time), 2 * n) and y.shape == (len(time), n)
    np.testing.assert_array_equal(x[:, :n], flight["q"])
    np.testing.assert_array_equal(x[:, n:], flight["v"])
    scale = np.abs(flight["u1"]).max().item()
    # rounding of forces of the size of the joints'
    np.testing.assert_allclose(y, flight["aero_force"], atol=1e-12 * max(scale, 1.0))


def test_the_force_of_the_mount_is_not_ascribed_to_the_air() -> None:
    robot = pt.load_robot("aerobat")
    aero = pt.QuasiSteady(robot, pt.Air(wind=(-3.0, 0.0, 0.0)))
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5)
    held = pt.simulate(robot, aero, gait, duration=0.05, time_step=1e-3, mount=pt.mounts.fixed())
    assert np.abs(held["mount_force"]).max() > 0.05  # N: there is something to subtract
    _, _, y = training_data(held)
    np.testing.assert_allclose(y, held["aero_force"], atol=1e-12)  # rounding


def test_damping_is_computed_where_the_record_has_none(flight: xr.Dataset) -> None:
    _, _, y = training_data(flight)
    _, _, again = training_data(flight.drop_vars(["damping_force", "mount_force"]))
    np.testing.assert_allclose(again, y, atol=1e-14)  # rounding


def test_another_robot_explains_the_flight_differently(flight: xr.Dataset) -> None:
    robot = pt.load_robot("aerobat")
    heavier = robot.with_parameters({"body.mass": 0.02})
    _, _, y = training_data(flight)
    _, _, other = training_data(flight, heavier)
    extra = (other - y)[:, robot.index("z")]
    expected = 0.01 * (flight["a"][:, robot.index("z")] + robot.gravity)
    np.testing.assert_allclose(extra, expected, atol=1e-10)  # rounding


def test_what_is_missing_is_named(flight: xr.Dataset) -> None:
    with pytest.raises(FlightError, match="expected the quantity `u1`"):
        training_data(flight.drop_vars("u1"))
    with pytest.raises(FlightError, match="expected 14 coordinates of robot 'aerobat', found 13"):
        training_data(flight.isel(dof=slice(13)), pt.load_robot("aerobat"))
    broken = flight.copy(deep=True)
    broken["a"][7, 2] = np.nan
    with pytest.raises(LogError, match="a: expected finite numbers, found 1 .* t = 0.007 s"):
        training_data(broken)


def learner(
    inputs: int, outputs: tuple[str, ...], scale: float | tuple[float, ...] = 10.0
) -> pt.CubatureLearner:
    network = pt.DenseNetwork(inputs, (6,), outputs, input_scale=scale, output_scale=0.2)
    return pt.CubatureLearner(network, prior_std=0.3, measurement_std=2e-3, spread=1.7)


@pytest.mark.parametrize("kind", [complex, str, "datetime64[s]"])
def test_what_is_no_real_number_is_refused(kind: object, flight: xr.Dataset) -> None:
    for name in ("q", "v", "a", "u1"):
        values = flight[name].values.astype(kind)
        with pytest.raises(PatagiumError, match=f"{name}: expected real numbers"):
            pt.identify(flight.assign({name: (flight[name].dims, values)}), every=50)


def test_identify_streams_a_flight_and_evaluate_does_not_teach(flight: xr.Dataset) -> None:
    names = ("q.left_plunge", "v.left_plunge", "v.z", "v.pitch")
    student = learner(4, ("z", "roll"), (0.5, 15.0, 1.0, 0.3))
    result = identify(flight, student, every=5, inputs=names)
    assert list(result.scores["nmse"]) == ["z", "roll"]
    assert result.scores["updates"] == 51
    assert result.scores["silent"] == ["roll"]  # the flight is symmetric
    assert result.scores["nmse_mean"] < 0.3  # predicting the mean scores 1
    assert result.prediction["unit"].values.tolist() == ["N", "N m"]
    before = student.weights
    unseen = evaluate(flight, student, inputs=names)
    np.testing.assert_array_equal(student.weights, before)
    assert unseen.scores["every"] == identify(flight, student, inputs=names).scores["every"]
    assert unseen.scores["updates"] == 0 and unseen.prediction.sizes["update_time"] == 0
    assert unseen.scores["nmse_mean"] < 0.5
    assert unseen.scores["coverage_checks"] > 100


def test_the_whole_state_is_seen_unless_told(flight: xr.Dataset) -> None:
    result = identify(flight, learner(28, ("z",)), every=50)
    assert result.scores["updates"] == 6


@pytest.mark.usefixtures("interpreted")
def test_networks_that_do_not_fit_the_flight_are_refused(flight: xr.Dataset) -> None:
    with pytest.raises(
        ShapeError, match="inputs: expected as many as the network sees, 3, found 28"
    ):
        identify(flight, learner(3, ("z",)))
    with pytest.raises(ShapeError, match="coordinates of robot 'aerobat'"):
        identify(flight, learner(28, ("lift",)))
    other = pt.learning.LinearStripNetwork(pt.load_robot("aerobat").with_attitude("quaternion"))
    with pytest.raises(ShapeError, match="expected quaternion, as the model sees it, found euler"):
        identify(flight, pt.ExtendedLearner(other))
    with pytest.raises(ParameterError, match="q.x to v.right_feather, found 'plunge'"):
        state_columns(pt.load_robot("aerobat"), ["plunge"])


def test_the_wingbeat_is_that_of_the_gait(flight: xr.Dataset) -> None:
    assert gait_period(flight) == pytest.approx(0.2)
    told = flight.copy()
    for gait, beat in (
        ({"kind": "table", "time": [1.0, 1.1, 1.3]}, 0.3),
        ({"kind": "superposed", "parts": [{"frequency": 4.0}, {"frequency": 8.0}]}, 0.25),
    ):
        told.attrs = {"gait": json.dumps(gait)}
        assert gait_period(told) == pytest.approx(beat)
    told.attrs = {"gait": json.dumps({"kind": "fourier", "frequency": 0.0})}
    assert gait_period(told) is None


def test_a_load_cell_is_a_linear_function_of_the_strip_forces(flight: xr.Dataset) -> None:
    robot = pt.load_robot("aerobat")
    balance = np.zeros((2, 3 * len(robot.strips)))
    balance[0, 0::3], balance[1, 2::3] = 1.0, 1.0  # total force forward and up
    network = pt.StripNetwork(robot, (4,), measured=balance)
    _, x, y, _ = samples(flight, network)
    np.testing.assert_allclose(y, flight["strip_force"].sum("strip")[:, [0, 2]], atol=1e-14)
    learner = pt.CubatureLearner(network, prior_std=0.3, measurement_std=1e-3, spread=1.7)
    scores = identify(flight, learner, every=1).scores
    assert list(scores["nmse"]) == ["y0", "y1"]
    assert scores["nmse_second_half"]["y1"] < 0.05  # after one beat, four neurons


@pytest.mark.parametrize("kind", ["extended", "own"])
def test_every_learner_goes_through_the_same_stream(flight: xr.Dataset, kind: str) -> None:
    network = pt.DenseNetwork(28, (6,), ("z",), input_scale=10.0, output_scale=0.2)
    learner = {
        "extended": lambda: pt.ExtendedLearner(network, prior_std=0.3, measurement_std=2e-3),
        "own": lambda: OwnLearner(network),
    }[kind]()
    scores = identify(flight, learner, every=1).scores
    assert scores["outcome"] == "COMPLETED" and scores["updates"] == 251
    assert scores["nmse_second_half_worst"] < 1.0  # predicting the mean scores 1
    assert np.isnan(scores["coverage"]) == (kind == "own")
    assert np.isnan(scores["largest_variance"]) == (kind == "own")
    assert scores["time_per_update"] > 0


def test_a_saved_model_meets_another_flight(flight: xr.Dataset, tmp_path: Path) -> None:
    student = learner(2, ("z",), (15.0, 1.0))
    names = ("v.left_plunge", "v.z")
    identify(flight, student, every=1, inputs=names)
    save_model(tmp_path / "model.json", model_of(student, inputs=names))
    model = load_model(tmp_path / "model.json")
    saved, living = evaluate(flight, model).scores, evaluate(flight, student, inputs=names).scores
    assert saved["nmse"] == living["nmse"]
    assert saved["coverage"] == pytest.approx(living["coverage"], abs=0.2)  # linear, not points


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda one: one.drop_vars("time"), "expected the quantity `time`"),
        (lambda one: one.isel(time=0), "expected samples, found none"),
        (lambda one: one.isel(dof=slice(None, None, -1)), "right_feather.* in place of x, y"),
        (lambda one: one.isel(time=[0, 1, 1, 2]), "expected to advance, found 0.001 s after 0.001"),
        (lambda one: one.isel(time=slice(None, None, -1)), "expected to advance"),
        (lambda one: one.assign_coords(time=one.time.where(one.time < 0.1)), "found nan s after"),
        (lambda one: one.assign_coords(time=one.time.astype("M8[s]")), "array of datetime64"),
    ],
)
def test_times_and_coordinates_that_are_no_flights_are_refused(flight, change, said) -> None:
    with pytest.raises(PatagiumError, match=said):
        training_data(change(flight))


def test_measured_forces_are_cut_whatever_they_were_given_as() -> None:
    """Lists and DataArrays were taken, and `where` then failed by their shapes."""
    robot, time = pt.load_robot("aerobat"), [0.0, 0.1, 0.2]
    motion = xr.DataArray(np.ones((3, robot.dof)))
    spread = np.tile(np.eye(robot.dof), (3, 1, 1)).tolist()
    forces = pt.sensing.ForceSamples(time, motion, motion, motion, spread, robot, "made")
    assert forces.where(slice(1, None)).std.shape == (2, robot.dof)

from pathlib import Path

import numpy as np
import pytest

from patagium.learning import CubatureLearner, ExtendedLearner, identify, network_for
from patagium.learning.models.memory import memory_of, network_inputs, replay
from patagium.sensing import LogTable, read_table
from patagium_lab.measured.crazyflie import (
    crazyflie_mapping,
    crazyflie_sections,
    crazyflie_study,
    in_flight,
)
from patagium_lab.measured.thrust import FIRST_LAG, ThrustNetwork, thrust_network_for

LOG = Path(__file__).parents[3].parent / "shared" / "data" / "crazyflie" / "log16.csv.gz"
pytestmark = pytest.mark.skipif(
    not LOG.is_file(), reason="the quadrotor's log is not beside the repository"
)


@pytest.fixture(scope="module")
def table() -> LogTable:
    return read_table(LOG, crazyflie_mapping())


def test_the_mapping_reads_the_log_in_si_units(table: LogTable) -> None:
    assert table.x.shape == (47182, 7) and table.y.shape == (47182, 1)
    assert table.output_units == ("m/s^2",) and table.input_units[4:] == ("rad/s",) * 3
    standing = table.time < 13.0
    assert table.y[standing].mean() == pytest.approx(9.80665, rel=2e-3)  # the weight
    assert not table.x[standing, :4].any()
    rate = 1.0 / np.median(np.diff(table.time))
    assert rate == pytest.approx(1011.0, rel=2e-3)  # Hz


def test_the_one_gap_is_stated(table: LogTable) -> None:
    assert len(table.gaps) == 1
    assert "1 gap(s)" in table.describe_gaps() and "0.003961 s" in table.describe_gaps()


def test_taking_off_is_learned_and_holding_a_sample_is_the_bar(table: LogTable) -> None:
    start = table.where(slice(14_000, 19_000))
    learner = CubatureLearner(
        network_for(start, (8,)), prior_std=0.5, measurement_std=1.0, spread=1.7
    )
    dense = identify(start, learner, every=1, horizons="1s").scores
    assert dense["outcome"] == "COMPLETED"
    # at 1 kHz nothing beats the last sample
    assert dense["persistence_second_half_worst"] < dense["nmse_second_half_worst"] < 1.0
    assert np.isfinite(dense["forecast_1s_nmse_second_half_worst"])


def test_flights_are_what_lies_between_take_off_and_motors_off(table: LogTable) -> None:
    flights = in_flight(table)
    assert len(flights.gaps) == 1 and 13_000 < len(flights.time) < 15_000
    pause = flights.gaps[0]
    assert flights.time[0] == pytest.approx(14.46, abs=0.01)
    assert flights.time[pause - 1] == pytest.approx(22.46, abs=0.01)
    assert flights.time[pause] == pytest.approx(27.10, abs=0.01)
    assert flights.time[-1] == pytest.approx(32.83, abs=0.01)


def test_the_study_sets_learners_beside_holding_a_sample() -> None:
    study = crazyflie_study(LOG, every=(100,), samples=17_000)
    names = [row["learner"] for row in study.rows]
    assert names[0] == names[8] == "last used sample held" and len(names) == 16
    assert {row["part"] for row in study.rows} == {"whole log", "in flight"}
    assert all(np.isfinite(row["second_half"]) for row in study.rows)
    assert crazyflie_sections(study)[0].blocks


def test_slopes_of_physics_and_network_are_those_of_the_whole_run(table: LogTable) -> None:
    part = table.where(slice(15_000, 15_100))
    network = thrust_network_for(part, (3,))
    draw = np.random.default_rng(0)
    weights = network.initial(0) + 0.2 * draw.standard_normal(network.size)

    def last(at: np.ndarray) -> np.ndarray:
        return network_inputs(network, at, part.time, part.x)[-1]

    seen = network.encode_one(last(weights))
    value, slope = network.linearized(seen, weights)
    steps = 1e-6 * np.eye(network.size)
    ends = [
        [network(last(weights + sign * h), weights + sign * h) for sign in (1, -1)] for h in steps
    ]
    numeric = np.array([(above - below)[0] / 2e-6 for above, below in ends])
    # rounding of differences: 1e-15 of 10 m/s^2, over 2e-6
    np.testing.assert_allclose(slope[0], numeric, atol=1e-7)
    assert slope[0, 0] != 0.0
    np.testing.assert_allclose(network.values(seen, np.stack([weights] * 2))[1], value, rtol=1e-13)
    again = ThrustNetwork.from_description(network.describe())
    np.testing.assert_allclose(again(last(weights), weights), value, rtol=1e-13)  # rounding


def test_memory_goes_on_from_block_to_block_and_moves_with_the_weights(table: LogTable) -> None:
    part = table.where(slice(15_000, 15_040))
    network = thrust_network_for(part, (3,))
    weights = network.initial(0)
    whole = network_inputs(network, weights, part.time, part.x)
    memory, other = memory_of(network), memory_of(network)
    first = memory.recall(weights, part.time[:20], part.x[:20])
    before = memory.last
    rest = memory.recall(weights, part.time[20:], part.x[20:])
    np.testing.assert_array_equal(np.vstack([first, rest]), whole)
    change = np.zeros(network.size)
    change[0] = 1e-4
    memory.last = before
    memory.corrected(change)
    other.recall(weights + change, part.time[:20], part.x[:20])
    moved, anew = memory.last, other.last
    np.testing.assert_allclose(moved.state, anew.state, rtol=1e-8)  # second order in the change
    assert (moved.state != before.state).any()


def test_a_rotors_lag_is_found(table: LogTable) -> None:
    flight = in_flight(table).where(slice(0, 4000))
    network = thrust_network_for(flight, (2,))
    truth = network.initial(0)
    truth[0] = np.log(0.02 / FIRST_LAG)  # rotors of 20 ms
    recalled = network_inputs(network, truth, flight.time, flight.x, flight.gaps)
    y = network.evaluate(recalled, truth) + 0.1 * np.random.default_rng(0).standard_normal(
        (4000, 1)
    )
    learner = ExtendedLearner(network, prior_std=0.5, measurement_std=0.1)
    memory = replay(network, flight.time, flight.x, flight.gaps)
    for k in range(4000):
        before = learner.weights
        learner.update(memory.upto(k + 1, before)[-1], y[k])
        memory.corrected(learner.weights - before)
    # the residual network may take up part: within three deviations as the filter states them
    std = np.sqrt(learner.variances[0])
    assert abs(learner.weights[0] - truth[0]) < 3 * std < 0.6

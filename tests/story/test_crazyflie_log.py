from pathlib import Path

import numpy as np
import pytest

from patagium.identification import (
    CubatureLearner,
    Table,
    identify_table,
    network_for,
    read_table,
)
from patagium.studies.crazyflie import (
    crazyflie_mapping,
    crazyflie_sections,
    crazyflie_study,
    in_flight,
)

LOG = Path(__file__).parents[2].parent / "shared" / "data" / "crazyflie" / "log16.csv.gz"
pytestmark = pytest.mark.skipif(
    not LOG.is_file(), reason="the quadrotor's log is not beside the repository"
)


@pytest.fixture(scope="module")
def table() -> Table:
    return read_table(LOG, crazyflie_mapping())


def test_the_mapping_reads_the_log_in_si_units(table: Table) -> None:
    assert table.x.shape == (47182, 7) and table.y.shape == (47182, 1)
    assert table.output_units == ("m/s^2",) and table.input_units[4:] == ("rad/s",) * 3
    standing = table.time < 13.0
    assert table.y[standing].mean() == pytest.approx(9.80665, rel=2e-3)  # the weight
    assert not table.x[standing, :4].any()
    rate = 1.0 / np.median(np.diff(table.time))
    assert rate == pytest.approx(1011.0, rel=2e-3)  # Hz


def test_the_one_gap_is_stated(table: Table) -> None:
    assert len(table.gaps) == 1
    assert "1 gap(s)" in table.describe_gaps() and "0.003961 s" in table.describe_gaps()


def test_taking_off_is_learned_and_holding_a_sample_is_the_bar(table: Table) -> None:
    start = table.where(slice(14_000, 19_000))
    learner = CubatureLearner(
        network_for(start, (8,)), prior_deviation=0.5, measurement_deviation=1.0, spread=1.7
    )
    dense = identify_table(start, learner, every=1, horizons={"1s": 1.0}).scores
    assert dense["outcome"] == "COMPLETED"
    # at 1 kHz nothing beats the last sample; a second ahead nothing is worse
    assert dense["persistence_second_half_worst"] < dense["nmse_second_half_worst"] < 1.0
    ahead = dense["horizon_1s_nmse_second_half_worst"]
    assert ahead < dense["horizon_1s_persistence_second_half_worst"]


def test_flights_are_what_lies_between_take_off_and_motors_off(table: Table) -> None:
    flights = in_flight(table)
    assert len(flights.gaps) == 1 and 13_000 < len(flights.time) < 15_000
    pause = flights.gaps[0]
    assert flights.time[0] == pytest.approx(14.46, abs=0.01)
    assert flights.time[pause - 1] == pytest.approx(22.46, abs=0.01)
    assert flights.time[pause] == pytest.approx(27.10, abs=0.01)
    assert flights.time[-1] == pytest.approx(32.83, abs=0.01)


def test_the_study_sets_learners_beside_holding_a_sample() -> None:
    study = crazyflie_study(LOG, every=(20,), samples=17_000)
    names = [row["learner"] for row in study.rows]
    assert names[0] == names[4] == "last used sample held" and len(names) == 8
    assert {row["part"] for row in study.rows} == {"whole log", "in flight"}
    assert all(np.isfinite(row["second_half"]) for row in study.rows)
    assert crazyflie_sections(study)[0].blocks

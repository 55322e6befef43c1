from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from tests.tables import table_of

import patagium as pt
from patagium.errors import LogError
from patagium.learning.default_learner import default_learner, table_every, table_share
from patagium.learning.identify import evaluate, identify
from patagium.learning.model_file import model_of
from patagium.learning.page import summary
from patagium.learning.settings import FilterSettings
from patagium.learning.table_network import network_for, scaling_samples
from patagium.sensing.logs.table import LogTable

WORDS: dict[str, Any] = {
    "time": {"column": "t", "unit": "ms"},
    "inputs": [
        {"column": "command", "unit": "1", "range": [0, 1000]},
        {"column": "rate", "unit": "deg/s", "range": [-180, 180]},
    ],
    "outputs": [{"column": "force", "unit": "N", "name": "lift", "range": [0, 4]}],
}


def log(count: int = 400, seed: int = 0, words: dict[str, Any] = WORDS) -> LogTable:
    rng = np.random.default_rng(seed)
    command, rate = rng.uniform(0, 1000, count), rng.uniform(-180, 180, count)
    force = 1e-3 * command + 0.01 * rate + 1.0 + 0.01 * rng.normal(size=count)
    stamps = np.arange(count) * 2.0
    stamps[count // 2 :] += 50.0
    frame = pd.DataFrame({"t": stamps, "command": command, "rate": rate, "force": force})
    return table_of(frame, words)


def learner(table: LogTable) -> pt.CubatureLearner:
    return pt.CubatureLearner(
        network_for(table, (4,)), prior_std=0.5, measurement_std=0.02, spread=0.5
    )


def test_a_network_is_scaled_by_the_stated_ranges_alone() -> None:
    network = network_for(log(), (4,))
    np.testing.assert_allclose(network.input_center, [500.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(network.input_scale, [500.0, np.pi], rtol=1e-12)
    assert network.output_center.tolist() == [2.0] and network.output_scale.tolist() == [2.0]
    assert network.output_names == ("lift",)
    assert network_for(log(seed=1), (4,)).describe() == network.describe()


UNRANGED = {**WORDS, "outputs": [{"column": "force", "unit": "N", "name": "lift"}]}


def test_a_short_log_with_a_column_without_a_range_is_refused_with_the_remedy() -> None:
    with pytest.raises(LogError, match=r"first 1 s .* lift, found 400 .* state a range"):
        network_for(log(words=UNRANGED), (4,))


def test_a_column_without_a_range_is_scaled_by_samples_that_are_not_predicted() -> None:
    """The first second is 475 samples of 2 ms before the gap of 50 ms, in the order of the log."""
    table = log(900, words=UNRANGED)
    network = network_for(table, (4,))
    first = table.y[: scaling_samples(table)]
    assert scaling_samples(table) == 475 and scaling_samples(log()) == 0
    np.testing.assert_allclose(network.output_scale, (first.max() - first.min()) / 2)
    later = log(900, words=UNRANGED)
    later.y[475:] *= 3.0  # nothing looks ahead
    assert network_for(later, (4,)).describe() == network.describe()
    scores = identify(table, every=1).scores
    assert scores["samples_that_scaled"] == 475
    assert scores["samples"] == 900 and scores["samples_predicted"] == 425
    assert scores["nmse_second_half"]["lift"] < 0.05


def test_a_column_far_beyond_what_scales_it_is_told() -> None:
    """A fan that stands still in the first second left its input unscaled, without a warning."""
    rng, time = np.random.default_rng(6), np.arange(0.0, 10.0, 0.01)
    fan = np.where(time < 2.0, 0.0, 600.0) + (time >= 2.0) * rng.normal(0.0, 5.0, 1000)
    angle = 0.5 * np.sin(6 * np.pi * time)
    frame = pd.DataFrame({"t": 1e3 * time, "fan": fan, "a": angle, "lift": fan * (1 + angle)})
    for stated in ({}, {"range": [0, 1000]}):
        inputs = [{"column": "fan", "unit": "1", **stated}, {"column": "a", "unit": "1"}]
        output = {"column": "lift", "unit": "N", "range": [0, 1500]}
        scores = identify(table_of(frame, {**WORDS, "inputs": inputs, "outputs": [output]})).scores
        told = "; ".join(scores["verdict"])
        assert ("fan goes to 6" in told and "first 100 samples scale it by 0 +- 1" in told) != (
            "range" in stated
        )
        assert "every sample used after the first 100, which scale the network" in summary(scores)


def test_a_table_that_is_learned_well_and_modeled_badly_is_told_with_its_remedy() -> None:
    """A model with an NMSE of .017, ten times that of a held sample, caused no warning."""
    time = np.arange(0.0, 30.0, 0.01)
    x = np.sin(3 * time + 1)
    y = 2 * x**3 + 0.005 * np.random.default_rng(1).normal(size=time.size)
    frame = pd.DataFrame({"t": 1e3 * time, "x": x, "y": y})
    words = {
        "inputs": [{"column": "x", "unit": "1", "range": [-1, 1]}],
        "outputs": [{"column": "y", "unit": "N", "range": [-2, 2]}],
    }
    table, frozen = table_of(frame, {**WORDS, **words}), []
    settings = FilterSettings(noise_estimation=pt.learning.NoiseEstimation(memory=1000))
    for one in (None, pt.ExtendedLearner(network_for(table, (8, 8)), settings)):
        scores = identify(table, one).scores
        told = any("`--prior-share 0 --noise-memory 1000`" in text for text in scores["verdict"])
        frozen.append(scores["frozen_second_half"]["y"])
        assert told == (one is None) == (frozen[-1] > scores["persistence_second_half"]["y"])
    assert frozen[1] < 0.02 * frozen[0]


def test_a_learner_with_scales_of_its_own_loses_no_sample_of_a_table() -> None:
    """The first second of each table was left out, and shorter tables were refused."""
    table = log(900, words=UNRANGED)
    stated = pt.ExtendedLearner(network_for(log(), (4,)))
    for k, rows in enumerate((slice(0, 400), slice(450, 850))):
        parts = {name: getattr(table, name)[rows] for name in ("time", "x", "y")}
        part = replace(table, **parts, gaps=np.zeros(0, np.int64))
        found = identify(part, stated, every=1)
        assert found.scores["samples_that_scaled"] == 0
        assert found.scores["samples_predicted"] == 400 and stated.count == 400 * (k + 1)
    scaled = pt.ExtendedLearner(network_for(table, (4,)))
    assert identify(table, scaled, every=1).scores["samples_that_scaled"] == 475
    rest = identify(replace(table, y=2 * table.y), scaled, every=1)
    assert rest.scores["samples_predicted"] == 900


def test_a_table_that_begins_at_rest_is_scaled_by_its_first_second_of_motion() -> None:
    """The rest scaled the network: .026 of the variance, and a hundred samples refused."""
    rng, time = np.random.default_rng(3), np.arange(0.0, 20.0, 0.01)
    angle = (time > 5.0) * (0.5 + 0.3 * np.sin(0.3 * time)) * np.sin(6 * np.pi * time)
    rate, wind = np.gradient(angle, time), 5.0 + 1e-3 * rng.normal(size=2000)
    lift = 0.02 * wind**2 * np.sin(angle) + 1e-3 * rate * wind + 2e-3 * rng.normal(size=2000)
    frame = pd.DataFrame(
        {"t": 1e3 * time, "angle": angle, "rate": rate, "wind": wind, "lift": lift}
    )
    inputs = [{"column": one, "unit": "1"} for one in ("angle", "rate", "wind")]
    words = {**WORDS, "inputs": inputs, "outputs": [{"column": "lift", "unit": "N"}]}
    table = table_of(frame, words)
    scores = identify(table).scores
    assert scores["samples_that_scaled"] == pytest.approx(601, abs=10)
    assert scores["nmse_second_half_worst"] < 2e-3
    assert not any("taught nothing" in one for one in scores["verdict"])


def test_a_table_is_learned_without_any_setting() -> None:
    scores = identify(log(3000)).scores
    # noise is 3e-4 of the variance; at 500 Hz a learner that forgets uses each sample
    assert scores["nmse_second_half"]["lift"] < 0.01 and scores["every"] == 1
    assert scores["chosen"]["network"].startswith("dense, 8,8")
    assert scores["chosen"]["memory"].startswith("100 s")


def test_a_machine_that_changes_is_followed_without_any_setting() -> None:
    """The gain falls as a battery does, and the offset wanders; commands are smooth."""
    rng, table = np.random.default_rng(1), log(6000)
    command = 500.0 + 400.0 * np.sin(3.0 * table.time)
    offset = np.cumsum(rng.normal(0.0, 3e-3, len(command)))
    force = 3e-3 * command * (1.0 - 0.05 * table.time) + offset
    drifting = replace(table, x=np.column_stack([command, 0 * command]), y=force[:, None])
    scores = identify(drifting).scores
    assert scores["nmse_second_half_worst"] < scores["persistence_second_half_worst"]
    assert 0.88 < scores["coverage_second_half"] <= 1.0
    believing = pt.ExtendedLearner(network_for(drifting, (8, 8)))
    sure = identify(drifting, believing, every=1).scores  # it takes all for one truth
    assert scores["nmse_second_half_worst"] < 0.3 * sure["nmse_second_half_worst"]


def test_the_memory_of_a_table_goes_by_time_and_yields_to_what_is_set() -> None:
    table = log()
    network = network_for(table, (8, 8))
    assert table_share(table, network) == pytest.approx(2e-3 / 100)
    assert table_share(table, network, 10) == pytest.approx(2e-2 / 100)
    assert table_share(table, network, 10000) == 1e-3  # a thousand updates at least
    assert default_learner(table, every=10).settings.prior_share == pytest.approx(2e-4)  # type: ignore[attr-defined]
    stated = default_learner(table, settings=FilterSettings(measurement_std=0.1))
    assert stated.settings.prior_share == 0.0  # type: ignore[attr-defined]
    large = network_for(table, (60, 60))
    assert table_every(pt.ExtendedLearner(large, prior_share=1e-5), 1e-3) > 10
    assert table_every(pt.ExtendedLearner(network), 1e-3) == 10  # one that does not forget


def test_a_table_is_learned_and_its_gap_is_stated() -> None:
    table = log()
    result = identify(table, learner(table), every=2, horizons={"10ms": 0.01})
    assert result.scores["gaps"] == 1 and "1 gap(s)" in result.scores["gaps_found"]
    assert result.scores["nmse_second_half"]["lift"] < 0.05
    assert result.prediction["unit"].values.tolist() == ["N"]
    assert table.time[200] - table.time[199] == pytest.approx(0.052)  # s, not bridged
    assert np.isin(table.time[200], result.prediction["update_time"])


def test_a_learned_model_is_held_against_another_log() -> None:
    table, unseen = log(), log(seed=1)
    student = learner(table)
    identify(table, student, every=1)
    model = model_of(student, inputs=table.input_names)
    result = evaluate(unseen, model, every=10)
    assert result.scores["nmse_worst"] < 0.01 and result.scores["updates"] == 0
    assert result.scores["persistence_worst"] > 1.0 and result.scores["gaps"] == 1
    assert 0.8 < result.scores["coverage"] <= 1.0


def test_a_model_of_other_columns_is_refused() -> None:
    table = log()
    model = model_of(learner(table), inputs=("rate", "command"))
    with pytest.raises(LogError, match="expected the inputs rate, command, found command, rate"):
        evaluate(table, model)
    words = {**WORDS, "outputs": [{**WORDS["outputs"][0], "name": "drag"}]}
    with pytest.raises(LogError, match="expected the outputs lift, found drag"):
        evaluate(log(words=words), learner(table))

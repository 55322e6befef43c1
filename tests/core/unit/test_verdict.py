"""Verdict on the scores of an identification in words."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import patagium as pt
from patagium.learning import ExtendedLearner, LinearStripNetwork, Misfit, Screening
from patagium.learning.identify import _noise_words, compare
from patagium.learning.model_file import Model, load_model, model_of, save_model
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.page import summary
from patagium.learning.stream import stream
from patagium.learning.verdict import _frozen_words, with_verdict


def said(std: float) -> dict[str, Any]:
    """Scores of a learner whose errors have the deviation one, and that states another."""
    learner = ExtendedLearner(DenseNetwork(1, (), ("y",)), prior_std=1e-9, measurement_std=std)
    half = np.random.default_rng(7).standard_normal((200, 1))
    errors, x = np.tile(half / np.sqrt(np.mean(half**2)), (2, 1)), np.zeros((400, 1))
    y = learner.network.evaluate(x, learner.weights) + errors
    return compare(learner, 0.01 * np.arange(400), x, y).scores


def test_words_for_intervals() -> None:
    """The share inside of 200 errors says how narrow to 15 %."""
    right, narrow, wide = (said(std) for std in (1.0, 0.2, 8.0))
    for std, scores in ((1.0, right), (0.2, narrow), (8.0, wide)):
        np.testing.assert_allclose(scores["nis_second_half"], 1 / std**2, rtol=1e-9)  # rounding
        assert any("NIS" in text for text in scores["verdict"]) == (std != 1.0)
    assert right["verdict"][0].startswith("Intervals about right (9")
    assert wide["verdict"][0].startswith("Intervals 8 times too wide (100 %")
    times = re.match("Intervals (.*) times too narrow", narrow["verdict"][0])
    assert times is not None
    assert float(times[1]) == pytest.approx(5.0, rel=0.15)


@pytest.mark.parametrize(("samples", "every"), [(2, 10), (50, 1), (150, 10)])
def test_logs_too_short_to_judge(samples: int, every: int, rng: np.random.Generator) -> None:
    """One update of a flight was called learned, with an error of nan and too wide intervals."""
    learner = ExtendedLearner(DenseNetwork(1, (), ("y",)), measurement_std=8.0)
    x, y = rng.standard_normal((2, samples, 1))
    scores = stream(learner, 0.001 * np.arange(samples), x, y, every=every).scores
    (told,) = scores["verdict"]
    assert f"too short to judge errors and intervals: {samples} samples" in told
    assert f"{-(-samples // every)} updates" in told and "nan" not in summary(scores)
    frozen = compare(learner, 0.001 * np.arange(samples), x, y).scores["verdict"]
    assert ("too short" in str(frozen)) == (samples < 60)


def test_wrong_intervals_of_one_output_are_told(rng: np.random.Generator) -> None:
    """A mean over outputs of .9 hid that one of them had intervals five times too wide."""
    network, std = DenseNetwork(1, (), ("a", "b")), np.array([0.75, 5.0])
    learner = ExtendedLearner(network, prior_std=1e-9, measurement_std=std)
    x = np.zeros((400, 1))
    y = network.evaluate(x, learner.weights) + rng.standard_normal((400, 2))
    told = compare(learner, 0.01 * np.arange(400), x, y).scores["verdict"]
    assert any(re.search(r"\(NIS\): 0\.0\d+ times of b\.", text) for text in told)  # 1/25


def test_intervals_of_frozen_weights_hold_the_noise_of_each_sample() -> None:
    """Noise of deviation 5 that comes with the samples, over a model's own of 1."""
    learner = ExtendedLearner(DenseNetwork(1, (), ("y",)), prior_std=1e-9, measurement_std=1.0)
    time, x = 0.01 * np.arange(400), np.zeros((400, 1))
    y = 26**0.5 * np.random.default_rng(5).standard_normal((400, 1))
    y += learner.network.evaluate(x, learner.weights)
    for one in (learner, model_of(learner)):
        scores = compare(one, time, x, y, std=np.full((400, 1), 5.0)).scores
        assert scores["nis_second_half"] == pytest.approx(1.0, abs=0.3)  # of 200 samples


def test_noise_of_samples_is_no_flow_that_was_not_learned() -> None:
    """A saved model with `misfit` counted the noise of each sample twice, and took it for flow."""
    learner = ExtendedLearner(DenseNetwork(2, (), ("y",)), misfit=Misfit(), prior_std=3.0)
    draw = np.random.default_rng(2)
    time, x = 0.01 * np.arange(400), draw.uniform(-1, 1, (400, 2))
    y, std = x @ np.array([[1.0], [-0.5]]) + draw.normal(0, 0.1, (400, 1)), np.full((400, 1), 0.1)
    stream(learner, time, x, y, every=1, std=std)
    own, saved = (compare(one, time, x, y, std=std).scores for one in (learner, model_of(learner)))
    assert saved["unseen_share"] == own["unseen_share"] < 0.05
    assert saved["nis_second_half"] == pytest.approx(own["nis_second_half"], rel=1e-6)  # rounding


def test_a_few_wild_samples_are_told_with_their_remedy() -> None:
    """Spikes in 2 % of the samples left intervals "about right", and nothing named screening."""
    draw = np.random.default_rng(3)
    time, x, y = walk(2000)
    y = y + 0.1 * draw.standard_normal(y.shape)
    spiked = y + 1.5 * (draw.random(y.shape) < 0.02) * draw.choice([-1, 1], y.shape)
    told = []
    for log, screening in ((y, None), (spiked, None), (spiked, Screening(outlier_std=5.0))):
        network = DenseNetwork(2, (), ("y",))
        learner = ExtendedLearner(network, measurement_std=0.1, screening=screening)
        words = stream(learner, time, x, log, every=1).scores["verdict"]
        told.append((words[0], any("--outlier-std" in text for text in words)))
    assert ["but for a few errors" in first for first, _ in told] == [False, True, True]
    assert [remedy for _, remedy in told] == [False, True, False]
    assert all(first.startswith("Intervals about right") for first, _ in told)


def test_wrong_intervals_of_tiny_errors_are_a_note() -> None:
    """Below a thousandth of an output's deviation: half of that squared, and twice."""
    scores = said(0.2)
    for nmse, word in ((5e-7, "Note: "), (2e-6, "Warning: ")):
        found = with_verdict({**scores, "nmse_second_half": {"y": nmse}})["verdict"]
        assert [text for text in found if "NIS" in text][0].startswith(word)


def test_warning_of_flow_that_was_not_learned(tmp_path: Path) -> None:
    """Learner and model file alike, and only where inputs are beyond those learned."""
    network = DenseNetwork(2, (), ("y",))
    learner = ExtendedLearner(network, misfit=Misfit(), prior_std=3.0)
    draw = np.random.default_rng(2)
    time, x = 0.01 * np.arange(400), draw.uniform(-1, 1, (400, 2))
    y = x @ np.array([[1.0], [-0.5]]) + 0.1 * draw.standard_normal((400, 1))
    result = stream(learner, time, x, y, every=1)
    assert result.scores["verdict"]
    model = load_model(save_model(tmp_path / "model.json", learner))
    for one in (learner, model):
        near, far = (compare(one, time, size * x, size * y).scores for size in (1.0, 30.0))
        assert near["unseen_share"] < 0.05
        assert far["unseen_share"] > 0.8
        assert not any("not learned" in text for text in near["verdict"])
        assert any("not learned" in text for text in far["verdict"])


def test_flow_of_a_whole_log_was_learned_by_a_filter_that_forgets() -> None:
    """A model said of a third of its own training log that its flow was not learned."""
    time = 0.01 * np.arange(2000)
    x = np.sin(2 * np.pi * np.outer(time, [2.3, 3.1, 0.37]))
    y = x @ np.array([[1.0], [-0.5], [0.3]])
    y += 0.02 * np.random.default_rng(0).standard_normal(y.shape)
    network = DenseNetwork(3, (8, 8), ("y",))
    learner = ExtendedLearner(network, misfit=Misfit(floor=0.005), prior_share=1e-3)
    stream(learner, time, x, y, every=1)
    late = learner.state()
    for one in (learner, model_of(learner)):
        near, far = (compare(one, time, size * x, y).scores for size in (1.0, 5.0))
        assert near["unseen_share"] < 0.05 < 0.5 < far["unseen_share"]
        assert 0.1 < near["nis_second_half"] < 3.0 and near["coverage"] < 0.999
    (name,) = (name for name in late if name.endswith("usual"))
    assert np.array_equal(late[name], learner.state()[name])  # it goes on as it would have
    learner.update(x[-1], y[-1], 20.0)
    np.testing.assert_array_equal(learner.usual_std, np.sqrt(learner.state()[name]))  # late again


def test_warning_of_errors_above_physics_alone_and_held_samples() -> None:
    """Truth is physics alone; the model's weights are others."""
    robot = pt.load_robot("aerobat")
    network = LinearStripNetwork(robot)
    draw = np.random.default_rng(1)
    still = np.r_[robot.coordinates(), np.zeros(2 * robot.dof)]
    x = still + 0.2 * draw.standard_normal((60, network.inputs))
    y = network.evaluate(x, network.initial(0))
    right, close, wrong = (
        compare(Model(network, scale * network.initial(0)), np.arange(60.0), x, y, every=1)
        for scale in (1.0, 1.0 + 1e-9, 5.0)
    )
    for one in (right, close):  # rounding is no error
        assert not any("physics alone" in text for text in one.scores["verdict"])
    assert any("physics alone" in text for text in wrong.scores["verdict"])
    assert any("held" in text for text in wrong.scores["verdict"])


def walk(count: int = 300) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Samples of a smooth path in two inputs, which ends far from where it began."""
    time = 0.01 * np.arange(count)
    x = np.column_stack([np.sin(2 * time), time])
    return time, x, x @ np.array([[1.0], [-0.5]])


def test_another_log_is_learned_wherever_and_whenever_it_begins() -> None:
    """Its first sample is back at the place and at the time of the beginning."""
    learner, log = ExtendedLearner(DenseNetwork(2, (), ("y",)), measurement_std=0.01), walk()
    for count in (300, 600):
        scores = stream(learner, *log, every=1).scores
        assert learner.count == count and scores["events"] == {}
        assert scores["updates"] == scores["updates_learned"] == 300


def test_warning_of_samples_that_taught_nothing() -> None:
    """An input that jumps for 30 samples of 300, or that no sensor measures; one missing output."""
    time, x, y = walk()
    few, jumped = y.copy(), x.copy()
    few[200], jumped[200:230, 1] = np.nan, 30.0
    for inputs, outputs, refused in ((x, few, 1), (1e12 * (x + 1), y, 300), (jumped, y, 30)):
        learner = ExtendedLearner(DenseNetwork(2, (), ("y",)), measurement_std=0.01)
        scores = stream(learner, time, inputs, outputs, every=1).scores
        assert scores["updates_learned"] == learner.count == 300 - refused
        told = [text for text in scores["verdict"] if "taught nothing" in text]
        assert len(told) == (refused > 3)
    assert "30 of the 300 samples" in told[0] and "bad_inputs 30" in told[0]


def test_warning_of_weights_that_follow_a_log_and_are_no_model_of_it() -> None:
    """A constant input: the weights follow a slow wave, and know one moment of it in the end."""
    time = 0.01 * np.arange(800)
    wave = np.sin(4 * time)[:, None]
    for x, follows in ((np.ones((800, 1)), True), (wave, False)):
        learner = ExtendedLearner(DenseNetwork(1, (), ("y",)), forgetting_factor=0.8)
        scores = stream(learner, time, x, wave, every=1).scores
        guess = learner.network.evaluate(x, learner.weights)[400:]
        own = ((guess - wave[400:]) ** 2).mean() / wave[400:].var()
        assert scores["frozen_second_half"]["y"] == pytest.approx(own, rel=1e-9, abs=1e-20)
        told = [text for text in scores["verdict"] if "no model of it" in text]
        assert bool(told) == follows == (scores["nmse_second_half"]["y"] < 1 < own)


def scored(**errors: list[float]) -> dict[str, Any]:
    """Scores of outputs x, z and roll by kind, of the second half."""
    return {
        f"{k}_second_half": dict(zip(["x", "z", "roll"], v, strict=True)) for k, v in errors.items()
    }


def test_weights_that_are_lost_are_told_before_an_output_of_noise() -> None:
    """The NMSE of noise is one, so that roll hid an x of .44, 52 times the error while learning."""
    rivals = {"physics": [0.14, 0.1, 1.0], "persistence": [0.02, 0.03, 2.0]}
    frozen, nmse = [0.44, 2e-4, 1.3], [0.0085, 2e-4, 0.99]
    (told,) = _frozen_words(scored(nmse=nmse, frozen=frozen, **rivals))
    assert "NMSE would be 0.44 for x, 1.3 for roll:" in told


def test_errors_of_noise_are_no_worse_by_chance() -> None:
    """A right model was "no model", as the NMSE of roll, which is noise, went from .99998 to 1."""
    rivals = {"physics": [0.14, 0.1, 1.0], "persistence": [0.02, 0.03, 2.0]}
    for error, warned in ((1.0006, False), (1.6, True)):  # with 1.0, by the margin of 1.2
        right = {**said(1.0), **scored(nmse=[1e-4, 2e-6, 0.99998], frozen=[1e-4, 2e-6, error])}
        assert bool(_frozen_words(right | scored(**rivals))) == warned
        late = right | scored(nmse=[1e-4, 2e-6, error], **rivals)
        told = [text for text in with_verdict(late)["verdict"] if "physics alone" in text]
        assert bool(told) == warned
        assert all("error of roll is" in text for text in told)


def test_an_output_whose_interval_is_too_narrow_is_told() -> None:
    """One of three outputs states .6 of its deviation; the mean of all is about right."""
    network, std = DenseNetwork(1, (), ("a", "b", "c")), np.array([0.4, 2.0, 2.0])
    learner = ExtendedLearner(network, prior_std=1e-9, measurement_std=std)
    x, errors = np.zeros((400, 1)), np.random.default_rng(3).standard_normal((400, 3))
    y = network.evaluate(x, learner.weights) + errors * [0.4 / 0.6, 1.9, 1.9]
    scores = compare(learner, 0.01 * np.arange(400), x, y).scores
    share = 100 * scores["coverage_second_half_by_output"]["a"]
    assert scores["coverage_second_half"] > 0.88
    assert scores["verdict"][0].startswith("Intervals about right in the mean (")
    assert scores["verdict"][0].endswith(f", but too narrow for a ({share:.0f} %).")


@pytest.mark.parametrize(("last", "warned"), [(0.85, True), (0.15, False), (0.07, False)])
def test_last_weights_that_are_worse_than_physics_alone_are_told(last: float, warned: bool) -> None:
    """Last weights that lost the lift gave no warning, since a network with physics never did."""
    names = ("frozen", "persistence", "physics", "nmse")
    errors = zip(names, (last, 1.0, 0.08, 0.02), strict=True)
    scores = {f"{name}_second_half": {"z": error} for name, error in errors}
    assert bool(_frozen_words(scores)) == warned


def test_errors_far_beyond_the_noise_of_measured_forces_are_told(rng: np.random.Generator) -> None:
    y = rng.normal(size=(200, 3)) * [1.0, 1.0, 1e-3]
    std = np.full((200, 3), 1e-2)
    notes = _noise_words(std, y, {"nmse_second_half": {"a": 1e-4, "b": 0.09, "c": 1.0}})
    assert len(notes) == 2
    assert "force of c is smaller than its noise" in notes[0]
    assert "errors of b are up to" in notes[1] and "times the noise" in notes[1]
    std[::4] *= 30.0  # errors of the size of such noise were called no noise
    nmse = dict(zip("abc", (std[:, :1] ** 2).mean(axis=0) / y.var(axis=0), strict=True))
    assert not any(
        "times the noise" in one for one in _noise_words(std, y, {"nmse_second_half": nmse})
    )

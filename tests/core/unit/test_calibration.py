"""Innovations of a filter that is right, too sure, not sure enough, and late."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.learning import stream
from patagium.learning.scores import NOMINAL, InnovationSums, IntervalSums


def reliability(error, std):
    sums = IntervalSums(2)
    sums.add(error, std)
    return sums.reliability()


def calibration_scores(innovation, std, nis, names):
    sums, heard = InnovationSums(len(names)), np.ones(len(names), bool)
    sums.add(innovation, std, nis, heard)
    return sums.scores(names, heard)


def test_gaussian_errors_are_on_the_diagonal(rng):
    std = rng.uniform(0.1, 10, (20_000, 2))
    error = std * rng.normal(size=std.shape)
    error[::7, 0] = np.nan
    # 40,000 draws: three deviations of a share are below 0.0075
    np.testing.assert_allclose(reliability(error, std), NOMINAL, atol=0.0075)
    assert (reliability(error, 2 * std) > NOMINAL).all()
    assert np.isnan(reliability(np.zeros((0, 2)), np.zeros((0, 2)))).all()


@pytest.mark.parametrize("sureness", [0.5, 1.0, 2.0])
def test_normalized_innovations_say_how_sure_it_is(sureness, rng):
    innovation = sureness * rng.normal(size=(5000, 3))
    innovation[::5, 1] = np.nan
    std = np.ones_like(innovation)
    scores = calibration_scores(innovation, std, np.nansum(innovation**2, axis=1), "abc")
    assert scores["nis_per_channel"] == pytest.approx(sureness**2, rel=0.05)  # 14,000 draws
    assert (abs(scores["nis_inside"] - 0.95) < 0.01) == (sureness == 1.0)
    assert max(abs(value) for value in scores["innovation_correlation"].values()) < 0.05


def test_innovations_that_could_be_foreseen_are_colored(rng):
    noise = rng.normal(size=(5001, 1))
    innovation = noise[1:] + noise[:-1]  # correlation 1/2
    scores = calibration_scores(innovation, np.ones_like(innovation), innovation[:, 0] ** 2, "a")
    assert scores["innovation_correlation"]["a"] == pytest.approx(0.5, abs=0.05)


def test_a_learner_that_finds_its_noise_is_calibrated(rng, tmp_path):
    network = pt.DenseNetwork(2, (), 2)
    x = rng.normal(size=(3000, 2))
    y = network.evaluate(x, network.initial(4)) + [0.3, 0.03] * rng.normal(size=(3000, 2))
    time, told = np.arange(3000) * 1e-3, {"prior_std": 1.0, "measurement_std": 1.0}
    sure, found = (
        stream(pt.CubatureLearner(network, noise_estimation=noise, **told), time, x, y, every=1)
        for noise in (None, pt.learning.NoiseEstimation(300))
    )
    assert sure.scores["coverage"] > 0.99  # told too much
    assert 0.93 < found.scores["coverage_second_half"] < 0.97
    late = found.prediction["nis"].values[1500:] / 2
    assert late.mean() == pytest.approx(1.0, abs=0.1)  # 3000 draws: three deviations are 0.08
    found.report(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert (
        "Reliability" in page
        and "(NIS), all outputs together, at the" in page
        and "updates of the whole run" in page
    )


def test_what_happened_to_samples_is_in_scores_and_page(rng, tmp_path):
    network = pt.DenseNetwork(2, (3,), 2)
    x, y = rng.normal(size=(300, 2)), rng.normal(size=(300, 2))
    y[50:60, 1] = np.nan
    y[100] = 1e4
    learner = pt.CubatureLearner(
        network, prior_std=0.5, measurement_std=1.0, screening=pt.learning.Screening()
    )
    result = stream(learner, np.arange(300) * 1e-3, x, y, every=1)
    # what no sensor can say is refused ahead of the filter and counts as missing
    events = {"missing": 12, "blind": 1, "out_of_range": 2}
    assert result.scores["events"] == events
    assert np.isfinite(result.scores["nmse_mean"])
    assert np.isfinite(result.scores["persistence_mean"])
    result.report(tmp_path / "page.html")
    assert "missing 12" in (tmp_path / "page.html").read_text()

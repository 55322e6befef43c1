"""Lags of the air found in noisy flights, as sure as they are said to be: a short version."""

import numpy as np

from patagium_lab.lag_recovery import PRIORS, RecoveryPlan, recover, recovery_scores


def test_two_deviations_hold_the_truth_as_often_as_they_should(one_wing):
    """Of five numbers in six flights 28.6 are expected; below 25, four times in a thousand."""
    robot = one_wing("name: plunge, axis: x", "name: feather, axis: -y")
    course = RecoveryPlan(robot, duration=0.4, time_step=1e-3, every=4)
    found = [recover(course, seed) for seed in range(6)]
    far = np.abs([one.distances(one.refined) for one in found])
    assert (far <= 2).sum() >= 25
    scores = recovery_scores(found)
    spread = scores["refined"]["std_over_prior"]
    assert set(spread) == set(PRIORS) and max(spread.values()) < 0.95  # all are learned
    assert spread["lags.rate[1]"] < 0.3 and spread["lags.lift[1]"] < 0.3
    assert 0.9 < scores["coverage_of_forces"] < 0.99

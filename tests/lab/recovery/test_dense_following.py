"""A dense network follows a gait at the rate of the samples, one block of covariance a neuron."""

from __future__ import annotations

import pytest

import patagium as pt
from patagium.learning.identify import samples
from patagium.learning.stream import stream
from patagium_lab.frozen_spans import FrozenSpans
from patagium_lab.reproduction.cases import FLIGHT_CASES, make_network
from patagium_lab.reproduction.flights import corrected_flight

EVERY = 5
MEMORY = {"forgetting_factor": 0.9975}  # 0.2 s, about one wingbeat


@pytest.fixture(scope="module")
def flight():
    return corrected_flight(0.5)


def ahead(flight, learner):
    """NMSE of frozen weights over 10 ms, second half: mean and worst; the same of persistence."""
    time, x, y, _ = samples(flight, learner.network)
    spans = FrozenSpans({"10ms": 0.01}, learner, time, y, EVERY)
    stream(learner, time, x, y, every=EVERY, watches=[spans])
    scores = spans.scores()
    key = "horizon_10ms_{}_second_half_{}"
    return [scores[key.format(*k)] for k in WANTED]


WANTED = [(kind, span) for kind in ("nmse", "persistence") for span in ("mean", "worst")]


def flow_learner(covariance):
    network = pt.learning.FlowNetwork(pt.load_robot("aerobat"))
    return pt.CubatureLearner(
        network,
        prior_std=1.0,
        measurement_std=0.01 * network.force_scale(5.0),
        spread=3**0.5,
        covariance=covariance,
        **MEMORY,
    )


def test_blocks_of_neurons_foresee_10_ms_and_no_worse_than_the_full_covariance(flight):
    mean, worst, held_mean, held_worst = ahead(flight, flow_learner("node"))
    full_mean, full_worst, *_ = ahead(flight, flow_learner("full"))
    assert mean < 1.5 * full_mean  # issue: at most so much worse; a tenth measured
    assert worst < 1.5 * full_worst
    assert mean < held_mean / 50  # 1/180 measured
    assert worst < held_worst / 25


def test_flow_is_better_seen_than_coordinates(flight):
    mean, worst, *_ = ahead(flight, flow_learner("node"))
    known = make_network(FLIGHT_CASES["corrected"], "inputs")  # scaled by known ranges
    told = {"prior_std": 1.0, "measurement_std": 0.001 * known.output_scale, **MEMORY}
    squares = pt.LinearLearner(known, features=28, **told)  # as many neurons, held at random
    squares_mean, squares_worst, *_ = ahead(flight, squares)
    assert mean < squares_mean / 1.5  # .44 measured
    assert worst < squares_worst / 1.5

"""Does the study of a lost wing fly, score and tell what its plan says?"""

from dataclasses import asdict

import numpy as np
import pytest

from patagium.control.adaptation import AirWeights
from patagium_lab.damage.page import page, share
from patagium_lab.damage.plan import FORGETTING, GRADIENT, LEARNING, OFF, DamagePlan, Flight
from patagium_lab.damage.run import GradientWeights, authority, fly
from patagium_lab.gallery import Gallery
from patagium_lab.study import Results


def test_every_flight_of_the_plan_is_another():
    flights = DamagePlan(flights=3, pairs=2, ablations=2, few=1).listed()
    assert len(set(flights)) == len(flights) == 4 * 3 + 2 * 2 + 4 * 2 + 2 + 2 * 3
    assert {one.seed for one in flights} == {100, 101, 102}


@pytest.mark.parametrize("group", ["damage", "sensed"])
def test_a_lost_wing_shows_in_the_score(group):
    flight = Flight(group, "linear", OFF, seed=40, share=0.5, before=11, after=6)
    found = fly(flight)
    assert asdict(flight).items() <= found.items()
    assert len(found["error"]) == 17
    assert found["worst"] > 3 * found["former"]
    assert found["back"] is None and not found["lost"]
    assert found["power_before"] > 0


def test_what_brings_a_lost_wing_back_is_the_search_for_the_cut():
    """The gradient learner also brings the robot back; a controller without the search does not."""
    flights = [Flight("damage", "linear", one, 40, 1 / 3) for one in (GRADIENT, FORGETTING)]
    gradient, forgetting = (fly(one) for one in flights)
    assert gradient["counts"]["cut of a wing found"] == 1 and gradient["back"] <= 10
    assert "cut of a wing found" not in forgetting["counts"] and forgetting["back"] is None
    assert forgetting["end"] > 2 * gradient["end"]  # seen: 5.6 times


def test_a_gradient_step_descends_towards_least_squares():
    rng = np.random.default_rng(0)
    prior, truth, stds = np.ones(3), np.array([1.5, 0.5, 2.0]), np.array([0.3, 0.5, 1.0])
    exact, step = AirWeights(prior, stds, 1e6), GradientWeights(prior, stds, 1e6)
    errors = []
    for _ in range(200):
        slopes = rng.normal(size=(20, 3))
        errors.append(np.linalg.norm((step.weights - truth) / stds))
        for one in (exact, step):
            one.learn(slopes, slopes @ truth)
    assert np.all(np.diff(errors) <= 0)  # no noise: each step descends
    assert np.abs(exact.weights - truth).max() < 1e-2  # the prior still pulls by 1e-3
    assert errors[-1] < 1e-6 < errors[5]
    step.forget(1.0)
    assert np.array_equal(step.weights, prior)


def test_authority_shrinks_with_the_wing():
    rows = authority((0.2, 0.4))
    assert all(row["found"] for row in rows)
    assert 1 > rows[0]["room"] > rows[1]["room"] > 0.5


def test_the_page_counts_flights_that_are_back(tmp_path):
    flights = [
        Flight(group, "linear", learner, seed, 0.3 if group == "damage" else 0.0, before=12)
        for group in ("damage", "no harm")
        for learner in (OFF, LEARNING)
        for seed in (1, 2)
    ]
    rows = [
        asdict(one)
        | {"former": 0.1, "end": 0.1, "worst": 1.0, "lost": False, "effort": 0.1}
        | {"power_before": 1.0, "power_after": 2.0, "back": 4 if one.learner == LEARNING else 11}
        | {"error": [0.1 if one.learner == LEARNING else 0.2] * 30}
        for one in flights
    ]
    metrics = {"rows": rows, "share": 0.3, "seed": 1, "authority": [], "environment": {}}
    text = page(Results(metrics, Gallery(tmp_path))).write(tmp_path / "page.md").read_text()
    assert "without learning, 0 (0 to 66) % of 2 flights" in text
    assert "with learning, 100 (34 to 100) % of 2" in text
    assert "| learning: back within 10 beats [%] | at least 95 | 100 | yes |" in text
    assert "| undamaged: error with learning over that without, every pair [1] | at most" in text
    assert "0.500" in text  # ratio of errors without damage


def test_shares_have_intervals_of_wilson():
    rows = [{"back": 3}] * 9 + [{"back": None}]
    assert share(rows) == "90 (60 to 98)"

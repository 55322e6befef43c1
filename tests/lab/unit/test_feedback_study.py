"""Are flights side by side those of `pt.fly`, and does the study say what it found?"""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium import control
from patagium_lab.feedback.flights import Flights
from patagium_lab.feedback.page import page
from patagium_lab.feedback.plan import AVERAGED, ORNITHOPTER, PERIODIC, PREDICTIVE
from patagium_lab.feedback.run import controller, design, in_flight, law_of, region, truth
from patagium_lab.gallery import Gallery
from patagium_lab.study import Results

STEPS = 8
"""Time steps of an interval."""


@pytest.mark.parametrize("kind", [PERIODIC, PREDICTIVE])
def test_flights_side_by_side_are_those_of_the_loop(kind: str) -> None:
    """Commands that saturate, whose rates are limited, frequency among them."""
    case = ORNITHOPTER
    orbit, one = design(case), controller(case, kind)
    states = np.tile(one.model.course.states[0], (3, 1))
    states[:, orbit.names.index("z")] += [0.0, 0.4, -0.4]
    states[:, orbit.names.index("velocity of roll")] += [0.1, 1.0, -1.0]
    parts = {"commands": case.commands}
    kinds = {PERIODIC: control.LinearRegulator, PREDICTIVE: control.PredictiveController}
    pilots = [kinds[kind](orbit, **parts) for _ in states]
    truths = [truth(case, 1), truth(case, 2)]
    many = Flights(truths, one, law_of(one, 3), states, STEPS, np.zeros(3, int))
    many.fly(30)
    for k, start in enumerate(states):
        robot, aero = truths[k % 2]
        q, v = orbit.start()["q"], orbit.start()["v"]
        q[:6], v[:6] = start[:6], start[6:]
        flown = pt.fly(
            robot, aero, pilots[k], orbit=orbit, duration=30 * one.period, q=q, v=v,
            time_step=one.period / STEPS * (1 + 1e-9),
        )  # fmt: skip
        end = np.r_[flown["q"].values[-1, :6], flown["v"].values[-1, :6]]
        away = one.model.course.apart(30, end)
        assert np.abs(away - many.departures[k]).max() < 1e-5  # own time: order seven
        assert np.abs(away).max() > 0.01
    assert many.alive.all()


def test_a_delay_too_long_and_a_start_too_far_are_lost() -> None:
    delays = np.array([0, 200])  # time steps, of which a beat has 80
    assert in_flight(ORNITHOPTER, PERIODIC, range(2), delays, 10, 1, 8) == [True, False]
    found = region(ORNITHOPTER, PERIODIC, 5, 12, 10)
    sizes, recovered = np.array(found["sizes"]), np.array(found["recovered"])
    assert recovered.any() and not recovered[sizes > 0.6].all()


def test_the_page_says_which_order_holds(tmp_path) -> None:
    margins = [
        {"robot": "bird", "controller": PERIODIC, "beat": 0.2, "doubling": 7.0, "delay": 0.5}
        | {"delay_longest": False, "interval": 0.25, "interval_longest": False}
    ]
    many = {PREDICTIVE: 9, PERIODIC: 5, AVERAGED: 7}
    regions = [
        {"robot": "bird", "controller": kind, "lost": 1, "largest_multiplier": None}
        | {"sizes": [k / 10 for k in range(10)], "recovered": [k < count for k in range(10)]}
        for kind, count in many.items()
    ]
    metrics = {"margins": margins, "regions": regions, "seed": 7, "flights": 6, "beats": 40}
    whole = page(Results(metrics | {"environment": {}}, Gallery(tmp_path)))
    text = whole.write(tmp_path / "page.md").read_text()
    assert "| bird | 200 | 7.00 | periodic LQR | 0.5 (100 ms) | 4 (20 Hz) |" in text
    assert "predictive recovers at least as many as periodic LQR | 4 | 0 | 0.125 | yes" in text
    assert "periodic LQR recovers at least as many as averaged LQR | 0 | 2 | 0.500 | **no**" in text
    assert "90.0 | 60 to 98" in text

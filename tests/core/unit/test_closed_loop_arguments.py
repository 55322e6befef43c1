"""Wrong arguments of `pt.fly`, and commands that are no numbers, are refused by one sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError, PatagiumError
from patagium.simulation.steered_gait import SteeredGait

ROBOT = pt.load_robot("ornithopter")


@pytest.mark.parametrize("value", [np.nan, np.inf, None, "x", [1, 2], 1j, b"1", {}, np.ones(2)])
def test_a_command_that_is_no_number_is_refused(value: Any) -> None:
    gait = SteeredGait(ROBOT, pt.gaits.cruise(ROBOT))
    with pytest.raises(ParameterError, match="frequency"):
        gait.command(0.0, {"frequency": value})


@pytest.mark.parametrize("name", [1, None, "no_such", "\ud800", ("frequency",)])
def test_a_name_that_is_no_command_is_refused(name: Any) -> None:
    with pytest.raises(ParameterError, match="command"):
        SteeredGait(ROBOT, pt.gaits.cruise(ROBOT)).command(0.0, {name: 1.0})


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (pt.control.PayloadEvent(time=0.0, body="body", mass=0.01, position=5), "position"),
        (
            pt.control.PayloadEvent(time=0.0, body="body", mass=0.01, position=("a", 0, 0)),
            "position",
        ),
        (pt.control.PolarEvent(time=0.0, factors=1.0), "factors"),
    ],
)
def test_an_event_of_hostile_numbers_is_refused(event: Any, words: str) -> None:
    aero = pt.QuasiSteady(ROBOT, pt.Air())
    with pytest.raises(PatagiumError, match=words):
        event.changed(ROBOT, aero)

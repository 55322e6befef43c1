"""Wrong arguments of `pt.fly`, and commands that are no numbers, are refused by one sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError, PatagiumError, ShapeError
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
    ("kind", "name", "value"),
    [
        (pt.control.PayloadEvent, "position", 5),
        (pt.control.PayloadEvent, "position", ("a", 0, 0)),
        (pt.control.PayloadEvent, "mass", np.timedelta64(1, "s")),
        (pt.control.PayloadEvent, "time", 10**400),
        (pt.control.PolarEvent, "factors", 1.0),
        (pt.control.PolarEvent, "factors", {"lift_amplitude": np.nan}),
        (pt.control.GustEvent, "velocity", (0.0, np.inf, 0.0)),
        (pt.control.WindEvent, "velocity", (0.0, 1.0)),
        (pt.control.StuckEvent, "command", ["frequency"]),
    ],
)
def test_an_event_of_hostile_numbers_is_refused(kind: Any, name: str, value: Any) -> None:
    words = {
        pt.control.PayloadEvent: {"body": "body", "mass": 0.01},
        pt.control.PolarEvent: {"factors": {"lift_amplitude": 0.9}},
        pt.control.GustEvent: {"velocity": (0.0, 0.0, 1.0), "length_time": 0.01},
        pt.control.WindEvent: {"velocity": (0.0, 0.0, 1.0)},
        pt.control.StuckEvent: {"command": "frequency"},
    }
    with pytest.raises(ParameterError, match=f"^{name}: expected"):
        kind(**{"time": 0.0, **words[kind], name: value})


HOSTILE = (None, "x", b"1", object(), [[1], 2], {1}, 1j, np.nan, 10**400, np.ma.masked, {})


@pytest.mark.parametrize("value", HOSTILE, ids=lambda value: type(value).__name__)
@pytest.mark.parametrize(
    ("function", "given", "name"),
    [
        (pt.trim, {"robot": ROBOT}, "robot"),
        (pt.trim, {"robot": ROBOT}, "turn_rate"),
        (pt.trim, {"robot": ROBOT}, "tolerable"),
        (pt.trim, {"robot": ROBOT}, "steps"),
        (pt.control.continue_orbit, {"along": "speed", "limits": (4.0, 6.0)}, "orbit"),
        (pt.control.continue_orbit, {"orbit": ..., "limits": (4.0, 6.0)}, "along"),
        (pt.control.continue_orbit, {"orbit": ..., "along": "speed"}, "limits"),
        (pt.control.floquet, {}, "orbit"),
        (pt.control.optimize, {"robot": ROBOT}, "harmonics"),
        (pt.control.power_front, {"robot": ROBOT}, "speeds"),
        (pt.control.LinearRegulator, {"orbit": ...}, "commands"),
        (pt.control.PredictiveController, {"commands": ["frequency"]}, "orbit"),
        (pt.control.off_nominal, {"robot": ROBOT, "share": 0.1}, "seed"),
    ],
)
def test_a_hostile_argument_is_refused_by_its_name(
    function: Any, given: Any, name: str, value: Any, ornithopter_orbit: Any
) -> None:
    if value == {} and name == "tolerable":
        pytest.skip("an empty mapping is one")
    orbit = {"orbit": ornithopter_orbit} if "orbit" in given else {}
    known = {} if name in given else {**given, **orbit}
    with pytest.raises(PatagiumError, match=f"^{name}: expected"):
        function(**known, **{name: value})


@pytest.mark.parametrize("name", ["estimator", "progress"])
def test_an_option_of_a_flight_that_cannot_be_called_is_refused(
    name: str, ornithopter_orbit: Any
) -> None:
    law = pt.control.LinearRegulator(ornithopter_orbit, list(ROBOT.actuators))
    air = pt.QuasiSteady(ROBOT)
    with pytest.raises(ParameterError, match=f"^{name}: expected"):
        pt.fly(ROBOT, air, law, orbit=ornithopter_orbit, duration=0.02, **{name: 5})


def test_an_array_is_as_good_as_a_tuple_where_none_may_stand_too() -> None:
    told = [
        pt.control.PayloadEvent(time=0.1, body="body", mass=0.01, position=where)
        for where in (np.ones(3), [1.0, 1.0, 1.0], (1.0, 1.0, 1.0))
    ]
    assert told[0] == told[1] == told[2] and told[0].position == (1.0, 1.0, 1.0)


@pytest.mark.parametrize("cost", [np.ones((2, 3)), np.ones(3), np.array(1.0), np.ones((2, 2, 2))])
@pytest.mark.parametrize("name", ["state_cost", "input_cost"])
def test_a_cost_that_is_no_square_matrix_is_refused(name: str, cost: Any) -> None:
    given = {"state_cost": np.eye(2), "input_cost": np.eye(2), name: cost}
    with pytest.raises(ShapeError, match=f"^{name}: expected"):
        pt.control.RealTimeIteration(print, 2, **given)

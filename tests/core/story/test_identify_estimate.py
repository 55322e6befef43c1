"""`patagium identify --estimate`: numbers of the air from a flight, as a table and as a page."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

import patagium as pt
from patagium.cli.main import run
from patagium.robot import Robot

from ...spoken import Speak

ESTIMATE = "lift_slope=1.5,zero_lift_angle=5 deg"


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory, one_wing: Callable[..., Robot]) -> Path:
    """DeLaurier's strips with a lift slope of 5.5 and a zero-lift angle of -3 degrees."""
    robot = one_wing("name: plunge, axis: x", "name: feather, axis: -y")
    air = pt.Air(wind=(-5.0, 0.0, 0.0))
    aero = pt.DeLaurier(robot, air, lift_slope=5.5, zero_lift_angle=-0.0524)
    gait = pt.gaits.sinusoidal(robot, frequency=4.0, plunge=0.4, feather=0.1)
    path = tmp_path_factory.mktemp("flight") / "flight.nc"
    pt.save_flight(pt.simulate(robot, aero, gait, duration=0.4, time_step=1e-3), path)
    return path


@pytest.fixture
def identify(flight: Path, speak: Speak) -> Speak:
    return partial(speak, "identify", flight, "--every", 4)


LEARN = ("--estimate", ESTIMATE, "--measurement-std", "1e-4")


def test_numbers_are_learned_shown_and_kept(identify: Speak, flight: Path, tmp_path: Path) -> None:
    page, model = tmp_path / "report.html", tmp_path / "model.json"
    answer = identify(*LEARN, "--aero", "quasi-steady")
    assert answer.code == 2 and "lift_slope" in answer.err and "polar.lift_offset" in answer.err
    answer = identify(*LEARN, "--report", page, "--model", model, "--refine")
    assert answer.code == 0
    assert "zero_lift_angle" in answer.out and "standard deviation" in answer.out
    text = page.read_text(encoding="utf-8")
    assert "Physical parameters" in text and "lift_slope" in text
    scores = json.loads(identify(*LEARN, "--learner", "extended", "--json").out)
    assert scores["parameter_value"]["lift_slope"] == pytest.approx(5.5, rel=1e-3)
    assert scores["parameter_prior_std"]["zero_lift_angle"] == pytest.approx(0.0872665)
    assert scores["nmse_worst"] < 1e-6  # it starts at the flight's own numbers
    with pytest.raises(SystemExit) as left:
        run(["evaluate", str(model), str(flight)])
    assert left.value.code in (None, 0)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--estimate", "lift_slop=0.5", *LEARN[2:]), "closest: lift_slope"),
        (("--estimate", "lift_slope", *LEARN[2:]), "NAME=VALUE"),
        (("--estimate", "lift_slope=1", *LEARN), "lift_slope once"),
        (("--estimate", "wing[0].chord=2 kg", *LEARN[2:]), "--estimate wing[0].chord"),
        (("--estimate", "lift_slope=-1", *LEARN[2:]), "positive prior deviation"),
        (("--aero", "delaurier", *LEARN[2:]), "--estimate"),
        (("--network", "strip", *LEARN), "none with --estimate"),
        (("--refine", *LEARN[2:], "--prior-std", "1"), "--estimate"),
    ],
)
def test_what_cannot_be_is_said_in_a_line(
    identify: Speak, words: tuple[str, ...], message: str
) -> None:
    answer = identify(*words)
    assert answer.code == 2 and message in answer.err


def test_a_table_has_no_numbers_of_the_air(tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as left:
        run(["identify", str(tmp_path / "log.csv"), "--mapping", "m.yaml", *LEARN])
    assert left.value.code == 2

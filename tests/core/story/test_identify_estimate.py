"""`patagium identify --estimate`: numbers of the air from a flight, as a table and as a page."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import patagium as pt
from patagium.cli.main import run
from patagium.robot import Robot, load_robot_text

from ...spoken import Speak

MOTH = """
name: moth
gravity: 9.81
bodies:
  fore:
    joints: [{name: flap, axis: x}, {name: twist, axis: -y}]
    mass: 4 g
    center_of_mass: [-1.2 cm, 8 cm, 3 mm]
    inertia: {xx: 9 g cm^2, yy: 4 g cm^2, zz: 12 g cm^2}
wings:
  - name: fore
    segments:
      - body: fore
        strips: 5
        stations:
          - {span: 1 cm, leading: 2 cm, trailing: -6 cm}
          - {span: 17 cm, leading: 1.5 cm, trailing: -4.5 cm}
"""
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
    answer = identify(*LEARN, "--report", page, "--model", model)
    assert answer.code == 0
    assert "zero_lift_angle" in answer.out and "standard deviation" in answer.out
    text = page.read_text(encoding="utf-8")
    assert "Physical parameters" in text and "lift_slope" in text
    assert "from a least-squares fit of the whole log" in " ".join(answer.out.split())
    assert "from a least-squares fit of the whole log" in text
    once = ("--no-refine", "--model", tmp_path / "once.json")
    assert "from one pass, which" in " ".join(identify(*LEARN, *once).out.split())
    scores = json.loads(identify(*LEARN, "--learner", "extended", "--json").out)
    assert scores["parameter_value"]["lift_slope"] == pytest.approx(5.5, rel=1e-3)
    assert scores["parameter_prior_std"]["zero_lift_angle"] == pytest.approx(0.0872665)
    assert scores["nmse_worst"] < 1e-6  # it starts at the flight's own numbers
    with pytest.raises(SystemExit) as left:
        run(["evaluate", str(model), str(flight)])
    assert left.value.code in (None, 0)


def test_a_refined_model_knows_its_log_and_its_fit(
    identify: Speak, flight: Path, tmp_path: Path, speak: Speak
) -> None:
    """`evaluate` said of refined numbers that they are of one pass, and `check` named no log."""
    model = tmp_path / "model.json"
    assert identify(*LEARN, "--model", model).code == 0
    told = " ".join(speak("evaluate", model, flight).out.split())
    assert "from a least-squares fit of the whole log" in told and "one pass" not in told
    assert json.loads(speak("check", model, "--json").out)["learned from"] == flight.name


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--estimate", "lift_slop=0.5", *LEARN[2:]), "closest: lift_slope"),
        (("--estimate", "wing.mas=1 g", *LEARN[2:]), "closest: wing.mass"),
        (("--estimate", "lift_slope", *LEARN[2:]), "NAME=VALUE"),
        (("--estimate", "lift_slope=1", *LEARN), "lift_slope once"),
        (("--estimate", "wing[0].chord=2 kg", *LEARN[2:]), "--estimate wing[0].chord"),
        (("--estimate", "lift_slope=-1", *LEARN[2:]), "positive prior deviation"),
        (("--aero", "delaurier", *LEARN[2:]), "--estimate"),
        (("--network", "strip", *LEARN), "none with --estimate"),
        (("--no-refine", *LEARN[2:], "--prior-std", "1"), "--estimate"),
        (("--refine", *LEARN[2:], "--prior-std", "1"), "--estimate"),
    ],
)
def test_what_cannot_be_is_said_in_a_line(
    identify: Speak, words: tuple[str, ...], message: str
) -> None:
    answer = identify(*words)
    assert answer.code == 2 and message in answer.err


def test_the_shortest_command_states_deviations_that_hold(tmp_path: Path, speak: Speak) -> None:
    """A mass was 84 of its stated deviations off where the noise is found and nothing refined."""
    robot = load_robot_text(MOTH, "moth")
    air = pt.Air(wind=(-4.0, 0.0, 0.3))
    polar = pt.air.DickinsonPolar(lift_amplitude=1.3)
    gait = pt.gaits.sinusoidal(robot, frequency=4.0, flap=0.5, twist=0.3)
    models = pt.QuasiSteady(robot, air, polar=polar), pt.QuasiSteady(robot, air)
    flight, book = (
        pt.simulate(robot, one, gait, duration=duration, time_step=5e-4)
        for one, duration in zip(models, (2.0, 0.01), strict=True)
    )
    noise = (
        0.05 * flight.u1.std("time").values * np.random.default_rng(0).normal(size=flight.u1.shape)
    )
    flight = flight.assign(u1=(flight.u1 + noise).assign_attrs(flight.u1.attrs))
    pt.save_flight(flight.assign_attrs(aero=book.attrs["aero"]), tmp_path / "log.nc")
    wanted = ("--estimate", "polar.lift_amplitude=0.5,fore.mass=5e-4")
    answer = speak("identify", tmp_path / "log.nc", *wanted, "--every", 10, "--json")
    scores = json.loads(answer.out)
    for name, true in {"polar.lift_amplitude": 1.3, "fore.mass": 4e-3}.items():
        error = scores["parameter_value"][name] - true
        assert abs(error) < 4 * scores["parameter_std"][name] < 0.2 * true


def test_a_table_has_no_numbers_of_the_air(tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as left:
        run(["identify", str(tmp_path / "log.csv"), "--mapping", "m.yaml", *LEARN])
    assert left.value.code == 2


def test_a_resumed_state_counts_in_the_fit(identify: Speak, tmp_path: Path) -> None:
    """The fit after a resumed state used the last log alone."""
    options = *LEARN, "--model", tmp_path / "model.json", "--json"
    once, first, second = (
        json.loads(identify(*options, *state).out)
        for state in ((), *[("--state", tmp_path / "learner.state")] * 2)
    )
    assert first["parameter_std"] == once["parameter_std"]
    for name, std in once["parameter_std"].items():
        assert second["parameter_std"][name] == pytest.approx(std / 2**0.5, rel=1e-3)
    assert "of what was learned before it" in second["parameter_fit"]

"""`patagium fly`: a plan becomes a flight, and what was chosen is said."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

import patagium as pt
from patagium.cli import plan
from patagium.cli.main import run
from patagium.cli.plan import load_plan, prepared
from patagium.errors import LogError, ParameterError

PLAN = """
robot: ornithopter
trim: {speed: 6 m/s, free: [frequency, elevation_offset, plunge_amplitude]}
truth: {masses: 0.02, density: 1.19 kg/m^3, polar: {lift_amplitude: 0.97}}
controller: {type: regulator, commands: [frequency, elevation_offset, rudder_offset]}
sensors: {std: {z: 0.005, velocity of z: 0.02}, missing: 0.02}
events:
  - {type: gust, time: 0.1 s, velocity: [0, 50 cm/s, 0], length_time: 200 ms}
  - {type: gust, time: 0.2 s, velocity: [0.1, 0, 0], length_time: 50 ms, stays: true}
  - {type: payload, time: 0.3 s, body: body, mass: 5 g}
  - {type: wing_loss, time: 0.4 s, wing: left_wing, share: 0.03}
  - {type: polar, time: 0.5 s, factors: {drag_offset: 1.1}}
  - {type: stuck, time: 0.6 s, command: rudder_offset, value: 0}
duration: 0.8 s
time_step: 0.5 ms
seed: 3
"""


def said(capsys, *words):
    """Exit code, answer and complaints of the program."""
    with pytest.raises(SystemExit) as left:
        run([str(word) for word in words])
    heard = capsys.readouterr()
    return left.value.code or 0, heard.out, heard.err


def test_a_plan_is_flown_as_it_says(tmp_path, capsys):
    (tmp_path / "plan.yaml").write_text(PLAN)
    code, out, err = said(
        capsys, "fly", tmp_path / "plan.yaml", "-o", tmp_path / "f.nc", "--seed", 4
    )
    assert code == 0 and "completed" in out
    for words in (
        "6 m/s",
        "regulator",
        "masses and inertias off by 2 %",
        "seed 4",
        "payload of 5 g",
        "missing",
    ):
        assert words in err
    flight = pt.load_flight(tmp_path / "f.nc")
    kinds = [one["kind"] for one in json.loads(flight.attrs["events"])]
    assert kinds == [
        *("GustEvent", "GustEvent", "PayloadEvent", "WingLossEvent", "PolarEvent", "StuckEvent")
    ]
    assert flight.attrs["seed"] == 4
    assert json.loads(flight.attrs["aero"])["air"]["density"] == 1.19
    wind = flight["wind"].sel(axis="y").values
    assert wind.max() == pytest.approx(0.5, rel=1e-3)
    rudder = flight["command"].sel(command_name="rudder_offset").values
    assert (rudder[flight["time"].values > 0.61] == 0.0).all()


def test_a_name_alone_flies_and_says_what_was_chosen(tmp_path, capsys):
    words = ("--duration", "0.6 s", "-o", tmp_path / "f.nc", "--json")
    code, out, err = said(capsys, "fly", "aerobat", *words)
    assert code == 0 and json.loads(out)["outcome"] == "COMPLETED" and "Orbit" not in err
    ready = prepared(load_plan("aerobat"))
    assert ready.duration == pytest.approx(40 * ready.orbit.period)
    (gust,) = ready.events
    assert gust.time == pytest.approx(ready.duration / 3)
    assert any("predictive" in one for one in ready.words)
    flight = pt.load_flight(tmp_path / "f.nc")
    heave = flight["estimate"].sel(state="z").values - flight["reference"].sel(state="z").values
    assert np.abs(heave).max() < 0.1


def test_a_glider_holds_its_glide(tmp_path, capsys):
    words = ("--duration", "0.4 s", "-o", tmp_path / "flown.nc")
    code, _, err = said(capsys, "fly", "hawk", *words)
    assert code == 0 and "climb -2." in err and "elevation_offset" in err
    pitch = pt.load_flight(tmp_path / "flown.nc").q.sel(dof="pitch").values
    assert float(np.ptp(pitch)) < 0.1  # rad; a gust of a tenth of its speed turns it


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ("masses", "mases", "line 4, truth.mases: .*did you mean masses"),
        ("type: gust", "type: gst", "line 8, events.0.type: .*did you mean gust"),
        ("share:", "shar:", "line 11, .*did you mean share"),
        ("mass: 5 g", "mass: 5 m", "line 10, .*expected a mass"),
        ("regulator", "regulatr", "line 5, .*did you mean regulator"),
        ("missing: 0.02", "parts: [{type: as560}]", "line 6, .*did you mean as5600"),
        ("seed: 3", "seed: -3", "line 16, seed"),
        ("seed: 3", "seed: true", "line 16, seed: expected a whole number, found True"),  # was 1
        ("seed: 3", "seed: '1'", "line 16, seed: expected a whole number, found '1'"),
        ("density: 1.19 kg/m^3", "air: lifting_line", "line 4, .*did you mean lifting-line"),
        ("type: regulator", "type: regulator, learn: often", "line 5, controller.learn"),
        ("speed: 6 m/s", "speed: fast", "line 3, trim.speed: .*a speed"),
        ("time: 0.2 s, ", "", "line 9, events.1.*time: .*found nothing"),
        ("missing: 0.02", "missing: .nan", "line 6, sensors.missing"),
        ("velocity of z: 0.02", "velocity of z: 2 cm", r"line 6, sensors.std.velocity of z: .*m/s"),
        ("value: 0", "value: 3 mm", r"line 13, events.5.stuck.value: .*rad"),
        (  # an amplitude is over the gait's own: it was taken for .52 of it
            "rudder_offset, value: 0",
            "plunge_amplitude, value: 30 deg",
            "line 13, events.5.stuck.value: expected a quantity such as '0.5'",
        ),
        (
            "robot: ornithopter\n",
            "",
            "robot: expected a value such as `robot: ornithopter`, found nothing",
        ),
    ],
)
def test_wrong_words_of_a_plan_are_told_with_their_line(tmp_path, old, new, where):
    path = tmp_path / "plan.yaml"
    path.write_text(PLAN.replace(old, new))
    with pytest.raises(LogError, match=where):
        load_plan(path)


def test_numbers_of_a_plan_may_carry_units(tmp_path):
    path = tmp_path / "plan.yaml"
    words = PLAN.replace("std: {z: 0.005", "std: {z: 5 mm, pitch: 1 deg, velocity of yaw: 2 deg/s")
    words = words.replace("value: 0}", "value: -3 deg}")
    path.write_text(words.replace("commands:", "tolerable: {x: 20 cm, pitch: 0.1}, commands:"))
    plan = load_plan(path)
    assert plan.sensors.std == pytest.approx(
        {
            "z": 0.005,
            "pitch": np.radians(1),
            "velocity of yaw": np.radians(2),
            "velocity of z": 0.02,
        }
    )
    assert plan.controller.tolerable == {"x": 0.2, "pitch": 0.1}
    assert plan.events[-1].value == pytest.approx(np.radians(-3))
    path.write_text(PLAN.replace("rudder_offset, value: 0}", "left_plunge_phase, value: 4 deg}"))
    assert load_plan(path).events[-1].value == pytest.approx(np.radians(4))  # no actuator's name


def test_legs_have_the_added_mass_of_the_first_orbit(monkeypatch):
    """Legs were trimmed without the learned added mass, and the flight left its own orbit."""
    orbit = SimpleNamespace(
        **dict.fromkeys(("robot", "aero", "gait")),
        **{"speed": 6.0, "climb": 0.0, "turn_rate": 0.0, "added_mass": "that of the model"},
    )
    seen: dict[str, object] = {}

    def trim(*args: object, **given: object) -> None:
        seen.update(given)
        raise LogError("far enough")

    monkeypatch.setattr(plan, "trim", trim)
    law = SimpleNamespace(model=SimpleNamespace(commands=()))
    with pytest.raises(LogError, match="far enough"):
        plan._route((plan.LegPart(time="1 s"),), law, orbit)
    assert seen["added_mass"] == "that of the model"


def test_the_truth_of_a_plan_in_water_is_water(tmp_path):
    """A controller whose model is in water flew a truth in air of 1.2 kg/m^3."""
    path = tmp_path / "plan.yaml"
    for density, words in (("density: 1.5, ", "1.46939"), ("", "1.2")):
        trimmed = f"trim: {{{density}speed: 6, free: [frequency, elevation_offset, plunge_phase]}}"
        path.write_text(f"robot: ornithopter\n{trimmed}\nevents: []\nduration: 5 ms\n")
        ready = prepared(load_plan(path))
        assert f"quasi-steady air of {words} kg/m^3, the model's" in " ".join(ready.words)
        assert pt.simulation.air_of(ready.fly()).density == pytest.approx(float(words), rel=1e-5)


def test_the_robot_of_a_plan_is_looked_for_beside_it(tmp_path, monkeypatch):
    (tmp_path / "plans").mkdir()
    path, own = (tmp_path / "plans" / name for name in ("plan.yaml", "own.yaml"))
    own.write_text(pt.load_robot("ornithopter").source)
    path.write_text(PLAN.replace("robot: ornithopter", "robot: own.yaml"))
    monkeypatch.chdir(tmp_path)
    assert load_plan("plans/plan.yaml").robot == str(own.relative_to(tmp_path))
    for missing in ("other.yaml", "ornithoptr"):
        path.write_text(PLAN.replace("robot: ornithopter", f"robot: {missing}"))
        with pytest.raises(LogError, match=rf"plan\.yaml: robot: .*{missing}"):
            load_plan(path)


def test_a_plan_asks_for_a_model_that_relearns(tmp_path):
    path = tmp_path / "plan.yaml"
    path.write_text(PLAN.replace("type: regulator,", "type: regulator, learn: true,"))
    ready = prepared(load_plan(path))
    assert isinstance(ready.controller, pt.control.AdaptiveController)
    assert any("relearns in flight" in one for one in ready.words)


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ("wing: left_wing", "wing: left_wng", "line 11, events.3.wing_loss.wing"),
        ("share: 0.03", "share: 1.5", "line 11, events.3.wing_loss.share"),
        ("body: body", "body: boddy", "line 10, events.2.payload.body"),
        ("50 ms, stays", "-1 s, stays", "line 9, events.1.gust"),
        ("mass: 5 g", "mass: -5 g", "line 10, events.2.payload.mass"),
        ("drag_offset", "drag_ofset", "factors"),
        ("command: rudder_offset", "command: ruder_offset", "ruder_offset"),
        ("time: 0.6 s", "time: 6 s", "within the flight"),
        ("time: 0.6 s", "time: -1 s", "line 13, events.5.stuck.time"),
        ("std: {z:", "std: {zz:", "line 6, sensors.std"),
        ("missing: 0.02", "missing: 1.5", "line 6, sensors.missing"),
        ("missing: 0.02", "delay: -1 s", "line 6, sensors.delay"),
        ("masses: 0.02", "masses: 0.5", "line 4, truth.masses: expected a number less than 0.3"),
        ("density: 1.19 kg/m^3", "density: -1", "line 4, truth.density"),
        ("lift_amplitude: 0.97", "lift: 0.97", "factors"),
        ("duration: 0.8 s", "duration: -1 s", "line 14, duration"),
        ("duration: 0.8 s", "duration: 0 s", "line 14, duration"),
        ("time_step: 0.5 ms", "time_step: 0 s", "line 15, time_step"),
        ("type: regulator", "type: regulator, tolerable: {z: 0}", "line 5, controller.tolerable"),
        ("commands: [", "tolerable: {zz: 1}, commands: [", "zz"),
        ("commands: [", "commands: [ruder_offset, ", "line 5, controller.commands"),
        ("free: [frequency, ", "free: [frequncy, ", "line 3, trim.free"),
    ],
)
def test_numbers_and_names_that_cannot_be_are_refused_in_a_sentence(
    tmp_path, capsys, old, new, where
):
    (tmp_path / "plan.yaml").write_text(PLAN.replace(old, new))
    code, _, err = said(capsys, "fly", tmp_path / "plan.yaml", "-o", tmp_path / "f.nc")
    last = err.strip().splitlines()[-1]
    assert code == 2 and where in last and "expected" in last and "Traceback" not in err
    assert not list(tmp_path.glob("*.nc"))


def test_what_a_plan_cannot_ask_is_refused(tmp_path):
    path = tmp_path / "plan.yaml"
    with pytest.raises(ParameterError, match="actuators"):
        prepared(load_plan("dragonfly"))
    parts = "parts: [{type: icm_42688_p, rate: 500 Hz}, {type: as5600}, {type: prime_x_13}]"
    path.write_text(PLAN.replace("missing: 0.02", parts))
    with pytest.raises(LogError, match="line 6, sensors.*parts, or std"):
        load_plan(path)
    path.write_text(PLAN.replace("std: {z: 0.005, velocity of z: 0.02}, missing: 0.02", parts))
    words = prepared(load_plan(path)).words
    assert any("tracker makes of icm_42688_p, as5600" in one for one in words)

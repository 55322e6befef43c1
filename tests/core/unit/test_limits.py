"""Limits of what is read: each refusal is short and names the place and the remedy."""

import os
import signal
import time

import numpy as np
import pytest
import xarray as xr
import yaml
from tests.flights import stored

import patagium as pt
from patagium import scratch
from patagium.cli.stream import _robot_and_air
from patagium.errors import LogError, ParameterError, PatagiumError, RobotFileError, Unreadable
from patagium.learning.tuning import search
from patagium.limits import NESTING, PROBLEMS, YAML_TEXT
from patagium.live.packets import read_key
from patagium.live.sources import source_of
from patagium.reading import json_object, parsed_json, parsed_yaml, regular_file, text_of
from patagium.report.figures import comparison
from patagium.report.page import picture
from patagium.robot import load_robot_text
from patagium.robot.files import preset_text
from patagium.robot.units import UnitMismatch, in_si
from patagium.sensing.logs.files.opening import open_log
from patagium.sensing.logs.mapping import conversion, load_mapping
from patagium.sensing.sensors.sense import load_sensor_log
from patagium.simulation.cycles import cycle_statistics
from patagium.simulation.simulator import whole_steps

_AT_ONCE = 3.0  # s of the processor, the table of units included


@pytest.mark.parametrize(
    "written",
    [
        "1 m/s^2^9^9^9",
        "1 9^9^9^9 m/s^2",
        "1 (9)^(9)^(9)^(9) m/s^2",
        "1 m/s^2" + " " * 80_000,
        "1" + " " * 80_000 + "m/s^2",
        "1 ((((((km^9)^9)^9)^9)^9)^9)",
        "1 " + "(" * 39,
        "9" * 80_000,
        "1e31 m/s^2",
    ],
)
def test_a_hostile_quantity_is_refused_at_once(written):
    began = time.process_time()
    with pytest.raises(UnitMismatch) as caught:
        in_si(written, "m/s^2", "an acceleration")
    assert time.process_time() - began < _AT_ONCE
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("unit", ["m/s^2^9^9^9", "9^9^9^9", "m" + " " * 80_000, "m^99"])
def test_a_hostile_unit_of_a_mapping_is_refused_at_once(unit):
    began = time.process_time()
    with pytest.raises(LogError) as caught:
        conversion(unit, None, "mapping: time")
    assert time.process_time() - began < _AT_ONCE
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    ("unit", "factor"), [("m s^(-2)", 1.0), ("mm.s**-2", 1e-3), ("rad/s/Hz^0.5", 1.0), ("1/s", 1.0)]
)
def test_units_of_people_are_read(unit, factor):
    assert conversion(unit, None, "here")[0] == factor


def test_many_unknown_keys_make_a_short_message():
    words = yaml.safe_load(preset_text("aerobat")) | {f"unknown_{k}": k for k in range(300)}
    with pytest.raises(RobotFileError) as caught:
        load_robot_text(yaml.safe_dump(words), "many.yaml")
    assert f"and {300 - PROBLEMS} more" in str(caught.value)
    assert len(str(caught.value)) < 2000


def test_a_long_key_is_cut(tmp_path):
    with pytest.raises(RobotFileError) as caught:
        load_robot_text("k" * 50_000 + ": 1", "long.yaml")
    assert len(str(caught.value)) < 2000
    (tmp_path / "m.yaml").write_text("? " + "k" * 50_000 + "\n: 1")
    with pytest.raises(LogError) as caught:
        load_mapping(tmp_path / "m.yaml")
    assert len(str(caught.value)) < 2000


def test_the_text_of_a_robot_in_a_flight_is_bounded():
    with pytest.raises(RobotFileError, match=f"at most {YAML_TEXT}"):
        load_robot_text("#" * (YAML_TEXT + 1), "flight")


def test_a_quantity_beyond_physics_is_refused():
    for mass in ("1e308", "1e-320"):
        text = f"name: a\ngravity: 9.8\nbodies:\n  b: {{mass: {mass}, floating: true}}\n"
        with pytest.raises(RobotFileError, match="mass"):
            load_robot_text(text, "heavy.yaml")


@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "none"])
def test_only_regular_files_are_read(tmp_path, kind):
    path = {"device": "/dev/zero", "folder": tmp_path}.get(kind, tmp_path / "file.yaml")
    if kind == "pipe":
        os.mkfifo(path)
    with pytest.raises(Unreadable, match=str(path)):
        regular_file(path)
    with pytest.raises(PatagiumError):
        pt.load_robot(path)


def test_a_text_is_read_up_to_its_bound(tmp_path):
    file = tmp_path / "text"
    file.write_text("x" * 11)
    with pytest.raises(Unreadable, match="at most 10 bytes"):
        text_of(file, 10)
    assert text_of(file, 11) == "x" * 11


@pytest.mark.parametrize(
    "text",
    ["[" * 100_000, "[" * (NESTING + 1) + "]" * (NESTING + 1), '{"a": "\\ud800"}', "9" * 9999, "{"],
)
def test_hostile_json_is_refused(text):
    with pytest.raises(Unreadable, match="file.json"):
        json_object(text, "file.json")


def test_brackets_in_texts_are_no_levels():
    assert parsed_json('["' + "[" * 1000 + '\\""]', "x") == ["[" * 1000 + '"']


@pytest.mark.parametrize(
    "text",
    [
        "[" * 5000,
        "a: &a [1]\nb: &b [*a, *a]\n" + "c: &a [*b, *b]\nd: &b [*a, *a]\n" * 30,
        "&a [*a]",
        'a: "\\ud800"',
        "a: 1\na: 2",
    ],
)
def test_hostile_yaml_is_refused(text):
    with pytest.raises(Unreadable, match=r"file.yaml"):
        parsed_yaml(text, "file.yaml")


def test_too_many_steps_are_refused():
    for duration, step in ((1e300, 1e-300), (1e9, 1e-9)):
        with pytest.raises(ParameterError, match="duration"):
            whole_steps(duration, step)


@pytest.mark.parametrize(
    ("place", "moment", "sound"),
    [("[0, 0, 0]", 0, False), ("[0.1, 0, 0]", 0, True), ("[0, 0.5, 0]", 0, False),
     ("[0, 0, 0]", 1e-300, False), ("[0, 0, 0]", 1e-6, True)],
)  # fmt: skip
def test_a_joint_that_turns_no_mass_is_refused(place, moment, sound):
    text = f"""
name: a
gravity: 9.81
bodies:
  base: {{mass: 1, shape: {{type: point}}}}
  arm:
    parent: base
    mass: 1
    center_of_mass: {place}
    inertia: {{xx: {moment}, yy: {moment}, zz: {moment}}}
    joints: [{{name: hinge, axis: y}}]
"""
    if sound:
        assert load_robot_text(text).dof == 1
        return
    with pytest.raises(RobotFileError, match=r"bodies\.arm: expected a moment of inertia"):
        load_robot_text(text)


def _flown(steps=300, **options):
    robot = pt.load_robot("aerobat")
    air = pt.air.QuasiSteady(robot, pt.Air())
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.3)
    options = {"duration": steps * 1e-3, "mount": pt.mounts.fixed(), **options}
    return pt.simulate(robot, air, gait, time_step=1e-3, **options)


def test_a_long_flight_on_the_disk_is_the_flight_in_memory(tmp_path, monkeypatch):
    short = _flown()
    monkeypatch.setattr(scratch, "MEMORY_SHARE", 0.0)
    long = _flown()
    assert scratch.release(long["q"].to_numpy()) and not scratch.release(short["q"].to_numpy())
    assert long.identical(short)
    pt.save_flight(long, tmp_path / "long.nc")
    assert pt.load_flight(tmp_path / "long.nc").identical(stored(short))


def test_a_flight_beyond_the_disk_is_refused_with_its_size_also_where_the_step_is_chosen():
    robot = pt.load_robot("aerobat")
    air, gait = pt.air.QuasiSteady(robot, pt.Air()), pt.gaits.cruise(robot)
    with pytest.raises(ParameterError, match=r"duration: .*shorten it.* samples of .*iB"):
        pt.simulate(robot, air, gait, duration=1e9)
    with pytest.raises(ParameterError, match=r"duration: expected .* found .*iB") as caught:
        _flown(steps=10**11)
    assert "shorten it" in str(caught.value)


def test_audits_in_blocks_are_those_of_the_whole(monkeypatch):
    whole = _flown()
    monkeypatch.setattr("patagium.simulation.flight._BLOCK", 64)
    parts = _flown()
    for name in ("energy_exchanged", "impulse_exchanged"):
        # sums of 300 terms in another order
        assert parts.attrs[name] == pytest.approx(whole.attrs[name], rel=1e-13)


def test_a_name_is_no_formula():
    time, values = np.arange(3.0), np.zeros((3, 1))
    name = r"$\frac{$"
    figure = comparison(time, values, {name: values}, names=[name], units=[name])
    assert picture(figure, "hostile").source.startswith("data:")


READERS = {
    "robot": pt.load_robot,
    "robot of URDF": pt.robot.load_urdf,
    "gait": lambda path: pt.gaits.from_csv(pt.load_robot("aerobat"), path),
    "flight": pt.load_flight,
    "settings": pt.learning.load_settings,
    "learner": pt.load_learner,
    "model": pt.learning.load_model,
    "identification": pt.learning.load_identification,
    "sensor log": load_sensor_log,
    "mapping": load_mapping,
    "log": open_log,
    "key": read_key,
    "journal": search._storage,
    "packets": lambda path: source_of(str(path), ["time"]),
}


@pytest.fixture
def ended_after_10_s():
    def end(*_):
        raise AssertionError("it waits")

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(10)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.usefixtures("ended_after_10_s")
@pytest.mark.parametrize("what", READERS)
def test_nothing_waits_at_a_pipe(what, tmp_path):
    """A named pipe without a writer would block a reader for ever."""
    path = tmp_path / "pipe.csv"
    os.mkfifo(path)
    with pytest.raises(PatagiumError, match=r"pipe\.csv"):
        READERS[what](path)


@pytest.mark.usefixtures("ended_after_10_s")
def test_a_pipe_to_stream_is_answered_with_the_way(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    source = str(tmp_path / "pipe")
    assert _robot_and_air(source, "aerobat")[0].name == "aerobat"
    with pytest.raises(LogError, match="give - and pipe it to the program"):
        source_of(source, ["time"])


@pytest.mark.usefixtures("ended_after_10_s")
@pytest.mark.parametrize("name", ["part.bag", "metadata.yaml", "rosbag2_0.db3"])
def test_nothing_waits_at_a_pipe_among_the_parts_of_a_log(name, tmp_path):
    os.mkfifo(tmp_path / name)
    with pytest.raises(Unreadable, match=name):
        open_log(tmp_path)


@pytest.mark.parametrize("name", ["window", "reference"])
def test_samples_to_remember_are_bounded(name):
    with pytest.raises(ParameterError, match=f"{name}: .*at most 1e\\+06"):
        pt.learning.ChangeDetection(**{name: 10**30})


def test_points_of_a_wingbeat_are_bounded():
    with pytest.raises(ParameterError, match="2 to ten thousand points"):
        cycle_statistics(xr.Dataset(), period=0.1, phases=2**31)

"""The shortest commands: presets fly by themselves, and say what they chose and how they flew."""

from __future__ import annotations

import json
import signal
from contextlib import contextmanager
from importlib import import_module

import numpy as np
import pytest

import patagium as pt
from patagium.errors import Interrupted, ParameterError, RobotFileError
from patagium.robot import load_robot_text
from patagium.simulation.flight_summary import flight_summary
from patagium.simulation.state_limits import tidy_step

from ...spoken import say

FLYERS = ("aerobat", "aerobat-beta", "dragonfly", "hawk", "ornithopter", "yeo-wing")


@pytest.mark.parametrize("name", FLYERS)
def test_a_preset_flies_by_itself(name, tmp_path, capsys):
    path = tmp_path / "flight.nc"
    code, out, err = say(capsys, "simulate", name, "-o", path)
    assert code == 0, err
    assert f"Chosen for {name}" in err and "time step" in err and f"view {path}" in out
    flight, robot = pt.load_flight(path), pt.load_robot(name)
    assert flight.time[-1] == pytest.approx(robot.cruise.duration)
    assert flight.attrs["energy_audit"] < 1e-7  # fourth order at 400 steps a beat: below 1e-8
    moved = np.ptp(flight.q.sel(dof=[robot.dof_names[i] for i in robot.actuated]).values, axis=0)
    assert (moved.max() > 0.2) == (robot.cruise.frequency is not None)  # rad: it flaps
    told = {"aerobat-beta": "Its flight is not steady", "hawk": "It sinks"}  # one tumbles later
    warnings = flight_summary(flight)["warnings"]
    assert [told[name] in w for w in warnings] == ([True] if name in told else [])
    assert all(w in err for w in warnings)


def test_the_summary_sees_what_is_wrong():
    """A glider on its side, and one that is thrown backwards."""
    robot = pt.load_robot("hawk").with_attitude("quaternion")
    aero, gait = pt.QuasiSteady(robot), pt.gaits.still(robot)
    start = dict(q=robot.coordinates(roll=2.0), v=robot.velocities(x=2.0))
    flight = pt.simulate(robot, aero, gait, duration=0.5, time_step=1e-3, **start)
    found = flight_summary(flight)
    words = " ".join(found["warnings"])
    assert "tumbles: roll reaches" in words and "sinks" in words
    thrown = robot.velocities(x=-9.0)
    back = pt.simulate(robot, aero, gait, duration=0.1, time_step=1e-3, v=thrown)
    assert "backwards" in flight_summary(back)["warnings"][0]
    fast = dict(q=robot.coordinates(pitch=0.19), v=robot.velocities(x=9.2))
    raised = pt.gaits.still(robot, elevation=0.242)
    pulled = pt.simulate(robot, aero, raised, duration=1.0, time_step=1e-3, **fast)
    (slowing,) = flight_summary(pulled)["warnings"]  # it pulls up and stalls; sinks by 9 cm
    assert slowing.startswith("Its flight is not steady: the air carries 5")
    assert found["height_change"] == flight.q.values[-1, 2]
    np.testing.assert_allclose(found["roll"][1], 2.0, atol=0.5)
    half = np.trapezoid(flight.strip_force.sel(axis="z").sum("strip").values[250:]) / 250
    assert found["force_over_weight"] == pytest.approx(half / (0.28 * 9.81), rel=1e-12)


def test_the_summary_says_that_water_carries_nothing():
    robot = pt.load_robot("hawk")
    sea = pt.QuasiSteady(robot, pt.Air(density=1000.0))
    flight = pt.simulate(robot, sea, pt.gaits.still(robot), duration=0.01, time_step=1e-3)
    assert any(w.startswith("Buoyancy is not modeled") for w in flight_summary(flight)["warnings"])


def test_the_summary_tells_what_no_actuator_has():
    robot = pt.load_robot("ornithopter")
    flight = pt.simulate(
        robot, pt.QuasiSteady(robot), pt.gaits.cruise(robot), duration=0.5, time_step=1e-3,
        v=robot.velocities(x=4.5),
    )  # fmt: skip
    assert not flight_summary(flight)["warnings"]
    place = robot.index("left_plunge")
    torque = np.abs(flight.u1.values[:, place])
    power = np.abs(flight.u1.values * flight.v.values)[:, place]
    for limit, values, unit in (("effort", torque, "N m"), ("power", power, "W")):
        text = robot.source.replace(
            "60 deg]}", f"60 deg], {limit}_limit: {0.7 * values.max()}}}", 1
        )
        weak = flight.assign_attrs(robot=load_robot_text(text).source)
        (left, right) = flight_summary(weak)["warnings"]
        assert left.startswith(f"left_plunge needs {values.max():.3g} {unit} of {limit} at ")
        assert right.startswith("right_plunge") and f"but has {0.7 * values.max():.3g}" in left


def test_units_stand_in_every_row(tmp_path, capsys):
    words = ("simulate", "hawk", "--duration", "0.2", "-o", tmp_path / "flight.nc")
    code, out, _ = say(capsys, *words)
    assert code == 0
    rows = [
        line for line in out.splitlines() if any(k in line for k in ("audit", "speed", "climb"))
    ]
    assert len(rows) >= 5 and all("[" in row for row in rows)
    facts = json.loads(say(capsys, *words, "--json")[1])
    assert facts["speed"] > 1 and facts["pitch"][0] < facts["pitch"][1]


def test_a_broken_run_leaves_the_good_file(tmp_path, capsys):
    path = tmp_path / "flight.nc"
    assert say(capsys, "simulate", "hawk", "--duration", "0.1", "-o", path)[0] == 0
    before = path.read_bytes()
    code, out, err = say(capsys, "simulate", "aerobat", "--time-step", "1e-2", "-o", path)
    assert code == 2 and "flight.partial.nc" in err
    assert f"duration {pt.load_robot('aerobat').cruise.duration:g} s" in err  # not that reached
    assert path.read_bytes() == before
    assert pt.load_flight(tmp_path / "flight.partial.nc").attrs["outcome"] != "COMPLETED"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("verb", ["simulate", "fly"])
def test_an_interrupted_flight_is_kept_up_to_there(verb, number, tmp_path, capsys, monkeypatch):
    path = tmp_path / "flight.nc"
    path.write_bytes(b"of before")

    @contextmanager
    def bar(label):
        yield lambda done, total: signal.raise_signal(number) if done > 0.3 * total else None

    monkeypatch.setattr(import_module(f"patagium.cli.{verb}"), "progress_bar", bar)
    words = (verb, "ornithopter", "--duration", "4", "-o", path)
    code, _, err = say(capsys, *words)
    assert code == 130 and err.endswith("is kept in " + str(tmp_path / "flight.partial.nc") + "\n")
    assert "interrupted; run it again from the start, or for a shorter time; the flight" in err
    assert path.read_bytes() == b"of before"
    kept = pt.load_flight(tmp_path / "flight.partial.nc")
    assert kept.attrs["outcome"] == "INTERRUPTED" and 1.2 < kept["time"].values[-1] < 4.0
    kept.close()
    # the advice was to start again "for the rest", and the flight so far was replaced silently
    assert say(capsys, *words).err.endswith("flight.partial.nc, in place of an earlier one\n")


def test_progress_that_is_interrupted_ends_the_flight_between_steps():
    robot = pt.load_robot("hawk")

    def flown(progress=None):
        return pt.simulate(
            robot, pt.QuasiSteady(robot), pt.gaits.cruise(robot), duration=2.0, time_step=2e-4,
            throw=False, progress=progress,
        )  # fmt: skip

    def tell(done, total):
        if done > total // 2:
            raise Interrupted

    whole, half = flown(), flown(tell)
    assert half.attrs["outcome"] == "INTERRUPTED"
    assert half.sizes["time"] < whole.sizes["time"]
    for name in ("q", "v", "aero_force"):
        same = whole[name].isel(time=slice(half.sizes["time"]))
        np.testing.assert_array_equal(half[name], same)


def test_the_chosen_step_is_tidy_and_divides_the_duration():
    for duration, most, expected in (
        (2.0, 2e-4, 2e-4), (2.0, 3.7e-4, 2e-4), (1.0, 9.99e-4, 5e-4), (0.333, 1e-3, 1e-3),
        (0.3331, 1e-3, 0.3331 / 334),
    ):  # fmt: skip
        assert tidy_step(duration, most) == pytest.approx(expected, rel=1e-12)


@pytest.mark.usefixtures("interpreted")
def test_a_short_gust_gets_a_step_that_meets_it():
    """Half a millisecond and shorter was passed over: no wind was recorded."""
    robot = pt.load_robot("yeo-wing")
    gait = pt.gaits.sinusoidal(robot, frequency=3.3, **{robot.dof_names[0]: 0.4})
    for length, steps in ((0.1, 100), (4e-4, 2500)):
        pulse = pt.air.OneMinusCosineGust((0.0, 0.0, 5.0), 0.01, length)
        for gust in (pulse, pt.air.TravelingGust(pulse, (0.0, 1.0, 0.0), speed=1e3)):
            aero = pt.QuasiSteady(robot, pt.Air(gust=gust))
            flight = pt.simulate(robot, aero, gait, duration=0.05)
            assert flight.sizes["time"] - 1 == steps
        at_once = pt.simulate(robot, pt.QuasiSteady(robot, pt.Air(gust=pulse)), gait, duration=0.05)
        # a share of sin(pi/40)^2 at most is missed between steps of a twentieth
        assert at_once["wind"].max() > 4.9 or length == 0.1


def test_a_stiff_robot_gets_a_step_that_holds():
    """A damper that answers fifty times as fast takes a shorter step, and it is chosen."""
    robot = pt.load_robot("aerobat")
    damper = {"pitch.damping": 50 * 0.05}
    stiff = robot.with_parameters(damper)
    gait = pt.gaits.sinusoidal(stiff, frequency=1.0, plunge=0.3)
    flight = pt.simulate(stiff, pt.QuasiSteady(stiff), gait, duration=0.02)
    soft = pt.simulate(robot, pt.QuasiSteady(robot), gait, duration=0.02)
    assert flight.attrs["outcome"] == "COMPLETED"
    assert flight.attrs["time_step"] < 0.1 * soft.attrs["time_step"]


def test_a_cruise_that_cannot_be_is_refused():
    text = pt.load_robot("hawk").source
    cut = text.index("cruise:")
    for cruise, place in (
        ("{amplitude: {sweep: 0.1}}", "cruise"),
        ("{frequency: 0, amplitude: {sweep: 0.1}}", "cruise.frequency"),
        ("{frequency: 5, amplitude: {flap: 0.1}}", "cruise.amplitude.flap"),
        ("{speed: 3 kg}", "cruise.speed"),
        ("{height: 3}", "cruise.height"),
    ):
        with pytest.raises(RobotFileError, match=place):
            pt.robot.files.load_robot_text(f"{text[:cut]}cruise: {cruise}\n", "own")
    bare = pt.robot.files.load_robot_text(text[:cut], "own")
    with pytest.raises(ParameterError, match="a section cruise"):
        pt.gaits.cruise(bare)


def test_numbers_and_names_beyond_sense_are_refused(tmp_path, capsys):
    path = tmp_path / "flight.nc"
    assert say(capsys, "simulate", "hawk", "--duration", "0.1", "-o", path)[0] == 0
    code, _, err = say(capsys, "cycles", path, "--period", "0.02 s", "--skip", "9" * 18)
    assert code == 2 and "0 to a million wingbeats" in err
    code, _, err = say(capsys, "cycles", path, "--period", "0.02 s", "--skip", "9" * 19)
    assert code == 2 and "a whole number below 2^63" in err
    page = tmp_path / "view.html"
    assert say(capsys, "view", path, "-o", page, "--title", "\udcff")[0] == 0
    assert "<title>?" in page.read_text("utf-8")

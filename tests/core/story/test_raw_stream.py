"""What a robot has, learned while it flies: raw samples of sensors, with their noise."""

from __future__ import annotations

import json
import re
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.arrays import Array
from patagium.cli.main import run
from patagium.cli.stream import _opened
from patagium.errors import LogError, ParameterError
from patagium.live.loop import Counters, Status, follow, summary
from patagium.live.packets import DatagramPackets, Intake, TextPackets, send_packets
from patagium.live.pipeline import Pipeline
from patagium.live.raw_sensors import LAG, MotionPackets, sensor_rows, sensors_text
from patagium.live.record import StreamFile
from patagium.live.sources import DatagramSource, PacketQueue, source_of, start_reading
from patagium.sensing.force.air_force import packet_columns
from patagium.sensing.force.flown_force import motion_and_force
from patagium.sensing.force.measured_force import motor_forces
from patagium.sensing.motion.sensor_streams import streams_of

P = pt.sensors.presets
LIVELY = ("x", "z", "pitch", "left_plunge", "right_plunge", "left_feather")


@pytest.fixture(scope="module")
def robot() -> pt.Robot:
    return pt.load_robot("aerobat")


@pytest.fixture(scope="module")
def flight(robot: pt.Robot) -> xr.Dataset:
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    aero, start = pt.QuasiSteady(robot, pt.Air()), robot.coordinates(x=3.0)
    return pt.simulate(robot, aero, gait, duration=1.7, time_step=5e-4, v=start)


@pytest.fixture(scope="module")
def log(flight: xr.Dataset) -> pt.sensing.SensorLog:
    """Log with the noise, delay and steps of data sheets."""
    motors = P.ina226(torque_constant=5e-3, gear_ratio=20.0, rate=500.0)
    units = (P.icm_42688_p("body", 500.0), P.as5600(rate=500.0), P.prime_x_13("body"), motors)
    return pt.sense(flight, units, seed=0).without_truth()


@pytest.fixture(scope="module")
def record(log: pt.sensing.SensorLog, robot: pt.Robot, tmp_path_factory: pytest.TempPathFactory):
    """Record and summary of a stream that heard the log over loopback, in the flight's own time."""
    source = DatagramSource(57, "127.0.0.1", 0, idle=2.0)
    pipeline = Pipeline(pt.learning.default_learner(robot), robot)
    queue, stop = PacketQueue(8000, 57, Intake(), robot), threading.Event()
    status, path = Status(Counters(14, 500.0)), tmp_path_factory.mktemp("raw") / "stream.nc"
    words = {"target": ("127.0.0.1", source.port)}
    sender = threading.Thread(target=send_packets, args=(log,), kwargs=words)
    reader = start_reading(source, queue, stop)
    sender.start()
    sink = StreamFile(path, pipeline)
    follow(queue, pipeline, status, stop, sinks=[sink])
    sender.join()
    reader.join(5.0)
    facts = summary(status, queue, pipeline)
    sink.close(facts)
    with xr.open_dataset(path) as kept:
        return kept.load(), facts, queue.motion


@pytest.fixture(scope="module")
def whole(log: pt.sensing.SensorLog):
    """Motion and force that the whole log tells."""
    return motion_and_force(log, shifts={"icm_42688_p": 0.0, "prime_x_13": 4.2e-3})


def test_its_forces_are_those_of_the_whole_log(
    record, whole, log: pt.sensing.SensorLog, robot: pt.Robot
) -> None:
    kept, facts, motion = record
    assert facts["lost"] == facts["dropped"] == facts["bad_rows"] == facts["failed"] == 0
    assert facts["received"] == len(sensor_rows(log))
    assert facts["samples"] == facts["learned"] > 800  # of 850 at 500 Hz
    time = kept["time"].values
    inner = (time > 0.1) & (time < 1.6)
    apart = {}
    for name in LIVELY:
        k = robot.index(name)
        other = np.interp(time, whole[1].time, whole[1].force[:, k])
        error = (kept["measurement"].values[:, k] - other)[inner]
        apart[name] = (error**2).mean() / other[inner].var()
    # 20 ms of later samples tell nearly all; with none the vertical force errs by 3 %
    assert max(apart.values()) < 0.02 and apart["z"] < 1e-3
    assert facts["coverage_in_all"] == pytest.approx(0.95, abs=0.03)
    said = " ".join(motion.notes)
    assert "icm_42688_p (Imu, 500 Hz)" in said and f"{1e3 * LAG:g} ms behind" in said
    assert "prime_x_13 4." in said  # ms: the delay on its sheet is 4.2


def test_a_sensor_log_and_a_text_are_read_like_datagrams(
    log: pt.sensing.SensorLog, record, tmp_path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, again = pt.sensing.save_sensor_log(log, tmp_path / "log.nc"), tmp_path / "again.nc"
    with pytest.raises(SystemExit) as left:
        run(["stream", str(file), "--robot", "aerobat", "--json", "--record", str(again)])
    assert left.value.code == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["samples"] == record[1]["samples"]
    with xr.open_dataset(again) as other:  # whether rows come one by one or in long blocks
        for name in ("time", "q", "a", "u1"):
            np.testing.assert_array_equal(other[name], record[0][name])
    assert f"Reading {file}" in said.err and "Raw sensors: icm_42688_p" in said.err
    robot, rows = log.robot, sensor_rows(log)
    queue = PacketQueue(10, 57, Intake(), robot)
    reader = TextPackets([c.name for c in packet_columns(robot)], queue.intake, queue.describe)
    motion = MotionPackets(robot, sensors_text(log))
    names = ",".join(motion.columns)
    lines = [",".join("" if np.isnan(k) else repr(k) for k in row) for row in rows[:5].tolist()]
    text = "\n".join([f"# sensors {sensors_text(log)}", names, *lines, ""])
    np.testing.assert_array_equal(reader.take(text.encode()), rows[:5])


@pytest.mark.parametrize("named", [True, False])
def test_an_imported_log_of_sensors_is_read_as_raw_samples(
    robot: pt.Robot, tmp_path: Path, named: bool
) -> None:
    """`stream` asked an imported log for q, v, a and u1, which `send` and UDP did not."""
    times = np.arange(300) / 300.0
    rows = np.column_stack([times, 0.4 * np.sin(31 * times), -0.4 * np.sin(31 * times)])
    joints, columns = ("left_plunge", "right_plunge"), [c.name for c in packet_columns(robot)]
    names = ",".join(["t", *joints])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=names, comments="")
    words = "".join(f"\n- {{column: {name}, unit: rad}}" for name in joints)
    words = f"time: {{column: t, unit: s}}\nchannels:{words}\n" + "robot: aerobat\n" * named
    (tmp_path / "map.yaml").write_text(words)
    file = pt.import_log(tmp_path / "log.csv", tmp_path / "map.yaml", tmp_path / "log.nc").path
    queue = PacketQueue(1000, len(columns), Intake(), robot)
    source_of(str(file), columns, robot=None if named else robot).read(queue, threading.Event())
    assert queue.motion is not None and queue.intake.received == 300
    assert queue.motion.columns == ("time", *(f"encoders.position.{name}" for name in joints))


def test_forces_that_nothing_measures_are_missing(
    log: pt.sensing.SensorLog, robot: pt.Robot
) -> None:
    kept = {name: reading for name, reading in log.readings.items() if name != "ina226"}
    motion = MotionPackets(robot, sensors_text(replace(log, readings=kept)))
    motion.take(sensor_rows(replace(log, readings=kept)), 4)
    torque = motion.take(None, 4)[:, -robot.dof :]
    driven = np.isin(np.arange(robot.dof), robot.actuated)
    assert np.isnan(torque[:, driven]).all() and (torque[:, ~driven] == 0).all()
    assert "No force is learned of left_plunge" in motion.notes[-1]
    held = MotionPackets(robot, sensors_text(replace(log, mount="rig")))
    assert held._torque.unknown[:6].all()


@pytest.fixture(scope="module")
def limited(log: pt.sensing.SensorLog) -> pt.sensing.SensorLog:
    """Log in which a third of the currents is at the limit of their sensor."""
    current = log["ina226"]["current"]
    largest = float(np.quantile(np.abs(current), 0.67))
    cut = {**log.readings, "ina226": log["ina226"].assign(current=current.clip(-largest, largest))}
    sensors = {**log.sensors, "ina226": replace(log.sensors["ina226"], range=largest)}
    return replace(log, readings=cut, sensors=sensors)


SATURATED = "ina226: .*% of the samples .* reach the end of its range"


def test_saturated_currents_are_missing_and_told_in_a_log(
    log: pt.sensing.SensorLog, limited: pt.sensing.SensorLog, whole
) -> None:
    assert re.search(SATURATED, limited.saturated()["ina226"]) and not log.saturated()
    joint = log.robot.index("left_plunge")
    found, true = (motor_forces(one, whole[0], "ina226") for one in (limited, log))
    error = np.abs(found.values - true.values)[:, joint]
    assert np.mean(error < 2 * np.sqrt(found.variance[:, joint])) > 0.9  # not certain of a guess


def test_a_stream_undoes_the_low_pass_of_currents(
    log: pt.sensing.SensorLog, flight: xr.Dataset, robot: pt.Robot
) -> None:
    """The delay of the sensor's low-pass stayed in the torques: 3 ms, 1 % of their variance."""
    slow = replace(log.sensors["ina226"], bandwidth=50.0)
    readings = {**log.readings, **pt.sense(flight, [slow]).readings}
    slower = replace(log, readings=readings, sensors={**log.sensors, "ina226": slow})
    packets = MotionPackets(robot, sensors_text(slower)).take(
        sensor_rows(slower.without_truth()), 800
    )
    joint = robot.index("left_plunge")
    true = np.interp(packets[:, 0], flight["time"], flight["u1"][:, joint])[100:]
    error = packets[100:, 1 + 3 * robot.dof + joint] - true
    assert np.mean(error**2) < 1e-3 * true.var()


def test_a_stream_leaves_out_saturated_currents_and_believes_a_clock_that_went_back(
    limited: pt.sensing.SensorLog, robot: pt.Robot
) -> None:
    motion, rows = MotionPackets(robot, sensors_text(limited)), sensor_rows(limited)
    packets = motion.take(rows, 2000)
    torque = packets[:, 1 + 3 * robot.dof + robot.index("left_plunge")]
    largest = 0.1 * limited.sensors["ina226"].range  # A times 0.1 N m/A
    assert np.nanmax(np.abs(torque)) < largest and 0.1 < np.isnan(torque).mean() < 0.9
    assert motion.counts["out_of_range"] > 200 and motion.counts["late"] == 0
    assert re.search(SATURATED, " ".join(motion.notes))
    again = rows[: len(rows) // 2]
    after = motion.take(again, 2000)
    assert len(after) > 350 and after[-1, 0] == pytest.approx(again[-1, 0], abs=0.05)
    assert np.abs(after[:, 1:4]).max() < 100.0
    assert 9 <= motion.counts["late"] < 15  # rows, those of cameras alone too
    assert motion.counts["clock_resets"] == 1 and motion.counts["lost_tracks"] == 0
    motion._most = np.zeros((3, robot.dof))  # nothing is near enough
    assert not len(motion.take(rows[len(again) :], 2000)) and motion.counts["lost_tracks"] > 0


def test_a_clock_that_goes_back_costs_nothing_that_waits(
    log: pt.sensing.SensorLog, robot: pt.Robot
) -> None:
    """Samples before the reset were lost, as many as the block of rows held."""
    rows, half = sensor_rows(log), len(sensor_rows(log)) * 3 // 4
    rows[half:, 0] -= 1.0
    found = []
    for size in (1, 512):
        motion, made = MotionPackets(robot, sensors_text(log)), []
        for block in [rows[k : k + size] for k in range(0, len(rows), size)]:
            made.append(motion.take(block, 9999))
        made.append(motion.take(None, 9999))
        found.append(np.concatenate(made)[:, 0])
        assert motion.counts["clock_resets"] == 1
    np.testing.assert_array_equal(*found)
    assert found[0].max() == pytest.approx(rows[half - 1, 0], abs=0.01)


def apart(motion: MotionPackets, rows: Array, sensor: str) -> tuple[Array, Array]:
    """Rows in two: what a sensor says at each stamp, and all else."""
    own = [name.startswith(sensor) for name in motion.columns]
    alone, others = rows.copy(), rows.copy()
    alone[:, ~np.array([True, *own[1:]])] = np.nan
    others[:, own] = np.nan
    return alone, others


def with_clock_set(motion: MotionPackets, rows: Array, sensors, by: float, at: float) -> Array:
    """Rows of raw sensors in order of arrival; at a moment [s] their clock is set by a time [s]."""
    for sensor in sensors:
        alone, others = apart(motion, rows, sensor)
        alone[rows[:, 0] > at, 0] += by
        rows = np.stack([alone, others], axis=1).reshape(-1, rows.shape[1])
        rows = rows[np.isfinite(rows[:, 1:]).any(axis=1)]
    return rows


def test_the_clock_of_one_sensor_that_is_set_ends_no_learning(
    log: pt.sensing.SensorLog, flight: xr.Dataset, robot: pt.Robot
) -> None:
    """A sensor whose clock was set ended learning: its samples were out of the tracker's time."""
    motion, made = MotionPackets(robot, sensors_text(log)), []
    rows = with_clock_set(motion, sensor_rows(log), ["prime_x_13"], -1.1, 1.1)
    for block in [rows[k : k + 300] for k in range(0, len(rows), 300)]:
        made.append(motion.take(block, 9999))
    packets = np.concatenate([*made, motion.take(None, 9999)])
    assert len(packets) > 840 and (np.diff(packets[:, 0]) > 0).all()  # of 850 at 500 Hz
    assert re.search(r"prime_x_13 went back by 1\.[01]\d* s at 1\.1", " ".join(motion.notes))
    assert (motion.counts["clock_resets"], motion.counts["silences"]) == (1, 0)
    found = motion._set["prime_x_13"] + motion._shifts["prime_x_13"]
    assert found == pytest.approx(-1.1 + 4.2e-3, abs=1e-3)  # s, where a step is 4 ms
    late = packets[(packets[:, 0] > 1.2) & (packets[:, 0] < 1.65)]
    for name in ("z", "pitch"):
        k = robot.index(name)
        true = np.interp(late[:, 0], flight["time"], flight["a"][:, k])
        error = late[:, 1 + 2 * robot.dof + k] - true
        assert np.mean(error**2) < 0.03 * true.var()  # .001 and .007 with a clock that runs on


@pytest.mark.parametrize(
    ("sensors", "by"),
    [
        (["icm_42688_p"], 100.0),
        (["prime_x_13"], 0.2),
        (["as5600", "icm_42688_p", "ina226"], -0.5),
        (["ina226"], -0.1),
    ],
)
def test_a_clock_that_is_set_back_or_ahead_is_told_from_the_others(
    log: pt.sensing.SensorLog, robot: pt.Robot, sensors: list[str], by: float
) -> None:
    motion, rows = MotionPackets(robot, sensors_text(log)), sensor_rows(log)
    for row in with_clock_set(motion, rows, sensors, by, 0.8):
        motion._sort(row)
    assert motion._set == {name: pytest.approx(by, abs=0.005) for name in sensors}  # steps: 4 ms
    assert motion.counts["clock_resets"] == len(sensors)
    assert max(motion._newest.values()) == pytest.approx(rows[-1, 0], abs=0.005)


def test_gaps_and_single_wrong_stamps_set_no_clock(
    log: pt.sensing.SensorLog, robot: pt.Robot
) -> None:
    rows = sensor_rows(log)
    wrong, later = rows.copy(), (rows[:, 0] < 0.5) | (rows[:, 0] > 1.0)
    wrong[600, 0] = 1e9
    motion = MotionPackets(robot, sensors_text(log))
    alone, others = apart(motion, rows, "prime_x_13")
    for given, late in ((rows[later], 5), (wrong, 20), (np.where(later[:, None], rows, others), 0)):
        motion = MotionPackets(robot, sensors_text(log))
        for row in given:
            motion._sort(row)
        assert not motion._set and motion.counts["late"] <= late
        assert set(motion._newest) == {*log.readings}
        assert motion._newest["prime_x_13"] == pytest.approx(rows[-1, 0], abs=0.005)  # a step


def test_raw_samples_that_tell_no_motion_are_warned_of(
    log: pt.sensing.SensorLog,
    robot: pt.Robot,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    motion, rows = MotionPackets(robot, sensors_text(log)), sensor_rows(log)
    for _ in range(3):  # 5.1 s of stamps that stand still
        motion.take(rows * np.r_[0.0, np.ones(rows.shape[1] - 1)], 9)
    assert motion.counts["silences"] == 1 and "nothing is learned" in motion.notes[-1]
    monkeypatch.setattr(MotionPackets, "_follow", lambda self, ended: [])
    file = pt.sensing.save_sensor_log(log, tmp_path / "log.nc")
    with pytest.raises(SystemExit) as left:
        run(["stream", str(file), "--json"])
    said = capsys.readouterr()
    assert left.value.code == 2 and json.loads(said.out)["raw_silences"] == 1
    assert "Warning: no motion was found for 1 s" in said.err


def changed(log: pt.sensing.SensorLog, name: str, change) -> list[str]:
    """Doubts about a log, where the values of a sensor are changed."""
    other = replace(log, readings={**log.readings, name: log[name].map(change)})
    streams = streams_of(other, log.robot, {"prime_x_13": 4.2e-3})
    narrow = replace(log.robot, lower=(-1.0,) * 14, upper=(1.0,) * 14)
    return MotionPackets(narrow, sensors_text(log))._doubts(other, streams)


def test_wrong_units_and_axes_are_doubted(log: pt.sensing.SensorLog) -> None:
    flipped = np.array([1.0, -1.0, -1.0])  # z down
    unit, camera = "icm_42688_p", "prime_x_13"
    assert changed(log, unit, lambda values: values) == []
    for name, change, words in (
        (unit, lambda k: k * flipped, "a body that is carried feels up: check frame"),
        (unit, lambda k: 1e3 * k if k.name == "angular_rate" else k, "is it in deg/s"),
        (camera, lambda k: 1e3 * k if k.name == "position" else k, "is it in mm"),
        ("as5600", np.rad2deg, "q.left_plunge reaches .* is it in degrees"),
    ):
        assert re.search(words, " ".join(changed(log, name, change)))


def test_a_gap_of_a_motor_current_is_no_torque(log: pt.sensing.SensorLog, robot: pt.Robot) -> None:
    motion = MotionPackets(robot, sensors_text(log))
    for stamp in (0.0, 0.002, 0.1, 0.102):
        motion._torque.add("ina226", stamp, np.full(8, 0.5))
    found = motion._torque.at(np.array([0.001, 0.05, 0.101, 0.2]))[:, robot.index("left_plunge")]
    np.testing.assert_allclose(found, [0.05, np.nan, 0.05, np.nan])  # A times 0.1 N m/A


def test_descriptions_that_cannot_be_used_are_refused(
    log: pt.sensing.SensorLog, robot: pt.Robot
) -> None:
    quaternion, text = robot.with_attitude("quaternion"), sensors_text(log)
    with pytest.raises(ParameterError, match="Euler angles for raw sensors"):
        MotionPackets(quaternion, text)
    strange = text.replace('"body": "body"', '"body": "tail"')
    for words, said in (
        (text.replace("Imu", "Gps"), "icm_42688_p: kind: expected one of Imu, Encoder, .*'Gps'"),
        (text.replace('"rate"', '"rte"', 1), "keys of Imu: name, rate, .*did you mean rate"),
        (text.replace('"rate": 500.0, ', "", 1), "icm_42688_p: expected the key rate"),
    ):
        with pytest.raises(LogError, match=said):
            MotionPackets(robot, words)
    for words in ("", "[]", "{}", '{"sensors": 1}', text.replace("Imu", "Gps")):
        with pytest.raises(LogError, match="description of the sensors"):
            MotionPackets(robot, words)
    assert MotionPackets(robot, strange).columns  # where a sensor sits is asked at its first sample
    queue = PacketQueue(10, 57, Intake(), robot)
    reader = DatagramPackets(57, queue.intake, None, queue.describe)
    header = np.array([1.0, -1.0]).astype("<f8").tobytes()
    reader.take(header + b"no text")
    reader.take(header + text.encode())
    assert queue.motion is not None and queue.intake.bad_rows == 1
    reader.take(header + text.replace("500", "501").encode())
    assert "expected those described at first" in queue.intake.examples[-1]
    plain = PacketQueue(10, 57, Intake(received=1), robot)
    with pytest.raises(LogError, match="expected raw rows from the first"):
        plain.describe(text)


def test_a_listener_says_how_to_send(robot: pt.Robot, capsys: pytest.CaptureFixture[str]) -> None:
    packets = _opened("udp://127.0.0.1:0", ["time"], None, None, robot)
    with packets._socket:
        address = packets.address
    said = capsys.readouterr().err
    assert said.startswith(f"Listening at {address} for motion")
    assert said.endswith(f"patagium send flight.nc {address}\n")

"""From a table of poses to motion and forces: by the command line and in Python."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

import patagium as pt
from patagium.cli.main import run
from patagium.errors import LogError, ParameterError

BODY = """
name: brick
gravity: 9.81
bodies:
  body:
    floating: true
    mass: 50 g
    shape: {type: box, size: [10 cm, 6 cm, 4 cm]}
"""
MAPPING = """
time: {column: t, unit: s}
channels:
  - {column: [x, y, z], frame: flu, unit: mm, name: position}
  - {column: [qx, qy, qz, qw], order: xyzw, frame: flu, body: flu, name: attitude}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> Path:
    """A brick that falls through the air while it tumbles, as cameras see it in millimetres."""
    monkeypatch.chdir(tmp_path)
    time = np.arange(200) / 200.0
    place = np.column_stack([time, 0 * time, -0.5 * 4.9 * time**2])  # half the weight is carried
    place += 2e-4 * rng.standard_normal((200, 3))
    turns = Rotation.from_rotvec(np.outer(time, [2.0, 6.0, 1.0]))
    turns = turns * Rotation.from_rotvec(2e-3 * rng.standard_normal((200, 3)))
    table = np.column_stack([time, 1e3 * place, turns.as_quat()])
    header = "t,x,y,z,qx,qy,qz,qw"
    np.savetxt("flight.csv", table, delimiter=",", header=header, comments="")
    Path("brick.yaml").write_text(BODY, "utf-8")
    Path("map.yaml").write_text(MAPPING, "utf-8")
    return tmp_path


def said(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as left:
        run(words)
    captured = capsys.readouterr()
    assert not left.value.code, captured.err
    return captured.out


def test_a_table_becomes_motion_forces_and_a_figure(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["motion", "flight.csv", "--mapping", "map.yaml", "--robot", "brick.yaml"]
    told = said([*words, "--plot", "forces.png"], capsys)
    assert "cameras of body: 200 samples of attitude, position." in told or "position" in told
    assert "The motion is known in 100.0%" in told and "Force of the air" in told
    assert (folder / "forces.png").stat().st_size > 10_000
    with xr.open_dataset("flight-motion.nc") as found:
        lift = found["force"].sel(dof="z").values
        assert found["known"].values.all()
        std = found["force_std"].sel(dof="z").values
    checked = said(["check", "flight-motion.nc"], capsys)
    assert "a motion with forces" in checked and "force [N or N m]" in checked
    expected = 0.05 * (9.81 - 4.9)  # N
    inner = slice(20, -20)
    assert np.abs(lift - expected)[inner].mean() < 2 * std[inner].mean() < 0.1


def test_findings_of_the_import_are_told_and_the_file_has_forces_alone(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("in_m.yaml").write_text(MAPPING.replace("unit: mm", "unit: m"), "utf-8")
    with pytest.raises(SystemExit):
        run(["motion", "flight.csv", "--mapping", "in_m.yaml", "--robot", "brick.yaml"])
    assert "flight.csv: 1 finding(s) when it was imported:\n  position: unit: in m it reaches" in (
        capsys.readouterr().err
    )
    with pytest.raises(SystemExit):
        run(["cycles", "flight-motion.nc"])
    told = capsys.readouterr().err
    assert "flight-motion.nc: expected a simulated flight, found a motion with forces" in told
    with pytest.raises(SystemExit) as left:
        run(["view", "flight-motion.nc"])
    assert left.value.code in (0, None) and Path("flight-motion.html").is_file()
    out = said(["import", "flight.csv", "--map", "map.yaml", "-o", "log.nc"], capsys)
    assert out.endswith("Next: patagium motion --robot ROBOT log.nc\n")


def test_an_import_says_what_motion_lacks(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It said "Next: patagium motion", which refused the log."""
    Path("bird.yaml").write_text(MAPPING + "robot: ornithopter\n", "utf-8")
    with pytest.raises(SystemExit):
        run(["import", "flight.csv", "--map", "bird.yaml", "-o", "log.nc"])
    told = capsys.readouterr()
    assert "patagium motion cannot take it yet: log: expected sensors that see left_" in told.err
    assert told.out.endswith("Next: change bird.yaml, then import again\n")


def test_coordinates_of_a_floating_base_become_cameras(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """q.x, q.y and q.z were taken for one vector, whose attitude was then missing.

    The wind beside them is that of the forces.
    """
    time = np.arange(200) / 200.0
    turns = np.column_stack([0.1 * np.sin(9 * time), 0.2 * np.cos(9 * time), 0.5 * time])
    wind = np.sin(5 * time)
    rows = np.column_stack([time, time, 0 * time, -2.45 * time**2, turns, wind])
    header = "t,x,y,z,roll,pitch,yaw,gust"
    np.savetxt("flight.csv", rows, delimiter=",", header=header, comments="")
    parts = [(name, "m" if name in "xyz" else "rad") for name in header.split(",")[1:-1]]
    words = [f"  - {{column: {name}, unit: {unit}, name: q.{name}}}" for name, unit in parts]
    words.append("  - {column: gust, unit: m/s, name: wind.y}")
    text = "\n".join(["time: {column: t, unit: s}", "robot: brick.yaml", "channels:", *words])
    Path("map.yaml").write_text(text, "utf-8")
    said(["import", "flight.csv", "--map", "map.yaml", "-o", "log.nc"], capsys)
    assert "cameras of body: 200 samples" in said(["motion", "log.nc", "-o", "motion.nc"], capsys)
    air = pt.sensing.ForceSamples.of(pt.load_log("motion.nc")).air
    np.testing.assert_allclose(air.wind_at(time)[:, 1], wind, atol=1e-12)  # digits of the text


def test_an_imported_log_gives_the_same_in_python(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pt.import_log("flight.csv", "map.yaml", "log.nc")
    measured = pt.sensor_log("log.nc", "brick.yaml")
    assert list(measured.sensors) == ["cameras of body"]
    motion = pt.estimate_motion(measured)
    figures = json.loads(said(["motion", "log.nc", "--robot", "brick.yaml", "--json"], capsys))
    assert figures["known"] == 1.0 and figures["stretches"] == []
    noise = {one["part"]: one["std"] for one in figures["noise"]}
    assert noise["position"] == pytest.approx(2e-4, rel=0.2)  # 600 numbers; 0.03 is one deviation
    assert set(noise) == {"position", "attitude"}
    assert noise["attitude"] == pytest.approx(2e-3, rel=0.2)
    rate = motion["v"].sel(dof="x").values
    assert np.abs(rate[20:-20] - 1.0).max() < 0.02  # m/s
    measured = pt.sensing.load_sensor_log(pt.sensing.save_sensor_log(measured, "sensors.nc"))
    again = pt.estimate_motion(measured)
    np.testing.assert_allclose(again["q"].values, motion["q"].values, atol=1e-9)


def test_an_import_at_a_higher_rate_makes_no_new_measurements(folder: Path) -> None:
    """Interpolated samples were taken as measured: deviations were up to 10 times too small."""
    noise = {}
    for rate in (200, 1000):
        words = MAPPING.replace("unit: s}", f"unit: s, rate: {rate} Hz}}")
        Path("map.yaml").write_text(words, "utf-8")
        pt.import_log("flight.csv", "map.yaml", "log.nc")
        measured = pt.sensor_log("log.nc", "brick.yaml")
        assert measured.sensors["cameras of body"].rate == pytest.approx(200.0)
        noise[rate] = json.loads(pt.estimate_motion(measured).attrs["findings"])["noise"]
    assert noise[200][0]["std"] == pytest.approx(noise[1000][0]["std"], rel=1e-3)


def test_no_sensor_is_read_faster_than_it_measured(folder: Path) -> None:
    """Samples at 1.25 times the rate of a sensor, each from the same two, counted as measured."""
    words = MAPPING.replace("unit: s}", "unit: s, rate: 250 Hz}")
    Path("map.yaml").write_text(words, "utf-8")
    pt.import_log("flight.csv", "map.yaml", "log.nc")
    measured = pt.sensor_log("log.nc", "brick.yaml")
    assert measured.sensors["cameras of body"].rate == pytest.approx(125.0)


def test_quantities_find_their_sensor_by_unit_shape_and_name() -> None:
    robot = pt.load_robot("aerobat")
    count, axes = 20, ("time", "axis")
    zeros, still = np.zeros((count, 3)), np.tile([1.0, 0, 0, 0], (count, 1))
    numbers = {name: ("time", np.zeros(count), {"units": "rad"}) for name in robot.dof_names[6:]}
    log = xr.Dataset(
        {
            "attitude": (("time", "quaternion"), still, {"units": "1"}),
            "position": (axes, zeros, {"units": "m"}),
            "left_plate force": (axes, zeros, {"units": "m/s^2"}),
            "spin": (axes, zeros, {"units": "rad/s"}),
            "wind": (axes, zeros, {"units": "m/s"}),
            "u1.left_plunge": ("time", np.zeros(count), {"units": "N m"}),
            **{f"q.{name}": value for name, value in numbers.items()},
        },
        coords={"time": 0.01 * np.arange(count)},
    )
    found = pt.sensor_log(log, robot, bodies={"spin": "left_plate"})
    kinds = {type(sensor).__name__ for sensor in found.sensors.values()}
    assert kinds == {"MotionCapture", "Imu", "Encoder", "MotorCurrent"}
    assert found.sensors["inertial unit of left_plate"].body == "left_plate"  # type: ignore[attr-defined]
    with pytest.raises(LogError, match="left_plate force: expected angular rate of left_plate"):
        pt.sensor_log(log.drop_vars("spin"), robot)
    with pytest.raises(ParameterError, match="bodies: expected quantities among"):
        pt.sensor_log(log, robot, bodies={"gyro": "body"})
    with pytest.raises(LogError, match="expected an attitude with a position"):
        pt.sensor_log(log[["wind"]], robot)
    with pytest.raises(ParameterError, match="robot"):
        pt.sensor_log(log)


def test_a_clamped_robot_needs_no_cameras_and_is_told_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A class of Python was named as what needs none; a rig of encoders is learned."""
    monkeypatch.chdir(tmp_path)
    floating = """
name: rig
gravity: 9.81 m/s^2
bodies:
  stand:
    floating: true
    mass: 200 g
    shape: {type: box, size: [10 cm, 4 cm, 4 cm]}
  wing:
    parent: stand
    joints: [{name: stroke, axis: z}]
    mass: 3 g
    center_of_mass: [0, 7 cm, 0]
    shape: {type: plate, chord: 4 cm, span: 15 cm, thickness: 1 mm}
wings:
  - name: wing
    segments:
      - body: wing
        strips: 4
        stations:
          - {span: 0 cm, leading: 1 cm, trailing: -3 cm, incidence: 30 deg}
          - {span: 15 cm, leading: 1 cm, trailing: -2 cm, incidence: 20 deg}
"""
    Path("free.yaml").write_text(floating, "utf-8")
    Path("rig.yaml").write_text(floating.replace("    floating: true\n", ""), "utf-8")
    robot = pt.load_robot("rig.yaml")
    gait = pt.gaits.sinusoidal(robot, frequency=4.0, stroke=0.8)
    flight = pt.simulate(robot, pt.QuasiSteady(robot), gait, duration=1.0, time_step=1e-3)
    q, u1 = flight.q.sel(dof="stroke").values, flight.u1.sel(dof="stroke").values
    rows = np.column_stack([1e3 * flight.time.values, q, 1e3 * u1])
    np.savetxt("rig.csv", rows, delimiter=",", header="millis,q,u", comments="")
    mapping = """
time: {column: millis, unit: ms}
channels:
  - {column: q, unit: rad, name: q.stroke}
  - {column: u, unit: mN m, name: u1.stroke}
"""
    Path("map.yaml").write_text(mapping, "utf-8")
    words = ["motion", "rig.csv", "--mapping", "map.yaml", "-o", "motion.nc", "--robot"]
    with pytest.raises(SystemExit):
        run([*words, "free.yaml"])
    assert "held leaves out `floating`" in capsys.readouterr().err
    assert said([*words, "rig.yaml"], capsys).endswith("Next: patagium identify motion.nc\n")
    cell = "  - {column: [q, q, q], unit: %s, frame: flu, name: cell.%s}\n"
    both = cell % ("N", "force") + cell % ("N m", "moment")
    Path("cell.yaml").write_text(mapping + both, "utf-8")
    told = said([*words[:3], "cell.yaml", "-o", "cell.nc", "--robot", "rig.yaml"], capsys)
    assert "load cell is not used" in told
    said(["identify", "motion.nc"], capsys)
    pt.save_flight(flight, "flight.nc")
    scores = json.loads(said(["evaluate", "model.json", "flight.nc", "--json"], capsys))
    assert scores["nmse_worst"] < 0.01

"""What sizes and rates of change tell of units and axes."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import patagium as pt
from patagium.sensing.logs.axes import continuous
from patagium.sensing.logs.importing.findings import (
    NO_STAMP,
    Sizes,
    StampSurvey,
    ValueSurvey,
    stamp_findings,
    unit_findings,
)
from patagium.sensing.logs.importing.import_log import import_log
from patagium.sensing.logs.mapping import conversion, parse_mapping

GRAVITY = 9.80665


def guess(unit: str, rms: list[float], largest: float) -> str:
    """What a quantity written in a unit is guessed to be in; sizes as written."""
    factor, si = conversion(unit, None, "it")
    sizes = np.array(rms) * factor
    found = unit_findings("it", Sizes(unit, si, factor, sizes, sizes, largest * factor))
    return found[0].text.rpartition("is it in ")[2].rstrip("?") if found else ""


@pytest.mark.parametrize(
    ("unit", "rms", "largest", "likely"),
    [
        ("m/s^2", [0.1, 0.1, 1.0], 1.4, "g_0"),
        ("m/s^2", [0.5, 0.5, 9.8], 30.0, ""),
        ("m/s^2", [20.0, 30.0, 980.0], 2000.0, "mg_0"),
        ("g_0", [0.5, 0.2, 9.7], 13.0, "m/s^2"),
        ("g_0", [0.1, 0.1, 1.0], 4.0, ""),
        ("m/s^2", [0.1, 0.1, 0.2], 1.0, ""),  # gravity taken out
        ("m/s^2", [1.02], 1.4, "g_0"),  # of one axis
        ("rad/s", [50.0, 20.0, 30.0], 300.0, "deg/s"),
        ("rad/s", [5.0, 2.0, 3.0], 30.0, ""),
        ("deg/s", [0.5, 0.2, 0.3], 3.0, "rad/s"),
        ("deg/s", [50.0, 20.0, 30.0], 300.0, ""),
        ("deg/s", [2395.0], 3386.0, ""),  # asked for what is stated
        ("mm", [1e6], 2e6, ""),
        ("mm/s", [9e5], 1e6, ""),
        ("rad", [20.0], 45.0, "deg"),
        ("rad", [0.5], 1.5, ""),
        ("deg", [0.5], 1.5, "rad"),
        ("m", [1000.0, 200.0, 1500.0], 2000.0, "mm"),
        ("m", [10.0, 2.0, 15.0], 30.0, ""),
        ("mm", [1.0, 0.2, 1.5], 2.0, "m"),
        ("m/s", [900.0], 1500.0, "mm/s"),
        ("N", [1e6], 1e7, ""),
    ],
)
def test_sizes_speak_for_units(unit: str, rms: list[float], largest: float, likely: str) -> None:
    assert guess(unit, rms, largest) == likely


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_joints_in_the_other_unit_of_angles_are_told(unit: str, tmp_path: Path) -> None:
    """Strokes of 4.5 deg passed for 4.5 rad, and of 0.1 rad for 0.1 deg, without a word."""
    t = 0.005 * np.arange(500)
    robot = pt.load_robot("ornithopter")
    joints = [name for k, name in enumerate(robot.dof_names) if k not in robot.floating_dofs]
    for size, told in ((4.5, unit == "rad"), (0.1, unit == "deg"), (40.0, unit == "rad")):
        stroke = size * np.sin(30 * t)
        table = pd.DataFrame({"t": t} | dict.fromkeys(joints, stroke))
        table.to_csv(tmp_path / "log.csv", index=False)
        channels = [{"column": name, "unit": unit, "name": f"q.{name}"} for name in joints]
        words = {"time": {"column": "t"}, "robot": "ornithopter", "channels": channels}
        mapping = parse_mapping(words)
        found = import_log(tmp_path / "log.csv", mapping, tmp_path / "log.nc").findings
        assert any(one.kind == "unit" for one in found) == told, (size, found)


def test_little_motion_is_not_asked_for_its_unit(rng: np.random.Generator, tmp_path: Path) -> None:
    """A joint that moves by a degree beside others in degrees, a robot at rest in millimeters."""
    t = 0.005 * np.arange(500)
    angles = {"left_plunge": 40 * np.sin(30 * t), "left_feather": 1.2 * np.sin(30 * t)}
    place = np.array([3.1, -2.0, 8.4]) + 0.1 * rng.standard_normal((500, 3))
    table = {f"{name} [deg]": values for name, values in angles.items()}
    table |= {f"p.{axis} [mm]": place[:, k] for k, axis in enumerate("xyz")}
    pd.DataFrame({"t [s]": t} | table).to_csv(tmp_path / "log.csv", index=False)
    channels: list[dict[str, Any]] = [{"column": name, "unit": "deg"} for name in angles]
    channels += [
        {"column": [f"p.{axis}" for axis in "xyz"], "unit": "mm", "frame": "flu", "name": "p"}
    ]
    mapping = parse_mapping({"time": {"column": "t", "unit": "s"}, "channels": channels})
    seen = import_log(tmp_path / "log.csv", mapping, tmp_path / "log.nc").findings
    seen += pt.sensing.inspect_log(tmp_path / "log.csv").findings
    assert not [one for one in seen if one.kind == "unit"]


def test_a_gyroscope_at_rest_is_asked_for_degrees_alone(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    force = 0.2 * rng.standard_normal((500, 3)) + [0.0, 0.0, GRAVITY]
    table = np.column_stack([0.005 * np.arange(500), force, 0.3 * rng.standard_normal((500, 3))])
    pd.DataFrame(table, columns=list("tabcxyz")).to_csv(tmp_path / "rest.csv", index=False)
    asked = []
    for unit in ("deg/s", "rad/s"):
        words = {
            "time": {"column": "t", "unit": "s"},
            "channels": [
                {"column": list("abc"), "unit": "m/s^2", "frame": "flu", "name": "force"},
                {"column": list("xyz"), "unit": unit, "frame": "flu", "name": "rate"},
            ],
        }
        mapping = parse_mapping(words)
        found = import_log(tmp_path / "rest.csv", mapping, tmp_path / "rest.nc").findings
        asked.append([one.text.rpartition("is it in ")[2] for one in found if one.kind == "unit"])
    assert asked == [[], ["deg/s?"]]


@pytest.mark.parametrize("frequency", [11.0, 200.0])
def test_fast_rates_of_joints_are_no_doubt_about_their_unit(
    frequency: float, tmp_path: Path
) -> None:
    """A right rate above 40 rad/s was suspected of deg/s, though the angle changed as fast."""
    time, w = np.arange(2000) / (100 * frequency), 2 * np.pi * frequency
    table = {"t": time, "q": np.sin(w * time), "v": w * np.cos(w * time), "l": np.cos(time)}
    pd.DataFrame(table | {"wrong": np.degrees(table["v"])}).to_csv(tmp_path / "it.csv")
    asked = []
    for column in ("v", "wrong"):
        words = {
            "time": {"column": "t", "unit": "s"},
            "inputs": [
                {"column": "q", "unit": "rad", "name": "q.left_plunge"},
                {"column": column, "unit": "rad/s", "name": "v.left_plunge"},
            ],
            "outputs": [{"column": "l", "unit": "N"}],
        }
        log = import_log(tmp_path / "it.csv", parse_mapping(words), tmp_path / "it.nc")
        asked.append([one.text[-8:] for one in log.findings if one.kind == "unit"])
    assert asked == [[], ["n deg/s?"]]


@pytest.mark.parametrize("step", [0.5, 2.0, 5.0])
def test_milliseconds_that_pass_for_seconds_are_asked_for(step: float) -> None:
    stamps = StampSurvey()
    stamps.add((np.arange(100) * step * 1e9).astype(np.int64))
    (found,) = stamp_findings("it", stamps, 3.0, written=True)
    assert found.kind == "unit of time" and "is its unit perhaps ms?" in found.text


def test_stamps_are_counted_alike_in_blocks_and_whole(rng: np.random.Generator) -> None:
    stamps = np.cumsum(rng.integers(0, 4_000_000, 2000))
    stamps[[3, 700]] -= 50_000_000
    stamps[[40, 41, 1500]] = NO_STAMP
    whole, parts = StampSurvey(), StampSurvey()
    kept = whole.add(stamps)
    for piece in np.split(stamps, [1, 2, 3, 41, 700, 701, 1200]):
        parts.add(piece)
    assert (np.diff(stamps[kept]) > 0).all() and kept.sum() == whole.kept
    np.testing.assert_equal(vars(whole), vars(parts))
    assert whole.missing == 3 and whole.backwards >= 2
    assert whole.rows == whole.kept + whole.missing + whole.duplicates + whole.backwards
    steps = np.diff(stamps[kept]) * 1e-9
    assert whole.median == pytest.approx(np.median(steps), rel=0.005)  # width of a bin
    assert whole.gaps(1.8) == pytest.approx((steps > 1.8 * np.median(steps)).sum(), abs=9)
    assert whole.longest == pytest.approx(1e9 * steps.max())


def test_steady_stamps_are_nothing_to_tell() -> None:
    survey = StampSurvey()
    survey.add(np.arange(1000, dtype=np.int64) * 5_000_000)
    assert stamp_findings("imu", survey, 3.0, written=True) == []
    assert survey.median == pytest.approx(0.005, rel=1e-12)


def test_values_are_counted_alike_in_blocks_and_whole(rng: np.random.Generator) -> None:
    values = rng.normal(size=(500, 3)) * [1.0, 1e6, 1e-6] + [0.0, 5e6, 0.0]
    values[::50, 1] = math.nan
    whole, parts = ValueSurvey(3), ValueSurvey(3)
    whole.add(values)
    for piece in np.split(values, [1, 7, 300]):
        parts.add(piece)
    assert whole.missing.tolist() == [0, 10, 0] == parts.missing.tolist()
    for survey in (whole, parts):
        np.testing.assert_allclose(survey.mean, np.nanmean(values, axis=0), rtol=1e-9)
        np.testing.assert_allclose(survey.rms**2, np.nanmean(values**2, axis=0), rtol=1e-12)
        np.testing.assert_array_equal(survey.low, np.nanmin(values, axis=0))
        np.testing.assert_array_equal(survey.high, np.nanmax(values, axis=0))


@pytest.mark.parametrize(
    ("unit", "frame", "words"),
    [("m", "nwu", ""), ("mm", "nwu", "velocity too small by 1000"),
     ("km", "nwu", "velocity too large by 1000"), ("m", "ned", "check frame")],
)  # fmt: skip
def test_a_position_must_move_as_its_velocity_says(
    unit: str, frame: str, words: str, tmp_path: Path
) -> None:
    t = 0.005 * np.arange(2000)
    table: dict[str, Any] = {"t": t}
    for name, phase in (("x", 0.0), ("y", 1.0), ("z", 2.0)):
        table[f"p.{name}"], table[f"v.{name}"] = np.sin(t + phase), np.cos(t + phase)
    path = tmp_path / "log.csv"
    pd.DataFrame(table).to_csv(path, index=False)
    mapping = parse_mapping(
        {
            "time": {"column": "t"},
            "channels": [
                {"column": "p", "frame": "nwu", "unit": "m"},
                {"column": "v", "frame": frame, "unit": f"{unit}/s"},
            ],
        }
    )
    found = [one.text for one in import_log(path, mapping, tmp_path / "log.nc").findings]
    assert any(words in text for text in found) if words else not found, found


def test_sensors_on_turned_frames_of_a_robot_do_not_contradict_each_other(tmp_path: Path) -> None:
    """Each is on a frame of its own: the unit hangs upside down from the body."""
    (tmp_path / "brick.yaml").write_text(
        "{name: brick, gravity: 9.81, bodies: {body: {floating: true, mass: 0.05, shape: {type: "
        "box, size: [0.1, 0.06, 0.04]}}, markers: {parent: body, massless: true}, unit: {parent: "
        "body, at: [0, 0, 0.01], orientation: [180 deg, 0, 0], massless: true}}}"
    )
    t = 0.005 * np.arange(2000)
    yaw, rate = 2 * np.sin(t), 2 * np.cos(t)
    table = {"t": t, "p.x": 0 * t, "p.y": 0 * t, "p.z": 0 * t, "q.w": np.cos(yaw / 2)}
    table |= {"q.x": 0 * t, "q.y": 0 * t, "q.z": np.sin(yaw / 2), "w.x": 0 * t, "w.y": 0 * t}
    table |= {"w.z": -rate, "f.x": 0 * t, "f.y": 0 * t, "f.z": 0 * t - 9.81}
    path = tmp_path / "log.csv"
    pd.DataFrame(table).to_csv(path, index=False)
    channels = [
        {"column": "p", "frame": "nwu", "unit": "m", "name": "markers.position"},
        {"column": "q", "order": "wxyz", "frame": "nwu", "body": "flu", "name": "markers.attitude"},
        {"column": "w", "frame": "flu", "unit": "rad/s", "name": "unit.rate"},
        {"column": "f", "frame": "flu", "unit": "m/s^2", "name": "unit.force"},
    ]
    words = {"time": {"column": "t"}, "robot": str(tmp_path / "brick.yaml"), "channels": channels}
    found = import_log(path, parse_mapping(words), tmp_path / "log.nc").findings
    assert not [one for one in found if one.kind == "axes"], found
    del words["robot"]
    found = import_log(path, parse_mapping(words), tmp_path / "log.nc").findings
    assert len([one for one in found if one.kind == "axes"]) == 2, found


def _flown(heading: float, *, banked: float = 0.0) -> tuple[np.ndarray, Rotation, np.ndarray]:
    """Position, attitude and time of a robot whose nose is on its course, with a wingbeat."""
    t = np.arange(0.0, 3.0, 0.005)
    turned = heading + banked * 9.80665 / 4.0 * t  # rad, at 4 m/s
    course = np.column_stack([np.cos(turned), np.sin(turned), 0.0 * t])
    place = np.cumsum(4.0 * 0.005 * course, axis=0)
    pitch = -0.2 + 0.1 * np.sin(2 * np.pi * 6 * t)
    level = Rotation.from_euler("ZX", np.column_stack([turned, 0 * t - np.arctan(banked)]))
    return place, level * Rotation.from_euler("y", pitch[:, None]), t


def _thrown(heading: float) -> tuple[np.ndarray, Rotation, np.ndarray]:
    """Position, attitude and time of a body that tumbles freely, by Euler's equations."""
    t, inertia = np.arange(0.0, 1.2, 0.005), np.array([1.0, 2.0, 2.8])
    rate, turn, turns = np.array([1.0, 5.0, 3.0]), Rotation.from_euler("z", heading), []
    for k in range(10 * len(t)):
        if k % 10 == 0:
            turns.append(turn)
        rate = rate - 5e-4 * np.cross(rate, inertia * rate) / inertia
        turn = turn * Rotation.from_rotvec(5e-4 * rate)
    place = np.column_stack([2 * t, 0.5 * t, 5 * t - 0.5 * 9.80665 * t**2])
    return place, Rotation.concatenate(turns), t


@pytest.mark.parametrize(
    ("fault", "kind", "words"),
    [
        ("", "", ""),
        ("10 deg", "", ""),  # less than the 15 deg of the documents
        ("world", "axes", "turned by 4"),  # by the heading of 40 deg
        ("ypr", "axes", "turned by"),
        ("ms", "unit", "are the stamps in s, not in ms?"),
    ],
)
@pytest.mark.parametrize("rows", [100, 600])
def test_rates_that_are_turned_from_the_attitude_are_told(
    rows: int, fault: str, kind: str, words: str, rng: np.random.Generator, tmp_path: Path
) -> None:
    """Pitch of flapping hid a turn by 40 deg, and logs below half a second were passed over."""
    _, turn, t = _flown(0.7, banked=0.02)
    step = (turn[:-1].inv() * turn[1:]).as_rotvec() / 0.005
    rate = (step + np.vstack([step[1:], step[-1:]])) / 2  # at the later sample, to second order
    turn, t = turn[1 : rows + 1], t[1 : rows + 1]
    rate = (turn.apply(rate[: len(t)]) if fault == "world" else rate[: len(t)]) + 2e-3  # a bias
    if fault == "10 deg":
        rate = Rotation.from_euler("z", 10, degrees=True).apply(rate)
    seen = turn * Rotation.from_rotvec(1e-4 * rng.normal(size=(len(t), 3)))
    angles = seen.as_euler("ZYX", degrees=True)[:, :: 1 if fault == "ypr" else -1]
    table = pd.DataFrame(np.column_stack([t, angles, rate]), columns=["t", *"abc", *"xyz"])
    table.to_csv(tmp_path / "log.csv", index=False)
    attitude = {"column": [*"abc"], "order": "rpy", "unit": "deg", "frame": "nwu", "body": "flu"}
    gyro = {"column": [*"xyz"], "unit": "rad/s", "frame": "flu", "name": "rate"}
    channels = [attitude | {"name": "attitude"}, gyro]
    time = {"column": "t", "unit": "ms" if fault == "ms" else "s"}
    mapping = parse_mapping({"time": time, "channels": channels})
    found = import_log(tmp_path / "log.csv", mapping, tmp_path / "log.nc").findings
    told = [one for one in found if one.level == "warning" and one.kind in ("unit", "axes")]
    assert [one.kind for one in told] == [kind] * bool(kind), told
    assert all(words in one.text for one in told), told


@pytest.mark.parametrize("heading", [0.0, 1.0, np.pi])
@pytest.mark.parametrize("motion", ["level", "turning", "thrown"])
def test_an_attitude_in_another_order_than_stated_is_told(
    motion: str, heading: float, rng: np.random.Generator, tmp_path: Path
) -> None:
    """Its error was 120 to 180 deg, or 10 to 60 deg of angles, without a word."""
    place, turn, t = (
        _thrown(heading) if motion == "thrown" else _flown(heading, banked=float(motion != "level"))
    )
    place = place + 2e-4 * rng.normal(size=place.shape)
    turn = turn * Rotation.from_rotvec(2e-3 * rng.normal(size=(len(t), 3)))
    quaternion = continuous(turn.as_quat())
    written = {
        "xyzw": quaternion,
        "wxyz": quaternion[:, [3, 0, 1, 2]],
        "rpy": np.degrees(turn.as_euler("ZYX")[:, ::-1]),
        "rotvec": np.degrees(turn.as_rotvec()),
    }
    wrong = {"xyzw": "wxyz", "wxyz": "xyzw", "rpy": "rotvec", "rotvec": "rpy"}
    for order, values in written.items():
        names = [f"c{k}" for k in range(values.shape[1])]
        table = pd.DataFrame(np.column_stack([t, place, values]), columns=["t", *"XYZ", *names])
        table.to_csv(tmp_path / "log.csv", index=False)
        for stated in (order, wrong[order]):
            attitude = {"column": names, "order": stated, "frame": "nwu", "body": "flu"}
            attitude |= {"name": "attitude"} | ({"unit": "deg"} if len(names) == 3 else {})
            position = {"column": list("XYZ"), "frame": "nwu", "unit": "m", "name": "position"}
            mapping = parse_mapping({"time": {"column": "t"}, "channels": [position, attitude]})
            found = import_log(tmp_path / "log.csv", mapping, tmp_path / "log.nc").findings
            told = [one.text for one in found if one.kind == "axes"]
            alike = len(names) == 3 and motion == "level" and heading in (0.0, np.pi)
            if stated == order:
                assert not told, (order, told)
            elif not alike:  # angles about one axis alone are a rotation vector
                assert f"was it written as {order}?" in told[0], (order, told)

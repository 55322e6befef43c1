"""Logs of other programs, brought to SI, our axes and one time base."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from patagium.cli.import_log import _verbs
from patagium.cli.main import run
from patagium.errors import LogError
from patagium.sensing.logs.files.message_files import unit_in_message
from patagium.sensing.logs.importing.findings import Finding
from patagium.sensing.logs.importing.import_log import Imported, import_log
from patagium.sensing.logs.importing.inspection import inspect_log
from patagium.sensing.logs.mapping import TableMapping, parse_mapping
from patagium.sensing.logs.record import LogRecord, load_log

DATA = Path(__file__).parents[3].parent / "shared" / "data"

IMU: dict[str, Any] = {
    "time": {"rate": "100 Hz"},
    "channels": [
        {"topic": "/imu", "field": "orientation", "order": "xyzw", "frame": "nwu", "body": "flu",
         "name": "attitude"},
        {"topic": "/imu", "field": "angular_velocity", "frame": "flu", "unit": "rad/s",
         "name": "rate"},
        {"topic": "/imu", "field": "linear_acceleration", "frame": "flu", "unit": "m/s^2",
         "name": "force"},
        {"topic": "/velocity", "field": "twist.linear", "frame": "nwu", "unit": "m/s",
         "name": "velocity"},
        {"topic": "/joints", "field": "position[left_plunge]", "unit": "rad", "name": "plunge"},
        {"topic": "/levels", "field": "data[2]", "unit": "1", "name": "level"},
    ],
}  # fmt: skip


def mapping(words: dict[str, Any] = IMU, **time: Any) -> TableMapping:
    return parse_mapping({**words, "time": {**words.get("time", {}), **time}})


def changed(name: str, **change: Any) -> TableMapping:
    channels = [{**one, **(change if one["name"] == name else {})} for one in IMU["channels"]]
    return parse_mapping({**IMU, "channels": channels})


def warnings(found: Imported) -> list[Finding]:
    return [one for one in found.findings if one.level == "warning"]


def check_motion(path: Path, recordings: Any) -> None:
    log = load_log(path)
    t = log["time"].to_numpy() + 0.0
    assert log.sizes["time"] > 250
    roll = 2 * np.arctan2(log["attitude"].to_numpy()[:, 1], log["attitude"].to_numpy()[:, 0])
    # linear between samples 10 ms apart: errors of 1e-4; the start is the first common stamp
    np.testing.assert_allclose(roll, [recordings.roll(s) for s in t], atol=1e-4)
    climb = log["velocity"].to_numpy()[:, 2]
    np.testing.assert_allclose(climb, [recordings.climb(s) for s in t], atol=1e-4)
    np.testing.assert_allclose(log["plunge"].to_numpy(), 0.6 * np.sin(30 * t), atol=0.01)


@pytest.mark.parametrize(
    ("storage", "compression"),
    [("sqlite3", ""), ("sqlite3", "MESSAGE"), ("sqlite3", "FILE"), ("mcap", ""),
     ("mcap", "STORAGE")],
)  # fmt: skip
def test_ros2_bags_hold_the_motion(
    storage: str, compression: str, recordings: Any, tmp_path: Path
) -> None:
    bag = recordings.ros2(tmp_path / "bag", storage=storage, compression=compression)
    words = {**IMU, "channels": [c for c in IMU["channels"] if c["topic"] != "/levels"]}
    found = import_log(bag, mapping(words), tmp_path / "log.nc")
    check_motion(found.path, recordings)
    assert warnings(found) == []
    residual = found.facts[0]["residual_rms"]
    assert max(residual) < 2e-3  # of differences over 50 ms; the change itself is 0.7 m/s^2
    assert found.facts[0]["acceleration_rms"][2] > 0.5


@pytest.mark.parametrize("compression", ["", "LZ4", "BZ2"])
def test_ros1_bags_hold_the_motion(compression: str, recordings: Any, tmp_path: Path) -> None:
    bag = recordings.ros1(tmp_path / "log.bag", compression=compression)
    words = {**IMU, "channels": [c for c in IMU["channels"] if c["topic"] != "/levels"]}
    check_motion(import_log(bag, mapping(words), tmp_path / "log.nc").path, recordings)


def test_parts_of_a_recording_are_one(recordings: Any, tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    recordings.ros1(tmp_path / "parts" / "b_0.bag", part=slice(0, 700))
    recordings.ros1(tmp_path / "parts" / "b_1.bag", part=slice(700, None))
    words = {**IMU, "channels": [c for c in IMU["channels"] if c["topic"] != "/levels"]}
    found = import_log(tmp_path / "parts", mapping(words), tmp_path / "log.nc")
    assert found.samples == recordings.count // 2
    check_motion(found.path, recordings)
    parts = [tmp_path / "parts" / f"b_{k}.bag" for k in range(2)]
    for again in (parts, tmp_path / "parts"):  # the log of the first is no part of the second
        assert import_log(again, mapping(words), tmp_path / "parts" / "log.nc").samples > 250
    (tmp_path / "link.nc").symlink_to(parts[1])
    with pytest.raises(LogError, match="another name than that of the log itself"):
        import_log(parts, mapping(words), tmp_path / "link.nc")


def test_a_transform_is_found_by_its_frame(recordings: Any, tmp_path: Path) -> None:
    bag = recordings.ros2(tmp_path / "bag")
    field = "transforms[wing/left].transform"
    words = [
        {"topic": "/tf", "field": f"{field}.translation", "frame": "flu", "unit": "m", "name": "p"},
        {"topic": "/tf", "field": f"{field}.rotation", "frame": "flu", "body": "flu",
         "order": "xyzw", "name": "a"},
    ]  # fmt: skip
    found = import_log(bag, parse_mapping({"channels": words}), tmp_path / "log.nc")
    log = load_log(found.path)
    np.testing.assert_allclose(log["p"].to_numpy()[:, 0], log["time"].to_numpy(), atol=1e-9)
    assert log.attrs["findings"] == "[]"


def test_stamps_are_those_of_the_header_unless_asked(recordings: Any, tmp_path: Path) -> None:
    bag = recordings.ros2(tmp_path / "bag")
    one = {"channels": [IMU["channels"][1]]}
    by_header = import_log(bag, mapping(one), tmp_path / "a.nc")
    received = import_log(bag, mapping(one, base="received"), tmp_path / "b.nc")
    origins = []
    for found in (by_header, received):
        with LogRecord(found.path) as record:
            origins.append(int(record._file.time_origin_ns))
    assert origins[1] - origins[0] == 3_000_000
    levels = {"channels": [IMU["channels"][5]]}
    with pytest.raises(LogError, match="expected a stamp in the header of topic '/levels'"):
        import_log(bag, mapping(levels, base="header"), tmp_path / "c.nc")


def test_json_in_mcap_and_a_recording_cut_off(recordings: Any, tmp_path: Path) -> None:
    words = {"channels": [
        {"topic": "sample", "field": "force", "frame": "frd", "unit": "N"},
        {"topic": "sample", "field": "angles[1]", "unit": "deg", "name": "angle"},
    ]}  # fmt: skip
    whole = recordings.json(tmp_path / "whole.mcap")
    found = import_log(whole, parse_mapping(words), tmp_path / "log.nc")
    log = load_log(found.path)
    t = log["time"].to_numpy()
    np.testing.assert_allclose(log["force"].to_numpy(), np.outer(t, [1, -2, -3]), atol=1e-12)
    np.testing.assert_allclose(log["angle"].to_numpy(), np.radians(-t), atol=1e-12)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:20_000])
    found = import_log(cut, parse_mapping(words), tmp_path / "cut.nc")
    assert 100 < found.samples < 400
    assert any("breaks off" in note for note in found.notes)


def _json_messages(path: Path, messages: list[dict[str, Any]]) -> Path:
    """MCAP file with one JSON message every 10 ms on the topic `s`."""
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema(name="Sample", encoding="jsonschema", data=b"{}")
        channel = writer.register_channel(topic="s", message_encoding="json", schema_id=schema)
        for k, words in enumerate(messages):
            writer.add_message(channel, k * 10**7, json.dumps(words).encode(), 0, k)
        writer.finish()
    return path


@pytest.mark.parametrize("names", ["1 2 3", "2 3 1", "1 2 0", "11 12 leg[0]"])
def test_joints_named_by_numbers_or_with_brackets(names: str, tmp_path: Path) -> None:
    """Joint 1 was read from place 1, which changes with the order; 11 and leg[0] not at all."""
    joints = names.split()
    orders = [joints if k % 2 else joints[::-1] for k in range(60)]
    states = [(one, [joints.index(name) + k / 60 for name in one]) for k, one in enumerate(orders)]
    bag = _joint_states(tmp_path / "bag", states)
    words = [{"topic": "s", "field": f"position[{name}]", "unit": "rad", "name": f"j{name}"}
             for name in joints]  # fmt: skip
    log = load_log(import_log(bag, mapping({"channels": words}), tmp_path / "log.nc").path)
    for place, name in enumerate(joints):
        np.testing.assert_allclose(log[f"j{name}"], place + np.arange(60) / 60)
    (seen,) = inspect_log(bag).topics
    lows = {one.name: round(one.low) for one in seen.channels}
    assert lows == {f"position[{name}]": place for place, name in enumerate(joints)}


def _frames(k: int, names: str, late: int = 0) -> dict[str, Any]:
    """Transform message; each frame is stamped `late` steps of 10 ms after the one before."""
    stamps = [1000 + k + late * place for place, _ in enumerate(names)]
    return {"transforms": [
        {"header": {"stamp": {"sec": one // 100, "nsec": one % 100 * 10**7}},
         "child_frame_id": name, "x": one / 100.0}
        for name, one in zip(names, stamps, strict=True)
    ]}  # fmt: skip


@pytest.mark.parametrize("names", ["ab", "ba"])
@pytest.mark.parametrize("base", [None, "header"])
def test_frames_of_one_message_have_their_own_stamps(
    names: str, base: str | None, tmp_path: Path
) -> None:
    """All frames had the stamp of the one that the mapping names first, which many lacked."""
    held = [_frames(k, "ab", late=4) for k in range(100)]
    for words in held[::25]:
        del words["transforms"][0]
    path = _json_messages(tmp_path / "log.mcap", held)
    words = {"time": {"rate": "100 Hz", **({"base": base} if base else {})}, "channels": [
        {"topic": "s", "field": f"transforms[{name}].x", "unit": "m", "name": name}
        for name in names
    ]}  # fmt: skip
    found = import_log(path, parse_mapping(words), tmp_path / "log.nc")
    log = load_log(found.path)
    with LogRecord(found.path) as record:
        times = log["time"].to_numpy() + int(record._file.time_origin_ns) * 1e-9
    assert not warnings(found) and found.samples == 96  # in which a and b overlap
    for name in names:
        np.testing.assert_allclose(log[name], times, atol=1e-8)  # rounding of times in ns


def test_frames_of_one_stamp_need_no_rate(tmp_path: Path) -> None:
    path = _json_messages(tmp_path / "log.mcap", [_frames(k, "ab") for k in range(50)])
    words = [{"topic": "s", "field": f"transforms[{one}].x", "unit": "m", "name": one}
             for one in "ab"]  # fmt: skip
    for time in ({}, {"restamp": "100 Hz"}):
        found = import_log(path, mapping({"channels": words}, **time), tmp_path / "log.nc")
        assert found.samples == 50
    later = _json_messages(tmp_path / "b.mcap", [_frames(k, "ab", late=1) for k in range(50)])
    with pytest.raises(
        LogError, match=r"expected rate .* s by transforms\[a\].header.stamp 100 Hz"
    ):
        import_log(later, mapping({"channels": words}), tmp_path / "log.nc")


def test_a_time_of_a_message_can_be_its_stamp(tmp_path: Path) -> None:
    """A stamp of two fields was refused; the seconds alone, which the error named, are none."""
    held = [{"header": {"stamp": {"sec": 9, "nsec": k * 10**7}}, "x": k / 100.0,
             "cam": {"sec": 7 * (k > 0), "nanosec": k * 10**7 * (k > 0)}}
            for k in range(90)]  # fmt: skip
    path = _json_messages(tmp_path / "log.mcap", held)
    x = {"topic": "s", "field": "x", "unit": "m"}
    for words in (
        {"channels": [x], "time": {"column": "cam"}},
        {"channels": [{**x, "stamp": "cam"}]},
        {"channels": [x], "time": {"column": "header.stamp"}},
    ):
        found = import_log(path, parse_mapping(words), tmp_path / "log.nc")
        log, first = load_log(found.path), 9 if found.samples == 90 else 7
        assert found.samples == (90 if first == 9 else 89)  # a stamp of 0 is none
        with LogRecord(found.path) as record:
            times = log["time"].to_numpy() + int(record._file.time_origin_ns) * 1e-9
        np.testing.assert_allclose(log["x"], times - first, atol=1e-8)  # rounding of times in ns


def test_keys_of_json_may_hold_dots(tmp_path: Path) -> None:
    """Messages whose keys hold dots, as `export` writes them, made no row without a warning."""
    held = [{"q": {"x": -1.0}, "q.x/q.x": float(k), "m.a": {"b.c": [0.0, 2.0 * k]}}
            for k in range(50)]  # fmt: skip
    path = _json_messages(tmp_path / "log.mcap", held)
    told = inspect_log(path)
    assert told.topics[0].rows == 50 and not told.findings
    for field, slope in (("q.x/q.x", 1.0), ("m.a.b.c[1]", 2.0)):
        words = {"channels": [{"topic": "s", "field": field, "unit": "1", "name": "f"}]}
        found = import_log(path, parse_mapping(words), tmp_path / "log.nc")
        read = load_log(found.path)["f"].to_numpy()
        np.testing.assert_allclose(read, slope * np.arange(50.0), atol=1e-9)  # rounding of times
    told = inspect_log(_json_messages(tmp_path / "b.mcap", held[:1] + [{"q": "?"}] * 9))
    assert "no rows" in {one.kind for one in told.findings}


@pytest.mark.parametrize("first", [0, 1, 30])
def test_nulls_of_json_are_missing_numbers(first: int, tmp_path: Path) -> None:
    """A null ended the reading of all topics, or hid a field where the first message had it."""
    held = [{"x": float(k), "a": {"b": [2.0 * k, 0]}} for k in range(100)]
    nulls: list[dict[str, Any]] = [{"x": None, "a": None}, {"x": None, "a": {"b": None}}]
    held[first : first + 2] = nulls
    path = _json_messages(tmp_path / "log.mcap", held)
    (seen,) = inspect_log(path).topics
    assert {one.name: one.missing for one in seen.channels} == {"x": 2, "a.b[0]": 2, "a.b[1]": 2}
    assert not seen.unplaced
    for field, slope in (("x", 1.0), ("a.b[0]", 2.0)):
        words = {"channels": [{"topic": "s", "field": field, "unit": "1", "name": "f"}]}
        log = load_log(import_log(path, parse_mapping(words), tmp_path / "log.nc").path)
        read, times = log["f"].to_numpy(), log["time"].to_numpy()
        known = np.isfinite(read)
        assert known.sum() == 98
        np.testing.assert_allclose(read[known], slope * 100 * times[known])


def test_a_number_that_is_always_null_is_said_to_be(tmp_path: Path) -> None:
    """The reason shown for a missing field was the name of a Python type."""
    path = _json_messages(tmp_path / "log.mcap", [{"x": 1.0, "y": None}] * 300)
    assert inspect_log(path).topics[0].unplaced == {"y": "absent or null in the first messages"}


@pytest.mark.parametrize("kind", ["mcap", "csv"])
def test_stamps_that_no_unit_makes_nanoseconds(kind: str, tmp_path: Path) -> None:
    """Integer stamps in ns without a unit raised "int too large" or an unclear error."""
    held = [{"t": 17 * 10**17 + k * 10**7, "x": float(k)} for k in range(100)]
    path = tmp_path / f"log.{kind}"
    if kind == "mcap":
        _json_messages(path, held)
    else:
        pd.DataFrame(held).to_csv(path, index=False)
    at = {"topic": "s", "field": "x"} if kind == "mcap" else {"column": "x"}
    words = {"time": {"column": "t"}, "channels": [{**at, "unit": "1"}]}
    with pytest.raises(LogError, match=r"below 146 years: .* unit perhaps ns\?"):
        import_log(path, parse_mapping(words), tmp_path / "log.nc")
    found = import_log(path, mapping(words, unit="ns"), tmp_path / "log.nc")
    assert found.duration == pytest.approx(0.99)


def _joint_states(
    folder: Path, states: list[tuple[list[str], list[float]]], unset: int = 0
) -> Path:
    """ROS 2 bag with one message every 10 ms on the topic `s`: names and positions of joints.

    The first `unset` of them have no stamp.
    """
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    make, kind, empty = store.types, "sensor_msgs/msg/JointState", np.zeros(0)
    with Writer(folder, version=9) as writer:
        connection = writer.add_connection("s", kind, typestore=store)
        for k, (names, angles) in enumerate(states):
            known = k >= unset
            stamp = make["builtin_interfaces/msg/Time"](int(known), k * 10**7 * known)
            header = make["std_msgs/msg/Header"](stamp=stamp, frame_id="")
            state = make[kind](header, names, np.array(angles), velocity=empty, effort=empty)
            writer.write(connection, k * 10**7, store.serialize_cdr(state, kind))
    return folder


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_parts_that_the_first_message_lacks_are_found_by_name(kind: str, tmp_path: Path) -> None:
    """Frames and joints of the second of two publishers were refused, and `inspect` hid them."""
    parts = [(["gripper"], [0.5]), (["left", "right"], [0.0, 0.1])] * 30
    parts = [(names, [k * angle for angle in angles]) for k, (names, angles) in enumerate(parts)]
    if kind == "bag":
        path = _joint_states(tmp_path / "bag", parts)
    else:
        held = [{"name": names, "position": angles} for names, angles in parts]
        path = _json_messages(tmp_path / "log.mcap", held)
    seen = {one.name: topic.rows for topic in inspect_log(path).topics for one in topic.channels}
    assert seen == {f"position[{name}]": 30 for name in ("gripper", "left", "right")}
    right = {"topic": "s", "field": "position[right]", "unit": "rad", "name": "right"}
    gripper = {**right, "field": "position[gripper]", "name": "gripper"}
    for words in ({"channels": [right]}, {"channels": [right, gripper], "time": {"rate": "50 Hz"}}):
        found = import_log(path, parse_mapping(words), tmp_path / f"{len(words)}.nc")
        log, factors = load_log(found.path), {"right": 0.1, "gripper": 0.5}
        times = log["time"].to_numpy() / 0.01 + 1.0  # the first stamp of both
        assert found.samples >= 29
        for name in factors.keys() & set(log):
            np.testing.assert_allclose(log[name], factors[name] * times, atol=1e-6)


@pytest.mark.parametrize("names", ["imu.x,u1.roll", "q.x,v.x,a.x,u1.x"])
def test_a_table_of_raw_sensors_is_not_sent_to_stream(tmp_path: Path, names: str) -> None:
    """`import -o A.csv` of sensors recommended `stream`, which refuses them."""
    path = tmp_path / "A.CSV"
    path.write_text(f"# unit\ntime,{names}\n", encoding="utf-8")
    assert _verbs(path) == ["stream --robot ROBOT"] * names.startswith("q.x")


def test_ros1_messages_in_mcap_and_protobuf(recordings: Any, tmp_path: Path) -> None:
    ros = {"channels": [{**IMU["channels"][2], "frame": "frd"}]}
    found = import_log(recordings.ros1_mcap(tmp_path / "a.mcap"), mapping(ros), tmp_path / "a.nc")
    assert load_log(found.path)["force"].to_numpy()[0, 2] == pytest.approx(-10.80665, abs=1e-9)
    pytest.importorskip("google.protobuf", reason="Protobuf needs the extra patagium[logs]")
    proto = {"channels": [{"topic": "v", "field": "point", "frame": "frd", "unit": "m"}]}
    path = recordings.protobuf(tmp_path / "b.mcap")
    log = load_log(import_log(path, parse_mapping(proto), tmp_path / "b.nc").path)
    t = log["time"].to_numpy()
    np.testing.assert_allclose(log["point"].to_numpy(), np.outer(t, [1, -2, -3]), atol=1e-9)


def test_idl_in_mcap_may_include_other_files(recordings: Any, tmp_path: Path) -> None:
    """rosbag2 stores .idl files as they are: every type with a header was refused."""
    path = recordings.idl(tmp_path / "idl.mcap")
    words = {"channels": [{"topic": "v", "field": "vector.x", "unit": "m", "name": "x"}]}
    log = load_log(import_log(path, mapping(words), tmp_path / "log.nc").path)
    np.testing.assert_allclose(log["x"], log["time"].to_numpy(), atol=1e-8)  # rounding of times


def test_a_bag_without_definitions_borrows_them(recordings: Any, tmp_path: Path) -> None:
    bag = recordings.ros2(tmp_path / "bag", part=slice(0, 300))
    import sqlite3

    with sqlite3.connect(bag / "bag.db3") as base:
        base.execute("UPDATE message_definitions SET encoded_message_definition = ''")
        base.execute("DELETE FROM message_definitions")
    base.close()
    one = {"channels": [IMU["channels"][1]]}
    found = import_log(bag, mapping(one), tmp_path / "log.nc")
    assert found.samples > 20
    assert any("no definition of sensor_msgs/msg/Imu" in note for note in found.notes)


def test_a_wrong_topic_or_field_names_what_there_is(recordings: Any, tmp_path: Path) -> None:
    bag = recordings.ros2(tmp_path / "bag")
    cases = {
        "topic": ({"topic": "/imu_raw"}, "no topic '/imu_raw'; closest: /imu"),
        "field": ({"field": "angular_vel"}, "expected 'angular_vel'.*closest: angular_velocity"),
        "vector": ({"field": "orientation.x"}, "expected 3 components under 'orientation.x'"),
    }
    for change, message in cases.values():
        with pytest.raises(LogError, match=message):
            import_log(bag, changed("rate", **change), tmp_path / "log.nc")
    with pytest.raises(LogError, match=r"'position' is no number.*position\[left_plunge\]"):
        import_log(bag, changed("plunge", field="position"), tmp_path / "log.nc")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag"]


@pytest.mark.parametrize(
    "name", ["z" * 256, "\u00e9" * 128, "-a", ".", " a", "a ", "a\tb", "a\0b", "\ud800", "a\udfff"]
)
def test_a_name_that_no_file_can_hold_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"channels\.0\.name: expected at most 255 bytes"):
        import_log(two_columns(tmp_path), parse_mapping(called(name, "b")), tmp_path / "log.nc")
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]


@pytest.mark.parametrize(("one", "other"), [("time", "b"), ("a|b", "a/b"), ("\u00e9", "e\u0301")])
def test_a_name_that_is_taken_is_refused(one: str, other: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"channels\.\d\.name: expected a name of its own"):
        import_log(two_columns(tmp_path), parse_mapping(called(one, other)), tmp_path / "log.nc")


@pytest.mark.parametrize("name", ["z" * 255, "a b", "imu/x", "\u00e9", "7", "_"])
def test_other_names_are_kept_as_they_are(name: str, tmp_path: Path) -> None:
    found = import_log(two_columns(tmp_path), parse_mapping(called(name, "b")), tmp_path / "log.nc")
    assert load_log(found.path)[name].shape == (200,)


def two_columns(folder: Path) -> Path:
    rows = [f"{0.01 * k:.2f},{np.sin(k)},{np.cos(k)}" for k in range(200)]
    (folder / "log.csv").write_text("\n".join(["t,first,second", *rows]) + "\n")
    return folder / "log.csv"


def called(one: str, other: str) -> dict[str, Any]:
    columns = ({"column": "first", "name": one}, {"column": "second", "name": other})
    return {"time": {"column": "t"}, "channels": [{**words, "unit": "m"} for words in columns]}


@pytest.mark.parametrize(
    ("name", "change", "kind", "words"),
    [
        ("rate", {"unit": "deg/s"}, "unit", "is the rate in rad/s"),
        ("force", {"unit": "g_0"}, "unit", "is it in m/s"),
        ("force", {"frame": "frd"}, "axes", "check frame"),
        ("rate", {"frame": "x, -y, -z", "field": "angular_velocity"}, "", ""),
        ("attitude", {"body": "frd"}, "axes", "check frame"),
        ("plunge", {"unit": "deg"}, "unit", "is it in rad"),
    ],
)
def test_slips_of_units_and_axes_are_found(
    name: str, change: dict[str, Any], kind: str, words: str, recordings: Any, tmp_path: Path
) -> None:
    bag = recordings.ros2(tmp_path / "bag")
    found = warnings(import_log(bag, changed(name, **change), tmp_path / "log.nc"))
    hits = [one for one in found if one.kind == kind and words in one.text]
    assert bool(hits) == bool(kind), found


@pytest.mark.parametrize(("path", "unit"), [
    ("linear.x", "m/s^2"), ("angular.y", "rad/s^2"), ("accel.angular.z", "rad/s^2"),
])  # fmt: skip
def test_accelerations_have_the_units_of_their_kind(path: str, unit: str) -> None:
    """Those of turning had none."""
    assert unit_in_message("geometry_msgs/msg/AccelStamped", path) == unit


def test_the_mapping_to_begin_from_names_joints(recordings: Any, tmp_path: Path) -> None:
    bag, words = recordings.ros2(tmp_path / "bag"), tmp_path / "map.yaml"
    with pytest.raises(SystemExit) as left:
        run(["inspect", str(bag), "--topic", "/joints", "-o", str(words)])
    assert left.value.code in (0, None)
    assert 'field: "position[left_plunge]", unit: "rad"' in words.read_text("utf-8")
    assert import_log(bag, words, tmp_path / "log.nc").samples > 10
    units = {name: unit_in_message("sensor_msgs/msg/JointState", name)
             for name in ("position[x]", "velocity[z]", "position[roll]")}  # fmt: skip
    assert units == {"position[x]": "", "velocity[z]": "", "position[roll]": "rad"}


@pytest.mark.parametrize("base", [None, "header"])
@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_a_stamp_of_zero_is_none_and_the_others_are_taken(
    kind: str, base: str | None, tmp_path: Path
) -> None:
    """Where a driver had no time for its first message, all were stamped as received, untold."""
    if kind == "bag":
        path = _joint_states(tmp_path / "bag", [(["x"], [float(k)]) for k in range(100)], unset=3)
    else:
        held = [{"header": {"stamp": {"sec": int(k > 2), "nsec": k * 10**7 * (k > 2)}},
                 "position": [float(k)]} for k in range(100)]  # fmt: skip
        path = _json_messages(tmp_path / "log.mcap", held)
    words = {"channels": [{"topic": "s", "field": "position[0]", "unit": "1", "name": "x"}]}
    found = import_log(path, mapping(words, **({"base": base} if base else {})), tmp_path / "a.nc")
    log = load_log(found.path)
    with LogRecord(found.path) as record:
        assert int(record._file.time_origin_ns) == 10**9 + 3 * 10**7 and found.samples == 97
    np.testing.assert_allclose(log["x"], 3 + 100 * log["time"].to_numpy(), atol=1e-9)  # rounding
    assert [(one.kind, one.text[:8]) for one in warnings(found)] == [("missing stamps", "3 of 100")]
    assert inspect_log(path).topics[0].stamps == "header"


def test_stamps_that_are_always_zero_are_told(tmp_path: Path) -> None:
    held = [{"header": {"stamp": {"sec": 0, "nsec": 0}}, "x": float(k)} for k in range(100)]
    found = inspect_log(_json_messages(tmp_path / "log.mcap", held))
    assert found.topics[0].stamps == "received"
    assert found.notes == ("s: its stamps are 0; it is stamped as received",)


def test_parts_of_a_ulog_topic_are_one(recordings: Any, tmp_path: Path) -> None:
    """Of a topic that is subscribed twice, as merged files have it, all but one part were lost."""
    whole = recordings.ulog(tmp_path / "a.ulg").read_bytes()
    row, head = 37, len(whole) - 300 * 37  # 3 bytes of a message's head, 2 of an id, 32 of numbers
    again = whole[head - 9 : head - 5] + b"\7\0" + whole[head - 3 : head]  # its id is 7
    rows = [whole[k : k + row] for k in range(head, len(whole), row)]
    later = [one[:3] + b"\7\0" + one[5:] for one in rows[200:]]
    path = tmp_path / "b.ulg"
    path.write_bytes(b"".join([whole[:head], again, *rows[:100], *later, *rows[100:200]]))
    words = {"channels": [{"topic": "imu", "field": "gyro[0]", "unit": "rad/s", "name": "rate"}]}
    log = load_log(import_log(path, parse_mapping(words), tmp_path / "log.nc").path)
    times = log["time"].to_numpy()
    assert len(times) == 300
    expected = [recordings.rolling(t) for t in times]
    np.testing.assert_allclose(log["rate"], expected, atol=1e-6)  # float32


def _telemetry(path: Path, *, top_first: bool) -> Path:
    """MCAP file of Protobuf: a oneof of imu and motor, by turns, and `volt` in every fourth."""
    pytest.importorskip("google.protobuf", reason="Protobuf needs the extra patagium[logs]")
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from google.protobuf.text_format import Parse
    from mcap.writer import Writer

    vec = """name: "vec.proto" package: "p" syntax: "proto3" message_type {name: "Vec"
        field {name: "x" number: 1 type: TYPE_DOUBLE label: LABEL_OPTIONAL}}"""
    top = """name: "top.proto" package: "p" syntax: "proto3" dependency: "vec.proto" message_type {
        name: "T" oneof_decl {name: "payload"} oneof_decl {name: "_volt"}
        field {name: "imu" number: 1 type: TYPE_MESSAGE type_name: ".p.Vec" label: LABEL_OPTIONAL
            oneof_index: 0}
        field {name: "motor" number: 2 type: TYPE_MESSAGE type_name: ".p.Vec" label: LABEL_OPTIONAL
            oneof_index: 0}
        field {name: "volt" number: 3 type: TYPE_DOUBLE label: LABEL_OPTIONAL oneof_index: 1
            proto3_optional: true}
        field {name: "plain" number: 4 type: TYPE_DOUBLE label: LABEL_OPTIONAL}
        field {name: "extra" number: 5 type: TYPE_MESSAGE type_name: ".p.T.E" label: LABEL_REPEATED}
        nested_type {name: "E" options {map_entry: true}
            field {name: "key" number: 1 type: TYPE_INT32 label: LABEL_OPTIONAL}
            field {name: "value" number: 2 type: TYPE_DOUBLE label: LABEL_OPTIONAL}}}"""
    files = [Parse(words, descriptor_pb2.FileDescriptorProto()) for words in (vec, top)]
    pool = descriptor_pool.DescriptorPool()
    for one in files:
        pool.Add(one)
    make = message_factory.GetMessageClass(pool.FindMessageTypeByName("p.T"))
    held = descriptor_pb2.FileDescriptorSet(file=files[:: -1 if top_first else 1])
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("p.T", "protobuf", held.SerializeToString())
        channel = writer.register_channel("s", "protobuf", schema)
        for k in range(100):
            message = make(**{"motor" if k % 2 else "imu": {"x": 9.8}})
            message.extra[7] = float(k)
            if k % 4 == 1:
                message.volt = 11.1
            writer.add_message(channel, k * 10**7, message.SerializeToString(), 0, k)
        writer.finish()
    return path


@pytest.mark.parametrize("kind", ["json", "protobuf", "protobuf, top first"])
def test_what_a_message_lacks_is_not_zero(kind: str, tmp_path: Path) -> None:
    """Absent parts of Protobuf were 0, and those absent in the first message of JSON not found.

    A schema whose top file comes first, as in the C++ example of MCAP, and a map were refused.
    """
    path = tmp_path / "log.mcap"
    if kind == "json":
        held = [{"motor" if k % 2 else "imu": {"x": 9.8}, "plain": 0.0, "extra": {"7": float(k)},
                 **({"volt": 11.1} if k % 4 == 1 else {})} for k in range(100)]  # fmt: skip
        _json_messages(path, held)
    else:
        _telemetry(path, top_first=kind != "protobuf")
    seen = {one.name: (topic.rows, one.missing, round(one.mean, 6))
            for topic in inspect_log(path).topics for one in topic.channels}  # fmt: skip
    assert seen == {"imu.x": (50, 0, 9.8), "motor.x": (50, 0, 9.8), "volt": (25, 0, 11.1),
                    "plain": (100, 0, 0.0), "extra.7": (100, 0, 49.5)}  # fmt: skip
    words = {"channels": [{"topic": "s", "field": "volt", "unit": "V"}]}
    log = load_log(import_log(path, parse_mapping(words), tmp_path / "log.nc").path)
    np.testing.assert_allclose(log["time"], 0.04 * np.arange(25), atol=1e-9)  # ns of stamps


def test_a_clock_that_wraps_is_said_and_restamped(tmp_path: Path) -> None:
    """The rows after the wrap were left out, or refused without a remedy."""
    rows = np.arange(400)
    stamps = (5000 * rows + 2**32 - 900_000) % 2**32
    table = {"t": stamps, "x": np.sin(0.1 * rows)}
    pd.DataFrame(table).to_csv(tmp_path / "log.csv", index=False)
    words: dict[str, Any] = {
        "time": {"column": "t", "unit": "us"},
        "channels": [{"column": "x", "unit": "m"}],
    }
    with pytest.raises(LogError, match=r"say under time `restamp: 200 Hz` if .* wraps"):
        import_log(tmp_path / "log.csv", parse_mapping(words), tmp_path / "log.nc")
    words["time"]["restamp"] = "200 Hz"
    found = import_log(tmp_path / "log.csv", parse_mapping(words), tmp_path / "log.nc")
    assert found.samples == 400 and found.duration == pytest.approx(1.995)
    assert any("1 time(s) their clock jumped back" in one.text for one in found.findings)

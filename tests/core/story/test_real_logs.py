"""Logs of real robots: imported, inspected, brought to one time base, and consistent."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from patagium.cli.main import run
from patagium.sensing.logs.importing.import_log import import_log
from patagium.sensing.logs.importing.inspection import inspect_log
from patagium.sensing.logs.mapping import parse_mapping
from patagium.sensing.logs.record import load_log

DATA = Path(__file__).parents[3].parent / "shared" / "data"
PX4 = DATA / "px4" / "sample_log_small.ulg"
CRAZYFLIE = DATA / "crazyflie" / "log16.csv.gz"
px4 = pytest.mark.skipif(not PX4.exists(), reason="the PX4 log is not in the repository")
crazyflie = pytest.mark.skipif(not CRAZYFLIE.exists(), reason="the log is not in the repository")

CHANNELS: list[dict[str, Any]] = [
    {"topic": "vehicle_attitude", "field": "q", "order": "wxyz", "frame": "ned", "body": "frd",
     "name": "attitude"},
    {"topic": "sensor_combined", "field": "gyro_rad", "frame": "frd", "unit": "rad/s",
     "name": "rate"},
    {"topic": "sensor_combined", "field": "accelerometer_m_s2", "frame": "frd", "unit": "m/s^2",
     "name": "force"},
    {"topic": "vehicle_local_position", "field": ["vx", "vy", "vz"], "frame": "ned",
     "unit": "m/s", "name": "velocity"},
]  # fmt: skip


def words(**changes: dict[str, Any]) -> dict[str, Any]:
    channels = [{**one, **changes.get(str(one["name"]), {})} for one in CHANNELS]
    return {"time": {"rate": "200 Hz"}, "channels": channels}


@pytest.fixture(scope="module")
def ulog() -> None:
    pytest.importorskip("pyulog", reason="ULog needs the extra patagium[logs]")


@px4
def test_body_acceleration_of_the_px4_log_is_recovered(ulog: None, tmp_path: Path) -> None:
    found = import_log(PX4, parse_mapping(words()), tmp_path / "px4.nc")
    fact = found.facts[0]
    # specific force turned into the world is 1 g up; what it leaves of the change of velocity is
    # the accelerometer's bias (0.13 m/s^2 upward) and noise of its size
    np.testing.assert_allclose(fact["mean_in_world"], [0.0, 0.0, 9.80665], atol=0.2)
    assert max(fact["residual_std"]) < 0.1 and max(np.abs(fact["residual_mean"])) < 0.15
    assert {one.kind for one in found.findings if one.level == "warning"} == {"gap"}
    log = load_log(found.path)
    attitude = log["attitude"].to_numpy()
    np.testing.assert_allclose(np.linalg.norm(attitude, axis=1), 1.0, atol=1e-12)
    steps = np.diff(log["time"].to_numpy())
    assert np.isclose(steps, 0.005).all() and found.left_out == 33  # the gap of 0.161 s, at first


@px4
@pytest.mark.parametrize(
    ("change", "kind"),
    [
        ({"rate": {"unit": "deg/s"}}, "unit"),
        ({"force": {"unit": "g_0"}}, "unit"),
        ({"attitude": {"body": "flu"}}, "axes"),
        ({"attitude": {"order": "xyzw"}}, "axes"),
        ({"attitude": {"frame": "nwu"}}, "axes"),
        ({"force": {"frame": "flu"}}, "axes"),
    ],
)
def test_slips_in_the_px4_log_are_found(
    change: dict[str, Any], kind: str, ulog: None, tmp_path: Path
) -> None:
    found = import_log(PX4, parse_mapping(words(**change)), tmp_path / "px4.nc")
    assert kind in {one.kind for one in found.findings if one.level == "warning"}


@px4
def test_the_px4_log_is_inspected(ulog: None, capsys: pytest.CaptureFixture[str]) -> None:
    facts = inspect_log(PX4)
    topics = {topic.name: topic for topic in facts.topics}
    assert topics["sensor_combined"].rows == 1298
    assert topics["sensor_combined"].rate == pytest.approx(204.6, rel=0.01)
    assert topics["vehicle_attitude"].gaps == 1
    assert "1 dropout(s)" in facts.notes[0]
    with pytest.raises(SystemExit) as left:
        run(["inspect", str(PX4), "--json"])
    assert left.value.code == 0
    assert json.loads(capsys.readouterr().out)["format"] == "PX4 ULog"


@px4
def test_a_truncated_px4_log_is_read_as_far_as_it_goes(ulog: None, tmp_path: Path) -> None:
    cut = tmp_path / "cut.ulg"
    cut.write_bytes(PX4.read_bytes()[:600_000])
    found = import_log(cut, parse_mapping(words()), tmp_path / "cut.nc")
    assert 100 < found.samples < 1266


@crazyflie
def test_the_crazyflie_log_is_imported_and_learned_from(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    mapping = tmp_path / "map.yaml"
    mapping.write_text(
        "time: {column: timestamp_ms, unit: ms, end: 3}\n"
        "inputs:\n"
        "  - {column: gyro, unit: deg/s, frame: flu, range: [-200, 200]}\n"
        "  - {column: motor.m1, unit: '1', range: [0, 65535]}\n"
        "outputs: [{column: acc.z, unit: g_0, name: lift, range: [0, 2]}]\n",
        encoding="utf-8",
    )
    monkeypatch.chdir(tmp_path)
    assert say("import", CRAZYFLIE, "--map", mapping) == 0
    assert (tmp_path / "log16.nc").exists()
    learn = ("--hidden", "4", "--prior-std", "0.5", "--measurement-std", "0.6")
    assert say("identify", "log16.nc", *learn, "--json", "--model", "model.json") == 0
    out = capsys.readouterr().out
    scores = json.loads(out[out.index("\n{") :])
    assert scores["samples"] > 2900 and scores["outcome"] == "COMPLETED"
    assert say("evaluate", "model.json", "log16.nc") == 0
    assert say("identify", CRAZYFLIE, "--mapping", mapping, *learn, "--json") == 0
    out = capsys.readouterr().out
    again = json.loads(out[out.index("\n{") :])
    assert again["nmse"] == scores["nmse"]  # the log is imported on the way


@crazyflie
def test_a_mapping_with_an_imported_log_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(CRAZYFLIE, tmp_path / "a.csv.gz")
    mapping = tmp_path / "map.yaml"
    mapping.write_text(
        "time: {column: timestamp_ms, unit: ms, end: 1}\nchannels: [{column: acc.x, unit: g_0}]\n"
    )
    out = tmp_path / "a.nc"
    assert say("import", tmp_path / "a.csv.gz", "--map", mapping, "-o", out) == 0
    stds = ("--prior-std", "0.5", "--measurement-std", "0.6")
    assert say("identify", out, "--mapping", mapping, *stds) == 2
    assert "carries its own" in capsys.readouterr().err
    assert say("identify", out, *stds) == 2
    told = capsys.readouterr().err  # it refused without the command that `import` proposes
    assert "named channels only: acc.x" in told and "`patagium motion " in told
    assert say("check", out, "--json") == 0
    assert json.loads(capsys.readouterr().out)["numbers"] == ["acc.x [m/s^2]"]


def say(*words: object) -> int:
    with pytest.raises(SystemExit) as left:
        run([str(word) for word in words])
    code = left.value.code
    return code if isinstance(code, int) else 0

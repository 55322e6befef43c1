"""DataFlash logs of ArduPilot: numbers by pymavlink's formats, or the command that converts."""

import random
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from patagium.errors import LogError
from patagium.sensing.logs.files.channels import Request
from patagium.sensing.logs.files.opening import open_log
from patagium.sensing.logs.importing.import_log import import_log
from patagium.sensing.logs.importing.inspection import inspect_log
from patagium.sensing.logs.mapping import parse_mapping
from patagium.sensing.logs.record import load_log

WORDS: dict[str, Any] = {
    "time": {"rate": "100 Hz"},
    "channels": [
        {"topic": "IMU", "field": ["GyrX", "GyrY", "GyrZ"], "frame": "frd", "unit": "rad/s",
         "name": "rate"},
        {"topic": "IMU/1", "field": "GyrX", "unit": "rad/s", "name": "second"},
        {"topic": "IMU", "field": ["AccX", "AccY", "AccZ"], "frame": "frd", "unit": "m/s^2",
         "name": "force"},
        {"topic": "ATT", "field": "Roll", "unit": "deg", "name": "roll"},
    ],
}  # fmt: skip


@pytest.fixture
def pymavlink() -> Any:
    return pytest.importorskip("pymavlink", reason="DataFlash needs patagium[ardupilot]")


def test_numbers_of_all_instances(pymavlink: Any, recordings: Any, tmp_path: Path) -> None:
    log = recordings.dataflash(tmp_path / "log.BIN")
    found = import_log(log, parse_mapping(WORDS), tmp_path / "out.nc")
    assert not [one for one in found.findings if one.level == "warning"]
    held = load_log(found.path)
    t = held["time"].to_numpy()
    rolling = np.array([recordings.rolling(s) for s in t])
    np.testing.assert_allclose(held["rate"][:, 0], rolling, atol=1e-4)  # singles, interpolated
    np.testing.assert_allclose(held["second"], rolling + 1, atol=1e-4)
    force = np.array([recordings.specific_force(s) for s in t])
    np.testing.assert_allclose(held["force"], force, atol=1e-3)
    roll = np.array([recordings.roll(s) for s in t])
    np.testing.assert_allclose(held["roll"], roll, atol=3e-4)  # centidegrees, 50 Hz


def test_inspect_lists_types_units_and_text(
    pymavlink: Any, recordings: Any, tmp_path: Path
) -> None:
    found = inspect_log(recordings.dataflash(tmp_path / "log.BIN"))
    topics = {one.name: one for one in found.topics}
    assert set(topics) == {"IMU", "IMU/1", "ATT"} and found.format == "ArduPilot DataFlash"
    units = {one.name: one.unit for one in topics["IMU"].channels}
    assert units["GyrX"] == "rad/s" and units["AccZ"] == "m/s^2" and units["I"] == ""
    assert topics["IMU"].rows == 300 and topics["IMU"].rate == pytest.approx(200.0, rel=1e-6)
    assert topics["ATT"].unplaced == {"Mode": "text"}
    assert not [one for one in found.findings if one.level == "warning"]


def test_a_heading_goes_by_north(pymavlink: Any, recordings: Any, tmp_path: Path) -> None:
    """Yaw was interpolated as a plain number: between 359 and 0 degrees it passed through 180."""
    log = recordings.dataflash(tmp_path / "log.BIN")
    topics = {one.name: one for one in inspect_log(log).topics}
    unit = next(one.unit for one in topics["ATT"].channels if one.name == "Yaw")
    words = {"topic": "ATT", "field": "Yaw", "unit": unit, "name": "yaw"}
    mapping = parse_mapping({"time": {"rate": "200 Hz"}, "channels": [words]})
    held = load_log(import_log(log, mapping, tmp_path / "out.nc").path)
    turned = held["yaw"].to_numpy() - held["yaw"].to_numpy()[0]
    np.testing.assert_allclose(turned, np.radians(4 * held["time"].to_numpy()), atol=1e-4)


def test_numbers_are_those_of_pymavlink(pymavlink: Any, recordings: Any, tmp_path: Path) -> None:
    """Every number of every message, bit by bit."""
    from pymavlink.DFReader import DFReader_binary

    path = recordings.dataflash(tmp_path / "log.BIN")
    rows: dict[str, list[list[float]]] = {"IMU": [], "IMU/1": [], "ATT": []}
    reader = DFReader_binary(str(path))
    while (message := reader.recv_match(type=["IMU", "ATT"], strict=True)) is not None:
        if message.get_type() == "ATT":
            rows["ATT"].append([message.TimeUS, message.Roll])
        else:
            gyro = [message.TimeUS, message.I, message.GyrX, message.GyrY, message.AccZ]
            rows["IMU/1" if message.I else "IMU"].append(gyro)
    reader.close()
    with closing(open_log(path)) as log:
        for name, expected in rows.items():
            fields = (
                ("TimeUS", "Roll") if name == "ATT" else ("TimeUS", "I", "GyrX", "GyrY", "AccZ")
            )
            (block,) = log.blocks((Request(name, log.topics[name].base, fields),))
            np.testing.assert_array_equal(block.values, expected)
            np.testing.assert_array_equal(block.stamps, 1000 * block.values[:, 0])


def test_a_cut_log_is_read_to_its_end(pymavlink: Any, recordings: Any, tmp_path: Path) -> None:
    log = recordings.dataflash(tmp_path / "log.BIN")
    log.write_bytes(log.read_bytes()[:-10])
    rows = {one.name: one.rows for one in inspect_log(log).topics}
    assert rows["IMU"] == 300 and rows["IMU/1"] == 299


@pytest.mark.parametrize("seed", range(20))
def test_damaged_logs_are_read_or_refused(
    seed: int, pymavlink: Any, recordings: Any, tmp_path: Path
) -> None:
    chance, log = random.Random(seed), recordings.dataflash(tmp_path / "log.BIN", 60)
    content = bytearray(log.read_bytes())
    for _ in range(chance.choice([1, 3, 30])):
        content[chance.randrange(len(content))] = chance.randrange(256)
    log.write_bytes(content[: chance.randrange(len(content) // 2, len(content))])
    try:
        inspect_log(log)
        import_log(log, parse_mapping(WORDS), tmp_path / "out.nc")
    except LogError as problem:
        assert "log.BIN" in str(problem)


def test_without_pymavlink_the_error_has_the_command(
    recordings: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = recordings.dataflash(tmp_path / "log.BIN")
    monkeypatch.setitem(sys.modules, "pymavlink.DFReader", None)
    with pytest.raises(LogError) as refusal:
        inspect_log(log)
    command = "mavlogdump.py --format mat --mat_file log.mat log.BIN"
    assert "patagium[ardupilot]" in str(refusal.value) and command in str(refusal.value)

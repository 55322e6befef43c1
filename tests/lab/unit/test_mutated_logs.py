"""Logs and mappings with something wrong in them: a named error, or a whole log and warnings."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

from patagium import reading
from patagium.errors import PatagiumError, Unreadable
from patagium.sensing.logs.files.opening import open_log
from patagium.sensing.logs.importing.import_log import import_log
from patagium.sensing.logs.importing.inspection import inspect_log
from patagium.sensing.logs.record import LogRecord
from patagium_lab.attack.mutation import mutated_bytes, mutated_table, mutated_tree
from patagium_lab.attack.recordings import recordings

FORMATS = (
    *("CSV", "gzipped CSV", "Parquet", "MAT", "ROS 1 bag", "ROS 2 bag"),
    *("MCAP", "ULog", "DataFlash"),
)
CASES = 12
"""Cases of each format; an attack has thousands (`patagium study attack`)."""


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Whole logs of each format with their mappings."""
    return dict(recordings(tmp_path_factory.mktemp("originals")))


def check(log: Path, mapping: Path, folder: Path) -> str:
    """Import it; a named error that leaves nothing, or a log that holds together."""
    before = {path.name for path in folder.iterdir()}
    out = folder / "out.nc"
    try:
        found = import_log(log, mapping, out)
    except PatagiumError as problem:
        assert str(problem).strip()
        assert {path.name for path in folder.iterdir()} == before
        return "refused"
    assert {path.name for path in folder.iterdir()} == before | {"out.nc"}
    with LogRecord(out) as record:
        assert record.count == found.samples >= 2
        assert (np.diff(record.time()) > 0).all()
        assert np.isfinite(record.values(record.labels)).all()
        assert [one["text"] for one in record.findings] == [one.text for one in found.findings]
    return "warned" if found.findings else "imported"


def prepared(folder: Path, log: Path, words: Any) -> tuple[Path, Path]:
    """Copy of a log and file of its mapping, alone in a folder."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    mapping = folder / "map.yaml"
    mapping.write_text(yaml.safe_dump(words, allow_unicode=True), "utf-8", "surrogatepass")
    return Path(shutil.copy(log, folder / log.name)), mapping


@pytest.mark.parametrize("name", FORMATS)
def test_whole_logs_are_imported(name: str, originals: dict[str, Any], tmp_path: Path) -> None:
    log, mapping = prepared(tmp_path / "one", *originals[name])
    assert check(log, mapping, tmp_path / "one") != "refused"


@pytest.mark.parametrize("name", FORMATS)
def test_damaged_files(name: str, originals: dict[str, Any], tmp_path: Path) -> None:
    for seed in range(CASES):
        folder = tmp_path / "one"
        log, mapping = prepared(folder, *originals[name])
        log.write_bytes(mutated_bytes(log.read_bytes(), np.random.default_rng(seed)))
        check(log, mapping, folder)
        try:
            inspect_log(log)
        except PatagiumError as problem:
            assert str(problem).strip()


def test_tables_with_wrong_numbers(originals: dict[str, Any], tmp_path: Path) -> None:
    for seed in range(5 * CASES):
        folder = tmp_path / "one"
        log, mapping = prepared(folder, *originals["CSV"])
        log.write_bytes(mutated_table(log.read_bytes(), np.random.default_rng(seed)))
        check(log, mapping, folder)


@pytest.mark.parametrize("name", ("CSV", "ROS 1 bag", "ROS 2 bag", "MCAP", "ULog"))
def test_wrong_mappings(name: str, originals: dict[str, Any], tmp_path: Path) -> None:
    log, words = originals[name]
    for seed in range(CASES):
        folder = tmp_path / "one"
        check(*prepared(folder, log, mutated_tree(words, np.random.default_rng(seed))), folder)


def test_logs_beyond_the_memory_are_refused_with_size_and_remedy(
    originals: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files that are read at once, and small files with much compressed content."""
    wide, bag = tmp_path / "wide.mat", tmp_path / "wide.bag"
    savemat(wide, {"t": np.zeros(1_000_000)}, do_compression=True)
    types, writer = get_typestore(Stores.ROS1_NOETIC), Writer(bag)
    writer.set_compression(Writer.CompressionFormat.BZ2)
    with writer:
        topic = writer.add_connection("/t", "std_msgs/msg/Float64", typestore=types)
        for k in range(9000):
            writer.write(topic, k, bytes(8))
    for path in (wide, bag):
        open_log(path).close()
    monkeypatch.setattr(reading, "free_memory", lambda: 4 * 50_000)
    with pytest.raises(Unreadable, match=r"compressed parts.*at most 48\.8 KiB.*in parts"):
        open_log(wide)
    log = open_log(bag)
    assert "compressed parts: expected at most 48.8 KiB" in log.topics["/t"].problem
    log.close()
    monkeypatch.setattr(reading, "free_memory", lambda: 4 * 500)
    for kind in ("MAT", "ULog", "MCAP"):
        with pytest.raises(Unreadable, match="at most 500 B at once"):
            open_log(originals[kind][0])

"""Logs and mappings with something wrong in them: a named error, or a whole log and warnings."""

import math
import random
import shutil
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from patagium.errors import PatagiumError
from patagium.sensing.logs.importing.import_log import import_log
from patagium.sensing.logs.importing.inspection import inspect_log
from patagium.sensing.logs.record import LogRecord

Words = dict[str, Any]

ROS: Words = {
    "time": {"rate": "100 Hz"},
    "inputs": [
        {"topic": "/imu", "field": "orientation", "order": "xyzw", "frame": "nwu", "body": "flu"},
        {"topic": "/imu", "field": "angular_velocity", "frame": "flu", "unit": "rad/s",
         "range": [-3, 3]},
        {"topic": "/joints", "field": "position[left_plunge]", "unit": "rad", "range": [-1, 1]},
    ],
    "outputs": [{"topic": "/imu", "field": "linear_acceleration.z", "unit": "m/s^2"}],
}  # fmt: skip
JSON: Words = {
    "channels": [
        {"topic": "sample", "field": "force", "frame": "frd", "unit": "N"},
        {"topic": "sample", "field": "angles[1]", "unit": "1"},
    ]
}
ULOG: Words = {
    "inputs": [{"topic": "imu", "field": "gyro", "frame": "frd", "unit": "rad/s"}],
    "outputs": [{"topic": "imu", "field": "accel", "frame": "frd", "unit": "m/s^2"}],
}
TABLE: Words = {
    "time": {"column": "t", "unit": "ms"},
    "inputs": [{"column": ["gx", "gy", "gz"], "unit": "deg/s", "frame": "frd", "name": "rate"}],
    "outputs": [{"column": "fz", "unit": "g_0", "name": "lift", "range": [0, 2]}],
}


def table(count: int = 200) -> pd.DataFrame:
    k = np.arange(count)
    return pd.DataFrame(
        {
            "t": 2.0 * k,
            "gx": 10 * np.sin(0.05 * k),
            "gy": 5 + 0.01 * k,
            "gz": np.cos(0.1 * k),
            "fz": 1 + 0.1 * np.sin(0.2 * k),
        }
    )


@pytest.fixture(scope="module")
def originals(recordings: Any, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Whole logs of each format with their mappings."""
    folder = tmp_path_factory.mktemp("originals")
    part = slice(0, 200)
    table().to_csv(folder / "log.csv", index=False)
    table().to_csv(folder / "log.csv.gz", index=False)
    table().to_parquet(folder / "log.parquet")
    from scipy.io import savemat

    savemat(folder / "log.mat", {name: column.to_numpy() for name, column in table().items()})
    recordings.ros2(folder / "sql", part=part)
    recordings.ros2(folder / "mcap", storage="mcap", part=part)
    return {
        "csv": (folder / "log.csv", TABLE),
        "csv.gz": (folder / "log.csv.gz", TABLE),
        "parquet": (folder / "log.parquet", TABLE),
        "mat": (folder / "log.mat", TABLE),
        "bag": (recordings.ros1(folder / "log.bag", compression="LZ4", part=part), ROS),
        "db3": (folder / "sql" / "sql.db3", ROS),
        "mcap": (folder / "mcap" / "mcap.mcap", ROS),
        "json": (recordings.json(folder / "json.mcap"), JSON),
        "ulg": (recordings.ulog(folder / "log.ulg"), ULOG),
    }


FORMATS = ("csv", "csv.gz", "parquet", "mat", "bag", "db3", "mcap", "json", "ulg")


def truncated(content: bytes, chance: random.Random) -> bytes:
    return content[: chance.randrange(len(content))]


def scratched(content: bytes, chance: random.Random) -> bytes:
    damaged = bytearray(content)
    for _ in range(chance.choice([1, 3, 30])):
        damaged[chance.randrange(len(damaged))] = chance.randrange(256)
    return bytes(damaged)


def blanked(content: bytes, chance: random.Random) -> bytes:
    begin = chance.randrange(len(content))
    length = min(len(content) - begin, chance.choice([8, 100, 5000]))
    return content[:begin] + bytes(length) + content[begin + length :]


def doubled(content: bytes, chance: random.Random) -> bytes:
    begin = chance.randrange(len(content))
    return content[:begin] + content[max(0, begin - 500) : begin] + content[begin:]


DAMAGES: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    truncated, scratched, blanked, doubled,
)  # fmt: skip
ODD = (math.nan, math.inf, -1.0, 1e300, 0.0, 2**70, "word", "", None)


def odd_table(chance: random.Random) -> pd.DataFrame:
    """A table with wrong numbers, stamps or columns."""
    odd = table(chance.choice([0, 1, 2, 60, 200])).astype(object)
    for _ in range(chance.choice([1, 2, 4])):
        kind = chance.randrange(7)
        name = chance.choice(list(odd.columns))
        rows = [row for row in range(len(odd)) if chance.random() < chance.choice([0.02, 0.6, 1.0])]
        if kind == 0:
            odd.loc[rows, name] = chance.choice(ODD)
        elif kind == 1 and len(odd):
            rolled = np.roll(odd["t"].to_numpy(), chance.randrange(len(odd)))
            odd["t"] = pd.Series(rolled, dtype=object)
        elif kind == 2 and len(odd):
            odd.loc[rows, "t"] = odd["t"].iloc[0]
        elif kind == 3:
            odd = odd.rename(columns={name: chance.choice(list(odd.columns)) + "'"})
        elif kind == 4:
            other = chance.choice(list(odd.columns))
            odd = odd.rename(columns={name: other, other: name})
        elif kind == 5 and name in odd and len(odd):
            larger = [value * 1e3 if isinstance(value, float) else value for value in odd[name]]
            odd[name] = pd.Series(larger, dtype=object)
        elif len(odd.columns) > 1:
            odd = odd.drop(columns=name)
        if "t" not in odd:
            return odd
    return odd


def numeric(column: Any) -> Any:
    try:
        return column.astype(float)
    except (TypeError, ValueError):
        return column.astype(str)


def odd_words(words: Words, chance: random.Random) -> Any:
    """A mapping with something wrong at a random place."""
    changed: Any = deepcopy(words)
    for _ in range(chance.choice([1, 1, 2])):
        place, key = chance.choice(places(changed) or [({"time": {}}, "time")])
        kind = chance.randrange(5)
        if kind == 0 and key in (place if isinstance(place, dict) else range(len(place))):
            del place[key]
        elif kind == 1:
            place[key] = chance.choice([None, 3, -1.5, [], {}, "", "x" * 500, True, [1, "a"]])
        elif kind == 2:
            place[key] = chance.choice(
                ["deg", "rad/s", "m", "1", "g_0", "furlong", "/imu", "ned", "x, y", "rpy", "t"]
            )
        elif kind == 3 and isinstance(place, dict):
            place[f"{key}s"] = place.get(key)
        elif isinstance(place[key], str):
            place[key] = place[key][:-1] or "?"
    return changed


def places(words: Any) -> list[tuple[Any, Any]]:
    pairs = list(words.items()) if isinstance(words, dict) else list(enumerate(words))
    found = [(words, key) for key, _ in pairs]
    for _, inner in pairs:
        if isinstance(inner, dict | list):
            found += places(inner)
    return found


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
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    mapping = folder / "map.yaml"
    mapping.write_text(yaml.safe_dump(words), encoding="utf-8")
    return Path(shutil.copy(log, folder / log.name)), mapping


@pytest.mark.parametrize("name", FORMATS)
def test_whole_logs_are_imported(name: str, originals: dict[str, Any], tmp_path: Path) -> None:
    log, mapping = prepared(tmp_path / "one", *originals[name])
    assert check(log, mapping, tmp_path / "one") == "imported"


THOROUGH = settings(
    max_examples=67, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)


@given(seed=st.integers(0, 2**32), name=st.sampled_from(FORMATS), damage=st.sampled_from(DAMAGES))
@THOROUGH
def test_damaged_files(
    seed: int, name: str, damage: Any, originals: dict[str, Any], tmp_path: Path
) -> None:
    folder = tmp_path / "one"
    log, mapping = prepared(folder, *originals[name])
    log.write_bytes(damage(log.read_bytes(), random.Random(seed)))
    check(log, mapping, folder)
    try:
        inspect_log(log)
    except PatagiumError as problem:
        assert str(problem).strip()


@given(seed=st.integers(0, 2**32), kind=st.sampled_from(["csv", "csv.gz", "parquet"]))
@THOROUGH
def test_tables_with_wrong_numbers(seed: int, kind: str, tmp_path: Path) -> None:
    folder = tmp_path / "one"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    odd, log, mapping = odd_table(random.Random(seed)), folder / f"log.{kind}", folder / "map.yaml"
    mapping.write_text(yaml.safe_dump(TABLE), encoding="utf-8")
    if kind == "parquet":
        numbers = {name: numeric(column) for name, column in odd.items()}
        pd.DataFrame(numbers).to_parquet(log)
    else:
        odd.to_csv(log, index=False)
    check(log, mapping, folder)


@given(seed=st.integers(0, 2**32), name=st.sampled_from(("csv", "bag", "db3", "json", "ulg")))
@THOROUGH
def test_wrong_mappings(seed: int, name: str, originals: dict[str, Any], tmp_path: Path) -> None:
    log, words = originals[name]
    folder = tmp_path / "one"
    check(*prepared(folder, log, odd_words(words, random.Random(seed))), folder)

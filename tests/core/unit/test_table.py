import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from patagium.errors import LogError, ParameterError
from patagium.sensing.logs.importing.import_log import read_table
from patagium.sensing.logs.mapping import load_mapping, parse_mapping
from patagium.sensing.logs.table import table_from_frame

WORDS: dict[str, Any] = {
    "time": {"column": "stamp", "unit": "ms"},
    "inputs": [
        {"column": "turn", "unit": "deg/s", "name": "rate", "range": [-180, 180]},
        {"column": "throttle", "unit": "1", "offset": 100.0},
    ],
    "outputs": [{"column": "acc", "unit": "g_0"}],
}


def frame(**changes: Any) -> pd.DataFrame:
    columns = {
        "stamp": [5.0, 6.0, 7.0, 8.0],
        "turn": [0.0, 180.0, -180.0, 90.0],
        "throttle": [100, 200, 300, 400],
        "acc": [1.0, 1.1, 0.9, 1.0],
    }
    return pd.DataFrame({**columns, **changes})


def test_units_scale_columns_to_si() -> None:
    table = table_from_frame(frame(), parse_mapping(WORDS))
    np.testing.assert_allclose(table.time, [0.0, 1e-3, 2e-3, 3e-3], atol=1e-15)
    np.testing.assert_allclose(table.x[:, 0], [0.0, np.pi, -np.pi, np.pi / 2], rtol=1e-14)
    np.testing.assert_allclose(table.x[:, 1], [0.0, 100.0, 200.0, 300.0])
    np.testing.assert_allclose(table.y[:, 0], 9.80665 * np.array([1.0, 1.1, 0.9, 1.0]), rtol=1e-14)
    assert table.input_names == ("rate", "throttle")
    assert table.output_units == ("m/s^2",) and table.input_units == ("rad/s", "1")
    np.testing.assert_allclose(table.input_range[0], [-np.pi, np.pi])
    assert np.isnan(table.input_range[1]).all()


def test_a_unit_may_be_asked_for() -> None:
    words = {**WORDS, "outputs": [{"column": "acc", "unit": "g_0", "as": "cm/s^2"}]}
    table = table_from_frame(frame(), parse_mapping(words))
    assert table.y[0, 0] == pytest.approx(980.665, rel=1e-14)


def test_csv_gz_and_parquet_hold_the_same_table(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="Parquet needs the extra patagium[logs]")
    with gzip.open(tmp_path / "log.csv.gz", "wt") as file:
        frame().to_csv(file, index=False)
    frame().to_parquet(tmp_path / "log.parquet")
    mapping = parse_mapping(WORDS)
    one = read_table(tmp_path / "log.csv.gz", mapping)
    other = read_table(tmp_path / "log.parquet", mapping)
    np.testing.assert_array_equal(one.x, other.x)
    np.testing.assert_array_equal(one.y, other.y)


def test_gaps_are_found_and_said() -> None:
    words = {**WORDS, "gap": 2.5}
    table = table_from_frame(frame(stamp=[0.0, 1.0, 2.0, 9.0]), parse_mapping(words))
    assert table.gaps.tolist() == [3]
    assert "1 gap(s)" in table.describe_gaps() and "0.007 s" in table.describe_gaps()
    steady = table_from_frame(frame(), parse_mapping(words))
    assert steady.describe_gaps().startswith("no gap")


@pytest.mark.parametrize("kept", [7, [1, 0], [0, 9], [True], "all", [[0, 1]], 2**63, [0.5]])
def test_a_selection_that_is_none_is_refused(kept: Any) -> None:
    table = table_from_frame(frame(), parse_mapping(WORDS))
    assert table.where([0, 2]).x.tolist() == table.x[[0, 2]].tolist()
    with pytest.raises(ParameterError, match="kept: expected a slice, increasing indices"):
        table.where(kept)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"acc": [1.0, np.nan, 0.9, 1.0]},
            "column acc: expected finite numbers, found nan in row 2",
        ),
        ({"turn": [0.0, 1.0, np.inf, 0.0]}, "column turn: expected finite numbers, found inf"),
        ({"acc": ["a", "b", "c", "d"]}, "column acc: expected numbers, found 'a'"),
        ({"stamp": [0.0, 1.0, 1.0, 2.0]}, "the same stamp twice after row 2"),
        ({"stamp": [0.0, 2.0, 1.0, 3.0]}, "a step back of 0.001 s after row 2"),
    ],
)
def test_what_would_have_to_be_guessed_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(LogError, match=message):
        table_from_frame(frame(**changes), parse_mapping(WORDS))


def test_a_missing_column_is_named_with_what_the_file_holds() -> None:
    with pytest.raises(LogError, match=r"column\(s\) acc, but the file holds stamp, turn, thrott"):
        table_from_frame(frame().drop(columns="acc"), parse_mapping(WORDS))


def test_a_header_with_a_unit_must_agree() -> None:
    agreeing = frame().rename(columns={"acc": "acc [g_0]"})
    assert table_from_frame(agreeing, parse_mapping(WORDS)).y.shape == (4, 1)
    with pytest.raises(LogError, match="mapping says 'g_0', the header says 'm/s\\^2'"):
        table_from_frame(frame().rename(columns={"acc": "acc [m/s^2]"}), parse_mapping(WORDS))
    with pytest.raises(LogError, match="column acc: expected a unit of"):
        table_from_frame(frame().rename(columns={"acc": "acc [g]"}), parse_mapping(WORDS))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gaps": 3}, "gaps: expected one of the keys .*, found 'gaps'; did you mean gap\\?"),
        ({"outputs": []}, "outputs: "),
        ({"time": {"column": "stamp", "unit": "m"}}, "time .*expected a unit of"),
        ({"time": {"column": "stamp", "unit": "blinks"}}, "expected a unit such as"),
        ({"outputs": [{"column": "acc", "unit": "g_0", "as": "rad"}]}, "acc: expected a unit of"),
        ({"outputs": [{"column": "acc", "unit": "degC"}]}, "expected a unit that only scales"),
        ({"outputs": [{"column": "acc"}]}, "outputs.0.unit: expected a value here, found nothing"),
        ({"outputs": [{"column": "turn", "unit": "1", "name": "rate"}]}, "rate twice"),
        ({"outputs": [{"column": "acc", "unit": "1", "range": [2, 1]}]}, "low < high"),
        ({"gap": 0.5}, "gap: .*greater than 1"),
    ],
)
def test_a_mapping_that_does_not_fit_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(LogError, match=message):
        parse_mapping({**WORDS, **change})


def test_mapping_files(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="found no such file"):
        load_mapping(tmp_path / "none.yaml")
    (tmp_path / "bad.yaml").write_text("time: [")
    with pytest.raises(LogError, match="expected readable YAML"):
        load_mapping(tmp_path / "bad.yaml")
    (tmp_path / "list.yaml").write_text("- 1")
    with pytest.raises(LogError, match="list.yaml: file"):
        load_mapping(tmp_path / "list.yaml")


def test_files_that_are_no_tables(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no such file"):
        read_table(tmp_path / "none.csv", parse_mapping(WORDS))
    (tmp_path / "empty.csv").write_text("")
    with pytest.raises(LogError, match="expected names, found no line"):
        read_table(tmp_path / "empty.csv", parse_mapping(WORDS))
    (tmp_path / "headers.csv").write_text("stamp,turn,throttle,acc\n")
    with pytest.raises(LogError, match="found an empty table"):
        read_table(tmp_path / "headers.csv", parse_mapping(WORDS))

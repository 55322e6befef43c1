import gzip
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from tests.tables import table_of

from patagium.errors import LogError, ParameterError
from patagium.sensing.logs.importing.import_log import read_table
from patagium.sensing.logs.mapping import load_mapping, parse_mapping

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
    table = table_of(frame(), WORDS)
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
    table = table_of(frame(), words)
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
    table = table_of(frame(stamp=[0.0, 1.0, 2.0, 9.0]), words)
    assert table.gaps.tolist() == [3]
    assert "1 gap(s)" in table.describe_gaps() and "0.007 s" in table.describe_gaps()
    steady = table_of(frame(), words)
    assert steady.describe_gaps().startswith("no gap")


@pytest.mark.parametrize("kept", [7, [1, 0], [0, 9], [True], "all", [[0, 1]], 2**63, [0.5]])
def test_a_selection_that_is_none_is_refused(kept: Any) -> None:
    table = table_of(frame(), WORDS)
    assert table.where([0, 2]).x.tolist() == table.x[[0, 2]].tolist()
    with pytest.raises(ParameterError, match="kept: expected a slice, increasing indices"):
        table.where(kept)


def test_rows_that_lack_a_number_are_left_out_and_told(tmp_path: Path) -> None:
    told: list[Any] = []
    frame(acc=[1.0, np.nan, 0.9, np.inf]).to_csv(tmp_path / "log.csv", index=False)
    table = read_table(tmp_path / "log.csv", parse_mapping(WORDS), told.extend)
    np.testing.assert_allclose(table.y[:, 0], [9.80665, 0.9 * 9.80665], rtol=1e-14)
    np.testing.assert_allclose(table.time, [0.0, 2e-3], atol=1e-12)
    assert any(one.kind == "missing numbers" and one.where == "acc" for one in told)


def test_a_column_of_text_is_refused() -> None:
    with pytest.raises(LogError, match="acc.*text such as 'a'"):
        table_of(frame(acc=["a", "b", "c", "d"]), WORDS)


def test_a_missing_column_is_named_with_what_the_file_holds() -> None:
    with pytest.raises(LogError, match=r"acc.*stamp, turn, thrott"):
        table_of(frame().drop(columns="acc"), WORDS)


def test_a_header_with_another_unit_is_told(tmp_path: Path) -> None:
    told: list[Any] = []
    for unit in ("g_0", "m/s^2"):
        frame().rename(columns={"acc": f"acc [{unit}]"}).to_csv(tmp_path / "log.csv", index=False)
        assert read_table(tmp_path / "log.csv", parse_mapping(WORDS), told.extend).y.shape == (4, 1)
    texts = [one.text for one in told if one.kind == "unit"]
    assert texts == ["the file or its definitions say [m/s^2], the mapping [g_0]"]


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


FINITE = "finite and below 1e.30, found"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"air": {"density": inf}}, f"^m: air.density: .*{FINITE} inf"),
        ({"air": {"density": True}}, "^m: air.density: expected a pure number .*found True"),
        ({"air": {"wind": [nan, 0, 0]}}, f"^m: air.wind.0: .*{FINITE} nan"),
        ({"gap": inf}, f"^m: gap: .*{FINITE} inf"),
        ({"time": {"rate": True}}, "^m: time.rate: expected a rate such as .*found True"),
        (
            {"time": {"rate": "0 Hz"}},
            "^m: time.rate: expected a number greater than 0, ",
        ),
        ({"time": {"rate": 1e7}}, "^m: time.rate: expected a number less than 10000000, found"),
        ({"time": {"restamp": {"t": True}}}, "(?m)^m: time.restamp.t: .*found True"),
        ({"offset": nan}, f"^m: outputs.0.offset: .*{FINITE} nan"),
        ({"offset": True}, "^m: outputs.0.offset: expected a pure number .*found True"),
        ({"range": [3, inf]}, f"^m: outputs.0.range.1: .*{FINITE} inf"),
        ({"range": [True, 5]}, "^m: outputs.0.range.0: .*found True"),
        ({"negated": "yes"}, "^m: outputs.0.negated: expected true or false, found 'yes'"),
    ],
)
def test_numbers_of_a_mapping_are_finite_and_no_flags(change: dict[str, Any], message: str) -> None:
    """An infinite gap was a traceback, a density of inf was kept, a true offset subtracted 1."""
    if not {*change} & {"air", "gap", "time"}:
        change = {"outputs": [{"column": "acc", "unit": "deg", **change}]}
    with pytest.raises(LogError, match=message):
        parse_mapping({**WORDS, **change}, "m")


def test_numbers_of_a_mapping_may_have_a_power_of_ten() -> None:
    """YAML takes 1e-3 for text."""
    column = {"column": "acc", "unit": "deg", "offset": "1e-3"}
    assert parse_mapping({**WORDS, "outputs": [column]}).outputs[0].offset == 1e-3


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
    with pytest.raises(LogError, match="expected a CSV, .* found an empty file"):
        read_table(tmp_path / "empty.csv", parse_mapping(WORDS))
    (tmp_path / "headers.csv").write_text("stamp,turn,throttle,acc\n")
    with pytest.raises(LogError, match="expected samples below the line of names, found none"):
        read_table(tmp_path / "headers.csv", parse_mapping(WORDS))

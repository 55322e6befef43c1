"""Logs too long for memory: read and learned from in blocks, interrupted and gone on from."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import patagium as pt
from patagium.errors import LogError
from patagium.learning import long_log
from patagium.learning.identify import identify
from patagium.learning.long_log import identify_record, remove_course
from patagium.learning.table_network import network_for
from patagium.sensing.logs.files import table_files
from patagium.sensing.logs.importing.import_log import import_log
from patagium.sensing.logs.mapping import parse_mapping
from patagium.sensing.logs.record import LogRecord
from patagium.sensing.logs.table import LogTable

WORDS: dict[str, Any] = {
    "time": {"column": "t", "unit": "s"},
    "inputs": [{"column": f"x{k}", "unit": "1", "range": [-1, 1]} for k in range(2)],
    "outputs": [
        {"column": "y", "unit": "N", "range": [-1, 1]},
        {"column": "still", "unit": "N", "range": [-1, 1]},
    ],
}
COUNT = 3000


def written(folder: Path, count: int = COUNT) -> Path:
    rng = np.random.default_rng(0)
    time = 1e-3 * np.arange(count)
    time[count // 3 :] += 0.5
    x = rng.uniform(-1, 1, (count, 2))
    y = 0.5 * x[:, 0] - 0.3 * x[:, 1] ** 2 + 0.02 * rng.normal(size=count)
    columns = {"t": time, "x0": x[:, 0], "x1": x[:, 1], "y": y, "still": np.full(count, 0.25)}
    pd.DataFrame(columns).to_csv(folder / "log.csv", index=False)
    return folder / "log.csv"


@pytest.fixture
def record(tmp_path: Path) -> Any:
    found = import_log(written(tmp_path), parse_mapping(WORDS), tmp_path / "log.nc")
    with LogRecord(found.path) as opened:
        yield opened


def learner(table: LogTable) -> pt.CubatureLearner:
    return pt.CubatureLearner(
        network_for(table, (3,)), prior_std=0.5, measurement_std=0.05, spread=0.5
    )


class Stopped(BaseException):
    """Ctrl-C, or a kill."""


def stops_after(calls: int) -> Callable[[int, int], None]:
    left = calls

    def progress(done: int, total: int) -> None:
        nonlocal left
        left -= 1
        assert 0 <= done <= total
        if left < 0:
            raise Stopped

    return progress


@pytest.mark.parametrize("every", [1, 7])
def test_blocks_give_the_scores_of_one_stream(every: int, record: LogRecord) -> None:
    table = record.table()
    whole = identify(table, learner(table), every=every)
    parts = identify_record(record, learner(table), every=every, block=500)
    np.testing.assert_array_equal(parts.learner.weights, whole.learner.weights)
    for key in (
        "samples", "samples_predicted", "updates", "gaps", "silent", "outcome", "every",
    ):  # fmt: skip
        assert parts.scores[key] == whole.scores[key], key
    for key in (
        "nmse", "nmse_second_half", "persistence", "persistence_second_half",
    ):  # fmt: skip
        assert parts.scores[key]["y"] == pytest.approx(whole.scores[key]["y"], rel=1e-9), key
        assert np.isnan(parts.scores[key]["still"])
    assert parts.scores["coverage"] == pytest.approx(whole.scores["coverage"], abs=0.05)
    assert parts.scores["nis_per_channel"] == pytest.approx(
        whole.scores["nis_per_channel"], rel=0.2
    )
    # but for a file kept: the record of the last block alone
    assert set(whole.scores) <= set(parts.scores) and "last" in parts.scores["recorded"]


def test_the_last_weights_are_scored_over_the_whole_second_half(
    record: LogRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last weights were scored on the last block only, where they are most accurate."""
    monkeypatch.setattr(long_log, "_FEW", 400)
    found = identify_record(record, learner(record.table()), every=7, block=500)
    frozen = pt.evaluate(record.table(), found.learner).scores["nmse_second_half"]
    assert found.scores["frozen_second_half"] == pytest.approx(frozen, rel=1e-9, nan_ok=True)


def test_horizons_are_scored_in_every_block(record: LogRecord) -> None:
    table = record.table()
    whole = identify(table, learner(table), every=10, horizons={"20ms": 0.02})
    parts = identify_record(record, learner(table), every=10, horizons={"20ms": 0.02}, block=1000)
    assert parts.scores["forecast_20ms_count"] > whole.scores["forecast_20ms_count"] > 50
    found, expected = (r.scores["forecast_20ms_held"]["y"] for r in (parts, whole))
    assert found == pytest.approx(expected, rel=0.3)  # of other times
    assert set(whole.scores) <= set(parts.scores)


def test_learning_goes_on_where_it_was_interrupted(record: LogRecord, tmp_path: Path) -> None:
    table, course = record.table(), tmp_path / "learner.course"
    options: dict[str, Any] = {"every": 3, "horizons": "20ms", "block": 400}
    straight = identify_record(record, learner(table), **options)
    with pytest.raises(Stopped):
        identify_record(record, learner(table), **options, course=course, progress=stops_after(700))
    assert course.exists() and len(list(tmp_path.glob("learner.course.*.state"))) == 1
    seen: list[int] = []
    again = identify_record(
        record, learner(table), **options, course=course, progress=lambda k, _: seen.append(k)
    )
    assert seen[0] > 1000  # it did not begin anew
    np.testing.assert_array_equal(again.learner.weights, straight.learner.weights)
    for key in (
        "nmse",
        "persistence_second_half",
        "forecast_20ms_nmse",
        "coverage",
        "nis_inside",
        "updates",
        "gaps",
    ):
        assert again.scores[key] == pytest.approx(straight.scores[key], nan_ok=True), key
    remove_course(course)
    assert not list(tmp_path.glob("learner.course*"))


def test_a_course_is_removed_by_its_own_name(tmp_path: Path) -> None:
    """A state's name was taken as a pattern: the kept learner of another run was removed."""
    own = {"run[1].course", "run[1].course.250.state", "run[1].course.500.state"}
    others = {"run1.course", "run1.course.250.state", "run[1].course.copy.state"}
    for name in own | others:
        (tmp_path / name).touch()
    remove_course(tmp_path / "run[1].course")
    assert {one.name for one in tmp_path.iterdir()} == others


def test_a_course_of_another_log_is_refused(record: LogRecord, tmp_path: Path) -> None:
    table, course = record.table(), tmp_path / "learner.course"
    with pytest.raises(Stopped):
        identify_record(
            record, learner(table), every=3, block=400, course=course, progress=stops_after(700)
        )
    with pytest.raises(LogError, match="of another log, learner or setting"):
        identify_record(record, learner(table), every=4, block=400, course=course)
    # numpy raises ValueError, EOFError and BadZipFile of these: the last two came through
    for content in (b"no course", b"", b"PK\3\4abc", course.read_bytes()[:300]):
        course.write_bytes(content)
        with pytest.raises(LogError, match="no course to go on from"):
            identify_record(record, learner(table), every=3, block=400, course=course)


@pytest.mark.parametrize("calls", [3, 10, 20])
@pytest.mark.parametrize("kind", ["nc", "csv"])
def test_an_interrupted_import_leaves_what_was_there(
    calls: int, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_files, "BLOCK", 150)
    path, words, out = written(tmp_path), parse_mapping(WORDS), tmp_path / f"out.{kind}"
    for before in (None, b"of another day"):
        if before is not None:
            out.write_bytes(before)
        names = sorted(one.name for one in tmp_path.iterdir())
        with pytest.raises(Stopped):
            import_log(path, words, out, progress=stops_after(calls))
        assert sorted(one.name for one in tmp_path.iterdir()) == names
        assert before is None or out.read_bytes() == before
    assert import_log(path, words, out).samples == COUNT
    assert sorted(one.name for one in tmp_path.iterdir()) == sorted({*names, out.name})


def test_blocks_do_not_change_an_import(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, words = written(tmp_path), parse_mapping(WORDS)
    whole = import_log(path, words, tmp_path / "whole.nc")
    monkeypatch.setattr(table_files, "BLOCK", 150)
    parts = import_log(path, words, tmp_path / "parts.nc")
    assert parts.findings == whole.findings and parts.samples == whole.samples
    with LogRecord(whole.path) as one, LogRecord(parts.path) as other:
        np.testing.assert_array_equal(one.time(), other.time())
        np.testing.assert_array_equal(one.values(one.labels), other.values(one.labels))


def test_scales_of_another_log_cost_no_sample(tmp_path: Path) -> None:
    """The first second of a log was left out although it did not scale the learner."""
    words = WORDS | {"outputs": [{"column": "y", "unit": "N"}]}
    path = import_log(written(tmp_path), parse_mapping(words), tmp_path / "log.nc").path
    with LogRecord(path) as opened:
        table = opened.table()
        own = identify_record(opened, learner(table), every=7).scores
        other = identify_record(opened, learner(replace(table, y=2 * table.y)), every=7).scores
    assert own["samples_that_scaled"] > 900 and other["samples_that_scaled"] == 0
    assert other["samples_predicted"] == COUNT

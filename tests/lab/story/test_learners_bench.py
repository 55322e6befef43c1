"""`patagium study bench learners`: the search, the race, the page, and who is missing on it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from patagium.cli.main import run
from patagium.errors import FilterDiverged, Outcome, ParameterError
from patagium_lab.learners import run as learners_bench
from patagium_lab.learners.data_sets import flight_data, load_data, log_data
from patagium_lab.learners.entries import ENTRIES, SPANS, HeldSample, entries_of, entry
from patagium_lab.learners.page import page as learners_page
from patagium_lab.learners.plan import LearnersPlan
from patagium_lab.learners.run import compare
from patagium_lab.learners.trial import (
    ScoredSpan,
    drawn_settings,
    run_trial,
    search_settings,
    teach,
)
from patagium_lab.study import Stages

PLAN = LearnersPlan(after=(0.02, 0.04), tuning=0.08, draws=4, limit=5.0, twin_limit=0.5, workers=0)
LOG = Path(__file__).parents[3].parent / "shared" / "data" / "crazyflie" / "log16.csv.gz"
SETTING = {"prior": 0.5, "noise": 0.01, "memory": 1000.0, "spread": 1.7}


class Diverging(HeldSample):
    """Loses its numbers in the first span, and itself after the 200th sample."""

    def __init__(self, course, setting, seed):
        super().__init__(course.y.shape[1])
        self.count = 0

    def update(self, x, y):
        if self.count == 200:
            raise FilterDiverged("lost", Outcome.NOT_FINITE)
        self.count += 1
        super().update(x, y * (np.nan if self.count > 100 else 1.0))


@pytest.fixture(scope="module")
def course():
    return flight_data("corrected", 0.06)


@pytest.fixture(scope="module")
def found(course):
    told: list[tuple[str, float]] = []
    only = ("persistence", "node", "node32", "features", "filterpy", "dynamax")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(learners_bench, "ROUNDS", 1)
        result = compare(
            [course], replace(PLAN, only=only), Stages(lambda *stage: told.append(stage))
        )
    assert told[0] == ("tuned", 0.0) and told[-1] == ("done", 1.0)
    assert [part for _, part in told] == sorted(part for _, part in told)
    return result


def test_rows_are_whole(found):
    (course,) = found["courses"]
    rows = {row["key"]: row for row in course["rows"]}
    assert len(rows) == 6
    for key in ("node", "node32", "features"):
        row = rows[key]
        assert row["outcome"] == "completed" and row["samples"] > 100
        assert set(row["errors"]) == {"0.02", "0.04"}
        assert all(0 < e < 10 for kinds in row["errors"].values() for e in kinds.values())
        assert row["microseconds"] > 1
        assert 0 <= row["coverage"] <= 1 and 0 <= row["scaled"] <= 1
    assert rows["node32"]["setting"] == rows["node"]["setting"]
    assert set(rows["node"]["setting"]) == {"prior", "noise", "memory", "spread"}
    assert rows["features"]["weights"] == 101 * 14
    assert rows["persistence"]["setting"] == {} and rows["persistence"]["microseconds"] is None
    assert json.loads(json.dumps(found))["plan"]["draws"] == 4


def test_what_is_missing_or_slow_is_said(found):
    rows = {row["key"]: row for row in found["courses"][0]["rows"]}
    for key in ("filterpy", "dynamax"):
        if entry(key).installed:
            assert rows[key]["outcome"] in ("completed", "out of time")
            assert entry(key).package in rows[key]["program"]
        else:
            assert rows[key]["outcome"] == "not installed" and not rows[key]["errors"]


def test_the_page_shows_every_row_and_its_figure(found, tmp_path):
    text = learners_page(found).write(tmp_path / "page.md").read_text("utf-8")
    assert (tmp_path / "page" / "error-against-time.svg").stat().st_size > 5_000
    assert "](page/error-against-time.svg)" in text
    for row in found["courses"][0]["rows"]:
        assert text.count(f"| {row['title']} |") >= 2
    assert "Pareto-optimal after 0.04 s (fastest first)" in text
    assert "4 settings" in text and "load average" in text


def test_an_entry_nobody_knows_is_refused(course):
    with pytest.raises(ParameterError, match="node32"):
        LearnersPlan(only=("nodes",))


def test_the_search_takes_the_best_of_its_draws(course):
    plan, node = replace(PLAN, draws=8), entry("node")

    def error(setting, part):
        span = ScoredSpan(part / 2, part, ("short",))
        teach(node, course, setting, [span], np.inf, plan.seed)
        return span.errors(course.moving)["short"]

    settings = drawn_settings(node.knobs, plan.draws, plan.seed)
    better = sorted(settings, key=lambda one: error(one, plan.tuning / 4))[:2]
    best, factor = search_settings(node, course, plan)
    assert best == min(better, key=lambda one: error(one, plan.tuning))
    assert factor > 0
    assert search_settings(entry("persistence"), course, plan)[0] == {}


def test_everybody_draws_within_the_same_spans():
    for one in ENTRIES:
        assert set(one.knobs) <= set(SPANS)
        assert bool(one.knobs) != bool(one.twin) or one.key == "persistence"
        if one.twin:
            assert entry(one.twin).knobs
    for setting in drawn_settings(tuple(SPANS), 50, 0):
        assert all(SPANS[k][0] <= value <= SPANS[k][1] for k, value in setting.items())
    assert drawn_settings(("prior",), 5, 0) != drawn_settings(("prior",), 5, 1)


def test_errors_are_those_of_the_samples_predicted(course):
    result = run_trial(entry("persistence"), course, {}, float("nan"), PLAN)
    begin = round(0.04 / course.step)
    used = np.arange(begin, round((0.04 + course.beat) / course.step), course.every)
    rows = (used[:, None] + 1 + np.arange(course.every)).ravel()
    truth, held = course.y[rows][:, course.moving], course.y[used.repeat(course.every)]
    error = np.mean((truth - held[:, course.moving]) ** 2, axis=0) / truth.var(axis=0)
    assert result["errors"]["0.04"]["hold"] == pytest.approx(error.mean(), rel=1e-9)
    assert 6 <= course.moving.sum() <= 12  # not the lateral forces of a symmetric flight


def test_a_learner_out_of_time_or_out_of_numbers_says_so(course):
    slow = run_trial(entry("node"), course, SETTING, 1.0, replace(PLAN, limit=0.0))
    assert slow["outcome"] == "out of time" and slow["samples"] == 1 and slow["errors"] == {}
    diverges = replace(entry("linear"), build=Diverging)
    failed = run_trial(diverges, course, SETTING, 1.0, PLAN)
    assert failed["outcome"] == "failed: FilterDiverged" and failed["samples"] == 200
    assert set(failed["errors"]) == {"0.02"} and failed["errors"]["0.02"]["hold"] == np.inf


def test_a_course_survives_its_file(course, tmp_path):
    again = load_data(course.save(tmp_path))
    np.testing.assert_array_equal(again.x, course.x)
    assert again.networks == course.networks and again.gaps == course.gaps
    assert {one.key for one in entries_of(course)} == {one.key for one in ENTRIES}


@pytest.mark.skipif(not LOG.is_file(), reason="the Crazyflie log is not here")
def test_the_log_is_a_course_without_strips():
    course = log_data(LOG)
    assert "strip" not in course.networks
    assert "strip" not in {one.key for one in entries_of(course)}
    assert len(course.gaps) == 1 and 13 < course.clock[-1] < 14.5  # two flights, their pause cut
    gap = course.gaps[0]
    begin = course.clock[gap] - 0.02
    span = ScoredSpan(begin, begin + 0.04, ("short",))
    teach(entry("persistence"), course, {}, [span], np.inf, 0)
    assert len(span.truth["short"]) < 40  # no window crosses the pause


def test_the_command_writes_page_and_figures(tmp_path, monkeypatch, capsys):
    page, figures = tmp_path / "page.md", tmp_path / "found.json"
    run_study = learners_bench.run
    in_this_process = lambda plan, stages: run_study(replace(plan, workers=0), stages)  # noqa: E731
    monkeypatch.setattr(learners_bench, "run", in_this_process)
    with pytest.raises(SystemExit) as left:
        run(["bench", "learners", "--quick", "--only", "node", "-o", str(page), "--json",
             str(figures)])  # fmt: skip
    assert not left.value.code, capsys.readouterr().err
    assert [one["key"] for one in json.loads(figures.read_text())["courses"]] == [
        "published", "corrected",
    ]  # fmt: skip
    assert "The published flight" in page.read_text("utf-8")
    with pytest.raises(SystemExit) as left:
        run(["bench", "learners", "--log", str(tmp_path / "none.csv")])
    assert left.value.code == 2 and "none.csv" in capsys.readouterr().err

"""The study of foreign air on a few flights: kept results, marked misses, refused plans."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from patagium.errors import ParameterError
from patagium.learning import ExtendedLearner, default_learner, evaluate, identify
from patagium.learning.models.linear_strip import LinearStripNetwork
from patagium.report import cell_text
from patagium.simulation import air_of, load_flight, robot_of
from patagium_lab.foreign import near as near_page
from patagium_lab.foreign import page as pages
from patagium_lab.foreign import trials as trial_module
from patagium_lab.foreign.contestants import DEFAULT
from patagium_lab.foreign.flights import DISTANCES, Case, near_cases
from patagium_lab.foreign.plan import QUICK, ForeignPlan
from patagium_lab.foreign.run import planned, run, split
from patagium_lab.foreign.subjects import LATTICE, MOUNTED
from patagium_lab.foreign.trials import BEST, PHYSICS, SEARCH, Trial, run_trial
from patagium_lab.study import Stages, write_study
from patagium_lab.verbs.foreign import foreign

SMALL = ForeignPlan(
    airs=(LATTICE,),
    robots=("wing-slender",),
    contestants=("linear",),
    learned=1,
    unseen=1,
    near=0,
    real=False,
    workers=0,
)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of two stored wingbeats of one wing, which needs no other program."""
    folder = tmp_path_factory.mktemp("foreign") / "out"
    report, page = write_study(folder, SMALL, run, pages.page)
    page.write(folder / "page.md")
    assert report == folder / "report.html"
    return folder


@pytest.fixture(scope="module")
def metrics(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / "metrics.json").read_text())
    return found


def test_every_contestant_stands_beside_physics_and_the_held_sample(
    out: Path, metrics: dict[str, Any]
) -> None:
    assert [row["contestant"] for row in metrics["rows"]] == [PHYSICS, "linear"]
    text = (out / "page.md").read_text("utf-8")
    for row in [*metrics["rows"], *pages.held_rows(metrics["rows"])]:
        errors = [row["known"]["worst"], row["unseen"][0]["worst"]]
        shown = [f"{cell_text(one)} \\*" for one in errors]  # all of these miss
        assert all(one in text for one in shown), (row["contestant"], shown)
    for title in ("Targets", "What was kept apart", "How it is scored"):
        assert f"\n## {title}\n" in text


def test_held_and_known_are_those_of_the_flight(out: Path, metrics: dict[str, Any]) -> None:
    physics, linear = metrics["rows"]
    assert physics["known"]["held"] == pytest.approx(linear["known"]["held"])
    assert 0.0 < linear["known"]["coverage"] <= 1.0 and physics["known"]["coverage"] is None
    assert linear["outcome"] == "COMPLETED" and linear["update"] > 0
    flights = sorted(path.stem for path in out.glob("flights/*/*/wing-slender/*.nc"))
    assert flights[0] == f"{linear['gait']:02d}" and len(flights) == 2


def test_a_study_goes_on_where_it_stopped(
    out: Path, metrics: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(trial_module, "identify")
    monkeypatch.delattr(trial_module, "evaluate")
    assert run(SMALL, out, Stages()).metrics["rows"] == metrics["rows"]
    more = replace(SMALL, contestants=("features",))
    with pytest.raises(NameError):  # a new contestant is computed
        run(more, out, Stages())


def test_what_is_kept_apart_is_learned_apart(metrics: dict[str, Any]) -> None:
    trials, _ = planned(replace(QUICK, learned=3, unseen=3), Path("nowhere"))
    assert {trial.contestant for trial in trials} == {PHYSICS, *QUICK.contestants}
    for trial in trials:
        assert {one.apart for one in trial.unseen} <= {trial.learned.apart}
        assert {one.robot for one in trial.unseen} <= {trial.learned.robot}
        assert trial.learned not in trial.unseen
    kept = split(ForeignPlan())
    assert metrics["split"][LATTICE]["wing-slender"] == kept[LATTICE]["wing-slender"]
    assert sum(len(gaits) == 12 for gaits in kept[MOUNTED].values()) == 2


def test_a_lost_learner_is_a_row_and_no_end(
    out: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    gaits = sorted(out.glob("flights/choosing/*/wing-slender/*.nc"))
    learned, other = (Case(LATTICE, "wing-slender", int(p.stem), 13, False) for p in gaits[:2])

    def lost(*_: object, **__: object) -> None:
        raise ArithmeticError("no number")

    monkeypatch.setattr(trial_module, "evaluate", lost)
    row = run_trial(Trial("linear", learned, (other,), 10), out / "flights", tmp_path)
    assert row["unseen"] == [{"worst": None, "mean": None, "coverage": 0.0, "held": None}]
    assert pages.figures([row], "unseen", "worst")[0] == float("inf")
    assert load_flight(learned.path(out / "flights")).attrs["mount"] == "carried"


def row_of(name: str, known: float, unseen: float, coverage: float | None = 0.95) -> dict[str, Any]:
    """A row of nothing."""
    score = {"mean": 0.0, "coverage": coverage, "held": 0.5}
    return {
        **{"contestant": name, "air": LATTICE, "robot": "wing", "gait": 0, "apart": False},
        "known": {"worst": known, **score},
        "unseen": [{"worst": unseen, **score}],
    }


def test_misses_are_marked_against_the_limits() -> None:
    rows = [row_of(PHYSICS, 3.0, 3.0, None), row_of("strip", 1e-3, 1e-2), row_of("dense", 1e-3, 9)]
    rows += pages.held_rows(rows)
    assert pages.shown(rows) == "strip"
    targets = {row["target"].split(": ")[1]: row for row in pages.target_rows(rows)}
    assert all(row["met"] for row in targets.values())
    assert targets["unseen, over the best of held sample, physics and least squares"][
        "found"
    ] == pytest.approx(1e-2 / 0.5)
    worse = pages.target_rows([*rows, row_of("strip", 3e-3, 1e-2, 0.2)])
    assert [row["met"] for row in worse] == [False, False, True, False, True]
    assert worse[0]["flights"] == "1 of 2" and worse[0]["found"] == 3e-3
    named = pages.shown([*rows, row_of(DEFAULT, 1.0, 100.0)])
    assert named == DEFAULT


def test_a_search_is_scored_beside_the_default_as_its_pick_and_its_best_trial(
    out: Path, tmp_path: Path
) -> None:
    gaits = sorted(out.glob("flights/choosing/*/wing-slender/*.nc"))
    learned, other = (Case(LATTICE, "wing-slender", int(p.stem), 13, False) for p in gaits[:2])
    row = run_trial(Trial(SEARCH, learned, (other,), 40, 8), out / "flights", tmp_path)
    (best,) = pages.best_rows([row])
    assert best["contestant"] == BEST and row["contestant"] == SEARCH
    assert 0 < best["known"]["worst"] <= row["known"]["worst"] < 1
    assert len(best["unseen"]) == 1 and "prior_std" in row["settings"]
    flight = {"robot": learned.robot, "gait": learned.gait}
    default, physics = ({**row_of(name, 1.0, 1.0), **flight} for name in (DEFAULT, PHYSICS))
    default["known"] = {**default["known"], "worst": 3.5 * best["known"]["worst"]}
    targets = pages.target_rows([physics, default, row, best])
    found = [one for one in targets if one["target"].startswith("all air")]
    assert len(found) == 2 and found[1]["found"] == pytest.approx(3.5) and not found[1]["met"]
    assert found[0]["found"] <= found[1]["found"]


def test_on_a_vortex_lattice_the_default_sees_attached_flow_and_carries_over_further(
    out: Path,
) -> None:
    paths = sorted(out.glob("flights/choosing/*/wing-slender/*.nc"))
    flight, other = (load_flight(path) for path in paths[:2])
    learner = default_learner(flight)
    assert learner.network.attached
    plain = ExtendedLearner(LinearStripNetwork(robot_of(flight), air_of(flight)))
    known, unseen = [], []
    for one in (learner, plain):
        known.append(identify(flight, one, every=10).scores["nmse_second_half_worst"])
        unseen.append(evaluate(other, one).scores["nmse_mean"])
    assert known[0] < known[1] / 5  # .00008 and .0014
    assert unseen[0] < 0.75 * unseen[1]  # mean of the outputs, .0079 and .015


def test_near_wingbeats_stay_at_their_distance_on_one_ray() -> None:
    case = Case(MOUNTED, "hawk", 0, 13, True)
    drawn, around = case.wingbeat(), near_cases(case, 2)
    assert [one.distance for one in around] == [d for d in DISTANCES for _ in range(2)]
    assert len({one.path(Path()) for one in around}) == 6 and all(one.apart for one in around)
    largest = max(drawn.amplitude.values())
    for one in around:
        beat = one.wingbeat()
        assert beat == one.wingbeat()
        shares = [beat.frequency / drawn.frequency - 1, beat.speed / drawn.speed - 1]
        shares += [beat.amplitude[k] / drawn.amplitude[k] - 1 for k in drawn.amplitude]
        shares += [beat.phase[k] - drawn.phase[k] for k in drawn.phase]
        shares += [(beat.offset[k] - drawn.offset[k]) / largest for k in drawn.offset]
        shares.append((beat.incidence - drawn.incidence) / largest)
        assert max(map(abs, shares)) == pytest.approx(one.distance)
        nearer, farther = (around[k + one.direction].wingbeat().frequency for k in (0, 4))
        assert nearer - drawn.frequency == pytest.approx((farther - drawn.frequency) / 4)


def test_near_flights_are_learned_by_the_default_and_their_misses_marked() -> None:
    plan = ForeignPlan(airs=(MOUNTED,), robots=("aerobat",), contestants=(DEFAULT,), near=1)
    trials, absent = planned(plan, Path("nowhere"))
    near = [trial for trial in trials if trial.unseen[0].distance]
    if not absent:  # with MuJoCo
        assert [trial.contestant for trial in near] == [PHYSICS, DEFAULT]
        assert all(trial.learned.apart for trial in near)
    row = row_of(DEFAULT, 1e-3, 1e-2)
    row |= {"unseen": [row["unseen"][0]] * 3, "distances": list(DISTANCES)}
    row["unseen"] = [{**row["unseen"][0], "worst": worst} for worst in (0.01, 0.03, 9.0)]
    target = near_page.near_targets([row])[0]
    assert not target["met"] and target["found"] == 0.03 and target["flights"] == "1 of 2"
    assert near_page.at_distance([row], 0.4, "worst").tolist() == [9.0]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"airs": ("water",)}, "air"),
        ({"robots": ("bird",)}, "robot"),
        ({"contestants": ("oracle",)}, "contestant"),
        ({"learned": 0}, "learned"),
        ({"unseen": 12}, "unseen"),
        ({"gaits_apart": 1}, "gaits_apart"),
        ({"near": -1}, "near"),
        ({"search": 7}, "search"),
    ],
)
def test_a_plan_that_cannot_be_is_refused(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        ForeignPlan(**wrong)


def test_the_verb_writes_the_page(
    out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("patagium_lab.foreign.plan.QUICK", SMALL)
    app = typer.Typer()
    app.command()(foreign)
    words = ["--out", str(out), "--quick", "--jobs", "0", "--page", str(tmp_path / "page.md")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0 and f"The report is in {out / 'report.html'}" in done.output
    assert (tmp_path / "page.md").read_text("utf-8").startswith("<!-- Written by patagium")

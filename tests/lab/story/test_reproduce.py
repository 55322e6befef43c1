"""The reproduction on short flights: every section, every number from the metrics, no links out."""

from __future__ import annotations

import html
import json
import math
import os
import re
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

from patagium.report import cell_text
from patagium_lab.bench import overhead
from patagium_lab.reproduction.cases import STRIPS
from patagium_lab.reproduction.page import RESULTS, page
from patagium_lab.reproduction.plan import LIMITS, ReproductionPlan
from patagium_lab.reproduction.run import run
from patagium_lab.reproduction.unsteady_trials import unsteady_trials
from patagium_lab.rivals import symbolic_rival
from patagium_lab.rivals.compiled import SHORT_FLAGS
from patagium_lab.study import write_study
from patagium_lab.targets import verdict

from ...chromium import Chromium, found

SECTIONS = (
    "Two experiments",
    "The claims of the paper",
    "Targets",
    "What each error of the published experiment does",
    "Overhead of dynamics and of aerodynamics",
    "Learning the published flight",
    "Learning the corrected flight",
    "Gaits never seen",
    "What limits the dense network",
    "The luck of the start",
    "Air with memory",
    "A measured flapping wing (Yeo et al. 2011)",
    "How it was run",
)
FIGURES = (
    *("overhead_dynamics", "overhead_aerodynamics"),
    *(
        f"{flight}_{name}"
        for flight in ("published", "corrected")
        for name in (
            "flight",
            "forces_body",
            "forces_attitude",
            "forces_left_wing",
            "innovation",
            "learning",
            "unseen",
        )
    ),
    *(
        f"unsteady_{mount}_{name}"
        for mount in ("free", "fixed")
        for name in ("forces_body", "forces_left_wing", "unseen")
    ),
    *("corrected_still", "corrected_lift"),
    "unsteady_scores",
)


BRIEF_FLAGS = ("-O0", *SHORT_FLAGS[1:])
"""Flags of the rival's long text, which GCC optimizes for long; no test reads its times."""
compile_ahead = overhead.compile_ahead


def compile_briefly(kind: str, name: str) -> None:
    """The job that compiles ahead, with the flags of this test: it runs in a worker process."""
    symbolic_rival.SHORT_FLAGS = BRIEF_FLAGS
    compile_ahead(kind, name)


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("reproduction")
    told: list[float] = []
    early: dict[str, Any] = {}

    def progress(stage: str, part: float) -> None:
        told.append(part)
        if not early and (out / "report.html").exists():
            early.update(part=part, page=(out / "report.html").read_text(encoding="utf-8"))

    plan = ReproductionPlan.of(quick=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(symbolic_rival, "SHORT_FLAGS", BRIEF_FLAGS)
        patch.setattr(overhead, "compile_ahead", compile_briefly)
        report, results = write_study(out, plan, run, page, progress)
    results.only(RESULTS).write(out / "results.md")
    return {
        "out": out,
        "report": report,
        "told": told,
        "early": early,
        "page": report.read_text(encoding="utf-8"),
        "metrics": json.loads((out / "metrics.json").read_text(encoding="utf-8")),
    }


def test_all_results_are_written(outcome: dict[str, Any]) -> None:
    out = outcome["out"]
    assert outcome["report"] == out / "report.html"
    drawn = {path.name for path in (out / "figures").iterdir()}
    assert drawn == {f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg")}
    for name in ("published", "corrected", "unsteady_free", "unsteady_fixed"):
        with xr.open_dataset(out / f"{name}.nc") as flight:
            assert flight.attrs["outcome"] == "COMPLETED"


def test_a_first_page_is_there_while_it_runs(outcome: dict[str, Any]) -> None:
    early = outcome["early"]
    assert early["part"] < 0.4
    assert "The study still runs" in early["page"] and early["page"].count("<img ") == 2
    assert "The study still runs" not in outcome["page"]


def test_it_says_how_far_it_is(outcome: dict[str, Any]) -> None:
    told = outcome["told"]
    assert told == sorted(told) and told[0] == 0.0 and told[-1] == 1.0


def test_the_report_has_every_section_and_picture(outcome: dict[str, Any]) -> None:
    titles = [html.unescape(t) for t in re.findall(r"<h2>\d+\. (.*?)</h2>", outcome["page"])]
    assert [title for title in SECTIONS if title not in titles] == []
    assert outcome["page"].count("<img ") >= len(FIGURES)


def test_the_page_of_results_has_the_targets_and_what_was_found(outcome: dict[str, Any]) -> None:
    text = (outcome["out"] / "results.md").read_text(encoding="utf-8")
    titles = ["At a glance", *RESULTS, "Where it comes from"]
    assert re.findall(r"^## (.*)$", text, re.MULTILINE) == titles
    for row in outcome["metrics"]["targets"]:
        value = math.nan if row["found"] is None else row["found"]
        cells = [row["target"], row["limit"], cell_text(value)]
        assert f"| {' | '.join(cells)} |" in text and verdict(row["met"]) in text
    assert "`patagium study reproduce`, flights of 0.2 s" in text
    assert "> Short flights of 0.2 s were asked for; targets are those of 2 s." in text
    shown = re.findall(r"\]\(results/([^)]+\.svg)\)", text)
    assert len(shown) > 8 and {p.name for p in (outcome["out"] / "results").iterdir()} == {*shown}


def test_the_report_opens_offline(outcome: dict[str, Any]) -> None:
    page = outcome["page"]
    beside = {path.name for path in outcome["out"].iterdir()}
    for address in re.findall(r"""(?:src|href)\s*=\s*["']([^"']+)["']""", page):
        assert address.startswith(("#", "data:image/")) or address in beside, address[:80]
    assert {"published.html", "corrected.html"} <= beside
    assert "@import" not in page and "url(http" not in page


@pytest.mark.parametrize("width", [1400, 390])
def test_the_report_fits_a_screen_and_a_phone(
    outcome: dict[str, Any], width: int, tmp_path: Path
) -> None:
    if found() is None:
        pytest.skip("no Chromium on this machine")
    artefacts = Path(os.environ.get("PATAGIUM_ARTEFACTS", tmp_path))
    artefacts.mkdir(parents=True, exist_ok=True)
    with Chromium(tmp_path / "chromium", width, 900) as browser:
        browser.size(width, 900, touch=width < 500)
        browser.go(outcome["report"].as_uri())
        browser.screenshot(artefacts / f"report-{width}.png")
        first = browser.ask("document.querySelector('header').innerText")
        assert first.count("The paper: ") == 3
        assert browser.ask("document.querySelectorAll('header img').length") == 2
        assert browser.ask("document.documentElement.scrollHeight") < 4 * 900
        assert browser.misfits() == []
        high = browser.ask(
            "[...document.querySelectorAll('td')].filter((e) => e.offsetHeight > 90).length"
        )
        assert width < 500 or not high  # pixels of three lines


def test_figures_come_before_tables_and_cited_errors_are_told(outcome: dict[str, Any]) -> None:
    for section in outcome["page"].split("<section ")[1:]:
        table, image = section.find("<table>"), section.rfind("<img ")
        assert image < table or table < 0 or image < 0, section[:200]
    claims = outcome["page"].split("The claims of the paper</h2>")[1].split("</section>")[0]
    for error in set(re.findall(r"\((E\d+)\)", claims)):
        assert f">{error}</td>" in claims


def test_every_number_in_the_tables_is_in_the_metrics(outcome: dict[str, Any]) -> None:
    known = {cell_text(value) for value in _numbers(outcome["metrics"])} | {"–", "n/a", "yes", "no"}
    cells = re.findall(r'<td class="number">(.*?)</td>', outcome["page"], flags=re.DOTALL)
    shown = [html.unescape(cell).strip() for cell in cells]
    assert len(shown) > 300
    assert sorted({cell for cell in shown if cell not in known}) == []


def test_the_metrics_hold_claims_targets_and_errors(outcome: dict[str, Any]) -> None:
    metrics = outcome["metrics"]
    assert len(metrics["claims"]) == 12
    assert all(row["claim"] and row["published"] and row["ours"] for row in metrics["claims"])
    assert {row["met"] for row in metrics["targets"]} <= {True, False, "not run"}
    put_in = {row["variant"]: row for row in metrics["errors"]["put_in"]}
    # a flight conserves energy to the integrator's error unless joints are overwritten (E3)
    kept = {name: row["energy_residual"] < 1e-6 for name, row in put_in.items()}
    assert kept == {name: not name.startswith("E3") for name in put_in}
    # drag that pushes backward lets the air do work on a strip in still air (E2)
    driven = {name for name, row in put_in.items() if row["driven_directions"] > 0}
    assert driven == {"E2 drag pushes backwards"}
    # a yaw of 2 pi does nothing but change the last digits
    assert put_in["E7 yaw of 2 pi"]["peak_force"] == pytest.approx(
        put_in["corrected"]["peak_force"], rel=1e-9
    )


def _numbers(value: Any) -> list[float]:
    if isinstance(value, dict):
        return [n for item in value.values() for n in _numbers(item)]
    if isinstance(value, list):
        return [n for item in value for n in _numbers(item)]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return []
    return [value] if math.isfinite(value) else []


def test_every_error_is_put_in_and_taken_away() -> None:
    names = {(case.table, case.name) for case in ReproductionPlan().error_cases()}
    errors = [f"E{k}" for k in (1, 2, 3, 4, 5, 6, 9)]
    for error in errors:
        assert any(table == "put_in" and name.startswith(error) for table, name in names)
        assert any(
            table == "taken_away" and name.startswith(f"without {error}") for table, name in names
        )


def test_the_usual_run_leaves_to_the_full_one_only_what_no_target_reads() -> None:
    usual, full = ReproductionPlan.of(), ReproductionPlan.of(full=True)
    left = [t for t in set(full.trials()) - set(usual.trials()) if t.kind != "start"]
    filtered = {(t.flight, t.network, t.every) for t in left if t.learner == "cubature"}
    assert {(t.learner, t.every) for t in left} == {
        *(("replay", 10), ("gradient", 10)),
        *((learner, 1) for learner in ("cubature", "gradient", "linear", "features")),
    }
    assert filtered == {
        *(("corrected", network, 1) for network in ("dense", "dense_velocity", "strip_rotation")),
        *(("published", network, 1) for network in ("strip", "strip_rotation")),
    }
    started = {(t.flight, t.network) for t in usual.trials() if t.seed}
    assert started == {(flight, networks[0]) for flight, networks in STRIPS.items()}
    rates = usual.unsteady_every
    air = set(unsteady_trials(rates, 1, usual.unsteady_candidates, usual.slow_every))
    moved = {(t.candidate, t.every) for t in set(unsteady_trials(rates, 1)) - air}
    assert moved == {("grey", 100), ("grey", 1), ("strip", 1), ("strip_rotation", 1)}
    assert any("`--full`: from every sample" in text for text in usual.left_out)


def test_a_run_that_two_tables_show_is_run_once() -> None:
    plan = ReproductionPlan.of()
    trials, limits = plan.trials(), plan.limit_trials()
    runs = [trial.run for trial in trials]
    assert len(set(runs)) == len(runs) and {trial.run for trial in limits} <= set(runs)
    assert len({trial.run for trial in limits}) == len(limits) == len(LIMITS)


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("in the way", encoding="utf-8")
    with pytest.raises(OSError, match="file"):
        write_study(file, ReproductionPlan.of(quick=True), run, page)

"""Pages the program writes: its own results, misses marked, nothing left out."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from patagium.report import cell_text
from patagium_lab.bench.page import page as bench_page
from patagium_lab.bench.plan import GROUPS, PARTS
from patagium_lab.bench.run import TIMERS
from patagium_lab.bench.targets import TARGETS, figure_text, speed_targets
from patagium_lab.foreign import page as foreign_page
from patagium_lab.learners.entries import ENTRIES
from patagium_lab.reproduction import page as reproduction_page
from patagium_lab.rig import page as rig_page
from patagium_lab.study import Stages
from patagium_lab.validation.cases.case import CaseResult, ErrorLimit
from patagium_lab.validation.page import page as validation_page
from patagium_lab.validation.plan import ValidationPlan
from patagium_lab.validation.run import error_rows
from patagium_lab.validation.run import run as run_validation

DOCS = Path(__file__).parents[3] / "docs"


def rows_of(text: str) -> list[list[str]]:
    """Cells of every line of every table of a page."""
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]


def made_up(errors: dict[str, float], **targets: ErrorLimit) -> CaseResult:
    """A case of nothing."""
    x = np.linspace(0.0, 1.0, 5)
    return CaseResult(
        *("A case", "A book (1900)", "time [s]", "lift [N]", x, x, {name: x for name in errors}),
        *("largest difference [N]", errors, {"Somebody": 0.125}, "Because of this.", targets),
    )


def test_the_page_of_the_validation_says_what_the_results_say(tmp_path: Path) -> None:
    (real,) = run_validation(ValidationPlan(("wagner",)), Stages())
    missed = made_up(
        {"good": 0.1, "bad": 0.3}, good=ErrorLimit(0.2, "a book"), bad=ErrorLimit(0.2, "it")
    )
    text = validation_page([real, missed]).write(tmp_path / "v.md").read_text("utf-8")
    cells = rows_of(text)
    for row in error_rows([real, missed]):
        name = row["model"] if row["ours"] else f"{row['model']} (others')"
        met = {None: "–", True: "yes", False: "**no**"}[row["met"]]
        assert [name, cell_text(row["error"]), cell_text(row["limit"]), met] in [
            line[:4] for line in cells
        ]
    assert ["A case: bad", "largest difference [N]", "0.300", "0.200", "**no**"] in cells
    assert "**3 of 4 targets are met.** Missed: A case: bad." in text
    fails = text.split("## What fails, and why")[1].split("\n## ")[0]
    assert "**A case**" in fails and "Because of this." in fails and "Wagner" not in fails
    assert {one.name for one in (tmp_path / "v").iterdir()} == {"wagner-step.svg", "a-case.svg"}
    page = validation_page([missed]).write(tmp_path / "v.html").read_text("utf-8")
    assert "<strong>no</strong>" in page and page.count("<img ") == 1


def bench_row(group: str, name: str, value: float | None, **more: Any) -> dict[str, Any]:
    """A line of the bench."""
    empty = {"unit": "ns", "against": None, "ratio": None, "note": "", "against_value": None}
    return {"group": group, "name": name, "value": value, **empty, **more}


def test_the_page_of_the_bench_says_what_the_rows_say(tmp_path: Path) -> None:
    rival = {"against": "Pinocchio 3 in C++", "against_value": 1000.0}
    rows = [
        bench_row("conditions", "load average at the start", None, note="7.5 (7.0 over 5 minutes)"),
        bench_row("conditions", "time taken by pinocchio", 61.0, unit="s"),
        bench_row("pinocchio", "mass_matrix_and_bias", 150.0, ratio=0.15, **rival),
        bench_row("pinocchio", "forward", 1300.0, ratio=1.3, note="a | b", **rival),
        bench_row("mujoco", "rival left out", None, note="MuJoCo is not installed"),
    ]
    text = bench_page(rows).write(tmp_path / "b.md").read_text("utf-8")
    text = text.replace("\u00a0", " ")
    cells = rows_of(text)
    assert ["mass matrix and bias", "150 ns", rival["against"], "1 µs", "0.150", "–"][:5] in [
        line[:5] for line in cells
    ]
    assert "1.3 µs" in text and "a \\| b" in text and "MuJoCo is not installed" in text
    assert ["forward, over Pinocchio", "at most 0.25 times", "1.3 times", "**no**"] in cells
    met = ["mass matrix and bias, over Pinocchio", "at most 0.2 times", "0.15 times", "yes"]
    assert met in cells
    assert "Our time over theirs: forward: Pinocchio 3 in C++, 1.30 times." in text
    assert "1 of 6 targets are met" in text and "Not run: bias batch" in text
    assert "7.5 (7.0 over 5 minutes)" in text and ["pinocchio", "61 s"] in cells
    left = re.search(r"\*\*Not run here:\*\* (.*)\.", text)
    assert left and left[1].split(", ") == [g for g in GROUPS if g not in ("pinocchio", "mujoco")]
    assert len(list((tmp_path / "b").iterdir())) == 1


def test_a_time_is_read_in_its_unit() -> None:
    row = bench_row("pipeline", "dense 28-20-14, one block a neuron: median", 39.0, unit="us")
    slow = {**row, "value": 41.0}
    assert [speed_targets([one])[0]["met"] for one in (row, slow)] == [True, False]
    assert speed_targets([row])[0]["limit"] == "at most 40\u00a0µs"
    assert figure_text(2.0, "cores") == "2\u00a0cores" and figure_text(0.89, "1") == "0.89"


def test_every_group_of_the_bench_has_its_place_on_the_page() -> None:
    assert list(TIMERS) == list(GROUPS)
    assert {target.group for target in TARGETS} <= set(GROUPS)


@pytest.mark.parametrize(
    ("page", "titles"),
    [
        ("benchmarks.md", [title for title, _, _ in PARTS]),
        ("results.md", reproduction_page.RESULTS),
        ("rig.md", rig_page.RESULTS),
        ("foreign.md", foreign_page.RESULTS),
    ],
)
def test_a_page_of_the_documentation_has_every_part(page: str, titles: list[str]) -> None:
    text = (DOCS / page).read_text("utf-8")
    assert [title for title in titles if f"\n## {title}\n" not in text] == []
    assert "Not run here" not in text and (page == "results.md" or "Not run:" not in text)


def test_the_page_of_the_learners_has_every_learner() -> None:
    text = (DOCS / "learners.md").read_text("utf-8")
    numbers = {line[0] for line in rows_of(text) if len(line) > 10}
    assert numbers - {"#", "---:"} == {str(number) for number in range(len(ENTRIES))}


@pytest.mark.parametrize(
    "page", ["validation", "results", "rig", "benchmarks", "learners", "foreign"]
)
def test_a_page_shows_every_picture_beside_it(page: str) -> None:
    text = (DOCS / f"{page}.md").read_text("utf-8")
    assert text.startswith("<!-- Written by patagium") and f"\n{page}\n" in (
        DOCS / "index.md"
    ).read_text("utf-8")
    shown = set(re.findall(rf"\]\({page}/([^)]+)\)", text))
    assert shown == {one.name for one in (DOCS / page).iterdir()}

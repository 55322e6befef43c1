"""Every study has the same shape, and what all studies share does what it says."""

from __future__ import annotations

import dataclasses
import inspect
import json
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import patagium_lab
from patagium.cli.main import run as run_program
from patagium.errors import OutputError
from patagium.report import PageSection
from patagium_lab.gallery import Gallery
from patagium_lab.study import Page, Results, Stages, table_of, write_study
from patagium_lab.targets import at_least, at_most, between

LABORATORY = Path(patagium_lab.__file__).parent
STUDIES = sorted(path.parent.name for path in LABORATORY.glob("*/plan.py"))


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_is_a_plan_a_run_and_a_page(name: str) -> None:
    plan, run, page = (
        import_module(f"patagium_lab.{name}.{part}") for part in ("plan", "run", "page")
    )
    plans = [
        one for key, one in vars(plan).items() if key.endswith("Plan") and inspect.isclass(one)
    ]
    assert len(plans) == 1 and plans[0].__dataclass_params__.frozen
    plans[0]()  # every setting has a default
    parameters = inspect.signature(run.run).parameters
    assert next(iter(parameters)) == "plan" and list(parameters)[-1] == "stages"
    assert inspect.signature(run.run).parameters["plan"].annotation == plans[0].__name__
    signature = inspect.signature(page.page)
    assert len(signature.parameters) == 1 and signature.return_annotation == "Page"
    assert page.TITLE


def test_the_studies_are_those_that_verbs_run() -> None:
    names = [
        "attack",
        "bench",
        "damage",
        "feedback",
        "foreign",
        "learners",
        "reproduction",
        "rig",
        "validation",
    ]
    assert STUDIES == names


def help_of(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What the program prints of some words and `--help`."""
    with pytest.raises(SystemExit) as left:
        run_program([*words, "--help"])
    assert not left.value.code
    return capsys.readouterr().out


def test_studies_are_one_verb_and_their_old_words_are_hidden(capsys) -> None:
    shown, study = help_of([], capsys), help_of(["study"], capsys)
    verbs = ("reproduce", "rig", "bench", "latency", "validate", "attack", "foreign")
    for verb in verbs:
        assert f"│ {verb} " in study and f"│ {verb} " not in shown
        text = help_of(["study", verb], capsys)
        assert f"patagium study {verb}" in text.partition("Examples:")[2]
        same = text.replace(f"study {verb} [OPT", f"{verb} [OPT").split()
        assert help_of([verb], capsys).split() == same
    assert "│ study " in shown and "│ stress " not in study + shown
    assert "Former name" in help_of(["stress"], capsys)


@dataclasses.dataclass(frozen=True)
class TinyPlan:
    """A study of nothing."""

    value: float = 2.0


def tiny_run(plan: TinyPlan, out: Path, stages: Stages) -> Results:
    """One figure and one number."""
    gallery = Gallery(out / "figures")
    with stages.stage("drawing", 0.0, 0.5) as tell:
        figure = Figure()
        figure.subplots().plot([0, plan.value])
        gallery.add("line", figure, "A line.")
        tell(1.0)
    return Results({"value": plan.value, "nothing": np.nan}, gallery)


def tiny_page(results: Results) -> Page:
    """Two sections."""
    shown = PageSection("Shown", results.gallery.pictures("line", "missing"))
    number = PageSection("Number", [str(results.metrics["value"])])
    return Page("Tiny", "Nothing.", {"made by": "a test"}, [shown, number])


def test_a_study_is_written_into_its_folder(tmp_path: Path) -> None:
    told: list[tuple[str, float]] = []
    report, page = write_study(
        tmp_path / "out", TinyPlan(), tiny_run, tiny_page, lambda *stage: told.append(stage)
    )
    assert told == [("drawing", 0.0), ("drawing", 0.5), ("done", 1.0)]
    assert json.loads((tmp_path / "out" / "metrics.json").read_text()) == {
        "value": 2.0,
        "nothing": None,
    }
    text = report.read_text("utf-8")
    assert text.count("data:image/png") == 1 and "A line." in text
    page.only(["Number", "Shown", "Left out"]).write(tmp_path / "page.md")
    text = (tmp_path / "page.md").read_text("utf-8")
    assert text.index("## Number") < text.index("## Shown") and "Left out" not in text
    assert [path.suffix for path in (tmp_path / "page").iterdir()] == [".svg"]


def test_metrics_that_fail_do_not_cost_the_report(tmp_path: Path) -> None:
    (tmp_path / "metrics.json").mkdir()
    with pytest.raises(OutputError, match=r"metrics.json: cannot be written"):
        write_study(tmp_path, TinyPlan(), tiny_run, tiny_page)
    assert "</html>" in (tmp_path / "report.html").read_text("utf-8")


def test_a_target_is_met_on_its_side_of_the_limit() -> None:
    assert at_most("a", 2.0).row(2.0) == {
        "target": "a",
        "limit": "at most 2",
        "found": 2.0,
        "met": True,
    }
    assert not at_most("a", 2.0).meets(2.1) and not at_most("a", 2.0).meets(np.nan)
    assert at_least("a", 2.0).meets(2.1) and not at_least("a", 2.0).meets(1.9)
    share = between("a", 0.9, 0.99, ideal=0.95)
    assert [share.meets(found) for found in (0.89, 0.9, 0.99, 1.0)] == [False, True, True, False]


def test_the_median_of_the_starts_counts_and_the_worst_is_named() -> None:
    starts = [0.91, 0.96, 1.0]
    assert between("a", 0.9, 0.99, ideal=0.95).row_of_starts(starts)["worst"] == 1.0
    assert at_most("a", 0.95).row_of_starts(starts) == {
        "target": "a",
        "limit": "at most 0.95",
        "found": 0.96,
        "worst": 1.0,
        "met": False,
    }
    assert at_least("a", 0.95).row_of_starts(starts)["worst"] == 0.91
    assert at_most("a", 0.95).row_of_starts([])["met"] == "not run"


def test_cells_come_from_keys_or_functions() -> None:
    table = table_of({"x [m]": "x", "twice [m]": lambda row: 2 * row["x"], "y": "y"}, [{"x": 1.0}])
    assert table.columns == ("x [m]", "twice [m]", "y") and table.rows == ((1.0, 2.0, None),)

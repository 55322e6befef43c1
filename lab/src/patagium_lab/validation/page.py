"""The page of the validation: targets first, what fails and why, then case by case.

Every figure on it is a result's. Neglected: cases that were not computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from patagium.report import PageSection, Table, picture, write_page
from patagium.report.figures import curves
from patagium_lab.conditions import conditions
from patagium_lab.targets import count_met, verdict
from patagium_lab.validation.cases.case import CaseResult
from patagium_lab.validation.run import error_rows, target_rows

SUMMARY = (
    "The models of the air beside closed forms, classical functions and measurements. No constant "
    "of a model is tuned to a case; where others reached a figure it stands beside."
)
NOT_COMPARED = (
    "Only lift, and the induced drag of steady wings, are compared. No drag, moment or power of a "
    "moving wing, no wing that folds or bends, no hover and no free flight of a real robot: there "
    "are no such records here. Both measured cases are a wing or a section alone in a wind tunnel."
)


def write_validation(path: str | Path, results: Sequence[CaseResult]) -> Path:
    """Write the page.

    Args:
        path: File to write, Markdown or HTML.
        results: What `validate` gave.
    """
    facts = {"made by": "`patagium validate`", **conditions()}
    sections = validation_sections(results)
    return write_page(path, "Models of the air, validated", sections, summary=SUMMARY, facts=facts)


def validation_sections(results: Sequence[CaseResult]) -> list[PageSection]:
    """The page in reading order.

    Args:
        results: What `validate` gave.
    """
    return [
        PageSection("Targets", [count_met(target_rows(results)), _targets(results)]),
        PageSection("What fails, and why", [*_failures(results), NOT_COMPARED]),
        *map(_case, results),
    ]


def _targets(results: Sequence[CaseResult]) -> Table:
    rows = [
        [row["target"], row["measure"], row["found"], row["limit"], verdict(row["met"])]
        for row in target_rows(results)
    ]
    caption = "Where each limit comes from stands with its case."
    return Table(("case: model", "error", "found", "at most", "met"), rows, caption)


def _failures(results: Sequence[CaseResult]) -> list[str | Table]:
    """What misses its target, and what has none to meet."""
    missed = [
        f"**{result.name}**: {count_met(target_rows([result]))} {result.note}"
        for result in results
        if any(row["met"] is False for row in target_rows([result]))
    ]
    bare = [
        [row["case"], row["model"], row["error"], row["measure"]]
        for row in error_rows([result for result in results if not result.targets])
    ]
    said: list[str | Table] = [*missed] or ["No case misses its target."]
    if bare:
        caption = "Cases without a target, because nobody says how near is near enough."
        said.append(Table(("case", "model", "error", "measure"), bare, caption))
    return said


def _case(result: CaseResult) -> PageSection:
    rows = [
        [
            row["model"] if row["ours"] else f"{row['model']} (others')",
            row["error"],
            row["limit"],
            "–" if row["met"] is None else verdict(row["met"]),
            row["reason"],
        ]
        for row in error_rows([result])
    ]
    columns = ("model", "error", "at most", "met", "where the limit comes from")
    note = f"{result.note} Expected: {result.source}."
    caption = f"{result.name}: expected, and found by each model."
    return PageSection(
        result.name,
        [
            note,
            Table(columns, rows, f"Error: {result.measure}."),
            picture(_figure(result), caption),
        ],
    )


def _figure(result: CaseResult) -> Figure:
    return curves(
        result.x,
        result.expected,
        result.models,
        abscissa=result.abscissa,
        ordinate=result.ordinate,
    )

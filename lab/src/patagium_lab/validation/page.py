"""Page of the validation: targets first, what fails and why, then case by case."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from patagium.report import Block, PageSection, picture
from patagium.report.figures import curves
from patagium_lab.conditions import conditions
from patagium_lab.study import Columns, Page, Row, table_of
from patagium_lab.targets import count_met, row_verdict, verdict
from patagium_lab.validation.cases.case import CaseResult
from patagium_lab.validation.run import error_rows, target_rows

TITLE = "Models of the air, validated"
SUMMARY = (
    "The models of the air stand beside closed forms, classical functions and measurements. No "
    "constant of a model is tuned to a case. Errors that others reached are shown where they are "
    "known."
)
NOT_COMPARED = (
    "Only lift, the induced drag of steady wings, the thrust of moving ones in attached flow, the "
    "weight that hovering insects carry, the power of two of them, the force of a robotic wing "
    "over a wingbeat, the modes of a hover, and the bend and the fold of wings at rest in the wind "
    "are compared. There are no records here of the measured moment of a moving wing, of a beating "
    "wing that folds, bends or rotates by itself, or of the free flight of a real robot. The "
    "measured cases are wings or a section alone in a wind tunnel or in oil."
)


def page(results: Sequence[CaseResult]) -> Page:
    """Whole page of the validation.

    Args:
        results: Results of `run`.
    """
    rows = target_rows(results)
    columns: Columns = {
        "case: model": "target",
        "error": "measure",
        "found": "found",
        "at most": "limit",
        "met": row_verdict,
    }
    caption = "The section of each case says where its limit comes from."
    sections = [
        PageSection("Targets", [count_met(rows), table_of(columns, rows, caption)]),
        PageSection("What fails, and why", [*_failures(results), NOT_COMPARED]),
        *map(_case, results),
    ]
    return Page(TITLE, SUMMARY, {"made by": "`patagium study validate`", **conditions()}, sections)


def _failures(results: Sequence[CaseResult]) -> list[Block]:
    """Cases that miss their target, and cases without a target."""
    missed: list[Block] = [
        f"**{result.name}**: {count_met(target_rows([result]))} {result.note}"
        for result in results
        if any(row["met"] is False for row in target_rows([result]))
    ]
    said = missed or ["No case misses its target."]
    bare = error_rows([result for result in results if not result.targets])
    if bare:
        columns = {
            "case": "case",
            "model": "model",
            "error": "error",
            "measure and unit of the error": "measure",
        }
        caption = "Cases without a target, because no source says how small the error should be."
        said.append(table_of(columns, bare, caption))
    return said


def _case(result: CaseResult) -> PageSection:
    columns: Columns = {
        "model": lambda row: row["model"] if row["ours"] else f"{row['model']} (others')",
        "error": "error",
        "at most": "limit",
        "met": _met,
        "where the limit comes from": "reason",
    }
    table = table_of(columns, error_rows([result]), f"Error: {result.measure}.")
    caption = f"{result.name}: expected values, and the values of each model."
    note = f"{result.note} Expected: {result.source}."
    return PageSection(result.name, [note, table, picture(_figure(result), caption)])


def _met(row: Row) -> str:
    return "–" if row["met"] is None else verdict(row["met"])


def _figure(result: CaseResult) -> Figure:
    return curves(
        result.x,
        result.expected,
        result.models,
        abscissa=result.abscissa,
        ordinate=result.ordinate,
    )

"""The models of the air beside what is known: one page, a table and a figure a case.

Every case is a module of `validation_cases`. Neglected: the time a case takes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from patagium import __version__
from patagium.errors import ParameterError
from patagium.report import Section, Table, picture
from patagium.report.figures import curves
from patagium.report.page import write_page
from patagium.studies.validation_cases import CASES
from patagium.studies.validation_cases.case import CaseResult

SUMMARY = (
    "The models of the air beside closed forms, classical tables and measurements. "
    "No constant of a model is tuned to a case; where others reached a figure it stands beside."
)


def validate(
    only: Sequence[str] | None = None, progress: Callable[[int, int], None] | None = None
) -> list[CaseResult]:
    """Results of the cases.

    Args:
        only: Names out of `CASES`; all of them by default.
        progress: Called with cases done and cases in all.

    Raises:
        ParameterError: If there is no case of a name.
    """
    chosen = list(only or CASES)
    for name in chosen:
        if name not in CASES:
            raise ParameterError("case", f"one of {', '.join(CASES)}", name)
    results: list[CaseResult] = []
    for done, name in enumerate(chosen):
        module = import_module(f"patagium.studies.validation_cases.{name}")
        results += module.compute()
        if progress is not None:
            progress(done + 1, len(chosen))
    return results


def error_rows(results: Sequence[CaseResult]) -> list[dict[str, Any]]:
    """One error a model and case, and what others reached, as JSON-able rows.

    Args:
        results: What `validate` gave.
    """
    return [
        {"case": r.name, "model": name, "error": error, "measure": r.measure, "ours": ours}
        for r in results
        for errors, ours in ((r.errors, True), (r.known, False))
        for name, error in errors.items()
    ]


def error_table(results: Sequence[CaseResult]) -> Table:
    """The same as a table.

    Args:
        results: What `validate` gave.
    """
    rows = [
        [r["case"], r["model"] if r["ours"] else f"{r['model']} (known)", r["error"], r["measure"]]
        for r in error_rows(results)
    ]
    return Table(["case", "model", "error", "measure"], rows, "Every error, in one place.")


def write_validation(path: str | Path, results: Sequence[CaseResult]) -> Path:
    """Write the page.

    Args:
        path: File to write.
        results: What `validate` gave.
    """
    sections = [Section("Errors", [error_table(results)]), *(_section(r) for r in results)]
    facts = {"program": f"patagium {__version__}"}
    return write_page(path, "Models of the air, validated", sections, summary=SUMMARY, facts=facts)


def _section(result: CaseResult) -> Section:
    note = f"{result.note} Expected: {result.source}."
    caption = f"{result.name}: expected and found."
    return Section(result.name, [note, error_table([result]), picture(_figure(result), caption)])


def _figure(result: CaseResult) -> Figure:
    return curves(
        result.x,
        result.expected,
        result.models,
        abscissa=result.abscissa,
        ordinate=result.ordinate,
    )

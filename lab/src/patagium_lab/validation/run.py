"""The models of the air beside what is known: errors, case by case, against their targets.

Every case is a module of `validation_cases`. Neglected: the time a case takes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from patagium.errors import ParameterError
from patagium.report import Table
from patagium_lab.validation.cases import CASES
from patagium_lab.validation.cases.case import CaseResult


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
        module = import_module(f"patagium_lab.validation.cases.{name}")
        results += module.compute()
        if progress is not None:
            progress(done + 1, len(chosen))
    return results


def error_rows(results: Sequence[CaseResult]) -> list[dict[str, Any]]:
    """One error a model and case, and what others reached, as JSON-able rows.

    Args:
        results: What `validate` gave.

    Returns:
        case, model, error, measure, whether it is ours, and limit, reason and met of its
        target, each None where it has none.
    """
    return [
        {"case": r.name, "model": name, "error": error, "measure": r.measure, "ours": ours}
        | _target(r, name, error)
        for r in results
        for errors, ours in ((r.errors, True), (r.known, False))
        for name, error in errors.items()
    ]


def target_rows(results: Sequence[CaseResult]) -> list[dict[str, Any]]:
    """The targets among them: target, limit, found, met, and where each comes from.

    Args:
        results: What `validate` gave.
    """
    return [
        {"target": f"{row['case']}: {row['model']}", "found": row["error"]}
        | {key: row[key] for key in ("measure", "limit", "reason", "met")}
        for row in error_rows(results)
        if row["limit"] is not None
    ]


def error_table(results: Sequence[CaseResult]) -> Table:
    """The errors as a table.

    Args:
        results: What `validate` gave.
    """
    rows = [
        [r["case"], r["model"] if r["ours"] else f"{r['model']} (known)", r["error"], r["limit"],
         r["met"], r["measure"]]
        for r in error_rows(results)
    ]  # fmt: skip
    columns = ["case", "model", "error", "at most", "met", "measure"]
    return Table(columns, rows, "Every error, in one place.")


def _target(result: CaseResult, model: str, error: float) -> dict[str, Any]:
    target = result.targets.get(model)
    if target is None:
        return {"limit": None, "reason": None, "met": None}
    return {"limit": target.limit, "reason": target.reason, "met": bool(error <= target.limit)}

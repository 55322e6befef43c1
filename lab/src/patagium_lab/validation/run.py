"""Run of the validation: models of the air beside theory and measurement, case by case."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any

from patagium.report import Table
from patagium_lab.study import Columns, Stages, table_of
from patagium_lab.validation.cases.case import CaseResult
from patagium_lab.validation.plan import ValidationPlan


def run(plan: ValidationPlan, stages: Stages) -> list[CaseResult]:
    """Results of the cases.

    Args:
        plan: Cases that are computed.
        stages: Receives progress.
    """
    results: list[CaseResult] = []
    for done, name in enumerate(plan.cases):
        with stages.stage(name, done / len(plan.cases), (done + 1) / len(plan.cases)):
            module = import_module(f"patagium_lab.validation.cases.{name}")
            results += module.compute()
    stages.tell("done", 1.0)
    return results


def error_rows(results: Sequence[CaseResult]) -> list[dict[str, Any]]:
    """Errors of every model and case, and errors that others reached, as JSON-able rows.

    Args:
        results: Results of `run`.

    Returns:
        Rows with the keys case, model, error, measure and ours (whether the model is ours);
        limit, reason and met belong to the target of the model and are None without one.
    """
    return [
        {"case": r.name, "model": name, "error": error, "measure": r.measure, "ours": ours}
        | _target(r, name, error)
        for r in results
        for errors, ours in ((r.errors, True), (r.known, False))
        for name, error in errors.items()
    ]


def target_rows(results: Sequence[CaseResult]) -> list[dict[str, Any]]:
    """Rows of the targets, with the keys target, found, measure, limit, reason and met.

    Args:
        results: Results of `run`.
    """
    return [
        {"target": f"{row['case']}: {row['model']}", "found": row["error"]}
        | {key: row[key] for key in ("measure", "limit", "reason", "met")}
        for row in error_rows(results)
        if row["limit"] is not None
    ]


def error_table(results: Sequence[CaseResult]) -> Table:
    """Table of all errors.

    Args:
        results: Results of `run`.
    """
    columns: Columns = {
        "case": "case",
        "model": lambda row: row["model"] if row["ours"] else f"{row['model']} (known)",
        "error": "error",
        "at most": "limit",
        "met": "met",
        "measure and unit of the error": "measure",
    }
    return table_of(columns, error_rows(results), "Errors of all models.")


def _target(result: CaseResult, model: str, error: float) -> dict[str, Any]:
    target = result.targets.get(model)
    if target is None:
        return {"limit": None, "reason": None, "met": None}
    return {"limit": target.limit, "reason": target.reason, "met": bool(error <= target.limit)}

"""Page of an identification: its scores as a table, its predictions as curves."""

from __future__ import annotations

from collections.abc import Mapping, Sized
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from patagium.learning.forecast import RIVALS
from patagium.learning.parameter_paths import parameter_table
from patagium.report import (
    Block,
    KeyNumber,
    Link,
    Note,
    PageSection,
    Picture,
    Table,
    cell_text,
    picture,
    write_page,
)
from patagium.report.figures import comparison, curves, innovation_and_covariance, paths
from patagium.report.page import snippet
from patagium.report.style import figures_for

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = 10
"""The last of so many parts of a run is drawn on the first screen."""
DRAWN = 6
"""Most outputs drawn; the others are in the table."""


def write_identification(
    scores: Mapping[str, Any],
    record: xr.Dataset,
    path: str | Path,
    title: str,
    replay: str | Picture | None = None,
) -> Path:
    """Self-contained HTML page of an identification.

    Args:
        scores: Of an `Identification`.
        record: Its predictions and updates, see `record_of`.
        path: File to write.
        title: Heading of the page.
        replay: Address of the flight's replay, relative to the page, or a picture that leads
            there, or None.
    """
    address = replay.address if isinstance(replay, Picture) else replay
    moving = [Link("The flight in three dimensions", address)] if address else []
    tables = [score_table(scores), *forecast_tables(scores)]
    loud = _loud(scores, record)
    told = f"Measured, and {_sample_words(scores)[1]}.{_not_drawn(loud)}"
    sections = [
        PageSection("Scores", [*moving, summary(scores), *tables, *_remarks(scores)]),
        *_parameters(scores, record),
        PageSection(
            "Predictions", [picture(_compared(record.sel(output=loud[:DRAWN])), told, "png")]
        ),
    ]
    if record.sizes["update_time"] > 1:
        sections.append(
            PageSection("What each update learned", [_innovation_picture(scores, record)])
        )
    if np.isfinite(list(scores["reliability"].values())).all():
        sections.append(PageSection("Does it know how wrong it is?", _calibration(scores)))
    words = " ".join(scores.get("verdict", [])) or summary(scores)
    shown = [replay] if isinstance(replay, Picture) else []
    return write_page(
        path, title, sections, summary=words, opening=[*shown, *_opening(scores, record)]
    )


def _opening(scores: Mapping[str, Any], record: xr.Dataset) -> list[Block]:
    """First screen: the end of one prediction, and three numbers with what they should be."""
    if "nmse_second_half_mean" not in scores:
        return []
    loud = _loud(scores, record)
    name = "z" if "z" in loud else loud[0]
    late = record.isel(time=slice(-max(2, record.sizes["time"] // _SHOWN), None)).sel(output=[name])
    with figures_for("phone"):
        plot = _compared(late)
    _, predicted, rival = _sample_words(scores)
    error, held = (scores[f"{key}_second_half_mean"] for key in ("nmse", "persistence"))
    return [
        picture(plot, f"The last {100 // _SHOWN} %: measured, and {predicted}."),
        KeyNumber(
            _percent(error),
            "Mean square error of the predictions over the variance of the output, second half.",
            f"{rival}, held: {_percent(held)}.".capitalize(),
        ),
        KeyNumber(
            _percent(scores["coverage_second_half"]),
            "Share of the errors inside the predicted 95 % interval, second half.",
            "Right: 95 %.",
        ),
        KeyNumber(
            cell_text(scores["nis_second_half"]),
            "Squared error over its predicted variance (NIS), each output by itself, at samples "
            "spread over the second half.",
            "Right: 1; below it intervals are too wide, above it too narrow.",
        ),
    ]


def _percent(share: float) -> str:
    """A share in percent, or "n/a" where it is unknown."""
    return "n/a" if np.isnan(share) else f"{cell_text(100 * share)} %"


def _parameters(scores: Mapping[str, Any], record: xr.Dataset) -> list[PageSection]:
    """Physical parameters as a table, and their paths; nothing where none was learned."""
    table = parameter_table(scores)
    if table is None:
        return []
    shown: list[Any] = [table]
    if "parameter_value" in record and record.sizes["update_time"] > 1:
        figure = paths(
            record["update_time"].values,
            record["parameter_value"].values,
            record["parameter_std"].values,
            list(scores["parameter_prior"].values()),
            **_labels(record, "parameter", "parameter_unit"),
        )
        shown.append(picture(figure, "After each update, within two deviations; dashed: before."))
    return [PageSection("Physical parameters", shown)]


def _sample_words(scores: Mapping[str, Any]) -> tuple[str, str, str]:
    """Words for the samples that were learned, for their predictions, and for the held sample."""
    every = scores["every"]
    if scores.get("frozen"):
        held = "the last sample" if every == 1 else f"one measured sample in {every}"
        return "none learned", "predicted with frozen weights", held
    used = "every sample used" if every == 1 else f"one in {every} used"
    if first := scores.get("samples_that_scaled"):
        used += f" after the first {first}, which scale the network"
    return used, "predicted before the sample was used", "the last used sample"


def summary(scores: Mapping[str, Any]) -> str:
    """Summary of the scores in two sentences."""
    if "nmse_second_half_mean" not in scores:
        return str(scores["message"])
    used, _, held = _sample_words(scores)
    if not np.isfinite(scores["nmse_second_half_mean"]):
        held = "No output varies over the second half, so that its error has no scale."
        return f"{scores['samples']} samples, {used}. {held}"
    words = (
        f"{scores['samples']} samples, {used}. Normalized mean square "
        f"error over the second half: mean {scores['nmse_second_half_mean']:.2e}, worst "
        f"{scores['nmse_second_half_worst']:.2e} ({held}, held: "
        f"{scores['persistence_second_half_mean']:.2e}, "
        f"{scores['persistence_second_half_worst']:.2e})."
    )
    return f"{words} {scores['message']}".strip()


def forecast_tables(scores: Mapping[str, Any]) -> list[Table]:
    """Errors of the forecasts of each horizon and of their baselines."""
    heads = {"nmse": "forecast", **RIVALS}
    tables = []
    for key in [name.removesuffix("_rule") for name in scores if name.endswith("_rule")]:
        present = {head: scores.get(f"{key}_{name}_second_half") for name, head in heads.items()}
        if not key.startswith("forecast_") or not all(present.values()):
            continue
        names = [name for name in scores["nmse"] if name not in scores["silent"]]
        ways = {}
        for name, counts in scores[f"{key}_ways"].items():
            way = max(counts, key=counts.__getitem__, default="")
            ways[name] = f"{way} ({counts[way]} of {sum(counts.values())})" if way else ""
        rows = [
            [name, *(each[name] for each in present.values() if each), ways[name]] for name in names
        ]
        ahead = scores[f"{key}_seconds"]
        tables.append(
            Table(
                ["output", *(f"{head} [1]" for head in heads.values()), "forecast mostly by"],
                rows,
                f"Forecast {ahead:g} s ahead from samples up to a time alone "
                f"({scores[f'{key}_count']} times; {scores[f'{key}_rule']}): mean square error "
                "over the variance of the output, second half.",
            )
        )
    return tables


def score_table(scores: Mapping[str, Any]) -> Table:
    """Errors and coverage of each output that is not silent."""
    columns = {
        "NMSE, whole run [1]": "nmse",
        "second half [1]": "nmse_second_half",
        "held sample, second half [1]": "persistence_second_half",
        "in the 95 % interval, whole run [1]": "coverage_by_output",
    }
    present = {head: scores[key] for head, key in columns.items() if key in scores}
    names = [name for name in next(iter(present.values()), {}) if name not in scores["silent"]]
    rows = [[name, *(column[name] for column in present.values())] for name in names]
    _, predicted, held = _sample_words(scores)
    text = f"Mean square error over the variance of the output, {predicted}; held: {held}."
    return Table(["output", *present], rows, text)


def silent_words(scores: Mapping[str, Any]) -> list[str]:
    """Sentences that name the outputs that never move, and those that were not measured."""
    missing = scores.get("not_measured", [])  # later than the first files
    still = [name for name in scores["silent"] if name not in missing]
    kinds = {"Silent": still, "Not measured": missing}
    rest = "and left out of mean and worst"
    return [f"{kind}, {rest}: {', '.join(names)}." for kind, names in kinds.items() if names]


def _remarks(scores: Mapping[str, Any]) -> list[Note]:
    words = [scores["message"]] if scores["message"] else []
    words += silent_words(scores)
    if scores.get("events"):
        events = ", ".join(f"{name.replace('_', ' ')} {n}" for name, n in scores["events"].items())
        words.append(f"Events of samples: {events}.")
    if gaps := scores["gaps"]:
        words.append(f"{gaps} gap(s) in time: each ends a hold interval, none is bridged.")
    chosen = scores.get("chosen", {}).items()
    return [*map(Note, words), *(Note(f"{name.capitalize()}: {text}.") for name, text in chosen)]


def reliability_picture(found: Mapping[str, Mapping[str, float]]) -> Picture:
    """Picture of the share of errors inside each predicted interval.

    Args:
        found: That share [1] by the probability of the interval, for each of several runs.
    """
    nominal = [float(p) for p in next(iter(found.values()))]
    figure = curves(
        nominal,
        nominal,
        {name: list(shares.values()) for name, shares in found.items()},
        abscissa="probability of the predicted interval [1]",
        ordinate="share of errors inside [1]",
    )
    return picture(figure, "Reliability: on the diagonal, intervals are what they say.")


def _calibration(scores: Mapping[str, Any]) -> list[Any]:
    shown = [reliability_picture({"found": scores["reliability"]})]
    if "nis_per_channel" not in scores or not np.isfinite(scores["nis_per_channel"]):
        return shown
    color = [value for value in scores["innovation_correlation"].values() if np.isfinite(value)]
    words = (
        f"Innovation squared over its predicted covariance (NIS), all outputs together, at the "
        f"{scores['updates']} updates of the whole run: {scores['nis_per_channel']:.3g} a channel "
        f"on average (1 if right, more if too sure); {100 * scores['nis_inside']:.0f} % of updates "
        "lie in its 95 % interval. The NIS at the top leaves out the first half, and "
        "takes each output by itself. Normalized innovations one update apart correlate by "
        f"{np.mean(color):.2f} on average (0 means no structure is left in the errors)."
    )
    return [Note(words), *shown]


def _loud(scores: Mapping[str, Any], record: xr.Dataset) -> list[str]:
    """Names of the outputs that are not silent."""
    return [str(name) for name in record["output"].values if name not in scores["silent"]]


def _labels(record: xr.Dataset, names: str = "output", units: str = "unit") -> dict[str, Any]:
    """Names and units of curves, from two coordinates of a record."""
    return {"names": [*map(str, record[names].values)], "units": [*map(str, record[units].values)]}


def _not_drawn(outputs: Sized) -> str:
    """Sentence on the outputs that a figure leaves out; empty where it has all."""
    rest = len(outputs) - DRAWN
    return f" Scores of the other {rest} outputs are in the table." if rest > 0 else ""


def _compared(record: xr.Dataset) -> Figure:
    return comparison(
        record["time"].values,
        record["measurement"].values,
        {"predicted": record["prediction"].values},
        **_labels(record),
        truth_name="measured",
    )


def result_snippet(record: xr.Dataset, facts: Mapping[str, str]) -> str:
    """Result of an identification as a notebook shows it, in HTML."""
    loud = record["measurement"].std("time").values.argsort()[::-1]
    return snippet("Identification", facts, _compared(record.isel(output=loud[:2])))


def _innovation_picture(scores: Mapping[str, Any], record: xr.Dataset) -> Any:
    looked = np.isfinite(record["largest_variance"].values)
    if not looked.any():
        looked = np.ones_like(looked)
    loud = _loud(scores, record)
    chosen = record.sel(output=loud[:DRAWN]).isel(update_time=looked)
    figure = innovation_and_covariance(
        chosen["update_time"].values,
        chosen["innovation"].values,
        chosen["largest_variance"].values,
        **_labels(chosen),
    )
    words = "Innovation at the updates, and the largest variance of a weight."
    return picture(figure, words + _not_drawn(loud))

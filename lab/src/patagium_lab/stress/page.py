"""Page of the stress study: faults, damage, calibration, endurance, motion capture."""

from __future__ import annotations

from typing import Any

import numpy as np

from patagium.learning.scores import NOMINAL
from patagium.report import Block, PageSection, Picture, Table, picture
from patagium.report.figures import curves
from patagium_lab.conditions import conditions
from patagium_lab.stress.campaign import SETTLING, WINDOW, WORST_RATIO
from patagium_lab.stress.motion_capture import summary
from patagium_lab.stress.run import StressResults
from patagium_lab.study import Page, table_of

TITLE = "Learners under stress"
SUMMARY = (
    "Learners are flown through faults that are drawn from a seed, through damage to a wing, and "
    "through very long runs. The page counts what must not happen, and shows how well the filter "
    "knows its own uncertainty."
)


def page(results: StressResults) -> Page:
    """Whole page of the stress study.

    Args:
        results: Results of `run`.
    """
    facts = {"made by": "`patagium stress`", "seed": str(results.seed), **conditions()}
    sections = [
        PageSection("Faults", [_campaign(results), fault_table(results), _ratio_picture(results)]),
        PageSection("Damage", _damage(results.damage)),
        PageSection("Calibration", _calibration(results.calibration)),
        PageSection("Endurance", [_endurance(results)]),
        PageSection("Motion capture", _captures(results.captures)),
    ]
    return Page(TITLE, SUMMARY, facts, sections)


def fault_table(results: StressResults) -> Table:
    """Table of failures by fault.

    Args:
        results: Results of `run`.
    """
    columns = {
        "fault": "fault",
        "runs": "runs",
        "crashes": "crashes",
        "weights not finite": "not_finite",
        "covariance indefinite": "indefinite",
        "lost states": "lost_states",
        "miscounted": "miscounted",
        "not recovered": "not_recovered",
        "error ratio, median [1]": "ratio_median",
        "error ratio, largest [1]": "ratio_largest",
    }
    rows = results.faults()
    counts = list(columns.values())[1:8]
    total = {
        "fault": "all",
        **{key: sum(row[key] for row in rows) for key in counts},
        "ratio_largest": max((row["ratio_largest"] for row in rows), default=None),
    }
    caption = (
        "Number of failures, and the error after a fault over that of the same learner without it."
    )
    return table_of(columns, [*rows, total], caption)


def _campaign(results: StressResults) -> str:
    torn = sum(row["interrupted_saves"] for row in results.faults())
    return (
        f"{len(results.runs)} runs of seed {results.seed}. Each run draws a learner (strip or "
        "dense network; full, layer, node or low-rank covariance; double or single precision; "
        "with or without change detection; always with screening and noise estimation) and a "
        "fault with its place, length and channels. The error ratio compares the learner over "
        f"{WINDOW} samples, {SETTLING} after the fault, with the same learner without the fault; "
        f"above {WORST_RATIO:g} it counts as not recovered. {torn} of the kills left a "
        "half-written draft beside the whole file."
    )


def _ratio_picture(results: StressResults) -> Picture:
    ratios = np.sort([run["ratio"] for run in results.runs])
    share = (np.arange(len(ratios)) + 1) / len(ratios)
    figure = curves(
        share,
        np.full(len(share), WORST_RATIO),
        {"error ratio of the runs, sorted": np.minimum(ratios, 10 * WORST_RATIO)},
        abscissa="share of the runs [1]",
        ordinate="error ratio [1]",
    )
    return picture(figure, "Error after the fault over the error without it; expected: the limit.")


def _damage(rows: list[dict[str, Any]]) -> list[Block]:
    beats = [1, 2, 3, 4]
    cells = []
    for row in rows:
        for name, label in (("hold", "one sample"), ("ahead", "10 ms")):
            former = row[f"{name}_former"]
            after = [former * ratio for ratio in row[f"{name}_ratios"][: len(beats)]]
            after += [None] * (len(beats) - len(after))
            detected = row["detected"] if name == "hold" else None
            cells.append([row["learner"], label, former, *after, row[f"{name}_beats"], detected])
    heads = (
        *("learner", "horizon", "NMSE before [1]"),
        *(f"NMSE in wingbeat {beat} [1]" for beat in beats),
        *("within twice the former error from wingbeat", "detected after [samples]"),
    )
    figure = curves(
        np.arange(1, len(rows[0]["ahead_ratios"]) + 1),
        np.full(len(rows[0]["ahead_ratios"]), 2.0),
        {row["learner"]: row["ahead_ratios"] for row in rows},
        abscissa="wingbeats after the damage [1]",
        ordinate="error over the former one [1]",
    )
    return [
        "In flight the left wing loses the rear third of its chord and all strips get another "
        "polar; every sample is learned, with 2 % noise. A learner with a large error before the "
        "damage is back at that error early, so the errors themselves count. A strip network gives "
        "both wings the same coefficients and cannot represent damage to one of them.",
        Table(heads, cells, "NMSE by wingbeat before and after the damage, mean over outputs."),
        picture(figure, "Error 10 ms ahead over the former one, by wingbeat."),
    ]


def _calibration(rows: list[dict[str, Any]]) -> list[Block]:
    columns = {
        "flight": "subject",
        "samples": "samples",
        "share in the 95 % interval [1]": "coverage",
        "share in the interval, second half [1]": "coverage_second_half",
        "NIS per channel [1]": "nis_per_channel",
        "share of NIS in its 95 % range [1]": "nis_inside",
        "correlation of innovations [1]": "innovation_correlation",
        "NMSE, second half [1]": "nmse",
    }
    figure = curves(
        NOMINAL,
        NOMINAL,
        {row["subject"]: list(row["reliability"].values()) for row in rows},
        abscissa="probability of the predicted interval [1]",
        ordinate="share of errors inside [1]",
    )
    return [
        "Every sample is used, and the noise is estimated online. A filter with the right "
        "uncertainty has a NIS per channel of 1 and innovations without correlation.",
        table_of(columns, rows, "Calibration of the predicted intervals."),
        picture(figure, "Reliability: predicted probability, and share of errors inside."),
    ]


def _endurance(results: StressResults) -> Table:
    glide, precision = results.glide, results.precision
    rows: list[list[Any]] = [
        ["steady glide: samples", glide["samples"]],
        ["steady glide: share of the prior [1]", glide["share"]],
        ["steady glide: largest diagonal of P over the prior's [1]", glide["largest"]],
        ["steady glide: smallest diagonal of P over the prior's [1]", glide["smallest"]],
        ["precision: updates in each precision", precision["updates"]],
        ["precision: updates refused, float32", precision["refused"]["float32"]],
        ["precision: covariance definite at every look, float32", precision["definite"]],
        ["precision: NMSE, float64 [1]", precision["error"]["float64"]],
        ["precision: NMSE, float32 [1]", precision["error"]["float32"]],
        ["precision: error of float32 over that of float64 [1]", precision["ratio"]],
    ]
    return Table(["figure", "value"], rows, "Filters with one covariance block a neuron.")


def _captures(rows: list[dict[str, Any]]) -> list[Block]:
    facts = summary(rows)
    cells: list[list[Any]] = [
        [f"{name.replace('_', ' ')} {'' if name.startswith('seeds') else '[1]'}".strip(), value]
        for name, value in facts.items()
        if not isinstance(value, list)
    ]
    return [
        "Each seed draws the motion of a body, with tumbles, and a log of cameras with colored "
        "noise, jitter, lost frames, swapped markers and a bad tail. Errors are those of the "
        "attitude where `estimate_motion` claims to know it; the ratio is that of the error to "
        "the stated standard deviation.",
        Table(["figure", "value"], cells, "Motion from made-up motion capture."),
    ]

"""The study of stress as one page.

Neglected: single runs; they are drawn again from seed and number.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from patagium import __version__
from patagium.learning.calibration import NOMINAL
from patagium.report import PageSection, Table, picture
from patagium.report.figures import curves
from patagium.report.page import write_page
from patagium_lab.stress.campaign import SETTLING, WINDOW, WORST_RATIO
from patagium_lab.stress.run import StressStudy

SUMMARY = (
    "Learners flown through faults drawn from a seed, through damage to a wing, and on and on: "
    "what must not happen, how often it did, and how well the filter knows what it does not know."
)


def write_stress(path: str | Path, study: StressStudy) -> Path:
    """Write the page.

    Args:
        path: File to write.
        study: What `stress` gave.
    """
    sections = [
        PageSection("Faults", [_campaign_note(study), fault_table(study), *_ratio_picture(study)]),
        PageSection("Damage", _damage(study.damage)),
        PageSection("Calibration", _calibration(study.calibration)),
        PageSection("Endurance", [_endurance(study)]),
    ]
    facts = {"program": f"patagium {__version__}", "seed": str(study.seed)}
    return write_page(path, "Learners under stress", sections, summary=SUMMARY, facts=facts)


def fault_table(study: StressStudy) -> Table:
    """Counts by fault.

    Args:
        study: What `stress` gave.
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
        "error ratio, median": "ratio_median",
        "largest": "ratio_largest",
    }
    rows = [[row[key] for key in columns.values()] for row in study.faults()]
    total = [sum(row[k] for row in rows) for k in range(1, 8)]
    largest = max((row[9] for row in rows), default=None)
    caption = "What must not happen, and the error after a fault over that of an untouched twin."
    return Table(list(columns), [*rows, ["all", *total, None, largest]], caption)


def _campaign_note(study: StressStudy) -> str:
    killed = [row for row in study.faults() if row["interrupted_saves"]]
    torn = sum(row["interrupted_saves"] for row in killed)
    return (
        f"{len(study.runs)} runs of seed {study.seed}. Each draws a learner (strip or dense "
        "network; full, layer, node or low-rank covariance; double or single precision; with or "
        "without change detection; screening and noise estimation always), a fault, its place, "
        f"length and channels. The error ratio compares the learner over {WINDOW} samples, "
        f"{SETTLING} after the fault, with its twin that met none; above {WORST_RATIO:g} it counts "
        f"as not recovered. {torn} of the kills left a half-written draft beside the whole file."
    )


def _ratio_picture(study: StressStudy) -> list[Any]:
    ratios = np.sort([run["ratio"] for run in study.runs])
    share = (np.arange(len(ratios)) + 1) / len(ratios)
    figure = curves(
        share,
        np.full(len(share), WORST_RATIO),
        {"error ratio of the runs, sorted": np.minimum(ratios, 10 * WORST_RATIO)},
        abscissa="share of the runs [1]",
        ordinate="error ratio [1]",
    )
    return [picture(figure, "Error after the fault over the twin's; expected: the limit.")]


def _damage(rows: list[dict[str, Any]]) -> list[Any]:
    columns = ["learner", "horizon", "former NMSE", "beat 1", "beat 2", "beat 3", "beat 4"]
    cells = []
    for row in rows:
        for name, label in (("hold", "one sample"), ("ahead", "10 ms")):
            former = row[f"{name}_former"]
            after = [former * ratio for ratio in row[f"{name}_ratios"][:4]]
            after += [None] * (4 - len(after))
            found, beats = row["detected"] if name == "hold" else None, row[f"{name}_beats"]
            cells.append([row["learner"], label, former, *after, beats, found])
    heads = [*columns, "back within twice at beat", "detected after [samples]"]
    return [
        "At mid-flight the left wing loses the rear third of its chord and all strips get another "
        "polar; every sample is learned, with 2 % noise. A learner that was poor before is back at "
        "its former level early: look at the errors themselves. A strip network gives both wings "
        "the same coefficients and cannot represent damage to one of them.",
        Table(heads, cells, "NMSE by wingbeat before and after the damage, mean over outputs."),
        picture(_damage_figure(rows), "Error 10 ms ahead over the former one, by wingbeat."),
    ]


def _damage_figure(rows: list[dict[str, Any]]) -> Figure:
    beats = np.arange(1, len(rows[0]["ahead_ratios"]) + 1)
    found = {row["learner"]: row["ahead_ratios"] for row in rows}
    return curves(
        beats,
        np.full(len(beats), 2.0),
        found,
        abscissa="wingbeats after the damage [1]",
        ordinate="error over the former one [1]",
    )


def _calibration(rows: list[dict[str, Any]]) -> list[Any]:
    columns = {
        "flight": "subject",
        "samples": "samples",
        "in the 95 % interval": "coverage",
        "second half": "coverage_second_half",
        "NIS per channel": "nis_per_channel",
        "NIS in its 95 %": "nis_inside",
        "correlation of innovations": "innovation_correlation",
        "NMSE, second half": "nmse",
    }
    cells = [[row[key] for key in columns.values()] for row in rows]
    reached = {row["subject"]: list(row["reliability"].values()) for row in rows}
    figure = curves(
        NOMINAL,
        NOMINAL,
        reached,
        abscissa="probability of the predicted interval [1]",
        ordinate="share of errors inside [1]",
    )
    return [
        "Every sample is used; the noise is found online. A filter that is right has a NIS per "
        "channel of 1 and innovations without correlation.",
        Table(list(columns), cells, "What the predicted intervals are worth."),
        picture(figure, "Reliability: predicted probability and what happened."),
    ]


def _endurance(study: StressStudy) -> Table:
    glide, precise = study.glide, study.precision
    rows: list[list[Any]] = [
        ["steady glide: samples", glide["samples"]],
        ["steady glide: share of the prior", glide["share"]],
        ["steady glide: largest of diag P over the prior's", glide["largest"]],
        ["steady glide: smallest of diag P over the prior's", glide["smallest"]],
        ["precision: updates in each", precise["updates"]],
        ["precision: updates refused, float32", precise["refused"]["float32"]],
        ["precision: covariance definite at every look, float32", precise["definite"]],
        ["precision: NMSE, float64", precise["error"]["float64"]],
        ["precision: NMSE, float32", precise["error"]["float32"]],
        ["precision: error of float32 over that of float64", precise["ratio"]],
    ]
    return Table(["figure", "value"], rows, "Node-decoupled filters that run on and on.")

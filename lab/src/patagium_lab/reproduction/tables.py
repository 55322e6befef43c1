"""Tables of the reproduction, made of its metrics and nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from patagium.report import Table
from patagium_lab.reproduction.cases import LEARNERS, NETWORKS
from patagium_lab.study import Columns, Metrics, Row, table_of

FLIGHT_FIGURES = {
    "duration [s]": "duration",
    "wingbeat frequency [Hz]": "beat_frequency",
    "speed at the start [m/s]": "speed_start",
    "largest speed [m/s]": "speed_largest",
    "speed at the end [m/s]": "speed_end",
    "distance [m]": "distance",
    "change of height [m]": "height_change",
    "largest force of the air [N]": "force_largest",
    "mean lift over weight, second half [1]": "lift_over_weight",
    "largest incidence [rad]": "incidence_largest",
    "reduced frequency at the start [1]": "reduced_frequency_start",
    "reduced frequency at the end [1]": "reduced_frequency_end",
    "energy residual over energy exchanged [1]": "energy_audit",
    "momentum residual over impulse exchanged [1]": "momentum_audit",
    "largest power of the air [W]": "aero_power_largest",
}
"""Headings and names of the figures of a flight."""


def flight_table(
    flights: Mapping[str, Mapping[str, Any]], figures: Mapping[str, str] = FLIGHT_FIGURES
) -> Table:
    """Table of flights, one column each.

    Args:
        flights: Figures of each flight, by its heading.
        figures: Headings and names of the figures that are shown.
    """
    rows = [[title, *(one[key] for one in flights.values())] for title, key in figures.items()]
    return Table(("quantity", *flights), rows)


def learner_name(row: Row) -> str:
    """Name of the learner of a row, and whether it diverged.

    Args:
        row: Scores of a trial, or of the held sample.
    """
    if row["learner"] == HELD:
        return HELD
    return LEARNERS[row["learner"]] + ("" if row["outcome"] == "COMPLETED" else ", diverged")


def network_name(row: Row) -> str | None:
    """Name of the network of a row.

    Args:
        row: Scores of a trial, or of the held sample.
    """
    return None if row["learner"] == HELD else NETWORKS.get(row["network"], "all inputs")


HELD = "last used sample held"
SCORES: Columns = {
    "one sample in": "every",
    "NMSE, mean force [1]": "nmse_second_half_mean",
    "NMSE, worst force [1]": "nmse_second_half_worst",
    "NMSE 10 ms ahead, worst force [1]": "horizon_10ms_nmse_second_half_worst",
}
"""Headings and names of the scores that every table of learners shows."""


def held_row(row: Row) -> dict[str, Any]:
    """Scores of holding the last used sample, with the names of a learner's scores.

    Args:
        row: Scores of a trial that used the same samples.
    """
    names = [key for key in row if key.startswith(("persistence", "horizon"))]
    held = {key.replace("persistence", "nmse"): row[key] for key in names if "persistence" in key}
    return {"learner": HELD, "every": row["every"], **held}


def with_held_rows(rows: Sequence[Row], keys: Sequence[str]) -> list[Row]:
    """Rows of learners, with a row of the held sample before each group of them.

    Args:
        rows: Scores of trials.
        keys: Names of the values that a group has in common.
    """
    found: list[Row] = []
    groups = set[tuple[Any, ...]]()
    for row in rows:
        group = tuple(row[key] for key in keys)
        if group not in groups:
            groups.add(group)
            found.append(held_row(row) | {key: row[key] for key in keys})
        found.append(row)
    return found


def learner_table(metrics: Metrics, flight: str) -> Table:
    """Table of every learner, network and rate of samples on one flight.

    Args:
        metrics: Metrics of the reproduction.
        flight: Key of the flight.
    """
    runs = [row for row in metrics["learning"] if row["flight"] == flight]
    columns: Columns = {
        "learner": learner_name,
        "network": network_name,
        **SCORES,
        "NMSE one beat ahead, worst force [1]": "horizon_beat_nmse_second_half_worst",
        "share in the 95 % interval [1]": "coverage_second_half",
        "largest variance of a weight [1]": "largest_variance",
        "time of an update [µs]": "microseconds_per_update",
    }
    caption = (
        "Normalized mean square error (NMSE) over the second half, predicted before the sample was "
        "used; at the two horizons with frozen weights. A learner is of use where it is better "
        "than the last used sample held."
    )
    ordered = sorted(runs, key=lambda row: -row["every"])
    return table_of(columns, with_held_rows(ordered, ("every",)), caption)


def unseen_table(metrics: Metrics, flight: str) -> Table:
    """Table of frozen models on gaits that were not learned.

    Args:
        metrics: Metrics of the reproduction.
        flight: Key of the flight that was learned, from one sample in 100.
    """
    rows = [
        row
        for row in metrics["learning"]
        if row["flight"] == flight and row["every"] == 100 and row["unseen"]
    ]
    gaits = list(rows[0]["unseen"]) if rows else []
    held = [rows[0]["unseen"][gait]["persistence_worst"] for gait in gaits]
    cells: list[list[Any]] = [["last sample held (one in 100)", None, *held]] if rows else []
    for row in rows:
        name = [LEARNERS[row["learner"]], NETWORKS.get(row["network"], "all inputs")]
        cells.append([*name, *(row["unseen"][gait]["worst"] for gait in gaits)])
    return Table(
        ("learner", "network", *(f"{gait} [1]" for gait in gaits)),
        cells,
        "Normalized mean square error of the worst force over a gait that was not learned, with "
        "weights frozen after the flight that was learned.",
    )


def limit_table(metrics: Metrics) -> Table:
    """Table of what limits the dense network.

    Args:
        metrics: Metrics of the reproduction.
    """
    columns: Columns = {
        "published flight": "label",
        "one sample in": "every",
        "weights": "weights",
        "NMSE, mean force [1]": "nmse_second_half_mean",
        "NMSE, worst force [1]": "nmse_second_half_worst",
        "share in the 95 % interval [1]": "coverage_second_half",
        "largest variance of a weight [1]": "largest_variance",
        "completed": lambda row: row["outcome"] == "COMPLETED",
    }
    caption = "One thing is changed at a time; second half of the flight."
    return table_of(columns, metrics["limits"], caption)


def start_spans(starts: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Least, median and most of the scores over the starts of each strip network.

    Args:
        starts: Scores of trials that differ in their first weights.
    """
    groups: dict[tuple[str, str, int], list[Mapping[str, Any]]] = {}
    for row in starts:
        groups.setdefault((row["flight"], row["network"], row["every"]), []).append(row)
    keys = {"error": "nmse_second_half_worst", "coverage": "coverage_second_half"}
    keys["unseen"] = "unseen_worst"
    return [
        {
            "flight": flight,
            "network": network,
            "every": every,
            "starts": len(runs),
            **{
                f"{key}_{word}": float(pick([run.get(name, np.nan) for run in runs]))
                for key, name in keys.items()
                for word, pick in (("least", np.min), ("median", np.median), ("most", np.max))
            },
        }
        for (flight, network, every), runs in groups.items()
    ]


def starts_table(metrics: Metrics) -> Table:
    """Table of how much the scores of a strip network depend on its first weights.

    Args:
        metrics: Metrics of the reproduction.
    """
    columns: Columns = {
        "flight": "flight",
        "network": lambda row: NETWORKS[row["network"]],
        "one sample in": "every",
        "starts": "starts",
        "NMSE, best start [1]": "error_least",
        "NMSE, median start [1]": "error_median",
        "NMSE, worst start [1]": "error_most",
        "share in the 95 % interval, least [1]": "coverage_least",
        "share in the interval, median [1]": "coverage_median",
        "share in the interval, most [1]": "coverage_most",
        "NMSE on unseen gaits, median start [1]": "unseen_median",
        "NMSE on unseen gaits, worst start [1]": "unseen_most",
    }
    caption = (
        "Strip network and cubature filter from several random starts. Worst force of the second "
        "half; on unseen gaits worst force of the worst gait within the incidences learned."
    )
    return table_of(columns, metrics["start_spans"], caption)


def dynamics_table(metrics: Metrics) -> Table:
    """Table of the overhead of dynamics, by formulation.

    Args:
        metrics: Metrics of the reproduction.
    """
    columns: Columns = {
        "formulation": "formulation",
        "run": "run",
        "D [ns]": "mass_matrix",
        "C v + G [ns]": "bias",
        "D and C v + G [ns]": "both",
        "derivation [s]": "derivation_time",
        "compiling [s]": "compile_time",
        "code [bytes]": lambda row: row["code_size"] or None,
    }
    caption = "Median time of a call on random states, on one core."
    return table_of(columns, metrics["overhead"]["dynamics"], caption)


def aerodynamics_table(metrics: Metrics) -> Table:
    """Table of the overhead of aerodynamics, by model.

    Args:
        metrics: Metrics of the reproduction.
    """
    columns: Columns = {
        "model": "model",
        "kind": "kind",
        "one state a call [ns]": "single",
        "one of many states [ns]": "batch",
        "time in 1 s of flight [s]": "flight_second",
        "times real time [1]": "times_real_time",
    }
    caption = (
        "Force, and rates of the model's own states, compiled, on one core. One second of flight "
        "calls the model 40 000 times (Runge-Kutta at 0.1 ms). Lags of a network are given."
    )
    return table_of(columns, metrics["overhead"]["aerodynamics"], caption)


def stage_table(metrics: Metrics) -> Table:
    """Table of the time that each stage of the reproduction took.

    Args:
        metrics: Metrics of the reproduction.
    """
    return Table(("stage", "time [s]"), list(metrics["stages"].items()))

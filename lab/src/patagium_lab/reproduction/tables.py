"""Tables of the reproduction, made of its metrics and nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from patagium.report import Table
from patagium_lab.reproduction.subjects import LEARNERS, NETWORKS

Metrics = Mapping[str, Any]


def flight_table(metrics: Metrics) -> Table:
    """The two flights in numbers.

    Args:
        metrics: Of the reproduction.
    """
    flights = metrics["flights"]
    quantities = {
        "duration [s]": "duration",
        "beats a second [Hz]": "beat_frequency",
        "speed at the start [m/s]": "speed_start",
        "largest speed [m/s]": "speed_largest",
        "speed at the end [m/s]": "speed_end",
        "distance [m]": "distance",
        "change of height [m]": "height_change",
        "largest force of the air [N]": "force_largest",
        "mean lift over weight, second half": "lift_over_weight",
        "largest incidence [rad]": "incidence_largest",
        "reduced frequency at the start": "reduced_frequency_start",
        "reduced frequency at the end": "reduced_frequency_end",
        "energy residual over energy exchanged": "energy_audit",
        "momentum residual over impulse exchanged": "momentum_audit",
        "largest power of the air [W]": "aero_power_largest",
    }
    rows = [
        [title, *(flights[name][key] for name in ("published", "corrected"))]
        for title, key in quantities.items()
    ]
    return Table(("quantity", "published", "corrected"), rows)


def learner_table(metrics: Metrics, flight: str) -> Table:
    """Every learner, network and rate of samples on one flight.

    Args:
        metrics: Of the reproduction.
        flight: Key of the flight.
    """
    rows, held = [], set[int]()
    runs = [row for row in metrics["learning"] if row["flight"] == flight]
    for row in sorted(runs, key=lambda row: -row["every"]):
        if row["every"] not in held:
            held.add(row["every"])
            rows.append(_persistence(row))
        rows.append(_learner(row))
    columns = (
        "learner",
        "network",
        "one in",
        "NMSE mean",
        "NMSE worst",
        "10 ms ahead",
        "one beat ahead",
        "in the 95 % interval",
        "largest variance",
        "update [µs]",
    )
    return Table(
        columns,
        rows,
        "Normalized mean square error over the second half: mean and worst of the forces, "
        "predicted before the sample was used; worst at two horizons with frozen weights. Holding "
        "the last used sample is the bar.",
    )


def _persistence(row: Mapping[str, Any]) -> list[Any]:
    return [
        "last used sample held",
        None,
        row["every"],
        row.get("persistence_second_half_mean"),
        row.get("persistence_second_half_worst"),
        row.get("horizon_10ms_persistence_second_half_worst"),
        row.get("horizon_beat_persistence_second_half_worst"),
        None,
        None,
        None,
    ]


def _learner(row: Mapping[str, Any]) -> list[Any]:
    completed = row["outcome"] == "COMPLETED"
    return [
        LEARNERS[row["learner"]] + ("" if completed else ", diverged"),
        NETWORKS.get(row["network"], "all inputs"),
        row["every"],
        row.get("nmse_second_half_mean"),
        row.get("nmse_second_half_worst"),
        row.get("horizon_10ms_nmse_second_half_worst"),
        row.get("horizon_beat_nmse_second_half_worst"),
        row.get("coverage_second_half"),
        row.get("largest_variance"),
        row["microseconds_per_update"],
    ]


def unseen_table(metrics: Metrics, flight: str) -> Table:
    """Frozen models on gaits they never saw, learned from one sample in 100.

    Args:
        metrics: Of the reproduction.
        flight: Key of the flight.
    """
    runs = [
        row
        for row in metrics["learning"]
        if row["flight"] == flight and row["every"] == 100 and row["unseen"]
    ]
    gaits = list(runs[0]["unseen"]) if runs else []
    held = [runs[0]["unseen"][gait]["persistence_worst"] for gait in gaits]
    rows: list[list[Any]] = [["last sample held (it sees one in 100)", None, *held]] if runs else []
    for row in runs:
        name = [LEARNERS[row["learner"]], NETWORKS.get(row["network"], "all inputs")]
        rows.append([*name, *(row["unseen"][gait]["worst"] for gait in gaits)])
    return Table(
        ("learner", "network", *gaits),
        rows,
        "Worst normalized mean square error of the forces over 1 s of a gait that was not "
        "learned, weights frozen after the flight that was.",
    )


def limit_table(metrics: Metrics) -> Table:
    """What limits the dense network.

    Args:
        metrics: Of the reproduction.
    """
    rows = [
        [
            row["label"],
            row["every"],
            row["weights"],
            row.get("nmse_second_half_mean"),
            row.get("nmse_second_half_worst"),
            row.get("coverage_second_half"),
            row.get("largest_variance"),
            row["outcome"] == "COMPLETED",
        ]
        for row in metrics["limits"]
    ]
    columns = (
        "published flight",
        "one in",
        "weights",
        "NMSE mean",
        "NMSE worst",
        "in the 95 % interval",
        "largest variance",
        "finished",
    )
    return Table(columns, rows, "One thing changed at a time; second half of the flight.")


def start_spans(starts: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Least, median and most of the scores over the starts of a strip network.

    Args:
        starts: Scores of runs that differ in where they start.
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
    """How much the strip network's scores depend on the weights it starts from.

    Args:
        metrics: Of the reproduction.
    """
    columns = {
        "flight": "flight",
        "network": "network",
        "every": "one in",
        "starts": "starts",
        "error_least": "NMSE worst: best start",
        "error_median": "median",
        "error_most": "worst start",
        "coverage_least": "in the 95 % interval: least",
        "coverage_median": "median",
        "coverage_most": "most",
        "unseen_median": "unseen gaits: median",
        "unseen_most": "worst start",
    }
    rows = [
        [NETWORKS[row[key]] if key == "network" else row[key] for key in columns]
        for row in metrics["start_spans"]
    ]
    return Table(
        list(columns.values()),
        rows,
        "Strip network, cubature filter, from several random starts. Worst force, second half; "
        "worst force of the worst unseen gait within the incidences learned.",
    )


def dynamics_table(metrics: Metrics) -> Table:
    """Overhead of dynamics by formulation.

    Args:
        metrics: Of the reproduction.
    """
    rows = [
        [
            row["formulation"],
            row["run"],
            row["mass_matrix"],
            row["bias"],
            row["both"],
            row["derivation_time"],
            row["compile_time"],
            row["code_size"] or None,
        ]
        for row in metrics["overhead"]["dynamics"]
    ]
    columns = (
        *("formulation", "run", "D [ns]", "C v + G [ns]", "both [ns]"),
        *("derivation [s]", "compiling [s]", "code [bytes]"),
    )
    return Table(columns, rows, "Median time of a call on random states, one core.")


def aerodynamics_table(metrics: Metrics) -> Table:
    """Overhead of aerodynamics, actual and estimated.

    Args:
        metrics: Of the reproduction.
    """
    keys = ("model", "kind", "single", "batch", "flight_second", "times_real_time")
    rows = [[row[key] for key in keys] for row in metrics["overhead"]["aerodynamics"]]
    columns = (
        *("model", "by", "one state a call [ns]", "a state of many [ns]"),
        *("in 1 s of flight [s]", "times real time"),
    )
    return Table(
        columns,
        rows,
        "Force and rates of the model's own states, compiled, one core; 1 s of flight asks for "
        "the air 40 000 times (Runge-Kutta at 0.1 ms). Lags of hidden states are given.",
    )


def stage_table(metrics: Metrics) -> Table:
    """Where the time of the reproduction went.

    Args:
        metrics: Of the reproduction.
    """
    return Table(("stage", "time [s]"), list(metrics["stages"].items()))

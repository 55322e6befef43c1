"""The paper's claims, one by one: the published experiment beside our results.

Every figure comes from the metrics of the page; nothing is measured here. Claims without a number
behind them are left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from patagium.report import cell_text
from patagium_lab.comparisons import seconds_text
from patagium_lab.reproduction.cases import STRIPS
from patagium_lab.study import Metrics

CLOSE = 0.01
"""Error of the worst force below which replay is said to come close."""


def scores_of_trial(
    metrics: Metrics, flight: str, network: str, learner: str = "cubature", every: int = 100
) -> dict[str, Any]:
    """Scores of a trial; empty where it was not run.

    Args:
        metrics: Metrics of the reproduction.
        flight: Key of the flight.
        network: Key of the network.
        learner: Key of the learner.
        every: One sample in this many was learned.
    """
    wanted = (flight, network, learner, every)
    for row in metrics["learning"]:
        if (row["flight"], row["network"], row["learner"], row["every"]) == wanted:
            return dict(row)
    return {}


def scores_of_starts(
    metrics: Metrics, flight: str, network: str, every: int, key: str
) -> list[float]:
    """One score of all starts of a strip network.

    Args:
        metrics: Metrics of the reproduction.
        flight: Key of the flight.
        network: Key of the network.
        every: One sample in this many was learned.
        key: Name of the score.
    """
    wanted = (flight, network, every)
    return [
        float(row[key])
        for row in metrics["starts"]
        if (row["flight"], row["network"], row["every"]) == wanted and _number(row.get(key))
    ]


def best_strip(flight: str) -> str:
    """Key of the strip network that can represent the air of a flight."""
    return STRIPS[flight][0]


def claims(metrics: Metrics) -> list[dict[str, Any]]:
    """Rows of the paper's claims, with the keys claim, published and ours.

    Args:
        metrics: Metrics of the reproduction.
    """
    makers = (
        _overhead,
        _accuracy,
        _sparse,
        _unseen,
        _confidence,
        _noise,
        _real_time,
        _layers,
        _extended,
        _backpropagation,
        _cheaper,
        _morphing,
    )
    return [make(metrics)._asdict() for make in makers]


def claim_paragraphs(metrics: Metrics) -> list[str]:
    """Three paragraphs for each claim: the claim, its published experiment, this reproduction.

    Args:
        metrics: Metrics of the reproduction, `claims` among them.
    """
    return [
        text
        for number, row in enumerate(metrics["claims"], 1)
        for text in (
            f"**Claim {number}: {row['claim']}**",
            f"Published experiment: {row['published']}",
            f"Found here: {row['ours']}",
        )
    ]


class PaperClaim(NamedTuple):
    """A claim of the paper.

    Attributes:
        claim: What the paper says.
        published: What its published experiment does.
        ours: What this reproduction finds.
    """

    claim: str
    published: str
    ours: str


def _overhead(metrics: Metrics) -> PaperClaim:
    rows = {row["formulation"]: row for row in metrics["overhead"]["dynamics"]}
    compiled = {name: row for name, row in rows.items() if row["run"] == "compiled"}
    times = "; ".join(
        f"{name} {seconds_text(1e-9 * _total(row))}" for name, row in compiled.items()
    )
    symbolic = next((row for name, row in rows.items() if "sympy" in name.lower()), None)
    recursive = next((row for name, row in rows.items() if "recursive" in name), None)
    derived = ""
    if symbolic and recursive:
        derived = (
            " What algorithmic differentiation does save is the derivation: "
            f"{seconds_text(symbolic['derivation_time'])} symbolically, "
            f"{seconds_text(recursive['derivation_time'])} here."
        )
    return PaperClaim(
        "Algorithmic differentiation gives D, C and G much faster than symbolic terms.",
        "First-call timings, interpreted against compiled, a smaller symbolic model, no shared "
        "subexpressions (E13).",
        f"Like for like, compiled, D and C v + G of the same robot: {times or 'no compiler'}. "
        "Symbolic code with shared subexpressions is not slow; formulation, compiling and "
        f"sharing win, not the way of differentiating.{derived}",
    )


def _accuracy(metrics: Metrics) -> PaperClaim:
    found = []
    for flight in ("published", "corrected"):
        for network, word in (("dense", "dense"), (best_strip(flight), "strip")):
            row = scores_of_trial(metrics, flight, network)
            if row:
                found.append(
                    f"{flight}, {word}: mean {_text(row['nmse_second_half_mean'])}, worst "
                    f"{_text(row['nmse_second_half_worst'])}, held sample "
                    f"{_text(row['persistence_second_half_mean'])}"
                )
    return PaperClaim(
        "The mean square error is 0.04 % for all generalized forces.",
        "No normalization is stated, and pitch is visibly wrong in its figure (E12).",
        "Normalized by the variance of each force, one sample in 100, second half: "
        + _listed(found)
        + ".",
    )


def _sparse(metrics: Metrics) -> PaperClaim:
    found = []
    for flight in ("published", "corrected"):
        parts = [
            f"{word} {_text(row['nmse_second_half_worst'])}"
            for every, word in ((100, "one in 100"), (10, "one in 10"), (1, "every sample"))
            if (row := scores_of_trial(metrics, flight, best_strip(flight), every=every))
        ]
        rival = scores_of_trial(metrics, flight, "", "features")
        tail = ""
        if rival:
            tail = (
                f" (least squares on random features, one in 100: "
                f"{_text(rival['nmse_second_half_worst'])})"
            )
        found.append(f"{flight}: {', '.join(parts)}{tail}")
    return PaperClaim(
        "One sample in 100 is enough.",
        "Its script updates at every sample (E10).",
        f"Strip network, worst force, second half: {_listed(found)}. It is enough, also for "
        "simpler rivals; what they lack is the next line.",
    )


def _unseen(metrics: Metrics) -> PaperClaim:
    found = []
    for flight in ("published", "corrected"):
        for network, learner, word in (
            (best_strip(flight), "cubature", "strip"),
            ("dense", "cubature", "dense"),
            ("", "features", "least squares on random features"),
        ):
            row = scores_of_trial(metrics, flight, network, learner)
            if row.get("unseen"):
                worst = max(gait["worst"] for gait in row["unseen"].values())
                found.append(f"{flight}, {word} {_text(worst)}")
    return PaperClaim(
        "The learned model predicts the forces in a 200 ms envelope, where backpropagation would "
        "be trapped around a local attractor.",
        "Only the gait that was learned is shown, while it is learned.",
        f"Weights frozen, gaits never seen, worst force of the worst gait: {_listed(found)}. "
        "Without physics inside nothing carries over to another gait.",
    )


def _confidence(metrics: Metrics) -> PaperClaim:
    found = [
        f"{flight}: {_text(row['prior_variance'])} before the first sample, "
        f"{_text(row['largest_variance'])} at the end, {_percent(row['coverage_second_half'])} "
        "of samples in the 95 % interval"
        for flight in ("published", "corrected")
        if (row := scores_of_trial(metrics, flight, best_strip(flight)))
    ]
    dense = scores_of_trial(metrics, "published", "dense")
    tail = ""
    if dense:
        tail = (
            " The dense network, which has to forget, ends at "
            f"{_text(dense['largest_variance'])} with its errors falling."
        )
    return PaperClaim(
        "The diagonal of P is below 1e-2, which reflects the confidence of the filter.",
        "P starts at 1e-3, so it is below 1e-2 before the first sample; the predicted P is about "
        "Q at every step (E10).",
        f"Strip network, {_listed(found)}. The diagonal depends on how weights are scaled; "
        f"coverage is the test of confidence.{tail}",
    )


def _noise(metrics: Metrics) -> PaperClaim:
    std = metrics["choices"]["strip_std"]
    return PaperClaim(
        "Process and measurement noise are zero.",
        "Its script has Q = R = 1e-3.",
        "R = 0 makes the innovation covariance singular. Here R stands for what the network "
        f"cannot represent: {_text(std['published'])} N a strip published, "
        f"{_text(std['corrected'])} N corrected; Q is zero. Dense networks forget instead, "
        f"to a share 1/e in {_text(metrics['choices']['memory'])} s or "
        f"{_text(metrics['choices']['least_memory'])} samples.",
    )


def _real_time(metrics: Metrics) -> PaperClaim:
    parts = []
    for network, word in (("strip", "strip"), ("dense", "dense"), ("dense_published", "dense")):
        row = scores_of_trial(metrics, "corrected", network)
        if row:
            parts.append(
                f"{word}, {row['weights']} weights, {seconds_text(row['time_per_update'])}"
            )
    return PaperClaim(
        "The model can be estimated in real time.",
        "No time of an update is given.",
        f"An update takes: {'; '.join(parts)}, on one core of this machine. One sample in 100 "
        "leaves 10 ms, every sample 0.1 ms.",
    )


def _layers(metrics: Metrics) -> PaperClaim:
    found = []
    for flight in ("published", "corrected"):
        for network in ("dense", "dense_published", "dense_velocity"):
            row = scores_of_trial(metrics, flight, network, every=10)
            if row:
                found.append(
                    f"{flight} {row['weights']} weights {_text(row['nmse_second_half_worst'])}"
                )
    return PaperClaim(
        "The network has three layers with two softplus activations.",
        "One softplus layer of 20 neurons; 400 recurrent weights are multiplied by zero (E10).",
        "Both are run: 28-16-12-14 (850 weights), 28-20-14 (874), and 8-20-14 (474). One sample "
        f"in 10, worst force, second half: {_listed(found)}.",
    )


def _extended(metrics: Metrics) -> PaperClaim:
    found = []
    for network, word in (("strip", "strip"), ("dense_published", "dense, 874 weights")):
        for flight in ("published", "corrected"):
            ours = scores_of_trial(metrics, flight, network)
            rival = scores_of_trial(metrics, flight, network, "extended")
            if ours and rival:
                found.append(
                    f"{word}, {flight}: extended {seconds_text(rival['time_per_update'])} and "
                    f"{_text(rival['nmse_second_half_worst'])}, cubature "
                    f"{seconds_text(ours['time_per_update'])} and "
                    f"{_text(ours['nmse_second_half_worst'])}"
                )
    return PaperClaim(
        "The extended Kalman filter is too costly, because of the Jacobian.",
        "It is not tried.",
        f"Time of an update and worst force, one sample in 100: {_listed(found)}. Both are "
        "written in C. The Jacobian costs one backward pass; both filters spend their time on P.",
    )


def _backpropagation(metrics: Metrics) -> PaperClaim:
    replayed = [row["every"] for row in metrics["learning"] if row["learner"] == "replay"]
    found, every, close = [], min(replayed), True
    for flight in ("published", "corrected"):
        for network, word in (("dense_published", "dense"), (best_strip(flight), "strip")):
            parts = [
                f"{name} {_text(row['nmse_second_half_worst'])}"
                for learner, name in (
                    ("gradient", "gradient"),
                    ("replay", "with replay"),
                    ("cubature", "cubature"),
                )
                if (row := scores_of_trial(metrics, flight, network, learner, every))
            ]
            if parts:
                found.append(f"{flight}, {word}: {', '.join(parts)}")
        row = scores_of_trial(metrics, flight, best_strip(flight), "replay", every)
        close &= row["nmse_second_half_worst"] < CLOSE
    return PaperClaim(
        "Backpropagation needs large data sets and offline training.",
        "It is not tried.",
        f"One step of Adam a sample, one sample in {every}, worst force, second half: "
        f"{_listed(found)}. For a dense network the paper is right: a filter learns far more "
        "from a sample." + (" With physics inside, replay comes close." if close else ""),
    )


def _cheaper(metrics: Metrics) -> PaperClaim:
    parts = [
        f"{row['model'].replace('_', ' ')} {seconds_text(1e-9 * row['single'])}"
        for row in metrics["overhead"]["aerodynamics"]
    ]
    return PaperClaim(
        "The estimated aerodynamic model has a low overhead.",
        "Interpreted model against generated code.",
        f"One state, compiled: {'; '.join(parts)}. A quasi-steady model is as cheap as any "
        "network; networks pay where the actual model is dear or unknown.",
    )


def _morphing(metrics: Metrics) -> PaperClaim:
    flights = metrics["flights"]
    return PaperClaim(
        "The data come from morphing wing flight.",
        "Elbow, feather and mediolateral are held at zero; joints are overwritten (E3); 15 Hz at "
        "2 m/s is a reduced frequency of "
        f"{_text(flights['published']['reduced_frequency_start'])} (E8), and the robot reaches "
        f"{_text(flights['published']['speed_largest'])} m/s.",
        "The linkage drives plunge and elbow, the plates feather: "
        f"{_text(flights['corrected']['speed_start'])} to "
        f"{_text(flights['corrected']['speed_end'])} m/s, mean lift "
        f"{_text(flights['corrected']['lift_over_weight'])} of the weight.",
    )


def _total(row: Mapping[str, Any]) -> float:
    """D and C v + G together, or one after the other [ns]."""
    both = row["both"]
    return float(both if _number(both) else row["mass_matrix"] + row["bias"])


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and math.isfinite(value)


def _listed(found: Sequence[str]) -> str:
    return "; ".join(found) or "not run"


def _text(value: Any) -> str:
    return cell_text(value)


def _percent(share: Any) -> str:
    return f"{100 * float(share):.0f} %" if _number(share) else "n/a"

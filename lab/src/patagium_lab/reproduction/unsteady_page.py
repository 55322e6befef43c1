"""Air with memory on the page: flights, scores, targets, and findings in words.

Every figure comes from the metrics, and the sentences are chosen by them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from patagium.report import Block, Note, PageSection, Table, cell_text
from patagium_lab.comparisons import score_points
from patagium_lab.gallery import Gallery
from patagium_lab.reproduction import figures
from patagium_lab.reproduction.tables import FLIGHT_FIGURES, HELD, flight_table, with_held_rows
from patagium_lab.reproduction.tables import SCORES as LEARNER_SCORES
from patagium_lab.reproduction.unsteady_flights import MOUNTS
from patagium_lab.reproduction.unsteady_models import CANDIDATES
from patagium_lab.reproduction.unsteady_trials import UnsteadyResult
from patagium_lab.study import Columns, Metrics, Row, table_of
from patagium_lab.targets import Target, at_least, at_most

PLAIN, MEMORY = "strip", "attached"
"""Candidates that targets compare."""
ERROR, UNSEEN, EVERY_SAMPLE, RATIO = 1e-3, 1e-2, 1e-4, 5.0
"""Limits: worst force from one sample in 100, on unseen gaits, from every sample; times below."""
WORST = "nmse_second_half_worst"


def unsteady_metrics(
    results: Sequence[UnsteadyResult], flights: Mapping[str, Any]
) -> dict[str, Any]:
    """Metrics of the learners in air with memory.

    Args:
        results: Results of all trials.
        flights: Figures of `fly_unsteady`, by mount.
    """
    rows = [
        one.scores | {"unseen_worst": _worst(one.scores["unseen"], flights[one.trial.mount])}
        for one in results
    ]
    return {
        "flights": dict(flights),
        "learning": [row for row in rows if row["seed"] == 0],
        "starts": [{k: v for k, v in row.items() if k != "unseen"} for row in rows],
    }


def unsteady_targets(metrics: Metrics) -> list[tuple[Target, list[float]]]:
    """Targets of learning air with memory, and what each start reached.

    Args:
        metrics: Metrics of the reproduction.
    """
    rows: list[tuple[Target, list[float]]] = []
    sparse = max(row["every"] for row in metrics["unsteady"]["learning"])
    for mount, name in MOUNTS.items():
        found = scores_of(metrics, mount, MEMORY, sparse)
        plain = scores_of(metrics, mount, PLAIN, sparse)
        ratios = [p / one for p in plain for one in found]
        unseen = scores_of(metrics, mount, MEMORY, sparse, "unseen_worst")
        dense = scores_of(metrics, mount, MEMORY, 1)
        title, half = f"unsteady, {name}: strips with a lag", "worst force, second half"
        rows += [
            (at_most(f"{title}, one in {sparse}, {half}", ERROR, ".1e"), found),
            (at_least(f"{title}, times below no memory, one in {sparse}", RATIO), ratios),
            (at_most(f"{title}, frozen, unseen gaits, worst force", UNSEEN, ".1e"), unseen),
            (at_most(f"{title}, every sample, {half}", EVERY_SAMPLE, ".1e"), dense),
        ]
    return rows


def scores_of(
    metrics: Metrics, mount: str, candidate: str, every: int, key: str = WORST
) -> list[float]:
    """One score of all starts of a candidate.

    Args:
        metrics: Metrics of the reproduction.
        mount: Key of `MOUNTS`.
        candidate: Key of `CANDIDATES`.
        every: One sample in this many was learned.
        key: Name of the score.
    """
    wanted = (mount, candidate, every)
    rows = metrics["unsteady"]["starts"]
    found = [
        row.get(key) for row in rows if (row["mount"], row["candidate"], row["every"]) == wanted
    ]
    return [float(value) for value in found if value is not None and math.isfinite(value)]


def unsteady_section(metrics: Metrics, gallery: Gallery) -> PageSection:
    """Section of the page.

    Args:
        metrics: Metrics of the reproduction.
        gallery: Figures of the reproduction.
    """
    flights = metrics["unsteady"]["flights"]
    shown = {MOUNTS[mount]: found["learned"] for mount, found in flights.items()}
    forces = [f"unsteady_{mount}_forces_{part}" for mount in MOUNTS for part in _PARTS]
    unseen = [f"unsteady_{mount}_unseen" for mount in MOUNTS]
    beyond = {
        f"{name} ({MOUNTS[mount]})" for mount, found in flights.items() for name in found["beyond"]
    }
    blocks: list[Block] = [
        _INTRODUCTION,
        *findings(metrics),
        *gallery.pictures("unsteady_scores", *forces, *unseen),
        flight_table(shown, _FLIGHT_FIGURES),
        _learner_table(metrics),
        *(_unseen_table(metrics, mount) for mount in MOUNTS),
        Note(
            "Flights whose incidences leave the range that was learned have no target: "
            f"{', '.join(sorted(beyond)) or 'none here'}."
        ),
    ]
    return PageSection("Air with memory", blocks)


def findings(metrics: Metrics) -> list[str]:
    """Findings in sentences that the numbers choose.

    Args:
        metrics: Metrics of the reproduction.
    """
    rates = sorted({row["every"] for row in metrics["unsteady"]["learning"]}, reverse=True)
    words = []
    for mount, name in MOUNTS.items():
        parts = []
        for every in rates:
            rate = "every sample" if every == 1 else f"one sample in {every}"
            parts.append(f"{rate}: {_listed(_ranked(metrics, mount, every, WORST))}")
        words.append(
            f"**{name.capitalize()}**, worst force of the second half. {'. '.join(parts)}."
        )
        order = _ranked(metrics, mount, rates[0], "unseen_worst")
        if order:
            words.append(
                "With frozen weights, on the worst unseen flight within the incidences learned: "
                f"{_listed(order)}."
            )
    return [*words, *_comparisons(metrics, rates[0])]


def _comparisons(metrics: Metrics, every: int) -> list[str]:
    """Sentences that compare strips with and without lag states, and name missed targets."""
    words = []
    for mount, name in MOUNTS.items():
        lagged = scores_of(metrics, mount, MEMORY, every)
        plain = scores_of(metrics, mount, PLAIN, every)
        if not (lagged and plain):
            continue
        ratio = float(np.median(plain) / np.median(lagged))
        side = "below" if ratio >= 1 else "above"
        text = (
            f"In {name} a lag in each strip brings the error "
            f"{cell_text(ratio if ratio >= 1 else 1 / ratio)} times {side} that without memory"
        )
        best = _ranked(metrics, mount, every, WORST)[0][0]
        better = "" if best == CANDIDATES[MEMORY].title else f"; the best of all is the {best}"
        words.append(f"{text}{better}.")
    missed = [
        target.name
        for target, found in unsteady_targets(metrics)
        if found and not target.meets(float(np.median(found)))
    ]
    return words + ([f"**Missed**: {'; '.join(missed)}."] if missed else [])


def _ranked(metrics: Metrics, mount: str, every: int, key: str) -> list[tuple[str, float]]:
    """Candidates and their median over the starts, the best first."""
    rows = []
    for candidate in CANDIDATES.values():
        found = scores_of(metrics, mount, candidate.key, every, key)
        if found:
            rows.append((candidate.title, float(np.median(found))))
    return sorted(rows, key=lambda row: row[1])


def _listed(order: Sequence[tuple[str, float]]) -> str:
    return ", ".join(f"{name} {cell_text(value)}" for name, value in order)


def _worst(unseen: Mapping[str, Any], flights: Mapping[str, Any]) -> float:
    return max((unseen[name]["worst"] for name in flights["within"]), default=math.nan)


def _learner_table(metrics: Metrics) -> Table:
    mounts, candidates = list(MOUNTS), list(CANDIDATES)
    rows = sorted(
        metrics["unsteady"]["learning"],
        key=lambda row: (
            mounts.index(row["mount"]),
            -row["every"],
            candidates.index(row["candidate"]),
        ),
    )
    columns: Columns = {
        "mount": lambda row: MOUNTS[row["mount"]],
        "candidate": _candidate_name,
        "weights": "weights",
        **LEARNER_SCORES,
        "share in the 95 % interval [1]": "coverage_second_half",
        "NMSE on unseen flights, worst force [1]": "unseen_worst",
        "time of an update [µs]": "microseconds_per_update",
    }
    caption = (
        "Kalman filters from their first start. Normalized mean square error (NMSE) over the "
        "second half, predicted before the sample was used; on unseen flights with frozen "
        "weights, on the worst flight within the incidences learned."
    )
    return table_of(columns, with_held_rows(rows, ("mount", "every")), caption)


def _candidate_name(row: Row) -> str:
    if row.get("learner") == HELD:
        return HELD
    completed = row["outcome"] == "COMPLETED"
    return CANDIDATES[row["candidate"]].title + ("" if completed else ", diverged")


def _unseen_table(metrics: Metrics, mount: str) -> Table:
    rows = [row for row in metrics["unsteady"]["learning"] if row["mount"] == mount]
    names = list(rows[0]["unseen"])
    return Table(
        ("candidate", "one sample in", *(f"{name} [1]" for name in names)),
        [
            [
                CANDIDATES[row["candidate"]].title,
                row["every"],
                *(row["unseen"][name]["worst"] for name in names),
            ]
            for row in rows
        ],
        f"{MOUNTS[mount].capitalize()}: normalized mean square error of the worst force on "
        "flights that were not learned, with frozen weights.",
    )


def draw_unsteady(gallery: Gallery, metrics: Metrics, results: Sequence[UnsteadyResult]) -> None:
    """Figures of true and learned forces, and of the scores of all candidates.

    Args:
        gallery: Gallery that receives the figures.
        metrics: Metrics of the reproduction.
        results: Results of all trials.
    """
    for mount in MOUNTS:
        records = {
            one.trial.candidate: one.record
            for one in results
            if one.trial.mount == mount and one.record is not None
        }
        beat = 1.0 / metrics["unsteady"]["flights"][mount]["learned"]["beat_frequency"]
        chosen = {CANDIDATES[key].title: records[key] for key in (MEMORY, PLAIN)}
        figures.force_figures(gallery, f"unsteady_{mount}", chosen, beat, _PARTS)
        _draw_unseen(gallery, metrics, mount)
    learning = metrics["unsteady"]["learning"]
    places = sorted({(row["mount"], row["every"]) for row in learning}, key=lambda p: (p[0], -p[1]))
    names = [
        f"{MOUNTS[mount]},\n" + ("every sample" if every == 1 else f"one in {every}")
        for mount, every in places
    ]
    found = {(row["mount"], row["candidate"], row["every"]): row for row in learning}
    scores = {
        candidate.title: [
            float(found.get((mount, key, every), {}).get(WORST, math.nan))
            for mount, every in places
        ]
        for key, candidate in CANDIDATES.items()
    }
    caption = (
        "Air with memory: worst force of the second half, by candidate, mount and rate of samples."
    )
    gallery.add("unsteady_scores", score_points(names, scores), caption)


def _draw_unseen(gallery: Gallery, metrics: Metrics, mount: str) -> None:
    learning = metrics["unsteady"]["learning"]
    sparse = max(row["every"] for row in learning)
    rows = {
        row["candidate"]: row["unseen"]
        for row in learning
        if row["mount"] == mount and row["every"] == sparse
    }
    names = list(next(iter(rows.values())))
    scores = {
        CANDIDATES[key].title: [unseen[name]["worst"] for name in names]
        for key, unseen in rows.items()
    }
    caption = (
        f"Air with memory, {MOUNTS[mount]}: worst force on flights that were not learned, with "
        f"weights frozen after one sample in {sparse}."
    )
    gallery.add(f"unsteady_{mount}_unseen", score_points(names, scores), caption)


_PARTS = ("body", "left_wing")
_FLIGHT_FIGURES = {
    title: key
    for title, key in FLIGHT_FIGURES.items()
    if key
    in (
        *("duration", "beat_frequency", "speed_start", "speed_end", "height_change"),
        *("lift_over_weight", "incidence_largest", "energy_audit"),
    )
}
_INTRODUCTION = (
    "The flights above are flown through quasi-steady air, whose force depends on the present "
    "state alone. Real air has memory. Here the corrected robot flies through a lifting line with "
    "two lag states a strip, its wings carry the air's added mass, and it either flies freely or "
    "sits on a rigid stand in a wind. Networks see the state relative to the air, strips with a "
    "lag its acceleration too, and learn the force of circulation; added mass is known inertia. "
    "Then the weights are frozen and tried on "
    "gaits, a speed and a gust that were not learned."
)

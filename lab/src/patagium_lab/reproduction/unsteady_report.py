"""Air with memory in the report: flights, scores, targets, and what they say in words.

Every figure comes from the metrics; every sentence is chosen by them. Neglected: why a
candidate fails, beyond what the others show.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from patagium.report import Note, Picture, Section, Table, cell_text
from patagium.report.figures import score_bars
from patagium_lab.reproduction import figures
from patagium_lab.reproduction.unsteady import UnsteadyRun
from patagium_lab.reproduction.unsteady_flights import MOUNTS
from patagium_lab.reproduction.unsteady_subjects import CANDIDATES

Metrics = Mapping[str, Any]

PLAIN, MEMORY = "strip", "hidden"
"""Candidates that targets compare."""
ERROR, UNSEEN, EVERY_SAMPLE, RATIO = 1e-3, 1e-2, 1e-4, 5.0
"""Limits: worst force from one sample in 100, on unseen gaits, from every sample; times below."""


def unsteady_scores(runs: Sequence[UnsteadyRun], words: Mapping[str, Any]) -> dict[str, Any]:
    """The metrics of the study.

    Args:
        runs: All trials.
        words: Mount to the summaries of `fly_unsteady`.
    """
    rows = [
        run.scores | {"unseen_worst": _worst(run.scores["unseen"], words[run.trial.mount])}
        for run in runs
    ]
    return {
        "flights": dict(words),
        "learning": [row for row in rows if row["seed"] == 0],
        "starts": [{k: v for k, v in row.items() if k != "unseen"} for row in rows],
    }


def unsteady_targets(metrics: Metrics) -> Iterator[tuple[str, float, list[float], bool]]:
    """Targets of learning air with memory: name, limit, found of each start, at most or least.

    Args:
        metrics: Of the reproduction.
    """
    for mount, name in MOUNTS.items():
        sparse = max(row["every"] for row in metrics["unsteady"]["learning"])
        found = scores_of(metrics, mount, MEMORY, sparse)
        plain = scores_of(metrics, mount, PLAIN, sparse)
        title = f"unsteady, {name}: hidden states"
        yield f"{title}, one in {sparse}, worst force, second half", ERROR, found, True
        ratios = [p / h for p, h in zip(plain, found, strict=False)]
        yield f"{title}, times below no memory, one in {sparse}", RATIO, ratios, False
        unseen = scores_of(metrics, mount, MEMORY, sparse, "unseen_worst")
        yield f"{title}, frozen, unseen gaits, worst force", UNSEEN, unseen, True
        dense = scores_of(metrics, mount, MEMORY, 1)
        yield f"{title}, every sample, worst force, second half", EVERY_SAMPLE, dense, True


def scores_of(
    metrics: Metrics,
    mount: str,
    candidate: str,
    every: int,
    key: str = "nmse_second_half_worst",
) -> list[float]:
    """One score of all starts of a candidate.

    Args:
        metrics: Of the reproduction.
        mount: Key of `MOUNTS`.
        candidate: Key of `CANDIDATES`.
        every: One sample in so many.
        key: Name of the score.
    """
    wanted = (mount, candidate, every)
    rows = metrics["unsteady"]["starts"]
    found = [
        row.get(key) for row in rows if (row["mount"], row["candidate"], row["every"]) == wanted
    ]
    return [float(value) for value in found if value is not None and math.isfinite(value)]


def unsteady_section(metrics: Metrics, pictures: Mapping[str, Picture]) -> Section:
    """The section of the report.

    Args:
        metrics: Of the reproduction.
        pictures: By name.
    """
    names = [f"unsteady_{mount}_forces_{part}" for mount in MOUNTS for part in _PARTS]
    names += ["unsteady_scores", *(f"unsteady_{mount}_unseen" for mount in MOUNTS)]
    shown = {name: pictures[name] for name in names if name in pictures}
    blocks: list[Any] = [_INTRODUCTION, _flight_table(metrics)]
    blocks += findings(metrics)
    if "unsteady_scores" in shown:
        blocks.append(shown.pop("unsteady_scores"))
    blocks.append(_learner_table(metrics))
    blocks += list(shown.values())
    blocks += [_unseen_table(metrics, mount) for mount in MOUNTS]
    beyond = {
        f"{name} ({MOUNTS[mount]})"
        for mount, words in metrics["unsteady"]["flights"].items()
        for name in words["beyond"]
    }
    blocks.append(
        Note(
            "Flights whose incidences leave the range that was learned are no target: "
            f"{', '.join(sorted(beyond)) or 'none here'}."
        )
    )
    return Section("Air with memory", blocks)


def findings(metrics: Metrics) -> list[str]:
    """What was found, in words chosen by the numbers.

    Args:
        metrics: Of the reproduction.
    """
    rates = sorted({row["every"] for row in metrics["unsteady"]["learning"]}, reverse=True)
    words = []
    for mount, name in MOUNTS.items():
        parts = []
        for every in rates:
            order = _ranked(metrics, mount, every, "nmse_second_half_worst")
            rate = "every sample" if every == 1 else f"one sample in {every}"
            parts.append(f"{rate}: {_listed(order)}")
        words.append(
            f"**{name.capitalize()}**, worst force of the second half. {'. '.join(parts)}."
        )
        order = _ranked(metrics, mount, rates[0], "unseen_worst")
        if order:
            words.append(
                f"Frozen, worst unseen flight within the incidences learned: {_listed(order)}."
            )
    return [*words, *_verdicts(metrics, rates[0])]


def _verdicts(metrics: Metrics, every: int) -> list[str]:
    words = []
    for mount, name in MOUNTS.items():
        hidden = scores_of(metrics, mount, MEMORY, every)
        plain = scores_of(metrics, mount, PLAIN, every)
        if not (hidden and plain):
            continue
        ratio = float(np.median(plain) / np.median(hidden))
        side = "below" if ratio >= 1 else "above"
        times = cell_text(ratio if ratio >= 1 else 1 / ratio)
        words.append(
            f"In {name} hidden states bring the strip network {times} times {side} the one "
            "without memory"
        )
        best = _ranked(metrics, mount, every, "nmse_second_half_worst")[0]
        if best[0] != CANDIDATES[MEMORY].title:
            words[-1] += f"; the best of all is the {best[0]}"
        words[-1] += "."
    missed = [
        target
        for target, limit, found, below in unsteady_targets(metrics)
        if found and not _met(float(np.median(found)), limit, below)
    ]
    if missed:
        words.append(f"**Missed**: {'; '.join(missed)}.")
    return words


def _met(found: float, limit: float, below: bool) -> bool:
    return found <= limit if below else found >= limit


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


def _worst(unseen: Mapping[str, Any], words: Mapping[str, Any]) -> float:
    return max((unseen[name]["worst"] for name in words["within"]), default=math.nan)


def _flight_table(metrics: Metrics) -> Table:
    quantities = {
        "duration [s]": "duration",
        "beats a second [Hz]": "beat_frequency",
        "speed at the start [m/s]": "speed_start",
        "speed at the end [m/s]": "speed_end",
        "change of height [m]": "height_change",
        "mean lift over weight, second half": "lift_over_weight",
        "largest incidence [rad]": "incidence_largest",
        "energy residual over energy exchanged": "energy_audit",
    }
    flights = metrics["unsteady"]["flights"]
    rows = [
        [title, *(flights[mount]["learned"][key] for mount in MOUNTS)]
        for title, key in quantities.items()
    ]
    return Table(("quantity", *MOUNTS.values()), rows)


def _learner_table(metrics: Metrics) -> Table:
    rows, held = [], set[tuple[str, int]]()
    order = list(CANDIDATES)
    for row in sorted(
        metrics["unsteady"]["learning"],
        key=lambda row: (list(MOUNTS).index(row["mount"]), -row["every"],
                         order.index(row["candidate"])),
    ):  # fmt: skip
        place = (row["mount"], row["every"])
        if place not in held:
            held.add(place)
            rows.append(
                [MOUNTS[row["mount"]], "last used sample held", None, row["every"],
                 row["persistence_second_half_mean"], row["persistence_second_half_worst"],
                 None, None, None, None]
            )  # fmt: skip
        done = row["outcome"] == "COMPLETED"
        rows.append(
            [MOUNTS[row["mount"]],
             CANDIDATES[row["candidate"]].title + ("" if done else ", diverged"),
             row["weights"], row["every"],
             *(row.get(key) for key in ("nmse_second_half_mean", "nmse_second_half_worst",
                                        "horizon_10ms_nmse_second_half_worst",
                                        "coverage_second_half", "unseen_worst",
                                        "microseconds_per_update"))]
        )  # fmt: skip
    columns = (
        *("mount", "candidate", "weights", "one in", "NMSE mean", "NMSE worst", "10 ms ahead"),
        *("in the 95 % interval", "unseen, worst", "update [µs]"),
    )
    return Table(
        columns,
        rows,
        "Cubature filter, first start. Normalized mean square error over the second half, "
        "predicted before the sample was used; frozen weights on the worst unseen flight within "
        "the incidences learned.",
    )


def _unseen_table(metrics: Metrics, mount: str) -> Table:
    rows = [row for row in metrics["unsteady"]["learning"] if row["mount"] == mount]
    names = list(rows[0]["unseen"])
    return Table(
        ("candidate", "one in", *names),
        [
            [
                CANDIDATES[row["candidate"]].title,
                row["every"],
                *(row["unseen"][name]["worst"] for name in names),
            ]
            for row in rows
        ],
        f"{MOUNTS[mount].capitalize()}: worst normalized mean square error of a force over "
        "flights that were not learned, weights frozen.",
    )


def draw_unsteady(gallery: figures.Gallery, metrics: Metrics, runs: Sequence[UnsteadyRun]) -> None:
    """Forces true and learned, and scores of all candidates.

    Args:
        gallery: Where they go.
        metrics: Of the reproduction.
        runs: All trials.
    """
    for mount in MOUNTS:
        records = {
            run.trial.candidate: run.record
            for run in runs
            if run.trial.mount == mount and run.record is not None
        }
        beat = 1.0 / metrics["unsteady"]["flights"][mount]["learned"]["beat_frequency"]
        chosen = {CANDIDATES[key].title: records[key] for key in (MEMORY, PLAIN, "dense")}
        figures.force_figures(gallery, f"unsteady_{mount}", chosen, beat, _PARTS)
        _draw_unseen(gallery, metrics, mount)
    learning = metrics["unsteady"]["learning"]
    places = sorted({(row["mount"], row["every"]) for row in learning}, key=lambda p: (p[0], -p[1]))
    names = [
        f"{MOUNTS[mount]},\n" + ("every sample" if every == 1 else f"one in {every}")
        for mount, every in places
    ]
    scores = {
        candidate.title: [
            _one(learning, (mount, candidate.key, every), "nmse_second_half_worst")
            for mount, every in places
        ]
        for candidate in CANDIDATES.values()
    }
    gallery.add(
        "unsteady_scores",
        score_bars(names, scores),
        "Air with memory: worst force of the second half, by candidate, mount and rate of samples.",
    )


def _draw_unseen(gallery: figures.Gallery, metrics: Metrics, mount: str) -> None:
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
    gallery.add(
        f"unsteady_{mount}_unseen",
        score_bars(names, scores),
        f"Air with memory, {MOUNTS[mount]}: worst force on flights that were not learned, "
        f"weights frozen after one sample in {sparse}.",
    )


def _one(rows: Sequence[Mapping[str, Any]], place: tuple[str, str, int], key: str) -> float:
    for row in rows:
        if (row["mount"], row["candidate"], row["every"]) == place:
            return float(row.get(key, math.nan))
    return math.nan


_PARTS = ("body", "left_wing")
_INTRODUCTION = (
    "The flights above are flown through quasi-steady air: the force of the moment depends on "
    "the state of the moment. Real air remembers. Here the corrected robot flies through a "
    "lifting line with two lag states a strip, its wings carry the air's added mass, and it is "
    "held in two ways: not at all, and by a rigid stand in a wind. Networks see the state "
    "relative to the air and learn what circulation does; added mass is known inertia. Then the "
    "weights are frozen and tried on gaits, a speed and a gust that were not learned."
)

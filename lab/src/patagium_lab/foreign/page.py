"""Page of the study of foreign air: limits first, then every air, flight by flight."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from patagium.report import Block, Note, PageSection, Picture, Table, cell_text, picture
from patagium_lab.comparisons import score_points
from patagium_lab.foreign.contestants import CONTESTANTS, DEFAULT
from patagium_lab.foreign.figures import (
    COVERED,
    HALVES,
    HELD,
    LIMITS,
    best_rows,
    figures,
    held_rows,
    marked,
)
from patagium_lab.foreign.flights import DURATION, GAITS, STEP
from patagium_lab.foreign.near import NEAR, near_section, near_targets
from patagium_lab.foreign.subjects import DRAG, FREE, LATTICE, MOUNTED, TITLES
from patagium_lab.foreign.trials import BEST, PHYSICS, REFITTED, SEARCH
from patagium_lab.foreign.vortex_lattice import BEATS, PANELS, STEPS
from patagium_lab.study import Columns, Metrics, Page, Results, Row, table_of
from patagium_lab.targets import row_verdict

TITLE = "Foreign air"
SUMMARY = (
    "Other programs make the air: MuJoCo's fluid and PteraSoftware's vortex lattice. Each "
    "contestant learns a flight sample by sample, each predicted before it is used, and is then "
    "scored on other wingbeats of the same robot with its weights frozen."
)
FACTOR = 3.0
"""Largest error of the default over that of searched settings."""
GLANCE = "Unseen wingbeats at a glance"
RESULTS = ("Targets", GLANCE, NEAR, *TITLES.values(), "What was kept apart", "How it is scored")
"""Titles of the sections, but for those of the measured sets."""
RIVALS = (HELD, PHYSICS, "linear", "features")
"""Contestants that the default learner must beat on unseen gaits."""
_TITLES = {
    HELD: "held sample",
    PHYSICS: "physics alone",
    SEARCH: "pick of a search",
    BEST: "best trial of the search on the scored half",
    **{name: one.title for name, one in CONTESTANTS.items()},
}
_MADE = {
    MOUNTED: "The body is carried forward at a steady speed and pitch, the joints follow sines. "
    "The force is MuJoCo's `qfrc_fluid` at each q and v: drag, Kutta lift, Magnus force and "
    "angular drag of an ellipsoid for each strip, and of its added mass the products of "
    "velocities. MuJoCo leaves out the force that goes with acceleration, and so does this truth. "
    "Bodies without strips have no air.",
    FREE: "MuJoCo integrates the flight (Runge-Kutta, 0.1 ms) while torques drive the joints along "
    "their sines. Nobody steers: many flights end in a fall, and a record ends at a pitch of 1.2 "
    "rad, 15 m/s or 400 rad/s.",
    DRAG: "The same flights, but bodies without strips have MuJoCo's drag of a box of the same "
    "inertia, which no strip explains.",
    LATTICE: f"A flat trapezium on a hinge, {PANELS[0]} by {PANELS[1]} panels, {STEPS} steps a "
    f"wingbeat, {BEATS} wingbeats of which the first is left out, wake of constant shape. It has "
    "added mass and the wake's memory, and no viscosity, stall or leading-edge vortex. Its "
    "velocities are backward differences, which lag by half a step, so each force is ascribed to "
    "half a step before its own time; its added mass, a second difference, still lags by up to "
    "half a step. On two wingbeats flown with steps half as long, the forces and the flapping "
    "moment differ by .02 to .35 % of their variance, the feathering moment by 6 to 11 %: the "
    "truth is that of this step. Splines give samples 1 ms apart.",
}


def page(results: Results) -> Page:
    """Whole page of the study.

    Args:
        results: Results of `run`.
    """
    metrics = results.metrics
    rows = [*metrics["rows"], *held_rows(metrics["rows"]), *best_rows(metrics["rows"])]
    near = [*metrics["near"], *held_rows(metrics["near"])]
    airs = [air for air in TITLES if any(row["air"] == air for row in rows)]
    targets = [*target_rows(rows), *near_targets(near)]
    sections = [
        PageSection("Targets", [_targets_note(rows, targets), _targets(targets)]),
        PageSection(GLANCE, [_glance(rows, airs)]),
        *([near_section(near, rows)] if near else []),
        *(_air(air, [row for row in rows if row["air"] == air]) for air in airs),
        *results.sections,
        PageSection("What was kept apart", _split(metrics)),
        PageSection("How it is scored", [Note(text) for text in _notes(metrics, rows)]),
    ]
    facts = {"made by": "`patagium study foreign`", **metrics["environment"]}
    return Page(TITLE, f"{SUMMARY} {_found(rows)}", facts, sections)


def target_rows(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Rows of the targets of the contestant that `shown` names; the worst flight counts.

    Args:
        rows: Rows of `run_trial` and `held_rows`.
    """
    name, found = shown(rows), []
    for air in TITLES:
        own = [row for row in rows if row["air"] == air and row["contestant"] == name]
        for half, limit, covered in zip(HALVES, LIMITS[air], COVERED, strict=True):
            if not own:
                continue
            errors = figures(own, half, "worst")
            shares = figures(own, half, "coverage")
            beyond = np.maximum(covered[0] - shares, shares - covered[1])
            inside = beyond <= 0
            found += [
                _target(f"{TITLES[air]}: {half}, worst output", f"at most {limit:g}", errors,
                        errors <= limit, float(np.max(errors))),
                _target(f"{TITLES[air]}: {half}, coverage", f"{covered[0]:g} to {covered[1]:g}",
                        shares, inside, float(shares[np.argmax(beyond)])),
            ]  # fmt: skip
        better = _better(rows, air, name)
        found += [better] if better else []
    return [*found, *(one for rival in (SEARCH, BEST) if (one := _near_best(rows, name, rival)))]


def shown(rows: Sequence[Row]) -> str:
    """Contestant that the targets are held against: the default, or the best on unseen gaits.

    Args:
        rows: Rows of `run_trial`.
    """
    names = sorted({row["contestant"] for row in rows} - {HELD, PHYSICS, SEARCH, BEST})
    if DEFAULT in names:
        return DEFAULT
    own = {name: [row for row in rows if row["contestant"] == name] for name in names}
    medians = {name: float(np.median(figures(own[name], "unseen", "worst"))) for name in names}
    return str(min(medians, key=medians.__getitem__))


def _target(name: str, limit: str, found: Any, met: Any, worst: float) -> dict[str, Any]:
    return {
        "target": name,
        "limit": limit,
        "found": worst,
        "median": float(np.median(found)),
        "flights": f"{int(np.sum(met))} of {len(met)}",
        "met": bool(np.all(met)),
    }


def _better(rows: Sequence[Row], air: str, name: str) -> dict[str, Any] | None:
    """Target: on unseen gaits better than all rivals that know no network, on every flight."""
    ratios: list[float] = []
    for row in rows:
        if row["air"] == air and _is(row, name):
            rivals = [one for one in rows if one["contestant"] in RIVALS and _same(one, row)]
            best = [figures([one], "unseen", "worst") for one in rivals]
            ratios += (figures([row], "unseen", "worst") / np.min(best, axis=0)).tolist()
    if not ratios:
        return None
    title = f"{TITLES[air]}: unseen, over the best of held sample, physics and least squares"
    return _target(title, "at most 1", np.array(ratios), np.array(ratios) <= 1, max(ratios))


def _near_best(rows: Sequence[Row], name: str, rival: str) -> dict[str, Any] | None:
    """Target: on every flight that was learned, within `FACTOR` times of a search's settings."""
    own = {_flight(row): row for row in rows if _is(row, rival)}
    pairs = [(row, own[_flight(row)]) for row in rows if _is(row, name) and _flight(row) in own]
    if not pairs:
        return None
    known = [figures(side, "known", "worst") for side in zip(*pairs, strict=True)]
    ratios = known[0] / known[1]
    title = f"all air: known, worst output, over that of the {_title(rival)}"
    return _target(title, f"at most {FACTOR:g}", ratios, ratios <= FACTOR, float(np.max(ratios)))


def _flight(row: Row) -> tuple[Any, ...]:
    return tuple(row[key] for key in ("air", "robot", "gait", "apart"))


def _same(one: Row, other: Row) -> bool:
    return _flight(one) == _flight(other)


def _targets_note(rows: Sequence[Row], targets: Sequence[Row]) -> str:
    name, met = shown(rows), sum(bool(row["met"]) for row in targets)
    why = "" if name == DEFAULT else ", the best of all on unseen gaits"
    return (
        f"**{met} of {len(targets)} targets are met** by the {_title(name)}{why}. A target is met "
        "if it is met on every flight."
    )


def _targets(rows: Sequence[Row]) -> Table:
    columns: Columns = {
        "target": "target",
        "limit": "limit",
        "worst flight": "found",
        "median flight": "median",
        "flights that meet it": "flights",
        "met": row_verdict,
    }
    return table_of(columns, rows, "Errors are mean squares over the variance of the output [1].")


def _glance(rows: Sequence[Row], airs: Sequence[str]) -> Picture:
    """Figure of the median error of every contestant on unseen wingbeats, by air."""
    names = [name for name in _names(rows) if name not in (SEARCH, BEST)]
    scores = {}
    for air in airs:
        own = [[row for row in rows if row["air"] == air and _is(row, name)] for name in names]
        each = [figures(some, "unseen", "worst") for some in own]
        medians = np.array([np.median(one) if len(one) else np.nan for one in each])
        scores[TITLES[air]] = np.where(np.isfinite(medians), medians, np.nan)
    figure = score_points([_title(name) for name in names], scores)
    caption = "Error of the worst output on wingbeats that were never seen, median over flights."
    return picture(figure, caption)


def _names(rows: Sequence[Row]) -> list[str]:
    """Contestants that have rows, in the order of the page."""
    names = (HELD, PHYSICS, *CONTESTANTS, SEARCH, BEST)
    return [name for name in names if any(_is(row, name) for row in rows)]


def _air(air: str, rows: Sequence[Row]) -> PageSection:
    names = _names(rows)
    blocks: list[Block] = [_MADE[air]]
    for apart, where in ((False, "for choosing"), (True, "kept apart")):
        side = [row for row in rows if row["apart"] is apart]
        if side:
            blocks.append(_summary_table(air, side, where))
    for half in HALVES:
        blocks.append(_flight_table(air, rows, names, half))
    return PageSection(TITLES[air], blocks)


def _summary_table(air: str, rows: Sequence[Row], where: str) -> Table:
    def figure(half: str, key: str, pick: Callable[[Any], Any]) -> Callable[[Row], str]:
        def cell(row: Row) -> str:
            own = figures([one for one in rows if _is(one, row["name"])], half, key)
            value = float(pick(own))
            return marked(value, air, half, key)

        return cell

    columns: dict[str, Any] = {"contestant": lambda row: _title(row["name"])}
    for half in HALVES:
        columns[f"{half}: worst output, median flight"] = figure(half, "worst", np.median)
        columns[f"{half}: worst output, worst flight"] = figure(half, "worst", np.max)
        columns[f"{half}: mean of outputs, median flight"] = figure(half, "mean", np.median)
        columns[f"{half}: coverage, median flight"] = figure(half, "coverage", np.median)
    caption = (
        f"Flights {where}: errors over variances [1], share in the 95 % interval [1]; a star marks "
        "a miss."
    )
    return table_of(columns, [{"name": name} for name in _names(rows)], caption)


def _flight_table(air: str, rows: Sequence[Row], names: Sequence[str], half: str) -> Table:
    keys = sorted({(row["robot"], row["gait"], row["apart"]) for row in rows})
    flights = [{"robot": robot, "gait": gait, "apart": apart} for robot, gait, apart in keys]

    def figure(name: str) -> Callable[[Row], str]:
        def cell(flight: Row) -> str:
            own = [row for row in rows if _is(row, name) and flight.items() <= row.items()]
            found = figures(own, half, "worst")
            return marked(float(np.max(found)), air, half, "worst") if len(found) else "–"

        return cell

    columns: dict[str, Any] = {
        "robot": "robot",
        "gait learned": "gait",
        "side": lambda row: "kept apart" if row["apart"] else "for choosing",
        **{_title(name): figure(name) for name in names},
    }
    what = "second half" if half == "known" else "the worst of the unseen flights"
    return table_of(columns, flights, f"Worst output, {half} ({what}), flight by flight [1].")


def _is(row: Row, name: str) -> bool:
    return bool(row["contestant"] == name)


def _title(name: str) -> str:
    return _TITLES.get(name, name)


def _found(rows: Sequence[Row]) -> str:
    name = shown(rows)
    own = [row for row in rows if _is(row, name)]
    known, unseen = (float(np.median(figures(own, half, "worst"))) for half in HALVES)
    return (
        f"Over {len(own)} flights the worst output of the {_title(name)} errs by "
        f"{cell_text(known)} of its variance in the median, and by {cell_text(unseen)} on "
        "wingbeats never seen."
    )


def _split(metrics: Metrics) -> list[Block]:
    split: Mapping[str, Mapping[str, Sequence[int]]] = metrics["split"]
    lines = [
        {"air": TITLES[air], "robot": robot, "gaits": ", ".join(map(str, gaits))}
        for air, robots in split.items()
        for robot, gaits in robots.items()
    ]
    columns: Columns = {"air": "air", "robot": "robot", "gaits kept apart": "gaits"}
    text = (
        f"{GAITS} wingbeats of each robot, numbered from 0, are drawn from a Latin hypercube over "
        "frequency, speed, body pitch, and amplitude, phase and mean of each joint. The seed "
        f"{metrics['plan']['seed']} alone says which are kept apart: settings may be chosen on the "
        "others, and on none of these. A robot with all its gaits in the list is kept apart as a "
        "whole."
    )
    absent = metrics["absent"]
    more = [Note(f"{absent} flights were left out: their program is not installed.")]
    return [text, *(more if absent else []), table_of(columns, lines, "Gaits kept apart.")]


def _notes(metrics: Metrics, rows: Sequence[Row]) -> list[str]:
    left = [one.title for name, one in CONTESTANTS.items() if name not in _names(rows)]
    return [
        *([f"Left out of this run: {', '.join(left)}."] if left else []),
        f"One sample in {metrics['plan']['every']}, {1000 * STEP:g} ms apart, is used; flights by "
        f"MuJoCo last up to {DURATION:g} s, those of the lattice {BEATS - 1} wingbeats.",
        "Known: the second half of the learned flight, each sample predicted before it may be "
        "used. Unseen: other wingbeats of the same robot and side of the split, weights frozen. "
        "The held sample has the last used sample of the flight that is scored.",
        "No contestant is given a setting: noise, prior and scales are what a learner finds "
        "itself (docs/settings.md). Networks learn by the extended filter. The first wingbeat "
        "scales inputs and outputs of the dense network and of least squares.",
        *_search_notes(metrics, rows),
        "Physics alone: blade elements and added mass by theory, nothing learned.",
        "The force is what inverse dynamics gives, without noise of sensors: added mass and "
        "everything else that the other program lets the air do.",
    ]


def _search_notes(metrics: Metrics, rows: Sequence[Row]) -> list[str]:
    trials = metrics["plan"]["search"]
    searched, learned = (sum(_is(row, name) for row in rows) for name in (SEARCH, PHYSICS))
    if not searched:
        return []
    return [
        "Pick of a search: `patagium tune` of the default network by the extended filter, "
        f"{trials} trials on each of {searched} of the {learned} learned flights, over the ranges "
        "of docs/settings.md (prior, memory, structure of the covariance). It picks by what it "
        "leaves out of the flight, without a second flight.",
        f"Best trial of the search on the scored half: of the {REFITTED} trials with the least "
        "mean error on the second half itself, the one with the least error of the worst output "
        "there. Nobody can know it beforehand.",
    ]

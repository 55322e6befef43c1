"""Page of the study of a lost wing: what came back, what it cost, and what did no harm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binomtest

from patagium.report import Note, PageSection
from patagium.report.style import COLORS, panels, styled
from patagium_lab.damage.plan import (
    COMMANDS,
    ENCODERS,
    KNOWN,
    LEARNING,
    LOST,
    MARGIN,
    MASSES,
    OFF,
    SCALES,
)
from patagium_lab.study import Columns, Page, Results, Row, table_of

BEATS = 10
"""Beats within which a flight has to be back."""
TITLE = "A wing lost in flight"
_DAMAGED = {"sensed": ", sensors and tracker", "damage": ""}
_STYLES = {
    OFF: COLORS[0],
    LEARNING: COLORS[1],
    KNOWN: COLORS[2],
}


def page(results: Results) -> Page:
    """Page of the results.

    Args:
        results: Results of `run`.
    """
    metrics = results.metrics
    rows = metrics["rows"]
    groups = {key: _of(rows, *key) for key in dict.fromkeys(map(_key, rows))}
    damage = [_damage_row(key, own) for key, own in groups.items() if key[0] in _DAMAGED]
    if damage:
        results.gallery.add("damage", _drawn(rows), _CAPTION)
    sections = [
        PageSection("Targets", [table_of(_TARGETS, _targets(rows))]),
        PageSection(
            "Back on its orbit",
            [table_of(_DAMAGE, damage, _ERROR), *results.gallery.pictures("damage")],
        ),
        PageSection("Without damage", [table_of(_PAIRS, _pairs(rows), _PAIR)]),
        PageSection("Authority", [table_of(_AUTHORITY, metrics["authority"], _ROOM)]),
        PageSection("How it is flown", [Note(text) for text in _notes(metrics)]),
    ]
    facts = {"made by": "`patagium study damage`", **metrics["environment"]}
    return Page(TITLE, _summary(groups, metrics), facts, sections)


_TARGETS = {"target": "target", "limit": "limit", "found": "found", "met": "met"}


def _targets(rows: Sequence[Row]) -> list[dict[str, str]]:
    """Rows of the targets; a limit from above is written negative."""
    flown = []
    for group, words in _DAMAGED.items():
        on, off = (_of(rows, group, "linear", one, 0.0) for one in (LEARNING, OFF))
        shares = ([100 * np.mean([_back(row) for row in own])] if own else [] for own in (on, off))
        back, away = shares
        flown += [
            (f"learning{words}: back within {BEATS} beats [%]", 95.0, back),
            (
                f"no learning{words}: not back within {BEATS} beats [%]",
                90.0,
                [100 - one for one in away],
            ),
        ]
    undamaged = [row["largest"] for row in _pairs(rows) if row["gust"] == 0]
    lost = [sum(row["lost"] for row in rows if row["group"] == "no harm")] if undamaged else []
    asked = [
        *flown,
        ("undamaged: error with learning over that without, every pair [1]", -1.05, undamaged),
        ("undamaged: lost", -0.0, lost),
    ]
    return [
        {
            "target": name,
            "limit": f"at least {limit:g}" if limit > 0 else f"at most {-limit:g}",
            "found": f"{found[0]:.3g}",
            "met": "yes" if found[0] >= limit > 0 or found[0] <= -limit else "**no**",
        }
        for name, limit, found in asked
        if found
    ]


def _back(row: Row) -> bool:
    return row["back"] is not None and row["back"] <= BEATS


def _key(row: Row) -> tuple[str, str, str, float]:
    return row["group"], row["law"], row["learner"], row["gust"]


def _of(rows: Sequence[Row], *key: Any) -> list[Row]:
    return [row for row in rows if _key(row) == key]


def share(rows: Sequence[Row]) -> str:
    """Share of flights that are back within `BEATS`, in %, with its 95 % interval (Wilson).

    Args:
        rows: Flights.
    """
    return _share([_back(row) for row in rows])


def _share(found: Sequence[bool]) -> str:
    interval = binomtest(sum(found), len(found)).proportion_ci(method="wilson")
    low, high = (round(100 * one) for one in (interval.low, interval.high))
    return f"{100 * np.mean(found):.0f} ({low} to {high})"


def _damage_row(key: tuple[str, str, str, float], rows: Sequence[Row]) -> dict[str, Any]:
    """Figures of the flights of one controller."""

    def median(name: str) -> float:
        return float(np.median([row[name] for row in rows]))

    return {
        "controller": f"{key[1]}, {key[2]}{_DAMAGED[key[0]]}",
        "flights": len(rows),
        "back": share(rows),
        "ever": _share([row["back"] is not None for row in rows]),
        "lost": sum(row["lost"] for row in rows),
        "former": median("former"),
        "end": median("end"),
        "worst end": max(row["end"] for row in rows),
        "worst": median("worst"),
        "effort": median("effort"),
        "power": f"{median('power_before'):.3g}, {median('power_after'):.3g}",
    }


_DAMAGE = {
    "controller, learner": "controller",
    "flights": "flights",
    f"back within {BEATS} beats [%] (95 %)": "back",
    "back at all [%] (95 %)": "ever",
    "lost": "lost",
    "error before, median [1]": "former",
    "error at the end, median [1]": "end",
    "worst flight [1]": "worst end",
    "worst beat, median [1]": "worst",
    "effort [1]": "effort",
    "power before, after [W]": "power",
}
_ERROR = (
    "Error: root mean square over "
    + ", ".join(f"{name} / {size:g}" for name, size in SCALES.items())
    + " of the means of beats [m, rad, m/s]; before: the last ten beats before the loss; at the "
    f"end: the last ten of the flight. Back: over five beats within {MARGIN:g} times its own error "
    "before. Lost: beyond "
    + ", ".join(f"{name} {size:g}" for name, size in LOST.items())
    + ". Effort: standard deviation of the commands after the loss over half their ranges."
)
_CAPTION = (
    "Error of the mean of each beat: median of the flights, and from the tenth to the ninetieth "
    "percentile; states measured with white noise. The wing is lost in beat 0."
)


@styled
def _drawn(rows: Sequence[Row]) -> Figure:
    """Errors over the beats, with learning and without."""
    drawn, grid = panels(1)
    axes = grid.flat[0]
    for learner, color in _STYLES.items():
        own = _of(rows, "damage", "linear", learner, 0.0)
        count = min((len(row["error"]) for row in own), default=0)
        if not count:
            continue
        errors = np.array([row["error"][:count] for row in own])
        beats = np.arange(count) - own[0]["before"]
        low, middle, high = np.percentile(errors, [10, 50, 90], axis=0)
        axes.fill_between(beats, low, high, color=color, alpha=0.2, linewidth=0)
        axes.plot(
            beats, middle, color=color, label=f"learning {learner}" if learner == OFF else learner
        )
    axes.set(xlabel="beat after the loss", ylabel="error [1]", ylim=(0, None))
    axes.legend()
    return drawn


def _pairs(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Errors with learning over those without, of the same seeds, undamaged."""
    found = []
    for group, gust in dict.fromkeys((row["group"], row["gust"]) for row in rows):
        if group in _DAMAGED:
            continue
        errors = {}
        for learner in (LEARNING, OFF):
            own = _of(rows, group, "linear", learner, gust)
            errors[learner] = {row["seed"]: np.array(row["error"])[BEATS:] for row in own}
        seeds = sorted(set(errors[LEARNING]) & set(errors[OFF]))
        if not seeds:
            continue
        on, off = (
            np.array([np.sqrt(np.mean(errors[one][seed] ** 2)) for seed in seeds])
            for one in (LEARNING, OFF)
        )
        lost = [row["lost"] for row in rows if (row["group"], row["gust"]) == (group, gust)]
        found.append(
            {
                "gust": gust,
                "beats": own[0]["before"] + own[0]["after"],
                "flights": len(seeds),
                "off": float(np.median(off)),
                "on": float(np.median(on)),
                "ratio": float(np.median(on / off)),
                "largest": float((on / off).max()),
                "lost": sum(lost),
            }
        )
    return found


_PAIRS = {
    "turbulence, standard deviation [m/s]": "gust",
    "beats of a flight": "beats",
    "pairs of flights": "flights",
    "error without learning, median [1]": "off",
    "with learning [1]": "on",
    "ratio, median [1]": "ratio",
    "largest ratio [1]": "largest",
    "lost, of all": "lost",
}
_PAIR = (
    "Dryden turbulence of length scale 5 m; both flights of a pair have the same seed. Errors from "
    "the tenth beat on."
)
_AUTHORITY: Columns = {
    "share of the left wing lost [1]": "share",
    "trim found": lambda row: "yes" if row["found"] else "no",
    "least room of a command, over that without loss [1]": "room",
    "roll [rad]": "roll",
    "sideways [m/s]": "velocity of y",
}
_ROOM = (
    "Trims of the cut robot in the air of the truth, by the commands "
    + ", ".join(f"`{name}`" for name in COMMANDS)
    + ": how far the command that is nearest to its limit is from it."
)


def _summary(groups: Mapping[tuple[str, str, str, float], Sequence[Row]], metrics: Row) -> str:
    """Findings in a few sentences."""
    parts = [
        f"An Aerobat that loses {metrics['share']:.0%} of the span of one wing at any phase of a "
        "beat, with the linear regulator:"
    ]
    flown = [
        (group, learner, f"{way} learning{words}")
        for group, words in _DAMAGED.items()
        for learner, way in ((OFF, "without"), (LEARNING, "with"))
    ]
    for group, learner, words in flown:
        own = groups.get((group, "linear", learner, 0.0), [])
        if own:
            parts.append(
                f"{words}, {share(own)} % of {len(own)} flights are back within {BEATS} beats, and "
                f"{sum(row['lost'] for row in own)} are lost;"
            )
    return " ".join(parts).rstrip(";") + "."


def _notes(metrics: Row) -> list[str]:
    """Settings of the flights, in sentences."""
    return [
        "Model: the Aerobat with quasi-steady air of a smooth polar. Truth: the published polar, "
        f"masses and inertias off by {MASSES:.0%}, states measured with noise of 1 mm, 5 mrad, "
        "0.02 m/s and 0.02 rad/s, without a filter. Sensors and tracker: an inertial unit of 1 kHz "
        "and +-30 g, cameras of 240 Hz that are 4.2 ms late, encoders of "
        f"{ENCODERS:g} Hz, with noise, biases and steps, and `TrackedState` behind them.",
        f"Seeds from {metrics['seed']} on, which chose nothing: 0 to 7, 20 to 29, 100 to 146 and "
        "200 to 239 did. "
        "Side and time of the loss follow from the seed.",
        "'Loss known': the controller is given the cut robot as its model in the interval of the "
        "loss. 'Frozen': nothing is learned from the loss on. 'Forgetting only': the controller "
        "does not look for a lost wing tip; it learns from every beat, and older beats count less. "
        "'Gradient learner': one step of gradient descent per beat, of size 1 over the largest "
        "eigenvalue of the Hessian, in place of least squares; it does look for a lost wing tip.",
    ]

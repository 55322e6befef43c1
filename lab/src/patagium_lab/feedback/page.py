"""Page of the study of feedback: delays and rates that are borne, starts that are recovered."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binomtest

from patagium.report import Note, PageSection
from patagium.report.style import color, dash, panels, styled
from patagium_lab.feedback.plan import (
    AVERAGED,
    IN_FLIGHT,
    MASSES,
    OUTSIDE,
    PARTS,
    PERIODIC,
    PREDICTIVE,
    PUSHED,
    RECOVERED,
    STARTS,
)
from patagium_lab.study import Columns, Page, Results, Row, table_of

TITLE = "Feedback: delay, rate and region of attraction"
_KINDS = (PREDICTIVE, PERIODIC, AVERAGED)
_CLAIMS = ((PREDICTIVE, PERIODIC), (PERIODIC, AVERAGED))
_BINS = 5


def page(results: Results) -> Page:
    """Page of the results.

    Args:
        results: Results of `run`.
    """
    metrics = results.metrics
    margins, regions = metrics["margins"], [_shared(row) for row in metrics["regions"]]
    if regions:
        results.gallery.add("region", _drawn(regions), _CAPTION)
    sections = [
        PageSection("Delay and rate", [table_of(_MARGINS, margins, _margin_words(metrics))]),
        PageSection(
            "Region of attraction",
            [
                table_of(_REGIONS, regions, _region_words(metrics)),
                table_of(_ORDER, _orders(regions), _PAIRS),
                *results.gallery.pictures("region"),
            ],
        ),
        PageSection("How it is flown", [Note(text) for text in _NOTES]),
    ]
    facts = {"made by": "`patagium study feedback`", **metrics["environment"]}
    return Page(TITLE, _summary(margins, regions), facts, sections)


def interval(recovered: Sequence[bool]) -> tuple[float, float, float]:
    """Share of starts that are recovered, and its 95 % interval (Wilson) [%].

    Args:
        recovered: Whether each is.
    """
    found = binomtest(sum(recovered), len(recovered)).proportion_ci(method="wilson")
    return 100 * float(np.mean(recovered)), 100 * float(found.low), 100 * float(found.high)


def _shared(row: Row) -> dict[str, Any]:
    """Row of a region with its share."""
    share, low, high = interval(row["recovered"])
    return dict(row) | {"share": share, "interval": f"{low:.0f} to {high:.0f}"}


def _orders(regions: Sequence[Row]) -> list[dict[str, Any]]:
    """Comparisons of controllers on the same starts."""
    rows = []
    for robot in dict.fromkeys(row["robot"] for row in regions):
        found = {row["controller"]: np.array(row["recovered"])
                 for row in regions if row["robot"] == robot}  # fmt: skip
        for better, worse in _CLAIMS:
            shared = min(len(found[better]), len(found[worse]))
            first, second = found[better][:shared], found[worse][:shared]
            more, less = int((first & ~second).sum()), int((second & ~first).sum())
            chance = binomtest(more, max(more + less, 1)).pvalue if more + less else 1.0
            said = "yes" if more >= less else "**no**"
            rows.append(
                {"robot": robot, "claim": f"{better} recovers at least as many as {worse}"}
                | {"more": more, "less": less, "chance": float(chance), "holds": said}
            )
    return rows


def _delay(row: Row) -> str:
    if row["delay"] is None:
        return "none"
    more = " or more" if row["delay_longest"] else ""
    return f"{row['delay']:.3g} ({1e3 * row['delay'] * row['beat']:.3g} ms){more}"


def _rate(row: Row) -> str:
    if row["interval"] is None:
        return f"none up to {PARTS} a beat"
    less = " or less" if row["interval_longest"] else ""
    return f"{1 / row['interval']:.3g} ({1 / (row['interval'] * row['beat']):.3g} Hz){less}"


_MARGINS: Columns = {
    "robot": "robot",
    "beat [ms]": lambda row: 1e3 * row["beat"],
    "without feedback doubles in [beats]": lambda row: row["doubling"] or "stable",
    "controller": "controller",
    "largest delay [beats]": _delay,
    "slowest rate [commands a beat]": _rate,
}
_REGIONS: Columns = {
    "robot": "robot",
    "controller": "controller",
    "starts": lambda row: len(row["recovered"]),
    "recovered [%]": "share",
    "95 % [%]": "interval",
    "left the region": "lost",
    "largest multiplier under feedback": lambda row: row["largest_multiplier"] or "",
}
_ORDER: Columns = {
    "robot": "robot",
    "claim": "claim",
    "starts that only the first recovers": "more",
    "only the second": "less",
    "chance of that if both were equal": "chance",
    "holds": "holds",
}
_PAIRS = (
    "Of the starts that both fly; sign test of those that one of two recovers. Near the edge "
    "chance has a say: noise is not the same in both."
)


def _listed(sizes: Any) -> str:
    return ", ".join(f"{name} {size:g}" for name, size in sizes.items())


def _margin_words(metrics: Row) -> str:
    first, count = metrics["seed"], metrics["flights"]
    return (
        f"Largest delay from sample to command, at {PARTS} commands a beat, and slowest rate "
        f"without a delay, at which all of {count} flights of {metrics['beats']} beats (seeds "
        f"{first} to {first + count - 1}) stay in flight, as they do at every smaller delay and "
        "every faster rate that was tried. The controller does not know of the delay; it is made "
        f"anew for each rate down to one command a beat. Start: standard deviations "
        f"{_listed(PUSHED)}. In flight: within {_listed(IN_FLIGHT)} [m, rad, m/s]. 'Or more': the "
        "end of what was tried."
    )


def _region_words(metrics: Row) -> str:
    return (
        f"Starts off the orbit by up to {_listed(STARTS)} [m, rad, m/s, rad/s] times a size that "
        f"is even from 0 to 1, seed {metrics['seed']}. Recovered: after {metrics['beats']} beats "
        f"within {_listed(RECOVERED)}, and at no beat beyond {_listed(OUTSIDE)}."
    )


_CAPTION = (
    "Share of starts that are recovered over the size of the start, with 95 % intervals (Wilson)."
)


@styled
def _drawn(regions: Sequence[Row]) -> Figure:
    """Shares over the size of the start, a panel for each robot."""
    robots = list(dict.fromkeys(row["robot"] for row in regions))
    drawn, grid = panels(len(robots))
    for axes, robot in zip(grid.flat, robots, strict=True):
        for i, kind in enumerate(_KINDS):
            row = next(r for r in regions if (r["robot"], r["controller"]) == (robot, kind))
            sizes, recovered = np.array(row["sizes"]), np.array(row["recovered"])
            places = np.minimum((sizes * _BINS).astype(int), _BINS - 1)
            shown = [k for k in range(_BINS) if (places == k).any()]
            share, low, high = np.array([interval(list(recovered[places == k])) for k in shown]).T
            at = (np.array(shown) + 0.5 + 0.1 * (i - 1)) / _BINS
            errors = np.maximum([share - low, high - share], 0.0)
            style = {"color": color(i), "linestyle": dash(i), "marker": "o", "capsize": 2}
            axes.errorbar(at, share, yerr=errors, label=kind, **style)
        axes.set(title=robot, ylabel="recovered [%]", ylim=(-2, 102))
    grid.flat[-1].set_xlabel("size of the start [1]")
    grid.flat[0].legend()
    return drawn


def _summary(margins: Sequence[Row], regions: Sequence[Row]) -> str:
    """Findings in a few sentences."""
    parts = []
    for row in margins:
        delay = "no delay" if not row["delay"] else f"a delay of up to {row['delay']:.3g} beats"
        parts.append(f"{row['robot']}, {row['controller']}: it bears {delay}.")
    for row in regions:
        share = f"{row['share']:.0f} % ({row['interval']})"
        parts.append(f"{row['robot']}, {row['controller']}: {share} of the starts are recovered.")
    return " ".join(parts)


_NOTES = (
    f"Model: the preset with quasi-steady air of a smooth polar. Truth: the published polar, "
    f"masses and inertias off by {MASSES:.0%}, noise of the measured state; no estimator. The "
    "dragonfly hovers; its preset has no actuators, and here amplitude and mean feathering of each "
    "of its four wings are commanded, with response times of 0.1 s.",
    "Flights are flown side by side by the compiled equations of `patagium.simulate`; a test "
    "compares them with `patagium.fly`.",
    "All controllers have the default costs. Their settings were chosen with seeds below 1000.",
)

"""Section of the page on wingbeats near the learned one: error and coverage against distance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from patagium.report import Block, PageSection, Table, cell_text
from patagium_lab.foreign.contestants import DEFAULT
from patagium_lab.foreign.figures import HELD, LIMITS, figures, marked
from patagium_lab.foreign.flights import DISTANCES
from patagium_lab.foreign.subjects import TITLES
from patagium_lab.foreign.trials import PHYSICS
from patagium_lab.study import Columns, Row, table_of

NEAR = "Wingbeats near the learned one"
"""Title of the section."""
TARGET = 0.2
"""Distance up to which the limits of unseen wingbeats are a target."""
_TEXT = (
    "The wingbeats of the other sections are drawn anew over wide ranges. A laboratory's next "
    "flight is usually nearer, so these wingbeats lie around the learned one. In a direction that "
    "a seed draws, frequency, speed and amplitudes change by a share, phases by as many radians, "
    "the body pitch and the means of joints by that share of the largest amplitude; the number "
    "that changes most changes by the distance, up or down. All are near flights that are kept "
    "apart, and no setting was chosen on any of them. Weights are frozen."
)


def near_section(near: Sequence[Row], rows: Sequence[Row]) -> PageSection:
    """Section of the page.

    Args:
        near: Rows of wingbeats near the learned one, with those of the held sample.
        rows: Rows of wingbeats drawn anew.
    """
    airs = [air for air in TITLES if any(row["air"] == air for row in near)]
    blocks: list[Block] = [_TEXT, _summary(near, rows, airs), _flights(near, airs)]
    return PageSection(NEAR, blocks)


def near_targets(near: Sequence[Row]) -> list[dict[str, Any]]:
    """Rows of the targets: the limits of unseen wingbeats, held up to `TARGET`.

    Args:
        near: Rows of wingbeats near the learned one.
    """
    found = []
    for air in TITLES:
        own = [row for row in near if row["air"] == air and row["contestant"] == DEFAULT]
        parts = [at_distance(own, d, "worst") for d in DISTANCES if d <= TARGET]
        errors = np.concatenate(parts) if own else np.zeros(0)
        if len(errors):
            limit = LIMITS[air][1]
            found.append(
                {
                    "target": f"{TITLES[air]}: unseen within {100 * TARGET:.0f} %, worst output",
                    "limit": f"at most {limit:g}",
                    "found": float(errors.max()),
                    "median": float(np.median(errors)),
                    "flights": f"{int(np.sum(errors <= limit))} of {len(errors)}",
                    "met": bool(np.all(errors <= limit)),
                }
            )
    return found


def at_distance(rows: Sequence[Row], distance: float, key: str) -> Any:
    """A figure of every unseen flight at a distance, (k,).

    Args:
        rows: Rows of wingbeats near the learned one.
        distance: The distance [1].
        key: Such as "worst".
    """
    places = [one == distance for row in rows for one in row["distances"]]
    return figures(rows, "unseen", key)[np.array(places, bool)]


def _summary(near: Sequence[Row], rows: Sequence[Row], airs: Sequence[str]) -> Table:
    lines = []
    for air in airs:
        own = [row for row in near if row["air"] == air]
        learned = {(row["robot"], row["gait"]) for row in own}
        same = [r for r in rows if r["air"] == air and (r["robot"], r["gait"]) in learned]
        for distance in DISTANCES:
            figure = {
                (name, key): at_distance(_of(own, name), distance, key)
                for name in (HELD, PHYSICS, DEFAULT)
                for key in ("worst", "coverage")
            }
            lines.append(_line(air, f"{100 * distance:.0f} %", figure))
        drawn = {
            (name, key): figures(_of(same, name), "unseen", key)
            for name in (HELD, PHYSICS, DEFAULT)
            for key in ("worst", "coverage")
        }
        lines.append(_line(air, "drawn anew", drawn))
    columns: Columns = {key: key for key in lines[0]}
    caption = (
        "Flights near those kept apart: error of the worst output over its variance [1], share in "
        "the 95 % interval [1]; a star marks a miss."
    )
    return table_of(columns, lines, caption)


def _line(air: str, distance: str, figure: dict[tuple[str, str], Any]) -> dict[str, str]:
    errors, shares = figure[DEFAULT, "worst"], figure[DEFAULT, "coverage"]
    limit = LIMITS[air][1]

    def median(name: str) -> str:
        return marked(float(np.median(figure[name, "worst"])), air, "unseen", "worst")

    return {
        "air": TITLES[air],
        "distance": distance,
        "limit": cell_text(limit),
        "held sample, median flight": median(HELD),
        "physics alone, median flight": median(PHYSICS),
        "default, median flight": median(DEFAULT),
        "default, worst flight": marked(float(errors.max()), air, "unseen", "worst"),
        "default, flights within the limit": f"{int(np.sum(errors <= limit))} of {len(errors)}",
        "coverage, median flight": marked(float(np.median(shares)), air, "unseen", "coverage"),
        "coverage, least": marked(float(shares.min()), air, "unseen", "coverage"),
    }


def _flights(near: Sequence[Row], airs: Sequence[str]) -> Table:
    lines = []
    for air in airs:
        for row in _of([one for one in near if one["air"] == air], DEFAULT):
            line = {"air": TITLES[air], "robot": row["robot"], "gait learned": str(row["gait"])}
            known = float(figures([row], "known", "worst")[0])
            line["learned, second half"] = marked(known, air, "known", "worst")
            for distance in DISTANCES:
                worst = float(at_distance([row], distance, "worst").max())
                line[f"{100 * distance:.0f} %"] = marked(worst, air, "unseen", "worst")
            lines.append(line)
    columns: Columns = {key: key for key in lines[0]}
    caption = "Default, worst output [1], the worst direction, robot by robot."
    return table_of(columns, lines, caption)


def _of(rows: Sequence[Row], name: str) -> list[Row]:
    return [row for row in rows if row["contestant"] == name]

"""Page of the bench of times: targets, then every time with its ratio to the rival's.

Every figure on the page is that of a row. Neglected: spread; a row is a median.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from patagium.report import Block, PageSection, Table, cell_text, picture
from patagium.report.style import TRUTH, color, legend_above, panels, styled
from patagium_lab.bench.plan import GROUPS, OTHERS, PARTS
from patagium_lab.bench.run import CONDITIONS, TIME_TAKEN
from patagium_lab.bench.targets import figure_text, speed_targets
from patagium_lab.conditions import conditions
from patagium_lab.study import Columns, Page, table_of
from patagium_lab.targets import count_met, row_verdict

Row = dict[str, Any]
TITLE = "Times, ours and others'"
SUMMARY = (
    "The page gives the times of the compiled functions and of the learners, beside those of other "
    "programs that do the same on the same robot, the 14-coordinate Aerobat. A ratio is our time "
    "over theirs: below one we are faster."
)
METHOD = (
    "One run on one core. Equations: random states, a call a state, warmed up, medians over rounds "
    "of half a millisecond; compiled functions are called from C. Before a rival is timed its "
    "numbers are checked against ours; then both are timed in turns, so that a busy machine slows "
    "both. Like is compared with like: compiled with compiled, Python calls with Python calls. "
    "Times are those of this machine under its load; ratios of one run say more."
)
MARKERS = "os^DvPX*"


def page(rows: Sequence[Row]) -> Page:
    """Whole page of the bench; groups that were not run are named.

    Args:
        rows: Results of `run`.
    """
    loads = {row["name"]: row["note"] for row in rows if row["name"].startswith("load average")}
    facts = {"made by": "`patagium study bench`", **loads, **conditions()}
    parts = (
        (title, text, [row for row in rows if row["group"] in groups])
        for title, groups, text in PARTS
    )
    targets = speed_targets(rows)
    met = [PageSection("Targets", [count_met(targets), _targets(targets)])] if targets else []
    sections = [
        *met,
        PageSection("Where others are faster", [_faster(rows)]),
        *(_part(title, text, found) for title, text, found in parts if found),
        PageSection("How it was measured", [METHOD, *_conditions(rows)]),
    ]
    return Page(TITLE, SUMMARY, facts, sections)


def _targets(targets: Sequence[Row]) -> Table:
    columns: Columns = {
        "figure": "target",
        "target": "limit",
        "found": "found",
        "met": row_verdict,
    }
    return table_of(columns, targets, "The targets were set before anything was measured.")


def _faster(rows: Sequence[Row]) -> str:
    """Figures in which a rival is faster."""
    found = [
        f"{_words(row['name'])}: {row['against']}, {cell_text(row['ratio'])} times"
        for row in rows
        if row["group"] in OTHERS and row["ratio"] and row["ratio"] > 1.0
    ]
    return f"Our time over theirs: {'; '.join(found)}." if found else "In none of these rows."


def _part(title: str, text: str, rows: Sequence[Row]) -> PageSection:
    columns: Columns = {
        "call": lambda row: _words(row["name"]),
        "time": lambda row: figure_text(row["value"], row["unit"]),
        "against": "against",
        "time of the other": lambda row: figure_text(row["against_value"], row["unit"]),
        "ratio [1]": "ratio",
        "note": "note",
    }
    table = table_of(columns, rows)
    compared = [row for row in rows if row["ratio"]]
    if not compared:
        return PageSection(title, [text, table])
    drawn = picture(ratio_dots(compared), "Our time over theirs; left of the line we are faster.")
    return PageSection(title, [text, drawn, table])


def _conditions(rows: Sequence[Row]) -> list[Block]:
    taken = [
        row for row in rows if row["group"] == CONDITIONS and row["name"].startswith(TIME_TAKEN)
    ]
    columns: Columns = {
        "group": lambda row: row["name"].removeprefix(TIME_TAKEN),
        "time": lambda row: figure_text(row["value"], row["unit"]),
    }
    table = table_of(columns, taken, "Time that each group of the bench took.")
    left = [name for name in GROUPS if not any(row["group"] == name for row in rows)]
    return [*([f"**Not run here:** {', '.join(left)}."] if left else []), table]


def _words(name: str) -> str:
    return name.replace("_", " ")


@styled
def ratio_dots(rows: Sequence[Row]) -> Figure:
    """Figure of the ratios to the rivals: a line for each time, a mark for each rival.

    Args:
        rows: Rows that have a ratio.
    """
    names = list(dict.fromkeys(_words(row["name"]) for row in rows))
    rivals = list(dict.fromkeys(row["against"] for row in rows))
    figure, axes = panels(1, 1, row_height=0.7 + 0.24 * len(names) + 0.1 * len(rivals))
    panel = axes[0, 0]
    for number, rival in enumerate(rivals):
        mine = [row for row in rows if row["against"] == rival]
        places = [names.index(_words(row["name"])) for row in mine]
        panel.plot(
            [row["ratio"] for row in mine], places, MARKERS[number % len(MARKERS)],
            color=color(number), label=rival,
        )  # fmt: skip
    panel.axvline(1.0, color=TRUTH, linewidth=0.9)
    panel.set_xscale("log")
    panel.set_yticks(range(len(names)), names)
    panel.set_ylim(len(names) - 0.5, -0.5)
    panel.set_xlabel("our time over theirs [1]")
    panel.margins(x=0.12)
    legend_above(figure, panel)
    return figure

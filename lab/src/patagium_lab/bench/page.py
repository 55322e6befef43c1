"""The page of the bench of times: targets, then what was timed, with the ratios to the rivals.

Every figure on it is a row's. Neglected: spread; a row is a median.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from patagium.report import PageSection, Table, cell_text, picture, write_page
from patagium.report.style import TRUTH, color, legend_above, panels, styled
from patagium_lab.bench.run import CONDITIONS, GROUPS
from patagium_lab.bench.targets import figure_text, speed_targets
from patagium_lab.conditions import conditions
from patagium_lab.targets import count_met, verdict

Row = dict[str, Any]
SUMMARY = (
    "How long the compiled functions and the learners take, beside other programs doing the same "
    "on the same robot, the 14-coordinate Aerobat. A ratio is our time over theirs: below one we "
    "are faster."
)
METHOD = (
    "One run on one core. Equations: random states, a call a state, warmed up, medians over rounds "
    "of half a millisecond; compiled functions are called from C. Before a rival is timed its "
    "numbers are checked against ours; then both are timed in turns, so that a busy machine slows "
    "both. Like is compared with like: compiled with compiled, Python calls with Python calls. "
    "Times are those of this machine under its load; ratios of one run say more."
)
MARKERS = "os^DvPX*"
OTHERS = ("energy", "published", "sympy", "sympy-without-cse", "symengine", "pinocchio", "mujoco",
          "python")  # fmt: skip
"""Groups whose rivals are another program or another way to the same numbers."""
PARTS: tuple[tuple[str, tuple[str, ...], str], ...] = (
    (
        "Equations of motion",
        ("dynamics", "batch"),
        "D, C v, G, their sums, inverse and forward dynamics; one state a call, and many states "
        "in one call.",
    ),
    (
        "Equations of motion, beside the energy form",
        ("energy", "published"),
        "Lagrange's equations by algorithmic differentiation of the energies: sharing "
        "subexpressions, and as the published experiment has it.",
    ),
    (
        "Equations of motion, beside symbolic algebra",
        ("sympy", "sympy-without-cse", "symengine"),
        "The same Lagrangian derived by SymPy and SymEngine, written as C and compiled alike, with "
        "and without shared subexpressions.",
    ),
    (
        "Equations of motion, beside other libraries",
        ("pinocchio", "mujoco"),
        "Pinocchio's C++ and MuJoCo's C on the same tree of bodies.",
    ),
    (
        "Equations of motion, called from Python",
        ("python",),
        "What a Python caller sees; most of it is the call itself.",
    ),
    (
        "Air and networks",
        ("aerodynamics", "air-models", "strips"),
        "The force of the air by its equations and by networks that learn it; every model of the "
        "air beside the quasi-steady one; the lifting line as strips grow in number.",
    ),
    (
        "Updates of a learner",
        ("update",),
        "One sample learned, beside the paper's Algorithm 1, beside the matrix products an update "
        "cannot do without, and beside the least arithmetic there is.",
    ),
    (
        "From packet to prediction",
        ("pipeline",),
        "A learner's whole work for a sample in one compiled call: packet, inverse dynamics, "
        "prediction with its covariance, update. At 10 kHz the response counts from when a packet "
        "was due.",
    ),
    ("A flight", ("simulation",), "Simulating free flight, everything recorded."),
    (
        "Compiling",
        ("compile",),
        "On an empty cache, everything included; from then on it is loaded in milliseconds.",
    ),
)
"""Title, groups of the bench, and what is compared."""


def write_benchmark(path: str | Path, rows: Sequence[Row]) -> Path:
    """Write the page.

    Args:
        path: File to write, Markdown or HTML.
        rows: Of `run_benchmark`.
    """
    loads = {row["name"]: row["note"] for row in rows if row["name"].startswith("load average")}
    facts = {"made by": "`patagium bench`", **loads, **conditions()}
    sections = benchmark_sections(rows)
    return write_page(path, "Times, ours and others'", sections, summary=SUMMARY, facts=facts)


def benchmark_sections(rows: Sequence[Row]) -> list[PageSection]:
    """The page in reading order; groups that were not run are named.

    Args:
        rows: Of `run_benchmark`.
    """
    parts = (
        (title, text, [row for row in rows if row["group"] in groups])
        for title, groups, text in PARTS
    )
    targets = speed_targets(rows)
    met = [PageSection("Targets", [count_met(targets), _targets(targets)])] if targets else []
    return [
        *met,
        PageSection("Where others are faster", [_faster(rows)]),
        *(_part(title, text, found) for title, text, found in parts if found),
        PageSection("How it was measured", [METHOD, *_conditions(rows)]),
    ]


def _targets(targets: Sequence[Row]) -> Table:
    rows = [[row["target"], row["limit"], row["found"], verdict(row["met"])] for row in targets]
    return Table(("figure", "target", "found", "met"), rows, "Set before anything was measured.")


def _faster(rows: Sequence[Row]) -> str:
    """Figures in which a rival wins."""
    found = [
        f"{row['name'].replace('_', ' ')}: {row['against']}, {cell_text(row['ratio'])} times"
        for row in rows
        if row["group"] in OTHERS and row["ratio"] and row["ratio"] > 1.0
    ]
    return f"Our time over theirs: {'; '.join(found)}." if found else "Nowhere among these rows."


def _part(title: str, text: str, rows: Sequence[Row]) -> PageSection:
    cells = [
        [
            row["name"].replace("_", " "),
            figure_text(row["value"], row["unit"]),
            row["against"],
            figure_text(row["against_value"], row["unit"]),
            row["ratio"],
            row["note"],
        ]
        for row in rows
    ]
    table = Table(("what", "takes", "against", "which takes", "ratio", "note"), cells)
    compared = [row for row in rows if row["ratio"]]
    if not compared:
        return PageSection(title, [text, table])
    drawn = picture(ratio_dots(compared), "Our time over theirs; left of the line we are faster.")
    return PageSection(title, [text, drawn, table])


def _conditions(rows: Sequence[Row]) -> list[str | Table]:
    taken = [
        [row["name"].removeprefix("time taken by "), figure_text(row["value"], row["unit"])]
        for row in rows
        if row["group"] == CONDITIONS and row["name"].startswith("time taken")
    ]
    table = Table(("group", "time"), taken, "How long each group of the bench took.")
    left = [name for name in GROUPS if not any(row["group"] == name for row in rows)]
    return [*([f"**Not run here:** {', '.join(left)}."] if left else []), table]


@styled
def ratio_dots(rows: Sequence[Row]) -> Figure:
    """Ratios to the rivals, a line a figure, a mark a rival, on a logarithmic axis.

    Args:
        rows: Rows that have a ratio.
    """
    names = list(dict.fromkeys(row["name"].replace("_", " ") for row in rows))
    rivals = list(dict.fromkeys(row["against"] for row in rows))
    figure, axes = panels(1, 1, row_height=0.7 + 0.24 * len(names) + 0.1 * len(rivals))
    panel = axes[0, 0]
    for number, rival in enumerate(rivals):
        mine = [row for row in rows if row["against"] == rival]
        places = [names.index(row["name"].replace("_", " ")) for row in mine]
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

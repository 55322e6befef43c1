"""The report of the rig: what was done, what came out, what limits it, what was known besides.

Every figure in it is among the metrics. Neglected: anything that was not run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from patagium.report import Link, Note, Picture, Section, Table, cell_text
from patagium_lab.rig.learning import OBSERVER_GAIN, SOURCES
from patagium_lab.verdicts import count_met, verdict

Metrics = Mapping[str, Any]
Pictures = Mapping[str, Picture]

RESULTS = (
    "Targets",
    "Clocks, delays and motion",
    "Errors against noise",
    "Force by force",
    "What limits the measured force",
    "What was known beside the logs",
)
"""Sections of the page of results, those that were run."""
TITLE = "From a robot arm and its sensors to a model of the air"


def sections(metrics: Metrics, pictures: Pictures) -> list[Section]:
    """The report in reading order.

    Args:
        metrics: Of the rig.
        pictures: By name.
    """
    limits = [_limits(metrics, pictures)] if metrics["limits"] else []
    return [
        _rig(metrics, pictures),
        Section("Targets", [count_met(metrics["targets"]), _targets(metrics)]),
        _clocks(metrics),
        _noise(metrics, pictures),
        _forces(metrics, pictures),
        *limits,
        _wingbeat(metrics, pictures),
        Section("What was known beside the logs", [Note(text) for text in metrics["left_out"]]),
    ]


def results(metrics: Metrics, pictures: Pictures) -> list[Section]:
    """What came out, without how: the sections of a page of results.

    Args:
        metrics: Of the rig.
        pictures: By name.
    """
    return [section for section in sections(metrics, pictures) if section.title in RESULTS]


def summary(metrics: Metrics) -> str:
    """What was found, in a few sentences.

    Args:
        metrics: Of the rig.
    """
    row = _shown(metrics)
    worst = max(one["worst"] for one in row["sources"].values())
    unseen = max(one["unseen"]["path and gait"]["worst"] for one in row["sources"].values())
    met = sum(target["met"] for target in metrics["targets"])
    return (
        "A robot arm carries a flapping robot through the wind of a fan; instruments write logs; a "
        "second program that sees nothing but a log aligns the clocks, finds motion and force, and "
        f"learns the air online. **At {row['noise']:g} times the noise of the data sheets the "
        f"worst force is learned to {_percent(worst)} of its variance, and to {_percent(unseen)} "
        f"on a path and gait never seen.** {met} of {len(metrics['targets'])} targets are met."
    )


def facts(metrics: Metrics) -> dict[str, str]:
    """Where the figures come from, for the foot of the page.

    Args:
        metrics: Of the rig.
    """
    made = f"`patagium rig`, {metrics['plan']['eights']:g} eights of the arm"
    return {"made by": made, **metrics["environment"]}


def _rig(metrics: Metrics, pictures: Pictures) -> Section:
    plan = metrics["plan"]
    return Section(
        "The rig",
        [
            f"**{plan['robot']}** on the flange of an arm ({plan['arm']}), its nose into a wind of "
            f"{cell_text(plan['wind'])} m/s. The arm follows a lying eight across the wind, at "
            f"{cell_text(plan['speed'])} m/s where it is fastest, while the wings flap at "
            f"{cell_text(plan['frequency'])} Hz. The truth is a lifting line with the lags of its "
            "wake and stall, and added mass. Each instrument has a clock of its own.",
            Link("The flight on the arm in three dimensions", metrics["replay"]),
            *_present(pictures, "flight"),
            Table(
                ("instrument", "part", "rate [Hz]", "errors"),
                [[row[key] for key in ("name", "part", "rate", "errors")]
                 for row in metrics["instruments"]],
                "Instruments, with the figures of their data sheets.",
            ),
            Table(
                ("joint of the arm", "speed, greatest [rad/s]", "torque, greatest [N m]"),
                [[name, one["speed"], one["torque"]] for name, one in metrics["arm"].items()],
                "What the arm does on the eight; it was planned within its published limits.",
            ),
        ],
    )  # fmt: skip


def _targets(metrics: Metrics) -> Table:
    rows = [
        [row["target"], row["limit"], row["found"], verdict(row["met"])]
        for row in metrics["targets"]
    ]
    return Table(("target", "limit", "found", "met"), rows, "Against the truth.")


def _clocks(metrics: Metrics) -> Section:
    rows = [
        [
            row["noise"],
            clock["instrument"],
            1e3 * clock["true"],
            1e3 * clock["found"],
            1e3 * clock["std"],
            1e3 * clock["error"],
        ]
        for row in metrics["noise"]
        for clock in row["clocks"]
    ]
    columns = ("noise", "instrument", "late [ms]", "found [ms]", "stated ± [ms]", "error [ms]")
    table = Table(columns, rows, "Delay and offset together, against the unit on the body.")
    return Section("Clocks, delays and motion", [_CLOCKS, table, _motion(metrics)])


def _motion(metrics: Metrics) -> Table:
    rows = [
        [row["noise"], name, *(row["motion"][part][name] for part in "qva")]
        for row in metrics["noise"]
        for name in _MOTION
        if name in row["motion"]["q"]
    ]
    columns = ("noise", "coordinate", "q [m, rad]", "v [m/s, rad/s]", "a [m/s², rad/s²]")
    return Table(columns, rows, "Deviation of the errors of the smoothed motion.")


def _noise(metrics: Metrics, pictures: Pictures) -> Section:
    rows = [
        [
            row["noise"],
            source,
            one["measured_worst"],
            one["worst"],
            one["worst_coordinate"],
            one["mean"],
            one["coverage"],
            *(one["unseen"][name]["worst"] for name in one["unseen"]),
        ]
        for row in metrics["noise"]
        for source, one in row["sources"].items()
    ]
    unseen = next(iter(metrics["noise"][0]["sources"].values()))["unseen"]
    columns = (
        *("noise", "source", "measured, worst", "learned, worst", "coordinate", "learned, mean"),
        *("in the 95 % interval", *(f"unseen {name}, worst" for name in unseen)),
    )
    table = Table(
        columns,
        rows,
        "Mean square error over variance of the truth, second half of the flight; unseen: after "
        "the first wingbeat, weights frozen, true states in.",
    )
    return Section(
        "Errors against noise", [_SOURCES, *_present(pictures, "noise"), table, Note(_READING)]
    )


def _forces(metrics: Metrics, pictures: Pictures) -> Section:
    row = _shown(metrics)
    source = row["sources"][SOURCES[0]]
    names = list(source["by_coordinate"])
    rows = [
        [
            name,
            *(row["sources"][key]["by_coordinate"][name] for key in SOURCES),
            *(row["sources"][key]["coverage_by_coordinate"][name] for key in SOURCES),
        ]
        for name in names
    ]
    columns = ("force", *SOURCES, *(f"{name}, in the interval" for name in SOURCES))
    caption = f"Learned force at {row['noise']:g} times the noise of the data sheets, second half."
    return Section("Force by force", [*_present(pictures, "forces"), Table(columns, rows, caption)])


def _limits(metrics: Metrics, pictures: Pictures) -> Section:
    found = _verdict(metrics["limits"])
    rows = [[row["case"], *(row[source] for source in SOURCES)] for row in metrics["limits"]]
    table = Table(("changed", *SOURCES), rows, "Worst error of the measured force, second half.")
    return Section(
        "What limits the measured force", [_LIMITS, found, table, *_present(pictures, "limits")]
    )


def _verdict(rows: Sequence[Mapping[str, Any]]) -> str:
    """What lowers the error of inverse dynamics, what raises it, and what does neither."""
    source, base = SOURCES[0], rows[0]
    shares = {row["case"]: row[source] / base[source] for row in rows[1:]}
    groups = {
        "Lower": [name for name, share in shares.items() if share < 1.0 - _MATTERS],
        "Higher": [name for name, share in shares.items() if share > 1.0 + _MATTERS],
        "Within a tenth": [name for name, share in shares.items() if abs(share - 1.0) <= _MATTERS],
    }
    parts = [
        f"**{word}**: "
        + "; ".join(f"{name} ({cell_text(shares[name])} times)" for name in names)
        + "."
        for word, names in groups.items()
        if names
    ]
    return f"{base['case'].capitalize()}: {cell_text(base[source])}. " + " ".join(parts)


def _wingbeat(metrics: Metrics, pictures: Pictures) -> Section:
    kinds = metrics["cycles"]
    rows = [[name, kinds["truth"][name], kinds["measured"][name]] for name in kinds["truth"]]
    table = Table(("over the wingbeats of the flight, SI", "true", "measured"), rows, _CYCLES)
    return Section("As a load-cell laboratory reports it", [*_present(pictures, "wingbeat"), table])


def _shown(metrics: Metrics) -> Mapping[str, Any]:
    """The row of the data sheets' noise, or the first."""
    rows: Sequence[Mapping[str, Any]] = metrics["noise"]
    return next((row for row in rows if row["noise"] == 1.0), rows[0])


def _present(pictures: Pictures, *names: str) -> list[Picture]:
    return [pictures[name] for name in names if name in pictures]


def _percent(share: float) -> str:
    return f"{cell_text(100 * share)} %"


_MATTERS = 0.1  # share of the error below which a change says nothing
_MOTION = ("y", "z", "pitch", "left_plunge", "left_elbow")

LEFT_OUT = (
    "The robot's masses, inertias and wings, the density of the air, the speed of the fan: as they "
    "are. Added mass is taken from theory, as the truth has it, and is no part of what is learned.",
    "The network is a lifting line with hidden states whose lags, lift slope, stall and section "
    "are unknown; the truth is one with other numbers. Its form is right, as that of no model of "
    "real air will be.",
    "Load cell and amplifiers are triggered by the unit on the body, so that their clocks are "
    "known; nothing in the motion tells a delay of a force from a drag.",
    "Cross-talk of the load cell and errors of its scale: its data sheet names none of their "
    "signs. Zeros of the encoders: calibrated.",
    "The prior of the learner's noise, which sets the width of its intervals in forces that no "
    "instrument feels, was chosen on flights like these.",
    "At no noise at all instruments are said to have a tenth of the data sheets' errors: a "
    "smoother that is told of none has nothing to weigh.",
)
"""What the second half of the program is told beside the logs, and what is not modeled."""
_CLOCKS = (
    "The encoders' clock is 12 ms ahead, the cameras' 7 ms behind with 4.2 ms of delay; nobody "
    "says so. What was found from motion alone is used from here on."
)
_SOURCES = (
    "Three ways to the force of the air: **inverse dynamics** of the smoothed motion, with the "
    "motors' currents and the load cell under the robot; a **momentum observer** of the same, "
    f"{OBSERVER_GAIN:g}/s, which asks for no acceleration; the **load cell** alone, which feels "
    "six forces and no joint. What is learned is always all forces."
)
_READING = (
    "Errors of a measured force are noise of the encoders through two derivatives, and clocks; a "
    "network of strips can follow neither, so that what is learned can be closer to the truth than "
    "what it was learned from. Without noise what remains is what the network has not learned yet "
    "or cannot express."
)
_LIMITS = (
    "At the noise of the data sheets over the first eight, clocks known unless it says otherwise; "
    "one thing changed at a time."
)
_CYCLES = (
    "Added mass included. The arm's eight changes the wind from one wingbeat to the next, so that "
    "the spread is large."
)

"""Page of the rig: what was done, what was found, what limits it, what was known besides.

Every figure comes from the metrics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from patagium.report import Block, Link, Note, PageSection, Table, cell_text
from patagium_lab.gallery import Gallery
from patagium_lab.rig.learning import SOURCES
from patagium_lab.study import Columns, Metrics, Page, Results, table_of
from patagium_lab.targets import count_met, row_verdict

RESULTS = (
    "Targets",
    "Clocks, delays and motion",
    "Errors against noise",
    "Force by force",
    "What limits the measured force",
    "What was known beside the logs",
)
"""Titles of the sections of the page of results."""
TITLE = "From a robot arm and its sensors to a model of the air"


def page(results: Results) -> Page:
    """Whole page of the rig.

    Args:
        results: Results of `run`.
    """
    metrics, gallery = results.metrics, results.gallery
    made = f"`patagium study rig`, {metrics['plan']['eights']:g} eights of the arm"
    sections = [
        _rig(metrics, gallery),
        PageSection("Targets", [count_met(metrics["targets"]), _targets(metrics)]),
        _clocks(metrics),
        _noise(metrics, gallery),
        _forces(metrics, gallery),
        *([_limits(metrics, gallery)] if metrics["limits"] else []),
        _wingbeat(metrics, gallery),
        PageSection("What was known beside the logs", [Note(text) for text in metrics["left_out"]]),
    ]
    return Page(TITLE, _summary(metrics), {"made by": made, **metrics["environment"]}, sections)


def _summary(metrics: Metrics) -> str:
    row = _shown(metrics)
    worst = max(one["worst"] for one in row["sources"].values())
    unseen = max(one["unseen"]["path and gait"]["worst"] for one in row["sources"].values())
    met = sum(target["met"] for target in metrics["targets"])
    return (
        "A robot arm carries a flapping robot through the wind of a fan, and instruments write "
        "logs. A second program that sees nothing but a log aligns the clocks, finds motion and "
        f"force, and learns the air online. **At {row['noise']:g} times the noise of the data "
        f"sheets the worst force is learned to {_percent(worst)} of its variance, and to "
        f"{_percent(unseen)} on a path and gait never seen.** {met} of {len(metrics['targets'])} "
        "targets are met."
    )


def _rig(metrics: Metrics, gallery: Gallery) -> PageSection:
    plan = metrics["plan"]
    return PageSection(
        "The rig",
        [
            f"**{plan['robot']}** on the flange of an arm ({plan['arm']}), its nose into a wind of "
            f"{cell_text(plan['wind'])} m/s. The arm follows a lying eight across the wind, at "
            f"{cell_text(plan['speed'])} m/s where it is fastest, while the wings flap at "
            f"{cell_text(plan['frequency'])} Hz. The truth is a lifting line with the lags of its "
            "wake and stall, and added mass. Each instrument has a clock of its own.",
            Link("The flight on the arm in three dimensions", metrics["replay"]),
            *gallery.pictures("flight"),
            table_of(
                {"instrument": "name", "part": "part", "rate [Hz]": "rate", "errors": "errors"},
                metrics["instruments"],
                "Instruments, with the errors of their data sheets.",
            ),
            Table(
                ("joint of the arm", "largest speed [rad/s]", "largest torque [N m]"),
                [[name, one["speed"], one["torque"]] for name, one in metrics["arm"].items()],
                "Motion of the arm on the eight, planned within its published limits.",
            ),
        ],
    )


def _targets(metrics: Metrics) -> Table:
    columns: Columns = {
        "target": "target",
        "limit": "limit",
        "found": "found",
        "met": row_verdict,
    }
    caption = "Errors of forces are mean square errors over the variance of the truth."
    return table_of(columns, metrics["targets"], caption)


def _clocks(metrics: Metrics) -> PageSection:
    rows = [{"noise": row["noise"], **clock} for row in metrics["noise"] for clock in row["clocks"]]
    columns: Columns = {
        "noise over the data sheets' [1]": "noise",
        "instrument": "instrument",
        "late, true [ms]": lambda row: 1e3 * row["true"],
        "late, found [ms]": lambda row: 1e3 * row["found"],
        "stated standard deviation [ms]": lambda row: 1e3 * row["std"],
        "error [ms]": lambda row: 1e3 * row["error"],
    }
    table = table_of(columns, rows, "Delay and clock offset together, beside the unit on the body.")
    return PageSection("Clocks, delays and motion", [_CLOCKS, table, _motion(metrics)])


def _motion(metrics: Metrics) -> Table:
    rows = [
        {"noise": row["noise"], "name": name, **{part: row["motion"][part][name] for part in "qva"}}
        for row in metrics["noise"]
        for name in _MOTION
        if name in row["motion"]["q"]
    ]
    columns: Columns = {
        "noise over the data sheets' [1]": "noise",
        "coordinate": "name",
        "q [m, rad]": "q",
        "v [m/s, rad/s]": "v",
        "a [m/s², rad/s²]": "a",
    }
    return table_of(columns, rows, "Standard deviation of the errors of the smoothed motion.")


def _noise(metrics: Metrics, gallery: Gallery) -> PageSection:
    rows = [
        {"noise": row["noise"], "source": source, **one}
        | {f"unseen {name}": scores["worst"] for name, scores in one["unseen"].items()}
        for row in metrics["noise"]
        for source, one in row["sources"].items()
    ]
    columns: Columns = {
        "noise over the data sheets' [1]": "noise",
        "source of forces": "source",
        "NMSE measured, worst force [1]": "measured_worst",
        "NMSE learned, worst force [1]": "worst",
        "worst force": "worst_coordinate",
        "NMSE learned, mean force [1]": "mean",
        "share in the 95 % interval [1]": "coverage",
        **{f"NMSE unseen {name}, worst force [1]": f"unseen {name}" for name in rows[0]["unseen"]},
    }
    caption = (
        "Mean square error over the variance of the truth (NMSE), second half of the flight. "
        "Unseen flights count after their first wingbeat, with frozen weights and true states."
    )
    table = table_of(columns, rows, caption)
    blocks: list[Block] = [_SOURCES, *gallery.pictures("noise"), table, Note(_READING)]
    return PageSection("Errors against noise", blocks)


def _forces(metrics: Metrics, gallery: Gallery) -> PageSection:
    row = _shown(metrics)
    names = row["sources"][SOURCES[0]]["by_coordinate"]
    rows = [
        {"name": name}
        | {source: row["sources"][source]["by_coordinate"][name] for source in SOURCES}
        | {f"in {s}": row["sources"][s]["coverage_by_coordinate"][name] for s in SOURCES}
        for name in names
    ]
    columns: Columns = {
        "force": "name",
        **{f"NMSE, {source} [1]": source for source in SOURCES},
        **{f"share in the interval, {source} [1]": f"in {source}" for source in SOURCES},
    }
    caption = f"Learned force at {row['noise']:g} times the noise of the data sheets, second half."
    return PageSection(
        "Force by force", [*gallery.pictures("forces"), table_of(columns, rows, caption)]
    )


def _limits(metrics: Metrics, gallery: Gallery) -> PageSection:
    columns = {"changed": "case", **{f"NMSE, {source} [1]": source for source in SOURCES}}
    caption = "Worst error of the measured force over the variance of the truth, second half."
    table = table_of(columns, metrics["limits"], caption)
    found = _verdict(metrics["limits"])
    return PageSection(
        "What limits the measured force", [_LIMITS, found, table, *gallery.pictures("limits")]
    )


def _verdict(rows: Sequence[Mapping[str, Any]]) -> str:
    """Changes that lower the error of inverse dynamics, that raise it, and that do neither."""
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


def _wingbeat(metrics: Metrics, gallery: Gallery) -> PageSection:
    kinds = metrics["cycles"]
    rows = [[name, kinds["truth"][name], kinds["measured"][name]] for name in kinds["truth"]]
    table = Table(
        ("over the wingbeats of the flight [SI units]", "true", "measured"), rows, _CYCLES
    )
    return PageSection(
        "As a load-cell laboratory reports it", [*gallery.pictures("wingbeat"), table]
    )


def _shown(metrics: Metrics) -> Mapping[str, Any]:
    """Row of the data sheets' noise, or else the first row."""
    rows: Sequence[Mapping[str, Any]] = metrics["noise"]
    return next((row for row in rows if row["noise"] == 1.0), rows[0])


def _percent(share: float) -> str:
    return f"{cell_text(100 * share)} %"


_MATTERS = 0.1  # relative change of the error below which it says nothing
_MOTION = ("y", "z", "pitch", "left_plunge", "left_elbow")

LEFT_OUT = (
    "The robot's masses, inertias and wings, the density of the air and the speed of the fan are "
    "known exactly. Added mass is taken from theory, as in the truth, and is not learned.",
    "What learns is a lifting line with two lags a strip; unknown are their rates, lift slope and "
    "profile drag, which begin half as large again as in the truth, or a fifth too small. All else "
    "of the model is right, which it will not be in real air: on other programs' air a grey box "
    "errs by more than the default network.",
    "Load cell and amplifiers are triggered by the unit on the body, so that their clocks are "
    "known; nothing in the motion tells a delay of a force from a drag.",
    "Cross-talk of the load cell and errors of its scale are left out, because its data sheet does "
    "not give their signs. The zeros of the encoders are calibrated.",
    "The prior of the learner's noise, which sets the width of its intervals in forces that no "
    "instrument feels, was chosen on a flight of three wingbeats, no part of these.",
    "Without noise the instruments are said to have a tenth of the data sheets' errors, because a "
    "smoother needs some error to weigh its measurements.",
)
"""Knowledge of the second half of the program beside the logs, and what is not modeled."""
_CLOCKS = (
    "The encoders' clock is 12 ms ahead, and the cameras' clock is 7 ms behind with 4.2 ms of "
    "delay. The program is not told; it estimates both from the motion and uses the estimates."
)
_SOURCES = (
    "There are two ways to the force of the air: **inverse dynamics** of the smoothed motion, "
    "with the motors' currents and the load cell under the robot; and the **load cell** alone, "
    "which feels six forces and no joint. All forces are learned in both cases."
)
_READING = (
    "Errors of a measured force come from the encoders' noise through two derivatives, and from "
    "clocks. A lifting line can follow neither, so that the learned force can be closer to "
    "the truth than the measurement that it was learned from. Without noise the remaining error is "
    "what has not been learned yet."
)
_LIMITS = (
    "These runs have the noise of the data sheets and cover the first eight; clocks are known "
    "unless a row says otherwise. One thing is changed at a time."
)
_CYCLES = (
    "Added mass is included. The arm's eight changes the wind from one wingbeat to the next, so "
    "that the spread is large."
)

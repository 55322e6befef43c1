"""Page of the attack: hostile cases, then learners under faults, damage and long runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from patagium.learning.page import reliability_picture
from patagium.report import Block, PageSection, Picture, Table, picture
from patagium.report.figures import curves
from patagium.report.page import Cell
from patagium_lab.attack.campaign import SETTLING, WINDOW, WORST_RATIO
from patagium_lab.attack.motion_capture import summary
from patagium_lab.attack.oracle import KINDS, LIMIT
from patagium_lab.attack.plan import HOSTILE
from patagium_lab.attack.poison import LONGEST, RECOVERY
from patagium_lab.attack.run import AttackResults
from patagium_lab.conditions import conditions
from patagium_lab.study import Page, table_of

TITLE = "What the program survives"
SUMMARY = (
    "The whole program is attacked: hostile files, packets, options, signals, failing disks and "
    "damaged caches; learners are flown through faults, damage and very long runs. Everything is "
    "drawn from a seed. The page counts what must not happen, and shows how well the filter "
    "knows its own uncertainty."
)
_HOSTILE_WORDS = {
    "files": "every format that the program reads, mutated by bytes, by tokens of its language, "
    "by the tree of YAML and JSON, by cells of tables, by variables and attributes of netCDF; "
    "what is accepted must hold together (time rises, numbers are finite, a learner's file "
    "predicts as the learner that was saved)",
    "packets": "sessions of datagrams with strangers, losses, doubles and late ones between them, "
    "and texts with hostile lines or in pieces; no packet that was not sent, none twice",
    "loops": "`pt.fly` with hostile commands, periods, events, sensors, learners and start, and "
    "plans, flown for 20 ms; states of a flight that completed are finite",
    "calls": "public functions, classes and methods with one or two arguments of a wrong kind, "
    "shape, size or robot; the result is finite, or a failure that the function documents",
    "options": "one to four hostile options of a verb; a traceback, a death or an end later than "
    f"{LIMIT:g} s after Ctrl-C is a finding",
    "signals": "INT, TERM, HUP or KILL at a random time of a verb; each output is the former file "
    "or a whole new one",
    "writes": "a disk that is full, read-only or gone from the nth operation on, for every verb "
    "that writes; each output is the former file or a whole new one",
    "cache": "a compiled library with damaged bytes; the flight must be equal bit for bit",
}
_FAULTS = (
    ("not a number", "some or all channels NaN or infinite, up to 200 samples",
     "exactly: `missing`, `blind`"),
    ("no input", "one input of each sample NaN or infinite", "exactly: `bad_inputs`"),
    ("spikes", "single measurements off by 100 standard deviations of the noise, up to 1e300",
     "`outliers`, at least all spikes of 300 standard deviations or more"),
    ("input spikes", "single inputs off by their whole range, up to 1e300 times it",
     "no requirement"),
    ("stuck", "some or all channels repeat one value", "exactly: `stuck`, `blind`"),
    ("gap", "samples that never come", "nothing"),
    ("duplicates", "samples that come up to four times", "exactly: `duplicates`"),
    ("out of order", "samples that come up to nine places later", "exactly: `late`"),
    ("clock jump", "the clock jumps ahead, back, for one sample, or gives no time at all",
     "exactly: `late`, `clock_resets`"),
    ("storm", "all of these faults at random", "no requirement"),
    ("kill -9 while saving", "a forked process saves in a loop and is killed",
     "the file loads, holds the last confirmed save or the one after it, and the learner goes on "
     "bit for bit"),
)  # fmt: skip


def page(results: AttackResults) -> Page:
    """Whole page of the attack; areas that were not run are left out.

    Args:
        results: Results of `run`.
    """
    facts = {"made by": "`patagium study attack`", "seed": str(results.seed), **conditions()}
    areas = results.areas
    sections = [PageSection("Hostile cases", _hostile(results))] if results.tallies() else []
    if "poison" in areas:
        sections.append(PageSection("Poison", _poison(areas["poison"])))
    if "faults" in areas:
        blocks: list[Block] = [_campaign(results), _fault_kinds(), fault_table(results)]
        sections.append(PageSection("Faults", [*blocks, _ratio_picture(areas["faults"])]))
    if "damage" in areas:
        sections.append(PageSection("Damage", _damage(areas["damage"])))
    if "calibration" in areas:
        sections.append(PageSection("Calibration", _calibration(areas["calibration"])))
    if "endurance" in areas:
        sections.append(PageSection("Endurance", _endurance(areas["endurance"])))
    if "captures" in areas:
        sections.append(PageSection("Motion capture", _captures(areas["captures"])))
    return Page(TITLE, SUMMARY, facts, sections)


def area_table(results: AttackResults) -> Table:
    """Table of hostile cases and findings by area.

    Args:
        results: Results of `run`.
    """
    tallies = results.tallies()
    names = [area for area in HOSTILE if any(row["area"] == area for row in tallies)]
    rows = [
        _summed({"name": area}, [row for row in tallies if row["area"] == area]) for area in names
    ]
    rows.append(_summed({"name": "all"}, tallies))
    return table_of({"area": "name", **_COLUMNS}, rows, "Hostile cases and findings by area.")


_COLUMNS = {
    "cases": "cases",
    "answered": "answered",
    "refused with words": "refused",
    "crashes": "crash",
    "silent wrong numbers": "wrong",
    "lost states": "lost",
    "hangs": "hang",
    "peak memory of a process [MB]": "peak",
    "time of a case [ms]": "time",
}


def _summed(about: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Sum of tallies."""
    cases = sum(row["cases"] for row in rows)
    return {
        **about,
        **{key: sum(row[key] for row in rows) for key in ("cases", "answered", "refused")},
        **{kind: sum(row["counts"].get(kind, 0) for row in rows) for kind in KINDS},
        "peak": round(max(row["peak"] for row in rows) / 1e6),
        "time": 1e3 * sum(row["seconds"] for row in rows) / cases,
    }


def _hostile(results: AttackResults) -> list[Block]:
    tallies = results.tallies()
    targets = [_summed({"area": row["area"], "name": row["target"]}, [row]) for row in tallies]
    findings = [one for row in tallies for one in row["findings"]]
    words: list[list[Cell]] = [[area, text] for area, text in _HOSTILE_WORDS.items()]
    blocks: list[Block] = [
        "A case is drawn from the seed, its target and its number, and runs in a process that is "
        f"watched: a case ends within {LIMIT:g} s, and no process takes 1 GB more than it began "
        "with. A case ends in an answer or in a refusal with words (a `PatagiumError`; exit code "
        "2 and a sentence of a program). Anything else is a finding. Time in which other programs "
        "held the processor does not count. Cases that were findings "
        "once are kept, small, in `tests/lab/story/corpus`, and are read by each `make test`.",
        Table(["area", "what is done, and what is asked for"], words, "Areas of hostile cases."),
        area_table(results),
        table_of({"area": "area", "target": "name", **_COLUMNS}, targets, "The same by target."),
        "Not attacked: the attack itself, studies under signals and failing disks, plugins, power "
        "that is lost, netCDF files whose checksum a stranger makes right (see SECURITY.md), and a "
        "stranger who can write as the user. Times include what other programs on the machine "
        "took.",
    ]
    if findings:
        cells: list[list[Cell]] = [
            [f["target"], f["number"], f["kind"], f["words"][:160]] for f in findings[:40]
        ]
        blocks.append(Table(["target", "case", "kind", "words"], cells, "Findings that are left."))
    return blocks


def _poison(rows: list[dict[str, Any]]) -> list[Block]:
    cells: list[list[Cell]] = [
        [
            row["learner"],
            row["samples"],
            sum(row["bursts"].values()),
            row["crash"] or "none",
            row["uncounted"],
            sum(row["beyond"].values()),
            sum(row["below"].values()),
            max(row["ratio"].values()),
            *row["missing"],
            row["clean"][1],
            row["clean"][-1],
        ]
        for row in rows
    ]
    kinds: list[list[Cell]] = [
        [
            kind,
            sum(row["bursts"][kind] for row in rows),
            sum(row["beyond"][kind] for row in rows),
            sum(row["below"][kind] for row in rows),
            max(row["ratio"][kind] for row in rows),
        ]
        for kind in rows[0]["bursts"]
    ]
    tail = ["bursts with a ratio above 1.5", "below 1/1.5", "largest ratio [1]"]
    heads = ["learner", "samples", "bursts", "crash", "samples that were not counted", *tail]
    heads += ["above 1.5 where the samples are missing instead", "largest there [1]"]
    heads += ["error of the twin in the second tenth of the flight [N]", "in the last [N]"]
    return [
        f"Bursts of up to {LONGEST} samples that no sensor should give, to 1e300, in a flight of a "
        "robot of three joints; a second learner learns the same samples without them. The ratio "
        f"is that of the root mean square error to the twin's, over {RECOVERY} samples that begin "
        f"{RECOVERY} clean samples after a burst. A sample that is not learned must be counted as "
        "an event. Learners that had other samples differ, and a hundred samples are 0.3 to 0.5 "
        "of a wingbeat of a joint: states where they differ return later. How often the twin is "
        "the worse one tells how often this alone is more than 1.5, and so does a third learner, "
        "which never gets the samples of the bursts. An encoder that jumps within "
        "its range is believed after 100 samples at most, and a small or random jump may look like "
        "motion; such samples are learned. "
        "Learners of the three joints have a prior share, so that cubature points lie one standard "
        "deviation off. `wings` is the default network of a winged robot in flight, with the "
        "default filter; its errors are over the scale of each force.",
        Table(heads, cells, "Screened learners, with noise by EM or Misfit, and their twins."),
        Table(["kind", "bursts", *tail], kinds, "The same by kind of poison."),
    ]


def fault_table(results: AttackResults) -> Table:
    """Table of failures by fault.

    Args:
        results: Results of `run`.
    """
    columns = {
        "fault": "fault",
        "runs": "runs",
        "crashes": "crashes",
        "weights not finite": "not_finite",
        "covariance indefinite": "indefinite",
        "lost states": "lost_states",
        "miscounted": "miscounted",
        "not recovered": "not_recovered",
        "error ratio, median [1]": "ratio_median",
        "error ratio, largest [1]": "ratio_largest",
    }
    rows = results.faults()
    counts = list(columns.values())[1:8]
    total = {
        "fault": "all",
        **{key: sum(row[key] for row in rows) for key in counts},
        "ratio_largest": max((row["ratio_largest"] for row in rows), default=None),
    }
    caption = (
        "Number of failures, and the error after a fault over that of the same learner without it."
    )
    return table_of(columns, [*rows, total], caption)


def _campaign(results: AttackResults) -> str:
    runs = results.areas["faults"]
    torn = sum(row["interrupted_saves"] for row in results.faults())
    events: dict[str, int] = {}
    for row in results.faults():
        for name, count in row["events"].items():
            events[name] = events.get(name, 0) + count
    counted = ", ".join(f"{n} `{name}`" for name, n in sorted(events.items(), key=lambda e: -e[1]))
    return (
        f"{len(runs)} runs of seed {results.seed}. Each run draws a learner as a user would choose "
        "it (strip or dense network; full, layer or node covariance; double or single "
        "precision; with or without change detection; always with screening, noise estimation and "
        "`prior_share=1e-4`) and a fault with its place, length and channels; it can be flown "
        "again: `patagium_lab.attack.campaign.one_run(seed, number)`. The learner gets 1,500 "
        "samples of the corrected flight (0.6 s, 2 % noise); one fault begins between samples 500 "
        "and 800. The error ratio compares the learner over "
        f"{WINDOW} samples, {SETTLING} after the fault (half a wingbeat), with the same learner "
        "without the fault: (E + f) / (E_without + f), where E is the mean square error and f a "
        f"tenth of the variance of the noise; above {WORST_RATIO:g} it counts as not recovered. "
        f"{torn} of the kills left a half-written draft beside the whole file. The learners "
        f"counted {counted}.\n\n"
        "A hundred standard deviations of 2 % noise are two of the signal itself; a network that "
        "predicts no better than that cannot recognize such a spike. `stuck_samples` is 10 here, "
        "because noisy channels never repeat a value. A strip network does not read the position "
        "of the robot, so a missing position does no harm to it."
    )


def _fault_kinds() -> Table:
    heads = ["fault", "what happens", "what must be counted"]
    return Table(heads, [list(row) for row in _FAULTS], "Faults of the campaign.")


def _ratio_picture(runs: list[dict[str, Any]]) -> Picture:
    ratios = np.sort([run["ratio"] for run in runs])
    share = (np.arange(len(ratios)) + 1) / len(ratios)
    figure = curves(
        share,
        np.full(len(share), WORST_RATIO),
        {"error ratio of the runs, sorted": np.minimum(ratios, 10 * WORST_RATIO)},
        abscissa="share of the runs [1]",
        ordinate="error ratio [1]",
    )
    return picture(figure, "Error after the fault over the error without it; expected: the limit.")


def _damage(rows: list[dict[str, Any]]) -> list[Block]:
    beats = [1, 2, 3, 4]
    cells = []
    for row in rows:
        for name, label in (("hold", "one sample"), ("ahead", "10 ms")):
            former = row[f"{name}_former"]
            after = [former * ratio for ratio in row[f"{name}_ratios"][: len(beats)]]
            after += [None] * (len(beats) - len(after))
            detected = row["detected"] if name == "hold" else None
            cells.append([row["learner"], label, former, *after, row[f"{name}_beats"], detected])
    heads = (
        *("learner", "horizon", "NMSE before [1]"),
        *(f"NMSE in wingbeat {beat} [1]" for beat in beats),
        *("within twice the former error from wingbeat", "detected after [samples]"),
    )
    figure = curves(
        np.arange(1, len(rows[0]["ahead_ratios"]) + 1),
        np.full(len(rows[0]["ahead_ratios"]), 2.0),
        {row["learner"]: row["ahead_ratios"] for row in rows},
        abscissa="wingbeats after the damage [1]",
        ordinate="error over the former one [1]",
    )
    return [
        "The robot flaps on a fixed mount in oblique wind (a free robot would roll over). After "
        "twelve wingbeats the left wing loses the rear third of its chord, and every strip gets "
        "another polar, with a quarter less lift and more drag. A dense network learns every "
        "sample, with 2 % noise; the filters have one covariance block a neuron. Change detection "
        "has `window=50` (5 ms), a `reference` of one wingbeat, `reopening=0.3` and "
        "`false_alarm_rate=1e-9`, chosen before the runs from their meaning; an alarm needs "
        "innovations larger than predicted, and after one the test is silent for a wingbeat. A "
        "learner with a large error before the damage is back at that error early, so the errors "
        "themselves count. A strip network gives both wings the same coefficients and cannot "
        "represent damage to one of them.",
        Table(heads, cells, "NMSE by wingbeat before and after the damage, mean over outputs."),
        picture(figure, "Error 10 ms ahead over the former one, by wingbeat."),
    ]


def _calibration(rows: list[dict[str, Any]]) -> list[Block]:
    columns = {
        "flight": "subject",
        "samples": "samples",
        "share in the 95 % interval [1]": "coverage",
        "share in the interval, second half [1]": "coverage_second_half",
        "NIS per channel [1]": "nis_per_channel",
        "share of NIS in its 95 % range [1]": "nis_inside",
        "correlation of innovations [1]": "innovation_correlation",
        "NMSE, second half [1]": "nmse",
    }
    return [
        "Every sample is used, and the noise is estimated online. A filter with the right "
        "uncertainty has a NIS per channel of 1 and innovations without correlation. On the flight "
        "without noise the innovations are the forces that the network cannot represent: they are "
        "correlated and have heavier tails than a normal distribution, so that the interval holds "
        "its share of the errors but says little about a single sample.",
        table_of(columns, rows, "Calibration of the predicted intervals."),
        reliability_picture({row["subject"]: row["reliability"] for row in rows}),
    ]


def _endurance(figures: Mapping[str, Any]) -> list[Block]:
    glide, precision = figures["glide"], figures["precision"]
    rows: list[list[Any]] = [
        ["steady glide: samples", glide["samples"]],
        ["steady glide: share of the prior [1]", glide["share"]],
        ["steady glide: largest diagonal of P over the prior's [1]", glide["largest"]],
        ["steady glide: smallest diagonal of P over the prior's [1]", glide["smallest"]],
        ["precision: updates in each precision", precision["updates"]],
        ["precision: updates refused, float32", precision["refused"]["float32"]],
        ["precision: covariance definite at every look, float32", precision["definite"]],
        ["precision: NMSE, float64 [1]", precision["error"]["float64"]],
        ["precision: NMSE, float32 [1]", precision["error"]["float32"]],
        ["precision: error of float32 over that of float64 [1]", precision["ratio"]],
    ]
    return [
        "A steady glide has one state, repeated: the covariance may not exceed its prior. A filter "
        "in single precision and one in double precision learn the outputs of a network whose "
        "weights turn between two sets.",
        Table(["figure", "value"], rows, "Filters with one covariance block a neuron."),
    ]


def _captures(rows: list[dict[str, Any]]) -> list[Block]:
    facts = summary(rows)
    cells: list[list[Any]] = [
        [f"{name.replace('_', ' ')} {'' if name.startswith('seeds') else '[1]'}".strip(), value]
        for name, value in facts.items()
        if not isinstance(value, list)
    ]
    return [
        "Each seed draws a body's motion of 3 to 8 s (smooth, flapping, or a rest before a flight) "
        "with up to two tumbles of 5 to 25 rad/s, and a log of cameras: 100 to 250 Hz, noise of "
        "0.1 to 1 mm and 0.1 to 1.6 degrees that is white or correlated up to .6 from frame to "
        "frame, jitter up to a fifth of the step, swapped markers, lost frames up to 0.6 s, and in "
        "a third of the logs a tail of nonsense. Errors are those of the attitude where "
        "`estimate_motion` claims to know it; the ratio is that of the error to the stated "
        "standard deviation.",
        Table(["figure", "value"], cells, "Motion from made-up motion capture."),
    ]

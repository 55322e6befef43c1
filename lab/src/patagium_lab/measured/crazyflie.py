"""A real quadrotor's log learned online: motor commands and rates to vertical specific force.

The log holds two short flights that end in falls, between stretches on the ground. Static maps of
commands and rates predict the force: a dense network, recursive least squares. They do not know
the motors' lag, the battery, or whether the robot stands. One network holds physics as well, the
rotors' lag and thrust. All stand beside holding the last used sample, which at 1 kHz is hard to
beat until samples become rare or the horizon long.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np

from patagium.learning.identify import evaluate, identify
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.settings import NoiseEstimation
from patagium.learning.stream import stream
from patagium.learning.table_network import network_for
from patagium.report import PageSection
from patagium.sensing.logs.importing.import_log import read_table
from patagium.sensing.logs.mapping import TableMapping, load_mapping
from patagium.sensing.logs.table import LogTable
from patagium_lab.frozen_spans import FrozenSpans
from patagium_lab.measured.thrust import thrust_network_for
from patagium_lab.rivals.linear_learner import LinearLearner
from patagium_lab.study import table_of

EVERY = (1, 10, 100)
HORIZONS = {"10ms": 0.01, "100ms": 0.1, "1s": 1.0}
HIDDEN = (8, 8)
FEATURES = 100
MEASUREMENT_STD = 0.6
"""Standard deviation of the specific force: vibration, and forces not commanded [m/s^2]."""
BOUNDED: dict[str, Any] = {"prior_share": 1e-5, "noise_estimation": NoiseEstimation(300)}
"""Settings of learners that keep learning: a memory of 10^5 samples, and noise found online."""
FLYING_COMMAND = 0.05
"""Motors run where the mean command exceeds this share of its range."""
DROP_OUT = 0.3
"""Motors that stop for less than this are still in flight [s]."""
PAUSE = 1.0
"""Least time between two flights [s]."""


@dataclass(frozen=True)
class CrazyflieStudy:
    """Scores of learners on the log.

    Attributes:
        rows: One dict a part of the log, sampling and learner: `part`, `every`, `learner`,
            NMSE over the second half (the second flight) sample by sample and at each
            horizon, by weights frozen after the first flight, coverage, microseconds an
            update.
        samples: Samples in the log and in flight.
        gaps: The gaps in one sentence.
    """

    rows: list[dict[str, Any]]
    samples: tuple[int, int]
    gaps: str


def crazyflie_mapping() -> TableMapping:
    """Mapping of the log's columns, from the file in this package."""
    with as_file(files("patagium_lab").joinpath("cases/crazyflie.yaml")) as path:
        return load_mapping(path)


def in_flight(table: LogTable) -> LogTable:
    """The samples between take-off and the end of each flight; the rest is a gap.

    Args:
        table: The log, motor commands first among its inputs.
    """
    share = table.x[:, :4].mean(axis=1) / table.input_range[:4, 1].mean()
    running = np.flatnonzero(share > FLYING_COMMAND)
    short = np.flatnonzero(np.diff(table.time[running]) < DROP_OUT)
    kept = np.zeros(len(table.time), bool)
    for index in short:
        kept[running[index] : running[index + 1] + 1] = True
    return table.where(kept)


def crazyflie_study(
    path: str | Path,
    every: Sequence[int] = EVERY,
    samples: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> CrazyflieStudy:
    """The log streamed in order through each learner: all of it, and its flights alone.

    Args:
        path: The log, `log16.csv.gz`.
        every: Rates of samples: one in this many is used.
        samples: Number of samples used from the start; None: all.
        progress: Receives the number of runs done and of all runs.
    """
    table = read_table(path, crazyflie_mapping()).where(slice(samples))
    flights, makers, rows = in_flight(table), _makers(table), []
    total = 2 * len(every) * len(makers)
    for part, log in (("whole log", table), ("in flight", flights)):
        for one_in in every:
            for name, make in makers.items():
                own, held = _row(log, make, one_in)
                key = {"part": part, "every": one_in}
                if name == next(iter(makers)):
                    rows.append({**key, "learner": "last used sample held", **held})
                rows.append({**key, "learner": name, **own})
                if progress is not None:
                    progress(sum("outcome" in row for row in rows), total)
    sizes = len(table.time), len(flights.time)
    return CrazyflieStudy(rows, sizes, table.describe_gaps())


def crazyflie_sections(study: CrazyflieStudy) -> list[PageSection]:
    """Section of a page with the study.

    Args:
        study: Results of `crazyflie_study`.
    """
    columns = {
        "samples": "part",
        "one sample in": "every",
        "learner": "learner",
        "second half [1]": "second_half",
        **{f"{label} ahead [1]": f"horizon_{label}" for label in HORIZONS},
        "second flight, frozen [1]": "second_flight_frozen",
        "share in the 95 % interval [1]": "coverage",
        "update [µs]": "microseconds_per_update",
    }
    return [
        PageSection(
            "A real log (Crazyflie quadrotor, 1 kHz)",
            [
                f"{study.samples[0]} samples, {study.samples[1]} of them in flight; "
                f"{study.gaps}. Motor commands and angular rates in, vertical specific force "
                "out, in order. Falls after the motors stop, with knocks of up to 13 g, hold most "
                "of the variance of the whole log: no command predicts them.",
                "The physics: each of four rotors follows its command with a lag that is learned, "
                "and pulls by its square and itself; a dense network beside sees the lagged "
                "commands and the rates. Alone, the network sees the commands as they are. With a "
                "bounded memory a share of 1e-5 of the covariance before any sample is mixed in "
                "before each, and the noise of the measurement is found online; the others take "
                f"it as {MEASUREMENT_STD} m/s^2, which learners with bounded memory only "
                "start from.",
                table_of(
                    columns,
                    study.rows,
                    "Normalized mean square error over the second half. Holding a sample needs "
                    "that sample; a frozen model does not.",
                ),
            ],
        )
    ]


def _makers(table: LogTable) -> dict[str, Callable[[], Learner]]:
    network = network_for(table, HIDDEN)
    physics, linear = thrust_network_for(table, HIDDEN), network_for(table, ())
    prior: dict[str, Any] = {
        "prior_std": 0.5,
        "measurement_std": MEASUREMENT_STD,
    }
    beside, alone = f"physics and network {HIDDEN}", f"dense network {HIDDEN}"
    return {
        f"{beside}, extended": lambda: ExtendedLearner(physics, **prior),
        f"{beside}, extended, bounded memory": lambda: ExtendedLearner(physics, **prior, **BOUNDED),
        f"{alone}, extended": lambda: ExtendedLearner(network, **prior),
        f"{alone}, extended, bounded memory": lambda: ExtendedLearner(network, **prior, **BOUNDED),
        f"{alone}, cubature": lambda: CubatureLearner(network, spread=3**0.5, **prior),
        "recursive least squares, linear": lambda: LinearLearner(linear, **prior),
        f"recursive least squares, {FEATURES} features": lambda: LinearLearner(
            linear, features=FEATURES, **prior
        ),
    }


def _row(
    table: LogTable, make: Callable[[], Learner], every: int
) -> tuple[dict[str, Any], dict[str, Any]]:
    learner = make()
    spans = FrozenSpans(HORIZONS, learner, table.time, table.y, every, table.gaps)
    log = table.time, table.x, table.y
    found = stream(learner, *log, every=every, gaps=table.gaps, watches=[spans])
    scores = found.scores | spans.scores()
    own: dict[str, Any] = {
        "coverage": scores["coverage"],
        "microseconds_per_update": 1e6 * scores["time_per_update"],
        "outcome": scores["outcome"],
    }
    lengths = np.diff(table.time)
    if lengths.max() > PAUSE:
        own["second_flight_frozen"] = _frozen(table, make(), every, int(lengths.argmax()) + 1)
    held: dict[str, Any] = {}
    for target, key in ((own, "nmse"), (held, "persistence")):
        target["second_half"] = scores[f"{key}_second_half_worst"]
        for label in HORIZONS:
            name = f"horizon_{label}_{key}_second_half_worst"
            target[f"horizon_{label}"] = scores.get(name, float("nan"))
    return own, held


def _frozen(table: LogTable, learner: Learner, every: int, pause: int) -> float:
    """Error after a pause, of weights learned before it."""
    identify(table.where(slice(pause)), learner, every=every)
    unseen = evaluate(table.where(slice(pause, None)), learner, every=every)
    return float(unseen.scores["nmse_worst"])

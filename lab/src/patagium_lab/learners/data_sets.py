"""Data sets of the comparison of learners: two flights and a log.

A data set holds samples in order and the networks that may learn them, scaled by what is known
beforehand; nothing is taken from the samples. Neglected: sensors; forces of the flights are those
of inverse dynamics, exact.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.arrays import Array
from patagium.learning.models.network import Network
from patagium.learning.models.registry import network_from_description
from patagium.learning.table_network import network_for
from patagium.robot import load_robot
from patagium.sensing.force.air_force import training_data
from patagium.sensing.logs.importing.import_log import read_table
from patagium_lab.measured.crazyflie import HIDDEN, crazyflie_mapping, in_flight
from patagium_lab.reproduction.cases import FLIGHT_CASES, Span, lever_arms, make_network
from patagium_lab.reproduction.flights import (
    TIME_STEP,
    beat_frequency,
    corrected_flight,
    published_flight,
)

EVERY = 10
"""One sample in this many of a flight is used, which gives 1,000 updates a second."""
LOG_BEAT = 0.1
"""The long horizon of the quadrotor, which has no wingbeat [s]."""
MOVING = 1e-3
"""An output is scored if its standard deviation is at least this share of its scale."""
FIRST = 0.5
"""Duration of the first part of a data set in which outputs must move to be scored [s]."""
_WIDE: dict[str, tuple[dict[str, Span], dict[str, Span]]] = {
    "published": (
        {"x": (0.0, 500.0), "z": (-10.0, 450.0), "pitch": (-1.5, 0.5)},
        {"z": (-10.0, 80.0)},
    ),
    "corrected": ({"x": (-5.0, 15.0), "z": (-25.0, 1.0)}, {"x": (-4.0, 6.0), "z": (-4.0, 2.0)}),
}
"""Ranges of coordinates and velocities that move farther in ten seconds than in two."""


@dataclass(frozen=True)
class DataSet:
    """Samples in order, and the networks that may learn them.

    Attributes:
        name: Key of the data set.
        title: Title on the page.
        note: Description in a sentence or two.
        clock: Time since the start without the gaps, (N,) [s].
        x: States of a flight or inputs of a log, (N, n_x) [SI units].
        y: Outputs that are learned, (N, n_y) [SI units].
        scale: Scale of each output, known beforehand, (n_y,) [as y].
        gaps: First sample after each gap.
        every: One sample in this many is used.
        beat: Long horizon of prediction [s].
        beat_name: Name of the long horizon.
        networks: Descriptions of networks by key: "dense", "linear", "strip".
    """

    name: str
    title: str
    note: str
    clock: Array
    x: Array
    y: Array
    scale: Array
    gaps: tuple[int, ...]
    every: int
    beat: float
    beat_name: str
    networks: dict[str, dict[str, Any]]

    @property
    def step(self) -> float:
        """Time between two samples [s]."""
        return float(np.median(np.diff(self.clock)))

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Whether each output is scored, because it moves from the start, (n_y,)."""
        start = self.y[: max(2, round(FIRST / self.step))]
        return np.asarray(start.std(axis=0) > MOVING * self.scale)

    def network(self, key: str) -> Network:
        """A new network.

        Args:
            key: Key of `networks`.
        """
        return network_from_description(self.networks[key])

    def save(self, folder: Path) -> Path:
        """Write the data set into a file for the workers, and give its path.

        Args:
            folder: Folder of the file.
        """
        words = {key: getattr(self, key) for key in _WORDS}
        path = folder / f"{self.name}.npz"
        arrays = {key: getattr(self, key) for key in _ARRAYS}
        np.savez(path, words=np.array(json.dumps(words)), **arrays)
        return path


_ARRAYS = ("clock", "x", "y", "scale")
_WORDS = ("name", "title", "note", "gaps", "every", "beat", "beat_name", "networks")


@cache
def load_data(path: Path) -> DataSet:
    """Data set from a file.

    Args:
        path: File that `DataSet.save` wrote.
    """
    with np.load(path) as file:
        words = json.loads(str(file["words"]))
        words["gaps"] = tuple(words["gaps"])
        return DataSet(**words, **{key: file[key] for key in _ARRAYS})


def flight_data(name: str, duration: float) -> DataSet:
    """Data set of a flight of the reproduction, two wingbeats longer than the duration.

    Args:
        name: "published" or "corrected".
        duration: Duration [s].
    """
    fly = published_flight if name == "published" else corrected_flight
    beat = 1.0 / beat_frequency(fly(1e-3))
    steps = int(np.ceil((duration + 2 * beat) / TIME_STEP)) + EVERY
    time, x, y = training_data(fly(steps * TIME_STEP))
    subject = FLIGHT_CASES[name]
    envelope, rates = _WIDE[name]
    wide = replace(subject, envelope=subject.envelope | envelope, rates=subject.rates | rates)
    kinds = {"dense": "dense_published", "linear": "inputs"}
    networks = {key: make_network(wide, kind).describe() for key, kind in kinds.items()}
    strip = "strip_midchord" if name == "published" else "strip"
    networks["strip"] = make_network(wide, strip).describe()
    return DataSet(
        name=name,
        title=f"The {name} flight",
        note=_NOTES[name],
        clock=time,
        x=x,
        y=y,
        scale=subject.strip_force * lever_arms(load_robot(subject.robot)),
        gaps=(),
        every=EVERY,
        beat=beat,
        beat_name="one wingbeat",
        networks=networks,
    )


_NOTES = {
    "published": "The published experiment as published, all its errors in it, at 15 Hz: it "
    "gathers 70 m/s in half a second and climbs away.",
    "corrected": "The corrected robot in free flight at 5.9 Hz, nobody at the controls: near "
    "level for two seconds, then it slows, sinks, and from about 5 s on falls backwards.",
}


def log_data(path: str | Path) -> DataSet:
    """Data set of the quadrotor's log in flight, without the pause between its flights.

    Args:
        path: The log, `log16.csv.gz`.

    Raises:
        LogError: If it cannot be read.
    """
    table = in_flight(read_table(path, crazyflie_mapping()))
    kinds: dict[str, Sequence[int]] = {"dense": HIDDEN, "linear": ()}
    step = float(np.median(np.diff(table.time)))
    return DataSet(
        name="crazyflie",
        title="A real log: the Crazyflie quadrotor",
        note="Motor commands and angular rates in, vertical specific force out, at 1 kHz: two "
        "flights of 8 and 6 s, both ending in a fall. What the commands do not tell is noise.",
        clock=np.arange(len(table.time), dtype=float) * step,
        x=table.x,
        y=table.y,
        scale=np.diff(table.output_range, axis=1)[:, 0] / 2,
        gaps=tuple(table.gaps.tolist()),
        every=1,
        beat=LOG_BEAT,
        beat_name="a tenth of a second",
        networks={key: network_for(table, hidden).describe() for key, hidden in kinds.items()},
    )

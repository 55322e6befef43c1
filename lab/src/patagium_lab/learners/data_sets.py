"""What learners are compared on: two flights and a log, and what is known of them beforehand.

A course holds samples in order and the networks that may be taught of them, scaled by what is
known before: nothing is taken from the samples. Neglected: sensors; forces of the flights are
those of inverse dynamics, exact.
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

from patagium.learning.models.network import Network
from patagium.learning.models.registry import network_from_description
from patagium.learning.tables import network_for
from patagium.robot import load_robot
from patagium.sensing.force.training_data import training_data
from patagium.sensing.logs.read_table import read_table
from patagium_lab.measured.crazyflie import HIDDEN, crazyflie_mapping, in_flight
from patagium_lab.reproduction.cases import FLIGHT_CASES, Span, lever_arms, make_network
from patagium_lab.reproduction.flights import (
    TIME_STEP,
    beat_frequency,
    corrected_flight,
    published_flight,
)

Array = NDArray[np.float64]

EVERY = 10
"""One sample in so many of a flight is used: 1,000 updates a second."""
LOG_BEAT = 0.1
"""The long horizon of the quadrotor, which has no wingbeat [s]."""
HEARD = 1e-3
"""An output is scored if it moves by at least this share of its scale."""
FIRST = 0.5
"""It is asked in this first part of a course [s]."""
_WIDE: dict[str, tuple[dict[str, Span], dict[str, Span]]] = {
    "published": (
        {"x": (0.0, 500.0), "z": (-10.0, 450.0), "pitch": (-1.5, 0.5)},
        {"z": (-10.0, 80.0)},
    ),
    "corrected": ({"x": (-5.0, 15.0), "z": (-25.0, 1.0)}, {"x": (-4.0, 6.0), "z": (-4.0, 2.0)}),
}
"""Coordinates and velocities that move farther in ten seconds than in the reproduction's two."""


@dataclass(frozen=True)
class Course:
    """Samples in order, and the networks that may learn them.

    Attributes:
        name: Key of the course.
        title: Its name on the page.
        note: What it is, in a sentence or two.
        clock: Time since the start, gaps closed, (N,) [s].
        x: State, or the inputs of the log, (N, n_x).
        y: What is learned, (N, n_y).
        scale: Of each output, known beforehand, (n_y,), in its unit.
        gaps: First sample after each gap.
        every: One sample in so many is used.
        beat: The long horizon [s].
        beat_name: What it is called.
        networks: Key ("dense", "linear", "strip") to the description of a network.
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
    def heard(self) -> NDArray[np.bool_]:
        """Outputs that are scored, (n_y,): those that move from the start."""
        start = self.y[: max(2, round(FIRST / self.step))]
        return np.asarray(start.std(axis=0) > HEARD * self.scale)

    def network(self, key: str) -> Network:
        """A network made anew.

        Args:
            key: Of `networks`.
        """
        return network_from_description(self.networks[key])

    def save(self, folder: Path) -> Path:
        """Write it for the workers; gives the file.

        Args:
            folder: Where to.
        """
        words = {key: getattr(self, key) for key in _WORDS}
        path = folder / f"{self.name}.npz"
        arrays = {key: getattr(self, key) for key in _ARRAYS}
        np.savez(path, words=np.array(json.dumps(words)), **arrays)
        return path


_ARRAYS = ("clock", "x", "y", "scale")
_WORDS = ("name", "title", "note", "gaps", "every", "beat", "beat_name", "networks")


@cache
def load_course(path: Path) -> Course:
    """What `Course.save` wrote.

    Args:
        path: The file.
    """
    with np.load(path) as file:
        words = json.loads(str(file["words"]))
        words["gaps"] = tuple(words["gaps"])
        return Course(**words, **{key: file[key] for key in _ARRAYS})


def flight_course(name: str, duration: float) -> Course:
    """A flight of the reproduction, two wingbeats longer than asked for.

    Args:
        name: "published" or "corrected".
        duration: [s].
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
    return Course(
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


def log_course(path: str | Path) -> Course:
    """The quadrotor's log while it flies; the pause between its flights is cut out.

    Args:
        path: The log, `log16.csv.gz`.

    Raises:
        LogError: If it cannot be read.
    """
    table = in_flight(read_table(path, crazyflie_mapping()))
    kinds: dict[str, Sequence[int]] = {"dense": HIDDEN, "linear": ()}
    step = float(np.median(np.diff(table.time)))
    return Course(
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

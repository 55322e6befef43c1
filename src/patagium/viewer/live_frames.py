"""Frames that a learner or a simulation sends to its page, about thirty a second.

A frame is the last sample, the scores so far, and the forces since the frame before, thinned,
so that a wingbeat can be plotted although only few of its pictures are drawn. Making one copies
a few kilobytes; nothing is drawn here. Frames travel between two processes through memory they
share, a ring of slots of a fixed layout: one writes, one reads, nobody waits, the oldest are
lost. Samples between frames are not sent.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.arrays import Array, Indices
from patagium.learning.learners.learner import Learner
from patagium.learning.models.network import Network
from patagium.live.loop import Counters
from patagium.live.pipeline import Records
from patagium.robot import Robot
from patagium.sensing.force.air_force import packet_parts

Letter = Any
"""One record (`np.void`) of a mailbox's layout."""


class Mailbox:
    """Ring of letters between a process and one that it spawns.

    A slot's number is taken away while it is written and given when it is whole, so that a
    letter half written is never taken for one.

    Args:
        layout: Fields of a letter, name, kind and shape each.
        slots: Letters that wait at most.
    """

    def __init__(self, layout: Sequence[Any], slots: int) -> None:
        self.layout = np.dtype(list(layout))
        slot = np.dtype([("number", "i8"), ("letter", self.layout)])
        self._memory = get_context("spawn").RawArray("b", 8 + slots * slot.itemsize)
        self._slot, self._seen = slot, 0
        self._attach()

    def __getstate__(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in ("layout", "_memory", "_slot", "_seen")}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        self.__dict__ |= state
        self._attach()

    @property
    def sent(self) -> int:
        """Letters that were put in so far."""
        return int(self._count[0])

    def put(self, letter: Mapping[str, Any]) -> None:
        """Send a letter in place of the oldest one.

        Args:
            letter: Values by field; those not named are zero.
        """
        content = np.zeros((), self.layout)
        for name, value in letter.items():
            content[name] = value
        number = self.sent + 1
        place = number % len(self._slots)
        self._slots["number"][place] = 0
        self._slots["letter"][place] = content
        self._slots["number"][place] = number
        self._count[0] = number

    def take(self) -> list[Letter]:
        """Letters that came since the last call and are not overwritten, oldest first."""
        last = self.sent
        first = max(self._seen, last - len(self._slots)) + 1
        found = []
        for number in range(first, last + 1):
            slot = self._slots[number % len(self._slots)]
            letter = slot["letter"].copy() if slot["number"] == number else None
            if letter is not None and slot["number"] == number:
                found.append(letter)
        self._seen = last
        return found

    def _attach(self) -> None:
        self._count: Indices = np.frombuffer(self._memory, "i8", 1)
        self._slots: NDArray[np.void] = np.frombuffer(self._memory, self._slot, offset=8)


TRACE = 32
"""Samples a frame holds at most, of those since the one before."""
SLOTS = 32
"""Frames that wait for a page that is late: about a second."""
_WORDS = 480  # bytes
COMMAND = (
    ("frequency", "f8"),
    ("amplitude", "f8"),
    ("paused", "?"),
    ("resets", "i8"),
    ("drawn", "i8"),
)
"""Fields of what a page sends back: commands, and the number of frames it drew."""


@dataclass(frozen=True)
class Steering:
    """Range of commands that a page may give to a gait.

    Attributes:
        frequency: Beats a second at first [Hz].
        least: Fewest beats a second [Hz].
        most: Most beats a second [Hz].
        amplitude: Largest excursion over the gait's own that the joints allow.
    """

    frequency: float
    least: float
    most: float
    amplitude: float

    def allows(self, frequency: float, amplitude: float) -> bool:
        """Whether a command is within the range, to rounding.

        Args:
            frequency: Beats a second [Hz].
            amplitude: Excursion over the gait's own [1].
        """
        room = 1.0 + 1e-9
        return self.least <= room * frequency <= room**2 * self.most and (
            0.0 <= amplitude <= room * self.amplitude
        )


@dataclass(frozen=True)
class Subject:
    """Subject of a page: what does not change from frame to frame.

    Attributes:
        robot: The machine.
        outputs: Coordinates whose force of the air is known or learned.
        network: Network that learns; None for none.
        title: Title of the page.
        beat: Duration of a wingbeat [s]; None where unknown.
        steering: Range of its commands; None where it cannot steer.
        strips: Whether the true force on each strip is known.
    """

    robot: Robot
    outputs: tuple[str, ...]
    network: Network | None
    title: str
    beat: float | None = None
    steering: Steering | None = None
    strips: bool = False

    @property
    def layout(self) -> list[Any]:
        """Fields of a frame."""
        m, robot = len(self.outputs), self.robot
        weights = 0 if self.network is None else self.network.size
        return [
            *(("time", "f8"), ("q", "f8", (robot.coordinate_count,)), ("v", "f8", (robot.dof,))),
            *((name, "f8", (m,)) for name in FORCES),
            ("strip_force", "f8", (len(robot.strips) if self.strips else 0, 3)),
            ("weights", "f8", (weights,)),
            *(("trace", "f8", (TRACE, 1 + len(FORCES) * m)), ("traced", "i8")),
            *((name, "f8") for name in ("load", "nmse", "coverage", "time_per_call")),
            *((name, "f8") for name in ("frequency", "amplitude", "share")),
            *((name, "i8") for name in ("samples", "failed")),
            *(("paused", "?"), ("ended", "?"), ("words", f"S{_WORDS}")),
        ]


FORCES = ("measurement", "prediction", "std")
"""Generalized force of the air as it was, as it was predicted, and how sure that was."""


class Feed:
    """Samples as they come, kept as they are until the next frame leaves.

    Args:
        letters: Mailbox for the frames.
        subject: Subject of the page.
        learner: Learner; None where nothing is learned.
    """

    def __init__(self, letters: Mailbox, subject: Subject, learner: Learner | None = None) -> None:
        self._letters, self._subject, self._learner = letters, subject, learner
        self._waiting: list[tuple[Array, Records]] = []
        self._last: dict[str, Any] | None = None

    def append(self, packets: Array, records: Records) -> None:
        """More samples, (k, 1 + n_q + 3 n), and what became of them; they are not copied."""
        self._waiting.append((packets, records))

    def post(self, **facts: Any) -> None:
        """Send a frame: the last sample there is, and facts by the name of their field."""
        if self._waiting:
            self._last = self._samples()
            self._waiting = []
        if self._last is None:
            return
        words = str(facts.pop("words", "")).encode()[:_WORDS]
        self._letters.put(self._last | facts | {"words": words})
        self._last |= {"traced": 0}

    def _samples(self) -> dict[str, Any]:
        packets, records = self._waiting[-1]
        q, v, *_ = packet_parts(packets[-1], self._subject.robot)
        trace = self._trace()
        room = ((0, TRACE - len(trace)), (0, 0))
        found = {"time": packets[-1, 0], "q": q, "v": v}
        found |= {"trace": np.pad(trace, room), "traced": len(trace)}
        found |= {name: getattr(records, name)[-1] for name in FORCES}
        if self._learner is not None and self._subject.network is not None:
            found["weights"] = self._learner.weights
        return found

    def _trace(self) -> Array:
        """Samples since the last frame, thinned: time and forces, (at most TRACE, 1 + 3 m)."""
        times = np.concatenate([packets[:, :1] for packets, _ in self._waiting])
        records = Records(np.concatenate([records.rows for _, records in self._waiting]))
        lines = np.hstack([times, *(getattr(records, name) for name in FORCES)])
        return lines[:: -(-len(lines) // TRACE)]


def counted(counters: Counters) -> dict[str, Any]:
    """Facts of a frame about the samples so far."""
    return {
        "samples": counters.samples,
        "failed": counters.samples - counters.learned,
        "nmse": counters.nmse_mean,
        "coverage": counters.coverage,
        "time_per_call": counters.duration(0.5),
    }


def records_without_learner(force: Array) -> Records:
    """Records of samples of the air's force, (N, m) [N, N m], without a learner."""
    m = force.shape[1]
    rows = np.full((len(force), 3 * m + 4), np.nan)
    rows[:, 2 * m : 3 * m], rows[:, -3:] = force, 0.0
    return Records(rows)

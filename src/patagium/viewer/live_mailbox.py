"""Letters between two processes through memory they share: nobody waits, the oldest are lost.

One process writes, one reads. A letter is a record of fixed layout; the writer puts it into the
next slot of a ring and counts it, the reader copies what has come since it last looked and
notices what was overwritten meanwhile. There is one writer, and all letters have one size.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from multiprocessing import get_context
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
        self._count: NDArray[np.int64] = np.frombuffer(self._memory, "i8", 1)
        self._slots: NDArray[np.void] = np.frombuffer(self._memory, self._slot, offset=8)

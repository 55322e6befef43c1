"""What a network remembers of samples that come one by one, and where its memory begins anew.

`Recollection` is the same for a log that is there as a whole. A sample that the learner refuses
for its stamp or for its input leaves the memory as it was. Neglected: two streams at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import inf, isnan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.errors import Outcome, ShapeError
from patagium.learning.models.network import Carried, Network

Array = NDArray[np.float64]

LONGEST_STEP = 0.01
"""A step up to this is bridged, [s]: short against a wingbeat and the lags of its air, ..."""
USUAL_STEPS = 3.0
"""... and so is one of up to so many usual ones; as long as a gap of an imported log begins."""
UNSEEN = (Outcome.BAD_INPUT, Outcome.LATE, Outcome.DUPLICATE)
"""Outcomes of samples that a learner did not look at."""
_SHARE = 0.01  # of a step in the usual one
_PREFIX = "memory_"


class LiveMemory:
    """Memory of a network from one sample to the next, as `Network.recall` carries it.

    It begins with the first sample, and anew where the stamps go back (and the learner believes
    them) or after a step longer than `LONGEST_STEP` and `USUAL_STEPS` usual ones.

    Args:
        network: What remembers.

    Attributes:
        carried: What `recall` left, moved by what was learned; None before the first sample.
        clock: Last stamp and usual step, (2,) [s].
        resets: How often memory began anew.
    """

    def __init__(self, network: Network) -> None:
        self._network = network
        self.carried: Carried = None
        self.clock = np.array([-inf, np.nan])
        self._next: tuple[float, Carried] | None = None
        self.resets = 0

    @property
    def remembers(self) -> bool:
        """Whether there is anything to remember."""
        return self._network.measured_inputs != self._network.inputs

    def recalled(self, time: float, x: Array, weights: Array) -> Array:
        """Input of the next sample with what is remembered, (n_x,); `settle` must follow.

        Args:
            time: Of the sample [s].
            x: What is measured of the input, (n_measured,).
            weights: That hold there, (n,).
        """
        carried = self.carried if self._follows(time) else None
        rows, found = self._network.recall(weights, np.array([time]), x[None], carried)
        sound = np.isfinite(rows[0, self._network.measured_inputs :]).all()
        self._next = (time, found) if sound else None
        return np.asarray(rows[0])

    def settle(self, outcome: Outcome, change: Array) -> None:
        """The learner is done with that sample.

        Args:
            outcome: What became of it.
            change: By which the weights moved, (n,).
        """
        if self._next is None or outcome in UNSEEN:
            return
        time, found = self._next
        if self.carried is not None:
            self.resets += not self._follows(time)
            self.clock[1] = self._usual_after(time - float(self.clock[0]))
        self.clock[0] = time
        self.carried = self._network.corrected(found, change)

    def state(self) -> dict[str, Array | int]:
        """All that the next samples depend on, by name; nothing without memory."""
        if not self.remembers:
            return {}
        numbers = dict(enumerate(_numbers(self.carried)))
        kept = {f"{_PREFIX}{k}": number.copy() for k, number in numbers.items()}
        return {**kept, f"{_PREFIX}clock": self.clock.copy(), f"{_PREFIX}resets": self.resets}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from a state; one without a memory begins with the next sample.

        Args:
            state: Of a network with the same description.

        Raises:
            ShapeError: If an array has another shape.
        """
        self._next, self.carried = None, None
        if f"{_PREFIX}clock" not in state:
            self.clock, self.resets = np.array([-inf, np.nan]), 0
            return
        self.clock = np.array(state[f"{_PREFIX}clock"], float)
        self.resets = int(state[f"{_PREFIX}resets"])
        if f"{_PREFIX}0" in state:
            network = self._network
            still = np.zeros((1, network.measured_inputs))
            with np.errstate(all="ignore"):  # its numbers mean nothing, only where they stand
                _, like = network.recall(network.initial(0), np.zeros(1), still)
            each = (state[f"{_PREFIX}{k}"] for k in range(len(list(_numbers(like)))))
            self.carried = _filled(like, each)

    def _follows(self, time: float) -> bool:
        last, usual = self.clock.tolist()
        longest = inf if isnan(usual) else max(LONGEST_STEP, USUAL_STEPS * usual)
        return self.carried is not None and 0 < time - last <= longest

    def _usual_after(self, step: float) -> float:
        """The usual step [s] after another one; those back in time say nothing."""
        usual = float(self.clock[1])
        if step <= 0 or isnan(usual):
            return step if step > 0 else usual
        return usual + _SHARE * (min(step, USUAL_STEPS * usual) - usual)


def _numbers(carried: Carried) -> Iterator[Array]:
    """All numbers of what is carried, in order."""
    if isinstance(carried, tuple):
        for part in carried:
            yield from _numbers(part)
    elif carried is not None:
        yield np.asarray(carried, float)


def _filled(like: Carried, numbers: Iterator[Array]) -> Carried:
    """The same with other numbers, as `_numbers` gave them."""
    if isinstance(like, tuple):
        parts = (_filled(part, numbers) for part in like)
        return type(like)._make(parts)  # type: ignore[attr-defined]
    if like is None:
        return None
    number = np.array(next(numbers), float)
    if number.shape != np.shape(like):
        raise ShapeError("memory", np.shape(like), number.shape)
    return float(number) if isinstance(like, float) else number

"""Test for changes of the air or the wing: recent innovations against those before them.

The normalized innovation squared e' P_yy^-1 e of a sample with m channels is chi-square with
m degrees of freedom where the filter is right. Its mean over a window, over its mean over a
longer span before, is then F distributed, and stays so when P_yy is wrong by one factor all
along: a filter that is too sure, or not sure enough, raises no alarm by that alone.
Neglected: correlation of innovations in time, which raises more alarms than it should.
"""

from __future__ import annotations

from math import inf

import numpy as np
from scipy.special import betaincinv

from patagium.learning.settings import ChangeDetection

_RECENT, _BEFORE = 3, 4  # of `numbers`, as in screening.h
_FILLED, _PLACE, _ALARM = 1, 2, 3  # of `whole`
_LARGEST_NIS = 1e6  # of a channel: one wild sample is not remembered for ever


class ChangeMonitor:
    """Running test of one learner, in NumPy as `watch` in `kernels/screening.h`.

    Args:
        detection: What it tests for; None: nothing.
        channels: Number of channels m when none is missing: the limit is that of all of them.
    """

    def __init__(self, detection: ChangeDetection | None, channels: int) -> None:
        self.detection = detection
        self.window = 0 if detection is None else detection.window
        self.reference = 0 if detection is None else detection.reference
        self.ratio = inf if detection is None else _limit(detection, channels)
        self.numbers = np.zeros(5)
        self.whole = np.zeros(5, np.int64)
        self.past = np.zeros(self.window + self.reference)

    @property
    def alarm(self) -> bool:
        """Whether a change was found and `settle` was not called since."""
        return bool(self.whole[_ALARM])

    def settle(self) -> None:
        """Take back the alarm: the learner has acted on it."""
        self.whole[_ALARM] = 0

    def alarmed_by(self, nis: float, channels: int) -> bool:
        """Whether the innovations up to this one are too large; the test then starts anew.

        Args:
            nis: Normalized innovation squared e' P_yy^-1 e.
            channels: How many channels it is of.
        """
        if not self.window:
            return False
        size, place = len(self.past), int(self.whole[_PLACE])
        value, oldest = min(nis / channels, _LARGEST_NIS), self.past[place]
        self.past[place] = value
        self.numbers[_RECENT] += value
        if self.whole[_FILLED] >= self.window:
            moved = self.past[(place - self.window) % size]
            self.numbers[_RECENT] -= moved
            self.numbers[_BEFORE] += moved
        self.whole[_PLACE] = (place + 1) % size
        if self.whole[_FILLED] >= size:
            self.numbers[_BEFORE] -= oldest
        else:
            self.whole[_FILLED] += 1
            if self.whole[_FILLED] < size:
                return False
        recent, before = self.numbers[_RECENT] / self.window, self.numbers[_BEFORE] / self.reference
        if recent <= self.ratio * max(before, 1.0):
            return False
        self.numbers[[_RECENT, _BEFORE]], self.whole[[_FILLED, _PLACE]] = 0.0, 0
        self.whole[_ALARM] = 1
        return True


def _limit(detection: ChangeDetection, channels: int) -> float:
    """Quantile of F at the false alarm rate.

    P(F > x) = I_u(d2 / 2, d1 / 2) with u = d2 / (d2 + d1 x).
    """
    window, reference = detection.window * channels, detection.reference * channels
    share = float(betaincinv(reference / 2, window / 2, detection.false_alarm_rate))
    return reference * (1 - share) / (window * share)

"""Has the air or the wing changed? The last innovations against those before them.

The normalized innovation squared e' P_yy^-1 e of a sample with m channels is chi-square with
m degrees of freedom where the filter is right. Its mean over a window, over its mean over a
longer span before, is then F distributed, and stays so when P_yy is wrong by one factor all
along: a filter that is too sure, or not sure enough, raises no alarm by that alone.
Neglected: correlation of innovations in time, which raises more alarms than it should.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import isfinite

from scipy.stats import f as f_distribution

from patagium.errors import ParameterError


@dataclass(frozen=True)
class ChangeDetection:
    """When a learner takes its weights for outdated, and how far it opens its covariance.

    Where the innovations are white and Gaussian, a sample raises a false alarm with
    probability `false_alarm_rate` at most; after an alarm the test starts anew and is silent
    for window + reference samples.

    Args:
        false_alarm_rate: Of the test at each sample, between 0 and 1.
        window: Samples that are tested; a change is found about so many samples after it.
        reference: Samples before them that they are compared with; a flapping wing's
            innovations differ over the beat, so that one wingbeat is the least.
        reopening: Share s of the prior that comes back, P <- (1 - s) P + s P0, 0 < s <= 1.

    Raises:
        ParameterError: If a number is out of its range.
    """

    false_alarm_rate: float
    window: int
    reference: int
    reopening: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.false_alarm_rate < 1:
            raise ParameterError("false_alarm_rate", "between 0 and 1", self.false_alarm_rate)
        for name, value in (("window", self.window), ("reference", self.reference)):
            if not isinstance(value, int) or value < 1:
                raise ParameterError(name, "a positive integer", value)
        if not (isfinite(self.reopening) and 0 < self.reopening <= 1):
            raise ParameterError("reopening", "above 0 and at most 1", self.reopening)


class ChangeMonitor:
    """The running test of one learner.

    Args:
        detection: What it tests for.
    """

    def __init__(self, detection: ChangeDetection) -> None:
        self.detection = detection
        self._recent: deque[tuple[float, int]] = deque()
        self._before: deque[tuple[float, int]] = deque()
        self._sums = [0.0, 0.0]
        self._channels = [0, 0]
        self._threshold = (0, 0, 0.0)

    def alarmed_by(self, nis: float, channels: int) -> bool:
        """Whether the innovations up to this one are too large; the test then starts anew.

        Args:
            nis: Normalized innovation squared e' P_yy^-1 e.
            channels: How many channels it is of, m.
        """
        self._push(0, self._recent, (nis, channels))
        if len(self._recent) <= self.detection.window:
            return False
        oldest = self._pop(0, self._recent)
        self._push(1, self._before, oldest)
        if len(self._before) < self.detection.reference:
            return False
        if len(self._before) > self.detection.reference:
            self._pop(1, self._before)
        recent, before = (s / max(c, 1) for s, c in zip(self._sums, self._channels, strict=True))
        if recent <= before * self._limit():
            return False
        self.__init__(self.detection)  # type: ignore[misc]
        return True

    def _limit(self) -> float:
        window, reference = self._channels
        if self._threshold[:2] != (window, reference):
            rate = self.detection.false_alarm_rate
            limit = float(f_distribution.isf(rate, max(window, 1), max(reference, 1)))
            self._threshold = (window, reference, limit)
        return self._threshold[2]

    def _push(
        self, span: int, samples: deque[tuple[float, int]], sample: tuple[float, int]
    ) -> None:
        samples.append(sample)
        self._sums[span] += sample[0]
        self._channels[span] += sample[1]

    def _pop(self, span: int, samples: deque[tuple[float, int]]) -> tuple[float, int]:
        sample = samples.popleft()
        self._sums[span] -= sample[0]
        self._channels[span] -= sample[1]
        return sample

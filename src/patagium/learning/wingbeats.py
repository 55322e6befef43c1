"""Times of a log: its wingbeat, the period with which its inputs repeat themselves, and durations.

The period is the first maximum of the autocorrelation of all inputs together, each about its
trend and in units of its own standard deviation. Neglected: a wingbeat whose frequency changes
within the log, of which the mean is found; inputs that repeat themselves less than three times.
"""

from __future__ import annotations

import numpy as np

from patagium.arrays import Array
from patagium.errors import ParameterError
from patagium.robot.units import UnitMismatch, in_si

ALIKE = 0.6
"""Least autocorrelation one period later at which inputs are said to repeat themselves."""
REPEATS = 3
"""Least number of periods in a log."""
_MOST = 16_384  # samples that are looked at
_STILL = 1e-6  # of the largest input, below which one is rounding


def wingbeat_period(time: Array, x: Array) -> float | None:
    """Period with which the inputs repeat themselves [s]; None if they do not.

    Args:
        time: Increasing and about evenly spaced, (N,) [s].
        x: Inputs, (N, n_x) [units of x].

    References:
        Box, Jenkins & Reinsel (2008), Time series analysis, ch. 2: the autocorrelation.
    """
    count = len(time)
    if count < 4 * REPEATS:
        return None
    step, begin = float(time[-1] - time[0]) / (count - 1), max(0, count - _MOST) // 2
    period = _period(x[begin : begin + _MOST])
    if period is None and begin:  # slower than the middle is long: means keep what is slow
        width = -(-count // _MOST)
        means = x[: count - count % width].reshape(-1, width, x.shape[1]).mean(axis=1)
        step, period = step * width, _period(means[:, means.std(axis=0) > 0.5 * x.std(axis=0)])
    return None if period is None else period * step


def _period(seen: Array) -> float | None:
    """Period of evenly spaced inputs, (N, n_x), in steps; None if they do not repeat themselves."""
    count = len(seen)
    place = np.arange(count)
    line = np.polynomial.polynomial.polyfit(place, seen, 1)
    signal = seen - np.polynomial.polynomial.polyval(place, line).T
    size = signal.std(axis=0)
    moving = size > _STILL * np.abs(seen).max(axis=0, initial=0.0)
    if not moving.any():
        return None
    spectrum = np.fft.rfft(signal[:, moving] / size[moving], 2 * count, axis=0)
    correlation = np.fft.irfft((np.abs(spectrum) ** 2).sum(axis=1))[: count // REPEATS + 1]
    correlation /= np.arange(count, count - len(correlation), -1)
    correlation /= correlation[0]
    negative = np.flatnonzero(correlation < 0)
    if not len(negative):
        return None
    later = correlation[negative[0] :]
    high = np.flatnonzero(later >= max(ALIKE, 0.9 * float(later.max())))
    if not len(high):
        return None
    first = int(negative[0] + high[0])
    peak = first + int(np.argmax(correlation[first : first + first // 4 + 2]))
    if peak + 1 >= len(correlation):
        return None
    before, top, after = correlation[peak - 1 : peak + 2]
    bend = before - 2 * top + after
    shift = 0.5 * float(before - after) / float(bend) if bend < 0 else 0.0
    return peak + shift


def duration(name: str, value: float | str) -> float:
    """Positive time in seconds, from a number or text such as "100ms".

    Args:
        name: Name of the argument, for the message.
        value: Number [s], or text with a unit of time.

    Raises:
        ParameterError: If it is no time or not positive.
    """
    try:
        found = in_si(value.item() if isinstance(value, np.generic) else value, "s", "a time")
    except UnitMismatch:
        found = -1.0
    if not found > 0:
        raise ParameterError(name, "a positive time such as '100 ms', or a number [s]", value)
    return found

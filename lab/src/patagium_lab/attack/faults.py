"""Faults of sensors, wires and clocks in a stream of samples, drawn from a seed.

Each fault changes a stretch of a stream and gives the counts that a learner should have. Neglected:
faults that look right sample by sample, such as a slow drift of a sensor.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from patagium.arrays import Array, Indices

LONGEST = 200
"""Samples of the longest fault."""
STUCK_SAMPLES = 10
"""Samples of one value after which a channel is left out: noise does not repeat itself."""
_POSITION = 3
"""Inputs that say where the robot is."""
CLEAR = 300.0
"""Standard deviations of the noise beyond which any network should detect a spike."""
CLOCK_RUN = 10
"""Late samples in a row after which a learner should believe the clock."""


class Feed(NamedTuple):
    """Samples in the order in which a learner gets them.

    Attributes:
        time: Stamps, (M,) [s].
        x: Inputs, (M, n_x) [units of x].
        y: Measurements, (M, n_y) [unit of y].
        sample: Number of each sample in the flight, (M,) [1].
    """

    time: Array
    x: Array
    y: Array
    sample: Indices

    def taken(self, rows: slice | Indices) -> Feed:
        """Some of the samples, or all in another order.

        Args:
            rows: Rows that are taken.
        """
        return Feed(self.time[rows], self.x[rows], self.y[rows], self.sample[rows])


class Faulted(NamedTuple):
    """A feed with a fault in it.

    Attributes:
        feed: Samples that the learner gets.
        exact: Event to the count that it adds, no more and no less.
        least: Event to the count that it adds at least.
        last: Last sample of the flight that the fault touches.
    """

    feed: Feed
    exact: dict[str, int]
    least: dict[str, int]
    last: int


Fault = Callable[[np.random.Generator, Feed, int, Array], Faulted]


def not_a_number(draw: np.random.Generator, feed: Feed, begin: int, std: Array) -> Faulted:
    """Channels that are NaN or infinite for a while, one of them or all.

    Args:
        draw: Generator of lengths and places.
        feed: The clean samples.
        begin: First sample touched.
        std: Standard deviation of the measurement, (n_y,) [as y].
    """
    end = begin + _length(draw)
    channels = _channels(draw, feed.y.shape[1])
    feed = _copy(feed)
    values = draw.choice([np.nan, np.inf, -np.inf], (end - begin, len(channels)))
    feed.y[begin:end, channels] = values
    blind = end - begin if len(channels) == feed.y.shape[1] else 0
    return Faulted(feed, {"missing": values.size, "blind": blind}, {}, end - 1)


def no_input(draw: np.random.Generator, feed: Feed, begin: int, std: Array) -> Faulted:
    """Inputs that are NaN or infinite for a while; see `not_a_number`.

    All but the position, which a strip network does not look at: it learns without it.
    """
    end, feed = begin + _length(draw), _copy(feed)
    place = draw.integers(_POSITION, feed.x.shape[1], size=end - begin)
    feed.x[np.arange(begin, end), place] = draw.choice([np.nan, np.inf, -np.inf], end - begin)
    return Faulted(feed, {"bad_inputs": end - begin}, {}, end - 1)


def spikes(draw: np.random.Generator, feed: Feed, begin: int, std: Array) -> Faulted:
    """Single measurements off by a hundred standard deviations, or by absurdly large numbers.

    Of every ten samples one is hit at most, in a channel that is not silent. A hundred times the
    noise of 2 % are two of the signal: what a poor network predicts no better than that, it
    cannot call an outlier. See `not_a_number` for the arguments.
    """
    count = int(draw.integers(1, LONGEST // 10))
    feed = _copy(feed)
    samples = begin + 10 * np.arange(count) + draw.integers(10, size=count)
    channels = draw.choice(np.flatnonzero(std > 0.01 * std.max()), count)
    size = draw.choice([100.0, 100.0, CLEAR, 1e4, 1e30, 1e300], count)
    feed.y[samples, channels] += size * draw.choice([-1.0, 1.0], count) * std[channels]
    return Faulted(feed, {}, {"outliers": int((size >= CLEAR).sum())}, int(samples[-1]))


def input_spikes(draw: np.random.Generator, feed: Feed, begin: int, std: Array) -> Faulted:
    """Single inputs off by up to their whole range, or beyond all reason; see `spikes`."""
    count = int(draw.integers(1, LONGEST // 10))
    feed = _copy(feed)
    samples = begin + 10 * np.arange(count) + draw.integers(10, size=count)
    channels = draw.integers(feed.x.shape[1], size=count)
    size = draw.choice([1.0, 1.0, 1e3, 1e30, 1e300], count) * draw.choice([-1.0, 1.0], count)
    feed.x[samples, channels] += size * np.ptp(feed.x, axis=0)[channels]
    return Faulted(feed, {}, {}, int(samples[-1]))


def stuck(draw: np.random.Generator, feed: Feed, begin: int, std: Array) -> Faulted:
    """Channels that repeat one value; see `not_a_number`."""
    end = begin + int(draw.integers(STUCK_SAMPLES + 1, LONGEST))
    channels = _channels(draw, feed.y.shape[1])
    feed = _copy(feed)
    feed.y[begin:end, channels] = feed.y[begin, channels]
    left_out = end - begin - STUCK_SAMPLES + 1
    blind = left_out if len(channels) == feed.y.shape[1] else 0
    return Faulted(feed, {"stuck": left_out * len(channels), "blind": blind}, {}, end - 1)


def gap(draw: np.random.Generator, feed: Feed, begin: int, std: Array) -> Faulted:
    """Samples that never come; see `not_a_number`."""
    end = begin + _length(draw)
    kept = np.delete(np.arange(len(feed.time)), np.arange(begin, end))
    return Faulted(feed.taken(kept), {}, {}, end - 1)


def duplicates(draw: np.random.Generator, feed: Feed, begin: int, std: Array) -> Faulted:
    """Samples that come twice or more, with their stamps; see `not_a_number`."""
    end = begin + _length(draw)
    times = np.ones(len(feed.time), np.int64)
    times[begin:end] += draw.integers(0, 4, size=end - begin)
    order = np.repeat(np.arange(len(times)), times)
    extra = len(order) - len(times)
    return Faulted(feed.taken(order), {"duplicates": extra}, {}, end - 1)


def out_of_order(draw: np.random.Generator, feed: Feed, begin: int, std: Array) -> Faulted:
    """Samples that come a few places later, by when they are late; see `not_a_number`."""
    count = int(draw.integers(1, LONGEST // 10))
    order = np.arange(len(feed.time))
    for place in (begin + 10 * np.arange(count)).tolist():
        delay = int(draw.integers(1, CLOCK_RUN - 1))
        order[place : place + delay + 1] = np.roll(order[place : place + delay + 1], -1)
    last = begin + 10 * count
    return Faulted(feed.taken(order), {"late": count}, {}, last)


def clock_jump(draw: np.random.Generator, feed: Feed, begin: int, std: Array) -> Faulted:
    """A clock that jumps, ahead or back, for good or for one sample; see `not_a_number`."""
    feed = _copy(feed)
    jump = float(draw.choice([1e-3, 1.0, 1e9]) * draw.uniform(1, 2))
    late = {"late": CLOCK_RUN - 1, "clock_resets": 1}
    kind = draw.integers(4)
    if kind == 0:  # ahead for good
        feed.time[begin:] += jump
        return Faulted(feed, {"late": 0, "clock_resets": 0}, {}, begin)
    if kind == 1:  # back for good, beyond the start of the flight
        feed.time[begin:] -= 1.0 + jump
        return Faulted(feed, late, {}, begin + CLOCK_RUN)
    if kind == 2:  # ahead for one sample: all that follow are behind it
        feed.time[begin] += 1.0 + jump
        return Faulted(feed, late, {}, begin + CLOCK_RUN)
    feed.time[begin] = draw.choice([np.inf, -np.inf])  # no clock at all
    return Faulted(feed, {"late": 1, "clock_resets": 0}, {}, begin)


def storm(draw: np.random.Generator, feed: Feed, begin: int, std: Array) -> Faulted:
    """All of it at once, at random; see `not_a_number`."""
    end, feed = begin + _length(draw), _copy(feed)
    odd = np.array([np.nan, np.inf, -np.inf, 1e308, -1e200, 1e30, 1e-320, 0.0])
    for part, share in ((feed.x[begin:end], 0.02), (feed.y[begin:end], 0.1)):
        hit = draw.random(part.shape) < share
        part[hit] = draw.choice(odd, int(hit.sum()))
    order = np.arange(len(feed.time))
    order[begin:end] = begin + draw.integers(end - begin, size=end - begin)
    return Faulted(feed.taken(order), {}, {}, end - 1)


FAULTS: dict[str, Fault] = {
    "not a number": not_a_number,
    "no input": no_input,
    "spikes": spikes,
    "input spikes": input_spikes,
    "stuck": stuck,
    "gap": gap,
    "duplicates": duplicates,
    "out of order": out_of_order,
    "clock jump": clock_jump,
    "storm": storm,
}
"""Faults of samples by name."""


def _length(draw: np.random.Generator) -> int:
    return int(draw.integers(1, LONGEST))


def _channels(draw: np.random.Generator, count: int) -> Indices:
    some = int(draw.choice(np.array([1, int(draw.integers(1, count + 1)), count])))
    return draw.choice(count, some, replace=False)


def _copy(feed: Feed) -> Feed:
    return Feed(feed.time.copy(), feed.x.copy(), feed.y.copy(), feed.sample)

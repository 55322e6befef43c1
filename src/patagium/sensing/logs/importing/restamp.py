"""Stamps of rows that were sampled evenly, whatever their stamps in the file say.

A mapping that says `restamp: 100 Hz` states that the sensor took the rows at this rate, and that
their stamps tell when they were written. Row k is then at t_0 + (k + l) / rate. t_0 is the median
difference to the stamps in the file, and l the number of rows that were lost before row k: after a
gap, stamps go on later by whole steps. Where they jump back, as a counter that wraps or a clock
that is set, they go on by one step. A rate that the stamps contradict is refused.
Neglected: a sensor whose rate changes; rows that were lost within the jitter or a block of rows.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from patagium.arrays import Array, Bools
from patagium.errors import LogError
from patagium.sensing.logs.files.channels import NO_STAMP, Stamps

_WINDOW = 50
"""Rows beside a gap whose stamps tell how many rows were lost in it."""
_SPREAD = (0.1, 0.9)
"""Quantiles between which most stamps beside a gap lie; rows lost move them by more."""
_CATCH_UP = 1000
"""Rows after a gap of which some are on time again where none was lost."""
_EARLIEST = 0.02
"""Quantile of the delays of rows that were not late."""
_MOVED = 0.99
"""Steps by which the delay of a row falls below that of the one before, if both share a stamp."""
_MOST_GAPS = 0.1
"""Share of the steps that may be gaps."""
_BACK = 10.0
"""Steps beyond which a stamp that is too early is of a clock that jumped back."""
_ENDS = 10
"""Share of the rows, as 1 / 10, whose stamps at both ends tell a drift."""
_TRIES = 10
"""Rates after which the one that is found is good enough to propose."""


def restamped(stamps: Stamps, rate: float, gap: float, where: str) -> tuple[Stamps, str]:
    """Evenly spaced stamps of rows, and the assumption in one sentence.

    Args:
        stamps: Stamps of the file, (N,) [ns]; `NO_STAMP` where a row has none.
        rate: Rate at which the rows were sampled [Hz].
        gap: Length from which a step is a gap, in steps.
        where: File and stream, for messages.

    Returns:
        Increasing stamps, (N,) [ns], and what was assumed and found.

    Raises:
        LogError: If the rows were not sampled at this rate; the message states the one found.
    """
    step, rows = 1e9 / rate, np.arange(len(stamps))
    known = np.flatnonzero(stamps != NO_STAMP)
    words = f"rows are taken as sampled at {rate:g} Hz without a change of rate"
    if len(known) < 2:
        return np.rint(rows * step).astype(np.int64), f"{words}; they have no stamps of their own"
    origin = int(stamps[known[0]])
    own = step  # that of the stamps, in which other rows are lost than by the stated one
    for _ in range(_TRIES):
        late = (stamps[known] - origin).astype(float) - known * own
        back, wraps = _set_back(late, own)
        late -= back
        lost, gaps = _lost(late, own, gap)
        if len(gaps) > _MOST_GAPS * len(late):
            lost, gaps = np.zeros(len(late)), gaps[:0]  # the rate is another one
        late -= lost * own
        drift, span = _drift(late, known)
        if abs(drift) <= gap * own:
            break
        own += drift / span
    if own != step:
        raise LogError(
            f"{where}: restamp: expected rows {step / 1e9:.6g} s apart, but their stamps are "
            f"{own / 1e9:.6g} s apart on average; say `restamp: {1e9 / own:.6g} Hz`, or leave "
            "restamp out if the rate changes"
        )
    start = float(np.median(late))
    shift = np.zeros(len(stamps))
    shift[known[gaps]] = np.diff(lost, prepend=0.0)[gaps]
    grid = rows + np.cumsum(shift)
    off = late - start
    some = f"{int(lost[-1])} row(s) as lost in {len(gaps)} gap(s)"
    words += f", and {some if len(gaps) else 'none as lost'}"
    if wraps:
        words += f"; {wraps} time(s) their clock jumped back, and no row was lost then"
    rms, most = np.sqrt(np.mean(off**2)) / 1e9, np.abs(off).max() / 1e9
    words += f"; the stamps in the file differ from this by {rms:.3g} s (rms), at most {most:.3g} s"
    return np.rint(grid * step + start).astype(np.int64) + origin, words


def _set_back(late: Array, step: float) -> tuple[Array, int]:
    """Time by which the clock was set back before each row, (k,) [ns], and how often."""
    back, found = np.zeros(len(late)), 0
    for place, change, _ in _jumps(late, np.diff(late) < -_BACK * step):
        if change < -_BACK * step:  # else the rows before only waited to be written
            back[place:] += change
            found += 1
    return back, found


def _jumps(late: Array, far: Bools) -> Iterator[tuple[int, float, float]]:
    """First row after each large step in time, the delay from there on, and its spread [ns]."""
    ends = [0, *(np.flatnonzero(far) + 1).tolist(), len(late)]
    for before, place, following in zip(ends, ends[1:-1], ends[2:], strict=False):
        earlier = late[max(before, place - _WINDOW) : place]
        later = late[place : min(following, place + _WINDOW)]
        spread = max(float(np.ptp(np.quantile(one, _SPREAD))) for one in (earlier, later))
        yield place, float(np.median(later) - np.median(earlier)), spread


def _lost(late: Array, step: float, gap: float) -> tuple[Array, Stamps]:
    """Number of rows lost before each row, (k,), and the rows after a gap."""
    lost, found = np.zeros(len(late)), []
    steps = np.diff(late)
    far = steps > (gap - 1.0) * step
    moved = np.flatnonzero(steps > -_MOVED * step)
    if len(moved) and moved[-1] < len(steps) - 1:
        far[moved[-1]] = False  # rows that share the last stamp do not tell whether they are late
    for place, change, spread in _jumps(late, far):
        if change > max(spread, step / 2):
            usual = float(np.median(late[max(0, place - _WINDOW) : place]))
            on_time = float(np.quantile(late[place : place + _CATCH_UP], _EARLIEST))
            if on_time > usual + step / 2:  # else the rows only waited to be written
                lost[place:] += np.rint(change / step)
                found.append(place)
    return lost, np.array(found, np.int64)


def _drift(late: Array, known: Stamps) -> tuple[float, float]:
    """Growth of the delay from the first rows to the last [ns], and the rows between them."""
    share = max(1, len(late) // _ENDS)
    first, last = (float(np.quantile(one, _EARLIEST)) for one in (late[:share], late[-share:]))
    return last - first, float(np.median(known[-share:]) - np.median(known[:share]))

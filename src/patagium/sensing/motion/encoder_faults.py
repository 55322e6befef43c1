"""Samples of an encoder that contradict the others: drop-outs, and a counter that was reset.

A jump is a step that no motion before and after it makes. Of the pieces between jumps the longest
chain of those that continue each other is taken as the joint, all others are left out. Neglected:
jumps less than ten samples apart, and a reset in a gap of the stamps.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from patagium.arrays import Array, Bools, Indices, count_noise

_BESIDE = 10
"""Samples before and after a step that tell the motion."""
_AWAY = 10.0
"""Least size of a jump over what steps beside it scatter by."""
_FASTER = 4.0
"""Step of a jump over all those beside it; a sample that was lost makes one of two."""
_SWING = 0.3
"""Least motion between jumps over the largest of them: less is of positions held in turn."""
_SHORT = 20
"""Samples that a joint may be lost for, and be where it can have moved to."""
_SAME = 0.1
"""Share of the largest jump by which pieces at the same zero may differ."""
_ABRUPT = 8.0
"""Fastest step over one beside which a joint that stands still does not slow down."""
_BACK = 40
"""Pieces over which a chain may leave out others."""


def jumps_of(values: Array) -> tuple[Indices, Array]:
    """Samples after which an angle jumps, (n_jumps,), and how far, less the motion, (n_jumps,).

    Args:
        values: Angles without whole turns, (N,) [any unit]; NaN where some are missing.
    """
    none: tuple[Indices, Array] = np.empty(0, np.int64), np.empty(0)
    if len(values) <= 4 * _BESIDE:
        return none
    change = np.nan_to_num(np.diff(np.pad(values, _BESIDE, mode="edge")))
    windows = sliding_window_view(change, 2 * _BESIDE + 1)
    near = np.s_[_BESIDE - 2 : _BESIDE + 3]
    others = np.delete(windows, near, axis=1)
    usual = np.median(others, axis=1, keepdims=True)
    before, away, after = (windows[:, near] - usual).T[1:4]
    onward = np.maximum(
        before * np.sign(away), after * np.sign(away)
    )  # of a motion of some samples
    scatter = np.maximum(np.abs(others - usual).max(axis=1), onward)
    scatter = np.maximum(scatter, 2 * count_noise(values[np.isfinite(values)]))
    size = np.abs(windows[:, _BESIDE])
    faster = size > _FASTER * np.abs(others).max(axis=1)
    jumps = np.flatnonzero(faster & (np.abs(away) > _AWAY * scatter))
    parts = [one[np.isfinite(one)] for one in np.split(values, jumps + 1)]
    swing = max(float(np.ptp(one)) for one in parts if len(one))
    if not len(jumps) or swing <= _SWING * size[jumps].max():
        return none
    return jumps, away[jumps]


def steady_angles(values: Array) -> Bools:
    """Whether each sample of an encoder continues the others, (N,).

    Args:
        values: Angles without whole turns, (N,) [any unit]; NaN where some are missing.
    """
    jumps, away = jumps_of(values)
    used = np.ones(len(values), bool)
    if not len(jumps):
        return used
    jumps, away = _with_ways_back(values, jumps, away)
    steps = np.abs(np.diff(values))
    steps[jumps] = np.nan
    fastest = float(np.nanmax(steps))
    first, last = np.append(0, jumps + 1), np.append(jumps, len(values) - 1)
    zero = np.append(0.0, np.cumsum(away))
    still = [bool(np.ptp(values[a : b + 1]) <= 0) for a, b in zip(first, last, strict=True)]
    lost = np.append(0, np.cumsum(np.where(still, 0, last - first + 1)))  # where it moved

    def continues(before: int, after: int) -> bool:
        gone = lost[after] - lost[before + 1]
        way = abs(values[first[after]] - values[last[before]])
        reached = way <= fastest * (first[after] - last[before])
        same = abs(zero[after] - zero[before]) < _SAME * np.abs(away).max()
        return after > before + 1 and bool((gone < _SHORT and reached) or same)

    length = (last - first + 1).astype(float)
    best, chosen = length.copy(), np.full(len(length), -1)
    for k in range(len(length)):
        for j in range(max(0, k - _BACK), k):
            if best[j] + length[k] > best[k] and continues(j, k):
                best[k], chosen[k] = best[j] + length[k], j
    used[:], k = False, int(best.argmax())
    while k >= 0:
        used[first[k] : last[k] + 1] = True
        k = int(chosen[k])
    return used


def _with_ways_back(values: Array, jumps: Indices, away: Array) -> tuple[Indices, Array]:
    """Jumps, and the other ends of what they begin or end, which are too small to be one.

    Where the angle goes on as if there were no jump, the sample before it and the one after it are
    pieces of their own, and so is what stands still beside a jump and in the midst of a motion.
    """
    places = np.clip(jumps[:, None] + [-2, 0, 1, 3], 0, len(values) - 1)
    early, before, after, late = values[places].T
    stays = np.abs(late - early - 5 * (after - before - away)) > 0.5 * np.abs(away)
    apart = np.diff(np.pad(jumps, 1, constant_values=(-_BESIDE, len(values) + _BESIDE)))
    steps = np.abs(np.diff(values))
    lone = ~stays & (apart[1:] > 3) & (apart[:-1] > 3)
    moves = np.concatenate([[-1], np.flatnonzero(steps), [len(steps)]])
    place = np.searchsorted(moves, jumps)  # a jump is a step, too
    ends = np.concatenate([moves[place - 1], moves[place + 1]])  # of what stands still beside it
    beyond = np.clip(ends + np.repeat([-1, 1], len(jumps)), 0, len(steps) - 1)
    abrupt = steps[beyond] > np.delete(steps, jumps).max() / _ABRUPT
    stuck = ends[abrupt & (np.abs(ends - np.tile(jumps, 2)) > _SHORT)]
    every = np.concatenate([jumps, jumps[lone] - 1, jumps[lone] + 1, stuck])
    sizes = np.concatenate([away, np.zeros(lone.sum()), -away[lone], np.zeros(len(stuck))])
    inside = (every >= 0) & (every < len(values) - 1)
    ends, place = np.unique(every[inside], return_inverse=True)
    return ends, np.bincount(place, sizes[inside]).astype(float)

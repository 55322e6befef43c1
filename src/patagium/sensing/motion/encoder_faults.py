"""Jumps of an encoder, of drop-outs and of a counter that was reset.

A jump is a step that no motion before and after it makes. Neglected: jumps three to ten samples
apart, and a reset in a gap of the stamps.
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
_APART = 3
"""Samples from a step from which others tell the motion."""
_BRIEF = 3
"""Most samples between a jump and the one back that are a drop-out."""


def jumps_of(values: Array) -> tuple[Indices, Array]:
    """Index of the last sample before each jump of an angle, and its size, (n_jumps,) each.

    Args:
        values: Angles without whole turns, (N,) [any unit]; NaN where some are missing.
    """
    none: tuple[Indices, Array] = np.empty(0, np.int64), np.empty(0)
    if len(values) <= 4 * _BESIDE:
        return none
    change = np.nan_to_num(np.diff(np.pad(values, _BESIDE, mode="edge")))
    size = np.abs(change)
    beside = [size[_BESIDE + k : len(size) - _BESIDE + k] for k in (-_APART, _APART)]
    size = size[_BESIDE:-_BESIDE]
    steps = np.flatnonzero(size > _FASTER * np.maximum(*beside))  # few, of which all is looked at
    windows = sliding_window_view(change, 2 * _BESIDE + 1)[steps]
    near = np.s_[_BESIDE - _APART + 1 : _BESIDE + _APART]
    others = np.delete(windows, near, axis=1)
    usual = np.median(others, axis=1, keepdims=True)
    before, away, after = (windows[:, near] - usual).T[1:4]
    onward = np.maximum(before, after, where=away > 0, out=-np.minimum(before, after))
    scatter = np.maximum(np.abs(others - usual).max(axis=1), onward)
    scatter = np.maximum(scatter, 2 * count_noise(values[np.isfinite(values)]))
    faster = size[steps] > _FASTER * np.abs(others).max(axis=1)
    found = faster & (np.abs(away) > _AWAY * scatter)
    jumps, away = steps[found], away[found]
    parts = [one[np.isfinite(one)] for one in np.split(values, jumps + 1)]
    swing = max(float(np.ptp(one)) for one in parts if len(one))
    if not len(jumps) or swing <= _SWING * size[jumps].max():
        return none
    return jumps, away


def dropped_out(values: Array) -> Bools:
    """Whether each sample of an encoder is between a jump and the one back, (N,).

    Args:
        values: Angles without whole turns, (N,) [any unit]; NaN where some are missing.
    """
    jumps, away = jumps_of(values)
    found = np.zeros(len(values), bool)
    back = (np.diff(jumps) <= _BRIEF) & (away[1:] * away[:-1] < 0)
    for begin, end in zip(jumps[:-1][back], jumps[1:][back], strict=True):
        found[begin + 1 : end + 1] = True
    return found

"""Jumps of an encoder, of drop-outs and of a counter that was reset.

A jump is a step that no motion before and after it makes. Neglected: drop-outs by less than
four steps of the motion, those in the first or last samples, and a reset in a gap of the stamps.
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
_ALIKE = 3.0
"""Most times that the step back from a drop-out is of the one to it, or the other way."""
_BRIEF = 50
"""Most samples between a jump and the one back that are a drop-out."""


def jumps_of(values: Array) -> tuple[Indices, Array]:
    """Index of the last sample before each jump of an angle, and its size, (n_jumps,) each.

    Args:
        values: Angles without whole turns, (N,) [any unit]; NaN where some are missing.
    """
    none: tuple[Indices, Array] = np.empty(0, np.int64), np.empty(0)
    if len(values) <= 4 * _BESIDE:
        return none
    onwards = np.pad(values, _BESIDE, mode="reflect", reflect_type="odd")  # as it moves there
    change = np.nan_to_num(np.diff(onwards))
    size = np.abs(change)
    near = np.s_[_BESIDE - _APART + 1 : _BESIDE + _APART]
    least = sliding_window_view(np.minimum(size[1:], size[:-1]), 2 * _BESIDE)
    beside = least[:, [_BESIDE - _APART - 1, _BESIDE + _APART]].max(axis=1)
    size = size[_BESIDE:-_BESIDE]
    usual = np.median(np.append(size[size > 0], 0.0))
    steps = np.flatnonzero(size > _FASTER * np.maximum(beside, usual))  # few, all looked at
    windows = sliding_window_view(change, 2 * _BESIDE + 1)[steps]
    share = -windows / windows[:, [_BESIDE]]  # of the step, by which others lead back
    alike, back = share.max(axis=1), share.argmax(axis=1) - _BESIDE
    back[(alike < 1 / _ALIKE) | (alike > _ALIKE)] = 0
    along = np.arange(-_BESIDE, _BESIDE + 1) * np.sign(back)[:, None]
    others = np.where((along > 0) & (along <= np.abs(back)[:, None]), np.nan, windows)
    others[:, near] = np.nan
    usual = np.nanmedian(others, axis=1, keepdims=True)
    before, away, after = (windows[:, near] - usual).T[1:4]
    onward = np.maximum(before, after, where=away > 0, out=-np.minimum(before, after))
    scatter = np.maximum(np.nanmax(np.abs(others - usual), axis=1), onward)
    scatter = np.maximum(scatter, 2 * count_noise(values[np.isfinite(values)]))
    faster = size[steps] > _FASTER * np.nanmax(np.abs(others), axis=1)
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
    apart = np.diff(jumps, prepend=-np.inf, append=np.inf)  # the shorter way is the fault
    back = (apart[1:-1] < np.minimum(apart[:-2], _BRIEF + 1)) & (apart[1:-1] <= apart[2:])
    back &= away[1:] * away[:-1] < 0
    for begin, end in zip(jumps[:-1][back], jumps[1:][back], strict=True):
        found[begin + 1 : end + 1] = True
    return found

"""What `kernels/screening.h` calls a screening: constants, and addresses of a `Screen`'s arrays.

Neglected: who frees what; the filter that holds the one holds the other.
"""

from __future__ import annotations

import ctypes

from patagium.learning.filters.screening import Screen

_INTEGERS = ("channels", "stuck_samples", "window", "reference")
_NUMBERS = ("limit", "share", "ratio")
_ARRAYS = (
    *("numbers", "whole", "counts", "noise", "steady", "loaded", "smallest", "load", "mean_load"),
    *("extra", "last", "still", "moved", "left_out", "past", "stated"),
)


class _Screening(ctypes.Structure):
    """`screening` of the kernels, field by field."""

    _fields_ = [
        *((name, ctypes.c_int32) for name in _INTEGERS),
        *((name, ctypes.c_double) for name in _NUMBERS),
        *((name, ctypes.c_void_p) for name in _ARRAYS),
    ]


def screening_structure(screen: Screen) -> _Screening:
    """The memory of a screen as a compiled filter takes it.

    Args:
        screen: Whose arrays, shared by address; it must outlive the structure.
    """
    arrays = {**screen.arrays, "stated": screen.stated}
    return _Screening(
        channels=len(arrays["noise"]),
        stuck_samples=screen.stuck_samples,
        window=screen.monitor.window,
        reference=screen.monitor.reference,
        limit=screen.limit,
        share=screen.share,
        ratio=screen.monitor.ratio,
        **{name: arrays[name].ctypes.data for name in _ARRAYS},
    )

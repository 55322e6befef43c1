"""Arrays of real numbers as a caller gives them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from numbers import Real
from reprlib import Repr
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from patagium.errors import LogError, ParameterError

Array: TypeAlias = NDArray[np.float64]
Bools: TypeAlias = NDArray[np.bool_]
Indices: TypeAlias = NDArray[np.int64]

_SHORT = Repr()
_SHORT.maxstring = _SHORT.maxother = 60


def brief(record: Any) -> str:
    """Representation of a dataclass in one line: arrays by their shape, long values shortened.

    Args:
        record: A dataclass, which takes this as its `__repr__`.
    """
    said = []
    for one in fields(record):
        value = getattr(record, one.name)
        if isinstance(value, np.ndarray):
            text = f"array{value.shape}"
        elif isinstance(value, Mapping):
            text = f"{{{', '.join(map(str, value))}}}"
        else:
            text = _SHORT.repr(value)
        said += [f"{one.name}={text[:200]}"] if one.repr else []
    return f"{type(record).__name__}({', '.join(said)})"


def rising(times: Any) -> Array:
    """Times of samples, checked to increase, (N,) [s], as float64.

    Args:
        times: Numbers, each above the one before.

    Raises:
        ParameterError: If they are no numbers.
        LogError: If one is not finite, or not above the one before.
    """
    stamps = real_array("time", times).ravel()
    for k in np.flatnonzero(~((np.diff(stamps) > 0) & np.isfinite(stamps[1:]))):
        found = f"{stamps[k + 1]:.9g} s after {stamps[k]:.9g} s at sample {k + 1}"
        raise LogError(f"time: expected to advance, found {found}")
    return stamps


def real_array(name: str, values: Any) -> Array:
    """Array of real numbers, as float64.

    Args:
        name: The argument.
        values: Numbers in any nesting; no text, dates, complex or masked numbers, which NumPy
            would turn into other numbers without a word.

    Raises:
        ParameterError: If they are of another kind.
    """
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values
    try:
        found = np.asarray(values)
        hidden = np.ma.isMaskedArray(values) and np.ma.is_masked(values)
        if found.dtype.kind in "fiub" and not hidden:
            return found.astype(np.float64)
        if found.dtype.kind == "O" and all(isinstance(one, Real) for one in found.flat):
            return found.astype(np.float64)
        kind = "masked numbers" if hidden else f"an array of {found.dtype}"
    except (ValueError, TypeError, OverflowError, RuntimeError) as problem:  # 33 dimensions too
        kind = str(problem)[:200]
    raise ParameterError(name, "real numbers", kind)

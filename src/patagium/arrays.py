"""Arrays of real numbers as a caller gives them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from numbers import Real
from reprlib import Repr
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from patagium.errors import LogError, ParameterError, ShapeError

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


def equal(record: Any, other: object) -> bool:
    """Whether two records of one class hold the same numbers and words.

    Args:
        record: A dataclass, which takes this as its `__eq__`.
        other: Anything.
    """
    names = [one.name for one in fields(record)]
    alike = (np.array_equal(getattr(record, k), getattr(other, k)) for k in names)
    return type(record) is type(other) and all(alike)


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
        raise LogError("time", "to advance", found)
    return stamps


def usual_step(times: Array) -> float:
    """Mean of the steps of increasing times near their median [s]: rounding averages out."""
    steps = np.diff(times)
    return float(steps[np.abs(steps / np.median(steps) - 1) <= 0.5].mean())


def stored(record: Any, name: str, *dims: Any) -> Array:
    """Variable of a Dataset as float64, its dimensions in the order of those named, if any."""
    return np.asarray((record[name].transpose(*dims) if dims else record[name]).values, float)


def means_between(values: Array, at: Array, ends: Array) -> Array:
    """Means of values, (N,), between ends, (K + 1,), of what joins them by lines, (K,).

    Args:
        values: One value a place, (N,) [any unit].
        at: Rising places, (N,) [any unit].
        ends: Rising places between which means are taken, (K + 1,) [of the places].
    """
    places = np.union1d(ends, at[(at > ends[0]) & (at < ends[-1])])
    found = np.interp(places, at, values)
    pieces = np.diff(places) * (found[1:] + found[:-1]) / 2
    firsts = np.searchsorted(places, ends[:-1])
    return np.asarray(np.add.reduceat(pieces, firsts) / np.diff(ends))


def classic_step(
    rate: Callable[[Array, int], Array], state: Array, place: int, time_step: float
) -> Array:
    """State a step later by classic Runge-Kutta, (size,) [SI].

    Args:
        rate: Rate of a state at a place of time, of which there are two a step.
        state: At the beginning, (size,) [SI].
        place: Place of the beginning.
        time_step: Step [s].
    """
    k1 = rate(state, place)
    k2 = rate(state + 0.5 * time_step * k1, place + 1)
    k3 = rate(state + 0.5 * time_step * k2, place + 1)
    k4 = rate(state + time_step * k3, place + 2)
    return state + time_step / 6.0 * ((k1 + k4) + 2.0 * (k2 + k3))


def median_step(times: Any) -> float:
    """Median of the steps of times [s]."""
    return float(np.median(np.diff(times)))


def find_gaps(time: Any, factor: float = 3.0) -> Indices:
    """Index of the first sample after each gap, (n_gaps,).

    Args:
        time: Increasing times, (N,) [s].
        factor: Length from which a step is a gap, in median steps.
    """
    steps = np.diff(np.asarray(time, float))
    if not len(steps):
        return np.empty(0, np.int64)
    return np.flatnonzero(steps > factor * np.median(steps)) + 1


def runs(chosen: Bools) -> Indices:
    """Index of the first sample of each run of True, and of the one after its last, (n_runs, 2).

    Args:
        chosen: (N,) bools.
    """
    edges = np.diff(chosen, prepend=False, append=False)
    return np.flatnonzero(edges).reshape(-1, 2)


def selected(kept: Any, count: int) -> Indices:
    """Indices of selected samples, in order.

    Args:
        kept: Slice, increasing indices, or a bool for each sample.
        count: Number of samples.

    Raises:
        ParameterError: If it is something else.
    """
    try:
        found = np.arange(count)[kept if isinstance(kept, slice) else np.asarray(kept)]
        if np.ndim(found) == 1 and (np.diff(found) > 0).all():
            return found
    except (IndexError, OverflowError, TypeError, ValueError):
        pass
    expected = f"a slice, increasing indices or a bool for each of {count} samples"
    raise ParameterError("kept", expected, kept)


def real_array(name: str, values: Any, shape: tuple[int | str, ...] | None = None) -> Array:
    """Array of real numbers, as float64.

    Args:
        name: The argument.
        values: Numbers in any nesting; no text, dates, complex or masked numbers, nor True in a
            list, which NumPy would turn into other numbers without a word.
        shape: Shape that is expected, "N" first where any length will do; None: any.

    Raises:
        ParameterError: If they are of another kind.
        ShapeError: If the shape is another.
    """
    found, kind = values, ""
    if type(values) is not np.ndarray or values.dtype != np.float64:
        try:
            found = np.asarray(values)
            odd = f"an array of {found.dtype}" if found.ndim else f"a {type(values).__name__}"
            odd = "" if _of_reals(found) else odd
            kind = "masked numbers" if np.ma.is_masked(values) else odd
            kind = "True or False" if _holds_flag(values) else kind
            found = found if kind else found.astype(np.float64)
        except (ValueError, TypeError, OverflowError, RuntimeError) as problem:  # 33 dimensions too
            kind = str(problem)[:200] or type(problem).__name__
            kind = f"a {type(values).__name__}" if isinstance(values, Mapping) else kind
    if kind:
        named = _REMEDIES.get(type(values).__name__, "")
        raise ParameterError(name, f"real numbers{named}", kind)
    if shape is not None:
        first = int(shape[:1] == ("N",) and found.ndim > 0)
        if found.shape[first:] != shape[first:]:
            raise ShapeError(name, shape, found.shape)
    return np.asarray(found)


_REMEDIES = {
    "dict": ", such as robot.coordinates(x=3.0) gives",
    "Dataset": ", such as those of one variable (pt.evaluate(flight, model) takes a flight)",
}


def _holds_flag(values: Any) -> bool:
    listed = isinstance(values, list | tuple)
    return any(map(_holds_flag, values)) if listed else isinstance(values, bool)


def _of_reals(array: Any) -> bool:
    kind = array.dtype.kind
    return kind in "fiub" or (kind == "O" and all(isinstance(one, Real) for one in array.flat))


def thin(indices: Indices, most: int) -> Indices:
    """Indices thinned evenly to at most `most`; the first and the last are kept."""
    if len(indices) <= most:
        return indices
    return np.asarray(indices[np.linspace(0, len(indices) - 1, most).round().astype(int)])


def count_noise(values: Array) -> float:
    """Standard deviation of rounding to counts of an encoder or digits of a text.

    Args:
        values: Samples of a number, (N,) [any unit].

    Returns:
        The standard deviation [unit of the values]; 0 if the values do not lie on a grid.
    """
    seen = values[np.isfinite(values)]
    steps = np.abs(np.diff(seen))
    steps = steps[steps > 1e-9 * np.abs(seen).max(initial=0.0)]
    if len(steps) < 10 or len(np.unique(seen)) > 0.8 * len(seen):  # values of a grid come again
        return 0.0
    counts = steps / steps.min()
    if (np.abs(counts - counts.round()) < 0.05).mean() < 0.95:
        return 0.0
    return float(steps.min() / np.sqrt(12.0))

"""Arguments of functions and records, checked against their annotations where they enter."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from inspect import signature
from numbers import Integral
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from patagium.errors import ParameterError, is_finite

_Function = TypeVar("_Function", bound=Callable[..., Any])
_WORDS = {
    float: "a finite number",
    int: "a whole number",
    bool: "True or False",
    str: "text",
    type(None): "None",
}
_EXAMPLES = {
    "Robot": "a Robot such as pt.load_robot('aerobat')",
    "Orbit": "an Orbit such as pt.trim(robot)",
    "Aerodynamics": "a model of the air such as pt.QuasiSteady(robot)",
    "Gait": "a gait such as pt.gaits.cruise(robot)",
    "LoopController": "a controller such as pt.control.LinearRegulator(orbit, commands)",
    "Event": "an event such as pt.control.GustEvent(...)",
    "Dataset": "a flight such as pt.load_flight('flight.nc')",
    "Mount": "a Mount such as pt.mounts.fixed()",
}
_LARGEST = 2**63  # whole number


def checked(function: _Function) -> _Function:
    """Function that refuses arguments of other kinds than its annotations say.

    Args:
        function: Function or method; its options may be those of a typed dictionary.
    """
    known = signature(function)

    @wraps(function)
    def entered(*given: Any, **named: Any) -> Any:
        try:
            found = known.bind(*given, **named).arguments
        except TypeError:  # Python says it in its own words
            return function(*given, **named)
        kinds = _kinds(function)
        for name, value in {**found, **found.get("options", {})}.items():
            if name in kinds and name != "options":
                of_kind(name, value, kinds[name])
        return function(*given, **named)

    return entered  # type: ignore[return-value]


def check_fields(record: Any) -> None:
    """Refuse a dataclass with a field of another kind than its annotation says.

    Args:
        record: The dataclass, whose `__post_init__` calls this.
    """
    for name, value in vars(record).items():
        of_kind(name, value, _kinds(type(record)).get(name, Any))


def of_kind(name: str, value: object, kind: Any) -> None:
    """Refuse an argument of another kind.

    Args:
        name: The argument.
        value: What was given.
        kind: Annotation: a type, a union, a sequence or a mapping.

    Raises:
        ParameterError: If it is of another kind.
    """
    if not _fits(value, kind):
        raise ParameterError(name, _words(kind), value)


@cache
def _kinds(owner: Any) -> dict[str, Any]:
    """Annotations of a function with its typed options, or of a class."""
    kinds = get_type_hints(owner)
    options = get_args(kinds.get("options"))
    return kinds | (get_type_hints(options[0]) if options else {})


def _fits(value: Any, kind: Any) -> bool:
    """Whether a value is what an annotation says; unknown annotations fit."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return complex in inner or any(_fits(value, one) for one in inner)  # or it is ArrayLike
    if kind is float:
        return is_finite(value)
    if kind is int:
        return isinstance(value, Integral) and is_finite(value) and abs(value) < _LARGEST
    if kind is bool:
        return isinstance(value, bool | np.bool_)
    if origin is Literal:
        return isinstance(value, str) and value in inner
    if origin is np.ndarray:
        return isinstance(value, np.ndarray) and _is_real(value)
    if origin is Mapping:
        pairs = value.items() if isinstance(value, Mapping) else [(None, None)]
        return all(
            _fits(part, way) for pair in pairs for part, way in zip(pair, inner, strict=True)
        )
    if origin in (Sequence, tuple):
        items = inner if origin is tuple and ... not in inner else inner[:1] * _length(value)
        return len(items) == _length(value) and all(map(_fits, value, items))
    kind = origin or kind
    if not isinstance(kind, type) or kind.__dict__.get("_is_runtime_protocol") is False:
        return True
    return kind in type(value).__mro__ or isinstance(value, kind)


def _is_real(value: Any) -> bool:
    return value.dtype.kind in "fiu" and bool(np.isfinite(value).all())


def _length(value: Any) -> int:
    """Number of items of a sequence or an array that is none of text; -1 of other things."""
    listed = isinstance(value, np.ndarray) and value.ndim and not np.ma.isMaskedArray(value)
    sequence = isinstance(value, Sequence) and not isinstance(value, str | bytes)
    return len(value) if listed or sequence else -1


def _words(kind: Any) -> str:
    """Annotation in words."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return " or ".join(_words(one) for one in inner)
    if origin is Literal:
        return f"one of {', '.join(inner)}"
    if origin is Mapping:
        return f"a mapping of {_words(inner[0])} to {_words(inner[1])}"
    if origin in (Sequence, tuple):
        count = "" if origin is Sequence or ... in inner else f"{len(inner)} times "
        return f"a list of {count}{_words(inner[0])}"
    if origin is np.ndarray:
        return "an array of finite numbers"
    kind = origin or kind
    name = getattr(kind, "__name__", "value")
    return _WORDS.get(kind) or _EXAMPLES.get(name, f"a {name}")

"""Arguments of functions and records, checked against their annotations where they enter."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from inspect import Parameter, signature
from math import isfinite
from numbers import Integral
from types import MappingProxyType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import real_array
from patagium.errors import ParameterError, is_finite, plain, similar

Progress = Callable[[int, int], None]
"""Function that is told the work done and the work in all."""
_Function = TypeVar("_Function", bound=Callable[..., Any])
_WORDS = MappingProxyType({
    "float": "a finite number", "int": "a whole number below 2^63",
    "bool": "True or False", "str": "text",
    "Mapping": "a mapping", "Robot": "a Robot such as pt.load_robot('aerobat')",
    "Orbit": "an Orbit such as pt.trim(robot)", "Reference": "an Orbit such as pt.trim(robot)",
    "LoopController": "a function of time and state with an attribute `period` in seconds",
    "Gait": "a gait such as pt.gaits.cruise(robot)",
    "Aerodynamics": "a model of the air such as pt.QuasiSteady(robot)",
    "Event": "an Event such as pt.control.GustEvent(...)",
    "Callable": "a function", "Estimator": "a function",
    "Dataset": "a Dataset such as pt.load_flight('flight.nc')",
    "LogTable": "a LogTable such as pt.sensing.read_table('log.csv', 'map.yaml')",
    "Learner": "a learner such as pt.CubatureLearner(network)",
    "Trained": "a model such as pt.load_model('model.json')",
    "NoneType": "None", "ndarray": "finite numbers", "Mount": "a Mount such as pt.mounts.fixed()",
})  # fmt: skip
_LARGEST = 2**63  # whole number


def checked(function: _Function) -> _Function:
    """Decorator that checks the types of the arguments against the annotations.

    An array without axes enters as its number, also one within a dictionary; a list as an array.

    Args:
        function: Function or method; a keyword that it does not know is a TypeError.
    """
    known = signature(function).parameters
    ordered = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
    names = [name for name, one in known.items() if one.kind in ordered]
    rest = next((name for name, one in known.items() if one.kind is Parameter.VAR_KEYWORD), "")

    @wraps(function)
    def entered(*given: Any, **named: Any) -> Any:
        kinds = _kinds(function)
        if not rest and (unknown := sorted(named.keys() - known.keys())):
            hint = similar(unknown[0], list(known))
            expected = f"expected one of {', '.join(sorted(known.keys() - {'self'}))}{hint}"
            raise TypeError(f"unexpected keyword argument {unknown[0]!r}, {expected}")
        first = [_entering(name, one, kinds) for name, one in zip(names, given, strict=False)]
        others = {
            name: _entering(name, one, kinds if name in known else {name: kinds.get(rest, Any)})
            for name, one in named.items()
        }
        return function(*first, *given[len(names) :], **others)

    return entered  # type: ignore[return-value]


def _entering(name: str, value: Any, kinds: Mapping[str, Any]) -> Any:
    """Argument as it enters: the number of an array without axes where a number will do."""
    kind, number = kinds.get(name, Any), plain(value)
    if get_origin(_meant(kind)) is np.ndarray:
        value = real_array(name, value)
    if number is not value and _fits(number, kind):
        value = number
    of_kind(name, value, kind)
    return value


def check_fields(record: Any) -> None:
    """Check the types of a dataclass's fields; NumPy values become plain Python values."""
    owner: Any = type(record)
    kinds = _kinds(owner)
    for name, value in [(name, plain(value)) for name, value in vars(record).items()]:
        of_kind(name, value, kind := kinds[name])
        either = get_origin(kind) in (Union, UnionType)
        origins = [get_origin(one) for one in (get_args(kind) if either else (kind,))]
        if tuple in origins and _listed(value) and not isinstance(value, tuple):
            value = tuple(np.asarray(value).tolist())
        elif Mapping in origins and isinstance(value, Mapping):
            value = dict(value)
        object.__setattr__(record, name, value)


def of_kind(name: str, value: object, kind: Any) -> None:
    """Refuse an argument whose type is not that of its annotation.

    Args:
        name: Name of the argument.
        value: What was given.
        kind: Annotation: a type, a union, a sequence or a mapping.

    Raises:
        ParameterError: If the type is another, or a seed or a number of steps is below zero.
    """
    if not _fits(value, kind):
        raise ParameterError(*_misfit(name, value, kind))
    if name in ("seed", "steps") and isinstance(value, Integral) and int(value) < 0:
        raise ParameterError(name, "a whole number, zero or more", value)


def _misfit(name: str, value: Any, kind: Any) -> tuple[str, str, Any]:
    """Name of what does not fit, what was expected, and what it is: the value within a mapping."""
    either = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    inner = next((get_args(one) for one in either if get_origin(one) is Mapping), ())
    if inner and isinstance(value, Mapping):
        for key, found in value.items():
            if not _fits(key, inner[0]):
                return f"{name}: a name", _words(inner[0]), key
            if not _fits(found, inner[1]):
                return _misfit(f"{name}: {key}", found, inner[1])
    if isinstance(value, float) and value.is_integer() and _fits(int(value), kind):
        return name, f"a whole number such as {int(value)}", value
    return name, _words(kind), value


@cache
def _kinds(owner: Any) -> dict[str, Any]:
    """Type hints of a function or a class."""
    return get_type_hints(owner)


def _meant(kind: Any) -> Any:
    """Annotation that an alias stands for, as NumPy has them since 2.5; Any for ArrayLike."""
    alias = get_origin(kind) or kind
    if not hasattr(alias, "__value__"):
        return kind
    return Any if alias is ArrayLike else alias.__value__[get_args(kind)]


def _fits(value: Any, kind: Any) -> bool:
    """Whether the type of a value is that of an annotation; any value fits an unknown one."""
    kind = _meant(kind)
    if type(value) is kind and kind is not int:
        return kind is not float or isfinite(value)
    origin, inner = get_origin(kind), get_args(kind)
    if kind is Any:
        return True
    if origin in (Union, UnionType):
        return complex in inner or any(_fits(value, one) for one in inner)  # or it is ArrayLike
    if kind is float:
        return is_finite(value)
    if kind is int:
        return isinstance(value, Integral) and is_finite(value) and abs(float(value)) < _LARGEST
    if origin is Literal:
        return isinstance(value, str) and value in inner
    if origin is Mapping and isinstance(value, Mapping):
        return all(_fits(key, inner[0]) and _fits(value[key], inner[1]) for key in value)
    if origin in (Sequence, tuple):
        count = len(value) if _listed(value) else -1
        kinds = inner if origin is tuple and ... not in inner else inner[:1] * count
        return len(kinds) == count and all(map(_fits, value, kinds))
    kind = bool | np.bool_ if kind is bool else origin or kind
    if getattr(kind, "_is_protocol", False):  # the nearest that can be asked for at run time
        if isinstance(value, type):  # the class in place of one of its kind
            return False
        kind = next((one for one in kind.__mro__ if vars(one).get("_is_runtime_protocol")), object)
    if isinstance(kind, type | UnionType):
        told = kind in type(value).__mro__  # a protocol may compile what it looks for
        if not (told or isinstance(value, kind)):
            return False
        return origin is not np.ndarray or (value.dtype.kind in "fiu" and np.isfinite(value).all())
    return True


def _listed(value: Any) -> bool:
    """Whether a value is a sequence or an array, and none of text or masked."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0 and not np.ma.isMaskedArray(value)
    return isinstance(value, Sequence) and not isinstance(value, str | bytes | bytearray)


def _words(kind: Any) -> str:
    """Words of an error message that say which type an annotation asks for."""
    kind = _meant(kind)
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Literal:
        return f"one of {', '.join(inner)}"
    if origin in (Union, UnionType):
        return " or ".join(map(_words, inner))
    if origin in (Sequence, tuple):
        some = "a list" if origin is Sequence or ... in inner else f"{len(inner)} numbers"
        return f"{some}, each {_words(inner[0])}"
    name = getattr(origin or kind, "__name__", "value")
    return _WORDS.get(name, f"{'an' if name[0] in 'AEIOU' else 'a'} {name}")

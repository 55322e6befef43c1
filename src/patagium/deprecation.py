"""Old names of arguments, which work for one release and say what they are called now."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

Call = TypeVar("Call", bound=Callable[..., Any])
Kind = TypeVar("Kind")


def with_new_names(
    given: Mapping[str, Any], names: Mapping[str, str], stacklevel: int = 3
) -> dict[str, Any]:
    """Arguments by their names of today.

    Args:
        given: Values by name of the argument.
        names: Old name to new name.
        stacklevel: Frames between the warning and the caller whose line it names.

    Raises:
        TypeError: If an argument is given by its old and its new name.
    """
    found = {name: value for name, value in given.items() if name not in names}
    for old in (name for name in given if name in names):
        if names[old] in given:
            raise TypeError(f"{old} is the old name of {names[old]}: give one of them")
        message = f"the argument {old} is called {names[old]}; the next release drops it"
        warnings.warn(message, DeprecationWarning, stacklevel=stacklevel)
        found[names[old]] = given[old]
    return found


def renamed_arguments(**names: str) -> Callable[[Call], Call]:
    """Decorator of a function that still takes old names of its keyword arguments.

    Args:
        **names: Old name to new name.
    """

    def decorated(call: Call) -> Call:
        @functools.wraps(call)
        def renaming(*args: Any, **given: Any) -> Any:
            if given.keys().isdisjoint(names):
                return call(*args, **given)
            return call(*args, **with_new_names(given, names))

        return renaming  # type: ignore[return-value]

    return decorated


def renamed_fields(**names: str) -> Callable[[type[Kind]], type[Kind]]:
    """Decorator of a class whose constructor still takes old names of its arguments.

    Args:
        **names: Old name to new name.
    """

    def decorated(kind: type[Kind]) -> type[Kind]:
        setattr(kind, "__init__", renamed_arguments(**names)(vars(kind)["__init__"]))  # noqa: B010
        return kind

    return decorated

"""Descriptions of dataclasses by the values of their fields, and objects made again from them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

from patagium.errors import ParameterError, check_names

_Kind = TypeVar("_Kind")


def field_values(described: Any) -> dict[str, Any]:
    """Values of the fields of a dataclass by name, as JSON-able values; tuples are lists."""
    return {field.name: plainly(getattr(described, field.name)) for field in fields(described)}


def plainly(value: Any) -> Any:
    """Value as JSON can hold it: tuples and arrays as lists, objects by their own describe()."""
    if isinstance(value, tuple):
        return [plainly(one) for one in value]
    if isinstance(value, dict):
        return {name: plainly(one) for name, one in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if hasattr(value, "describe"):
        return value.describe()
    return field_values(value) if is_dataclass(value) else value


def from_field_values(what: str, kind: type[_Kind], description: Mapping[str, Any]) -> _Kind:
    """Object of a dataclass from the values of its fields by name.

    Raises:
        ParameterError: If a key is missing or unknown.
    """
    check_keys(what, description, {field.name for field in fields(kind)})  # type: ignore[arg-type]
    return kind(**description)


def check_keys(what: str, description: Mapping[str, Any], known: Iterable[str]) -> None:
    """Refuse a description whose keys are not exactly the known ones.

    Raises:
        ParameterError: If a key is missing or unknown.
    """
    if set(description) != set(known):
        raise ParameterError(what, f"the keys {sorted(known)}", sorted(description))


def from_named_description(
    what: str, kinds: Iterable[type[Any]], description: Mapping[str, Any]
) -> Any:
    """Object of the dataclass whose `name` a description gives, its fields from the other keys.

    Args:
        what: Name of what the dataclasses describe, for messages: "gust", "polar".
        kinds: Dataclasses with a class attribute `name`.
        description: Name and values, as `describe()` gives them.

    Raises:
        ParameterError: If the name is unknown, or a key is missing or unknown.
    """
    by_name = {kind.name: kind for kind in kinds}
    values = dict(description)
    name = values.pop("name", None)
    check_names(what, [name], by_name)
    return from_field_values(f"{what} {name}", by_name[name], values)

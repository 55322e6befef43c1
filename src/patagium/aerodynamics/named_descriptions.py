"""Objects made again from a description that gives a name and the values of all fields."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any

from patagium.errors import ParameterError


def check_keys(what: str, description: Mapping[str, Any], known: Iterable[str]) -> None:
    """Refuse a description whose keys are not exactly the known ones.

    Args:
        what: Name of the thing described, for the message.
        description: The description.
        known: Keys it must have.

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
    if name not in by_name:
        raise ParameterError(what, f"one of {', '.join(by_name)}", name)
    kind = by_name[name]
    check_keys(f"{what} {name}", values, {field.name for field in fields(kind)})
    return kind(**values)

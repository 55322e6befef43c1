"""Valid call of a function, which hostile arguments are put into."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Valid:
    """Valid call of a function.

    Attributes:
        function: The function, or class.
        given: Its arguments by name.
        takes: Names of further arguments that it may have.
        passes: Whether numbers beyond all measure pass through to a result that is not finite.
    """

    function: Callable[..., Any]
    given: Mapping[str, Any]
    takes: tuple[str, ...] = ()
    passes: bool = False

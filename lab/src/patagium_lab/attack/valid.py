"""Correct call of a function, whose arguments the attack replaces by wrong ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Valid:
    """Function with correct arguments, some of which the attack replaces by wrong ones.

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

"""Former package `patagium.identification`: its names work for one release, with a warning.

They are now in `patagium.learning`, `patagium.sensing` and `patagium.live`.
"""

from __future__ import annotations

from typing import Any

from patagium.deprecation import FORMER, former_name

__all__ = [*sorted(FORMER[__name__])]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    return former_name(__name__, name, ())

"""Former package `patagium.identification`: its names work for one release, with a warning.

They are now in `patagium.learning`, `patagium.sensing` and `patagium.live`.
"""

from __future__ import annotations

from typing import Any

from patagium.deprecation import former_name, former_names

__all__ = [*sorted(former_names(__name__))]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    return former_name(__name__, name, ())

"""`patagium cache`: where compiled libraries are kept, how many, how large; and their removal."""

from __future__ import annotations

from typing import Annotated

import typer

from patagium.cli.options import JsonOption
from patagium.cli.words import answer

EXAMPLES = ("patagium cache", "patagium cache --clear")


def cache(
    clear: Annotated[
        bool, typer.Option("--clear", help="Remove all that no build is using now.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Say where compiled libraries are kept, how many they are, and how large; or remove them.

    Removing them costs only the time to compile them again.
    """
    from patagium.native.cache import BOUND, cache_folder, items, tidy

    removed = tidy(0) if clear else []
    held = items()
    facts = {
        "folder": str(cache_folder()),
        "libraries": sum(item.path.suffix == ".so" for item in held),
        "files_and_folders": len(held),
        "size_MB": round(sum(item.size for item in held) / 1e6, 1),
        "bound_MB": round(BOUND / 1e6, 1),
    }
    if clear:
        facts |= {
            "removed": len(removed),
            "removed_MB": round(sum(item.size for item in removed) / 1e6, 1),
        }
    answer(facts, as_json=as_json)

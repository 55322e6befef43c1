"""Walks through the program: how many modules a setting and a sample pass on their way."""

from __future__ import annotations

import re
from pathlib import Path

from .debts import within
from .source_tree import ROOT
from .walks import SPREAD, holds, sample_walk, spread_walk


def told(name: str) -> list[str]:
    """Modules that docs/architecture.md lists for a walk, in order."""
    text = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    part = text.split(f"<!-- {name} -->")[1].split("<!--")[0]
    paths = re.findall(r"^\d+\. `([\w/]+)\.py`", part, re.MULTILINE)
    return ["patagium." + path.replace("/", ".") for path in paths]


def test_a_number_is_found_in_records_and_sequences() -> None:
    assert holds({"a": (1.0, [SPREAD])}, SPREAD) and not holds({"a": (1.0,)}, SPREAD)


def test_the_walk_of_a_setting_is_short(tmp_path: Path) -> None:
    """Traced for `--spread` of `patagium stream`, from the command line to the kernel in C."""
    found = spread_walk(tmp_path)
    assert found[0].startswith("patagium.cli.")
    assert found[-1].startswith("patagium.learning.filters.")
    within("modules on the walk of spread", found)
    assert told("walk of spread") == found


def test_the_walk_of_a_sample_is_short(tmp_path: Path) -> None:
    """Traced for a line of a log of `patagium stream`, from its packet to the weights."""
    found = sample_walk(tmp_path)
    assert found[0] == "patagium.live.packets" and "patagium.live.pipeline" in found
    within("modules on the walk of a sample", found)
    assert told("walk of a sample") == found

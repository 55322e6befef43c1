"""Changed parameters written into a robot file's text.

A robot's source travels with every flight, so a calibrated or damaged robot has
to say in it what differs: in the block `parameters`, which is applied last.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

import yaml

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # calibration comes here often
_BLOCK = re.compile(r"^parameters:[^\n]*\n(?:(?:[ \t}#][^\n]*)?\n)*", re.MULTILINE)


def amended_source(source: str, values: Mapping[str, float]) -> str:
    """Text of the robot file with some parameters changed.

    Args:
        source: Text of a valid robot file.
        values: New values by parameter name [SI].

    Returns:
        The same text with one block `parameters` at its end.
    """
    described = _parsed(source)
    known = described.pop("parameters", None) or {}
    kept = _BLOCK.sub("", source + "\n").rstrip("\n") + "\n"
    if _parsed(kept) != described:  # the block was written in an unusual way
        kept = yaml.safe_dump(described, sort_keys=False)
    changed = {**known, **{name: float(value) for name, value in values.items()}}
    block = "".join(f"  {json.dumps(k)}: {json.dumps(v)}\n" for k, v in changed.items())
    return f"{kept}parameters:\n{block}" if changed else kept


def _parsed(text: str) -> Any:
    return yaml.load(text, Loader=_LOADER)

"""Trials kept as they end, so that a search that was stopped goes on where it was.

A journal is a text file: its first line says which question its trials answer, each other
line is one trial as JSON, flushed to the disk before the next. A line that was cut short by
a crash is dropped. Neglected: two searches that write to one journal at the same time; they
do no harm, but may both do the same trial.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from math import inf, nan
from pathlib import Path
from typing import Any

from patagium.errors import LogError, Outcome
from patagium.learning.scores import json_ready
from patagium.learning.tuning.foresight import Foresight
from patagium.whole_file import write_whole

FORMAT = "patagium trials 1"


class Journal:
    """The trials of one question, in memory and, where there is a file, on disk.

    Args:
        question: What all trials have in common, JSON-able.
        path: The file; None: nothing is kept.

    Raises:
        LogError: If the file is not a journal, or answers another question.
    """

    def __init__(self, question: Mapping[str, Any], path: str | Path | None = None) -> None:
        self._path = None if path is None else Path(path)
        self._found: dict[str, Foresight] = {}
        head = json.dumps({"format": FORMAT, **question}, sort_keys=True)
        if self._path is not None and self._path.exists():
            self._read(self._path, json.loads(head))
        elif self._path is not None:
            write_whole(self._path, head + "\n")

    def __len__(self) -> int:
        return len(self._found)

    def found(self, trial: Mapping[str, Any]) -> Foresight | None:
        """What a trial gave; None if it is still to do.

        Args:
            trial: What was tried, JSON-able.
        """
        return self._found.get(_key(trial))

    def keep(self, trial: Mapping[str, Any], foresight: Foresight) -> None:
        """Keep what a trial gave, on disk before this returns.

        Args:
            trial: What was tried, JSON-able.
            foresight: What it gave.
        """
        self._found[_key(trial)] = foresight
        if self._path is None:
            return
        line = json.dumps({"trial": dict(trial), **described_foresight(foresight)})
        with self._path.open("a", encoding="utf-8") as file:
            file.write(line + "\n")
            file.flush()
            os.fsync(file.fileno())

    def _read(self, path: Path, question: Mapping[str, Any]) -> None:
        text = path.read_text(encoding="utf-8", errors="replace")
        head, *lines = text.splitlines() or [""]
        _same_question(path, _object(head), question)
        whole = [head]
        for line in lines:
            kept = _object(line)
            if kept is None:
                continue
            try:
                trial = kept.pop("trial")
                self._found[_key(trial)] = foresight_from(kept)
            except (AttributeError, KeyError, TypeError) as problem:
                raise LogError(f"{path}: expected a trial in each line, found: {line}") from problem
            whole.append(line)
        if len(whole) != len(lines) + 1 or not text.endswith("\n"):
            write_whole(path, "\n".join(whole) + "\n")


def described_foresight(foresight: Foresight) -> dict[str, Any]:
    """A foresight as JSON-able values; what is not finite is null."""
    words: dict[str, Any] = json_ready(asdict(foresight))
    return words | {"outcome": foresight.outcome.name}


def foresight_from(description: Mapping[str, Any]) -> Foresight:
    """Inverse of `described_foresight`.

    Raises:
        KeyError: If there is no such outcome.
        TypeError: If a key is missing or unknown.
    """
    lost = {"log_likelihood": -inf, "log_likelihood_second_half": -inf}
    found: dict[str, Any] = {
        k: lost.get(k, nan) if v is None else v for k, v in description.items()
    }
    return Foresight(**{**found, "outcome": Outcome[found["outcome"]]})


def _same_question(path: Path, found: dict[str, Any] | None, asked: Mapping[str, Any]) -> None:
    if found is None or found.get("format") != FORMAT:
        raise LogError(f"{path}: expected a journal of trials ({FORMAT!r}), found another file")
    for name in sorted({*asked, *found}):
        if found.get(name) != asked.get(name):
            raise LogError(
                f"{path}: expected the trials of this question, found those of another: {name} "
                f"was {found.get(name)!r}, is {asked.get(name)!r}; name another result (--out) "
                "to ask anew, or delete the journal"
            )


def _object(line: str) -> dict[str, Any] | None:
    """A line of JSON; None if it was cut short."""
    try:
        read = json.loads(line)
    except ValueError:
        return None
    return read if isinstance(read, dict) else None


def _key(trial: Mapping[str, Any]) -> str:
    return json.dumps(trial, sort_keys=True)

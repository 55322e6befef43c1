"""What a page says of where its figures come from, and how targets are counted."""

from __future__ import annotations

import os
import re
from datetime import date
from pathlib import Path

import pytest

from patagium_lab.conditions import conditions, load_average, machine
from patagium_lab.targets import count_met, verdict


def test_conditions_name_program_machine_and_day(monkeypatch: pytest.MonkeyPatch) -> None:
    found = conditions()
    assert found["program"].startswith("patagium ")
    assert found["date"] == date.today().isoformat()
    assert all(word in found["machine"] for word in ("cores", "Python", "casadi", "numpy"))
    assert found["load average at the end"]
    monkeypatch.setenv("PATAGIUM_COMPILER", "none")
    assert "no C compiler" in machine()


def test_a_compiler_that_says_nothing_of_itself_has_its_name(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    silent = tmp_path / "quiet-cc"
    silent.write_text('#!/bin/sh\n[ "$1" = --version ] || exec cc "$@"\n', encoding="utf-8")
    silent.chmod(0o755)
    monkeypatch.setattr("patagium_lab.conditions.compiler_command", lambda: (str(silent),))
    assert "quiet-cc, -O2" in machine()


def test_the_load_is_told_or_said_to_be_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "getloadavg", lambda: (8.62, 3.0, 1.0), raising=False)
    assert load_average() == "8.6 (3.0 over 5 minutes, 1.0 over 15)"
    monkeypatch.delattr(os, "getloadavg")
    assert load_average() == "unknown"


def test_a_missed_target_stands_out() -> None:
    rows = [
        {"target": "a", "met": True},
        {"target": "b", "met": False},
        {"target": "c", "met": "not run"},
    ]
    text = count_met(rows)
    assert text == "**1 of 3 targets are met.** Missed: b. Not run: c."
    assert count_met(rows[:1]) == "**1 of 1 targets are met.**"
    assert [verdict(row["met"]) for row in rows] == ["yes", "**no**", "not run"]
    assert not re.search(r"\bno\b", verdict(True))

"""Times of one autopilot step, compiled and in Python, on the same samples."""

from __future__ import annotations

import pytest

import patagium_lab.bench.tick as tick
from patagium.native import compiler_name


@pytest.mark.skipif(compiler_name() is None, reason="needs a C compiler")
def test_ticks_are_timed_beside_their_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tick, "_SETTLING", 100)
    rows = {row.name: row for row in tick.tick_results(600, 30)}
    whole = rows["whole tick: median"]
    assert whole.ratio is not None and whole.value is not None
    assert 0.0 < whole.ratio < 0.5  # a hundredth; loaded machines are no reason to fail
    tail = rows["whole tick: 99 % within"].value
    assert tail is not None and tail >= whole.value
    for name in ("with commands", "with a late sample"):
        row = rows[f"tick {name}: median"]
        assert row.value is not None and row.value > 0.0
        assert 3 < int(row.note.split()[0]) < 100  # of 600 ticks: a beat of 10 and 240 a second

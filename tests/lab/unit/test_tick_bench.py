"""The bench of a tick: each part is timed on samples of sensors, and the tick is their sum."""

from __future__ import annotations

import pytest

import patagium_lab.bench.tick as tick
from patagium.native import compiler_name


@pytest.mark.skipif(compiler_name() is None, reason="needs a C compiler")
def test_parts_of_a_tick_are_timed_and_summed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tick, "BEATS", 2)
    rows = {row.name: row.value for row in tick.tick_results(30)}
    medians = {name: value for name, value in rows.items() if name.endswith(": median")}
    assert len(rows) == 2 * len(medians) == 10
    for name, value in medians.items():
        assert value is not None and 1.0 < value < 1e6  # us
        assert rows[name.replace("median", "99 % within")] >= value
    parts = [value for name, value in medians.items() if "whole" not in name]
    assert max(parts) < medians["whole tick: median"]

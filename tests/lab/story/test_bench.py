"""The bench runs, its lines are whole, and it refuses rivals whose numbers differ."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from patagium.cli.main import run
from patagium.errors import ParameterError, PatagiumError
from patagium.native import compiler_name
from patagium.robot import load_robot
from patagium_lab.bench.dynamics import ARGUMENTS, DynamicsBench
from patagium_lab.bench.plan import GROUPS, QUICK, BenchPlan
from patagium_lab.bench.run import run as run_bench
from patagium_lab.bench.targets import figure_text
from patagium_lab.rivals import energy_rival
from patagium_lab.study import Stages
from patagium_lab.timing import compiled_call, time_call

needs_compiler = pytest.mark.skipif(compiler_name() is None, reason="needs a C compiler")
FIELDS = {"group", "name", "value", "unit", "against", "ratio", "note", "against_value"}


@needs_compiler
def test_lines_are_whole() -> None:
    told: list[tuple[str, float]] = []
    results = run_bench(BenchPlan(("dynamics", "batch")), Stages(lambda *stage: told.append(stage)))
    assert json.loads(json.dumps(results)) == results
    assert all(set(result) == FIELDS for result in results)
    assert results[0]["unit"] == "cores" and "cc" in results[0]["note"]
    alone = {result["name"] for result in results if result["against"] is None}
    assert set(ARGUMENTS) <= alone
    assert {"time taken by dynamics", "load average at the start"} <= alone
    assert {result["group"] for result in results} == {"conditions", "dynamics", "batch"}
    beside = [result for result in results if result["against"]]
    assert len(beside) == len(ARGUMENTS)
    for result in beside:
        assert result["ratio"] == pytest.approx(result["value"] / result["against_value"])
        assert result["value"] > 0
    assert told[0] == ("dynamics", 0.0) and told[-1] == ("done", 1.0)


def test_without_a_compiler_it_says_what_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATAGIUM_COMPILER", "none")
    results = run_bench(BenchPlan(("energy", "mujoco", "pinocchio")), Stages())
    assert "no C compiler" in results[0]["note"]
    left_out = [result for result in results if result["name"] == "rival left out"]
    assert len(left_out) == 3
    assert all(result["value"] is None and "compiler" in result["note"] for result in left_out)


def test_groups_by_name() -> None:
    assert set(QUICK) < set(GROUPS)
    with pytest.raises(ParameterError, match="dynamics"):
        BenchPlan(("speed",))


@needs_compiler
def test_the_command_writes_the_page(tmp_path: Path) -> None:
    page, figures = tmp_path / "page.md", tmp_path / "figures.json"
    with pytest.raises(SystemExit) as left:
        run(["bench", "--only", "dynamics", "-o", str(page), "--json", str(figures)])
    assert not left.value.code
    text = page.read_text("utf-8")
    rows = json.loads(figures.read_text())
    for row in rows[2:9]:
        name, value = row["name"].replace("_", " "), figure_text(row["value"], row["unit"])
        assert f"| {name} | {value} |" in text
    assert rows[0]["note"] in text and rows[1]["note"] in text


@needs_compiler
def test_a_rival_with_other_numbers_is_refused() -> None:
    bench = DynamicsBench(load_robot("yeo-wing"))
    rival = energy_rival.short_rival(bench.robot)
    assert all(result.ratio for result in bench.against(rival))
    heavier = replace(rival, extra=(rival.extra[0] * 1.001,))
    with pytest.raises(PatagiumError, match="disagree on mass_matrix"):
        list(bench.against(heavier))


@needs_compiler
def test_a_compiled_call_is_the_function_itself() -> None:
    bench = DynamicsBench(load_robot("yeo-wing"))
    call = compiled_call(bench.dynamics.functions["gravity"])
    assert call is not None
    q = bench.states.q
    (found,) = call.evaluate([q[2], bench.robot.parameters])
    np.testing.assert_array_equal(found, bench.dynamics.gravity(q[2]))
    nanoseconds = time_call(call, [q, bench.robot.parameters], budget=0.003)
    assert 1 < nanoseconds < 1e6

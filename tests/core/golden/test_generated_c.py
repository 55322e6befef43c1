"""Generated C of two models of the air and of the equations they push, frozen as files.

A change of the writer or of an equation shows here as a diff of the text. Where it is meant,
`make golden` accepts it, and the diff is read again before it is committed.
"""

from __future__ import annotations

import difflib
from functools import cache
from pathlib import Path

import casadi as ca
import pytest
from tests.robots import half_wing

import patagium as pt
from patagium.aerodynamics.model import aero_functions
from patagium.native.emit import emit, emit_batch

TEXTS = Path(__file__).parent / "texts"


@cache
def functions() -> dict[str, ca.Function]:
    """Functions of a wing of one strip, by the name of their golden file."""
    robot = half_wing(1)
    steady = {f.name(): f for f in aero_functions(pt.QuasiSteady(robot))}
    lifting_line = {f.name(): f for f in aero_functions(pt.LiftingLine(robot))}
    return {
        "dynamics_mass_matrix_and_bias": pt.Dynamics(robot).expressions["mass_matrix_and_bias"],
        "quasi_steady_generalized_force": steady["generalized_force"],
        "lifting_line_state_derivative": lifting_line["state_derivative"],
    }


CASES = {
    "dynamics_mass_matrix_and_bias": emit,
    "quasi_steady_generalized_force": emit,
    "quasi_steady_generalized_force_batch": emit_batch,
    "lifting_line_state_derivative": emit,
}


def difference(kept: str, made: str, name: str) -> str:
    """Unified diff from the kept text to the one made now; empty where they are equal."""
    lines = difflib.unified_diff(
        kept.splitlines(), made.splitlines(), f"{name} (golden)", f"{name} (now)", lineterm="", n=2
    )
    return "\n".join(lines)


@pytest.mark.parametrize("name", CASES)
def test_the_c_text_is_the_golden_one(name: str, accepted: bool) -> None:
    made = "".join(CASES[name](functions()[name.removesuffix("_batch")]))
    file = TEXTS / f"{name}.c"
    if accepted:
        file.write_text(made, "utf-8")
    change = difference(file.read_text("utf-8"), made, file.name)
    assert not change, f"{change}\n\nIf this change is meant: make golden"


def test_every_golden_file_has_its_function() -> None:
    assert {file.stem for file in TEXTS.iterdir()} == {*CASES}


def test_a_changed_line_is_shown() -> None:
    shown = difference("a = 1;\nb = 2;\n", "a = 1;\nb = 3;\n", "f.c")
    assert "-b = 2;" in shown and "+b = 3;" in shown and "-a = 1;" not in shown

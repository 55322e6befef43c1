"""The computer algebra's equations, stored and derived now, against ours and the vectors."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from patagium.dynamics import equations
from patagium.errors import ParameterError
from patagium.native import compiler_name
from patagium.robot import load_robot
from patagium_lab.rivals import symbolic_rival
from patagium_lab.rivals.compiled import SHORT_FLAGS
from patagium_lab.rivals.symbolic_code import c_text, stored_code
from patagium_lab.rivals.symbolic_rival import lambdified, symengine_code

FILE = Path(__file__).parents[3].parent / "shared" / "data" / "lagrange_vectors.npz"
ROUNDING = 1e-10  # thousands of unsimplified terms cancel

needs_compiler = pytest.mark.skipif(compiler_name() is None, reason="needs a C compiler")


@pytest.fixture(autouse=True)
def compiled_as_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rival's long text is called a few times here, and GCC optimizes it for ten seconds."""
    monkeypatch.setattr(symbolic_rival, "SHORT_FLAGS", ("-O0", *SHORT_FLAGS[1:]))


@pytest.fixture(scope="module")
def vectors() -> dict[str, np.ndarray]:
    if not FILE.exists():
        pytest.skip(f"the reference vectors {FILE.name} are not beside this checkout")
    with np.load(FILE) as archive:
        return {name: archive[name] for name in archive.files}


@needs_compiler
def test_stored_c_on_the_reference_vectors(vectors) -> None:
    robot = load_robot("aerobat-published")
    rival = symbolic_rival.symbolic_rival(
        robot, stored_code(robot), shared=True, quantities=("bias",)
    )
    for q, v, coriolis, gravity in _columns(vectors, "q", "qd", "Cqd", "G"):
        (bias,) = rival.calls["bias"].evaluate([q, v, *rival.extra])
        _assert_close(bias, coriolis + gravity)


def test_stored_python_on_the_reference_vectors(vectors) -> None:
    robot = load_robot("aerobat-published")
    code = stored_code(robot)
    force, inertia = lambdified(code, "bias"), lambdified(code, "mass_matrix")
    lower = np.tril_indices(robot.dof)
    for q, v, mass_matrix, coriolis, gravity in _columns(vectors, "q", "qd", "M", "Cqd", "G"):
        _assert_close(np.array(force(q, v, robot.parameters)), coriolis + gravity)
        _assert_close(np.array(inertia(q, v, robot.parameters)), mass_matrix[lower])


def test_without_shared_subexpressions_the_text_is_longer_and_has_none() -> None:
    robot = load_robot("aerobat")
    code = stored_code(robot)
    shared = c_text(code, robot.dof, "mass_matrix")
    written_out = c_text(code, robot.dof, "mass_matrix", shared=False)
    assert "double x0 =" in shared
    assert "double x0 =" not in written_out
    assert len(written_out) > 4 * len(shared)


def test_other_robots_are_refused() -> None:
    with pytest.raises(ParameterError, match="yeo-wing"):
        stored_code(load_robot("yeo-wing"))


@needs_compiler
def test_symengine_derives_any_robot(random_machine, rng: np.random.Generator) -> None:
    pytest.importorskip("symengine", reason="SymEngine comes with the extra `bench`")
    robot = random_machine(1)
    rival = symbolic_rival.symbolic_rival(robot, symengine_code(robot), shared=True)
    q, v = rng.uniform(-1, 1, robot.dof), rng.normal(size=robot.dof)
    mass_matrix, bias = rival.calls["both"].evaluate([q, v, *rival.extra])
    symbols = ca.SX.sym("q", robot.dof), ca.SX.sym("v", robot.dof)
    ours = [equations.mass_matrix(robot, symbols[0]), equations.bias(robot, *symbols)]
    expected = ca.Function("ours", symbols, ours)(q, v)
    _assert_close(mass_matrix, np.array(expected[0]).ravel())
    _assert_close(bias, np.array(expected[1]).ravel())


def _columns(vectors: dict[str, np.ndarray], *names: str) -> zip:
    return zip(*(vectors[name] for name in names), strict=True)


def _assert_close(found: np.ndarray, expected: np.ndarray) -> None:
    assert np.abs(found - expected).max() <= ROUNDING * np.abs(expected).max()

"""Imports go down the layers, and importing the package loads none of them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import patagium

ROOT = Path(__file__).parents[2]
PUBLIC = {
    "Air",
    "CompilerError",
    "CubatureLearner",
    "DenseNetwork",
    "DrydenGust",
    "Dynamics",
    "ExtendedLearner",
    "FilterDiverged",
    "FlightError",
    "GradientLearner",
    "LinearLearner",
    "LogError",
    "OneMinusCosineGust",
    "Outcome",
    "ParameterError",
    "PatagiumError",
    "Published",
    "QuasiSteady",
    "Robot",
    "RobotFileError",
    "ShapeError",
    "SimulationFailed",
    "StripNetwork",
    "__version__",
    "evaluate",
    "gaits",
    "identify",
    "load_flight",
    "load_robot",
    "mounts",
    "save_flight",
    "simulate",
    "simulate_published",
    "training_data",
}


def test_imports_only_go_down() -> None:
    run = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c()"]
    done = subprocess.run([*run, "--no-cache"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_public_names_are_the_ones_promised() -> None:
    assert set(patagium.__all__) == PUBLIC


@pytest.mark.parametrize("name", sorted(PUBLIC))
def test_public_name_resolves(name: str) -> None:
    assert getattr(patagium, name) is not None


def test_an_unknown_name_is_refused_as_by_any_module() -> None:
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        patagium.simulat  # noqa: B018


@pytest.mark.parametrize("statement", ["import patagium", "import patagium.cli.main"])
def test_importing_loads_nothing_heavy(statement: str) -> None:
    heavy = "{'numpy', 'casadi', 'xarray', 'pandas', 'matplotlib', 'pydantic', 'pint', 'jinja2'}"
    program = f"{statement}; import sys; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stdout + done.stderr

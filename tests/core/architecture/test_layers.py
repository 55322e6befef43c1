"""Imports go down the layers, and importing the package loads none of them."""

from __future__ import annotations

import ast
import importlib.metadata
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import patagium

ROOT = Path(__file__).parents[3]
PUBLIC = {
    "AddedMass",
    "Air",
    "ChangeDetection",
    "CompilerError",
    "CubatureLearner",
    "DeLaurier",
    "DenseNetwork",
    "DrydenGust",
    "Dynamics",
    "ExtendedLearner",
    "FilterDiverged",
    "FlightError",
    "FlowNetwork",
    "GradientLearner",
    "GreyBox",
    "HiddenFlowNetwork",
    "HiddenStripNetwork",
    "Indicial",
    "LiftingLine",
    "LinearLearner",
    "LogError",
    "LowRank",
    "NoiseEstimation",
    "Screening",
    "OneMinusCosineGust",
    "Outcome",
    "ParameterError",
    "PathError",
    "PatagiumError",
    "Pipeline",
    "QuasiSteady",
    "RampGust",
    "Robot",
    "RobotFileError",
    "RobotFileWarning",
    "Section",
    "SensorLog",
    "ShapeError",
    "SimulationFailed",
    "StallDelay",
    "StripNetwork",
    "TablePolar",
    "TravelingGust",
    "__version__",
    "cycle_statistics",
    "evaluate",
    "ForceSamples",
    "Kalman",
    "MomentumObserver",
    "MotionTracker",
    "SavitzkyGolay",
    "Spline",
    "cell_wrench",
    "estimate_motion",
    "estimate_shifts",
    "inverse_dynamics_force",
    "load_cell_force",
    "momentum_force",
    "motor_forces",
    "gaits",
    "identify",
    "import_log",
    "inspect_log",
    "load_flight",
    "load_learner",
    "load_log",
    "load_robot",
    "load_urdf",
    "load_sensor_log",
    "measured_section",
    "mounts",
    "paths",
    "replay",
    "refine",
    "save_flight",
    "save_sensor_log",
    "sense",
    "sensors",
    "simulate",
    "still",
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


def third_party_imports(path: Path) -> set[str]:
    """Top names of what a module imports that is neither Python's nor ours."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module)
    tops = {name.partition(".")[0] for name in names}
    return tops - set(sys.stdlib_module_names) - {"patagium"}


def test_every_import_is_declared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    rivals = project["optional-dependencies"]["bench"]
    formats = project["optional-dependencies"]["logs"]
    pages = project["optional-dependencies"]["viewer"]
    core = {canonical(line) for line in project["dependencies"]}
    distributions = {**importlib.metadata.packages_distributions(), "pinocchio": ["pin"]}
    for path in sorted((ROOT / "src" / "patagium").rglob("*.py")):
        places = {"studies": rivals, "files": formats, "viewer": pages}
        extra = [line for place, lines in places.items() if place in path.parts for line in lines]
        allowed = core | {canonical(line) for line in extra}
        for name in third_party_imports(path):
            owners = {canonical(owner) for owner in distributions[name]}
            assert owners & allowed, f"{path.name} imports {name} of {owners}, not declared"


def canonical(requirement: str) -> str:
    """Name of a distribution as the index spells it, from a requirement."""
    return re.split(r"[^A-Za-z0-9._-]", requirement)[0].lower().replace("_", "-")

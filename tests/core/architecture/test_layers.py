"""Imports go down the layers, and importing the package loads none of them."""

from __future__ import annotations

import ast
import importlib
import importlib.metadata
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

import patagium

ROOT = Path(__file__).parents[3]
PUBLIC = {
    "AddedMass",
    "Air",
    "CubatureLearner",
    "DeLaurier",
    "DenseNetwork",
    "Dynamics",
    "ExtendedLearner",
    "GreyBox",
    "LiftingLine",
    "PatagiumError",
    "Pipeline",
    "QuasiSteady",
    "Robot",
    "Simulator",
    "StripNetwork",
    "__version__",
    "air",
    "control",
    "cycle_statistics",
    "errors",
    "estimate_motion",
    "evaluate",
    "fly",
    "gaits",
    "identify",
    "import_log",
    "inverse_dynamics_force",
    "learning",
    "load_flight",
    "load_learner",
    "load_log",
    "load_model",
    "load_robot",
    "load_urdf",
    "mounts",
    "paths",
    "refine",
    "replay",
    "save_flight",
    "sense",
    "sensor_log",
    "sensing",
    "sensors",
    "simulate",
    "still",
    "training_data",
    "trim",
    "tune",
}
NAME_SPACES = ("air", "control", "errors", "learning", "sensing")


def test_imports_only_go_down() -> None:
    run = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c()"]
    done = subprocess.run([*run, "--no-cache"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_public_names_are_the_ones_promised() -> None:
    assert set(patagium.__all__) == set(dir(patagium)) == PUBLIC


@pytest.mark.parametrize("name", sorted(PUBLIC))
def test_public_name_resolves(name: str) -> None:
    assert getattr(patagium, name) is not None


def test_the_public_surface_stays_small() -> None:
    assert len(PUBLIC) <= 50


@pytest.mark.parametrize("space", NAME_SPACES)
def test_names_of_a_name_space_resolve(space: str) -> None:
    module = getattr(patagium, space)
    assert importlib.import_module(f"patagium.{space}") is module
    assert len(module.__all__) == len({*module.__all__}) > 5
    assert [name for name in module.__all__ if getattr(module, name, None) is None] == []


def test_a_layer_is_there_whatever_was_used_before() -> None:
    """`pt.robot` was there only after something else had imported it."""
    program = "import patagium as pt; print(pt.robot.load_robot is pt.load_robot, pt.live.__name__)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.strip() == "True patagium.live", done.stderr


@pytest.mark.parametrize("space", NAME_SPACES)
def test_a_name_of_a_name_space_is_found_from_the_top(space: str) -> None:
    names = set(getattr(patagium, space).__all__) - {*patagium.__all__}
    assert names
    for name in names:
        meant = rf"has no attribute '{name}'; did you mean patagium\.\w+\.(?i:{name})\?$"
        with pytest.raises(AttributeError, match=meant):
            getattr(patagium, name)


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("simulat", "simulate"),
        ("Quasisteady", "QuasiSteady"),
        ("cubature_learner", "CubatureLearner"),
        ("DrydenGusts", "patagium.air.DrydenGust"),
    ],
)
def test_an_unknown_name_is_refused_with_a_suggestion(typed: str, meant: str) -> None:
    said = rf"^module 'patagium' has no attribute '{typed}'; did you mean {meant}\?$"
    with pytest.raises(AttributeError, match=said):
        getattr(patagium, typed)


@pytest.mark.parametrize(
    "module", [one for one in patagium.__all__ if isinstance(getattr(patagium, one), ModuleType)]
)
def test_every_public_module_suggests_its_own_names(module: str) -> None:
    found = getattr(patagium, module)
    for name in found.__all__:
        said = (
            rf"^module '{found.__name__}' has no attribute '{name}_'; did you mean (?i:{name})\?$"
        )
        with pytest.raises(AttributeError, match=said):
            getattr(found, f"{name}_")
    assert not hasattr(found, "xyzzy")


def test_a_name_like_no_other_is_refused_without_a_suggestion() -> None:
    with pytest.raises(AttributeError, match="^module 'patagium' has no attribute 'xyzzy'$"):
        patagium.xyzzy  # noqa: B018


@pytest.mark.parametrize(
    "statement",
    [
        "import patagium",
        "import patagium.cli.main",
        "import patagium.errors",
        "from patagium import whole_file",  # asked for as a name first, and no name space holds it
    ],
)
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
    formats = [
        line for extra in ("logs", "ardupilot") for line in project["optional-dependencies"][extra]
    ]
    pages = [
        line for extra in ("viewer", "film") for line in project["optional-dependencies"][extra]
    ]
    search = project["optional-dependencies"]["tune"]
    core = {canonical(line) for line in project["dependencies"]}
    distributions = {**importlib.metadata.packages_distributions(), "pinocchio": ["pin"]}
    for path in sorted((ROOT / "src" / "patagium").rglob("*.py")):
        places = {"studies": rivals, "files": formats, "viewer": pages, "tuning": search}
        extra = [line for place, lines in places.items() if place in path.parts for line in lines]
        allowed = core | {canonical(line) for line in extra}
        for name in third_party_imports(path):
            owners = {canonical(owner) for owner in distributions.get(name, [name])}
            assert owners & allowed, f"{path.name} imports {name} of {owners}, not declared"


def canonical(requirement: str) -> str:
    """Name of a distribution as the index spells it, from a requirement."""
    return re.split(r"[^A-Za-z0-9._-]", requirement)[0].lower().replace("_", "-")

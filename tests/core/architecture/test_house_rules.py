"""The rules of the house, read from the source: sizes, words, docstrings, addresses."""

from __future__ import annotations

import ast
import dataclasses
import enum
import inspect
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

import patagium

from .source_tree import modules

ROOT = Path(__file__).parents[3]
PACKAGE = ROOT / "src" / "patagium"
TEXT = {
    ".py", ".c", ".h", ".cpp", ".md", ".toml", ".yaml", ".yml", ".html", ".cff", ".lock", ".cfg",
    "", ".json",
}  # fmt: skip
BANNED = {"num", "calc", "data", "utils", "util", "helper", "helpers", "manager"}
ALLOWED_NAMES = {"training_data"}  # the paper's word for it
UNIT = re.compile(r"\[[^\]]+\]")


def tracked(*patterns: str) -> list[Path]:
    """Files git knows or would take; every file outside of a checkout."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "--", *patterns]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if listed.returncode == 0:
        return [ROOT / line for line in listed.stdout.splitlines() if (ROOT / line).is_file()]
    found = {path for pattern in patterns or ("**/*",) for path in ROOT.glob(f"**/{pattern}")}
    hidden = {".venv", ".git", "out"}
    return sorted(p for p in found if p.is_file() and not hidden & set(p.relative_to(ROOT).parts))


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def test_no_path_of_a_machine_stands_in_a_file() -> None:
    places = re.compile("|".join(f"/{name}/" for name in ("work", "farm", "root", "home")))
    guilty = [
        name_of(path)
        for path in tracked()
        if path.suffix in TEXT and places.search(path.read_text("utf-8", errors="ignore"))
    ]
    assert guilty == []


def test_the_lock_names_no_host() -> None:
    text = (ROOT / "requirements.lock").read_text("utf-8")
    requirement = re.compile(
        r"""[a-z0-9][a-z0-9._-]*==[\w.!+]+(\ ;\ [\w\s'.*<>=!()]+)?(\ \\)?
            |\ {4}--hash=sha256:[0-9a-f]{64}(\ \\)?""",
        re.VERBOSE,
    )
    strangers = [line for line in text.splitlines() if not requirement.fullmatch(line)]
    assert strangers == []


def test_every_locked_requirement_has_a_hash() -> None:
    text = (ROOT / "requirements.lock").read_text("utf-8")
    blocks = re.split(r"\n(?=\S)", text.strip())
    assert len(blocks) > 40
    assert all("--hash=sha256:" in block for block in blocks)


def public_definitions(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.ClassDef]:
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for inner in node.body:
                if isinstance(inner, ast.FunctionDef) and not inner.name.startswith("_"):
                    yield inner


def test_every_module_says_what_it_is() -> None:
    assert len(modules()) > 100
    silent = [one for one in modules() if one.tree.body and not ast.get_docstring(one.tree)]
    assert [name_of(one.path) for one in silent] == []


def test_names_are_words_of_the_field() -> None:
    guilty = set()
    for module in modules():
        for node in module.nodes:
            names = []
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names.append(node.name)
            if isinstance(node, ast.FunctionDef):
                names += [a.arg for a in (*node.args.args, *node.args.kwonlyargs)]
            for name in names:
                words = set(re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower().strip("_").split("_"))
                if words & BANNED and name not in ALLOWED_NAMES:
                    guilty.add(f"{name_of(module.path)}: {name}")
    assert guilty == set()


def describes_an_array(docstring: str) -> bool:
    """Whether it gives the shape of something over coordinates, time, strips or space."""
    return bool(re.search(r"\((n|N|T|3|n_\w+|N, ?\w+|time)(, ?[\w ]*)*\)", docstring))


PHYSICAL = ("robot", "dynamics", "aerodynamics", "simulation")


@pytest.mark.parametrize("layer", PHYSICAL)
def test_arrays_of_physical_layers_carry_units(layer: str) -> None:
    without = []
    for module in modules():
        if not module.path.is_relative_to(PACKAGE / layer):
            continue
        for node in public_definitions(module.tree):
            text = ast.get_docstring(node) or ""
            if isinstance(node, ast.FunctionDef) and "Args:" in text:
                if describes_an_array(text) and not UNIT.search(text):
                    without.append(f"{name_of(module.path)}: {node.name}")
    assert not without, "\n".join(without)


def takes_arguments(value: object) -> bool:
    if isinstance(value, type) and issubclass(value, Exception):
        return "__init__" in vars(value)
    return callable(value) and not (isinstance(value, type) and issubclass(value, enum.Enum))


@pytest.mark.parametrize("name", patagium.__all__)
def test_public_names_explain_every_argument(name: str) -> None:
    value = getattr(patagium, name)
    if not takes_arguments(value):
        return
    text = inspect.getdoc(value) or ""
    if isinstance(value, type) and "Args:" not in text:
        text += inspect.getdoc(value.__init__) or ""
    arguments = set(inspect.signature(value).parameters) - {"self"}
    if dataclasses.is_dataclass(value):
        arguments = {field.name for field in dataclasses.fields(value) if field.init}
    silent = {a for a in arguments if not re.search(rf"^\s*\**{a}: \S", text, re.MULTILINE)}
    assert silent == set()


def test_no_user_input_is_checked_by_assert() -> None:
    guilty = [
        f"{name_of(module.path)}:{node.lineno}"
        for module in modules()
        for node in module.nodes
        if isinstance(node, ast.Assert)
    ]
    assert guilty == []


def test_no_compiled_function_is_kept_for_the_whole_process() -> None:
    """One that was kept while no compiler was chosen would stay slow when one is."""
    functions = [
        (module.name, node)
        for module in modules("patagium")
        for node in module.nodes
        if isinstance(node, ast.FunctionDef)
    ]
    assert any("load_functions(" in ast.unparse(node) for _, node in functions)
    kept = [
        f"{name}.{node.name}"
        for name, node in functions
        if {"cache", "lru_cache"}
        & set(re.findall(r"\w+", " ".join(map(ast.unparse, node.decorator_list))))
        and re.search(r"\bload_(functions|kernel)\(", ast.unparse(node))
    ]
    assert kept == []

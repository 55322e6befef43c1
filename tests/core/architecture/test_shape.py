"""Shape of the tree: no cycles, bases that do not know their children, small functions."""

from __future__ import annotations

import ast
import re

from .debts import within
from .source_tree import (
    Function,
    all_modules,
    classes,
    cycles,
    descendants,
    functions,
    imports,
    modules,
)


def all_functions() -> list[Function]:
    return [one for module in all_modules() for one in functions(module)]


def test_a_cycle_is_found_through_every_kind_of_import() -> None:
    graph = {"a": frozenset({"b"}), "b": frozenset({"c"}), "c": frozenset({"b"}), "d": frozenset()}
    assert cycles(graph) == [["b", "c"]]
    lazy = imports()["patagium.aerodynamics.gusts"]
    assert "patagium.aerodynamics.lags" not in lazy
    assert "patagium.learning" in imports()["patagium.cli.evaluate"]  # inside its function
    assert "patagium.air" in imports()["patagium"]  # for type checks only


def test_no_modules_import_each_other() -> None:
    """Imports inside functions and for type checks count."""
    found = cycles(imports())
    within("modules in cycles", [" <-> ".join(one) for one in found], sum(map(len, found)))


def test_no_base_knows_its_children() -> None:
    """A module with a base class names none of the classes derived from it in its bodies.

    Imports of a child, direct or by way of others, are cycles and found as such.
    """
    offenders = []
    for one in classes().values():
        names = {name.rpartition(".")[2] for name in descendants(one.name)}
        inside = {node.id for node in ast.walk(one.node) if isinstance(node, ast.Name)}
        for name in sorted(names & inside):
            offenders.append(f"{one.name} names its child {name}")
    within("classes that know their children", offenders)


def test_packages_only_gather_names() -> None:
    """An `__init__` defines nothing but names, and how they are resolved when first used."""
    offenders = [
        f"{module.name}:{node.lineno} {node.name}"
        for module in all_modules()
        if module.is_package
        for node in module.tree.body
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
    ]
    within("packages with code in their __init__", offenders)


def test_functions_fit_on_a_screen() -> None:
    offenders = [f"{one.place}: {one.lines}" for one in all_functions() if one.lines > 60]
    within("functions above 60 lines", offenders)


def test_functions_take_few_arguments() -> None:
    offenders = [
        f"{one.place}: {len(one.parameters)}"
        for one in all_functions()
        if len(one.parameters) > 8 and not one.is_verb
    ]
    within("functions with more than 8 parameters", offenders)


def test_the_wheel_stays_small() -> None:
    """Control is counted for itself: it is the layer that is being built. Stubs count too."""
    lines = {"lines of control": 0, "lines of Python in the wheel outside control": 0}
    for module in modules():
        own = "control" in module.path.parts
        name = "lines of control" if own else "lines of Python in the wheel outside control"
        text = module.path.read_text("utf-8") + module.stub
        lines[name] += len(text.splitlines())
    for name, count in lines.items():
        within(name, [], count)


def documented(tree: ast.Module) -> set[int]:
    """Numbers of the lines that docstrings take."""
    nodes = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    found: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, nodes) and ast.get_docstring(node) is not None:
            text = node.body[0]
            found |= set(range(text.lineno, (text.end_lineno or text.lineno) + 1))
    return found


def header(tree: ast.Module) -> set[int]:
    """Numbers of the lines that imports and lists of public names take."""
    return {
        number
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        or (isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__")
        for number in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }


def test_few_lines_are_not_won_by_width_or_by_docstrings() -> None:
    """Characters of code count as lines do, without indents, docstrings and imports."""
    characters, lines, docstrings = 0, 0, 0
    for module in modules():
        text, said = module.path.read_text("utf-8").splitlines(), documented(module.tree)
        skipped = said | header(module.tree)
        lines, docstrings = lines + len(text), docstrings + len(said)
        characters += sum(len(one.strip()) for k, one in enumerate(text, 1) if k not in skipped)
    within("characters of code in the wheel", [], characters)
    assert docstrings / lines > 0.237  # .239 before typed dictionaries of keywords went


def test_there_are_few_weight_filters() -> None:
    """Classes that update weights, or are derived from one that does; protocols are not counted."""
    acting = {
        one.name
        for one in classes().values()
        if one.module.name.startswith("patagium.learning.filters")
        and {"update", "predict"} <= {getattr(node, "name", "") for node in one.node.body}
        and "Protocol" not in {ast.unparse(base) for base in one.node.bases}
    }
    found = acting.union(*(descendants(name) for name in acting))
    within("classes of weight filters", sorted(found))


def test_there_are_few_types_of_memory() -> None:
    found = [
        one.name
        for one in classes().values()
        if one.module.name.startswith("patagium.learning")
        and re.search(r"Memory|Recall|Recollect", one.node.name)
    ]
    within("types of memory", found)

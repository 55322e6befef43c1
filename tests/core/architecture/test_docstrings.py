"""Docstrings: first lines that name the thing, arrays with shape and unit, what is raised."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest

from .debts import within
from .source_tree import Function, Module, all_modules, functions

NO_NOUN = re.compile(
    r"""(The\ same|They|Them|Those|These|This|It|Its|Which|Who|What|How|Where|When|Why|Of|As|So|
    In|By|Here|There|That|Only|Not|Nothing|Everything|And|Or|But|If|Says|Told|Asked|Given)\b""",
    re.VERBOSE,
)
ENDS_OPEN = re.compile(r"^(\w+,? ){1,4}(made|it|them|so|too|there|of|by|with|to|does|is|are)\.?$")
SHAPE = re.compile(r"\((?:\w+|\.\.\.|[-\w]+(?: [-+*] \w+)?)(?:, ?[\w.+*-]+)*,?\)")
ARRAY = re.compile(r"\((?:n|N|T|M|m|3|4|6|k|B|S|n_\w+|time)(?:, ?[\w .+*-]*)*\)")
UNIT = re.compile(r"\[[^\]]+\]|\b(in the unit|unit of|units of|as [`\w]+|like [`\w]+|per)\b")
UNITLESS = ("bool", "weights", "index", "indices", "names", "Whether")


def documented(module: Module) -> Iterator[tuple[str, ast.AST, str]]:
    """Place, node and docstring of a module, its classes and its functions."""
    path = module.path.name
    text = ast.get_docstring(module.tree)
    if text:
        yield f"{module.name} ({path})", module.tree, text
    for node in module.nodes:
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            if text:
                yield f"{module.name}:{node.lineno} {node.name}", node, text


def names_nothing(first: str) -> bool:
    """Whether a first line begins or ends as a phrase without its noun does."""
    return bool(NO_NOUN.match(first) or ENDS_OPEN.search(first.rstrip(". ")))


@pytest.mark.parametrize(
    ("first", "bad"),
    [
        ("The same, made.", True),
        ("They, as a file holds them.", True),
        ("Which filter of weights a structure of the covariance takes.", True),
        ("Of the air by now, (n,) [N, N m].", True),
        ("Weight filter for a covariance structure.", False),
        ("Generalized inertia of the free-flying robot.", False),
        ("Write a model as JSON.", False),
    ],
)
def test_the_rule_of_first_lines_knows_bad_from_good(first: str, bad: bool) -> None:
    assert names_nothing(first) == bad


def test_first_lines_name_the_thing() -> None:
    offenders = [
        f"{place}: {text.splitlines()[0]}"
        for module in all_modules()
        for place, _, text in documented(module)
        if names_nothing(text.splitlines()[0])
    ]
    within("first lines that are no noun phrase", offenders)


def entries(text: str) -> dict[str, str]:
    """What a docstring says of each argument and attribute."""
    found: dict[str, str] = {}
    name = part = ""
    for line in text.splitlines():
        if re.match(r"^[A-Z]\w+:$", line):
            part = line
        elif part in ("Args:", "Attributes:") and (new := re.match(r"^ {4}\**(\w+): (.*)", line)):
            name = new[1]
            found[name] = new[2]
        elif part in ("Args:", "Attributes:") and line.startswith("     ") and name:
            found[name] += " " + line.strip()
    return found


def test_arrays_say_their_unit() -> None:
    offenders = [
        f"{place}: {name}: {said}"
        for module in all_modules()
        for place, _, text in documented(module)
        for name, said in entries(text).items()
        if ARRAY.search(said) and not UNIT.search(said) and not any(w in said for w in UNITLESS)
    ]
    within("arguments with a shape and no unit", offenders)


def raised(function: Function) -> set[str]:
    """Exceptions that the body of a function raises, without those of functions inside."""
    found = set()
    waiting: list[ast.AST] = list(function.node.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.Lambda | ast.ClassDef):
            continue
        if isinstance(node, ast.Raise) and node.exc is not None:
            name = ast.unparse(node.exc.func if isinstance(node.exc, ast.Call) else node.exc)
            found.add(name)
        waiting.extend(ast.iter_child_nodes(node))
    return {name for name in found if re.fullmatch(r"[A-Z][\w.]*", name)}


def test_functions_say_what_they_raise() -> None:
    offenders = []
    for module in all_modules():
        for one in functions(module):
            text = ast.get_docstring(one.node) or ""
            names = raised(one) - {"NotImplementedError", "AttributeError", "StopIteration"}
            if one.is_public and not one.is_verb and names and "Raises:" not in text:
                offenders.append(f"{one.place}: {', '.join(sorted(names))}")
    within("functions that raise and do not say so", offenders)

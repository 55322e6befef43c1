"""Syntax trees of the package and of its laboratory: modules, imports, classes, functions."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

ROOT = Path(__file__).parents[3]
FOLDERS = {"patagium": ROOT / "src" / "patagium", "lab": ROOT / "lab" / "src" / "patagium_lab"}
VERB_FOLDERS = ("patagium.cli.", "patagium_lab.verbs.")


@dataclass(frozen=True)
class Module:
    """One file of source.

    Attributes:
        name: Dotted name; a package has the name of its folder.
        path: The file.
        tree: Its syntax tree.
    """

    name: str
    path: Path
    tree: ast.Module

    @cached_property
    def stub(self) -> str:
        """Text of the type stub (.pyi) beside the module; empty if it has none."""
        file = self.path.with_suffix(".pyi")
        return file.read_text("utf-8") if file.exists() else ""

    @cached_property
    def nodes(self) -> tuple[ast.AST, ...]:
        """All nodes of the tree, and of its stub."""
        return (*ast.walk(self.tree), *ast.walk(ast.parse(self.stub)))

    @property
    def is_package(self) -> bool:
        """Whether the file is the `__init__` of a folder."""
        return self.path.name == "__init__.py"


@dataclass(frozen=True)
class Function:
    """A function or method, with the module that has it."""

    module: Module
    qualified_name: str
    node: ast.FunctionDef | ast.AsyncFunctionDef

    @property
    def place(self) -> str:
        """File, line and name, for a message."""
        path = self.module.path.relative_to(ROOT)
        return f"{path}:{self.node.lineno} {self.qualified_name}"

    @property
    def is_verb(self) -> bool:
        """Whether the command line takes its options from the signature."""
        folder = self.module.name.startswith(VERB_FOLDERS)
        named = self.qualified_name == self.module.name.rpartition(".")[2]
        return folder and (named or self.qualified_name == "_program")

    @property
    def is_public(self) -> bool:
        """Whether it stands in no function and no part of its name begins with an underscore."""
        *outer, _ = parts = self.qualified_name.split(".")
        return all(part[0].isupper() for part in outer) and "_" not in {p[0] for p in parts}

    @property
    def lines(self) -> int:
        """Lines behind the signature, docstring included."""
        first = self.node.body[0].lineno
        return (self.node.end_lineno or first) - first + 1

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters without `self`, `cls` and keywords that have a default."""
        given = self.node.args
        keywords = zip(given.kwonlyargs, given.kw_defaults, strict=True)
        needed = [one for one, default in keywords if default is None]
        names = [one.arg for one in (*given.posonlyargs, *given.args, *needed)]
        return names[1:] if names[:1] in (["self"], ["cls"]) else names


@cache
def modules(folder: str = "patagium") -> tuple[Module, ...]:
    """Modules of the package or of the laboratory, by name."""
    home = FOLDERS[folder]
    found = []
    for path in sorted(home.rglob("*.py")):
        parts = path.relative_to(home.parent).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found.append(Module(name, path, ast.parse(path.read_text("utf-8"))))
    return tuple(found)


def all_modules() -> tuple[Module, ...]:
    """Modules of the package, then those of the laboratory."""
    return tuple(module for folder in FOLDERS for module in modules(folder))


@cache
def functions(module: Module) -> tuple[Function, ...]:
    """Functions and methods of a module, those inside functions too."""

    def below(node: ast.AST, before: str) -> Iterator[Function]:
        for child in ast.iter_child_nodes(node):
            name = before
            if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                name = f"{before}.{child.name}".lstrip(".")
            if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
                yield Function(module, name, child)
            yield from below(child, name)

    return tuple(below(module.tree, ""))


@cache
def imports() -> dict[str, frozenset[str]]:
    """Modules that each module imports: at the top, inside functions, for type checks.

    `from package import name` is an import of the submodule `name` where there is one, and of
    the package otherwise. Parents are not counted: Python runs them, the code does not name them.
    """
    known = {module.name for module in all_modules()}
    return {
        module.name: frozenset(target for target in _targets(module, known)) - {module.name}
        for module in all_modules()
    }


def _targets(module: Module, known: set[str]) -> Iterator[str]:
    for node in module.nodes:
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = module.name.split(".")
                above = node.level - module.is_package
                base = ".".join([*parts[: len(parts) - above], *base.split(".")]).rstrip(".")
            full = [f"{base}.{alias.name}" for alias in node.names]
            names = [name if name in known else base for name in full]
        elif isinstance(node, ast.Call) and _called(node) == "import_module":
            names = [a.value for a in node.args[:1] if isinstance(a, ast.Constant)]
        yield from (name for name in names if name in known)


def _called(node: ast.Call) -> str:
    """Name of a called function, without its module."""
    return str(getattr(node.func, "attr", getattr(node.func, "id", "")))


def cycles(graph: dict[str, frozenset[str]]) -> list[list[str]]:
    """Strongly connected components of more than one module (Tarjan)."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(name: str) -> None:
        order[name] = low[name] = len(order)
        stack.append(name)
        for other in sorted(graph.get(name, ())):
            if other not in order:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], order[other])
        if low[name] == order[name]:
            at = stack.index(name)
            component = sorted(stack[at:])
            del stack[at:]
            if len(component) > 1:
                found.append(component)

    for name in sorted(graph):
        if name not in order:
            visit(name)
    return found


@dataclass(frozen=True)
class Class:
    """A class with the dotted names of its bases, as far as the tree defines them."""

    module: Module
    node: ast.ClassDef
    bases: tuple[str, ...]

    @property
    def name(self) -> str:
        """Dotted name."""
        return f"{self.module.name}.{self.node.name}"


@cache
def classes() -> dict[str, Class]:
    """Classes at the top of modules, by dotted name, with bases resolved through imports."""
    exported: dict[str, dict[str, str]] = {}
    for module in all_modules():
        names = exported[module.name] = {}
        for node in module.nodes:
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                for alias in node.names:
                    names[alias.asname or alias.name] = f"{node.module}.{alias.name}"
        for node in module.tree.body:
            if isinstance(node, ast.ClassDef):
                names[node.name] = f"{module.name}.{node.name}"

    def resolved(name: str, hops: int = 4) -> str:
        home, _, attribute = name.rpartition(".")
        further = exported.get(home, {}).get(attribute)
        return name if further in (None, name) or not hops else resolved(further, hops - 1)

    found = {}
    for module in all_modules():
        for node in module.tree.body:
            if isinstance(node, ast.ClassDef):
                heads = [b.value if isinstance(b, ast.Subscript) else b for b in node.bases]
                bases = [exported[module.name].get(ast.unparse(head), "") for head in heads]
                one = Class(module, node, tuple(resolved(b) for b in bases if b))
                found[one.name] = one
    return found


def descendants(name: str) -> set[str]:
    """Classes below a class, children of children too."""
    children = {one.name for one in classes().values() if name in one.bases}
    return children.union(*(descendants(child) for child in children))

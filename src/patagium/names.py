"""Public names of packages, which are imported when they are first used.

Importing a package costs nothing, and a command loads what it needs alone. The stub beside a
package's `__init__.py` says where its names are, to type checkers and to this module.
"""

from __future__ import annotations

import ast
import sys
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any


def offer_names(package: str) -> list[str]:
    """Let a package import the names of its stub at their first use.

    Args:
        package: Dotted name of the package, whose `__init__.pyi` has lines such as
            `from package.module import name as name`.

    Returns:
        The names, for `__all__`.
    """
    module = sys.modules[package]
    loader: Any = module.__loader__  # of folders or of archives
    stub = loader.get_data(str(module.__file__).rpartition(".")[0] + ".pyi").decode("utf-8")
    lines = [line for line in ast.parse(stub).body if isinstance(line, ast.ImportFrom)]
    homes = {one.name: str(line.module) for line in lines for one in line.names}
    module.__dict__["_homes"] = homes
    module.__class__ = _Package
    return sorted(homes)


class _Package(ModuleType):
    """Package that imports its names when they are first used."""

    def __getattr__(self, name: str) -> Any:
        package, homes = self.__name__, self.__dict__["_homes"]
        if name not in homes:
            from patagium.errors import unknown_name

            known = dict[str, str]()  # none for importers, which ask for "__path__"
            if name[0] != "_":
                if find_spec(f"{package}.{name}"):
                    return import_module(f"{package}.{name}")
                for space in (one for one, home in homes.items() if home == package):
                    words = import_module(f"{package}.{space}").__all__
                    known |= {word: f"{package}.{space}.{word}" for word in words}
            raise unknown_name(package, name, known | {word: word for word in homes})
        if homes[name] == package:
            return import_module(f"{package}.{name}")
        value = getattr(import_module(homes[name]), name)
        super().__setattr__(name, value)
        return value

    def __setattr__(self, name: str, value: object) -> None:
        home = self.__dict__["_homes"].get(name, self.__name__)
        if home == self.__name__ or not isinstance(value, ModuleType):  # not a name's own module
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted(self.__dict__["_homes"])

    def __reduce__(self) -> tuple[Any, ...]:
        return import_module, (self.__name__,)  # as any module is pickled for other processes

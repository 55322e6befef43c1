"""Programs that make foreign air, imported when they are needed."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from patagium.errors import ParameterError

MUJOCO, LATTICE_PROGRAM = "mujoco", "pterasoftware"
"""Names of the modules."""


def program(name: str) -> Any:
    """Module of a program.

    Args:
        name: Name of the module.

    Raises:
        ParameterError: If it is not installed.
    """
    try:
        return import_module(name)
    except ImportError:
        expected = "installed for this: pip install 'patagium-lab[foreign]'"
        raise ParameterError(name, expected, "not installed") from None


def installed(name: str) -> bool:
    """Whether a program is installed.

    Args:
        name: Name of the module.
    """
    return find_spec(name) is not None

"""A polar or a section for all wings of a robot, or one for each wing.

Neglected: sections that change along the span of a wing; write such a wing as several.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Generic, TypeVar

from patagium.aerodynamics.polars import Polar
from patagium.aerodynamics.sections import StripSection
from patagium.errors import ParameterError, check_names
from patagium.robot.model import Robot

_Kind = TypeVar("_Kind", Polar, StripSection)


class OfWings(Generic[_Kind]):
    """Polars or sections by wing, and their numbers, which follow each other.

    Args:
        name: Name of the argument, which is that of the numbers too.
        given: One for all wings, or one for each by its name; the mirror image of a wing has that
            of the wing where it is not named.
        robot: Whose wings they are.

    Attributes:
        numbers: Numbers of all, by name, in their order [SI].
        structure: Text of all that shapes the equations, numbers aside.

    Raises:
        ParameterError: If a wing has none, or a name is that of no wing.
    """

    def __init__(self, name: str, given: _Kind | Mapping[str, _Kind], robot: Robot) -> None:
        self._wing_of: dict[str, str] = {}
        self._kinds: dict[str, _Kind] = {}
        self._places: dict[str, slice] = {}
        self.numbers: dict[str, float] = {}
        if isinstance(given, Mapping):
            self._kinds.update(given)
            self._wing_of = wings_of(name, given, robot)
            self.structure = str({wing: kind.structure for wing, kind in given.items()})
        else:
            self._kinds[""] = given
            self.structure = given.structure
        for wing, kind in self._kinds.items():
            prefix = f"{name}.{wing}." if wing else f"{name}."
            first = len(self.numbers)
            values = zip(kind.parameter_names, kind.parameters, strict=True)
            self.numbers |= {f"{prefix}{number}": value for number, value in values}
            self._places[wing] = slice(first, len(self.numbers))

    def of(self, wing: str, numbers: Any) -> tuple[_Kind, Any]:
        """Polar or section of one wing, with its parameters.

        Args:
            wing: Name of the wing.
            numbers: Values or symbols in the order of the attribute of this name, (n,) [SI].
        """
        own = self._wing_of.get(wing, "")
        return self._kinds[own], numbers[self._places[own]]


def wings_of(name: str, given: Mapping[str, Any], robot: Robot) -> dict[str, str]:
    """Name that is given for each wing of a robot.

    Args:
        name: Name of the argument.
        given: What is given by the names of wings.
        robot: Whose wings they are.

    Raises:
        ParameterError: If a wing has none, or a name is that of no wing.
    """
    wings = robot.wing_names
    originals = {image: wing for wing, image in robot.mirrored_wings}
    found = {wing: wing if wing in given else originals.get(wing, wing) for wing in wings}
    check_names(f"{name} by wing", given, wings, "names of", near=True)
    for wing, own in found.items():
        if own not in given:
            expected = "one: where wings have their own, each needs one, mirror images aside"
            raise ParameterError(f"{name} of {wing}", expected, None)
    return found

"""A robot whose parameters are symbols of any kind: CasADi MX, SymPy, SymEngine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from patagium.robot.model import Robot

_XYZ = ("x", "y", "z")
_INERTIA = ("xx", "yy", "zz", "xy", "xz", "yz")


def with_symbols(robot: Robot, symbols: Mapping[str, Any]) -> Robot:
    """Robot whose bodies' numbers and gravity are replaced where a symbol is given.

    Args:
        robot: The machine.
        symbols: Symbol for each name of `robot.parameter_names`; strips and damping
            stay as they are, for D, C v and G do not depend on them.
    """

    def replaced(prefix: str, old: tuple[Any, ...], labels: tuple[str, ...]) -> Any:
        return tuple(symbols.get(f"{prefix}.{k}", x) for k, x in zip(labels, old, strict=True))

    bodies = tuple(
        replace(
            body,
            position=replaced(f"{body.name}.position", body.position, _XYZ),
            mass=symbols.get(f"{body.name}.mass", body.mass),
            center_of_mass=replaced(f"{body.name}.center_of_mass", body.center_of_mass, _XYZ),
            inertia=replaced(f"{body.name}.inertia", body.inertia, _INERTIA),
        )
        for body in robot.bodies
    )
    return replace(robot, bodies=bodies, gravity=symbols.get("gravity", robot.gravity))

"""The numbers of a robot by name: what its compiled functions take as inputs.

A number that is exactly zero is structure, not a parameter: the equations are generated
without it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from patagium.robot.model import Robot

_XYZ = ("x", "y", "z")
_INERTIA = ("xx", "yy", "zz", "xy", "xz", "yz")


def with_values(robot: Robot, values: Mapping[str, Any]) -> Robot:
    """A copy with some parameters changed, to numbers or symbols; unknown names are passed over."""

    def vector(prefix: str, old: tuple[Any, ...], labels: tuple[str, ...]) -> Any:
        return tuple(values.get(f"{prefix}.{k}", x) for k, x in zip(labels, old, strict=True))

    bodies = tuple(
        replace(
            b,
            position=vector(f"{b.name}.position", b.position, _XYZ),
            mass=values.get(f"{b.name}.mass", b.mass),
            center_of_mass=vector(f"{b.name}.center_of_mass", b.center_of_mass, _XYZ),
            inertia=vector(f"{b.name}.inertia", b.inertia, _INERTIA),
        )
        for b in robot.bodies
    )
    strips = tuple(
        replace(
            s,
            quarter_chord=vector(f"{s.name}.quarter_chord", s.quarter_chord, _XYZ),
            chord=values.get(f"{s.name}.chord", s.chord),
            width=values.get(f"{s.name}.width", s.width),
        )
        for s in robot.strips
    )
    damping = tuple(
        values.get(f"{name}.damping", d)
        for name, d in zip(robot.dof_names, robot.damping, strict=True)
    )
    return replace(
        robot,
        bodies=bodies,
        strips=strips,
        damping=damping,
        gravity=values.get("gravity", robot.gravity),
    )


def leaves(robot: Robot) -> Iterator[tuple[str, Any]]:
    """Name and value of every number that may be a parameter."""
    yield "gravity", robot.gravity
    for name, value in zip(robot.dof_names, robot.damping, strict=True):
        yield f"{name}.damping", value
    for body in robot.bodies:
        for label, value in zip(_XYZ, body.position, strict=True):
            yield f"{body.name}.position.{label}", value
        yield f"{body.name}.mass", body.mass
        for label, value in zip(_XYZ, body.center_of_mass, strict=True):
            yield f"{body.name}.center_of_mass.{label}", value
        for label, value in zip(_INERTIA, body.inertia, strict=True):
            yield f"{body.name}.inertia.{label}", value
    for strip in robot.strips:
        for label, value in zip(_XYZ, strip.quarter_chord, strict=True):
            yield f"{strip.name}.quarter_chord.{label}", value
        yield f"{strip.name}.chord", strip.chord
        yield f"{strip.name}.width", strip.width


def is_parameter(value: Any) -> bool:
    """Whether a number is an input of the compiled functions."""
    return bool(value != 0.0)

"""Likely slips in a robot: what is valid and yet hardly meant.

Looked at with all coordinates at zero. Neglected: whether the robot can fly.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees, isfinite, pi
from typing import Any

import numpy as np
import yaml

from patagium.reading import lines_of
from patagium.robot.model import Robot
from patagium.robot.planform import (
    image_joints,
    inwards,
    mirrored_bodies,
    placed,
    poses,
    strip_corners,
)

_SMALL = 1e-6
"""Area of a strip that does nothing, over that of the largest."""

_HINGE = 0.05
"""Distance of a center of mass that is at the hinge, over that of the wing's middle."""

_HEAVY = 5.0
"""Mass of a wing over that of all other bodies that is hardly meant."""

_ALIKE, _POINT = 0.3, 0.02
"""Share of span that a wing's mass and its strips have in common; that of a mass in a point."""

_KINDS = {
    ("kg", "g"): "mass",
    ("m", "cm"): "at position center_of_mass leading trailing span chord thickness radius length "
    "size semi_axes",
    ("kg m^2", "g cm^2"): "xx yy zz xy xz yz",
}
"""Keys of a robot file by the unit of a bare number and the one that may be meant."""

_WIDE = 5.0
"""Distance of a body's mass from its center over the size of the robot that is hardly meant."""

_AXIS = 0.1
"""Difference of two unit axes that are the same."""

_OVERLAP = 0.1
"""Share of its chord and its width that a strip may lie on another one."""


def robot_warnings(robot: Robot) -> list[str]:
    """Sentences on likely slips, each with what to write; none for a robot without."""
    images = mirrored_bodies(robot)  # the other side is told
    every = (
        _no_wings(robot),
        _bare_numbers(robot.source),
        _wide_limits(robot, images),
        _masses_of_wings(robot, images),
        _small_strips(robot),
        _few_strips(robot),
        _elsewhere(robot),
        _wide_bodies(robot, images),
        _same_axes(robot),
        _overlaps(robot),
    )
    return [*dict.fromkeys(sentence for check in every for sentence in check)]


def _no_wings(robot: Robot) -> Iterator[str]:
    if robot.cruise is not None and not robot.strips:
        yield "wings: there is no such section, so that no air acts on the robot; write its wings"


def _bare_numbers(text: str) -> Iterator[str]:
    """Masses, lengths, inertias of 1 and more without a unit, where others of the file have one."""
    for (unit, small), keys in _KINDS.items():
        found = list(_written(yaml.safe_load(text), keys.split()))
        bare = {k: x for k, x in found if isinstance(x, int | float) and abs(x) >= 1}
        lines = lines_of(text, bare)
        for place, x in bare.items() if any(isinstance(one, str) for _, one in found) else ():
            seen = f"{x:g} without a unit is {x:g} {unit}, and others have their units"
            yield f"line {lines[place]}, {place}: {seen}; write '{x:g} {small}' or '{x:g} {unit}'"


def _written(node: Any, keys: list[str], place: str = "", own: bool = False) -> Iterator[Any]:
    """Places and values of these keys in a file, entries of a list one by one."""
    listed = isinstance(node, list)
    if own and not isinstance(node, dict | list):
        yield place[1:], node
    for key, value in enumerate(node) if listed else getattr(node, "items", tuple)():
        yield from _written(value, keys, f"{place}.{key}", own if listed else key in keys)


def _wide_limits(robot: Robot, images: set[int]) -> Iterator[str]:
    for joint in (k for i, b in enumerate(robot.bodies) if i not in images for k in b.joints):
        low, high = robot.lower[joint.dof], robot.upper[joint.dof]
        far = [k for k in (low, high) if isfinite(k) and abs(k) > 2 * pi]
        if joint.kind == "revolute" and far:
            turns = f"{far[0]:g} rad are {degrees(far[0]):.0f} deg, more than a turn"
            remedy = f"are degrees meant? Write [{low:g} deg, {high:g} deg]"
            yield f"joint {joint.name}: limits: {turns}; {remedy}"


def _masses_of_wings(robot: Robot, images: set[int]) -> Iterator[str]:
    """Sentences about wings whose mass, or its place, can hardly be meant."""
    largest = max((float(s.chord * s.width) for s in robot.strips), default=0.0)
    for index, body in enumerate(robot.bodies):
        strips = [strip for strip in robot.strips if strip.body == index]
        if index in images or not strips or not body.joints or body.mass == 0.0:
            continue
        areas = [float(s.chord * s.width) for s in strips]
        if not sum(areas) > _SMALL * largest:  # its strips are told
            continue
        middle = np.average([s.quarter_chord for s in strips], axis=0, weights=areas)
        if np.linalg.norm(body.center_of_mass) < _HINGE * np.linalg.norm(middle):
            place = ", ".join(f"{100 * x:.3g} cm" for x in middle)
            yield (
                f"body {body.name}: center_of_mass: it is at the hinge, its wing's middle is not; "
                f"write center_of_mass: [{place}] if its mass is spread over the wing"
            )
            continue
        others = {*range(len(robot.bodies))} - images - {index}
        rest = sum(float(robot.bodies[k].mass) for k in others)
        if robot.floating and body.mass > _HEAVY * rest:
            own, less = (f"{float(f'{1000 * m:.3g}'):g} g" for m in (body.mass, rest))
            heavy = f"{own}, all other bodies but its mirror image only {less} together"
            yield f"body {body.name}: mass: it has {heavy}; check its unit"
        if ranges := mass_beside_strips(robot, index):
            there, here = (f"{100 * a:.3g} to {100 * b:.3g} cm" for a, b in ranges)
            seen = f"its mass lies from {there} along its span, its strips from {here}"
            yield f"body {body.name}: center_of_mass, shape: {seen}; check the units"


def mass_beside_strips(robot: Robot, index: int) -> list[tuple[float, float]]:
    """Ranges of a body's mass and of its strips along its span [m], where they are elsewhere."""
    body = robot.bodies[index]
    corners = np.concatenate([strip_corners(one) for one in robot.strips if one.body == index])
    k = int(np.argmax(np.ptp(corners, axis=0)[1:])) + 1  # the axis of the span
    ends = corners[:, k].min(), corners[:, k].max()
    square = 1.5 * (sum(body.inertia[:3]) - 2 * body.inertia[k]) / (body.mass or 1.0)
    half = np.sqrt(max(square, 0.0))
    own = body.center_of_mass[k] - half, body.center_of_mass[k] + half
    shared, longest = min(ends[1], own[1]) - max(ends[0], own[0]), max(np.ptp(ends), 2 * half)
    apart = half > _POINT * longest and shared < _ALIKE * longest
    return [own, ends] if apart else []


def _wide_bodies(robot: Robot, images: set[int]) -> Iterator[str]:
    """Bodies, moving wings aside, whose inertia is that of a mass far outside of the robot."""
    wings = {s.body for s in robot.strips if robot.bodies[s.body].joints} | images
    places = poses(robot)
    centers = np.array([body.center_of_mass for body in robot.bodies], float)
    points = [placed(places[s.body], strip_corners(s)) for s in robot.strips]
    points += [placed(place, one[None]) for place, one in zip(places, centers, strict=True)]
    size = float(np.linalg.norm(np.ptp(np.concatenate(points), axis=0)))
    for body in (b for k, b in enumerate(robot.bodies) if robot.strips and k not in wings):
        far = np.sqrt(sum(body.inertia[:3]) / 2 / body.mass) if body.mass else 0.0
        if far > _WIDE * size:
            seen = f"its mass lies {far:.3g} m from its center, and the robot is {size:.3g} m large"
            yield f"body {body.name}: mass, inertia, shape: {seen}; check the units"


def _same_axes(robot: Robot) -> Iterator[str]:
    """Joints of a written right wing, image of the left one, on an axis that is not mirrored."""
    for _, image, axis, mirrored in image_joints(robot):
        apart, wrong = (np.linalg.norm(image.axis - k) for k in (axis, mirrored))
        if apart < _AXIS < wrong and image.dof in robot.actuated:
            best = ", ".join(f"{k + 0.0:.3g}" for k in np.round(mirrored, 3))
            seen = "it is that of the left side, so the wings do not move as mirror images"
            yield f"joint {image.name}: axis: {seen}; write axis: [{best}]"


def _elsewhere(robot: Robot) -> Iterator[str]:
    """Wings with the name of a body that moves by joints, on other bodies."""
    for index, body in enumerate(robot.bodies):
        carriers = {
            strip.body for strip in robot.strips if strip.wing == body.name and not strip.mirrored
        }
        if body.joints and carriers and not any(index in inwards(robot, k) for k in carriers):
            on = ", ".join(robot.bodies[k].name for k in sorted(carriers))
            yield f"wing {body.name}: it is on {on}; write body: {body.name} if that carries it"


def _small_strips(robot: Robot) -> Iterator[str]:
    areas = [float(strip.chord * strip.width) for strip in robot.strips]
    told: set[str] = set()
    for strip, area in zip(robot.strips, areas, strict=True):
        if area <= _SMALL * max(areas) and strip.wing not in told:
            told.add(strip.wing)
            yield f"strip {strip.name}: its area of {area:.3g} m^2 does nothing; give it a chord"


def _few_strips(robot: Robot) -> Iterator[str]:
    """Flexible plates of more pieces than strips: what is between them bends, but feels no air."""
    for name, body in yaml.safe_load(robot.source).get("bodies", {}).items():
        pieces = 1 + body["flexible"].get("elements", 4) if body.get("flexible") else 0
        own = {name, *(f"{name}_{k}" for k in range(1, pieces))}
        strips = sum(robot.bodies[strip.body].name in own for strip in robot.strips)
        if 0 < strips < pieces:
            few = f"its {pieces} pieces have {strips} strips"
            yield f"body {name}: flexible: {few}; write strips: {pieces} or more, or fewer elements"


def _overlaps(robot: Robot) -> Iterator[str]:
    """A strip in the plane of another one, chord and span of both in common."""
    places = poses(robot)
    corners = [placed(places[s.body], strip_corners(s)) for s in robot.strips]
    told: set[tuple[str, str]] = set()
    for i, strip in enumerate(robot.strips):
        if strip.mirrored:
            continue
        turn = places[strip.body][1]
        ahead, up = turn @ strip.forward, turn @ strip.normal
        axes = np.array([ahead, np.cross(up, ahead), up])
        own = corners[i] @ axes.T
        for j, other in enumerate(robot.strips[:i]):
            seen = corners[j] @ axes.T
            shared = np.minimum(own.max(0), seen.max(0)) - np.maximum(own.min(0), seen.min(0))
            level = np.abs(seen[:, 2] - own[:, 2].mean()).max() < _OVERLAP * strip.chord
            size = np.minimum(np.ptp(own, axis=0), np.ptp(seen, axis=0))[:2]
            pair = (other.wing, strip.wing)
            if level and (shared[:2] > _OVERLAP * size).all() and pair not in told:
                told.add(pair)
                yield (
                    f"strips {other.name} and {strip.name} lie on each other, so that the air "
                    "pushes twice there; move one wing or segment, unless joints part them"
                )

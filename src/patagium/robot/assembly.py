"""From a robot file's parts to the frozen robot.

Mirrors what is to be mirrored, orders parents before children, numbers the
coordinates, and cuts the wings into blade elements. Between stations both edges of a wing are
straight. Strips of a segment are equally wide; each has the chord that keeps its area.
Neglected: camber and thickness (they belong to the polar), dihedral within a strip.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from math import copysign, isfinite
from typing import Any

import numpy as np

from patagium.arrays import Array, means_between
from patagium.errors import ParameterError, similar
from patagium.limits import LEAST_INERTIA, SWING, TURN
from patagium.robot.attitude import rotation_from_angles
from patagium.robot.flexible import Hinge, flexed, pieces_of
from patagium.robot.model import (
    CAPACITIES,
    COMMANDS,
    FLOATING_COORDINATES,
    Actuator,
    Axis,
    Body,
    Cruise,
    Joint,
    Robot,
    Strip,
    axes_of,
    axis_of,
    moments_of,
    repeated,
)
from patagium.robot.planform import (
    from_the_root,
    image_joints,
    inwards,
    loop_of,
    mirror_body,
    placed,
    poses,
    reflected_axis,
)
from patagium.robot.schema import (
    ActuatorPart,
    BodyPart,
    CruisePart,
    JointPart,
    Mirror,
    RobotFile,
    Segment,
    WingPart,
)
from patagium.robot.strip_chains import joined_images
from patagium.robot.units import UnitMismatch, in_si, meant, spoken

_REFLECTION = np.diag([1.0, -1.0, 1.0])


def _unknown(path: str, known: list[str], found: str) -> tuple[str, str, str]:
    """Problem of a name that stands for nothing, with a similar one that does."""
    return path, f"one of {', '.join(known)}", found + similar(found, known)


class AssemblyError(ValueError):
    """Parts that are each valid but do not make a robot.

    Args:
        problems: One `(path in the file, expected, found)` a problem.
    """

    def __init__(self, *problems: tuple[str, str, str]) -> None:
        super().__init__(problems)
        self.problems = list(problems)


@dataclass(frozen=True)
class _Draft:
    """A body before its parents and coordinates have numbers."""

    name: str
    parent: str | None
    part: BodyPart
    orientation: Any
    reflected: bool
    path: str


def assemble(file: RobotFile, source: str) -> Robot:
    """The robot that a file describes.

    Raises:
        AssemblyError: If the parts contradict each other.
    """
    for name, body in file.bodies.items():
        for piece in (f"{name}_0", *pieces_of(name, body).names[1:]) if body.flexible else ():
            if piece in file.bodies:
                expected = f"another name, as {piece} is a piece of the flexible body {name}"
                raise AssemblyError((f"bodies.{piece}", expected, piece))
    parts = flexed(file.bodies)
    drafts = _in_tree_order(_mirrored(file, [_draft(n, b, parts) for n, b in parts.items()]))
    _check_masses(drafts)
    joints = _joints(drafts)
    order = _ordered(file, tuple(joints))
    ordered = [joints[name] for name in order]
    dof = {name: i for i, name in enumerate(order)}
    bodies: list[Body] = []
    for draft in drafts:
        bodies.append(_body(draft, bodies, dof))
    robot = Robot(
        name=file.name,
        bodies=tuple(bodies),
        strips=(),
        dof_names=order,
        dof_units=tuple(k.unit for k in ordered),
        actuated=tuple(i for i, k in enumerate(ordered) if not k.passive),
        damping=tuple(k.damping for k in ordered),
        lower=tuple(k.limits[0] if k.limits else -np.inf for k in ordered),
        upper=tuple(k.limits[1] if k.limits else np.inf for k in ordered),
        gravity=file.gravity,
        **_springs_and_capacities(ordered),
    )
    robot = replace(robot, strips=_strips(file, robot))
    _check_inertia(robot, [draft.path for draft in drafts])
    if taken := repeated(robot.coordinate_names):
        floating = next(draft for draft in drafts if draft.part.floating)
        path = f"{floating.path}.attitude"
        raise AssemblyError((path, "coordinates named once", f"a joint {taken[0]} too"))
    robot = _joined(file, robot)
    robot = replace(robot, cruise=_cruise(robot, file.cruise))
    actuators = {name: _actuator(robot, name, part) for name, part in file.actuators.items()}
    _check_actuators(robot, actuators)
    robot = replace(robot, actuators=actuators)
    return replace(with_file_parameters(robot, file.parameters), source=source)


def _joined(file: RobotFile, robot: Robot) -> Robot:
    """The robot with the pairs of wings that one lifting line runs through."""
    wings = robot.wing_names
    said: list[tuple[str, str]] = []
    images: list[tuple[str, str]] = []
    for i, wing in enumerate(file.wings):
        mirrors = [k for k in file.mirror if wing.name.startswith(k.source)]
        images += [(wing.name, k.image(wing.name)) for k in mirrors]
        for other in wing.joins or ():
            if other not in wings or other == wing.name:
                known = [k for k in wings if k != wing.name]
                raise AssemblyError(_unknown(f"wings.{i}.joins", known, other))
            pair = (wing.name, other)
            sides = [(mirror.image(pair[0]), mirror.image(pair[1])) for mirror in mirrors]
            said += [pair, *(side for side in sides if {*side} != {*pair})]
    pairs = [k for n, k in enumerate(said) if not {k, k[::-1]} & {*said[:n]}]
    left = [name for name in wings if name not in {name for pair in images for name in pair}]
    images += [k for k in combinations(left, 2) if mirror_body(robot, *k) is not None]
    told = {wing.name for wing in file.wings if wing.joins is not None}
    near = joined_images(robot, [pair for pair in images if not {*pair} & told])
    robot = replace(robot, joined_wings=(*pairs, *near), mirrored_wings=tuple(images))
    return replace(robot, mirrored_joints=_mirrored_joints(file, robot))


def _mirrored_joints(file: RobotFile, robot: Robot) -> tuple[tuple[str, str], ...]:
    """Pairs of left and right joints: by words in their names, by `mirror`, or by their wings."""
    aside: dict[str, float] = {}
    for body, pose in zip(robot.bodies, poses(robot), strict=True):
        y = placed(pose, np.array(body.center_of_mass))[1]
        aside |= {joint.name: -y for joint in body.joints}
    words = [["right" if k == "left" else k for k in name.split("_")] for name in aside]
    images = [(name, mirror.image(name)) for mirror in file.mirror for name in aside]
    for joint, other, _, mirrored in image_joints(robot):
        if np.allclose(other.axis, mirrored):
            images.append((joint.name, other.name))
    pairs = [*zip(aside, map("_".join, words), strict=True)]
    pairs += [k if aside[k[0]] <= aside[k[1]] else k[::-1] for k in images if k[1] in aside]
    found: dict[str, str] = {}
    for left, right in pairs:
        if left != right in aside and not {left, right} & {*found, *found.values()}:
            found[left] = right
    return tuple(found.items())


def _cruise(robot: Robot, part: CruisePart | None) -> Cruise | None:
    """The flight where nothing else is asked for, its names checked."""
    if part is None:
        return None
    given: dict[str, dict[str, float]] = {"amplitude": {}, "offset": {}, "phase": {}}
    for key, name, written in [(k, *one) for k in given for one in getattr(part, k).items()]:
        path, joints = f"cruise.{key}.{name}", robot.joints_named(name)
        if not joints:
            known = robot.actuated_names
            expected = f"an actuated joint ({', '.join(known)}) or a pair"
            near = similar(name, [*robot.joint_groups, *known])
            raise AssemblyError((path, expected, name + near))
        unit = "rad" if key == "phase" else robot.dof_units[robot.index(joints[0])]
        most = SWING if key == "amplitude" else TURN
        given[key][name] = _in_si(path, written, unit, most=most)
    named = [(key, k) for key in ("amplitude", "offset") for k in given[key]]
    moved = [(key, name, joint) for key, name in named for joint in robot.joints_named(name)]
    values = {(key, joint): given[key][name] for key, name, joint in moved}
    for key, name, joint in moved:
        size, mean = (values.get((k, joint), 0.0) for k in ("amplitude", "offset"))
        beyond = beyond_limits(robot, robot.index(joint), mean - abs(size), mean + abs(size))
        if beyond:
            raise AssemblyError((f"cruise.{key}.{name}", *beyond))
    return Cruise(**dict(part) | given)


def _in_si(path: str, written: Any, unit: str, noun: str = "", most: float = TURN) -> float:
    try:
        return in_si(written, unit, noun, most)
    except UnitMismatch as error:
        raise AssemblyError((path, error.expected, error.found)) from None


def beyond_limits(robot: Robot, dof: int, least: float, most: float) -> tuple[str, str] | None:
    """Expected and found motion of a joint [rad, m] in words, where it is beyond its limits.

    A joint that has none may go a turn either way.
    """
    unit, (lower, upper) = robot.dof_units[dof], (robot.lower[dof], robot.upper[dof])
    if unit == "rad":
        lower, upper = (k if isfinite(k) else copysign(TURN, k) for k in (lower, upper))
    if lower - MARGIN <= least and most <= upper + MARGIN:
        return None
    expected = f"a gait within its limits {spoken(unit, lower, upper)}"
    return expected, spoken(unit, least, most) + (meant(most, least) if unit == "rad" else "")


MARGIN = 1e-9
"""Rounding allowed beyond a joint limit [rad, m]."""


def _actuator(robot: Robot, name: str, part: ActuatorPart) -> Actuator:
    """Limits of a command, in the unit of the joints that answer it."""
    kind, joints = robot.command(name)
    path = f"actuators.{name}"
    if not joints or name == "amplitude":
        known = robot.actuated_names
        kinds = ", ".join(f"<joint>_{one}" for one in COMMANDS)
        every = [f"{one}_{kind}" for one in (*known, *robot.joint_groups) for kind in COMMANDS]
        near = similar(name, ["frequency", *every])
        expected = f"frequency, {kinds} of an actuated joint ({', '.join(known)})"
        raise AssemblyError((path, expected, name + near))
    units = {"frequency": "Hz", "phase": "rad"}
    unit = units.get(kind, robot.dof_units[robot.index(joints[0])])
    low, high, rate = -np.inf, np.inf, np.inf
    if part.range is not None:
        places = ((f"{path}.range.{k}", one) for k, one in enumerate(part.range))
        low, high = (_in_si(place, one, unit, "a limit") for place, one in places)
        least = 0.0 if kind in ("frequency", "amplitude") else -np.inf
        if not least <= low < high:
            sign = "" if least else ", none below 0"
            found = spoken(unit, low, high)
            raise AssemblyError((f"{path}.range", f"the lower before the upper{sign}", found))
    if part.rate_limit is not None:
        rate = _in_si(f"{path}.rate_limit", part.rate_limit, f"{unit}/s", "a limit")
    if not rate > 0:
        raise AssemblyError((f"{path}.rate_limit", "a positive quantity", f"{rate:g}"))
    return Actuator(unit, (low, high), rate, part.response_time, part.cost)


def _check_actuators(robot: Robot, actuators: Mapping[str, Actuator]) -> None:
    """Refuse a joint that is limited twice, and ranges that exclude the cruise."""
    seen: dict[tuple[str, str], str] = {}
    cruise = robot.cruise
    for name, actuator in actuators.items():
        kind, joints = robot.command(name)
        for joint in joints:
            other = seen.setdefault((kind, joint), name)
            if other != name:
                expected = f"the {kind} of {joint} limited once"
                raise AssemblyError((f"actuators.{name}", expected, f"also as {other!r}"))
        if cruise is None or kind == "phase" or cruise.frequency is None:
            continue
        own = {"frequency": {name: cruise.frequency}, "amplitude": cruise.amplitude}
        given = own.get(kind, cruise.offset)
        for key, value in given.items():
            named = kind == "frequency" or set(robot.joints_named(key)) & set(joints)
            low, high = actuator.range
            if named and not low <= value <= high:
                expected = f"a range that holds the cruise's {spoken(actuator.unit, value)}"
                found = spoken(actuator.unit, low, high)
                raise AssemblyError((f"actuators.{name}.range", expected, found))


def _draft(name: str, part: BodyPart, bodies: Mapping[str, BodyPart]) -> _Draft:
    path, parent = f"bodies.{name}", part.parent
    floating = [k for k, body in bodies.items() if body.floating]
    if parent is None and floating and not part.floating:
        expected = f"`parent: {floating[0]}`, or `parent: world` for what hangs on the world"
        raise AssemblyError((f"{path}.parent", expected, "nothing"))
    parent = None if parent == "world" and parent not in bodies else parent
    return _Draft(name, parent, part, rotation_from_angles(part.orientation), False, path)


def _mirrored(file: RobotFile, drafts: list[_Draft]) -> list[_Draft]:
    """Drafts with the images that the file asks for."""
    everything = {draft.name: draft for draft in drafts}
    for i, mirror in enumerate(file.mirror):
        path = f"mirror.{i}"
        originals = [draft for draft in drafts if draft.name.startswith(mirror.source)]
        wings = [wing for wing in file.wings if wing.name.startswith(mirror.source)]
        if not originals and not wings:
            expected = "the beginning of some body's or wing's name"
            raise AssemblyError((f"{path}.from", expected, mirror.source))
        for draft in originals:
            image = _image(draft, mirror)
            if image.name in everything:
                raise AssemblyError((path, "names that are not taken yet", f"body {image.name}"))
            everything[image.name] = image
    return [*everything.values()]


def _image(draft: _Draft, mirror: Mirror) -> _Draft:
    """Mirror image of a draft in the plane of symmetry."""
    if draft.part.floating:
        raise AssemblyError((draft.path, "a body that does not float, to be mirrored", "floating"))
    joints = []
    for joint in draft.part.joints:
        if not joint.name.startswith(mirror.source):
            expected = f"names that begin with {mirror.source!r}, to be mirrored"
            raise AssemblyError((f"{draft.path}.joints", expected, joint.name))
        axis = reflected_axis(joint.type, joint.axis)
        joints.append(joint.model_copy(update={"name": mirror.image(joint.name), "axis": axis}))
    return _Draft(
        name=mirror.image(draft.name),
        parent=mirror.image(draft.parent) if draft.parent else None,
        part=draft.part.model_copy(update={"joints": tuple(joints)}),
        orientation=_REFLECTION @ draft.orientation @ _REFLECTION,
        reflected=True,
        path=draft.path,
    )


def _in_tree_order(drafts: list[_Draft]) -> list[_Draft]:
    """Drafts in order, each after its parent."""
    names = {draft.name for draft in drafts}
    for draft in drafts:
        if draft.parent is not None and draft.parent not in names:
            raise AssemblyError(_unknown(f"{draft.path}.parent", sorted(names), draft.parent))
    ordered: list[_Draft] = []
    placed: set[str | None] = {None}
    waiting = drafts
    while waiting:
        first = next((draft for draft in waiting if draft.parent in placed), None)
        if first is None:
            loop = loop_of({draft.name: str(draft.parent) for draft in waiting}, waiting[0].name)
            path = next(draft.path for draft in waiting if draft.name == loop[0])
            expected = "a chain of parents that ends at a floating body or the world"
            found = f"the loop {' -> '.join(loop)}; give one of them another parent"
            raise AssemblyError((f"{path}.parent", expected, found))
        ordered.append(first)
        placed.add(first.name)
        waiting = [draft for draft in waiting if draft is not first]
    return ordered


def _check_masses(drafts: list[_Draft]) -> None:
    """A joint that moves no mass has no equation of motion."""
    heavy: set[str] = set()
    for draft in reversed(drafts):
        if draft.part.mass > 0 or draft.name in heavy:
            heavy.add(draft.name)
            if draft.parent is not None:
                heavy.add(draft.parent)
        elif draft.part.joints or draft.part.floating:
            expected = "a body with mass, or one that carries such"
            raise AssemblyError((draft.path, expected, "massless"))


def _check_inertia(robot: Robot, paths: list[str]) -> None:
    """A turn that moves no mass has no equation of motion either; seen at zero coordinates."""
    each = list(zip(robot.bodies, poses(robot), strict=True))
    masses = np.array([body.mass for body in robot.bodies])
    centers = np.array([placed(pose, np.array(body.center_of_mass)) for body, pose in each])
    tensors = np.array([turn @ body.tensor @ turn.T for body, (_, turn) in each])
    for k, (body, (place, turn)) in enumerate(each):
        free = body.floating_dofs is not None
        axes = [turn @ j.axis for j in body.joints if j.kind == "revolute"]
        if not axes and not free:
            continue
        below = [i for i in range(len(each)) if k in inwards(robot, i)]
        if free:
            place = np.average(centers[below], 0, masses[below])
        arms = centers[below] - place
        second = masses[below] * arms.T @ arms
        tensor = tensors[below].sum(axis=0) + np.trace(second) * np.eye(3) - second
        least = np.linalg.eigvalsh(tensor)[0] if free else min(a @ tensor @ a for a in axes)
        if not least > max(_ROUNDING * np.trace(tensor), LEAST_INERTIA):
            expected = f"a moment of inertia about its {'center' if free else 'joint'} above 0"
            raise AssemblyError((paths[k], expected, f"{max(least, 0.0):.3g} kg m^2"))


_ROUNDING = 1e-13
"""Rounding of a moment of inertia, relative to those about other axes."""


def _springs_and_capacities(ordered: list[JointPart]) -> dict[str, Any]:
    """Springs and limits of actuators, by fields of the robot; empty where no joint has one."""
    found: dict[str, tuple[float, ...]] = {}
    for key in ("stiffness", "rest", *CAPACITIES):
        none = np.inf if key in CAPACITIES else 0.0
        known = any(getattr(k, "stiffness" if key == "rest" else key) for k in ordered)
        found[key] = tuple(getattr(k, key) or none for k in ordered) if known else ()
    return found


def _joints(drafts: list[_Draft]) -> dict[str, JointPart]:
    """Joints of all bodies by name, those of a floating body too."""
    found: dict[str, JointPart] = {}
    for draft in drafts:
        for i, joint in enumerate([*_floating_joints(draft.part), *draft.part.joints]):
            if joint.name in found:
                place = f"{draft.path}.joints.{i}.name" if draft.part.joints else draft.path
                raise AssemblyError((place, "coordinates named once", f"{joint.name} again"))
            found[joint.name] = joint
    if not found:
        raise AssemblyError(("bodies", "a floating body or at least one joint", "none"))
    return found


def _floating_joints(body: BodyPart) -> Iterator[JointPart]:
    """Passive joints of a floating body, one for each coordinate."""
    for k, name in enumerate(FLOATING_COORDINATES if body.floating else ()):
        yield JointPart.model_construct(
            name=name,
            type="prismatic" if k < 3 else "revolute",
            axis=axis_of(np.eye(3)[k % 3]),
            damping=getattr(body.damping, name, 0.0),
            passive=True,
        )


def _ordered(file: RobotFile, names: tuple[str, ...]) -> tuple[str, ...]:
    if file.coordinates is None:
        return names
    if sorted(file.coordinates) != sorted(names):
        missing = [k for k in names if k not in file.coordinates]
        extra = [k for k in file.coordinates if k not in names]
        found = f"missing {missing or 'none'}, unknown {extra or 'none'}"
        if not missing and not extra:
            found = "one of them twice"
        raise AssemblyError(("coordinates", f"each of {', '.join(names)} once", found))
    return file.coordinates


def _body(draft: _Draft, before: list[Body], dof: dict[str, int]) -> Body:
    """Body of a draft, mirrored where it is an image."""
    parent = -1 if draft.parent is None else [one.name for one in before].index(draft.parent)
    joints = []
    for k, one in enumerate(draft.part.joints):
        coupling = one.coupling if isinstance(one, Hinge) else 0.0
        inner = before[parent].joints[k].name if coupling else ""
        joints.append(Joint(one.name, one.type, one.axis, dof[one.name], coupling, inner))
    piece = any(isinstance(part, Hinge) for part in draft.part.joints)
    mirror = _REFLECTION if draft.reflected else np.eye(3)
    return Body(
        name=draft.name,
        parent=parent,
        position=axis_of(mirror @ draft.part.at),
        orientation=axes_of(draft.orientation),
        joints=tuple(joints),
        floating_dofs=(
            tuple(dof[k] for k in FLOATING_COORDINATES) if draft.part.floating else None
        ),
        mass=draft.part.mass,
        center_of_mass=axis_of(mirror @ draft.part.center_of_mass),
        inertia=moments_of(mirror @ draft.part.tensor() @ mirror),
        attitude=draft.part.attitude or "euler",
        piece=piece,
        flexible=draft.part.flexible is not None and not piece,
    )


def _strips(file: RobotFile, robot: Robot) -> tuple[Strip, ...]:
    """Strips of all wings, each from its root to its tip."""
    index = {body.name: i for i, body in enumerate(robot.bodies)}
    names = [wing.name for wing in file.wings]
    strips: list[Strip] = []
    for i, wing in enumerate(file.wings):
        if names.index(wing.name) != i:
            raise AssemblyError((f"wings.{i}.name", "a name that is not taken yet", wing.name))
        for j, segment in enumerate(wing.segments):
            if segment.body not in index:
                path = f"wings.{i}.segments.{j}.body"
                raise AssemblyError(_unknown(path, list(index), segment.body))
        cut = []
        for strip in cut_wing(wing, index):
            body, point = robot.place(robot.bodies[strip.body].name, strip.quarter_chord)
            cut.append(replace(strip, body=body, quarter_chord=_triple(point)))
        strips += from_the_root(robot, cut)
    _check_wing_names(file)
    for i, mirror in enumerate(file.mirror):
        for strip in tuple(s for s in strips if not s.mirrored):
            if not strip.wing.startswith(mirror.source):
                continue
            name = mirror.image(strip.wing)
            if name in names:
                raise AssemblyError((f"mirror.{i}", "names that are not taken yet", f"wing {name}"))
            strips.append(_reflected_strip(robot, strip, mirror))
    return tuple(strips)


def _check_wing_names(file: RobotFile) -> None:
    """Refuse a wing that is not mirrored together with its body."""
    for mirror in file.mirror:
        for i, wing in enumerate(file.wings):
            on_mirrored = any(k.body.startswith(mirror.source) for k in wing.segments)
            if on_mirrored and not wing.name.startswith(mirror.source):
                expected = f"a name that begins with {mirror.source!r}, as its body is mirrored"
                raise AssemblyError((f"wings.{i}.name", expected, wing.name))


def _reflected_strip(robot: Robot, strip: Strip, mirror: Mirror) -> Strip:
    """Mirror image of a strip."""
    return replace(
        strip,
        name=mirror.image(strip.name),
        wing=mirror.image(strip.wing),
        body=robot.body_index(mirror.image(robot.bodies[strip.body].name)),
        mirrored=True,
        quarter_chord=reflected_axis("prismatic", strip.quarter_chord),
        forward=reflected_axis("prismatic", strip.forward),
        normal=reflected_axis("prismatic", strip.normal),
    )


def with_file_parameters(robot: Robot, parameters: Mapping[str, float]) -> Robot:
    """The robot with the values of a file's block `parameters`.

    Raises:
        AssemblyError: If a name is no parameter, or a value cannot be.
    """
    if not parameters:
        return robot
    try:
        return robot.with_parameters(parameters)
    except ParameterError as error:
        path = f"parameters.{error.name}"
        found = str(error).partition(", found ")[2]  # and what may be meant
        raise AssemblyError((path, error.expected, found)) from None


def cut_wing(wing: WingPart, body_index: dict[str, int]) -> Iterator[Strip]:
    """Strips of a wing, as the file writes them."""
    cuts = ((body_index[one.body], cut) for one in wing.segments for cut in _cut(one))
    for index, (body, cut) in enumerate(cuts):
        yield Strip(f"{wing.name}[{index}]", wing.name, body, False, *cut)


def _cut(segment: Segment) -> Iterator[tuple[Axis, Axis, Axis, float, float]]:
    """Quarter chord, forward, normal, chord and width of each strip of a segment."""
    rows = [(k.span, k.leading, k.trailing, k.incidence) for k in segment.stations]
    span, leading, trailing, incidence = np.array(rows).T
    edges = np.linspace(span[0], span[-1], segment.strips + 1)
    chords = means_between(leading - trailing, span, edges)
    along = np.array(segment.span_axis)
    ahead = np.array([1.0, 0.0, 0.0])  # to the leading edge
    upward = np.cross(ahead, along)
    upward = -upward if upward[2] < 0 else upward
    for mean_chord, begin, end in zip(chords, edges, edges[1:], strict=False):
        middle = (begin + end) / 2
        x = np.interp(middle, span, leading) - mean_chord / 4
        twist = float(np.interp(middle, span, incidence))
        forward = _triple(np.cos(twist) * ahead + np.sin(twist) * upward)
        normal = _triple(np.cos(twist) * upward - np.sin(twist) * ahead)
        point = np.array(segment.at) + middle * along + x * ahead
        yield _triple(point), forward, normal, _clean(mean_chord), _clean(end - begin)


def _triple(vector: Array) -> Axis:
    return axis_of(map(_clean, vector))


def _clean(value: float) -> float:
    """Fifteen digits, and an exact zero where rounding left a trace: zeros are structure."""
    return float(f"{value:.15g}") if abs(value) > 1e-16 else 0.0

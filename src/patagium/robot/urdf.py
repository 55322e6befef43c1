"""Reader of URDF files: XML in, the text of a robot file out, with a list of what is left out.

Links become bodies and joints become their coordinates: revolute, continuous and prismatic
joints move, fixed joints hold a body without coordinates, a floating joint frees the root.
Inertias are turned into the axes of their link. A massless link is a named frame. The XML
parser is defusedxml's, which refuses document types and entities.

Neglected, and reported where it changes the motion: Coulomb friction, and the tie of a
mimic joint, which becomes a coordinate of its own. Shapes, materials, transmissions
and simulator extensions are not read.

References:
    The XML specification of URDF, wiki.ros.org/urdf/XML.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import remainder, tau
from typing import Any
from xml.etree.ElementTree import Element, ParseError

import numpy as np
import yaml
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from patagium.errors import RobotFileError
from patagium.limits import TURN
from patagium.robot.attitude import rotation_from_angles
from patagium.robot.model import FLOATING_COORDINATES, INERTIA, inertia_tensor, moments_of
from patagium.robot.planform import loop_of

Problem = tuple[str, str, str]

GRAVITY = 9.81
"""Gravitational acceleration of a robot from a URDF, which states none [m/s^2]."""

_MOVING = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"}
_LONGEST_NAME = 40


@dataclass
class _Names:
    """Names of a robot file: lower case, each used once."""

    taken: set[str] = field(default_factory=set)
    renamed: list[tuple[str, str]] = field(default_factory=list)

    def new(self, written: str, fallback: str) -> str:
        name = re.sub(r"[^a-z0-9_]", "_", written.strip().lower())
        if not name or not name[0].isalpha():
            name = f"{fallback}_{name}".rstrip("_")
        name, number = name[:_LONGEST_NAME], 2
        while name in self.taken:
            ending = f"_{number}"
            name, number = name[: _LONGEST_NAME - len(ending)] + ending, number + 1
        self.taken.add(name)
        if name != written:
            self.renamed.append((written, name))
        return name


def read_urdf(text: str, file: str, floating: bool) -> tuple[str, list[tuple[str, str]]]:
    """Robot file made from the text of a URDF.

    Args:
        text: XML.
        file: Name of the file, for errors.
        floating: Whether the root link floats; a joint of kind floating always frees its child.

    Returns:
        YAML of the robot file, and the parts that a robot cannot represent: place in the URDF, and
        what becomes of it.

    Raises:
        RobotFileError: If the text is no URDF, or describes a part that a robot cannot have.
    """
    reader = _Reader(_root(text, file), floating)
    described = reader.described()
    if reader.problems:
        raise RobotFileError(file, reader.problems)
    renamed = [*reader.bodies.renamed, *reader.coordinates.renamed]
    head = [f"From a URDF; gravity {GRAVITY} m/s^2 is assumed."]
    head += [f"Left out: {where}: {what}" for where, what in reader.left_out]
    head += [f"Renamed: {_one_line(old)} to {new}" for old, new in renamed]
    written = "".join(f"# {line}\n" for line in head) + yaml.safe_dump(described, sort_keys=False)
    return written, reader.left_out


def _root(text: str, file: str) -> Element:
    try:
        root: Element = fromstring(text, forbid_dtd=True)
    except DefusedXmlException:
        problem = ("", "a URDF without a document type", "<!DOCTYPE or entity")
        raise RobotFileError(file, [problem]) from None
    except (ParseError, ValueError) as error:
        raise RobotFileError(file, [("", "readable XML", str(error)[:120])]) from None
    if root.tag != "robot":
        raise RobotFileError(file, [("", "an element <robot>", f"<{_one_line(root.tag)}>")])
    if any("xacro" in str(element.tag) for element in root.iter()):
        raise RobotFileError(file, [("", "a URDF; run xacro on it first", "elements of xacro")])
    return root


@dataclass(frozen=True)
class _Link:
    """Link of the tree with the joint above it and the name of its parent."""

    name: str
    element: Element
    joint: Element | None
    parent: str | None


class _Reader:
    """Reader of one URDF that collects every problem before any is reported."""

    def __init__(self, root: Element, floating: bool) -> None:
        self.root, self.floating = root, floating
        self.problems: list[Problem] = []
        self.left_out: list[tuple[str, str]] = []
        self.bodies, self.coordinates = _Names(), _Names(set(FLOATING_COORDINATES))

    def described(self) -> dict[str, Any]:
        """Mapping of the robot file; empty if there are problems."""
        links = self._tree()
        if self.problems:
            return {}
        links = self._freed(links)
        names = {link.name: self.bodies.new(link.name, "link") for link in links}
        bodies = {names[link.name]: self._body(link, names) for link in links}
        name = re.sub(r"[^A-Za-z0-9_-]", "_", self.root.get("name", "")) or "robot"
        name = name if name[0].isalpha() else f"robot_{name}"
        return {"name": name[:_LONGEST_NAME], "gravity": GRAVITY, "bodies": bodies}

    def _tree(self) -> list[_Link]:
        """Links in order, each parent before its children."""
        elements, joints = self._named("link"), self._named("joint")
        above: dict[str, tuple[Element, str]] = {}
        for name, joint in joints.items():
            ends = (self._linked(name, joint, key, elements) for key in ("parent", "child"))
            parent, child = ends
            if child in above:
                self._refuse(f"joint {name}", "a child with one parent", f"{child} again")
            above[child] = (joint, parent)
        roots = [name for name in elements if name not in above]
        if not self.problems and len(roots) != 1:
            found = ", ".join(roots[:5]) or ("a loop" if elements else "no link")
            self._refuse("", "one root link", found)
        if self.problems:
            return []
        below: dict[str, list[str]] = {}
        for child, (_, parent) in above.items():
            below.setdefault(parent, []).append(child)
        links, waiting = [], [roots[0]]
        while waiting:
            name = waiting.pop()
            links.append(_Link(name, elements[name], *above.get(name, (None, None))))
            waiting += reversed(below.get(name, []))
        if len(links) < len(elements):
            lost = next(name for name in elements if name not in {link.name for link in links})
            loop = loop_of({child: parent for child, (_, parent) in above.items()}, lost)
            found = f"the loop {' -> '.join(loop)}; give one of them another parent"
            self._refuse("", f"a tree that starts at {roots[0]}", found)
        return links

    def _named(self, kind: str) -> dict[str, Element]:
        found: dict[str, Element] = {}
        for element in self.root.findall(kind):
            name = element.get("name")
            if not name or name in found:
                self._refuse(kind, "a name of its own", repr(name))
            else:
                found[name] = element
        return found

    def _linked(self, name: str, joint: Element, key: str, links: dict[str, Element]) -> str:
        end = joint.find(key)
        link = end.get("link", "") if end is not None else ""
        if link not in links:
            self._refuse(f"joint {name}.{key}", "the name of a link", repr(link))
        return link

    def _freed(self, links: list[_Link]) -> list[_Link]:
        """Links without a massless root that only stands for the world of a floating body."""
        free = [k for k in links if k.joint is not None and k.joint.get("type") == "floating"]
        if not free:
            return links
        first, second = links[0], free[0]
        origin = self._origin(second.joint, second.name)
        below = [link for link in links if link.parent == first.name]
        massless = first.element.find("inertial") is None
        if not (free == below == [second] and massless and not np.any(origin)):
            expected = "one floating joint, at the origin of a root link without mass and others"
            self._refuse(f"joint above {second.name}", expected, "another")
            return links
        self.floating = True
        return [_Link(second.name, second.element, None, None), *links[2:]]

    def _body(self, link: _Link, names: dict[str, str]) -> dict[str, Any]:
        body: dict[str, Any] = {}
        if link.joint is None:
            body |= {"floating": True} if self.floating else {}
        else:
            place = f"joint {link.joint.get('name')}"
            origin = self._origin(link.joint, place)
            body["parent"] = names[str(link.parent)]
            turns = (remainder(k, tau) if abs(k) <= TURN else k for k in origin[3:].tolist())
            body |= {"at": origin[:3].tolist(), "orientation": [*turns]}
            joints = list(self._coordinates_of(link.joint, place))
            body |= {"joints": joints} if joints else {}
        return body | self._inertial(link)

    def _inertial(self, link: _Link) -> dict[str, Any]:
        element, place = link.element.find("inertial"), f"link {link.name}.inertial"
        if element is None:
            return {"massless": True}
        origin = self._origin(element, place)
        mass = self._number(element.find("mass"), "value", f"{place}.mass")
        inertia = element.find("inertia")
        moments = [self._number(inertia, f"i{key}", f"{place}.inertia") for key in INERTIA]
        if mass == 0 and not any(moments):
            return {"massless": True}
        turn = rotation_from_angles(origin[3:])
        turned = moments_of(turn @ inertia_tensor(moments) @ turn.T)
        entries = dict(zip(INERTIA, turned, strict=True))
        return {"mass": mass, "center_of_mass": origin[:3].tolist(), "inertia": entries}

    def _coordinates_of(self, joint: Element, place: str) -> Iterator[dict[str, Any]]:
        """Coordinates of a joint as the robot file writes them; none of a fixed one."""
        kind = joint.get("type", "")
        if kind == "fixed":
            return
        if kind not in _MOVING:
            expected = "revolute, continuous, prismatic, fixed, or floating at the root"
            self._refuse(f"{place}.type", expected, _one_line(kind) or "nothing")
            return
        axis = self._numbers(joint.find("axis"), "xyz", 3, f"{place}.axis", (1.0, 0.0, 0.0))
        name = self.coordinates.new(joint.get("name", ""), "joint")
        limit = self._limits(joint, kind, place)
        dynamics = joint.find("dynamics")
        damping = self._number(dynamics, "damping", f"{place}.dynamics", 0.0)
        if self._number(dynamics, "friction", f"{place}.dynamics", 0.0):
            self.left_out.append((place, "its Coulomb friction is left out"))
        mimic = joint.find("mimic")
        if mimic is not None:
            factor = self._number(mimic, "multiplier", f"{place}.mimic", 1.0)
            offset = self._number(mimic, "offset", f"{place}.mimic", 0.0)
            leader = _one_line(mimic.get("joint", ""))
            tie = f"{name} = {factor:g} {leader} + {offset:g}"
            self.left_out.append((place, f"a coordinate of its own; tie {tie} in the gait"))
        found = {"name": name, "type": _MOVING[kind], "axis": axis.tolist()} | limit
        yield found | ({"damping": damping} if damping else {})

    def _limits(self, joint: Element, kind: str, place: str) -> dict[str, Any]:
        element, place = joint.find("limit"), f"{place}.limit"
        limits: dict[str, Any] = {}
        lower, upper = (self._number(element, k, place, 0.0) for k in ("lower", "upper"))
        if kind != "continuous" and (lower or upper):
            limits["limits"] = [lower, upper]
        for key, written in (("speed_limit", "velocity"), ("effort_limit", "effort")):
            most = self._number(element, written, place, 0.0)
            if most:  # 0 is how files say that nobody knows
                limits[key] = most
        return limits

    def _origin(self, holder: Element | None, place: str) -> Any:
        """Position and roll, pitch, yaw of the element <origin>, (6,) [m, rad]."""
        element = holder.find("origin") if holder is not None else None
        place, none = f"{place}.origin", (0.0, 0.0, 0.0)
        parts = [self._numbers(element, k, 3, place, none) for k in ("xyz", "rpy")]
        return np.concatenate(parts)

    def _number(
        self, element: Element | None, key: str, place: str, default: float | None = None
    ) -> float:
        fallback = None if default is None else (default,)
        return float(self._numbers(element, key, 1, place, fallback)[0])

    def _numbers(
        self,
        element: Element | None,
        key: str,
        count: int,
        place: str,
        default: tuple[float, ...] | None,
    ) -> Any:
        """Numbers of an attribute, (count,); the default where it is not written."""
        written = element.get(key) if element is not None else None
        if written is None and default is not None:
            return np.array(default)
        try:
            values = np.array([float(word) for word in (written or "").split()])
        except ValueError:
            values = np.array([np.nan])
        if values.shape != (count,) or not np.isfinite(values).all():
            found = "nothing" if written is None else repr(written)[:60]
            self._refuse(f"{place}.{key}", f"{count} finite number(s)", found)
            return np.ones(count)
        return values

    def _refuse(self, place: str, expected: str, found: str) -> None:
        self.problems.append((place, expected, found))


def _one_line(text: str) -> str:
    return " ".join(text.split())[:60]

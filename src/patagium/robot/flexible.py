"""Bodies that bend and twist: a plate cut into rigid pieces with springs between them.

A beam of bending stiffness EI and torsional stiffness GJ turns by an angle at every point of its
span. Here it turns at n hinges, which lie at the points of Gauss's rule with two points in each of
n/2 equal elements and have the compliance of their share of the span, l/EI and l/GJ. Bending
frequencies converge with the fourth power of the element's length, those of torsion with the
third, by springs between neighboring hinges: a piece turns as a whole where the rod's angle is
linear. Neglected: bending in the plane of the plate, shear, stretching, warping; the elastic axis
is the body's y axis.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from patagium.arrays import Array
from patagium.robot.schema import BodyPart, FlexiblePart, JointPart, Plate


@dataclass(frozen=True)
class Pieces:
    """Rigid pieces of a flexible body.

    Attributes:
        names: Name of each, from the root outwards.
        root: Place of the root's end of the plate along y [m].
        outwards: 1 where the plate goes along y from there, -1 where it goes against it.
        hinges: Distance of each hinge from the root's end, rising, (n,) [m].
    """

    names: tuple[str, ...]
    root: float
    outwards: float
    hinges: Array

    def place(self, y: float) -> tuple[int, float]:
        """Piece that holds a point of the body, and the point's place along y in its axes [m].

        Args:
            y: Place of the point along y in the body's axes [m].
        """
        piece = int(np.searchsorted(self.hinges, self.outwards * (y - self.root)))
        return piece, y - (self.origin(piece) if piece else 0.0)

    def origin(self, piece: int) -> float:
        """Place of a piece's inner hinge along y in the body's axes [m]."""
        return self.root + self.outwards * float(self.hinges[piece - 1])


def pieces_of(name: str, body: BodyPart) -> Pieces:
    """Pieces into which a flexible body is cut."""
    plate, flexible = _plate(body)
    outwards = 1.0 if body.center_of_mass[1] >= 0 else -1.0
    element = 2 * plate.span / flexible.elements
    firsts = element * np.arange(flexible.elements // 2)
    points = element * (0.5 + np.array([-0.5, 0.5]) / np.sqrt(3))
    return Pieces(
        (name, *(f"{name}_{k + 1}" for k in range(flexible.elements))),
        body.center_of_mass[1] - outwards * plate.span / 2,
        outwards,
        np.add.outer(firsts, points).ravel(),
    )


def flexed(bodies: dict[str, BodyPart]) -> dict[str, BodyPart]:
    """Bodies of a file, flexible ones as their pieces, and what hangs on one on its piece."""
    cut = {name: pieces_of(name, body) for name, body in bodies.items() if body.flexible}
    found: dict[str, BodyPart] = {}
    for name, body in bodies.items():
        held = body
        if body.parent in cut:
            x, y, z = body.at
            piece, along = cut[body.parent].place(y)
            parent = cut[body.parent].names[piece]
            held = body.model_copy(update={"parent": parent, "at": (x, along, z)})
        found |= _cut(held, cut[name]) if name in cut else {name: held}
    return found


def _plate(body: BodyPart) -> tuple[Plate, FlexiblePart]:
    if not isinstance(body.shape, Plate) or body.flexible is None:
        raise TypeError("a flexible body is a plate")  # the schema sees to it
    return body.shape, body.flexible


def _cut(body: BodyPart, pieces: Pieces) -> dict[str, BodyPart]:
    """Pieces of a flexible body by name, each with its share of mass and span."""
    plate, flexible = _plate(body)
    x, _, z = body.center_of_mass
    ends, found = np.r_[0.0, pieces.hinges, plate.span], dict[str, BodyPart]()
    for k, (name, length) in enumerate(zip(pieces.names, np.diff(ends), strict=True)):
        middle = pieces.outwards * float(length) / 2 + (0.0 if k else pieces.root)
        changed = {
            "mass": body.mass * float(length) / plate.span,
            "center_of_mass": (x, middle, z),
            "shape": plate.model_copy(update={"span": float(length)}),
        }
        if k:
            before = pieces.origin(k - 1) if k > 1 else 0.0
            changed |= {
                "parent": pieces.names[k - 1],
                "at": (0.0, pieces.origin(k) - before, 0.0),
                "orientation": (0.0, 0.0, 0.0),
                "joints": tuple(_hinge(pieces.names[0], k, plate.span, flexible)),
            }
        found[name] = body.model_copy(update=changed)
    return found


class Hinge(JointPart):
    """Hinge between two pieces, and its coupling to the hinge before; see `Joint`."""

    coupling: float


def _hinge(name: str, number: int, span: float, flexible: FlexiblePart) -> Iterator[JointPart]:
    """Hinges for bending and twist between two pieces of a flexible body."""
    share = span / flexible.elements
    # rod's inertia that a piece has too much, over the distance of the hinges, both in shares
    distance = 2 / np.sqrt(3) if number % 2 == 0 else 2 - 2 / np.sqrt(3)
    coupling = (2 / 3 - 1 / np.sqrt(3)) / distance if number > 1 else 0.0
    for kind, axis, stiffness in (
        ("bend", (1.0, 0.0, 0.0), flexible.bending),
        ("twist", (0.0, 1.0, 0.0), flexible.torsion),
    ):
        if stiffness:
            yield Hinge.model_construct(
                name=f"{name}_{kind}_{number}",
                axis=axis,
                passive=True,
                stiffness=stiffness / share,
                damping=flexible.damping * stiffness / share,
                coupling=coupling if kind == "twist" else 0.0,
            )

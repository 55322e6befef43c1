"""Solids, surfaces, lines and arrows in space, drawn in perspective on a flat page.

Everything becomes small polygons that are painted from the farthest to the nearest (the
painter's algorithm), so that a picture stays a drawing of lines and areas. Faces that
cross one another come out in the order of their middles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb, to_rgba
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_SUN = np.array([-0.4, -0.7, 1.4]) / np.linalg.norm([-0.4, -0.7, 1.4])
_AROUND, _ALONG = 28, 18  # faces around and along what is round


class Camera(NamedTuple):
    """Camera of a picture.

    Attributes:
        eye: In the world, (3,) [m].
        target: What it looks at, (3,) [m]; up is up.
    """

    eye: Array
    target: Array

    def axes(self) -> Array:
        """Rows: to the right, up and toward the eye, (3, 3)."""
        back = self.eye - self.target
        back = back / np.linalg.norm(back)
        right = np.cross([0.0, 0.0, 1.0], back)
        right = right / np.linalg.norm(right)
        return np.stack([right, np.cross(back, right), back])

    def seen(self, points: ArrayLike) -> tuple[Array, Array]:
        """On the page at a distance of one, (..., 2), and distances from the eye, (...) [m].

        Args:
            points: In the world, (..., 3) [m].
        """
        local = (np.asarray(points, float) - self.eye) @ self.axes().T
        depth = np.maximum(-local[..., 2], 1e-6)
        return local[..., :2] / depth[..., None], depth


@dataclass
class Painting:
    """Polygons collected to be painted, far ones first.

    Attributes:
        camera: Where it is seen from.
    """

    camera: Camera
    _flat: list[Array] = field(default_factory=list)
    _depth: list[float] = field(default_factory=list)
    _face: list[Any] = field(default_factory=list)
    _edge: list[Any] = field(default_factory=list)

    def add(self, corners: Array, color: Any, *, alpha: float = 1.0, nearer: float = 0.0) -> None:
        """One polygon.

        Args:
            corners: In the world, (k, 3) [m].
            color: Of its face.
            alpha: How much it hides.
            nearer: As if it were so much nearer [m].
        """
        flat, depth = self.camera.seen(corners)
        self._flat.append(flat)
        self._depth.append(float(depth.mean()) - nearer)
        self._face.append(to_rgba(color, alpha))
        self._edge.append(to_rgba(color, alpha if alpha == 1.0 else 0.0))  # closes seams

    def lit(self, faces: Array, color: Any, under: Any = None, *, nearer: float = 0.0) -> None:
        """Add faces in sunlight, darker on the side turned away from the sun.

        Args:
            faces: Corners in order around each, (m, k, 3) [m].
            color: Of the side from which the corners go counterclockwise.
            under: Of the other side; None: the same.
            nearer: As if they were so much nearer [m].
        """
        normals = normals_of(faces)
        sizes = np.linalg.norm(normals, axis=1)
        for face, normal, size in zip(faces, normals, sizes, strict=True):
            if not size > 0:
                continue
            facing = float(normal @ (self.camera.eye - face.mean(axis=0))) > 0
            toward = normal / size if facing else -normal / size
            light = 0.72 + 0.34 * max(float(toward @ _SUN), -0.35)
            side = to_rgb(color if facing or under is None else under)
            self.add(face, tuple(min(1.0, light * k) for k in side), nearer=nearer)

    def line(
        self, points: Array, color: Any, width: float, *, alpha: float = 1.0, nearer: float = 0.0
    ) -> None:
        """A line in space, so wide on the page at the target.

        Args:
            points: In order, (k, 3) [m].
            color: Of the line.
            width: At the distance of the target [m].
            alpha: How much it hides.
            nearer: As if it were so much nearer [m].
        """
        flat, depth = self.camera.seen(points)
        half = width / 2 / np.linalg.norm(self.camera.eye - self.camera.target)
        for a, b, near, far in zip(flat, flat[1:], depth, depth[1:], strict=False):
            along = b - a
            size = float(np.hypot(*along))
            if not size > 0:
                continue
            across = half * np.array([-along[1], along[0]]) / size
            self._flat.append(np.array([a - across, b - across, b + across, a + across]))
            self._depth.append((near + far) / 2 - nearer)
            self._face.append(to_rgba(color, alpha))
            self._edge.append(to_rgba(color, 0.0))

    def arrow(self, start: Array, vector: Array, color: Any, width: float, **look: Any) -> None:
        """An arrow from a point.

        Args:
            start: (3,) [m].
            vector: From start to end, (3,) [m].
            color: Of the arrow.
            width: Of its shaft [m].
            look: `alpha`, `nearer`.
        """
        length = float(np.linalg.norm(vector))
        if length < width:
            return
        head = min(5.5 * width, 0.6 * length)
        neck = start + vector * (1 - head / length)
        self.line(np.stack([start, neck]), color, width, **look)
        toward = self.camera.eye - neck
        across = np.cross(vector, toward)
        size = float(np.linalg.norm(across))
        if size > 0:
            across *= 0.36 * head / size
            self.add(np.stack([neck - across, start + vector, neck + across]), color, **look)

    def paint(self, axes: Axes) -> None:
        """Draw what was collected.

        Args:
            axes: Where.
        """
        order = np.argsort(self._depth)[::-1]
        flat, face, edge = (
            [kept[k] for k in order] for kept in (self._flat, self._face, self._edge)
        )
        axes.add_collection(PolyCollection(flat, facecolors=face, edgecolors=edge, linewidths=0.25))


def normals_of(faces: Array) -> Array:
    """Twice the area of quadrangles along their normals, by their diagonals, (m, 3) [m^2].

    Args:
        faces: Corners in order around each, (m, 4, 3) [m].
    """
    return np.asarray(np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1]))


def subdivide(corners: Array, times: int) -> Array:
    """A quadrangle cut into times x times smaller ones, (times^2, 4, 3).

    Args:
        corners: Corners in order around it, (4, 3) [m].
        times: Along each edge.
    """
    a, b, c, d = corners
    u = np.linspace(0.0, 1.0, times + 1)
    s, t = np.meshgrid(u, u, indexing="ij")
    s, t = s[..., None], t[..., None]
    grid = (1 - s) * ((1 - t) * a + t * d) + s * ((1 - t) * b + t * c)
    return _quadrangles(grid)


def solid_faces(kind: str, center: Sequence[float], axis: Sequence[float], size: Any) -> Array:
    """Faces of a solid in body axes, counterclockwise as seen from outside, (m, 4, 3) [m].

    Args:
        kind: "cylinder", "capsule", "box" or "ellipsoid"; see `robot.solids.Solid`.
        center: (3,) [m].
        axis: Unit vector along a cylinder or capsule, (3,) [-].
        size: As there [m].
    """
    if kind == "box":
        half = np.array(size) / 2
        faces = []
        for k in range(3):
            u, v = np.eye(3)[(k + 1) % 3], np.eye(3)[(k + 2) % 3]
            for sign in (1.0, -1.0):
                middle = sign * np.eye(3)[k]
                ring = [middle - u - v, middle + sign * (u - v), middle + u + v]
                ring.append(middle - sign * (u - v))
                faces += list(subdivide(np.array(ring) * half, 3))
        return np.asarray(np.array(faces) + center)
    if kind == "ellipsoid":
        polar = np.linspace(-np.pi / 2, np.pi / 2, _ALONG + 1)
        profile = np.stack([np.cos(polar), np.sin(polar)], axis=1)
        return np.asarray(_turned(profile) * np.array(size) + center)
    radius, length = size
    if kind == "capsule":
        polar = np.linspace(0.0, np.pi / 2, 5)
        cap = np.stack([radius * np.cos(polar), length / 2 + radius * np.sin(polar)], axis=1)
    else:
        fillet, polar = min(0.18 * radius, 0.2 * length), np.linspace(0.0, np.pi / 2, 5)
        rim = np.stack([np.cos(polar), np.sin(polar)], axis=1) * fillet
        cap = np.vstack([rim + [radius - fillet, length / 2 - fillet], [0.0, length / 2]])
    side = np.column_stack([np.full(9, cap[0, 0]), np.linspace(-cap[0, 1], cap[0, 1], 9)])
    profile = np.vstack([(cap * [1.0, -1.0])[::-1][:-1], side, cap[1:]])
    return np.asarray(_turned(profile) @ _rotation_onto(np.array(axis, float)).T + center)


def _turned(profile: Array) -> Array:
    """Faces of a body of revolution about z from (radius, height), upward."""
    angle = np.linspace(0.0, 2 * np.pi, _AROUND + 1)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    grid = np.empty((len(angle), len(profile), 3))
    grid[..., :2] = circle[:, None] * profile[None, :, :1]
    grid[..., 2] = profile[:, 1]
    return _quadrangles(grid)


def _quadrangles(grid: Array) -> Array:
    """Quadrangles between neighbors of a grid of points, (m, 4, 3)."""
    around = [grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]]
    return np.stack(around, axis=2).reshape(-1, 4, 3)


def _rotation_onto(axis: Array) -> Array:
    """A rotation that takes z onto an axis, (3, 3)."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(helper, axis)
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis], axis=1)

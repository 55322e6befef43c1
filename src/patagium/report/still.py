"""A moment of a flight as a picture: bodies, wings, forces, paths, shadow, in perspective.

It shows what the replay page shows, in the same colors, as lines and areas for print.
Everything becomes small polygons that are painted from the farthest to the nearest (the
painter's algorithm). Faces that cross one another come out in the order of their middles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from patagium.arrays import Array
from patagium.report.replay_page import Replay
from patagium.report.style import COLORS, SCENE, TRUTH, round_down, styled, width

_SUN = np.array([-0.4, -0.7, 1.4]) / np.linalg.norm([-0.4, -0.7, 1.4])
_AROUND, _ALONG = 28, 18  # faces around and along what is round


@dataclass(frozen=True)
class Camera:
    """Camera of a picture.

    Attributes:
        eye: In the world, (3,) [m].
        target: What it looks at, (3,) [m]; up is up.
    """

    eye: Array
    target: Array

    @cached_property
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
        local = (np.asarray(points, float) - self.eye) @ self.axes.T
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
        """Draw what was collected."""
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
        fillet = min(0.18 * radius, 0.2 * length)
        polar = np.linspace(0.0, np.pi / 2, 5)
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


OBLIQUE = (-0.72, -0.75, 0.55)
"""From behind, from the right and from above."""
_SHAPE = 0.62  # height of a picture over its width
_ROOM = 1.1  # of the picture over what is in it
_CORNERS = 160  # of a path
_LONGEST = 0.5  # arrow, but for the largest 2 %, over what the robot reaches


@styled
def room_of(replay: Replay, frames: Sequence[int]) -> Array:
    """Corners of the robot at some frames, relative to its origin, (N, 3) [m]."""
    return np.concatenate([_Bodies(replay, k).points() - replay.origin[k] for k in frames])


def draw_still(
    replay: Replay,
    frame: int,
    *,
    seen_from: tuple[float, float, float] = OBLIQUE,
    room: Array | None = None,
) -> Figure:
    """A moment of a flight in perspective.

    Args:
        replay: What is to be shown.
        frame: Which of its times.
        seen_from: Direction from the robot to the eye, (3,) [-].
        room: What the picture holds, relative to the robot's origin, (N, 3) [m]; None: the robot
            and its arrows. The same in all pictures of a film.
    """
    bodies = _Bodies(replay, frame)
    points = bodies.points() if room is None else replay.origin[frame] + room
    target = (points.min(axis=0) + points.max(axis=0)) / 2
    direction = np.array(seen_from) / np.linalg.norm(seen_from)
    reach = float(np.linalg.norm(points - target, axis=1).max())
    camera = Camera(target + 5.0 * reach * direction, target)
    painting = Painting(camera)
    ground = replay.ground if replay.ground is not None else points[:, 2].min() - 0.35 * reach
    floor = Painting(camera)
    square = _ground(floor, target, reach, ground)
    shadow = Painting(camera)
    for face in bodies.faces:
        shadow.add(np.column_stack([face[:, :2], np.full(len(face), ground)]), SCENE["shadow"])
    bodies.paint(painting, 0.004 * reach)
    _paths(painting, replay, frame, reach)
    scale, ends = _arrows(painting, replay, frame, reach)
    wide = 0.75 * width()
    figure = Figure(figsize=(wide, _SHAPE * wide), facecolor=SCENE["paper"])
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    for part in (floor, shadow, painting):
        part.paint(axes)
    _frame(axes, camera, np.concatenate([points, ends]) if room is None else points)
    words = [
        f"arrows: {one:.1g} N = {_length(one * scale)}" for one in _legend_forces(scale, reach)
    ]
    words.append(f"grid {_length(square)}")
    behind: dict[str, Any] = {
        "facecolor": SCENE["paper"],
        "alpha": 0.75,
        "linewidth": 0,
        "pad": 2.5,
    }
    place: dict[str, Any] = {"transform": axes.transAxes, "ha": "right", "color": "#5a6570"}
    axes.text(0.985, 0.03, " · ".join(words), bbox=behind, **place)
    return figure


class _Bodies:
    """Faces of everything solid at a frame, in the world."""

    def __init__(self, replay: Replay, frame: int) -> None:
        self.replay = replay
        origin = replay.origin[frame]
        turns = Rotation.from_quat(replay.quaternion[frame]).as_matrix()
        places = origin + replay.position[frame]

        def placed(body: int, faces: Array) -> Array:
            return np.asarray(faces @ turns[body].T + places[body])

        self.solids = [
            (placed(one["body"], _solid(one)), "carrier" if one.get("carrier") else "bodies")
            for one in replay.solids
        ]
        self.strips = [placed(one.body, np.asarray(one.corners)) for one in replay.surfaces]

    @property
    def faces(self) -> list[Array]:
        """All of them, each (k, 3)."""
        return [face for faces, _ in self.solids for face in faces] + self.strips

    def points(self) -> Array:
        """Corners that are to be in the picture, (N, 3)."""
        return np.concatenate([f.reshape(-1, 3) for f, _ in self.solids] + self.strips)

    def paint(self, painting: Painting, thin: float) -> None:
        """With outlines of strips, so wide [m]."""
        for faces, kind in self.solids:
            toward = painting.camera.eye - faces.mean(axis=1)
            painting.lit(faces[(normals_of(faces) * toward).sum(axis=1) > 0], SCENE[kind])
        for corners in self.strips:
            # bones lie in the plane of their wing: they are seen on its near side
            painting.lit(subdivide(corners, 4), SCENE["upper"], SCENE["lower"], nearer=-10 * thin)
            edges = np.concatenate([np.linspace(a, b, 5) for a, b in _ring(corners)])
            painting.line(edges, SCENE["edge"], thin, alpha=0.8, nearer=-8 * thin)


def _ring(corners: Array) -> list[tuple[Array, Array]]:
    return [(corners[k], corners[(k + 1) % len(corners)]) for k in range(len(corners))]


def _solid(one: dict[str, Any]) -> Array:
    return solid_faces(one["kind"], one["center"], one["axis"], one["size"])


def _ground(painting: Painting, target: Array, reach: float, ground: float) -> float:
    """A grid that fades away; the size of its squares [m]."""
    square = round_down(0.55 * reach)
    middle = np.round(target[:2] / square) * square
    wide = 16
    steps = np.arange(-wide, wide + 1)
    for k in steps:
        for across in (0, 1):
            line = np.full((len(steps), 3), ground)
            line[:, across] = middle[across] + k * square
            line[:, 1 - across] = middle[1 - across] + steps * square
            _faded(painting, line, target, reach, "gridMajor" if k % 5 == 0 else "grid")
    return square


def _faded(painting: Painting, line: Array, target: Array, reach: float, kind: str) -> None:
    for a, b in zip(line, line[1:], strict=False):
        away = float(np.linalg.norm(((a + b) / 2 - target)[:2])) / (8.0 * reach)
        if away < 1.0:
            painting.line(np.stack([a, b]), SCENE[kind], 0.0035 * reach, alpha=1.0 - away)


def _paths(painting: Painting, replay: Replay, frame: int, reach: float) -> None:
    """The origin's path and what the wing tips traced in the last wingbeat."""
    time = replay.time
    beat = replay.period or 0.1 * (time[-1] - time[0])
    first = int(np.searchsorted(time, time[frame] - beat))
    shown = np.unique(np.linspace(first, frame, _CORNERS).round().astype(int))
    moved = replay.origin[shown]
    if len(moved) > 1 and np.ptp(moved, axis=0).max() > 0.02 * reach:
        painting.line(moved, SCENE["path"], 0.011 * reach)
    for mark in replay.marks:
        turns = Rotation.from_quat(replay.quaternion[shown, mark.body])
        tip = moved + replay.position[shown, mark.body] + turns.apply(mark.offset)
        painting.line(tip, SCENE["trace"], 0.008 * reach)


def _arrows(painting: Painting, replay: Replay, frame: int, reach: float) -> tuple[float, Array]:
    """Forces on strips, or their total: meters a newton, 0 if there are none, and the ends."""
    arrows = replay.arrows
    if arrows is None:
        return 0.0, np.zeros((0, 3))
    known = arrows.force if arrows.force is not None else arrows.total[:, None]
    points = arrows.point if arrows.point is not None else arrows.center[:, None]
    guess = arrows.predicted if arrows.force is not None else None
    sizes = np.linalg.norm(known, axis=2)
    largest = float(np.quantile(sizes[np.isfinite(sizes)], 0.98))
    if not largest > 0:
        return 0.0, np.zeros((0, 3))
    scale, starts = _LONGEST * reach / largest, replay.origin[frame] + points[frame]
    # predicted ones are a halo under the true ones
    shown = [] if guess is None else [(guess[frame], COLORS[0], 0.026, 0.05, 0.65)]
    shown.append((known[frame], TRUTH, 0.011, 0.06, 1.0))
    for forces, color, wide, near, alpha in shown:
        for start, force in zip(starts, forces, strict=True):
            look = {"alpha": alpha, "nearer": near * reach}
            painting.arrow(start, scale * force, color, wide * reach, **look)
    return scale, starts + scale * known[frame]


def _legend_forces(scale: float, reach: float) -> list[float]:
    """A round force whose arrow is not too short, if there are arrows [N]."""
    return [round_down(0.4 * reach / scale)] if scale else []


def _frame(axes: Any, camera: Camera, points: Array) -> None:
    """Limits that hold the points, in the shape of the picture."""
    flat, _ = camera.seen(points)
    low, high = flat.min(axis=0), flat.max(axis=0)
    middle, half = (low + high) / 2, _ROOM * (high - low) / 2
    half[0] = max(half[0], half[1] / _SHAPE)
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - _SHAPE * half[0], middle[1] + _SHAPE * half[0])
    axes.set_aspect("equal")


def _length(meters: float) -> str:
    value, unit = (meters, "m") if meters >= 1 else (100 * meters, "cm")
    return f"{value:.2g} {unit}"

"""A moment of a flight as a picture: bodies, wings, forces, paths, shadow, in perspective.

It shows what the replay page shows, in the same colors, as areas for print. Matplotlib paints
them from the farthest to the nearest; faces that cross come out in the order of their middles.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb, to_rgba_array
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from mpl_toolkits.mplot3d.proj3d import proj_transform
from scipy.spatial.transform import Rotation

from patagium.arrays import Array
from patagium.report.replay_page import Replay
from patagium.report.style import COLORS, SCENE, TRUTH, round_down, styled, width

_SUN = np.array([-0.4, -0.7, 1.4]) / np.linalg.norm([-0.4, -0.7, 1.4])
_AROUND, _ALONG = 28, 18  # faces around and along what is round


class _Layer:
    """Quadrangles that are painted together, far ones first.

    Args:
        eye: Position of the eye, (3,) [m].
    """

    def __init__(self, eye: Array) -> None:
        self.eye = eye
        self._parts: list[tuple[Array, Array]] = []

    def add(self, faces: Array, color: Any, alpha: Any = 1.0, nearer: float = 0.0) -> None:
        """Add faces, (m, 4, 3) [m], of one color or of one each, sorted as if nearer [m]."""
        toward = self.eye - faces
        moved = faces + nearer * toward / np.linalg.norm(toward, axis=2, keepdims=True)
        colors = np.broadcast_to(to_rgba_array(color, alpha), (len(faces), 4))
        self._parts.append((moved[colors[:, 3] > 0], colors[colors[:, 3] > 0]))

    def lit(self, faces: Array, color: str, under: str | None = None, nearer: float = 0.0) -> None:
        """Add faces in sunlight, counterclockwise, and their other side if it has a color."""
        normals = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
        facing = (normals * (self.eye - faces.mean(axis=1))).sum(axis=1)
        shown = facing > 0 if under is None else facing != 0
        toward = (normals * np.sign(facing)[:, None])[shown]
        toward = toward / np.linalg.norm(toward, axis=1, keepdims=True)
        light = 0.72 + 0.34 * np.maximum(toward @ _SUN, -0.35)
        sides = np.where(facing[shown, None] > 0, to_rgb(color), to_rgb(under or color))
        self.add(faces[shown], np.minimum(1.0, light[:, None] * sides), nearer=nearer)

    def lines(self, points: Array, color: Any, wide: float, **look: Any) -> None:
        """Add lines through points, (..., k, 3) [m], so wide [m]."""
        a, b = points[..., :-1, :].reshape(-1, 3), points[..., 1:, :].reshape(-1, 3)
        across = wide / 2 * self._across(a, b)
        self.add(np.stack([a - across, b - across, b + across, a + across], axis=1), color, **look)

    def arrows(self, starts: Array, vectors: Array, color: Any, wide: float, **look: Any) -> None:
        """Add arrows, (m, 3) [m], but those shorter than they are wide [m]."""
        lengths = np.linalg.norm(vectors, axis=1)
        shown = np.isfinite(lengths) & (lengths >= wide)
        starts, vectors, lengths = starts[shown], vectors[shown], lengths[shown, None]
        heads, ends = np.minimum(5.5 * wide, 0.6 * lengths), starts + vectors
        necks = ends - vectors * heads / lengths
        self.lines(np.stack([starts, necks], axis=1), color, wide, **look)
        across = 0.36 * heads * self._across(necks, ends)
        self.add(np.stack([necks - across, ends, ends, necks + across], axis=1), color, **look)

    def _across(self, a: Array, b: Array) -> Array:
        """Unit vectors across lines as they are seen, (m, 3) [-]."""
        across = np.cross(b - a, self.eye - a)
        return np.asarray(across / np.maximum(np.linalg.norm(across, axis=1), 1e-12)[:, None])

    def paint(self, figure: Figure) -> None:
        """Draw what was added, over what was drawn before."""
        faces, colors = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        edges = colors * (colors[:, 3:] == 1.0)  # close seams
        drawn = Poly3DCollection(faces, facecolors=colors, edgecolors=edges, linewidths=0.25)
        figure.axes[0].add_collection3d(drawn)  # type: ignore[attr-defined]
        drawn.set_clip_box(figure.bbox)


def solid_faces(kind: str, center: Sequence[float], axis: Sequence[float], size: Any) -> Array:
    """Faces of a solid in body axes, counterclockwise as seen from outside, (m, 4, 3) [m].

    Args:
        kind: "cylinder", "capsule", "box" or "ellipsoid"; see `robot.solids.Solid`.
        center: (3,) [m].
        axis: Unit vector along a cylinder or capsule, (3,) [-].
        size: As there [m].
    """
    if kind == "box":
        top = _cut(0.5 * np.array([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]), 3)
        half = np.concatenate([np.roll(top, k, axis=2) for k in range(3)])
        return np.asarray(np.concatenate([half, -half[:, ::-1]]) * np.array(size) + center)
    if kind == "ellipsoid":
        polar = np.linspace(-np.pi / 2, np.pi / 2, _ALONG + 1)
        return np.asarray(_turned(np.cos(polar), np.sin(polar)) * np.array(size) + center)
    radius, length = size
    fillet = radius if kind == "capsule" else min(0.18 * radius, 0.2 * length)
    straight = length / 2 - (0.0 if kind == "capsule" else fillet)
    polar = np.linspace(0.0, np.pi / 2, 5)
    rim = np.append(radius - fillet + fillet * np.cos(polar), 0.0)
    top = np.append(straight + fillet * np.sin(polar), straight + fillet)
    side = np.linspace(-straight, straight, 9)[1:-1]
    widths = np.concatenate([rim[::-1], np.full(7, radius), rim])
    faces = _turned(widths, np.concatenate([-top[::-1], side, top]))
    onto, _ = Rotation.align_vectors([axis], [[0.0, 0.0, 1.0]])
    return np.asarray(faces @ onto.as_matrix().T + center)


def _turned(radius: Array, height: Array) -> Array:
    """Faces of a body of revolution about z, from its foot to its top."""
    angle = np.linspace(0.0, 2 * np.pi, _AROUND + 1)[:, None]
    grid = [radius * np.cos(angle), radius * np.sin(angle), height + 0.0 * angle]
    return _quadrangles(np.stack(grid, axis=2))


def _cut(corners: Array, times: int) -> Array:
    """A quadrangle, (4, 3), cut into times x times smaller ones, (times^2, 4, 3)."""
    a, b, c, d = corners
    return _quadrangles(
        np.linspace(np.linspace(a, d, times + 1), np.linspace(b, c, times + 1), times + 1)
    )


def _quadrangles(grid: Array) -> Array:
    """Quadrangles between neighbors of a grid of points, (m, 4, 3)."""
    around = [grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]]
    return np.stack(around, axis=2).reshape(-1, 4, 3)


OBLIQUE = (-0.72, -0.75, 0.55)
"""Direction of a view from behind, from the right and from above."""
_SHAPE = 0.62  # height of a picture over its width
_ROOM = 1.1  # of the picture over what is in it
_FOCAL = 0.275  # the eye is 5 times as far away as what is seen reaches
_CORNERS = 160  # of a path
_LONGEST = 0.5  # arrow, but for the largest 2 %, over what the robot reaches


def room_of(replay: Replay, frames: Sequence[int]) -> Array:
    """Corners of the robot at some frames, relative to its origin, (N, 3) [m]."""
    found = [faces - replay.origin[k] for k in frames for _, faces in _bodies(replay, k)]
    return np.concatenate(found).reshape(-1, 3)


@styled
def draw_still(
    replay: Replay, frame: int, *, seen_from: Sequence[float] = OBLIQUE, room: Array | None = None
) -> Figure:
    """A moment of a flight in perspective.

    Args:
        replay: Flight to show.
        frame: Which of its times.
        seen_from: Direction from the robot to the eye, (3,) [-].
        room: What the picture holds, relative to the robot's origin, (N, 3) [m]; None: the robot
            and its arrows. The same in all pictures of a film.
    """
    bodies = list(_bodies(replay, frame))
    faces = np.concatenate([faces for _, faces in bodies])
    points = faces.reshape(-1, 3) if room is None else replay.origin[frame] + room
    target = (points.min(axis=0) + points.max(axis=0)) / 2
    reach = float(np.linalg.norm(points - target, axis=1).max())
    ground = replay.ground if replay.ground is not None else points[:, 2].min() - 0.35 * reach
    wide = 0.75 * width()
    figure = Figure(figsize=(wide, _SHAPE * wide), facecolor=SCENE["paper"])
    eye = _look(figure, target, reach, seen_from)
    floor, shadow, scene = _Layer(eye), _Layer(eye), _Layer(eye)
    square = _add_ground(floor, target, reach, ground)
    shadow.add(np.dstack([faces[..., :2], np.full(faces.shape[:2], ground)]), SCENE["shadow"])
    _add_bodies(scene, bodies, 0.004 * reach)
    _add_paths(scene, replay, frame, reach)
    scale, tips, kind = _add_arrows(scene, replay, frame, reach)
    for layer in (floor, shadow, scene):
        layer.paint(figure)
    _fit(figure, np.concatenate([points, tips]) if room is None else points)
    words = f"grid {_length(square)}"
    if scale:
        force = round_down(0.4 * reach / scale)
        words = f"{kind}: {force:g} N = {_length(force * scale)} · {words}"
    behind = {"facecolor": SCENE["paper"], "alpha": 0.75, "linewidth": 0, "pad": 2.5}
    figure.text(0.985, 0.03, words, bbox=behind, ha="right", color="#5a6570")
    return figure


def _look(figure: Figure, target: Array, reach: float, seen_from: Sequence[float]) -> Array:
    """The eye, (3,) [m], of new axes that are seen from a direction."""
    x, y, z = seen_from
    axes: Any = figure.add_subplot(
        **{"projection": "3d", "computed_zorder": False, "facecolor": "none"},
        **{"elev": np.degrees(np.arctan2(z, np.hypot(x, y))), "azim": np.degrees(np.arctan2(y, x))},
        **dict(zip(("xlim", "ylim", "zlim"), target[:, None] + [-reach, reach], strict=True)),
        **{"focal_length": _FOCAL, "box_aspect": (1, 1, 1)},
    )
    axes.set_axis_off()
    across = axes.get_proj()[[0, 1, 3]]  # all three vanish where lines of sight meet
    return -np.asarray(np.linalg.solve(across[:, :3], across[:, 3]), float)


def _fit(figure: Figure, points: Array) -> None:
    """Place the axes so that the points fill the picture."""
    axes: Any = figure.axes[0]
    flat = np.stack(proj_transform(*points.T, axes.get_proj())[:2], axis=1)
    low, high = np.sort(axes.transLimits.transform(flat), axis=0)[[0, -1]]
    size = np.array([1.0, 1.0 / _SHAPE])
    size /= _ROOM * ((high - low) * size).max()
    axes.set_position((*(0.5 - (low + high) / 2 * size), *size))


def _bodies(replay: Replay, frame: int) -> Iterator[tuple[str, Array]]:
    """Color and faces in the world, (m, 4, 3) [m], of everything solid; strips are "upper"."""
    turns = Rotation.from_quat(replay.quaternion[frame]).as_matrix().swapaxes(1, 2)
    places = replay.origin[frame] + replay.position[frame]
    for one in replay.solids:
        faces = solid_faces(one["kind"], one["center"], one["axis"], one["size"])
        kind = "carrier" if one.get("carrier") else "bodies"
        yield kind, faces @ turns[one["body"]] + places[one["body"]]
    for strip in replay.surfaces:
        yield "upper", strip.corners[None] @ turns[strip.body] + places[strip.body]


def _add_bodies(layer: _Layer, bodies: list[tuple[str, Array]], thin: float) -> None:
    """Solids, and strips with outlines so wide [m]."""
    for kind, faces in bodies:
        if kind != "upper":
            layer.lit(faces, SCENE[kind])
            continue
        # bones lie in the plane of their wing: they are seen on its near side
        layer.lit(_cut(faces[0], 4), SCENE[kind], SCENE["lower"], nearer=-10 * thin)
        ring = np.linspace(faces[0], np.roll(faces[0], -1, axis=0), 5, axis=1)
        layer.lines(ring, SCENE["edge"], thin, alpha=0.8, nearer=-8 * thin)


def _add_ground(layer: _Layer, target: Array, reach: float, ground: float) -> float:
    """A grid that fades away; the size of its squares [m]."""
    square, steps = round_down(0.55 * reach), np.arange(-16, 17)
    x, y = square * (np.round(target[:2] / square)[:, None] + steps)
    grid = np.stack([*np.meshgrid(x, y), np.full((33, 33), ground)], axis=2)
    for lines in (grid, grid.swapaxes(0, 1)):
        middle = (lines[:, 1:] + lines[:, :-1])[..., :2] / 2
        away = np.linalg.norm(middle - target[:2], axis=2) / (8.0 * reach)
        for kind, chosen in (("gridMajor", steps % 5 == 0), ("grid", steps % 5 != 0)):
            fade = np.maximum(1.0 - away[chosen].ravel(), 0.0)
            layer.lines(lines[chosen], SCENE[kind], 0.0035 * reach, alpha=fade)
    return square


def _add_paths(layer: _Layer, replay: Replay, frame: int, reach: float) -> None:
    """The origin's path and what the wing tips traced in the last wingbeat."""
    time = replay.time
    beat = replay.period or 0.1 * (time[-1] - time[0])
    first = int(np.searchsorted(time, time[frame] - beat))
    shown = np.unique(np.linspace(first, frame, _CORNERS).round().astype(int))
    moved = replay.origin[shown]
    if np.ptp(moved, axis=0).max() > 0.02 * reach:
        layer.lines(moved, SCENE["path"], 0.011 * reach)
    for mark in replay.marks:
        turns = Rotation.from_quat(replay.quaternion[shown, mark.body])
        tip = moved + replay.position[shown, mark.body] + turns.apply(mark.offset)
        layer.lines(tip, SCENE["trace"], 0.008 * reach)


def _add_arrows(
    layer: _Layer, replay: Replay, frame: int, reach: float
) -> tuple[float, Array, str]:
    """Forces on strips, or their total: meters a newton, 0 if none, the ends, and their name."""
    arrows, kind = replay.arrows, "arrows"
    if arrows is None:
        return 0.0, np.zeros((0, 3)), kind
    known, points, guess = arrows.force, arrows.point, arrows.predicted
    total = arrows.predicted_total
    if known is None or points is None or (guess is None and total is not None):
        known, points, kind = arrows.total[:, None], arrows.center[:, None], "total force"
        guess = None if total is None else total[:, None]
    sizes = np.linalg.norm(known, axis=2)
    largest = float(np.quantile(sizes[np.isfinite(sizes)], 0.98))
    if not largest > 0:
        return 0.0, np.zeros((0, 3)), kind
    scale, starts = _LONGEST * reach / largest, replay.origin[frame] + points[frame]
    if guess is not None:  # a halo under the true ones
        kind = f"predicted in color\n{kind}"
        halo = {"alpha": 0.65, "nearer": 0.05 * reach}
        layer.arrows(starts, scale * guess[frame], COLORS[0], 0.026 * reach, **halo)
    layer.arrows(starts, scale * known[frame], TRUTH, 0.011 * reach, nearer=0.06 * reach)
    return scale, starts + scale * known[frame], kind


def _length(meters: float) -> str:
    power, unit = next((k for k in ((1, "m"), (100, "cm")) if k[0] * meters >= 1), (1000, "mm"))
    return f"{power * meters:.3g} {unit}"

"""A moment of a flight as a picture: bodies, wings, forces, paths, shadow, in perspective.

It shows what the replay page shows, in the same colors, as lines and areas for print.
The drawing has the limits of `perspective`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from patagium.report.perspective import Camera, Painting, normals_of, solid_faces, subdivide
from patagium.report.replay_page import Replay
from patagium.report.style import COLORS, SCENE, TRUTH, round_down, styled, width

Array = NDArray[np.float64]

OBLIQUE = (-0.72, -0.75, 0.55)
"""From behind, from the right and from above."""
_SHAPE = 0.62  # height of a picture over its width
_ROOM = 1.1  # of the picture over what is in it
_CORNERS = 160  # of a path
_LONGEST = 0.5  # arrow, but for the largest 2 %, over what the robot reaches


@styled
def draw_still(
    replay: Replay, frame: int, *, seen_from: tuple[float, float, float] = OBLIQUE
) -> Figure:
    """A moment of a flight in perspective.

    Args:
        replay: What is to be shown.
        frame: Which of its times.
        seen_from: Direction from the robot to the eye, (3,) [-].
    """
    bodies = _Bodies(replay, frame)
    points = bodies.points()
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
    _frame(axes, camera, np.concatenate([points, ends]))
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

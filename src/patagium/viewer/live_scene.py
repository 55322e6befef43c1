"""The robot of a live page: bodies and wings where the kinematics puts them, forces as arrows.

World axes, x forward, y left, z up. What is drawn is shifted by a path that follows the robot
averaged over a wingbeat, so that the browser's own camera stays with it. The flow is not shown.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from patagium.dynamics.dynamics import Poses
from patagium.learning.scores import INTERVAL
from patagium.report.style import COLORS, SCENE, TRUTH, round_down
from patagium.robot import Robot
from patagium.robot.drawing import strip_corners
from patagium.robot.solids import Solid, solids, wing_tips
from patagium.viewer.replay import center_of_mass, quaternions

Array = NDArray[np.float64]

_BODIES, _UPPER, _LOWER, _EDGE = (SCENE[k] for k in ("bodies", "upper", "lower", "edge"))
_GRID, _MAJOR, _PATH = (SCENE[k] for k in ("grid", "gridMajor", "path"))
_AXES = {"x": "#c23b3b", "y": "#3a8f4d", "z": "#3a62c2"}
_BEHIND = (-0.72, -0.75, 0.62)  # where the camera is, from the robot
_AWAY = 5.2  # times the reach
_TRAIL = 240  # points
_STILL = 0.2  # s over which the path is averaged where there is no wingbeat


def rgb(color: str) -> tuple[int, int, int]:
    """A color such as "#336699" as numbers from 0 to 255."""
    red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return red, green, blue


def arrow_rgb(color: str) -> tuple[int, int, int]:
    """Color of an arrow from 0 to 255 as linear light, which viser expects for arrows."""
    parts = np.array(rgb(color)) / 255.0
    linear = np.where(parts > 0.04045, ((parts + 0.055) / 1.055) ** 2.4, parts / 12.92)
    red, green, blue = (int(part) for part in np.round(255.0 * linear))
    return red, green, blue


class LiveScene:
    """Scene in front of the camera.

    Args:
        scene: viser's.
        robot: The machine.
        beat: One wingbeat [s]; None where unknown.
    """

    def __init__(self, scene: Any, robot: Robot, beat: float | None) -> None:
        self._scene, self._robot = scene, robot
        self._poses = Poses(robot)
        self._span = beat or _STILL
        position, rotation = self._poses(robot.coordinates()[None])
        tips = wing_tips(robot).values()
        reaches = [position[0, b] - position[0, 0] + rotation[0, b] @ tip for b, tip in tips]
        reaches += list(position[0] - position[0, 0])
        self.reach = float(max(np.linalg.norm(place) for place in reaches)) or 0.5
        self.following = True
        self.meters_per_newton = 0.0
        self._anchor, self._time, self._ground = position[0, 0].copy(), np.nan, np.inf
        self._before, self._velocity = self._anchor, np.zeros(3)
        self._trail: list[Array] = []
        carriers = {s.body for s in robot.strips}
        self._carried = {
            b: [k for k, s in enumerate(robot.strips) if s.body == b] for b in carriers
        }
        self._quarter = np.array([s.quarter_chord for s in robot.strips], float).reshape(-1, 3)
        self._build()

    @property
    def camera(self) -> tuple[Array, Array]:
        """First position of the camera and of its target, (3,) each [m]."""
        toward = np.array(_BEHIND) / np.linalg.norm(_BEHIND)
        return _AWAY * self.reach * toward, np.zeros(3)

    def forget(self) -> None:
        """Begin again: another flight."""
        self._time, self._trail, self._ground = np.nan, [], np.inf

    def show(self, time: float, q: Array) -> None:
        """The robot at a time.

        Args:
            time: [s].
            q: Generalized coordinates, (n_q,) [m, rad, 1].
        """
        position, rotation = self._poses(q[None])
        origin = position[0, 0]
        if self.following:
            self._follow(time, origin)
        self._time = time
        turns = np.roll(quaternions(rotation)[0], 1, axis=-1)  # w x y z
        for body, place, turn in zip(self._bodies, position[0], turns, strict=True):
            body.position, body.wxyz = place - self._anchor, turn
        self._rotation = rotation[0]
        self._center = center_of_mass(self._robot, position, rotation)[0] - self._anchor
        self._lay_ground(origin)
        self._draw_trail(origin)

    def show_forces(
        self, kind: str, total: Array | None, strips: Array | None, std: Array | None = None
    ) -> None:
        """Forces as arrows: in all at the center of mass, and on strips.

        Args:
            kind: "true" or "predicted".
            total: (3,) [N], or None.
            strips: (n_strips, 3) [N], or None.
            std: Standard deviation of the total, (3,) [N]; drawn as the ellipsoid whose
                semi-axes are the 95 % interval of each component.
        """
        self._rescale(total, strips)
        at, color = self._center[None], arrow_rgb(TRUTH if kind == "true" else COLORS[0])
        width = self.reach * (0.011 if kind == "true" else 0.016)
        whole = None if total is None else total[None]
        self._arrows(f"/forces/{kind}", at, whole, color, width)
        for body, carried in self._carried.items():  # in its axes, so that they move with it
            inside = None if strips is None else strips[carried] @ self._rotation[body]
            name = f"/robot/{self._robot.bodies[body].name}/{kind}"
            self._arrows(name, self._quarter[carried], inside, color, 0.55 * width)
        shown = total is not None and std is not None and bool(np.isfinite(std).all())
        if kind == "predicted":
            self._interval.visible = shown
        if shown and total is not None and std is not None:
            self._interval.position = self._center + self.meters_per_newton * total
            size = np.maximum(INTERVAL * self.meters_per_newton * std, 1e-3 * self.reach)
            self._interval.scale = tuple(map(float, size))

    def _build(self) -> None:
        scene, reach = self._scene, self.reach
        scene.set_up_direction("+z")
        scene.configure_default_lights(enabled=False)  # shadows take most of the time in software
        scene.configure_environment_map(None)
        scene.add_light_hemisphere("/sky", rgb("#ffffff"), rgb("#b9c4cd"), intensity=1.75)
        scene.add_light_directional(
            "/sun", rgb("#ffffff"), intensity=1.7, position=(-0.4, -0.7, 1.4)
        )
        scene.configure_fog(8.0 * reach, 40.0 * reach, color=(247, 249, 250))
        self._bodies = [
            scene.add_frame(f"/robot/{body.name}", show_axes=False) for body in self._robot.bodies
        ]
        for number, solid in enumerate(solids(self._robot)):
            self._add_solid(f"/robot/{self._robot.bodies[solid.body].name}/solid{number}", solid)
        for index, body in enumerate(self._robot.bodies):
            self._add_wing(f"/robot/{body.name}/wing", index)
        self._square = round_down(0.6 * reach)
        self._grid = scene.add_grid(
            "/ground", infinite_grid=True, cell_size=self._square, section_size=5 * self._square,
            cell_color=rgb(_GRID), section_color=rgb(_MAJOR), fade_distance=40.0 * reach,
            fade_strength=1.5, shadow_opacity=0.2,
        )  # fmt: skip
        self._axes = scene.add_frame("/axes", show_axes=False)
        for number, (name, color) in enumerate(_AXES.items()):
            tip = 0.55 * self._square * np.eye(3)[number]
            points, width = np.array([[np.zeros(3), tip]]), 0.008 * reach
            scene.add_arrows(
                f"/axes/{name}", points, arrow_rgb(color), shaft_radius=width,
                head_radius=2.6 * width, head_length=8 * width,
            )  # fmt: skip
            scene.add_label(f"/axes/{name}/name", name, position=1.12 * tip)
        self._interval = scene.add_icosphere(
            "/forces/interval", 1.0, rgb(COLORS[0]), opacity=0.28, cast_shadow=False,
            receive_shadow=False, visible=False,
        )  # fmt: skip
        self._handles: dict[str, Any] = {}
        self._path: Any = None

    def _add_solid(self, name: str, solid: Solid) -> None:
        mesh = _mesh_of(solid)
        self._scene.add_mesh_simple(
            name, np.asarray(mesh.vertices), np.asarray(mesh.faces), color=rgb(_BODIES)
        )

    def _add_wing(self, name: str, body: int) -> None:
        corners = [strip_corners(strip) for strip in self._robot.strips if strip.body == body]
        if not corners:
            return
        points = np.concatenate(corners)
        first = 4 * np.arange(len(corners))[:, None]
        faces = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])
        for side, color in (("front", _UPPER), ("back", _LOWER)):
            self._scene.add_mesh_simple(
                f"{name}/{side}", points, faces, color=rgb(color), side=side, flat_shading=True,
                opacity=0.92,
            )  # fmt: skip
        edges = np.concatenate([np.stack([k, np.roll(k, -1, axis=0)], axis=1) for k in corners])
        self._scene.add_line_segments(
            f"{name}/edges", edges, rgb(_EDGE), thickness=1.2, thickness_units="screen"
        )

    def _follow(self, time: float, origin: Array) -> None:
        """The anchor moves to the robot's path averaged over a wingbeat."""
        passed = time - self._time
        if not 0 <= passed < 5 * self._span:
            self._anchor = origin.copy()
            self._velocity = np.zeros(3)
            self._before = origin.copy()
            return
        share = 1.0 - np.exp(-passed / self._span)
        if passed > 0:
            self._velocity += share * ((origin - self._before) / passed - self._velocity)
            self._before = origin.copy()
        ahead = origin - (self._anchor + self._velocity * passed)
        self._anchor = self._anchor + self._velocity * passed + share * ahead

    def _lay_ground(self, origin: Array) -> None:
        step = self._square
        below = step * np.floor((origin[2] - 1.25 * self.reach) / step)
        self._ground = min(self._ground, below)
        near = 5 * step * np.round(self._anchor[:2] / (5 * step))
        place = np.array([*near, self._ground]) - self._anchor
        self._grid.position = place
        self._axes.position = np.array([0.0, 0.0, place[2]])

    def _draw_trail(self, origin: Array) -> None:
        far = not self._trail or np.linalg.norm(origin - self._trail[-1]) > 0.02 * self.reach
        if far:
            self._trail = [*self._trail[1 - _TRAIL :], origin.copy()]
        points = np.array([*self._trail, origin]) - self._anchor
        pieces = np.stack([points[:-1], points[1:]], axis=1)
        if self._path is None:
            self._path = self._scene.add_line_segments(
                "/path", pieces, rgb(_PATH), thickness=2.2, thickness_units="screen"
            )
        self._path.points = pieces

    def _rescale(self, total: Array | None, strips: Array | None) -> None:
        """Meters a newton, a round number, such that the largest force so far fits."""
        given = [force for force in (total, strips) if force is not None and _drawn(force)]
        if not given:
            return
        largest = max(float(np.linalg.norm(force, axis=-1).max()) for force in given)
        fits = 0.0 < self.meters_per_newton * largest < 1.3 * self.reach
        if largest > 0 and not fits:
            self.meters_per_newton = round_down(0.9 * self.reach / largest)

    def _arrows(
        self, name: str, at: Array, force: Array | None, color: tuple[int, int, int], width: float
    ) -> None:
        handle = self._handles.get(name)
        if force is None or not _drawn(force):
            if handle is not None:
                handle.visible = False
            return
        points = np.stack([at, at + self.meters_per_newton * np.nan_to_num(force)], axis=1)
        if handle is None:
            self._handles[name] = self._scene.add_arrows(
                name, points, color, shaft_radius=width, head_radius=2.6 * width,
                head_length=7 * width,
            )  # fmt: skip
            return
        handle.points, handle.visible = points, True


def _drawn(force: Array) -> bool:
    return bool(force.size) and bool(np.isfinite(force).all())


def _mesh_of(solid: Solid) -> Any:
    """A solid as triangles in body axes."""
    made: Any
    if solid.kind == "box":
        made = trimesh.creation.box(extents=solid.size)
    elif solid.kind == "ellipsoid":
        made = trimesh.creation.icosphere(subdivisions=3)
        made.apply_scale(solid.size)
    elif solid.kind == "capsule":
        radius, length = solid.size
        made = trimesh.creation.capsule(height=length, radius=radius, count=(12, 12))
        made.apply_translation(-made.bounds.mean(axis=0))
    else:
        radius, length = solid.size
        made = trimesh.creation.cylinder(radius=radius, height=length, sections=32)
    if solid.kind in ("capsule", "cylinder"):
        geometry: Any = trimesh.geometry
        made.apply_transform(geometry.align_vectors([0, 0, 1], solid.axis))
    made.apply_translation(solid.center)
    return made

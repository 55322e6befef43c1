"""A live page: the scene, numbers, plots, and what may be asked of a simulation.

Everything runs in the page's process: poses, forces on strips by the weights that the learner
has by now, histories of what is plotted. In the scene the robot is shifted by a path that
follows it averaged over a wingbeat, so that the browser's own camera stays with it; plots keep a
bounded number of points. Nothing is shown of the time before the page was served, nor the flow.
"""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any, TypeGuard

import numpy as np
import viser
from jinja2 import Environment, StrictUndefined, Template
from PIL.ImageColor import getrgb as rgb

from patagium.arrays import Array, Indices
from patagium.dynamics.dynamics import Poses
from patagium.errors import is_finite
from patagium.learning.scores import INTERVAL
from patagium.report.still import solid_faces
from patagium.report.style import COLORS, SCENE, TRUTH, round_down
from patagium.robot import Robot
from patagium.robot.planform import strip_corners
from patagium.robot.solids import solids, wing_tips
from patagium.viewer.live_door import Door
from patagium.viewer.live_frames import FORCES, Mailbox, Steering, Subject
from patagium.viewer.predicted_forces import strip_force_network
from patagium.viewer.replay import center_of_mass, quaternions

Row = tuple[str, str]


@cache
def _template() -> Template:
    text = files("patagium.viewer").joinpath("live_numbers.html").read_text("utf-8")
    return Environment(autoescape=True, undefined=StrictUndefined).from_string(text)


def _number(value: float, kind: str, unit: str = "") -> str:
    return f"{value:{kind}}{unit}" if np.isfinite(value) else "–"


_KEPT = 1200
_FIRST = ("z", "x", "pitch")
_FORCES = 3
_HIGH, _LOW = 128, 104  # px, scores
_CURSOR = {"sync": {"key": "live"}, "drag": {"setScale": False, "x": False, "y": False}}


class LivePlots:
    """Plots in the open container.

    Args:
        gui: viser's.
        subject: Subject of the page.
        door: Door that lets the choices of forces in.
    """

    def __init__(self, gui: Any, subject: Subject, door: Door) -> None:
        self._subject = subject
        m = len(subject.outputs)
        self._trace = np.empty((0, 1 + len(FORCES) * m))
        self._scores = np.empty((0, 3))
        order = [*(k for k in _FIRST if k in subject.outputs), *subject.outputs]
        self._shown = list(dict.fromkeys(order))[:_FORCES]
        self._learned = subject.network is not None
        names = ["measured", "predicted", "low", "high"][: 4 if self._learned else 1]
        self._plots = [_plot(gui, self._title(name), names) for name in self._shown]
        if self._learned:
            self._error = _plot(gui, "Error: log10 of mean square over variance", ["NMSE"])
            self._coverage = _plot(gui, "Measurements in the 95 % interval [%]", ["inside", "95 %"])
        with gui.add_folder("Forces shown", expand_by_default=False):
            for place, name in enumerate(self._shown):
                choice = gui.add_dropdown(f"Plot {place + 1}", subject.outputs, initial_value=name)
                door.allow(choice, subject.outputs.__contains__)
                choice.on_update(lambda _, k=place, one=choice: self._choose(k, one.value))

    def add(self, letter: Any) -> None:
        """Add the samples and scores of a frame."""
        fresh = letter["trace"][: letter["traced"]]
        fresh = fresh[fresh[:, 0] <= letter["time"]]  # later ones are of the flight before
        self._trace = np.concatenate([self._trace, fresh])[-_KEPT:]
        score = np.array([[letter["time"], letter["nmse"], letter["coverage"]]])
        self._scores = np.concatenate([self._scores, score])[-_KEPT:]

    def forget(self) -> None:
        """Begin again: another flight."""
        self._trace, self._scores = self._trace[:0], self._scores[:0]

    def draw(self) -> None:
        """Draw all plots."""
        if len(self._trace) < 2:
            return
        for name, plot in zip(self._shown, self._plots, strict=True):
            plot.data = _drawable(*self._lines(name))
        if self._learned:
            time, error, inside = self._scores.T
            self._error.data = _drawable(time, np.log10(np.where(error > 0, error, np.nan)))
            self._coverage.data = _drawable(time, 100.0 * inside, np.full_like(time, 95.0))

    def _choose(self, place: int, name: str) -> None:
        self._shown[place] = name
        self._plots[place].title = self._title(name)
        self.draw()

    def _title(self, name: str) -> str:
        robot = self._subject.robot
        return f"Force of the air on {name} [{robot.force_units[robot.index(name)]}]"

    def _lines(self, name: str) -> tuple[Array, ...]:
        outputs, time = self._subject.outputs, self._trace[:, 0]
        truth, guess, std = self._trace[:, 1 + outputs.index(name) :: len(outputs)].T
        if self._subject.network is None:
            return time, truth
        known = np.r_[truth, guess]
        known = known[np.isfinite(known)]
        reach = np.minimum(INTERVAL * std, np.ptp(known) if len(known) else np.inf)  # else too flat
        return time, truth, guess, guess - reach, guess + reach


def _drawable(*lines: Array) -> tuple[Array, ...]:
    """Lines that begin with their first finite value, or 0: uPlot takes limits from the first."""
    found = np.where(np.isfinite(lines), lines, np.nan)
    known = np.isfinite(found).argmax(axis=1)
    found[:, 0] = np.nan_to_num(found[np.arange(len(lines)), known])
    return tuple(found)


def _plot(gui: Any, title: str, names: Sequence[str]) -> Any:
    """An empty plot; of four series the last two are the edges of a band."""
    looks: dict[str, dict[str, Any]] = {
        "measured": {"stroke": TRUTH, "width": 1.6},
        **dict.fromkeys(("predicted", "NMSE", "inside"), {"stroke": COLORS[0], "width": 1.6}),
        **dict.fromkeys(("low", "high"), {"stroke": "rgba(213, 94, 0, 0.25)", "width": 1}),
        "95 %": {"stroke": "#7b8894", "width": 1, "dash": (6, 4)},
    }
    lines = ({"label": name, "points": {"show": False}, **looks[name]} for name in names)
    series = {"label": "t [s]"}, *lines
    axis = {"font": "11px sans-serif", "size": 26, "labelFont": "11px sans-serif"}
    axes = (
        {**axis, "label": "t [s]", "labelSize": 15, "labelGap": 0},
        {**axis, "size": 52, "space": 18},
    )
    band = ({"series": (4, 3), "fill": "rgba(213, 94, 0, 0.16)"},) if "high" in names else None
    start = tuple(np.full(2, np.nan) if k else np.array([0.0, 1.0]) for k in range(len(series)))
    return gui.add_uplot(
        start,
        series,
        title=title,
        scales={"x": {"time": False}},
        axes=axes,
        bands=band,
        cursor=_CURSOR,
        legend={"show": False},
        height=_HIGH if names[0] == "measured" else _LOW,
        padding=(4, 12, 0, 0),
    )


_BODIES, _UPPER, _LOWER, _EDGE = (SCENE[k] for k in ("bodies", "upper", "lower", "edge"))
_GRID, _MAJOR, _PATH = (SCENE[k] for k in ("grid", "gridMajor", "path"))
_AXES = {"x": "#c23b3b", "y": "#3a8f4d", "z": "#3a62c2"}
_BEHIND = (-0.9, -0.75, 0.3)  # where the camera is, from the robot: hardly a force points there
_AWAY = 5.2  # times the reach
_TRAIL = 240  # points
_FADING = 0.995  # of the largest force, from frame to frame
_STILL = 0.2  # s over which the path is averaged where there is no wingbeat


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
        beat: Duration of a wingbeat [s]; None where unknown.
    """

    def __init__(self, scene: Any, robot: Robot, beat: float | None) -> None:
        self._scene, self._robot = scene, robot
        self._poses = Poses(robot)
        self._span = beat or _STILL
        position, rotation = self._poses(robot.coordinates()[None])
        tips = wing_tips(robot).values()
        ends = [*position[0], *(position[0, b] + rotation[0, b] @ tip for b, tip in tips)]
        self.reach = float(np.linalg.norm(ends - position[0, 0], axis=1).max()) or 0.5
        self.following = True
        self.scales: dict[str, float] = {}
        self._largest: dict[str, float] = {}
        self._anchor, self._time, self._ground = position[0, 0].copy(), np.nan, np.inf
        self._before, self._velocity = self._anchor, np.zeros(3)
        self._trail: list[Array] = []
        self._carried: dict[int, list[int]] = {}
        for k, strip in enumerate(robot.strips):
            self._carried.setdefault(strip.body, []).append(k)
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
        self._rescale("total", total)
        self._rescale("strip", strips)
        at, color = self._center[None], arrow_rgb(TRUTH if kind == "true" else COLORS[0])
        width = self.reach * (0.013 if kind == "true" else 0.02)
        whole = None if total is None else total[None]
        self._arrows(f"/forces/{kind}", at, whole, color, width, "total")
        for body, carried in self._carried.items():  # in its axes, so that they move with it
            inside = None if strips is None else strips[carried] @ self._rotation[body]
            name = f"/robot/{self._robot.bodies[body].name}/{kind}"
            self._arrows(name, self._quarter[carried], inside, color, 0.7 * width, "strip")
        if kind == "predicted":
            self._interval.visible = total is not None and _drawn(std)
        if total is not None and _drawn(std):
            scale = self.scales.get("total", 0.0)
            self._interval.position = self._center + scale * total
            size = np.maximum(INTERVAL * scale * std, 1e-3 * self.reach)
            self._interval.scale = tuple(map(float, size))

    def _build(self) -> None:
        """Put lights, bodies, wings and ground into the scene."""
        scene, reach = self._scene, self.reach
        scene.set_up_direction("+z")
        scene.configure_default_lights(enabled=False)  # shadows take most of the time in software
        scene.configure_environment_map(None)
        sky, ground, at = rgb("#ffffff"), rgb("#b9c4cd"), (-0.4, -0.7, 1.4)
        scene.add_light_hemisphere("/sky", sky_color=sky, ground_color=ground, intensity=1.75)
        scene.add_light_directional("/sun", color=sky, intensity=1.7, position=at)
        scene.configure_fog(8.0 * reach, 40.0 * reach, color=(247, 249, 250))
        self._bodies = [
            scene.add_frame(f"/robot/{body.name}", show_axes=False) for body in self._robot.bodies
        ]
        for number, solid in enumerate(solids(self._robot)):
            corners = solid_faces(*solid[1:]).reshape(-1, 3).round(9)
            points, places = np.unique(corners, axis=0, return_inverse=True)
            name = f"/robot/{self._robot.bodies[solid.body].name}/solid{number}"
            scene.add_mesh_simple(name, points, _triangles(places), color=rgb(_BODIES))
        for index, body in enumerate(self._robot.bodies):
            self._add_wing(f"/robot/{body.name}/wing", index)
        self._square = round_down(0.6 * reach)
        self._grid = scene.add_grid(
            "/ground",
            infinite_grid=True,
            cell_size=self._square,
            section_size=5 * self._square,
            cell_color=rgb(_GRID),
            section_color=rgb(_MAJOR),
            fade_distance=40.0 * reach,
            fade_strength=1.5,
            shadow_opacity=0.2,
        )
        self._axes = scene.add_frame("/axes", show_axes=False)
        for number, (name, color) in enumerate(_AXES.items()):
            tip = self._square * np.eye(3)[number]
            points = np.array([[np.zeros(3), tip]])
            self._new_arrows(f"/axes/{name}", points, arrow_rgb(color), 0.008 * reach, 8)
            length = f"{name}, {100 * self._square:g} cm" if name == "x" else name
            scene.add_label(f"/axes/{name}/name", length, position=1.12 * tip)
        self._interval = scene.add_icosphere(
            "/forces/interval",
            1.0,
            rgb(COLORS[0]),
            opacity=0.28,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )
        self._handles: dict[str, Any] = {}
        self._path: Any = None

    def _add_wing(self, name: str, body: int) -> None:
        """Add the strips of a body to the scene, colored above and below."""
        corners = [strip_corners(strip) for strip in self._robot.strips if strip.body == body]
        if not corners:
            return
        points = np.concatenate(corners)
        faces = _triangles(np.arange(len(points)))
        for side, color in (("front", _UPPER), ("back", _LOWER)):
            self._scene.add_mesh_simple(
                f"{name}/{side}",
                points,
                faces,
                color=rgb(color),
                side=side,
                flat_shading=True,
                opacity=0.92,
            )
        edges = np.concatenate([np.stack([k, np.roll(k, -1, axis=0)], axis=1) for k in corners])
        self._scene.add_line_segments(
            f"{name}/edges", edges, rgb(_EDGE), thickness=1.2, thickness_units="screen"
        )

    def _follow(self, time: float, origin: Array) -> None:
        """The anchor moves to the robot's path averaged over a wingbeat."""
        passed = time - self._time
        if not 0 <= passed < 5 * self._span:
            self._anchor = self._before = origin.copy()
            self._velocity = np.zeros(3)
            return
        share = 1.0 - np.exp(-passed / self._span)
        if passed > 0:
            self._velocity += share * ((origin - self._before) / passed - self._velocity)
            self._before = origin.copy()
        moved = self._anchor + self._velocity * passed
        self._anchor = moved + share * (origin - moved)

    def _lay_ground(self, origin: Array) -> None:
        step = self._square
        below = step * np.floor((origin[2] - 1.25 * self.reach) / step)
        self._ground = min(self._ground, below)
        near = 5 * step * np.round(self._anchor[:2] / (5 * step))
        place = np.array([*near, self._ground]) - self._anchor
        self._grid.position = place
        self._axes.position = np.array([0.0, 0.0, place[2]])

    def _draw_trail(self, origin: Array) -> None:
        if not self._trail or np.linalg.norm(origin - self._trail[-1]) > 0.02 * self.reach:
            self._trail = [*self._trail[1 - _TRAIL :], origin.copy()]
        points = np.array([*self._trail, origin]) - self._anchor
        pieces = np.stack([points[:-1], points[1:]], axis=1)
        if self._path is None:
            self._path = self._scene.add_line_segments(
                "/path", pieces, rgb(_PATH), thickness=2.2, thickness_units="screen"
            )
        self._path.points = pieces

    def _rescale(self, kind: str, force: Array | None) -> None:
        """Length of an arrow of one newton [m], rounded so that the recent largest force fits."""
        if not _drawn(force):
            return
        now = float(np.linalg.norm(force, axis=-1).max())
        largest = self._largest[kind] = max(now, _FADING * self._largest.get(kind, 0.0))
        length = self.scales.get(kind, 0.0) * largest / self.reach
        if largest > 0 and not 0.3 < length < 1.3:
            self.scales[kind] = round_down(0.9 * self.reach / largest)

    def _arrows(
        self,
        name: str,
        at: Array,
        force: Array | None,
        color: tuple[int, int, int],
        width: float,
        kind: str,
    ) -> None:
        """Draw arrows of forces, or hide them where no force is known."""
        handle = self._handles.get(name)
        if not _drawn(force):
            if handle is not None:
                handle.visible = False
            return
        points = np.stack([at, at + self.scales.get(kind, 0.0) * np.nan_to_num(force)], axis=1)
        if handle is None:
            self._handles[name] = self._new_arrows(name, points, color, width, 5)
            return
        handle.points, handle.visible = points, True

    def _new_arrows(
        self, name: str, points: Array, color: tuple[int, int, int], width: float, head: float
    ) -> Any:
        """Arrows in the scene, with heads as long as so many widths."""
        sizes = {"head_radius": 2.6 * width, "head_length": head * width}
        return self._scene.add_arrows(name, points, color, shaft_radius=width, **sizes)


def _triangles(places: Indices) -> Indices:
    """Triangles of quadrangles whose corners are points in a row, by the places of these."""
    return places.reshape(-1, 4)[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def _drawn(force: Array | None) -> TypeGuard[Array]:
    return force is not None and force.size > 0 and bool(np.isfinite(force).all())


_NUMBERS = 0.2  # s between two looks at the numbers
_PLOTS = 0.12  # s between two plots


class LivePage:
    """Page in a browser.

    Args:
        subject: Subject of the page.
        host: Address.
        port: Port; 0: any that is free.
        token: First part of the path of its address, which nobody can guess.
        commands: Mailbox of the commands given on the page.

    Raises:
        OSError: If the port was taken meanwhile.
        ParameterError: If viser cannot be guarded.
    """

    def __init__(
        self, subject: Subject, host: str, port: int, token: str, commands: Mailbox
    ) -> None:
        self._subject, self._commands = subject, commands
        self._door = Door(host, token)
        place = host if ":" in host else socket.gethostbyname(host)  # one address of a name
        with self._door.guarding():
            self._server = viser.ViserServer(place, port, label="patagium", verbose=False)
        self.port = int(self._server.get_port())
        if port and self.port != port:
            self._server.stop()
            raise OSError(f"port {port} was taken meanwhile")
        self._asked: dict[str, Any] = {
            "frequency": 0.0,
            "amplitude": 1.0,
            "paused": False,
            "resets": 0,
            "drawn": 0,
        }
        network = subject.network
        self._strips = None if network is None else strip_force_network(network, subject.robot)
        self._last: Any = None
        self._numbered = self._plotted = -np.inf
        self._seen: list[tuple[float, float, int]] = []  # wall clock, time, samples
        self._build()

    def show(self, letters: Sequence[Any], sent: int) -> None:
        """Draw the last frame and plot all frames that have come.

        Args:
            letters: Frames, oldest first.
            sent: Number of frames sent so far.
        """
        # by the thread that serves: viser's messages are not safe in another
        drawing = self._show(letters, sent)
        asyncio.run_coroutine_threadsafe(drawing, self._server.get_event_loop()).result()

    async def _show(self, letters: Sequence[Any], sent: int) -> None:
        now = time.monotonic()
        for letter in letters:
            if self._last is not None and letter["time"] < self._last["time"]:
                self._scene.forget()  # another flight
                self._plots.forget()
                self._seen = []
            self._plots.add(letter)
            self._last = letter
        if self._last is None or not self._server.get_clients():
            return
        if letters:
            with self._server.atomic():
                self._draw(self._last)
            self._ask("drawn", self._asked["drawn"] + 1)
        if now - self._plotted > _PLOTS and letters:
            self._plots.draw()
            self._plotted = now
        if now - self._numbered > _NUMBERS:
            self._count(now, sent)
            self._numbered = now

    def close(self) -> None:
        """Stop serving the page."""
        self._server.stop()

    def _build(self) -> None:
        """Lay out the page: scene, camera, numbers, plots and buttons."""
        gui, subject = self._server.gui, self._subject
        gui.configure_theme(
            show_logo=False, show_share_button=False, brand_color=rgb(COLORS[1])[:3]
        )
        self._scene = LiveScene(self._server.scene, subject.robot, subject.beat)
        place, target = self._scene.camera
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.up = place, target, (0.0, 0.0, 1.0)
        camera.fov = np.radians(32.0)
        gui.set_panel_label(subject.title)
        self._numbers = gui.add_html(_template().render(groups=[]), order=0)
        if subject.steering is not None:
            self._build_steering(gui, subject.steering)
        with gui.add_folder("View", order=20):
            follow = gui.add_checkbox("Follow the robot (F)", True)
        self._door.allow(follow, lambda value: isinstance(value, bool))
        follow.on_update(lambda _: setattr(self._scene, "following", follow.value))

        async def turn(_: object) -> None:
            follow.value = not follow.value  # type: ignore[misc]  # it is a checkbox

        self._door.allow(gui.add_command("Follow the robot", hotkey="F")).on_trigger(turn)
        gui.main_panel.dock_left()
        gui.main_panel.set_width(310)
        panel = gui.add_panel()
        with panel.add_tab("Plots"):
            self._plots = LivePlots(gui, subject, self._door)
        panel.dock_right()
        panel.set_width(400)

    def _build_steering(self, gui: Any, steering: Steering) -> None:
        """Add sliders of frequency and amplitude, and what they change of the flight."""
        with gui.add_folder("Gait", order=10):
            step = 10.0 ** np.floor(np.log10(steering.most)) / 100.0
            beat = gui.add_slider(
                "Frequency [Hz]",
                steering.least,
                steering.most,
                step,
                steering.frequency,
                hint="Wingbeats a second; the phase goes on where it is.",
            )
            size = gui.add_slider(
                "Amplitude [%]",
                0.0,
                np.floor(100.0 * steering.amplitude),
                1.0,
                100.0,
                hint="Of the gait's own excursions about their mean.",
            )
        with gui.add_folder("Flight", order=11):
            pause = self._pause = gui.add_button("Pause (space)", icon=viser.Icon.PLAYER_PAUSE)
            reset = gui.add_button("Fly again from the start (R)", icon=viser.Icon.REFRESH)
        allow, first = self._door.allow, steering.frequency
        allow(beat, lambda value: is_finite(value) and steering.allows(value, 1.0))
        allow(size, lambda value: is_finite(value) and steering.allows(first, 0.01 * value))
        self._asked["frequency"] = steering.frequency
        beat.on_update(lambda _: self._ask("frequency", float(beat.value)))
        size.on_update(lambda _: self._ask("amplitude", 0.01 * float(size.value)))
        allow(pause).on_click(self._toggle)
        allow(reset).on_click(self._reset)
        allow(gui.add_command("Pause or fly on", hotkey="SPACE")).on_trigger(self._toggle)
        allow(gui.add_command("Fly again from the start", hotkey="R")).on_trigger(self._reset)

    def _ask(self, name: str, value: Any) -> None:
        self._asked[name] = value
        self._commands.put(self._asked)

    async def _toggle(self, _: object) -> None:
        paused = not self._asked["paused"]
        self._pause.label = "Fly on (space)" if paused else "Pause (space)"
        self._pause.icon = viser.Icon.PLAYER_PLAY if paused else viser.Icon.PLAYER_PAUSE
        self._ask("paused", paused)

    def _reset(self, _: object) -> None:
        self._ask("resets", self._asked["resets"] + 1)

    def _draw(self, letter: Any) -> None:
        q, v = letter["q"], letter["v"]
        self._scene.show(float(letter["time"]), q)
        strips = letter["strip_force"] if self._subject.strips else None
        measured, predicted, std = (self._total(letter[name]) for name in FORCES)
        self._scene.show_forces("true", measured if strips is None else strips.sum(axis=0), strips)
        if self._subject.network is None:
            return
        guess = None
        if self._strips is not None:
            x = np.concatenate([q, v])[None]
            guess = self._strips.evaluate(x, letter["weights"]).reshape(-1, 3)
            predicted = guess.sum(axis=0) if predicted is None else predicted
        self._scene.show_forces("predicted", predicted, guess, std)

    def _total(self, force: Array) -> Array | None:
        """Force along x, y and z, (3,) [N]; None where a component is not measured."""
        known = dict(zip(self._subject.outputs, force, strict=True))
        total = np.array([known.get(name, np.nan) for name in "xyz"])
        return total if np.isfinite(total).all() else None

    def _count(self, now: float, sent: int) -> None:
        letter, since = self._last, self._seen[0] if self._seen else (np.nan, np.nan, 0)
        self._seen = [*self._seen[-20:], (now, float(letter["time"]), int(letter["samples"]))]
        passed = now - since[0]
        rate = (int(letter["samples"]) - since[2]) / passed
        pace = (float(letter["time"]) - since[1]) / passed
        groups = [self._flight_rows(letter, pace), *self._learner_rows(letter, rate)]
        self._numbers.content = _template().render(
            words=bytes(letter["words"]).decode(errors="replace"),
            ended=bool(letter["ended"]),
            groups=[*groups, self._picture_rows(sent)],
            key=[("true", TRUTH), *([("learned", COLORS[0])] if self._subject.network else [])],
            steered=self._subject.steering is not None,
        )

    def _flight_rows(self, letter: Any, pace: float) -> list[Row]:
        """Rows about the flight; the pace is time flown over time on the clock."""
        robot, rows = self._subject.robot, [("Time", f"{letter['time']:.2f} s")]
        if robot.floating:
            base = next(iter(robot.floating_bodies.values()))
            along = list(robot.floating_dofs[:3])
            place = list(robot.floating_coordinates(base))[:3]
            rows.append(("Speed", f"{np.linalg.norm(letter['v'][along]):.2f} m/s"))
            rows.append(("Position", "{:.2f}, {:.2f}, {:.2f} m".format(*letter["q"][place])))
        if self._subject.steering is not None:
            beat = f"{letter['frequency']:.2f} Hz, amplitude {letter['amplitude']:.0%}"
            rows.append(("Wingbeat", beat))
        if not letter["paused"]:
            rows.append(("Pace", f"{_number(pace, '.2f')} × real time"))
        return rows

    def _learner_rows(self, letter: Any, rate: float) -> list[list[Row]]:
        """Table rows about the learner and its rate of samples; none without a learner."""
        if self._subject.network is None:
            return []
        rows = [
            ("Error (NMSE)", _number(letter["nmse"], ".2e")),
            ("In the 95 % interval", _number(100 * letter["coverage"], ".1f", " %")),
            ("Samples", f"{int(letter['samples']):,}".replace(",", " ")),
            ("Rate", _number(rate, ".0f", " /s")),
            ("Time a sample", _number(1e6 * letter["time_per_call"], ".1f", " µs")),
        ]
        if letter["load"] > 0:
            rows.append(("Load", _number(100 * letter["load"], ".0f", " %")))
        if letter["share"] > 1:
            rows.append(("Learned from", f"1 sample in {letter['share']:.0f}"))
        if letter["failed"]:
            rows.append(("Not learned", f"{int(letter['failed'])}"))
        return [rows]

    def _picture_rows(self, sent: int) -> list[Row]:
        """Rows about the pictures drawn of those sent, and about what was refused."""
        rows = [("Frames drawn", f"{self._asked['drawn']} of {sent} sent")]
        for kind, scale in self._scene.scales.items():
            rows.append((f"Arrow of 0.1 N, {kind}", f"{10 * scale:g} cm"))
        if self._door.refused:
            rows.append(("Requests refused", f"{self._door.refused}"))
        return rows

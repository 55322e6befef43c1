"""A live page: the scene, numbers, plots, and what may be asked of a simulation.

Everything runs in the page's process: poses, forces on strips by the weights that the learner
has by now, histories of what is plotted. Nothing is shown of the time before the page was served.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from patagium.report.style import COLORS, TRUTH
from patagium.viewer.live_frames import FORCES, Steering, Subject, command_of
from patagium.viewer.live_mailbox import Mailbox
from patagium.viewer.live_numbers import flight_rows, learner_rows, picture_rows, table
from patagium.viewer.live_plots import LivePlots
from patagium.viewer.live_scene import LiveScene, rgb
from patagium.viewer.predicted_forces import strip_force_network

Array = NDArray[np.float64]

_NUMBERS = 0.2  # s between two looks at the numbers
_PLOTS = 0.12  # s between two plots


class LivePage:
    """Page in a browser.

    Args:
        subject: Subject of the page.
        host: Address.
        port: Port; 0: any that is free.
        commands: Where what is asked for goes.

    Raises:
        OSError: If the port was taken meanwhile.
    """

    def __init__(self, subject: Subject, host: str, port: int, commands: Mailbox) -> None:
        self._subject, self._commands = subject, commands
        self._server = viser.ViserServer(host, port, label="patagium", verbose=False)
        self.port = int(self._server.get_port())
        if port and self.port != port:
            self._server.stop()
            raise OSError(f"port {port} was taken meanwhile")
        self._asked: dict[str, Any] = {
            "frequency": 0.0, "amplitude": 1.0, "paused": False, "resets": 0, "drawn": 0
        }  # fmt: skip
        self._strips = _strip_network(subject)
        self._measured = {name: k for k, name in enumerate(subject.outputs)}
        self._last: Any = None
        self._numbered = self._plotted = -np.inf
        self._seen: list[tuple[float, float, int]] = []  # wall clock, time, samples
        self._build()

    def show(self, letters: Sequence[Any], sent: int) -> None:
        """Draw the last frame and plot all frames that have come.

        Args:
            letters: Frames, oldest first.
            sent: How many were sent so far.
        """
        now = time.monotonic()
        for letter in letters:
            if self._last is not None and letter["time"] < self._last["time"]:
                self._forget()
            self._plots.add(letter)
            self._last = letter
        if self._last is None or not self._server.get_clients():
            return
        if letters:
            with self._server.atomic():
                self._draw(self._last)
            self._asked["drawn"] += 1
            self._send()
        if now - self._plotted > _PLOTS and letters:
            self._plots.draw()
            self._plotted = now
        if now - self._numbered > _NUMBERS:
            self._count(now, sent)
            self._numbered = now

    def close(self) -> None:
        """No more is shown."""
        self._server.stop()

    def _build(self) -> None:
        gui, subject = self._server.gui, self._subject
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=rgb(COLORS[1]))
        self._scene = LiveScene(self._server.scene, subject.robot, subject.beat)
        place, target = self._scene.camera
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.up = place, target, (0.0, 0.0, 1.0)
        camera.fov = np.radians(32.0)
        gui.set_panel_label(subject.title)
        self._numbers = gui.add_html("", order=0)
        if subject.steering is not None:
            self._build_steering(gui, subject.steering)
        with gui.add_folder("View", order=20):
            follow = gui.add_checkbox("Follow the robot (F)", True)
        follow.on_update(lambda _: self._follow(follow.value))
        gui.add_command("Follow the robot", hotkey="F").on_trigger(
            lambda _: setattr(follow, "value", not follow.value)
        )
        gui.main_panel.dock_left()
        gui.main_panel.set_width(310)
        panel = gui.add_panel()
        with panel.add_tab("Plots"):
            self._plots = LivePlots(gui, subject)
        panel.dock_right()
        panel.set_width(400)

    def _build_steering(self, gui: Any, steering: Steering) -> None:
        with gui.add_folder("Gait", order=10):
            step = 10.0 ** np.floor(np.log10(steering.most)) / 100.0
            beat = gui.add_slider(
                "Frequency [Hz]", steering.least, steering.most, step, steering.frequency,
                hint="Wingbeats a second; the phase goes on where it is.",
            )  # fmt: skip
            size = gui.add_slider(
                "Amplitude [%]", 0.0, np.floor(100.0 * steering.amplitude), 1.0, 100.0,
                hint="Of the gait's own excursions about their mean.",
            )  # fmt: skip
        with gui.add_folder("Flight", order=11):
            pause = gui.add_button("Pause (space)", icon=viser.Icon.PLAYER_PAUSE)
            reset = gui.add_button("Fly again from the start (R)", icon=viser.Icon.REFRESH)
        self._pause = pause
        self._asked["frequency"] = steering.frequency
        beat.on_update(lambda _: self._ask("frequency", float(beat.value)))
        size.on_update(lambda _: self._ask("amplitude", 0.01 * float(size.value)))
        pause.on_click(lambda _: self._toggle())
        reset.on_click(lambda _: self._reset())
        gui.add_command("Pause or fly on", hotkey="SPACE").on_trigger(lambda _: self._toggle())
        gui.add_command("Fly again from the start", hotkey="R").on_trigger(lambda _: self._reset())

    def _ask(self, name: str, value: Any) -> None:
        self._asked[name] = value
        self._send()

    def _send(self) -> None:
        self._commands.put(command_of(self._asked))

    def _toggle(self) -> None:
        paused = not self._asked["paused"]
        self._pause.label = "Fly on (space)" if paused else "Pause (space)"
        self._pause.icon = viser.Icon.PLAYER_PLAY if paused else viser.Icon.PLAYER_PAUSE
        self._ask("paused", paused)

    def _reset(self) -> None:
        self._ask("resets", self._asked["resets"] + 1)

    def _follow(self, follow: bool) -> None:
        self._scene.following = follow

    def _forget(self) -> None:
        self._scene.forget()
        self._plots.forget()
        self._seen = []

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
        places = [self._measured.get(name) for name in "xyz"]
        if None in places:
            return None
        total = np.array([force[k] for k in places if k is not None])
        return total if np.isfinite(total).all() else None

    def _count(self, now: float, sent: int) -> None:
        letter, last = self._last, self._seen[0] if self._seen else None
        self._seen = [*self._seen[-20:], (now, float(letter["time"]), int(letter["samples"]))]
        since = (np.nan, np.nan, 0) if last is None else last
        passed = now - since[0]
        rate = (int(letter["samples"]) - since[2]) / passed
        pace = (float(letter["time"]) - since[1]) / passed
        subject = self._subject
        self._numbers.content = table(
            flight_rows(letter, subject, pace),
            learner_rows(letter, rate) if subject.network is not None else [],
            picture_rows(self._asked["drawn"], sent, self._scene.meters_per_newton),
            key=[("true", TRUTH), *([("learned", COLORS[0])] if subject.network else [])],
            letter=letter,
        )


def _strip_network(subject: Subject) -> Any:
    """The network seen through the forces on strips, or None where it has none."""
    network = subject.network
    return None if network is None else strip_force_network(network, subject.robot)

"""Plots of a live page: forces with their predicted interval, error and coverage over time.

All share a cursor. What is kept is bounded by the number of points, so that the span shown is a
second or two of a simulation in its own time, and more of what is slow. Points that have
left the span are gone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.learning.scores import INTERVAL
from patagium.report.style import COLORS, TRUTH
from patagium.viewer.live_frames import FORCES, Subject

Array = NDArray[np.float64]

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
    """

    def __init__(self, gui: Any, subject: Subject) -> None:
        self._subject = subject
        m = len(subject.outputs)
        self._trace = np.empty((0, 1 + len(FORCES) * m))
        self._scores = np.empty((0, 3))
        order = [*(k for k in _FIRST if k in subject.outputs), *subject.outputs]
        self._shown = list(dict.fromkeys(order))[: min(_FORCES, m)]
        self._plots = [self._force_plot(gui, name) for name in self._shown]
        self._learned = subject.network is not None
        if self._learned:
            self._error = _plot(gui, "Error: mean square over variance", ["NMSE"], log=True)
            self._coverage = _plot(gui, "Measurements in the 95 % interval [%]", ["inside", "95 %"])
        with gui.add_folder("Forces shown", expand_by_default=False):
            for place, name in enumerate(self._shown):
                choice = gui.add_dropdown(f"Plot {place + 1}", subject.outputs, name)
                choice.on_update(lambda _, k=place, one=choice: self._choose(k, one.value))

    def add(self, letter: Any) -> None:
        """More to plot.

        Args:
            letter: A frame.
        """
        fresh = letter["trace"][: letter["traced"]]
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
            plot.data = self._lines(name)
        if self._learned:
            time, error, inside = self._scores.T
            sound = np.where(error > 0, error, np.nan)
            self._error.data = (time, sound)
            self._coverage.data = (time, 100.0 * inside, np.full_like(time, 95.0))

    def _choose(self, place: int, name: str) -> None:
        self._shown[place] = name
        self._plots[place].title = self._title(name)
        self.draw()

    def _title(self, name: str) -> str:
        subject = self._subject
        length = subject.robot.dof_units[subject.robot.index(name)] == "m"
        return f"Force of the air on {name} [{'N' if length else 'N m'}]"

    def _force_plot(self, gui: Any, name: str) -> Any:
        names = ["measured"]
        if self._subject.network is not None:
            names += ["predicted", "low", "high"]
        return _plot(gui, self._title(name), names)

    def _lines(self, name: str) -> tuple[Array, ...]:
        k, m = self._subject.outputs.index(name), len(self._subject.outputs)
        time = self._trace[:, 0]
        truth, guess, std = (self._trace[:, 1 + part * m + k] for part in range(len(FORCES)))
        if self._subject.network is None:
            return time, truth
        reach = INTERVAL * std
        return time, truth, guess, guess - reach, guess + reach


def _plot(gui: Any, title: str, names: Sequence[str], *, log: bool = False) -> Any:
    """An empty plot; of four series the last two are the edges of a band."""
    looks: dict[str, dict[str, Any]] = {
        "measured": {"stroke": TRUTH, "width": 1.6},
        "predicted": {"stroke": COLORS[0], "width": 1.6},
        "low": {"stroke": "rgba(213, 94, 0, 0.25)", "width": 1},
        "high": {"stroke": "rgba(213, 94, 0, 0.25)", "width": 1},
        "NMSE": {"stroke": COLORS[0], "width": 1.6},
        "inside": {"stroke": COLORS[0], "width": 1.6},
        "95 %": {"stroke": "#7b8894", "width": 1, "dash": (6, 4)},
    }
    series: list[dict[str, Any]] = [{"label": "t [s]"}]
    series += [{"label": name, "points": {"show": False}, **looks[name]} for name in names]
    scales: dict[str, Any] = {"x": {"time": False}}
    if log:
        scales["y"] = {"distr": 3}
    high = _HIGH if names[0] == "measured" else _LOW
    axis = {"font": "11px sans-serif", "size": 26, "labelFont": "11px sans-serif"}
    axes = ({**axis, "label": "t [s]", "labelSize": 15, "labelGap": 0}, {**axis, "size": 52})
    band = ({"series": (4, 3), "fill": "rgba(213, 94, 0, 0.16)"},) if "high" in names else None
    start = tuple(np.full(2, np.nan) if k else np.array([0.0, 1.0]) for k in range(len(series)))
    return gui.add_uplot(
        start, tuple(series), title=title, scales=scales, axes=axes, bands=band,
        cursor=_CURSOR, legend={"show": False}, height=high, padding=(4, 12, 0, 0),
    )  # fmt: skip

"""Replay of a flight as one HTML page: bodies, wings, forces, path and linked plots.

Everything is inline, three.js too, so that the file opens from disk, offline. Numbers
travel as base64 of little-endian floats: origins in double, all else in single precision
relative to the origin. The flow is not shown.
"""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from patagium.arrays import Array
from patagium.report.page import template
from patagium.report.style import COLORS, SCENE, TRUTH
from patagium.whole_file import write_whole

_SCRIPTS = "flight.js", "pace.js", "view.js", "paths.js", "arrows.js", "plots.js", "player.js"


@dataclass(frozen=True)
class Surface:
    """A strip of wing: a flat quadrangle fixed to a body.

    Attributes:
        wing: Name of the wing.
        body: Index of the body.
        corners: In body axes, counterclockwise as seen from above the wing, (4, 3) [m].
    """

    wing: str
    body: int
    corners: Array


@dataclass(frozen=True)
class Mark:
    """A point fixed to a body that leaves a trace: a wing tip.

    Attributes:
        name: Name of the point.
        body: Index of the body.
        offset: In body axes, (3,) [m].
    """

    name: str
    body: int
    offset: Array


@dataclass(frozen=True)
class Arrows:
    """Forces of the air at the times shown, world axes; what is not known is None.

    Attributes:
        point: Points where those of strips act, relative to the origin, (F, n_strips, 3) [m].
        force: True ones, (F, n_strips, 3) [N].
        predicted: Predicted ones, same shape.
        center: Point where the total is drawn, relative to the origin, (F, 3) [m].
        total: Force of the air on the robot, (F, 3) [N].
        predicted_total: Predicted force on the robot, (F, 3) [N].
        moment: Moment of the air about the center, (F, 3) [N m].
        predicted_moment: Predicted moment, (F, 3) [N m].
        std: Standard deviation of the predicted total, (F, 3) [N].
    """

    point: Array | None
    force: Array | None
    predicted: Array | None
    center: Array
    total: Array
    predicted_total: Array | None = None
    moment: Array | None = None
    predicted_moment: Array | None = None
    std: Array | None = None


@dataclass(frozen=True)
class Series:
    """A quantity over time, to be plotted.

    Attributes:
        group: Heading it stands under.
        name: Name.
        unit: Unit.
        values: (F,).
        predicted: (F,), NaN where it is not known, or None.
        shown: Whether it is plotted when the page opens.
        std: Standard deviation of the prediction, (F,), or None.
    """

    group: str
    name: str
    unit: str
    values: Array
    predicted: Array | None = None
    shown: bool = False
    std: Array | None = None


@dataclass(frozen=True)
class Replay:
    """All that a page shows, at F times.

    Attributes:
        title: Title of the page.
        subtitle: Description of the flight in a few words.
        time: (F,) [s].
        period: Duration of a wingbeat [s], or None.
        bodies: Names, n_b.
        origin: Position of the first body in the world, (F, 3) [m].
        position: Position of every body relative to it, world axes, (F, n_b, 3) [m].
        quaternion: Body axes to world axes, x y z w, (F, n_b, 4).
        speed: Speed of the origin, (F,) [m/s].
        solids: Kind, body, center, axis and size of each; see `robot.solids`. Those of an arm
            that carries the robot have `carrier` set.
        surfaces: Strips of all wings.
        marks: Points that leave a trace.
        arrows: Forces, or None.
        series: Plots.
        names: Names of truth and prediction.
        notes: Sentences about sampling, frames and units.
        ground: Height of the ground [m]; None: somewhere below the robot.
        events: Time [s] and words of what happened.
        gaps: The first of the F times after each gap, over which no curve is drawn.
        other: Another flight in the same space, drawn as a ghost; its series and arrows are not.
    """

    title: str
    subtitle: str
    time: Array
    period: float | None
    bodies: Sequence[str]
    origin: Array
    position: Array
    quaternion: Array
    speed: Array
    solids: Sequence[dict[str, Any]]
    surfaces: Sequence[Surface]
    marks: Sequence[Mark]
    arrows: Arrows | None
    series: Sequence[Series]
    names: tuple[str, str] = ("true", "predicted")
    notes: Sequence[str] = field(default_factory=tuple)
    ground: float | None = None
    events: Sequence[tuple[float, str]] = ()
    gaps: Sequence[int] = ()
    other: Replay | None = None


def write_replay(path: str | Path, replay: Replay) -> Path:
    """The page of a flight, written whole or not at all.

    Returns:
        The path written.
    """
    words = _content(replay)
    content = json.dumps(words, allow_nan=False, separators=(",", ":"), default=np.ndarray.tolist)
    text = template("replay/page.html").render(
        title=replay.title,
        subtitle=replay.subtitle,
        notes=replay.notes,
        predicted=any(series.predicted is not None for series in replay.series),
        names=replay.names,
        colors={"true": TRUTH, "predicted": COLORS[0]},
        style=Markup(_text("style.css")),
        license=Markup(_text("three.LICENSE.txt")),
        three=Markup(gzip.decompress(_file("three.min.js.gz").read_bytes()).decode()),
        content=Markup(content.replace("<", "\\u003c")),  # within a script element
        scripts=Markup("\n".join(_text(name) for name in _SCRIPTS)),
    )
    return write_whole(path, text)


def _content(replay: Replay) -> dict[str, Any]:
    """Content of a page as JSON-able values."""
    return _encoded(replay) | {
        "colors": [TRUTH, COLORS[0]],
        "look": SCENE,
        "time": encode_array(replay.time, "f8"),
        "origin": encode_array(replay.origin, "f8"),
        "surfaces": [vars(surface) for surface in replay.surfaces],
        "marks": [vars(mark) for mark in replay.marks],
        "arrows": None if replay.arrows is None else _encoded(replay.arrows),
        "series": [_encoded(series) for series in replay.series],
        "other": None if replay.other is None else _content(replay.other),
    }


def _encoded(record: Arrows | Series | Replay) -> dict[str, Any]:
    """Fields of a record, arrays encoded."""
    return {
        name: encode_array(value) if isinstance(value, np.ndarray) else value
        for name, value in vars(record).items()
    }


def encode_array(values: Array, kind: str = "f4") -> dict[str, Any]:
    """An array as JSON: its kind ("f4", "f8"), shape and bytes in base64, little-endian."""
    with np.errstate(over="ignore"):  # a prediction that ran away becomes infinite
        array = np.ascontiguousarray(values, f"<{kind}")
    return {
        "kind": kind,
        "shape": list(array.shape),
        "base64": base64.b64encode(array.tobytes()).decode("ascii"),
    }


def _text(name: str) -> str:
    return str(_file(name).read_text(encoding="utf-8"))


def _file(name: str) -> Any:
    return files("patagium.report").joinpath("replay", name)

"""Picture of the path of data through patagium: `python docs/draw_architecture.py`.

It writes docs/architecture.svg; `make pages` runs it. The tests hold the picture equal to what
this program draws, and every layer in it equal to a folder of the package.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from matplotlib import rc_context
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch


class Box(NamedTuple):
    """A layer or a thing in the picture.

    Attributes:
        x: Center from the left [box widths].
        y: Center from the bottom [box heights].
        title: Name of the layer, or of the thing.
        text: What it does, in a few words.
    """

    x: float
    y: float
    title: str
    text: str


LAYERS = {
    "robot": Box(0, 3, "robot", "bodies, joints, wings"),
    "dynamics": Box(1, 4, "dynamics", "D, C v, G; forward, inverse"),
    "aerodynamics": Box(1, 2, "aerodynamics", "wind, strips, loads"),
    "native": Box(2, 4.9, "native", "expressions to compiled C"),
    "simulation": Box(2, 3, "simulation", "gait, mount, integration"),
    "sensing": Box(3, 2, "sensing", "sensors, logs, motion, force"),
    "learning": Box(4, 3, "learning", "models, filters, scores"),
    "control": Box(5, 3, "control", "orbits, feedback"),
    "live": Box(4, 1.1, "live", "packets to updates, in flight"),
    "viewer": Box(5, 4, "viewer", "flights to look at"),
    "report": Box(5, 2, "report", "figures and pages"),
    "cli": Box(2, 1.1, "cli", "verbs; calls every layer"),
}
THINGS = {
    "robot file": Box(0, 4.9, "robot file", "YAML or URDF"),
    "flight": Box(3, 4, "flight", "xarray.Dataset, netCDF"),
    "log": Box(3, 0.2, "log", "CSV, ULog, bags, MCAP ..."),
    "packets": Box(5, 0.2, "packets", "lines, pipes, UDP"),
    "model": Box(4, 4.9, "model", "weights, covariance"),
}
ARROWS = (
    ("robot file", "robot"), ("robot", "dynamics"), ("robot", "aerodynamics"),
    ("dynamics", "native"), ("dynamics", "simulation"), ("aerodynamics", "simulation"),
    ("simulation", "flight"), ("flight", "sensing"), ("flight", "learning"), ("log", "sensing"),
    ("sensing", "learning"), ("packets", "live"), ("live", "learning"), ("learning", "model"),
    ("learning", "viewer"), ("learning", "report"), ("learning", "control"),
)  # fmt: skip
WIDE, HIGH = 1.7, 1.0  # distance of two boxes [inch]
BOX = (1.44, 0.56)  # size of a box [inch]


def draw() -> Figure:
    """Picture of the layers, the files and the path of data between them."""
    figure = Figure(figsize=(6.1 * WIDE, 5.4 * HIGH))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(-0.55 * WIDE, 5.55 * WIDE), ylim=(-0.2 * HIGH, 5.3 * HIGH))
    axes.axis("off")
    boxes = LAYERS | THINGS
    patches = {}
    for name, box in boxes.items():
        x, y = _place(box)
        look = {"facecolor": "#dbe9f2", "edgecolor": "#46627a"}
        if name in THINGS:
            look = {"facecolor": "#fdf3dc", "edgecolor": "#b58a1f"}
        corner, shape = (x - BOX[0] / 2, y - BOX[1] / 2), "round,pad=0.02,rounding_size=0.08"
        patches[name] = FancyBboxPatch(corner, *BOX, boxstyle=shape, zorder=2, **look)
        axes.add_patch(patches[name])
        words = {"ha": "center", "va": "center", "zorder": 3, "color": "#1a1a1a"}
        axes.text(x, y + 0.11, box.title, fontsize=10, weight="bold", **words)
        axes.text(x, y - 0.12, box.text, fontsize=7, **words)
    for start, end in ARROWS:
        ends = {"patchA": patches[start], "patchB": patches[end], "shrinkA": 2, "shrinkB": 2}
        path = _place(boxes[start]), _place(boxes[end])
        look = {"arrowstyle": "-|>", "mutation_scale": 11, "color": "#46627a", "linewidth": 1.2}
        axes.add_patch(FancyArrowPatch(*path, **ends, **look))
    return figure


def _place(box: Box) -> tuple[float, float]:
    return box.x * WIDE, box.y * HIGH


def write(path: Path) -> Path:
    """Picture as a file, the same bytes every time.

    Args:
        path: The file, an SVG.

    Returns:
        The path.
    """
    with rc_context({"svg.hashsalt": "patagium", "svg.fonttype": "none"}):
        FigureCanvasSVG(draw()).print_svg(path, metadata={"Date": None})
    return path


if __name__ == "__main__":
    print(write(Path(__file__).with_name("architecture.svg")))

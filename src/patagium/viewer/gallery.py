"""The gallery: every robot that comes along, in a flight of its own, and its picture.

Gaits are such that the robot flies, not such that it flies well.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from PIL import Image

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.polars import SmoothPolar
from patagium.aerodynamics.quasi_steady import QuasiSteady
from patagium.report.page import draw
from patagium.report.still import OBLIQUE
from patagium.robot import load_robot
from patagium.simulation import gaits, mounts, paths, simulate
from patagium.viewer import still
from patagium.whole_file import make_folder, whole_file


@dataclass(frozen=True)
class Exhibit:
    """Flight of a robot of the gallery.

    Attributes:
        gait: Of `gaits.sinusoidal`; empty: joints held still.
        speed: Forward at the beginning [m/s].
        time_step: Small beside the fastest damper and beat [s].
        shown: When the picture is taken [s].
        held: Where joints stand still, by name [rad].
        smooth: Whether the polar is smooth, for wings that do not flap.
        seen_from: Direction from the robot to the eye.
    """

    gait: Mapping[str, Any] = field(default_factory=dict)
    speed: float = 0.0
    time_step: float = 5e-4
    shown: float = 0.2
    held: Mapping[str, float] = field(default_factory=dict)
    smooth: bool = False
    seen_from: tuple[float, float, float] = OBLIQUE


EXHIBITS = {
    "aerobat": Exhibit({"frequency": 5.0, "plunge": 0.6}, 3.0, 1e-4, 0.3),
    "aerobat-beta": Exhibit({"frequency": 5.0, "plunge": 0.5}, 3.0, 5e-4, 0.14),
    "yeo-wing": Exhibit({"frequency": 3.3, "plunge": 0.38}, 0.0, 5e-4, 0.45),
    "hawk": Exhibit({}, 8.0, 1e-3, 0.6, {"elevation": np.radians(5.0)}, smooth=True),
    "dragonfly": Exhibit(
        {
            "frequency": 18.0,
            **dict.fromkeys(("fore_plunge", "hind_plunge", "fore_feather", "hind_feather"), 0.6),
            "phase": {
                "fore_feather": -np.pi / 2,
                "hind_feather": np.pi / 2,
                "hind_plunge": np.pi,
            },
            "offset": {"fore_feather": -0.4, "hind_feather": -0.4},
        },
        1.0,
        2e-4,
        0.12,
    ),
    "ornithopter": Exhibit(
        {"frequency": 4.0, "plunge": 0.6, "offset": {"elevation": -0.05}}, 6.0, 1e-3, 0.37
    ),
}


def gallery_flight(name: str, duration: float) -> xr.Dataset:
    """A flight of a robot of the gallery.

    Args:
        name: One of `EXHIBITS`.
        duration: How long [s].
    """
    exhibit, robot = EXHIBITS[name], load_robot(name)
    aero = QuasiSteady(robot, Air())
    if exhibit.smooth:
        aero = QuasiSteady(robot, Air(), polar=SmoothPolar(zero_lift_drag=0.03))
    gait = (
        gaits.sinusoidal(robot, **exhibit.gait)
        if exhibit.gait
        else gaits.still(robot, **exhibit.held)
    )
    start = robot.coordinates(x=exhibit.speed) if robot.floating else None
    return simulate(robot, aero, gait, duration=duration, time_step=exhibit.time_step, v=start)


def arm_flight(duration: float) -> xr.Dataset:
    """The aerobat, carried by the gallery's arm.

    Args:
        duration: How long [s].
    """
    robot, arm = load_robot("aerobat"), load_robot("ur5e")
    path = paths.figure_of_eight(
        (0.65, 0.0, 0.4), 0.6, 0.3, speed=0.6, along=(0.0, 1.0, 0.0), across=(0.0, 0.0, 1.0)
    )
    turned = (0.0, -np.pi / 2, 0.0)
    mount = mounts.on_arm(arm, path, position=(0.0, 0.0, 0.06), orientation=turned)
    gait = gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    aero = QuasiSteady(robot, Air())
    return simulate(robot, aero, gait, duration=duration, time_step=5e-4, mount=mount)


def draw_gallery(folder: Path) -> Iterator[Path]:
    """Files of the pictures of all robots, one after the other.

    Args:
        folder: Where they go; made if missing.
    """
    for name, exhibit in EXHIBITS.items():
        flight = gallery_flight(name, exhibit.shown)
        yield save_picture(still(flight, exhibit.shown, seen_from=exhibit.seen_from), folder, name)
    yield save_picture(still(arm_flight(0.5), 0.5, seen_from=(0.8, -1.0, 0.4)), folder, "ur5e")


def save_picture(picture: Figure, folder: Path, name: str) -> Path:
    """File of a picture, reduced to 96 colors because a page loads all pictures.

    Args:
        picture: The picture.
        folder: Where it goes; made if missing.
        name: Of the file, without ending.
    """
    path, content = make_folder(folder) / f"{name}.png", io.BytesIO()
    draw(picture, content, "png")
    with Image.open(content) as image, whole_file(path) as draft:
        image.convert("RGB").quantize(96).save(draft, format="PNG", optimize=True)
    return path

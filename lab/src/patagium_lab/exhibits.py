"""The gallery: every robot that comes along, in a flight of its own, and its picture.

Each flies its cruise, as its file has it. `python -m patagium_lab.exhibits docs/gallery` draws it.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from PIL import Image

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.quasi_steady import QuasiSteady
from patagium.report.page import draw
from patagium.robot import load_robot
from patagium.simulation import gaits, mounts, paths, simulate
from patagium.viewer import still
from patagium.whole_file import make_folder, whole_file

EXHIBITS = {
    "aerobat": 0.3,
    "aerobat-beta": 0.14,
    "yeo-wing": 0.45,
    "hawk": 0.6,
    "dragonfly": 0.12,
    "ornithopter": 0.37,
}
"""Robots of the gallery, and when the picture of each is taken [s]."""


def gallery_flight(name: str, duration: float) -> xr.Dataset:
    """Cruise flight of a preset; on a fixed mount, the cruise speed is that of the wind.

    Args:
        name: One of `EXHIBITS`.
        duration: How long [s].

    Raises:
        ParameterError: If its file has no cruise.
    """
    return simulate(load_robot(name), duration=duration)


def arm_flight(duration: float) -> xr.Dataset:
    """Flight of the Aerobat, mounted on a robot arm (the preset ur5e) that follows a path.

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
    for name, shown in EXHIBITS.items():
        yield save_picture(still(gallery_flight(name, shown), shown), folder, name)
    yield save_picture(still(arm_flight(0.5), 0.5, seen_from=(0.8, -1.0, 0.4)), folder, "ur5e")


def save_picture(picture: Figure, folder: Path, name: str) -> Path:
    """File of a picture, reduced to 96 colors because a page loads all pictures.

    Args:
        picture: The picture.
        folder: Where it goes; made if missing.
        name: Of the file, without ending.
    """
    path, content = make_folder(folder) / f"{name}.png", io.BytesIO(draw(picture, "png"))
    with Image.open(content) as image, whole_file(path) as draft:
        image.convert("RGB").quantize(96).save(draft, format="PNG", optimize=True)
    return path


if __name__ == "__main__":
    for drawn in draw_gallery(Path(sys.argv[1])):
        print(drawn)

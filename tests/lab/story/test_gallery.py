"""The gallery flies: every robot of it keeps its books, and its page shows it and runs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import patagium as pt
from patagium.report.style import SCENE
from patagium.robot import preset_names
from patagium.viewer import still
from patagium_lab.exhibits import EXHIBITS, gallery_flight, save_picture

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "gallery.md").read_text("utf-8")
FLAPPING = [name for name in EXHIBITS if name != "hawk"]


@pytest.mark.parametrize("name", FLAPPING)
def test_a_robot_of_the_gallery_flies_and_keeps_its_books(name: str) -> None:
    flight = gallery_flight(name, 0.2)
    # RK4 at some fifty to five hundred steps a beat
    assert flight.attrs["energy_audit"] < 1e-8
    assert flight.attrs["momentum_audit"] < 1e-8
    assert flight.attrs["aero_power_largest"] <= 0.0


def test_the_dragonfly_and_the_ornithopter_stay_up() -> None:
    for name in ("dragonfly", "ornithopter"):
        weight = 9.81 * sum(body.mass for body in pt.load_robot(name).bodies)
        lift = pt.cycle_statistics(gallery_flight(name, 0.5), skip=0).attrs["mean_lift"]
        assert 0.6 * weight < lift < 1.5 * weight


def test_pictures_of_the_gallery_are_made_by_the_program(tmp_path: Path) -> None:
    assert sorted([*EXHIBITS, "ur5e"]) == sorted({*preset_names()} - {"aerobat-published"})
    picture = save_picture(still(gallery_flight("hawk", 0.3), 0.3), tmp_path, "hawk")
    with Image.open(picture) as made, Image.open(ROOT / "docs/gallery/hawk.png") as shown:
        assert made.size == shown.size
        dots = np.asarray(made.convert("RGB"), int)
    for part in ("paper", "upper", "trace"):
        color = [int(SCENE[part][k : k + 2], 16) for k in (1, 3, 5)]
        # few colors in the file, and light on a wing
        assert (np.abs(dots - color).max(axis=2) < 24).mean() > 5e-4
    assert (dots.max(axis=2) < 60).mean() > 1e-3  # arrows of true forces


def test_a_picture_without_a_time_is_of_the_greatest_force_in_the_middle_beat(
    tmp_path: Path,
) -> None:
    flight = gallery_flight("aerobat", 0.6)
    beat = 1.0 / pt.load_robot("aerobat").cruise.frequency  # type: ignore[union-attr, operator]
    total = flight["strip_force"].sum("strip").sel(time=slice(0.3 - beat / 2, 0.3 + beat / 2))
    strongest = float((total**2).sum("axis").idxmax())
    pictures = [tmp_path / name for name in ("own.png", "told.png", "middle.png")]
    for time, file in zip((None, strongest, 0.3), pictures, strict=True):
        still(flight, time).savefig(file)
    own, told, middle = (file.read_bytes() for file in pictures)
    assert own == told != middle


def test_the_page_shows_every_robot_that_is_not_a_slip() -> None:
    shown = re.findall(r"!\[([\w-]+)\]\(gallery/([\w-]+)\.png\)", PAGE)
    assert sorted(a for a, _ in shown) == sorted({*preset_names()} - {"aerobat-published"})
    for name, picture in shown:
        assert name == picture and (ROOT / "docs" / "gallery" / f"{picture}.png").is_file()


def test_the_hawk_of_the_page_glides() -> None:
    code, _ = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    names: dict[str, Any] = {}
    exec(compile(code, "gallery.md", "exec"), names)
    flight = names["flight"]
    pitch = flight["q"].sel(dof="pitch").values
    forward = flight["v"].sel(dof="x").values
    sunk = -flight["q"].sel(dof="z").values[-1]
    assert np.abs(pitch).max() < 0.5 and forward.min() > 5.0
    assert flight["q"].sel(dof="x").values[-1] > 2.5 * sunk > 0.0
    assert flight.attrs["energy_audit"] < 1e-8

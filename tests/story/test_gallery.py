"""The gallery flies: every robot of it keeps its books, and its page shows it and runs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import patagium as pt
from patagium.robot import preset_names

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "gallery.md").read_text("utf-8")
FLIGHTS: dict[str, tuple[dict[str, Any], float, float]] = {
    # gait, speed [m/s], time step [s]: small beside the fastest damper and beat
    "aerobat": ({"frequency": 5.0, "plunge": 0.6}, 3.0, 1e-4),
    "aerobat-beta": ({"frequency": 5.0, "plunge": 0.5}, 3.0, 5e-4),
    "yeo-wing": ({"frequency": 3.3, "plunge": 0.38}, 0.0, 5e-4),
    "dragonfly": (
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
    ),
    "ornithopter": (
        {"frequency": 4.0, "plunge": 0.6, "offset": {"elevation": -0.05}},
        6.0,
        1e-3,
    ),
}


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_robot_of_the_gallery_flies_and_keeps_its_books(name: str) -> None:
    words, speed, step = FLIGHTS[name]
    robot = pt.load_robot(name)
    start = robot.coordinates(x=speed) if robot.floating else None
    gait = pt.gaits.sinusoidal(robot, **words)
    aero = pt.QuasiSteady(robot, pt.Air())
    flight = pt.simulate(robot, aero, gait, duration=0.2, time_step=step, v=start)
    # RK4 at some fifty to five hundred steps a beat
    assert flight.attrs["energy_audit"] < 1e-8
    assert flight.attrs["momentum_audit"] < 1e-8
    assert flight.attrs["aero_power_largest"] <= 0.0


def test_the_dragonfly_and_the_ornithopter_stay_up() -> None:
    for name in ("dragonfly", "ornithopter"):
        words, speed, step = FLIGHTS[name]
        robot = pt.load_robot(name)
        aero = pt.QuasiSteady(robot, pt.Air())
        gait = pt.gaits.sinusoidal(robot, **words)
        start = robot.coordinates(x=speed)
        flight = pt.simulate(robot, aero, gait, duration=0.5, time_step=step, v=start)
        weight = 9.81 * sum(body.mass for body in robot.bodies)
        lift = pt.cycle_statistics(flight, skip=0).attrs["mean_lift"]
        assert 0.6 * weight < lift < 1.5 * weight


def test_the_page_shows_every_robot_that_is_not_a_slip() -> None:
    shown = re.findall(r"!\[([\w-]+)\]\(gallery/([\w-]+)\.png\)", PAGE)
    assert sorted(a for a, _ in shown) == sorted({*preset_names()} - {"aerobat-published"})
    for name, picture in shown:
        assert name == picture and (ROOT / "docs" / "gallery" / f"{picture}.png").is_file()


def test_the_hawk_of_the_page_glides() -> None:
    (code,) = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    names: dict[str, Any] = {}
    exec(compile(code, "gallery.md", "exec"), names)
    flight = names["flight"]
    pitch = flight["q"].sel(dof="pitch").values
    forward = flight["v"].sel(dof="x").values
    sunk = -flight["q"].sel(dof="z").values[-1]
    assert np.abs(pitch).max() < 0.5 and forward.min() > 5.0
    assert flight["q"].sel(dof="x").values[-1] > 2.5 * sunk > 0.0
    assert flight.attrs["energy_audit"] < 1e-8

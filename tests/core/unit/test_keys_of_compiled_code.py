"""Keys of compiled code hold all that shapes it: robots of equal representation differ."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.learning.models.linear_strip import LinearStripNetwork
from patagium.robot import Robot, load_robot_text
from patagium.robot.files import preset_text

ROOT = Path(__file__).parents[3]
SOURCES = [*(ROOT / "src").rglob("*.py"), *(ROOT / "lab" / "src").rglob("*.py")]


@pytest.fixture
def twins() -> tuple[Robot, Robot]:
    """Two robots of one name and size; the hinge of the second turns about another axis."""
    first = pt.load_robot("aerobat")
    hinge = "{name: left_plunge, axis: %s}"
    text = preset_text("aerobat").replace(hinge % "x", hinge % "y")
    return first, load_robot_text(text, "aerobat")


def flight(robot: Robot) -> xr.Dataset:
    return pt.simulate(
        robot, pt.QuasiSteady(robot), pt.gaits.cruise(robot), duration=0.01, time_step=1e-3
    )


def test_flights_of_robots_that_look_alike_are_their_own(twins: tuple[Robot, Robot]) -> None:
    first, second = twins
    assert repr(first) == repr(second)
    both = [flight(robot) for robot in twins]
    assert np.abs(both[0]["u1"].values - both[1]["u1"].values).max() > 1e-6
    for robot, flown in zip(twins, both, strict=True):  # the flight's own dynamics as the oracle
        q, v, a = (flown[name].values[5] for name in ("q", "v", "a"))
        force = flown["aero_force"].values[5] + flown["damping_force"].values[5]
        needed = pt.Dynamics(robot).inverse(q, v, a) - force
        assert flown["u1"].values[5] == pytest.approx(needed, abs=1e-9)  # N, N m: rounding


def test_networks_of_robots_that_look_alike_are_their_own(
    twins: tuple[Robot, Robot], rng: np.random.Generator
) -> None:
    for make in (LinearStripNetwork, lambda robot: pt.StripNetwork(robot, (3,))):
        nets = [make(robot) for robot in twins]
        x = 0.3 * rng.standard_normal(nets[0].inputs)
        values = [net.evaluate(x[None], net.initial(0)) for net in nets]
        assert np.abs(values[0] - values[1]).max() > 1e-9


def test_no_key_of_compiled_code_holds_a_representation_for_people() -> None:
    """`repr` is for people, and may be the same for two robots; `structure` is not."""
    found = [
        f"{path.name}: {line.strip()}"
        for path in SOURCES
        for line in path.read_text("utf-8").splitlines()
        if re.search(r"(robot|symbolic|machine|model|aero|network)!r\}", line)
        and "structure" in line
    ]
    assert found == []

"""Keys of compiled code hold all that shapes it: robots of equal representation differ."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.learning.models.linear_strip import LinearStripNetwork
from patagium.robot import Robot, load_robot_text
from patagium.robot.files import preset_text

ROOT = Path(__file__).parents[3]
SOURCES = [*(ROOT / "src").rglob("*.py"), *(ROOT / "lab" / "src").rglob("*.py")]


TEXT = preset_text("aerobat").replace("strips: 5", "strips: 1")
"""A robot that compiles in a third of the time."""


@pytest.fixture
def twins() -> tuple[Robot, Robot]:
    """Two robots of one name and size; the hinge of the second turns about another axis."""
    hinge = "{name: left_plunge, axis: %s}"
    other = TEXT.replace(hinge % "x", hinge % "y")
    assert other != TEXT
    return load_robot_text(TEXT, "aerobat"), load_robot_text(other, "aerobat")


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


def edited_polar(factor: float) -> pt.air.Polar:
    """Polar of a class that is defined again with another formula, as in a notebook."""

    @dataclass(frozen=True)
    class Foil(pt.air.Polar):
        name: ClassVar[str] = "foil"
        slope: float = 4.0

        def coefficients(self, flow: Any, parameters: Any) -> tuple[Any, Any]:
            lift = factor * parameters[0] * ca.sin(flow.angle_of_attack) * flow.forward_sign
            return lift, 0.1 * factor

    return Foil()


def edited_model(factor: float) -> type[pt.QuasiSteady]:
    """Class of an air model that is defined again with another formula."""

    class Own(pt.QuasiSteady):
        def expressions(self, *inputs: Any) -> Any:
            air = super().expressions(*inputs)
            return replace(air, generalized_force=factor * air.generalized_force)

    return Own


def test_an_own_polar_or_model_is_compiled_anew_when_its_formula_is_edited() -> None:
    """An edited class was flown with its old formula: compiled code was found by its name alone."""
    robot = load_robot_text(TEXT, "aerobat")
    q, v = robot.coordinates(pitch=-0.1), robot.velocities(x=3.0)
    for make in (
        lambda factor: pt.QuasiSteady(robot, polar=edited_polar(factor)),
        lambda factor: edited_model(factor)(robot),
        lambda factor: pt.air.WindShear(edited_model(factor)(robot)),
    ):
        forces = [make(factor).generalized_force(q, v) for factor in (1.0, 2.0)]
        assert forces[1] == pytest.approx(2 * forces[0], rel=1e-12)  # rounding
        assert np.abs(forces[0]).max() > 0.01  # N, N m
        assert make(1.0).key == make(1.0).key


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

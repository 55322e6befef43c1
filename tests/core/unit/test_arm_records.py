"""The arm that carried a robot is found again from the flight, and stands under it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.dynamics.dynamics import poses_at
from patagium.errors import FlightError
from patagium.robot.solids import carried_body, solids
from patagium.simulation import carrier_of
from patagium.viewer.replay import carrying_arm

SEAT = (0.0, 0.0, 0.06)
TURN = (0.0, -np.pi / 2, 0.0)


@pytest.fixture(scope="module")
def mount() -> pt.mounts.Mount:
    path = pt.paths.line((0.5, 0, 0.3), (0.5, 0.2, 0.35), duration=0.3)
    return pt.mounts.on_arm(pt.load_robot("ur5e"), path, position=SEAT, orientation=TURN)


@pytest.fixture(scope="module")
def flight(mount: pt.mounts.Mount) -> xr.Dataset:
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    aero = pt.QuasiSteady(robot, pt.Air())
    return pt.simulate(robot, aero, gait, duration=0.4, time_step=2e-4, mount=mount)


def test_the_joints_of_the_arm_are_those_of_its_plan(
    flight: xr.Dataset, mount: pt.mounts.Mount
) -> None:
    carrier = carrier_of(flight)
    assert carrier is not None and carrier.arm.name == "ur5e" and mount.plan is not None
    expected = mount.plan.motion(flight["time"].values).position
    np.testing.assert_allclose(carrier.q, expected, atol=1e-10)  # both closed to 1e-13
    late = carrier_of(flight.isel(time=slice(700, None)))
    assert late is not None
    np.testing.assert_allclose(late.q, expected[700:], atol=1e-10)


def test_the_arm_holds_the_robot_where_it_is(flight: xr.Dataset) -> None:
    robot, frames = pt.load_robot("aerobat"), np.array([0, 500, 1999])
    standing = carrying_arm(robot, carrier_of(flight), frames)
    assert standing is not None
    tool = standing.names.index("ur5e tool")
    held = standing.position[:, tool] + standing.rotation[:, tool] @ SEAT
    np.testing.assert_allclose(held, flight["q"].values[frames, :3], atol=1e-12)
    foot = [k for k in standing.solids if standing.names[k.body] == "ur5e foot"]
    assert [k.kind for k in foot] == ["cylinder"]
    assert np.abs(standing.position[:, -1]).max() == 0.0
    reach = max(k.size[1] for k in standing.solids if k.kind == "capsule")
    assert reach == pytest.approx(0.425)  # the upper arm, its longest tube


def test_the_page_shows_the_arm(flight: xr.Dataset, tmp_path: Path) -> None:
    text = pt.replay(flight, tmp_path / "arm.html").read_text("utf-8")
    found = re.search(r'<script id="flight" type="application/json">(.*?)</script>', text, re.S)
    assert found is not None
    words = json.loads(found[1])
    own = len(pt.load_robot("aerobat").bodies)
    assert words["bodies"][own:][-2:] == ["ur5e tool", "ur5e foot"]
    assert words["ground"] == 0.0
    carriers = {k["body"] for k in words["solids"] if k.get("carrier")}
    assert carriers == set(range(own, len(words["bodies"])))
    assert "The arm that carries the robot stands on" in text


def test_without_an_arm_there_is_none(flight: xr.Dataset) -> None:
    plain = flight.assign_attrs(mount="carried")
    assert carrier_of(plain) is None
    assert carrying_arm(pt.load_robot("aerobat"), None, np.array([0, 1])) is None


def test_an_arm_that_cannot_reach_is_told(flight: xr.Dataset) -> None:
    told = json.loads(flight.attrs["mount_path"])
    told["arm"]["position"] = [0.0, 0.0, 3.0]
    far = flight.assign_attrs(mount_path=json.dumps(told))
    with pytest.raises(FlightError, match="arm cannot be made again"):
        carrier_of(far)


def test_a_robot_composed_with_its_arm_stands_on_its_foot() -> None:
    robot = pt.load_robot("aerobat").mounted_on(pt.load_robot("ur5e"), "tool")
    own = carried_body(robot)
    assert robot.bodies[own].name == "body" and robot.bodies[own - 1].name == "arm_tool"
    tubes = {robot.bodies[k.body].name: k.size[0] for k in solids(robot) if k.body < own}
    assert tubes["arm_forearm"] == pytest.approx(0.06 * 0.425)  # as thick as those of the arm alone
    standing = carrying_arm(robot, None, np.array([0, 1]))
    assert standing is not None and standing.names == ("foot",)
    assert poses_at(robot, robot.coordinates()[None])[0][0, 0] == pytest.approx([0, 0, 0.1625])

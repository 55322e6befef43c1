"""Poses of all bodies at many states, and the solids that are drawn there."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

import patagium as pt
from patagium.dynamics.dynamics import poses_at
from patagium.errors import ShapeError
from patagium.robot import load_robot_text, preset_names
from patagium.robot.planform import strip_corners
from patagium.robot.solids import solids, wing_tips


@pytest.mark.parametrize("attitude", ["euler", "quaternion"])
def test_poses_take_either_attitude(attitude: Literal["euler", "quaternion"]) -> None:
    angles = {"x": 1.0, "roll": 0.3, "pitch": -0.4, "yaw": 0.5, "left_plunge": 0.6}
    robot = pt.load_robot("aerobat")
    turned = robot.with_attitude(attitude)
    expected = poses_at(robot, robot.coordinates(**angles)[None])
    found = poses_at(turned, turned.coordinates(**angles)[None])
    for mine, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-14)  # rounding


@pytest.mark.parametrize("name", ["aerobat", "aerobat-beta", "yeo-wing"])
def test_poses_are_where_points_of_bodies_are(name: str, rng: np.random.Generator) -> None:
    robot = pt.load_robot(name)
    dynamics = pt.Dynamics(robot)
    q = rng.uniform(-1, 1, (9, robot.dof))
    position, rotation = poses_at(robot, q)
    offset = rng.standard_normal(3)
    for b in {0, len(robot.bodies) - 1}:
        point = dynamics.point(robot.bodies[b].name, offset)
        found = position[:, b] + rotation[:, b] @ offset
        expected = [point.position(one) for one in q]
        np.testing.assert_allclose(found, expected, atol=1e-13)  # rounding


def test_one_state_is_no_list_of_states() -> None:
    robot = pt.load_robot("aerobat")
    with pytest.raises(ShapeError, match="q"):
        poses_at(robot, np.zeros(robot.dof))


def test_bodies_have_the_shapes_of_the_robot_file() -> None:
    robot = pt.load_robot("aerobat")
    drawn = {robot.bodies[solid.body].name: solid for solid in solids(robot)}
    assert drawn["body"].kind == "cylinder"
    assert drawn["body"].size == pytest.approx((0.025, 0.1))
    assert drawn["left_humerus"].axis == (0.0, 1.0, 0.0)
    assert drawn["right_humerus"].axis == (0.0, -1.0, 0.0)
    assert drawn["right_humerus"].center == (0.0, -0.025, 0.0)


def test_a_body_without_shape_is_a_bone_to_its_joint() -> None:
    robot = pt.load_robot("aerobat-beta")
    drawn = {robot.bodies[solid.body].name: solid for solid in solids(robot)}
    bone = drawn["left_proximal"]
    assert bone.kind == "capsule"
    end = np.array(bone.center) + np.array(bone.axis) * bone.size[1] / 2
    joint = robot.bodies[robot.body_index("left_distal")].position
    np.testing.assert_allclose(end, joint, atol=1e-12)  # rounding


def test_a_mounted_robot_keeps_its_shapes() -> None:
    robot = pt.load_robot("aerobat").mounted_on(pt.load_robot("ur5e"), "wrist_3")
    kinds = {robot.bodies[solid.body].name: solid.kind for solid in solids(robot)}
    assert kinds["body"] == "cylinder" and kinds["right_humerus"] == "cylinder"
    assert kinds["arm_forearm"] == "capsule"


def test_bones_of_an_insect_are_as_thin_as_those_of_a_bird() -> None:
    """They had 2 mm at least: thicker than the body of a robot of 1 g."""
    text = """
name: bird
gravity: 9.81
bodies:
  body: {floating: true, mass: 1 g, shape: {type: point}}
  left_wing:
    parent: body
    joints: [{name: left_plunge, axis: x}]
    mass: 0.1 g
    center_of_mass: [0, 2 cm, 0]
    shape: {type: plate, chord: 1 cm, span: 4 cm, thickness: 1 mm}
wings:
  - name: left_wing
    segments:
      - {body: left_wing, strips: 2, stations: [
          {span: 0, leading: 0, trailing: -1 cm}, {span: 4 cm, leading: 0, trailing: -1 cm}]}
mirror: [{from: left, to: right}]
"""
    insect = solids(load_robot_text(text, "insect"))
    bird = solids(load_robot_text(text.replace(" cm", " m"), "bird"))
    for small, large in zip(insect, bird, strict=True):
        assert np.multiply(100, small.size) == pytest.approx(large.size)


def test_every_body_is_seen() -> None:
    for name in preset_names():
        robot = pt.load_robot(name)
        assert {solid.body for solid in solids(robot)} == set(range(len(robot.bodies)))


def test_wing_tips_are_the_outermost_points_of_their_strips() -> None:
    robot = pt.load_robot("aerobat-beta")
    tips = wing_tips(robot)
    left, right = tips["left_wing"][1], tips["right_wing"][1]
    np.testing.assert_allclose(left, right * [1, -1, 1], atol=1e-15)
    outermost = max(
        strip_corners(s)[:, 1].max() for s in robot.strips if s.body == tips["left_wing"][0]
    )
    assert left[1] == pytest.approx(outermost, rel=1e-12)

"""A robot mounted on an arm: one tree, names kept apart, everything carried along."""

import numpy as np
import pytest

from patagium.errors import ParameterError, RobotFileError
from patagium.robot import load_robot, load_robot_text

TURN = (0.0, -np.pi / 2, 0.3)


@pytest.fixture(scope="module")
def composed():
    return load_robot("aerobat").mounted_on(
        load_robot("ur5e"), "tool", position=(0.01, 0.02, 0.1), orientation=TURN
    )


def test_names_are_prefixed_and_everything_is_carried(composed):
    robot, arm = load_robot("aerobat"), load_robot("ur5e")
    assert composed.name == "aerobat-on-ur5e"
    assert composed.dof_names[:6] == tuple(f"arm_{k}" for k in arm.dof_names)
    assert composed.dof_names[6:] == robot.dof_names[6:]
    assert composed.actuated == tuple(range(14)) and not composed.floating
    assert composed.damping == (*arm.damping, *robot.damping[6:])
    assert composed.lower == (*arm.lower, *robot.lower[6:])
    assert composed.effort_limit == (150, 150, 150, 28, 28, 28, *[np.inf] * 8)
    assert composed.gravity == robot.gravity
    assert [s.name for s in composed.strips] == [s.name for s in robot.strips]
    for ours, theirs in zip(composed.strips, robot.strips, strict=True):
        assert composed.bodies[ours.body].name == robot.bodies[theirs.body].name
    body = composed.bodies[composed.body_index("body")]
    assert composed.bodies[body.parent].name == "arm_tool" and body.floating_dofs is None


def test_its_source_makes_it_again(composed):
    assert load_robot_text(composed.source) == composed
    heavier = composed.with_parameters({"arm_forearm.mass": 3.0, "body.mass": 0.012})
    assert load_robot_text(heavier.source) == heavier != composed
    twice = composed.mounted_on(load_robot("yeo-wing"), "left_wing", prefix="cart_")
    assert load_robot_text(twice.source) == twice


def test_a_turn_of_more_than_half_is_kept_by_the_source():
    """A file takes bare angles up to half a turn."""
    turned = load_robot("aerobat").mounted_on(load_robot("ur5e"), "tool", orientation=(0, 4.7, 0))
    assert load_robot_text(turned.source) == turned


def test_a_file_may_say_it_with_presets():
    text = "robot: aerobat\nmounted_on: ur5e\nat: tool\norientation: [0, -90 deg, 0]\n"
    expected = load_robot("aerobat").mounted_on(
        load_robot("ur5e"), "tool", orientation=(0, -np.pi / 2, 0)
    )
    assert load_robot_text(text) == expected


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("robot: aerobat\nmounted_on: ur5e\nat: hand\n", "at", "one of shoulder"),
        ("robot: bird\nmounted_on: ur5e\nat: tool\n", "robot", "a preset"),
        ("robot: aerobat\nmounted_on: {name: a}\nat: tool\n", "mounted_on.gravity", "gravity: 9.8"),
        ("robot: aerobat\nmounted_on: ur5e\n", "at", "a value here"),
        ("robot: ur5e\nmounted_on: ur5e\nat: tool\nprefix: ''\n", "prefix", "apart"),
        (
            "robot: aerobat\nmounted_on: ur5e\nat: tool\nparameters: {wing.mass: 1}\n",
            "parameters.wing.mass",
            "a parameter",
        ),
    ],
)
def test_a_wrong_file_says_where(text, place, words):
    with pytest.raises(RobotFileError) as caught:
        load_robot_text(text)
    assert caught.value.problems[0][0] == place and words in str(caught.value)


def test_a_mounting_must_be_a_pose():
    with pytest.raises(ParameterError, match="position"):
        load_robot("aerobat").mounted_on(load_robot("ur5e"), "tool", position=(0, np.nan, 0))


def test_a_body_without_mass_must_not_move_alone():
    text = "name: a\ngravity: 9.8\nbodies:\n  arm: {mass: 1, shape: {type: point}, at: [0, 0, 1],"
    text += " center_of_mass: [0, 1, 0],"
    text += " joints: [{name: swing, axis: x}]}\n  end: {parent: arm, massless: true"
    assert load_robot_text(text + "}\n").bodies[1].mass == 0
    with pytest.raises(RobotFileError, match="bodies.end: expected a body with mass"):
        load_robot_text(text + ", joints: [{name: turn, axis: x}]}\n")
    with pytest.raises(RobotFileError, match="bodies.end.mass: expected nothing with massless"):
        load_robot_text(text + ", mass: 1}\n")

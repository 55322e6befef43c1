"""A URDF becomes a robot file; what a robot cannot have is named where it stands."""

import warnings

import numpy as np
import pytest

from patagium.errors import RobotFileError, RobotFileWarning
from patagium.robot import load_robot, load_robot_text, load_urdf, load_urdf_text

ARM = """<?xml version="1.0"?>
<robot name="two arm">
  <link name="base_link"/>
  <link name="Upper-Arm">
    <inertial>
      <origin xyz="0 0 0.1" rpy="0 0 1.5707963267948966"/>
      <mass value="2"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.015"/>
    </inertial>
    <visual><geometry><box size="1 1 1"/></geometry></visual>
  </link>
  <link name="slider">
    <inertial><mass value="0.5"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/>
    </inertial>
  </link>
  <link name="tool0"/>
  <joint name="Shoulder" type="revolute">
    <parent link="base_link"/><child link="Upper-Arm"/>
    <origin xyz="0 0 0.2" rpy="0.1 0.2 0.3"/><axis xyz="0 0 2"/>
    <limit lower="-1" upper="2" effort="30" velocity="3"/>
    <dynamics damping="0.5" friction="0"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="Upper-Arm"/><child link="slider"/><origin xyz="0 0 0.4"/>
    <limit lower="0" upper="0.3" effort="0" velocity="0"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="slider"/><child link="tool0"/><origin xyz="0.1 0 0"/>
  </joint>
  <gazebo reference="tool0"/>
</robot>
"""


def test_a_urdf_loads_by_its_path(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    robot = load_robot(path)
    assert robot.name == "two_arm" and robot.dof_names == ("shoulder", "slide")
    assert [body.name for body in robot.bodies] == ["base_link", "upper_arm", "slider", "tool0"]
    assert robot == load_robot(str(path)) == load_urdf(path)
    assert load_robot_text(robot.source) == robot
    assert "Renamed: Upper-Arm to upper_arm" in robot.source


def test_a_turn_of_more_than_half_is_taken():
    """A robot file takes bare angles up to half a turn, a URDF those up to a whole one."""
    robot = load_urdf_text(ARM.replace("0.1 0.2 0.3", "0.1 0.2 4.8"))
    same = load_urdf_text(ARM.replace("0.1 0.2 0.3", f"0.1 0.2 {4.8 - 2 * np.pi}"))
    turns = [np.array(one.bodies[1].orientation) for one in (robot, same)]
    np.testing.assert_allclose(*turns, atol=1e-15)
    with pytest.raises(RobotFileError, match="write '90 deg'"):
        load_urdf_text(ARM.replace("0.1 0.2 0.3", "0 0 90"))


def test_every_number_arrives():
    robot = load_urdf_text(ARM)
    upper = robot.bodies[1]
    assert upper.joints[0].axis == (0, 0, 1) and robot.bodies[2].joints[0].axis == (1, 0, 0)
    assert upper.position == (0, 0, 0.2) and upper.center_of_mass == (0, 0, 0.1)
    # a quarter turn about z changes x and y
    np.testing.assert_allclose(upper.inertia, [0.02, 0.01, 0.015, 0, 0, 0], atol=1e-17)
    assert robot.damping == (0.5, 0) and robot.lower == (-1, 0) and robot.upper == (2, 0.3)
    assert robot.speed_limit == (3, np.inf) and robot.effort_limit == (30, np.inf)
    assert robot.acceleration_limit == ()
    assert robot.bodies[3].mass == 0 and robot.gravity == 9.81


def test_a_root_floats_when_asked_to_or_by_its_joint():
    stone = "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/>"
    body = f"<link name='hull'>{stone}</inertial></link>"
    world = "<link name='world'/><joint name='free' type='floating'>"
    world += "<parent link='world'/><child link='hull'/></joint>"
    asked = load_urdf_text(f"<robot name='x'>{body}</robot>", base="floating")
    freed = load_urdf_text(f"<robot name='x'>{body}{world}</robot>")
    assert asked == freed and asked.floating and len(asked.bodies) == 1


def test_what_a_robot_cannot_represent_is_said():
    mimic = '<mimic joint="Shoulder" multiplier="2" offset="0.1"/>'
    text = ARM.replace('friction="0"', 'friction="0.2"')
    text = text.replace('<child link="slider"/>', f'<child link="slider"/>{mimic}')
    with pytest.warns(RobotFileWarning) as caught:
        robot = load_urdf_text(text, "arm.urdf")
    assert [str(k.message) for k in caught] == [
        "arm.urdf: joint Shoulder: its Coulomb friction is left out",
        "arm.urdf: joint slide: a coordinate of its own; tie slide = 2 Shoulder + 0.1 in the gait",
    ]
    assert "# Left out: joint slide: a coordinate of its own" in robot.source
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_robot_text(robot.source)  # said once, where it was read


BROKEN = {
    "no XML": (ARM[:200], "", "readable XML"),
    "another tag": (ARM.replace("robot", "model"), "", "an element <robot>"),
    "a document type": ("<!DOCTYPE robot>" + ARM, "", "without a document type"),
    "an entity bomb": (
        "<!DOCTYPE robot [<!ENTITY a 'aaaaaaaa'><!ENTITY b '&a;&a;&a;&a;&a;&a;&a;&a;'>]>"
        + ARM.replace("<gazebo", "<link name='&b;'/><gazebo"),
        "",
        "without a document type",
    ),
    "an entity that names a file": (
        "<!DOCTYPE robot [<!ENTITY secret SYSTEM 'file:///etc/hostname'>]>"
        + ARM.replace("<gazebo", "<link name='&secret;'/><gazebo"),
        "",
        "without a document type",
    ),
    "xacro": (
        ARM.replace("<gazebo", "<x:y xmlns:x='http://www.ros.org/wiki/xacro'/><gazebo"),
        "",
        "run xacro",
    ),
    "planar": (ARM.replace('"prismatic"', '"planar"'), "joint slide.type", "floating at the root"),
    "floating in the middle": (
        ARM.replace('"prismatic"', '"floating"'),
        "joint above slider",
        "one floating joint",
    ),
    "a lost parent": (
        ARM.replace('<parent link="slider"/>', '<parent link="hand"/>'),
        "joint flange.parent",
        "the name of a link",
    ),
    "two roots": (ARM.replace("<gazebo", '<link name="alone"/><gazebo'), "", "one root link"),
    "a loop": (
        ARM.replace('<parent link="base_link"/>', '<parent link="slider"/>'),
        "",
        "the loop Upper-Arm -> slider -> Upper-Arm",
    ),
    "two parents": (
        ARM.replace('<child link="tool0"/>', '<child link="slider"/>'),
        "joint flange",
        "a child with one parent",
    ),
    "a name twice": (ARM.replace('name="tool0"/>', 'name="slider"/>', 1), "link", "of its own"),
    "no number": (
        ARM.replace('xyz="0 0 0.4"', 'xyz="0 0"'),
        "joint slide.origin.xyz",
        "3 finite number",
    ),
    "not finite": (ARM.replace('value="2"', 'value="nan"'), "link Upper-Arm.inertial", "'nan'"),
    "no mass": (ARM.replace('<mass value="0.5"/>', ""), "link slider.inertial.mass", "nothing"),
    "an impossible inertia": (ARM.replace('izz="0.015"', 'izz="5"'), "bodies.upper_arm", "real"),
    "a negative mass": (
        ARM.replace('value="2"', 'value="-2"'),
        "bodies.upper_arm.mass",
        "positive",
    ),
    "an axis of no length": (
        ARM.replace('xyz="0 0 2"', 'xyz="0 0 0"'),
        "bodies.upper_arm.joints.0.axis",
        "some length",
    ),
    "nothing to move": (
        ARM.replace('value="0.5"', 'value="0"').replace("1e-3", "0"),
        "bodies.slider",
        "with mass",
    ),
    "limits crossed": (ARM.replace('upper="2"', 'upper="-2"'), "bodies.upper_arm", "the lower"),
}


@pytest.mark.parametrize("fault", BROKEN)
def test_a_fault_is_named_where_it_stands(fault):
    text, place, words = BROKEN[fault]
    with pytest.raises(RobotFileError) as caught:
        load_urdf_text(text, "arm.urdf")
    assert any(k[0].startswith(place) for k in caught.value.problems), caught.value.problems
    assert words in str(caught.value) and str(caught.value).startswith("arm.urdf: ")


def test_a_mutated_urdf_loads_or_says_why(rng):
    letters = list('<>/"= 0.-eabc\n')
    for _ in range(150):
        text = list(ARM)
        for _ in range(int(rng.integers(1, 4))):
            place, letter = int(rng.integers(len(text))), letters[int(rng.integers(len(letters)))]
            text[place : place + int(rng.integers(0, 3))] = [letter]
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RobotFileWarning)
                load_urdf_text("".join(text))
        except RobotFileError as error:
            assert error.problems

"""A robot is drawn where its coordinates put it, and described in facts."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
import yaml

from patagium.dynamics.kinematics import body_poses
from patagium.errors import ShapeError
from patagium.robot import load_robot, preset_names
from patagium.robot.drawing import draw_robot
from patagium.robot.files import preset_text
from patagium.robot.planform import describe_robot, poses


@pytest.mark.parametrize("name", preset_names())
def test_drawn_poses_are_those_of_the_dynamics(name, rng):
    robot = load_robot(name)
    q = rng.normal(size=robot.dof)
    drawn = poses(robot, q)
    for (position, rotation), pose in zip(drawn, body_poses(robot, ca.SX(q)), strict=True):
        # two sines and cosines a joint
        np.testing.assert_allclose(position, np.array(ca.DM(pose.position))[:, 0], atol=1e-14)
        np.testing.assert_allclose(rotation, np.array(ca.DM(pose.rotation)), atol=1e-14)


@pytest.mark.parametrize("name", preset_names())
def test_a_figure_shows_every_strip_in_each_view(name):
    robot = load_robot(name)
    figure = draw_robot(robot)
    wings = [strip.wing for strip in robot.strips]
    for panel in figure.axes:
        drawn = [len(k.get_paths()) for k in panel.collections]
        assert drawn == [wings.count(wing) for wing in dict.fromkeys(wings)]


def test_a_figure_shows_nose_axes_limits_and_lifting_lines():
    figure = draw_robot(load_robot("ornithopter"))
    above, behind, left = figure.axes
    assert "nose" in [k.get_text() for k in above.texts]
    assert (
        figure.get_supxlabel().splitlines()[0].startswith("1  left_plunge: about x, -45 to 60 deg")
    )
    assert "right" not in figure.get_supxlabel()  # the other side is its image
    labels = above.get_legend_handles_labels()[1]
    assert {"lifting line", "path of the tip between its limits", "center of mass"} <= {*labels}
    (line,) = [k for k in above.lines if k.get_label() == "lifting line"]
    assert len(line.get_xdata()) == 16  # the strips of both wings
    plunge = [k for k in behind.lines if k.get_label() == "path of the tip between its limits"]
    (fin,) = [k for k in left.collections if k.get_label() == "fin"]
    assert np.ptp(fin.get_datalim(left.transData).intervalx) > 0.1  # a line in the other views
    heights = plunge[0].get_ydata()
    assert heights.max() > 0.6 and heights.min() < -0.4  # an arc, upwards and downwards


def test_ways_of_a_tip_mirror_each_other(tmp_path):
    """Of a tail whose trailing edges are along its axes, at one distance from them."""
    described = yaml.safe_load(preset_text("ornithopter"))
    described["bodies"]["left_tail"] = {
        **{"parent": "body", "at": [-0.4, 0.01, 0], "orientation": [0.6, 0, 0], "mass": 0.01},
        "center_of_mass": [-0.04, 0.055, 0],
        "joints": [{"name": "left_tail", "axis": "y", "limits": [-0.5, 0.5]}],
        "shape": {"type": "plate", "chord": 0.1, "span": 0.2, "thickness": 0.002},
    }
    edges = {"leading": 0, "trailing": -0.08}
    ends = [{"span": 0, **edges}, {"span": 0.11, **edges}]
    segment = {"body": "left_tail", "strips": 3, "stations": ends}
    described["wings"].append({"name": "left_tail", "segments": [segment]})
    (tmp_path / "v.yaml").write_text(yaml.safe_dump(described))
    above = draw_robot(load_robot(tmp_path / "v.yaml")).axes[0]
    ways = [k.get_xdata() for k in above.lines if len(k.get_xdata()) == 33]
    left, right = (x for x in ways if 0.05 < abs(x.mean()) < 0.15 and np.ptp(x) > 0.03)
    np.testing.assert_allclose(left, -right, atol=1e-12)


def test_a_drawing_refuses_coordinates_of_another_robot():
    with pytest.raises(ShapeError, match=r"q: expected shape \(14,\), found \(3,\)"):
        draw_robot(load_robot("aerobat"), np.zeros(3))


def test_facts_count_what_is_there():
    facts = describe_robot(load_robot("aerobat"))
    assert facts["coordinates"] == 14 and facts["joints"] == 8 and facts["strips"] == 10
    assert facts["mass [kg]"] == 0.02
    assert facts["span [m]"] == 0.3814
    assert facts["wing area [m^2]"] == 0.024
    assert describe_robot(load_robot("yeo-wing"))["base"] == "fixed"


def test_facts_of_a_small_robot_have_their_digits():
    """A robot of 1e-10 kg had no mass, and areas three digits."""
    robot = load_robot("aerobat")
    bodies = [replace(body, mass=5e-9 * body.mass) for body in robot.bodies]
    strips = [replace(one, chord=3e-6 * one.chord) for one in robot.strips]
    facts = describe_robot(replace(robot, bodies=bodies, strips=strips))
    assert facts["mass [kg]"] == 1e-10 and facts["wing area [m^2]"] == 7.2e-8

"""An arm follows a path exactly, or says which joint cannot, when and by how much."""

from dataclasses import replace

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError, PathError, ShapeError
from patagium.robot.attitude import rotation_from_angles
from patagium.simulation.arm import CLEARANCE, carried_gait, plan_arm, rotation_vector

TURN, SHIFT = (0.0, -np.pi / 2, 0.0), (0.01, 0.02, 0.05)
EIGHT = {"along": (0, 1, 0), "across": (0, 0, 1)}


def _eight(speed=1.0):
    return pt.paths.figure_of_eight((0.65, 0, 0.2), 0.9, 0.3, speed=speed, **EIGHT)


@pytest.fixture(scope="module")
def arm():
    return pt.load_robot("ur5e")


@pytest.fixture(scope="module")
def plan(arm):
    return plan_arm(arm, _eight(), position=SHIFT, orientation=TURN)


def test_the_tool_is_on_the_path_at_any_time(plan, rng):
    time = rng.uniform(0, 5 * plan.period, 200)
    motion, target = plan.motion(time), plan.path.motion(time)
    place, turn, _ = plan.tool.pose(motion.position)
    np.testing.assert_allclose(place, target.position[:, :3], atol=1e-12)
    np.testing.assert_allclose(turn, rotation_from_angles(target.position[:, 3:]), atol=1e-12)


def test_joint_rates_are_derivatives_of_joint_positions(plan):
    time, step = np.linspace(0.1, 1.5, 40), 1e-5
    motion = plan.motion(time)
    after, before = plan.motion(time + step), plan.motion(time - step)
    for rate, value, scale in (("velocity", "position", 1), ("acceleration", "velocity", 10)):
        expected = (getattr(after, value) - getattr(before, value)) / (2 * step)
        # second order in the step
        np.testing.assert_allclose(getattr(motion, rate), expected, atol=1e-7 * scale)


def test_a_turning_path_turns_the_tool(arm):
    path = pt.paths.sinusoid(
        (0.5, 0.1, 0.4), frequency=0.3, phase={"pitch": 1.0}, roll=0.3, pitch=0.4, yaw=0.5, x=0.05
    )
    plan = plan_arm(arm, path, orientation=TURN)
    time, step = np.linspace(0, 3, 30), 1e-5
    motion = plan.motion(time)
    _, turn, jacobian = plan.tool.pose(motion.position)
    np.testing.assert_allclose(
        turn, rotation_from_angles(path.motion(time).position[:, 3:]), atol=1e-12
    )
    after = rotation_from_angles(path.motion(time + step).position[:, 3:])
    before = rotation_from_angles(path.motion(time - step).position[:, 3:])
    spin = rotation_vector(after @ np.swapaxes(before, 1, 2)) / (2 * step)
    found = np.einsum("nij,nj->ni", jacobian, motion.velocity)[:, 3:]
    np.testing.assert_allclose(found, spin, atol=1e-8)


def test_a_plan_is_clear_and_within_the_limits(plan, arm):
    assert plan.clearance > CLEARANCE
    for k, (name, demand) in enumerate(plan.demands().items()):
        assert name == arm.dof_names[k]
        assert arm.lower[k] <= demand["least"] <= demand["greatest"] <= arm.upper[k]
        assert 0 <= demand["speed"] <= arm.speed_limit[k]
        assert demand["torque"] <= arm.effort_limit[k]
    assert plan.describe()["name"] == "ur5e"


def test_a_plan_begins_where_it_is_told(plan, arm):
    again = plan_arm(arm, plan.path, position=SHIFT, orientation=TURN, start=plan.knots[0] + 0.02)
    np.testing.assert_allclose(again.knots, plan.knots, atol=1e-9)


def _refusal(arm, path, **options):
    with pytest.raises(PathError) as caught:
        plan_arm(arm, path, orientation=TURN, **options)
    return caught.value


def test_what_an_arm_cannot_do_is_refused_with_the_reason(arm, plan):
    fast = _refusal(arm, _eight(3.0))
    assert fast.quantity == "speed" and fast.joint in arm.dof_names and fast.unit == "rad/s"
    assert fast.value > fast.limit == pytest.approx(np.pi) and 0 <= fast.time <= 1.2
    lazy = replace(arm, acceleration_limit=(1.0,) * 6)
    assert _refusal(lazy, _eight()).quantity == "acceleration"
    weak = replace(arm, effort_limit=(150, 10, 150, 28, 28, 28))
    error = _refusal(weak, _eight())
    assert (error.joint, error.quantity, error.limit) == ("shoulder_lift", "torque", 10)
    low, high = list(arm.lower), list(arm.upper)
    demand = plan.demands()["shoulder_pan"]
    middle = (demand["least"] + demand["greatest"]) / 2
    low[0], high[0] = middle - 0.1, middle + 0.1
    stiff = replace(arm, lower=tuple(low), upper=tuple(high))
    assert _refusal(stiff, _eight(), start=plan.knots[0]).quantity == "position"


def test_out_of_reach_and_near_singularities_is_refused(arm):
    start = _refusal(arm, pt.paths.line((2, 0, 0.2), (2.2, 0, 0.2), duration=2))
    assert start.time == 0 and start.quantity == "distance of the tool from the path's start"
    assert 0.9 < start.value < 1.4  # the arm reaches about .95 m
    leaving = _refusal(arm, pt.paths.line((0.5, 0, 0.3), (1.5, 0, 0.3), duration=4))
    assert "singularity" in leaving.quantity and 0 < leaving.time < 4
    assert leaving.value > leaving.limit == pytest.approx(1 / CLEARANCE)


def test_a_turn_too_many_cannot_go_on_for_ever(arm):
    down, arm = (np.pi, 0.0, 0.0), replace(arm, lower=(-20.0,) * 6, upper=(20.0,) * 6)
    plan_arm(arm, pt.paths.circle((0.5, 0, 0.3), 0.02, frequency=0.2), orientation=down)
    with pytest.raises(PathError) as caught:
        plan_arm(arm, pt.paths.circle((0, 0, 0.3), 0.5, frequency=0.05), orientation=down)
    assert caught.value.quantity == "gain a period"
    assert caught.value.joint in ("shoulder_pan", "wrist_3")
    assert caught.value.value == pytest.approx(2 * np.pi)


def test_only_an_arm_plans(arm):
    with pytest.raises(ParameterError, match="one of 6 joints"):
        plan_arm(pt.load_robot("yeo-wing"), _eight())
    with pytest.raises(ParameterError, match="one of shoulder"):
        plan_arm(arm, _eight(), at="hand")
    with pytest.raises(ShapeError, match="start"):
        plan_arm(arm, _eight(), start=[0, 0])


def test_a_carried_gait_is_the_arms_and_the_robots(arm, plan):
    robot = pt.load_robot("aerobat")
    tree = robot.mounted_on(arm, "tool", position=SHIFT, orientation=TURN)
    wings = pt.gaits.linkage(robot, frequency=5.0)
    gait = carried_gait(tree, plan, wings)
    time = np.linspace(0, 1, 5)
    assert gait.joints == tree.dof_names
    np.testing.assert_array_equal(gait.motion(time).position[:, 6:], wings.motion(time).position)
    assert gait.describe()["kind"] == "carried"
    with pytest.raises(ParameterError, match="joints arm_shoulder_pan"):
        carried_gait(tree, plan, pt.gaits.still(pt.load_robot("yeo-wing")))

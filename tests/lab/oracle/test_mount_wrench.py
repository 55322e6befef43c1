"""Wrenches at mount, load cells and ground against Pinocchio's Newton-Euler, arm plus robot."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import patagium as pt
from patagium.dynamics.kinematics import point_position, point_velocity
from patagium.simulation.arm import carried_gait

CLOSE = 1e-9  # relative to the largest entry: acceptance of the issue
SHIFT, TURN = (0.01, -0.02, 0.05), (0.0, -np.pi / 2, 0.0)
CELL_SHIFT, CELL_TURN = (0.0, 0.01, 0.02), (0.3, -0.2, 0.5)
STEP, SAMPLES = 1e-3, 12


@pytest.fixture(scope="module")
def flights():
    """The same motion twice: base prescribed, and arm and robot as one tree."""
    robot, arm = pt.load_robot("aerobat"), pt.load_robot("ur5e")
    arm = arm.with_parameters({"gravity": robot.gravity})
    eight = pt.paths.figure_of_eight(
        (0.65, 0, 0.2), 0.9, 0.3, speed=1.5, along=(0, 1, 0), across=(0, 0, 1)
    )
    rocking = pt.paths.sinusoid((0, 0, 0), frequency=1 / eight.period, roll=0.2, pitch=0.3, yaw=0.2)
    path = pt.paths.superposed(eight, rocking)
    mount = pt.mounts.on_arm(arm, path, position=SHIFT, orientation=TURN)
    gait = pt.gaits.linkage(robot, frequency=5.0)
    options = {"duration": STEP * SAMPLES, "time_step": STEP}
    cells = [
        pt.mounts.load_cell("body", CELL_SHIFT, CELL_TURN),
        pt.mounts.load_cell("left_plunge", (0, 0.01, 0), (0.1, 0.2, 0.3)),
    ]
    carried = pt.simulate(
        robot, pt.QuasiSteady(robot, pt.Air()), gait, mount=mount, load_cells=cells, **options
    )
    tree = robot.mounted_on(arm, "tool", position=SHIFT, orientation=TURN)
    both = carried_gait(tree, mount.plan, gait)
    air = pt.QuasiSteady(tree, pt.Air())
    # the damper of the floating coordinates goes with them: it resists no arm
    in_tree = pt.simulate(tree, air, both, load_cells=cells, **options)
    return robot, arm, tree, carried, in_tree


def _moved(position, rotation, wrench):
    """Force and moment about the world's origin as seen in axes at a place."""
    force, moment = wrench[:3], wrench[3:]
    return np.concatenate([rotation.T @ force, rotation.T @ (moment - np.cross(position, force))])


def _air(flight, k):
    """Force and moment of the strips about the world's origin."""
    force, point = flight["strip_force"].values[k], flight["strip_point"].values[k]
    return np.concatenate([force.sum(axis=0), np.cross(point, force).sum(axis=0)])


class _Pinocchio:
    """Arm and robot as two models; the robot hangs on a free joint moved as the tool is."""

    def __init__(self, robot, arm) -> None:
        self.pin = pytest.importorskip("pinocchio", reason="Pinocchio comes with `bench`")
        from patagium_lab.rivals.joint_table import joint_table
        from patagium_lab.rivals.pinocchio_model import PinocchioModel

        self.arm = PinocchioModel(arm)
        rows = joint_table(robot)[1:]  # without the translation: one free joint for both
        self.model = self.pin.Model()
        self.model.gravity.linear = np.array([0, 0, -robot.gravity])
        self.dofs = []
        for row in rows:
            free = row.kind == "zyx"
            kind = "FreeFlyer" if free else row.kind
            joint = getattr(self.pin, f"JointModel{kind}")()
            place = self.pin.SE3(row.rotation, row.position)
            parent = 0 if free else row.parent
            index = self.model.addJoint(parent, joint, place, row.name)
            inertia = self.pin.Inertia(row.mass, row.center_of_mass, row.central_inertia)
            self.model.appendBodyToJoint(index, inertia, self.pin.SE3.Identity())
            self.dofs += [] if free else list(row.dofs)
        self.state = self.model.createData()

    def needed(self, arm_motion, joint_motion):
        """Wrench at the robot's base that its motion takes, base axes, and the base's pose."""
        pin, model, state = self.pin, self.arm.model, self.arm.data
        pin.forwardKinematics(model, state, *arm_motion)
        euler = pin.rpy.rpyToMatrix(*TURN)
        offset = pin.SE3(euler, np.array(SHIFT))
        pose = state.oMi[model.njoints - 1] * offset
        speed = offset.actInv(state.v[model.njoints - 1])
        acceleration = offset.actInv(state.a[model.njoints - 1])
        q, v, a = (x[self.dofs] for x in joint_motion)
        full_q = np.concatenate([pin.SE3ToXYZQUAT(pose), q])
        full_v = np.concatenate([speed.vector, v])
        full_a = np.concatenate([acceleration.vector, a])
        return pin.rnea(self.model, self.state, full_q, full_v, full_a)[:6], pose


def _assert_close(found, expected) -> None:
    assert np.abs(found - expected).max() <= CLOSE * np.abs(expected).max()


@pytest.mark.usefixtures("interpreted")
def test_pinocchio_finds_the_wrench_between_arm_and_robot(flights) -> None:
    robot, arm, _, carried, in_tree = flights
    theirs = _Pinocchio(robot, arm)
    cell_turn = theirs.pin.rpy.rpyToMatrix(*CELL_TURN)
    for k in range(0, SAMPLES + 1, 3):
        arm_motion = [in_tree[x].values[k, :6] for x in "qva"]
        needed, pose = theirs.needed(arm_motion, [carried[x].values[k] for x in "qva"])
        air = _moved(pose.translation, pose.rotation, _air(in_tree, k))
        expected = _moved(np.array(CELL_SHIFT), cell_turn, needed - air)
        _assert_close(in_tree["load_cell_wrench"].values[k, 0], expected)
        # the damper of the floating coordinates acts on the body: mount and cell bear it
        damping = carried["damping_force"].values[k]
        outside = needed - air + _damper(robot, pose.rotation, carried["q"].values[k], -damping)
        expected = _moved(np.array(CELL_SHIFT), cell_turn, outside)
        _assert_close(carried["load_cell_wrench"].values[k, 0], expected)
        found = _moved(pose.translation, pose.rotation, carried["mount_wrench"].values[k])
        _assert_close(found, outside)


def _damper(robot, rotation, q, force):
    """A generalized force on roll, pitch and yaw as a moment in body axes."""
    pitch, yaw = q[4], q[5]
    axes = np.array(
        [
            [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)],
            [-np.sin(yaw), np.cos(yaw), 0],
            [0, 0, 1],
        ]
    )
    return np.concatenate([np.zeros(3), rotation.T @ np.linalg.solve(axes, force[3:6])])


def test_pinocchio_finds_the_reaction_of_the_ground(flights) -> None:
    pin = pytest.importorskip("pinocchio", reason="Pinocchio comes with `bench`")
    from patagium_lab.rivals.pinocchio_model import PinocchioModel

    _, _, tree, _, in_tree = flights
    theirs = PinocchioModel(tree)
    for k in range(0, SAMPLES + 1, 3):
        motion = [in_tree[x].values[k][theirs.order] for x in "qva"]
        pin.forwardKinematics(theirs.model, theirs.data, motion[0])
        pin.rnea(theirs.model, theirs.data, *motion)
        ground = theirs.data.oMi[1].act(theirs.data.f[1]).vector
        _assert_close(in_tree["mount_wrench"].values[k], ground - _air(in_tree, k))


def test_both_ways_to_carry_the_robot_are_one_motion(flights) -> None:
    robot, _, tree, carried, in_tree = flights
    for name, scale in (("q", 1.0), ("v", 10.0), ("a", 1e3)):
        ours, theirs = carried[name].values[:, 6:], in_tree[name].values[:, 6:]
        np.testing.assert_allclose(ours, theirs, atol=1e-12 * scale)
    q, v = ca.SX.sym("q", tree.dof), ca.SX.sym("v", tree.dof)
    at = tree, q, v, tree.body_index("body"), ca.SX.zeros(3, 1)
    velocity = point_velocity(*at)
    body = ca.Function("body", [q, v], [point_position(*at[:2], *at[3:]), velocity])
    for k in range(SAMPLES + 1):
        place, speed = body(in_tree["q"].values[k], in_tree["v"].values[k])
        np.testing.assert_allclose(place.full()[:, 0], carried["q"].values[k, :3], atol=1e-12)
        np.testing.assert_allclose(speed.full()[:, 0], carried["v"].values[k, :3], atol=1e-11)
    np.testing.assert_allclose(
        carried["strip_force"].values, in_tree["strip_force"].values, atol=1e-12
    )
    # a cell at a wing's root does not know how the body is held
    np.testing.assert_allclose(
        carried["load_cell_wrench"].values[:, 1],
        in_tree["load_cell_wrench"].values[:, 1],
        rtol=1e-9,
        atol=1e-12,
    )

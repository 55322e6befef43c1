"""Air of MuJoCo around a robot: on a mount, and in free flight that MuJoCo integrates.

Each strip is a flat box with MuJoCo's ellipsoid model of the fluid: drag, lift by Kutta's
condition, Magnus force, angular drag, and of the added mass the products of velocities. MuJoCo
leaves out the part of added mass that goes with acceleration, so its force depends on q and v
alone. A body without strips has no air, or MuJoCo's drag of a box of the same inertia.
"""

from __future__ import annotations

from collections.abc import Callable
from xml.etree import ElementTree

import numpy as np

from patagium.aerodynamics import Air
from patagium.arrays import Array
from patagium.errors import FlightError
from patagium.robot import Robot
from patagium.simulation.gait_models import FourierGait
from patagium_lab.foreign.kinematics import Wingbeat
from patagium_lab.foreign.programs import MUJOCO, program
from patagium_lab.foreign.record import ForeignOrigin
from patagium_lab.rivals.mujoco_model import MujocoModel, mujoco_xml, numbers_text

Motion = tuple[Array, Array, Array]

VISCOSITY = 1.8e-5
"""Viscosity of the air [Pa s]."""
THICKNESS = 2e-3
"""Thickness of a strip's box [m]."""
INNER_STEP = 1e-4
"""Time step of a free flight [s]."""
STEEPEST = 1.2
"""Pitch at which a free flight ends, before its Euler angles do [rad]."""
_STIFFNESS, _DAMPING = 4e4, 4e2  # of the error of a driven joint [1/s^2, 1/s]
_ENDS = (15.0, 400.0)  # speed [m/s] and rate of the body [rad/s] at which a free flight ends


class MujocoAir(MujocoModel):
    """A robot in MuJoCo's fluid.

    Args:
        robot: Machine with numbers, not symbols.
        air: Density and steady wind.
        body_drag: Whether bodies without strips have MuJoCo's drag of a box.

    Raises:
        ParameterError: If MuJoCo is not installed.
    """

    def __init__(self, robot: Robot, air: Air, *, body_drag: bool = False) -> None:
        program(MUJOCO)
        super().__init__(robot, _with_fluid(robot, air, body_drag))
        self.robot = robot
        self.model.dof_damping[:] = np.array(robot.damping, float)[self.order]
        for k in range(self.model.njnt if robot.stiffness else 0):
            place = self.order[self.model.jnt_dofadr[k]]
            self.model.jnt_stiffness[k] = float(robot.stiffness[place])
            self.model.qpos_spring[self.model.jnt_qposadr[k]] = float(robot.rest[place])

    def forces(self, q: Array, v: Array) -> Array:
        """Generalized force of the air, (N, n) [N, N m].

        Args:
            q: Generalized coordinates, (N, n_q) [m, rad].
            v: Generalized velocities, (N, n) [m/s, rad/s].
        """
        found = np.empty_like(v)
        for k in range(len(v)):
            self.data.qpos[:], self.data.qvel[:] = q[k][self.places], v[k][self.order]
            self.mujoco.mj_fwdPosition(self.model, self.data)
            self.mujoco.mj_fwdVelocity(self.model, self.data)
            found[k, self.order] = self.data.qfrc_fluid
        return found

    def fly(self, gait: FourierGait, q: Array, v: Array, time: Array) -> tuple[Motion, Array]:
        """Motion and force of a free flight, up to the last of the times or a fall.

        Joints are driven by the torques that give them the gait's accelerations.

        Args:
            gait: Motion of the actuated joints.
            q: First coordinates, (n_q,) [m, rad].
            v: First velocities, (n,) [m/s, rad/s].
            time: Times of the samples, evenly spaced, (N,) [s].

        Returns:
            q, (M, n_q), v and a, (M, n) [SI], and the force, (M, n) [N, N m]; M is smaller than
            N where the robot falls head over heels.

        Raises:
            FlightError: If the flight is not finite.
        """
        self.model.opt.timestep = INNER_STEP
        self.model.opt.integrator = self.mujoco.mjtIntegrator.mjINT_RK4
        self.mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = q[self.places], v[self.order]
        per = round((time[1] - time[0]) / INNER_STEP)
        steps, steep = (len(time) - 1) * per + 1, self.robot.index("pitch")
        drive, rows = self._drive(gait, steps), list[list[Array]]()
        for step in range(steps):
            drive(step)
            if step % per == 0:
                self.mujoco.mj_forward(self.model, self.data)
                rows.append(self._sample())
                if abs(rows[-1][0][steep]) > STEEPEST or self._too_fast(rows[-1][1]):
                    break
            self.mujoco.mj_step(self.model, self.data)
        q_, v_, a_, force = (np.array(column) for column in zip(*rows, strict=True))
        if not all(np.isfinite(one).all() for one in (q_, v_, a_, force)):
            raise FlightError(f"{self.robot.name}: expected a finite flight by MuJoCo, found none")
        return (q_, v_, a_), force

    def _too_fast(self, v: Array) -> bool:
        return bool(np.abs(v[:3]).max() > _ENDS[0] or np.abs(v[3:6]).max() > _ENDS[1])

    def _sample(self) -> list[Array]:
        data, n = self.data, len(self.order)
        q, v, a, force = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
        q[self.places], v[self.order] = data.qpos, data.qvel
        a[self.order], force[self.order] = data.qacc, data.qfrc_fluid
        return [q, v, a, force]

    def _drive(self, gait: FourierGait, steps: int) -> Callable[[int], None]:
        """Function that sets the joint torques of an inner step."""
        motion = gait.motion(np.arange(steps) * INNER_STEP)
        theirs = {dof: k for k, dof in enumerate(self.order.tolist())}
        joints = np.array([theirs[dof] for dof in self.robot.actuated])
        others = np.setdiff1d(np.arange(len(self.order)), joints)
        unit, mass = np.eye(len(self.order)), np.empty((len(self.order),) * 2)
        model, data, mujoco = self.model, self.data, self.mujoco

        def drive(step: int) -> None:
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fwdVelocity(model, data)
            for column, one in zip(mass, unit, strict=True):
                mujoco.mj_mulM(model, data, column, one)
            a = motion.acceleration[step]
            a = a + _STIFFNESS * (motion.position[step] - data.qpos[joints])
            a = a + _DAMPING * (motion.velocity[step] - data.qvel[joints])
            load = data.qfrc_passive - data.qfrc_bias
            push = load[others] - mass[np.ix_(others, joints)] @ a
            rest = np.linalg.solve(mass[np.ix_(others, others)], push)
            data.qfrc_applied[:] = 0.0
            data.qfrc_applied[joints] = (
                mass[np.ix_(joints, joints)] @ a
                + mass[np.ix_(joints, others)] @ rest
                - load[joints]
            )

        return drive


def mounted_flight(
    robot: Robot, wingbeat: Wingbeat, time: Array
) -> tuple[ForeignOrigin, Array, Motion, Array]:
    """Wingbeats on a mount at a steady speed, with the force of MuJoCo's air.

    Args:
        robot: Robot with one floating body.
        wingbeat: The wingbeat.
        time: Times of the samples, (N,) [s].
    """
    air, gait = Air(), wingbeat.gait(robot)
    motion = carried_motion(robot, wingbeat, time)
    force = MujocoAir(robot, air).forces(*motion[:2])
    program = "MuJoCo, ellipsoid fluid, on a mount"
    return ForeignOrigin(robot, air, program, gait.describe(), "carried"), time, motion, force


def free_flight(
    robot: Robot, wingbeat: Wingbeat, time: Array, *, body_drag: bool
) -> tuple[ForeignOrigin, Array, Motion, Array]:
    """Free flight that MuJoCo integrates, from the speed and attitude of a wingbeat.

    Args:
        robot: Robot with one floating body.
        wingbeat: The wingbeat.
        time: Times of the samples, (N,) [s].
        body_drag: Whether bodies without strips have MuJoCo's drag of a box.
    """
    air, gait = Air(), wingbeat.gait(robot)
    q, v, _ = (one[0] for one in carried_motion(robot, wingbeat, time[:1]))
    motion, force = MujocoAir(robot, air, body_drag=body_drag).fly(gait, q, v, time)
    program = "MuJoCo, ellipsoid fluid, free flight" + (", box drag on bodies" * body_drag)
    origin = ForeignOrigin(robot, air, program, gait.describe(), "free")
    return origin, time[: len(force)], motion, force


def carried_motion(robot: Robot, wingbeat: Wingbeat, time: Array) -> Motion:
    """Motion of a robot that a mount carries forward at a steady speed and pitch.

    Args:
        robot: Robot with one floating body.
        wingbeat: Gait, speed and incidence.
        time: Times, (N,) [s].

    Returns:
        q, v and a, (N, n) [SI].
    """
    joints = wingbeat.gait(robot).motion(time)
    q, v, a = (np.zeros((len(time), robot.dof)) for _ in range(3))
    actuated = list(robot.actuated)
    q[:, actuated], v[:, actuated] = joints.position, joints.velocity
    a[:, actuated] = joints.acceleration
    q[:, robot.index("x")], v[:, robot.index("x")] = wingbeat.speed * time, wingbeat.speed
    q[:, robot.index("pitch")] = -wingbeat.incidence
    return q, v, a


def _with_fluid(robot: Robot, air: Air, body_drag: bool) -> str:
    """MJCF text of a robot in MuJoCo's fluid."""
    root = ElementTree.fromstring(mujoco_xml(robot))
    for option in root.iter("option"):
        option.set("density", repr(air.density))
        option.set("viscosity", repr(VISCOSITY))
        option.set("wind", numbers_text(air.wind))
    elements = {str(one.get("name")): one for one in root.iter("body")}
    winged = {robot.bodies[strip.body].name for strip in robot.strips}
    for strip in robot.strips:
        forward, normal = np.array(strip.forward, float), np.array(strip.normal, float)
        middle = np.array(strip.quarter_chord, float) - forward * float(strip.chord) / 4
        size = float(strip.chord) / 2, float(strip.width) / 2, THICKNESS / 2
        axes = numbers_text([*forward, *np.cross(normal, forward)])
        box = {"type": "box", "pos": numbers_text(middle), "xyaxes": axes}
        box |= {"size": numbers_text(size), **_FLUID}
        ElementTree.SubElement(elements[robot.bodies[strip.body].name], "geom", box)
    for name in () if body_drag else set(elements) - winged:
        dot = {"type": "sphere", "size": "1e-6", **_FLUID}
        ElementTree.SubElement(elements[name], "geom", dot)
    return ElementTree.tostring(root, encoding="unicode")


_FLUID = {
    "mass": "0",
    "fluidshape": "ellipsoid",
    "contype": "0",
    "conaffinity": "0",
}

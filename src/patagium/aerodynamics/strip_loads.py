"""From the loads on strips to the force on the robot.

Loads act at points of the strips, in the planes of their sections; the generalized
force is the sum over strips of (dp_i/dq)^T f_i. Neglected: section moments about
those points, and air forces on anything but strips.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from patagium.aerodynamics.indicial import Relaxation
from patagium.aerodynamics.local_flow import StripMotion, strip_axes
from patagium.aerodynamics.polars import section_flow
from patagium.dynamics.chain import vector
from patagium.dynamics.kinematics import add_wrench, body_poses, generalized_force
from patagium.robot.model import Robot


@dataclass(frozen=True)
class AeroExpressions:
    """Forces of the air on a robot, as CasADi expressions.

    Attributes:
        generalized_force: Q = sum_i (dp_i/dq)^T f_i, and the moments' part, (n, 1) [N, N m].
        strip_force: Force on each strip, world axes, (3, n_strips) [N].
        strip_point: Where it acts, world axes, (3, n_strips) [m].
        angle_of_attack: Geometric incidence at that point: of its motion relative to the
            undisturbed air, (n_strips, 1) [rad].
        effective_angle_of_attack: Incidence of the chord that the load answers to: with the wake's
            lag and the velocity that the wings induce, where a model has them, (n_strips, 1) [rad].
        strip_airspeed: Speed of that point across the span, relative to the air,
            (n_strips, 1) [m/s]; its derivative is NaN where it is zero.
        power: Sum of force times velocity of its point relative to the air and of moment times
            pitch rate, scalar [W]; in still air the power of the air on the robot.
        state_derivative: Rate of the model's own states, (n_z, 1) [m/s^2, 1/s].
        circulation: Of each strip, positive where it lifts a wing that moves forward,
            (n_strips, 1) [m^2/s]; zero in models without.
        downwash: Normal velocity that the wings induce at each strip, against its normal,
            (n_strips, 1) [m/s]; zero in models without.
        memory: Relaxation of the states; None for a model without states.
        wind: Wind that strips meet, world axes, (3, n_strips) [m/s]; None for the given one.
    """

    generalized_force: ca.SX
    strip_force: ca.SX
    strip_point: ca.SX
    angle_of_attack: ca.SX
    effective_angle_of_attack: ca.SX
    strip_airspeed: ca.SX
    power: ca.SX
    state_derivative: ca.SX
    circulation: ca.SX
    downwash: ca.SX
    memory: Relaxation | None = None
    wind: ca.SX | None = None


@dataclass(frozen=True)
class StripLoad:
    """Force of the air on one strip, in the plane of its section.

    Attributes:
        motion: How the strip moves relative to the air.
        forward: Force along the chord to the leading edge [N].
        normal: Force out of the upper surface [N].
        ahead: Where it acts, ahead of the quarter chord [m].
        effective_angle_of_attack: Incidence that made it [rad].
        spanwise: Force along normal x forward [N].
        circulation: Bound circulation [m^2/s].
        downwash: Velocity that the wings induce, against the normal [m/s].
        moment: Moment about the point where the force acts, leading edge up [N m].
    """

    motion: StripMotion
    forward: Any
    normal: Any
    ahead: Any
    effective_angle_of_attack: Any
    spanwise: Any = 0.0
    circulation: Any = 0.0
    downwash: Any = 0.0
    moment: Any = 0.0


def assemble(
    robot: Robot,
    q: ca.SX,
    loads: Sequence[StripLoad],
    state_derivative: ca.SX,
    memory: Relaxation | None = None,
) -> AeroExpressions:
    """Loads of strips as forces on the robot.

    Args:
        robot: The machine.
        q: Generalized coordinates, (n_q,) [m, rad, 1].
        loads: One load a strip, in the order of `robot.strips`.
        state_derivative: Rate of the model's own states, (n_z, 1) [m/s^2, 1/s].
        memory: Relaxation of these states.
    """
    poses = body_poses(robot, q)
    wrenches: dict[int, tuple[ca.SX, ca.SX]] = {}
    forces, points = [ca.SX(3, 0)], [ca.SX(3, 0)]
    incidences, speeds = [ca.SX(0, 1)], [ca.SX(0, 1)]
    power = ca.SX(0)
    for load in loads:
        motion, strip = load.motion, load.motion.strip
        forward, normal, span = strip_axes(strip)
        force = forward * load.forward + normal * load.normal + span * load.spanwise
        point = vector(strip.quarter_chord) + forward * load.ahead
        add_wrench(wrenches, strip.body, force, ca.cross(point, force) - span * load.moment)
        pose = poses[strip.body]
        forces.append(pose.rotation @ force)
        points.append(pose.at(point))
        normal_velocity = motion.normal_ahead(load.ahead)
        incidences.append(section_flow(motion.forward, normal_velocity).angle_of_attack)
        speeds.append(ca.sqrt(motion.forward**2 + normal_velocity**2))
        power = power + load.forward * motion.forward + load.normal * normal_velocity
        power = power + load.spanwise * motion.spanwise_ahead(load.ahead)
        power = power + load.moment * motion.pitch_rate
    of_loads = {
        name: ca.vertcat(ca.SX(0, 1), *[getattr(load, name) for load in loads])
        for name in ("effective_angle_of_attack", "circulation", "downwash")
    }
    return AeroExpressions(
        generalized_force=generalized_force(robot, q, wrenches),
        strip_force=ca.horzcat(*forces),
        strip_point=ca.horzcat(*points),
        angle_of_attack=ca.vertcat(*incidences),
        strip_airspeed=ca.vertcat(*speeds),
        power=power,
        state_derivative=state_derivative,
        memory=memory,
        **of_loads,
    )

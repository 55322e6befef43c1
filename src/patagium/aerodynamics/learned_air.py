"""Model of the air with learned weights: the effectiveness of each strip, and a constant wrench.

The weights hold what a flight shows of a wing that was cut, of another polar, or of a wrong
weight: each strip's force over that of the model, and a mean force and moment on the body that
nothing else explains. The force is linear in both, and both are run-time numbers, so that other
weights compile nothing. Neglected: what changes the direction of a strip's force, or changes it
within a beat in another way than the force itself changes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from patagium.aerodynamics.on_model import OnModel
from patagium.aerodynamics.strip_loads import AeroExpressions
from patagium.arrays import real_array
from patagium.dynamics.kinematics import add_wrench, body_poses, generalized_force
from patagium.errors import ParameterError
from patagium.robot.model import Robot

WRENCH = ("force.x", "force.z", "moment.y")
"""Parts of the wrench: those of a mirrored robot; what is not mirrored, the strips tell."""


@dataclass(frozen=True)
class LearnedAir(OnModel):
    """Model of the air with learned weights: Q = sum_i e_i J_i^T f_i + J_b^T w.

    f_i is the force of the model on strip i, J_i the Jacobian of its point, e_i its effectiveness,
    and w a constant force forward and up and a moment of pitch in the axes of the first body, at
    its origin.

    Args:
        model: Model of the air that gives the force of each strip.
        weights: Effectiveness of each strip [1], then `WRENCH` [N, N m], (n_strips + 3,); by
            default 1 and 0, which is the model itself.

    Raises:
        ParameterError: If a weight is not finite, or the model is one of learned weights already.
        ShapeError: If the weights are not (n_strips + 3,).
    """

    weights: ArrayLike | None = None

    name = "learned"

    def __post_init__(self) -> None:
        super().__post_init__()
        count = len(self.robot.strips)
        given = np.r_[np.ones(count), np.zeros(3)] if self.weights is None else self.weights
        weights = real_array("weights", given, (count + 3,))
        if not np.isfinite(weights).all():
            raise ParameterError("weights", "finite numbers", weights.tolist())
        object.__setattr__(self, "weights", tuple(weights.tolist()))

    @property
    def weight_names(self) -> tuple[str, ...]:
        """Names of the weights, (n_strips + 3,)."""
        return (*(f"effectiveness.{strip.name}" for strip in self.robot.strips), *WRENCH)

    @property
    def own_parameters(self) -> dict[str, float]:
        """The weights by name [1, N, N m]."""
        return dict(zip(self.weight_names, np.asarray(self.weights), strict=True))

    def expressions(
        self, robot: Robot, q: ca.SX, v: ca.SX, state: ca.SX, wind: ca.SX, parameters: ca.SX
    ) -> AeroExpressions:
        """Equations of the model; see `Aerodynamics.expressions`."""
        own, strips = len(self.model.parameter_names), robot.strips
        air = self.model.expressions(robot, q, v, state, wind, parameters[:own])
        effective = parameters[own : own + len(strips)]
        wrench = parameters[own + len(strips) :]
        added = air.strip_force * ca.repmat(effective.T - 1, 3, 1)
        push = ca.vertcat(wrench[0], 0, wrench[1])
        body, poses = next(iter(robot.floating_bodies), 0), body_poses(robot, q)
        wrenches = {body: (push, ca.vertcat(0, wrench[2], 0))}
        for k, strip in enumerate(strips):
            pose = poses[strip.body]
            force = pose.rotation.T @ added[:, k]
            point = pose.rotation.T @ (air.strip_point[:, k] - pose.position)
            add_wrench(wrenches, strip.body, force, ca.cross(point, force))
        more = generalized_force(robot, q, wrenches)
        winds = wind if air.wind is None else air.wind
        winds = winds if winds.shape[1] > 1 else ca.repmat(winds, 1, len(strips))
        body_wind = poses[body].rotation.T @ ca.sum2(winds) / len(strips)
        carried = ca.sum1(ca.sum2(added * winds)) + ca.dot(push, body_wind)
        return replace(
            air,
            generalized_force=air.generalized_force + more,
            strip_force=air.strip_force + added,
            power=air.power + ca.dot(more, v) - carried,
        )

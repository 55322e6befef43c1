"""Learned air: a model of the air whose strips are more or less effective, beside a wrench.

What a flight tells of a wing that was cut, of a polar that is another, or of a weight that was
never weighed: each strip's force over that of the model, and a mean force and moment on the body
that nothing else explains. Both are linear in the force and run-time numbers, so that other
weights compile nothing. Neglected: what changes a strip's force in direction, or within a beat
otherwise than its own force.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.aerodynamics.air import Air
from patagium.aerodynamics.model import Aerodynamics
from patagium.aerodynamics.strip_loads import AeroExpressions
from patagium.arrays import real_array
from patagium.dynamics.chain import cross
from patagium.dynamics.kinematics import body_poses, generalized_force
from patagium.errors import ParameterError, ShapeError
from patagium.robot.model import Robot

Array = NDArray[np.float64]

WRENCH = ("force.x", "force.z", "moment.y")
"""Parts of the wrench: those of a mirrored robot; what is not mirrored, the strips tell."""


@dataclass(frozen=True)
class LearnedAir(Aerodynamics):
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

    model: Aerodynamics
    weights: ArrayLike | None = None

    name = "learned"

    def __post_init__(self) -> None:
        if isinstance(self.model, LearnedAir):
            raise ParameterError("model", "a model of the air without weights", self.model.name)
        count = len(self.robot.strips)
        given = np.r_[np.ones(count), np.zeros(3)] if self.weights is None else self.weights
        weights = real_array("weights", given)
        if weights.shape != (count + 3,):
            raise ShapeError("weights", (count + 3,), weights.shape)
        if not np.isfinite(weights).all():
            raise ParameterError("weights", "finite numbers", weights.tolist())
        object.__setattr__(self, "weights", tuple(weights.tolist()))

    @property
    def robot(self) -> Robot:  # type: ignore[override]
        """The machine."""
        return self.model.robot

    @property
    def air(self) -> Air:  # type: ignore[override]
        """Density, wind and gusts."""
        return self.model.air

    @property
    def state_size(self) -> int:
        """Number of states of the model."""
        return self.model.state_size

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states of the model."""
        return self.model.state_names

    @property
    def structure(self) -> str:
        """Text of what shapes the equations, numbers aside: part of a compiled function's key."""
        return f"{self.name} on {self.model.structure}"

    @property
    def weight_names(self) -> tuple[str, ...]:
        """Names of the weights, (n_strips + 3,)."""
        return (*(f"effectiveness.{strip.name}" for strip in self.robot.strips), *WRENCH)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the model's parameters, then of the weights."""
        return (*self.model.parameter_names, *self.weight_names)

    @property
    def parameters(self) -> Array:
        """Values of the model's parameters, then the weights, (n_c,)."""
        return np.concatenate([self.model.parameters, np.asarray(self.weights)])

    def describe(self) -> dict[str, Any]:
        """Description that makes the model again for a robot, as JSON-able values."""
        weights = np.asarray(self.weights).tolist()
        return {"model": self.name, "of": self.model.describe(), "weights": weights}

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
        poses, wrenches = body_poses(robot, q), {0: (push, ca.vertcat(0, wrench[2], 0))}
        for k, strip in enumerate(strips):
            pose = poses[strip.body]
            force = pose.rotation.T @ added[:, k]
            point = pose.rotation.T @ (air.strip_point[:, k] - pose.position)
            total, moment = wrenches.get(strip.body, (ca.SX.zeros(3, 1), ca.SX.zeros(3, 1)))
            wrenches[strip.body] = (total + force, moment + cross(point, force))
        more = generalized_force(robot, q, wrenches)
        winds = wind if wind.shape[1] > 1 else ca.repmat(wind, 1, len(strips))
        body_wind = poses[0].rotation.T @ ca.sum2(winds) / len(strips)
        carried = ca.sum1(ca.sum2(added * winds)) + ca.dot(push, body_wind)
        return replace(
            air,
            generalized_force=air.generalized_force + more,
            strip_force=air.strip_force + added,
            power=air.power + ca.dot(more, v) - carried,
        )

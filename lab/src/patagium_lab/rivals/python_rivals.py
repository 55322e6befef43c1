"""The rivals as a Python user calls them, their overhead included."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

import casadi as ca
import numpy as np

from patagium.arrays import Array
from patagium.robot.model import Robot
from patagium_lab.rivals import energy_form as energy
from patagium_lab.rivals.mujoco_model import MujocoModel
from patagium_lab.rivals.pinocchio_model import PinocchioModel
from patagium_lab.rivals.symbolic_rival import (
    lambdified,
    lambdified_by_symengine,
    sympy_code,
)

_RESULTS = {
    "mass_matrix": lambda robot, q, v: energy.energy_mass_matrix(robot, q),
    "bias": lambda robot, q, v: (
        energy.energy_coriolis(robot, q, v) + energy.energy_gravity(robot, q)
    ),
}


def python_rivals(robot: Robot, quantity: str) -> dict[str, Callable[..., object]]:
    """Functions of q, or of q and v, by name of the program; those that are installed.

    Args:
        robot: An Aerobat.
        quantity: "mass_matrix" or "bias".
    """
    rivals: dict[str, Callable[..., object]] = {}
    parameters, still = robot.parameters, np.zeros(robot.dof)
    listed = parameters.tolist()
    by_sympy = lambdified(sympy_code(robot), quantity)
    rivals["SymPy's lambdify with cse"] = lambda q, v=still: by_sympy(
        q.tolist(), v.tolist(), listed
    )
    if find_spec("symengine"):
        by_symengine = lambdified_by_symengine(robot, quantity)
        rivals["SymEngine's Lambdify with cse"] = lambda q, v=still: by_symengine(
            np.concatenate([q, v, parameters])
        )
    if find_spec("pinocchio"):
        rivals["Pinocchio's Python call"] = _pinocchio(robot, quantity)
    if find_spec("mujoco"):
        rivals["MuJoCo's Python calls"] = _mujoco(robot, quantity)
    return rivals


def _pinocchio(robot: Robot, quantity: str) -> Callable[..., object]:
    """The bare call; which coordinate is which does not matter to its time."""
    theirs = PinocchioModel(robot)
    model, data, pinocchio = theirs.model, theirs.data, theirs.pinocchio
    if quantity == "mass_matrix":
        return lambda q: pinocchio.crba(model, data, q)
    return lambda q, v: pinocchio.nonLinearEffects(model, data, q, v)


def _mujoco(robot: Robot, quantity: str) -> Callable[..., object]:
    """The bare calls of the stages a quantity needs."""
    theirs = MujocoModel(robot)
    model, state, mujoco = theirs.model, theirs.data, theirs.mujoco
    force = np.zeros(robot.dof)

    def mass_matrix(q: Array) -> None:
        state.qpos[:] = q
        mujoco.mj_kinematics(model, state)
        mujoco.mj_comPos(model, state)
        mujoco.mj_crb(model, state)

    def bias(q: Array, v: Array) -> None:
        state.qpos[:], state.qvel[:] = q, v
        mujoco.mj_kinematics(model, state)
        mujoco.mj_comPos(model, state)
        mujoco.mj_comVel(model, state)
        mujoco.mj_rne(model, state, 0, force)

    return mass_matrix if quantity == "mass_matrix" else bias


def interpreted_energy(robot: Robot, quantity: str) -> Callable[..., object]:
    """The energy form as a plain call of a CasADi function of q, or of q and v.

    Args:
        robot: The machine.
        quantity: "mass_matrix" or "bias".
    """
    q, v = ca.SX.sym("q", robot.dof), ca.SX.sym("v", robot.dof)
    inputs = [q] if quantity == "mass_matrix" else [q, v]
    function: Callable[..., object] = ca.Function(
        quantity, inputs, [_RESULTS[quantity](robot, q, v)], {"cse": True}
    )
    return function

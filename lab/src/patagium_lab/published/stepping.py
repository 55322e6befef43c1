"""The stepping of the published experiment, for comparison only.

At each step the wings' joints and rates are overwritten by the gait; then the whole
robot moves freely for one step, its joints without torque, the aerodynamic force
held constant. The overwriting does work and gives impulse that no force accounts
for (E3): the audits of such a flight say how much. Neglected: sense.

    state = [q, v, aerodynamic force, works (4), impulse (3)]
    row = [q, v of the actuated joints, wind (3)]
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
import xarray as xr

from patagium.aerodynamics import Aerodynamics
from patagium.arguments import Progress
from patagium.arrays import Array
from patagium.dynamics.equations import damping_force, forward
from patagium.errors import Outcome, ParameterError, SimulationFailed
from patagium.native import load_functions
from patagium.robot import Robot
from patagium.simulation.flight import FlightOrigin, flight_record
from patagium.simulation.flight_equations import RECORDED, external_force, observed
from patagium.simulation.gaits import sinusoidal
from patagium.simulation.runge_kutta import Equations, integrate, times_of
from patagium.simulation.simulator import check_robots, whole_steps
from patagium.simulation.state_layout import IMPULSE, WORKS
from patagium.simulation.state_limits import check_start, limits, outcome_message

INITIAL_YAW = 2 * np.pi
"""Heading the published experiment starts with [rad] (E7)."""


def simulate_published(
    robot: Robot,
    aero: Aerodynamics,
    *,
    frequency: float = 15.0,
    amplitude: float = 1.0,
    speed: float = 2.0,
    duration: float = 2.0,
    time_step: float = 1e-4,
    throw: bool = True,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Flight as the published experiment steps it; its defaults are the experiment's.

    Args:
        robot: The machine, floating, with joints `left_plunge` and `right_plunge`.
        aero: Model of the air.
        frequency: Beats a second [Hz].
        amplitude: Amplitude of both plunge angles [rad].
        speed: Initial speed along x [m/s].
        duration: A whole number of time steps [s].
        time_step: Step [s].
        throw: Whether a run that stops early raises, or is returned as it is.
        progress: Receives the number of steps done and of all steps.

    Returns:
        The flight, as `simulate` gives it. `a` is the free acceleration, u1 is zero.

    Raises:
        ParameterError: If an argument is not what it may be.
        SimulationFailed: If the run stopped early and `throw` is set.
    """
    _check(robot, aero)
    steps = whole_steps(duration, time_step)
    check_robots(robot, aero)
    gait = sinusoidal(robot, frequency=frequency, plunge=amplitude)

    def rows(time: Array) -> Array:
        motion = gait.motion(time)
        return np.column_stack([motion.position, motion.velocity, aero.air.wind_at(time)])

    state = np.zeros(3 * robot.dof + len(WORKS) + len(IMPULSE))
    state[: robot.dof] = robot.coordinates(yaw=INITIAL_YAW)
    state[robot.dof : 2 * robot.dof] = robot.velocities(x=speed)
    equations, names = _equations(robot, aero, state), _state_names(robot)
    check_start(equations, names, state)
    run = integrate(equations, state, rows, steps, time_step, progress)
    message = outcome_message(run, names, equations, steps, time_step)
    time = times_of(0, run.steps + 1, time_step)
    run.samples["wind"] = aero.air.wind_at(time)
    origin = FlightOrigin(robot, aero, gait.describe(), "free", time_step, "published")
    flight = flight_record(origin, time, run.samples, run.outcome, message)
    if throw and run.outcome is not Outcome.COMPLETED:
        raise SimulationFailed(message, flight, run.outcome)
    return flight


def _check(robot: Robot, aero: Aerodynamics) -> None:
    """Refuse a robot or air that the published stepping does not know."""
    if not robot.floating:
        raise ParameterError("robot", "a robot with a floating body", robot.name)
    if robot.attitude != "euler":
        raise ParameterError("robot", "a robot with Euler angles, as published", robot.attitude)
    if aero.state_size:
        raise ParameterError("aero", "a model without states of its own", aero.name)
    aero.air.require_uniform("aero.air")


def published_functions(robot: Robot, aero: Aerodynamics) -> Sequence[ca.Function]:
    """CasADi functions `prepare`, `rate` and `record` of (state, row, parameters).

    Args:
        robot: The machine.
        aero: Model of the air.
    """
    machine, robot_parameters = robot.symbolic()
    n, n_a = machine.dof, len(machine.actuated)
    state = ca.SX.sym("state", 3 * n + len(WORKS) + len(IMPULSE))
    row = ca.SX.sym("row", 2 * n_a + 3)
    aero_parameters = ca.SX.sym("c", len(aero.parameters))
    q, v, held = state[:n], state[n : 2 * n], state[2 * n : 3 * n]
    lag = ca.SX(0, 1)

    given_q, given_v = ca.SX(q), ca.SX(v)
    for k, i in enumerate(machine.actuated):
        given_q[i], given_v[i] = row[k], row[n_a + k]
    air = aero.expressions(machine, given_q, given_v, lag, row[2 * n_a :], aero_parameters)
    prepared = ca.vertcat(given_q, given_v, air.generalized_force, state[3 * n :])

    damping, zero = damping_force(machine, v), ca.SX.zeros(n, 1)
    a = forward(machine, q, v, held + damping)
    powers = ca.vertcat(0, ca.dot(held, v), ca.dot(damping, v), 0)
    impulse = external_force(machine, held + damping)
    rate = ca.vertcat(v, a, ca.SX.zeros(n, 1), powers, impulse)

    seen = aero.expressions(machine, q, v, lag, row[2 * n_a :], aero_parameters)
    recorded = {
        "q": q,
        "v": v,
        "a": a,
        "u1": zero,
        "aero_force": held,
        "damping_force": damping,
        "mount_force": zero,
        "mount_wrench": ca.SX.zeros(6, 1),
        **observed(machine, q, v, seen),
        "works": state[3 * n : 3 * n + len(WORKS)],
        "impulse": state[3 * n + len(WORKS) :],
        "aero_state": lag,
    }
    inputs = [state, row, robot_parameters, aero_parameters]
    names = ["state", "row", "robot_parameters", "aero_parameters"]
    return [
        ca.Function("prepare", inputs, [prepared], names, ["prepared"]),
        ca.Function("rate", inputs, [rate], names, ["rate"]),
        ca.Function("record", inputs, [recorded[k] for k in RECORDED], names, list(RECORDED)),
    ]


def _equations(robot: Robot, aero: Aerodynamics, state: Array) -> Equations:
    functions = load_functions(
        f"published flight {aero.key} {robot.structure}",
        lambda: published_functions(robot, aero),
        label=f"published flight of {robot.name}",
        many_only=["record"],
    )
    everything = tuple(range(robot.dof))
    lower, upper = limits(robot, everything, everything, state)
    return Equations(
        rate=functions["rate"],
        record=functions["record"],
        prepare=functions["prepare"],
        recorded=RECORDED,
        constants=(robot.parameters, np.asarray(aero.parameters, float)),
        lower=lower,
        upper=upper,
    )


def _state_names(robot: Robot) -> tuple[str, ...]:
    names = robot.dof_names
    return (
        *names,
        *(f"velocity of {name}" for name in names),
        *(f"aerodynamic force on {name}" for name in names),
        *WORKS,
        *IMPULSE,
    )

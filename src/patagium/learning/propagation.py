"""Forecast of a free-flying robot's motion by its equations, with the learned force of the air.

From the state at a time on, the joints repeat their last wingbeat, and the accelerations of the
other coordinates follow from the equations of motion with the force that the network gives at the
forecast state. With r(q, v, a) the force that the equations ask for less that of the network, each
step solves the linearly implicit midpoint rule, with w the mean acceleration of the step h:

    (dr/da + h/2 dr/dv) w = dr/da a - r(q, v, a),    v <- v + h w,    q <- q + h N(q) (v + h/2 w),

q and the joints at the middle of the step, a from the step before; exact in a where force and
equations are linear in it, and stable where the air damps a light robot within less than a step.
Neglected: forces between robot and ground; a mount, which prescribes what is forecast here.

References:
    Hairer & Wanner (1996), Solving ordinary differential equations II, ch. IV.7: linearly
    implicit methods.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from patagium.arrays import Array, stored
from patagium.dynamics.kinematics import coordinate_rates
from patagium.errors import PatagiumError
from patagium.learning.forecast import FrozenModel, Motion, Repetition
from patagium.learning.models.network import Network, flight_terms
from patagium.learning.samples import wind_change
from patagium.robot import Robot
from patagium.sensing.force import air_force
from patagium.simulation import added_mass_of

_SLOPE = 1e-4  # m/s and rad/s, difference by which the slope of the force is found
_ROUNDING = 1e-6  # of the largest force, below which a force on a free body is rounding


class RobotMotion:
    """Forecast of the inputs of a network by the equations of a free-flying robot.

    Args:
        form: Force of the air that the equations ask for.
        network: Network that gives it.
        time: Increasing, (N,) [s].
        motion: q (N, n_q), v and a (N, n) of the flight [SI].
        period: Wingbeat, where it is known beforehand [s].
        change: Wind less the steady one, (N, 3) [m/s], held from the last sample; None for none.

    Attributes:
        passive: Degrees of freedom that are forecast by the equations.
        beating: q and v of the joints, which show the wingbeat; of a body that drifts they would
            not. All of the motion where no joint moves.
    """

    def __init__(
        self,
        form: air_force.SampleForm,
        network: Network,
        time: Array,
        motion: tuple[Array, Array, Array],
        period: float | None,
        change: Array | None = None,
    ) -> None:
        robot = form.robot
        self._form, self._time = form, time
        self.passive = np.array(robot.passive)
        self._outputs = [network.output_names.index(robot.dof_names[i]) for i in robot.passive]
        self._moved = list(robot.actuated)
        self._joints = [robot.coordinate_indices[i] for i in robot.actuated]
        self.beating = np.hstack([motion[0][:, self._joints], motion[1][:, self._moved]])
        if not np.ptp(self.beating, axis=0).any():
            self.beating = np.hstack(motion)
        self._all = Repetition(time, np.hstack(motion), period, self.beating)
        self._sizes = np.cumsum([part.shape[1] for part in motion])[:-1]
        self._forces = np.zeros(robot.dof)
        self._changes = np.zeros((len(time), 3)) if change is None else change
        self._wind = self._changes[0]

    def path(self, last: int, ahead: Array, model: FrozenModel) -> Array:
        """Inputs at times after a sample, (N, n_measured) [units of x]; see `Motion`.

        Where the joints do not repeat themselves yet, they are held where they are.
        """
        self._wind = self._changes[last]
        ends = np.concatenate([[0.0], ahead])
        middles = (ends[1:] + ends[:-1]) / 2
        q_path, v_path, a_path = self._repeated(last, np.concatenate([ends, middles]))
        q, v, a = q_path[0], v_path[0].copy(), a_path[0].copy()
        model, count, found = model.fork(), len(ends), []
        for k, step in enumerate(np.diff(ends)):
            at = count + k
            state = q + step / 2 * self._rates(q, v), v.copy(), a_path[at].copy()
            state[0][self._joints] = q_path[at, self._joints]
            state[1][self._moved] = v_path[at, self._moved]
            state[2][self.passive] = a[self.passive]
            time = float(self._time[last] + middles[k])
            w, row = self._mean_acceleration(state, step, model, time)
            if not np.isfinite(w).all():
                return np.full((len(ahead), len(row)), np.nan)
            ended = v_path[k + 1].copy()
            ended[self.passive] = v[self.passive] + step * w
            q = q + step * self._rates(state[0], (v + ended) / 2)
            q[self._joints] = q_path[k + 1, self._joints]
            a, v = a_path[k + 1].copy(), ended
            a[self.passive] = w
            found.append(self._row(q, v, a))
        if self._form.sees_acceleration:
            time = float(self._time[last] + ends[-1])
            a[self.passive], _ = self._mean_acceleration((q, v, a), 0.0, model, time)
            found[-1] = self._row(q, v, a)
        return np.array(found)

    def rule(self) -> str:
        """Rule of the forecast, in words; see `Motion`."""
        return (
            "joints repeat their last wingbeat; the state is propagated by the robot's equations "
            "with the learned force"
        )

    def _repeated(self, last: int, times: Array) -> list[Array]:
        """q (N, n_q), v and a (N, n) that repeat the last wingbeat; held before there is one."""
        period = self._all.period(last)
        if period is None:
            whole = self._all.path(last, times)
        else:
            whole = self._all.repeated(last, times, period)
        q, v, a = (np.array(part) for part in np.split(whole, self._sizes, axis=1))
        if period is None:
            v[1:, self._moved], a[1:] = 0.0, 0.0
        return [q, v, a]

    def _rates(self, q: Array, v: Array) -> Array:
        """Rates of the coordinates, (n_q,) [m/s, rad/s, 1/s]."""
        return np.asarray(coordinate_rates(self._form.robot, q, v), float).ravel()

    def _row(self, q: Array, v: Array, a: Array) -> Array:
        """Measured inputs at a state, (n_measured,) [units of x]."""
        x = self._form.function(q, v, a, self._forces, self._form.parameters)[0]
        return np.asarray(self._relative(np.reshape(x, (1, -1)))[0])

    def _relative(self, x: Array) -> Array:
        """Measured inputs in the wind that is held, (N, n_measured) [units of x]."""
        return air_force.relative_to_wind(x, self._wind, self._form.robot, self._form.inputs)

    def _mean_acceleration(
        self,
        state: tuple[Array, Array, Array],
        step: float,
        model: FrozenModel,
        time: float,
    ) -> tuple[Array, Array]:
        """Mean acceleration of what is forecast over a step, and the measured inputs of its middle.

        The state is q (n_q,) of the middle of the step, v and a (n,), of the joints there and of
        the rest at the begin [SI]; a step of 0 gives the acceleration there. The memory moves on.
        """
        network, weights, memory = model
        q, v, a = state
        count = len(self.passive)
        rows = 2 * count + 1
        every_v, every_a = np.tile(v, (rows, 1)), np.tile(a, (rows, 1))
        for k, dof in enumerate(self.passive):
            every_a[1 + k, dof] += 1.0
            every_v[1 + count + k, dof] += _SLOPE
        both = self._form.function.batch(
            *(np.tile(q, (rows, 1)), every_v, every_a, np.tile(self._forces, (rows, 1))),
            self._form.parameters,
        )
        x, wanted = (np.array(part).reshape(rows, -1) for part in both)
        x = self._relative(x)
        recalled = memory.recall(weights, np.array([time]), x[:1])
        known = np.hstack([x, np.tile(recalled[0, x.shape[1] :], (rows, 1))])
        force = network.evaluate(known, weights)[:, self._outputs]
        missing = wanted[:, self.passive] - force
        by_a = (missing[1 : 1 + count] - missing[0]).T
        by_v = (missing[1 + count :] - missing[0]).T / _SLOPE
        try:
            w = np.linalg.solve(by_a + step / 2 * by_v, by_a @ a[self.passive] - missing[0])
        except np.linalg.LinAlgError:
            w = np.full(count, np.nan)
        return w, x[0]


def robot_motion(
    flight: xr.Dataset,
    robot: Robot,
    network: Network,
    inputs: Sequence[str] | None,
    period: float | None,
) -> Motion | None:
    """Forecast of a flight by the robot's equations; None where the flight has not what it needs.

    It needs a robot in free flight, on whose body no other force (u1) is recorded, whose network
    gives the force on every coordinate that no joint moves, and steady wind where the air's
    inertia is known.

    Args:
        flight: Record with q, v and a.
        robot: The machine.
        network: Network that learns.
        inputs: Names of what it sees; None: q, then v.
        period: Wingbeat, where it is known beforehand [s].
    """
    names, terms = network.output_names, flight_terms(network)
    whole = {robot.dof_names[i] for i in robot.passive}
    if not whole or flight.attrs.get("mount", "free") != "free" or not whole <= set(names):
        return None
    given = np.abs(np.nan_to_num(air_force.recorded(flight, "u1", robot)))  # or an imported mount
    if terms.strip_forces is not None or (
        given[:, list(robot.floating_dofs)].max(initial=0.0) > _ROUNDING * given.max()
    ):
        return None
    try:
        form = air_force.SampleForm(
            robot,
            None if inputs is None else tuple(inputs),
            added_mass=added_mass_of(flight),
            sees_acceleration=terms.acceleration,
            explains_added_mass=terms.added_mass,
        )
    except PatagiumError:
        return None
    q, v, a = (air_force.recorded(flight, name, robot) for name in ("q", "v", "a"))
    time = stored(flight, "time")
    change = wind_change(flight, network)
    return RobotMotion(form, network, time, (q, v, a), period, change)

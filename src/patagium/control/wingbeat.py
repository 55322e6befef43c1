"""Wingbeat map: the simulator's Runge-Kutta steps and their exact derivatives.

A stretch of flight is cut into segments that are flown side by side, x_{k+1} = F(x_k, p), with
dF/dx and dF/dp carried through every stage by the chain rule. The state is that of
`simulation.state_layout` without works and impulse: [q passive, v passive, lag states]. The
parameters p are whatever moves the prescribed rows (those of a gait: `gait_family`), the time
step, and numbers of the robot and of the model of the air, learned weights among them, which stay
run-time inputs: other values compile nothing. Neglected: gusts that travel, mounts, load cells.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from patagium.aerodynamics import AddedMass, Aerodynamics
from patagium.arguments import check_fields
from patagium.arrays import Array, Indices, brief, real_array
from patagium.errors import ParameterError
from patagium.native import NativeFunction, load_functions, load_kernel
from patagium.native.elimination import jacobian
from patagium.native.emit import calls_kernels
from patagium.native.function import as_c
from patagium.robot import Robot
from patagium.simulation.flight_equations import flight_balance
from patagium.simulation.mounts import mount_of
from patagium.simulation.simulator import check_added_mass, check_robots
from patagium.simulation.state_layout import state_layout

_LANES = 8


@dataclass(frozen=True)
class PrescribedRows:
    """Prescribed rows of a stretch of flight, every half step, and their derivatives.

    Attributes:
        table: Position, velocity and acceleration of the actuated joints, and the wind,
            (2 steps + 1, 3 n_a + 3) [SI].
        slopes: Derivatives of the joints' part by each parameter, (2 steps + 1, p, 3 n_a).
        time_step: Step [s].
        step_slopes: Derivatives of the step by each parameter, (p,) [s over its unit].
    """

    table: Array
    slopes: Array
    time_step: float
    step_slopes: Array

    @property
    def steps(self) -> int:
        """Number of steps of the stretch."""
        return len(self.table) // 2

    def part(self, place: int, count: int) -> PrescribedRows:
        """Part of the stretch by its place, of so many that are equally long."""
        length = 2 * self.steps // count
        own = slice(length * place, length * (place + 1) + 1)
        return replace(self, table=self.table[own], slopes=self.slopes[own])


@dataclass(frozen=True)
class Segments:
    """Segments of a flight, flown: ends and derivatives.

    Attributes:
        ends: State at the end of each, (m, n) [SI].
        by_state: Derivative of the end by the beginning, A_k, (m, n, n) [SI].
        by_parameter: Derivative of the end by the parameters, B_k, (m, n, p) [SI]: first of
            those of the prescribed rows, then of the map's own.
    """

    ends: Array
    by_state: Array
    by_parameter: Array


@dataclass(frozen=True)
class _Slopes:
    """Compiled rate and Jacobian of the flight.

    Attributes:
        function: Rate, then nonzeros of its Jacobian, as one column; or rate and its derivative
            along a seed, where a Jacobian would be too long to compile.
        rows: State or rate entry of each nonzero, (e,).
        columns: Column of each nonzero: state, prescribed row, own parameters, (e,).
        constants: Parameters of robot and air.
    """

    function: NativeFunction
    rows: NDArray[np.int32]
    columns: NDArray[np.int32]
    constants: tuple[Array, Array]

    @property
    def seeded(self) -> bool:
        """Whether derivatives are taken direction by direction."""
        return len(self.rows) == 0


@dataclass
class FlightMap:
    """Map of a free flight over segments of time, with exact derivatives by state and parameters.

    Args:
        robot: The machine, with a floating body or passive joints.
        aero: Model of the air around it; its air may have a gust that is the same everywhere.
        added_mass: Inertia of the air that moves with the wings, or None.
        parameters: Names of parameters of the robot or of `aero` that are parameters of the map
            too, in the order of `Segments.by_parameter`.
        work: Whether the work of the joints is the last entry of the state [J].

    Raises:
        ParameterError: If nothing of the robot is free, the air is another robot's, a gust
            travels, or there is no such parameter.
    """

    robot: Robot
    aero: Aerodynamics
    added_mass: AddedMass | None = None
    parameters: tuple[str, ...] = ()
    work: bool = False
    names: tuple[str, ...] = field(init=False)
    size: int = field(init=False)
    moving: int = field(init=False)
    __repr__ = brief

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.robot.passive:
            expected = "a robot with a floating body or passive joints"
            raise ParameterError("robot", expected, self.robot.name)
        check_robots(self.robot, self.aero)
        check_added_mass(self.robot, self.aero, self.added_mass)
        self.aero.air.require_uniform("aero")
        layout = state_layout(self.robot, self.aero, mount_of(self.robot, None), self.added_mass)
        self.moving, self.size = layout.moving, layout.moving + layout.lags + self.work
        self.names = layout.state_names[: self.size]
        self._row_size = layout.row_size
        self._quaternions = np.array([places[0] for places in layout.quaternions], np.int64)
        self._slopes = _compiled_slopes(self)
        self._library = None if self._slopes.seeded else load_kernel("wingbeat")

    @np.errstate(all="ignore")  # a flight that breaks is not finite, not a warning
    def fly(self, states: ArrayLike, rows: PrescribedRows) -> Segments:
        """Segments of equal length from given states, with the derivatives of their ends.

        Segment k takes the k-th part of the rows.

        Args:
            states: State at the beginning of each, (m, n) [SI].
            rows: Prescribed rows of all of them, whose number of steps m divides.

        Returns:
            Ends and derivatives; not finite where the flight breaks.

        Raises:
            ShapeError: If the states are not (m, n), or the rows have another width.
            ParameterError: If m does not divide the steps.
        """
        states, joints = real_array("states", states, ("N", self.size)), self._row_size - 3
        real_array("rows", rows.table, ("N", self._row_size))
        count = len(states)
        if count == 0 or rows.steps % count:
            raise ParameterError("segments", f"a number that divides {rows.steps} steps", count)
        own, given = len(self.parameters), rows.slopes.shape[1]
        slopes = np.zeros((len(rows.table), given + own, joints + own))
        slopes[:, :given, :joints] = rows.slopes
        slopes[:, given + np.arange(own), joints + np.arange(own)] = 1.0
        steps = np.r_[rows.step_slopes, np.zeros(own)]
        task = PrescribedRows(np.ascontiguousarray(rows.table), slopes, rows.time_step, steps)
        if self._library is None:
            return _flown(self._slopes, np.array(states, float), task, self._quaternions)
        return _flown_compiled(self._library, self._slopes, states, task, self._quaternions)

    @np.errstate(all="ignore")
    def slopes(self, states: Array, rows: Array) -> tuple[Array, Array]:
        """Rates of states and their Jacobians.

        Args:
            states: (m, n) [SI].
            rows: Prescribed row of each, (m, 3 n_a + 3) [SI].

        Returns:
            Rates, (m, n) [SI over s], and derivatives by the state, (m, n, n) [SI over s].
        """
        ways = np.tile(np.eye(self.size), (len(states), 1, 1))
        given = np.zeros((len(states), 0, self._row_size - 3 + len(self.parameters)))
        return _rate_and_slope(self._slopes, np.asarray(states, float), rows, ways, given)

    @np.errstate(all="ignore")
    def loads(self, states: Array, rows: PrescribedRows) -> Segments:
        """Forces or torques, then powers, of the actuated joints as segments begin, (m, 2 n_a).

        Args:
            states: State at the beginning of each, (m, n) [SI].
            rows: Prescribed rows of all segments, as `fly` takes them.

        Returns:
            The loads as `ends` [N, N m, W], and their derivatives.
        """
        at = 2 * (rows.steps // len(states)) * np.arange(len(states))
        given = rows.slopes[at]
        ways = np.tile(np.eye(self.size, self.size + given.shape[1]), (len(states), 1, 1))
        found, slope = _rate_and_slope(self._loads, states, rows.table[at], ways, given)
        return Segments(found, slope[:, :, : self.size], slope[:, :, self.size :])

    @cached_property
    def _loads(self) -> _Slopes:
        return _compiled_slopes(self, loads=True)


def _compiled_slopes(flight: FlightMap, loads: bool = False) -> _Slopes:
    """Compiled rate of the state and its Jacobian; the same code for all values of parameters.

    With `loads` those of the actuated joints in the place of the rate.
    """
    robot, aero, added_mass = flight.robot, flight.aero, flight.added_mass
    others = () if added_mass is None else added_mass.parameters
    known = (*robot.parameter_names, *aero.parameter_names)
    for name in flight.parameters:
        if name not in known:
            raise ParameterError("parameters", "parameters of the robot or of its air", name)
    places = tuple(known.index(name) for name in flight.parameters)
    kind = f" with {added_mass.structure}" if added_mass else ""
    kind += " with work" if flight.work else ""
    places, what = ((), "loads") if loads else (places, "slopes")
    functions = load_functions(
        f"{what}{kind} {aero.key} {places} {robot.structure}",
        lambda: _slope_functions(flight, places, loads),
        label=f"derivatives of a flight of {robot.name}",
        many_only=["slope"],
    )
    entries = np.zeros((2, 0), np.int32)
    if "entries" in functions:
        entries = np.ascontiguousarray(functions["entries"](0.0), np.int32).reshape(2, -1)
    constants = robot.parameters, np.r_[aero.parameters, others]
    return _Slopes(functions["slope"], entries[0], entries[1], constants)


def _slope_functions(
    flight: FlightMap, places: tuple[int, ...], loads: bool
) -> Sequence[ca.Function]:
    """CasADi functions of rate and Jacobian, and of where its nonzeros are.

    Where the air's equations call kernels, whose Jacobian is long, the function takes a seed too
    and gives rate and derivative along it. A density is that of the added mass too.
    """
    mount = mount_of(flight.robot, None)
    balance = flight_balance(flight.robot, flight.aero, mount, flight.added_mass)
    state, row, *constants = balance.inputs
    outputs, lacking = balance.effort if loads else balance.rate[: flight.size], balance.lacking
    variables = ca.vertcat(state[: flight.size], row[:-3], ca.vertcat(*constants)[list(places)])
    still = ca.substitute(lacking, balance.free, ca.DM.zeros(balance.free.shape))
    solved, count = ca.densify(balance.response(-still)), outputs.numel()
    if flight.added_mass and places and "density" in flight.parameters:
        known, air = flight.aero.parameter_names, constants[1]
        shared = [air[len(known)]], [air[known.index("density")]]
        outputs, lacking, solved = ca.substitute([outputs, lacking, solved], *shared)
    both, everything = ca.vertcat(outputs, lacking), ca.vertcat(variables, balance.free)
    inputs = [state[: flight.size], row, *constants]
    names, width = ["state", "row", "robot_parameters", "aero_parameters"], variables.numel()
    if calls_kernels(ca.Function("both", [*inputs, balance.free], [both])):
        seed = ca.SX.sym("seed", width)
        rate = ca.substitute(outputs, balance.free, solved)
        found = ca.vertcat(rate, ca.jtimes(rate, variables, seed))
        return [ca.Function("slope", [*inputs, seed], [found], [*names, "seed"], ["found"])]
    slopes = jacobian(both, everything)
    answer = -balance.response(slopes[count:, :width])
    whole = slopes[:count, :width] + slopes[:count, width:] @ answer
    found = ca.substitute(ca.vertcat(outputs, *whole.nonzeros()), balance.free, solved)
    function = ca.Function("slope", inputs, [found], names, ["found"])
    filled = whole.sparsity()
    entries, unused = ca.SX(ca.DM([*filled.row(), *filled.get_col()])), ca.SX.sym("unused")
    return [function, ca.Function("entries", [unused], [entries], ["unused"], ["entries"])]


def _flown_compiled(
    library: ctypes.CDLL, slopes: _Slopes, states: Array, rows: PrescribedRows, quaternions: Indices
) -> Segments:
    """Segments flown by `kernels/wingbeat.c`."""
    count, size = states.shape
    parameters = rows.slopes.shape[1]
    by_column = rows.slopes.transpose(0, 2, 1)
    column, parameter = np.nonzero(by_column.any(axis=0))  # most are zero
    begins = np.searchsorted(column, np.arange(by_column.shape[1] + 1))
    outer = [np.ascontiguousarray(part, np.int32) for part in (begins, parameter)]
    moved = np.ascontiguousarray(by_column[:, column, parameter])
    stride, width = -(-count // _LANES) * _LANES, size + parameters
    found = slopes.function.size_out[0][0]
    x, slope = np.zeros((size, stride)), np.zeros((size, width, stride))
    x[:, :count] = states.T
    slope[np.arange(size), np.arange(size)] = 1.0
    row_size = rows.table.shape[1]
    entries = (2 * size + found + 3 * width * size + len(column)) * stride
    work = np.zeros(entries + count * (size + row_size))
    rate, step = ctypes.c_void_p(slopes.function.batch_address), ctypes.c_double(rows.time_step)
    library.wingbeat(
        *as_c(rate, count, stride, rows.steps // count, step, rows.step_slopes, size, row_size),
        *as_c(parameters, len(column), rows.table, moved, *outer, *slopes.constants),
        *as_c(len(slopes.rows), slopes.rows, slopes.columns),
        *as_c(quaternions, len(quaternions), x, slope, work),
    )
    return _segments(x.T[:count], slope.transpose(2, 0, 1)[:count])


def _segments(ends: Array, slope: Array) -> Segments:
    size = ends.shape[1]
    parts = (ends, slope[:, :, :size], slope[:, :, size:])
    return Segments(*(np.ascontiguousarray(part) for part in parts))


def _flown(slopes: _Slopes, x: Array, rows: PrescribedRows, quaternions: Indices) -> Segments:
    """Segments flown in Python, as `kernels/wingbeat.c` does it."""
    count, size = x.shape
    steps, h = rows.steps // count, rows.time_step
    slope = np.tile(np.eye(size, size + len(rows.step_slopes)), (count, 1, 1))
    longer = np.r_[np.zeros(size), rows.step_slopes]  # of the step, by every direction
    firsts = 2 * steps * np.arange(count)
    for step in range(steps):
        _normalize(x, slope, quaternions)
        total, dtotal = np.zeros_like(x), np.zeros_like(slope)
        k, dk = total, dtotal
        for reach, ahead, weight in ((0.0, 0, 1.0), (0.5, 1, 2.0), (0.5, 1, 2.0), (1.0, 2, 1.0)):
            at = firsts + 2 * step + ahead
            turned = slope + reach * (h * dk + longer * k[:, :, None])
            k, dk = _rate_and_slope(
                slopes, x + reach * h * k, rows.table[at], turned, rows.slopes[at]
            )
            total, dtotal = total + weight * k, dtotal + weight * dk
        x = x + h / 6.0 * total
        slope = slope + h / 6.0 * dtotal + longer / 6.0 * total[:, :, None]
    _normalize(x, slope, quaternions)
    return _segments(x, slope)


def _rate_and_slope(
    slopes: _Slopes, x: Array, row: Array, turned: Array, given: Array
) -> tuple[Array, Array]:
    """Rate of states, (m, n), and its derivatives along directions, (m, n, d)."""
    (count, size), directions = x.shape, turned.shape[2]
    outside = np.zeros((count, given.shape[2], directions))
    outside[:, :, size:] = given.transpose(0, 2, 1)
    seeds = np.concatenate([turned, outside], axis=1)
    if slopes.seeded:
        along = seeds.transpose(0, 2, 1).reshape(count * directions, -1)
        repeated = [np.repeat(part, directions, axis=0) for part in (x, row)]
        found = slopes.function.batch(*repeated, *slopes.constants, along)
        found = found.reshape(count, directions, 2, -1)
        return found[:, 0, 0].copy(), found[:, :, 1].transpose(0, 2, 1).copy()
    found = slopes.function.batch(x, row, *slopes.constants)
    results = found.shape[1] - len(slopes.rows)
    matrix = np.zeros((count, results, seeds.shape[1]))
    matrix[:, slopes.rows, slopes.columns] = found[:, results:]
    return found[:, :results], matrix @ seeds


def _normalize(x: Array, slope: Array, quaternions: Indices) -> None:
    """Scale quaternions of states to length one, in place, with their derivatives."""
    for first in quaternions:
        part = slice(first, first + 4)
        norm = np.linalg.norm(x[:, part], axis=1)[:, None]
        x[:, part] /= norm
        along = np.einsum("mi,mid->md", x[:, part], slope[:, part])
        slope[:, part] -= x[:, part, None] * along[:, None]
        slope[:, part] /= norm[:, :, None]

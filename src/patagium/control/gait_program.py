"""Nonlinear program of an optimal gait: unknowns, constraints, cost, derivatives, and IPOPT.

Unknowns, all scaled: states at both ends of each segment of the beat, the work of the joints, the
parameters of the gait, and the top and bottom of whatever of a joint's motion is limited. Motions
keep their limits at samples of the beat, passive joints, torques and powers theirs where segments
begin; what goes beyond in between is taken off the limits and the program solved again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from patagium.arguments import Progress
from patagium.arrays import Array, Bools, Indices, runs
from patagium.control.gait_family import GaitFamily
from patagium.control.orbit import Frame, Orbit
from patagium.control.trimming import (
    STEEPEST,
    Conditions,
    PassiveLimits,
    parameter_sizes,
    state_sizes,
)
from patagium.control.wingbeat import FlightMap, PrescribedRows, Segments
from patagium.robot import Robot

Goal = Literal["power", "range", "speed"]

TOLERANCE = 1e-8
"""Largest residual of the conditions of Karush, Kuhn and Tucker, in scaled unknowns [1]."""
FARTHEST = np.pi / 2
"""Limit of a joint that has none, either side of its mean in the gait begun from [rad, m]."""
IN_PLANE = 1e-9
"""Distance from the plane of symmetry that is rounding's [SI]."""
_SAMPLES = 120  # of a beat, at which limits hold
_BETWEEN = 2001  # samples by which a gait is judged, as everywhere
_CLOSE = 1e-6  # inside a limit [1]
_STEP = 1e-6  # of differences of exact derivatives, in scaled unknowns
_AGAIN = 5  # solutions at most, with what samples miss taken off the limits
_ITERATIONS = 200
_OPTIONS = {
    "no_nlp_grad": True,
    "calc_lam_p": False,
    "print_time": False,
    "error_on_fail": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": _ITERATIONS,
    "ipopt.nlp_scaling_method": "none",
    "ipopt.mu_strategy": "adaptive",
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.tol": 1e-9,
    "ipopt.dual_inf_tol": 1e-9,
    "ipopt.compl_inf_tol": 1e-9,
    "ipopt.constr_viol_tol": 1e-9,
}
_WARM = {
    "ipopt.mu_init": 1e-8,
    "ipopt.warm_start_init_point": "yes",
    "ipopt.warm_start_bound_push": 1e-9,
    "ipopt.warm_start_bound_frac": 1e-9,
    "ipopt.warm_start_slack_bound_push": 1e-9,
    "ipopt.warm_start_slack_bound_frac": 1e-9,
}
_ACTIVE = 1e-5  # multiplier of a limit that holds a gait back


@dataclass(frozen=True)
class Optimum:
    """Solution of a program, or where IPOPT stopped.

    Attributes:
        nodes: State at both ends of the segments, (m + 1, n) [SI].
        values: Values of the parameters, (p,) [Hz, 1, rad or m, rad].
        work: Work of the joints in a beat [J].
        residual: Largest residual of the conditions of Karush, Kuhn and Tucker [1].
        iterations: Iterations of IPOPT.
        status: IPOPT's word for how it ended.
        held: Limits that hold the gait back, in words.
    """

    nodes: Array
    values: Array
    work: float
    residual: float
    iterations: int
    status: str
    held: tuple[str, ...]

    @property
    def solved(self) -> bool:
        """Whether it is a solution."""
        return self.residual <= TOLERANCE


@dataclass(frozen=True)
class _Swings:
    """Limited motions: a column of the prescribed rows each.

    Attributes:
        columns: Columns: positions, velocities or accelerations of joints, (l,).
        low: Least value of each, (l,) [SI].
        high: Greatest, (l,) [SI].
        least: Least half swing, (l,) [SI].
        most: Greatest, (l,) [SI].
        names: Names of the motions.
    """

    columns: Indices
    low: Array
    high: Array
    least: Array
    most: Array
    names: tuple[str, ...]

    @property
    def sizes(self) -> Array:
        """Sizes that the motions are scaled by, (l,) [SI]."""
        return np.maximum(1.0, self.high)


@dataclass(frozen=True)
class _Ranges:
    """Ranges of frequency, amplitudes, means and leads, which are linear in the parameters.

    Attributes:
        ways: Derivative of each by the parameters, (r, p).
        low: Least value of each, less that at parameters of zero, (r,) [Hz, rad or m].
        high: Greatest, (r,) [Hz, rad or m].
        names: Names.
    """

    ways: Array
    low: Array
    high: Array
    names: tuple[str, ...]


def _limited(flight: FlightMap, family: GaitFamily, rows: PrescribedRows) -> _Swings:
    """Motions that the parameters change and something limits, each of a mirrored pair once."""
    robot, n = flight.robot, len(family.base.joints)
    moved: Array = np.abs(rows.slopes).max(axis=(0, 1))
    ranges = {k: one.range for _, one, kind, k in family.commanded if kind == "amplitude"}
    rates = {"speed": robot.speed_limit, "acceleration": robot.acceleration_limit}
    found: dict[tuple[Any, ...], tuple[tuple[Any, ...], str]] = {}
    for k, (joint, i) in enumerate(zip(family.base.joints, robot.actuated, strict=True)):
        own, mean = np.array([robot.lower[i], robot.upper[i]]), family.base.mean[k]
        ends = np.where(np.isfinite(own), own, (mean - FARTHEST, mean + FARTHEST))
        limits = {joint: (k, *ends, *ranges.get(k, (0.0, np.inf)))}
        for order, (rate, end) in enumerate(rates.items(), 1):
            if end and np.isfinite(end[i]):
                limits[f"{rate} of {joint}"] = k + order * n, -end[i], end[i], 0.0, np.inf
        for name, limit in limits.items():
            column, *others = limit
            if moved[column]:
                motion, way = rows.table[:, column], rows.slopes[:, :, column]
                found.setdefault((motion.tobytes(), way.tobytes(), *others), (limit, name))
    bounds = np.array([limit for limit, _ in found.values()], float).reshape(-1, 5)
    columns, low, high, least, most = bounds.T
    names = tuple(name for _, name in found.values())
    return _Swings(columns.astype(np.int64), low, high, least, most, names)


def _linear_ranges(family: GaitFamily) -> _Ranges:
    """Ranges that actuators give frequency, means and leads (over the gait at the beginning).

    Of an amplitude it is that it is not negative, as `_limited` keeps the swing in its range. A
    frequency without an actuator stays between half and twice that of the gait.
    """
    joints = family.base.joints
    own, _, mean, lead, _ = family.swings(family.neutral)
    known = {"offset": ("mean", 1 + len(mean), mean), "phase": ("lead", 1 + 2 * len(mean), lead)}
    known["amplitude"] = "amplitude", 1, np.ones(len(mean))
    wanted = {"frequency": (0, own, (0.5 * own, 2.0 * own))}
    for name, actuator, kind, k in family.commanded:
        if kind == "frequency":
            wanted[name] = (0, own, actuator.range)
            continue
        word, first, values = known[kind]
        limits = (0.0, np.inf) if kind == "amplitude" else actuator.range
        wanted[f"{word} of {joints[k]}"] = (first + k, float(values[k]), limits)
    found: dict[tuple[float, ...], str] = {}
    for name, (place, own, (low, high)) in wanted.items():
        way = family.directions[:, place]
        shift = float(own - family.neutral @ way)
        if way.any():
            found.setdefault((*way, low - shift, high - shift), name)
    table = np.array([*found], float).reshape(-1, len(family.names) + 2)
    return _Ranges(table[:, :-2], table[:, -2], table[:, -1], tuple(found.values()))


@dataclass(frozen=True)
class _Loads:
    """Limited forces, torques and powers of joints.

    Attributes:
        columns: Their columns of `FlightMap.loads`, (l,).
        limits: Greatest size of each, (l,) [N, N m, W].
        names: Limits in words.
    """

    columns: Indices
    limits: Array
    names: tuple[str, ...]


def _loaded(robot: Robot, in_plane: bool) -> _Loads:
    """Loads that actuators limit; of a mirrored pair one, where the flight is mirrored too."""
    found: list[tuple[int, float, str]] = []
    for first, limits in ((0, robot.effort_limit), (len(robot.actuated), robot.power_limit)):
        for k, i in enumerate(robot.actuated if limits else ()):
            name, turning = robot.dof_names[i], robot.dof_units[i] == "rad"
            twin = robot.index(robot.twin(name))
            mirrored = in_plane and twin != i and robot.side(name) < 0
            if np.isinf(limits[i]) or (mirrored and limits[twin] <= limits[i]):
                continue
            what = "power" if first else "torque" if turning else "force"
            unit = "W" if first else "N m" if turning else "N"
            found.append((first + k, limits[i], f"{limits[i]:g} {unit} of {what} of {name}"))
    columns, most, names = zip(*found, strict=True) if found else ((), (), ())
    return _Loads(np.array(columns, np.int64), np.array(most, float), tuple(names))


def _phases(chosen: Bools) -> str:
    """Phases of a beat at whose samples something is so, in words."""
    spans = [(first / len(chosen), (last - 1) / len(chosen)) for first, last in runs(chosen)]
    words = [f"{a:.3g}" if a == b else f"{a:.3g} to {b:.3g}" for a, b in spans]
    return "phase " + ", ".join(words)


def lateral_states(names: Sequence[str]) -> list[int]:
    """Indices of the states that stay zero in flight in the plane of symmetry, from their names."""
    return [
        k for k, x in enumerate(names) if x.removeprefix("velocity of ") in ("y", "roll", "yaw")
    ]


def _ends(
    names: tuple[str, ...], family: GaitFamily, goal: Goal, conditions: Conditions
) -> tuple[ca.Function, ca.Function]:
    """Cost and conditions of a beat, with gradient and Jacobian; and their Lagrangian's Hessian.

    Both of the first and last state, the work and the parameters, (2 n + 1 + p,) [SI].
    """
    n, frame = len(names), Frame(names)
    first, last = ca.SX.sym("first", n), ca.SX.sym("last", n)
    work, values = ca.SX.sym("work"), ca.SX.sym("values", len(family.names))
    way, own = family.directions[:, 0], family.base.frequency
    period = 1.0 / (own + ca.dot(way, values - family.neutral))
    x, y, z, yaw = frame.neutral
    along, across = (names.index(f"velocity of {k}") for k in "xy")
    cosine, sine = ca.cos(last[yaw]), ca.sin(last[yaw])
    seen = ca.SX(last)
    seen[along] = cosine * last[along] + sine * last[across]
    seen[across] = cosine * last[across] - sine * last[along]
    half = 0.5 * conditions.turn_rate * period
    longer = half / ca.sin(half) if conditions.turn_rate else 1.0
    forward = longer * (ca.cos(half) * last[x] + ca.sin(half) * last[y])
    returned = (seen[frame.kept] - first[frame.kept]) / state_sizes(names)[frame.kept]
    wanted = conditions.turn_rate, conditions.climb, conditions.speed
    ways = zip((last[yaw], last[z], forward), wanted, strict=True)
    others = [way - rate * period for way, rate in ways if rate is not None]
    cost = {"power": work / period, "range": work / forward, "speed": -forward / period}[goal]
    given = ca.vertcat(first, last, work, values)
    ends = ca.vertcat(returned, *others)
    weights = ca.SX.sym("weights", 1 + ends.shape[0])
    slopes = ca.gradient(cost, given), ends, ca.densify(ca.jacobian(ends, given))
    bends = ca.hessian(ca.dot(weights, ca.vertcat(cost, ends)), given)[0]
    return (
        ca.Function("ends", [given], [cost, *slopes]),
        ca.Function("bends", [given, weights], [ca.densify(bends)]),
    )


class GaitProgram:
    """Nonlinear program for the best gait of a robot; z is the vector of scaled unknowns.

    Args:
        family: Gaits that the parameters reach.
        start: Orbit to begin from, with its robot and air.
        goal: "power" for the least mean power, "range" for the least energy a meter, "speed" for
            the greatest speed.
        conditions: Conditions in addition to periodicity.

    Attributes:
        begin: Scaled unknowns at the beginning.
        lateral: States that a mirrored flight leaves at zero, and are left out.
        iterations: Iterations of IPOPT so far.
        power_before: Mean power of the joints at the beginning [W].
    """

    def __init__(
        self, family: GaitFamily, start: Orbit, goal: Goal, conditions: Conditions
    ) -> None:
        flight = FlightMap(start.robot, start.aero, start.added_mass, work=True)
        self.flight, self.family, self.steps = flight, family, start.steps
        self.names, self.parts = flight.names[:-1], len(start.states)
        nodes = np.vstack([start.states, start.segments.ends[-1]])
        self._sizes = state_sizes(self.names)
        self._cost, self._bends = _ends(self.names, family, goal, conditions)
        rows = self._prescribed(family.neutral)
        self._swings = _limited(flight, family, rows)
        self._ranges = _linear_ranges(family)
        samples = np.arange(_SAMPLES) * 2 * self.steps // _SAMPLES
        self._sampled = np.ix_(samples, self._swings.columns)
        motion = rows.table[self._sampled]
        self._peaks = motion.argmax(axis=0), motion.argmin(axis=0)
        self._beyond = np.full((2, len(self._swings.columns)), _CLOSE)
        self._passive = PassiveLimits(flight.robot, self.names)
        self._strain = np.full((2, len(self._passive.dofs)), _CLOSE)
        self._loads = _Loads(np.zeros(0, np.int64), np.zeros(0), ())
        flown = self._fly(nodes, rows)
        work = float(flown.ends[:, -1].sum())
        self.power_before = work * family.base.frequency
        parts = (nodes.ravel(), [work], family.neutral, motion.max(axis=0), motion.min(axis=0))
        swung = np.tile(self._swings.sizes, 2)
        states = np.tile(self._sizes, self.parts + 1)
        self.scale = np.r_[states, abs(work), parameter_sizes(family), swung]
        at = np.cumsum([0, *map(len, parts)])
        self._nodes, self._work, self._values, self._top, self._bottom = map(slice, at, at[1:])
        n = len(self.names)
        self._outer = np.r_[np.arange(n), np.arange(at[1] - n, at[3])]
        self.begin = np.concatenate(parts) / self.scale
        self.iterations = 0
        self._progress: Progress | None = None
        self._known: tuple[bytes, Array, PrescribedRows, Segments] | None = None
        lateral = lateral_states(self.names)
        apart = np.abs(nodes[:, lateral]).max()
        moved = np.abs(flown.by_parameter[:, lateral]).max()
        turns = conditions.turn_rate or max(apart, moved) > IN_PLANE
        self.lateral = [] if turns else lateral
        self._loads = _loaded(flight.robot, not turns)
        self._over = np.full(len(self._loads.names), _CLOSE)
        self._rows, self._row_scale = self._constraint_rows()
        self._weight = 1.0
        self._weight /= max(abs(self.cost(self.begin)), 1e-9)

    def _constraint_rows(self) -> tuple[dict[str, slice], Array]:
        """Places of the kinds of constraints, and their scales."""
        swung = self._swings.sizes
        scales = {
            "defects": np.tile(self._sizes, self.parts),
            "work": self.scale[self._work],
            "ends": np.ones(self._cost.size_out(2)[0]),
            "under": np.tile(swung, _SAMPLES),
            "over": np.tile(swung, _SAMPLES),
            "swings": swung,
            "least": swung,
            "ranges": np.ones(len(self._ranges.ways)),
            "loads": np.ones(self.parts * len(self._loads.names)),
        }
        at = np.cumsum([0, *map(len, scales.values())])
        places = dict(zip(scales, map(slice, at, at[1:]), strict=True))
        return places, np.concatenate([*scales.values()])

    def _flown(self, z: Array) -> tuple[Array, PrescribedRows, Segments]:
        """Nodes, rows and flight of all segments; those of the last unknowns are known."""
        key = z.tobytes()
        if self._known is None or self._known[0] != key:
            w = z * self.scale
            rows = self._prescribed(w[self._values])
            nodes = w[self._nodes].reshape(self.parts + 1, -1)
            self._known = key, nodes, rows, self._fly(nodes, rows)
        return self._known[1:]

    def _prescribed(self, values: Array) -> PrescribedRows:
        return self.family.rows(values, self.steps, self.flight.aero.air)

    def _fly(self, nodes: Array, rows: PrescribedRows) -> Segments:
        """Final states and work of segments, loads at their start over limits, (m, n+1+l)."""
        begin, limits = np.pad(nodes[:-1], ((0, 0), (0, 1))), self._loads.limits[:, None]
        flown = self.flight.fly(begin, rows)
        if not len(limits):
            return flown
        loads, of = self.flight.loads(begin, rows), self._loads.columns
        ends = np.hstack([flown.ends, loads.ends[:, of] / limits[:, 0]])
        by_state = np.hstack([flown.by_state, loads.by_state[:, of] / limits])
        return Segments(
            ends, by_state, np.hstack([flown.by_parameter, loads.by_parameter[:, of] / limits])
        )

    def cost(self, z: Array) -> float:
        """Cost over that at the beginning."""
        return self._weight * float(self._cost((z * self.scale)[self._outer])[0])

    def gradient(self, z: Array) -> Array:
        """Gradient of the cost."""
        found, w = np.zeros(len(z)), z * self.scale
        found[self._outer] = np.array(self._cost(w[self._outer])[1]).ravel()
        return np.asarray(self._weight * found * self.scale)

    def constraints(self, z: Array) -> Array:
        """Defects, work, conditions, samples below top and above bottom, swings, ranges, loads."""
        nodes, rows, flown = self._flown(z)
        n, w, motion = len(self.names), z * self.scale, rows.table[self._sampled]
        top, bottom = w[self._top], w[self._bottom]
        high, low = self._peaks
        each = np.arange(motion.shape[1])
        parts = [
            flown.ends[:, :n] - nodes[1:],
            flown.ends[:, n].sum() - w[self._work],
            np.array(self._cost(w[self._outer])[2]),
            top - motion,
            motion - bottom,
            top - bottom,
            motion[high, each] - motion[low, each],
            self._ranges.ways @ w[self._values],
            flown.ends[:, n + 1 :],
        ]
        return np.concatenate([np.ravel(part) for part in parts]) / self._row_scale

    def slopes(self, z: Array | None) -> Array:
        """Jacobian of the constraints; ones where it may not be zero without unknowns."""
        n, m, p = len(self.names), self.parts, len(self.family.names)
        count, size = len(self._swings.columns), n + 1 + len(self._loads.names)
        if z is None:
            a, b = np.ones((m, size, n + 1)), np.ones((m, size, p))
            outer, motion = 1.0, np.ones((_SAMPLES, count, p))
        else:
            _, rows, flown = self._flown(z)
            a, b = flown.by_state, flown.by_parameter
            outer = self._cost((z * self.scale)[self._outer])[3]
            motion = rows.slopes.transpose(0, 2, 1)[self._sampled]
        at, values = self._rows, self._values
        found = np.zeros((len(self._row_scale), len(self.scale)))
        loads = found[at["loads"]].reshape(m, -1, len(self.scale))
        for k in range(m):
            own = slice(k * n, (k + 1) * n)
            after = slice((k + 1) * n, (k + 2) * n)
            found[own, own] = a[k, :n, :n]
            found[own, after] = -np.eye(n)
            loads[k, :, own] = a[k, n + 1 :, :n]
        found[at["defects"], values] = b[:, :n].reshape(m * n, p)
        loads[:, :, values] = b[:, n + 1 :]
        found[at["work"], : m * n] = a[:, n, :n].ravel()
        found[at["work"], values] = b[:, n].sum(axis=0)
        found[at["work"], self._work] = -1.0
        found[at["ends"], self._outer] = outer
        each, one = np.arange(count), np.eye(count)
        for kind, end, side in (("under", self._top, 1.0), ("over", self._bottom, -1.0)):
            found[at[kind], values] = -side * motion.reshape(-1, p)
            found[at[kind], end] = np.tile(side * one, (_SAMPLES, 1))
            found[at["swings"], end] = side * one
        found[at["least"], values] = motion[self._peaks[0], each]
        if z is not None:
            found[at["least"], values] -= motion[self._peaks[1], each]
        found[at["ranges"], values] = self._ranges.ways
        return np.asarray(found * self.scale / self._row_scale[:, None])

    def bends(self, z: Array, weight: float, multipliers: Array) -> Array:
        """Hessian of the Lagrangian, by differences of exact derivatives of each segment.

        Weight and multipliers are those of the cost and of the constraints in the Lagrangian.
        """
        n, m, w = len(self.names), self.parts, z * self.scale
        own = {kind: (multipliers / self._row_scale)[at] for kind, at in self._rows.items()}
        parts = own["defects"], np.repeat(own["work"], m), own["loads"]
        of_ends, count = np.hstack([x.reshape(m, -1) for x in parts]), len(self._swings.columns)
        of_motion = (own["over"] - own["under"]).reshape(_SAMPLES, count)
        for peak, side in zip(self._peaks, (1.0, -1.0), strict=True):
            of_motion[peak, np.arange(count)] += side * own["least"]

        def gradient(rows: PrescribedRows, flown: Segments) -> tuple[Array, Array]:
            """Gradient of the weighted ends by states, (m, n), and parameters, (m, p)."""
            motion = rows.slopes.transpose(0, 2, 1)[self._sampled]
            found = np.einsum("ki,kij->kj", of_ends, flown.by_parameter)
            found[0] += np.einsum("sl,slp->p", of_motion, motion)
            return np.einsum("ki,kij->kj", of_ends, flown.by_state)[:, :n], found

        found, values = np.zeros((len(z), len(z))), self._values
        outer = np.r_[weight * self._weight, own["ends"]]
        found[np.ix_(self._outer, self._outer)] = self._bends(w[self._outer], outer)
        nodes, rows, flown = self._flown(z)
        here = gradient(rows, flown)
        still = {*Frame(self.names).neutral[:3], *self.lateral}
        for i in set(range(n)) - still:
            step = _STEP * self._sizes[i]
            moved = self._fly(nodes + step * np.eye(n)[i], rows)
            by_state, by_value = gradient(rows, moved)
            for k, change in enumerate((by_state - here[0]) / step):
                found[k * n : (k + 1) * n, k * n + i] += change
            mixed = (by_value - here[1]) / step
            found[i : m * n : n, values] += mixed
            found[values, i : m * n : n] += mixed.T
        for i, size in enumerate(parameter_sizes(self.family)):
            given = w[values].copy()
            given[i] += _STEP * size
            rows = self._prescribed(given)
            change = gradient(rows, self._fly(nodes, rows))[1] - here[1]
            found[values, values.start + i] += change.sum(axis=0) / (_STEP * size)
        return np.asarray(0.5 * (found + found.T) * np.outer(self.scale, self.scale))

    def solve(self, progress: Progress | None = None) -> Optimum:
        """Solution of the program, its limits kept between the samples too; progress of IPOPT."""
        self._progress = progress
        begin: dict[str, Any] = {"x0": self.begin}
        for _ in range(_AGAIN):
            begin, found = self._solved(begin)
            if not found.solved:
                break
            excess = self._beyond_limits(found.values), self._overloads(found), self._strains(found)
            if not any((over > 0.0).any() for over in excess):
                break
            for margin, over in zip((self._beyond, self._over, self._strain), excess, strict=True):
                margin[over > 0.0] += over[over > 0.0] + _CLOSE
        return found

    def _overloads(self, found: Optimum) -> Array:
        """Excess of loads at any time step over their limits, (l,) [1]."""
        if not self._loads.names:
            return np.zeros(0)
        rows, states = self._prescribed(found.values), np.zeros((self.steps, self.flight.size))
        states[0, :-1] = found.nodes[0]
        for k in range(self.steps - 1):
            step = rows.part(k, self.steps)
            states[k + 1] = self.flight.fly(states[k : k + 1], step).ends[0]
        loads = self.flight.loads(states, rows).ends[:, self._loads.columns]
        return np.asarray(np.abs(loads).max(axis=0) / self._loads.limits - 1.0)

    def _strains(self, found: Optimum) -> Array:
        """Excess of passive joints between nodes beyond their limits, low and high, (2, l) [SI]."""
        ends = self._passive.ends(found.nodes, 1.0 / self.family.gait(found.values).frequency)
        return np.asarray(np.array([[-1.0], [1.0]]) * (ends - self._passive.limits))

    def _beyond_limits(self, values: Array) -> Array:
        """Excess of motions between samples beyond their limits, above and below, (2, l) [SI]."""
        swings, gait = self._swings, self.family.gait(values)
        motion = gait.motion(np.linspace(0.0, gait.period or 0.0, _BETWEEN))
        limited = np.hstack([*motion])[:, swings.columns]
        top, bottom = limited.max(axis=0), limited.min(axis=0)
        over = np.array([top - swings.high, swings.low - bottom])
        return np.asarray(np.maximum(over, (top - bottom - 2.0 * swings.most) / 2.0))

    def _bounds(self) -> tuple[Array, Array, Array, Array]:
        """Least and greatest of unknowns and of constraints, scaled."""
        m, swings, frame, at = self.parts, self._swings, Frame(self.names), self._rows
        high = np.full(len(self.scale), np.inf)
        low = -high
        most = np.zeros(len(self._row_scale))
        least = most.copy()
        pitch, yaw = self.names.index("pitch"), len(frame.kept)
        free = [k for k, place in enumerate(frame.kept) if place in self.lateral]
        passive = zip(self._passive.limits, self._strain, strict=True)
        sides = zip((-1.0, 1.0), passive, (low, high), (least, most), strict=True)
        for side, (limits, strain), unknowns, rows in sides:
            nodes = unknowns[self._nodes].reshape(m + 1, -1)
            nodes[:, pitch] = side * STEEPEST
            nodes[:, self._passive.places] = limits - side * strain
            nodes[0, frame.neutral] = 0.0
            nodes[:, self.lateral] = 0.0  # no unknowns, no conditions
            rows[at["defects"]].reshape(m, -1)[:, self.lateral] = side * np.inf
            rows[at["ends"]][[*free, yaw] if self.lateral else []] = side * np.inf
            rows[at["loads"]] = side * np.tile(1.0 - self._over, m)
        high[self._top] = swings.high - self._beyond[0]
        low[self._bottom] = swings.low + self._beyond[1]
        most[at["under"]] = most[at["over"]] = most[at["least"]] = np.inf
        most[at["swings"]] = 2.0 * swings.most - self._beyond.sum(axis=0)
        least[at["least"]] = np.where(swings.least > 0.0, 2.0 * swings.least, -np.inf)
        least[at["ranges"]], most[at["ranges"]] = self._ranges.low, self._ranges.high
        scale, own = self.scale, self._row_scale
        return low / scale, high / scale, least / own, most / own

    def _solver(self, warm: bool) -> tuple[ca.Function, list[_Callback]]:
        """IPOPT for this program, and functions that it calls and that must outlive it."""
        n, size = len(self.names), len(self.scale)
        values, bent = np.arange(size)[self._values], np.zeros((size, size))
        for places in (self._outer, *np.arange(self.parts * n).reshape(-1, n)):
            every = np.r_[places, values]
            bent[np.ix_(every, every)] = 1.0
        filled = self.slopes(None), np.triu(bent)  # where they may not be zero
        slopes, bends = (ca.sparsify(ca.DM(part)).sparsity() for part in filled)
        of_slopes, of_bends = slopes.get_triplet(), bends.get_triplet()
        own = ca.Sparsity.dense(size)
        rows = ca.Sparsity.dense(len(self._row_scale))
        none, one = ca.Sparsity.dense(0, 1), ca.Sparsity.dense(1)
        done = self.iterations

        def both(z: Array, _: Array | None = None) -> list[Any]:
            return [self.cost(z), self.constraints(z)]

        def gradient(z: Array, _: Array) -> list[Any]:
            return [self.cost(z), self.gradient(z)]

        def jacobian(z: Array, _: Array) -> list[Any]:
            return [self.constraints(z), ca.DM(slopes, self.slopes(z)[of_slopes])]

        def hessian(z: Array, _: Array, weight: Array, multipliers: Array) -> list[Any]:
            nonlocal done
            done += 1  # one an iteration
            if self._progress is not None:
                self._progress(min(done, _ITERATIONS), _ITERATIONS)
            return [ca.DM(bends, self.bends(z, float(weight[0]), multipliers)[of_bends])]

        cost = _Callback("values", both, [own], [one, rows])
        given = {
            "grad_f": _Callback("gradient", gradient, [own, none], [one, own]),
            "jac_g": _Callback("slopes", jacobian, [own, none], [rows, slopes]),
            "hess_lag": _Callback("bends", hessian, [own, none, one, rows], [bends]),
        }
        x, p = ca.MX.sym("x", own), ca.MX.sym("p", none)
        program = ca.Function("program", [x, p], [*cost(x)], ["x", "p"], ["f", "g"])
        options = _OPTIONS | (_WARM if warm else {})
        solver = ca.nlpsol("gait", "ipopt", program, given | options)
        return solver, [cost, *given.values()]

    def _solved(self, begin: dict[str, Any]) -> tuple[dict[str, Any], Optimum]:
        """Solution by IPOPT, and where to begin from to go on."""
        solver, functions = self._solver(warm="lam_g0" in begin)
        low, high, least, most = self._bounds()
        found = solver(**begin, lbx=low, ubx=high, lbg=least, ubg=most)
        for one in functions:
            if one.stopped is not None:
                raise one.stopped
        z, on, of = (np.array(found[name]).ravel() for name in ("x", "lam_g", "lam_x"))
        stats = solver.stats()
        self.iterations += stats["iter_count"]
        w = z * self.scale
        return {"x0": z, "lam_g0": on, "lam_x0": of}, Optimum(
            w[self._nodes].reshape(self.parts + 1, -1),
            w[self._values],
            float(w[self._work][0]),
            self._residual(z, on, of),
            self.iterations,
            stats["return_status"],
            self._held(of, on),
        )

    @property
    def overloads(self) -> tuple[str, ...]:
        """Loads of the beginning that are beyond their limits, in words."""
        loads = self.constraints(self.begin)[self._rows["loads"]].reshape(self.parts, -1)
        return tuple(
            f"{own.max():.3g} times the limit of {name} at phase {own.argmax() / self.parts:.3g}"
            for name, own in zip(self._loads.names, np.abs(loads.T), strict=True)
            if own.max() > 1.0
        )

    def _residual(self, z: Array, on: Array, of: Array) -> float:
        """Largest residual of the conditions of Karush, Kuhn and Tucker, scaled unknowns [1].

        Of the stationarity, of the constraints, and of multipliers times what is left of a limit.
        """
        low, high, least, most = self._bounds()
        still = self.gradient(z) + self.slopes(z).T @ on + of
        sizes = [np.abs(still[low < high]).max()]
        both = (z, of, low, high), (self.constraints(z), on, least, most)
        for value, multiplier, below, above in both:
            sizes.append(max(np.max(below - value), np.max(value - above)))
            for end, sign in ((below, -1.0), (above, 1.0)):
                limit = np.isfinite(end) & (below < above)
                left = np.abs(value[limit] - end[limit])
                sizes.append(np.max(sign * multiplier[limit] * left, initial=0.0))
        return float(max(sizes))

    def _held(self, of: Array, on: Array) -> tuple[str, ...]:
        """Limits that hold the gait back, in words."""
        swings, at, found = self._swings, self._rows, list[str]()
        limits = {
            "{} at its upper limit": of[self._top],
            "{} at its lower limit": of[self._bottom],
            "amplitude of {} at its greatest": on[at["swings"]],
            "amplitude of {} at its least": on[at["least"]],
        }
        for k, name in enumerate(swings.names):
            found += [words.format(name) for words, own in limits.items() if abs(own[k]) > _ACTIVE]
        of_nodes = of[self._nodes].reshape(self.parts + 1, -1)
        for i, own in zip(self._passive.dofs, of_nodes.T[self._passive.places], strict=True):
            sides = {"upper": own.max(), "lower": -own.min()}
            name = self.flight.robot.dof_names[i]
            found += [f"{name} at its {word} limit" for word in sides if sides[word] > _ACTIVE]
        for multiplier, name in zip(on[at["ranges"]], self._ranges.names, strict=True):
            if abs(multiplier) > _ACTIVE:
                found.append(f"{name} at its {'greatest' if multiplier > 0 else 'least'}")
        active = np.abs(on[at["loads"]].reshape(self.parts, -1)) > _ACTIVE
        for chosen, name in zip(active.T, self._loads.names, strict=True):
            if chosen.any():
                found.append(f"limit of {name} at {_phases(chosen)}")
        return tuple(found)


class _Callback(ca.Callback):  # type: ignore[misc]
    """CasADi function of arrays that calls a function in Python."""

    def __init__(
        self,
        name: str,
        function: Callable[..., list[Any]],
        given: list[ca.Sparsity],
        found: list[ca.Sparsity],
    ) -> None:
        super().__init__()
        self.stopped: KeyboardInterrupt | None = None
        self._function, self._given, self._found = function, given, found
        self.construct(name, {})

    def get_n_in(self) -> int:
        """Number of arguments."""
        return len(self._given)

    def get_n_out(self) -> int:
        """Number of results."""
        return len(self._found)

    def get_sparsity_in(self, place: int) -> ca.Sparsity:
        """Shape of an argument."""
        return self._given[place]

    def get_sparsity_out(self, place: int) -> ca.Sparsity:
        """Shape of a result."""
        return self._found[place]

    def eval(self, arguments: list[ca.DM]) -> list[Any]:
        """Results; none from a Ctrl-C on, which CasADi discards."""
        if self.stopped is not None:
            raise self.stopped
        try:
            return self._function(*(np.array(part).ravel() for part in arguments))
        except KeyboardInterrupt as pressed:
            self.stopped = pressed
            raise

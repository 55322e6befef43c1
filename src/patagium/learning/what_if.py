"""Mistakes in a log that the force of the air reveals: signs, zeros, clocks and wind.

The force of the air is nearly linear in a few dimensionless weights of known size, whatever the air
(`LinearStripNetwork`). For each mistake that laboratories make, the log is turned back as if it had
been made, the force of the air is computed anew, and the weights are fitted to it with their prior.
A log of which the air explains a changed form several times better than the log itself has that
mistake. Neglected: two mistakes at once that are no group of joints, and dampers that turn with
their joint.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve

from patagium.arrays import Array, Bools, Indices, usual_step
from patagium.learning.models.linear_strip import ATTACHED_STDS, STDS, LinearStripNetwork
from patagium.robot import Robot
from patagium.sensing.force.air_force import SampleForm

_BETTER = 5.0
"""Error as stated over that of a changed log from which the log is taken for mistaken [1]."""
_ALIKE = 1.5  # errors of changes over the least, up to which each of them may be the mistake
_MOVES = 0.1  # of the largest joint rate, below which a robot rests
_LEAST = 3e-3  # of the variance: errors below it, as of a small rudder, are not worth a question
_MISFIT = 0.1  # of the standard deviation of an output: what the air may be off by
_SLIGHT = 0.1  # of what the largest force of the strips makes of an output: less says little
_NUMBERS, _SAMPLES = 1000, (60, 300)
"""Forces that are looked at, and the least and largest number of samples that they are of."""
_ALONE = 2**18
"""Multiplications up to which BLAS works alone: it would wait for cores that are busy."""
_LONGEST = 0.1
"""Largest delay that is looked for, as a share of a wingbeat [1]."""
_OFFSET = 0.35  # rad, the largest offset of a joint that is looked for
_WIND = 3.0  # m/s, likewise
_PROMISING, _STEPS = 5, (0.1, 0.03, 0.01)  # numbers to find well; steps over the reach, after ...
_COARSE = np.linspace(-0.9, 0.9, 7).tolist()  # ... the best of these


class _Change(NamedTuple):
    """A log as it would be without a mistake.

    Args:
        words: What would be other.
        motion: Sign of each coordinate, (n,) [1].
        forces: Sign of each force that is known, (n,) [1].
        order: Coordinate whose motion takes each place, (n,) [1]; all keep theirs by default.
        known: Coordinate whose known force takes each place, (n,) [1]; likewise.
    """

    words: str
    motion: Array | float = 1.0
    forces: Array | float = 1.0
    order: Indices | slice = slice(None)
    known: Indices | slice = slice(None)


class _Number(NamedTuple):
    """A number by which a log may be off.

    Args:
        error: Error of the log with so much more of it.
        reach: Largest size that is looked for [unit of the number].
        scale: Unit of the number over that of the words.
        words: What would be other.
        more: Words for less and for more of it.
    """

    error: Callable[[float], float]
    reach: float
    scale: float
    words: str
    more: tuple[str, str] = ("less", "more")

    def nearer(self, value: float, step: float) -> float:
        """Value nearer to that of the least error, by a parabola through three."""
        below, here, above = (self.error(value + k * step) for k in (-1, 0, 1))
        bend = below - 2.0 * here + above
        moved = 0.5 * (below - above) / bend if bend > 0 else float(np.sign(below - above))
        return float(np.clip(value + step * np.clip(moved, -2.0, 2.0), -self.reach, self.reach))


class _Log:
    """Motion, and known forces, of a robot at some samples of a log.

    Args:
        network: What explains their air, without memory.
        log: Times (N,) [s]; x = [q, v, a], (N, 3 n); y, its outputs, and their std, (N, n_y).
        reach: Largest delay that will be asked for [s].
        attached: Whether flow stays attached, whose edges pull along the span.
    """

    def __init__(
        self, network: LinearStripNetwork, log: Sequence[Array], reach: float, attached: bool
    ) -> None:
        robot = self.robot = network.robot
        self.time, x, y, std = log
        self.form = SampleForm(robot)
        self.network, self.whole = network, np.array(np.split(x, 3, axis=1))
        self.prior = network.prior((ATTACHED_STDS[0], STDS[1]) if attached else STDS)
        self.joints = [k for k in range(robot.dof) if k not in robot.floating_dofs]
        measured = np.array([robot.index(name) for name in network.output_names])
        force = np.full((len(y), robot.dof), np.nan)
        force[:, measured] = y
        counted = np.isfinite(y).sum(axis=0)
        self.heard = np.flatnonzero((network.per_newton > 0) & (counted > 1))
        self.outputs = measured[self.heard]
        inside = (self.time > self.time[0] + reach) & (self.time < self.time[-1] - reach)
        self.rows = self._spread(inside & np.isfinite(force[:, self.outputs].sum(axis=1)))
        self.motion = self.whole[:, self.rows]
        self.needs = self._needed(self.whole) - force
        self.known = self.needs[self.rows]
        self.stated = force[self.rows][:, self.outputs]
        self.std = np.nan_to_num(std[self.rows][:, self.heard])

    def _spread(self, known: Bools) -> Indices:
        """Samples whose outputs are known and in which joints move, spread over the log."""
        rates = np.abs(self.whole[1][:, self.joints]).max(axis=1, initial=0.0)
        rows = np.flatnonzero(known & (rates > _MOVES * rates.max(initial=0.0)))
        count = int(np.clip(_NUMBERS / max(1, len(self.outputs)), *_SAMPLES))
        return rows[:: max(1, len(rows) // count)]

    def _needed(self, motion: Array) -> Array:
        """Force that a motion, (3, N, n), needs besides that of the robot's dampers, (N, n)."""
        form, (q, v, a) = self.form, motion
        _, y = form.function.batch(q, v, a, np.zeros_like(v), form.parameters)
        return np.array(y).reshape(q.shape)

    def changed(self, change: _Change) -> float:
        """Error of the log as it would be; inf where a force from elsewhere would be heard."""
        own = np.arange(self.robot.dof)
        if set(own[change.known][self.outputs]) != set(self.outputs):
            return np.inf
        motion = self.motion[:, :, change.order] * change.motion
        return self._error(motion, self.known[:, change.known] * change.forces)

    def later(self, forces: bool, delay: float) -> float:
        """Error of the log with its joints, or their forces too, as they are a delay [s] later."""
        motion, known, times = self.motion.copy(), self.known.copy(), self.time[self.rows] + delay
        for part, k in product(range(len(motion)), self.joints):
            motion[part, :, k] = np.interp(times, self.time, self.whole[part, :, k])
        for k in self.joints if forces else ():
            there = np.isfinite(self.needs[:, k])
            if there.any():
                known[:, k] = np.interp(times, self.time[there], self.needs[there, k])
        return self._error(motion, known)

    def moved(self, part: int, places: Sequence[int], by: float) -> float:
        """Error of the model on the log, coordinates (0) or velocities (1) shifted [rad or m/s]."""
        motion = self.motion.copy()
        motion[part][:, places] += by
        return self._error(motion, self.known)

    def _error(self, motion: Array, known: Array) -> float:
        """Error of the best weights, with their distance from the prior, over the variance [1]."""
        network, lever = self.network, self.network.per_newton[self.heard]
        y = (self._needed(motion) - known)[:, self.outputs]
        size = y.std(axis=0)
        largest, stated = (size / lever).max(), (self.stated.std(axis=0) / lever).max()
        if largest > stated:  # noise counts as much as before
            largest, size = stated, size * stated / largest
        size = np.maximum(size, _SLIGHT * largest * lever)
        slopes = network.slopes(network.encode(np.hstack([*motion])))[:, self.heard]
        scale, prior = np.hypot(_MISFIT * size, self.std), self.prior
        matrix = (slopes / scale[:, :, None]).reshape(-1, len(prior))
        missed = (y / scale).ravel() - matrix @ network.initial(0)
        some = np.array_split(matrix, 1 + matrix.size * len(prior) // _ALONE)
        square = sum(one.T.copy() @ one for one in some) * np.outer(prior, prior)
        weights = solve(square + np.eye(len(prior)), prior * (missed @ matrix), assume_a="pos")
        apart = missed - matrix @ (prior * weights)
        return float(_MISFIT**2 * (np.sum(apart**2) + weights @ weights) / missed.size)


def what_if(
    network: LinearStripNetwork,
    log: tuple[Array, Array, Array],
    std: Array | None = None,
    period: float | None = None,
) -> list[str]:
    """Warning of what a log would be explained by several times better, if anything; or nothing.

    Args:
        network: Strips of the robot in the air of the log, with the outputs that are measured.
        log: Times (N,) [s]; x and y of the network at each, as `samples` gives them.
        std: Standard deviation of y, (N, n_y) [N, N m]; None: without noise.
        period: Wingbeat [s]; None: the strongest period of the joint rates.
    """
    robot, (time, x, y) = network.robot, log
    if robot.coordinate_count > robot.dof:  # quaternions have no signs of angles
        return []
    if attached := network.attached:  # has a memory, so that samples may not be taken anywhere
        network = LinearStripNetwork(robot, network.air, network.measured)
    if period is None:
        v = np.split(x, 3, axis=1)[1]  # of x = [q, v, a]
        power = np.abs(np.fft.rfft(v - v.mean(axis=0), axis=0)).sum(axis=1)[1:]
        period = 1.0 / float(np.fft.rfftfreq(len(time), usual_step(time))[1:][np.argmax(power)])
    reach = _LONGEST * period
    record = _Log(network, (time, x, y, np.zeros_like(y) if std is None else std), reach, attached)
    if len(record.rows) < _SAMPLES[0] or not len(record.outputs):
        return []
    stated = record.changed(_Change(""))
    if not stated > _LEAST:
        return []
    found = {record.changed(one): one.words for one in reversed([*_changes(robot)])}
    found |= _best_numbers([*_numbers(record, reach)])
    least = min(found)
    if not stated > _BETTER * least:
        return []
    words = "; or ".join(found[size] for size in sorted(found) if size <= _ALIKE * least)
    return [
        f"Warning: the air would explain this log {stated / least:.2g} times better if {words}. "
        "Check signs, axes, columns, zeros, clocks, wind and masses "
        "(mapping: `negated`, `offset`, `air`)."
    ]


def _numbers(record: _Log, reach: float) -> Iterator[_Number]:
    """Delay of the joints up to a reach [s], zeros of joints and pairs of them, and wind."""
    robot = record.robot
    stamped, ways = "were stamped {:.2g} ms {}", ("later", "earlier")
    yield _Number(partial(record.later, False), reach, 1e3, f"joints {stamped}", ways)
    if np.nan_to_num(record.known[:, record.joints]).any():
        words = f"joints and their forces {stamped}"
        yield _Number(partial(record.later, True), reach, 1e3, words, ways)
    turning = [robot.dof_names[k] for k in record.joints if robot.dof_units[k] == "rad"]
    for names in (*_pairs(robot, turning), *([name] for name in turning)):
        error = partial(record.moved, 0, [robot.index(name) for name in names])
        words = f"{' and '.join(names)} were {{:.2g}} deg {{}}"
        yield _Number(error, _OFFSET, 180.0 / np.pi, words)
    for name, stated in zip("xyz", record.network.air.wind, strict=True):
        if name in robot.dof_names and robot.index(name) in robot.floating_dofs:
            words = f"the wind along {name} were {{:.2g}} m/s {{}}"
            reach = max(_WIND, 2.2 * abs(stated))  # twice what is stated: the other sign
            error = partial(record.moved, 1, [robot.index(name)])  # less wind, as no inertia feels
            yield _Number(error, reach, 1.0, words, ("more", "less"))


def _best_numbers(numbers: Sequence[_Number]) -> dict[float, str]:
    """Errors with the best values of those numbers that promise most, and words on them."""
    coarse = [min((one.error(k * one.reach), k) for k in _COARSE) for one in numbers]
    found = {}
    for k in sorted(range(len(numbers)), key=coarse.__getitem__)[:_PROMISING]:
        one, value = numbers[k], coarse[k][1] * numbers[k].reach
        for fraction in _STEPS:
            value = one.nearer(value, fraction * one.reach)
        found[one.error(value)] = one.words.format(abs(one.scale * value), one.more[value > 0])
    return found


def _changes(robot: Robot) -> Iterator[_Change]:
    """Mistakes of laboratories: signs of joints and of their forces, axes of the world, sides."""
    free = {robot.dof_names[k] for k in robot.floating_dofs}
    joints = [name for name in robot.dof_names if name not in free]
    for names, words in _groups(robot, joints):
        signs = np.ones(robot.dof)
        signs[[robot.index(name) for name in names]] = -1.0
        forces = f"the {'force' if len(names) == 1 else 'forces'} of {words}"
        yield _Change(f"{words} had the other sign", signs)
        yield _Change(f"{forces} had the other sign", forces=signs)
        if not free.issuperset(names):
            yield _Change(f"{words} and {forces} had the other sign", signs, signs)
    columns = [([pair], " and ".join(pair), True) for pair in combinations(joints, 2)]
    if sides := _pairs(robot, robot.dof_names):
        columns.insert(0, (sides, "left and right", False))
    for exchanged, words, alone in columns:  # whether angles alone may be exchanged, too
        order = np.arange(robot.dof)
        for one, other in exchanged:
            places = [robot.index(one), robot.index(other)]
            order[places] = places[::-1]
        yield _Change(f"{words} were exchanged", order=order, known=order)
        if alone:
            yield _Change(f"the angles of {words} were exchanged", order=order)
    for axis, turned in (("z pointed down", "y z pitch yaw"), ("x pointed back", "x y pitch roll")):
        names = turned.split()
        if free.intersection(names):
            signs = np.array([-1.0 if name in names else 1.0 for name in robot.dof_names])
            yield _Change(f"{axis} (another sign of {', '.join(names)})", signs)


def _pairs(robot: Robot, names: Sequence[str]) -> list[tuple[str, str]]:
    """Joints of the left, and the same of the right."""
    both = [(name, robot.twin(name)) for name in names if robot.side(name) > 0]
    return [(left, right) for left, right in both if right != left and right in names]


def _groups(robot: Robot, joints: Sequence[str]) -> Iterator[tuple[Sequence[str], str]]:
    """Coordinates that may have a wrong sign together, and their name."""
    yield from (([name], name) for name in robot.dof_names)
    yield from ((pair, " and ".join(pair)) for pair in _pairs(robot, joints))
    for side, word in ((1, "left"), (-1, "right")):
        group = [name for name in joints if robot.side(name) == side]
        if len(group) > 1:
            yield group, f"all joints of the {word}"
    if len(joints) > 1:
        yield joints, "all joints"

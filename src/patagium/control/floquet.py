"""Floquet analysis of a periodic orbit: multipliers, modes, and where averaged models fail.

A small change of the state on the orbit becomes M times itself after a beat. Eigenvalues of M
are the multipliers; position and heading have 1, for nothing depends on them. Beside them stand
two averaged models of the same beat: the mean of its linearization, and the first order of
averaging, which takes the mean of the rate with the state held. Neglected: what is not small.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patagium.arguments import checked
from patagium.arrays import Array
from patagium.control.orbit import STILL, Frame, Orbit

GONE = 1e-12
"""Size of a multiplier whose rate is rounding's: nothing is left of the mode after a beat."""
FAILS = 0.2
"""Relative error of an averaged rate from which on averaging fails."""
_BALANCED = 1e-8  # mean rate of an equilibrium, rounding of some thousand operations [SI]


@dataclass(frozen=True)
class Mode:
    """Mode of a periodic orbit.

    Attributes:
        name: The field's name where the motion is that, else its largest states. A neutral motion
            stays; a drift of states by others grows as time does, though its multiplier is 1.
        multiplier: Factor of a beat; of a pair the one with the positive angle [1].
        rate: Growth rate and angular frequency, log(multiplier) / period [1/s].
        shares: Share of each state in the mode, mean over the beat, by name, largest first [1].
        averaged: Rate by the mean of the beat's linearization [1/s].
        first_order: Rate by averaging of first order [1/s]; nan where it has no equilibrium.
    """

    name: str
    multiplier: complex
    rate: complex
    shares: dict[str, float]
    averaged: complex
    first_order: complex

    @property
    def time(self) -> float:
        """Time to double, positive, or to halve, negative [s]; infinite where neither."""
        return float(np.log(2.0) / self.rate.real) if self.rate.real else float("inf")

    def fails(self, rate: complex) -> bool:
        """Whether an averaged rate is further from the mode's than a fifth of it."""
        if abs(self.multiplier) < GONE:
            return not rate.real < 0.5 * self.rate.real
        return not abs(rate - self.rate) <= FAILS * abs(self.rate)


@dataclass(frozen=True, eq=False)
class Floquet:
    """Stability of a periodic orbit.

    Attributes:
        modes: Modes, least stable first.
        neutral: Multipliers of position and heading, (4,) [1].
        period: Time of a beat [s].
        vectors: Eigenvector of each mode in the coordinates of `states`, (n - 4, modes) [SI]; of a
            drift the states that stay and drive others.
        states: Names of the states, position and heading left out.
    """

    modes: tuple[Mode, ...]
    neutral: NDArray[np.complex128]
    period: float
    vectors: NDArray[np.complex128] = field(repr=False)
    states: tuple[str, ...] = field(repr=False)

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Multipliers of all modes, both of a pair, least stable first, (n - 4,) [1]."""
        pairs = ((one.multiplier, one.multiplier.conjugate()) for one in self.modes)
        return np.array([each for pair in pairs for each in dict.fromkeys(pair)])

    @property
    def stable(self) -> bool:
        """Whether every mode fades."""
        return all(abs(mode.multiplier) < 1.0 for mode in self.modes)

    def summary(self) -> list[dict[str, Any]]:
        """Modes as rows of a table, with units in the names."""
        return [
            {
                "mode": mode.name,
                "multiplier": abs(mode.multiplier),
                "doubles_in_s": mode.time if mode.rate.real > 0 else None,
                "halves_in_s": -mode.time if mode.time < 0 else None,
                "period_s": 2 * np.pi / abs(mode.rate.imag) if mode.rate.imag else None,
                "averaging_fails": mode.fails(mode.averaged),
                "first_order_fails": mode.fails(mode.first_order),
            }
            for mode in self.modes
        ]

    def __repr__(self) -> str:
        far = float(np.abs(self.neutral - 1.0).max())
        lines = [f"modes of a beat of {self.period:.4g} s; position and heading 1 within {far:.0e}"]
        for mode in self.modes:
            word = "doubles" if mode.time > 0 else "halves"
            swings = f", period {2 * np.pi / mode.rate.imag:.3g} s" if mode.rate.imag else ""
            averages = {"mean": mode.averaged, "first order": mode.first_order}
            failing = [words for words, rate in averages.items() if mode.fails(rate)]
            note = f"; averaging fails ({', '.join(failing)})" if failing else ""
            size = abs(mode.multiplier)
            told = f"{word} in {abs(mode.time):.3g} s{swings}"
            if not mode.rate:
                told = "stays" if mode.name.startswith("neutral") else "grows evenly"
            elif size < GONE:
                told = "gone within a beat"
            lines.append(f"  {mode.name}: |multiplier| {size:.5g}, {told}{note}")
        return "\n".join(lines)


@checked
def floquet(orbit: Orbit) -> Floquet:
    """Multipliers and modes of a periodic orbit, compared with those of averaged models.

    Args:
        orbit: The orbit.

    Returns:
        Modes, least stable first; multipliers are exact for the map of the flight.
    """
    frame, slope = Frame(orbit.names), orbit.return_slope
    values, vectors = np.linalg.eig(slope)
    period, sizes = orbit.period, _sizes(orbit, frame.names)
    still = np.flatnonzero(np.abs(values - 1.0) < STILL)
    vectors[:, still], driven = _neutral_motions(slope, sizes, len(still))
    values[still] = 1.0
    rows = orbit.family.rows(orbit.values, orbit.steps, orbit.aero.air)
    beginnings = rows.table[: -1 : len(rows.table) // len(orbit.states)]
    slopes = partial(orbit.map.slopes, rows=beginnings)
    beat = zip(orbit.states, *slopes(orbit.states), strict=True)
    mean = np.mean([frame.seen_rate(*one) for one in beat], axis=0)
    averaged, first = np.linalg.eigvals(mean).astype(complex), _first_order_rates(orbit, slopes)
    kept = [k for k in np.argsort(-np.abs(values), kind="stable") if values[k].imag >= 0]
    rates = np.emath.log(np.where(values == 0, 1e-300, values)[kept]) / period  # of 0: rounding
    averaged, first = (np.where(np.abs(x) * period < STILL, 0.0, x) for x in (averaged, first))
    near, nearer = _matched(rates, averaged), _matched(rates, first)
    carried = _carried(orbit, frame)
    shares = [_shares(frame.names, carried @ vectors[:, k] / sizes) for k in kept]
    names = _names(shares, rates, orbit)
    for k, vector in zip(still, driven.T, strict=True):
        if vector.any():
            place, moved = kept.index(k), _shares(frame.names, carried @ vector / sizes)
            names[place] = f"drift of {_of(moved)} by {_of(shares[place])}"
    numbers = np.array([values[kept], rates], complex).tolist()
    modes = tuple(map(Mode, names, *numbers, shares, near, nearer))
    return Floquet(modes, _neutral(orbit), period, vectors[:, kept], frame.names)


def _neutral_motions(slope: Array, sizes: Array, count: int) -> tuple[Array, Array]:
    """Motions of a multiplier 1 that occurs `count` times, and what a beat adds to each, else 0.

    Fewer eigenvectors than that are there where some of these states drive others.
    """
    change = slope * sizes / sizes[:, None] - np.eye(len(slope))
    kernel = np.linalg.svd(np.linalg.matrix_power(change, count))[2][len(slope) - count :].T
    added, size, motions = np.linalg.svd(kernel.T @ change @ kernel)
    added = added * np.where(size < STILL, 0.0, size)
    return sizes[:, None] * (kernel @ motions.T), sizes[:, None] * (kernel @ added)


def _neutral(orbit: Orbit) -> NDArray[np.complex128]:
    """Multipliers of position and heading: how their generators map onto themselves, (4,)."""
    frame = Frame(orbit.names)
    _, slope = frame.seen(orbit.segments.ends[-1])
    moved = slope @ orbit.monodromy @ frame.generators(orbit.states[0])
    left = np.abs(moved[frame.kept]).max(axis=0)  # of a generator nothing else is left
    # the yaw's shifts the position too, which is the block above the diagonal
    return np.asarray(np.linalg.eigvals(np.triu(moved[frame.neutral])) + left, complex)


def _first_order_rates(
    orbit: Orbit, slopes: Callable[[Array], tuple[Array, Array]]
) -> NDArray[np.complex128]:
    """Rates of averaging of first order about its own equilibrium, (n - 4,) [1/s].

    The mean rate of a held state vanishes at the equilibrium, which Levenberg and Marquardt's
    method finds from the mean state of the orbit. Of states as the segments begin, `slopes` gives
    rates and Jacobians.
    """
    from scipy.optimize import root  # slow to import, rarely needed

    frame, m = Frame(orbit.names), len(orbit.states)
    state = np.array([frame.seen(one)[0] for one in orbit.states]).mean(axis=0)
    state[frame.neutral] = 0.0

    def mean_rate(kept: Array) -> tuple[Array, Array]:
        state[frame.kept] = kept
        rate, slope = (part.mean(axis=0) for part in slopes(np.tile(state, (m, 1))))
        return (frame.seen(state)[1] @ rate)[frame.kept], frame.seen_rate(state, rate, slope)

    with np.errstate(all="ignore"):
        found = root(mean_rate, state[frame.kept], jac=True, method="lm", options={"xtol": 1e-13})
        residual, seen = mean_rate(found.x)
    if not (np.isfinite(seen).all() and np.abs(residual).max() <= _BALANCED):
        return np.full(len(found.x), np.nan, complex)
    return np.asarray(np.linalg.eigvals(seen), complex)


def _matched(rates: Array, others: NDArray[np.complex128]) -> list[complex]:
    """Partner of each rate among others, the nearest as a whole."""
    from scipy.optimize import linear_sum_assignment  # slow to import, rarely needed

    if not np.isfinite(others).all():
        return [complex(np.nan)] * len(rates)
    apart = np.abs(rates[:, None] - others[None, :])
    sizes = np.abs(rates)[:, None] + np.abs(others)[None, :]
    places = linear_sum_assignment(apart / (sizes + 1e-12))[1]
    return [complex(others[k]) for k in places]


_LONGITUDINAL = ("pitch", "velocity of x", "velocity of z", "velocity of pitch")
_LATERAL = ("roll", "velocity of y", "velocity of roll", "velocity of yaw")


def _sizes(orbit: Orbit, names: tuple[str, ...]) -> Array:
    """Reference values that make states dimensionless, similar for robots of all sizes, (n,) [SI].

    An angle counts as 0.1 rad, a length as 3/4 of gravity times the squared period of the beat, and
    a velocity as 5/3 of them a beat: 1 m/s and 2 rad/s at 12 Hz.
    """
    robot, period = orbit.robot, orbit.period
    length = 0.75 * robot.scale_gravity * period**2
    units = dict(zip(robot.dof_names, robot.dof_units, strict=True))
    places = [name.rpartition("velocity of ")[2] for name in names]
    sizes = np.array([length if units.get(place) == "m" else 0.1 for place in places])
    faster = np.array([*map(str.__ne__, names, places)])
    return np.where(faster, 5.0 / 3.0 / period * sizes, sizes)


def _carried(orbit: Orbit, frame: Frame) -> Array:
    """Derivative of the state as each segment begins by the first, (m, n - 4, n - 4) [SI]."""
    found, slope = [], np.eye(frame.size)
    for state, step in zip(orbit.states, orbit.segments.by_state, strict=True):
        found.append((frame.seen(state)[1] @ slope)[np.ix_(frame.kept, frame.kept)])
        slope = step @ slope
    return np.array(found)


def _shares(names: tuple[str, ...], motion: NDArray[np.complex128]) -> dict[str, float]:
    """Share of each state by name, the largest first, in a motion in their sizes, (m, n) [1]."""
    parts = np.abs(motion)
    sums = parts.sum(axis=1, keepdims=True)
    left = sums[:, 0] > GONE * sums.max()  # of what faded within the beat only rounding is left
    parts = (parts[left] / sums[left]).mean(axis=0)
    return {names[k]: float(parts[k]) for k in np.argsort(-parts, kind="stable")}


def _names(shares: list[dict[str, float]], rates: Array, orbit: Orbit) -> list[str]:
    """The field's names of modes that are these motions, else their largest states.

    An airplane's names are for flight forward, faster than the size of velocities; of two
    oscillations in the plane of symmetry the slower is the phugoid, and spiral and roll subsidence
    are the slowest and the fastest of the lateral motions that do not oscillate.
    """
    found = [_largest(part, rate) for part, rate in zip(shares, rates, strict=True)]
    if orbit.speed < _sizes(orbit, ("velocity of x",))[0]:
        return found
    order = [k for k in np.argsort(np.abs(rates)) if rates[k]]
    along = [k for k in order if _part(shares[k], _LONGITUDINAL) and rates[k].imag]
    across = [k for k in order if _part(shares[k], _LATERAL)]
    straight = [k for k in across if not rates[k].imag]
    if along and _part(shares[along[0]], ("velocity of x", "velocity of z", "pitch"), 0.8):
        found[along[0]] = "phugoid"
    if len(along) > 1:
        found[along[-1]] = "short period"
    if len(across) - len(straight) == 1:
        found[next(k for k in across if rates[k].imag)] = "dutch roll"
    if straight and next(iter(shares[straight[0]])) == "roll":
        found[straight[0]] = "spiral"
    if len(straight) > 1 and _part(shares[straight[-1]], ("velocity of roll", "roll"), 0.5):
        found[straight[-1]] = "roll subsidence"
    return found


def _part(shares: dict[str, float], names: tuple[str, ...], most: float = 0.95) -> bool:
    """Whether some states make up most of a mode."""
    return sum(shares.get(name, 0.0) for name in names) > most


def _largest(shares: dict[str, float], rate: complex) -> str:
    """Name of a mode by its largest states."""
    kind = "divergence" if rate.real > 0 else "subsidence"
    if not rate:
        kind = "neutral motion"
    elif rate.imag:
        kind = "oscillation"
    return f"{kind} of {_of(shares)}"


def _of(shares: dict[str, float]) -> str:
    """Largest states of a motion."""
    return ", ".join([name for name in shares if shares[name] > 0.15][:3] or [*shares][:1])

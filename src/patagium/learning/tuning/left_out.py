"""Samples that trials of `tune` do not learn from, and by which they are then judged.

A setting that fits the flight it learns may err by orders of magnitude on the next gait. So each
trial is judged by weights that stay, on samples it has not learned:

1. flights that are left out, if there are any;
2. else stretches of different kinematics: the wingbeats of the flight are grouped by mean and
   spread of their inputs (speed, incidence, amplitude and, through the rates, frequency), and
   each group is left out in turn;
3. else, where all wingbeats are alike, the second half of the flight, or what follows some times
   of it within a horizon: how the settings carry over cannot be judged.

Neglected: kinematics that change within a wingbeat; differences that the inputs do not show.

References:
    Roberts et al. (2017), Cross-validation strategies for data with temporal, spatial,
    hierarchical, or phylogenetic structure, Ecography 40.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal, NamedTuple

import numpy as np
import xarray as xr
from scipy.cluster.hierarchy import fcluster, linkage

from patagium.arrays import Array, Indices
from patagium.learning.tuning.prediction_score import Flown, Fold
from patagium.learning.wingbeats import wingbeat_period
from patagium.sensing.force.air_force import recorded
from patagium.sensing.logs.table import LogTable
from patagium.simulation import gait_period, robot_of

Rule = Literal["left-out flights", "left-out kinematics", "second half"]

MOST_GROUPS = 3
"""Groups of wingbeats at most: a trial learns the flight once for each."""
UNLIKE = 0.1
"""Groups are unlike if mean or spread of an input differs by this share of its size, ..."""
APART = 3.0
"""... and by so many standard deviations within the groups."""
LEAST_SHARE = 0.1
"""Share of all wingbeats that a group has at least."""
STRETCHES = 20
"""Stretches of a log that does not repeat itself."""
ORIGINS = (0.5, 0.625, 0.75, 0.875)
"""Shares of a flight after which a horizon is predicted."""
_SMALL = 0.01  # of the largest input of its unit, below which an input is left aside


class Kinematics(NamedTuple):
    """Inputs of a flight by which its wingbeats are told apart.

    Attributes:
        time: Increasing, (N,) [s].
        x: Inputs, (N, n) [`units`]; no positions, on which no force depends.
        names: Their names.
        units: Their units.
        period: Wingbeat [s]; None to find it in the inputs.
        gaps: First sample after each gap.
        used: Samples used, increasing.
    """

    time: Array
    x: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    period: float | None
    gaps: Indices
    used: Indices


@dataclass(frozen=True)
class LeftOut:
    """Samples that are left out of what trials learn.

    Attributes:
        rule: How they were chosen.
        text: The rule and what it found, in words.
        folds: What is learned and what is then predicted.
    """

    rule: Rule
    text: str
    folds: tuple[Fold, ...]


def kinematics_of(
    flight: xr.Dataset | LogTable, time: Array, gaps: Indices, used: Indices
) -> Kinematics:
    """Kinematics of a flight or a table.

    Args:
        flight: Record with q and v, or a table.
        time: Times of its samples, (N,) [s].
        gaps: First sample after each gap.
        used: Samples used, increasing.
    """
    if isinstance(flight, LogTable):
        table = flight
        return Kinematics(time, table.x, table.input_names, table.input_units, None, gaps, used)
    robot = robot_of(flight)
    q, v = recorded(flight, "q", robot), recorded(flight, "v", robot)
    places = {place for body in robot.bodies for place in robot.floating_coordinates(body)[:3]}
    kept = [place for place in range(q.shape[1]) if place not in places]
    names = [f"q.{robot.coordinate_names[place]}" for place in kept]
    units = [robot.coordinate_units[place] for place in kept]
    names += [f"v.{name}" for name in robot.dof_names]
    units += [f"{unit}/s" for unit in robot.dof_units]
    x = np.hstack([q[:, kept], v])
    return Kinematics(time, x, tuple(names), tuple(units), gait_period(flight), gaps, used)


def left_out(
    flown: Flown, kinematics: Sequence[Kinematics], others: Sequence[Flown], horizon: float | None
) -> LeftOut:
    """Samples that are left out: other flights, else other kinematics, else the second half.

    Args:
        flown: Flights that are learned.
        kinematics: Their kinematics, flight by flight.
        others: Flights that are left out.
        horizon: Time for which weights stay where all kinematics are alike [s]; None: over the
            second half.
    """
    whole = np.ones(len(flown.used), bool)
    if others:
        text = f"left-out flights: {', '.join(one.name for one in others)}"
        folds = tuple(Fold(whole, one, np.arange(len(one.used))) for one in others)
        return LeftOut("left-out flights", text, folds)
    group, words = stretches_of(kinematics)
    if group.any():
        groups = [group == k for k in range(int(group.max()) + 1)]
        folds = tuple(Fold(~one, flown, np.flatnonzero(one)) for one in groups)
        if all(flown.scored[one].any() for one in groups):
            text = f"wingbeats of other kinematics left out in turn: {words}"
            return LeftOut("left-out kinematics", text, folds)
    text = (
        f"second half, by weights that stay; {words}, so that it cannot be judged how the "
        "settings carry over to other kinematics: give a flight with others to --hold-out. Of "
        "the trials within one standard error of the best, that whose weights moved least"
    )
    return LeftOut("second half", text, _later(flown, horizon))


def stretches_of(flights: Sequence[Kinematics]) -> tuple[Indices, str]:
    """Group of the wingbeat of each used sample, (U,), told apart by kinematics; what was found.

    Args:
        flights: Flights one after the other, with the same inputs.
    """
    beats, features, word, count = [], [], "wingbeats", 0
    for one in flights:
        numbers, repeats = _beats(one)
        word = word if repeats else "stretches"
        beats.append(numbers[one.used] + count)
        parts = [one.x[numbers == k] for k in range(numbers.max() + 1)]
        features += [np.concatenate([x.mean(axis=0), x.std(axis=0)]) for x in parts]
        count += int(numbers.max()) + 1
    beat, table = np.concatenate(beats), np.array(features)
    whole = np.concatenate([one.x for one in flights])
    scaled, names = _scaled(table, whole, flights[0])
    groups = _groups(scaled)
    if groups is None:
        most = np.ptp(scaled, axis=0).max(initial=0.0)
        text = f"the {count} {word} are alike: mean and spread of the inputs differ by {most:.2g} "
        text += "times the size of the input at most, in no groups"
        return np.zeros(len(beat), np.int64), text
    sizes = np.bincount(groups)
    centers = np.array([scaled[groups == k].mean(axis=0) for k in range(len(sizes))])
    place = int(np.ptp(centers, axis=0).argmax())
    values = ", ".join(f"{table[groups == k].mean(axis=0)[place]:.3g}" for k in range(len(sizes)))
    text = (
        f"{len(sizes)} groups of {', '.join(map(str, sizes))} {word}, which differ most in "
        f"{names[place]}: {values}"
    )
    return groups[beat], text


def _later(flown: Flown, horizon: float | None) -> tuple[Fold, ...]:
    """Folds of a flight that predict what comes after what they learn."""
    time, count = flown.samples.time[flown.used], len(flown.used)
    half = np.arange(count) < count // 2
    if horizon is None:
        return (Fold(half, flown, np.flatnonzero(~half), elsewhere=False),)
    folds = []
    for share in ORIGINS:
        learned = np.arange(count) < int(share * count)
        ahead = ~learned & (time <= time[learned][-1] + horizon)
        if flown.scored[ahead].any():
            folds.append(Fold(learned, flown, np.flatnonzero(ahead), elsewhere=False))
    return tuple(folds) or _later(flown, None)


def _beats(flight: Kinematics) -> tuple[Indices, bool]:
    """Number of the wingbeat of each sample, and whether there is a wingbeat at all.

    A piece of a wingbeat before a gap or at the end belongs to the one before.
    """
    time, ends = flight.time, [*flight.gaps.tolist(), len(flight.time)]
    period = flight.period
    if period is None:
        longest = max(zip([0, *ends[:-1]], ends, strict=True), key=lambda one: one[1] - one[0])
        period = wingbeat_period(time[slice(*longest)], flight.x[slice(*longest)])
    length = float(time[-1] - time[0]) / STRETCHES if period is None else period
    numbers, count, begin = np.empty(len(time), np.int64), 0, 0
    for end in ends:
        inside = ((time[begin:end] - time[begin]) / length + 1e-9).astype(np.int64)
        whole = max(1, int((time[end - 1] - time[begin]) / length + 0.1))
        numbers[begin:end] = count + np.minimum(inside, whole - 1)
        count, begin = count + whole, end
    return np.unique(numbers, return_inverse=True)[1], period is not None


def _scaled(table: Array, x: Array, flight: Kinematics) -> tuple[Array, list[str]]:
    """Features in units of the size of their input, and their names; small inputs are left aside.

    An input of one that is small against others of its unit is rounding or noise.
    """
    size = np.sqrt((x**2).mean(axis=0))
    units = np.array(flight.units)
    largest = np.array([size[units == unit].max() for unit in flight.units])
    kept = np.flatnonzero((size > _SMALL * largest) & (size > 0))
    columns = np.concatenate([kept, kept + len(size)])
    words = [f"the {part} of {name}" for part in ("mean", "spread") for name in flight.names]
    scaled = np.zeros_like(table)
    scaled[:, columns] = table[:, columns] / np.tile(size[kept], 2)
    return scaled, words


def _groups(scaled: Array) -> Indices | None:
    """Group of each wingbeat, the most groups that are all unlike; None where all are alike."""
    count = len(scaled)
    if count < 4:
        return None
    tree = linkage(scaled, "ward")
    for wanted in range(MOST_GROUPS, 1, -1):
        groups: Indices = fcluster(tree, wanted, "maxclust").astype(np.int64) - 1
        sizes = np.bincount(groups, minlength=wanted)
        if sizes.min() < max(2, LEAST_SHARE * count):
            continue
        parts = [scaled[groups == k] for k in range(wanted)]
        if all(_unlike(*pair) for pair in combinations(parts, 2)):
            return groups
    return None


def _unlike(one: Array, other: Array) -> bool:
    """Whether the means of two groups of wingbeats differ by more than the scatter within them."""
    apart = np.abs(one.mean(axis=0) - other.mean(axis=0))
    within = np.sqrt(one.var(axis=0) * len(one) + other.var(axis=0) * len(other))
    within /= np.sqrt(len(one) + len(other))
    return bool(((apart > UNLIKE) & (apart > APART * within)).any())

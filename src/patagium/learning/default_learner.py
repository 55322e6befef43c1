"""Default learner: network, learner and sampling of a log for which none is given.

What was chosen, and from what, is kept with the scores of an identification (`choices`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from math import ceil, nan
from typing import Any

import numpy as np
import xarray as xr

from patagium.aerodynamics import Air
from patagium.arguments import checked
from patagium.arrays import Array, Bools, usual_step
from patagium.errors import LogError
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.models.linear_strip import LinearStripNetwork
from patagium.learning.models.memory import network_inputs
from patagium.learning.models.network import Network
from patagium.learning.models.physical import own_prior
from patagium.learning.models.structure import blocks_of
from patagium.learning.parameter_paths import Trained
from patagium.learning.samples import flown, samples, with_force
from patagium.learning.scores import normalized_error
from patagium.learning.settings import FilterSettings, Structure, settings_from
from patagium.learning.table_network import network_for
from patagium.robot import Robot
from patagium.sensing.force.measured_force import ForceSamples
from patagium.sensing.logs.table import LogTable
from patagium.simulation import added_mass_of, gait_period

HIDDEN = (8, 8)
"""Neurons of each hidden layer of the default network of a table."""
UPDATE_RATE, PER_WINGBEAT, FASTEST = 100.0, 20.0, 1000.0
"""Updates a second; at least so many a wingbeat; never more a second than the last."""
MEMORY, LEAST_MEMORY, FLOOR = 100.0, 1000, 0.005
"""Memory of the default learner of a table [s], its least number of updates, floor of `Misfit`."""
ATTACHED, EXACT = 0.2, 0.05
"""Error of a lifting line in the first wingbeat, over the variance, below which flow is attached;
of blade elements, below which nothing else is looked for [1]."""
_APART = 0.18  # of a wingbeat, between neighbors of the phases of the first twenty samples
_LOOK = 1.0  # s that are looked at where no gait is known, ...
_MOVES = 0.1  # ... from the first joint rate that is so much of the largest
_OVERHEAD, _OPERATION, _LOAD = 2e-5, 5e-10, 0.5
# s a sample, s a multiplication and addition (ten times a compiled one), share of the time


def default_network(
    subject: xr.Dataset | ForceSamples | Robot,
    air: Air | None = None,
) -> Network:
    """Default network for the air of a robot with wings.

    The first wingbeat of a log says whether flow is attached: there physics with a lifting line
    leaves less than `ATTACHED` of the variance of the median output, and less than blade elements.

    Args:
        subject: Flight or measured forces, or a robot with strips, of whose air nothing is known.
        air: Air that it flies in; None: that of a flight or of forces, of a robot still air.
    """
    if isinstance(subject, Robot):
        return LinearStripNetwork(subject, air)
    log: xr.Dataset | ForceSamples = with_force(subject)
    robot, own = flown(log)
    air, measured = air or own, log.measured if isinstance(log, ForceSamples) else None
    network = LinearStripNetwork(robot, air, measured)
    blades = _physics_error(network, log)
    if not blades > EXACT:
        return network
    attached = LinearStripNetwork(robot, air, measured, attached=True)
    return attached if _physics_error(attached, log) < min(ATTACHED, blades) else network


def _physics_error(network: LinearStripNetwork, log: xr.Dataset | ForceSamples) -> float:
    """Error of physics alone in the first wingbeat over the variance, median output [1].

    Without added mass where a simulation says that it had none. Where no gait is known it is the
    error of the first second in which joints move; nan where no output moves.

    Raises:
        LogError: If a wingbeat of the gait is shorter than the step of the samples.
    """
    period, carried = None, True
    if isinstance(log, xr.Dataset):
        carried = "air" in log.attrs or added_mass_of(log) is not None  # no simulation has "air"
        if period := gait_period(log):
            stamps = log["time"].values
            beat = stamps <= stamps[0] + period
            if beat.sum() < min(2, len(stamps)):
                found = f"a step of {stamps[1] - stamps[0]:g} s; is it in s?"
                raise LogError("time", f"samples within a wingbeat of {period:g} s", found)
            log = log.isel(time=beat)
    time, x, y, _ = samples(log, network)
    first, weights = first_motion(network.robot, time, x, period), network.physics(carried)
    seen = network_inputs(network, weights, time[first], x[first])
    error = normalized_error(y[first], network.evaluate(seen, weights))
    known = error[np.isfinite(error)]
    return float(np.median(known)) if len(known) else nan


def first_motion(robot: Robot, time: Array, x: Array, period: float | None = None) -> Bools:
    """Samples of the first wingbeat, else second, of motion, (N,); x = [q, v, ...], (N, n_x) [SI].

    It begins with the first joint rate that is a tenth of the largest.
    """
    joints = robot.coordinate_count + np.array(robot.actuated, int)
    rates = np.abs(x[:, joints]).max(axis=1, initial=0.0)
    begin = time[np.argmax(rates >= _MOVES * rates.max())]
    return np.asarray((time >= begin) & (time <= begin + (period or _LOOK)))


@checked
def default_learner(
    subject: xr.Dataset | ForceSamples | LogTable | Robot,
    air: Air | None = None,
    settings: FilterSettings | None = None,
    every: int | None = None,
) -> FilterLearner:
    """Default learner of a flight, a table or a robot.

    The extended Kalman filter, whose noise and prior are found, on the default network of the
    robot, or on a dense network for the columns of a table, which forgets: see `table_share`.

    Args:
        subject: What it learns from, or the robot that will send samples.
        air: Air that the robot flies in; None: that of a flight or of forces, of a robot still air.
        settings: Settings that are not to be found; None: all are.
        every: One sample of a table in so many will be used; None: as `table_every` says.
    """
    if isinstance(subject, LogTable):
        network: Network = network_for(subject, HIDDEN)
        own = settings or settings_from("extended", table_settings(subject, network, every))
        return ExtendedLearner(network, own)
    return ExtendedLearner(default_network(subject, air), settings)


def table_settings(
    table: LogTable,
    network: Network,
    every: int | None = None,
    given: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Default settings of the learner of a table, by name: forgetting and the least model error.

    Args:
        table: Rows of the log.
        network: Network that learns it.
        every: One sample in so many is used; None: as many as the time of an update allows.
        given: Settings that are given, by dotted name; with noise given, no least error is set.
    """
    structure = (given or {}).get("covariance", "full")
    found: dict[str, Any] = {"prior_share": table_share(table, network, every, structure)}
    if {"measurement_std", "misfit.floor", "noise_estimation.memory"}.isdisjoint(given or ()):
        found["misfit"] = {"floor": FLOOR}
    return found


def table_share(
    table: LogTable, network: Network, every: int | None = None, structure: Structure = "full"
) -> float:
    """Default `prior_share` of the learner of a table: a memory of 100 s [1].

    A network without physics is not the machine: batteries, ground and wear move the best weights.
    A filter that takes the samples as all of one truth becomes sure of their mean, and errs by
    more than the last sample held. The memory is 1000 updates at least. Three
    digits: the time steps of two logs of one rate differ by rounding, their settings do not.
    """
    step = usual_step(table.time)
    taken = _kept_up(network, structure, step) if every is None else every
    return float(f"{min(taken * step / MEMORY, 1.0 / LEAST_MEMORY):.3g}")


def update_time(network: Network, structure: Structure = "full") -> float:
    """Estimated time of an update that any computer of today keeps [s].

    It is estimated from the number of weights, not measured, so that a busy computer learns what an
    idle one learns: 20 us, and half a nanosecond a multiplication and addition, several times what
    compiled code takes.

    Args:
        network: Network that is learned.
        structure: Structure of the covariance.
    """
    outputs, whole = network.outputs, structure not in ("layer", "node")
    blocks = blocks_of(network, "full" if whole else structure)
    operations = sum(len(block) ** 2 for block in blocks) * (outputs + 8)
    if not whole:
        operations += network.size * outputs**2
    return _OVERHEAD + _OPERATION * operations


def _setting(learner: Any, name: str, default: Any) -> Any:
    """Setting of a learner, or of the one that learned a model; the default if it has none."""
    known = getattr(learner, "learner", {}).get(name, default)
    return getattr(getattr(learner, "settings", None), name, known)


def chosen_every(learner: Trained, step: float, period: float | None = None) -> int:
    """Default number of samples from one used sample to the next; step and period in [s].

    One hundred updates a second, or twenty a wingbeat where that is more, but at most 1000, and
    no more than the estimated time of an update allows (`update_time`). More often does not tell
    more: the errors of a model last for a part of a wingbeat, and a filter that takes them for
    independent is too sure of itself. Of a fast wingbeat it is up to half as many more, so that
    samples do not fall on the same few phases of every beat.
    """
    wanted = UPDATE_RATE if period is None else max(UPDATE_RATE, PER_WINGBEAT / period)
    update = update_time(learner.network, _setting(learner, "covariance", "full"))
    rate = min(wanted, FASTEST, _LOAD / update)
    every = max(1, ceil((1 - 1e-4) / (rate * step)))
    if period is None:
        return every
    for longer in range(every, every + every // 2 + 1):
        phases = np.sort(np.arange(PER_WINGBEAT) * longer * step / period % 1.0)
        if np.diff(phases, append=phases[0] + 1.0).max() < _APART:
            return longer
    return every


def table_every(learner: Trained, step: float) -> int:
    """Default interval between used samples of a table, in samples.

    A learner that forgets may use as many as the estimated time of an update allows, for it never
    becomes too sure; others as `chosen_every` says.

    Args:
        learner: What learns.
        step: Median time between two samples [s].
    """
    if not _setting(learner, "prior_share", 0.0):
        return chosen_every(learner, step)
    return _kept_up(learner.network, _setting(learner, "covariance", "full"), step)


def _kept_up(network: Network, structure: Structure, step: float) -> int:
    """Least interval between used samples that the estimated time of an update allows."""
    return max(1, ceil(update_time(network, structure) / (_LOAD * step) - 1e-6))


def choices(
    learner: Learner, every: int, step: float, *, learner_given: bool, every_given: bool
) -> dict[str, str]:
    """Choices of an identification in words: what was set, and what was found from what.

    Args:
        learner: After it learned.
        every: One sample in so many was used.
        step: Median time between two samples [s].
        learner_given: Whether network and learner were chosen by hand.
        every_given: Whether the share of the samples was.
    """
    used = "every sample" if every == 1 else f"one sample in {every}"
    rate = f"{used}, {1 / (every * step):.4g} updates a second"
    found = f"from {1 / step:.4g} samples a second, the wingbeat and the number of weights"
    words = learner_choices(learner, given=("network", "learner") if learner_given else ())
    share = _setting(learner, "prior_share", 0.0)
    if share:
        words["memory"] = f"{every * step / share:.4g} s, prior_share {share:.3g}"
    return words | {"every": f"{rate}; {'set by you' if every_given else found}"}


def learner_choices(learner: Learner, *, given: Collection[str]) -> dict[str, str]:
    """Choices of network, learner and its settings in words; see `choices`.

    Args:
        learner: After it learned.
        given: Which of "network" and "learner" were chosen by hand.
    """
    described, network = learner.describe(), learner.network
    by = {k: "set by you" if k in given else "the default" for k in ("network", "learner")}
    layers = ",".join(map(str, network.hidden)) or "linear in its weights"
    kind, air = described["network"]["kind"], getattr(network, "air", None)
    words = dict[str, str]()
    if air and air.ground is not None:
        words["ground"] = "not known to the network, whose error its effect is"
    if getattr(network, "attached", False):
        told = "" if "network" in given else "; the first wingbeat"
        words["flow"] = f"attached, so a lifting line with lags{told}"
    return words | {
        "network": f"{kind}, {layers}, {network.size} weights; {by['network']}",
        "learner": f"{described['kind']}; {by['learner']}",
        **_found_words(described, own=bool(np.isfinite(own_prior(network)).all())),
    }


def _found_words(described: Mapping[str, Any], *, own: bool) -> dict[str, str]:
    """Noise and prior of a learner, in words; those that it has."""
    found, words = described.get("found", {}), {}
    sources = {
        "measurement_std": ("noise", " [unit of the output]; from the samples and the innovations"),
        "prior_std": ("prior", "; the rule for dimensionless weights"),
    }
    for name, (label, source) in sources.items():
        value = described.get(name)
        if name in found:
            words[label] = f"{_span(found[name])}{source}"
        elif value is not None:
            words[label] = f"{_span(value)}{source.partition(';')[0]}; set by you"
        elif name == "prior_std" and own:
            words[label] = "that of the network, for each weight; the default"
    return words


def _span(value: Any) -> str:
    """A number, or the least and the greatest of several; None is left out."""
    known = np.array(value, float)
    low, high = np.nanmin(known), np.nanmax(known)
    return f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}, by output"

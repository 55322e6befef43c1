"""Bursts of samples that no sensor should give, and a second learner that does not get them.

Of two subjects: a robot of three joints that flaps, with a force that a random network makes of
angles and rates, and a winged robot that flies, with a force that the default network makes of its
motion at other weights, and a part that no weights give. Every few hundred samples comes a burst of
one kind of poison. The twin learns the same samples without it. Neglected: faults of the clock,
which `campaign` has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import deepcopy
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from patagium.arrays import Array
from patagium.errors import PatagiumError
from patagium.learning.default_learner import default_network
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.models.network import Network
from patagium.learning.models.physical import own_prior
from patagium.learning.settings import Misfit, NoiseEstimation, Screening
from patagium_lab.attack import seeds
from patagium_lab.attack.campaign import STRUCTURES

JOINTS, OUTPUTS, STEP, NOISE = 3, 2, 1e-3, 0.02
RECOVERY = 100
"""Clean samples after a burst before the error is compared, and over which it is."""
LONGEST = 50
"""Samples of the longest burst."""
SEGMENT = 50_000
"""Samples of a flight that are in memory at a time."""
_BEGIN, _REST = 2000, 100
UNLEARNED = ("bad_inputs", "late", "duplicates", "blind", "refused")
"""Events of samples that are not learned, one for each."""


class Poisoned(NamedTuple):
    """Result of a learner on a poisoned stream.

    Attributes:
        samples: Samples that it was given.
        bursts: Bursts of each kind.
        crash: What ended it; empty: nothing.
        uncounted: Samples not learned and not counted as an event.
        ratio: By kind, the largest root mean square error over that of the twin, over `RECOVERY`
            samples that begin `RECOVERY` samples after a burst [1].
        beyond: By kind, bursts after which it is above 1.5.
        below: By kind, bursts after which it is below 1 / 1.5: by so much learners that had other
            samples differ, poisoned or not.
        missing: Bursts after which the ratio of a learner that never gets their samples is above
            1.5, and the largest such ratio [1].
        events: Events that it counted.
        clean: Error of the twin in each tenth of the flight, root of the median square [N].
    """

    samples: int
    bursts: dict[str, int]
    crash: str
    uncounted: int
    ratio: dict[str, float]
    beyond: dict[str, int]
    below: dict[str, int]
    missing: tuple[int, float]
    events: dict[str, int]
    clean: list[float]


class Subject(NamedTuple):
    """Robot whose samples are poisoned.

    Attributes:
        network: Network that learns its force.
        joints: Number of its encoders, which are inputs from the first one on.
        first: Place of the first one among the inputs.
        samples: Function of the seed, the first sample and a number of samples: inputs, (N, n_x)
            [units of x], and forces measured, (N, n_y) [units of y].
        scale: Scale of each force in the error that is compared, (n_y,) [units of y].
    """

    network: Network
    first: int
    joints: int
    samples: Callable[[int, int, int], tuple[Array, Array]]
    scale: Array


def network() -> DenseNetwork:
    """Network that learns the force of the three joints, of the inputs' scales."""
    speed = np.full(JOINTS, 30.0)
    return DenseNetwork(
        2 * JOINTS, (6,), OUTPUTS, input_scale=np.concatenate([np.ones(JOINTS), speed])
    )


def flight(seed: int, start: int, count: int) -> tuple[Array, Array]:
    """Angles and rates of the joints, (N, 6) [rad, rad/s], and forces measured, (N, 2) [N].

    Args:
        seed: Seed of the force, the gait and the noise.
        start: Number of the first sample.
        count: Number of samples, one a millisecond.
    """
    draw = np.random.default_rng(seed)
    time, frequency = STEP * (start + np.arange(count)[:, None]), np.array([4.0, 5.3, 2.9])
    rate = 2 * np.pi * frequency
    phase = rate * time + draw.uniform(0, 2 * np.pi, JOINTS) + 0.7 * np.sin(time)
    x = np.hstack([0.7 * np.sin(phase), 0.7 * (rate + 0.7 * np.cos(time)) * np.cos(phase)])
    inner = x / np.repeat([1.0, 30.0], JOINTS) @ draw.normal(size=(2 * JOINTS, 5))
    y = np.tanh(inner) @ draw.normal(size=(5, OUTPUTS))
    draw = np.random.default_rng((seed, start)) if start else draw
    return x, y + NOISE * draw.normal(size=y.shape)


def winged_flight(seed: int, start: int, count: int) -> tuple[Array, Array]:
    """Motion [q, v, a] of the robot of `seeds`, (N, 24), and generalized forces, (N, 8) [N, N m].

    It flies on at 3 m/s, sways, turns and flaps; the force is that of the default network with
    weights a third of their prior off, with a part that no weights give and noise, each of `NOISE`
    of the scale of a force.

    Args:
        seed: Seed of the weights, the gait and the noise.
        start: Number of the first sample.
        count: Number of samples, one a millisecond.
    """
    draw, model = np.random.default_rng(seed), default_network(seeds.robot())
    time = STEP * (start + np.arange(count)[:, None])
    size = np.array([0.2, 0.1, 0.1, 0.15, 0.1, 0.2, 0.6, 0.6])
    rate = 2 * np.pi * np.array([0.41, 0.33, 0.53, 0.71, 0.87, 0.29, 5.0, 5.0])
    phase = rate * time + np.array([*draw.uniform(0, 2 * np.pi, 6), 0.0, 0.05])
    q, v, a = (
        size * np.sin(phase), size * rate * np.cos(phase), -size * rate**2 * np.sin(phase)
    )  # fmt: skip
    q[:, :1] += 3.0 * time
    v[:, 0] += 3.0
    x = np.hstack([q, v, a])
    weights = model.initial(0) + own_prior(model) * draw.normal(size=model.size) / 3
    inner = draw.normal(size=(x.shape[1], 8)) * 0.3 / np.repeat([1.0, 3.0, 100.0], 8)[:, None]
    inner[0] = 0.0  # the place is no cause of a force
    y = model.decode(model.encode(x), weights)
    own = np.random.default_rng((seed, start, 1)).normal(size=y.shape)
    return x, y + NOISE * winged_scale() * (np.sin(x @ inner) + own)


@cache
def winged_scale() -> Array:
    """Scale of the forces of `winged_flight`, (8,) [N, N m]."""
    return np.array([0.5, 0.5, 0.5, 0.02, 0.02, 0.02, 0.02, 0.02])


def subject(name: str) -> Subject:
    """Subject by name.

    Args:
        name: "joints" or "wings".
    """
    if name == "wings":
        model = default_network(seeds.robot())
        return Subject(model, 6, 2, winged_flight, winged_scale())
    return Subject(network(), 0, JOINTS, flight, np.ones(OUTPUTS))


Poison = Callable[[np.random.Generator, Subject, Array, Array], None]


def _spikes(draw: np.random.Generator, values: Array) -> None:
    hit = draw.random(values.shape) < 0.5
    hit[:, draw.integers(values.shape[1])] = True
    size = 10.0 ** draw.uniform(1.0, 300.0, values.shape) * draw.choice([-1.0, 1.0], values.shape)
    values[hit] = size[hit]


def _nonsense(draw: np.random.Generator, values: Array) -> None:
    hit = draw.random(values.shape) < 0.5
    values[hit] = draw.choice([np.nan, np.inf, -np.inf], values.shape)[hit]


def _jump(draw: np.random.Generator, on: Subject, x: Array) -> None:
    k = on.first + draw.integers(on.joints)
    x[:, k] += np.where(x[:, k] > 0, -0.6, 0.6)


def _collinear(draw: np.random.Generator, on: Subject, x: Array, y: Array) -> None:
    share = draw.uniform(-1.0, 1.0, (len(x), 1))
    x[:], y[:] = share * x[0], share * y[0]


def _zero(draw: np.random.Generator, on: Subject, x: Array, y: Array) -> None:
    x[:], y[:] = 0.0, 0.0


def _swapped(draw: np.random.Generator, on: Subject, x: Array, y: Array) -> None:
    x[:], y[:] = x[:, ::-1].copy(), y[:, ::-1].copy()


def _stuck(draw: np.random.Generator, values: Array) -> None:
    k = draw.integers(values.shape[1])
    values[:, k] = values[0, k]


KINDS: dict[str, Poison] = {
    "spikes of inputs": lambda draw, on, x, y: _spikes(draw, x),
    "spikes of outputs": lambda draw, on, x, y: _spikes(draw, y),
    "inputs not numbers": lambda draw, on, x, y: _nonsense(draw, x),
    "outputs not numbers": lambda draw, on, x, y: _nonsense(draw, y),
    "encoder jump": lambda draw, on, x, y: _jump(draw, on, x),
    "stuck input": lambda draw, on, x, y: _stuck(draw, x),
    "stuck output": lambda draw, on, x, y: _stuck(draw, y),
    "collinear": _collinear,
    "zero": _zero,
    "swapped": _swapped,
}
"""Kinds of poison: what they make of the samples of a burst."""


def poisoned(learner: FilterLearner, seed: int, count: int, of: str = "joints") -> Poisoned:
    """Result of a learner on a flight of so many samples, poisoned in bursts.

    Args:
        learner: The learner, before any sample; it is changed.
        seed: Seed of the flight and of the poison.
        count: Number of samples, those of the bursts included.
        of: Subject, see `subject`.
    """
    on, twin, spared = subject(of), deepcopy(learner), deepcopy(learner)
    found: dict[str, list[float]] = {kind: [] for kind in KINDS}
    missing, clean, crash = list[float](), [], ""
    for start, x, y, wrong_x, wrong_y, ends in _segments(on, seed, count):
        errors = np.full((3, *y.shape), np.nan)
        wrong = (wrong_x != x).any(axis=1) | (wrong_y != y).any(axis=1)
        try:
            for k in range(len(x)):
                time = STEP * (start + k)
                errors[1, k] = twin.update(x[k], y[k], time)
                errors[0, k] = learner.update(wrong_x[k], wrong_y[k], time)
                if not wrong[k]:
                    errors[2, k] = spared.update(x[k], y[k], time)
        except (ArithmeticError, ValueError, PatagiumError) as problem:
            crash = f"sample {start + k}: {type(problem).__name__}: {problem}"
        squares = (errors / on.scale) ** 2
        squares[~np.isfinite(squares)] = np.nan
        for kind, end in ends:
            after = squares[:, end + RECOVERY : end + 2 * RECOVERY]
            own, other, without = np.nanmean(after, axis=(1, 2))
            found[kind].append(float(np.sqrt(own / other)))
            missing.append(float(np.sqrt(without / other)))
        clean += [float(np.nanmedian(part)) for part in np.array_split(squares[1], 10)]
        if crash:
            break
    unlearned = sum(learner.events[name] for name in UNLEARNED)
    return Poisoned(
        count,
        {kind: len(each) for kind, each in found.items()},
        crash,
        0 if crash else count - learner.count - unlearned,
        {kind: max(each, default=0.0) for kind, each in found.items()},
        {kind: sum(not ratio <= 1.5 for ratio in each) for kind, each in found.items()},
        {kind: sum(ratio < 1 / 1.5 for ratio in each) for kind, each in found.items()},
        (sum(not ratio <= 1.5 for ratio in missing), max(missing, default=0.0)),
        learner.events,
        [float(np.sqrt(np.mean(tenth))) for tenth in np.array_split(clean, 10)],
    )


def _segments(
    on: Subject, seed: int, count: int
) -> Iterator[tuple[int, Array, Array, Array, Array, list[tuple[str, int]]]]:
    """Number of the first sample, clean and poisoned samples, kind and end of each burst."""
    for start in range(0, count, SEGMENT):
        own = min(SEGMENT, count - start)
        (x, y), ends = on.samples(seed, start, own), []
        draw = np.random.default_rng((seed, start, 2) if start else (seed, 1))
        wrong_x, wrong_y = x.copy(), y.copy()
        begin = RECOVERY if start else _BEGIN
        while begin + LONGEST + 2 * RECOVERY < own:
            end = begin + int(draw.integers(1, LONGEST + 1))
            kind = str(draw.choice(list(KINDS)))
            KINDS[kind](draw, on, wrong_x[begin:end], wrong_y[begin:end])
            ends.append((kind, end))
            begin = end + 2 * RECOVERY + int(draw.integers(1, _REST))
        yield start, x, y, wrong_x, wrong_y, ends


NOISE_MODELS: dict[str, dict[str, Any]] = {
    "EM": {"noise_estimation": NoiseEstimation(3000)},  # some ten wingbeats of the joints
    "Misfit": {"misfit": Misfit()},
}
"""Ways in which a learner finds its noise, by name."""

LEARNER_KINDS = {"cubature": CubatureLearner, "extended": ExtendedLearner}
LEARNERS: tuple[dict[str, Any], ...] = (
    *(
        {"learner": "cubature", "covariance": structure, "dtype": dtype}
        for structure, dtype in product(STRUCTURES, ("float64", "float32"))
    ),
    *({"learner": "extended", "covariance": structure} for structure in STRUCTURES),
    {"learner": "extended", "covariance": "full", "of": "wings"},
)
"""Settings of the learners that are poisoned; `wings` has the default network and filter."""


def poison_row(options: dict[str, Any], noise: str, seed: int, count: int) -> dict[str, Any]:
    """JSON-able result of a screened learner that is poisoned.

    Args:
        options: Its settings, one of `LEARNERS`.
        noise: How it finds its noise, one of `NOISE_MODELS`.
        seed: Seed of the flight and of the poison.
        count: Number of samples.
    """
    own, chosen = NOISE_MODELS[noise], {**options}
    kind = LEARNER_KINDS[chosen.pop("learner", "cubature")]
    of = chosen.pop("of", "joints")
    if of == "joints":
        chosen["prior_share"] = 1e-4  # the default network has a prior of its own, and no share
    screening = Screening(stuck_samples=10)
    learner = kind(subject(of).network, screening=screening, **chosen, **own)
    found = poisoned(learner, seed, count, of)
    return {"learner": ", ".join([*options.values(), noise]), **found._asdict()}

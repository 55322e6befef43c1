"""Bursts of samples that no sensor should give, and a second learner that does not get them.

A robot of three joints flaps, with a force that a random network makes of angles and rates. Every
few hundred samples comes a burst of one kind of poison. The twin learns the same samples without
it. Neglected: faults of the clock, which `campaign` has.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from patagium.errors import PatagiumError
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.settings import Misfit, NoiseEstimation, Screening
from patagium_lab.attack.campaign import STRUCTURES

Array = NDArray[np.float64]

JOINTS, OUTPUTS, STEP, NOISE = 3, 2, 1e-3, 0.02
RECOVERY = 100
"""Clean samples after a burst before the error is compared, and over which it is."""
LONGEST = 50
"""Samples of the longest burst."""
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
    events: dict[str, int]
    clean: list[float]


def network() -> DenseNetwork:
    """Network that learns the force, of the inputs' scales."""
    speed = np.full(JOINTS, 30.0)
    return DenseNetwork(
        2 * JOINTS, (6,), OUTPUTS, input_scale=np.concatenate([np.ones(JOINTS), speed])
    )


def flight(seed: int, count: int) -> tuple[Array, Array]:
    """Angles and rates of the joints, (N, 6) [rad, rad/s], and forces measured, (N, 2) [N].

    Args:
        seed: Seed of the force, the gait and the noise.
        count: Number of samples, one a millisecond.
    """
    draw = np.random.default_rng(seed)
    time, frequency = STEP * np.arange(count)[:, None], np.array([4.0, 5.3, 2.9])
    rate = 2 * np.pi * frequency
    phase = rate * time + draw.uniform(0, 2 * np.pi, JOINTS) + 0.7 * np.sin(time)
    x = np.hstack([0.7 * np.sin(phase), 0.7 * (rate + 0.7 * np.cos(time)) * np.cos(phase)])
    inner = x / np.repeat([1.0, 30.0], JOINTS) @ draw.normal(size=(2 * JOINTS, 5))
    y = np.tanh(inner) @ draw.normal(size=(5, OUTPUTS))
    return x, y + NOISE * draw.normal(size=y.shape)


Poison = Callable[[np.random.Generator, Array, Array], None]


def _spikes(draw: np.random.Generator, values: Array) -> None:
    hit = draw.random(values.shape) < 0.5
    hit[:, draw.integers(values.shape[1])] = True
    size = 10.0 ** draw.uniform(1.0, 300.0, values.shape) * draw.choice([-1.0, 1.0], values.shape)
    values[hit] = size[hit]


def _nonsense(draw: np.random.Generator, values: Array) -> None:
    hit = draw.random(values.shape) < 0.5
    values[hit] = draw.choice([np.nan, np.inf, -np.inf], values.shape)[hit]


def _jump(draw: np.random.Generator, x: Array) -> None:
    k = draw.integers(JOINTS)
    x[:, k] += np.where(x[:, k] > 0, -0.6, 0.6)


def _collinear(draw: np.random.Generator, x: Array, y: Array) -> None:
    share = draw.uniform(-1.0, 1.0, (len(x), 1))
    x[:], y[:] = share * x[0], share * y[0]


def _zero(draw: np.random.Generator, x: Array, y: Array) -> None:
    x[:], y[:] = 0.0, 0.0


def _swapped(draw: np.random.Generator, x: Array, y: Array) -> None:
    x[:], y[:] = x[:, ::-1].copy(), y[:, ::-1].copy()


def _stuck(draw: np.random.Generator, values: Array) -> None:
    k = draw.integers(values.shape[1])
    values[:, k] = values[0, k]


KINDS: dict[str, Poison] = {
    "spikes of inputs": lambda draw, x, y: _spikes(draw, x),
    "spikes of outputs": lambda draw, x, y: _spikes(draw, y),
    "inputs not numbers": lambda draw, x, y: _nonsense(draw, x),
    "outputs not numbers": lambda draw, x, y: _nonsense(draw, y),
    "encoder jump": lambda draw, x, y: _jump(draw, x),
    "stuck input": lambda draw, x, y: _stuck(draw, x),
    "stuck output": lambda draw, x, y: _stuck(draw, y),
    "collinear": _collinear,
    "zero": _zero,
    "swapped": _swapped,
}
"""Kinds of poison: what they make of the samples of a burst."""


def poisoned(learner: FilterLearner, seed: int, count: int) -> Poisoned:
    """Result of a learner of `network()` on a flight of so many samples, poisoned in bursts.

    Args:
        learner: The learner, before any sample; it is changed.
        seed: Seed of the flight and of the poison.
        count: Number of samples, those of the bursts included.
    """
    x, y = flight(seed, count)
    draw, twin, errors = np.random.default_rng((seed, 1)), deepcopy(learner), np.zeros((2, count))
    wrong_x, wrong_y, ends = x.copy(), y.copy(), []
    begin = _BEGIN
    while begin + LONGEST + 2 * RECOVERY < count:
        end = begin + int(draw.integers(1, LONGEST + 1))
        kind = str(draw.choice(list(KINDS)))
        KINDS[kind](draw, wrong_x[begin:end], wrong_y[begin:end])
        ends.append((kind, end))
        begin = end + 2 * RECOVERY + int(draw.integers(1, _REST))
    crash = ""
    try:
        for k in range(count):
            time = STEP * k
            errors[1, k] = _error(twin.update(x[k], y[k], time))
            errors[0, k] = _error(learner.update(wrong_x[k], wrong_y[k], time))
    except (ArithmeticError, ValueError, PatagiumError) as problem:
        crash = f"sample {k}: {type(problem).__name__}: {problem}"
    unlearned = sum(learner.events[name] for name in UNLEARNED)
    found: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for kind, end in ends:
        window = slice(end + RECOVERY, end + 2 * RECOVERY)
        own, other = (np.sqrt(np.nanmean(error[window])) for error in errors)
        found[kind].append(float(own / other))
    return Poisoned(
        count,
        {kind: len(each) for kind, each in found.items()},
        crash,
        0 if crash else count - learner.count - unlearned,
        {kind: max(each, default=0.0) for kind, each in found.items()},
        {kind: sum(not ratio <= 1.5 for ratio in each) for kind, each in found.items()},
        {kind: sum(ratio < 1 / 1.5 for ratio in each) for kind, each in found.items()},
        learner.events,
        [float(np.sqrt(np.nanmedian(tenth))) for tenth in np.array_split(errors[1], 10)],
    )


NOISE_MODELS: dict[str, dict[str, Any]] = {
    "EM": {"noise_estimation": NoiseEstimation(300)},
    "Misfit": {"misfit": Misfit()},
}
"""Ways in which a learner finds its noise, by name."""

LEARNER_KINDS = {"cubature": CubatureLearner, "extended": ExtendedLearner}
LEARNERS: tuple[dict[str, Any], ...] = (
    *(
        {"learner": "cubature", "covariance": structure, "dtype": dtype}
        for structure, dtype in product(STRUCTURES, ("float64", "float32"))
    ),
    *(
        {"learner": "cubature", "covariance": "full", "dtype": dtype, "spread": 1.0}
        for dtype in ("float64", "float32")
    ),
    {"learner": "extended", "covariance": "full"},
)
"""Settings of the learners that are poisoned; `spread` brings the cubature points near."""


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
    screening = Screening(stuck_samples=10)
    learner = kind(network(), prior_share=1e-4, screening=screening, **chosen, **own)
    found = poisoned(learner, seed, count)
    words = [f"{name} {value}" if name == "spread" else value for name, value in options.items()]
    return {"learner": ", ".join([*words, noise]), **found._asdict()}


def _error(innovation: Array) -> float:
    """Mean square of the innovations that there are; NaN where nothing was learned."""
    known = np.isfinite(innovation)
    return float(np.mean(innovation[known] ** 2)) if known.any() else float("nan")

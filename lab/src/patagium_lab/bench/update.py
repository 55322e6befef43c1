"""Times of an update: full covariance, noise between samples.

One update stands beside Algorithm 1 and beside the arithmetic that it cannot avoid. All take turns,
some calls each, so that a busy machine slows all; times are medians of the processor's time.
Neglected: cold caches, since a learner at flight rate does nothing else.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Mapping
from itertools import cycle, pairwise
from time import process_time_ns
from typing import Any

import numpy as np

from patagium.arrays import Array
from patagium.learning.filters.block_kernel import structure_and_kernel
from patagium.learning.filters.numbers import filter_numbers
from patagium.learning.filters.weight_filter import WeightFilter
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.models.network import Network
from patagium.learning.models.strip import StripNetwork
from patagium.learning.settings import (
    FilterSettings,
    NoiseEstimation,
    Screening,
    Structure,
)
from patagium.native import load_kernel
from patagium.robot.model import Robot
from patagium_lab.bench.dynamics import random_states
from patagium_lab.bench.result import Result, compared
from patagium_lab.kernels import KERNELS
from patagium_lab.rivals.algorithm_1 import Algorithm1

Call = Callable[[], object]

PRIOR, NOISE = 0.3, 0.003
_PLAIN: dict[str, Any] = {"prior_std": PRIOR, "measurement_std": NOISE, "spread": 3**0.5}
_NOISE_BETWEEN: dict[str, Any] = {
    "prior_share": 1e-5,
    "process_std": 1e-4,
    "noise_estimation": NoiseEstimation(100),
    "screening": Screening(),
}
_NOISY: tuple[tuple[str, Structure], ...] = (
    *(("extended", structure) for structure in ("full", "layer")),
    *(("cubature", structure) for structure in ("full", "layer", "node")),
)
_ROUNDS, _LINKS = 9, 40_000
_FLOOR_NOTE = (
    "floor: multiplications with additions of S Z and of the change of S, {0}, and of the network "
    "at the points, each done once at the peak rate of this core in this precision, measured in "
    "the same run; recursion, moments, activations and memory for nothing"
)
_SHAPES = {"square": "n^2 n_y each", "triangular": "n (n + 1) / 2 n_y each"}


def full_covariance_results(robot: Robot) -> Iterator[Result]:
    """The paper's network on the whole state: both precisions beside Algorithm 1 and the floor.

    Args:
        robot: A floating machine with wings.

    Yields:
        Ratios to Algorithm 1 line by line in NumPy, to Algorithm 1 without what may be left
        out of it, and to the arithmetic floors, on one BLAS thread.
    """
    n = robot.dof
    network = DenseNetwork(2 * n, (20,), robot.dof_names)
    plain = Algorithm1(network, PRIOR / np.sqrt(network.fan_in), np.full(n, NOISE**2))
    learners = {
        "float64": CubatureLearner(network, prior_std=PRIOR, measurement_std=NOISE),
        "float32": CubatureLearner(
            network, prior_std=PRIOR, measurement_std=NOISE, dtype="float32"
        ),
        "cholesky": CubatureLearner(
            network, prior_std=PRIOR, measurement_std=NOISE, square_root="cholesky"
        ),
    }
    updates = {"plain": plain.update} | {name: one.update for name, one in learners.items()}
    calls = {name: (on_samples(robot, update), 3) for name, update in updates.items()}
    calls["float64"], calls["float32"] = ((calls[name][0], 25) for name in ("float64", "float32"))
    peaks = {name: (lambda name=name: peak_time(name), 3) for name in ("float64", "float32")}
    for _ in range(3):
        for call, _ in calls.values():
            call()
    difference = np.abs(learners["float64"].weights - plain.mean).max()
    times, unit_times = in_turns(calls, peaks)
    for dtype in ("float64", "float32"):
        name = f"update of full covariance, {network.size} weights, {dtype}"
        note = f"numbers agree to {difference:.0e}; Python calls, everything included"
        yield compared(
            name, times[dtype], "ns", "Algorithm 1, line by line in NumPy", times["plain"], note
        )
        yield compared(
            name, times[dtype], "ns", "Algorithm 1 (cholesky of ours)", times["cholesky"], note
        )
        for shape, count in _SHAPES.items():
            floor = multiply_adds(network, shape) * unit_times[dtype]
            against, note = f"arithmetic floor, S {shape}", _FLOOR_NOTE.format(count)
            yield compared(name, times[dtype], "ns", against, floor, note)


def noise_results(robot: Robot) -> Iterator[Result]:
    """Time of an update with prior share, process noise and noise estimation, over that without.

    Args:
        robot: A machine with strips.

    Yields:
        A row for each network, learner and covariance structure that a kernel learns.
    """
    n = robot.dof
    networks = {
        "linear 11-12, 144 weights": DenseNetwork(11, (), 12),
        "strip 2-8-8-2, 114 weights": StripNetwork(robot),
        "strip 2-11-11-2, 189 weights": StripNetwork(robot, hidden=(11, 11)),
        "dense 8-20-14, 474 weights": DenseNetwork(8, (20,), robot.dof_names),
        f"dense {2 * n}-20-{n}, 874 weights": DenseNetwork(2 * n, (20,), robot.dof_names),
    }
    for name, network in networks.items():
        for learner, covariance in _NOISY:
            filters = {
                which: _filter(network, learner, FilterSettings(covariance=covariance, **settings))
                for which, settings in (("with", _PLAIN | _NOISE_BETWEEN), ("without", _PLAIN))
            }
            calls = {
                which: (on_samples(robot, _cut(one, network)), 12) for which, one in filters.items()
            }
            times, _ = in_turns(calls, {})
            words = describe_covariance(covariance)
            yield compared(
                f"update with noise between samples, {name}, {words}, {learner}", times["with"],
                "ns", "without", times["without"], "prior share, process noise, noise estimation",
            )  # fmt: skip


def _cut(filter_: WeightFilter, network: Network) -> Callable[[Array, Array], object]:
    """Update of a filter whose network takes the first inputs and gives the first outputs."""
    return lambda x, y: filter_.update(x[: network.inputs], y[: network.outputs])


def describe_covariance(structure: Structure) -> str:
    """Covariance structure in words.

    Args:
        structure: As a setting has it.
    """
    return {"full": "full covariance", "layer": "by layer", "node": "by neuron"}[structure]


def _filter(network: Network, learner: str, settings: FilterSettings) -> WeightFilter:
    numbers = filter_numbers(network, settings, learner)
    return WeightFilter(numbers, structure_and_kernel(numbers), network.initial(0))


def multiply_adds(network: DenseNetwork, shape: str) -> int:
    """Multiplications with additions that an update of the square root S cannot avoid.

    With n weights and n_y outputs, S Z and the change of S take 2 n^2 n_y, half of it where S
    is triangular. At the two points of a column of a triangular S its own layer takes one for
    each of the column's entries there, every later layer two a weight and point, to move it
    and to apply it; for a square S no more is counted.

    Args:
        network: Whose weights are estimated.
        shape: Of S, "square" or "triangular".
    """
    sizes = [(below + 1) * above for below, above in pairwise(network.perceptron.widths)]
    points = sum(
        size * (size + 1) // 2 + size * 4 * sum(sizes[layer + 1 :])
        for layer, size in enumerate(sizes)
    )
    rows = 2 * network.size if shape == "square" else network.size + 1
    return network.size * rows * network.outputs + points


def peak_time(dtype: str, links: int = _LINKS) -> float:
    """Time of one multiplication with addition at the peak rate of a core [ns].

    Without a compiler that of a product of matrices in NumPy's BLAS.

    Args:
        dtype: "float64" or "float32".
        links: Length of the chains timed.
    """
    single = dtype == "float32"
    kernel = load_kernel(
        "peak", {"REAL": "float" if single else "double", "SINGLE": int(single)}, KERNELS
    )
    if kernel is None:
        matrix = np.ones((400, 400), dtype)
        started = process_time_ns()
        np.matmul(matrix, matrix)
        return (process_time_ns() - started) / 400**3
    kernel.peak_time.restype = ctypes.c_double
    total = ctypes.c_double()
    return float(kernel.peak_time(links, ctypes.c_double(0.999), ctypes.byref(total)))


def on_samples(robot: Robot, update: Callable[[Array, Array], object], count: int = 64) -> Call:
    """A call of an update that takes the next of some random samples each time.

    Args:
        robot: A machine, whose states are the inputs.
        update: A learner's.
        count: How many samples.
    """
    states = random_states(robot, count)
    y = 0.01 * np.random.default_rng(1).normal(size=(count, robot.dof))
    turn = cycle(zip(np.hstack([states.q, states.v]), y, strict=True))
    return lambda: update(*next(turn))


def in_turns(
    calls: Mapping[str, tuple[Call, int]],
    figures: Mapping[str, tuple[Callable[[], float], int]],
    rounds: int = _ROUNDS,
) -> tuple[dict[str, float], dict[str, float]]:
    """Median time of each call [ns] and median of each figure, all taking turns.

    Args:
        calls: Name to a call and how often it is called a turn; the first call of a turn
            finds the caches as its predecessor left them and does not count.
        figures: Name to what measures a figure itself, and how often a turn.
        rounds: How often each has its turn.
    """
    times: dict[str, list[float]] = {name: [] for name in calls}
    found: dict[str, list[float]] = {name: [] for name in figures}
    for _ in range(rounds):
        for name, (call, count) in calls.items():
            call()
            for _ in range(count - 1):
                started = process_time_ns()
                call()
                times[name].append(process_time_ns() - started)
        for name, (figure, count) in figures.items():
            found[name] += [figure() for _ in range(count)]
    return (
        {name: float(np.median(values)) for name, values in times.items()},
        {name: float(np.median(values)) for name, values in found.items()},
    )

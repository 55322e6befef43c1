"""Very long runs: a glide that excites few weights, and ten million updates in float32."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np

from patagium.arrays import Array
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.models.dense import DenseNetwork
from patagium.native import load_kernel
from patagium_lab.attack.network import is_definite
from patagium_lab.kernels import KERNELS
from patagium_lab.reproduction.cases import SPREAD

GLIDE = 1_000_000
UPDATES = 10_000_000
LOOKS = 100
"""Number of times that the covariance is checked."""
SHARE = 1e-5
"""Share of the prior, which gives a memory of 1e5 samples."""
TURN = 500
"""Updates between two changes of the network that is learned."""
_NOISE = 0.05


def steady_glide(samples: int = GLIDE, share: float = SHARE) -> dict[str, Any]:
    """Figures of one state repeated with noise, which excites few directions of the weights.

    Args:
        samples: Number of samples.
        share: Share of the prior that is mixed in before each sample.

    Returns:
        samples, share; largest and smallest of the diagonal of P over that of the prior;
        below_prior, whether all of it stayed there at every look.
    """
    learner = _learner(DenseNetwork(4, (8,), 3), "float64", share)
    prior = learner.variances
    x, truth = np.array([0.3, -0.2, 0.5, 0.1]), np.array([0.2, -0.1, 0.4])
    draw, largest = np.random.default_rng(0), 0.0
    for _ in range(LOOKS):
        noise = _NOISE * draw.normal(size=(samples // LOOKS, 3))
        for y in truth + noise:
            learner.update(x, y)
        largest = max(largest, float((learner.variances / prior).max()))
    return {
        "samples": learner.count,
        "share": share,
        "largest": largest,
        "smallest": float((learner.variances / prior).min()),
        "below_prior": largest < 1.0 + 1e-12,
    }


def single_precision(
    updates: int = UPDATES, progress: Callable[[float], None] | None = None
) -> dict[str, Any]:
    """Figures of learning a slowly changing network in float32 and in float64.

    The compiled filter is called as a flight computer would call it. An update that finds its
    covariance indefinite gives an outcome other than zero.

    Args:
        updates: Number of updates in each precision.
        progress: Receives the part of the work that is done.

    Returns:
        updates; refused: outcomes other than zero by precision; error: mean square error over
        the variance of the truth by precision; ratio of the two; definite: whether float32's
        covariance had a Cholesky factor at every look.
    """
    network = DenseNetwork(4, (6,), 2)
    learners: dict[str, CubatureLearner] = {
        "float64": _learner(network, "float64", SHARE),
        "float32": _learner(network, "float32", SHARE),
    }
    found: dict[str, dict[str, float]] = {name: {"refused": 0, "error": 0.0} for name in learners}
    draw, definite, variance = np.random.default_rng(1), True, 0.0
    length = TURN * max(1, updates // (TURN * LOOKS))
    for look in range(LOOKS):
        x = draw.normal(size=(length, 4))
        truth = _turning(network, x, (look + np.arange(0, 1, TURN / length)) / LOOKS)
        y = truth + _NOISE * draw.normal(size=truth.shape)
        variance += float(truth.var()) / LOOKS
        for name, learner in learners.items():
            refused, error = _run(learner, x, y, truth)
            found[name]["refused"] += refused
            found[name]["error"] += error / LOOKS
        definite = definite and is_definite(learners["float32"])
        if progress is not None:
            progress((look + 1) / LOOKS)
    errors = {name: each["error"] / variance for name, each in found.items()}
    return {
        "updates": length * LOOKS,
        "refused": {name: int(each["refused"]) for name, each in found.items()},
        "error": errors,
        "ratio": errors["float32"] / errors["float64"],
        "definite": definite,
    }


def _turning(network: DenseNetwork, x: Array, turns: Array) -> Array:
    """Outputs of a network whose weights turn between two sets, (N, n_y) [1]."""
    ends = network.initial(5), network.initial(6)
    angles = 2 * np.pi * turns
    parts = zip(np.array_split(x, len(turns)), np.cos(angles), np.sin(angles), strict=True)
    return np.vstack([network.evaluate(p, c * ends[0] + s * ends[1]) for p, c, s in parts])


def _learner(network: DenseNetwork, dtype: str, share: float) -> CubatureLearner:
    return CubatureLearner(
        network,
        prior_std=0.5,
        measurement_std=_NOISE,
        spread=SPREAD,
        dtype=dtype,
        covariance="node",
        prior_share=share,
    )


def _run(learner: CubatureLearner, x: Array, y: Array, truth: Array) -> tuple[int, float]:
    """Refused updates and mean square error of what was predicted."""
    compiled, kernel = learner.compiled, load_kernel("drive", folder=KERNELS)
    guess = np.empty_like(y)
    if compiled is None or kernel is None:
        for k in range(len(x)):
            guess[k] = y[k] - learner.update(x[k], y[k])
        return 0, float(np.mean((guess - truth) ** 2))
    compiled.stamp[0] = np.nan
    kernel.drive.restype = ctypes.c_int64
    sizes = (ctypes.c_int64(size) for size in (len(x), x.shape[1], y.shape[1]))
    arrays = (x, y, compiled.x, compiled.y, compiled.mean, guess)
    addresses = (ctypes.c_void_p(array.ctypes.data) for array in arrays)
    start = ctypes.c_void_p(compiled.update), ctypes.c_void_p(compiled.memory)
    refused = int(kernel.drive(*start, *sizes, *addresses))
    return refused, float(np.mean((guess - truth) ** 2))

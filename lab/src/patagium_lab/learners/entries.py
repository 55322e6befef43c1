"""Entries of the comparison: our learners and those of other programs, and their free settings.

Every row of the page is an `Entry`: a learner, its network, and the settings that a search may
choose within ranges that are the same for all. An entry that is the same filter as another to
rounding, or the same filter in single precision, takes the settings of its twin.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from math import exp
from typing import Any, Protocol

import numpy as np

from patagium.arrays import Array
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.settings import NoiseEstimation
from patagium_lab.learners.data_sets import DataSet
from patagium_lab.rivals.gradient_learner import GradientLearner
from patagium_lab.rivals.linear_learner import LinearLearner

Settings = Mapping[str, float]

RANK = 10
FEATURES = 100
REPLAY = 8
SPANS = {
    "prior": (0.03, 3.0),
    "noise": (1e-4, 0.3),
    "memory": (1_000.0, 1_000_000.0),
    "spread": (0.3, 30.0),
    "rate": (1e-4, 0.1),
    "wander": (1e-4, 0.1),
    "gain": (0.05, 2.0),
}
"""Ranges of the free settings, searched on a logarithmic scale.

prior: prior standard deviation of the weights, times 1/sqrt(fan-in); noise: measurement standard
deviation over the scale of the output; memory [samples]; spread: spread of the points [standard
deviations]; rate: step size of the gradient; wander: process standard deviation of a weight
between two samples over its prior; gain: factor on pytagi's own prior."""


class AnyLearner(Protocol):
    """A learner of any program."""

    def update(self, x: Array, y: Array) -> object:
        """Learn one sample, x (n_x,), y (n_y,)."""
        ...

    def predict(self, x: Array) -> Array:
        """Predicted y of many x, (N, n_y) [as y]."""
        ...

    def std(self, x: Array) -> Array:
        """Predicted standard deviation of a measurement at x, (n_y,) [as y], or NaN."""
        ...


class OurLearner:
    """A learner of ours.

    Args:
        learner: The learner.
    """

    def __init__(self, learner: Learner) -> None:
        self.learner = learner
        self.update = learner.update

    def predict(self, x: Array) -> Array:
        """Predicted y of many x by the present weights, (N, n_y) [as y]."""
        return self.learner.network.evaluate(x, self.learner.weights)

    def std(self, x: Array) -> Array:
        """Predicted standard deviation of a measurement at x, (n_y,) [as y]."""
        return np.sqrt(np.diagonal(self.learner.predict(x)[1]))


class HeldSample:
    """Persistence: the last used sample is the prediction.

    Args:
        outputs: Number of outputs, n_y.
    """

    def __init__(self, outputs: int) -> None:
        self._held = np.zeros(outputs)

    def update(self, x: Array, y: Array) -> None:
        """Keep y as the prediction."""
        self._held = y

    def predict(self, x: Array) -> Array:
        """The last used sample for each x, (N, n_y) [as y]."""
        return np.tile(self._held, (len(x), 1))

    def std(self, x: Array) -> Array:
        """NaN, because there is no interval, (n_y,)."""
        return np.full(len(self._held), np.nan)


Build = Callable[[DataSet, Settings, int], AnyLearner]


@dataclass(frozen=True)
class Entry:
    """A row of the page.

    Attributes:
        key: Short name.
        title: Name on the page.
        build: Gives the learner for a data set, settings and a seed.
        network: Key of the network of the data set; empty without one.
        knobs: Free settings, keys of `SPANS`.
        package: Distribution of the program.
        module: Module that must be importable.
        twin: Key of the entry whose settings it takes; empty if it has its own.
    """

    key: str
    title: str
    build: Build
    network: str = "dense"
    knobs: tuple[str, ...] = ()
    package: str = "patagium"
    module: str = "patagium"
    twin: str = ""

    def weights(self, data: DataSet) -> int:
        """Number of weights that are learned.

        Args:
            data: Data set.
        """
        if self.key == "features":
            return (FEATURES + 1) * len(data.scale)
        return data.network(self.network).size if self.network else 0

    @property
    def installed(self) -> bool:
        """Whether the program is installed."""
        return find_spec(self.module) is not None

    @property
    def same(self) -> bool:
        """Whether it is the filter of its twin to rounding, by another program."""
        return bool(self.twin) and (self.package != "patagium" or self.key == "algorithm1")

    @property
    def program(self) -> str:
        """Distribution and version of the program."""
        try:
            return f"{self.package} {version(self.package)}"
        except PackageNotFoundError:
            return self.package


def _assumed(data: DataSet, settings: Settings) -> dict[str, Any]:
    """Prior, noise and forgetting factor of a filter."""
    return {
        "prior_std": settings["prior"],
        "measurement_std": settings["noise"] * data.scale,
        "forgetting_factor": exp(-1.0 / settings["memory"]),
    }


def _cubature(network: str = "dense", **fixed: Any) -> Build:
    def build(data: DataSet, settings: Settings, seed: int) -> AnyLearner:
        chosen = {**_assumed(data, settings), "spread": settings.get("spread"), "seed": seed}
        return OurLearner(CubatureLearner(data.network(network), **{**chosen, **fixed}))

    return build


def _bounded(**fixed: Any) -> Build:
    """One block a neuron, with the prior mixed in before each sample instead of forgetting."""

    def build(data: DataSet, settings: Settings, seed: int) -> AnyLearner:
        share = 1.0 / settings["memory"]
        node = _cubature(covariance="node", forgetting_factor=1.0, prior_share=share, **fixed)
        return node(data, settings, seed)

    return build


def _extended(data: DataSet, settings: Settings, seed: int) -> AnyLearner:
    return OurLearner(ExtendedLearner(data.network("dense"), seed=seed, **_assumed(data, settings)))


def _gradient(replay: int) -> Build:
    def build(data: DataSet, settings: Settings, seed: int) -> AnyLearner:
        rate, network = settings["rate"], data.network("dense")
        return OurLearner(GradientLearner(network, learning_rate=rate, replay=replay, seed=seed))

    return build


def _linear(features: int) -> Build:
    def build(data: DataSet, settings: Settings, seed: int) -> AnyLearner:
        network: Any = data.network("linear")
        assumed = _assumed(data, settings)
        return OurLearner(LinearLearner(network, features=features, seed=seed, **assumed))

    return build


def _persistence(data: DataSet, settings: Settings, seed: int) -> AnyLearner:
    return HeldSample(data.y.shape[1])


def _rival(module: str, name: str) -> Build:
    """Another program's filter of the dense network, with our prior, noise and memory."""

    def build(data: DataSet, settings: Settings, seed: int) -> AnyLearner:
        kind = getattr(import_module(f"patagium_lab.rivals.{module}"), name)
        learner: AnyLearner = kind(data.network("dense"), seed=seed, **_assumed(data, settings))
        return learner

    return build


def _rebayes(data: DataSet, settings: Settings, seed: int) -> AnyLearner:
    from patagium_lab.rivals.rebayes_low_rank import RebayesLowRank

    return RebayesLowRank(
        data.network("dense"),
        rank=RANK,
        prior_std=settings["prior"],
        measurement_std=settings["noise"] * data.scale,
        wandering=settings["wander"],
        seed=seed,
    )


def _pytagi(data: DataSet, settings: Settings, seed: int) -> AnyLearner:
    from patagium_lab.rivals.pytagi_network import PytagiNetwork

    network: Any = data.network("dense")
    noise = settings["noise"] * data.scale
    return PytagiNetwork(network, gain=settings["gain"], measurement_std=noise, seed=seed)


_FILTERPY = _rival("filterpy_cubature", "FilterpyCubature")
_STONESOUP = _rival("stonesoup_cubature", "StoneSoupCubature")
_DYNAMAX = _rival("dynamax_extended", "DynamaxExtended")
_FILTER = ("prior", "noise", "memory")
_POINTS = (*_FILTER, "spread")
_SINGLE = {"dtype": "float32"}
_NOISE = {"noise_estimation": NoiseEstimation(memory=200)}
_CUBATURE = "cubature filter, points at √n"
ENTRIES: tuple[Entry, ...] = (
    Entry("persistence", "last used sample held", _persistence, network=""),
    Entry("full", "cubature, full", _cubature(), knobs=_POINTS),
    Entry("full32", "cubature, full, single", _cubature(**_SINGLE), twin="full"),
    Entry("rule", "cubature, full, points at √n", _cubature(), knobs=_FILTER),
    Entry(
        "algorithm1",
        "Algorithm 1 of the paper, NumPy",
        _cubature(square_root="cholesky"),
        twin="rule",
    ),
    Entry("layer", "cubature, by layer", _cubature(covariance="layer"), knobs=_POINTS),
    Entry("layer32", "cubature, by layer, single", _cubature(covariance="layer", **_SINGLE),
          twin="layer"),
    Entry("node", "cubature, by neuron", _cubature(covariance="node"), knobs=_POINTS),
    Entry("node32", "cubature, by neuron, single", _cubature(covariance="node", **_SINGLE),
          twin="node"),
    Entry("bounded", "cubature, by neuron, bounded memory", _bounded(), knobs=_POINTS),
    Entry("estimated", "cubature, by neuron, bounded, noise estimated", _bounded(**_NOISE),
          knobs=_POINTS),
    Entry("extended", "extended filter, compiled", _extended, knobs=_FILTER),
    Entry("strip", "strip network, cubature, full", _cubature("strip"), "strip", knobs=_POINTS),
    Entry("strip32", "strip network, cubature, full, single", _cubature("strip", **_SINGLE),
          "strip", twin="strip"),
    Entry("strip_estimated", "strip network, cubature, full, noise estimated",
          _cubature("strip", **_NOISE), "strip", knobs=_POINTS),
    Entry("gradient", "gradient (Adam), one step a sample", _gradient(0), knobs=("rate",)),
    Entry("replay", f"gradient (Adam), {REPLAY} samples replayed", _gradient(REPLAY),
          knobs=("rate",)),
    Entry("linear", "least squares, linear", _linear(0), "linear", knobs=_FILTER),
    Entry("features", f"least squares, {FEATURES} random features", _linear(FEATURES), "linear",
          knobs=_FILTER),
    Entry("filterpy", _CUBATURE, _FILTERPY, package="filterpy", module="filterpy", twin="rule"),
    Entry("stonesoup", _CUBATURE, _STONESOUP, package="stonesoup", module="stonesoup",
          twin="rule"),
    Entry("dynamax", "extended filter", _DYNAMAX, package="dynamax", module="dynamax",
          twin="extended"),
    Entry("rebayes", f"low-rank extended filter (LoFi), rank {RANK}", _rebayes,
          package="rebayes-mini", module="rebayes_mini", knobs=("prior", "noise", "wander")),
    Entry("pytagi", "TAGI, one sample a step", _pytagi, package="pytagi", module="pytagi",
          knobs=("gain", "noise")),
)  # fmt: skip
"""Every entry, in the order of the page."""


def entries_of(data: DataSet) -> tuple[Entry, ...]:
    """Entries that can learn a data set; a quadrotor has no strips.

    Args:
        data: Data set.
    """
    return tuple(e for e in ENTRIES if not e.network or e.network in data.networks)


def entry(key: str) -> Entry:
    """Entry of a key.

    Args:
        key: Key of an entry.
    """
    return next(one for one in ENTRIES if one.key == key)

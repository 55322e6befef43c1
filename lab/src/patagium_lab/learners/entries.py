"""Who takes part: our learners and other programs', and what of each may be chosen.

Every row of the page is an `Entry`: a learner, its network, and the numbers a search may
choose within spans that are the same for all. An entry that is the same filter as another to
rounding, or the same in single precision, takes what was chosen for its twin.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from math import exp
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.gradient import GradientLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.learners.linear import LinearLearner
from patagium.learning.settings import LowRank, NoiseEstimation
from patagium_lab.learners.data_sets import Course

Array = NDArray[np.float64]
Setting = Mapping[str, float]

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
"""What may be chosen, on a logarithmic scale: deviation of the weights beforehand (times
1/sqrt(fan-in)); deviation of the measurement, in scales of the output; samples remembered;
spread of the points in deviations; step of the gradient; wandering of a weight between two
samples, in its prior deviations; factor on pytagi's own prior."""


class Entrant(Protocol):
    """A learner at work."""

    def update(self, x: Array, y: Array) -> object:
        """Learn one sample, x (n_x,), y (n_y,)."""
        ...

    def predict(self, x: Array) -> Array:
        """y of many x by what is known now, (N, n_y)."""
        ...

    def std(self, x: Array) -> Array:
        """Predicted standard deviation of a measurement at x, (n_y,); nan for none."""
        ...


class OurEntrant:
    """A learner of ours.

    Args:
        learner: The learner.
    """

    def __init__(self, learner: Learner) -> None:
        self.learner = learner
        self.update = learner.update

    def predict(self, x: Array) -> Array:
        """y of many x by the present weights, (N, n_y)."""
        return self.learner.network.evaluate(x, self.learner.weights)

    def std(self, x: Array) -> Array:
        """Predicted standard deviation of a measurement at x, (n_y,)."""
        return np.sqrt(np.diagonal(self.learner.predict(x)[1]))


class HeldSample:
    """Persistence: the last used sample, held.

    Args:
        outputs: n_y.
    """

    def __init__(self, outputs: int) -> None:
        self._held = np.zeros(outputs)

    def update(self, x: Array, y: Array) -> None:
        """Hold y."""
        self._held = y

    def predict(self, x: Array) -> Array:
        """The held sample, (N, n_y)."""
        return np.tile(self._held, (len(x), 1))

    def std(self, x: Array) -> Array:
        """None."""
        return np.full(len(self._held), np.nan)


Build = Callable[[Course, Setting, int], Entrant]


@dataclass(frozen=True)
class Entry:
    """A row of the page.

    Attributes:
        key: Short name.
        title: What it is called.
        build: Makes it for a course, from what was chosen and a seed.
        network: Key of the course's network; empty without one.
        knobs: What may be chosen, of `SPANS`.
        package: Distribution it is from.
        module: Module that must be there.
        twin: Entry whose setting it takes; empty if it has its own.
    """

    key: str
    title: str
    build: Build
    network: str = "dense"
    knobs: tuple[str, ...] = ()
    package: str = "patagium"
    module: str = "patagium"
    twin: str = ""

    def weights(self, course: Course) -> int:
        """Number of weights it learns.

        Args:
            course: Where.
        """
        if self.key == "features":
            return (FEATURES + 1) * len(course.scale)
        return course.network(self.network).size if self.network else 0

    @property
    def installed(self) -> bool:
        """Whether its program is there."""
        return find_spec(self.module) is not None

    @property
    def same(self) -> bool:
        """Whether it is the same filter as its twin to rounding, by another program."""
        return bool(self.twin) and (self.package != "patagium" or self.key == "algorithm1")

    @property
    def program(self) -> str:
        """Its distribution and version."""
        try:
            return f"{self.package} {version(self.package)}"
        except PackageNotFoundError:
            return self.package


def _assumed(course: Course, setting: Setting) -> dict[str, Any]:
    """Prior, noise and memory as filters take them."""
    return {
        "prior_std": setting["prior"],
        "measurement_std": setting["noise"] * course.scale,
        "forgetting_factor": exp(-1.0 / setting["memory"]),
    }


def _cubature(network: str = "dense", **fixed: Any) -> Build:
    def build(course: Course, setting: Setting, seed: int) -> Entrant:
        chosen = {**_assumed(course, setting), "spread": setting.get("spread"), "seed": seed}
        return OurEntrant(CubatureLearner(course.network(network), **{**chosen, **fixed}))

    return build


def _bounded(**fixed: Any) -> Build:
    """By neuron, its prior mixed in before each sample in place of forgetting."""

    def build(course: Course, setting: Setting, seed: int) -> Entrant:
        share = 1.0 / setting["memory"]
        node = _cubature(covariance="node", forgetting_factor=1.0, prior_share=share, **fixed)
        return node(course, setting, seed)

    return build


def _extended(course: Course, setting: Setting, seed: int) -> Entrant:
    return OurEntrant(
        ExtendedLearner(course.network("dense"), seed=seed, **_assumed(course, setting))
    )


def _gradient(replay: int) -> Build:
    def build(course: Course, setting: Setting, seed: int) -> Entrant:
        rate, network = setting["rate"], course.network("dense")
        return OurEntrant(GradientLearner(network, learning_rate=rate, replay=replay, seed=seed))

    return build


def _linear(features: int) -> Build:
    def build(course: Course, setting: Setting, seed: int) -> Entrant:
        network: Any = course.network("linear")
        assumed = _assumed(course, setting)
        return OurEntrant(LinearLearner(network, features=features, seed=seed, **assumed))

    return build


def _persistence(course: Course, setting: Setting, seed: int) -> Entrant:
    return HeldSample(course.y.shape[1])


def _filterpy(course: Course, setting: Setting, seed: int) -> Entrant:
    from patagium_lab.rivals.filterpy_cubature import FilterpyCubature

    return FilterpyCubature(course.network("dense"), seed=seed, **_assumed(course, setting))


def _stonesoup(course: Course, setting: Setting, seed: int) -> Entrant:
    from patagium_lab.rivals.stonesoup_cubature import StoneSoupCubature

    return StoneSoupCubature(course.network("dense"), seed=seed, **_assumed(course, setting))


def _dynamax(course: Course, setting: Setting, seed: int) -> Entrant:
    from patagium_lab.rivals.dynamax_extended import DynamaxExtended

    return DynamaxExtended(course.network("dense"), seed=seed, **_assumed(course, setting))


def _rebayes(course: Course, setting: Setting, seed: int) -> Entrant:
    from patagium_lab.rivals.rebayes_low_rank import RebayesLowRank

    return RebayesLowRank(
        course.network("dense"),
        rank=RANK,
        prior_std=setting["prior"],
        measurement_std=setting["noise"] * course.scale,
        wandering=setting["wander"],
        seed=seed,
    )


def _pytagi(course: Course, setting: Setting, seed: int) -> Entrant:
    from patagium_lab.rivals.pytagi_network import PytagiNetwork

    network: Any = course.network("dense")
    noise = setting["noise"] * course.scale
    return PytagiNetwork(network, gain=setting["gain"], measurement_std=noise, seed=seed)


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
    Entry("low_rank", f"cubature, rank {RANK}", _cubature(covariance=LowRank(RANK)),
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
    Entry("filterpy", _CUBATURE, _filterpy, package="filterpy", module="filterpy", twin="rule"),
    Entry("stonesoup", _CUBATURE, _stonesoup, package="stonesoup", module="stonesoup",
          twin="rule"),
    Entry("dynamax", "extended filter", _dynamax, package="dynamax", module="dynamax",
          twin="extended"),
    Entry("rebayes", f"low-rank extended filter (LoFi), rank {RANK}", _rebayes,
          package="rebayes-mini", module="rebayes_mini", knobs=("prior", "noise", "wander")),
    Entry("pytagi", "TAGI, one sample a step", _pytagi, package="pytagi", module="pytagi",
          knobs=("gain", "noise")),
)  # fmt: skip
"""Everybody, in the order of the page."""


def entries_of(course: Course) -> tuple[Entry, ...]:
    """Who can take part in a course: a quadrotor has no strips.

    Args:
        course: The course.
    """
    return tuple(e for e in ENTRIES if not e.network or e.network in course.networks)


def entry(key: str) -> Entry:
    """The entry of a key.

    Args:
        key: Of `ENTRIES`.
    """
    return next(one for one in ENTRIES if one.key == key)

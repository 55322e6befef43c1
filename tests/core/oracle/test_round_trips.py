"""A learner that was saved, pickled or copied goes on bit for bit; threads, fork and asyncio."""

from __future__ import annotations

import asyncio
import copy
import os
import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import patagium as pt
from patagium.learning import (
    ChangeDetection,
    LinearStripNetwork,
    Misfit,
    NoiseEstimation,
    Screening,
)
from patagium.learning.learners.registry import LEARNERS
from patagium.learning.models.registry import _OWN as KINDS
from patagium.learning.settings import FilterSettings, settings_of
from patagium.robot import load_robot_text

ROBOT = pt.load_robot("aerobat")
SMALL = load_robot_text(ROBOT.source.replace("strips: 5", "strips: 2"))
NETWORKS: dict[str, Callable[[], Any]] = {
    "dense": lambda: pt.DenseNetwork(3, (4,), 2),
    "linear": lambda: pt.DenseNetwork(3, (), 2),
    "strips": lambda: pt.StripNetwork(ROBOT, (3,), measured=["x", "z"]),
    "linear strips": lambda: LinearStripNetwork(SMALL, measured=["x", "z"]),
    "robot's strips": lambda: LinearStripNetwork(SMALL, measured=["x", "z"]),
    "attached strips": lambda: LinearStripNetwork(SMALL, measured=["x", "z"], attached=True),
    "grey box": lambda: pt.GreyBox(
        pt.LiftingLine(SMALL), {"lags.rate[0]": 0.02, "section.lift_slope": 0.5},
        measured=["x", "z"],
    ),
}  # fmt: skip
OPTIONS: dict[str, dict[str, Any]] = {
    "plain": {"measurement_std": 0.1},
    "noise found": {"screening": Screening(), "noise_estimation": NoiseEstimation(30)},
    "misfit": {"misfit": Misfit(), "screening": Screening(3.0, 4)},
    "changes": {"change_detection": ChangeDetection(1e-2, 5, 12), "prior_share": 1e-3},
    "layer": {"covariance": "layer"},
    "node": {"covariance": "node"},
    "known": {"prior_std": 0.2, "process_std": 1e-4, "forgetting_factor": 0.999},
}
OF_CUBATURE = {"points": {"square_root": "cholesky", "spread": 1.7}}
CASES = [
    *((kind, net, option) for kind in ("cubature", "extended") for net in NETWORKS
      for option in OPTIONS),
    *(("cubature", net, option) for net in NETWORKS for option in OF_CUBATURE),
    *(("single", net, option) for net in ("dense", "linear", "strips")
      for option in ("plain", "node", "layer")),
]  # fmt: skip


def learner_of(kind: str, network: str, option: str) -> Any:
    single = {"dtype": "float32"} if kind == "single" else {}
    chosen = {**OPTIONS, **OF_CUBATURE}[option]
    made = LEARNERS["cubature" if kind == "single" else kind]
    return made(NETWORKS[network](), **{**chosen, **single})


def test_every_learner_network_and_setting_is_among_the_cases() -> None:
    """What is registered later must join `CASES`, or this fails."""
    seen: dict[str, set[str]] = {}
    kinds = set()
    for case in CASES:
        learner = learner_of(*case)
        kinds.add(learner.network.describe()["kind"])
        kind = "cubature" if case[0] == "single" else case[0]
        plain = FilterSettings()
        seen.setdefault(kind, set()).update(
            one.name
            for one in settings_of(kind)
            if getattr(learner.settings, one.name) != getattr(plain, one.name)
        )
    assert kinds == set(KINDS)
    assert set(seen) == set(LEARNERS)
    for kind, names in seen.items():
        of_kind = {one.name for one in settings_of(kind)}
        assert of_kind <= names, of_kind - names


def run(learner: Any, begin: int, end: int) -> list[Any]:
    """All that a learner says of samples, faults among them."""
    draw, told = np.random.default_rng(begin), []
    for k in range(begin, end):
        x = 0.3 * np.sin(0.3 * k + np.arange(learner.network.inputs))
        y = draw.normal(size=learner.network.outputs)
        y[k % 2] = np.nan if k % 11 == 5 else 1e200 if k % 11 == 7 else y[k % 2]
        x[0] = 1e50 if k % 13 == 6 else x[0]
        innovation = learner.update(x, y, 1e-3 * k)
        mean, covariance = learner.predict(np.full(len(x), 0.3))
        told += [innovation, mean, covariance, getattr(learner, "nis", 0.0)]
    return [*told, learner.weights, np.array(list(learner.events.values())), learner.variances]


@pytest.mark.parametrize(("kind", "network", "option"), CASES)
def test_copies_go_on_bit_for_bit(kind: str, network: str, option: str, tmp_path: Path) -> None:
    learner = learner_of(kind, network, option)
    run(learner, 0, 40)
    path = learner.save(tmp_path / "learner")
    ways = [pt.load_learner(path, learner), pickle.loads(pickle.dumps(learner))]
    ways.append(copy.deepcopy(learner))
    expected = run(learner, 40, 60)
    for other in ways:
        for one, two in zip(expected, run(other, 40, 60), strict=True):
            np.testing.assert_array_equal(two, one)


def test_eight_threads_with_a_learner_each_are_as_one() -> None:
    expected = run(learner_of("cubature", "dense", "noise found"), 0, 60)
    with ThreadPoolExecutor(8) as pool:
        learners = [learner_of("cubature", "dense", "noise found") for _ in range(8)]
        for found in pool.map(lambda learner: run(learner, 0, 60), learners, timeout=60):
            for one, two in zip(expected, found, strict=True):
                np.testing.assert_array_equal(two, one)


def test_tasks_of_one_loop_share_a_network() -> None:
    async def learned(learner: Any) -> list[Any]:
        await asyncio.sleep(0)
        return run(learner, 0, 40)

    async def both() -> Any:
        learners = [learner_of("extended", "dense", "misfit") for _ in range(2)]
        return await asyncio.gather(*map(learned, learners))

    for one, two in zip(*asyncio.run(both()), strict=True):
        np.testing.assert_array_equal(one, two)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system cannot fork")
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")  # other tests' threads
def test_a_forked_learner_goes_on_apart(tmp_path: Path) -> None:
    learner = learner_of("cubature", "dense", "misfit")
    run(learner, 0, 20)
    child = os.fork()
    if child == 0:
        try:
            np.save(tmp_path / "child.npy", run(learner, 20, 40)[-2])
        finally:
            os._exit(0)
    expected = run(learner, 20, 40)[-2]
    assert os.waitpid(child, 0)[1] == 0
    np.testing.assert_array_equal(np.load(tmp_path / "child.npy"), expected)


ERRORS = [
    pt.errors.ParameterError("x", "a number", "y"),
    pt.errors.ShapeError("x", (3,), (4,)),
    pt.errors.SimulationFailed("stopped", None, pt.errors.Outcome.NOT_FINITE),
    pt.errors.FilterDiverged("lost", pt.errors.Outcome.COVARIANCE_LOST),
    pt.errors.OutputError("out.nc", OSError(28, "no space left")),
    pt.errors.LogError("line 3"),
]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("again", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_an_error_comes_back_from_another_process(error: Exception, again: Any) -> None:
    """A pool whose worker sends one that cannot be read is broken, and its other results lost."""
    found = again(error)
    assert type(found) is type(error) and str(found) == str(error)
    assert vars(found) == vars(error)

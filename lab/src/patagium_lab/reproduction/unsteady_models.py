"""Learners of the air with memory: strips without and with memory, a grey box.

Each candidate is one entry of `CANDIDATES`; its settings, chosen by small searches on these
flights, are the same for both mounts and all rates of samples. Strips learn by the cubature filter;
hidden states and grey box by the extended filter, since points take eight times as long.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from patagium.aerodynamics import LiftingLine, Section
from patagium.aerodynamics.indicial import TWO_STATE
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.models.grey_box import GreyBox
from patagium.learning.models.hidden_strip import HiddenStripNetwork
from patagium.learning.models.strip import StripNetwork
from patagium.robot import Robot
from patagium_lab.reproduction.cases import SPREAD, WEIGHT_STD, lever_arms

STRIP_STD = {"strip": 1e-4, "strip_rotation": 1e-4, "hidden": 3e-3, "grey": 3e-3}
"""Standard deviation of a strip's force, by candidate [N]."""
HIDDEN_PRIOR = 0.1
"""Prior std of each weight of the network with hidden states, before division by sqrt(fan-in)."""
GREY_START = {"lift_slope": 0.8, "profile_drag": 1.5, "rate": 1.5}
"""First numbers of the grey box over the true ones; its prior std is half of each number."""


@dataclass(frozen=True)
class Candidate:
    """A learner of the force of the air.

    Attributes:
        key: Short name.
        title: Name in the tables.
        make: Gives the learner at its start for a robot, the time between two samples [s] and
            a seed.
        every_sample: Whether a target asks what it learns from every sample.
    """

    key: str
    title: str
    make: Callable[[Robot, float, int], Learner]
    every_sample: bool = False


def _strip(robot: Robot, interval: float, seed: int) -> Learner:
    network = StripNetwork(robot, (8, 8), activation="tanh", coefficient_scale=4.0)
    return _filtered(network, STRIP_STD["strip"], seed)


def _strip_rotation(robot: Robot, interval: float, seed: int) -> Learner:
    network = StripNetwork(robot, (8, 8), activation="tanh", rotation=True, coefficient_scale=4.0)
    return _filtered(network, STRIP_STD["strip_rotation"], seed)


def _hidden(robot: Robot, interval: float, seed: int) -> Learner:
    return ExtendedLearner(
        HiddenStripNetwork(robot),
        prior_std=HIDDEN_PRIOR,
        measurement_std=STRIP_STD["hidden"] * lever_arms(robot),
        seed=seed,
    )


def _grey(robot: Robot, interval: float, seed: int) -> Learner:
    true = Section()
    section = replace(
        true,
        lift_slope=GREY_START["lift_slope"] * true.lift_slope,
        profile_drag=GREY_START["profile_drag"] * true.profile_drag,
    )
    rates = tuple(GREY_START["rate"] * rate for rate in TWO_STATE.rate)
    model = LiftingLine(robot, lags=replace(TWO_STATE, rate=rates), section=section)
    estimate = {
        "section.lift_slope": 0.5 * section.lift_slope,
        "section.profile_drag": 0.5 * section.profile_drag,
        **{f"lags.rate[{k}]": 0.5 * rate for k, rate in enumerate(rates)},
    }
    return ExtendedLearner(
        GreyBox(model, estimate, start="still"),
        prior_std=1.0,
        measurement_std=STRIP_STD["grey"] * lever_arms(robot),
        seed=seed,
    )


def _filtered(network: StripNetwork, std: float, seed: int) -> Learner:
    """A cubature filter that never forgets, for a network of strips."""
    return CubatureLearner(
        network,
        spread=SPREAD,
        prior_std=WEIGHT_STD * network.fan_in**0.5,
        measurement_std=std * lever_arms(network.robot),
        seed=seed,
    )


CANDIDATES = {
    one.key: one
    for one in (
        Candidate("strip", "strip network, no memory", _strip),
        Candidate("strip_rotation", "strip network, no memory, pitch rate too", _strip_rotation),
        Candidate("hidden", "strip network with hidden states", _hidden, every_sample=True),
        Candidate("grey", "grey box: lifting line, four numbers unknown", _grey),
    )
}
"""Candidates by key, in the order of the tables; targets are set for "hidden"."""

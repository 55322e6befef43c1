"""Learners of the air with memory: strips without memory and with lags, a grey box.

Each candidate is one entry of `CANDIDATES`, the same for both mounts and all rates of samples.
Strips with lags are the default's of attached flow, with no setting; settings of the others were
chosen by small searches on these flights. Strips without memory learn by the
cubature filter, the others by the extended filter: it is exact for weights that are linear, and
points of a grey box take eight times as long.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from patagium.aerodynamics import Air, LiftingLine, Section
from patagium.aerodynamics.indicial import TWO_STATE
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.models.grey_box import GreyBox, Start
from patagium.learning.models.linear_strip import LinearStripNetwork
from patagium.learning.models.strip import StripNetwork
from patagium.robot import Robot
from patagium_lab.reproduction.cases import SPREAD, WEIGHT_STD, lever_arms

STRIP_STD = {"strip": 1e-4, "strip_rotation": 1e-4, "grey": 3e-3}
"""Standard deviation of a strip's force, by candidate [N]."""
_STILL = Air()
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


def _attached(robot: Robot, interval: float, seed: int) -> Learner:
    network = LinearStripNetwork(robot, attached=True)
    return ExtendedLearner(network, seed=seed)


def lifting_line_box(robot: Robot, air: Air = _STILL, start: Start = "still") -> GreyBox:
    """Grey box of a lifting line with two lags, whose first numbers are those of `GREY_START`.

    Args:
        robot: The machine.
        air: Air with its density and wind.
        start: Flow before the first sample, as `GreyBox` has it.
    """
    true = Section()
    section = replace(
        true,
        lift_slope=GREY_START["lift_slope"] * true.lift_slope,
        profile_drag=GREY_START["profile_drag"] * true.profile_drag,
    )
    rates = tuple(GREY_START["rate"] * rate for rate in TWO_STATE.rate)
    model = LiftingLine(robot, air, lags=replace(TWO_STATE, rate=rates), section=section)
    estimate = {
        "section.lift_slope": 0.5 * section.lift_slope,
        "section.profile_drag": 0.5 * section.profile_drag,
        **{f"lags.rate[{k}]": 0.5 * rate for k, rate in enumerate(rates)},
    }
    return GreyBox(model, estimate, start=start)


def _grey(robot: Robot, interval: float, seed: int) -> Learner:
    std = STRIP_STD["grey"] * lever_arms(robot)
    return ExtendedLearner(lifting_line_box(robot), measurement_std=std, seed=seed)


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
        Candidate("attached", "linear strip network, one lag", _attached, every_sample=True),
        Candidate("grey", "grey box: lifting line, four numbers unknown", _grey),
    )
}
"""Candidates by key, in the order of the tables; targets are set for "attached"."""

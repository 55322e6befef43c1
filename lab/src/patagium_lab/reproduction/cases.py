"""Cases of the reproduction: two flights, six networks, six learners and their settings.

Every number that a person chose is here, and it is the same for a whole family of runs: scales from
what is known of a flight before it is flown (its envelope, the force of a strip), standard
deviations, spread, memory. Nothing is taken from the flight itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from math import exp, pi, sqrt
from typing import Any

import casadi as ca
import numpy as np

from patagium.arrays import Array
from patagium.dynamics.kinematics import point_jacobian
from patagium.errors import ParameterError
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.models.network import Network
from patagium.learning.models.strip import StripNetwork
from patagium.robot import Robot, load_robot
from patagium_lab.rivals.gradient_learner import GradientLearner
from patagium_lab.rivals.linear_learner import LinearLearner

Span = tuple[float, float]

SPREAD = sqrt(3.0)
"""Spread of the cubature points [standard deviations]; sqrt(n) is the paper's rule."""
WEIGHT_STD = 0.0999
"""Prior standard deviation of each weight of a strip network; its square is just below 1e-2."""
DENSE_PRIOR = 0.5
"""Prior standard deviation of each weight of a dense network, before division by sqrt(fan-in)."""
DENSE_NOISE = 0.01
"""Measurement standard deviation of a dense network, over its output scales."""
MEMORY = 0.1
"""Time in which a dense network forgets to a share 1/e [s]; strip networks never forget."""
LEAST_MEMORY = 20
"""Least memory in samples, which counts where samples are rare."""
REPLAY = 32
FEATURES = 100
STEP = {"strip": 0.01, "dense": 0.003, "dense, replayed": 0.03}
"""Step size of Adam: the best of 0.001 to 0.1 for each family."""


@dataclass(frozen=True)
class FlightCase:
    """A flight that is learned, and what is known of it beforehand.

    Attributes:
        name: Key of the flight.
        robot: Preset whose geometry the strip network knows.
        strip_force: Size of the air's force on a strip [N].
        strip_std: Standard deviation of a strip's force, for sensors and for air that the
            network cannot represent [N].
        coefficient_scale: Size of the section coefficients [1].
        envelope: Range of each coordinate [m, rad].
        rates: Range of each velocity [m/s, rad/s].
        chosen: Inputs of the network with few inputs.
    """

    name: str
    robot: str
    strip_force: float
    strip_std: float
    coefficient_scale: float
    envelope: dict[str, Span] = field(repr=False)
    rates: dict[str, Span] = field(repr=False)
    chosen: tuple[str, ...] = field(repr=False)


def _both(**spans: Span) -> dict[str, Span]:
    return {f"{side}_{joint}": span for side in ("left", "right") for joint, span in spans.items()}


_UNIT = (-1.0, 1.0)
_BEAT = (-2 * pi * 15, 2 * pi * 15)
FLIGHT_CASES = {
    "published": FlightCase(
        name="published",
        robot="aerobat-published",
        strip_force=25.0,
        strip_std=0.01,
        coefficient_scale=10.0,
        envelope={
            "x": (0.0, 150.0),
            "z": (-10.0, 10.0),
            "pitch": (-0.2, 0.2),
            "yaw": (2 * pi - 1, 2 * pi + 1),
        },
        rates={"x": (0.0, 80.0), "z": (-10.0, 10.0), "pitch": (-2.5, 2.5)}
        | _both(plunge=_BEAT, mediolateral=_BEAT, elbow=_BEAT, feather=_BEAT),
        chosen=(
            *("v.x", "v.z", "q.pitch", "v.pitch"),
            *("q.left_plunge", "v.left_plunge", "q.right_plunge", "v.right_plunge"),
        ),
    ),
    "corrected": FlightCase(
        name="corrected",
        robot="aerobat",
        strip_force=0.05,
        strip_std=1e-4,
        coefficient_scale=4.0,
        envelope={"x": (0.0, 8.0)}
        | _both(plunge=(-2.0, 1.0), elbow=(-1.5, 1.5), feather=(-0.6, 0.6)),
        rates={"x": (0.0, 6.0), "z": (-2.0, 2.0), "pitch": (-2.0, 2.0)}
        | _both(plunge=(-40.0, 40.0), elbow=(-60.0, 60.0), feather=(-20.0, 20.0)),
        chosen=(
            *("v.x", "v.z", "q.left_plunge", "v.left_plunge"),
            *("q.left_elbow", "v.left_elbow", "q.left_feather", "v.left_feather"),
        ),
    ),
}
"""The two flights; a coordinate or velocity not named moves within +-1."""

NETWORKS = {
    "strip": "strip 2-8-8-2",
    "strip_midchord": "strip 2-8-8-2, incidence at mid-chord",
    "strip_rotation": "strip 3-8-8-2, pitch rate too",
    "dense": "dense 28-16-12-14, two softplus layers",
    "dense_published": "dense 28-20-14, the experiment's size",
    "dense_velocity": "dense 8-20-14, whole-body velocities",
}
"""Networks by key, as tables name them."""
STRIPS = {
    "published": ("strip_midchord", "strip", "strip_rotation"),
    "corrected": ("strip", "strip_rotation"),
}
"""Strip networks of each flight; the first has the fewest weights that can represent its air."""
LEARNERS = {
    "cubature": "cubature filter",
    "extended": "extended filter",
    "gradient": "gradient, one step a sample",
    "replay": f"gradient, {REPLAY} samples replayed",
    "linear": "least squares, linear",
    "features": f"least squares, {FEATURES} random features",
}
"""Learners by key, as tables name them."""


@dataclass(frozen=True)
class DenseSettings:
    """Settings of a dense network that are varied to find what limits it.

    Attributes:
        scaled: Whether inputs are scaled; without it they go in as they are (E7).
        spread: Spread of the cubature points [standard deviations]; None is sqrt(n).
        memory: See `MEMORY` and `LEAST_MEMORY` [s]; None never forgets.
        prior: See `DENSE_PRIOR`.
        noise: See `DENSE_NOISE`.
    """

    scaled: bool = True
    spread: float | None = SPREAD
    memory: float | None = MEMORY
    prior: float = DENSE_PRIOR
    noise: float = DENSE_NOISE


AS_RUN = DenseSettings()


@cache
def preset(name: str) -> Robot:
    """Robot of a preset, read once in a process.

    Args:
        name: Name of the preset.
    """
    return load_robot(name)


def inputs_of(case: FlightCase, network: str) -> tuple[str, ...]:
    """Names of the inputs of a network: q.<coordinate> and v.<coordinate>.

    Args:
        case: The flight.
        network: Key of `NETWORKS`.
    """
    if network == "dense_velocity":
        return case.chosen
    names = preset(case.robot).dof_names
    return tuple(f"{kind}.{name}" for kind in "qv" for name in names)


def make_network(case: FlightCase, network: str, settings: DenseSettings = AS_RUN) -> Network:
    """A network for a flight.

    Args:
        case: The flight.
        network: Key of `NETWORKS`, or "inputs" for the linear network of all inputs.
        settings: Settings that say whether inputs are scaled.

    Raises:
        ParameterError: If there is no such network.
    """
    robot = preset(case.robot)
    if network.startswith("strip"):
        return StripNetwork(
            robot,
            (8, 8),
            activation="tanh",
            chord_fraction=0.5 if network == "strip_midchord" else None,
            rotation=network == "strip_rotation",
            coefficient_scale=case.coefficient_scale,
        )
    hidden = {"dense": (16, 12), "dense_published": (20,), "dense_velocity": (20,), "inputs": ()}
    if network not in hidden:
        raise ParameterError("network", f"one of {', '.join(NETWORKS)}, inputs", network)
    names = inputs_of(case, network)
    spans = np.array([_span(case, name) for name in names])
    scales: dict[str, Any] = {}
    if settings.scaled:
        scales = {
            "input_center": spans.mean(axis=1),
            "input_scale": np.ptp(spans, axis=1) / 2,
        }
    output_scale = case.strip_force * lever_arms(robot)
    return DenseNetwork(
        len(names), hidden[network], robot.dof_names, output_scale=output_scale, **scales
    )


def make_learner(
    case: FlightCase,
    network: str,
    learner: str,
    interval: float,
    seed: int = 0,
    settings: DenseSettings = AS_RUN,
) -> Learner:
    """A learner at its start.

    Args:
        case: The flight.
        network: Key of `NETWORKS`; ignored by least squares, which sees all inputs.
        learner: Key of `LEARNERS`.
        interval: Time between two samples that are learned [s].
        seed: Seed of the first weights.
        settings: Settings of a dense network.

    Raises:
        ParameterError: If there is no such learner or network.
    """
    squares = learner in ("linear", "features")
    model: Any = make_network(case, "inputs" if squares else network, settings)
    strip = isinstance(model, StripNetwork)
    lever = lever_arms(preset(case.robot))
    if strip:
        std, forget = case.strip_std * lever, 1.0
        prior = WEIGHT_STD * np.sqrt(model.fan_in)
    else:
        std = settings.noise * case.strip_force * lever
        forget = _forgetting(interval, settings.memory)
        prior = settings.prior
    filtering = {
        "prior_std": prior,
        "measurement_std": std,
        "forgetting_factor": forget,
        "seed": seed,
    }
    if learner == "cubature":
        return CubatureLearner(model, spread=settings.spread, **filtering)
    if learner == "extended":
        return ExtendedLearner(model, **filtering)
    if squares:
        return LinearLearner(model, features=FEATURES if learner == "features" else 0, **filtering)
    if learner not in ("gradient", "replay"):
        raise ParameterError("learner", f"one of {', '.join(LEARNERS)}", learner)
    replay = REPLAY if learner == "replay" else 0
    step = STEP["strip" if strip else "dense, replayed" if replay else "dense"]
    return GradientLearner(model, learning_rate=step, replay=replay, seed=seed)


@cache
def lever_arms(robot: Robot) -> Array:
    """Lever arms of the strips: how errors of strip forces add up in each coordinate, (n,) [-, m].

    l_k = sqrt(sum over strips of |dp/dq_k|^2) with p the strip's quarter chord, the robot as
    drawn: independent errors of standard deviation s on the strips give s l_k.

    Args:
        robot: The machine.
    """
    q, total = ca.SX.zeros(robot.coordinate_count), np.zeros(robot.dof)
    for strip in robot.strips:  # numbers put into the equations: nothing is compiled for one call
        jacobian = ca.evalf(point_jacobian(robot, q, strip.body, strip.quarter_chord))
        total += (np.asarray(jacobian) ** 2).sum(axis=0)
    return np.asarray(np.sqrt(total), float)


def _forgetting(interval: float, memory: float | None) -> float:
    """Forgetting factor of a memory [s]; 1 where the memory is None."""
    return 1.0 if memory is None else exp(-min(interval / memory, 1.0 / LEAST_MEMORY))


def _span(case: FlightCase, name: str) -> Span:
    kind, coordinate = name.split(".", 1)
    spans = case.envelope if kind == "q" else case.rates
    return spans.get(coordinate, _UNIT)

"""Lags of the air found in noisy flights, as sure as they are said to be: a short version.

A robot flaps on a fixed mount in a wind, with lags of the air drawn from the prior, and forces are
measured with noise. A grey box that starts at the usual lags learns them online. If its covariance
is right, two standard deviations hold the truth 19 times in 20.
"""

from typing import NamedTuple

import numpy as np

import patagium as pt
from patagium.aerodynamics import Air, LiftingLine
from patagium.learning.models.physical import Estimate
from patagium.learning.parameter_paths import estimates_of
from patagium.learning.stream import stream
from patagium.robot import Robot
from patagium.sensing.force.air_force import training_data
from patagium.simulation import gaits, mounts

PRIORS = {
    "lags.rate[0]": 0.015,
    "lags.rate[1]": 0.1,
    "lags.lift[0]": 0.04,
    "lags.lift[1]": 0.06,
    "section.lift_slope": 0.5,
}
"""Standard deviations of the true numbers, and of the learner's prior."""
NOISE = 0.02
"""Noise of each measured force over its standard deviation, or over the loudest force's [1]."""


class Recovery(NamedTuple):
    """Estimates from one flight.

    Attributes:
        truth: True numbers, by name.
        refined: Estimates after least squares over the flight.
        coverage: Share of forces inside the predicted 95 % interval of the online pass.
    """

    truth: dict[str, float]
    refined: tuple[Estimate, ...]
    coverage: float


def recover(robot: Robot, seed: int) -> Recovery:
    """Estimates from one flight with lags, gait, wind and noise of its own."""
    draw = np.random.default_rng(seed)
    air = Air(wind=(-draw.uniform(3.0, 6.0), 0.0, 0.0))
    grey = pt.GreyBox(LiftingLine(robot, air), PRIORS, start="still")
    weights = draw.normal(size=grey.size)
    truth, _ = grey.air_at(weights)
    gait = gaits.sinusoidal(
        robot,
        frequency=draw.uniform(3.0, 6.0),
        plunge=draw.uniform(0.3, 0.6),
        feather=draw.uniform(0.05, 0.25),
        phase={"feather": draw.uniform(0.0, 2 * np.pi)},
    )
    flight = pt.simulate(robot, truth, gait, duration=0.4, time_step=1e-3, mount=mounts.fixed())
    time, x, y = training_data(flight)
    loud = y.std(axis=0)
    noise = NOISE * np.maximum(loud, 1e-2 * loud.max())
    y = y + noise * draw.normal(size=y.shape)
    student = pt.ExtendedLearner(grey, measurement_std=noise)
    coverage = stream(student, time, x, y, every=4).scores["coverage"]
    model = pt.refine(student, time, x, y, every=4)
    return Recovery(
        {e.name: e.value for e in grey.estimates(weights)}, estimates_of(model), coverage
    )


def test_two_deviations_hold_the_truth_as_often_as_they_should(one_wing):
    """Of five numbers in six flights 28.6 are expected; below 25, four times in a thousand."""
    robot = one_wing("name: plunge, axis: x", "name: feather, axis: -y")
    found = [recover(robot, seed) for seed in range(6)]
    far = [abs(e.value - one.truth[e.name]) / e.std for one in found for e in one.refined]
    assert (np.array(far) <= 2).sum() >= 25
    spread = np.median([[e.std / e.prior_std for e in one.refined] for one in found], axis=0)
    typical = dict(zip(PRIORS, spread, strict=True))
    assert max(typical.values()) < 0.95  # all are learned
    assert typical["lags.rate[1]"] < 0.3 and typical["lags.lift[1]"] < 0.3
    assert 0.9 < np.mean([one.coverage for one in found]) < 0.99

"""Contestants of the study: every network, and what needs no network.

A contestant makes a learner for a flight. It may look at the robot, the air, and the first
wingbeat, which scales inputs and outputs of the dense network and of least squares; nobody sees
more before it is scored. No contestant is given a setting: what a learner needs it finds itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from patagium.aerodynamics import AddedMass, QuasiSteady
from patagium.arrays import Array
from patagium.learning import (
    DenseNetwork,
    ExtendedLearner,
    GreyBox,
    Model,
    Network,
    StripNetwork,
    default_learner,
)
from patagium.learning.learners.learner import Learner
from patagium.sensing import training_data
from patagium.simulation import air_of, gait_period, robot_of
from patagium_lab.rivals.linear_learner import LinearLearner

FEATURES = 100
"""Number of random features of the recursive least squares."""
NUMBERS = {"polar.lift_amplitude": 0.5, "polar.drag_offset": 0.5, "added_mass.factor": 0.3}
"""Numbers of the physics that the grey box learns, with their standard deviations."""
_LEAST = 1e-3  # of the largest output of the same unit: scale of outputs that hardly move

DEFAULT = "default"
"""Name of the contestant that needs no learner."""

Make = Callable[[xr.Dataset], Learner]


@dataclass(frozen=True)
class Contestant:
    """A way to learn the air.

    Attributes:
        name: Key.
        title: Name on the page.
        make: Function that makes a new learner for a flight.
    """

    name: str
    title: str
    make: Make


def physics(flight: xr.Dataset) -> Model:
    """Blade elements with added mass as theory has them: nothing is learned.

    Args:
        flight: Flight, for its robot and air.
    """
    network = _grey(flight)
    return Model(network, network.initial(0))


def _filtered(make: Callable[[xr.Dataset], Network]) -> Make:
    """Maker of an extended filter of a network."""

    def learner(flight: xr.Dataset) -> Learner:
        return ExtendedLearner(make(flight))

    return learner


def _winged(kind: Any, *arguments: Any, **options: Any) -> Make:
    def network(flight: xr.Dataset) -> Network:
        made: Network = kind(robot_of(flight), *arguments, air=air_of(flight), **options)
        return made

    return _filtered(network)


def _grey(flight: xr.Dataset) -> GreyBox:
    robot, air = robot_of(flight), air_of(flight)
    return GreyBox(QuasiSteady(robot, air), NUMBERS, AddedMass(robot, air))


def _dense(flight: xr.Dataset, hidden: tuple[int, ...] = (8, 8)) -> DenseNetwork:
    x, y = _first_beat(flight)
    (x_center, x_scale), (y_center, _) = _spans(x), _spans(y)
    return DenseNetwork(
        x.shape[1],
        hidden,
        robot_of(flight).dof_names,
        input_center=x_center,
        input_scale=x_scale,
        output_center=y_center,
        output_scale=_scales(flight, y),
    )


def _least_squares(features: int) -> Make:
    def learner(flight: xr.Dataset) -> Learner:
        return LinearLearner(_dense(flight, ()), features=features)

    return learner


CONTESTANTS = {
    one.name: one
    for one in (
        Contestant(DEFAULT, "default", default_learner),
        Contestant("linear", "linear least squares", _least_squares(0)),
        Contestant("features", f"{FEATURES} random features", _least_squares(FEATURES)),
        Contestant("dense", "dense network", _filtered(_dense)),
        Contestant("strip", "strip network", _winged(StripNetwork)),
        Contestant("turning", "strip network, rotation", _winged(StripNetwork, rotation=True)),
        Contestant("grey", "grey box", _filtered(_grey)),
    )
}
"""Contestants by name."""


def _first_beat(flight: xr.Dataset) -> tuple[Array, Array]:
    """State and force of the first wingbeat; see `training_data`."""
    time, x, y = training_data(flight)
    first = time <= time[0] + (gait_period(flight) or time[-1])
    return x[first], y[first]


def _scales(flight: xr.Dataset, y: Array) -> Array:
    """Scale of each output, (n_y,): its standard deviation, of still ones a least one."""
    turns = np.array([unit == "rad" for unit in robot_of(flight).dof_units])
    std = y.std(axis=0)
    least = np.where(turns, std[turns].max(), std[~turns].max() if (~turns).any() else 0.0)
    return np.asarray(np.maximum(std, _LEAST * least))


def _spans(values: Array) -> tuple[Array, Array]:
    """Middle and half width of each column, one where it stands still."""
    low, high = values.min(axis=0), values.max(axis=0)
    half = (high - low) / 2
    return (low + high) / 2, np.where(half > _LEAST * half.max(), half, 1.0)

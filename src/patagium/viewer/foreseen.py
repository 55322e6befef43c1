"""What a learned model, or an identification, says of the forces of a flight.

A model with frozen weights is asked at every time; an identification is replayed as it
was, each force predicted before its sample was used. A strip network says the force on each
strip; other networks only the sum. Neglected: how sure they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from patagium.errors import LogError, ShapeError
from patagium.identification.identify import Trained, samples
from patagium.identification.model_file import Model
from patagium.identification.network import Network
from patagium.identification.recollection import Recollection
from patagium.identification.result import Identification
from patagium.identification.strip import StripNetwork
from patagium.robot import Robot

Array = NDArray[np.float64]
Frames = NDArray[np.int64]
Predicted: TypeAlias = Trained | Identification


@dataclass(frozen=True)
class Foreseen:
    """Predicted forces at the times shown.

    Attributes:
        names: Coordinates whose force is predicted, k.
        generalized: Predicted generalized force, (F, k) [N, N m].
        strips: Predicted force on each strip, world axes, (F, n_strips, 3) [N], or None.
        words: How they were predicted.
    """

    names: tuple[str, ...]
    generalized: Array
    strips: Array | None
    words: str


def foresee(flight: xr.Dataset, robot: Robot, predicted: Predicted, frames: Frames) -> Foreseen:
    """Predicted forces of a flight.

    Args:
        flight: Record with q, v, a, u1.
        robot: Its machine.
        predicted: A learner or model, or the identification of this very flight.
        frames: Indices of the samples that are shown, (F,).

    Raises:
        ShapeError: If the model is of another robot.
        LogError: If the identification is of another flight.
    """
    if not isinstance(predicted, Identification):
        return _asked(flight, robot, predicted, frames)
    kept = _kept(flight, predicted, frames)
    if type(getattr(predicted.learner, "network", None)) is not StripNetwork:
        return kept
    strips = _asked(flight, robot, predicted.learner, frames).strips
    if strips is None:
        return kept
    words = f"{kept.words} (plots); by the weights of the end (arrows on strips)"
    return replace(kept, strips=strips, words=words)


def _kept(flight: xr.Dataset, result: Identification, frames: Frames) -> Foreseen:
    record = result.prediction
    time = np.asarray(flight["time"].values, float)
    found = np.asarray(record["time"].values, float)
    if found.shape != time.shape or not np.allclose(found, time, rtol=0, atol=1e-9):
        span = f"{time.size} samples over {time[-1] - time[0]:g} s"
        other = f"{found.size} samples over {found[-1] - found[0]:g} s"
        raise LogError(f"predictions: expected those of this flight ({span}), found {other}")
    names = tuple(str(name) for name in record["output"].values)
    values = np.asarray(record["prediction"].transpose("time", "output").values, float)[frames]
    return Foreseen(names, values, None, "before the sample was used")


def _asked(flight: xr.Dataset, robot: Robot, model: Trained, frames: Frames) -> Foreseen:
    network = model.network
    inputs = model.inputs if isinstance(model, Model) else None
    winged = type(network) is StripNetwork
    if winged:
        _check(network, robot)
        network = _measuring(network, list(robot.dof_names))
    time, x, _, _ = samples(flight, network, inputs, robot)
    seen = Recollection(network, time, x, ()).upto(len(time), model.weights)[frames]
    strips = _strip_forces(network, robot, seen, model.weights) if winged else None
    values = network.evaluate(seen, model.weights)
    return Foreseen(tuple(network.output_names), values, strips, "by the learned model")


def _check(network: Any, robot: Robot) -> None:
    names, expected = ([s.name for s in one.strips] for one in (network.robot, robot))
    if names != expected:
        raise ShapeError("strips of the model", ", ".join(expected), ", ".join(names))


def _measuring(network: Network, measured: Any) -> StripNetwork:
    """The same strip network, its weights too, seen through other measurements."""
    return StripNetwork.from_description(network.describe() | {"measured": measured})


def _strip_forces(network: Network, robot: Robot, x: Array, weights: Array) -> Array:
    every = _measuring(network, np.eye(3 * len(robot.strips)).tolist())
    return every.evaluate(x, weights).reshape(len(x), len(robot.strips), 3)


def strip_measuring(network: Network, robot: Robot) -> StripNetwork | None:
    """The same network, its weights too, seen through the force on each strip.

    Args:
        network: Any; of strips or not.
        robot: Its machine.

    Returns:
        A network of 3 n_strips outputs, world axes, strip by strip; None where it has no strips.
    """
    if type(network) is not StripNetwork:
        return None
    return _measuring(network, np.eye(3 * len(robot.strips)).tolist())

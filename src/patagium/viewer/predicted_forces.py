"""Predicted forces of a flight, by a learned model or by an identification.

A model with frozen weights is asked at every time; an identification is replayed as it
was, each force predicted before its sample was used. A network of strips says the force on
each strip; others only the sum. How sure they are is asked at some hundred times, and taken
for straight between. Neglected: correlation between the errors of several forces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import xarray as xr

from patagium.arrays import Array, Indices, stored, thin
from patagium.errors import LogError, ShapeError
from patagium.learning.model_file import Model
from patagium.learning.models.linear_strip import LinearStripNetwork, strip_forces
from patagium.learning.models.memory import network_inputs
from patagium.learning.models.network import Network
from patagium.learning.models.strip import StripNetwork
from patagium.learning.parameter_paths import Trained
from patagium.learning.result import Identification
from patagium.learning.samples import in_flight, samples
from patagium.robot import Robot
from patagium.sensing import training_data

Predicted: TypeAlias = Trained | Identification

_WINGED = (StripNetwork, LinearStripNetwork)
_ASKED = 241  # times at which a model says how sure it is


@dataclass(frozen=True)
class Prediction:
    """Predicted forces at the times shown.

    Attributes:
        names: Coordinates whose force is predicted, k.
        generalized: Predicted generalized force, (F, k) [N, N m].
        strips: Predicted force on each strip, world axes, (F, n_strips, 3) [N], or None.
        words: Way of prediction, in words.
        std: Standard deviation of the generalized force, with measurement noise, (F, k)
            [N, N m]; None where it is not known.
        notes: Sentences about what the model did not learn of this flight.
    """

    names: tuple[str, ...]
    generalized: Array
    strips: Array | None
    words: str
    std: Array | None = None
    notes: Sequence[str] = ()


def predict_flight(
    flight: xr.Dataset, robot: Robot, predicted: Predicted, frames: Indices
) -> Prediction:
    """Predicted forces of a flight.

    Args:
        flight: Record with q, v, a, u1 and aero_force.
        robot: Its machine.
        predicted: A learner or model, or the identification of this very flight.
        frames: Indices of the samples that are shown, (F,).

    Raises:
        ShapeError: If the model is of another robot.
        LogError: If the identification is of another flight.
    """
    if not isinstance(predicted, Identification):
        return _from_model(flight, robot, predicted, frames)
    kept = _from_identification(flight, robot, predicted, frames)
    if not isinstance(getattr(predicted.learner, "network", None), _WINGED):
        return kept
    strips = _from_model(flight, robot, predicted.learner, frames).strips
    if strips is None:
        return kept
    words = f"{kept.words} (plots); by the weights of the end (arrows on strips)"
    return replace(kept, strips=strips, words=words)


def _check_forces(
    flight: xr.Dataset, robot: Robot, result: Identification, names: Sequence[str]
) -> None:
    """Refuse an identification whose measured forces are not those of a flight."""
    if other := [name for name in names if name not in robot.dof_names]:
        expected = f"forces of coordinates of {robot.name}"
        raise LogError("predictions", expected, ", ".join(other))
    if {*result.scores.get("parameter_value", ())} & {*robot.parameter_names}:
        return  # the forces are those by other numbers of the robot
    columns = [robot.dof_names.index(name) for name in names]
    measured = stored(result.prediction, "measurement", "time", "output")
    most = 1e-3 * np.linalg.norm(np.nan_to_num(measured)) + 1e-9  # N, N m: rounding
    own = (training_data(flight, robot, with_added_mass=carried)[2] for carried in (False, True))
    errors = (np.linalg.norm(np.nan_to_num(measured - one[:, columns])) for one in own)
    if all(error > most for error in errors):
        raise LogError("predictions", "those of this flight", "other measured forces")


def _from_identification(
    flight: xr.Dataset, robot: Robot, result: Identification, frames: Indices
) -> Prediction:
    """Prediction that an identification made before it used each sample."""
    record = result.prediction
    time = stored(flight, "time")
    found = stored(record, "time")
    if found.shape != time.shape or not np.allclose(found, time, rtol=0, atol=1e-9):
        span = f"{time.size} samples over {time[-1] - time[0]:g} s"
        other = f"{found.size} samples over {found[-1] - found[0]:g} s"
        raise LogError("predictions", f"those of this flight ({span})", other)
    names = tuple(map(str, record["output"].values))
    _check_forces(flight, robot, result, names)
    values = stored(record, "prediction", "time", "output")[frames]
    checks = stored(record, "check_time")
    kept = stored(record, "predicted_std", "check_time", "output")
    std = _interpolate(checks, kept, time[frames])
    return Prediction(names, values, None, "before the sample was used", std)


def _interpolate(known: Array, values: Array, time: Array) -> Array | None:
    """Straight between known times, (F, k); None where any is unknown."""
    if not len(known) or not np.isfinite(values).all():
        return None
    return np.column_stack([np.interp(time, known, column) for column in values.T])


def _from_model(flight: xr.Dataset, robot: Robot, model: Trained, frames: Indices) -> Prediction:
    """Prediction by a learner or a model with the weights that it has."""
    if isinstance(model.network, _WINGED):
        names, expected = ([s.name for s in one.strips] for one in (model.network.robot, robot))
        if names != expected:
            other = next((one for one in names if one not in expected), "fewer")
            found = f"{len(names)} of another robot, such as {other}"
            raise ShapeError("strips of the model", f"the {len(expected)} of the flight", found)
    model, notes = in_flight(model, flight)
    network = model.network
    inputs = model.inputs if isinstance(model, Model) else None
    if isinstance(network, StripNetwork):
        network = _with_measurements(network, list(robot.dof_names))
    time, x, _, _ = samples(flight, network, inputs)
    seen = network_inputs(network, model.weights, time, x)[frames]
    return Prediction(
        tuple(network.output_names),
        network.evaluate(seen, model.weights),
        _strip_forces(network, robot, seen, model.weights),
        "by the learned model",
        _model_std(model, network, seen, time[frames]),
        notes,
    )


def _model_std(model: Trained, network: Network, seen: Array, time: Array) -> Array | None:
    """Deviations that the model itself gives, asked at some of the times."""
    if model.network.output_names != network.output_names or not hasattr(model, "predict"):
        return None
    asked = thin(np.arange(len(seen)), _ASKED)
    covariances = np.array([np.atleast_2d(model.predict(seen[k])[1]) for k in asked])
    with np.errstate(invalid="ignore"):
        found = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    return _interpolate(time[asked], found, time)


def _with_measurements(network: Network, measured: Any) -> StripNetwork:
    """Strip network with the same weights and other measurements."""
    return StripNetwork.from_description(network.describe() | {"measured": measured})


def _strip_forces(network: Network, robot: Robot, x: Array, weights: Array) -> Array | None:
    """Force on each strip, world axes, (F, n_strips, 3) [N]; None where the network has none."""
    if isinstance(network, LinearStripNetwork):
        return strip_forces(network, x, weights)
    every = strip_force_network(network, robot)
    if every is None:
        return None
    return every.evaluate(x, weights).reshape(len(x), len(robot.strips), 3)


def strip_force_network(network: Network, robot: Robot) -> StripNetwork | None:
    """Network with the same weights whose outputs are the forces on the strips.

    Args:
        network: Any; of strips or not.
        robot: Its machine.

    Returns:
        A network of 3 n_strips outputs, world axes, strip by strip; None where it has no strips.
    """
    if type(network) is not StripNetwork:
        return None
    return _with_measurements(network, np.eye(3 * len(robot.strips)).tolist())

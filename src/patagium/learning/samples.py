"""Samples of a flight or of measured forces, as a network learns them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from patagium.aerodynamics import Air, WindShear
from patagium.aerodynamics.on_model import has_layer
from patagium.arrays import Array, stored
from patagium.errors import LogError, ParameterError, ShapeError
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.learners.learner import Learner
from patagium.learning.model_file import Model, model_of
from patagium.learning.models.memory import measured_inputs
from patagium.learning.models.network import Network, flight_terms
from patagium.learning.models.physical import WIND
from patagium.learning.models.registry import in_air, network_from_description, steady_air
from patagium.learning.parameter_paths import Trained
from patagium.robot import Robot
from patagium.sensing.force.air_force import (
    SampleForm,
    recorded,
    recorded_wind_change,
    relative_to_wind,
    state_columns,
    training_data,
)
from patagium.sensing.force.measured_force import ForceSamples
from patagium.simulation import air_of, robot_of


def with_force(flight: Any) -> Any:
    """Measured forces, also those of a motion, where one is known; any other log as it is.

    Raises:
        LogError: If none is known.
    """
    if isinstance(flight, xr.Dataset) and "force" in flight:
        flight = ForceSamples.of(flight)
    if not isinstance(flight, ForceSamples):
        return flight
    known = np.isfinite(flight.force).any(axis=1)
    if known.sum() < 2:
        raise LogError(
            "forces: expected samples with a known force, found none; joints with a motor need "
            "motor currents, a held body a load cell"
        )
    return flight if known.all() else flight.where(known)


def samples(
    flight: xr.Dataset | ForceSamples,
    network: Network,
    inputs: Sequence[str] | None = None,
) -> tuple[Array, Array, Array, list[str]]:
    """Training samples of a flight: inputs of a network, and what it should predict.

    Where the wind of the flight changes, velocities of the base are those less the change. Where
    numbers of a robot are learned, the force is that by the numbers of the network's robot.

    Args:
        flight: Record with q, v, a, u1; or measured forces.
        network: Its outputs are coordinates of the robot (generalized forces), or linear
            functions of the strip forces (`measured`, taken from the flight's strips).
        inputs: Names of what it sees; None: q, then v. Then a, if it needs accelerations.

    Returns:
        Time (N,) [s]; x (N, n_x); y (N, n_y); units of the outputs.

    Raises:
        FlightError: If the flight misses a quantity.
        LogError: If there are less than two samples.
        ShapeError: If the network has other inputs, or outputs that are no coordinates.
        ParameterError: If an input has no such name, or measured forces cannot feed the network.
    """
    terms, flight = flight_terms(network), with_force(flight)
    machine, _ = flown(flight)
    if isinstance(flight, ForceSamples):
        time, state, force = flight.time, flight.state, _force_by(flight, terms.robot)
        acceleration = flight.a
        if terms.acceleration and acceleration is None:
            raise ParameterError("a", "accelerations, which the network sees", None)
    else:
        if terms.robot is not None:  # whose numbers the network learns, dampers included
            machine, flight = terms.robot, flight.drop_vars("damping_force", errors="ignore")
        time, state, force = training_data(flight, machine, with_added_mass=terms.added_mass)
        acceleration = recorded(flight, "a", machine) if terms.acceleration else None
    if len(time) < 2:
        raise LogError("flight", "two samples at least", f"{len(time)}; fly longer")
    x = state if inputs is None else state[:, state_columns(machine, inputs)]
    change = wind_change(flight, network)
    x = x if change is None else relative_to_wind(x, change, machine, inputs)
    if terms.acceleration and acceleration is not None:
        x = np.hstack([x, acceleration])
    balance = terms.strip_forces
    if balance is not None:
        if isinstance(flight, ForceSamples):
            raise ParameterError("network", "outputs that are coordinates", "sums of strip forces")
        strips = stored(flight, "strip_force", "time", "strip", "axis")
        return time, x, strips.reshape(len(time), -1) @ balance.T, ["1"] * len(balance)
    names = network.output_names
    if not set(names) <= set(machine.dof_names):
        known = f"coordinates of robot {machine.name!r}: {', '.join(machine.dof_names)}"
        raise ShapeError("outputs of the model", known, f"another robot's: {', '.join(names)}")
    seen, own = measured_inputs(network), getattr(network, "robot", machine)
    if own.attitude != machine.attitude:
        words = f"{machine.attitude}; learn anew, with `robot.with_attitude({machine.attitude!r})`"
        raise ShapeError("attitude of the robot", f"{own.attitude}, as the model sees it", words)
    if x.shape[1] not in (seen, network.inputs):
        raise ShapeError("inputs", f"as many as the network sees, {seen}", x.shape[1])
    columns = [machine.index(name) for name in names]
    return time, x, force[:, columns], [machine.force_units[k] for k in columns]


def _force_by(flight: ForceSamples, robot: Robot | None) -> Array:
    """Measured force by the numbers of a robot, None: of the flight's, (N, n) [N, N m]."""
    if robot is None or np.array_equal(robot.parameters, flight.robot.parameters):
        return flight.force
    if flight.a is None:
        expected = "accelerations, since the robot of the network has other numbers"
        raise ParameterError("a", expected, None)
    motion = flight.q, flight.v, flight.a, np.zeros(flight.v.shape)
    forms = SampleForm(flight.robot), SampleForm(robot)
    own, other = (np.array(form.function.batch(*motion, form.parameters)[1]) for form in forms)
    return np.asarray(flight.force + (other - own).reshape(flight.force.shape))


def flown(flight: xr.Dataset | ForceSamples) -> tuple[Robot, Air]:
    """Robot of a flight or of measured forces, and the air that it flew in."""
    if isinstance(flight, ForceSamples):
        return flight.robot, flight.air
    return robot_of(flight), air_of(flight)


def wind_change(flight: xr.Dataset | ForceSamples, network: Network) -> Array | None:
    """Change of a flight's wind from its steady part, (N, 3) [m/s], world axes; None: no change.

    Args:
        flight: Record of a flight, or measured forces.
        network: What learns from it or predicts it; where it knows shear, as a grey box does, the
            change in a flight in shear is that at the reference height.
    """
    known = has_layer(getattr(network, "model", None), WindShear)
    if isinstance(flight, xr.Dataset) and not (known and "strip_wind" in flight):
        return recorded_wind_change(flight)
    _, air = flown(flight)
    change = air.uniform_wind_at(np.asarray(flight.time)) - air.wind
    return change if change.any() else None


def other_air(network: Network, flight: xr.Dataset | ForceSamples) -> tuple[Air, str] | None:
    """Steady air of a flight and words on it; None if the network knows no air, or has this.

    What the network learns of wind and density stays as it was before it was learned.
    """
    own = steady_air(network)
    if own is None:
        return None
    _, air = flown(flight)
    if (air.wind, air.density) == (own.wind, own.density):
        return None
    estimate = network.describe().get("estimate", ())
    learned = [name for name in ("density", *WIND) if name in estimate]
    each = zip(WIND, own.wind, air.wind, strict=True)
    wind: Any = tuple(mine if name in learned else its for name, mine, its in each)
    density = own.density if "density" in learned else air.density
    air = replace(air, wind=wind, density=density)
    words = (f"wind {one.wind} m/s at {one.density:.4g} kg/m^3" for one in (air, own))
    kept = f" (as learned, not of the flight: {', '.join(learned)})" if learned else ""
    return air, "; learned in ".join(words) + kept


def in_flight(model: Trained, flight: xr.Dataset | ForceSamples) -> tuple[Trained, list[str]]:
    """Model in the steady wind and the density of a flight, and what it did not learn, in words.

    Args:
        model: A learner or a model; its network may know no air and no robot.
        flight: Record of a flight, or measured forces.
    """
    network, told, (robot, _) = model.network, [], flown(flight)
    known = getattr(getattr(network, "model", network), "robot", None)
    if known is not None and known.strips != robot.strips:
        told = [f"Warning: the wings of {robot.name} are not those that the model learned."]
    found = other_air(network, flight)
    if found is not None and isinstance(model, Model | Learner):
        network = network_from_description(in_air(network.describe(), found[0]))
        model = replace(model if isinstance(model, Model) else model_of(model), network=network)
        told.append(f"Note: predicted in the air of the flight, {found[1]}.")
    return model, told


def go_on_in(learner: Learner, flight: xr.Dataset | ForceSamples) -> dict[str, str]:
    """Take a learner that has learned before into the steady air of a flight, in words.

    One that has not keeps the air that it was given.
    """
    found = other_air(learner.network, flight)
    if found is None:
        return {}
    if not (isinstance(learner, FilterLearner) and learner.count):
        return {"air": f"not that of the flight, {found[1]}"}
    learner.go_on_with(network_from_description(in_air(learner.network.describe(), found[0])))
    return {"air": f"that of the flight, {found[1]} before"}


def stds(flight: xr.Dataset | ForceSamples, network: Network) -> Array | None:
    """Standard deviations of measured forces, (N, n_y) [N, N m]; None for a flight."""
    flight = with_force(flight)
    if not isinstance(flight, ForceSamples):
        return None
    return flight.std[:, [flight.robot.index(name) for name in network.output_names]]

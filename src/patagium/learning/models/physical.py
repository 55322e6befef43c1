"""Physical parameters as weights: their names, units and prior standard deviations.

A weight is the distance of a parameter from its start in prior standard deviations. For a
parameter that cannot be negative, the weight measures its logarithm, so that no update takes
the parameter below zero. Neglected: limits that depend on other parameters, such as stall that
begins before it is complete.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any, NamedTuple

import numpy as np

from patagium.aerodynamics.added_mass import AddedMass
from patagium.aerodynamics.delaurier import NUMBERS
from patagium.aerodynamics.description import aero_from_description
from patagium.aerodynamics.model import Aerodynamics
from patagium.arrays import Array
from patagium.errors import ParameterError, positive
from patagium.learning.models.network import Network
from patagium.robot.model import Robot

FACTOR = "added_mass.factor"
WIND = ("wind.x", "wind.y", "wind.z")


def _units(named: Mapping[str, str]) -> dict[str, str]:
    """Unit of each name, from names by unit."""
    return {name: unit for unit, names in named.items() for name in names.split()}


_POSITIVE = _units({
    "kg/m^3": "density",
    "1/rad": "lift_slope",
    "rad": "stall_begins stall_complete stall_angle stall_width memory",
    "1/semichord": "rate",
    "semichords": "pressure separation vortex",
    "1": "profile_drag friction_drag crossflow_drag induced_factor suction_efficiency "
    "surface_constant factor exponent apparent_mass",
    "m": "chord width reference_height roughness",
    "kg": "mass",
    "kg m^2": "xx yy zz",
    "m/s^2": "gravity",
    "m^2/s": "viscosity",
    "N s/m or N m s": "damping",
    "N/m or N m/rad": "stiffness",
})  # fmt: skip
_SIGNED = _units({
    "rad": "zero_lift_angle lift_phase drag_phase angle",
    "kg m^2": "xy xz yz",
    "m": "ground",
    "m or rad": "rest",
})  # fmt: skip
_VECTORS = _units({"m": "position center_of_mass quarter_chord", "m/s": "wind"})
_PLAIN = {"1": "", "1/semichord": "", "semichords": ""}


class Estimate(NamedTuple):
    """A physical parameter with its value and standard deviation.

    Attributes:
        name: Such as `section.lift_slope`, or `left_wing[0].chord`.
        unit: Of the numbers.
        value: Most probable.
        std: Standard deviation; NaN where the learner has none.
        prior: Value before any sample.
        prior_std: Standard deviation before any sample.
    """

    name: str
    unit: str
    value: float
    std: float
    prior: float
    prior_std: float


class PhysicalParameter(NamedTuple):
    """A number of the air or of the robot that is learned.

    value(w) = prior + deviation w, or prior exp(w deviation / prior) if it is positive.

    Attributes:
        name: Such as `section.lift_slope`, or `left_wing[0].chord`.
        prior: Value before any sample, in `unit`.
        std: Standard deviation before any sample, in `unit`.
        unit: Of the numbers.
    """

    name: str
    prior: float
    std: float
    unit: str

    @property
    def positive(self) -> bool:
        """Whether it cannot be zero or less."""
        return _last(self.name) in _POSITIVE

    @property
    def scale(self) -> float:
        """Standard deviation of the parameter, or of its logarithm: a weight of one."""
        return self.std / self.prior if self.positive else self.std

    def estimate(self, weight: float, variance: float = float("nan")) -> Estimate:
        """Estimate at a weight, its standard deviation to first order.

        Args:
            weight: In prior deviations.
            variance: Of the weight.
        """
        if self.positive:
            value = self.prior * float(np.exp(weight * self.scale))
            slope = value * self.scale
        else:
            value, slope = self.prior + weight * self.scale, self.scale
        spread = slope * float(np.sqrt(variance))
        return Estimate(self.name, self.unit, value, spread, self.prior, self.std)


def own_prior(network: Network) -> Array:
    """Standard deviations of weights before any sample that the network knows itself, (n,).

    Args:
        network: With physical parameters or without.

    Returns:
        nan where the learner chooses.
    """
    return np.asarray(getattr(network, "own_prior", np.full(network.size, np.nan)))


def unit_of(name: str, robot: Robot) -> str:
    """Unit of a parameter of a robot or its air."""
    last, before = _last(name), name.split(".")[-2:-1]
    if last in ("x", "y", "z") and before and before[0] in _VECTORS:
        return _VECTORS[before[0]]
    unit, joint = _POSITIVE.get(last) or _SIGNED.get(last, "1"), name.rpartition(".")[0]
    if " or " in unit:
        unit = unit.split(" or ")[robot.dof_units[robot.index(joint)] != "m"]
    return unit


def written_unit(name: str, numbers: Mapping[str, float], robot: Robot) -> str:
    """Unit of a parameter as written behind a number, checked; empty for pure numbers."""
    _check_name(name, numbers, robot)
    unit = unit_of(name, robot)
    return _PLAIN.get(unit, unit)


def numbers_of(model: Aerodynamics, added_mass: AddedMass | None) -> dict[str, float]:
    """All numbers that may be learned, by name.

    Args:
        model: The air, around a robot.
        added_mass: What it carries along.
    """
    robot = model.robot
    numbers = dict(zip(robot.parameter_names, robot.parameters.tolist(), strict=True))
    numbers |= dict(zip(model.parameter_names, model.parameters.tolist(), strict=True))
    numbers |= dict(zip(WIND, model.air.wind, strict=True))
    return numbers | ({} if added_mass is None else added_mass.factors)


def physical_parameters(
    estimate: Mapping[str, float], numbers: Mapping[str, float], robot: Robot
) -> tuple[PhysicalParameter, ...]:
    """Parameters to learn, checked.

    Args:
        estimate: Prior deviation of each, by name, in its unit.
        numbers: What may be learned; see `numbers_of`.
        robot: Whose numbers are not listed in a message, for they are many.

    Raises:
        ParameterError: If there is none, no such name, a deviation is not positive, or a
            parameter that cannot be zero is.
    """
    if not estimate:
        raise ParameterError("estimate", "parameters by name, with prior deviations", estimate)
    found = []
    for name, std in estimate.items():
        _check_name(name, numbers, robot)
        unit = unit_of(name, robot)
        std = positive(name, std, f"a positive prior deviation [{unit}]")
        parameter = PhysicalParameter(name, float(numbers[name]), std, unit)
        if parameter.positive and parameter.prior <= 0:
            raise ParameterError(name, "a value above zero to start from", parameter.prior)
        found.append(parameter)
    return tuple(found)


def changed_air(
    model: Aerodynamics, added_mass: AddedMass | None, estimates: Sequence[Estimate]
) -> tuple[Aerodynamics, AddedMass | None]:
    """Model of the air and its robot with other numbers, in steady wind.

    Args:
        model: The model of the air.
        added_mass: What it carries along.
        estimates: Of the numbers that are others.

    Raises:
        ParameterError: If a number is no argument of the model, or not what it may be.
    """
    values = {found.name: found.value for found in estimates}
    robot, description = model.robot, model.describe()
    of_robot = {name: values.pop(name) for name in robot.parameter_names if name in values}
    for name, value in {"gust": None, **values}.items():
        if not name.startswith("added_mass."):
            _write(description, name, value, model.name)
    try:
        machine = robot.with_parameters(of_robot) if of_robot else robot
        changed = aero_from_description(machine, description)
    except ParameterError as problem:
        expected = f"those of a possible robot and air ({problem}): estimate fewer of them, or "
        expected += "with narrower priors, or fly other gaits"
        found = {one.name: float(f"{one.value:.4g}") for one in estimates}
        raise ParameterError("learned numbers", expected, found) from problem
    if added_mass is None:
        return changed, None
    factor: Any = values.get(FACTOR, added_mass.factor)
    if isinstance(factor, Mapping):
        factor = {wing: values.get(f"added_mass.{wing}.factor", factor[wing]) for wing in factor}
    return changed, AddedMass(machine, changed.air, factor=factor)


def _write(description: Any, name: str, value: float | None, model: str) -> None:
    """One number into the description of a model."""
    path = f"air.{name}" if name in ("density", "ground", "gust", *WIND) else name
    steps = re.findall(r"[^.\[\]]+", path)
    while "of" in description and steps[0] != description["model"]:
        description = description["of"]  # of the model under this one
    if "of" in description:
        del steps[0]
    if name in WIND:
        steps[-1] = str("xyz".index(steps[-1]))
    for step in steps[:-1]:
        description = description.get(step) if isinstance(description, dict) else None
    last: Any = int(steps[-1]) if isinstance(description, list) else steps[-1]
    known = range(len(description)) if isinstance(description, list) else description
    if known is None or last not in known:
        raise ParameterError(name, f"an argument of {model}", name)
    description[last] = value


def _check_name(name: str, numbers: Mapping[str, float], robot: Robot) -> None:
    if name in numbers:
        return
    if told := robot.refusal(name):
        raise ParameterError("estimate", told, name)
    names = robot.parameter_names
    of_air = [known for known in numbers if known not in names]
    near = get_close_matches(name, list(numbers), 1, 0.0)
    chosen = [next((n for n in names if _last(n) == kind), None) for kind in ("mass", "chord")]
    own = f"or a number of robot {robot.name!r} such as {', '.join(filter(None, chosen))}"
    expected = f"one of {', '.join(of_air)}, {own} (closest: {near[0]})"
    raise ParameterError("estimate", expected, name)


def _last(name: str) -> str:
    """Last part of a parameter's name, without its index; the first of numbers by wing."""
    first = name.partition(".")[0]
    return first if first in NUMBERS else re.sub(r"\[\d+\]$", "", name.rpartition(".")[2])


def inertial(names: Sequence[str], robot: Robot) -> bool:
    """Whether a parameter changes the robot's own inertia or weight."""
    strips = tuple(f"{strip.name}." for strip in robot.strips)
    return any(
        name in robot.parameter_names and not name.startswith(strips) and _last(name) != "damping"
        for name in names
    )

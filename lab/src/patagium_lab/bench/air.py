"""Times of models of the air: one model beside another, and by the number of strips.

Force and rate of the model's states are timed together, one state a call, compiled.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from patagium.aerodynamics import (
    AddedMass,
    Aerodynamics,
    Air,
    DeLaurier,
    LiftingLine,
    QuasiSteady,
    StallDelay,
)
from patagium.aerodynamics.indicial import FOUR_STATE, ONE_STATE, TWO_STATE
from patagium.dynamics.equations import kirchhoff_force
from patagium.native import NativeFunction, load_functions
from patagium.robot.model import Robot, Strip
from patagium_lab.bench.result import Result, compared
from patagium_lab.published.aerodynamics import Published
from patagium_lab.timing import compiled_call, time_call, time_python

STRIPS = (8, 16, 32, 64, 128)
STATES = 512


@dataclass(frozen=True)
class AirModel:
    """A model of the air to be timed.

    Attributes:
        aero: The model.
        added_mass: Inertia of the air beside it, its force at a given acceleration; or None.
    """

    aero: Aerodynamics
    added_mass: AddedMass | None = None


FIRST = "quasi-steady"
MODELS: dict[str, Callable[[Robot, Air], AirModel]] = {
    FIRST: lambda robot, air: AirModel(QuasiSteady(robot, air)),
    "as published": lambda robot, air: AirModel(Published(robot, air)),
    "DeLaurier's strips": lambda robot, air: AirModel(DeLaurier(robot, air)),
    "lifting line, one state": lambda robot, air: AirModel(LiftingLine(robot, air, ONE_STATE)),
    "lifting line, two states": lambda robot, air: AirModel(LiftingLine(robot, air, TWO_STATE)),
    "lifting line, four states": lambda robot, air: AirModel(LiftingLine(robot, air, FOUR_STATE)),
    "lifting line, two states, added mass": lambda robot, air: AirModel(
        LiftingLine(robot, air, TWO_STATE), AddedMass(robot, air)
    ),
    "lifting line, two states, stall delay": lambda robot, air: AirModel(
        LiftingLine(robot, air, TWO_STATE, stall_delay=StallDelay())
    ),
}
"""Every model of the air for a machine with strips, by name."""


def model_cost(robot: Robot, name: str) -> float:
    """Time of force and rate of the states, one state a call [ns].

    Args:
        robot: A machine with strips.
        name: Key of `MODELS`.
    """
    return _cost(MODELS[name](robot, Air()))[0]


def model_results(robot: Robot) -> Iterator[Result]:
    """Every model of the air on the same robot, beside the quasi-steady model.

    Args:
        robot: A machine with strips.
    """
    note = f"force and rate of the states, {len(robot.strips)} strips, one state a call"
    base = model_cost(robot, FIRST)
    yield Result(FIRST, base, "ns", note=note)
    for name in MODELS:
        if name != FIRST:
            yield compared(name, model_cost(robot, name), "ns", FIRST, base, note)


def strip_results(robot: Robot, counts: Sequence[int] = STRIPS) -> Iterator[Result]:
    """The lifting line with one state a strip, from few strips to many.

    Args:
        robot: A machine whose strips follow each other along its wings, as many on each.
        counts: Strips in all.
    """
    base, against = 0.0, f"lifting line, {counts[0]} strips"
    for count in counts:
        value, making = _cost(AirModel(LiftingLine(restriped(robot, count), lags=ONE_STATE)))
        note = "force and rate of the states, one state a strip"
        if making > 1.0:
            note += f"; {making:.0f} s to derive and compile"
        name = f"lifting line, {count} strips"
        if not base:
            base = value
            yield Result(name, value, "ns", note=note)
        else:
            yield compared(name, value, "ns", against, base, note)


def restriped(robot: Robot, count: int) -> Robot:
    """Robot with another number of strips of equal width on the same span.

    Args:
        robot: A machine whose strips follow each other along its wings, as many on each.
        count: Strips in all, a multiple of the number of wings.
    """
    strips: list[Strip] = []
    wings = list(robot.wing_names)
    share = count // len(wings)
    for wing in wings:
        old = [strip for strip in robot.strips if strip.wing == wing]
        edge = np.concatenate([[0.0], np.cumsum([strip.width for strip in old])])
        middle = (edge[1:] + edge[:-1]) / 2
        width = edge[-1] / share
        for k in range(share):
            along = (k + 0.5) * width
            like = old[min(int(np.searchsorted(edge, along, "right")) - 1, len(old) - 1)]
            points = np.array([strip.quarter_chord for strip in old])
            point = [_on_line(along, middle, points[:, axis]) for axis in range(3)]
            chord = float(np.interp(along, middle, [strip.chord for strip in old]))
            strips.append(
                replace(
                    like,
                    name=f"{wing}[{k}]",
                    quarter_chord=(point[0], point[1], point[2]),
                    chord=chord,
                    width=float(width),
                )
            )
    return replace(robot, name=f"{robot.name} of {count} strips", strips=tuple(strips), source="")


def _on_line(along: float, middle: np.ndarray, values: np.ndarray) -> float:
    """Value between the strips' middles, and on the same line beyond the first and last."""
    k = int(np.clip(np.searchsorted(middle, along) - 1, 0, len(middle) - 2))
    slope = (values[k + 1] - values[k]) / (middle[k + 1] - middle[k])
    return float(values[k] + slope * (along - middle[k]))


def _cost(model: AirModel) -> tuple[float, float]:
    """Time of a call [ns], and time to make it [s]."""
    started = time.perf_counter()
    function = compiled(model)
    making = time.perf_counter() - started
    return _time(function, model), making


def compiled(model: AirModel) -> NativeFunction:
    """Force and rate of the states, and added mass's force where there is any, as one function.

    Args:
        model: The model.
    """
    aero = model.aero
    added = "" if model.added_mass is None else " with added mass"
    key = f"cost of air {aero.key}{added} {aero.robot.structure}"
    label = f"{aero.name}{added} of {aero.robot.name}"
    return load_functions(key, lambda: [_function(model)], label=label)["cost"]


def _function(model: AirModel) -> ca.Function:
    aero, added = model.aero, model.added_mass
    robot, robot_parameters = aero.robot.symbolic()
    q, v, a = (ca.SX.sym(name, robot.dof) for name in "qva")
    state, wind = ca.SX.sym("state", aero.state_size), ca.SX.sym("wind", 3)
    parameters, carried = ca.SX.sym("c", len(aero.parameter_names)), ca.SX.sym("m", 2)
    air = aero.expressions(robot, q, v, state, wind, parameters)
    force = air.generalized_force
    if added is not None:
        force += kirchhoff_force(robot, q, v, a, added.inertia(robot, wind, carried))
        force += added.circulation_force(robot, q, v, wind, carried)
    return ca.Function(
        "cost",
        [q, v, a, state, wind, robot_parameters, parameters, carried],
        [force, air.state_derivative],
        [*("q", "v", "a", "state", "wind"),
         *("robot_parameters", "aero_parameters", "added_mass_parameters")],
        ["force", "rate"],
    )  # fmt: skip


def _time(function: NativeFunction, model: AirModel) -> float:
    rng, aero = np.random.default_rng(0), model.aero
    robot = aero.robot
    inputs = [
        rng.normal(scale=0.4, size=(STATES, robot.dof)),
        rng.normal(scale=3.0, size=(STATES, robot.dof)),
        rng.normal(scale=50.0, size=(STATES, robot.dof)),
        rng.normal(size=(STATES, aero.state_size)) if aero.state_size else np.zeros(0),
        np.array([-3.0, 0.0, 0.0]),
        robot.parameters,
        aero.parameters,
        AddedMass(robot).parameters,
    ]
    call = compiled_call(function)
    if call is not None:
        return time_call(call, inputs)
    one = [x[0] if x.ndim == 2 else x for x in inputs]
    return time_python(lambda: function(*one))

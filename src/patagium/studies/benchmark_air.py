"""What a model of the air costs: one model beside another, and as strips grow in number.

Force and rate of the model's states together, one state a call, compiled. Neglected:
what a flight adds around them.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from patagium.aerodynamics import (
    FOUR_STATE,
    ONE_STATE,
    TWO_STATE,
    Aerodynamics,
    Air,
    DeLaurier,
    LiftingLine,
    QuasiSteady,
    StallDelay,
)
from patagium.native import NativeFunction, load_functions
from patagium.robot.model import Robot, Strip
from patagium.studies.benchmark_result import Result, compared
from patagium.studies.benchmark_timing import compiled_call, time_call, time_python

STRIPS = (8, 16, 32, 64, 128)
STATES = 512


def model_results(robot: Robot) -> Iterator[Result]:
    """Every model of the air on the same robot, beside the quasi-steady one.

    Args:
        robot: A machine with strips.
    """
    air = Air()
    models: dict[str, Aerodynamics] = {
        "DeLaurier's strips": DeLaurier(robot, air),
        "lifting line, one state": LiftingLine(robot, air, ONE_STATE),
        "lifting line, two states": LiftingLine(robot, air, TWO_STATE),
        "lifting line, four states": LiftingLine(robot, air, FOUR_STATE),
        "lifting line, two states, stall delay": LiftingLine(
            robot, air, TWO_STATE, stall_delay=StallDelay()
        ),
    }
    first = "quasi-steady"
    base, _ = _cost(QuasiSteady(robot, air))
    note = f"force and rate of the states, {len(robot.strips)} strips, one state a call"
    yield Result(first, base, "ns", note=note)
    for name, model in models.items():
        yield compared(name, _cost(model)[0], "ns", first, base, note)


def strip_results(robot: Robot, counts: Sequence[int] = STRIPS) -> Iterator[Result]:
    """The lifting line with one state a strip, from few strips to many.

    Args:
        robot: A machine whose strips follow each other along its wings, as many on each.
        counts: Strips in all.
    """
    base, against = 0.0, f"lifting line, {counts[0]} strips"
    for count in counts:
        value, making = _cost(LiftingLine(restriped(robot, count), lags=ONE_STATE))
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
    """The same robot with another number of strips, of one width, on the span of its own.

    Args:
        robot: A machine whose strips follow each other along its wings, as many on each.
        count: Strips in all, a multiple of the number of wings.
    """
    strips: list[Strip] = []
    wings = list(dict.fromkeys(strip.wing for strip in robot.strips))
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
    return replace(robot, name=f"{robot.name} of {count} strips", strips=tuple(strips))


def _on_line(along: float, middle: np.ndarray, values: np.ndarray) -> float:
    """Value between the strips' middles, and on the same line beyond the first and last."""
    k = int(np.clip(np.searchsorted(middle, along) - 1, 0, len(middle) - 2))
    slope = (values[k + 1] - values[k]) / (middle[k + 1] - middle[k])
    return float(values[k] + slope * (along - middle[k]))


def _cost(model: Aerodynamics) -> tuple[float, float]:
    """Time of a call [ns], and time to make it [s]."""
    started = time.perf_counter()
    key = f"cost of air {model.structure} {model.robot.structure}"
    function = load_functions(
        key, lambda: [_function(model)], label=f"{model.name} of {model.robot.name}"
    )["cost"]
    making = time.perf_counter() - started
    return _time(function, model), making


def _function(model: Aerodynamics) -> ca.Function:
    robot, robot_parameters = model.robot.symbolic()
    q, v = ca.SX.sym("q", robot.dof), ca.SX.sym("v", robot.dof)
    state, wind = ca.SX.sym("state", model.state_size), ca.SX.sym("wind", 3)
    parameters = ca.SX.sym("c", len(model.parameter_names))
    air = model.expressions(robot, q, v, state, wind, parameters)
    return ca.Function(
        "cost",
        [q, v, state, wind, robot_parameters, parameters],
        [air.generalized_force, air.state_derivative],
        ["q", "v", "state", "wind", "robot_parameters", "aero_parameters"],
        ["force", "rate"],
    )


def _time(function: NativeFunction, model: Aerodynamics) -> float:
    rng, robot = np.random.default_rng(0), model.robot
    inputs = [
        rng.normal(scale=0.4, size=(STATES, robot.dof)),
        rng.normal(scale=3.0, size=(STATES, robot.dof)),
        rng.normal(size=(STATES, model.state_size)) if model.state_size else np.zeros(0),
        np.array([-3.0, 0.0, 0.0]),
        robot.parameters,
        model.parameters,
    ]
    call = compiled_call(function)
    if call is not None:
        return time_call(call, inputs)
    one = [x[0] if x.ndim == 2 else x for x in inputs]
    return time_python(lambda: function(*one))

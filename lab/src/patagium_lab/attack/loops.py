"""Targets that are closed loops: hostile controllers, events, sensors and plans.

What is accepted must fly: states of a flight that completed are finite. Neglected: controllers that
never return, and errors that a controller raises itself, which are its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import patagium as pt
from patagium import control
from patagium.cli.plan import Prepared, event_of, load_plan
from patagium.errors import Outcome
from patagium.robot import Robot
from patagium_lab.attack import seeds
from patagium_lab.attack.mutation import HOSTILE, Draw, mutated_yaml
from patagium_lab.attack.oracle import Target, WrongNumber

AREA = "loops"
_DURATION, _PERIOD = 0.02, 2e-3
_ODD: tuple[Any, ...] = (
    np.array([1.0, 2.0]), np.array(np.nan), np.float32(2.0), 1j, b"1", np.ma.masked, (1, 2, 3),
    (float("nan"), 0, 0), (1e300, 0, 0), ("a", "b", "c"), object(), lambda *given: None,
)  # fmt: skip


def loop_targets() -> Iterator[Target]:
    """Targets of the area, with their shares of the cases."""
    yield Target(AREA, "controllers and events", 1.0, _loops)
    yield Target(AREA, "plans that are flown", 0.5, _plans)


class Commander:
    """Controller that answers with what it was given.

    Args:
        answer: Commands of each call.
        period: Time between two calls [s].
    """

    def __init__(self, answer: Any, period: Any = _PERIOD) -> None:
        self.answer, self.period = answer, period

    def __call__(self, time: float, state: Any) -> Any:
        """Commands, whatever the state."""
        return self.answer


@cache
def _orbit() -> Any:
    return pt.trim(pt.load_robot("ornithopter"))


def _value(draw: Draw) -> Any:
    values = HOSTILE + _ODD
    return values[int(draw.integers(len(values)))]


def _commands(draw: Draw, robot: Robot) -> Any:
    if draw.random() < 0.2:
        return _value(draw)
    names = [*robot.actuators, "left_plunge_offset", "amplitude", "no_such", "\ud800"]
    return {str(draw.choice(names)): _value(draw) for _ in range(int(draw.integers(1, 3)))}


def _event(draw: Draw) -> Any:
    """An event with at most one hostile number."""
    kinds: tuple[tuple[Any, dict[str, Any]], ...] = (
        (control.GustEvent, {"velocity": (0.0, 0.0, 1.0), "length_time": 0.01}),
        (control.GustEvent, {"velocity": (0.0, 1.0, 0.0), "length_time": 0.01, "stays": True}),
        (control.PayloadEvent, {"body": "body", "mass": 1e-3, "position": (0.0, 0.0, 0.01)}),
        (control.WingLossEvent, {"wing": "left_wing", "share": 0.1}),
        (control.PolarEvent, {"factors": {"lift_amplitude": 0.9}}),
        (control.StuckEvent, {"command": "frequency", "value": 5.0}),
    )
    kind, words = kinds[int(draw.integers(len(kinds)))]
    words = {"time": 0.01, **words}
    if draw.random() < 0.8:
        words[str(draw.choice(list(words)))] = _value(draw)
    return kind(**words)


def _loops(folder: Path) -> Callable[[Draw], None]:
    """Case of a closed loop with one hostile argument, or hostile commands."""
    orbit, air = _orbit(), pt.QuasiSteady(_orbit().robot, pt.Air())
    names = ("duration", "time_step", "seed", "q", "v", "sensors", "learner", "events", "period")

    def case(draw: Draw) -> None:
        given: dict[str, Any] = {"duration": _DURATION, "throw": False}
        answer: Any = {}
        period: Any = _PERIOD
        kind = int(draw.integers(3))
        if kind == 0:
            answer = _commands(draw, orbit.robot)
        elif kind == 1:
            given["events"] = [_event(draw) for _ in range(int(draw.integers(1, 3)))]
        else:
            name, value = str(draw.choice(names)), _value(draw)
            if name == "period":
                period = value
            else:
                given[name] = value
        flown(pt.fly(orbit.robot, air, Commander(answer, period), orbit=orbit, **given))

    return case


def flown(flight: Any) -> None:
    """Refuse a flight that completed with numbers that are not.

    Args:
        flight: The flight.

    Raises:
        WrongNumber: If a state is not finite.
    """
    if flight.attrs["outcome"] != Outcome.COMPLETED.name:
        return
    for name in ("q", "v", "a"):
        if not np.isfinite(flight[name].to_numpy()).all():
            raise WrongNumber(f"{name} of a flight that completed is not finite")


def _plans(folder: Path) -> Callable[[Draw], None]:
    """Case of a plan whose controller, sensors, truth and events are hostile, flown for 20 ms."""
    orbit, path = _orbit(), folder / "plan.yaml"
    tree = yaml.safe_load(seeds.PLAN)
    tree |= {"duration": "20 ms", "truth": {**tree["truth"], "air": "quasi-steady"}}
    tree["truth"]["polar"] = {"lift_amplitude": 0.9}
    del tree["truth"]["added_mass"]  # it is compiled
    for event in tree["events"]:
        event["time"] = "10 ms"
        if event["type"] == "polar":
            event["factors"] = {"lift_amplitude": 0.8}
    content = yaml.safe_dump(tree, sort_keys=False).encode()
    law = control.LinearRegulator(orbit, list(orbit.robot.actuators))

    def case(draw: Draw) -> None:
        fly(mutated_yaml(content, draw))

    def fly(text: bytes) -> None:
        path.write_bytes(text)
        plan = load_plan(path)
        if plan.duration is None or 1 > plan.duration > _DURATION:
            plan = plan.model_copy(update={"duration": _DURATION})
        if 1e-9 < plan.time_step < 1e-5:
            plan = plan.model_copy(update={"time_step": 1e-5})
        if plan.truth.air != "quasi-steady":  # another air is compiled
            truth = plan.truth.model_copy(update={"air": "quasi-steady"})
            plan = plan.model_copy(update={"truth": truth})
        events = tuple(event_of(one) for one in plan.events or ())
        known = plan.sensors.known(orbit.robot)
        flown(Prepared(plan, orbit, law, plan.duration or _DURATION, events, known).fly())

    fly(content)  # what is compiled, is now
    return case

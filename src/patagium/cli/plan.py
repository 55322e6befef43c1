"""Plan of a closed loop: a YAML file that says what flies, what is known, and what happens.

Only `robot` is needed; the rest is chosen, and `Prepared.words` says how.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias, Union

import xarray as xr

from pydantic import (  # isort: skip
    AfterValidator, BaseModel, ConfigDict, Field, StrictBool, StrictInt,
    ValidationError, ValidationInfo, create_model, model_validator,
)  # fmt: skip
from patagium.aerodynamics import QuasiSteady
from patagium.arguments import Progress
from patagium.cli.estimates import DENSITY, air_word, chosen_air, tell_unseen
from patagium.control.adaptation import AdaptiveController
from patagium.control.estimators import NoisyState, TrackedState
from patagium.control.events import (
    Event,
    GustEvent,
    PayloadEvent,
    PolarEvent,
    StuckEvent,
    WingLossEvent,
    off_nominal,
)
from patagium.control.gait_family import gait_family
from patagium.control.loop import fly
from patagium.control.lqr import LinearRegulator
from patagium.control.orbit import NoOrbit, Orbit
from patagium.control.predictive import OrbitController, PredictiveController
from patagium.control.route import Route
from patagium.control.trimming import free_parameters, trim
from patagium.errors import LogError, ParameterError, PatagiumError, positive
from patagium.limits import ROBOT_FILE
from patagium.reading import beside, parsed_yaml, refused, text_of
from patagium.robot import Robot, load_robot

from patagium.robot.units import (  # isort: skip
    Duration, Frequency, Length, Mass, PureNumber, Speed, quantity_type, si_at,
)  # fmt: skip
from patagium.sensing.sensors import presets
from patagium.sensing.sensors.sensor import Sensor
from patagium.simulation import gaits

_Density: TypeAlias = quantity_type("kg/m^3")  # type: ignore[valid-type]
Density: TypeAlias = Annotated[_Density, Field(gt=0)]
TurnRate: TypeAlias = quantity_type("rad/s")  # type: ignore[valid-type]
Velocity: TypeAlias = Annotated[tuple[Speed, Speed, Speed], Field(examples=["[0, 0, 1 m/s]"])]
BEATS = 40
"""Duration of a flight in wingbeats where none is given."""
TRUE_SHARE = 1.2 / DENSITY
"""Density of a truth that was not learned, where none is given, over that of the model [1]."""
GUST_SHARE = 0.1
"""Gust over the speed where no event is given."""


def _in_si(written: Any, info: ValidationInfo, name: str = "") -> Any:
    """Numbers by state in SI, or that of a command, once the robot is known."""
    robot = info.context
    if robot is None or (written is None and not name):
        return written
    if isinstance(written, dict):
        return {key: _in_si(one, info, key) for key, one in written.items()}
    rate, _, state = name.rpartition(" of ")
    if name not in robot.actuators and name and state not in robot.dof_names:
        known = robot.dof_names
        expected = f"a coordinate ({', '.join(known)}), or `velocity of` one"
        raise ParameterError("state", expected, name, known)
    key = info.data.get("command", name)
    kind, joints = robot.command(key)
    unit = {"frequency": "Hz", "phase": "rad"}.get(kind, "")  # of an amplitude: over the gait's
    if kind == "offset" and joints:
        unit = robot.dof_units[robot.index(joints[0])]
    if state in robot.dof_names:
        per = {"velocity": "/s", "acceleration": "/s^2"}.get(rate, "")
        unit = robot.dof_units[robot.index(state)] + per
    return si_at(written, unit, name, "a quantity")


def _parameters(names: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
    """Names of gait parameters, which the cruise has, once the robot is known."""
    if info.context is not None and names:
        gait_family(info.context, gaits.cruise(info.context), names)
    return names


AirWord: TypeAlias = Annotated[str, AfterValidator(air_word)]
Parameters: TypeAlias = Annotated[tuple[str, ...], AfterValidator(_parameters)]
States: TypeAlias = Annotated[dict[str, Any], AfterValidator(_in_si)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def check(self, robot: Robot) -> None:
        """Refuse values that this robot does not allow."""

    @model_validator(mode="after")
    def _possible(self, info: ValidationInfo) -> Self:
        if info.context is not None:
            self.check(info.context)
        return self


class TrimPart(_Part):
    """Conditions of the orbit, and the air that the controller's model has."""

    speed: Speed | None = None
    climb: Speed | None = None
    turn_rate: TurnRate = 0.0
    free: Parameters = ()
    air: AirWord = "quasi-steady"
    density: Density | None = None


class TruthPart(_Part):
    """Truth that flies: masses and inertias off the file's, other air."""

    masses: Annotated[PureNumber, Field(ge=0, lt=0.3, examples=["0.02"])] = 0.01
    air: AirWord = "quasi-steady"
    density: Density | None = None
    wind: Velocity | None = None
    added_mass: Annotated[PureNumber, Field(ge=0)] | None = None
    polar: dict[str, PureNumber] = {}


class ControllerPart(_Part):
    """Controller along the orbit; with `learn` its model of the air relearns in flight."""

    type: Literal["predictive", "regulator", "averaged"] = "predictive"
    commands: Parameters = ()
    tolerable: States = {}
    learn: StrictBool = False

    def check(self, robot: Robot) -> None:
        """Refuse a tolerable size that is not positive."""
        for name, size in self.tolerable.items():
            positive(f"tolerable.{name}", size)


class LegPart(_Part):
    """Orbit from a time on; conditions that are not given stay those of the orbit before."""

    time: Annotated[Duration, Field(gt=0)]
    speed: Speed | None = None
    climb: Speed | None = None
    turn_rate: TurnRate | None = None


class SensorPart(_Part):
    """Sensor with the noise of its data sheet, from `patagium.sensing.sensors.presets`."""

    type: Literal["icm_42688_p", "bmi270", "as5600", "prime_x_13"]
    body: str = ""
    rate: Frequency | None = None
    delay: Duration | None = None

    def sensor(self, robot: Robot) -> Sensor:
        """Sensor on a robot, on its first body where none is named."""
        rate = {} if self.rate is None else {"rate": self.rate}
        body = self.body or robot.bodies[0].name
        robot.body_index(body)
        given = () if self.type == "as5600" else (body,)
        made: Sensor = getattr(presets, self.type)(*given, **rate)
        return made if self.delay is None else replace(made, delay=self.delay)


class SensorsPart(_Part):
    """Knowledge of the state: `NoisyState`, or with `parts` the tracker of sensors."""

    std: States = {}
    delay: Duration = 0.0
    missing: PureNumber = 0.0
    parts: tuple[SensorPart, ...] = ()

    def check(self, robot: Robot) -> None:
        """Refuse sensors that this robot cannot carry, or numbers out of range."""
        self.known(robot)

    def known(self, robot: Robot) -> NoisyState | TrackedState:
        """Source of the estimates.

        Raises:
            ParameterError: If numbers are not possible, or there are other keys with `parts`.
        """
        state = NoisyState(self.std, self.delay, self.missing)
        if not self.parts:
            return state
        if state != NoisyState():
            raise ParameterError("sensors", "parts, or std, delay and missing", "both")
        return TrackedState([part.sensor(robot) for part in self.parts])


_TYPES: dict[str, Any] = {
    **dict.fromkeys(("time", "length_time"), Duration),
    **{"velocity": Velocity, "mass": Mass, "share": PureNumber, "stays": StrictBool},
    "position": tuple[Length, Length, Length] | None,
    "factors": dict[str, PureNumber],
    "value": Annotated[Any, AfterValidator(_in_si)],
}
"""Types of the fields of events; others are names."""
EVENTS: dict[str, type[Event]] = {
    "gust": GustEvent,
    "payload": PayloadEvent,
    "wing_loss": WingLossEvent,
    "polar": PolarEvent,
    "stuck": StuckEvent,
}


class _EventPart(_Part):
    def check(self, robot: Robot) -> None:
        """Refuse an event that this robot cannot have; a polar is checked in flight."""
        event = event_of(self)
        event.gust()
        if not isinstance(event, PolarEvent):
            event.changed(robot, QuasiSteady(robot))


def _event_part(name: str, kind: type[Event]) -> Any:
    """Event of a kind, as a plan has it."""
    given: dict[str, Any] = {"type": (Literal[name], ...)}
    for one in fields(kind):
        default = ... if one.default is MISSING else one.default
        given[one.name] = (_TYPES.get(one.name, str), default)
    return create_model(kind.__name__, __base__=_EventPart, **given)


_PARTS: Any = Union[tuple(_event_part(*one) for one in EVENTS.items())]  # noqa: UP007
EventPart: TypeAlias = Annotated[_PARTS, Field(discriminator="type")]


class Plan(_Part):
    """Plan of a closed loop, as its file has it."""

    robot: Annotated[str, Field(examples=["ornithopter"])]
    trim: TrimPart = TrimPart()
    truth: TruthPart = TruthPart()
    controller: ControllerPart = ControllerPart()
    legs: tuple[LegPart, ...] = ()
    sensors: SensorsPart = SensorsPart()
    events: tuple[EventPart, ...] | None = None
    duration: Annotated[Duration, Field(gt=0)] | None = None
    time_step: Annotated[Duration, Field(gt=0)] = 1e-4
    seed: Annotated[StrictInt, Field(ge=0)] = 0


def load_plan(name_or_path: str | Path) -> Plan:
    """Plan from a file, or the one that a robot's name stands for.

    Args:
        name_or_path: A YAML file with the key `robot`, beside which a robot file is looked for
            first; or a preset or robot file.

    Raises:
        LogError: If the file or its robot cannot be read, or it is no plan: a line for each key.
        RobotFileError: If it is neither a file nor a preset.
    """
    path = Path(name_or_path)
    if path.suffix not in (".yaml", ".yml"):
        load_robot(name_or_path)
        return Plan(robot=str(name_or_path))
    text = text_of(path, ROBOT_FILE)
    described = parsed_yaml(text, str(path), aliases=False)
    if isinstance(described, dict) and {"bodies", "mounted_on"} & {*described}:
        return Plan(robot=str(name_or_path))
    try:
        plan = Plan.model_validate(described)
        robot = beside(path, plan.robot)
        told = {**described, "robot": robot}
        for name, part in (("trim", plan.trim), ("truth", plan.truth)):
            if part.air.endswith(".json"):
                told[name] = {**described[name], "air": beside(path, part.air)}
        return Plan.model_validate(told, context=load_robot(robot))
    except ValidationError as problem:
        raise refused(str(path), problem.errors(), Plan, text) from None
    except PatagiumError as error:
        raise LogError(f"{path}: robot: {error}") from None


@dataclass(frozen=True)
class Prepared:
    """Plan whose orbit is found.

    Attributes:
        plan: The plan.
        orbit: The orbit.
        controller: Controller along the orbit.
        duration: Duration of the flight [s].
        events: Events of the flight.
        sensors: Source of the estimated state.
    """

    plan: Plan
    orbit: Orbit
    controller: OrbitController | AdaptiveController | Route
    duration: float
    events: tuple[Event, ...]
    sensors: NoisyState | TrackedState

    @property
    def words(self) -> tuple[str, ...]:
        """Sentences that say what was chosen."""
        plan, truth, orbit = self.plan, self.plan.truth, self.orbit
        known = self.sensors
        told = repr(known)
        if known == NoisyState():
            told = "the true state"
        if isinstance(known, TrackedState):
            names = [one.name for one in known.sensors]
            told = f"what a tracker makes of {', '.join(names)}"
        commands = ", ".join(self.controller.model.commands)
        learns = "; its model relearns in flight" * plan.controller.learn
        turns = f", turn {orbit.turn_rate:.3g} rad/s" * bool(plan.trim.turn_rate)
        happen = [f"at {one.time:.3g} s {one.words}" for one in self.events]
        events = "; ".join(happen) or "none"
        return (
            f"Orbit of {orbit.robot.name}: {_way(orbit)}{turns}, {1 / orbit.period:.3g} Hz",
            *self._legs(),
            f"Controller: {plan.controller.type}, commands {commands}{learns}",
            f"Truth: masses and inertias off by {100 * truth.masses:g} % "
            f"(std; seed {plan.seed}), {_air_words(truth, self._density)}, "
            f"the model's {_air_words(plan.trim, DENSITY)}",
            f"Known: {told}",
            f"Flight of {self.duration:.3g} s; events: {events}",
        )

    @property
    def _density(self) -> float:
        """Density of a truth that says none and was not learned [kg/m^3]."""
        return self.orbit.aero.air.density * TRUE_SHARE

    def _legs(self) -> list[str]:
        found = self.controller.legs if isinstance(self.controller, Route) else {}
        return [
            f"From {time:.3g} s on: {_way(one)}, turn {round(one.turn_rate, 9) + 0.0:.3g} rad/s"
            for time, one in found.items()
        ]

    def fly(self, progress: Progress | None = None) -> xr.Dataset:
        """Flight of the plan, up to where it breaks.

        Raises:
            ParameterError: If a name or number of the plan is not possible.
        """
        plan, truth = self.plan, self.plan.truth
        robot = off_nominal(self.orbit.robot, truth.masses, plan.seed)
        aero, carried, _ = chosen_air(
            truth.air, robot, usual=self._density, factor=truth.added_mass,
            density=truth.density, wind=truth.wind,
        )  # fmt: skip
        if truth.polar:
            _, aero = PolarEvent(time=0.0, factors=truth.polar).changed(robot, aero)
        return fly(
            robot, aero, self.controller, orbit=self.orbit, duration=self.duration,
            sensors=self.sensors, events=self.events,
            added_mass=carried, seed=plan.seed, time_step=plan.time_step, throw=False,
            progress=progress,
        )  # fmt: skip


def prepared(plan: Plan) -> Prepared:
    """Plan with its orbit found and its controller made.

    Raises:
        ParameterError: If a condition or command of the plan is not possible.
        PatagiumError: If there is no such orbit; it says what is lacking.
    """
    robot, given = load_robot(plan.robot), plan.trim
    aero, added, learned = chosen_air(given.air, robot, density=given.density)
    gait = gaits.cruise(robot)
    free = given.free or free_parameters(robot, gait, given.turn_rate)
    climb = 0.0 if given.climb is None and gait.period else given.climb  # a glide's is free
    asked = {"speed": given.speed, "climb": climb, "turn_rate": given.turn_rate}
    orbit = _found(trim(robot, aero, gait, free=free, added_mass=added, **asked))
    tell_unseen(learned, orbit)
    named = plan.controller.commands or tuple(robot.actuators)
    if not named:
        expected = "`actuators` in the robot's file for what steers it (frequency, amplitudes of "
        expected += "both sides, an offset: patagium robots --new writes a file with them)"
        raise ParameterError("controller: commands", expected, None)
    law = _controller(plan.controller, orbit, named)
    controller = _route(plan.legs, law, orbit) if plan.legs else law
    duration = BEATS * orbit.period if plan.duration is None else plan.duration
    positive("duration", duration, "a positive number of seconds")
    upward = GUST_SHARE * max(abs(orbit.speed), 1.0)
    gust: Any = {"velocity": (0.0, 0.0, upward), "length_time": 2 * orbit.period}
    events: tuple[Event, ...] = (GustEvent(time=duration / 3, **gust),)
    if plan.events is not None:
        events = tuple(map(event_of, plan.events))
    return Prepared(plan, orbit, controller, duration, events, plan.sensors.known(robot))


def _way(orbit: Orbit) -> str:
    """Speed and climb of an orbit, in words."""
    return f"{orbit.speed:.3g} m/s, climb {round(orbit.climb, 9) + 0.0:.3g} m/s"


def _air_words(part: TrimPart | TruthPart, usual: float) -> str:
    """A model of the air and its density, in words."""
    learned = part.air.endswith(".json")
    density = None if learned and part.density is None else part.density or usual
    return f"{part.air} air" + ("" if density is None else f" of {density:g} kg/m^3")


def _found(orbit: Orbit | NoOrbit, of: str = "") -> Orbit:
    if isinstance(orbit, NoOrbit):
        raise PatagiumError(f"{of}{orbit!r}")
    return orbit


def _route(
    legs: tuple[LegPart, ...], controller: OrbitController | AdaptiveController, orbit: Orbit
) -> Route:
    """Route along the orbits of legs, each found from the first with all commands."""
    if isinstance(controller, AdaptiveController):
        raise ParameterError("legs", "a controller that does not learn", "learn: true")
    conditions = {name: getattr(orbit, name) for name in ("speed", "climb", "turn_rate")}
    route: dict[float, Orbit] = {}
    for leg in legs:
        conditions |= {k: x for k in conditions if (x := getattr(leg, k)) is not None}
        free = controller.model.commands
        known = {"gait": orbit.gait, "free": free, "start": orbit, **conditions}
        found = trim(orbit.robot, orbit.aero, added_mass=orbit.added_mass, **known)
        route[leg.time] = _found(found, f"the leg at {leg.time:g} s: ")
    return Route(controller, route)


def _controller(
    part: ControllerPart, orbit: Orbit, named: tuple[str, ...]
) -> OrbitController | AdaptiveController:
    kinds: dict[str, Callable[..., OrbitController]] = {
        "predictive": PredictiveController,
        "regulator": LinearRegulator,
        "averaged": partial(LinearRegulator, averaged=True),
    }
    law = kinds[part.type](orbit, named, tolerable=dict(part.tolerable))
    return AdaptiveController(law) if part.learn else law


def event_of(part: BaseModel) -> Event:
    """Event of the loop, of that of a plan."""
    told = dict(part)
    return EVENTS[told.pop("type")](**told)

"""Wrong arguments of `pt.fly`, and commands that are no numbers, are refused by one sentence."""

from __future__ import annotations

import re
from typing import Any, TypeVar

import numpy as np
import pytest
import xarray as xr
from typing_extensions import TypeAliasType

import patagium as pt
from patagium.arguments import checked
from patagium.errors import ParameterError, PatagiumError, ShapeError
from patagium.simulation.steered_gait import SteeredGait

ROBOT = pt.load_robot("ornithopter")


@pytest.mark.parametrize("value", [np.nan, np.inf, None, "x", [1, 2], 1j, b"1", {}, np.ones(2)])
def test_a_command_that_is_no_number_is_refused(value: Any) -> None:
    gait = SteeredGait(ROBOT, pt.gaits.cruise(ROBOT))
    with pytest.raises(ParameterError, match="frequency"):
        gait.command(0.0, {"frequency": value})


@pytest.mark.parametrize("name", [1, None, "no_such", "\ud800", ("frequency",)])
def test_a_name_that_is_no_command_is_refused(name: Any) -> None:
    with pytest.raises(ParameterError, match="command"):
        SteeredGait(ROBOT, pt.gaits.cruise(ROBOT)).command(0.0, {name: 1.0})


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (pt.control.PayloadEvent, "position", 5),
        (pt.control.PayloadEvent, "position", ("a", 0, 0)),
        (pt.control.PayloadEvent, "mass", np.timedelta64(1, "s")),
        (pt.control.PayloadEvent, "time", 10**400),
        (pt.control.PolarEvent, "factors", 1.0),
        (pt.control.PolarEvent, "factors", {"lift_amplitude": np.nan}),
        (pt.control.GustEvent, "velocity", (0.0, np.inf, 0.0)),
        (pt.control.GustEvent, "velocity", (0.0, 1.0)),
        (pt.control.StuckEvent, "command", ["frequency"]),
    ],
)
def test_an_event_of_hostile_numbers_is_refused(kind: Any, name: str, value: Any) -> None:
    words = {
        pt.control.PayloadEvent: {"body": "body", "mass": 0.01},
        pt.control.PolarEvent: {"factors": {"lift_amplitude": 0.9}},
        pt.control.GustEvent: {"velocity": (0.0, 0.0, 1.0), "length_time": 0.01},
        pt.control.StuckEvent: {"command": "frequency"},
    }
    with pytest.raises(ParameterError, match=f"^{name}: (lift_amplitude: )?expected"):
        kind(**{"time": 0.0, **words[kind], name: value})


HOSTILE = (None, "x", b"1", object(), [[1], 2], {1}, 1j, np.nan, 10**400, np.ma.masked, {})


@pytest.mark.parametrize("value", HOSTILE, ids=lambda value: type(value).__name__)
@pytest.mark.parametrize(
    ("function", "given", "name"),
    [
        (pt.trim, {"robot": ROBOT}, "robot"),
        (pt.trim, {"robot": ROBOT}, "turn_rate"),
        (pt.trim, {"robot": ROBOT}, "tolerable"),
        (pt.trim, {"robot": ROBOT}, "steps"),
        (pt.control.continue_orbit, {"along": "speed", "limits": (4.0, 6.0)}, "orbit"),
        (pt.control.continue_orbit, {"orbit": ..., "limits": (4.0, 6.0)}, "along"),
        (pt.control.continue_orbit, {"orbit": ..., "along": "speed"}, "limits"),
        (pt.control.floquet, {}, "orbit"),
        (pt.control.optimize, {"robot": ROBOT}, "harmonics"),
        (pt.control.power_front, {"robot": ROBOT}, "speeds"),
        (pt.control.LinearRegulator, {"orbit": ...}, "commands"),
        (pt.control.PredictiveController, {"commands": ["frequency"]}, "orbit"),
        (pt.control.off_nominal, {"robot": ROBOT, "share": 0.1}, "seed"),
    ],
)
def test_a_hostile_argument_is_refused_by_its_name(
    function: Any, given: Any, name: str, value: Any, ornithopter_orbit: Any
) -> None:
    if name in ("tolerable", "steps") and value is None or value == {} and name == "tolerable":
        pytest.skip("that is what it is where nobody gives it")
    orbit = {"orbit": ornithopter_orbit} if "orbit" in given else {}
    known = {} if name in given else {**given, **orbit}
    with pytest.raises(PatagiumError, match=f"^{name}: expected"):
        function(**known, **{name: value})


@pytest.mark.parametrize("name", ["estimator", "progress"])
def test_an_option_of_a_flight_that_cannot_be_called_is_refused(
    name: str, ornithopter_orbit: Any
) -> None:
    law = pt.control.LinearRegulator(ornithopter_orbit, list(ROBOT.actuators))
    air = pt.QuasiSteady(ROBOT)
    with pytest.raises(ParameterError, match=f"^{name}: expected"):
        pt.fly(ROBOT, air, law, orbit=ornithopter_orbit, duration=0.02, **{name: 5})


def test_an_array_is_as_good_as_a_tuple_where_none_may_stand_too() -> None:
    told = [
        pt.control.PayloadEvent(time=0.1, body="body", mass=0.01, position=where)
        for where in (np.ones(3), [1.0, 1.0, 1.0], (1.0, 1.0, 1.0))
    ]
    assert told[0] == told[1] == told[2] and told[0].position == (1.0, 1.0, 1.0)


@pytest.mark.parametrize("number", [np.array, np.float32, xr.DataArray])
def test_an_array_without_axes_is_its_number(number: Any) -> None:
    """Commands, durations and records take arrays of shape (), which indexing returns."""

    def flown(as_given: Any) -> Any:
        return pt.simulate(
            ROBOT, pt.QuasiSteady(ROBOT, pt.Air(density=as_given(1.25))), pt.gaits.cruise(ROBOT),
            duration=as_given(0.125), time_step=as_given(2**-10),
            v=ROBOT.velocities(x=as_given(6.0)),
            controller=lambda time, state: {"elevation_offset": as_given(0.125)},
        )  # fmt: skip

    assert flown(number).identical(flown(float))
    heavy = ROBOT.with_parameters({"body.mass": number(0.5)})
    assert heavy == ROBOT.with_parameters({"body.mass": 0.5})


@pytest.mark.parametrize("value", [np.ma.masked, np.array(1j), np.array("1"), np.array(np.nan)])
def test_an_array_without_axes_that_holds_no_number_is_refused(value: Any) -> None:
    with pytest.raises(ParameterError, match="expected a (positive|finite) number"):
        pt.Air(density=value)
    with pytest.raises(ParameterError, match="x: expected a finite number"):
        ROBOT.coordinates(x=value)


@pytest.mark.parametrize("cost", [np.ones((2, 3)), np.ones(3), np.array(1.0), np.ones((2, 2, 2))])
@pytest.mark.parametrize("name", ["state_cost", "input_cost"])
def test_a_cost_that_is_no_square_matrix_is_refused(name: str, cost: Any) -> None:
    given = {"state_cost": np.eye(2), "input_cost": np.eye(2), name: cost}
    with pytest.raises(ShapeError, match=f"^{name}: expected"):
        pt.control.RealTimeIteration(print, 2, **given)


def test_costs_are_taken_as_lists_of_finite_numbers() -> None:
    iteration = pt.control.RealTimeIteration(print, 2, [[1, 0], [0, 2]], [[3]])
    assert iteration.final_cost.tolist() == [[1.0, 0.0], [0.0, 2.0]]
    with pytest.raises(ParameterError, match="input_cost: expected finite numbers"):
        pt.control.RealTimeIteration(print, 2, [[1.0]], [[np.nan]])


def test_an_alias_of_a_type_stands_for_the_type() -> None:
    """As NDArray does in NumPy 2.5, where any value fitted it."""
    scalar = TypeVar("scalar", bound=np.generic)
    array = np.ndarray[Any, np.dtype[scalar]]  # type: ignore[type-var]
    alias = TypeAliasType("alias", array, type_params=(scalar,))[np.float64]

    @checked
    def last(values: Any) -> float:
        return float(values[-1])

    last.__wrapped__.__annotations__["values"] = alias  # type: ignore[attr-defined]
    assert last(np.ones(2)) == 1.0
    with pytest.raises(ParameterError, match="^values: expected"):
        last("text")


class Steering:
    """Controller that gives the same commands at each call."""

    period = 0.02

    def __init__(self, commands: Any) -> None:
        self.commands = commands

    def __call__(self, time: float, state: Any) -> Any:
        return self.commands


@pytest.mark.parametrize(
    ("stuck", "commanded", "moved"),
    [
        ("left_plunge_amplitude", {"plunge_amplitude": 0.5}, [0.8, 0.5]),
        ("plunge_amplitude", {"left_plunge_amplitude": 0.5, "right_plunge_amplitude": 0.5}, None),
        ("plunge_amplitude", {"amplitude": 0.5}, None),
    ],
)
def test_what_is_stuck_stays_stuck_whatever_a_command_is_called(
    stuck: str, commanded: Any, moved: Any, ornithopter_orbit: Any
) -> None:
    gait = ornithopter_orbit.gait
    event = pt.control.StuckEvent(time=0.02, command=stuck, value=0.8)
    flight = pt.fly(
        ROBOT, pt.QuasiSteady(ROBOT), Steering(commanded), orbit=ornithopter_orbit,
        duration=0.9, time_step=2e-3, events=[event], throw=False,
    )  # fmt: skip
    names = ["left_plunge", "right_plunge"]
    last = flight["q"].sel(dof=names).values[-round(gait.period / flight.attrs["time_step"]) :]
    places = [gait.joints.index(name) for name in names]
    own = np.ptp(gait.motion(np.linspace(0, gait.period, 200)).position[:, places], axis=0)
    assert np.ptp(last, axis=0) / own == pytest.approx(moved or [0.8, 0.8], abs=0.01)


def test_commands_that_move_the_same_are_refused(ornithopter_orbit: Any) -> None:
    for more in ("frequency", "left_plunge_amplitude", "amplitude"):
        with pytest.raises(ParameterError, match="^commands: expected each once, and not a pair"):
            pt.control.LinearRegulator(ornithopter_orbit, [*ROBOT.actuators, more])
    with pytest.raises(ParameterError, match="^free: expected each gait parameter once"):
        pt.trim(ROBOT, free=("frequency", "frequency"))
    with pytest.raises(ParameterError, match="and each once"):
        pt.control.optimize(
            ornithopter_orbit.robot, start=ornithopter_orbit, free=("frequency", "frequency")
        )


@pytest.fixture(scope="module")
def regulator(ornithopter_orbit: Any) -> Any:
    return pt.control.LinearRegulator(ornithopter_orbit, list(ROBOT.actuators))


def test_a_controller_is_called_at_its_own_period(ornithopter_orbit: Any, regulator: Any) -> None:
    calls: list[float] = []

    class Counting:
        period = regulator.period

        def __call__(self, time: float, state: Any) -> dict[str, float]:
            calls.append(time)
            return {}

    orbit, wanted = ornithopter_orbit, regulator.period * np.arange(10)
    orbit.flight(beats=1, controller=Counting())
    assert calls == pytest.approx(wanted)
    words = {"duration": 10 * regulator.period, "time_step": regulator.period / 8}
    flying = pt.Simulator(ROBOT, pt.QuasiSteady(ROBOT), orbit.gait, **words, **orbit.start())
    flying.fly(Counting())
    assert calls == pytest.approx([*wanted, *wanted])
    del words["time_step"]  # what is chosen divides the period
    start, air = orbit.start(), pt.QuasiSteady(ROBOT)
    flight = pt.simulate(ROBOT, air, orbit.gait, controller=Counting(), **words, **start)
    assert calls == pytest.approx([*wanted, *wanted, *wanted])
    assert regulator.period / flight.attrs["time_step"] == pytest.approx(45)  # of 400 a beat
    words["duration"] = 10.3 * regulator.period  # and the flight is as many as come nearest
    flight = pt.simulate(ROBOT, air, orbit.gait, controller=Counting(), **words, **start)
    assert abs(flight["time"].values[-1] - words["duration"]) <= 0.51 * flight.attrs["time_step"]
    for share in (0.25, 3):
        with pytest.raises(ParameterError, match="^control_period: expected the controller's"):
            orbit.flight(controller=regulator, control_period=share * regulator.period)
    with pytest.raises(ParameterError, match="time_step: expected the control period of"):
        orbit.flight(controller=Counting(), time_step=regulator.period / 7.5)
    assert orbit.flight(beats=1, time_step=orbit.period / 400).sizes["time"] == 401


def test_a_controller_made_for_another_flight_is_refused(
    ornithopter_orbit: Any, regulator: Any
) -> None:
    fast = pt.trim(ROBOT, speed=6.0)
    air = pt.QuasiSteady(ROBOT)
    with pytest.raises(ParameterError, match="made for the orbit whose gait is flown"):
        pt.fly(ROBOT, air, regulator, orbit=fast, duration=0.1)
    with pytest.raises(ParameterError, match="made for the orbit whose gait is flown"):
        fast.flight(beats=1, controller=regulator)
    other = pt.load_robot("aerobat")
    adaptive = pt.control.AdaptiveController(regulator)
    for controller in (regulator, adaptive):
        with pytest.raises(ParameterError, match="made for aerobat, found 'ornithopter'"):
            pt.simulate(
                other, pt.QuasiSteady(other), pt.gaits.cruise(other),
                duration=0.1, controller=controller,
            )  # fmt: skip
    heavy = ROBOT.with_parameters({"body.mass": 1.1 * float(ROBOT.bodies[0].mass)})
    pt.fly(heavy, pt.QuasiSteady(heavy), regulator, orbit=ornithopter_orbit, duration=0.02)


@pytest.mark.parametrize(
    "mount",
    [pt.mounts.fixed(), pt.mounts.carried(pt.paths.line((0, 0, 1), (1, 0, 1), duration=1.0))],
)
def test_a_controller_of_a_free_flight_is_refused_on_a_mount(
    ornithopter_orbit: Any, regulator: Any, mount: Any
) -> None:
    orbit = ornithopter_orbit
    adaptive = pt.control.AdaptiveController(regulator)
    words = {"duration": 10 * regulator.period, "time_step": regulator.period / 8}
    flying = pt.Simulator(ROBOT, orbit.aero, orbit.gait, mount=mount, **words)
    for controller in (regulator, adaptive):
        with pytest.raises(ParameterError, match=f"mount: expected free.*found '{mount.kind}'"):
            pt.simulate(ROBOT, orbit.aero, orbit.gait, mount=mount, controller=controller, **words)
        with pytest.raises(ParameterError, match=f"mount: expected free.*found '{mount.kind}'"):
            flying.fly(controller)


QUATERNION = 'robot: expected one with Euler angles .*"euler".*found .*ornithopter with a quat'


def test_a_quaternion_is_refused_with_the_remedy(ornithopter_orbit: Any, regulator: Any) -> None:
    orbit = ornithopter_orbit
    robot = orbit.robot.with_attitude("quaternion")
    aero = pt.QuasiSteady(robot)

    class Own:
        period = regulator.period

        def __call__(self, time: float, state: Any) -> dict[str, float]:
            return {}

    for controller in (regulator, Own()):
        with pytest.raises(ParameterError, match=QUATERNION):
            pt.fly(robot, aero, controller, orbit=orbit, duration=0.1)
    with pytest.raises(ParameterError, match=QUATERNION):
        pt.simulate(robot, aero, orbit.gait, duration=0.1, controller=regulator)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"limits": {"velocity of z": (3, -3)}}, "limits: velocity of z: expected the least first"),
        (
            {"limits": {"z": 0.3}},
            "limits: z: expected 2 numbers, each a finite number or None, found 0.3",
        ),
        ({"limits": {"z": (np.nan, 1)}}, "limits: z: expected 2 numbers, each a finite number"),
        ({"limits": {1: (0, 1)}}, "limits: a name: expected text, found 1"),
        (  # taken without a word, and fought all along the orbit
            {"limits": {"velocity of z": (50, None)}},
            "limits: velocity of z: expected limits that hold the orbit's -",
        ),
        ({"horizon": 0}, "horizon: expected one interval at least, found 0"),
    ],
)
def test_limits_and_horizons_that_are_none_are_refused(
    words: Any, said: str, ornithopter_orbit: Any
) -> None:
    with pytest.raises(ParameterError, match=f"^{re.escape(said)}"):
        pt.control.PredictiveController(ornithopter_orbit, list(ROBOT.actuators), **words)


def test_a_command_that_is_wrong_is_named() -> None:
    flying = pt.Simulator(
        ROBOT, pt.QuasiSteady(ROBOT), pt.gaits.cruise(ROBOT), duration=0.02, time_step=1e-3,
        control_period=0.01, v=ROBOT.velocities(x=6.0),
    )  # fmt: skip
    flying.step({"elevation_offset": np.float64(0.1)})
    for value, found in ((np.nan, "nan"), ("4 Hz", "'4 Hz'"), (np.inf, "inf")):
        said = f"commands: elevation_offset: expected a finite number, found {found}"
        with pytest.raises(ParameterError, match=f"^{re.escape(said)}$"):
            flying.step({"elevation_offset": value})
    flying.step()
    with pytest.raises(ParameterError, match="expected one longer than 0.02 s, whose steps"):
        flying.step()
    assert (flying.flight()["command"].values == 0.1)[1:].all()


def test_what_is_no_controller_and_what_is_no_orbit_is_said(ornithopter_orbit: Any) -> None:
    with pytest.raises(ParameterError, match="attribute `period` in seconds"):
        pt.fly(
            ROBOT, pt.QuasiSteady(ROBOT), lambda time, state: {},
            orbit=ornithopter_orbit, duration=0.1,
        )  # fmt: skip
    reason = "what the free parameters hardly reach is -0.0005 N m of moment_y"
    none = pt.control.NoOrbit(reason, "free other parameters", {}, 1e-3, 9, {"frequency": 4.0})
    with pytest.raises(ParameterError, match=f"^orbit: .* NoOrbit: {re.escape(reason)}"):
        pt.control.LinearRegulator(none, list(ROBOT.actuators))


def test_a_plan_may_turn() -> None:
    from patagium.cli.plan import Plan, prepared

    given = {"robot": "ornithopter", "trim": {"turn_rate": 0.1, "speed": 6.0}, "events": []}
    flight = prepared(Plan.model_validate(given)).fly()
    assert flight.attrs["outcome"] == "COMPLETED"
    turned = 0.1 * float(flight["time"][-1])
    # air and masses of the truth are a percent or two off, and yaw moves within the beat
    assert float(flight.q.sel(dof="yaw")[-1]) == pytest.approx(turned, abs=0.05)


def test_an_error_of_an_event_names_the_event(ornithopter_orbit: Any) -> None:
    event = pt.control.StuckEvent(time=0.4, command="rudder")
    with pytest.raises(ParameterError, match=r"^events: at 0\.4 s .*rudder"):
        pt.fly(
            ROBOT, pt.QuasiSteady(ROBOT), Steering({}), orbit=ornithopter_orbit, duration=0.9,
            time_step=2e-3, events=[event],
        )  # fmt: skip

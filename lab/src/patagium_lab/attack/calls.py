"""Targets that are calls of the public functions of Python, with hostile arguments.

A call ends in a result of finite numbers, in a failure that its function documents, or in a
refusal. Neglected: records that functions return, made by hand, and callables of a caller that
never return.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import chdir
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import patagium as pt
from patagium import control, learning, sensing
from patagium.errors import Outcome, PatagiumError
from patagium.robot import Robot
from patagium_lab.attack import seeds
from patagium_lab.attack.further_calls import further_calls, method_calls
from patagium_lab.attack.mutation import HOSTILE, Draw
from patagium_lab.attack.oracle import Target, WrongNumber
from patagium_lab.attack.valid import Valid
from patagium_lab.attack.verbs import prepared

AREA = "calls"
_ODD: tuple[Any, ...] = (
    10**400, -(10**400), 1j, b"1", b"\xff", bytearray(3), object(), int, print, ..., range(3),
    {1, 2}, frozenset({"a"}), {"x": np.nan}, {1: 2}, {"\ud800": 1.0}, [["a"], [1, 2]], (1, 2, 3),
    (np.nan, 0, 0), ("a", "b", "c"), ["frequency"], ["\ud800"], [None], [object()], [{}], [[1.0]],
    np.array([]), np.array(np.nan), np.zeros((0, 3)), np.zeros((3, 4)), np.zeros(7), np.ones(3),
    np.full(3, np.inf), np.array(["a"]), np.array([1j]), np.array(None), np.float32(2.0),
    np.ma.masked, np.ma.array([1.0, 2.0, 3.0], mask=True), np.datetime64("2026-01-01"),
    np.array(["2026-01-01"], "datetime64[s]"), np.timedelta64(1, "s"), np.bool_(True),
    np.array([{}, 1], object), xr.Dataset(), xr.DataArray(1.0), 0.1, 0.5, 3, 100, "speed", "climb",
    "left_wing", "body", "no_such", lambda *given: None,
)  # fmt: skip
_FILES: tuple[Any, ...] = (
    "missing.nc", "missing/deep/x.nc", ".", "", "robot.yaml", "robot.yaml/x", "a" * 300, "out.nc",
    "flight.nc", "learner.state", "settings.yaml", "gait.csv", "robot.urdf", "sensors.nc", "\x00",
    "éü.nc", "\ud800.nc", "x.html", Path("a b.nc"), b"x.nc", [], ["flight.nc"], None, 10**400, 1j,
)  # fmt: skip
_PLAIN: tuple[Any, ...] = (None, True, False, 0, 1, 2, 5, 0.0, 0.1, 0.5, 1.0, 3.0, [0.0, 0.0, 0.1])
"""Plain values of an optional argument."""
_PATHS = {"path", "paths", "out", "mapping", "name_or_path", "log"}
_UNTOLD = {
    "inspect_log",
    "identify",
    "identify a table",
    "evaluate",
    "evaluate on a table",
    "stream",
    "inverse_dynamics_force",
    "load_identification",
    "tune",
    "read_table",
    "Pipeline.run",
    "Pipeline.step",
}
"""Functions whose results say by nan what the samples do not tell."""
_KEPT = ("q", "v", "a")


def call_targets() -> Iterator[Target]:
    """Targets of the area, with their shares of the cases."""
    yield Target(AREA, "functions of control", 1.0, lambda folder: _calls(folder, control_calls))
    yield Target(AREA, "other functions", 1.0, lambda folder: _calls(folder, other_calls))
    yield Target(AREA, "further functions", 1.0, lambda folder: _calls(folder, further_calls))
    yield Target(AREA, "methods", 1.0, lambda folder: _calls(folder, method_calls))


@cache
def _orbit(name: str = "ornithopter") -> Any:
    return pt.trim(pt.load_robot(name))


@cache
def control_calls() -> dict[str, Valid]:
    """Valid calls of what `patagium.control` holds, by name."""
    orbit = _orbit()
    robot, air, gait = orbit.robot, orbit.aero, orbit.gait
    names = list(robot.actuators)
    law = control.LinearRegulator(orbit, names)
    eye = np.eye(2)
    flown = {"robot": robot, "aero": air, "controller": law, "orbit": orbit, "duration": 0.02}
    options = ("learner", "estimator", "seed", "time_step", "q", "v", "added_mass", "throw")
    found = {
        "floquet": Valid(control.floquet, {"orbit": orbit}),
        "free_parameters": Valid(control.free_parameters, {"robot": robot, "gait": gait}),
        "gait_family": Valid(
            control.gait_family, {"robot": robot, "gait": gait, "names": ("frequency",)}
        ),
        "off_nominal": Valid(control.off_nominal, {"robot": robot, "share": 0.02, "seed": 1}),
        "LinearRegulator": Valid(
            control.LinearRegulator,
            {"orbit": orbit, "commands": names},
            ("parts", "tolerable", "averaged"),
        ),
        "PredictiveController": Valid(
            control.PredictiveController,
            {"orbit": orbit, "commands": names, "horizon": 2},
            ("parts", "tolerable", "limits"),
        ),
        "AdaptiveController": Valid(
            control.AdaptiveController, {"controller": law, "memory": 10.0}
        ),
        "AirWeights": Valid(
            control.AirWeights, {"prior": np.ones(2), "stds": np.ones(2), "memory": 10.0}
        ),
        "FlightMap": Valid(
            control.FlightMap, {"robot": robot, "aero": air}, ("added_mass", "parameters", "work")
        ),
        "QuadraticProgram": Valid(
            control.QuadraticProgram, {"stages": 2, "states": 2, "inputs": 1}
        ),
        "RealTimeIteration": Valid(
            control.RealTimeIteration,
            {"predict": print, "horizon": 2, "state_cost": eye, "input_cost": eye},
        ),
        "NoisyState": Valid(control.NoisyState, {"std": {"z": 1e-3}}, ("delay", "missing")),
        "TrackedState": Valid(
            control.TrackedState, {"sensors": [pt.sensors.Encoder(rate=500.0)]}
        ),
        "Orbit.flight": Valid(orbit.flight, {"beats": 1.0}),
        "fly": Valid(control.fly, flown, (*options, "sensors", "events", "progress")),
    }  # fmt: skip
    return found | _events() | _searches()


def _searches() -> dict[str, Valid]:
    """Valid calls that seek orbits."""
    orbit = _orbit()
    robot = orbit.robot
    search = ("added_mass", "start", "steps", "tolerable", "free", "speed", "climb")
    return {
        "trim": Valid(
            control.trim, {"robot": robot}, ("aero", "gait", "turn_rate", *search)
        ),
        "continue_orbit": Valid(
            control.continue_orbit,
            {"orbit": orbit, "along": "speed", "limits": (orbit.speed - 1, orbit.speed + 1),
             "points": 1},
            ("hold",),
        ),
        "optimize": Valid(
            control.optimize,
            {"robot": robot, "start": orbit, "harmonics": 1, "free": ["frequency"]},
            ("aero", "gait", "goal", *search),
        ),
        "power_front": Valid(
            control.power_front, {"robot": robot, "speeds": ()}, ("aero", "gait", "harmonics")
        ),
    }  # fmt: skip


def _events() -> dict[str, Valid]:
    """Valid calls of events, which happen in a flight."""
    events: dict[str, tuple[Any, dict[str, Any]]] = {
        "GustEvent": (control.GustEvent, {"velocity": (0.0, 0.0, 1.0), "length_time": 0.01}),
        "PayloadEvent": (
            control.PayloadEvent,
            {"body": "body", "mass": 1e-3, "position": (0.0, 0.0, 0.01)},
        ),
        "WingLossEvent": (control.WingLossEvent, {"wing": "left_wing", "share": 0.1}),
        "PolarEvent": (control.PolarEvent, {"factors": {"lift_amplitude": 0.9}}),
        "StuckEvent": (control.StuckEvent, {"command": "frequency", "value": 5.0}),
    }
    return {
        name: Valid(_happens(kind), {"time": 0.01, **words})
        for name, (kind, words) in events.items()
    }


def _happens(kind: Any) -> Callable[..., Any]:
    """Function that makes an event and flies through it."""
    orbit = _orbit()

    def happens(**given: Any) -> Any:
        event = kind(**given)
        law = control.LinearRegulator(orbit, list(orbit.robot.actuators))
        air = pt.QuasiSteady(orbit.robot)
        given = {"orbit": orbit, "duration": 0.02, "events": [event], "throw": False}
        return pt.fly(orbit.robot, air, law, **given)

    return happens


@cache
def other_calls() -> dict[str, Valid]:
    """Valid calls of the names of daily work outside of control, by name."""
    parts = _flights(), _logs(), _learners(), _airs(), _gaits(), _paths()
    return {name: call for part in parts for name, call in part.items()}


def _flights() -> dict[str, Valid]:
    """Valid calls that fly, read and write."""
    robot, flight = seeds.robot(), seeds.flight()
    air, gait = pt.QuasiSteady(robot), pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    flown = {"robot": robot, "aero": air, "gait": gait, "duration": 0.02, "time_step": 1e-3}
    options = ("mount", "q", "v", "added_mass", "load_cells", "aero_state", "controller",
               "control_period")  # fmt: skip
    return {
        "simulate": Valid(pt.simulate, flown, (*options, "throw", "progress")),
        "Simulator": Valid(pt.Simulator, flown, options[:-2]),
        "cycle_statistics": Valid(
            pt.cycle_statistics, {"flight": flight, "period": 0.02, "skip": 0}, ("phases",)
        ),
        "load_flight": Valid(pt.load_flight, {"path": "flight.nc"}),
        "save_flight": Valid(pt.save_flight, {"flight": flight, "path": "out.nc"}),
        "load_robot": Valid(pt.load_robot, {"name_or_path": "robot.yaml"}),
        "load_urdf": Valid(pt.load_urdf, {"path": "robot.urdf"}, ("base",)),
        "load_learner": Valid(pt.load_learner, {"path": "learner.state"}, ("like",)),
        "load_model": Valid(pt.load_model, {"path": "model.json"}),
        "load_log": Valid(pt.load_log, {"path": "log.nc"}),
        "load_settings": Valid(learning.load_settings, {"path": "settings.yaml"}),
        "save_model": Valid(
            learning.save_model, {"path": "new.json", "model": seeds.learner()}
        ),
        "import_log": Valid(
            pt.import_log,
            {"paths": "log.csv", "mapping": "map.yaml", "out": "new.nc"},
            ("progress", "tell"),
        ),
        "inspect_log": Valid(sensing.inspect_log, {"paths": "gait.csv"}, ("skip_rows",)),
    }  # fmt: skip


def _logs() -> dict[str, Valid]:
    """Valid calls on logs and samples."""
    robot, flight = seeds.robot(), seeds.flight()
    network, learner = pt.StripNetwork(robot, (3,)), seeds.flight_learner()
    log = sensing.load_sensor_log("sensors.nc")
    motion = pt.estimate_motion(log)
    table = {"time": 0.01 * np.arange(20), "x": np.ones((20, 3)), "y": np.ones((20, 2))}
    return {
        "sense": Valid(
            pt.sense, {"flight": flight, "sensors": [pt.sensors.Encoder(rate=500.0)]}, ("seed",)
        ),
        "estimate_motion": Valid(
            pt.estimate_motion,
            {"log": log},
            ("shifts", "times", "order"),
        ),
        "inverse_dynamics_force": Valid(
            pt.inverse_dynamics_force, {"motion": motion}, ("joints", "mount", "added_mass")
        ),
        "training_data": Valid(
            pt.training_data, {"flight": flight}, ("robot", "with_added_mass")
        ),
        "identify": Valid(
            pt.identify,
            {"flight": flight, "learner": learner, "every": 5},
            ("inputs", "horizons", "robot", "progress"),
        ),
        "evaluate": Valid(
            pt.evaluate, {"flight": flight, "model": learner, "every": 5}, ("inputs", "robot")
        ),
        "stream": Valid(
            learning.stream, {"learner": seeds.learner(), **table, "every": 5},
            ("horizons", "gaps"),
        ),
        "refine": Valid(
            pt.refine, {"learner": seeds.learner(), **table}, ("every",)
        ),
        "tune": Valid(
            pt.tune, {"flight": flight, "network": network, "every": 10, "trials": 8},
            ("learner", "covariance", "settings", "seed"),
        ),
    }  # fmt: skip


def _learners() -> dict[str, Valid]:
    """Constructors of networks and learners, with valid arguments."""
    robot, learner = seeds.robot(), seeds.flight_learner()
    dense = {"inputs": 3, "hidden": (4,), "outputs": 2}
    air, small = pt.QuasiSteady(robot), pt.DenseNetwork(3, (4,), 2)
    filters = ("prior_std", "measurement_std", "process_std", "forgetting_factor", "prior_share",
               "covariance", "screening", "noise_estimation", "misfit", "change_detection",
               "seed", "settings")  # fmt: skip
    return {
        "DenseNetwork": Valid(
            pt.DenseNetwork, dense, ("activation", "input_center", "input_scale", "output_scale")
        ),
        "StripNetwork": Valid(
            pt.StripNetwork,
            {"robot": robot, "hidden": (3,)},
            ("air", "activation", "measured", "chord_fraction", "rotation", "coefficient_scale"),
        ),
        "ExtendedLearner": Valid(pt.ExtendedLearner, {"network": small}, filters),
        "CubatureLearner": Valid(
            pt.CubatureLearner, {"network": small}, (*filters, "spread", "square_root", "dtype")
        ),
        "GreyBox": Valid(
            pt.GreyBox, {"model": air, "estimate": {"density": 0.1}},
            ("added_mass", "measured", "start"),
        ),
        "Pipeline": Valid(
            pt.Pipeline, {"learner": learner, "robot": robot}, ("inputs", "carried", "added_mass")
        ),
    }  # fmt: skip


def _airs() -> dict[str, Valid]:
    """Valid calls that make models, and pictures of a flight."""
    robot, flight = seeds.robot(), seeds.flight()
    return {
        "Dynamics": Valid(pt.Dynamics, {"robot": robot}),
        "Air": Valid(pt.Air, {}, ("density", "wind", "gust", "ground")),
        "QuasiSteady": Valid(pt.QuasiSteady, {"robot": robot}, ("air", "polar", "rotational")),
        "LiftingLine": Valid(
            pt.LiftingLine, {"robot": robot}, ("air", "lags", "section", "surface_constant")
        ),
        "DeLaurier": Valid(pt.DeLaurier, {"robot": robot}, ("air", "lift_slope", "stall_angle")),
        "Inflow": Valid(pt.air.Inflow, {"model": pt.QuasiSteady(robot)}),
        "WindShear": Valid(
            pt.air.WindShear, {"model": pt.QuasiSteady(robot)},
            ("reference_height", "exponent", "roughness"),
        ),
        "Section": Valid(
            pt.air.Section, {}, ("lift_slope", "profile_drag", "stall_begins", "stalled")
        ),
        "StallDelay": Valid(pt.air.StallDelay, {}, ("pressure", "separation", "vortex")),
        "OneMinusCosineGust": Valid(
            pt.air.OneMinusCosineGust,
            {"velocity": (0.0, 0.0, 1.0), "start": 0.01, "length_time": 0.02},
        ),
        "DrydenGust": Valid(
            pt.air.DrydenGust,
            {"intensity": (0.1, 0.1, 0.1), "length_scale": (5.0, 5.0, 5.0), "airspeed": 5.0,
             "seed": 1},
        ),
        "AddedMass": Valid(pt.AddedMass, {"robot": robot}, ("air", "factor")),
        "replay": Valid(
            pt.replay, {"flight": flight, "path": "x.html"},
            ("predicted", "title", "start", "end", "beside"),
        ),
        "still": Valid(pt.still, {"flight": flight}, ("time", "predicted", "seen_from")),
    }  # fmt: skip


def _gaits() -> dict[str, Valid]:
    """Valid calls that make gaits and mounts."""
    robot, center = seeds.robot(), (0.0, 0.0, 0.0)
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    return {
        "gaits.sinusoidal": Valid(
            pt.gaits.sinusoidal, {"robot": robot, "frequency": 5.0, "plunge": 0.6},
            ("phase", "offset"),
        ),
        "gaits.fourier": Valid(
            pt.gaits.fourier, {"robot": robot, "frequency": 5.0, "plunge": (0.1, [(0.2, 0.3)])}
        ),
        "gaits.still": Valid(pt.gaits.still, {"robot": robot, "plunge": 0.1}),
        "gaits.cruise": Valid(pt.gaits.cruise, {"robot": _orbit().robot}, ("frequency",)),
        "gaits.from_csv": Valid(
            pt.gaits.from_csv, {"robot": robot, "path": "gait.csv"}, ("period",)
        ),
        "gaits.to_csv": Valid(
            pt.gaits.to_csv, {"robot": robot, "gait": gait, "path": "new.csv"}
        ),
        "mounts.load_cell": Valid(
            pt.mounts.load_cell, {"at": "left_wing"}, ("position", "orientation")
        ),
        "mounts.carried": Valid(
            pt.mounts.carried, {"path": pt.paths.line(center, (1.0, 0.0, 0.0), duration=1.0)}
        ),
    }  # fmt: skip


def _paths() -> dict[str, Valid]:
    """Valid calls that make paths and sensors."""
    center = (0.0, 0.0, 0.0)
    return {
        "paths.line": Valid(
            pt.paths.line, {"start": center, "end": (1.0, 0.0, 0.0), "duration": 1.0},
            ("attitude",),
        ),
        "paths.circle": Valid(
            pt.paths.circle, {"center": center, "radius": 1.0, "speed": 1.0},
            ("frequency", "normal", "attitude"),
        ),
        "paths.figure_of_eight": Valid(
            pt.paths.figure_of_eight,
            {"center": center, "length": 2.0, "width": 1.0, "speed": 1.0},
            ("frequency", "along", "across", "attitude"),
        ),
        "paths.sinusoid": Valid(
            pt.paths.sinusoid, {"center": center, "frequency": 1.0, "z": 0.1},
            ("phase", "attitude"),
        ),
        "paths.waypoints": Valid(
            pt.paths.waypoints,
            {"time": [0.0, 1.0, 2.0], "points": [[0.0] * 3, [1.0] * 3, [2.0] * 3]},
            ("closed", "attitude"),
        ),
        "sensors.Encoder": Valid(pt.sensors.Encoder, {"rate": 500.0}, ("name", "delay")),
        "sensors.MotionCapture": Valid(
            pt.sensors.MotionCapture, {"body": "body", "rate": 100.0},
            ("position", "position_std", "attitude_std", "dropout", "dropout_length"),
        ),
        "sensors.LoadCell": Valid(
            pt.sensors.LoadCell, {"rate": 500.0},
            ("body", "at", "position", "force_std", "cross_talk", "force_range", "bandwidth"),
        ),
        "sensors.MotorCurrent": Valid(
            pt.sensors.MotorCurrent, {"rate": 500.0, "torque_constant": 0.01},
            ("joints", "gear_ratio", "delay"),
        ),
        "sensors.Imu": Valid(
            pt.sensors.Imu, {"body": "body", "rate": 500.0}, ("name", "delay", "position")
        ),
    }  # fmt: skip


def _calls(folder: Path, calls: Callable[[], dict[str, Valid]]) -> Callable[[Draw], None]:
    """Case of a function with one or two hostile arguments."""
    prepared(folder)
    with chdir(folder):
        pt.import_log("log.csv", "map.yaml", "log.nc")
        found = calls()
        names = list(found)
        for name in names:
            _called(name, found[name], {})  # what is compiled, is now
    material = [value for one in found.values() for value in one.given.values()]

    def case(draw: Draw) -> None:
        name = names[int(draw.integers(len(names)))]
        valid = found[name]
        places = [*valid.given, *valid.takes]
        hostile = {}
        for _ in range(int(draw.choice([1, 1, 1, 2]))):
            place = places[int(draw.integers(len(places)))]
            hostile[place] = _value(draw, place, valid.given.get(place), material)
        with chdir(folder):
            for path, content in seeds.contents().items():
                if not Path(path).is_file() or Path(path).stat().st_size != len(content):
                    Path(path).write_bytes(content)
            _called(name, valid, hostile)

    return case


def _value(draw: Draw, place: str, usual: Any, material: list[Any]) -> Any:
    """Hostile value of an argument: any, that of another one, or the usual one in part.

    Half of them are of the right kind, as near as may be.
    """
    if draw.random() < 0.5:
        return _near(draw, usual)
    kind = draw.random()
    if place in _PATHS and kind < 0.8:
        return _FILES[int(draw.integers(len(_FILES)))]
    values = (*HOSTILE, *_ODD)
    value = values[int(draw.integers(len(values)))]
    if place in _PATHS and isinstance(value, str):
        return "missing.nc"  # no other text, which may name a place outside
    if kind < 0.1:
        return (one for one in (value, value))
    if kind < 0.25:
        return material[int(draw.integers(len(material)))]
    if kind < 0.45 and isinstance(usual, list | tuple) and usual:
        changed = list(usual)
        changed[int(draw.integers(len(usual)))] = value
        return type(usual)(changed)
    if kind < 0.45 and isinstance(usual, dict) and usual:
        return {next(iter(usual)): value}
    if kind < 0.45 and isinstance(usual, np.ndarray):
        numbers = usual.astype(float)
        numbers.flat[0] = float(draw.choice([np.nan, np.inf, 1e308, -1.0, 0.0]))
        return numbers
    return value


def _near(draw: Draw, usual: Any) -> Any:
    """Value like the usual one; a plain one where there is none."""
    if isinstance(usual, bool):
        return not usual
    if isinstance(usual, int):
        return usual + int(draw.integers(-2, 3))
    if isinstance(usual, float | np.ndarray):
        return usual * float(draw.choice([-1.0, 0.0, 0.5, 0.9, 1.1, 2.0, 10.0]))
    if isinstance(usual, list) and usual:
        return usual[: int(draw.integers(len(usual) + 1))] or [*usual, usual[0]]
    if isinstance(usual, tuple) and usual:
        return tuple(_near(draw, one) for one in usual)
    if isinstance(usual, dict) and usual:
        return {key: _near(draw, value) for key, value in usual.items()}
    return _PLAIN[int(draw.integers(len(_PLAIN)))] if usual is None else usual


def _called(name: str, valid: Valid, hostile: Mapping[str, Any]) -> None:
    """Call a function; its result is finite, or a failure that it documents."""
    given = {**valid.given, **hostile}
    shown = {key: f"{type(value).__name__} {str(value)[:40]!r}" for key, value in hostile.items()}
    try:
        result = valid.function(**given)
    except PatagiumError:
        raise
    except Exception as problem:
        problem.args = (f"{name}({shown}): {type(problem).__name__}: {problem}",)
        raise
    passed = valid.passes and any(map(_beyond, hostile.values()))
    wrong = "" if name in _UNTOLD or passed else not_finite(result)
    if wrong:
        raise WrongNumber(f"{name}({shown}): {wrong} is not finite")


def _beyond(value: Any) -> bool:
    """Whether a value has a number that is not finite, or so large that sums of squares are not."""
    try:
        return not (np.abs(np.asarray(value, float)) < 1e150).all()
    except (TypeError, ValueError, OverflowError):
        return False


def not_finite(result: Any, name: str = "result", depth: int = 3) -> str:
    """Name of the first number of a result that is not finite; empty if there is none.

    Args:
        result: What a function returned.
        name: How it is called.
        depth: Levels of records, mappings and lists to look through.
    """
    if isinstance(result, xr.Dataset):
        done = result.attrs.get("outcome", Outcome.COMPLETED.name) == Outcome.COMPLETED.name
        parts = {key: result[key].to_numpy() for key in _KEPT if done and key in result}
    elif isinstance(result, float | complex | np.ndarray | np.number):
        numbers = np.asarray(result)
        return name if numbers.dtype.kind in "fc" and not np.isfinite(numbers).all() else ""
    elif depth == 0 or isinstance(result, Robot | control.NoOrbit):
        return ""
    elif is_dataclass(result) and not isinstance(result, type):
        parts = {one.name: getattr(result, one.name) for one in fields(result) if one.repr}
    elif isinstance(result, Mapping):
        parts = dict(result)
    elif isinstance(result, list | tuple):
        parts = {str(k): value for k, value in enumerate(result)}
    else:
        return ""
    found = (not_finite(value, f"{name}.{key}", depth - 1) for key, value in parts.items())
    return next((one for one in found if one), "")

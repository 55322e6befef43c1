"""Further functions and methods of Python for the area of calls: sections, logs, states, filters.

Neglected: methods that take expressions of CasADi, those that filters need of networks, those that
controllers need of each other, events' and estimators'.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import xarray as xr

import patagium as pt
from patagium import control, learning, sensing
from patagium_lab.attack import seeds
from patagium_lab.attack.valid import Valid

_ANGLES, _LIFT, _DRAG = [-0.2, -0.1, 0.0, 0.1, 0.2], [-0.8, -0.5, 0.0, 0.5, 0.8], [0.02] * 5


@cache
def further_calls() -> dict[str, Valid]:
    """Valid calls of functions and classes beyond those of daily work, by name."""
    parts = _sections(), _logs(), _networks(), _motions()
    return {name: call for part in parts for name, call in part.items()}


@cache
def method_calls() -> dict[str, Valid]:
    """Valid calls of methods, each of an object of its own, by name."""
    parts = _mechanics(), _air(), _learned(), _loops(), _measured(), _solved()
    made = {name: call for part in parts for name, call in part.items()}
    return {name: replace(call, passes=True) for name, call in made.items()}


def _method(make: Callable[[], Any], name: str) -> Callable[..., Any]:
    """Function that makes an object and calls a method of it."""

    def method(*given: Any, **named: Any) -> Any:
        return getattr(make(), name)(*given, **named)

    return method


def _table() -> Any:
    """Table of a log with stated ranges."""
    table = sensing.read_table("log.csv", "map.yaml")
    bounds = [np.tile([-9.0, 9.0], (len(names), 1)) for names in (table.x.T, table.y.T)]
    return replace(table, input_range=bounds[0], output_range=bounds[1])


def _angles() -> xr.Dataset:
    """Imported log of an encoder."""
    time, rows = np.linspace(0.0, 1.0, 20), {"units": "rad"}
    names = ("left_plunge", "right_plunge")
    angles = {name: ("time", np.sin(time), rows) for name in names}
    return xr.Dataset(angles, {"time": time})


def _sections() -> dict[str, Valid]:
    """Valid calls of what a section is made of."""
    air, line = pt.air, (1.0, 0.0, 0.0)
    table = {"angle": _ANGLES, "lift": _LIFT, "drag": _DRAG}
    return {
        "DickinsonPolar": Valid(
            air.DickinsonPolar, {}, ("lift_offset", "lift_amplitude", "drag_rate")
        ),
        "SmoothPolar": Valid(air.SmoothPolar, {}, ("lift_amplitude", "zero_lift_drag")),
        "ReynoldsPolar": Valid(air.ReynoldsPolar, {}, ("lift_amplitude", "viscosity")),
        "TablePolar": Valid(air.TablePolar, {name: tuple(row) for name, row in table.items()}),
        "measured_section": Valid(air.measured_section, table, ("moment",)),
        "register_polar": Valid(air.register_polar, {"kind": air.SmoothPolar}),
        "read_polar": Valid(air.read_polar, {"path": "polar.txt"}),
        "Indicial": Valid(
            air.Indicial,
            {"rate": (0.05, 0.3), "lift": (0.2, 0.3), "circulation": (0.2, 0.3)},
        ),
        "LearnedAir": Valid(
            air.LearnedAir, {"model": pt.QuasiSteady(seeds.robot())}, ("weights",)
        ),
        "LinearStrips": Valid(
            air.LinearStrips,
            {"robot": seeds.robot()},
            ("air", "terms", "corrections", "attached"),
        ),
        "RecordedGust": Valid(
            air.RecordedGust, {"time": np.arange(3.0), "velocity": np.ones((3, 3))}
        ),
        "RampGust": Valid(
            air.RampGust, {"velocity": (0.0, 0.0, 1.0), "start": 0.0, "length_time": 0.1}
        ),
        "TravelingGust": Valid(
            air.TravelingGust,
            {"profile": air.RampGust((0.0, 0.0, 1.0), 0.0, 0.1), "direction": line, "speed": 3.0},
            ("origin",),
        ),
        "section_history": Valid(
            air.section_history,
            {"model": pt.LiftingLine, "time": np.linspace(0, 0.02, 5), "pitch": 0.1,
             "airspeed": 5.0, "chord": 0.1},
            ("plunge", "pitch_axis", "added_mass"),
        ),
    }  # fmt: skip


def _logs() -> dict[str, Valid]:
    """Valid calls on sensor logs and tables."""
    log = sensing.load_sensor_log("sensors.nc")
    return {
        "sensor_log": Valid(
            pt.sensor_log, {"log": _angles(), "robot": seeds.robot()}, ("bodies",)
        ),
        "load_sensor_log": Valid(sensing.load_sensor_log, {"path": "sensors.nc"}),
        "save_sensor_log": Valid(sensing.save_sensor_log, {"log": log, "path": "new.nc"}),
        "load_mapping": Valid(sensing.load_mapping, {"path": "map.yaml"}),
        "read_table": Valid(
            sensing.read_table, {"path": "log.csv", "mapping": "map.yaml"}, ("tell",)
        ),
        "load_identification": Valid(
            learning.load_identification, {"path": "identification.nc"}
        ),
    }  # fmt: skip


def _networks() -> dict[str, Valid]:
    """Valid calls of settings, networks, and what is made of tables."""
    robot, table = seeds.robot(), _table()
    dense = learning.network_for(table, (3,))
    return {
        "ChangeDetection": Valid(
            learning.ChangeDetection, {}, ("false_alarm_rate", "window", "reference", "reopening")
        ),
        "Screening": Valid(learning.Screening, {}, ("outlier_std", "stuck_samples")),
        "Misfit": Valid(learning.Misfit, {}, ("floor",)),
        "NoiseEstimation": Valid(learning.NoiseEstimation, {}, ("memory",)),
        "FilterSettings": Valid(
            learning.FilterSettings, {"prior_std": 0.3},
            ("measurement_std", "process_std", "spread", "dtype", "covariance", "screening"),
        ),
        "LinearStripNetwork": Valid(
            learning.LinearStripNetwork, {"robot": robot},
            ("air", "measured", "attached"),
        ),
        "default_learner": Valid(
            learning.default_learner, {"subject": robot}, ("air", "settings", "seed", "every")
        ),
        "network_for": Valid(
            learning.network_for, {"table": table, "hidden": (3,)}, ("activation",)
        ),
        "identify a table": Valid(
            learning.identify, {"flight": table, "learner": pt.ExtendedLearner(dense)},
            ("every", "horizons", "progress"),
        ),
        "evaluate on a table": Valid(
            learning.evaluate, {"flight": table, "model": pt.ExtendedLearner(dense)},
            ("every",),
        ),
        "learner_from_description": Valid(
            learning.learner_from_description, {"description": seeds.learner().describe()}
        ),
        "network_from_description": Valid(
            learning.network_from_description,
            {"description": seeds.learner().network.describe()},
        ),
        "model_of": Valid(
            learning.model_of, {"learner": seeds.learner()}, ("inputs", "source")
        ),
    }  # fmt: skip


def _motions() -> dict[str, Valid]:
    """Functions that make gaits, mounts and sums of paths, each with correct arguments."""
    robot, center = seeds.robot(), (0.0, 0.0, 0.0)
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.1)
    path = pt.paths.line(center, (1.0, 0.0, 0.0), duration=1.0)
    near = pt.paths.line((0.5, 0.0, 0.3), (0.5, 0.1, 0.35), duration=0.5)
    return {
        "gaits.linkage": Valid(
            pt.gaits.linkage, {"robot": pt.load_robot("aerobat"), "frequency": 5.0},
            ("linkage", "plunge_offset", "elbow_offset"),
        ),
        "gaits.superposed": Valid(
            lambda robot, part: pt.gaits.superposed(robot, part, gait),
            {"robot": robot, "part": gait},
        ),
        "gaits.check_gait": Valid(pt.gaits.check_gait, {"robot": robot, "gait": gait}),
        "paths.superposed": Valid(
            lambda part: pt.paths.superposed(part, path), {"part": path}
        ),
        "mounts.on_arm": Valid(
            pt.mounts.on_arm,
            {"arm": pt.load_robot("ur5e"), "path": near, "orientation": (0.0, -np.pi / 2, 0.0)},
            ("at", "position", "start"),
        ),
    }  # fmt: skip


def _mechanics() -> dict[str, Valid]:
    """Valid calls of methods of robots, their dynamics and their flights."""
    robot = seeds.robot()
    dynamics = pt.Dynamics(robot)
    q, v, f = (np.full(robot.dof, number) for number in (0.1, 0.2, 0.01))
    state, moved = {"q": q, "v": v}, v[list(robot.actuated)]
    gait, air = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6), pt.QuasiSteady(robot)

    def simulator() -> Any:
        return pt.Simulator(robot, air, gait, duration=0.01, time_step=1e-3)

    found = {
        "Robot.coordinates": Valid(robot.coordinates, {"x": 0.1, "left_plunge": 0.2}),
        "Robot.velocities": Valid(robot.velocities, {"x": 0.1}),
        "Robot.body_index": Valid(robot.body_index, {"name": "body"}),
        "Robot.index": Valid(robot.index, {"dof_name": "x"}),
        "Robot.joints_named": Valid(robot.joints_named, {"name": "plunge"}),
        "Robot.with_attitude": Valid(robot.with_attitude, {"attitude": "quaternion"}),
        "Robot.with_parameters": Valid(robot.with_parameters, {"values": {"body.mass": 0.1}}),
        "Robot.mounted_on": Valid(
            robot.mounted_on, {"arm": pt.load_robot("ur5e"), "at": "tool"},
            ("position", "orientation", "prefix"),
        ),
        "Dynamics.point": Valid(dynamics.point, {"body": "body"}, ("offset",)),
        "Dynamics.inverse": Valid(dynamics.inverse, {**state, "a": f}),
        "Dynamics.forward": Valid(dynamics.forward, {**state, "f": f}),
        "Dynamics.forward_prescribed": Valid(
            dynamics.forward_prescribed, {**state, "a_actuated": moved, "f": f}
        ),
        "Simulator.advance": Valid(_method(simulator, "advance"), {"steps": 2}, ("progress",)),
        "Simulator.step": Valid(_method(simulator, "step"), {}, ("commands",)),
        "Simulator.command": Valid(_method(simulator, "command"), {"commands": {}}),
        "Simulator.change": Valid(
            _method(simulator, "change"), {"robot": robot, "aero": air}
        ),
        "Simulator.fly": Valid(_method(simulator, "fly"), {}, ("controller", "progress")),
    }  # fmt: skip
    for name in ("bias", "coriolis", "kinetic_energy", "momentum", "coordinate_rates"):
        found[f"Dynamics.{name}"] = Valid(getattr(dynamics, name), state)
    for name in ("mass_matrix", "center_of_mass", "potential_energy", "gravity"):
        found[f"Dynamics.{name}"] = Valid(getattr(dynamics, name), {"q": q})
    return found


def _air() -> dict[str, Valid]:
    """Valid calls of methods of models of the air and of gusts."""
    robot = seeds.robot()
    state = {"q": np.full(robot.dof, 0.1), "v": np.full(robot.dof, 0.2)}
    lifting, mass = pt.LiftingLine(robot), pt.AddedMass(robot)
    gust = pt.air.OneMinusCosineGust((0.0, 0.0, 1.0), 0.01, 0.02)
    line = pt.air.FOUR_STATE
    found = {
        "AddedMass.mass_matrix": Valid(mass.mass_matrix, {"q": state["q"]}),
        "AddedMass.circulatory_force": Valid(mass.circulatory_force, state, ("wind",)),
        "AddedMass.generalized_force": Valid(
            mass.generalized_force, {**state, "a": state["v"]}, ("wind",)
        ),
        "LiftingLine.state_space": Valid(lifting.state_space, state, ("wind",)),
        "Air.wind_at": Valid(pt.Air(gust=gust).wind_at, {"time": [0.0, 0.01]}),
        "Air.uniform_wind_at": Valid(pt.Air(gust=gust).uniform_wind_at, {"time": [0.0, 0.01]}),
        "Indicial.lift_response": Valid(line.lift_response, {"semichords": [0.0, 1.0]}),
        "Indicial.lift_transfer": Valid(line.lift_transfer, {"reduced_frequency": [0.1, 1.0]}),
    }
    for model in (pt.QuasiSteady(robot), lifting):
        for name in ("generalized_force", "state_derivative", "strips"):
            call = Valid(getattr(model, name), state, ("state", "wind"))
            found[f"{type(model).__name__}.{name}"] = call
    return found


def _learned() -> dict[str, Valid]:
    """Methods of learners, networks and results, each with correct arguments."""
    x, y = np.full(3, 0.1), np.full(2, 0.1)
    found: dict[str, Valid] = {}
    for file, make in seeds.LEARNERS.items():

        def learner(make: Callable[[], Any] = make) -> Any:
            return seeds.taught(make())

        found |= {
            f"{file}: update": Valid(_method(learner, "update"), {"x": x, "y": y}, ("time", "std")),
            f"{file}: predict": Valid(_method(learner, "predict"), {"x": x}, ("time", "std")),
            f"{file}: resume": Valid(
                _method(learner, "resume"), {"state": learner().state()}
            ),
            f"{file}: save": Valid(_method(learner, "save"), {"path": "new.state"}),
        }  # fmt: skip
    network, learned = pt.DenseNetwork(3, (4,), 2), seeds.learner()
    model, strip = learning.model_of(learned), pt.StripNetwork(seeds.robot(), (3,))
    weights = network.initial(0)
    pipeline = pt.Pipeline(seeds.flight_learner(), seeds.robot())
    packet = np.full(len(seeds.column_names()), 0.1)
    result = learning.load_identification("identification.nc")
    return found | {
        "Learner.reopen": Valid(_method(seeds.learner, "reopen"), {"share": 0.5}),
        "Learner.carried": Valid(_method(seeds.learner, "carried"), {"times": np.zeros(2)}),
        "DenseNetwork.__call__": Valid(network.__call__, {"x": x, "weights": weights}),
        "DenseNetwork.evaluate": Valid(network.evaluate, {"x": [x], "weights": weights}),
        "DenseNetwork.initial": Valid(network.initial, {"seed": 0}),
        "StripNetwork.initial": Valid(strip.initial, {"seed": 0}),
        "Model.predict": Valid(model.predict, {"x": x}),
        "Pipeline.step": Valid(pipeline.step, {"packet": packet}),
        "Pipeline.run": Valid(pipeline.run, {"packets": [packet]}),
        "Identification.save": Valid(result.save, {"path": "new.nc"}),
        "Identification.report": Valid(result.report, {"path": "new.html"}, ("title",)),
    }


def _loops() -> dict[str, Valid]:
    """Valid calls of methods of controllers and of families of gaits."""
    orbit = _orbit()
    names = list(orbit.robot.actuators)
    flight = pt.Simulator(orbit.robot, orbit.aero, orbit.gait, duration=0.01, time_step=1e-3)
    now = {"time": 0.0, "state": flight.step()}
    return {
        "LinearRegulator.__call__": Valid(
            _method(lambda: control.LinearRegulator(orbit, names), "__call__"), now
        ),
        "PredictiveController.__call__": Valid(
            _method(lambda: control.PredictiveController(orbit, names, horizon=2), "__call__"),
            now,
        ),
        "GaitFamily.gait": Valid(orbit.family.gait, {"values": orbit.values}),
    }


def _measured() -> dict[str, Valid]:
    """Valid calls of methods of trackers, logs and force samples."""
    log, time = sensing.load_sensor_log("sensors.nc"), np.linspace(0.0, 0.1, 20)
    name, stamp, row = log.samples()[0]
    robot, count, density = seeds.robot(), seeds.robot().dof, np.ones(log.robot.dof)
    zeros, every = np.zeros((20, count)), np.tile(np.eye(count), (20, 1, 1))
    forces: dict[str, Any] = {
        "time": time,
        "q": zeros,
        "v": zeros,
        "force": zeros,
        "covariance": every,
    }
    forces |= {"robot": robot, "source": "inverse dynamics"}

    def tracker() -> Any:
        made = sensing.MotionTracker(log.robot, log.sensors, density)
        for sample in log.samples()[:50]:
            made.push(*sample)
        return made

    found = {
        "SensorLog.__getitem__": Valid(log.__getitem__, {"name": name}),
        "LogTable.where": Valid(_table().where, {"kept": slice(0, 5)}),
        "ForceSamples": Valid(sensing.ForceSamples, forces, ("a",)),
        "ForceSamples.where": Valid(
            sensing.ForceSamples(**forces).where, {"kept": slice(0, 5)}
        ),
        "MotionTracker": Valid(
            sensing.MotionTracker,
            {"robot": log.robot, "sensors": log.sensors, "density": density},
            ("order", "shifts", "memory", "variances"),
        ),
        "MotionTracker.push": Valid(
            _method(tracker, "push"), {"name": name, "stamp": stamp + 1.0, "values": row}
        ),
        "MotionTracker.now": Valid(_method(tracker, "now"), {}, ("time",)),
        "MotionTracker.past": Valid(_method(tracker, "past"), {"times": [0.01, 0.02]}),
    }  # fmt: skip
    return found


def _solved() -> dict[str, Valid]:
    """Valid calls of methods of programs, weights, maps of a flight and steered gaits."""
    orbit = _orbit()
    rows = orbit.family.rows(orbit.values, 40, orbit.aero.air)

    def flown(states: Any) -> Any:
        return orbit.map.fly(states, rows)

    def weights() -> Any:
        return control.AirWeights(np.ones(2), np.ones(2), 10.0)

    def program() -> Any:
        made = control.QuadraticProgram(2, 2, 1)
        for name in "QR":
            made[name][...] = np.eye(made[name].shape[-1])
        return made

    def steered() -> Any:
        return control.LinearRegulator(orbit, [*orbit.robot.actuators]).model.steered

    return {
        "AirWeights.learn": Valid(
            _method(weights, "learn"), {"slopes": np.eye(2), "measured": np.ones(2)}, ("alike",)
        ),
        "AirWeights.forget": Valid(_method(weights, "forget"), {"share": 0.5}),
        "AirWeights.differ": Valid(_method(weights, "differ"), {"others": np.ones(2)}),
        "QuadraticProgram.__getitem__": Valid(_method(program, "__getitem__"), {"name": "x"}),
        "QuadraticProgram.solve": Valid(
            _method(program, "solve"), {"inverse": program().inverse()}
        ),
        "FlightMap.fly": Valid(flown, {"states": orbit.states[:1]}),
        "GaitFamily.rows": Valid(
            orbit.family.rows, {"values": orbit.values, "steps": 40, "air": orbit.aero.air}
        ),
        "SteeredGait.motion": Valid(_method(steered, "motion"), {"time": [0.0, 0.01]}),
        "SteeredGait.command": Valid(
            _method(steered, "command"), {"time": 0.01, "commands": {}}
        ),
        "SteeredGait.limits": Valid(
            _method(steered, "limits"), {"name": next(iter(orbit.robot.actuators))}
        ),
    }  # fmt: skip


def _orbit() -> Any:
    return pt.trim(pt.load_robot("ornithopter"))

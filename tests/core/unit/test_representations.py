"""What an object says of itself: a few readable lines, and a picture with a table in a notebook."""

from __future__ import annotations

import inspect
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest

import patagium as pt
from patagium.live import Autopilot
from patagium.native import compiler_name
from patagium.simulation.flight_summary import flight_summary

A, S, L = pt.air, pt.sensing, pt.learning
BASES = {"Network", "Aerodynamics", "Polar", "Section", "SectionFlow", "PatagiumError", "Encoding"}
"""Protocols, bases and parts of a computation, which no user holds."""
FILES = {"Settings", "TableMapping", "LogTable", "Shifts", "Tuned", "Model"}
"""Contents of files and results of long searches, whose fields the first test of `brief` covers."""


@pytest.fixture(scope="module")
def robot() -> pt.Robot:
    return pt.load_robot("aerobat")


@pytest.fixture(scope="module")
def flight(robot: pt.Robot) -> Any:
    gait, aero = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6), pt.QuasiSteady(robot)
    start = robot.coordinates(x=3.0)
    return pt.simulate(robot, aero, gait, duration=0.1, time_step=1e-3, v=start)


def started_tracker(robot: pt.Robot, density: np.ndarray) -> pt.sensing.MotionTracker:
    """Tracker that has had a sample of each sensor."""
    sensors = {"a": pt.sensors.presets.as5600(), "b": pt.sensors.presets.prime_x_13("body")}
    tracker = pt.sensing.MotionTracker(robot, sensors, density)
    tracker.push("a", 0.0, np.zeros(8))
    tracker.push("b", 0.0, [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    return tracker


@pytest.fixture(scope="module")
def things(robot: pt.Robot, flight: Any) -> dict[str, Any]:
    """Instance of each public class by its name."""
    aero, strip = pt.QuasiSteady(robot), pt.StripNetwork(robot)
    encoder, unit = pt.sensors.presets.as5600(), pt.sensors.presets.icm_42688_p("body")
    log, count = pt.sense(flight, [encoder, unit]), len(flight["time"])
    angle = np.radians(np.arange(-90.0, 91.0))
    up, density = (0.0, 0.0, 1.0), np.full(robot.dof, 1e6)
    gust = A.OneMinusCosineGust(up, 0.0, 0.2)
    result = pt.identify(flight)
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    table = A.TablePolar(tuple(angle), tuple(np.sin(2 * angle)), tuple(0.1 + 0 * angle))
    q, v = robot.coordinates(), robot.coordinates(x=3.0)
    found = [
        *(robot, aero, pt.Air(), strip, result, result.learner, result.learner.network),
        *(pt.Dynamics(robot), pt.AddedMass(robot), pt.DeLaurier(robot), pt.LiftingLine(robot)),
        pt.CubatureLearner(strip, prior_std=0.3, measurement_std=1e-3),
        *(pt.DenseNetwork(3, (6,), 2), pt.GreyBox(aero, {"density": 0.1})),
        pt.Pipeline(result.learner, robot),
        *(
            pt.Simulator(robot, aero, gait, duration=0.1, time_step=1e-3),
            A.SmoothPolar(),
            A.DickinsonPolar(),
            A.ReynoldsPolar(),
        ),
        *(gust, A.RampGust(up, 0.0, 0.1), A.TravelingGust(gust, up, 5.0), A.StallDelay(), table),
        A.RecordedGust(np.arange(1e4), np.ones((10_000, 3))),
        A.DrydenGust((0.5, 0.5, 0.5), (0.5, 0.5, 0.5), airspeed=4.0, seed=2),
        A.measured_section(angle, np.sin(2 * angle), 0.1 + 0 * angle),
        pt.LiftingLine(robot).state_space(q, v),
        pt.LiftingLine(robot).lags,
        *(
            A.Inflow(aero),
            A.LearnedAir(aero),
            A.LinearStrips(robot),
            A.WindShear(aero),
            A.PolarTable(angle[:3], angle[:3], angle[:3], None),
        ),
        log,
        *(L.FilterSettings(), L.Screening(), L.Misfit()),
        *(L.NoiseEstimation(), L.ChangeDetection()),
        S.ForceSamples(
            *(np.zeros((count, 14)[:n]) for n in (1, 2, 2, 2)),
            np.zeros((count, 14, 14)),
            robot,
            "made up",
        ),
        started_tracker(robot, density),
    ]
    if compiler_name() is not None:
        orbit = pt.trim(robot)
        regulator = pt.control.LinearRegulator(orbit, ["plunge_amplitude", "feather_offset"])
        found.append(Autopilot(found[-1], regulator))
    return {type(one).__name__: one for one in found}


def test_every_public_object_says_what_it_is_in_a_few_lines(things: dict[str, Any]) -> None:
    public = {
        name
        for space in (pt, A, S, L)
        for name in space.__all__
        if inspect.isclass(getattr(space, name))
    }
    assert public <= set(things) | BASES | FILES
    for name, thing in things.items():
        text = repr(thing)
        assert name in text and " at 0x" not in text
        assert len(text.splitlines()) <= 10 and len(text) <= 1000, name
    arm = pt.load_robot("ur5e")
    way = pt.paths.line((0.5, 0.0, 0.3), (0.5, 0.2, 0.3), duration=1.0)
    mount, state = pt.mounts.on_arm(arm, way), things["Simulator"].state
    for thing in (mount, mount.plan, state, things["MotionTracker"].now()):
        assert len(repr(thing)) <= 700 and len(repr(thing).splitlines()) == 1
    many = replace(things["Identification"], scores={"samples": 10_001})
    assert "samples: 10001\n" in repr(many)  # a count, all its digits


def test_a_point_says_where_it_is(robot: pt.Robot) -> None:
    point = pt.Dynamics(robot).point("left_plate", (0.0, 0.1, 0.0))
    assert repr(point).startswith("<Point [0.  0.1 0. ] m on left_plate of <Robot aerobat: ")


def test_what_equations_depend_on_is_not_what_a_person_reads(robot: pt.Robot) -> None:
    heavier = robot.with_parameters({robot.parameter_names[0]: 1.0})
    assert repr(robot) == repr(heavier) and robot.structure == heavier.structure
    other = pt.load_robot("hawk")
    assert len(robot.structure) > 1000 and robot.structure != other.structure


class _Tags(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.seen.append(tag)
        if tag != "img":
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.mark.parametrize(
    "name", ["Robot", "Identification", "ExtendedLearner", "StripNetwork", "flight"]
)
def test_a_notebook_shows_a_picture_and_a_table(name: str, things: dict[str, Any], flight) -> None:
    thing = flight_summary(flight) if name == "flight" else things[name]
    page = _Tags(thing._repr_html_())
    assert {"img", "table", "th"} <= set(page.seen) and not page.open

"""Times of a tick from sensors to commands: estimate, learning and feedback in one compiled call.

An aerobat on its orbit, sensed at 10 kHz by a unit on the body and by encoders, and by a camera
whose samples come late. Each tick takes one sample of both, predicts the motion to now, learns the
packet with the default learner, and gives commands where an interval of the regulator begins.
Beside it the same parts in Python, on the same samples. Times are those of the wall.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from time import perf_counter

import numpy as np

import patagium as pt
from patagium.control import LinearRegulator, Orbit, driving_noise
from patagium.learning.default_learner import default_learner
from patagium.live import Autopilot
from patagium.sensing import MotionTracker
from patagium.simulation.simulator import FlightState
from patagium_lab.bench.result import Result, compared

TICKS = 20_000
"""Ticks that are timed in C; ..."""
IN_PYTHON = 500
"""... and in Python."""
RATE = 10_000.0
"""Ticks in a second [Hz]."""
_SETTLING = 2000
_COMMANDS = (
    *("left_plunge_amplitude", "right_plunge_amplitude"),
    *("left_feather_offset", "right_feather_offset", "feather_amplitude"),
)


def tick_results(ticks: int = TICKS, in_python: int = IN_PYTHON) -> Iterator[Result]:
    """Times of whole ticks: median and tail, of those that do more, and of the parts in Python.

    Args:
        ticks: Number of ticks that are timed.
        in_python: Number of ticks that are timed in Python.

    Yields:
        Times [us].
    """
    orbit = pt.trim(pt.load_robot("aerobat"))
    assert isinstance(orbit, Orbit)
    flown = _Sensed(orbit, (ticks + _SETTLING) / RATE)
    autopilot = Autopilot(flown.tracker(), *flown.others())
    autopilot.run(flown.rows[:_SETTLING])
    found = autopilot.run(flown.rows[_SETTLING:][:ticks])
    took = 1e6 * found.duration
    plain = float(np.median(took))
    note = f"{len(took)} ticks of {len(_COMMANDS)} commands; one compiled call"
    yield compared(
        "whole tick: median", plain, "us", "its parts in Python", flown.in_python(in_python), note
    )
    yield Result("whole tick: 99 % within", float(np.percentile(took, 99)), "us", note=note)
    late = np.isfinite(flown.rows[_SETTLING:][: len(took)][:, autopilot.places[flown.late].start])
    for name, which in (("with commands", found.commanded), ("with a late sample", late)):
        some = took[which]
        value = float(np.median(some)) if len(some) else None
        yield Result(f"tick {name}: median", value, "us", note=f"{len(some)} of them")


class _Sensed:
    """Samples of a flight on an orbit, one row a tick, and what is given them.

    Attributes:
        rows: Rows of an autopilot's ticks.
        late: Name of the sensor whose samples come late.
    """

    def __init__(self, orbit: Orbit, duration: float) -> None:
        self.orbit, presets = orbit, pt.sensors.presets
        camera = presets.prime_x_13("body")
        flight = orbit.flight(beats=duration / orbit.period + 1.0)
        fast = [presets.icm_42688_p("body"), presets.as5600()]
        sensors = [*(replace(one, rate=RATE) for one in fast), camera]
        self.log, self.late = pt.sense(flight, sensors), camera.name
        self.places = Autopilot(self.tracker(), *self.others()).places
        stamps, forces = flight["time"].values, flight["u1"].values
        self.rows = np.full((round(duration * RATE), self.places["forces"].stop), np.nan)
        self.rows[:, 0] = self.begin + np.arange(1, len(self.rows) + 1) / RATE
        for name, stamp, values in self.log.samples():
            arrival = stamp + (camera.delay if name == self.late else 0.0)
            k = int(np.searchsorted(self.rows[:, 0], arrival - 1e-9))
            if stamp > self.begin and k < len(self.rows):
                self.rows[k, self.places[name]] = [stamp, *values]
        places = np.searchsorted(stamps, self.rows[:, 0]).clip(max=len(forces) - 1)
        self.rows[:, self.places["forces"]] = forces[places]

    def tracker(self) -> MotionTracker:
        """Tracker that has started."""
        made = MotionTracker(
            self.orbit.robot, self.log.sensors, driving_noise(self.orbit), memory=0.01
        )
        for name, stamp, values in self.log.samples():
            if made.started:
                break
            made.push(name, stamp, values)
        self.begin = made.span[1]
        return made

    def others(self) -> tuple[LinearRegulator, pt.Pipeline]:
        """A regulator, and the pipeline of the default learner."""
        robot = self.orbit.robot
        return LinearRegulator(self.orbit, _COMMANDS), pt.Pipeline(default_learner(robot), robot)

    def in_python(self, ticks: int) -> float:
        """Median time of a tick whose parts are called one after the other [us]."""
        tracker, (regulator, pipeline) = self.tracker(), self.others()
        robot, took, due, newest = self.orbit.robot, [], 0.0, self.begin
        for row in self.rows[:ticks]:
            begun = perf_counter()
            for name in self.log.readings:
                stamp, *values = row[self.places[name]]
                if np.isfinite(stamp):
                    tracker.push(name, stamp, values)
                    newest = max(newest, stamp)
            now = tracker.now(max(row[0], newest))  # a stamp is the tick's time but for rounding
            forces = row[self.places["forces"]]
            pipeline.step(np.concatenate([row[:1], now.q, now.v, now.a, forces]))
            if row[0] >= due - 1e-9:  # as the autopilot does: where an interval begins
                regulator(row[0], FlightState(robot, row[0], now.q, now.v))
                due = (round(row[0] / regulator.period) + 1) * regulator.period
            took.append(perf_counter() - begun)
        return float(1e6 * np.median(took))

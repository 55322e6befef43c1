"""Times of a tick from sensors to commands: estimate, learn, command, each as it is today.

An aerobat on its orbit, sensed by a unit on the body, encoders and a camera. The estimator is the
motion tracker, in Python; the learner is the default one, packet to update in C; the regulator is
the linear one over the phase, in Python. A tick takes one inertial sample, predicts the motion to
now, learns the packet, and asks for commands. Times are those of the processor, caches as the other
parts leave them, but of the learner that of the wall. Neglected: samples that come late.
"""

from __future__ import annotations

from collections.abc import Iterator
from time import thread_time_ns

import numpy as np
import xarray as xr

import patagium as pt
from patagium.control import LinearRegulator, Orbit
from patagium.control.estimators import driving_noise
from patagium.learning.default_learner import default_learner
from patagium.live.packets import flight_packets
from patagium.live.pipeline import Pipeline
from patagium.sensing import MotionTracker
from patagium.simulation.simulator import FlightState
from patagium_lab.bench.result import Result

TICKS = 1000
"""Ticks that are timed."""
BEATS = 16
"""Beats of the flight that is sensed."""
_COMMANDS = (
    *("left_plunge_amplitude", "right_plunge_amplitude"),
    *("left_feather_offset", "right_feather_offset", "feather_amplitude"),
)


def tick_results(ticks: int = TICKS) -> Iterator[Result]:
    """Times of the parts of a tick, and of them one after the other: medians and tails.

    Args:
        ticks: Number of ticks that are timed.

    Yields:
        Median and 99 % of each part [us].
    """
    orbit = pt.trim(pt.load_robot("aerobat"))
    assert isinstance(orbit, Orbit)
    times = tick_times(orbit, orbit.flight(beats=BEATS), ticks)
    for name, found in (times | {"whole tick": sum(times.values())}).items():
        note = f"{ticks} ticks, one after the other; {_MADE.get(name, 'the sum')}"
        for way, share in (("median", 50), ("99 % within", 99)):
            yield Result(
                f"{name}: {way}", float(np.percentile(found, share)) / 1e3, "us", note=note
            )


_MADE = {
    "estimator, a sample": "in Python: update of the motion tracker by an inertial sample",
    "estimator, to now": "in Python: its prediction from the last sample to now",
    "learner": "in C: default learner, packet to update, by the clock of its call",
    "regulator": "in Python: linear regulator over the phase, lags of its commands known",
}


def tick_times(
    orbit: Orbit, flight: xr.Dataset, ticks: int
) -> dict[str, np.ndarray[tuple[int], np.dtype[np.float64]]]:
    """Times of the parts of each tick, (ticks,) [ns].

    Args:
        orbit: Orbit that the regulator follows.
        flight: Flight along it.
        ticks: Number of ticks at most.
    """
    robot, presets = orbit.robot, pt.sensors.presets
    sensors = [presets.icm_42688_p("body"), presets.as5600(), presets.prime_x_13("body")]
    log = pt.sense(flight, sensors)
    tracker = MotionTracker(robot, log.sensors, driving_noise(orbit), memory=0.05)
    pipeline = Pipeline(default_learner(robot), robot)
    regulator = LinearRegulator(orbit, _COMMANDS)
    packets, stamps = flight_packets(flight), flight["time"].values
    found: list[list[int]] = []
    for time, name, row in _samples(log, [sensor.name for sensor in sensors]):
        inertial = name == sensors[0].name
        marks = [thread_time_ns()]
        tracker.push(name, time, row)
        marks.append(thread_time_ns())
        if not (inertial and tracker.started):
            continue
        now = tracker.now()
        marks.append(thread_time_ns())
        packet = packets[min(int(np.searchsorted(stamps, time)), len(packets) - 1)].copy()
        packet[0], packet[1 : 1 + 3 * robot.dof] = time, np.concatenate([now.q, now.v, now.a])
        state = FlightState(robot, time, now.q, now.v)
        learned = pipeline.step(packet).duration[0]
        marks.append(marks[-1] + round(1e9 * learned))
        begun = thread_time_ns()
        regulator(time, state)
        marks.append(marks[-1] + thread_time_ns() - begun)
        found.append([end - begin for begin, end in zip(marks, marks[1:], strict=False)])
        if len(found) == ticks:
            break
    return dict(zip(_MADE, np.array(found, float).T, strict=True))


def _samples(log: pt.sensing.SensorLog, names: list[str]) -> list[tuple[float, str, np.ndarray]]:
    """Samples of some sensors in the order of their times: time [s], sensor and values [SI]."""
    found = []
    for name in names:
        reading = log[name]
        kinds = ("position", "quaternion", "specific_force", "angular_rate")
        rows = np.hstack([reading[kind].values for kind in kinds if kind in reading])
        found += [
            (float(t), name, row) for t, row in zip(reading["time"].values, rows, strict=True)
        ]
    return sorted(found, key=lambda sample: sample[:2])

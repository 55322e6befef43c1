"""An autopilot that brings a disturbed flight back, by what its sensors see alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import patagium as pt
from patagium.control import LinearRegulator, driving_noise
from patagium.live import Autopilot
from patagium.native import compiler_name
from patagium.sensing import MotionTracker
from patagium.simulation.steered_gait import SteeredGait

P = pt.sensors.presets
COMMANDS = ("frequency", "plunge_amplitude", "elevation_offset", "rudder_offset")
DISTURBED = 0.1  # rad of pitch


def shown(robot, state, rng):
    """Samples of cameras and encoders of a state, with their noise."""
    attitude = Rotation.from_euler("ZYX", state.q[[5, 4, 3]]) * Rotation.from_rotvec(
        1e-3 * rng.standard_normal(3)
    )
    place = state.q[:3] + 1e-4 * rng.standard_normal(3)
    camera = np.r_[place, np.roll(attitude.as_quat(), 1)]
    joints = state.q[list(robot.actuated)] + 1e-3 * rng.standard_normal(len(robot.actuated))
    return {"joints": np.r_[state.time, joints], "camera": np.r_[state.time, camera]}


def steered(orbit) -> float:
    """Largest way up or down in the last two beats, of a flight that begins nose down [m]."""
    robot, rng = orbit.robot, np.random.default_rng(1)
    start = orbit.start()
    start["q"][robot.index("pitch")] += DISTURBED
    duration, step = 2.5, 2.5e-4  # 11 beats
    simulator = pt.Simulator(
        robot, orbit.aero, SteeredGait(robot, orbit.gait), duration=duration, time_step=step,
        **start,
    )  # fmt: skip
    sensors = {
        "joints": replace(P.as5600(rate=1e3), name="joints"),
        "camera": replace(P.prime_x_13("body"), name="camera", rate=1e3),
    }
    tracker = MotionTracker(robot, sensors, driving_noise(orbit))
    for name, (stamp, *values) in shown(robot, simulator.state, rng).items():
        tracker.push(name, stamp, values)
    autopilot = Autopilot(tracker, LinearRegulator(orbit, COMMANDS))
    heights = []
    for _ in range(int(duration / step) // 4):
        simulator.advance(4)
        tick = autopilot.step(simulator.time, shown(robot, simulator.state, rng))
        if tick.commanded[0]:
            simulator.command(dict(zip(COMMANDS, tick.commands[0], strict=True)))
        heights.append(simulator.state.position("z"))
    assert autopilot.counts["refused"] == autopilot.counts["late"] == 0
    return float(np.abs(heights[-len(heights) // 6 :]).max())


@pytest.mark.skipif(compiler_name() is None, reason="needs a C compiler")
def test_a_disturbed_flight_comes_back_by_what_sensors_see() -> None:
    orbit = pt.trim(pt.load_robot("ornithopter"))
    own = float(np.abs(orbit.flight(beats=1.0)["q"].sel(dof="z")).max())  # within a beat
    start = orbit.start()
    start["q"][orbit.robot.index("pitch")] += DISTURBED
    free = orbit.flight(beats=11, **start)["q"].sel(dof="z").values
    assert np.abs(free[-len(free) // 6 :]).max() > own + 0.2
    assert steered(orbit) < own + 0.03  # noise, and what is left of the start

"""Compiled flight and the flight without a compiler are the same numbers."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.native import compiler_name
from patagium.robot import load_robot_text
from patagium.robot.files import preset_text

STEPS = 60
TIME_STEP = 1e-4


def compared(compiled, fallback):
    # twice the roundings of STEPS steps, multiply-adds fused in one of the two
    for name in compiled.data_vars:
        ours, theirs = compiled[name].values, fallback[name].values
        scale = np.abs(ours).max(initial=0.0)
        if name.endswith("residual"):
            scale = 1e-3  # joule or newton second: a residual is rounding itself
        np.testing.assert_allclose(theirs, ours, rtol=0, atol=1e-12 * max(scale, 1e-12))
    assert compiled.attrs["message"] == fallback.attrs["message"]


@pytest.fixture
def both(monkeypatch):
    def fly(simulate):
        if compiler_name() is None:
            pytest.skip("no C compiler here to compare with")
        compiled = simulate()
        monkeypatch.setenv("PATAGIUM_COMPILER", "none")
        fallback = simulate()
        monkeypatch.delenv("PATAGIUM_COMPILER")
        return compiled, fallback

    return fly


@pytest.mark.parametrize("mount", [pt.mounts.free(), pt.mounts.fixed()])
def test_flight_is_the_same(both, mount):
    robot = pt.load_robot("aerobat")
    aero = pt.QuasiSteady(robot, pt.Air(wind=(-4.0, 0.3, 0.1)))
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5, left_feather=0.1)
    q = robot.coordinates(roll=0.1, pitch=0.1)
    compared(
        *both(
            lambda: pt.simulate(
                robot, aero, gait, duration=STEPS * TIME_STEP, time_step=TIME_STEP, q=q, mount=mount
            )
        )
    )


def test_flight_with_a_quaternion_is_the_same(both, glider):
    robot = glider("quaternion")
    aero, start = pt.QuasiSteady(robot), robot.coordinates(pitch=-1.5)
    gait = pt.gaits.sinusoidal(robot, frequency=6.0, left_plunge=0.4, right_plunge=0.3)
    v = robot.velocities(z=2.0, pitch=-4.0)
    compared(
        *both(
            lambda: pt.simulate(
                robot, aero, gait, duration=STEPS * TIME_STEP, time_step=TIME_STEP, q=start, v=v
            )
        )
    )


@pytest.mark.parametrize("kind", ["strips", "stall delay"])
def test_flight_in_air_with_memory_is_the_same(both, kind):
    robot = load_robot_text(preset_text("aerobat").replace("strips: 5", "strips: 2"))
    angle, lift = (-1.5, -0.15, 0.0, 0.3, 1.5), (0.0, -0.9, 0.1, 1.1, 0.0)
    section = pt.air.measured_section(angle, lift, (1.2, 0.02, 0.01, 0.05, 1.3))
    air = pt.Air(wind=(-4.0, 0.3, 0.1))
    aero = pt.DeLaurier(robot, air)
    if kind == "stall delay":
        aero = pt.LiftingLine(robot, air, section=section, stall_delay=pt.air.StallDelay())
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5, left_feather=0.1)
    compared(
        *both(lambda: pt.simulate(robot, aero, gait, duration=20 * TIME_STEP, time_step=TIME_STEP))
    )


@pytest.mark.parametrize("kind", ["turbulence", "edge"])
def test_flight_in_a_gust_that_travels_is_the_same(both, kind, glider):
    robot = glider("quaternion")
    profile = pt.air.RampGust((0.0, 0.5, 1.0), 0.0, 1e-3)
    if kind == "turbulence":
        profile = pt.air.DrydenGust((1.0, 0.5, 0.5), (0.3, 0.2, 0.1), airspeed=3.0, seed=1)
    gust = pt.air.TravelingGust(profile, (-1.0, 0.3, 0.0), 3.0, decay_time=0.05)
    air = pt.Air(gust=gust)
    aero, added = pt.QuasiSteady(robot, air), pt.AddedMass(robot, air)
    gait = pt.gaits.sinusoidal(robot, frequency=6.0, left_plunge=0.4, right_plunge=0.3)
    compared(
        *both(
            lambda: pt.simulate(
                robot, aero, gait, duration=20 * TIME_STEP, time_step=TIME_STEP,
                added_mass=added, v=robot.velocities(x=4.0),
            )
        )
    )  # fmt: skip


def test_a_run_that_stops_stops_alike(both):
    robot = pt.load_robot("aerobat")
    aero = pt.QuasiSteady(robot)
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5)
    compiled, fallback = both(
        lambda: pt.simulate(
            robot, aero, gait, duration=0.5, time_step=5e-3, v=robot.coordinates(x=4.0), throw=False
        )
    )
    assert compiled.attrs["outcome"] != "COMPLETED"
    assert compiled.sizes == fallback.sizes
    assert compiled.attrs["outcome"] == fallback.attrs["outcome"]

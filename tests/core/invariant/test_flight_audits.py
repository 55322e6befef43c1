"""Energy, momentum and symmetry of simulated flights; what the published stepping breaks."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics.learned_air import LearnedAir
from patagium.dynamics import Dynamics
from patagium.robot import load_robot_text
from patagium.sensing.force.measured_force import Measured, Wrench
from patagium.simulation.flight_summary import flight_summary

TIME_STEP = 1e-4


@pytest.fixture(scope="module")
def robot():
    return pt.load_robot("aerobat")


@pytest.fixture(scope="module")
def flapping(robot):
    parts = (
        pt.gaits.linkage(robot, frequency=5.0, plunge_offset=0.3),
        pt.gaits.sinusoidal(robot, frequency=5.0, feather=0.3, phase={"feather": 1.5}),
    )
    return pt.gaits.superposed(robot, *parts)


@pytest.fixture(scope="module")
def free_flight(robot, flapping):
    return pt.simulate(
        robot,
        pt.QuasiSteady(robot),
        flapping,
        duration=0.4,
        time_step=TIME_STEP,
        v=robot.coordinates(x=4.0),
    )


def test_energy_of_free_flight_is_accounted_for(free_flight):
    exchanged = free_flight.attrs["energy_exchanged"]
    assert exchanged > 0.1  # joule: a real flight, not a still one
    # fourth order at 1e-4 s: measured 1e-9 and below
    assert np.abs(free_flight.energy_residual.values).max() < 1e-8 * exchanged
    assert free_flight.attrs["energy_audit"] < 1e-8


def test_a_glider_that_stands_in_the_wind_is_accounted_for():
    # Nothing moves in the world, so that its audit was a share of rounding by rounding: .4.
    hawk = pt.load_robot("hawk")
    orbit = pt.trim(hawk, climb=None, free=("elevation_offset",))
    start, wind = orbit.start(), (-orbit.speed, 0.0, -orbit.climb)
    start["v"][[hawk.index("x"), hawk.index("z")]] = 0.0
    air = pt.QuasiSteady(hawk, pt.Air(wind=wind))
    held = pt.simulate(hawk, air, orbit.gait, duration=0.5, time_step=2e-3, **start)
    assert np.abs(held.q - held.q[0]).max() < 1e-9 and held.attrs["energy_audit"] < 1e-9


def test_momentum_of_free_flight_is_accounted_for(free_flight):
    assert free_flight.attrs["impulse_exchanged"] > 0.05  # newton second
    assert free_flight.attrs["momentum_audit"] < 1e-9  # as above


def test_air_at_rest_takes_power_from_the_robot(free_flight):
    assert free_flight.attrs["aero_power_largest"] < 0.0
    assert np.all(np.diff(free_flight.air_work.values) < 0.0)
    assert np.all(np.diff(free_flight.damping_work.values) <= 0.0)


def test_a_symmetric_gait_stays_in_the_plane_of_symmetry(robot, free_flight):
    lateral = [robot.index(name) for name in ("y", "roll", "yaw")]
    moving = [robot.index(name) for name in ("x", "z", "pitch")]
    # rounding, grown by the flight's own instabilities over 0.4 s
    assert np.abs(free_flight.q.values[:, lateral]).max() < 1e-12
    assert np.abs(free_flight.v.values[:, lateral]).max() < 1e-12
    assert np.abs(free_flight.v.values[:, moving]).max(axis=0).min() > 0.1


def test_joints_follow_the_gait_exactly(robot, flapping, free_flight):
    motion = flapping.motion(free_flight.time.values)
    joints = list(robot.actuated)
    assert np.array_equal(free_flight.q.values[:, joints], motion.position)
    assert np.array_equal(free_flight.v.values[:, joints], motion.velocity)
    np.testing.assert_allclose(free_flight.a.values[:, joints], motion.acceleration, rtol=1e-15)


def test_recorded_forces_satisfy_the_equations_of_motion(robot, free_flight):
    inverse = Dynamics(robot).batch.inverse(
        free_flight.q.values, free_flight.v.values, free_flight.a.values
    )
    names = ("u1", "aero_force", "damping_force", "mount_force")
    forces = sum(free_flight[name].values for name in names)
    # rounding of the solve, relative to the forces inside the balance
    np.testing.assert_allclose(inverse, forces, atol=1e-12 * np.abs(inverse).max())
    assert not free_flight.u1.values[:, list(robot.passive)].any()


def test_a_wind_that_carries_the_robot_changes_nothing_but_the_frame(robot, flapping):
    """Galilean invariance: still air met at 4 m/s is a head wind of 3 m/s met at 1 m/s."""
    flights = [
        pt.simulate(
            robot,
            pt.QuasiSteady(robot, pt.Air(wind=(-wind, 0.0, 0.0))),
            flapping,
            duration=0.1,
            time_step=TIME_STEP,
            v=robot.coordinates(x=4.0 - wind),
        )
        for wind in (0.0, 3.0)
    ]
    forces = [flight.aero_force.values for flight in flights]
    # rounding over 1,000 steps
    np.testing.assert_allclose(*forces, atol=1e-11 * np.abs(forces[0]).max())


BIRD = """
  bird: {floating: true, mass: 50 g, shape: {type: box, size: [10 cm, 6 cm, 4 cm]}}
  wing: {parent: bird, joints: [{name: flap, axis: x}], mass: 5 g, center_of_mass: [0, 5 cm, 0],
    shape: {type: plate, chord: 4 cm, span: 10 cm, thickness: 1 mm}}"""
STAND = """
  stand: {parent: world, joints: [{name: swing, axis: y, passive: true}], mass: 20 g,
    center_of_mass: [0, 0, -30 cm], shape: {type: point}}"""
WING = """
wings: [{name: wing, segments: [{body: wing, strips: 2, stations: [
  {span: 0 cm, leading: 2 cm, trailing: -8 cm}, {span: 20 cm, leading: 1 cm, trailing: -6 cm}]}]}]
"""


def beside(bodies, mount=None):
    """Flight of a bird in air with a learned wrench; a stand that hangs on the world swings."""
    robot = load_robot_text(f"name: two\ngravity: 9.81 m/s^2\nbodies:{bodies}{WING}")
    aero = pt.QuasiSteady(robot, pt.Air(wind=(-4.0, 0.0, 0.0)))
    aero = LearnedAir(aero, np.r_[np.ones(2), 0.1, 0.2, 0.01])
    gait = pt.gaits.sinusoidal(robot, frequency=3.0, flap=0.4)
    start = robot.coordinates(**({"swing": 0.3} if "stand" in bodies else {}))
    return pt.simulate(robot, aero, gait, duration=0.1, time_step=1e-3, q=start, mount=mount)


@pytest.mark.parametrize("bodies", [BIRD + STAND, STAND + BIRD])
def test_what_hangs_on_the_world_weighs_nothing_in_flight(bodies):
    """The audit of momentum was .3, and a learned wrench pushed the stand if it came first."""
    alone, both = beside(BIRD), beside(bodies)
    names = list(alone.dof.values)
    for name in ("q", "aero_force"):
        own = both[name].sel({alone[name].dims[1]: names})
        np.testing.assert_allclose(own, alone[name], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(both.momentum, alone.momentum, rtol=1e-9, atol=1e-12)
    assert both.attrs["momentum_audit"] < 1e-6
    share = [flight_summary(one)["force_over_weight"] for one in (alone, both)]
    assert share[1] == pytest.approx(share[0], rel=1e-9)


@pytest.mark.parametrize("bodies", [BIRD, STAND + BIRD])
def test_a_cell_in_world_axes_holds_the_floating_body(bodies):
    """A load cell in world axes was taken to hold the first body of the file, even a stand."""
    held = beside(bodies, pt.mounts.fixed())
    n, (count, _) = held.sizes["dof"], held.v.shape
    motion = held.assign(covariance=(("time", "part", "other"), np.zeros((count, 3 * n, 3 * n))))
    shown = Measured(held.mount_wrench.values, np.zeros((count, 6)))
    joints = Measured(held.u1.values, np.zeros((count, n)))
    mount = Wrench(shown, pt.sensors.LoadCell(rate=1.0))
    found = pt.inverse_dynamics_force(motion, joints=joints, mount=mount)
    np.testing.assert_allclose(found.force, held.aero_force, atol=1e-9)

"""Flights with a quaternion: through loops, rolls and vertical climbs, their books in order."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import patagium as pt
from patagium.dynamics import equations, kinematics
from patagium.errors import Outcome, ParameterError, SimulationFailed
from patagium.robot.attitude import quaternion_from_angles


def _matrix(quaternions):
    """Body axes to world axes, (..., 3, 3), of quaternions qw, qx, qy, qz."""
    return Rotation.from_quat(np.roll(quaternions, -1, axis=-1)).as_matrix()


ROUNDING = 1e-11  # differentiated expressions, some hundred roundings
TRUNCATION = 1e-8  # RK4 at steps of 0.5 ms, relative to what was exchanged


@pytest.fixture(scope="module")
def robot(glider):
    return glider("quaternion")


def _fly(robot, duration, density=1.225, right=0.28, q=None, **v):
    gait = pt.gaits.sinusoidal(robot, frequency=6.0, left_plunge=0.3, right_plunge=right)
    aero = pt.QuasiSteady(robot, pt.Air(density=density))
    return pt.simulate(
        robot, aero, gait, duration=duration, time_step=5e-4,
        q=robot.coordinates(**(q or {})), v=robot.velocities(**v),
    )  # fmt: skip


def _upward(flight):
    """World's up in the body's axes, (N, 3)."""
    return _matrix(flight.q.values[:, 3:7])[:, 2]


def _check_books(flight):
    assert flight.attrs["outcome"] == "COMPLETED"
    lengths = np.linalg.norm(flight.q.values[:, 3:7], axis=1)
    np.testing.assert_allclose(lengths, 1.0, rtol=0, atol=4e-16)  # two roundings of a root
    assert flight.attrs["energy_audit"] < TRUNCATION
    assert flight.attrs["momentum_audit"] < TRUNCATION
    assert flight.attrs["aero_power_largest"] <= 0.0


def test_a_loop_which_stops_angles(robot, glider):
    flight = _fly(robot, 1.7, right=0.3, x=20.0)
    _check_books(flight)
    up = _upward(flight)
    turned = np.unwrap(np.arctan2(up[:, 0], up[:, 2]))
    assert turned.max() > 2 * np.pi and up[:, 2].min() < -0.99

    with pytest.raises(SimulationFailed, match=r"pitch reached .* attitude: quaternion") as stopped:
        _fly(glider("euler"), 1.7, right=0.3, x=20.0)
    assert stopped.value.outcome is Outcome.LIMIT_REACHED
    before = stopped.value.flight
    # the same motion up to there, each with the error of its own fourth order
    np.testing.assert_allclose(
        flight.q.values[: before.sizes["time"], :3], before.q.values[:, :3], atol=1e-6
    )


def test_a_roll_in_thin_air(robot):
    flight = _fly(robot, 0.3, density=0.05, x=3.0, roll=60.0)
    _check_books(flight)
    up = _upward(flight)
    turned = np.unwrap(np.arctan2(up[:, 1], up[:, 2]))
    assert turned.max() > 4 * np.pi


def test_a_vertical_climb_rolling_about_the_vertical(robot, glider):
    upright = {"pitch": -np.pi / 2}
    flight = _fly(robot, 0.3, density=0.05, q=upright, z=8.0, roll=60.0)
    _check_books(flight)
    assert _upward(flight)[:, 0].min() > 0.998, "the nose stays within 4 degrees of up"
    assert flight.q.values[-1, 2] > 1.9
    assert np.trapezoid(flight.v.values[:, 3], flight.time) > 4 * np.pi
    with pytest.raises(ParameterError, match=r"pitch: expected a start .*quaternion"):
        _fly(glider("euler"), 0.3, q=upright, z=8.0)


def test_held_upside_down_the_mount_carries_the_weight(robot):
    """Perched under a branch: force and moment about the world's origin, at a pitch of 90 too."""
    weight = robot.gravity * sum(body.mass for body in robot.bodies)
    dynamics = pt.Dynamics(robot)
    for angles in ({"roll": np.pi}, {"pitch": np.pi / 2, "yaw": 0.4}):
        start = {"x": 0.3, "z": 2.0, **angles}
        still, aero = pt.gaits.still(robot), pt.QuasiSteady(robot)
        q = robot.coordinates(**start)
        held = pt.simulate(
            robot, aero, still, duration=0.01, time_step=5e-4, q=q, mount=pt.mounts.fixed()
        )
        np.testing.assert_array_equal(held.q.values, np.tile(q, (21, 1)))
        force = np.array([0.0, 0.0, weight])
        moment = np.cross(dynamics.center_of_mass(q), force)
        expected = np.concatenate([force, moment])
        np.testing.assert_allclose(held.mount_wrench.values[-1], expected, atol=1e-13)  # rounding


def test_free_motion_keeps_energy_and_momentum(robot, rng):
    """Rates along the free motion: d(K + U)/dt = 0, dp/dt = m g, dl/dt = r_c x m g."""
    q = ca.SX.sym("q", robot.coordinate_count)
    v, a = ca.SX.sym("v", robot.dof), ca.SX.sym("a", robot.dof)
    energy = equations.kinetic_energy(robot, q, v) + equations.potential_energy(robot, q)
    kept = [energy, equations.momentum(robot, q, v), equations.angular_momentum(robot, q, v)]
    moved = kinematics.coordinate_rates(robot, q, v)
    rates = [ca.jtimes(x, q, moved) + ca.jtimes(x, v, a) for x in kept]
    function = ca.Function("r", [q, v, a], rates)
    dynamics = pt.Dynamics(robot)
    weight = np.array([0.0, 0.0, -robot.gravity * sum(body.mass for body in robot.bodies)])
    for _ in range(10):
        x, u = _state(robot, rng)
        free = dynamics.forward(x, u, np.zeros(robot.dof))
        d_energy, d_linear, d_angular = (np.array(r).ravel() for r in function(x, u, free))
        scale = max(1.0, float(np.abs(free).max())) * max(1.0, dynamics.kinetic_energy(x, u))
        assert abs(float(d_energy[0])) < ROUNDING * scale
        np.testing.assert_allclose(d_linear, weight, atol=ROUNDING * scale)
        moment = np.cross(dynamics.center_of_mass(x), weight)
        np.testing.assert_allclose(d_angular, moment, atol=ROUNDING * scale)


def test_a_quaternion_its_negative_and_any_length_are_one_attitude(robot, rng):
    dynamics, local = pt.Dynamics(robot), pt.QuasiSteady(robot)
    for factor in (-1.0, 1.7):
        q, v = _state(robot, rng)
        other = q.copy()
        other[3:7] *= factor
        force = local.generalized_force(q, v)
        # rounding of the quaternion's products
        np.testing.assert_allclose(local.generalized_force(other, v), force, rtol=1e-12, atol=1e-13)
        expected = dynamics.forward(q, v, force)
        np.testing.assert_allclose(dynamics.forward(other, v, force), expected, rtol=1e-10)


def test_a_mirrored_state_has_the_mirrored_acceleration(robot, rng):
    """In y: qx and qz, roll and yaw, y change sign, the wings change sides."""
    dynamics, aero = pt.Dynamics(robot), pt.QuasiSteady(robot)

    def mirror(vector, names):
        image = np.empty_like(vector)
        for k, name in enumerate(names):
            twin = name.replace("left_", "*").replace("right_", "left_").replace("*", "right_")
            odd = name in ("y", "qx", "qz", "roll", "yaw")
            image[names.index(twin)] = -vector[k] if odd else vector[k]
        return image

    for _ in range(10):
        q, v = _state(robot, rng)
        image = mirror(q, robot.coordinate_names), mirror(v, robot.dof_names)
        accelerations = [
            dynamics.forward(*state, aero.generalized_force(*state)) for state in ((q, v), image)
        ]
        scale = float(np.abs(accelerations[0]).max())
        mirrored = mirror(accelerations[1], robot.dof_names)
        np.testing.assert_allclose(mirrored, accelerations[0], atol=ROUNDING * scale)


def test_a_heading_is_only_a_name(robot):
    """A flight that starts turned about the vertical is the same flight, turned."""
    turn = _matrix(quaternion_from_angles([0.0, 0.0, 2.2]))
    straight = _fly(robot, 0.2, q={"pitch": -1.2, "roll": 0.3}, x=5.0, z=6.0)
    x, y, z = turn @ [5.0, 0.0, 6.0]
    turned = _fly(robot, 0.2, q={"pitch": -1.2, "roll": 0.3, "yaw": 2.2}, x=x, y=y, z=z)
    # rounding, grown by the motion's own sensitivity
    np.testing.assert_allclose(
        turned.q.values[:, :3], straight.q.values[:, :3] @ turn.T, atol=1e-11
    )
    np.testing.assert_allclose(turned.v.values[:, 3:], straight.v.values[:, 3:], atol=1e-9)


def _state(robot, rng):
    q, v = rng.uniform(-1.2, 1.2, robot.coordinate_count), rng.normal(size=robot.dof) * 3
    q[3:7] = rng.normal(size=4)
    q[3:7] /= np.linalg.norm(q[3:7])
    return q, v

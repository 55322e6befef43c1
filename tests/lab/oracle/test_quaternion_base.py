"""A quaternion floating base against other programs, the energies, and Euler angles."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import patagium as pt
from patagium.aerodynamics.model import aero_functions
from patagium.dynamics import equations, kinematics
from patagium.robot.attitude import (
    body_rates,
    quaternion_from_angles,
)
from patagium.robot.model import Robot
from patagium_lab.rivals import energy_form as energy


def _matrix(quaternions):
    """Body axes to world axes, (..., 3, 3), of quaternions qw, qx, qy, qz."""
    return Rotation.from_quat(np.roll(quaternions, -1, axis=-1)).as_matrix()


def _angles(quaternions):
    """Roll, pitch, yaw, (..., 3) [rad], of quaternions qw, qx, qy, qz."""
    return Rotation.from_quat(np.roll(quaternions, -1, axis=-1)).as_euler("ZYX")[..., ::-1]


ROUNDING = 1e-12  # relative to the largest entry: another order of summation
SOLVED = 1e-9  # of D^-1: D's condition number is about 1e7 for the aerobats
UPRIGHT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def _floating(machine: Robot) -> Robot:
    """With a quaternion, and its root as a free joint has it: without a place of its own."""
    root = replace(machine.bodies[0], position=(0.0, 0.0, 0.0), orientation=UPRIGHT)
    whole = replace(machine, bodies=(root, *machine.bodies[1:]), source="")
    return whole.with_attitude("quaternion")


def _machines(random_machine) -> list[Robot]:
    trees = [random_machine(seed) for seed in range(20)]
    return [_floating(tree) for tree in trees if tree.floating]


def _state(robot: Robot, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A state in which every attitude is as likely as any other."""
    q, v = rng.uniform(-1.2, 1.2, robot.coordinate_count), rng.normal(size=robot.dof) * 3
    q[3:7] = rng.normal(size=4)
    q[3:7] /= np.linalg.norm(q[3:7])
    return q, v


def _ours(robot: Robot) -> ca.Function:
    q = ca.SX.sym("q", robot.coordinate_count)
    v, a, f = (ca.SX.sym(name, robot.dof) for name in "vaf")
    outputs = [
        equations.mass_matrix(robot, q),
        equations.bias(robot, q, v),
        equations.inverse(robot, q, v, a),
        equations.forward(robot, q, v, f),
    ]
    return ca.Function("ours", [q, v, a, f], [ca.densify(x) for x in outputs])


def _assert_close(found: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    expected = np.array(expected).reshape(found.shape)
    assert np.abs(found - expected).max() <= tolerance * np.abs(expected).max()


def _compare_with_mujoco(robot: Robot, rng: np.random.Generator) -> None:
    from patagium_lab.rivals.mujoco_model import MujocoModel

    theirs, ours = MujocoModel(robot), _ours(robot)
    for _ in range(5):
        q, v = _state(robot, rng)
        mass_matrix, bias, _, _ = ours(q, v, v, v)
        _assert_close(theirs.mass_matrix(q), mass_matrix, ROUNDING)
        _assert_close(theirs.bias(q, v), bias, ROUNDING)


def test_mujocos_free_joint(random_machine, rng: np.random.Generator) -> None:
    pytest.importorskip("mujoco", reason="MuJoCo comes with the extra `bench`")
    _compare_with_mujoco(pt.load_robot("aerobat").with_attitude("quaternion"), rng)
    machines = _machines(random_machine)
    assert len(machines) > 5
    for machine in machines:
        _compare_with_mujoco(machine, rng)


def _compare_with_pinocchio(robot: Robot, rng: np.random.Generator) -> None:
    from patagium_lab.rivals.pinocchio_model import PinocchioModel

    theirs, ours = PinocchioModel(robot), _ours(robot)
    for _ in range(5):
        q, v = _state(robot, rng)
        a, f = rng.normal(size=(2, robot.dof)) * [[10.0], [0.01]]
        mass_matrix, bias, inverse, forward = ours(q, v, a, f)
        _assert_close(theirs.mass_matrix(q), mass_matrix, ROUNDING)
        _assert_close(theirs.bias(q, v), bias, ROUNDING)
        _assert_close(theirs.inverse(q, v, a), inverse, ROUNDING)
        _assert_close(theirs.forward(q, v, f), forward, SOLVED)


def test_pinocchios_spherical_joint(random_machine, rng: np.random.Generator) -> None:
    pytest.importorskip("pinocchio", reason="Pinocchio comes with the extra `bench`")
    _compare_with_pinocchio(pt.load_robot("aerobat").with_attitude("quaternion"), rng)
    for machine in _machines(random_machine):
        _compare_with_pinocchio(machine, rng)


def _energy_machines(random_machine) -> list[Robot]:
    trees = [random_machine(seed) for seed in range(20)]
    oblique = [tree.with_attitude("quaternion") for tree in trees if tree.floating]
    return [pt.load_robot("aerobat").with_attitude("quaternion"), *oblique]


def test_boltzmann_hamels_equations(random_machine, rng: np.random.Generator) -> None:
    """The recursive equations are the derivatives of the energies, at any length of q."""
    for robot in _energy_machines(random_machine):
        q, v = ca.SX.sym("q", robot.coordinate_count), ca.SX.sym("v", robot.dof)
        both = [
            (equations.mass_matrix(robot, q), energy.energy_mass_matrix(robot, q)),
            (equations.coriolis(robot, q, v), energy.energy_coriolis(robot, q, v)),
            (equations.gravity_force(robot, q), energy.energy_gravity(robot, q)),
        ]
        compared = ca.Function("both", [q, v], [ca.densify(x) for pair in both for x in pair])
        state = _state(robot, rng)
        state[0][3:7] *= 1.7
        found = [np.array(x) for x in compared(*state)]
        largest_force = max(np.abs(x).max() for x in found[2:])
        for name, ours, theirs in zip("DCG", found[::2], found[1::2], strict=True):
            scale = np.abs(theirs).max() if name == "D" else largest_force
            assert np.abs(ours - theirs).max() <= ROUNDING * scale, (robot.name, name)


@pytest.fixture(scope="module")
def pair(glider) -> tuple[Robot, Robot]:
    return glider("euler"), glider("quaternion")


def _turned(q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A state with angles as one with a quaternion, and E with v of the one = E v of the other."""
    matrix = np.eye(len(v))
    matrix[3:6, 3:6] = np.array([body_rates(q[3:6], unit) for unit in np.eye(3)]).T
    return np.concatenate([q[:3], quaternion_from_angles(q[3:6]), q[6:]]), matrix @ v, matrix


def _forces(robot: Robot):
    """Generalized force of two models of the air at a state."""
    models = [
        kind(robot, pt.Air(wind=(-3.0, 0.4, 0.2))) for kind in (pt.QuasiSteady, pt.LiftingLine)
    ]
    functions = [aero_functions(model)[0] for model in models]

    def forces(q: np.ndarray, v: np.ndarray) -> list[np.ndarray]:
        found = []
        for model, function in zip(models, functions, strict=True):
            state, wind = np.linspace(-1.0, 1.0, model.state_size), model.air.wind
            arguments = (q, v, state, wind, robot.parameters, model.parameters)
            found.append(np.array(function(*arguments)).ravel())
        return found

    return forces


def test_equations_are_those_of_angles_in_other_velocities(pair, rng: np.random.Generator) -> None:
    """D, energies, momenta, points, air and the free motion of a state, away from 90 degrees."""
    by_angles, by_quaternion = (pt.Dynamics(robot) for robot in pair)
    airs = [_forces(robot) for robot in pair]
    added = [pt.AddedMass(robot) for robot in pair]
    for _ in range(20):
        q, v = rng.uniform(-1.2, 1.2, 8), rng.normal(size=8) * 3
        p, u, e = _turned(q, v)
        # twice the roundings of each: E and two orders of summation, E well away from singular
        _assert_close(e.T @ by_quaternion.mass_matrix(p) @ e, by_angles.mass_matrix(q), ROUNDING)
        _assert_close(e.T @ by_quaternion.gravity(p), by_angles.gravity(q), ROUNDING)
        for name in ("kinetic_energy", "momentum", "angular_momentum"):
            ours, theirs = getattr(by_quaternion, name)(p, u), getattr(by_angles, name)(q, v)
            _assert_close(np.atleast_1d(ours), np.atleast_1d(theirs), ROUNDING)
        points = [dyn.point("left_wing", (0.01, 0.1, 0.02)) for dyn in (by_quaternion, by_angles)]
        _assert_close(points[0].position(p), points[1].position(q), ROUNDING)
        _assert_close(points[0].velocity(p, u), points[1].velocity(q, v), ROUNDING)
        _assert_close(points[0].jacobian(p) @ e, points[1].jacobian(q), ROUNDING)
        for ours, theirs in zip(airs[1](p, u), airs[0](q, v), strict=True):
            _assert_close(e.T @ ours, theirs, ROUNDING)
        force = airs[1](p, u)[0]
        _assert_close(e.T @ added[1].mass_matrix(p) @ e, added[0].mass_matrix(q), ROUNDING)
        free = by_quaternion.forward(p, u, force), by_angles.forward(q, v, e.T @ force)
        same = [k for k in range(8) if k not in (3, 4, 5)]  # accelerations of angles are others
        _assert_close(free[0][same], free[1][same], SOLVED)


def test_rates_of_the_quaternion_are_those_of_the_rotation(pair, rng: np.random.Generator) -> None:
    """dR/dt = R [w], and the length of q stays."""
    robot = pair[1]
    q, v = ca.SX.sym("q", robot.coordinate_count), ca.SX.sym("v", robot.dof)
    rates = kinematics.coordinate_rates(robot, q, v)
    rotation = kinematics.body_poses(robot, q)[0].rotation
    wrong = ca.jtimes(rotation, q, rates) - rotation @ ca.skew(v[3:6])
    length = ca.jtimes(ca.sumsqr(q[3:7]), q, rates)
    function = ca.Function("f", [q, v], [wrong, length, rotation, rates])
    for _ in range(10):
        x, u = _state(robot, rng)
        x[3:7] *= 0.8
        wrong, growth, turned, moving = (np.array(k) for k in function(x, u))
        # rounding of some tens of products
        assert np.abs(wrong).max() < 1e-14 * np.abs(u).max() and abs(float(growth[0, 0])) < 1e-14
        np.testing.assert_allclose(turned, _matrix(x[3:7]), atol=1e-15)
        compiled = pt.Dynamics(robot).coordinate_rates(x, u)
        np.testing.assert_allclose(compiled, moving.ravel(), rtol=1e-14)


def test_flights_agree_away_from_the_singularity(pair) -> None:
    """Two integrations of one motion: apart by the errors of both, which fall as h^4."""

    def fly(robot: Robot, steps: int):
        gait = pt.gaits.sinusoidal(robot, frequency=6.0, left_plunge=0.5, right_plunge=0.45)
        air = pt.Air(wind=(-1.0, 0.3, 0.0))
        return pt.simulate(
            robot, pt.QuasiSteady(robot, air), gait, duration=0.1, time_step=0.1 / steps,
            added_mass=pt.AddedMass(robot, air), v=robot.velocities(x=-5.0, y=4.0),
            q=robot.coordinates(roll=0.3, pitch=-0.4, yaw=2.5),
        )  # fmt: skip

    apart = []
    for steps in (100, 200, 400):
        by_angles, by_quaternion = (fly(robot, steps) for robot in pair)
        angles, quaternion = by_angles.q.values[-1], by_quaternion.q.values[-1]
        turned = quaternion_from_angles(angles[3:6])
        apart.append(np.abs(turned - quaternion[3:7] * np.sign(turned @ quaternion[3:7])).max())
        apart[-1] = max(apart[-1], np.abs(angles[:3] - quaternion[:3]).max())
        for name in ("fluid_energy", "aero_power", "strip_force", "mount_wrench", "momentum"):
            scale = np.abs(by_angles[name].values).max()
            ours, theirs = by_quaternion[name].values, by_angles[name].values
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-7 * scale)  # steps of 1 ms
    assert apart[-1] < 1e-11
    assert np.all(np.abs(np.log2(np.divide(apart[:-1], apart[1:])) - 4.0) < 0.5), apart


def test_a_loop_is_the_roll_of_the_same_machine_named_otherwise(glider) -> None:
    """Through a pitch of 90 and 180 degrees: angles on a hub turned by 90 degrees see a roll."""
    looping, rolling = glider("quaternion"), glider("euler", heading=90)
    flights = []
    for robot, heading in ((looping, 0.0), (rolling, -np.pi / 2)):
        gait = pt.gaits.sinusoidal(robot, frequency=6.0, left_plunge=0.3, right_plunge=0.28)
        flights.append(
            pt.simulate(
                robot,
                pt.QuasiSteady(robot),
                gait,
                duration=1.7,
                time_step=5e-4,
                q=robot.coordinates(yaw=heading),
                v=robot.velocities(x=20.0),
            )  # fmt: skip
        )
    loop, roll = flights
    assert loop.attrs["outcome"] == roll.attrs["outcome"] == "COMPLETED"
    rotation = _matrix(loop.q.values[:, 3:7])
    turned = np.unwrap(np.arctan2(rotation[:, 2, 0], rotation[:, 2, 2]))
    assert turned.max() > 2 * np.pi
    # both integrate the same motion, each with its own error of fourth order
    np.testing.assert_allclose(loop.q.values[:, :3], roll.q.values[:, :3], atol=1e-8)
    np.testing.assert_allclose(loop.strip_force.values, roll.strip_force.values, atol=1e-8)


def test_angles_there_and_back(rng: np.random.Generator) -> None:
    angles = rng.uniform(-1.0, 1.0, (100, 3)) * [np.pi, np.pi / 2, np.pi]
    back = _angles(quaternion_from_angles(angles))
    np.testing.assert_allclose(back, angles, atol=1e-12)  # rounding over the cosine of the pitch

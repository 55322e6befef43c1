"""Energy, momentum, symmetry of a robot and the air that moves with it."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics.indicial import ONE_STATE
from patagium.dynamics import equations
from patagium.robot import load_robot_text

ROUNDING = 1e-11  # differentiated expressions, some hundred roundings
WIND = np.array([-3.0, 0.4, 0.2])
PLATE = """
name: plate
gravity: 0 m/s^2
bodies:
  plate: {floating: true, mass: 1 kg, shape: {type: plate, axis: y, chord: 20 cm, span: 2 m,
    thickness: 1 mm}}
wings:
  - name: plate
    segments:
      - {body: plate, strips: 4, stations: [{span: -1 m, leading: 10 cm, trailing: -10 cm},
         {span: 1 m, leading: 10 cm, trailing: -10 cm}]}
"""


@pytest.fixture(params=["aerobat", "aerobat-beta", "yeo-wing"])
def robot(request):
    return pt.load_robot(request.param)


def symbols(robot, wind):
    q, v, a = (ca.SX.sym(name, robot.dof) for name in "qva")
    model = pt.AddedMass(robot)
    return q, v, a, model.inertia(robot, ca.SX(ca.DM(wind)), ca.SX(ca.DM(model.parameters)))


def test_matrix_is_symmetric_semidefinite_and_what_newton_euler_asks_for(robot, rng):
    q, v, a, added = symbols(robot, WIND)
    total = equations.mass_matrix(robot, q, added) - equations.mass_matrix(robot, q)
    recursive = ca.Function("d", [q], [ca.densify(total)])
    model = pt.AddedMass(robot)
    for _ in range(20):
        x = rng.normal(size=robot.dof)
        matrix = model.mass_matrix(x)
        size = np.abs(matrix).max()
        np.testing.assert_allclose(matrix, matrix.T, rtol=0, atol=1e-13 * size)
        assert np.linalg.eigvalsh(matrix).min() > -1e-13 * size
        # differences of matrices that hold the robot as well
        np.testing.assert_allclose(np.array(recursive(x)), matrix, rtol=0, atol=1e-12)
        whole = np.linalg.eigvalsh(matrix + pt.Dynamics(robot).mass_matrix(x))
        assert whole.min() > 0


def test_force_is_lagranges_of_the_energy_of_the_air(robot, rng):
    """-(d/dt dT/dv - dT/dq), T of the motion relative to a steady wind: the energy form."""
    q, v, a, added = symbols(robot, WIND)
    ground = equations.fluid_energy(robot, q, v, added)
    relative = ground - ca.dot(added.wind, equations.fluid_momentum(robot, q, v, added))
    impulse = ca.gradient(relative, v)
    rate = ca.jtimes(impulse, q, v) + ca.jtimes(impulse, v, a)
    force = ca.Function("f", [q, v, a], [ca.gradient(relative, q) - rate])
    model = pt.AddedMass(robot)
    for _ in range(10):
        x, u, du = rng.normal(size=(3, robot.dof))
        ours = model.generalized_force(x, u, du, WIND)
        expected = np.array(force(x, u, du)).ravel()
        np.testing.assert_allclose(ours, expected, atol=ROUNDING * np.abs(expected).max())


@pytest.mark.parametrize("wind", [np.zeros(3), WIND])
def test_free_motion_keeps_energy_and_momentum_of_robot_and_air(robot, rng, wind):
    q, v, a, added = symbols(robot, wind)
    energy = equations.kinetic_energy(robot, q, v) + equations.potential_energy(robot, q)
    energy = energy + equations.fluid_energy(robot, q, v, added)
    linear = equations.momentum(robot, q, v) + equations.fluid_momentum(robot, q, v, added)

    def rate(x):
        return ca.jtimes(x, q, v) + ca.jtimes(x, v, a)

    rates = ca.Function("r", [q, v, a], [rate(energy), rate(linear)])
    zero = ca.SX.zeros(robot.dof, 1)
    move = ca.Function("m", [q, v], [equations.forward(robot, q, v, zero, added)])
    weight = -sum(body.mass for body in robot.bodies) * robot.gravity
    for _ in range(10):
        x, u = rng.normal(size=(2, robot.dof))
        acceleration = np.array(move(x, u)).ravel()
        d_energy, d_linear = (np.array(r).ravel() for r in rates(x, u, acceleration))
        scale = max(1.0, float(np.abs(acceleration).max()))
        if robot.floating:
            np.testing.assert_allclose(d_linear, [0, 0, weight], atol=ROUNDING * scale)
        if robot.floating or not wind.any():  # a wing held to the ground takes the wind's energy
            assert abs(float(d_energy[0])) < ROUNDING * scale


def test_circulation_takes_nothing_from_the_energy(rng):
    """What circulation takes back does no work against the air."""
    robot = pt.load_robot("aerobat")  # it feathers: a wing that only flaps feels none of it
    model = pt.AddedMass(robot)
    for _ in range(20):
        x, u = rng.normal(size=(2, robot.dof))
        force = model.circulatory_force(x, u, np.zeros(3))
        assert np.abs(force).max() > 1e-5
        assert abs(force @ u) < 1e-14 * max(1.0, float(np.abs(force) @ np.abs(u)))


def test_a_mirrored_state_has_the_mirrored_force(rng):
    robot = pt.load_robot("aerobat")
    model = pt.AddedMass(robot)
    order, sign = [], np.ones(robot.dof)
    for i, name in enumerate(robot.dof_names):
        other = name.replace("left_", "*").replace("right_", "left_").replace("*", "right_")
        order.append(robot.index(other))
        if name in ("y", "roll", "yaw"):
            sign[i] = -1.0
    for _ in range(10):
        x, u, du = rng.normal(size=(3, robot.dof))
        mirrored = [sign * w[order] for w in (x, u, du)]
        wind = rng.normal(size=3)
        across = wind * [1, -1, 1]
        for force, image in (
            (model.generalized_force(x, u, du, wind), model.generalized_force(*mirrored, across)),
            (model.circulatory_force(x, u, wind), model.circulatory_force(*mirrored[:2], across)),
        ):
            np.testing.assert_allclose(image, sign * force[order], atol=1e-13)


def test_a_plate_that_moves_backward_has_the_mirrored_force():
    """Flow was taken at the geometric quarter chord: half of circulation's force was wrong."""
    model, mirror = pt.AddedMass(load_robot_text(PLATE)), np.array([-1.0, 1, 1, 1, -1, -1])
    for degrees in (20, 30, 40, 45, 60):  # the force fades from 30 to 50
        v = np.array([8.0, 0, -8 * np.tan(np.radians(degrees)), 0, 20, 0])
        force = model.circulatory_force(np.zeros(6), v)
        backward = model.circulatory_force(np.zeros(6), mirror * v)
        assert abs(force[0]) > 1
        np.testing.assert_allclose(backward, mirror * force, atol=1e-12)  # rounding


def aerodynamics(robot, air):
    line = pt.LiftingLine(robot, air, lags=ONE_STATE)
    return {"quasi-steady": pt.QuasiSteady(robot, air), "lifting line": line}


@pytest.mark.parametrize("wind", [0.0, 2.0])
@pytest.mark.parametrize("name", ["quasi-steady", "lifting line"])
def test_books_of_a_flight_balance_air_included(name, wind):
    robot = pt.load_robot("aerobat")
    air = pt.Air(wind=(-wind, 0.3 * wind, 0.0))
    flight = pt.simulate(
        robot,
        aerodynamics(robot, air)[name],
        pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5, left_feather=0.2),
        duration=0.1,
        time_step=2e-4,
        v=robot.coordinates(x=4.0 - wind),
        added_mass=pt.AddedMass(robot, air),
    )
    assert np.ptp(flight.fluid_energy.values) > 1e-3 * flight.attrs["energy_exchanged"]
    for audit in ("energy_audit", "fluid_energy_audit", "momentum_audit"):
        assert flight.attrs[audit] < 1e-6  # fourth order at 2e-4 s
    names = ("u1", "aero_force", "damping_force", "mount_force", "added_mass_force")
    forces = sum(flight[k].values for k in names)
    inverse = pt.Dynamics(robot).batch.inverse(flight.q.values, flight.v.values, flight.a.values)
    np.testing.assert_allclose(inverse, forces, atol=1e-12 * np.abs(inverse).max())


def test_a_wind_that_carries_the_robot_changes_nothing_but_the_frame():
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5)
    forces = []
    for wind in (0.0, 3.0):
        air = pt.Air(wind=(-wind, 0.0, 0.0))
        flight = pt.simulate(
            robot,
            pt.QuasiSteady(robot, air),
            gait,
            duration=0.05,
            time_step=2e-4,
            v=robot.coordinates(x=4.0 - wind),
            added_mass=pt.AddedMass(robot, air),
        )
        forces.append(flight.added_mass_force.values)
    # rounding over 250 steps
    np.testing.assert_allclose(*forces, atol=1e-11 * np.abs(forces[0]).max())

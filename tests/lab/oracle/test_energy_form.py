"""The recursive equations against the derivatives of the energies."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from patagium.dynamics import equations
from patagium.robot import load_robot
from patagium.robot.model import Robot
from patagium_lab.rivals import energy_form as energy

PRESETS = ("aerobat", "aerobat-published", "aerobat-beta", "yeo-wing")
ROUNDING = 1e-12  # relative to the largest entry: two orders of summation of the same terms


def _recursive_and_energy(robot: Robot) -> ca.Function:
    q, v = ca.SX.sym("q", robot.dof), ca.SX.sym("v", robot.dof)
    recursive = [
        equations.mass_matrix(robot, q),
        equations.coriolis(robot, q, v),
        equations.gravity_force(robot, q),
    ]
    by_energy = [
        energy.energy_mass_matrix(robot, q),
        energy.energy_coriolis(robot, q, v),
        energy.energy_gravity(robot, q),
    ]
    return ca.Function("both", [q, v], [ca.densify(x) for x in recursive + by_energy])


def _assert_equal(robot: Robot, rng: np.random.Generator, states: int) -> None:
    both = _recursive_and_energy(robot)
    for _ in range(states):
        q, v = rng.uniform(-1.2, 1.2, robot.dof), rng.normal(size=robot.dof) * 3
        found = [np.array(x) for x in both(q, v)]
        largest_force = max(np.abs(x).max() for x in found[4:])
        for name, recursive, by_energy in zip("DCG", found[:3], found[3:], strict=True):
            # C v may vanish identically (a single joint): then gravity sets the scale
            scale = np.abs(by_energy).max() if name == "D" else largest_force
            assert np.abs(recursive - by_energy).max() <= ROUNDING * scale, name


@pytest.mark.parametrize("preset", PRESETS)
def test_presets(preset: str, rng: np.random.Generator) -> None:
    _assert_equal(load_robot(preset), rng, 10)


@pytest.mark.parametrize("seed", range(20))
def test_random_trees(seed: int, random_machine, rng: np.random.Generator) -> None:
    _assert_equal(random_machine(seed), rng, 3)


def test_random_trees_have_every_kind_of_joint(random_machine) -> None:
    machines = [random_machine(seed) for seed in range(20)]
    bodies = [body for machine in machines for body in machine.bodies]
    kinds = {joint.kind for body in bodies for joint in body.joints}
    assert kinds == {"revolute", "prismatic"}
    assert {machine.floating for machine in machines} == {True, False}
    assert any(not b.joints and b.floating_dofs is None for b in bodies), "a fixed body"
    assert any(len(b.joints) == 2 for b in bodies), "two joints at one body"
    branching = [
        len({b.parent for b in m.bodies}) < len(m.bodies) for m in machines if len(m.bodies) > 2
    ]
    assert any(branching)


def test_a_flapping_wing_is_the_textbook_pendulum() -> None:
    """Inertia m l^2 at each hinge, no Coriolis force, m g l cos(q) about a hinge."""
    robot = load_robot("yeo-wing")
    wing = robot.bodies[0]
    lever = wing.center_of_mass[1]
    q, v = ca.SX.sym("q", robot.dof), ca.SX.sym("v", robot.dof)
    outputs = [
        energy.energy_mass_matrix(robot, q),
        energy.energy_coriolis(robot, q, v),
        energy.energy_gravity(robot, q),
    ]
    found = ca.Function("f", [q, v], outputs)([0.4, 0.0], [20.0, -3.0])
    mass_matrix, coriolis, gravity = (np.array(x).squeeze() for x in found)
    assert mass_matrix[0, 0] == pytest.approx(wing.mass * lever**2 + wing.inertia[0], rel=1e-14)
    assert mass_matrix[0, 1] == 0, "two wings on a fixed root do not feel each other"
    assert np.abs(coriolis).max() < 1e-15  # a constant inertia has no Coriolis force
    expected = wing.mass * robot.gravity * lever * np.cos(0.4)
    assert gravity[0] == pytest.approx(expected, rel=1e-14)


def test_mx_and_sx_agree(rng: np.random.Generator) -> None:
    robot = load_robot("aerobat")
    results = []
    for symbol in (ca.SX, ca.MX):
        q, v = symbol.sym("q", robot.dof), symbol.sym("v", robot.dof)
        outputs = [
            energy.energy_mass_matrix(robot, q),
            energy.energy_coriolis(robot, q, v),
            energy.energy_gravity(robot, q),
        ]
        results.append(ca.Function("f", [q, v], outputs))
    q, v = rng.uniform(-1, 1, robot.dof), rng.normal(size=robot.dof)
    for sx, mx in zip(results[0](q, v), results[1](q, v), strict=True):
        scale = np.abs(np.array(sx)).max()
        np.testing.assert_allclose(np.array(mx), np.array(sx), atol=ROUNDING * scale, rtol=0)

"""Flexible plates against beam theory, and the energy of a flight with wings that bend."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import eigh
from tests.robots import FLAPPER

import patagium as pt
from patagium.control.events import without_tip
from patagium.dynamics.equations import damping_force, spring_force
from patagium.errors import Outcome, ParameterError, RobotFileError
from patagium.robot import Robot, load_robot_text
from patagium.sensing.sensors.scene import Scene
from patagium.simulation.mounts import with_load_cells

pytestmark = pytest.mark.usefixtures("interpreted")

BEAM = """
name: beam
gravity: 0
bodies:
  beam:
    mass: 0.1 kg
    center_of_mass: [0, 0.25, 0]
    shape: {type: plate, chord: 4 cm, span: 0.5 m, thickness: 1 mm}
    flexible: {elements: 8, bending: 0.5 N m^2, torsion: 0.2 N m^2}
"""
BENDING = np.array([1.87510407, 4.69409113, 7.85475744]) ** 2 * np.sqrt(0.5 / 0.2) / 0.5**2
"""First frequencies of a cantilever [rad/s]: beta^2 sqrt(EI / (m/L)) / L^2."""
TORSION = np.pi / 2 * np.array([1, 3]) / 0.5 * np.sqrt(0.2 / (0.2 * (0.04**2 + 1e-6) / 12))
"""First frequencies of a clamped rod [rad/s]: (k - 1/2) pi / L sqrt(GJ / I)."""
FLEXIBLE = FLAPPER.replace(
    "shape: {type: plate, chord: 8 cm, span: 20 cm, thickness: 1 mm}",
    "shape: {type: plate, chord: 8 cm, span: 20 cm, thickness: 1 mm}\n"
    "    flexible: {elements: 2, bending: 0.03 N m^2, torsion: 0.005 N m^2, damping: 0.3 ms}",
).replace("strips: 1", "strips: 6")


def stiffness(robot: Robot) -> np.ndarray:
    """Stiffness of the hinges, with the couplings between them, (n, n) [N m/rad]."""
    q = ca.SX.sym("q", robot.dof)
    return np.array(ca.evalf(ca.jacobian(spring_force(robot, q), q)))


def frequencies(elements: int) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies of bending and of torsion [rad/s]; at rest they do not act on each other."""
    robot = load_robot_text(BEAM.replace("elements: 8", f"elements: {elements}"))
    matrix = pt.Dynamics(robot).mass_matrix(np.zeros(robot.dof))
    found = []
    for kind in ("bend", "twist"):
        k = [i for i, name in enumerate(robot.dof_names) if f"_{kind}_" in name]
        found.append(np.sqrt(eigh(stiffness(robot)[np.ix_(k, k)], matrix[np.ix_(k, k)])[0]))
    return found[0], found[1]


def test_frequencies_are_those_of_beams_and_converge():
    errors = {}
    for elements in (4, 8):
        bending, torsion = frequencies(elements)
        errors[elements] = np.abs(bending[:2] / BENDING[:2] - 1), torsion[:2] / TORSION - 1
    bending, torsion = frequencies(8)
    assert np.abs(bending[:3] / BENDING - 1).max() < 0.01
    assert np.abs(torsion[:2] / TORSION - 1).max() < 0.0035  # without couplings .0156
    assert (errors[4][0] / errors[8][0] > 12).all()  # fourth order: 16
    assert (errors[4][1] / errors[8][1] > 7.5).all()  # third order: 8


def test_a_torque_at_the_tip_twists_as_much_as_the_rod():
    robot = load_robot_text(BEAM)
    torque = np.array([float("_twist_" in name) for name in robot.dof_names])
    twist = np.linalg.solve(stiffness(robot), torque)[torque > 0]
    np.testing.assert_allclose(twist, 0.5 / 0.2 / 8, rtol=1e-12)  # L / GJ, alike at every hinge


def test_a_flight_with_flexible_wings_keeps_its_energy_and_is_symmetric():
    robot = load_robot_text(FLEXIBLE)
    assert [body.name for body in robot.bodies if "left" in body.name] == [
        "left_wing", "left_wing_1", "left_wing_2",
    ]  # fmt: skip
    rigid = load_robot_text(FLAPPER)
    whole, parts = (pt.Dynamics(r).mass_matrix(r.coordinates()) for r in (rigid, robot))
    shared = [robot.dof_names.index(name) for name in rigid.dof_names]
    np.testing.assert_allclose(whole, parts[np.ix_(shared, shared)], atol=1e-12)
    assert len({strip.body for strip in robot.strips}) == 6  # every piece of both wings has some
    gait = pt.gaits.sinusoidal(robot, frequency=6.0, plunge=0.6, feather=0.1)
    flight = pt.simulate(
        robot, pt.QuasiSteady(robot), gait, duration=0.2, time_step=5e-5,
        v=robot.velocities(x=5.0),
    )  # fmt: skip
    exchanged = np.abs(flight["air_work"].values).max()
    assert np.abs(flight["energy_residual"].values).max() < 1e-8 * exchanged
    bent = flight.q.sel(dof="left_wing_bend_1").values
    assert 0.01 < np.abs(bent).max() < 0.5
    np.testing.assert_allclose(bent, flight.q.sel(dof="right_wing_bend_1"), atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("elements: 8", "elements: 3", "multiple of 2"),
        ("bending: 0.5 N m^2, torsion: 0.2 N m^2", "damping: 1 ms", "bending or a torsion"),
        ("type: plate, chord: 4 cm, span: 0.5 m, thickness: 1 mm",
         "type: box, size: [4 cm, 0.5 m, 1 mm]", "a plate along y"),
        ("0.2 N m^2", "0.2 N m", "torsion"),
        ("[0, 0.25, 0]", "[0, 0, 0]", "begins 0.25 m on the other side"),  # held at its tip
    ],
)  # fmt: skip
def test_what_cannot_bend_is_refused(old, new, words):
    with pytest.raises(RobotFileError, match=words):
        load_robot_text(BEAM.replace(old, new))


def test_what_hangs_on_a_flexible_body_hangs_on_its_piece():
    text = (
        BEAM
        + """
  tip:
    parent: beam
    at: [1 cm, 0.5, 0]
    joints: [{name: tip_turn, axis: x}]
    mass: 1 g
    shape: {type: box, size: [1 cm, 1 cm, 1 cm]}
"""
    )
    robot = load_robot_text(text)
    tip = robot.bodies[robot.body_index("tip")]
    assert robot.bodies[tip.parent].name == "beam_8"
    place = np.zeros(3)
    while tip.parent >= 0:
        place, tip = place + tip.position, robot.bodies[tip.parent]
    np.testing.assert_allclose(place, [0.01, 0.5, 0], atol=1e-15)


TIPPED = FLEXIBLE.replace(
    "wings:\n",
    "  left_tip: {parent: left_wing, at: [1 cm, 20 cm, 0], mass: 1 g, shape: {type: point}}\n"
    "wings:\n",
)


def test_a_point_of_a_flexible_body_is_on_its_piece():
    """A payload and a sensor at the tip went to the stiff piece at the root."""
    robot, tipped = map(load_robot_text, (FLEXIBLE, TIPPED))
    tips = [(f"{side}_wing", (0.01, y, 0.0)) for side, y in (("left", 0.2), ("right", -0.2))]
    loaded = robot
    for body, at in tips:
        event = pt.control.PayloadEvent(time=0.0, body=body, mass=1e-3, position=at)
        loaded, _ = event.changed(loaded, pt.QuasiSteady(loaded))
    q = 0.1 * np.arange(1.0, robot.dof + 1)
    masses = [pt.Dynamics(one).mass_matrix(q) for one in (loaded, tipped)]
    np.testing.assert_allclose(*masses, atol=1e-12)
    gait = pt.gaits.sinusoidal(tipped, frequency=6.0, plunge=0.6)
    flight = pt.simulate(tipped, pt.QuasiSteady(tipped), gait, duration=0.01, time_step=5e-5)
    scene = Scene(flight, tipped)
    pairs = [(*tips[0], "left_tip"), (*tips[1], "right_tip")]
    for body, at, tip in pairs:
        seen, there = (
            scene.frame(name, np.array(where), np.eye(3), scene.time[::20])
            for name, where in ((body, at), (tip, (0.0, 0.0, 0.0)))
        )
        np.testing.assert_allclose(seen.position, there.position, atol=1e-14)
        np.testing.assert_allclose(seen.specific_force, there.specific_force, atol=1e-9)
        point = pt.Dynamics(tipped).point(body, at)
        np.testing.assert_allclose(point.position(flight.q.values[-1]), there.position[-1])
    with pytest.raises(ParameterError, match="a point, as left_wing is flexible"):
        event = pt.control.PayloadEvent(time=0.0, body="left_wing", mass=1e-3)
        event.changed(robot, pt.QuasiSteady(robot))


def test_a_flexible_wing_that_loses_its_tip_flies_on():
    """Steps stayed explicit, and the little that is left of a piece on its springs is stiff."""
    robot, step = load_robot_text(FLEXIBLE), 5e-5
    cut = without_tip(robot, "left_wing", 0.3)
    still, v = pt.gaits.still(robot), robot.velocities(x=5.0)
    whole = pt.Simulator(
        robot, pt.QuasiSteady(robot), still, duration=0.01, time_step=step, v=v
    )  # fmt: skip
    whole.advance(100)
    then, aero = whole.state, pt.QuasiSteady(cut)
    whole.change(cut, aero)
    assert whole.advance(100) is Outcome.COMPLETED
    assert whole.flight().attrs["stepping"] == "partitioned RK4, then partitioned Lobatto IIIC"
    again = pt.simulate(
        cut, aero, still, duration=0.005, time_step=step, q=then.q, v=then.v
    )  # fmt: skip
    np.testing.assert_allclose(whole.state.q, again["q"][-1], rtol=1e-12, atol=1e-14)
    whole.change(robot, pt.QuasiSteady(robot))
    assert whole.flight().attrs["stepping"].endswith("Lobatto IIIC, then partitioned RK4")


def test_a_load_cell_in_a_twisting_wing_leaves_its_springs():
    """The twist beyond the cell was coupled to a slide of the cell, which is held."""
    robot = load_robot_text(FLEXIBLE)
    cells = [pt.mounts.load_cell("left_wing_2"), pt.mounts.load_cell("right_wing_bend_1")]
    machine = with_load_cells(robot, cells)
    np.testing.assert_array_equal(stiffness(machine)[12:, 12:], stiffness(robot))
    assert not stiffness(machine)[:12].any()
    arm = pt.load_robot("ur5e")
    held = stiffness(robot.mounted_on(arm, at="tool"))
    np.testing.assert_array_equal(held[arm.dof :, arm.dof :], stiffness(robot)[6:, 6:])


@pytest.mark.parametrize("piece", ["beam_0", "beam_1"])
def test_a_body_with_the_name_of_a_piece_is_refused(piece):
    """It took the place of the piece without a word."""
    other = f"\n  {piece}: {{parent: beam, mass: 1 g, shape: {{type: point}}}}\n"
    with pytest.raises(RobotFileError, match=f"{piece} is a piece of the flexible body beam"):
        load_robot_text(BEAM + other)


@pytest.mark.parametrize("number", ["mass", "center_of_mass.x", "inertia.xx"])
def test_numbers_of_a_whole_flexible_body_are_no_parameters(number):
    """They were those of the piece at the root: a mass of 6 g for 5 made 45.9 g of 37."""
    robot = load_robot_text(FLEXIBLE)
    told = r"a piece, left_wing_0, left_wing_1 .*`bodies` in the robot's file"
    with pytest.raises(ParameterError, match=told):
        robot.with_parameters({f"left_wing.{number}": 1e-3})
    with pytest.raises(RobotFileError, match=f"parameters.left_wing.{number}: .*{told}"):
        load_robot_text(f"{FLEXIBLE}parameters: {{left_wing.{number}: 1e-3}}\n")
    with pytest.raises(ParameterError, match=told):
        pt.GreyBox(pt.QuasiSteady(robot), {f"left_wing.{number}": 1e-3})
    own, place = robot.body_index("left_wing"), "left_wing.position.x"
    moved = robot.with_parameters({"left_wing_0.mass": 1e-3, place: 0.01})
    assert moved.bodies[own].mass == 1e-3 and moved.bodies[own].position[0] == 0.01
    assert moved.mass == pytest.approx(robot.mass - robot.bodies[own].mass + 1e-3, rel=1e-15)
    assert load_robot_text(moved.source).bodies == moved.bodies


def test_a_mode_is_damped_by_the_time_that_is_given():
    """Springs between neighboring hinges had no damper: .78 of it in the fourth mode of twist."""
    robot = load_robot_text(FLEXIBLE)
    v = ca.SX.sym("v", robot.dof)
    damping = -np.array(ca.evalf(ca.jacobian(damping_force(robot, v), v)))
    np.testing.assert_allclose(damping, 3e-4 * stiffness(robot), rtol=1e-12)  # rounding
    assert damping[robot.index("left_wing_twist_1"), robot.index("left_wing_twist_2")] < 0

"""Network of strips that is linear in its weights: its physics against the modules of the physics.

Tolerances of 1e-12 are rounding, relative to the largest force.
"""

from __future__ import annotations

import json
import pickle
import re

import numpy as np
import pytest
from numpy.typing import NDArray

import patagium as pt
from patagium.aerodynamics import Section, linear_strips
from patagium.aerodynamics.description import aero_from_description
from patagium.aerodynamics.indicial import ONE_STATE
from patagium.aerodynamics.linear_strips import (
    BODY_TERMS,
    EDGES,
    LIFTING_LINE,
    STRIP_TERMS,
    WHOLE_TERMS,
)
from patagium.errors import ParameterError
from patagium.learning.models.linear_strip import LinearStripNetwork, strip_forces
from patagium.learning.models.memory import network_inputs
from patagium.learning.models.registry import network_from_description
from patagium.learning.samples import samples
from patagium.robot import Robot, load_robot_text

Array = NDArray[np.float64]
OF_STRIPS = WHOLE_TERMS[0].name, *(term.name for term in STRIP_TERMS)


@pytest.fixture(scope="module")
def network() -> LinearStripNetwork:
    return LinearStripNetwork(pt.load_robot("aerobat"))


@pytest.fixture(scope="module")
def tailed() -> LinearStripNetwork:
    """A hawk of few strips: its code compiles in seconds, not in a minute."""
    return LinearStripNetwork(
        load_robot_text(re.sub(r"strips: \d+", "strips: 1", pt.load_robot("hawk").source))
    )


@pytest.fixture(scope="module")
def attached() -> LinearStripNetwork:
    return LinearStripNetwork(pt.load_robot("aerobat"), attached=True)


def sample(robot: Robot, seed: int) -> tuple[Array, Array, Array]:
    draw = np.random.default_rng(seed)
    q = np.array(robot.coordinates()) + 0.2 * draw.standard_normal(robot.coordinate_count)
    v = np.r_[3.0, draw.standard_normal(robot.dof - 1)]
    return q, v, 20 * draw.standard_normal(robot.dof)


def physics(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    blades, carried = pt.QuasiSteady(robot), pt.AddedMass(robot)
    elements = np.array(blades.batch.generalized_force(q[None], v[None]))[0]
    return elements + carried.generalized_force(q, v, a) + carried.circulatory_force(q, v)


@pytest.mark.parametrize("seed", range(3))
def test_expected_weights_are_blade_elements_with_added_mass(
    network: LinearStripNetwork, seed: int
) -> None:
    q, v, a = sample(network.robot, seed)
    expected = physics(network.robot, q, v, a)
    found = network(np.concatenate([q, v, a]), network.initial(0))
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["network", "tailed", "attached"])
def test_forces_of_strips_sum_to_the_force_without_added_mass_and_bodies(
    name: str, request: pytest.FixtureRequest
) -> None:
    network: LinearStripNetwork = request.getfixturevalue(name)
    robot = network.robot
    x = np.array([np.concatenate(sample(robot, seed)) for seed in range(3)])
    lags = np.random.default_rng(1).standard_normal((3, network.inputs - network.measured_inputs))
    x = np.hstack([x, lags])
    own = {f"{term} of {kind}" for term in OF_STRIPS[1:] for kind in network.surfaces}
    own |= {LIFTING_LINE.name, EDGES.name}
    chosen = [term.name in OF_STRIPS or term.name in own for term in network.terms]
    places = network._placed(np.ones(17), chosen, 0.0)
    weights = places * np.random.default_rng(0).standard_normal(network.size)
    forces = strip_forces(network, x, weights)
    assert forces.shape == (3, len(robot.strips), 3)
    expected = network.evaluate(x, weights)[:, :3]  # along x, y, z of the world
    atol = 1e-12 * np.abs(expected).max()
    np.testing.assert_allclose(forces.sum(axis=1), expected, atol=atol)


@pytest.mark.parametrize("name", ["network", "tailed", "attached"])
def test_air_at_weights_with_its_added_mass_is_the_force_of_the_network(
    name: str, request: pytest.FixtureRequest
) -> None:
    network: LinearStripNetwork = request.getfixturevalue(name)
    robot, draw = network.robot, np.random.default_rng(5)
    q, v, a = sample(robot, 5)
    weights = network.initial(0) + 0.3 * draw.standard_normal(network.size)
    weights[-4:] = 0.0  # stand for nothing
    lags = draw.standard_normal(network.inputs - network.measured_inputs)
    expected = network(np.concatenate([q, v, a, lags]), weights)
    request.getfixturevalue("interpreted")
    air, added = network.air_at(weights)
    air = aero_from_description(robot, json.loads(json.dumps(air.describe())))
    found = air.generalized_force(q, v, lags[: air.state_size])
    found += added.generalized_force(q, v, a) + added.circulatory_force(q, v)
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())
    assert len({*added.factors.values()}) == (2 if name == "tailed" else 1)  # kinds of wings


def test_side_edges_pull_the_ends_of_attached_wings_outwards(
    attached: LinearStripNetwork,
) -> None:
    robot = attached.robot
    x = np.r_[robot.coordinates(), 5.0, 0.0, -0.5, np.zeros(2 * robot.dof - 3)]
    x = np.r_[x, np.ones(attached.inputs - attached.measured_inputs)]  # lags of lift upwards
    chosen = [float(term is EDGES) for term in attached.terms]
    pulls = strip_forces(attached, x[None], attached._placed(np.zeros(17), chosen, 0.0))[0, :, 1]
    left, right = pulls.reshape(2, -1)  # y goes to the left
    assert left[-1] > 0 > left[0]  # a gap between the roots: four ends
    assert not left[1:-1].any()
    assert right == pytest.approx(-left)


@pytest.mark.usefixtures("interpreted")
def test_in_attached_flow_it_begins_with_a_lifting_line_and_added_mass() -> None:
    """The truth by Runge-Kutta, lags included; the network's by its second-order steps."""
    robot = load_robot_text(pt.load_robot("aerobat").source.replace("strips: 5", "strips: 3"))
    section = Section(profile_drag=0.0, stall_begins=1.56, stall_complete=1.57)
    wind = pt.Air(wind=(-4.0, 0.0, 0.0))
    air = pt.LiftingLine(robot, wind, lags=ONE_STATE, section=section)
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.4, feather=0.2)
    error = []
    for step in (1e-3, 5e-4):
        flight = pt.simulate(
            robot,
            air,
            gait,
            duration=1.2,  # of the start, which has no lift yet, e^-20 is left
            time_step=step,
            mount=pt.mounts.fixed(),
            added_mass=pt.AddedMass(robot, wind),
        )
        network = LinearStripNetwork(robot, wind, attached=True)
        time, x, y, _ = samples(flight, network)
        weights = network.initial(0)
        left = y - network.evaluate(network_inputs(network, weights, time, x), weights)
        heard = np.abs(y).max(axis=0) > 1e-6 * np.abs(y).max()
        error.append(
            (np.abs(left[len(left) // 2 :]).max(axis=0) / np.abs(y).max(axis=0))[heard].max()
        )
    assert error[1] < 1e-5
    assert error[0] / error[1] == pytest.approx(4.0, rel=0.1)  # second order


def test_force_is_linear_in_the_weights(network: LinearStripNetwork) -> None:
    x = np.concatenate(sample(network.robot, 5))
    draw = np.random.default_rng(0)
    one, other = draw.standard_normal((2, network.size))
    value, slopes = network.linearized(network.encode_one(x), one)
    np.testing.assert_allclose(value, slopes @ one, atol=1e-12 * np.abs(value).max())
    both = network(x, one + other)
    np.testing.assert_allclose(both, value + network(x, other), atol=1e-12 * np.abs(both).max())


def test_many_samples_are_those_one_by_one(network: LinearStripNetwork) -> None:
    rows = np.array([np.concatenate(sample(network.robot, seed)) for seed in range(3)])
    weights = network.initial(0) + 0.1
    found = network.evaluate(rows, weights)
    np.testing.assert_array_equal(found, [network(row, weights) for row in rows])


def test_acceleration_of_carried_air_undoes_the_part_of_added_mass_that_accelerates(
    network: LinearStripNetwork,
) -> None:
    q, v, a = sample(network.robot, 7)
    names = [term.name for term in network.terms]
    weights = network._placed(
        np.zeros(17),
        [
            {"added mass": 1.0, "acceleration of the air carried along": -1.0}.get(name, 0.0)
            for name in names
        ],
        0.0,
    )
    found = network(np.concatenate([q, v, a]), weights)
    again = network(np.concatenate([q, v, 0 * a]), weights)
    # what is left depends on velocities alone
    np.testing.assert_allclose(found, again, atol=1e-12 * np.abs(found).max())


def test_drag_of_a_body_is_that_of_a_box_of_its_inertia(network: LinearStripNetwork) -> None:
    robot = network.robot
    body = robot.bodies[0]
    xx, yy, zz = (float(value) for value in body.inertia[:3])
    height, width = (6 * value / float(body.mass) for value in (xx + yy - zz, xx + zz - yy))
    q, v = np.array(robot.coordinates()), np.zeros(robot.dof)
    v[0] = 4.0
    values = [float(term.name == f"{BODY_TERMS[0].name} of {body.name}") for term in network.terms]
    assert sum(values) == 1
    weights = network._placed(np.zeros(17), values, 0.0)
    found = network(np.concatenate([q, v, np.zeros(robot.dof)]), weights)
    drag = -1.225 / 2 * np.sqrt(height * width) * 4.0**2
    assert found[0] == pytest.approx(drag, rel=1e-12)
    assert abs(found[1:3]).max() < 1e-12 * abs(drag)


@pytest.mark.parametrize("incidence", [0.0, 0.02, 0.3])
def test_drag_beyond_a_small_incidence_takes_power_there_alone(
    network: LinearStripNetwork, incidence: float
) -> None:
    robot = network.robot
    values = [float(term.name == "drag beyond a small incidence") for term in network.terms]
    assert sum(values) == 1
    weights = network._placed(np.zeros(17), values, 0.0)
    q, v = np.array(robot.coordinates()), np.zeros(robot.dof)
    v[:3] = 4.0 * np.cos(incidence), 0.0, -4.0 * np.sin(incidence)
    power = v @ network(np.concatenate([q, v, np.zeros(robot.dof)]), weights)
    normal = [np.array(strip.normal, float)[2] for strip in robot.strips]
    assert np.allclose(normal, 1.0, rtol=1e-12)
    area = sum(float(strip.chord) * float(strip.width) for strip in robot.strips)
    share = np.sin(incidence) ** 2 / (np.sin(incidence) ** 2 + 0.02**2)
    expected = -1.225 / 2 * area * 4.0**3 * share
    assert power == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_a_section_that_turns_is_slowed_by_the_square_of_its_rate(
    network: LinearStripNetwork,
) -> None:
    robot, rate = network.robot, 80.0
    values = [float(term.name == "moment of a section that turns") for term in network.terms]
    q, v, k = np.array(robot.coordinates()), np.zeros(robot.dof), robot.index("left_feather")
    v[k] = rate
    x = np.concatenate([q, v, np.zeros(robot.dof)])
    left = [strip for strip in robot.strips if strip.wing == "left_wing"]
    sizes = sum(float(strip.chord) ** 4 * float(strip.width) for strip in left)
    moment = network(x, network._placed(np.zeros(17), values, 0.0))[k]
    assert moment == pytest.approx(-1.225 / 2 * sizes * rate**2, rel=1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_departures_of_all_kinds_of_wings_are_a_change_of_what_is_common(
    tailed: LinearStripNetwork, seed: int
) -> None:
    assert tailed.surfaces == ("wing", "tail")
    x = np.concatenate(sample(tailed.robot, seed))
    draw = np.random.default_rng(seed)
    change = dict(
        zip([t.name for t in STRIP_TERMS], draw.standard_normal(len(STRIP_TERMS)), strict=True)
    )

    def force(names: dict[str, float]) -> Array:
        values = [names.get(term.name, 0.0) for term in tailed.terms]
        return tailed(x, tailed._placed(np.zeros(17), values, 0.0))

    common = force(change)
    of_wing, of_tail = (
        force({f"{term} of {kind}": value for term, value in change.items()})
        for kind in tailed.surfaces
    )
    scale = np.abs(common).max()
    np.testing.assert_allclose(of_wing + of_tail, common, atol=1e-12 * scale)
    assert np.abs(of_tail).max() > 1e-6 * scale and np.abs(of_wing).max() > 1e-6 * scale
    joint = tailed.robot.index("left_sweep")  # of the wing alone
    assert abs(of_tail[joint]) < 1e-12 * scale < abs(of_wing[joint])


def test_a_tail_of_another_section_is_told_from_the_wing(
    tailed: LinearStripNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Truth: the tail has twice the attached lift. Where none may depart it is missed."""
    robot, draw = tailed.robot, np.random.default_rng(3)
    names = [term.name for term in tailed.terms]
    truth = tailed.initial(0) + tailed._placed(
        np.zeros(17), [float(name == "attached lift of tail") for name in names], 0.0
    )
    monkeypatch.setattr(linear_strips, "SURFACE_SHARE", 1e-6)
    together = LinearStripNetwork(robot)
    learners = [pt.ExtendedLearner(net, misfit=pt.learning.Misfit()) for net in (tailed, together)]
    tail = robot.index("pitch")
    errors = np.zeros(2)
    for k in range(300):
        q, v, a = sample(robot, k)
        x = np.concatenate([q, v, a + draw.standard_normal(robot.dof)])
        y = tailed(x, truth)
        for place, learner in enumerate(learners):
            error = learner.predict(x)[0][tail] - y[tail]
            learner.update(x, y, 0.01 * k)
            errors[place] += error**2 * (k > 200)
    assert errors[0] < 0.1 * errors[1]  # found: see the figures of the page on foreign air


def test_a_model_whose_terms_were_others_is_refused(tailed: LinearStripNetwork) -> None:
    old = {key: value for key, value in tailed.describe().items() if key != "terms"}
    with pytest.raises(ParameterError, match="terms of the network: .*learn the log anew"):
        network_from_description(old)


def yawed(network: LinearStripNetwork, term: str, yaw: float, incidence: float) -> Array:
    """Force along x, y, z of a term where the robot is carried askew, per dynamic pressure [m^2].

    The air meets the wings from the side by the yaw, and from below by the incidence.
    """
    robot = network.robot
    values = [float(one.name == term) for one in network.terms]
    assert sum(values) == 1
    q, v = np.array(robot.coordinates()), np.zeros(robot.dof)
    along = np.cos(incidence)
    v[:3] = 4.0 * np.array([along * np.cos(yaw), along * np.sin(yaw), -np.sin(incidence)])
    weights = network._placed(np.zeros(17), values, 0.0)
    force = network(np.concatenate([q, v, np.zeros(robot.dof)]), weights)[:3]
    return np.asarray(force / (1.225 / 2 * 4.0**2))


@pytest.mark.parametrize("yaw", [0.0, 0.5, -1.2])
def test_friction_and_separated_flow_go_with_the_whole_velocity(
    network: LinearStripNetwork, yaw: float
) -> None:
    """A flat wing is turned about its normal: the same force, turned along (closed forms)."""
    area = sum(float(strip.chord) * float(strip.width) for strip in network.robot.strips)
    sine, cosine = np.sin(0.3), np.cos(0.3)
    there = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    motion = cosine * there - sine * np.array([0.0, 0.0, 1.0])
    drag = yawed(network, "drag along the flow", yaw, 0.3)
    np.testing.assert_allclose(drag, -area * motion, atol=1e-9 * area)
    across = yawed(network, "drag of the area across the flow", yaw, 0.3)
    np.testing.assert_allclose(across, -2 * area * sine * motion, atol=1e-9 * area)
    lift = yawed(network, "lift of separated flow", yaw, 0.3)
    assert abs(lift @ motion) < 1e-9 * area  # Polhamus: 2 sin^2 cos, across the motion
    assert np.linalg.norm(lift) == pytest.approx(2 * area * sine**2 * cosine, rel=1e-9)
    assert lift[2] > 0


def test_terms_of_own_air_are_found_from_a_flight(network: LinearStripNetwork) -> None:
    """A flight in blade elements without added mass: the weight of added mass goes to zero."""
    robot = network.robot
    blades = pt.QuasiSteady(robot)
    learner = pt.ExtendedLearner(network, misfit=pt.learning.Misfit())
    time = 0.01 * np.arange(250)
    sides = [k for k, name in enumerate(robot.dof_names) if "plunge" in name or "feather" in name]
    for t in time:
        q, v, a = np.array(robot.coordinates()), np.zeros(robot.dof), np.zeros(robot.dof)
        v[0] = 3.0 + 0.5 * np.sin(3 * t)
        for place, k in enumerate(sides):
            size, phase, w = (0.6, 0.0, 31.0) if place % 2 == 0 else (0.3, 1.0, 31.0)
            q[k], v[k] = size * np.sin(w * t + phase), size * w * np.cos(w * t + phase)
            a[k] = -size * w * w * np.sin(w * t + phase)
        y = np.array(blades.batch.generalized_force(q[None], v[None]))[0]
        learner.update(np.concatenate([q, v, a]), y, t)
    held, (inputs, outputs) = learner.weights, network.perceptron.widths
    placed = held[: inputs * outputs].reshape(outputs, inputs)[:, 17:].T.ravel()
    found = {term.name: w for term, w in zip(network.terms, placed, strict=False)}
    total = found["added mass"] + found["acceleration of the air carried along"]
    assert abs(total) < 0.05 and found["blade elements"] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("name", ["network", "tailed"])
def test_network_is_made_again_from_its_description(
    name: str, request: pytest.FixtureRequest
) -> None:
    network: LinearStripNetwork = request.getfixturevalue(name)
    x = np.concatenate(sample(network.robot, 1))
    weights = network.initial(0) + 0.2
    for again in (
        network_from_description(network.describe()),
        pickle.loads(pickle.dumps(network)),
    ):
        np.testing.assert_array_equal(again(x, weights), network(x, weights))


@pytest.mark.usefixtures("interpreted")
def test_outputs_are_those_asked_for(network: LinearStripNetwork) -> None:
    x, weights = np.concatenate(sample(network.robot, 2)), network.initial(0)
    chosen = LinearStripNetwork(network.robot, measured=("z", "left_plunge"))
    rows = [network.robot.index(name) for name in chosen.output_names]
    np.testing.assert_allclose(chosen(x, weights), network(x, weights)[rows], rtol=1e-12)


def test_a_frame_without_mass_has_no_drag(network: LinearStripNetwork) -> None:
    """A frame of a sensor on the body: the same terms and the same force."""
    frame = "bodies:\n  cell: {parent: body, massless: true}"
    text = network.robot.source.replace("bodies:", frame)
    framed = LinearStripNetwork(load_robot_text(text))
    x, weights = np.concatenate(sample(network.robot, 3)), network.initial(0) + 0.1
    np.testing.assert_allclose(framed(x, weights), network(x, weights), rtol=1e-12)


def test_a_robot_without_wings_is_refused() -> None:
    with pytest.raises(ParameterError, match="robot with wings"):
        LinearStripNetwork(pt.load_robot("ur5e"))

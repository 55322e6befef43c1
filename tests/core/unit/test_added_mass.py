"""Added mass as an object and in flights: descriptions, refusals, what a flight carries."""

from __future__ import annotations

import copy
import json
import pickle

import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics.added_mass import added_mass_from_description
from patagium.errors import FlightError, ParameterError, ShapeError
from patagium.simulation import added_mass_of, load_flight, save_flight


@pytest.fixture(scope="module")
def robot():
    return pt.load_robot("aerobat")


def fly(robot, added_mass, air=None, **settings):
    return pt.simulate(
        robot,
        pt.QuasiSteady(robot, air or pt.Air()),
        pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5),
        duration=0.01,
        time_step=2e-4,
        v=robot.coordinates(x=4.0),
        added_mass=added_mass,
        **settings,
    )


@pytest.fixture(scope="module")
def heavy(robot):
    return fly(robot, pt.AddedMass(robot, factor=0.85))


def test_a_flight_carries_its_added_mass_to_disk_and_back(robot, heavy, tmp_path):
    flight = load_flight(save_flight(heavy, tmp_path / "flight.nc"))
    assert added_mass_of(flight) == pt.AddedMass(added_mass_of(flight).robot, factor=0.85)
    assert np.abs(flight.added_mass_force.values).max() > 1e-3
    flight.attrs["added_mass"] = json.dumps({"factor": 1.0})
    with pytest.raises(FlightError, match="cannot be made again"):
        added_mass_of(flight)


def test_without_it_a_flight_says_so_and_moves_otherwise(robot, heavy):
    light = fly(robot, None)
    assert added_mass_of(light) is None
    for name in ("added_mass_force", "added_mass_work", "fluid_energy", "fluid_momentum"):
        assert not light[name].values.any()
    assert light.attrs["fluid_energy_audit"] == 0.0
    assert np.abs(light.u1.values - heavy.u1.values).max() > 1e-3
    nothing = fly(robot, pt.AddedMass(robot, factor=0.0))
    # rounding of 50 steps
    np.testing.assert_allclose(nothing.v.values, light.v.values, atol=1e-11)


def test_training_data_leave_known_inertia_out_unless_asked(heavy):
    _, _, circulatory = pt.training_data(heavy)
    _, _, whole = pt.training_data(heavy, with_added_mass=True)
    scale = np.abs(whole).max()
    np.testing.assert_allclose(circulatory, heavy.aero_force.values, atol=1e-11 * scale)
    total = heavy.aero_force.values + heavy.added_mass_force.values
    np.testing.assert_allclose(whole, total, atol=1e-11 * scale)


@pytest.mark.usefixtures("interpreted")
def test_the_inertia_is_in_the_reaction_of_a_fixed_mount(robot):
    """The mount holds against the air that the wings throw about."""
    air = pt.Air(wind=(-4.0, 0.0, 0.0))
    settings = {"air": air, "mount": pt.mounts.fixed()}
    still = {
        key: pt.simulate(
            robot,
            pt.QuasiSteady(robot, air),
            pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5),
            duration=0.01,
            time_step=2e-4,
            mount=settings["mount"],
            added_mass=added_mass,
        )
        for key, added_mass in (("with", pt.AddedMass(robot, air)), ("without", None))
    }
    held = still["with"].mount_wrench.values - still["without"].mount_wrench.values
    push = still["with"].added_mass_force.values[:, :3]
    np.testing.assert_allclose(held[:, :3], -push, atol=1e-12)
    momentum = still["with"].fluid_momentum.values
    slope = np.gradient(momentum, still["with"].time.values, axis=0, edge_order=2)
    # second-order differences of 2e-4 s
    np.testing.assert_allclose(push[1:-1], -slope[1:-1], atol=1e-4 * np.abs(push).max())


def test_description_makes_it_again(robot):
    model = pt.AddedMass(robot, pt.Air(density=1.1), factor=0.9)
    assert added_mass_from_description(robot, json.loads(json.dumps(model.describe()))) == model
    with pytest.raises(ParameterError, match="factor"):
        added_mass_from_description(robot, {"air": pt.Air().describe()})
    assert len(model.parameter_names) == len(model.parameters)


@pytest.mark.usefixtures("interpreted")
def test_factors_by_wing(robot):
    rng = np.random.default_rng(0)
    q, (v, a) = 0.2 * rng.standard_normal(14), rng.standard_normal((2, 14))
    plain, ones = pt.AddedMass(robot), {"left_wing": 1.0, "right_wing": 1.0}
    parts = []
    for wing in ones:
        one = pt.AddedMass(robot, factor={**dict.fromkeys(ones, 0.0), wing: 1.0})
        parts.append(one.generalized_force(q, v, a) + one.circulatory_force(q, v))
    whole = plain.generalized_force(q, v, a) + plain.circulatory_force(q, v)
    np.testing.assert_allclose(sum(parts), whole, atol=1e-14)  # rounding
    assert pt.AddedMass(robot, factor={"left_wing": 0.7}).factors == {
        "added_mass.left_wing.factor": 0.7
    }
    half = pt.AddedMass(robot, factor=dict.fromkeys(ones, 0.5))
    again = added_mass_from_description(robot, json.loads(json.dumps(half.describe())))
    assert again == half
    plain, own = fly(robot, pt.AddedMass(robot, factor=0.5)), fly(robot, half)
    np.testing.assert_allclose(own.q, plain.q, atol=1e-12)  # rounding, over the flight


@pytest.mark.parametrize("again", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_added_mass_that_was_used_goes_to_another_process(robot, again):
    """Added mass that was evaluated could not be pickled: its compiled functions went along."""
    used, q = pt.AddedMass(robot), robot.coordinates(pitch=0.1)
    matrix = used.mass_matrix(q)
    np.testing.assert_array_equal(again(used).mass_matrix(q), matrix)


def test_refusals(robot):
    for factor in ({"left_wing": np.inf}, {"tail": 1.0}, {}):
        with pytest.raises(ParameterError, match="factor"):
            pt.AddedMass(robot, factor=factor)
    with pytest.raises(ParameterError, match="an inertia above zero"):
        fly(robot, pt.AddedMass(robot, factor={"left_wing": -50.0}))
    fly(robot, pt.AddedMass(robot, factor={"left_wing": -0.01}))
    for factor in (-0.1, np.nan):
        with pytest.raises(ParameterError, match="factor"):
            pt.AddedMass(robot, factor=factor)
    with pytest.raises(ParameterError, match="added_mass"):
        fly(robot, pt.AddedMass(pt.load_robot("aerobat-beta")))
    with pytest.raises(ParameterError, match="air"):
        fly(robot, pt.AddedMass(robot, pt.Air(density=1.0)))
    model = pt.AddedMass(robot)
    with pytest.raises(ShapeError, match="a: expected"):
        model.generalized_force(np.zeros(14), np.zeros(14), np.zeros(3))
    with pytest.raises(ShapeError, match="wind"):
        model.generalized_force(*np.zeros((3, 14)), wind=[1.0])

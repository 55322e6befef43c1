"""Flights through gusts that travel: who meets them first, what is recorded, what is refused."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics.gusts import strip_winds
from patagium.dynamics.equations import fluid_energy, kirchhoff_force
from patagium.errors import ParameterError
from patagium_lab.published.aerodynamics import Published
from patagium_lab.published.stepping import simulate_published

GUST = pt.air.OneMinusCosineGust((0.0, 0.0, 1.5), 0.02, 0.03)
SIDEWAYS = pt.air.TravelingGust(GUST, (0.0, -1.0, 0.0), 8.0)


@pytest.fixture(scope="module")
def robot():
    return pt.load_robot("aerobat")


def fly(robot, gust, *, duration=0.06, **options):
    air = pt.Air(wind=(-4.0, 0.0, 0.0), gust=gust)
    aero = pt.QuasiSteady(robot, air)
    return pt.simulate(
        robot, aero, options.pop("gait", pt.gaits.still(robot)), duration=duration,
        time_step=2e-4, added_mass=pt.AddedMass(robot, air), **options,
    )  # fmt: skip


def test_a_gust_from_the_left_lifts_the_left_wing_first(robot):
    flight = fly(robot, SIDEWAYS, mount=pt.mounts.fixed())
    side = flight["strip_point"].values[0, :, 1]
    felt = flight["strip_wind"].values[:, :, 2]
    peak = flight["time"].values[felt.argmax(axis=0)]
    np.testing.assert_allclose(peak - 0.035, -side / 8.0, atol=3e-4)  # a step and a half
    force = flight["strip_force"].values[:, :, 2]
    assert force[:, side > 0].sum(axis=1).argmax() < force[:, side < 0].sum(axis=1).argmax()
    roll = flight["aero_force"].values[:, robot.index("roll")]
    assert roll.max() > 0 > roll.min()  # left wing up, then the right one
    # chords lie along the front: all of each meets it at once
    delay = flight["strip_point"].values @ SIDEWAYS.parameters[:3]
    at = (flight["time"].values[:, None] - delay).ravel()
    there = SIDEWAYS.profile.velocity_at(at)[:, 2].reshape(felt.shape)
    np.testing.assert_allclose(felt, there, atol=1e-5)  # cubics for a cosine


def test_wind_is_the_mean_over_the_wings(robot):
    flight = fly(robot, SIDEWAYS, mount=pt.mounts.fixed())
    areas = [float(strip.chord * strip.width) for strip in robot.strips]
    mean = np.average(flight["strip_wind"].values, axis=1, weights=areas)
    np.testing.assert_allclose(flight["wind"].values, mean, atol=1e-12)


def test_the_length_of_a_chunk_changes_nothing(robot, monkeypatch):
    turbulence = pt.air.DrydenGust((0.5, 0.5, 0.5), (0.5, 0.5, 0.5), airspeed=4.0, seed=2)
    gust = pt.air.TravelingGust(turbulence, (-1.0, 0.2, 0.0), 4.0)
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5)
    once = fly(robot, gust, gait=gait, duration=0.02)
    monkeypatch.setattr("patagium.simulation.runge_kutta.CHUNK", 7)
    again = fly(robot, gust, gait=gait, duration=0.02)
    for name in once.data_vars:
        scale = np.abs(once[name].values).max(initial=1e-9)
        # the same lines from values read at other places: rounding
        np.testing.assert_allclose(again[name].values, once[name].values, atol=1e-11 * scale)
    assert once["strip_wind"].values[:, 0].std() > 0


CHANGES = {
    "direction": (1.0, -1.0, 0.3),
    "speed": 7.0,
    "origin": (0.0, 0.05, 0.0),
    "profile": replace(GUST, velocity=(0.0, 0.0, 1.6)),
}


@pytest.mark.parametrize("name", CHANGES)
def test_every_number_of_a_gust_moves_the_flight(robot, name):
    other = replace(SIDEWAYS, **{name: CHANGES[name]})
    one, two = (fly(robot, gust)["v"].values for gust in (SIDEWAYS, other))
    apart = np.abs(two - one).max(axis=1)
    assert apart.max() > 1e-4


def test_added_mass_is_pushed_by_the_rate_of_what_it_meets(robot):
    still, gust = pt.gaits.still(robot), pt.air.TravelingGust(GUST, (0.0, 0.0, 1.0), 50.0)
    flight = fly(robot, gust, gait=still, mount=pt.mounts.fixed())
    push = flight["added_mass_force"].values[:, robot.index("z")]
    rate = np.gradient(flight["strip_wind"].values[:, 0, 2], flight["time"].values)
    carried = sum(
        np.pi * 1.225 * float(strip.chord) ** 2 / 4 * float(strip.width) for strip in robot.strips
    )
    # flat wings across the gust: its rate and nothing else, by differences in time
    np.testing.assert_allclose(push[2:-2], carried * rate[2:-2], atol=0.02 * np.abs(push).max())
    assert np.abs(push).max() > 0.01


def test_a_robot_that_flies_into_a_gust_meets_it_sooner(robot):
    edge = pt.air.TravelingGust(pt.air.RampGust((0.0, 0.0, 1.0), 0.0, 1e-3), (-1.0, 0.0, 0.0), 5.0)
    ahead = replace(edge, origin=(0.3, 0.0, 0.0))
    waiting = fly(robot, ahead, mount=pt.mounts.fixed(), duration=0.08)
    flying = fly(robot, ahead, v=robot.velocities(x=4.0), duration=0.08)
    came = [
        float(f["time"].values[(f["strip_wind"].values[:, 0, 2] > 0.5).argmax()])
        for f in (waiting, flying)
    ]
    assert came[0] == pytest.approx(0.3 / 5.0, abs=0.01)  # the front stands half a chord apart
    assert came[1] == pytest.approx(0.3 / 9.0, abs=0.01)


def test_a_step_too_long_is_told_in_a_gust_that_travels_too(robot):
    damped = replace(robot, damping=tuple(20 * d for d in robot.damping), source="")
    flight = fly(damped, SIDEWAYS, throw=False)
    assert flight.attrs["outcome"] == "STEP_TOO_LONG"


def test_models_that_take_one_wind_refuse_a_gust_that_travels(robot):
    published = pt.load_robot("aerobat-published")
    with pytest.raises(ParameterError, match="without a gust that travels"):
        simulate_published(published, Published(published, pt.Air(gust=SIDEWAYS)), duration=0.01)


MODELS = {
    "quasi-steady": pt.QuasiSteady,
    "lifting line": lambda robot: pt.LiftingLine(robot, stall_delay=pt.air.StallDelay()),
    "DeLaurier": pt.DeLaurier,
}


@pytest.mark.parametrize("name", MODELS)
def test_the_same_wind_at_all_strips_is_one_wind(robot, name, rng):
    model, added = MODELS[name](robot), pt.AddedMass(robot)
    sizes = {"q": robot.coordinate_count, "v": robot.dof, "z": model.state_size, "w": 3}
    q, v, z, w = (ca.SX.sym(name, size) for name, size in sizes.items())
    numbers = [0.3 * rng.standard_normal(size) for size in sizes.values()]
    numbers[3] = np.array([-4.0, 0.5, 0.3])

    def equations(wind):
        air = model.expressions(robot, q, v, z, wind, ca.SX(ca.DM(model.parameters)))
        carried = ca.SX(ca.DM(added.parameters))
        inertia = added.inertia(robot, wind, carried)
        parts = [air.generalized_force, air.state_derivative, ca.vec(air.strip_force)]
        parts += [kirchhoff_force(robot, q, v, 2 * v, inertia), fluid_energy(robot, q, v, inertia)]
        parts.append(added.circulation_force(robot, q, v, wind, carried))
        return ca.vertcat(*parts)

    one, each = equations(w), equations(ca.repmat(w, 1, len(robot.strips)))
    found = np.array(ca.Function("both", [q, v, z, w], [one, each])(*numbers))
    scale = np.abs(found[0]).max()
    np.testing.assert_allclose(found[1], found[0], atol=1e-12 * scale)  # another order of sums


def test_what_a_strip_answers_to_is_weighted_toward_its_trailing_edge(robot):
    sizes = {"q": robot.coordinate_count, "v": robot.dof, "w": 3}
    q, v, w = (ca.SX.sym(name, size) for name, size in sizes.items())
    met = ca.SX.sym("met", 9, len(robot.strips))
    winds = ca.Function("winds", [q, v, w, met], strip_winds(robot, q, v, w, met))
    given = np.zeros((9, len(robot.strips)))
    given[2], given[5] = 1.0, 0.25  # more at the leading edge
    for forward, expected in ((4.0, 0.75), (-4.0, 1.25)):
        weighted, mean = winds(robot.coordinates(), robot.velocities(x=forward), 0.0, given)
        np.testing.assert_allclose(np.array(weighted)[2], expected, atol=1e-12)
        np.testing.assert_allclose(np.array(mean)[2], 1.0)

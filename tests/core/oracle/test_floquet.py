"""Multipliers are those of differences in the simulator, and of Hill's determinant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import patagium as pt
from patagium.control import PrescribedRows, floquet
from patagium.control.orbit import Frame

STEP = 1e-5  # of central differences: truncation 1e-10 of third derivatives, rounding 1e-11


@pytest.fixture(scope="module")
def orbit():
    return pt.trim(pt.load_robot("aerobat"), speed=4.5)


@pytest.fixture(scope="module")
def smooth():
    """Orbit in air whose forces have no jumps, so that Fourier series of slopes converge."""
    robot = pt.load_robot("aerobat")
    return pt.trim(robot, pt.QuasiSteady(robot, polar=pt.air.SmoothPolar()), steps=480)


def test_multipliers_are_those_of_differences_in_the_simulator(orbit):
    frame, start = Frame(orbit.names), orbit.start()
    passive = [i for i in range(orbit.robot.dof) if i not in orbit.robot.actuated]

    def back(change):
        q, v = start["q"].copy(), start["v"].copy()
        half = len(passive)
        q[passive] += change[:half]
        v[passive] += change[half:]
        flight = orbit.flight(beats=1, q=q, v=v)
        end = np.r_[flight.q.values[-1, passive], flight.v.values[-1, passive]]
        return frame.seen(end)[0][frame.kept]

    ways = np.eye(len(orbit.names))[frame.kept]
    slope = [(back(STEP * way) - back(-STEP * way)) / (2 * STEP) for way in ways]
    np.testing.assert_allclose(orbit.return_slope, np.transpose(slope), atol=1e-7)
    expected = np.linalg.eigvals(np.transpose(slope))
    for one in floquet(orbit).multipliers:
        assert np.abs(expected - one).min() <= 1e-7


def test_multipliers_are_those_of_hill(smooth):
    found = np.exp(hill_rates(smooth, 20) * smooth.period)
    for one in floquet(smooth).multipliers:
        assert np.abs(found - one).min() <= 1e-6


def hill_rates(orbit, harmonics):
    """Characteristic exponents from the Fourier series of the beat's Jacobian [1/s]."""
    flight_map, frame = orbit.map, Frame(orbit.names)
    rows = orbit.family.rows(orbit.values, orbit.steps, orbit.aero.air)
    states = [orbit.states[0]]
    for k in range(orbit.steps - 1):
        part = slice(2 * k, 2 * k + 3)
        step = PrescribedRows(rows.table[part], rows.slopes[part], rows.time_step, rows.step_slopes)
        states.append(flight_map.fly(states[-1][None], step).ends[0])
    slopes = flight_map.slopes(np.array(states), rows.table[:-1:2])
    seen = np.array([frame.seen_rate(*one) for one in zip(states, *slopes, strict=True)])
    series, n = np.fft.fft(seen, axis=0) / orbit.steps, seen.shape[1]
    orders = np.arange(-harmonics, harmonics + 1)
    matrix = np.block([[series[(k - j) % orbit.steps] for j in orders] for k in orders])
    matrix = matrix - np.diag(np.repeat(2j * np.pi * orders / orbit.period, n))
    rates, vectors = np.linalg.eig(matrix)
    weight = (np.abs(vectors) ** 2).reshape(len(orders), n, -1).sum(axis=1)
    center = np.abs(orders @ weight / weight.sum(axis=0))
    return rates[np.argsort(center)[: 3 * n]]  # those that the cut of the series hardly touches


@pytest.fixture(scope="module")
def glide():
    return pt.trim(pt.load_robot("hawk"), climb=None, free=("elevation_offset",))


def test_position_and_heading_are_neutral(orbit, smooth):
    turn = pt.trim(
        orbit.robot,
        free=("frequency", "feather_offset", "feather_offset_difference"),
        turn_rate=0.3,
    )
    for one in (orbit, smooth, turn):
        assert np.abs(floquet(one).neutral - 1.0).max() <= 1e-9


def test_a_mode_does_in_the_simulator_what_is_said_of_it(orbit):
    found = floquet(orbit)
    slow = found.modes[0]
    assert slow.multiplier.imag == 0 and "halves" in repr(found)
    change = 1e-5 * found.vectors[:, 0].real
    frame, start = Frame(orbit.names), orbit.start()
    whole = np.zeros(len(orbit.names))
    whole[frame.kept] = change
    passive = [i for i in range(orbit.robot.dof) if i not in orbit.robot.actuated]
    q, v = start["q"].copy(), start["v"].copy()
    q[passive] += whole[: len(passive)]
    v[passive] += whole[len(passive) :]
    flight = orbit.flight(beats=20, q=q, v=v)
    end = np.r_[flight.q.values[-1, passive], flight.v.values[-1, passive]]
    left = frame.seen(end)[0][frame.kept] - orbit.states[0][frame.kept]
    expected = slow.multiplier.real**20 * change
    assert np.linalg.norm(left - expected) <= 1e-3 * np.linalg.norm(expected)  # second order


def test_modes_bear_the_fields_names_where_they_are_that():
    ornithopter = floquet(pt.trim(pt.load_robot("ornithopter"), speed=5.0))
    names = [mode.name for mode in ornithopter.modes]
    assert {"phugoid", "short period", "dutch roll", "spiral", "roll subsidence"} <= set(names)
    hover = floquet(pt.trim(pt.load_robot("dragonfly"), speed=0.0))
    assert not hover.stable
    assert all(" of " in mode.name for mode in hover.modes)


def test_names_and_shares_do_not_depend_on_the_phase_where_the_beat_begins():
    """The phugoid was an oscillation of pitch and two velocities where the clock began later."""
    robot, modes = pt.load_robot("ornithopter"), []
    for phase in (0.0, 0.7):
        gait = pt.gaits.sinusoidal(
            robot, frequency=4.0, plunge=0.784, offset={"elevation": -0.015},
            phase={"plunge": phase},
        )  # fmt: skip
        orbit = pt.trim(robot, gait=gait, speed=4.5, free=("frequency", "elevation_offset"))
        modes.append(floquet(orbit).modes)
    for one, other in zip(*modes, strict=True):
        assert one.name == other.name
        assert one.shares == pytest.approx(other.shares, abs=0.01)  # other steps over jumps


def test_robots_that_are_alike_have_the_same_names_and_shares():
    """Sizes were those of one robot, so that names changed with the scale of the same flight."""
    robot = pt.load_robot("dragonfly")
    usual = pt.trim(robot, speed=4.0)
    heavy = replace(robot, gravity=4 * robot.gravity, actuators={})
    faster = [1 + name.startswith("velocity of ") for name in usual.names]
    start = replace(usual, states=usual.states * faster)
    gait = replace(usual.gait, frequency=2 * usual.gait.frequency)
    fast = pt.trim(heavy, pt.QuasiSteady(heavy), gait, free=("frequency",), start=start)
    assert fast.speed == pytest.approx(8.0, rel=1e-6)
    found = [floquet(one).modes for one in (usual, fast)]
    for slow, fast in zip(*found, strict=True):
        assert slow.multiplier == pytest.approx(fast.multiplier, abs=1e-6)
        assert slow.name == fast.name
        assert slow.shares == pytest.approx(fast.shares, abs=1e-5)


def test_what_stays_and_drives_a_neutral_motion_is_told_to_grow(glide):
    """A double multiplier 1 with one eigenvector was taken for two motions that stay."""
    found = floquet(glide)
    assert not found.stable and "neutral" in repr(glide).splitlines()[-1]
    drift, still = found.modes[:2]
    assert (drift.name, still.name) == (
        "drift of velocity of y by roll",
        "neutral motion of velocity of y",
    )
    assert "grows evenly" in repr(found).splitlines()[1]
    assert "stays" in repr(found).splitlines()[2]
    for row in found.summary()[:2]:
        assert row["multiplier"] == 1.0 and row["doubles_in_s"] is row["halves_in_s"] is None
        assert not row["averaging_fails"] and not row["first_order_fails"]
    side, bank = found.states.index("velocity of y"), 1e-3
    change = found.vectors[:, 0].real * bank / found.vectors[found.states.index("roll"), 0].real
    robot, q = glide.robot, glide.start()["q"]
    q[robot.index("roll")] += bank
    flown = glide.flight(beats=20, q=q).v.sel(dof="y").values[-1]
    beat = ((glide.return_slope - np.eye(len(change))) @ change)[side]
    assert flown == pytest.approx(20 * beat, rel=1e-3)  # terms of second order in the bank
    assert flown == pytest.approx(-20 * glide.period * 9.81 * bank, rel=0.1)  # side force is small


def test_averaging_holds_for_a_glide_and_is_told_where_it_fails(orbit, glide):
    for mode in floquet(glide).modes:  # an equilibrium is its own mean
        assert mode.averaged == pytest.approx(mode.rate, rel=1e-5)  # rounding
        assert mode.first_order == pytest.approx(mode.rate, rel=1e-5)
    assert any(mode.fails(mode.first_order) for mode in floquet(orbit).modes)
    rows = floquet(orbit).summary()
    assert {"mode", "multiplier", "halves_in_s", "averaging_fails"} <= rows[0].keys()

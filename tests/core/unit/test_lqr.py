"""Regulators: what they promise of the beat, the simulator does."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.control import LinearRegulator
from patagium.errors import ParameterError

COMMANDS = ("frequency", "elevation_offset", "rudder_offset")


@pytest.fixture(scope="module")
def orbit():
    return pt.trim(pt.load_robot("ornithopter"), speed=6.0)


def flown(orbit, controller, beats, size):
    """Roll and pitch off the orbit after some beats, from a small departure [rad]."""
    start, robot = orbit.start(), orbit.robot
    q = start["q"].copy()
    q[robot.index("roll")] += size
    q[robot.index("pitch")] += size / 2
    feedback = {"controller": controller, "control_period": orbit.period / 10}
    flight = orbit.flight(beats=beats, q=q, **(feedback if controller else {}))
    end = flight.q.sel(dof=["roll", "pitch", "z"]).values[-1]
    return np.abs(end - start["q"][[robot.index(k) for k in ("roll", "pitch", "z")]]).max()


def test_a_periodic_regulator_keeps_an_unstable_orbit(orbit):
    assert not pt.control.floquet(orbit).stable
    regulator = LinearRegulator(orbit, COMMANDS)
    sizes = np.sort(np.abs(regulator.multipliers))[::-1]
    assert sizes[0] == pytest.approx(1.0, abs=1e-6)  # the way along y, which costs nothing
    assert sizes[1] < 0.95
    assert len(sizes) > len(orbit.names)  # the lags of the commands are states
    without, with_feedback = flown(orbit, None, 40, 0.01), flown(orbit, regulator, 40, 0.01)
    assert with_feedback < 0.03 * without
    assert regulator.report() == "Every sample was answered."


def test_an_averaged_regulator_says_where_it_fails_and_does(orbit):
    averaged = LinearRegulator(orbit, COMMANDS, averaged=True)
    assert np.ptp(averaged.gains, axis=0).max() < 1e-8  # 1e-9 of the gains ends the sweeps
    grows = np.abs(averaged.multipliers).max()
    assert grows > 1.01
    each = (LinearRegulator(orbit, COMMANDS, averaged=True) for _ in range(2))
    early, late = (
        flown(orbit, one, beats, 1e-4) for one, beats in zip(each, (40, 80), strict=True)
    )
    assert late / early == pytest.approx(grows**40, rel=0.3)  # other modes are not yet gone


def test_a_command_that_is_none_is_refused(orbit):
    with pytest.raises(ParameterError, match="tail_offset"):
        LinearRegulator(orbit, ("tail_offset",))

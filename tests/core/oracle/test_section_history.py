"""Section driven through a motion: Theodorsen's lift, a static polar, and refusals."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics.indicial import FOUR_STATE
from patagium.errors import ParameterError

CHORD, SPEED, STEPS = 0.2, 8.0, 160


def thin(robot: pt.Robot, air: pt.Air) -> pt.LiftingLine:
    return pt.LiftingLine(robot, air, lags=FOUR_STATE, section=pt.air.Section(profile_drag=0.0))


@pytest.mark.parametrize("axis", [0.25, 0.6])
def test_a_pitching_section_has_theodorsens_lift_and_moment(axis: float) -> None:
    k, size, cycles = 0.3, 0.01, 8
    omega = 2 * k * SPEED / CHORD
    phase = np.arange(cycles * STEPS + 1) * 2 * np.pi / STEPS
    history = pt.air.section_history(
        thin,
        phase / omega,
        pitch=size * np.cos(phase),
        airspeed=SPEED,
        chord=CHORD,
        pitch_axis=axis,
    )
    last = slice(-STEPS - 1, -1)
    seen = [
        2 * np.mean(history[name].to_numpy()[last] * np.exp(-1j * phase[last])) / size
        for name in ("lift", "moment")
    ]
    a = 2 * axis - 1  # axis behind mid-chord in semichords
    theodorsen = 0.66497 - 0.17932j  # C(.3), from Hankel functions
    circulatory = theodorsen * (1 + 1j * k * (0.5 - a))
    lift = 2 * np.pi * circulatory + np.pi * (1j * k + a * k**2)
    about = np.pi * (a + 0.5) * circulatory  # moment about the axis, nose up
    about += np.pi / 2 * (-1j * k * (0.5 - a) + k**2 * (1 / 8 + a**2))
    at_quarter = about - (a + 0.5) / 2 * lift
    assert abs(seen[0] - lift) < 0.01 * abs(lift)  # lags and splines
    assert abs(seen[1] - at_quarter) < 0.01 * abs(lift)


def test_a_steady_section_is_steady_and_one_that_speeds_up_lifts_more() -> None:
    time = np.linspace(0, 0.05, 11)
    history = pt.air.section_history(
        pt.QuasiSteady, time, pitch=0.2, airspeed=SPEED, chord=CHORD, added_mass=False
    )
    assert np.allclose(history["angle_of_attack"], 0.2)
    assert np.allclose(history["lift"], history["lift"][0]) and history["drag"][0] > 0
    surging = pt.air.section_history(
        pt.DeLaurier, time, pitch=0.1, airspeed=SPEED + 20 * time, chord=CHORD
    )
    assert surging["lift"][-1] > surging["lift"][0] > 0


@pytest.mark.parametrize("delay", [None, pt.air.StallDelay()])
def test_coarse_times_change_no_coefficient(delay: pt.air.StallDelay | None) -> None:
    ends = []
    for samples in (5, 801):  # 112 and .56 semichords apart
        history = pt.air.section_history(
            lambda wing, air: pt.LiftingLine(wing, air, stall_delay=delay),
            np.linspace(0.0, 4.0 * CHORD, samples) * 7,
            pitch=np.radians(4.0),
            airspeed=SPEED,
            chord=CHORD,
        )
        ends.append([float(history[name][-1]) for name in ("lift", "drag")])
    assert np.allclose(ends[0], ends[1], rtol=1e-5)
    assert 0.4 < ends[0][0] < 2 * np.pi * np.sin(np.radians(4.0))


@pytest.mark.parametrize("added_mass", [False, True])
def test_a_section_in_a_growing_gust_is_one_that_sinks_faster_and_faster(added_mass: bool) -> None:
    """Of a gust, the velocity at the first time counted for ever."""
    time, rate = np.linspace(0.0, 0.1, 41), 4.0
    gust = pt.air.RampGust((0.0, 0.0, 0.1 * rate), 0.0, 0.1)
    options = {"pitch": 0.0, "airspeed": SPEED, "chord": CHORD, "added_mass": added_mass}
    blown = pt.air.section_history(lambda wing, air: thin(wing, pt.Air(gust=gust)), time, **options)
    sinking = pt.air.section_history(thin, time, plunge=-rate * time**2 / 2, **options)
    # the air carried along feels the section's acceleration, and not a uniform gust's
    carried = added_mass * np.pi * CHORD * rate / (2 * SPEED**2)
    np.testing.assert_allclose(blown["lift"], sinking["lift"] - carried, atol=1e-5)  # steps
    np.testing.assert_allclose(blown["drag"], sinking["drag"], atol=1e-5)
    assert blown["lift"][-1] > 0.1


def test_a_gust_that_travels_is_refused() -> None:
    gust = pt.air.TravelingGust(pt.air.RampGust((0.0, 0.0, 0.5), 0.0, 0.1), (-1.0, 0.0, 0.0), SPEED)
    with pytest.raises(ParameterError, match=r"without a gust that travels.*mounts\.fixed"):
        pt.air.section_history(
            lambda wing, air: thin(wing, pt.Air(gust=gust)),
            [0.0, 1.0],
            pitch=0.1,
            airspeed=SPEED,
            chord=CHORD,
        )


def test_coefficients_do_not_depend_on_where_the_samples_lie() -> None:
    """They were over the mean of the samples, of which a log may have more in fast flight."""
    even = np.linspace(0.0, 1.0, 201)
    uneven = np.unique(np.r_[np.linspace(0.0, 0.15, 31), np.linspace(0.15, 1.0, 86)])
    lifts = []
    for time in (even, uneven):
        surge = 7.5 + 2.5 * np.cos(2 * np.pi * time)
        history = pt.air.section_history(
            pt.QuasiSteady, time, pitch=0.1, airspeed=surge, chord=CHORD, added_mass=False
        )
        lifts.append(history["lift"].to_numpy())
    at_ten = pt.air.section_history(
        pt.QuasiSteady, [0.0, 1.0], pitch=0.1, airspeed=10.0, chord=CHORD, added_mass=False
    )["lift"][0].item()
    expected = at_ten * (10.0 / 7.5) ** 2  # the mean over time is 7.5 m/s
    assert [lift[-1] for lift in lifts] == pytest.approx([expected] * 2, rel=1e-6)  # splines


def test_what_is_no_motion_is_refused() -> None:
    with pytest.raises(ParameterError, match="time"):
        pt.air.section_history(thin, [0.0, 0.0], pitch=0.1, airspeed=SPEED, chord=CHORD)
    with pytest.raises(ParameterError, match="pitch"):
        pt.air.section_history(thin, [0.0, 1.0], pitch=[0.1] * 3, airspeed=SPEED, chord=CHORD)


def test_an_airspeed_that_is_smoothed_over_is_told_with_its_similar_flow() -> None:
    """The lift at .05 m/s is wrong; that of a similar flow, ten times faster, is right."""
    time = np.linspace(0.0, 30.0, 61)
    pitch = np.radians(4 + np.sin(time / 3))
    fast = pt.air.section_history(thin, time / 1e4, pitch=pitch, airspeed=5.0, chord=1.5e-3)
    similar = pt.air.section_history(thin, time / 1e2, pitch=pitch, airspeed=0.5, chord=0.015)
    with pytest.warns(UserWarning, match="ten times the speed"):
        slow = pt.air.section_history(thin, time, pitch=pitch, airspeed=0.05, chord=0.15)
    np.testing.assert_allclose(similar["lift"], fast["lift"], rtol=1e-4)
    assert abs(slow["lift"][-1] / fast["lift"][-1] - 1).item() > 0.01


@pytest.mark.parametrize("kind", [pt.LiftingLine, pt.DeLaurier])
def test_the_effective_incidence_of_a_cambered_section_is_that_of_its_chord(kind: type) -> None:
    """The effective incidence of a lifting line counted from no lift, 4 degrees more."""
    camber = np.radians(-4.0)
    if kind is pt.LiftingLine:
        given = {"section": pt.air.Section(zero_lift_angle=camber)}
    else:
        given = {"zero_lift_angle": camber}
    history = pt.air.section_history(
        lambda robot, air: kind(robot, air, **given),
        np.linspace(0, 4.0, 21),
        pitch=0.02,
        airspeed=SPEED,
        chord=CHORD,
        added_mass=False,
    )
    last = history.isel(time=-1)
    assert last["angle_of_attack"] == pytest.approx(0.02)
    expected = pytest.approx(0.02, abs=1e-6)  # what is left of the lag after 160 chords
    assert last["effective_angle_of_attack"] == expected

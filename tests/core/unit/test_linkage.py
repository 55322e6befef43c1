"""The seven-bar linkage closes, turns through without a jump, and gives the known gait."""

from dataclasses import fields, replace

import numpy as np
import pytest

from patagium.errors import LinkageError, ParameterError
from patagium.robot.linkage import Linkage

PHASE = np.linspace(0, 2 * np.pi, 1440, endpoint=False)

# Fourier fit of the published gait: mean, then (amplitude [rad], angle [deg]) by harmonic
HUMERUS = (-0.4033, (0.9368, 47.41), (0.0628, -80.08), (0.0498, 177.92))
RADIUS = (-1.0563, (1.0190, -38.24), (0.1219, -137.54), (0.0668, 27.52))


@pytest.fixture(scope="module")
def motion():
    return Linkage().solve(PHASE)


@pytest.mark.parametrize(("angle", "fit"), [("humerus", HUMERUS), ("radius", RADIUS)])
def test_the_gait_has_the_published_harmonics(motion, angle, fit):
    spectrum = np.fft.rfft(getattr(motion, angle)) / PHASE.size
    assert spectrum[0].real == pytest.approx(fit[0], abs=3e-5)  # stated residual
    for k, (amplitude, degrees) in enumerate(fit[1:], start=1):
        expected = amplitude * np.exp(1j * np.radians(degrees)) / 2
        # the fit is printed to four digits and hundredths of a degree
        assert abs(spectrum[k] - expected) < 1e-4


def test_the_wing_moves_through_the_published_range(motion):
    found = np.degrees([motion.humerus.min(), motion.humerus.max()])
    assert found == pytest.approx([-83.5, 29.4], abs=0.05)  # printed to a tenth
    found = np.degrees([motion.radius.min(), motion.radius.max()])
    assert found == pytest.approx([-116.8, -1.6], abs=0.05)


def test_the_loops_close_to_rounding(motion):
    assert motion.closure_error.max() < 1e-12 * 0.1  # of the longest bar


@pytest.mark.parametrize("angle", ["humerus", "radius"])
def test_rates_and_accelerations_are_the_derivatives(motion, angle):
    value, rate = getattr(motion, angle), getattr(motion, f"{angle}_rate")
    acceleration = getattr(motion, f"{angle}_acceleration")
    order = np.fft.rfftfreq(PHASE.size, 1 / PHASE.size)  # spectral derivative: exact here
    spectrum = np.fft.rfft(value)
    np.testing.assert_allclose(
        np.fft.irfft(1j * order * spectrum, PHASE.size), rate, atol=1e-10, rtol=0
    )
    np.testing.assert_allclose(
        np.fft.irfft(-(order**2) * spectrum, PHASE.size), acceleration, atol=1e-7, rtol=0
    )


def test_phase_is_periodic_and_may_come_in_any_order(motion, rng):
    shuffled = rng.permutation(PHASE.size)
    turns = 2 * np.pi * rng.integers(-50, 50, PHASE.size)
    again = Linkage().solve(PHASE[shuffled] + turns)
    np.testing.assert_allclose(again.radius, motion.radius[shuffled], atol=1e-12)
    np.testing.assert_allclose(again.humerus, motion.humerus[shuffled], atol=1e-12)


@pytest.mark.parametrize("length", ["l3b", "l5a", "l5b"])
def test_regulators_turn_through_their_range_on_one_branch(length):
    low, high = {"l3b": (5.88, 20.13), "l5a": (9.79, 18.43), "l5b": (8.76, 11.66)}[length]
    for value in np.linspace(low, high, 5) * 1e-3:
        motion = replace(Linkage(), **{length: value}).solve(PHASE)
        assert motion.closure_error.max() < 1e-13
        step = np.abs(np.diff(motion.radius, append=motion.radius[0])).max()
        assert step < 1.5 * np.abs(motion.radius_rate).max() * PHASE[1]  # no jump of a branch


def test_one_phase_is_enough():
    assert Linkage().solve(0.3).radius.shape == (1,)


@pytest.mark.parametrize("name", [f.name for f in fields(Linkage)])
def test_every_length_moves_the_linkage(name):
    linkage = Linkage()
    value = getattr(linkage, name)
    longer = tuple(1.01 * k for k in value) if isinstance(value, tuple) else 1.01 * value
    before = np.array(list(linkage.points(0.7).values()))
    after = np.array(list(replace(linkage, **{name: longer}).points(0.7).values()))
    assert np.abs(after - before).max() > 1e-7


def test_pins_keep_the_lengths_of_the_bars():
    linkage = Linkage()
    pins = {name: complex(*point) for name, point in linkage.points(1.1).items()}
    for first, second, length in (
        ("crank_axis", "crank_pin", linkage.l1),
        ("crank_pin", "humerus_lever", linkage.l2a),
        ("coupler_branch", "rocker_lever", linkage.l4),
        ("rocker_pin", "radius_lever", linkage.l6),
        ("elbow", "tip", linkage.l7a),
    ):
        assert abs(pins[first] - pins[second]) == pytest.approx(length, rel=1e-12)


def test_a_linkage_that_cannot_close_names_phase_and_lengths():
    with pytest.raises(LinkageError, match=r"phase 0 rad.*crank and humerus.*35 mm") as caught:
        replace(Linkage(), l1=0.03).solve(PHASE)
    assert caught.value.phase == 0.0
    assert caught.value.lengths[0] == 0.035


@pytest.mark.parametrize(
    ("name", "value"), [("l1", 0.0), ("l2a", -1.0), ("l3b", np.nan), ("p1", (1.0, 2.0, 3.0))]
)
def test_what_is_no_length_is_refused(name, value):
    with pytest.raises(ParameterError, match=name):
        Linkage(**{name: value})

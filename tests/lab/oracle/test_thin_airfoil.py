"""Exact functions against printed tables, lags against the exact functions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from patagium.aerodynamics import Indicial
from patagium.aerodynamics.indicial import (
    FOUR_STATE,
    NO_STATE,
    ONE_STATE,
    TWO_STATE,
)
from patagium.aerodynamics.named_descriptions import field_values, from_field_values
from patagium.errors import ParameterError, ShapeError
from patagium_lab.validation.cases.thrust import Motion, garrick
from patagium_lab.validation.exact_functions import (
    circulation_function,
    fitted_indicial,
    kussner_function,
    sears_function,
    theodorsen_function,
    wagner_function,
)

# printed values of Wagner's and Theodorsen's functions
WAGNER = {0: 0.5, 1: 0.60061, 2: 0.66929, 4: 0.75797, 8: 0.84913, 20: 0.93665, 50: 0.97676}
THEODORSEN = {
    0.05: 0.90901 - 0.13064j,
    0.1: 0.83192 - 0.17230j,
    0.2: 0.72758 - 0.18862j,
    0.5: 0.59794 - 0.15071j,
    1.0: 0.53943 - 0.10027j,
}
K = list(THEODORSEN)


def test_wagner_and_theodorsen_are_the_printed_ones() -> None:
    assert np.abs(wagner_function(list(WAGNER)) - list(WAGNER.values())).max() < 1e-5  # digits
    assert np.abs(theodorsen_function(K) - list(THEODORSEN.values())).max() < 1e-5


def test_kussner_begins_at_zero_and_agrees_with_the_sears_function() -> None:
    s = np.linspace(0.0, 60.0, 601)
    response = kussner_function(s[:21])
    assert response[0] == pytest.approx(0.0, abs=1e-6)
    # W. P. Jones' two exponentials, meant for later times: within a few hundredths
    late = 1 - 0.5 * np.exp(-0.13 * s[20:21]) - 0.5 * np.exp(-s[20:21])
    assert response[20] == pytest.approx(late[0], abs=0.03)
    # the response to exp(i k s) by superposition is the transfer function at the leading edge
    k, end = 0.5, 400.0
    fine = np.concatenate([np.linspace(0, 4, 161), np.linspace(4.25, end, 800)])
    decay = 1.0 - kussner_function(fine)
    superposed = 1.0 - 1j * k * np.trapezoid(decay * np.exp(-1j * k * fine), fine)
    assert abs(superposed - sears_function(k) * np.exp(-1j * k)) < 0.01  # cut-off and grid


@pytest.mark.parametrize(
    ("lags", "lift_error", "step_error"),
    [(ONE_STATE, 0.1, 0.085), (TWO_STATE, 0.015, 0.010), (FOUR_STATE, 0.001, 0.004)],
)
def test_lags_reproduce_lift_and_circulation(
    lags: Indicial, lift_error: float, step_error: float
) -> None:
    assert np.abs(lags.lift_transfer(K) - list(THEODORSEN.values())).max() < lift_error
    s = np.linspace(0.0, 100.0, 201)
    assert np.abs(lags.lift_response(s) - wagner_function(s)).max() < step_error
    assert lags.lift_response(0.0)[0] == pytest.approx(0.5, abs=2e-4)
    circulation = replace(lags, lift=lags.circulation).lift_transfer(K)
    error = np.abs(circulation - circulation_function(K)).max()
    assert error < {1: 0.11, 2: 0.07, 4: 0.0055}[lags.size]


def test_shipped_amplitudes_are_the_least_squares_ones() -> None:
    four = fitted_indicial(FOUR_STATE.rate)
    assert np.allclose(four.lift, FOUR_STATE.lift, atol=1e-4)  # printed digits
    assert np.allclose(four.circulation, FOUR_STATE.circulation, atol=1e-4)
    two = fitted_indicial(TWO_STATE.rate)
    assert np.allclose(two.circulation, TWO_STATE.circulation, atol=1e-4)
    assert sum(two.lift) == pytest.approx(0.5, abs=1e-12)  # held exactly


def test_air_without_memory_answers_at_once() -> None:
    assert NO_STATE.size == 0
    assert np.array_equal(NO_STATE.lift_response([0.0, 1.0]), [1.0, 1.0])
    assert np.array_equal(NO_STATE.lift_transfer([0.1, 1.0]), [1.0, 1.0])


def test_lags_travel_as_a_description_and_refuse_what_cannot_be() -> None:
    assert from_field_values("lags", Indicial, field_values(TWO_STATE)) == TWO_STATE
    with pytest.raises(ParameterError, match="keys"):
        from_field_values("lags", Indicial, {"rate": [1.0]})
    with pytest.raises(ShapeError, match="lift"):
        Indicial((0.1, 0.2), (0.5,), (0.5, 0.1))
    with pytest.raises(ParameterError, match="rate"):
        Indicial((-0.1,), (0.5,), (0.5,))
    with pytest.raises(ParameterError, match="circulation"):
        Indicial((0.1,), (0.5,), (1.5,))
    with pytest.raises(ParameterError, match="finite"):
        Indicial((0.1,), (np.nan,), (0.5,))


@pytest.mark.parametrize("lags", [TWO_STATE, FOUR_STATE])
def test_lags_of_a_finite_span_forget_within_half_of_it(lags: Indicial) -> None:
    wing = lags.finite_span(4.0)
    assert wing.lift == lags.lift and wing.circulation == lags.circulation
    assert min(wing.rate) > 1 / 4 and max(wing.rate) < 1.35 * max(lags.rate)
    assert lags.finite_span(1e9).rate == pytest.approx(lags.rate, rel=1e-12)
    for aspect_ratio in (0.0, -1.0, np.nan):
        with pytest.raises(ParameterError, match="aspect_ratio"):
            lags.finite_span(aspect_ratio)


def test_thrust_of_a_heave_is_that_of_its_suction() -> None:
    """Garrick's for heave alone, pi (w h / U)^2 |C|^2 over rho U^2 c / 2."""
    for k, c in THEODORSEN.items():
        heave = garrick(Motion(k, 0.01))
        assert heave == pytest.approx(np.pi * (2 * k * 0.01) ** 2 * abs(c) ** 2, rel=1e-4)
        with_pitch, turned = (garrick(Motion(k, 0.01, 0.02, a)) for a in (0.7, 0.7 + np.pi))
        mirrored = garrick(Motion(k, -0.01, 0.02, 0.7))
        assert turned == pytest.approx(mirrored, rel=1e-12) and turned != with_pitch

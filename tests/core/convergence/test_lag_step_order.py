"""One step of a memory: of second order, and a weighted mean at any step."""

import casadi as ca
import numpy as np
import pytest

from patagium.aerodynamics.indicial import Relaxation, lag_step

_Z, _STEP = ca.SX.sym("z"), ca.SX.sym("h")
_RATES, _TARGETS = ca.SX.sym("r", 2), ca.SX.sym("t", 2)
_ENDS = [Relaxation(_RATES[k], _TARGETS[k]) for k in range(2)]
STEP = ca.Function("step", [_Z, _STEP, _RATES, _TARGETS], [lag_step(_Z, _STEP, *_ENDS)])


def rate(time):
    return 3.0 + 2.0 * np.sin(5 * time)


def solution(time):
    """z = cos(4t) where the target is z + z'/rate."""
    return np.cos(4 * time)


def target(time):
    return np.cos(4 * time) - 4 * np.sin(4 * time) / rate(time)


def error(steps: int) -> float:
    times = np.linspace(0, 1, steps + 1)
    state = solution(0.0)
    for begin, end in zip(times[:-1], times[1:], strict=True):
        ends = np.array([begin, end])
        state = float(STEP(state, end - begin, rate(ends), target(ends)))
    return abs(state - solution(1.0))


def test_halving_the_step_quarters_the_error() -> None:
    ratios = [error(n) / error(2 * n) for n in (100, 200, 400)]
    assert np.allclose(ratios, 4.0, rtol=0.03)  # next order


@pytest.mark.parametrize("length", [1e-9, 1.0, 1e9])
def test_a_step_stays_between_what_it_has_and_what_it_follows(length: float) -> None:
    after = float(STEP(5.0, length, [0.3, 2.0], [-1.0, 2.0]))
    assert 0.5 <= after <= 5.0
    assert float(STEP(5.0, length, [0.0, 0.0], [-1.0, 2.0])) == 5.0

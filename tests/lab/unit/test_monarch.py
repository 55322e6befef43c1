"""Monarch butterfly: the public program's swings with its errors, and three hovers closed."""

from __future__ import annotations

import numpy as np
import pytest
from tests.validation_page import errors_of_the_page

from patagium.control import floquet
from patagium_lab.validation.cases.monarch import closed_orbits, compute


@pytest.mark.usefixtures("interpreted")
def test_swings_are_the_programs_with_its_errors_and_not_without():
    (case,) = compute()
    apart = {name: np.abs(one / case.expected - 1.0) for name, one in case.models.items()}
    # other steps and smoothed signs; the program's own hovers close within 1e-3 m/s
    assert apart["with the program's errors"].max() <= 0.005
    assert (apart["without them"].reshape(3, -1).max(axis=1) > 0.02).all()  # each hover
    shown = errors_of_the_page()
    for name, error in case.errors.items():
        assert shown[case.name, name] == pytest.approx(error, rel=0.02, abs=1e-4)  # three digits


def test_the_hovers_close_exactly_and_one_is_stable():
    orbits = closed_orbits()
    assert max(orbit.residual for orbit in orbits.values()) <= 1e-12
    for orbit in orbits.values():
        assert abs(orbit.speed) + abs(orbit.climb) < 1e-12
    stable = [name for name, orbit in orbits.items() if floquet(orbit).stable]
    assert stable == ["attitude prescribed"]
    flight = orbits["attitude prescribed"].flight(beats=20)
    assert np.ptp(flight.v.sel(dof="pitch").values) > 0.1  # prescribed, and moving
    assert np.abs(flight.q.sel(dof=["x", "z"]).values[-1]).max() < 1e-10  # stable: it stays

"""Still air never gives mean power to wings, whatever they are and however they move."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics.trailing_vortices import MOST_INDUCED
from patagium_lab.validation.still_air import (
    BEATS,
    ROUNDING,
    STEPS,
    models,
    power_shares,
    random_wings,
)

HARDEST = "lifting line, stall delay"


@pytest.mark.parametrize("name", ["DeLaurier", HARDEST])
def test_still_air_gives_no_mean_power(name: str) -> None:
    """Ten random wings of seed 8; of one, in a wind along its span, legs met other strips."""
    shares = power_shares(10, 8, {name: models()[name]}, first=25)
    assert shares.shape == (1, 10)
    assert (shares < ROUNDING).all()
    assert shares.min() < -0.5  # and it takes power


@pytest.mark.parametrize("wing", [170, 211])
def test_separated_flow_does_not_feed_a_wing_that_feathers_fast(wing: int) -> None:
    """Wings of seed 1 to which the lagged separation gave power: shares of +.81 and +.48."""
    assert power_shares(1, 1, {HARDEST: models()[HARDEST]}, first=wing)[0] < -0.5


@pytest.mark.parametrize("number", [1_000_131, 2_000_484])
def test_no_singularity_of_the_vortices_lets_the_air_run_away(number: int) -> None:
    """Strips of these wings meet the wind from opposite sides: downwash of 1e5 and 4e31 m/s."""
    robot, gait, mount, frequency = random_wings(np.random.default_rng(number))
    for delay in (None, pt.air.StallDelay()):
        flight = pt.simulate(
            robot,
            pt.LiftingLine(robot, stall_delay=delay),
            gait,
            duration=BEATS / frequency,
            time_step=1 / (STEPS * frequency),
            mount=mount,
        )
        assert np.abs(flight.downwash).max() < MOST_INDUCED * flight.strip_airspeed.max()

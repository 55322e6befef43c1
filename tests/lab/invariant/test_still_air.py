"""Still air never gives mean power to wings, whatever they are and however they move."""

from __future__ import annotations

import pytest

from patagium_lab.validation.still_air import ROUNDING, models, power_shares

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

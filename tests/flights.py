"""Flights of tests."""

import numpy as np
import xarray as xr

from patagium.simulation.flight import SINGLE


def stored(flight: xr.Dataset) -> xr.Dataset:
    """A flight as its file keeps it: flow at the strips rounded to single precision."""
    rounded = {name: flight[name].astype(np.float32) for name in SINGLE if name in flight}
    return flight.assign({name: one.astype(np.float64) for name, one in rounded.items()})

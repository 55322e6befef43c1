"""Flights as netCDF4 files: written whole or not at all, checked when read.

Files are not compressed: a flight of 1 s at 1e-4 s takes about 16 MB.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from patagium.errors import FlightError
from patagium.robot import Robot
from patagium.simulation.flight import (
    ATTRIBUTES,
    AXES,
    OPTIONAL,
    QUANTITIES,
    quantities,
    robot_of,
)
from patagium.whole_file import whole_file


def save_flight(flight: xr.Dataset, path: str | Path) -> Path:
    """Write a flight as netCDF4; an interrupted write leaves the former file.

    Args:
        flight: The flight.
        path: The file, replaced if it exists; folders are made.

    Returns:
        The path.

    Raises:
        FlightError: If the flight misses a quantity, or the file cannot be written.
    """
    check_flight(flight, "flight")
    try:
        with whole_file(path) as draft:
            flight.to_netcdf(draft, format="NETCDF4", engine="netcdf4")
    except OSError as error:
        raise FlightError(f"{path}: cannot be written: {error.strerror or error}") from None
    return Path(path)


def load_flight(path: str | Path) -> xr.Dataset:
    """Flight from a netCDF4 file, read and checked.

    Args:
        path: A netCDF4 file written by `save_flight`.

    Returns:
        The flight, in memory; the file is closed.

    Raises:
        FlightError: If there is no such file, or it is not a whole flight.
    """
    path = Path(path)
    try:
        with xr.open_dataset(path, engine="netcdf4", decode_times=False) as opened:
            flight = opened.load()
    except (OSError, ValueError) as error:
        reason = "no such file" if not path.exists() else f"no netCDF4 file: {error}"
        raise FlightError(f"{path}: {reason}") from None
    for variable in flight.variables.values():
        variable.encoding.clear()
    flight.encoding.clear()
    check_flight(flight, str(path))
    return flight


def check_flight(flight: xr.Dataset, name: str) -> None:
    """Refuse a record that is not a whole flight.

    Args:
        flight: The record.
        name: What to call it in errors.

    Raises:
        FlightError: If a quantity, attribute or coordinate is missing, has other
            dimensions or units, time does not rise, the state is not finite, or the
            coordinates are not its robot's.
    """
    _check_presence(flight, name)
    robot = robot_of(flight)
    _check_contents(flight, name, robot)
    time = flight["time"].to_numpy()
    if time.size == 0 or not np.all(np.diff(time) > 0):
        raise FlightError(f"{name}: time does not rise from sample to sample")
    for state in ("q", "v"):
        values = flight[state].to_numpy()
        if not np.isfinite(values).all():
            first = time[~np.isfinite(values).all(axis=1)][0]
            raise FlightError(f"{name}: {state} is not finite at t = {first:g} s")
    expected = {
        "dof": robot.dof_names,
        "strip": tuple(strip.name for strip in robot.strips),
        "axis": AXES,
    }
    if robot.attitude == "quaternion":
        expected["coordinate"] = robot.coordinate_names
    for dim, labels in expected.items():
        found = tuple(str(label) for label in flight[dim].to_numpy())
        if found != labels:
            raise FlightError(f"{name}: {dim}: expected {labels}, found {found}")


def _check_presence(flight: xr.Dataset, name: str) -> None:
    missing = [k for k in ("time", "dof", "strip", "axis", *QUANTITIES) if k not in flight]
    if missing:
        raise FlightError(f"{name}: no {', '.join(missing)}: not a whole flight")
    missing = [k for k in ATTRIBUTES if k not in flight.attrs]
    if missing:
        raise FlightError(f"{name}: no attribute {', '.join(missing)}: not a whole flight")


def _check_contents(flight: xr.Dataset, name: str, robot: Robot) -> None:
    for quantity, kind in (quantities(robot) | OPTIONAL).items():
        if quantity not in flight:
            continue  # only what is optional may be missing here
        variable = flight[quantity]
        if variable.dims != ("time", *kind.dims):
            expected = ("time", *kind.dims)
            raise FlightError(f"{name}: {quantity}: expected {expected}, found {variable.dims}")
        if variable.attrs.get("units") != kind.units:
            found = variable.attrs.get("units")
            raise FlightError(f"{name}: {quantity}: expected [{kind.units}], found [{found}]")
        if variable.dtype != np.float64:
            raise FlightError(f"{name}: {quantity}: expected float64, found {variable.dtype}")

"""Checksum at the end of a netCDF file: damage is found, other programs may change the file."""

from __future__ import annotations

from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

from patagium.errors import LogError, Unreadable
from patagium.netcdf_file import loaded_dataset, write_netcdf
from patagium.sensing.sensors.sense import is_sensor_log


@pytest.fixture
def file(tmp_path: Path) -> Path:
    values = np.random.default_rng(1).normal(size=(500, 3))
    content = xr.Dataset({"force": (("time", "axis"), values)}, attrs={"title": "three axes"})
    content = content.assign_coords(axis=["x", "y", "z"])
    return write_netcdf(tmp_path / "force.nc", content, {"part": content})


def load(file: Path) -> xr.Dataset:
    return loaded_dataset(file, LogError, "forces")


def test_damage_anywhere_is_found_before_hdf5_reads_it(file: Path) -> None:
    """Flipped bits in numbers, which HDF5 gives as other numbers, and zeros in its own records.

    Zeros in a heap of names can keep it reading for ever.
    """
    whole = file.read_bytes()
    for place in range(0, len(whole), 97):
        for harm in (bytes([whole[place] ^ 1]), bytes(64)):
            damaged = whole[:place] + harm + whole[place + len(harm) :]
            if damaged == whole or len(damaged) != len(whole):
                continue
            file.write_bytes(damaged)
            mark = damaged.rfind(b"patagium crc32 ")
            if mark < 0:  # what is damaged is the mark itself
                continue
            with pytest.raises(LogError, match="found others: it is damaged"):
                load(file)
            with pytest.raises(Unreadable):
                is_sensor_log(file)


def test_an_equal_file_is_read_and_so_is_one_without_a_checksum(file: Path) -> None:
    first = load(file)
    assert is_sensor_log(file)
    whole = file.read_bytes()
    file.write_bytes(whole[: whole.rfind(b"patagium crc32 ")])
    xr.testing.assert_identical(load(file), first)


def test_a_program_that_changes_the_file_drops_the_checksum(file: Path) -> None:
    with netCDF4.Dataset(file, "a") as opened:
        opened["force"][0, 0] = 7.0
        opened.createVariable("more", "f8", ("time",))[:] = 1.0
    assert float(load(file)["force"][0, 0]) == 7.0
    assert float(load(file)["more"].sum()) == 500.0


def test_a_file_of_any_size_is_sealed_block_by_block(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("patagium.netcdf_file._BLOCK", 1000)
    assert load(file).sizes["time"] == 500  # the same checksum, whatever the blocks

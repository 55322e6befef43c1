"""Flights on disk: the same when read again, whole or refused with a reason."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import partial

import netCDF4
import numpy as np
import pytest
import xarray as xr
from tests.flights import SINGLE, stored

import patagium as pt
from patagium.errors import FlightError, LogError
from patagium.live.packets import flight_packets
from patagium.netcdf_file import write_netcdf
from patagium.simulation import aero_of, robot_of
from patagium.simulation.flight_summary import flight_summary
from patagium.viewer.replay import replay_content


@pytest.fixture(scope="module")
def robot():
    return pt.load_robot("aerobat").with_parameters({"body.mass": 0.0123456789012345})


@pytest.fixture(scope="module")
def aero(robot):
    return pt.QuasiSteady(robot, pt.Air(density=1.1, wind=(-1.0, 0.0, 0.1)))


@pytest.fixture(scope="module")
def flight(robot, aero):
    gait = pt.gaits.linkage(robot, frequency=5.0)
    return pt.simulate(robot, aero, gait, duration=0.01, time_step=1e-4)


def test_a_flight_read_again_is_the_same(flight, tmp_path):
    path = pt.save_flight(flight, tmp_path / "flight.nc")
    again = pt.load_flight(path)
    assert again.identical(stored(flight))
    for name in SINGLE:  # rounded once, half a unit in the last of 24 bits
        np.testing.assert_allclose(again[name], flight[name], rtol=2.0**-24, atol=1e-45)
    assert [f.name for f in path.parent.iterdir()] == ["flight.nc"]
    pt.save_flight(again, path)  # over itself: the file was closed
    assert pt.load_flight(path).identical(again)


def test_a_flight_that_is_open_elsewhere_is_read(flight, tmp_path):
    """HDF5 ends the program where it reads strings of a file that is open twice."""
    path = pt.save_flight(flight, tmp_path / "flight.nc")
    with netCDF4.Dataset(path) as opened:
        assert [name for name, one in opened.variables.items() if one.dtype is str] == []
    program = "import sys, xarray, patagium as pt\nopened = xarray.open_dataset(sys.argv[1])\n"
    program += "for _ in range(9): assert pt.load_flight(sys.argv[1]).equals(opened)"
    subprocess.run([sys.executable, "-c", program, path], check=True)


def test_a_file_of_before_in_double_precision_is_read_bit_for_bit(flight, tmp_path):
    assert pt.load_flight(write_netcdf(tmp_path / "flight.nc", flight)).identical(flight)


def test_a_file_is_small_and_any_reader_opens_it(robot, aero, tmp_path):
    flight = pt.simulate(robot, aero, pt.gaits.cruise(robot), duration=0.5, time_step=1e-4)
    path = pt.save_flight(flight, tmp_path / "flight.nc")
    assert path.stat().st_size < 0.36 * flight.nbytes  # a third, and the head of the file
    with xr.open_dataset(path) as opened:
        assert set(opened.variables) == set(flight.variables)
        for name in set(flight.data_vars) - set(SINGLE):
            np.testing.assert_array_equal(opened[name], flight[name])


def test_robot_and_air_come_back_with_their_parameters(robot, aero, flight, tmp_path):
    again = pt.load_flight(pt.save_flight(flight, tmp_path / "flight.nc"))
    assert robot_of(again) == robot
    assert aero_of(again) == aero


def test_a_flight_that_diverged_is_kept_too(robot, aero, tmp_path):
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.4)
    stopped = pt.simulate(robot, aero, gait, duration=1.0, time_step=5e-3, throw=False)
    assert stopped.attrs["outcome"] != "COMPLETED"
    again = pt.load_flight(pt.save_flight(stopped, tmp_path / "stopped.nc"))
    assert again.attrs["message"] == stopped.attrs["message"]


def test_an_interrupted_write_leaves_what_was_there(flight, tmp_path, monkeypatch):
    path = pt.save_flight(flight, tmp_path / "flight.nc")
    before = path.read_bytes()

    def broken(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", broken)
    with pytest.raises(OSError, match="No space left"):
        pt.save_flight(flight, path)
    assert path.read_bytes() == before
    assert [f.name for f in tmp_path.iterdir()] == ["flight.nc"]


def without_units(flight):
    changed = flight.copy()
    changed["u1"] = flight["u1"].copy()
    changed["u1"].attrs["units"] = "N cm"
    return changed


def not_finite(flight):
    changed = flight.copy(deep=True)
    changed["v"][3, 2] = np.nan
    return changed


def backwards(flight):
    return flight.isel(time=slice(None, None, -1))


def other_names(flight):
    names = [f"{name}_" for name in flight.dof.values]
    return flight.assign_coords(dof=names)


def no_robot(flight):
    return flight.assign_attrs(robot="bodies: [")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda f: f.drop_vars(["u1", "momentum"]), "no u1, momentum"),
        (lambda f: f.drop_vars("time"), "no time"),
        (lambda f: f.drop_attrs(), "no attribute robot"),
        (lambda f: f.assign(q=f.q.astype("float32").assign_attrs(f.q.attrs)), "float64"),
        (lambda f: f.assign(q=f.q.transpose().assign_attrs(f.q.attrs)), "q: expected"),
        (without_units, "u1: expected [N or N m], found [N cm]"),
        (not_finite, "v is not finite at t = 0.0003 s"),
        (backwards, "time does not rise"),
        (other_names, "dof: expected"),
        (no_robot, "robot cannot be made again"),
    ],
)
def test_what_is_no_whole_flight_is_refused(flight, tmp_path, spoil, words):
    spoiled = spoil(flight)
    with pytest.raises(FlightError) as caught:
        pt.save_flight(spoiled, tmp_path / "spoiled.nc")
    assert words in str(caught.value)
    assert list(tmp_path.iterdir()) == []
    spoiled.to_netcdf(tmp_path / "spoiled.nc")
    with pytest.raises(FlightError) as caught:
        pt.load_flight(tmp_path / "spoiled.nc")
    assert words in str(caught.value)


def test_a_file_that_is_no_flight_is_said(tmp_path):
    with pytest.raises(FlightError, match="no such file"):
        pt.load_flight(tmp_path / "absent.nc")
    (tmp_path / "text.nc").write_text("not netCDF")
    with pytest.raises(FlightError, match="expected a flight such as"):
        pt.load_flight(tmp_path / "text.nc")
    with pytest.raises(FlightError, match="no attribute robot"):
        robot_of(xr.Dataset())


USES = {
    "packets": flight_packets,
    "cycles": lambda flight: pt.cycle_statistics(flight, period=0.005, skip=0),
    "sensors": lambda flight: pt.sense(flight, [pt.sensors.Encoder(rate=1000.0)]),
    "learner": lambda flight: pt.identify(flight, every=5),
    "robot": robot_of,
}


@pytest.mark.parametrize("use", USES)
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda flight: flight.isel(dof=slice(None, None, -1)),
            "dof: .* found 14: right_feather",
        ),
        (
            lambda flight: flight.isel(dof=slice(6)),
            "dof: .* 14 .* found 6: x, y, z, roll, pitch, yaw in ",
        ),
        (
            lambda flight: flight.isel(strip=slice(None, None, -1)),
            "strip: .* 10 strips .* found 10: right_wing",
        ),
        (lambda flight: flight.isel(time=slice(None, None, -1)), "time does not rise"),
        (lambda flight: flight.isel(time=slice(0)), "expected samples, found none"),
        (lambda flight: flight.isel(time=0), "expected samples, found none"),
        (lambda flight: flight.assign_coords(time=flight.time * 0), "time does not rise"),
        (
            lambda flight: flight.assign_coords(time=flight.time.astype("m8[s]")),
            "time does .* timedelta64",
        ),
    ],
)
def test_a_flight_whose_parts_were_rearranged_is_refused_everywhere(flight, use, change, words):
    with pytest.raises(FlightError, match=f"flight: {words}"):
        USES[use](change(flight))


def test_a_flight_of_one_sample_is_told_to_whoever_learns_or_scores(flight, robot):
    # It ended in "cannot convert float NaN to integer".
    taught, one = pt.identify(flight).learner, flight.isel(time=[0])
    for use in (pt.identify, partial(pt.evaluate, model=taught)):
        with pytest.raises(LogError, match="expected two samples at least, found 1"):
            use(one)


def test_sensors_refuse_a_flight_in_nanoseconds(flight):
    # It asked for a tebibyte.
    far = flight.assign_coords(time=("time", flight["time"].to_numpy() * 1e9, {"units": "s"}))
    said = r"encoder: expected at most 1e\+08 samples, found 1e\+10; is the time of the flight in s"
    with pytest.raises(FlightError, match=said):
        pt.sense(far, [pt.sensors.Encoder(name="encoder", rate=1000.0)])


def test_a_dataset_that_is_no_flight_is_refused(flight):
    for other in (xr.Dataset(), xr.Dataset({"a": ("x", [1, 2])}), flight.drop_vars("time")):
        with pytest.raises((FlightError, LogError)):
            pt.identify(other)


@pytest.mark.parametrize(
    ("key", "text", "words"),
    [
        ("events", '[{"time": 0.1}]', "events cannot be made again: KeyError"),
        ("events", '{"a": 1}', "events cannot be made again: TypeError"),
        ("events", '[{"time": NaN, "words": "a gust"}]', "time: expected a finite number"),
        ("held", "x", "held: line 1, column 1: expected JSON"),
        ("held", '{"no answer": "x"}', "held commands and audit cannot"),
        ("energy_audit", "x", "held commands and audit cannot"),
        ("aero", "x", "air cannot be made again: aero: line 1"),
        ("aero", '{"of": 3, "air": {"density": "x"}}', "air cannot be made again"),
        ("gait", '{"frequency": NaN}', "period: expected a positive number, found nan"),
        ("gait", '{"frequency": Infinity}', "period: expected a positive number, found 0.0"),
        ("gait", '{"frequency": -4.9}', "period: expected a positive number, found -0.2"),
        ("gait", '{"parts": [{"period": -1}, {"period": 1}]}', "a positive number, found -1"),
    ],
)
def test_attributes_that_were_changed_are_refused_with_a_sentence(flight, key, text, words):
    """Changed attributes ended in a traceback, and a negative period was accepted."""
    changed = flight.assign_attrs({key: text})
    readers = {"events": [replay_content], "gait": [replay_content, flight_summary]}
    for use in readers.get(key, [flight_summary]):
        with pytest.raises(FlightError, match=f"the flight.*{words}"):
            use(changed)


def test_a_page_of_a_flight_whose_air_is_no_description_is_refused(flight):
    """A replay of a flight with unreadable air ended in a traceback."""
    with pytest.raises(FlightError, match="the flight's air cannot be made again"):
        replay_content(flight.assign_attrs(aero="x"))

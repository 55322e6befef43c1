"""Do figures and the replay show what a closed loop wanted, commanded and met?"""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium import control
from patagium.report.figures import events_of, flight_overview, off_reference
from patagium.viewer.export import topics_of
from patagium.viewer.replay import replay_content

COMMANDS = ("frequency", "plunge_amplitude", "elevation_offset", "rudder_offset")


@pytest.fixture(scope="module")
def flight(ornithopter_orbit):
    orbit = ornithopter_orbit
    gust = control.GustEvent(time=0.3, velocity=(0.0, 0.0, 1.0), length_time=0.2)
    pilot = control.PredictiveController(orbit, COMMANDS)
    return pt.fly(
        orbit.robot, pt.QuasiSteady(orbit.robot), pilot, orbit=orbit, duration=0.8,
        time_step=5e-4, events=[gust],
    )  # fmt: skip


def test_the_figure_has_departures_commands_and_events(flight):
    figure = flight_overview(flight)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles[-3:] == ["Off reference", "Off reference", "Commands"]
    for axes in figure.axes:
        assert any((np.array(line.get_xdata()) == 0.3).all() for line in axes.lines)
    legend = [text.get_text() for text in figure.axes[-1].get_legend().get_texts()]
    assert legend == [*flight["command_name"].values, "a gust of 0, 0, 1 m/s, 0.2 s long"]
    (z,) = [line for line in figure.axes[-3].lines if line.get_label() == "z"]
    off = np.abs(np.array(z.get_ydata()))
    before = np.array(z.get_xdata()) < 0.3
    assert off[before].max() < 1e-3 < 0.03 < off[~before].max()  # m


def test_the_replay_has_a_ghost_that_follows_the_reference(flight, tmp_path):
    other = replay_content(flight.assign(q=flight["q"] - off_reference(flight)))
    page = pt.replay(flight, tmp_path / "page.html").read_text()
    assert '"names":["this flight","reference"]' in page
    assert "At 0.3 s: a gust of 0, 0, 1 m/s" in page
    shown = replay_content(flight)
    apart = np.abs(shown.origin - other.origin)[:, 2]
    assert apart[shown.time < 0.3].max() < 1e-3 < 0.03 < apart[shown.time > 0.3].max()  # m
    assert shown.events == [(0.3, "a gust of 0, 0, 1 m/s, 0.2 s long")] == events_of(flight)


def test_an_export_has_what_the_controller_knew_and_wanted(flight):
    """Both were left out, as their times are those of the controller."""
    found = {one.name: one for one in topics_of(flight)}
    for name in ("estimate", "reference"):
        topic = found[name]
        np.testing.assert_array_equal(topic.time, flight["control_time"])
        np.testing.assert_array_equal(topic.values, flight[name])
        units = dict(zip(topic.labels, topic.units, strict=True))
        assert units["z"] == "m" and units["pitch"] == "rad"
        assert units["velocity of z"] == "m/s" and units["velocity of pitch"] == "rad/s"


def test_a_flight_without_a_loop_has_none_of_it(flight):
    plain = flight.drop_vars(["reference", "command", "command_name"])
    plain.attrs = {name: value for name, value in flight.attrs.items() if name != "events"}
    titles = [axes.get_title(loc="left") for axes in flight_overview(plain).axes]
    assert not {"Off reference", "Commands"} & {*titles}
    assert not replay_content(plain).events


def test_the_reference_is_that_of_the_orbit_that_is_followed(ornithopter_orbit):
    """A controller that follows another orbit on its way, as one does that learns."""
    orbit = ornithopter_orbit
    law = control.LinearRegulator(orbit, COMMANDS)
    law.model.course.origin[2] = -1.0
    flight = pt.fly(
        orbit.robot, pt.QuasiSteady(orbit.robot), law, orbit=orbit, duration=0.2, time_step=1e-3
    )
    reference = flight["reference"]
    assert np.abs(reference.sel(state="z").values + 1.0).max() < 0.2  # m, within the beat
    assert np.ptp(reference.sel(state="left_plunge").values) > 0.1  # joints are the orbit's

"""Air and gusts: what `wind_at` returns, what is refused, and the round trip."""

from __future__ import annotations

import json

import numpy as np
import pytest

from patagium.aerodynamics import (
    Air,
    DrydenGust,
    OneMinusCosineGust,
    RampGust,
    RecordedGust,
    TravelingGust,
)
from patagium.aerodynamics.air import air_from_description
from patagium.errors import ParameterError, ShapeError

TRAVELING = TravelingGust(
    OneMinusCosineGust((1.0, 0.0, 0.0), 0.1, 0.3), (-3.0, 4.0, 0.0), 2.0, (1.0, 0.0, 0.5)
)
RECORDED = RecordedGust(np.array([0.0, 0.1, 0.3]), np.arange(9.0).reshape(3, 3))
DRYDEN = DrydenGust((0.5, 0.3, 0.2), (4.0, 2.0, 1.0), airspeed=3.0, seed=3)


def test_steady_wind_is_the_same_at_all_times() -> None:
    wind = Air(wind=(1.0, -2.0, 0.5)).wind_at([0.0, 1.0, 7.0])
    assert np.array_equal(wind, np.tile([1.0, -2.0, 0.5], (3, 1)))


def test_one_minus_cosine_starts_peaks_and_ends_where_it_says() -> None:
    air = Air(wind=(1.0, 0.0, 0.0), gust=OneMinusCosineGust((0.0, 2.0, -4.0), 0.5, 0.2))
    wind = air.wind_at([0.0, 0.5, 0.55, 0.6, 0.7, 3.0])
    share = np.array([0.0, 0.0, 0.5, 1.0, 0.0, 0.0])
    expected = np.outer(share, [0.0, 2.0, -4.0]) + [1.0, 0.0, 0.0]
    assert np.allclose(wind, expected, atol=1e-14)  # rounding of a cosine


def test_dryden_has_the_variance_and_the_memory_it_says() -> None:
    length = 4000.0  # 3,000 length scales along x: variance known to about 3 %
    time = np.arange(0.0, length, DRYDEN.step)
    gust = DRYDEN.velocity_at(time)
    assert np.allclose(gust.std(axis=0), DRYDEN.intensity, rtol=0.05)
    lag = 10
    x, y = gust[:, 0] / 0.5, gust[:, 1] / 0.3
    tau = lag * DRYDEN.step * 3.0
    along = np.exp(-tau / 4.0)
    across = np.exp(-tau / 2.0) * (1 - tau / 2.0 / 2)  # transverse correlation: e^-s (1 - s/2)
    assert np.mean(x[lag:] * x[:-lag]) == pytest.approx(along, rel=0.08)
    assert np.mean(y[lag:] * y[:-lag]) == pytest.approx(across, rel=0.08)


def test_dryden_is_a_function_of_time_and_seed_alone() -> None:
    coarse = DRYDEN.velocity_at(np.array([0.0, 0.5, 1.0]))
    fine = DRYDEN.velocity_at(np.linspace(0.0, 2.0, 2001))
    assert np.allclose(coarse, fine[[0, 500, 1000]], atol=1e-12)  # rounding of the grid
    other = DrydenGust((0.5, 0.3, 0.2), (4.0, 2.0, 1.0), airspeed=3.0, seed=4)
    assert not np.allclose(coarse, other.velocity_at(np.array([0.0, 0.5, 1.0])))


def test_dryden_before_zero_is_the_same_process() -> None:
    time = np.arange(-4000.0, 4000.0, DRYDEN.step)  # as above: variance known to about 3 %
    gust = DRYDEN.velocity_at(time)
    past, count = gust[time < 0], len(time) // 2
    assert np.allclose(past.std(axis=0), DRYDEN.intensity, rtol=0.05)
    for lag in (1, 20):  # within the past, after it, and from one to the other
        alike = [
            np.sum(part[lag:] * part[:-lag], axis=0) / np.sum(part**2, axis=0)
            for part in (past, gust[count:])
        ]
        assert np.allclose(*alike, atol=0.03)
    changes = np.abs(np.diff(gust, axis=0))
    assert (changes[count - 3 : count + 3] < 6 * changes.std(axis=0) + changes.mean(axis=0)).all()
    late = DRYDEN.velocity_at(np.array([-1.0, 2.0]))
    assert np.allclose(late[1], DRYDEN.velocity_at(np.array([2.0]))[0], atol=0)
    assert np.allclose(late[0], DRYDEN.velocity_at(np.array([-300.0, -1.0]))[1], atol=1e-12)


def test_a_traveling_gust_is_no_part_of_a_uniform_wind() -> None:
    time = np.array([0.2, 0.2 - 0.75])
    air = Air(wind=(1.0, 0.0, 0.0), gust=TRAVELING)
    assert np.array_equal(air.uniform_wind_at(time), [[1.0, 0.0, 0.0]] * 2)
    assert air.wind_at([0.25])[0, 0] == pytest.approx(2.0)


def test_a_recorded_gust_is_straight_between_samples_and_held_beyond() -> None:
    found = RECORDED.velocity_at(np.array([-1.0, 0.05, 0.2, 9.0]))
    np.testing.assert_allclose(found[:, 0], [0.0, 1.5, 4.5, 6.0], rtol=1e-12)  # rounding
    for span, knots in (((-1, 1), [0, 0.1, 0.3]), ((0.15, 0.2), [0.1, 0.3]), ((1, 2), [0.1, 0.3])):
        assert np.array_equal(RECORDED.knots(*span), knots)
    assert np.array_equal(RECORDED.knots(-2.0, -1.0), [0.0, 0.1])
    assert RecordedGust(RECORDED.time, RECORDED.velocity) == RECORDED != DRYDEN


def test_a_recorded_gust_stays_as_it_was_given() -> None:
    """It changed with the arrays of its caller."""
    time, velocity = np.arange(3.0), np.zeros((3, 3))
    gust = RecordedGust(time, velocity)
    time += 5.0
    velocity += 5.0
    assert gust == RecordedGust(np.arange(3.0), np.zeros((3, 3)))


def test_an_own_gust_that_is_read_again_is_refused_with_what_to_fly() -> None:
    told = {"gust": {"name": "mine", "size": 1.0}, "density": 1.2, "wind": [0.0, 0.0, 0.0]}
    with pytest.raises(ParameterError, match="RecordedGust in place of an own gust, .*'mine'"):
        air_from_description(told)


def test_a_description_from_before_gusts_decayed_is_read() -> None:
    told = Air(gust=TRAVELING).describe()
    del told["gust"]["decay_time"]
    assert air_from_description(told).gust == TRAVELING


@pytest.mark.parametrize(
    "gust",
    [
        None,
        DRYDEN,
        OneMinusCosineGust((1.0, 0.0, 0.0), 0.1, 0.3),
        RampGust((1.0, 0.0, 0.0), 0.1, 0.3),
        TRAVELING,
        TravelingGust(DRYDEN, (0.0, 1.0, 0.0), 3.0),
        TravelingGust(DRYDEN, (0.0, 1.0, 0.0), 3.0, decay_time=0.2),
        RECORDED,
        TravelingGust(RECORDED, (0.0, 1.0, 0.0), 3.0),
    ],
)
def test_air_survives_its_description(gust: object) -> None:
    air = Air(1.0, (1.0, 2.0, 3.0), gust)  # type: ignore[arg-type]
    assert air_from_description(json.loads(json.dumps(air.describe()))) == air


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Air(density=0.0),
        lambda: Air(wind=(np.nan, 0.0, 0.0)),
        lambda: OneMinusCosineGust((1.0, 0.0, 0.0), 0.0, 0.0),
        lambda: OneMinusCosineGust((1.0, 0.0, 0.0), np.inf, 1.0),
        lambda: DrydenGust((-1.0, 0.0, 0.0), (1.0, 1.0, 1.0), 1.0, 0),
        lambda: DrydenGust((1.0, 0.0, 0.0), (0.0, 1.0, 1.0), 1.0, 0),
        lambda: DrydenGust((1.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.0, 0),
        lambda: DrydenGust((1.0, 0.0, 0.0), (1.0, 1.0, 1.0), 1.0, -1),
        lambda: RampGust((1.0, 0.0, 0.0), 0.0, -1.0),
        lambda: TravelingGust(DRYDEN, (0.0, 0.0, 0.0), 3.0),
        lambda: TravelingGust(DRYDEN, (1.0, 0.0, 0.0), 0.0),
        lambda: TravelingGust(DRYDEN, (1.0, 0.0, 0.0), np.inf),
        lambda: TravelingGust(DRYDEN, (1.0, 0.0, 0.0), 1.0, decay_time=1e-4),
        lambda: RecordedGust(np.zeros(1), np.zeros((1, 3))),
        lambda: RecordedGust(np.arange(2.0), np.full((2, 3), np.nan)),
        lambda: TravelingGust(DRYDEN, (1.0, 0.0, 0.0), 1.0, decay_time=np.nan),
        lambda: TravelingGust(TRAVELING, (1.0, 0.0, 0.0), 1.0),  # type: ignore[arg-type]
        lambda: air_from_description({**Air(gust=TRAVELING).describe(), "density": 0.0}),
        lambda: Air(gust=TRAVELING).require_uniform("air"),
        lambda: air_from_description(
            {"density": 1.0, "wind": [0, 0, 0], "gust": {"name": "traveling", "speed": 1.0}}
        ),
        lambda: air_from_description({"density": 1.0}),
        lambda: air_from_description({"density": 1.0, "wind": [0, 0, 0], "gust": {"name": "x"}}),
        lambda: air_from_description(
            {"density": 1.0, "wind": [0, 0, 0], "gust": {"name": "dryden", "seed": 1}}
        ),
    ],
)
def test_impossible_air_is_refused(wrong: object) -> None:
    with pytest.raises(ParameterError, match="expected"):
        wrong()  # type: ignore[operator]


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Air(wind=(1.0, 2.0)),  # type: ignore[arg-type]
        lambda: Air().wind_at(0.0),
        lambda: OneMinusCosineGust((1.0,), 0.0, 1.0),  # type: ignore[arg-type]
        lambda: RampGust((1.0,), 0.0, 1.0),  # type: ignore[arg-type]
        lambda: RecordedGust(np.arange(2.0), np.zeros((3, 3))),
        lambda: TravelingGust(DRYDEN, (1.0, 0.0), 1.0),  # type: ignore[arg-type]
    ],
)
def test_wrong_shapes_are_refused(wrong: object) -> None:
    with pytest.raises(ShapeError, match="expected shape"):
        wrong()  # type: ignore[operator]

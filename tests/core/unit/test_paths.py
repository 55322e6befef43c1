"""Paths go where they say, at the speed they say, with the derivatives they give."""

import numpy as np
import pytest

import patagium as pt
from patagium.errors import LogError, ParameterError, ShapeError
from patagium.simulation.paths import span_of

TIME = np.linspace(0.0, 3.0, 301)
SQUARE = [
    [0, 0, 0],
    [1, 0, 0.2],
    [1, 1, 0],
    [0, 1, -0.2],
    [-0.5, 0.5, 0],
    [-0.2, 0.1, 0],
    [0, 0, 0],
]
PATHS = {
    "line": pt.paths.line((0, 0, 1), (1, -2, 3), duration=2.0),
    "circle": pt.paths.circle((1, 2, 3), 0.5, speed=2.0, normal=(1, 1, 1), attitude=(0.1, 0.2, 3)),
    "eight": pt.paths.figure_of_eight((0, 0, 1), 0.8, 0.4, speed=2.0, across=(0, 0, 1)),
    "sinusoid": pt.paths.sinusoid((0, 0, 1), frequency=1.5, phase={"z": 1.0}, z=0.2, pitch=0.4),
    "points": pt.paths.waypoints([0, 1, 1.5, 2.5], [[0, 0, 0], [1, 0, 1], [1, 1, 1], [0, 2, 0]]),
    "closed": pt.paths.waypoints(np.arange(7) * 0.4, SQUARE, closed=True),
}


@pytest.mark.parametrize("name", PATHS)
def test_derivatives_are_those_of_the_path(name):
    path, step = PATHS[name], 1e-5
    time = TIME + 0.0037  # jerk may jump at way-points
    motion = path.motion(time)
    after, before = path.motion(time + step), path.motion(time - step)
    for rate, value in (("velocity", "position"), ("acceleration", "velocity")):
        expected = (getattr(after, value) - getattr(before, value)) / (2 * step)
        found = getattr(motion, rate)
        # second order in the step, times the third derivative
        assert np.abs(found - expected).max() <= 1e-6 * max(1, np.abs(expected).max())


@pytest.mark.parametrize("name", PATHS)
def test_acceleration_is_continuous(name):
    path = PATHS[name]
    time = np.linspace(0.0, span_of(path) * 1.2, 40_001)
    jumps = np.abs(np.diff(path.motion(time).acceleration, axis=0)).max(axis=1)
    assert jumps.max() < 50 * np.median(jumps[jumps > 0]) + 1e-6


def test_a_line_is_straight_and_rests_at_its_ends():
    path = PATHS["line"]
    motion = path.motion(np.array([-1.0, 0.0, 1.0, 2.0, 5.0]))
    np.testing.assert_allclose(motion.position[2, :3], [0.5, -1, 2], atol=1e-14)
    np.testing.assert_allclose(motion.position[[0, 1]], [[0, 0, 1, 0, 0, 0]] * 2, atol=1e-14)
    np.testing.assert_allclose(motion.position[[3, 4]], [[1, -2, 3, 0, 0, 0]] * 2, atol=1e-13)
    np.testing.assert_allclose(motion.velocity[[0, 1, 3, 4]], 0, atol=1e-12)
    # least jerk: 15/8 of the mean speed in the middle
    np.testing.assert_allclose(motion.velocity[2, :3], 15 / 8 * np.array([0.5, -1, 1]), rtol=1e-12)


def test_a_circle_keeps_its_radius_speed_and_sense():
    motion = PATHS["circle"].motion(TIME)
    arm, speed = motion.position[:, :3] - (1, 2, 3), motion.velocity[:, :3]
    np.testing.assert_allclose(np.linalg.norm(arm, axis=1), 0.5, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(speed, axis=1), 2.0, rtol=1e-12)
    np.testing.assert_allclose(np.cross(arm, speed), np.ones((301, 3)) / np.sqrt(3), rtol=1e-12)
    np.testing.assert_array_equal(motion.position[:, 3:], [[0.1, 0.2, 3]] * 301)


def test_an_eight_is_fastest_where_it_crosses():
    path = PATHS["eight"]
    motion = path.motion(np.linspace(0, path.period, 4001))
    speed = np.linalg.norm(motion.velocity[:, :3], axis=1)
    assert speed.max() == pytest.approx(2.0, rel=1e-12) and np.argmax(speed) in (0, 2000, 4000)
    assert np.ptp(motion.position[:, 0]) == pytest.approx(0.8, rel=1e-5)
    assert np.ptp(motion.position[:, 2]) == pytest.approx(0.4, rel=1e-5)
    assert np.ptp(motion.position[:, 1]) == 0


def test_way_points_are_passed_at_their_times():
    motion = PATHS["points"].motion(np.array([0, 1, 1.5, 2.5]))
    expected = [[0, 0, 0], [1, 0, 1], [1, 1, 1], [0, 2, 0]]
    np.testing.assert_allclose(motion.position[:, :3], expected, atol=1e-12)
    np.testing.assert_allclose(motion.velocity[[0, -1]], 0, atol=1e-11)
    closed = PATHS["closed"]
    np.testing.assert_allclose(
        closed.motion(np.array([0.8])).position[0, :3], SQUARE[2], atol=1e-12
    )
    late = closed.motion(TIME + 7 * closed.period)
    np.testing.assert_allclose(late.position, closed.motion(TIME).position, atol=1e-9)


def test_points_stay_as_they_are_given():
    """A closed path wrote into its caller's points, and changed with them afterwards."""
    time, points = np.linspace(0.0, 1.0, 9), np.zeros((9, 6))
    points[-1, 0] = 3e-10
    path = pt.paths.waypoints(time, points, closed=True)
    assert points[-1, 0] == 3e-10
    points[:] = 7.0
    np.testing.assert_array_equal(path.motion(0.5).position, np.zeros((1, 6)))


def test_paths_add_up():
    eight = PATHS["eight"]
    nod = pt.paths.sinusoid((0, 0, 0.5), frequency=2 / eight.period, pitch=0.2)
    both = pt.paths.superposed(eight, nod)
    assert both.period == eight.period
    expected = eight.motion(TIME).position + nod.motion(TIME).position
    np.testing.assert_array_equal(both.motion(TIME).position, expected)
    rest = pt.paths.superposed(PATHS["line"], PATHS["points"])
    assert span_of(rest) == 2.5 and rest.period is None
    with pytest.raises(ParameterError, match="all repeat or all end"):
        pt.paths.superposed(PATHS["eight"], PATHS["line"])
    with pytest.raises(ParameterError, match="multiple"):
        pt.paths.superposed(PATHS["eight"], PATHS["closed"])


def test_a_path_comes_from_a_table(tmp_path):
    file = tmp_path / "path.csv"
    file.write_text("time [ms],x [mm],pitch [deg]\n0,0,0\n500,100,10\n1000,0,0\n")
    motion = pt.paths.from_csv(file).motion(np.array([0.5, 1.0]))
    np.testing.assert_allclose(motion.position[0], [0.1, 0, 0, 0, np.radians(10), 0], atol=1e-12)
    file.write_text("time [s],height [m]\n0,0\n1,1\n")
    with pytest.raises(LogError, match="expected columns among time, x.*found 'height'"):
        pt.paths.from_csv(file)
    file.write_text("time [s],x [s]\n0,0\n1,1\n")
    with pytest.raises(LogError, match="column 'x'"):
        pt.paths.from_csv(file)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: pt.paths.circle((0, 0, 0), 1.0), "speed: expected one of speed and frequency"),
        (lambda: pt.paths.circle((0, 0, 0), 0.0, speed=1), "radius: expected a positive"),
        (lambda: pt.paths.circle((0, 0, 0), 1.0, speed=1, normal=(0, 0, 0)), "normal"),
        (lambda: pt.paths.line((0, 0), (1, 0, 0), duration=1), "start: expected three"),
        (lambda: pt.paths.line((0, 0, 0), (1, 0, 0), duration=-1), "duration"),
        (lambda: pt.paths.line((0, 0, 0), (1, 0, 0), duration=1e-300), "a nanosecond or more"),
        (
            lambda: pt.paths.figure_of_eight((0, 0, 0), 1, 1, speed=1, across=(1, 1, 0)),
            "across: expected a direction square to along",
        ),
        (lambda: pt.paths.sinusoid((0, 0, 0), frequency=1, plunge=1), "plunge"),
        (lambda: pt.paths.sinusoid((0, 0, 0), frequency=1, pitch=1.6), "a pitch within"),
        (lambda: pt.paths.sinusoid((0, 0, 0), frequency=1, pitch=30), "1719 deg; are degrees"),
        (lambda: pt.paths.sinusoid((0, 0, 0), frequency=1, phase={"z": 90}), "np.radians.90"),
        (lambda: pt.paths.waypoints([0, 1, 1], np.zeros((3, 3))), "each later"),
        (lambda: pt.paths.waypoints(np.arange(7), np.eye(7, 3), closed=True), "the first"),
    ],
)
def test_what_is_no_path_is_refused(make, words):
    with pytest.raises(ParameterError, match=words):
        make()


def test_points_and_times_go_together():
    with pytest.raises(ShapeError, match=r"\(2, 3\) or \(2, 6\)"):
        pt.paths.waypoints([0, 1], np.zeros((2, 4)))

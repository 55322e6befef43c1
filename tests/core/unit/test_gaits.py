"""Gaits: addressing of joints, mirrored sides, tables with units, limits, refusals."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import patagium as pt
from patagium.cli.simulate import _gait
from patagium.errors import LogError, ParameterError, ShapeError
from patagium.robot import Linkage
from patagium.simulation import gait_period

TIME = np.linspace(0.0, 0.7, 57)
ROUNDING = 1e-13  # a handful of sines


@pytest.fixture(scope="module")
def robot():
    return pt.load_robot("aerobat")


def joint(robot, name):
    return [robot.dof_names[i] for i in robot.actuated].index(name)


def limited(robot, **upper):
    bounds = list(robot.upper)
    for name, value in upper.items():
        bounds[robot.index(name)] = value
    return replace(robot, upper=tuple(bounds))


def test_a_pair_name_moves_both_sides_and_an_exact_name_one(robot):
    gait = pt.gaits.sinusoidal(
        robot,
        frequency=4.0,
        plunge=0.5,
        left_feather=0.2,
        phase={"plunge": 0.3},
        offset={"elbow": -0.1, "right_feather": 0.05},
    )
    angle = 2 * np.pi * 4.0 * TIME
    position = gait.motion(TIME).position
    expected = np.zeros_like(position)
    for side in ("left", "right"):
        expected[:, joint(robot, f"{side}_plunge")] = 0.5 * np.sin(angle + 0.3)
        expected[:, joint(robot, f"{side}_elbow")] = -0.1
    expected[:, joint(robot, "left_feather")] = 0.2 * np.sin(angle)
    expected[:, joint(robot, "right_feather")] = 0.05
    np.testing.assert_allclose(position, expected, atol=ROUNDING)
    assert gait.period == 0.25


def test_a_fourier_gait_is_its_series(robot):
    series = (0.0354, [(0.0, 0.3793), (-0.0322, 0.0), (0.0, -0.0035)])
    gait = pt.gaits.fourier(robot, frequency=3.3, plunge=series)
    x = 2 * np.pi * 3.3 * TIME
    expected = 0.0354 + 0.3793 * np.sin(x) - 0.0322 * np.cos(2 * x) - 0.0035 * np.sin(3 * x)
    found = gait.motion(TIME).position[:, joint(robot, "right_plunge")]
    np.testing.assert_allclose(found, expected, atol=ROUNDING)


def test_the_linkage_plunges_with_the_humerus_and_bends_the_elbow_by_the_difference(robot):
    gait = pt.gaits.linkage(robot, frequency=5.0, plunge_offset=0.2, elbow_offset=-0.1)
    wing = Linkage().solve(2 * np.pi * 5.0 * TIME)
    motion = gait.motion(TIME)
    for side in ("left", "right"):
        plunge, elbow = joint(robot, f"{side}_plunge"), joint(robot, f"{side}_elbow")
        np.testing.assert_allclose(motion.position[:, plunge], wing.humerus + 0.2)
        bend = wing.radius - wing.humerus - 0.1
        np.testing.assert_allclose(motion.position[:, elbow], bend)
        assert not motion.position[:, joint(robot, f"{side}_feather")].any()


def test_the_linkage_spreads_the_wing_on_the_way_down(robot):
    gait = pt.gaits.linkage(robot, frequency=5.0)
    motion = gait.motion(np.linspace(0.0, 0.2, 400, endpoint=False))
    plunge, elbow = joint(robot, "left_plunge"), joint(robot, "left_elbow")
    down = motion.velocity[:, plunge] < 0
    bend = motion.position[:, elbow]
    assert bend[down].mean() > bend[~down].mean() + 1.0  # more than a radian straighter


def test_other_bars_give_another_gait(robot):
    usual = pt.gaits.linkage(robot, frequency=5.0).motion(TIME).position
    steered = pt.gaits.linkage(robot, frequency=5.0, linkage=Linkage(l3b=8e-3))
    assert np.abs(steered.motion(TIME).position - usual).max() > 0.01


def test_still_joints_hold_their_places(robot):
    motion = pt.gaits.still(robot, plunge=0.3).motion(TIME)
    assert np.all(motion.position[:, joint(robot, "left_plunge")] == 0.3)
    assert not motion.velocity.any() and not motion.acceleration.any()
    assert pt.gaits.still(robot).period is None


def test_superposed_gaits_add_up(robot):
    parts = (
        pt.gaits.linkage(robot, frequency=5.0),
        pt.gaits.sinusoidal(robot, frequency=10.0, feather=0.2),
        pt.gaits.still(robot, mediolateral=-0.1),
    )
    gait = pt.gaits.superposed(robot, *parts)
    motions = [part.motion(TIME) for part in parts]
    for name in ("position", "velocity", "acceleration"):
        total = sum(getattr(m, name) for m in motions)
        np.testing.assert_allclose(getattr(gait.motion(TIME), name), total, atol=ROUNDING)
    assert gait.period == 0.2


def test_a_sum_that_never_repeats_is_refused(robot):
    parts = [pt.gaits.sinusoidal(robot, frequency=f, plunge=0.1) for f in (5.0, 7.0)]
    with pytest.raises(ParameterError, match="multiple"):
        pt.gaits.superposed(robot, *parts)


@pytest.mark.parametrize("kind", ["sinusoidal", "still", "fourier"])
def test_a_misspelled_joint_is_refused_with_the_names_there_are(robot, kind):
    wrong = {
        "sinusoidal": lambda: pt.gaits.sinusoidal(robot, frequency=5.0, plung=0.1),
        "still": lambda: pt.gaits.still(robot, x=0.1),
        "fourier": lambda: pt.gaits.fourier(robot, frequency=1.0, roll=(0.0, [(0.0, 1.0)])),
    }[kind]
    with pytest.raises(ParameterError, match="left_plunge"):
        wrong()


def test_a_joint_named_twice_is_refused(robot):
    with pytest.raises(ParameterError, match="named once"):
        pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.1, left_plunge=0.2)


@pytest.mark.parametrize("frequency", [0.0, -5.0, np.nan, np.inf])
def test_a_frequency_is_positive(robot, frequency):
    with pytest.raises(ParameterError, match="frequency"):
        pt.gaits.sinusoidal(robot, frequency=frequency, plunge=0.1)


def test_a_gait_beyond_a_joint_limit_is_refused(robot):
    tight = limited(robot, left_plunge=0.5)
    pt.gaits.sinusoidal(tight, frequency=5.0, plunge=0.5)
    with pytest.raises(ParameterError, match=r"left_plunge.* 28\.65 deg.*-34\.38 to 34\.38 deg"):
        pt.gaits.sinusoidal(tight, frequency=5.0, plunge=0.6)
    with pytest.raises(ParameterError, match="left_plunge"):
        pt.gaits.still(tight, plunge=0.6)
    with pytest.raises(ParameterError, match=r"-360 to 360 deg.*meant\? np.radians\(30\)"):
        pt.gaits.sinusoidal(robot, frequency=5.0, plunge=30.0)  # without limits


def test_a_lead_beyond_a_turn_asks_for_degrees(robot):
    """A phase of 90 was taken for 90 rad without a warning."""
    turn = pt.gaits.sinusoidal(robot, frequency=5.0, feather=0.3, phase={"feather": 2 * np.pi})
    assert turn.period == 0.2
    with pytest.raises(ParameterError, match=r"feather within -360.*np\.radians\(90\)"):
        pt.gaits.sinusoidal(robot, frequency=5.0, feather=0.3, phase={"feather": 90.0})


def test_a_linkage_names_the_joints_that_it_moves():
    """The error named a joint `plunge`, which the user had not given."""
    with pytest.raises(ParameterError, match="plunge and elbow.*found 'hawk with left_sweep"):
        pt.gaits.linkage(pt.load_robot("hawk"), frequency=5.0)


def test_every_gait_describes_itself_in_json(robot, tmp_path):
    table = tmp_path / "gait.csv"
    table.write_text("time [s],plunge [deg]\n0,0\n.05,10\n.1,0\n.15,-10\n.2,0\n")
    gaits = [
        pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.1),
        pt.gaits.linkage(robot, frequency=5.0),
        pt.gaits.still(robot),
        pt.gaits.from_csv(robot, table),
    ]
    kinds = [json.loads(json.dumps(gait.describe()))["kind"] for gait in gaits]
    assert kinds == ["fourier", "linkage", "fourier", "table"]


def written(tmp_path, text):
    path = tmp_path / "gait.csv"
    path.write_text(text)
    return path


def test_a_table_is_read_in_its_units_and_repeats(robot, tmp_path):
    time = np.linspace(0.0, 200.0, 41)
    rows = [f"{t},{30 * np.sin(2 * np.pi * t / 200)}" for t in time]
    path = written(tmp_path, "\n".join(["time [ms],plunge [deg]", *rows]))
    gait = pt.gaits.from_csv(robot, path)
    expected = np.radians(30) * np.sin(2 * np.pi * TIME / 0.2)
    found = gait.motion(TIME).position[:, joint(robot, "left_plunge")]
    assert gait.period == pytest.approx(0.2)
    # interpolation error of a cubic, h^4/384 of the fourth derivative: 6e-7; ends a little worse
    np.testing.assert_allclose(found, expected, atol=3e-6)


def test_a_table_with_a_period_needs_no_closing_row(robot, tmp_path):
    time = np.linspace(0.0, 0.2, 40, endpoint=False)
    rows = [f"{t},{np.cos(2 * np.pi * t / 0.2)}" for t in time]
    path = written(tmp_path, "\n".join(["time [s],left_plunge [rad]", *rows]))
    gait = pt.gaits.from_csv(robot, path, period=0.2)
    position = gait.motion(TIME).position
    expected = np.cos(2 * np.pi * TIME / 0.2)
    # as above, for one radian
    np.testing.assert_allclose(position[:, joint(robot, "left_plunge")], expected, atol=1e-5)
    assert not position[:, joint(robot, "right_plunge")].any()


@pytest.mark.parametrize("closed", [True, False])
def test_a_flight_begins_with_the_first_row_whatever_the_clock(robot, tmp_path, closed):
    """A camera's clock counted: a table from 1.25 s on began in the middle of its beat."""
    rows = [f"{1.25 + k / 8},{k % 4 + 1}" for k in range(4 + closed)]
    path = written(tmp_path, "\n".join(["time [s],plunge [deg]", *rows]))
    gait = pt.gaits.from_csv(robot, path, period=None if closed else 0.5)
    if not closed:
        words: dict[str, list[str]] = {"amplitude": [], "phase": [], "offset": []}
        assert _gait(robot, str(path), 2.0, {}, **words).describe() == gait.describe()
    found = np.degrees(gait.motion(np.array([0.0, 0.25])).position[:, joint(robot, "left_plunge")])
    np.testing.assert_allclose(found, [1.0, 3.0], rtol=1e-12)  # rounding
    pt.gaits.to_csv(robot, gait, tmp_path / "again.csv")
    again = pt.gaits.from_csv(robot, tmp_path / "again.csv").motion(TIME).position
    # a cubic through 400 of its own points: its third derivative jumps within steps of 1.25 ms
    np.testing.assert_allclose(again, gait.motion(TIME).position, atol=1e-5)


def test_a_period_far_beyond_the_last_row_is_refused(robot, tmp_path):
    path = written(tmp_path, "time [s],plunge [rad]\n0,0\n1,1\n2,1\n3,0\n")
    with pytest.raises(LogError, match="nearer to the end"):
        pt.gaits.from_csv(robot, path, period=5.5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "empty"),
        ("time [s],plunge [rad]\n", "no rows"),
        ("time [s],plunge\n0,0\n1,0\n", "expected its unit"),
        ("time [s],plunge [m]\n0,0\n1,0\n", "plunge"),
        ("time [s],plung [rad]\n0,0\n1,0\n", "no actuated joint"),
        ("plunge [rad]\n0\n1\n", "columns of time and what moves"),
        ("time [s],plunge [rad]\n0,0\n1,x\n", "row 3: expected a finite number, found 'x'"),
        ("time [s],plunge [rad]\n0,0\n1,nan\n", "row 3: expected a finite number"),
        ("time [s],plunge [rad]\n0,0\n1\n", "row 3: 1 cells, expected 2"),
        ("time [s],plunge [rad]\n0,0\n1,1\n1,1\n2,0\n", "row 4: time does not rise"),
        ("time [s],plunge [rad]\n0,0\n1,1\n2,1\n3,.5\n", "not one whole period"),
        ("time [s],plunge [rad]\n0,0\n1,1\n2,0\n", "3 rows, expected at least 4"),
        ("time [s],plunge [rad],plunge [rad]\n0,0,0\n1,1,1\n", "found it twice"),
    ],
)
def test_a_table_that_is_no_period_is_refused_with_a_reason(robot, tmp_path, text, words):
    with pytest.raises(LogError) as caught:
        pt.gaits.from_csv(robot, written(tmp_path, text))
    assert words in str(caught.value)


def test_a_period_shorter_than_the_table_is_refused(robot, tmp_path):
    path = written(tmp_path, "time [s],plunge [rad]\n0,0\n1,1\n2,1\n3,0\n")
    with pytest.raises(LogError, match="more than the period"):
        pt.gaits.from_csv(robot, path, period=2.5)


def test_a_missing_file_is_said(robot, tmp_path):
    with pytest.raises(LogError, match=r"absent\.csv: .*found no such file"):
        pt.gaits.from_csv(robot, tmp_path / "absent.csv")


@pytest.mark.parametrize("name", ["sinusoidal", "linkage", "still"])
def test_a_motion_is_asked_for_at_one_time_or_many(robot, name):
    path = pt.paths.line((0, 0, 1), (1.5, 0, 1), duration=1.0)
    own = {"sinusoidal": {"plunge": 0.3}}.get(name, {})
    gait = getattr(pt.gaits, name)(robot, **({} if name == "still" else {"frequency": 5.0}), **own)
    for moved in (gait, path):
        expected = moved.motion([0.3])
        for time in (0.3, np.array(0.3), np.float64(0.3)):
            np.testing.assert_array_equal(moved.motion(time).position, expected.position)
        with pytest.raises(ShapeError, match="time"):
            moved.motion(np.zeros((2, 3)))


def test_gaits_and_paths_of_the_same_numbers_are_equal_and_short(robot):
    def made(amplitude):
        swing = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=amplitude)
        crank = pt.gaits.linkage(robot, frequency=5.0)
        line = pt.paths.line((0, 0, 1), (amplitude, 0, 1), duration=1.0)
        both = pt.gaits.superposed(robot, crank, swing)
        return swing, both, swing.motion(TIME), line, pt.mounts.carried(line)

    for one, same, other in zip(made(0.2), made(0.2), made(0.3), strict=True):
        assert one == same != other != 3
        assert len(repr(one)) < 500 and "\n" not in repr(one)


class Half:
    """Another gait at half its pace, whose description tells the other's period alone."""

    def __init__(self, gait: pt.gaits.Gait) -> None:
        self.gait, self.joints, self.period = gait, gait.joints, 2 * gait.period

    def motion(self, time):
        fast = self.gait.motion(np.asarray(time) / 2)
        return pt.gaits.PrescribedMotion(fast.position, fast.velocity / 2, fast.acceleration / 4)

    def describe(self):
        return {"kind": "half", "parts": [self.gait.describe()], "pace": np.array([0.5])}


def test_a_flight_knows_the_period_of_an_own_gait(robot):
    """The period was that of the inner gait or none, and an array in `describe` lost the flight."""
    gait = Half(pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.3))
    flight = pt.simulate(robot, pt.QuasiSteady(robot), gait, duration=0.01, time_step=1e-3)
    assert gait_period(flight) == pytest.approx(0.4)


def test_a_gait_beyond_the_limits_is_refused_whoever_made_it():
    """Only gaits made by functions of `gaits` were; others flew through the joint's stops."""
    bird = pt.load_robot("ornithopter")
    gait = pt.gaits.cruise(bird)
    wide = replace(gait, sine=2.5 * gait.sine)
    with pytest.raises(ParameterError, match="left_plunge: expected a gait within its limits"):
        pt.simulate(bird, pt.QuasiSteady(bird), wide, duration=0.01, time_step=1e-3)

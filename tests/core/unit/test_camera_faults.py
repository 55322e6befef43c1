"""Frames that contradict the others are found, and steady ones are kept."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import patagium as pt
from patagium.sensing.motion.camera_faults import consistent_frames, on_regular_clock, open_gaps
from patagium.sensing.motion.sensor_streams import CaptureModel, Stream
from patagium.sensing.sensors import MotionCapture, as_quaternion

RATE = 100.0


def camera(rng: np.random.Generator, spin: float = 3.0, count: int = 300) -> Stream:
    """A body that turns steadily while it moves on, seen with noise."""
    time = np.arange(count) / RATE
    turns = Rotation.from_rotvec(np.outer(time, [0.0, 0.6 * spin, 0.8 * spin]))
    turns = turns * Rotation.from_rotvec(2e-3 * rng.standard_normal((count, 3)))
    place = np.column_stack([time, 0 * time, np.sin(time)])
    rows = np.hstack([place + 2e-4 * rng.standard_normal((count, 3)), as_quaternion(turns)])
    robot = pt.load_robot("aerobat")
    model = CaptureModel(MotionCapture(body="body", rate=RATE), robot)
    return Stream("cameras", model, time, rows)


def swapped(rows: np.ndarray, here: slice) -> None:
    turns = pt.sensors.from_quaternion(rows[here, 3:]) * Rotation.from_rotvec([0, 0, np.pi / 2])
    rows[here, 3:] = as_quaternion(turns)


@pytest.mark.parametrize("spin", [0.0, 3.0, 25.0])
def test_steady_frames_are_kept_even_in_a_tumble(rng: np.random.Generator, spin: float) -> None:
    used, found = consistent_frames(camera(rng, spin))
    assert used.all() and not found


@pytest.mark.parametrize("length", [1, 2, 5, 40])
def test_swapped_markers_are_left_out(rng: np.random.Generator, length: int) -> None:
    stream, here = camera(rng), slice(100, 100 + length)
    swapped(stream.rows, here)
    used, found = consistent_frames(stream)
    assert not used[here].any() and used.sum() == 300 - length
    assert found[0].frames == length and found[0].begin == pytest.approx(1.0)


def test_a_bad_tail_does_not_cost_the_frames_before(rng: np.random.Generator) -> None:
    stream = camera(rng)
    stream.rows[220:, 3:] = as_quaternion(Rotation.random(80, random_state=1))
    stream.rows[220:, :3] += 0.3 * rng.standard_normal((80, 3))
    used, found = consistent_frames(stream)
    assert used[:220].all() and not used[220:].any()
    assert "nothing else confirms" in found[-1].reason


@pytest.mark.parametrize("other", [40, 15])
def test_before_a_gap_that_hides_the_turn_most_frames_count(
    other: int, rng: np.random.Generator
) -> None:
    """The fewest were believed, swapped or not, if their turn seemed to go on over the gap."""
    stream = camera(rng)
    swapped(stream.rows, slice(0, other))
    stream.rows[60:120] = np.nan
    used, found = consistent_frames(stream)
    assert used[120:].all() and not used[:other].any() and found
    assert used[other:60].all() if other == 15 else not used[other:60].any()


def test_held_frames_and_empty_quaternions_are_not_frames(rng: np.random.Generator) -> None:
    stream = camera(rng)
    stream.rows[50:60] = stream.rows[49]
    stream.rows[80:83, 3:] = 0.0
    used, found = consistent_frames(stream)
    assert not used[50:60].any() and not used[80:83].any() and used.sum() == 287
    assert found[0].reason == "frames that repeat the last one" and found[0].frames == 10


@pytest.mark.parametrize("jitter", [0.0, 1e-3])
def test_frames_that_were_filled_in_on_a_straight_line_are_not_frames(
    jitter: float, rng: np.random.Generator
) -> None:
    """They were taken as measured: the stated deviations were up to 200 times too small."""
    stream = camera(rng)
    stream.time[:] += jitter * rng.standard_normal(300)
    share = np.linspace(0, 1, 14)[1:-1]
    turns = pt.sensors.from_quaternion(stream.rows[[100, 113], 3:])
    stream.rows[101:113, :3] = np.outer(1 - share, stream.rows[100, :3])
    stream.rows[101:113, :3] += np.outer(share, stream.rows[113, :3])
    stream.rows[101:113, 3:] = as_quaternion(Slerp([0.0, 1.0], turns)(share))
    stream.rows[:, :3] = np.round(stream.rows[:, :3], 6)
    used, found = consistent_frames(stream)
    assert used.sum() == 288 and not used[101:113].any()
    assert "filled in" in found[0].reason and found[0].frames == 12


def test_gaps_are_open_where_the_turn_over_them_is_not_known(rng: np.random.Generator) -> None:
    used = np.ones(300, bool)
    used[100:130] = False
    assert not open_gaps(camera(rng, 0.5), used)
    assert open_gaps(camera(rng, 20.0), used) == [pytest.approx((0.99, 1.30))]


def test_jittered_stamps_of_an_even_clock_are_put_back(rng: np.random.Generator) -> None:
    stream = camera(rng)
    assert on_regular_clock(stream) is None
    late = 1e-3 * rng.standard_normal(300)
    mended = on_regular_clock(Stream("cameras", stream.model, stream.time + late, stream.rows))
    assert mended is not None
    np.testing.assert_allclose(mended.time, stream.time, atol=2e-4)  # 1 ms over sqrt(300), twice


def test_stamps_that_tell_when_it_was_are_kept(rng: np.random.Generator) -> None:
    late = 1e-3 * rng.standard_normal(300)
    even = camera(rng)
    time = even.time + late
    turns = Rotation.from_rotvec(np.outer(time, [0.0, 1.8, 2.4]))
    place = np.column_stack([time, 0 * time, np.sin(time)])
    rows = np.hstack([place, as_quaternion(turns)])
    assert on_regular_clock(Stream("cameras", even.model, time, rows)) is None


@pytest.mark.parametrize("turned", [False, True])
def test_what_lies_before_a_gap_is_kept_of_a_body_that_beats_its_wings(
    rng: np.random.Generator, *, turned: bool
) -> None:
    """It shakes at 4 Hz; over the gap steady motion does not lead from one pose to the next."""
    stream = camera(rng, 0.0)
    shake = np.sin(2 * np.pi * 4.0 * stream.time + 0.3)
    stream.rows[:, 2] += 0.05 * shake
    pitch = Rotation.from_rotvec(np.outer(0.15 * shake, [0.0, 1.0, 0.0]))
    stream.rows[:, 3:] = as_quaternion(pitch * pt.sensors.from_quaternion(stream.rows[:, 3:]))
    lost = slice(101, 120)
    if turned:
        swapped(stream.rows, lost)
    else:
        stream.rows[lost] = np.nan
    used, _ = consistent_frames(stream)
    assert not used[lost].any() and used.sum() == 300 - 19

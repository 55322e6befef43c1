"""Frames of motion capture that contradict the others, or are none: swapped markers, held frames.

Frames that follow each other steadily are a stretch; a jump ends it. The longest chain of stretches
that continue each other is taken as the body, all other frames are left out. Neglected: a swap that
turns the body by less than a few times what it turns between frames.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from patagium.arrays import Array, Bools, Indices, median_step, runs
from patagium.robot.attitude import without_flips
from patagium.sensing.motion.sensor_streams import Stream
from patagium.sensing.sensors import from_quaternion

_NEAR, _AROUND = 7, 41
"""Steps over which a rate and the size of its errors are medians."""
_SURPRISE = 8.0
"""Median errors of a steady prediction beyond which a step is a jump."""
_UNSTEADY = 0.4
"""Share of its own length by which a step may differ from a steady one."""
_LEAST = np.array([2e-2, 2e-3])
"""Least length of a jump of attitude [rad] and position [m]."""
_USUAL = 100.0
"""Least jump over the median error of steady predictions of the whole log."""
_MOST = np.array([0.7, np.inf])
"""Length of a step of attitude [rad] and position [m] that is a jump in any motion."""
_FEWEST = 3
"""Fewest frames of a stretch that counts."""
_LONG = 0.75
"""Time over which a stretch is longer than most swaps [s]."""
_STRAIGHT = 0.03
"""Change of a step over that of others up to which it is none."""
_NO_TURN = 1e-3
"""Length of a quaternion below which it is none."""
_BACK = 40
"""Stretches over which a chain may leave out others."""
_UNCLEAR = 1.5
"""Rotation over a gap above which the way that the body turned is not known [rad]."""
_PAIRS = 500
"""Pairs of frames that tell the usual error of steady motion."""
_LONGEST_GAP = 1.0
"""Gap over which no motion is known without inertial units [s]."""


@dataclass(frozen=True)
class Stretch:
    """Time in which sensors do not tell the motion, with the reason.

    Attributes:
        begin: Begin [s].
        end: End [s].
        reason: Reason in words.
        frames: Number of samples left out.
    """

    begin: float
    end: float
    reason: str
    frames: int


@dataclass(frozen=True)
class _Steps:
    """Steps between frames that are seen.

    Attributes:
        time: Times of the frames, (N,) [s].
        turns: Attitudes of the frames, N.
        places: Positions of the frames, (N, 3) [m].
        rates: Steady rate about each frame, attitude in its axes then position, (N, 6)
            [rad/s, m/s].
        slack: Length by which a step of attitude and position may differ from a steady one,
            (N - 1, 2) [rad, m].
        jumps: Whether each step is a jump, (N - 1,).
        known: Usual errors of steady motion, (2,) [rad, m], by the frames it goes over.
    """

    time: Array
    turns: Rotation
    places: Array
    rates: Array
    slack: Array
    jumps: Bools
    known: dict[int, Array] = field(default_factory=dict)

    def wander(self, span: float) -> Array:
        """Largest errors of predicting steady motion over a span without jumps, (2,) [rad, m]."""
        ahead = max(1, round(span / median_step(self.time)))
        if ahead not in self.known:
            jumps = np.concatenate([[0], np.cumsum(self.jumps)])
            begin = np.flatnonzero(jumps[ahead:] == jumps[:-ahead])
            begin = begin[:: 1 + len(begin) // _PAIRS]
            errors = _errors(self, begin, begin + ahead)[0]
            self.known[ahead] = errors.max(axis=0) if len(begin) else np.zeros(2)
        return self.known[ahead]


def usable_frames(rows: Array) -> Bools:
    """Whether each frame was seen: numbers, a quaternion, and not a repetition of the last, (N,).

    Args:
        rows: Positions [m] and quaternions, (N, 7).
    """
    finite = _whole_frames(rows)
    held = np.zeros(len(rows), bool)
    held[1:] = (rows[1:] == rows[:-1]).all(axis=1)
    return finite & ~held if held[finite].mean() < 0.5 else finite


def _whole_frames(rows: Array) -> Bools:
    """Whether each frame is numbers with a quaternion, (N,)."""
    turned = np.linalg.norm(np.nan_to_num(rows[:, 3:]), axis=1) > _NO_TURN
    return np.asarray(np.isfinite(rows).all(axis=1) & turned)


def _filled_frames(time: Array, rows: Array, finite: Bools) -> Bools:
    """Whether each frame is interpolated between its neighbors, in place and attitude, (N,)."""
    filled, known = np.zeros(len(rows), bool), np.flatnonzero(finite)
    if len(known) < 2 * _NEAR:
        return filled
    at, turns = time[known], from_quaternion(rows[known, 3:])
    moved = np.diff(rows[known, :3], axis=0), (turns[:-1].inv() * turns[1:]).as_rotvec()
    straight = np.ones(len(known) - 2, bool)
    for step in moved:
        by_time = step / np.diff(at)[:, None] * np.median(np.diff(at))
        off = [np.linalg.norm(np.diff(one, axis=0), axis=1) for one in (step, by_time)]
        least = np.minimum(*off)
        straight &= least <= _STRAIGHT * np.median(least)
    filled[known[1:-1]] = straight
    return filled if straight.mean() < 0.5 else np.zeros(len(rows), bool)


def consistent_frames(camera: Stream) -> tuple[Bools, list[Stretch]]:
    """Whether each frame shows the body, (N,), and the stretches of frames that do not."""
    seen = usable_frames(camera.rows)
    finite = _whole_frames(camera.rows)
    found: list[Stretch] = []
    filled = seen & _filled_frames(camera.time, camera.rows, finite)
    for gone, reason in (
        (finite & ~seen, "frames that repeat the last one"),
        (filled, "frames on a straight line between their neighbors: filled in, not seen"),
    ):
        if gone.any():
            begin, end = camera.time[gone][[0, -1]].tolist()
            found.append(Stretch(begin, end, reason, int(gone.sum())))
    seen &= ~filled
    places = np.flatnonzero(seen)
    if len(places) < 2 * _NEAR:
        return seen, found
    steps = _steps(camera.time[seen], camera.rows[seen])
    ends = np.flatnonzero(steps.jumps)
    first = np.concatenate([[0], ends + 1])
    last = np.concatenate([ends, [len(places) - 1]])
    used = np.zeros(len(camera.rows), bool)
    for k in _longest_chain(steps, first, last):
        used[places[first[k] : last[k] + 1]] = True
    begins = [begin for begin, _ in _open_gaps(steps)]
    part = np.searchsorted(begins, camera.time)  # between gaps that hide the turn most frames count
    count, of = np.bincount(part, used), np.bincount(part, seen)
    used &= ((2 * count >= of) | (count == count.max()))[part]
    found += _left_out(camera.time, places, used)
    return used, found


def open_gaps(camera: Stream, used: Bools) -> list[tuple[float, float]]:
    """Gaps between frames over which the way that the body turned is not known [s].

    Args:
        camera: Samples of motion capture.
        used: Whether each frame counts, (N,).
    """
    time, rows = camera.time[used], camera.rows[used]
    if len(time) < 2 * _NEAR:
        return []
    return _open_gaps(_steps(time, rows))


def _open_gaps(steps: _Steps) -> list[tuple[float, float]]:
    time, span = steps.time, np.diff(steps.time)
    turn = np.linalg.norm(steps.rates[:, :3], axis=1)
    rate = np.maximum(turn[:-1], turn[1:])
    wide = (span > 2.5 * np.median(span)) & ((rate * span > _UNCLEAR) | (span > _LONGEST_GAP))
    return [(float(time[k]), float(time[k + 1])) for k in np.flatnonzero(wide)]


def on_regular_clock(stream: Stream) -> Stream | None:
    """Stream with stamps at equal steps, if its values are steadier so; else None.

    Stamps that jitter although the sensor samples at equal steps make a steady motion look rough.
    """
    step = _regular_step(stream.time)
    if step is None:
        return None
    counts = np.rint((stream.time - stream.time[0]) / step)
    if not (np.diff(counts) > 0).all():
        return None
    slope, offset = np.polyfit(counts, stream.time, 1)
    regular = offset + slope * counts
    late = stream.time - regular
    if not 0.01 * step < late.std() < 0.5 * step:
        return None
    values = stream.rows
    if values.shape[1] == 7:
        seen = usable_frames(values)
        values = np.where(seen[:, None], values, np.nan)
        values[seen, 3:] = without_flips(values[seen, 3:])
    roughness = [_roughness(time, values) for time in (stream.time, regular)]
    return replace(stream, time=regular) if roughness[1] < 0.9 * roughness[0] else None


def _regular_step(time: Array) -> float | None:
    """Step of a clock by which stamps count up, the mean of those that are no gaps [s]."""
    steps = np.diff(time)
    if len(steps) < 20:
        return None
    middle = float(np.median(steps))
    near = steps[(steps > 0.3 * middle) & (steps < 1.7 * middle)]
    step = float(near.mean())
    for _ in range(3):  # a fit over ever more of the log
        counts = np.rint((time - time[0]) / step)
        step = float(np.polyfit(counts, time, 1)[0])
    return step


def _roughness(time: Array, values: Array) -> float:
    """Median error of values as predicted from both neighbors, over all columns."""
    share = (time[1:-1] - time[:-2]) / (time[2:] - time[:-2])
    error = np.abs(values[1:-1] - values[:-2] - share[:, None] * (values[2:] - values[:-2]))
    near = (time[2:] - time[:-2]) < 3 * np.median(np.diff(time))
    error = error[near]
    known = np.isfinite(error).all(axis=1)
    return float(np.median(np.linalg.norm(error[known], axis=1))) if known.any() else 0.0


def _steps(time: Array, rows: Array) -> _Steps:
    """Steps between frames, and which are jumps."""
    turns, places = from_quaternion(rows[:, 3:]), rows[:, :3]
    span = np.diff(time)
    moved = np.hstack([(turns[:-1].inv() * turns[1:]).as_rotvec(), np.diff(places, axis=0)])
    rate = moved / span[:, None]
    steady = median_filter(rate, size=(min(_NEAR, len(rate)), 1), mode="nearest")
    apart = np.abs(moved - steady * span[:, None]).reshape(-1, 2, 3)
    apart = np.linalg.norm(apart, axis=2)
    length = np.linalg.norm((steady * span[:, None]).reshape(-1, 2, 3), axis=2)
    usual = median_filter(apart, size=(min(_AROUND, len(rate)), 1), mode="nearest")
    slack = np.minimum(_SURPRISE * usual, _USUAL * np.median(apart, axis=0))
    slack = np.minimum(slack + _UNSTEADY * length + _LEAST, _MOST)
    both = np.vstack([steady[:1], 0.5 * (steady[1:] + steady[:-1]), steady[-1:]])
    return _Steps(time, turns, places, both, slack, (apart > slack).any(axis=1))


def _longest_chain(steps: _Steps, first: Array, last: Array) -> set[int]:
    """Numbers of the stretches of the chain with the most frames whose stretches continue."""
    count = len(first)
    score = (last - first + 1).astype(float)
    score[score < _FEWEST] = -np.inf
    best, before, ahead = score.copy(), np.full(count, -1), score.copy()
    step = median_step(steps.time)
    for i in range(count - 2, -1, -1):
        for j in range(i + 1, min(count, i + _BACK)):
            if score[i] + ahead[j] > ahead[i] and _continues(steps, last[i], first[j], long=False):
                ahead[i] = score[i] + ahead[j]
    for j in range(1, count):
        for i in range(max(0, j - _BACK), j):
            if best[i] + score[j] <= best[j]:
                continue
            long = min(best[i], ahead[j]) * step > _LONG
            if _continues(steps, last[i], first[j], bool(long)):
                best[j], before[j] = best[i] + score[j], i
    chain, k = set(), int(np.argmax(best))
    while k >= 0:
        chain.add(k)
        k = int(before[k])
    return chain


def _continues(steps: _Steps, i: int, j: int, long: bool) -> bool:
    """Whether frame j may follow frame i: its pose is one that a steady motion leads to.

    Where any attitude may, only a long stretch is believed after another.
    """
    errors, mean, apart = _errors(steps, np.array([i]), np.array([j]))
    span = steps.time[j] - steps.time[i]
    usual = 0.5 * (steps.slack[max(0, i - 1)] + steps.slack[min(len(steps.slack) - 1, j)])
    least = usual + 0.5 * span * (mean + apart)[0]
    if least[0] <= _MOST[0] and (errors[0] < least).all():
        return True
    allowed = np.maximum(least, steps.wander(float(span)))
    return long if allowed[0] > _MOST[0] else bool((errors[0] < allowed).all())


def _errors(steps: _Steps, i: Indices, j: Indices) -> tuple[Array, Array, Array]:
    """Errors of steady motion from frames i to j, mean rate, its change, attitude and position.

    Returns:
        Each (K, 2) [rad, m; rad/s, m/s; rad/s, m/s].
    """
    span = (steps.time[j] - steps.time[i])[:, None]
    before = steps.rates[np.maximum(0, i - 2)]
    after = steps.rates[np.minimum(len(steps.time) - 1, j + 2)]
    mean, back = 0.5 * (before + after), steps.turns[i].inv() * steps.turns[j]
    half = (back * Rotation.from_rotvec(-mean[:, :3] * span)).as_rotvec()
    ways = half, back.as_rotvec() - mean[:, :3] * span
    turned = np.min([np.linalg.norm(one, axis=1) for one in ways], axis=0)
    moved = np.linalg.norm(steps.places[j] - steps.places[i] - mean[:, 3:] * span, axis=1)
    sizes = [np.linalg.norm(one.reshape(-1, 2, 3), axis=2) for one in (mean, after - before)]
    return np.column_stack([turned, moved]), sizes[0], sizes[1]


def _left_out(time: Array, places: Indices, used: Bools) -> Iterator[Stretch]:
    """Stretches of frames that were seen and are not used."""
    for begin, end in runs(~used[places]):
        stamps = time[places[begin:end]].tolist()
        word = "a pose that jumps away and back: markers swapped"
        if begin == 0 or end == len(places):
            word = "a pose that nothing else confirms"
        elif len(stamps) == 1:
            word = "one frame off"
        yield Stretch(stamps[0], stamps[-1], word, len(stamps))

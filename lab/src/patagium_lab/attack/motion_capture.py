"""Motion from made-up motion capture: what it claims to know against what is true.

Each seed draws a body, its motion (smooth, flapping, or a rest before a flight) with tumbles, and
what cameras make of it: colored noise, jitter of the stamps or of the samples, lost frames, swapped
markers, a tail of nonsense. Neglected: markers one by one; rooms in which cameras err by place.

    python -m patagium_lab.attack.motion_capture 200
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, Slerp

from patagium.arrays import Array
from patagium.robot import Robot, load_robot_text
from patagium.sensing import SensorLog, estimate_motion
from patagium.sensing.sensors import MotionCapture, as_quaternion, from_quaternion

BODY = """
name: brick
gravity: 9.81
bodies:
  body:
    floating: true
    mass: 50 g
    shape: {type: box, size: [10 cm, 6 cm, 4 cm]}
"""
_STEP = 1e-3
"""Time step of the true motion [s]."""
_RATES = (100.0, 120.0, 200.0, 250.0)
"""Frame rates [Hz]."""
_MOST = {"median_error_deg": 1.0, "ratio": 1.5, "beyond_four": 0.01}
"""Bounds of a good run: median error of the attitude [deg], real over stated standard deviation
and its inverse, share of the samples that err by more than four stated ones."""


@dataclass(frozen=True)
class TrueMotion:
    """True motion of a body.

    Attributes:
        time: Times, (N,) [s].
        place: Positions, (N, 3) [m].
        turn: Attitudes, N.
    """

    time: Array
    place: Array
    turn: Rotation


def body() -> Robot:
    """Rigid body that is thrown, carried and tumbled."""
    return load_robot_text(BODY, "brick")


def true_motion(draw: np.random.Generator, duration: float) -> TrueMotion:
    """Motion of a body with tumbles.

    Args:
        draw: Generator of random numbers.
        duration: Length of the motion [s].
    """
    time = np.arange(0.0, duration + _STEP, _STEP)
    place, spin = (_smooth, _flapping, _from_rest)[draw.integers(3)](draw, time)
    for _ in range(draw.integers(0, 3)):
        at, length = draw.uniform(0.2, 0.9) * duration, draw.uniform(0.2, 0.8)
        rate = draw.uniform(5, 25) * draw.choice([-1, 1])
        axis = draw.normal(size=3)
        rise = np.tanh((time - at) / 0.03) - np.tanh((time - at - length) / 0.03)
        spin = spin + 0.5 * rise[:, None] * rate * axis / np.linalg.norm(axis)
    start = Rotation.random(random_state=int(draw.integers(1 << 20)))
    return TrueMotion(time, place, _turned(start, spin))


def _smooth(draw: np.random.Generator, time: Array) -> tuple[Array, Array]:
    """Position [m] and angular velocity [rad/s] of a random motion of a few hertz."""
    width = draw.uniform(1, 4)
    frequency = np.fft.rfftfreq(len(time), _STEP)
    found = []
    for size in (0.3, draw.uniform(0.5, 3)):
        white = np.fft.rfft(draw.standard_normal((len(time), 3)), axis=0)
        series = np.fft.irfft(
            white * np.exp(-((frequency / width) ** 2))[:, None], len(time), axis=0
        )
        found.append(size * series / series.std(axis=0))
    return found[0], found[1]


def _flapping(draw: np.random.Generator, time: Array) -> tuple[Array, Array]:
    """Position [m] and angular velocity [rad/s] of a body under flapping wings."""
    beat, phase = 2 * np.pi * draw.uniform(3, 9), draw.uniform(0, 6, 3)
    waves = np.sin(beat * time[:, None] + phase)
    place = np.array([0.003, 0.002, 0.01]) * waves
    place += np.column_stack([3 * time, 0 * time, 0.3 * np.sin(time)])
    size = draw.uniform(0.02, 0.15) * beat
    spin = size * np.array([0.3, 1.0, 0.0]) * np.cos(beat * time[:, None] + phase)
    spin += np.column_stack([0 * time, 0.1 * np.sin(time), 0.3 * np.sin(0.7 * time)])
    return place, spin


def _from_rest(draw: np.random.Generator, time: Array) -> tuple[Array, Array]:
    """Position [m] and angular velocity [rad/s] of a body that rests, then flies."""
    begin, beat = time[-1] * draw.uniform(0.2, 0.5), 2 * np.pi * draw.uniform(2, 6)
    flies = 1 / (1 + np.exp(-(time - begin) / 0.02))
    away = flies * np.clip(time - begin, 0.0, None)
    place = away[:, None] * draw.normal(size=3) + 0.01 * (flies * np.sin(beat * time))[:, None]
    waves = np.sin(beat * time[:, None] + np.arange(3))
    return place, draw.uniform(1, 4) * flies[:, None] * waves


def _turned(start: Rotation, spin: Array) -> Rotation:
    """Attitudes of a body with an angular velocity in its own axes, (N, 3) [rad/s]."""
    steps = Rotation.from_rotvec(0.5 * (spin[1:] + spin[:-1]) * _STEP)
    parts = Rotation.concatenate([start, steps]).as_quat()
    reach = 1
    while reach < len(parts):  # products over twice as many steps in each round
        ahead = Rotation.from_quat(parts[:-reach]) * Rotation.from_quat(parts[reach:])
        parts[reach:] = ahead.as_quat()
        reach *= 2
    return Rotation.from_quat(parts)


def captured(seed: int) -> tuple[SensorLog, TrueMotion]:
    """Log of motion capture, and the motion behind it.

    Args:
        seed: Seed of everything.
    """
    draw = np.random.default_rng(seed)
    duration = draw.uniform(3, 8)
    truth = true_motion(draw, duration)
    rate = float(draw.choice(_RATES))
    shown = np.arange(0.01, duration - 0.01, 1 / rate)
    late = draw.choice([0.0, 0.0, 0.05, 0.2]) / rate * draw.standard_normal(len(shown))
    stamps = shown + late
    if draw.random() < 0.5:  # the samples jitter, and the stamps say so
        shown = np.clip(stamps, 0.0, duration)
    color = float(draw.choice([0.0, 0.0, 0.3, 0.6]))
    noise = [
        size * _colored(draw, len(shown), color)
        for size in (10 ** draw.uniform(-4, -3), np.radians(10 ** draw.uniform(-1, 0.2)))
    ]
    place = CubicSpline(truth.time, truth.place)(shown) + noise[0]
    turn = Slerp(truth.time, truth.turn)(shown) * Rotation.from_rotvec(noise[1])
    parts = _damaged(draw, place, turn.as_quat(), rate)
    kept = np.ones(len(stamps), bool)
    kept[1:] = np.diff(np.maximum.accumulate(stamps)) > 0
    reading = xr.Dataset(
        {"position": (("time", "axis"), parts[0]), "quaternion": (("time", "part"), parts[1])},
        coords={"time": stamps},
    ).isel(time=kept)
    stated = float(draw.integers(2))
    cameras = MotionCapture(
        name="cameras",
        body="body",
        rate=rate,
        position_std=1e-4 * stated,
        attitude_std=np.radians(0.2) * stated,
    )
    return SensorLog({"cameras": reading}, {"cameras": cameras}, {}, body(), ""), truth


def _damaged(
    draw: np.random.Generator, place: Array, turn: Array, rate: float
) -> tuple[Array, Array]:
    """Positions and quaternions w, x, y, z with swaps, lost frames and a bad tail."""
    count = len(place)
    for _ in range(draw.integers(0, 4)):
        here = _run(draw, count, 0.5 * rate)
        angle = draw.choice([np.pi / 2, np.pi, 2 * np.pi / 3])
        swap = Rotation.from_rotvec(angle * np.eye(3)[draw.integers(3)])
        turn[here] = (Rotation.from_quat(turn[here]) * swap).as_quat()
        place[here] += draw.normal(size=3) * draw.choice([0.0, 0.02])
    quaternion = as_quaternion(Rotation.from_quat(turn))
    lost = [_run(draw, count, 0.6 * rate) for _ in range(draw.integers(0, 5))]
    if draw.random() < 0.3:
        tail = slice(int(0.85 * count), count)
        size = count - tail.start
        nonsense = Rotation.random(size, random_state=int(draw.integers(1 << 20)))
        quaternion[tail] = as_quaternion(nonsense)
        place[tail] += 0.3 * draw.normal(size=(size, 3))
    for here in lost:
        place[here], quaternion[here] = np.nan, np.nan
    return place, quaternion


def _run(draw: np.random.Generator, count: int, longest: float) -> slice:
    begin = int(draw.integers(count - 1))
    return slice(begin, min(count, begin + int(draw.integers(1, int(longest)))))


def _colored(draw: np.random.Generator, count: int, color: float) -> Array:
    """Noise of variance one with a correlation from sample to sample, (N, 3)."""
    noise = draw.standard_normal((count, 3))
    for k in range(1, count):
        noise[k] = color * noise[k - 1] + np.sqrt(1 - color**2) * noise[k]
    return np.asarray(noise)


def capture_row(seed: int) -> dict[str, Any]:
    """Errors of the motion from one log, JSON-able.

    Args:
        seed: Seed of the log.

    Returns:
        seed; known (share of the samples whose attitude is claimed to be known);
        median_error_deg (of the attitude there); ratio (root mean square of error over stated
        standard deviation, all axes); beyond_four (share of errors beyond four of them);
        beyond_four_everywhere (also where the attitude is not claimed to be known).
    """
    log, truth = captured(seed)
    found = estimate_motion(log)
    times = np.clip(found["time"].values, truth.time[0], truth.time[-1])
    estimate = from_quaternion(found["attitude"].values)
    error = (Slerp(truth.time, truth.turn)(times).inv() * estimate).as_rotvec()
    relative = np.abs(error / found["attitude_std"].values)
    known = found["known"].values
    if not known.any():
        return {"seed": seed, "known": 0.0}
    return {
        "seed": seed,
        "known": float(known.mean()),
        "median_error_deg": float(np.degrees(np.median(np.linalg.norm(error[known], axis=1)))),
        "ratio": float(np.sqrt((relative[known] ** 2).mean())),
        "beyond_four": float((relative[known] > 4).mean()),
        "beyond_four_everywhere": float((relative > 4).mean()),
    }


def capture_rows(first: int, last: int) -> list[dict[str, Any]]:
    """Rows of the seeds `first` to `last - 1`; see `capture_row`.

    Args:
        first: First seed.
        last: Seed after the last.
    """
    return [capture_row(seed) for seed in range(first, last)]


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures over many seeds, JSON-able.

    Args:
        rows: Rows of `capture_row`.
    """
    told = [row for row in rows if row["known"] > 0]
    ratio = np.array([row["ratio"] for row in told])
    beyond = np.array([row["beyond_four"] for row in told])
    median = np.array([row["median_error_deg"] for row in told])
    apart = np.maximum(ratio, 1 / ratio)
    return {
        "seeds": len(rows),
        "seeds_without_a_claim": len(rows) - len(told),
        "share_known": float(np.mean([row["known"] for row in rows])),
        "median_error_deg": float(np.median(median)),
        "seeds_with_median_above_1_deg": int((median > _MOST["median_error_deg"]).sum()),
        "ratio_median": float(np.median(ratio)),
        "ratio_5_and_95_percent": np.percentile(ratio, [5, 95]).tolist(),
        "seeds_with_ratio_beyond_1.5": int((apart > _MOST["ratio"]).sum()),
        "largest_ratio": float(ratio.max()),
        "share_beyond_four": float(np.average(beyond, weights=[row["known"] for row in told])),
        "seeds_with_more_than_1_percent_beyond_four": int((beyond > _MOST["beyond_four"]).sum()),
    }


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    for key, value in summary(capture_rows(0, count)).items():
        print(f"{key.replace('_', ' ')}: {value}")

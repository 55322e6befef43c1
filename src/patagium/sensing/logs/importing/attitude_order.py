"""Order of the components of an attitude, judged by the motion of the position.

An attitude that is read in another order than it was written in contradicts the motion: the mean
force on the robot and its course lie off the front and upper half of its plane of symmetry, its
wingbeat turns it about another axis than that of pitch, or, thrown, it does not keep its angular
momentum. Where another order fits far better than the one that the mapping states, it is named.
Neglected: wind; a robot that flies upside down or tail first and heads along an axis of the world
fits the other order of its quaternion as well, and the finding says so.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from patagium.arrays import Array, median_step, runs
from patagium.sensing.logs.importing.findings import GRAVITY, Finding
from patagium.sensing.sensors import from_quaternion

OTHER_ORDER = {"wxyz": "xyzw", "xyzw": "wxyz", "rpy": "rotvec", "rotvec": "rpy"}
"""Order for which each order of an attitude is mistaken."""
_FREE = 0.3 * GRAVITY
"""Specific force below which a body is thrown [m/s^2]."""
_WINDOW = 10
"""Spans over which force and course are averaged."""
_FINE, _BEAT = 0.01, 25
"""Step of a wingbeat [s], and steps of the mean that is taken off it."""
_MOVING = 0.5
"""Speed from which a course counts [m/s]."""
_ONE_AXIS = 3.0
"""Power of a wingbeat about one axis over that about the others from which the axis counts."""
_JUMP = 1.0
"""Turn from sample to sample that is a jump [rad]."""
_BAD = np.array([0.05, 0.3, 0.15, 4e-4])
"""Shares of force, course, wingbeat and angular momentum from which they contradict an order."""
_BETTER, _FAR_BETTER = 4.0, 8.0
"""Share of one order over that of another that fits better, and so much that force decides."""
_SMALL = 0.3
"""Turn over which an angular velocity is a mean [rad]."""
_POOR, _LEVEL = 0.3, 0.03
"""Share that no order that is named may have; lateral share of force that it may have more."""

Piece = tuple[Array, Array, Array]
"""Times (k,) [s], positions (k, 3) [m] and quaternions (k, 4) of a stretch without a gap."""


def order_findings(
    names: str, order: str, declared: Sequence[Piece], other: Sequence[Piece], span: int
) -> list[Finding]:
    """Finding that the other order of an attitude fits the motion and the declared one does not.

    Args:
        names: Names of attitude and position.
        order: Declared order.
        declared: Stretches with the attitude in the declared order.
        other: These stretches with the attitude in the other order.
        span: Samples over which rates are means.
    """
    (bad, lateral, jumps), (good, side, others) = (_shares(one, span) for one in (declared, other))
    told = np.isfinite(bad) & np.isfinite(good)
    told[2] &= order in ("rpy", "rotvec")  # a wingbeat about pitch stays one in a quaternion
    told[:3] &= not told[3]  # a body that is thrown was held before
    if not (told[0] or told[3]) or others > jumps or (good[told] > _POOR).any():
        return []
    sure = bool(told[0] and bad[0] > 0.1 * _BAD[0] and good[0] < bad[0] / _FAR_BETTER)
    better = told & (bad > _BAD) & (good < np.minimum(bad / _BETTER, 0.1))
    worse = good[told].sum() > 0.5 * bad[told].sum() and not sure
    if worse or not (sure or better.any()) or side > lateral + _LEVEL:
        return []
    asked = OTHER_ORDER[order]
    off = np.degrees(np.arcsin(np.sqrt(np.minimum([bad, good], 1.0)))).T
    words = [
        f"the {word} is {one:.0f} deg off {plane} ({two:.0f} deg as {asked})"
        for word, plane, (one, two), known in zip(_WORDS, _PLANES, off, told, strict=True)
        if known
    ]
    text = f"as `order: {order}` the attitude contradicts the motion: {', '.join(words)}"
    text += f": was it written as {asked}?"
    if not told[3]:
        text += " Let it be if the robot does fly upside down or tail first"
    return [Finding("warning", names, "axes", text)]


_WORDS = "mean force", "course", "axis of the wingbeat", "angular momentum in free fall"
_PLANES = "the upper half of the plane of symmetry", "its front half", "pitch", "its mean"


def _shares(pieces: Sequence[Piece], span: int) -> tuple[Array, float, int]:
    """Shares of force, course, wingbeat and angular momentum that contradict the attitude.

    Returns:
        The shares, (4,) [1], NaN where the log does not tell; lateral share of the force;
        number of jumps of the attitude.
    """
    forces, courses, spins = np.zeros((3, 0, 3))
    momenta: list[Array] = []
    jumps, found, lateral = 0, np.full(4, np.nan), 0.0
    for time, place, quaternion in pieces:
        turns = from_quaternion(quaternion)
        jumps += int(((turns[:-1].inv() * turns[1:]).magnitude() > _JUMP).sum())
        spins = np.vstack([spins, _wingbeat(time, turns)])
        at, where, ends = time[::span], place[::span], turns[::span]
        step = np.diff(at)[:, None]
        speed = np.diff(where, axis=0) / step
        force = 2 * np.diff(speed, axis=0) / (step[1:] + step[:-1]) + [0.0, 0.0, GRAVITY]
        thrown = np.linalg.norm(force, axis=1) < _FREE
        count = len(force) // _WINDOW
        for kept in np.arange(count * _WINDOW).reshape(count, _WINDOW):
            if not thrown[kept].all():
                back = ends[kept + 1].inv()
                middle = 0.5 * (speed[kept] + speed[kept + 1])
                forces = np.vstack([forces, back.apply(force[kept]).mean(axis=0)])
                courses = np.vstack([courses, back.apply(middle).mean(axis=0)])
        for begin, end in runs(thrown) + [1, 0]:
            if end - begin >= _WINDOW:
                part = slice(begin * span, end * span + 1)
                momenta.append(_momenta(time[part], turns[part], span))
    if len(forces):
        found[0], lateral = _off_plane(forces, forces[:, 2])
        if np.sqrt((courses**2).sum(axis=1).mean()) > _MOVING:
            found[1] = _off_plane(courses, courses[:, 0])[0]
    if len(spins):
        power, axes = np.linalg.eigh(spins.T @ spins)
        if power[2] > _ONE_AXIS * power[1]:
            found[2] = 1.0 - axes[1, 2] ** 2
    if momenta:
        found[3] = _not_kept(momenta)
    return found, lateral, jumps


def _off_plane(vectors: Array, ahead: Array) -> tuple[float, float]:
    """Shares of the squares of vectors that are lateral or against a direction, and lateral."""
    whole, lateral = (vectors**2).sum(), (vectors[:, 1] ** 2).sum()
    back = (np.minimum(ahead, 0.0) ** 2).sum()
    return float((lateral + back) / whole), float(lateral / whole)


def _wingbeat(time: Array, turns: Rotation) -> Array:
    """Angular velocity in body axes less its mean over a quarter of a second, (k, 3) [rad/s]."""
    fine = max(1, round(_FINE / median_step(time)))
    ends, at = turns[::fine], time[::fine]
    rate = (ends[:-1].inv() * ends[1:]).as_rotvec() / np.diff(at)[:, None]
    whole = rate[: len(rate) // _BEAT * _BEAT].reshape(-1, _BEAT, 3)
    return np.asarray((whole - whole.mean(axis=1, keepdims=True)).reshape(-1, 3))


def _momenta(time: Array, turns: Rotation, span: int) -> Array:
    """Angular momentum in the world as a linear function of six moments of inertia, (k, 3, 6)."""
    usual = float(np.median((turns[:-1].inv() * turns[1:]).magnitude()))
    stride = max(1, min(span, round(_SMALL / max(usual, 1e-9))))
    ends, step = turns[::stride], np.diff(time[::stride])[:, None]
    turn = (ends[:-1].inv() * ends[1:]).as_rotvec()
    x, y, z = (turn / step).T
    o = np.zeros_like(x)
    rows = [[x, o, o, y, z, o], [o, y, o, x, o, z], [o, o, z, o, x, y]]
    body = np.moveaxis(np.array(rows), -1, 0)
    return np.asarray((ends[:-1] * Rotation.from_rotvec(0.5 * turn)).as_matrix() @ body)


def _not_kept(momenta: Sequence[Array]) -> float:
    """Least share of the squares of angular momenta that changes, for any inertia."""
    whole = np.concatenate(momenta).reshape(-1, 6)
    change = np.concatenate([one - one.mean(axis=0) for one in momenta]).reshape(-1, 6)
    size = whole.T @ whole
    size += 1e-9 * np.trace(size) * np.eye(6)
    return float(max(0.0, eigh(change.T @ change, size, eigvals_only=True)[0]))

"""Consistency of the quantities of a log with each other, which sizes alone cannot show.

An attitude turns as fast as its rate says, a position moves as its velocity says, and specific
force turned into the world, less gravity, is the change of velocity. Mistakes in units, axes and
component order break these relations. They are tested in a few stretches spread over the log, in
means over about 50 ms. Neglected: delays between sensors, lever arms, the Earth's rotation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from patagium.arrays import Array, median_step
from patagium.robot import Robot
from patagium.sensing.logs.axes import continuous, slerp, turning_rate
from patagium.sensing.logs.importing.attitude_order import OTHER_ORDER, order_findings
from patagium.sensing.logs.importing.findings import (
    GRAVITY,
    SECOND,
    Finding,
    ValueSurvey,
    is_still,
    sizes_of,
    unit_findings,
)
from patagium.sensing.logs.importing.plan import Quantity, coordinates
from patagium.sensing.logs.importing.resample import Spool, TimeBase, resampled, stamps_in
from patagium.sensing.logs.sensor_log import body_in
from patagium.sensing.motion.camera_faults import consistent_frames
from patagium.sensing.motion.sensor_streams import ImuModel, Stream, first_camera
from patagium.sensing.sensors import as_quaternion, from_quaternion

_STRETCHES = 8
_LENGTH = 4000
_SPAN = 0.05  # s
_ENOUGH = 30
"""Numbers of each of two rates that a comparison takes."""
_BRIEF = 0.01
"""Duration of the means of joints, of which a wingbeat has several [s]."""
_DIFFERENT = 0.5
"""Difference of two rates over the larger of them from which one is not the other."""
_RATES = {
    ("q", "v"): (
        *(0.1, 0.3, 0.5),
        "velocities are the changes of q: x, y, z in world axes, and of roll, pitch, yaw those of "
        "the angles, no rates about axes of the body",
    ),
    ("v", "a"): (
        *(4.0, 10.0, 20.0),
        "accelerations are the changes of v: in world axes, and no specific force, which has "
        "gravity in it",
    ),
}
"""Mean and size of a body and size of a joint below which all is noise [SI], and the remedy."""
_NEARER, _TURN = 4.0, np.radians(15.0)
"""Squares of the difference of two rates over those once one is turned, from which it was turned,
and least angle [rad]."""
_WORLDS = ("ned", "enu", "nwu")
_SURE = 0.6
"""Correlation from which two rates are taken as the same motion."""
_LEAST = 0.7
"""Least mean specific force in g, and inverse of the largest, that is taken for that of hover."""
_ALONG = 0.8
"""Share of the mean specific force that points down where z was mistaken."""
_LEVEL = 0.5
"""Share of the mean specific force that may be horizontal."""


@np.errstate(all="ignore")  # numbers of a damaged log may be of any size
def consistency(spool: Spool, base: TimeBase) -> tuple[list[Finding], list[dict[str, Any]]]:
    """Findings about relations between quantities, and the residuals of specific forces.

    With a robot, quantities of different bodies are not compared: `estimate_motion` does it.

    Returns:
        Findings; and for each specific force with an attitude, its mean in world axes and, with
        a velocity in world axes, the residual R f - g - dv/dt by axis [m/s^2]: its mean (the bias
        of the accelerometer, for one), its standard deviation and its rms.
    """
    items, robot = spool.plan.items, spool.plan.robot
    attitudes = [item for item in items if item.is_attitude]
    vectors = [item for item in items if item.column.frame and not item.is_attitude]
    rates = [item for item in vectors if item.si == "rad/s"]
    forces = [item for item in vectors if item.si == "m/s^2"]
    speeds = [item for item in vectors if item.si == "m/s" and _of_world(item)]
    places = [item for item in vectors if item.si == "m" and _of_world(item)]
    looked = _Stretches(spool, base)
    found: list[Finding] = [] if robot is None else _rate_findings(looked, items, robot)
    facts: list[dict[str, Any]] = []

    def body_of(item: Quantity) -> str | None:
        return None if robot is None else body_in(item.label, robot)

    def of_base(item: Quantity) -> bool:
        return robot is None or body_of(item) == body_in("", robot)

    def beside(item: Quantity, others: Sequence[Quantity]) -> Quantity | None:
        return next((one for one in others if body_of(one) == body_of(item)), None)

    for rate in rates:
        if (attitude := beside(rate, attitudes)) is not None:
            found += _compare(looked, attitude, rate)
    for force in forces:
        if (attitude := beside(force, attitudes)) is not None:
            more, fact = _forces(looked, attitude, force, beside(force, speeds))
            found += more
            facts += fact
    if places and (speed := beside(places[0], speeds)) is not None:
        found += _compare(looked, places[0], speed)
    for attitude in attitudes:
        place = beside(attitude, [item for item in vectors if item.si == "m"])
        if place is not None and of_base(attitude) and attitude.order in OTHER_ORDER:
            if not any(attitude.label in one.where for one in found):
                found += _order_findings(looked, attitude, place)
    told = {one.where.partition(" and ")[0] for one in found if one.kind == "axes"}
    for force in forces:
        if of_base(force) and force.label not in told:
            found += _down_findings(force, spool)
    return found, facts


class _Stretches:
    """Stretches of a log without a gap, with means over short spans."""

    def __init__(self, spool: Spool, base: TimeBase) -> None:
        self._spool, self._base, self._gap = spool, base, spool.plan.mapping.gap
        self.span = max(1, min(round(_SPAN / base.step), base.count // 10))
        self.duration = self.span * base.step
        length = min(max(_LENGTH, 20 * self.span), base.count)
        last = base.count - length
        starts = np.linspace(0, last, min(_STRETCHES, 1 + last // length)).astype(int)
        self._places = [(int(start), int(start) + length) for start in np.unique(starts)]

    def of(self, *items: Quantity) -> list[tuple[Array, list[Array]]]:
        """Times, (k,) [s], and items, (k, n) each [SI], where all are valid, without a gap."""
        pieces = []
        for begin, end in self._places:
            stamps = stamps_in(self._spool, self._base, begin, end)
            parts = [resampled(self._spool, item, stamps) for item in items]
            time = (stamps - stamps[0]) / SECOND
            kept = np.flatnonzero(np.all([ok for _, ok in parts], axis=0))
            breaks = np.flatnonzero(np.diff(time[kept]) > self._gap * self._base.step) + 1
            for run in np.split(kept, breaks):
                if len(run) > self.span:
                    values = zip(items, parts, strict=True)
                    pieces.append((time[run], [one[run] * item.to_si for item, (one, _) in values]))
        return pieces


def _means(values: Array, span: int) -> Array:
    """Means over spans by the trapezoid rule, (m, n), in the unit of the values."""
    count = (len(values) - 1) // span
    whole = values[: count * span + 1]
    middle = (whole[1:] + whole[:-1]) / 2
    return np.asarray(middle.reshape(count, span, -1).mean(axis=1))


def _ends(values: Array, span: int) -> Array:
    """Values at the ends of the spans, (m + 1, n)."""
    return values[::span][: (len(values) - 1) // span + 1]


def _velocity(time: Array, place: Array) -> Array:
    """Mean rate of a place between consecutive times, (m, n), in its unit over that of time."""
    return np.diff(place, axis=0) / np.diff(time)[:, None]


Piece: TypeAlias = tuple[Array, list[Array]]
"""Times, (k,) [s], a place or attitude and its rate, (k, n) each [SI], without a gap."""


def _changes(
    pieces: Sequence[Piece], span: int, moved: Callable[[Array, Array], Array] = _velocity
) -> Array:
    """Mean rates over spans, from the change of position and as measured, (2, m, n) [SI]."""
    both = [[moved(_ends(t, span), _ends(x, span)), _means(rate, span)] for t, (x, rate) in pieces]
    return np.concatenate(both, axis=1) if both else np.empty((2, 0, 1))


def _span_of(pieces: Sequence[Piece], most: int) -> int:
    """Samples of a span: at most so many, and so few that a short log has spans enough."""
    numbers = sum(rate.size for _, (_, rate) in pieces)
    return max(1, min(most, 3 * numbers // (4 * _ENOUGH)))


def _rate_findings(looked: _Stretches, items: Sequence[Quantity], robot: Robot) -> list[Finding]:
    """Findings that velocities or accelerations of coordinates are not the changes that they are.

    Args:
        looked: Stretches of the log.
        items: Its quantities.
        robot: The machine, whose coordinates name them.
    """
    held, found = coordinates(items, robot), []
    for (lower, upper), (mean, *floors, words) in _RATES.items():
        wrong = []
        for k, name in enumerate(robot.dof_names):
            place, rate = held.get(f"{lower}.{name}"), held.get(f"{upper}.{name}")
            if place is None or rate is None:
                continue
            base, pieces = k in robot.floating_dofs, looked.of(place, rate)
            usual = round((_SPAN if base else _BRIEF) * looked.span / looked.duration)
            span = _span_of(pieces, usual)
            derived, measured = _changes(pieces, span).reshape(2, -1)
            count, offset = max(1, derived.size), float((measured - derived).sum())
            larger = float(max(derived @ derived, measured @ measured))
            apart = float(np.sum((derived - measured) ** 2))
            floor = floors[not base] * max(1.0, usual / span)  # noise grows as spans shrink
            differs = larger > floor**2 * count and apart > _DIFFERENT**2 * larger
            if count >= _ENOUGH and (differs or (base and abs(offset) > mean * count)):
                wrong.append(
                    f"{upper}.{name} (by {offset / count:.2g} {rate.si} in the mean, "
                    f"{np.sqrt(apart / count):.2g} rms)"
                )
        for body in robot.floating_bodies.values():
            names = [robot.dof_names[k] for k in body.floating_dofs or ()]
            labels = [f"{part}.{name}" for part in (lower, upper) for name in names[:3]]
            labels += [f"q.{name}" for name in names[3:]]
            if held.keys() >= {*labels} and _along_body(looked, [held[one] for one in labels]):
                wrong.append(f"{', '.join(labels[3:6])} (they are once turned from body to world)")
        if wrong:
            text = f"not the change of {lower}: {', '.join(wrong)}; {words}"
            found.append(Finding("warning", "flight", "rates", text))
    return found


def _along_body(looked: _Stretches, items: Sequence[Quantity]) -> bool:
    """Whether rates are changes only once turned from the body to the world.

    Args:
        looked: Stretches of the log.
        items: Three coordinates, their rates, and roll, pitch and yaw.
    """
    stated, turned = list[Piece](), list[Piece]()
    for time, values in looked.of(*items):
        x, rate, angles = np.split(np.hstack(values), 3, axis=1)
        stated.append((time, [x, rate]))
        turned.append((time, [x, Rotation.from_euler("ZYX", angles[:, ::-1]).apply(rate)]))
    span = _span_of(stated, looked.span)
    far, near = (np.diff(_changes(one, span), axis=0) for one in (stated, turned))
    return bool(far.size >= _ENOUGH and _NEARER * (near**2).sum() < (far**2).sum())


def _compare(looked: _Stretches, place: Quantity, rate: Quantity) -> list[Finding]:
    names = f"{place.label} and {rate.label}"
    return _agreement(names, looked.of(place, rate), looked.span, turning=place.is_attitude)


def _agreement(names: str, pieces: Sequence[Piece], most: int, *, turning: bool) -> list[Finding]:
    """Finding that a place, or an attitude, does not move as its rate says."""
    moved, span = turning_rate if turning else _velocity, _span_of(pieces, most)
    changes = _changes(pieces, span, moved)
    derived, measured = changes.reshape(2, -1)
    size, other = np.linalg.norm(derived), np.linalg.norm(measured)
    floor = 0.05 * np.sqrt(len(derived)) * most / span  # rad/s or m/s: less is noise
    if len(derived) < _ENOUGH or max(size, other) < floor or not (size > 0 and other > 0):
        return []
    ratio, correlation = size / other, float(derived @ measured / (size * other))
    facts = f"size ratio {ratio:.4g}, correlation {correlation:.2f}"
    slips = [words for factor, words in _SLIPS[turning] if 1 / 1.3 < ratio / factor < 1.3]
    if slips and abs(correlation) > _SURE:
        kind, doubt = "unit", slips[0]
    # of the same motion, noise makes the derived one larger: the correlation is 1 / ratio
    elif correlation < -_SURE or (correlation < 0.4 and 0.5 < ratio < 2.0):
        kind, doubt = "axes", "check frame, body, order, inverted and the time base"
    elif 0 < correlation < np.cos(_TURN) and _agree_turned(*changes):
        turn = f"turned by {np.degrees(np.arccos(correlation)):.0f} deg in the mean"
        kind, doubt = "axes", f"{turn}; check frame, body and order of both"
    else:
        return []
    return [Finding("warning", names, kind, f"do not agree ({facts}): {doubt}")]


def _agree_turned(derived: Array, measured: Array) -> bool:
    """Whether two rates, (m, 3), agree far better once one is turned by the best rotation."""
    size, product = (derived**2).sum() + (measured**2).sum(), measured.T @ derived
    *most, least = np.linalg.svd(product, compute_uv=False)
    same, best = np.trace(product), sum(most) + np.sign(np.linalg.det(product)) * least
    return bool(_NEARER * (size - 2 * best) < size - 2 * same)


_SLIPS = {
    True: (
        (np.pi / 180, "is the rate in deg/s?"),
        (180 / np.pi, "is the rate in rad/s?"),
        (1e3, "are the stamps in s, not in ms?"),
        (1e-3, "are the stamps in ms, not in s?"),
    ),
    False: (
        (1e3, "position too large or velocity too small by 1000: mm for m?"),
        (1e-3, "position too small or velocity too large by 1000: mm for m?"),
        (1e2, "position too large or velocity too small by 100: cm for m?"),
    ),
}


def _order_findings(looked: _Stretches, attitude: Quantity, place: Quantity) -> list[Finding]:
    order = attitude.order or ""
    other = replace(attitude, order=OTHER_ORDER[order])
    pieces = looked.of(place, attitude, other)
    declared, instead = ([(t, part[0], part[k]) for t, part in pieces] for k in (1, 2))
    names = f"{attitude.label} and {place.label}"
    return order_findings(names, order, declared, instead, looked.span)


def _forces(
    looked: _Stretches, attitude: Quantity, force: Quantity, speed: Quantity | None
) -> tuple[list[Finding], list[dict[str, Any]]]:
    items = (attitude, force) if speed is None else (attitude, force, speed)
    pieces = [
        (time, [*moving, from_quaternion(turned).apply(felt)])
        for time, (turned, felt, *moving) in looked.of(*items)
    ]
    if not pieces:
        return [], []
    mean = np.concatenate([values[-1] for _, values in pieces]).mean(axis=0)
    name = force.label
    fact: dict[str, Any] = {"specific_force": name, "mean_in_world": mean.tolist()}
    if speed is not None:
        change, means = _changes(pieces, looked.span)
        less = means - [0.0, 0.0, GRAVITY] - change
        fact["velocity"] = speed.label
        fact["residual_mean"] = less.mean(axis=0).tolist()
        fact["residual_rms"] = np.sqrt((less**2).mean(axis=0)).tolist()
        fact["residual_std"] = less.std(axis=0).tolist()
        fact["acceleration_rms"] = np.sqrt((change**2).mean(axis=0)).tolist()
        fact["span"] = looked.duration
    return _gravity_findings(name, attitude.label, mean), [fact]


def _gravity_findings(name: str, attitude: str, mean: Array) -> list[Finding]:
    size = float(np.linalg.norm(mean))
    if size < 0.3 * GRAVITY:  # gravity taken out, or another unit: reported elsewhere
        return []
    components = ", ".join(f"{value:.3g}" for value in mean)
    if mean[2] < -0.5 * size:
        doubt = "down; a body that is carried feels up: check frame and body"
    elif np.hypot(mean[0], mean[1]) > _LEVEL * size:
        doubt = "far from upright: check frame, body, order, inverted"
    else:
        return []
    text = f"the mean in the world is ({components}) m/s^2, {doubt}"
    return [Finding("warning", f"{name} and {attitude}", "axes", text)]


def sensor_findings(streams: Sequence[Stream]) -> list[Finding]:
    """Findings about units and axes of the inertial units and cameras of a floating body.

    Args:
        streams: Samples of its sensors, on one clock.
    """
    found: list[Finding] = []
    camera = first_camera(streams)
    if camera is not None:
        found += _sized(f"{camera.name}.position", camera.rows[:, :3], "m")
    for unit in streams:
        if not (isinstance(unit.model, ImuModel) and unit.model.frame.on_base):
            continue
        for k, (kind, si) in enumerate((("specific_force", "m/s^2"), ("angular_rate", "rad/s"))):
            found += _sized(f"{unit.name}.{kind}", unit.rows[:, 3 * k : 3 * k + 3], si)
        if camera is not None and not any(unit.name in one.where for one in found):
            found += _seen_by(camera, unit)
    return found


def _sized(where: str, rows: Array, si: str) -> list[Finding]:
    """Finding that values, (N, 3), do not have the size that their unit suggests."""
    values = ValueSurvey(rows.shape[1])
    values.add(rows)
    if not values.count.all():
        return []
    sizes = sizes_of(values, [*range(rows.shape[1])], si)
    return unit_findings(where, sizes, still=is_still(sizes))


def _seen_by(camera: Stream, unit: Stream) -> list[Finding]:
    """Finding that turning rates or gravity of an inertial unit contradict the cameras."""
    frame, own = camera.model.frame, unit.model.frame
    used, _ = consistent_frames(camera)
    frames = camera.time[used]
    if not frame.on_base or len(frames) < 2:
        return []
    inside = (unit.time >= frames[0]) & (unit.time <= frames[-1])
    inside &= np.isfinite(unit.rows).all(axis=1)
    time, rows = unit.time[inside], unit.rows[inside]
    if len(time) < 2:
        return []
    seen = as_quaternion(
        from_quaternion(camera.rows[used, 3:]) * Rotation.from_matrix(frame.mount.T)
    )
    attitude = slerp(frames, continuous(seen), time)
    force, rate = rows[:, :3] @ own.mount.T, rows[:, 3:] @ own.mount.T
    names = f"{camera.name} and {unit.name}"
    span = max(1, round(_SPAN / median_step(time)))
    mean = from_quaternion(attitude).apply(force).mean(axis=0)
    carried = _LEAST * GRAVITY < np.linalg.norm(mean) < GRAVITY / _LEAST
    found = _agreement(names, [(time, [attitude, rate])], span, turning=True)
    if mean[2] < 0 and carried and not found:  # a start by hand or a turn may lean, never hang
        found += _gravity_findings(unit.name, camera.name, mean)
    return found


def _down_findings(force: Quantity, spool: Spool) -> list[Finding]:
    """Finding that a specific force points down in its own axes, as one with z down would."""
    values = spool.surveys[force.stream].values
    mean = force.converted(values.mean[None, force.places])[0] * force.to_si
    size = float(np.linalg.norm(mean))
    if not _LEAST * GRAVITY < size < GRAVITY / _LEAST or mean[2] > -_ALONG * size:
        return []
    components = ", ".join(f"{value:.3g}" for value in mean)
    text = (
        f"the mean is ({components}) m/s^2 in x forward, y left, z up; a body that hovers, flies "
        "level or rests feels 1 g up: is z down in the log (frame: frd or ned), or the sensor "
        "mounted upside down?"
    )
    return [Finding("warning", force.label, "axes", text)]


def _of_world(item: Quantity) -> bool:
    return (item.column.frame or "").strip().lower() in _WORLDS

"""Findings about a log with a mapping: its stamps, sizes, units, ranges, attitudes and flight.

Networks of strips compute the flow at each wing from the joints. Where no joint was measured, or
none of them ever moves in the log, all that flow follows from the body, and a strip knows nothing
about the wings.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from patagium.errors import LogError
from patagium.robot import Robot
from patagium.sensing.force.air_force import HELD, flight_labels
from patagium.sensing.logs.axes import is_rotation
from patagium.sensing.logs.files.channels import some
from patagium.sensing.logs.files.table_files import nanoseconds_in, unit_of_suffix
from patagium.sensing.logs.importing.findings import (
    SENSED,
    Finding,
    is_still,
    number_findings,
    recorder_findings,
    sizes_of,
    stamp_findings,
    unit_findings,
)
from patagium.sensing.logs.importing.plan import Plan, Quantity, coordinates
from patagium.sensing.logs.importing.resample import CHUNK, Spool, TimeBase
from patagium.sensing.logs.mapping import conversion, si_of
from patagium.sensing.logs.record import WIND


def log_findings(spool: Spool, base: TimeBase) -> list[Finding]:
    """Findings about the stamps and numbers of a log, before it is resampled.

    Raises:
        LogError: If most rows of an attitude are no rotation matrices, or a coordinate of a flight
            is in a unit of another dimension.
    """
    plan, log, mapping = spool.plan, spool.plan.log, spool.plan.mapping
    flown, units = coordinates(plan.items, plan.robot), flight_labels(plan.robot)
    found = [Finding("note", str(log.path), "file", note) for note in log.notes]
    found += spool.findings
    for name, wanted, survey in zip(plan.names, plan.wanted, spool.surveys, strict=True):
        topic = log.topics[wanted.topic]
        own = topic.kind != "table" and wanted.base == topic.base  # a unit of the format
        written = wanted.base.kind == "column" and not own
        kept = mapping.time.duplicates
        found += stamp_findings(name, survey.stamps, mapping.gap, written=written, kept=kept)
        if written and (channel := topic.channels[wanted.base.column]).unit:
            stated = nanoseconds_in(channel.unit) if channel.dtype != "timestamp" else 0.0
            if stated and abs(wanted.base.factor / stated - 1.0) > 1e-9:
                text = f"the file states [{channel.unit}], "
                text += f"the mapping [{wanted.base.factor / 1e9:g} s]"
                found.append(Finding("warning", f"{name}, its stamps", "unit", text))
        median = survey.stamps.median
        if base.step > 2.01 * median:
            brought = f"every {median:.4g} s, brought to every {base.step:.4g} s"
            text = f"{brought} without a filter: what is faster folds"
            found.append(Finding("warning", name, "rate", text))
    still = any(
        is_still(sizes_of(spool.surveys[item.stream].values, item.places, item.column.unit))
        for item in plan.items
        if item.si == "m/s^2"
    )
    for item in plan.items:
        label = next((one for one in item.column.labels if one in flown), "")
        conversion(item.column.unit, units.get(label), f"mapping: {item.label}")
        found += _item_findings(item, spool, bool(label), still)
        for check in _CHECKS:
            found += check(item, spool)
    if plan.robot is not None:
        found += _flight_findings(plan.robot, spool)
    return found


def _item_findings(item: Quantity, spool: Spool, flown: bool, still: bool) -> Iterator[Finding]:
    """Findings about numbers, size and unit of a quantity, `flown` if a coordinate of a robot."""
    name, values = item.label, spool.surveys[item.stream].values
    yield from number_findings(name, values, item.places, "" if flown else "warning")
    if item.column.turn and spool.surveys[item.stream].stamps.gaps(spool.plan.mapping.gap):
        text = f"whole turns ({item.turn:g}) in a gap are not counted: it may be off after it"
        yield Finding("warning", name, "jump", text)
    if (flown and item.si == "m/s^2") or _is_change(item, spool):  # need not show gravity
        return
    if item.order in _WITH_UNIT:
        same = item.stream, item.column.unit
        alike = [one for one in spool.plan.items if (one.stream, one.column.unit) == same]
        others = [place for one in alike for place in one.places]
        sizes = sizes_of(values, item.places, item.column.unit, item.column.offset, others=others)
        yield from unit_findings(name, sizes, still=still)
        return
    norm = float(np.sqrt((values.rms[item.places] ** 2).sum()))
    if item.order != "matrix" and abs(norm - 1.0) > 0.01:
        text = f"expected quaternions of norm 1, found {norm:.4g} (rms, with zeros); scaled to 1"
        yield Finding("warning", name, "attitude", text)


_WITH_UNIT = (None, "rpy", "rotvec")
"""Orders of components that have a unit."""


def _is_change(item: Quantity, spool: Spool) -> bool:
    """Whether a rate v is as large as the coordinate q of its name changes: its unit is right."""
    kind, _, name = item.label.partition(".")
    rms = spool.surveys[item.stream].values.rms[item.places[0]] * item.si_factor
    for one in spool.plan.items if kind == "v" and item.si == "rad/s" else ():
        if one.label == f"q.{name}" and one.si == "rad":
            survey = spool.surveys[one.stream]
            change = survey.values.change[one.places[0]] * one.si_factor / survey.stamps.median
            return bool(rms / _APART < change < _APART * rms)
    return False


_APART = 7.5
"""Ratio of a rate to a change from which they may be in rad and in deg: the root of 57."""


def _wind_findings(item: Quantity, spool: Spool) -> list[Finding]:
    """Finding that the wind in a log is not the one that the mapping states for all of it.

    None of one named `wind`, or `wind.x`, which `identify` and `motion` follow.
    """
    name, places, values = item.label, item.places, spool.surveys[item.stream].values
    if spool.plan.robot is None or item.si != "m/s" or _WIND.search(name) is None:
        return []
    if not values.count[places].all() or set(WIND) & set(item.column.labels):
        return []
    sizes = sizes_of(values, places, item.column.unit, item.column.offset)
    speed, stated = (float(np.linalg.norm(k)) for k in (sizes.mean, spool.plan.mapping.air.wind))
    spread = np.maximum(values.rms[places] ** 2 - values.mean[places] ** 2, 0.0)
    change = float(np.sqrt(spread.sum())) * item.si_factor
    text = f"is {speed:.3g} m/s in the mean, and `air` of the mapping says a wind of {stated:.3g}"
    if change > max(_STEADY * speed, _CALM):
        text = f"changes by {change:.2g} m/s (rms) about {speed:.3g}; a wind that changes needs "
        text += "`name: wind` (a vector, with `frame`) or `name: wind.x`"
    elif abs(speed - stated) <= max(_STEADY * speed, _CALM):
        return []
    return [Finding("warning", name, "wind", text)]


_WIND = re.compile(r"(?i)(^|[^a-z])(wind|tunnel)")
_STEADY, _CALM = 0.1, 0.2
"""Share of the wind, and wind [m/s], by which it may be another."""


def _recorder_findings(item: Quantity, spool: Spool) -> Iterator[Finding]:
    """Findings about numbers that the recorder made, in the first samples of a quantity."""
    count = min(CHUNK, spool.surveys[item.stream].stamps.kept)
    stamps, first = spool.stamps_of(item.stream)[:count], spool.values_of(item, 0, count)
    single = item.column.size == 1
    measured = item.role == "output" or (item.si in SENSED and not single)
    joint = spool.plan.robot is not None and single and item.si in ("rad", "m")
    for numbers in () if item.is_attitude else first.T:
        yield from recorder_findings(
            item.label, stamps, numbers, spool.plan.mapping.gap,
            measured=measured, joint=joint, turn=item.turn,
        )  # fmt: skip


def _matrix_findings(item: Quantity, spool: Spool) -> list[Finding]:
    """Finding about rows of an attitude that are no rotation matrices.

    Raises:
        LogError: If most rows are none.
    """
    if item.order != "matrix":
        return []
    name, rows, bad, worst = item.label, 0, 0, np.empty((0, 9))
    for block in spool.blocks_of(item):
        matrices = block[np.isfinite(block).all(axis=1)]
        lost = matrices[~is_rotation(matrices)]
        rows, bad = rows + len(matrices), bad + len(lost)
        worst = lost[:1] if not len(worst) else worst
    if not bad:
        return []
    shown = ", ".join(f"{entry:.3g}" for entry in worst[0])
    text = f"{bad} of {rows} rows are no rotation matrix, such as ({shown})"
    if 2 * bad > rows:
        raise LogError(
            f"{spool.plan.log.path}: {name}: expected rotation matrices, nine entries row by row, "
            f"with rows of length 1 at right angles and determinant 1, but {text}, of determinant "
            f"{np.linalg.det(worst[0].reshape(3, 3)):.3g}; check the order of the columns, and "
            "that none is scaled or mirrored"
        )
    return [Finding("warning", name, "attitude", f"{text}; left out")]


def _range_findings(item: Quantity, spool: Spool) -> list[Finding]:
    """Finding that numbers leave the range that the mapping states."""
    words, places, values = item.column, item.places, spool.surveys[item.stream].values
    if words.range is None:
        return []
    low, high = words.range
    least, most = low - 1e-9 * (high - low), high + 1e-9 * (high - low)  # of rounding
    ends = float(values.low[places].min()), float(values.high[places].max())
    if ends[0] >= least and ends[1] <= most:
        return []
    count, outside = spool.surveys[item.stream].stamps.kept, 0
    for rows in spool.blocks_of(item):
        outside += int(((rows < least) | (rows > most)).any(axis=1).sum())
    text = (
        f"{outside} of {count} rows leave the stated range [{low:g}, {high:g}] {words.unit}: "
        f"they reach from {ends[0]:.6g} to {ends[1]:.6g}; networks are scaled by it: state what "
        "the quantity can reach, or check its unit"
    )
    return [Finding("warning", words.label, "range", text)]


def _stated_unit(item: Quantity, spool: Spool) -> list[Finding]:
    """Finding that the file states another unit, or order of a quaternion, than the mapping."""
    wanted = spool.plan.wanted[item.stream]
    topic = spool.plan.log.topics[wanted.topic]
    path = wanted.fields[item.places[0]]
    stated = topic.channels[path].unit
    if not stated and item.column.unit in ("g", "G"):
        stated = unit_of_suffix(f"{path}_g")
    named = "".join(wanted.fields[k][-1:].lower() for k in item.places)
    if sorted(named) == list("wxyz") and item.order and named != item.order:
        text = f"the mapping says order: {item.order}, but its columns are named {named}"
        return [Finding("warning", item.label, "attitude", text)]
    if not stated or item.order not in _WITH_UNIT:
        return []
    factor, si = si_of(stated)
    if not si or (si == item.si and abs(factor / item.si_factor - 1.0) < 1e-9):
        return []
    if "Twist" in topic.kind and item.si == f"{si}^2":
        return []  # an acceleration, for which ROS has no widely used message of its own
    text = f"the file or its definitions say [{stated}], the mapping [{item.column.unit}]"
    return [Finding("warning", item.label, "unit", text)]


_CHECKS = _range_findings, _recorder_findings, _wind_findings, _matrix_findings, _stated_unit
_DENSE = (
    "networks of strips are pointless without them: map measured angles, or learn a dense network "
    "of inputs and outputs (`--network dense`)"
)
_LITTLE = 0.7
"""Motion of joints that is rather one in radians [deg]."""


def zero_forces(plan: Plan) -> dict[str, str]:
    """Units of joint forces that are zero without a motor, where a log lacks only these."""
    held, robot = {label for item in plan.items for label in item.column.labels}, plan.robot
    missing = {name: unit for name, unit in flight_labels(robot).items() if name not in held}
    unforced = {f"u1.{robot.dof_names[k]}" for k in robot.passive} if robot else ()
    return missing if missing.keys() <= set(unforced) else {}


def _flight_findings(robot: Robot, spool: Spool) -> list[Finding]:
    """Findings about coordinates that were not measured, or that never change."""
    plan, surveys = spool.plan, spool.surveys
    wanted, held = flight_labels(robot), coordinates(plan.items, robot)
    if not held:
        text = f"names no q, v, a, u1 of {robot.name!r}: the log is no flight of it yet"
        return [Finding("note", "mapping", "flight", text)]
    seen = {name: (surveys[one.stream].values, one.places[0]) for name, one in held.items()}
    still = [name for name, (values, k) in seen.items() if values.low[k] == values.high[k]]
    found: list[tuple[str, str, str]] = []
    if still:
        found.append(("note", "constant", f"never change: {', '.join(still)}"))
    names = [name for k, name in enumerate(robot.dof_names) if k not in robot.floating_dofs]
    joints = {f"q.{name}": name for name in names}
    moved = []
    for label in joints.keys() & held.keys():
        values, place = seen[label]
        if held[label].column.unit in ("deg", "degree", "°") and not values.noise[place]:
            moved.append(float(values.high[place] - values.low[place]))
    if 0 < max(moved, default=0.0) < _LITTLE:
        text = f"no joint in deg moves by more than {max(moved):.2g} deg; are they in rad?"
        found.append(("warning", "unit", text))
    text = ""
    if unmeasured := [name for label, name in joints.items() if label not in held]:
        text = f"no q of {some(unmeasured, 6)}, joints of {robot.name!r}"
    elif joints.keys() <= set(still):
        text = f"no joint moves in the whole log: were {some(names, 6)} measured? If not"
    if text and robot.strips and joints:
        found.append(("warning", "joints", f"{text}, {_DENSE}"))
    if plan.zero:
        text = f"taken as zero, as no motor is there: {', '.join(plan.zero)}"
        found.append(("note", "missing", text))
    base = {f"{kind}.{robot.dof_names[k]}" for kind in "qv" for k in robot.floating_dofs}
    if plan.zero and base and base <= set(still):
        found.append(("warning", "held", HELD))
    if missing := sorted(wanted.keys() - held.keys() - joints.keys() - plan.zero.keys()):
        text = f"found no {some(missing, 6)}: the log is no flight of {robot.name!r} yet"
        found.append(("note", "missing", text))
    return [Finding(level, "flight", kind, text) for level, kind, text in found]

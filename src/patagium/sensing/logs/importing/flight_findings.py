"""Findings about a log of a robot's flight: which of its coordinates were measured at all.

Networks of strips compute the flow at each wing from the joints. Where no joint was measured, or
none of them ever moves in the log, all that flow follows from the body, and a strip knows nothing
about the wings.
"""

from __future__ import annotations

from patagium.robot import Robot
from patagium.sensing.force.air_force import packet_columns
from patagium.sensing.logs.files.channels import some
from patagium.sensing.logs.importing.findings import Finding, StreamSurvey
from patagium.sensing.logs.importing.plan import Plan

_DENSE = (
    "networks of strips are pointless without them: map measured angles, or learn a dense network "
    "of inputs and outputs (`--network dense`)"
)
_LITTLE = 0.7
"""Motion of joints that is rather one in radians [deg]."""


def flight_labels(robot: Robot | None) -> dict[str, str]:
    """Units of the numbers that make a log a flight of a robot, by name; none without a robot."""
    return {} if robot is None else {c.name: c.unit for c in packet_columns(robot)[1:]}


def zero_forces(robot: Robot | None, plan: Plan) -> dict[str, str]:
    """Units of joint forces that are zero without a motor, where a log lacks only these."""
    held = {label for item in plan.items for label in item.column.labels}
    missing = {name: unit for name, unit in flight_labels(robot).items() if name not in held}
    unforced = {f"u1.{robot.dof_names[k]}" for k in robot.passive} if robot else ()
    return missing if missing.keys() <= set(unforced) else {}


def flight_findings(robot: Robot, plan: Plan, surveys: tuple[StreamSurvey, ...]) -> list[Finding]:
    """Findings about coordinates that were not measured, or that never change."""
    wanted = flight_labels(robot)
    held = {item.column.label: item for item in plan.items if item.column.label in wanted}
    if not held:
        text = f"names no q, v, a, u1 of {robot.name!r}: the log is no flight of it yet"
        return [Finding("note", "mapping", "flight", text)]
    still = [
        name
        for name, item in held.items()
        if (values := surveys[item.stream].values).low[item.places[0]]
        == values.high[item.places[0]]
    ]
    found = []
    if still:
        found.append(Finding("note", "flight", "constant", f"never change: {', '.join(still)}"))
    joints = [name for k, name in enumerate(robot.dof_names) if k not in robot.floating_dofs]
    moved = []
    for name in (name for name in joints if f"q.{name}" in held):
        item = held[f"q.{name}"]
        values, place = surveys[item.stream].values, item.places[0]
        if item.column.unit in ("deg", "degree", "°") and not values.noise[place]:
            moved.append(float(values.high[place] - values.low[place]))
    if 0 < max(moved, default=0.0) < _LITTLE:
        text = f"no joint in deg moves by more than {max(moved):.2g} deg; are they in rad?"
        found.append(Finding("warning", "flight", "unit", text))
    unmeasured = [name for name in joints if f"q.{name}" not in held]
    text = ""
    if unmeasured:
        text = f"no q of {some(unmeasured, 6)}, joints of {robot.name!r}"
    elif {f"q.{name}" for name in joints} <= set(still):
        text = f"no joint moves in the whole log: were {some(joints, 6)} measured? If not"
    if text and robot.strips and joints:
        found.append(Finding("warning", "flight", "joints", f"{text}, {_DENSE}"))
    if plan.zero:
        text = f"taken as zero, as no motor is there: {', '.join(plan.zero)}"
        found.append(Finding("note", "flight", "missing", text))
    base = {f"{kind}.{robot.dof_names[k]}" for kind in "qv" for k in robot.floating_dofs}
    if plan.zero and base and base <= set(still):
        text = "the body never moves: what holds it has a force, which is taken for that of the air"
        text += "; import a load cell (`cell.force`, `cell.moment`) and use patagium motion, or "
        text += "leave out `floating` in the robot file"
        found.append(Finding("warning", "flight", "held", text))
    missing = sorted(set(wanted) - set(held) - {f"q.{name}" for name in joints} - plan.zero.keys())
    if missing:
        text = f"found no {some(missing, 6)}: the log is no flight of {robot.name!r} yet"
        found.append(Finding("note", "flight", "missing", text))
    return found

"""Every number of every robot file moves an output; generated from the files and the schema."""

import copy
from collections.abc import Iterator
from typing import Any, get_args

import casadi as ca
import numpy as np
import pytest
import yaml
from pydantic import BaseModel, ValidationError

from patagium.dynamics import equations, kinematics
from patagium.robot import Robot, load_robot_text, preset_names, preset_text
from patagium.robot.assembly import AssemblyError, assemble
from patagium.robot.schema import RobotFile
from patagium.robot.units import UnitMismatch, in_si
from patagium.simulation.mounts import on_massless_mount

# A robot that says everything a robot file can say: the test below holds it to that.
COMPLETE = """
name: complete
gravity: 9.8 m/s^2
coordinates: [z, y, x, roll, pitch, yaw, left_flap, left_slide, right_flap, right_slide, swing,
  left_wing_bend_1, left_wing_twist_1, left_wing_bend_2, left_wing_twist_2,
  right_wing_bend_1, right_wing_twist_1, right_wing_bend_2, right_wing_twist_2]
parameters: {tail.mass: 3.1e-3}
bodies:
  hull:
    floating: true
    attitude: quaternion
    mass: 20 g
    center_of_mass: [1 mm, 2 mm, 3 mm]
    inertia: {xx: 2e-5, yy: 3e-5, zz: 4e-5, xy: 1e-6, xz: 2e-6, yz: 3e-6}
    damping: {x: 0.1, y: 0.2, z: 0.3, roll: 0.01, pitch: 0.02, yaw: 0.03}
  left_wing:
    parent: hull
    at: [1 cm, 2 cm, 3 cm]
    orientation: [5 deg, 6 deg, 7 deg]
    joints:
      - {name: left_flap, type: revolute, axis: [1, 0.2, 0.1], limits: [-1, 1], damping: 0.1,
         speed_limit: 3, acceleration_limit: 40, effort_limit: 0.5, power_limit: 2 W}
      - {name: left_slide, type: prismatic, axis: y, limits: [0, 2 cm], passive: true, damping: 1,
         stiffness: 30, rest: 1 cm}
    mass: 4 g
    center_of_mass: [1 mm, 4 cm, 1 mm]
    shape: {type: plate, axis: y, chord: 5 cm, span: 10 cm, thickness: 3 mm}
    flexible: {elements: 2, bending: 0.1 N m^2, torsion: 0.2 N m^2, damping: 1 ms}
  boom:
    parent: hull
    at: [-5 cm, 0, 0]
    joints: [{name: swing, axis: z}]
    mass: 3 g
    shape: {type: cylinder, axis: x, radius: 3 mm, length: 5 cm}
  tail:
    parent: boom
    at: [-5 cm, 0, 1 cm]
    mass: 3 g
    shape: {type: ellipsoid, semi_axes: [3 cm, 4 cm, 5 cm]}
  nose:
    parent: hull
    at: [5 cm, 0, 0]
    mass: 2 g
    shape: {type: point}
  ballast:
    parent: boom
    at: [1 cm, 1 cm, 1 cm]
    mass: 2 g
    shape: {type: box, size: [3 cm, 4 cm, 5 cm]}
  sensor: {parent: nose, massless: true}
wings:
  - name: left_wing
    joins: [rudder]
    segments:
      - body: left_wing
        strips: 3
        at: [1 mm, 2 mm, 3 mm]
        stations:
          - {span: 0 cm, leading: 2 cm, trailing: -3 cm, incidence: 5 deg}
          - {span: 10 cm, leading: 2 cm, trailing: -1 cm, incidence: 2 deg}
  - name: rudder
    segments:
      - body: tail
        strips: 1
        span_axis: [0, 0.1, 1]
        stations:
          - {span: 0, leading: 0, trailing: -3 cm}
          - {span: 5 cm, leading: 0, trailing: -2 cm}
mirror: [{from: left, to: right}]
cruise:
  frequency: 5 Hz
  amplitude: {flap: 20 deg, swing: 0.1}
  phase: {flap: 30 deg}
  offset: {swing: -0.05 rad}
  speed: 4 m/s
  pitch: -5 deg
  duration: 2 s
actuators:
  frequency: {range: [1 Hz, 9 Hz], rate_limit: 5 Hz/s, response_time: 0.1 s, cost: 2}
"""
TEXTS = {**{name: preset_text(name) for name in preset_names()}, "complete": COMPLETE}
# Names and words; a change of the text itself is no parameter.
NOT_PHYSICS = {"coordinates", "name", "type", "body", "parent", "from", "to", "passive", "floating"}
# Replaced by an override, a zero that cannot be anything else, and a number of joints.
FIXED = {
    ("bodies", "tail", "mass"),
    ("wings", 1, "segments", 0, "span_axis", 0),
    ("bodies", "left_wing", "flexible", "elements"),
}


def _leaves(node: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    if isinstance(node, dict):
        for key, value in node.items():
            if key not in NOT_PHYSICS:
                yield from _leaves(value, (*path, key))
    elif isinstance(node, list):
        for i, value in enumerate(node):
            yield from _leaves(value, (*path, i))
    elif not isinstance(node, bool) and str(node).lstrip("+-.")[:1].isdigit():
        yield path


def _changed(described: Any, path: tuple[Any, ...], by: float) -> Any:
    """The file with one number changed by a fraction, or from zero by as much."""
    described = copy.deepcopy(described)
    holder = described
    for key in path[:-1]:
        holder = holder[key]
    written = holder[path[-1]]
    if path[-1] == "strips":
        holder[path[-1]] = written + 1
        return described
    number, _, unit = str(written).partition(" ")
    value = float(number)
    value = value * (1 + by) if value else abs(by) * 0.1
    holder[path[-1]] = f"{value!r} {unit}".strip()
    return described


def _neighbor(described: Any, path: tuple[Any, ...]) -> Robot:
    """A robot with one number changed, up if the file allows it, else down."""
    for by in (1e-3, -1e-3):
        try:
            changed = _changed(described, path, by)
            return assemble(RobotFile.model_validate(changed), "")
        except (ValidationError, AssemblyError):
            continue
    raise AssertionError(f"{path} can be neither raised nor lowered")


def _structure(robot: Robot) -> tuple[Any, ...]:
    """What is written into the equations: which numbers are zero, axes, orientations."""
    joints = [(b.orientation, b.joints, b.parent) for b in robot.bodies]
    return robot.parameter_names, joints, [s.body for s in robot.strips]


def _cruise(robot: Robot) -> list[float]:
    """Numbers of the flight where nothing else is asked for; none where the file has none."""
    own = robot.cruise
    if own is None:
        return []
    joints = [k for by_name in (own.amplitude, own.phase, own.offset) for k in by_name.values()]
    return [own.frequency or 0.0, own.speed, own.pitch, own.duration, *joints]


def _actuators(robot: Robot) -> list[float]:
    """Numbers of the commands that gaits and controllers obey."""
    return [
        number
        for one in robot.actuators.values()
        for number in (*one.range, one.rate_limit, one.response_time or 0.0, one.cost)
    ]


class _Outputs:
    """What the layers above read off a robot, as one vector of numbers."""

    def __init__(self, robot: Robot) -> None:
        self._structure = _structure(robot)
        self._function = self._compiled(robot)

    def __call__(self, robot: Robot) -> np.ndarray:
        function = self._function
        if _structure(robot) != self._structure:
            function = self._compiled(robot)
        moving = np.array(function(robot.parameters))[:, 0]
        strips = [
            (*s.forward, *s.normal, s.chord, s.width, s.chord * s.width) for s in robot.strips
        ]
        limits = np.nan_to_num(
            [
                *(robot.lower, robot.upper, robot.speed_limit or robot.upper),
                *(robot.acceleration_limit or robot.upper, robot.effort_limit or robot.upper),
                robot.power_limit or robot.upper,
            ],
            posinf=99,
            neginf=-99,
        )
        said = np.nan_to_num([*_cruise(robot), *_actuators(robot)], posinf=99)
        return np.concatenate([moving, np.ravel(strips), limits.ravel(), said])

    @staticmethod
    def _compiled(robot: Robot) -> ca.Function:
        symbolic, symbols = robot.symbolic()
        if not robot.floating:  # the reaction of the ground is an output of every flight
            symbolic = on_massless_mount(symbolic)
        rng = np.random.default_rng(5)
        q = ca.SX(rng.uniform(0.3, 1.0, symbolic.coordinate_count))
        v, a = (ca.SX(rng.uniform(0.3, 1.0, symbolic.dof)) for _ in range(2))
        poses = kinematics.body_poses(symbolic, q)
        points = [
            poses[s.body].position + poses[s.body].rotation @ ca.vertcat(*s.quarter_chord)
            for s in symbolic.strips
        ]
        outputs = [
            equations.inverse(symbolic, q, v, a),
            equations.damping_force(symbolic, v),
            equations.center_of_mass(symbolic, q),
            *points,
        ]
        return ca.Function("outputs", [symbols], [ca.vertcat(*outputs)])


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.usefixtures("interpreted")
def test_every_number_of_the_file_moves_an_output(name):
    described = yaml.safe_load(TEXTS[name])
    robot = load_robot_text(TEXTS[name])
    outputs = _Outputs(robot)
    before = outputs(robot)
    leaves = [path for path in _leaves(described) if path not in FIXED]
    assert len(leaves) > 20
    dead = []
    for path in leaves:
        after = outputs(_neighbor(described, path))
        same_size = after.shape == before.shape
        # a thousandth of the smallest inertia is far above the rounding of its sums
        if same_size and not np.any(np.abs(after - before) > 1e-11 * np.abs(before)):
            dead.append(".".join(str(k) for k in path))
    assert not dead


@pytest.mark.parametrize("name", preset_names())
def test_every_run_time_parameter_moves_an_output(name):
    robot = load_robot_text(preset_text(name))
    outputs = _Outputs(robot)
    before = outputs(robot)
    for parameter, value in zip(robot.parameter_names, robot.parameters, strict=True):
        after = outputs(robot.with_parameters({parameter: 1.001 * value}))
        assert np.any(np.abs(after - before) > 1e-11 * np.abs(before)), parameter


def test_the_complete_robot_says_all_that_the_schema_allows():
    said: dict[type[BaseModel], set[str]] = {}

    def visit(part: Any) -> None:
        if isinstance(part, BaseModel):
            said.setdefault(type(part), set()).update(part.model_fields_set)
            for name in type(part).model_fields:
                visit(getattr(part, name))
        elif isinstance(part, (tuple, list)):
            for below in part:
                visit(below)
        elif isinstance(part, dict):
            visit(list(part.values()))

    visit(RobotFile.model_validate(yaml.safe_load(COMPLETE)))
    for part in _parts(RobotFile):
        assert said.get(part, set()) == set(part.model_fields), part.__name__


def _parts(model: type[BaseModel], known: set[type[BaseModel]] | None = None) -> set[Any]:
    """All parts that a model can hold, itself included."""
    known = set() if known is None else known
    known.add(model)

    def visit(annotation: Any) -> None:
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            if annotation not in known:
                _parts(annotation, known)
        for below in get_args(annotation):
            visit(below)

    for field in model.model_fields.values():
        visit(field.annotation)
    return known


@pytest.mark.parametrize(
    ("name", "parameter", "index"),
    [("aerobat", "body.mass", 2), ("aerobat-beta", "left_distal.mass", 2)],
)
def test_a_heavier_part_weighs_more(name, parameter, index):
    robot = load_robot_text(preset_text(name))
    value = dict(zip(robot.parameter_names, robot.parameters, strict=True))[parameter]
    q = ca.SX(np.zeros(robot.dof))

    def weight(machine: Robot) -> float:
        return float(ca.DM(equations.gravity_force(machine, q)[index]))

    heavier = weight(robot.with_parameters({parameter: value + 1e-3}))
    assert heavier - weight(robot) == pytest.approx(9.8e-3, rel=1e-12)


def test_every_written_number_has_a_unit_that_is_read():
    """The leaves above are found by their looks: here the reader agrees with them."""
    for text in TEXTS.values():
        described = yaml.safe_load(text)
        for path in _leaves(described):
            written = described
            for key in path:
                written = written[key]
            assert any(_is_read(written, unit) for unit in _UNITS), path


_UNITS = (
    "m",
    "kg",
    "rad",
    "m/s^2",
    "kg m^2",
    "N s/m",
    "N/m",
    "N m^2",
    "N m s/rad",
    "rad/s",
    "N m",
    "m/s",
    "Hz",
    "Hz/s",
    "W",
    "s",
    "",
)


def _is_read(written: object, unit: str) -> bool:
    try:
        in_si(written, unit, "a quantity")
    except UnitMismatch:
        return False
    return True

"""A robot file becomes the robot it describes, or says where it does not."""

import re

import numpy as np
import pytest

from patagium.errors import ParameterError, RobotFileError, RobotFileWarning
from patagium.robot import load_robot, load_robot_text, preset_text
from patagium.robot.model import Actuator
from patagium.robot.review import robot_warnings

GLIDER = """
name: glider
gravity: 9.81
bodies:
  left_tip:
    parent: left_wing
    at: [1 cm, 20 cm, 2 cm]
    orientation: [10 deg, 20 deg, 30 deg]
    joints:
      - name: left_slide
        type: prismatic
        axis: [0, 3, 4]
        limits: [-1 cm, 2 cm]
        damping: 0.1 N s/m
      - {name: left_fold, axis: -z, limits: [-30 deg, 1], passive: true}
    mass: 5 g
    center_of_mass: [1 mm, 2 mm, 3 mm]
    inertia: {xx: 2e-6, yy: 3e-6, zz: 4e-6, xy: 1e-7, xz: 2e-7, yz: 3e-7}
  hull:
    floating: true
    mass: 100 g
    shape: {type: ellipsoid, semi_axes: [10 cm, 3 cm, 3 cm]}
    damping: {x: 0.5, yaw: 0.01}
  fin:
    parent: hull
    at: [-20 cm, 0, 0]
    mass: 2 g
    shape: {type: plate, axis: z, chord: 3 cm, span: 5 cm, thickness: 1 mm}
  left_wing:
    parent: hull
    at: [0, 3 cm, 0]
    mass: 10 g
    shape: {type: box, size: [5 cm, 20 cm, 1 mm]}
wings:
  - name: left_main
    segments:
      - body: left_wing
        strips: 2
        stations:
          - {span: 0, leading: 0.03, trailing: -0.03}
          - {span: 0.2, leading: 0.03, trailing: -0.03}
      - body: left_tip
        strips: 1
        stations:
          - {span: 0, leading: 0.03, trailing: -0.03}
          - {span: 0.1, leading: 0, trailing: 0}
  - name: rudder
    segments:
      - body: fin
        strips: 1
        span_axis: z
        stations:
          - {span: 0, leading: 0, trailing: -0.03}
          - {span: 0.05, leading: 0, trailing: -0.03}
mirror:
  - {from: left, to: right}
"""


@pytest.fixture(scope="module")
def glider():
    return load_robot_text(GLIDER)


def test_parents_come_before_children(glider):
    names = [b.name for b in glider.bodies]
    assert set(names) == {"hull", "fin", "left_wing", "left_tip", "right_wing", "right_tip"}
    assert all(b.parent < i for i, b in enumerate(glider.bodies))
    tip = glider.bodies[names.index("right_tip")]
    assert names[tip.parent] == "right_wing"


def test_a_body_without_joints_is_fixed_and_adds_no_coordinate(glider):
    fin = glider.bodies[glider.body_index("fin")]
    assert fin.joints == () and fin.floating_dofs is None
    assert glider.dof == 6 + 2 + 2


def test_joints_keep_kind_axis_limits_damping_and_passivity(glider):
    slide, fold = glider.index("left_slide"), glider.index("left_fold")
    first, second = glider.bodies[glider.body_index("left_tip")].joints
    assert (first.kind, second.kind) == ("prismatic", "revolute")
    assert first.axis == pytest.approx((0, 0.6, 0.8), rel=1e-15)
    assert (glider.dof_units[slide], glider.dof_units[fold]) == ("m", "rad")
    assert (glider.lower[slide], glider.upper[slide]) == (-0.01, 0.02)
    assert glider.lower[fold] == pytest.approx(-np.pi / 6, rel=1e-15)
    assert glider.upper[fold] == 1.0
    assert glider.damping[slide] == 0.1
    assert glider.damping[glider.index("x")] == 0.5
    assert slide in glider.actuated and fold in glider.passive


def test_the_mirror_reflects_everything_in_y(glider):
    left = glider.bodies[glider.body_index("left_tip")]
    right = glider.bodies[glider.body_index("right_tip")]
    flip = np.diag([1.0, -1.0, 1.0])
    np.testing.assert_array_equal(right.position, flip @ left.position)
    np.testing.assert_array_equal(right.center_of_mass, flip @ left.center_of_mass)
    turned = flip @ np.array(left.orientation) @ flip
    np.testing.assert_allclose(right.orientation, turned, atol=1e-16)
    signs = (1, 1, 1, -1, 1, -1)
    assert right.inertia == tuple(s * k for s, k in zip(signs, left.inertia, strict=True))
    assert right.joints[0].axis == pytest.approx((0, -0.6, 0.8), rel=1e-15)  # polar
    assert right.joints[1].axis == (0, 0, 1)  # axial
    assert right.joints[0].name == "right_slide"


def test_mirrored_strips_share_chord_and_flip_vectors(glider):
    left = [s for s in glider.strips if s.wing == "left_main"]
    right = [s for s in glider.strips if s.wing == "right_main"]
    assert len(left) == len(right) == 3
    for a, b in zip(left, right, strict=True):
        assert b.mirrored and not a.mirrored
        assert b.name == a.name.replace("left", "right")
        assert glider.bodies[b.body].name == glider.bodies[a.body].name.replace("left", "right")
        assert (b.chord, b.width, b.normal, b.forward) == (a.chord, a.width, a.normal, a.forward)
        assert b.quarter_chord == (a.quarter_chord[0], -a.quarter_chord[1], a.quarter_chord[2])


def test_a_vertical_tail_has_its_normal_across(glider):
    (rudder,) = [s for s in glider.strips if s.wing == "rudder"]
    assert rudder.normal == (0, -1, 0)
    assert rudder.quarter_chord == pytest.approx((-0.0075, 0, 0.025), rel=1e-14)


def test_orientation_is_yaw_pitch_roll(glider):
    roll, pitch, yaw = np.radians([10, 20, 30])
    tip = np.array(glider.bodies[glider.body_index("left_tip")].orientation)
    x_axis = [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)]
    np.testing.assert_allclose(tip[:, 0], x_axis, rtol=1e-14)
    np.testing.assert_allclose(
        tip[2, 1:], [np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)]
    )


def test_coordinates_can_be_put_in_any_order():
    text = load_robot("yeo-wing").source + "\ncoordinates: [right_plunge, left_plunge]\n"
    robot = load_robot_text(text)
    assert robot.dof_names == ("right_plunge", "left_plunge")
    assert {b.name: b.joints[0].dof for b in robot.bodies} == {"left_wing": 1, "right_wing": 0}


def test_a_parameter_that_cannot_be_is_refused():
    robot = load_robot("yeo-wing")
    for name, value in (("left_wing.mass", -1.0), ("gravity", np.nan), ("wingmass", 1.0)):
        with pytest.raises(ParameterError, match=name):
            robot.with_parameters({name: value})


FAULTS = {
    "unit of another dimension": (
        ("mass: 5 g", "mass: 5 cm"),
        "bodies.left_tip.mass",
        "a mass such as '20 g'",
        "of dimension [length]",
    ),
    "misspelled key": (
        ("mass: 5 g", "mas: 5 g"),
        "bodies.left_tip.mas",
        "one of the keys at,",
        "'mas'; did you mean mass?",
    ),
    "missing key": (("mass: 5 g", ""), "bodies.left_tip.mass", "`mass: 20 g`", "nothing"),
    "number of words": (("9.81", "strong"), "gravity", "an acceleration", "'strong'"),
    "negative mass": (("mass: 5 g", "mass: -5 g"), "bodies.left_tip.mass", "positive", "-0.005"),
    "length for an angle": (
        ("limits: [-30 deg, 1]", "limits: [-30 cm, 1]"),
        "bodies.left_tip.joints.1.limits.0",
        "an angle such as '5 deg'",
        "of dimension [length]",
    ),
    "limits the wrong way": (
        ("limits: [-30 deg, 1]", "limits: [2, 1]"),
        "bodies.left_tip.joints.1.limits",
        "the lower before the upper",
        "114.6 to 57.3 deg",
    ),
    "damping of a slide": (
        ("0.1 N s/m", "0.1 N m s"),
        "bodies.left_tip.joints.0.damping",
        "a damping such as '0.1 N s/m'",
        "'0.1 N m s'",
    ),
    "damping of a joint's body": (
        ("    mass: 10 g", "    mass: 10 g\n    damping: {x: 1}"),
        "bodies.left_wing",
        "damping on a floating body",
        "not floating",
    ),
    "unknown coordinate of damping": (
        ("yaw: 0.01", "jaw: 0.01"),
        "bodies.hull.damping.jaw",
        "one of the keys pitch, roll, x, y, yaw, z",
        "'jaw'; did you mean yaw?",
    ),
    "impossible inertia": (
        ("zz: 4e-6", "zz: 4e-5"),
        "bodies.left_tip.inertia",
        "principal moments of a real body",
        "zz 4e-05",
    ),
    "unknown shape": (
        ("type: box", "type: bax"),
        "bodies.left_wing.shape.type",
        "one of cylinder, box",
        "'bax'; did you mean box?",
    ),
    "two inertias": (
        ("    shape: {type: box", "    inertia: {xx: 1, yy: 1, zz: 1}\n    shape: {type: box"),
        "bodies.left_wing",
        "either inertia or shape, such as `shape: {type: point}` or `inertia: {xx: 2 g cm^2",
        "both",
    ),
    "axis": (("axis: -z", "axis: w"), "bodies.left_tip.joints.1.axis", "an axis", "'w'"),
    "no axis": (("[0, 3, 4]", "[0, 0, 0]"), "bodies.left_tip.joints.0.axis", "some length", "0"),
    "unknown parent": (
        ("parent: left_wing", "parent: left_wink"),
        "bodies.left_tip.parent",
        "one of fin, hull",
        "left_wink; did you mean left_wing?",
    ),
    "loop of parents": (
        ("  hull:\n    floating: true", "  hull:\n    parent: left_tip"),
        "bodies.hull",
        "damping on a floating body",
        "not floating",
    ),
    "name taken twice": (
        ("name: left_fold", "name: left_slide"),
        "bodies.left_tip.joints.1.name",
        "coordinates named once",
        "left_slide again",
    ),
    "joint that is not mirrored": (
        ("name: left_fold", "name: fold"),
        "bodies.left_tip.joints",
        "names that begin with 'left'",
        "fold",
    ),
    "wing that is not mirrored": (
        ("name: left_main", "name: main"),
        "wings.0.name",
        "a name that begins with 'left'",
        "main",
    ),
    "mirror of nothing": (("from: left", "from: port"), "mirror.0.from", "the beginning", "port"),
    "wing on no body": (
        ("body: fin", "body: fan"),
        "wings.1.segments.0.body",
        "one of hull, fin",
        "fan",
    ),
    "stations inwards": (
        ("span: 0.05,", "span: -0.05,"),
        "wings.1.segments.0.stations",
        "span positions that increase",
        "[0.0, -0.05]",
    ),
    "trailing edge ahead": (
        ("{span: 0.05, leading: 0,", "{span: 0.05, leading: -4 cm,"),
        "wings.1.segments.0.stations.1",
        "a leading edge ahead of the trailing edge",
        "leading -0.04 m",
    ),
    "span along the chord": (
        ("span_axis: z", "span_axis: x"),
        "wings.1.segments.0.span_axis",
        "an axis across x",
        "(1.0, 0.0, 0.0)",
    ),
    "half a strip": (("strips: 2", "strips: 2.5"), "wings.0.segments.0.strips", "", "2.5"),
    "bodies in a list": (("bodies:", "bodies: []\nother:"), "bodies", "a mapping", "[]"),
    "degrees of an orientation": (
        ("[10 deg, 20 deg, 30 deg]", "[35, 0, 0]"),
        "bodies.left_tip.orientation.0",
        "an angle",
        "35, which is 2005 deg without a unit; write '35 deg' or '35 rad'",
    ),
    "a canted segment": (
        ("        span_axis: z", "        orientation: [1, 0, 0]"),
        "wings.1.segments.0.orientation",
        "it on a body that carries the segment (`massless: true` if",
        "one of a segment",
    ),
    "degrees of an incidence": (
        ("trailing: -0.03}", "trailing: -0.03, incidence: 5}"),
        "wings.0.segments.0.stations.0.incidence",
        "an angle",
        "write '5 deg' or '5 rad'",
    ),
    "degrees of a cruise": (
        ("mirror:", "cruise: {pitch: -8}\nmirror:"),
        "cruise.pitch",
        "an angle",
        "'-8 deg'",
    ),
    "cruise beyond the limits": (
        ("mirror:", "cruise: {frequency: 5, amplitude: {slide: 0.03}}\nmirror:"),
        "cruise.amplitude.slide",
        "a gait within its limits -0.01 to 0.02 m",
        "-0.03 to 0.03 m",
    ),
    "angle of a joint that slides": (
        ("mirror:", "cruise: {frequency: 5, amplitude: {slide: 5 deg}}\nmirror:"),
        "cruise.amplitude.slide",
        "a length",
        "'5 deg'",
    ),
    "unknown parameter": (
        ("name: glider", "name: glider\nparameters: {hull.moss: 1}"),
        "parameters.hull.moss",
        "a parameter of robot 'glider'",
        "'hull.moss'",
    ),
}


_CRUISE = "cruise: {frequency: 5, amplitude: {slide: 10 mm}}\n"


def with_actuator(text: str) -> tuple[str, str]:
    return "mirror:", f"{_CRUISE}actuators:\n  {text}\nmirror:"


FAULTS |= {
    "command that no joint answers": (
        with_actuator("tail_offset: {range: [0, 1]}"), "actuators.tail_offset",
        "<joint>_offset, <joint>_phase of an actuated joint (left_slide, right_slide)", "tail",
    ),
    "command of a passive joint": (
        with_actuator("fold_offset: {range: [0, 1]}"), "actuators.fold_offset",
        "an actuated joint", "fold_offset",
    ),
    "unit of another joint": (
        with_actuator("slide_offset: {range: [-1 cm, 20 deg]}"), "actuators.slide_offset.range.1",
        "number [m]", "20 deg",
    ),
    "rate without its time": (
        with_actuator("slide_offset: {rate_limit: 3 cm}"), "actuators.slide_offset.rate_limit",
        "number [m/s]", "3 cm",
    ),
    "range the wrong way": (
        with_actuator("frequency: {range: [6, 4]}"), "actuators.frequency.range",
        "the lower before the upper", "6 to 4 Hz",
    ),
    "frequency below zero": (
        with_actuator("frequency: {range: [-6, 14]}"), "actuators.frequency.range",
        "none below 0", "-6 to 14 Hz",
    ),
    "rate of zero": (
        with_actuator("frequency: {rate_limit: 0}"), "actuators.frequency.rate_limit",
        "a positive quantity", "0",
    ),
    "response without time": (
        with_actuator("frequency: {response_time: 0 s}"), "actuators.frequency.response_time",
        "positive", "0",
    ),
    "limits that exclude the gait": (
        with_actuator("frequency: {range: [6, 8]}"), "actuators.frequency.range",
        "holds the cruise's 5 Hz", "6 to 8 Hz",
    ),
    "stroke that excludes the gait": (
        with_actuator("left_slide_amplitude: {range: [0, 5 mm]}"),
        "actuators.left_slide_amplitude.range", "holds the cruise's 0.01 m", "0 to 0.005 m",
    ),
    "a joint limited twice": (
        with_actuator("slide_phase: {}\n  left_slide_phase: {}"),
        "actuators.left_slide_phase", "the phase of left_slide limited once", "slide_phase",
    ),
    "power in newtons": (
        ("damping: 0.1 N s/m", "power_limit: 3 N"), "bodies.left_tip.joints.0.power_limit",
        "number [W]", "3 N",
    ),
}  # fmt: skip


def test_actuators_are_in_si():
    robot = load_robot_text(
        GLIDER.replace(
            *with_actuator(
                "slide_offset: {range: [-5 mm, 2 cm], rate_limit: 3 cm/s, response_time: 20 ms,"
                " cost: 2}\n  frequency: {range: [4, 6]}"
            )
        ).replace("damping: 0.1 N s/m", "damping: 0.1 N s/m\n        power_limit: 3 kW")
    )
    slide, frequency = robot.actuators["slide_offset"], robot.actuators["frequency"]
    assert slide == Actuator("m", (-0.005, 0.02), pytest.approx(0.03), 0.02, 2.0)
    assert frequency == Actuator("Hz", (4.0, 6.0), np.inf, None, 1.0)
    assert robot.power_limit[robot.index("right_slide")] == 3000.0
    assert robot.structure == load_robot_text(GLIDER).structure  # nothing is compiled anew


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_with_its_place(fault):
    (old, new), path, expected, found = FAULTS[fault]
    assert old in GLIDER
    with pytest.raises(RobotFileError) as caught:
        load_robot_text(GLIDER.replace(old, new, 1), "glider.yaml")
    problems = [k for k in caught.value.problems if k[0] == path]
    assert problems, caught.value.problems
    assert any(expected in want and found in got for _, want, got in problems), problems
    assert str(caught.value).startswith("glider.yaml: ")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass: 5 g", "mas: 5 g", "line 16, bodies.left_tip.mas: expected one of the keys"),
        ("axis: -z", "axis: w", "line 15, bodies.left_tip.joints.1.axis: expected an axis"),
        ("strips: 2", "strip: 2", "line 38, wings.0.segments.0.strip: expected one of the keys"),
        ("mass: 5 g", "", "line 5, bodies.left_tip.mass: expected a value such as `mass: 2"),
        ("from: left", "form: left", "line 56, mirror.0.form: expected one of the keys from, to"),
        ("parent: hull", "parent: hul", "line 25, bodies.fin.parent: expected one of fin, hull"),
        ("    parent: hull\n", "", "line 24, bodies.fin.parent: expected `parent: hull`, or `pare"),
        ("left_fold", "left_slide", "line 15, bodies.left_tip.joints.1.name: expected coordinat"),
    ],
)
def test_a_fault_is_told_once_with_its_line(old, new, message):
    with pytest.raises(RobotFileError) as caught:
        load_robot_text(GLIDER.replace(old, new, 1), "glider.yaml")
    (said,) = str(caught.value).splitlines()
    assert said.startswith(f"glider.yaml: {message}")


SLIPS = {
    "radians meant as degrees": (
        "limits: [-45 deg, 60 deg]",
        "limits: [-45, 60]",
        r"joint left_plunge: limits: -45 rad are -2578 deg, .*Write \[-45 deg, 60 deg\]$",
    ),
    "grams without a unit": (
        "mass: 380 g",
        "mass: 380",
        "line 16, bodies.body.mass: 380 without a unit is 380 kg.*write '380 g' or '380 kg'$",
    ),
    "centimeters without a unit": (
        "trailing: -22 cm",
        "trailing: -22",
        r"wings.0.segments.0.stations.0.trailing: -22 .* '-22 cm' or '-22 m'$",
    ),
    "an inertia in g cm^2 without a unit": (
        "shape: {type: plate, chord: 25 cm, span: 72 cm, thickness: 4 mm}",
        "inertia: {xx: 1900, yy: 230, zz: 2100}",
        "body left_wing: center_of_mass, shape: its mass lies from .*; check the units",
    ),
    "an inertia of the body without a unit": (
        "shape: {type: box, size: [45 cm, 6 cm, 8 cm]}",
        "inertia: {xx: 8, yy: 61, zz: 65}",
        r"body body: mass, inertia, shape: its mass lies 13.3 m from .* 1.* m large; check the",
    ),
    "mass at the hinge": (
        "    center_of_mass: [-2 cm, 28 cm, 0]\n",
        "",
        r"body left_wing: center_of_mass: .*write center_of_mass: \[-0.612 cm, 31.6 cm, 0 cm\]",
    ),
    "centimeters for a wing in millimeters": (
        "center_of_mass: [-2 cm, 28 cm, 0]",
        "center_of_mass: [-2 cm, 280 cm, 0]",
        "body left_wing: center_of_mass, shape: its mass lies from .* to 316 cm along its span",
    ),
    "kilograms for a wing in grams": (
        "mass: 45 g",
        "mass: 45 kg",
        "body left_wing: mass: it has 45000 g, all other bodies but its mirror image only .* g",
    ),
    "a wing on another body": (
        "      - body: left_wing\n        strips: 8",
        "      - body: body\n        strips: 8",
        "wing left_wing: it is on body; write body: left_wing if that carries it",
    ),
    "a strip of nothing": (
        "{span: 16 cm, leading: -5 cm, trailing: -12 cm}",
        "{span: 1e-9, leading: -5 cm, trailing: -12 cm}",
        r"strip fin\[0\]: its area of .* does nothing; give it a chord",
    ),
    "fewer strips than pieces": (
        "28 cm, 0]\n    shape: {type: plate, chord: 25 cm, span: 72 cm, thickness: 4 mm}",
        "36 cm, 0]\n    shape: {type: plate, chord: 25 cm, span: 72 cm, thickness: 4 mm}\n"
        "    flexible: {elements: 12, bending: 0.1 N m^2}",
        r"body left_wing: flexible: its 13 pieces have 8 strips; write strips: 13 or more",
    ),
    "a wing twice": (
        "  - name: tailplane\n",
        "  - name: left_again\n    segments: [{body: left_wing, strips: 2, stations: [{span: 0, "
        "leading: 6 cm, trailing: -6 cm, incidence: 6 deg}, {span: 20 cm, leading: 6 cm, "
        "trailing: -6 cm, incidence: 6 deg}]}]\n  - name: tailplane\n",
        r"strips left_wing\[0\] and left_again\[0\] lie on each other",
    ),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_likely_slip_is_told_with_what_to_write(slip, tmp_path):
    old, new, sentence = SLIPS[slip]
    text, path = preset_text("ornithopter"), tmp_path / "own.yaml"
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.warns(RobotFileWarning, match=sentence):
        load_robot(path)


def test_a_moment_of_inertia_without_a_unit_is_told_where_others_have_one():
    """Masses and lengths were, and inertias were not."""
    old, new = (
        "shape: {type: box, size: [45 cm,",
        "inertia: {xx: 3, yy: 4, zz: 4.1, xy: 1 g cm^2} #",
    )
    said = robot_warnings(load_robot_text(preset_text("ornithopter").replace(old, new)))
    assert len(said) == 3
    assert "body.inertia.yy: 4 without a unit is 4 kg m^2" in said[1]
    assert said[1].endswith("write '4 g cm^2' or '4 kg m^2'")


RIGHT_HAND = """
  right_wing:
    parent: body
    at: [-2 cm, -3 cm, 4 cm]
    joints: [{name: right_plunge, axis: AXIS}]
    mass: 45 g
    center_of_mass: [-2 cm, -28 cm, 0]
    shape: {type: plate, chord: 25 cm, span: 72 cm, thickness: 4 mm}
wings:
  - name: right_wing
    segments:
      - {body: right_wing, strips: 8, stations: [{span: -72 cm, leading: 5 cm, trailing: -20 cm},
         {span: 0, leading: 5 cm, trailing: -20 cm}]}
  - name: left_wing
    segments:
      - {body: left_wing, strips: 8, stations: [{span: 0, leading: 5 cm, trailing: -20 cm},
         {span: 72 cm, leading: 5 cm, trailing: -20 cm}]}
"""


@pytest.mark.parametrize(
    ("left", "right", "advice"),
    [
        ("x", "x", r"\[-1, 0, 0\]"),
        ("z", "[0, 0.01, 1]", r"\[0, 0, -1\]"),
        ("[1, 1, 0]", "[1, 1, 0]", r"\[-0.707, 0.707, 0\]"),
        ("x", "-x", None),
        ("y", "y", None),
        ("y", "-y", None),
    ],
)
def test_an_axis_of_a_written_right_wing_that_is_no_image_is_told(left, right, advice):
    """A pair that flaps antisymmetrically because one axis was copied was not told."""
    head = preset_text("ornithopter").partition("\n  tailplane:")[0]
    text = head.replace("axis: x", f"axis: {left}") + RIGHT_HAND.replace("AXIS", right)
    said = robot_warnings(load_robot_text(text))
    if advice is None:
        assert not said
    else:
        (sentence,) = said
        assert re.search(
            rf"right_plunge: axis: it is that of the left.*; write axis: {advice}$", sentence
        )


@pytest.mark.parametrize("angle", [5, -3.2])
def test_an_orientation_in_degrees_without_a_unit_is_refused(angle):
    """Up to a turn it was taken as radians; half a turn each way says every attitude."""
    text = GLIDER.replace("orientation: [10 deg", f"orientation: [{angle}")
    with pytest.raises(RobotFileError, match=rf"orientation.0: .*; write '{angle} deg' or"):
        load_robot_text(text)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("hull.mass: 30 g", "parameters.hull.mass: expected a number in SI units such as '0.5', f"),
        ("hull.mas: 0.03", "parameters.hull.mas: .* found 'hull.mas'; did you mean hull.mass[?]"),
    ],
)
def test_a_wrong_parameter_says_what_to_write(line, said):
    """A mass was to be "a pure number", and a slip of the name had no suggestion."""
    with pytest.raises(RobotFileError, match=said):
        load_robot_text(f"{GLIDER}\nparameters: {{{line}}}\n")


def test_the_world_is_a_parent():
    stand = load_robot_text(GLIDER.replace("parent: hull", "parent: world", 1))
    assert stand.bodies[stand.body_index("fin")].parent == -1


def test_a_loop_of_parents_is_named():
    text = load_robot("yeo-wing").source.replace(
        "left_wing:\n", "left_wing:\n    parent: left_wing\n", 1
    )
    with pytest.raises(RobotFileError, match="found the loop left_wing -> left_wing; give one of"):
        load_robot_text(text)


def test_a_robot_that_cannot_move_is_refused():
    text = "name: stone\ngravity: 9.8\nbodies: {rock: {mass: 1, shape: {type: point}}}"
    with pytest.raises(RobotFileError, match="a floating body or at least one joint, found none"):
        load_robot_text(text)


def test_all_faults_are_told_at_once():
    text = GLIDER.replace("9.81", "9.81 s").replace("mass: 5 g", "mass: 5 s")
    with pytest.raises(RobotFileError) as caught:
        load_robot_text(text)
    assert [k[0] for k in caught.value.problems] == ["gravity", "bodies.left_tip.mass"]


def test_a_duplicate_key_is_refused_with_its_line():
    with pytest.raises(RobotFileError, match="line 2.*each key once, found 'name' again"):
        load_robot_text("name: a\nname: b\n")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a:\n\tb: 1\n", "line 2, .* found a tab; indent by spaces$"),
        (
            "a:\n    b: 1\n\n   c: 2\n",
            "line 4, .* found a line indented by 3 spaces after one by 4$",
        ),
        ("a:\n  b: 1\n   c: 2\n", "line 3, .* found a line indented by 3 spaces after one by 2$"),
        ("a:\n  b: 1\nc: d: e\n", "line 3, .*: expected one `key: value` a line, found a second"),
        ("a:\n  b:1\n  c: 2\n", "line 2: expected `key: value` .*, found 'b:1'$"),
        ("a:\n  b: 1\n  c 2\n  d: 3\n", "line 3: expected `key: value` .*, found 'c 2'$"),
        ("a: {b: 1\nc: 2\n", "line 1: expected a comma .*, found none up to line 2, column 2$"),
        ("a: 'b\nc: 2\n", "line 1: expected a quote .*, found none up to the end$"),
        ("[", 'line 1, .* found "expected the node content'),
    ],
)
def test_a_wrong_indent_is_told(text, said):
    with pytest.raises(RobotFileError, match=said):
        load_robot_text(text)


def test_an_alias_is_refused():
    with pytest.raises(RobotFileError, match="no alias"):
        load_robot_text("name: &n a\nother: *n\n")


def test_a_file_that_is_not_utf8_is_refused(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_bytes(b"name: \xff\xfe")
    with pytest.raises(RobotFileError, match="UTF-8"):
        load_robot(path)

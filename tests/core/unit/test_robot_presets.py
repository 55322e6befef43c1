"""The presets are the machines of the literature, number by number."""

from pathlib import Path

import numpy as np
import pytest

from patagium.errors import ParameterError, RobotFileError
from patagium.robot import load_robot, load_robot_text, preset_names, preset_text
from patagium.robot.planform import wing_span

SHARED = Path(__file__).parents[3].parent / "shared" / "data"


def test_the_presets_are_there():
    aerobats = ("aerobat", "aerobat-beta", "aerobat-published")
    assert preset_names() == (*aerobats, "dragonfly", "hawk", "ornithopter", "ur5e", "yeo-wing")


@pytest.mark.parametrize("name", preset_names())
def test_a_preset_bears_its_name_and_carries_its_text(name):
    robot = load_robot(name)
    assert robot.name == name
    assert robot.source == preset_text(name)
    assert load_robot_text(robot.source) == robot


def test_aerobat_weighs_twenty_grams_and_spans_381_mm():
    robot = load_robot("aerobat")
    assert sum(b.mass for b in robot.bodies) == pytest.approx(0.020, rel=1e-14)
    assert wing_span(robot) == pytest.approx(0.3814, rel=1e-14)


def test_the_span_of_a_fin_alone_is_its_height():
    text = """
name: fish
gravity: 9.81 m/s^2
bodies: {body: {floating: true, mass: 1 kg, shape: {type: box, size: [9 cm, 4 cm, 4 cm]}}}
wings:
  - name: fin
    segments:
      - body: body
        span_axis: z
        strips: 3
        stations:
          - {span: -4 cm, leading: 0 cm, trailing: -10 cm}
          - {span: 8 cm, leading: -4 cm, trailing: -10 cm}
"""
    assert wing_span(load_robot_text(text)) == pytest.approx(0.12, rel=1e-12)


def test_aerobat_coordinates_stand_in_the_order_of_the_paper():
    side = ("plunge", "mediolateral", "elbow", "feather")
    expected = ("x", "y", "z", "roll", "pitch", "yaw")
    expected += tuple(f"left_{k}" for k in side) + tuple(f"right_{k}" for k in side)
    robot = load_robot("aerobat")
    assert robot.dof_names == expected
    assert robot.passive == (0, 1, 2, 3, 4, 5)
    assert robot.damping[:6] == (0, 0, 0, 0.01, 0.05, 0.01)


def test_aerobat_turns_its_shoulder_before_it_plunges():
    robot = load_robot("aerobat")
    humerus = robot.bodies[robot.body_index("left_humerus")]
    assert [(k.name, k.axis) for k in humerus.joints] == [
        ("left_mediolateral", (0, 0, -1)),
        ("left_plunge", (1, 0, 0)),
    ]
    mirrored = robot.bodies[robot.body_index("right_plate")]
    assert [(k.name, k.axis) for k in mirrored.joints] == [
        ("right_elbow", (-1, 0, 0)),
        ("right_feather", (0, -1, 0)),
    ]


def test_aerobat_has_five_strips_a_side_on_the_plates():
    robot = load_robot("aerobat")
    plates = {robot.body_index("left_plate"), robot.body_index("right_plate")}
    assert len(robot.strips) == 10
    assert {s.body for s in robot.strips} == plates
    left = [s for s in robot.strips if not s.mirrored]
    span = [s.quarter_chord[1] for s in left]
    assert span == pytest.approx([0.012, 0.036, 0.060, 0.084, 0.108], rel=1e-14)
    assert all(s.quarter_chord[0] == pytest.approx(0.025, rel=1e-14) for s in left)


def test_names_of_no_joint_have_no_side_and_no_pair():
    """`paired` answered plunge_plunge for left_plunge, and `side` 0 for Left_plunge."""
    robot = load_robot("aerobat")
    assert (robot.side("left_plunge"), robot.twin("left_plunge")) == (1, "right_plunge")
    assert (robot.side("pitch"), robot.twin("pitch")) == (0, "pitch")
    assert robot.paired("left_plunge_offset") == "plunge_offset"
    assert robot.paired("frequency") == "frequency"
    for asked in (robot.side, robot.twin):
        with pytest.raises(ParameterError, match="coordinate: .*left_plunge"):
            asked("Left_plunge")
    for name in ("left_plunge", "Left_plunge", "left_plung_offset"):
        with pytest.raises(ParameterError, match="command: expected one that a joint answers"):
            robot.paired(name)


def test_published_inertia_is_that_of_the_reference_vectors():
    if not (SHARED / "lagrange_vectors.npz").exists():
        pytest.skip("the shared reference vectors are not beside the repository")
    vectors = np.load(SHARED / "lagrange_vectors.npz")
    values = dict(zip(vectors["param_names"], vectors["params"], strict=True))
    robot = load_robot("aerobat-published")
    for body, letter in (("body", "b"), ("left_humerus", "a"), ("right_plate", "w")):
        expected = [values[f"I{letter}_{k}"] for k in "xyz"]
        found = robot.bodies[robot.body_index(body)].inertia
        assert found[:3] == pytest.approx(expected, rel=1e-14)  # rounding of the last digit


def test_published_and_corrected_differ_by_two_swapped_inertias_only():
    right, published = load_robot("aerobat"), load_robot("aerobat-published")
    changed = {
        name
        for name, a, b in zip(
            right.parameter_names, right.parameters, published.parameters, strict=True
        )
        if not np.isclose(a, b, rtol=1e-9)
    }
    wings = ("left_humerus", "left_plate", "right_humerus", "right_plate")
    assert changed == {f"{body}.inertia.{k}" for body in wings for k in ("yy", "zz")}


def test_aerobat_beta_has_the_span_and_area_reported_for_it():
    robot = load_robot("aerobat-beta")
    assert wing_span(robot) == pytest.approx(0.414, rel=1e-12)
    area = sum(s.chord * s.width for s in robot.strips)
    assert area == pytest.approx(0.048, rel=0.005)  # reported to two digits
    assert wing_span(robot) ** 2 / area == pytest.approx(3.6, rel=0.01)
    assert 0.0178 < sum(b.mass for b in robot.bodies) < 0.0209  # body 7 to 10 g


def test_yeo_wing_follows_the_digitised_planform():
    robot = load_robot("yeo-wing")
    assert not robot.floating
    assert wing_span(robot) == pytest.approx(2 * 0.213, rel=1e-12)
    area = sum(s.chord * s.width for s in robot.strips)
    assert area == pytest.approx(0.02461, rel=5e-4)  # reported to four digits
    path = SHARED / "yeo2011" / "extracted_planform_coordinates.csv"
    if not path.exists():
        pytest.skip("the shared planform is not beside the repository")
    assert area == pytest.approx(2 * _area_of_outline(path), rel=1e-4)


def _area_of_outline(path: Path) -> float:
    x, y = np.loadtxt(path, delimiter=",").T * 1e-3
    return abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))) / 2


@pytest.mark.parametrize(
    ("name", "mass", "span"),
    [("hawk", 0.28, 1.05), ("dragonfly", 0.175, 0.63), ("ornithopter", 0.51, 1.5)],
)
def test_machines_of_the_gallery_have_the_mass_and_span_of_their_models(name, mass, span):
    robot = load_robot(name)
    assert sum(b.mass for b in robot.bodies) == pytest.approx(mass, rel=1e-12)
    assert wing_span(robot) == pytest.approx(span, rel=1e-12)


def test_an_unknown_preset_names_the_known_ones():
    with pytest.raises(RobotFileError, match=r"aerobat, aerobat-beta.*found 'aerobot'"):
        load_robot("aerobot")


def test_a_missing_file_is_said_to_be_missing(tmp_path):
    with pytest.raises(RobotFileError, match="expected a file that can be read"):
        load_robot(tmp_path / "robot.yaml")


def test_a_robot_loads_from_a_path(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(preset_text("yeo-wing"), encoding="utf-8")
    assert load_robot(path) == load_robot("yeo-wing")
    assert load_robot(str(path)) == load_robot("yeo-wing")


@pytest.mark.parametrize("name", preset_names())
def test_changed_parameters_travel_in_the_source(name):
    robot = load_robot(name)
    first, last = robot.parameter_names[0], robot.parameter_names[-1]
    changed = robot.with_parameters({last: 1e-5}).with_parameters({first: 3.0, last: 2e-5})
    again = load_robot_text(changed.source)
    assert again == changed
    assert again != robot
    values = dict(zip(again.parameter_names, again.parameters, strict=True))
    assert (values[first], values[last]) == (3.0, 2e-5)

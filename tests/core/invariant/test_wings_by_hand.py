"""A right wing that is written by hand is the mirror image of the left one."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import yaml

import patagium as pt
from patagium.aerodynamics import Aerodynamics
from patagium.aerodynamics.inflow import strokes_of
from patagium.control.events import without_tip
from patagium.control.gait_family import gait_family, symmetric_parameters
from patagium.learning.models.linear_strip import LinearStripNetwork
from patagium.learning.models.memory import network_inputs
from patagium.robot import Robot, load_robot_text
from patagium.robot.review import robot_warnings
from patagium.robot.solids import wing_tips
from patagium.robot.strip_chains import chain_words, strip_chains

pytestmark = pytest.mark.usefixtures("interpreted")

TEXT = """
name: bird
gravity: 9.81
bodies:
  body: {floating: true, mass: 0.1, shape: {type: box, size: [0.2, 0.05, 0.04]}}
  left_arm:
    parent: body
    at: [0, 0.01, 0.01]
    joints: [{name: left_plunge, axis: x}, {name: left_feather, axis: -y}]
    mass: 0.004
    center_of_mass: [0, 0.05, 0]
    shape: {type: plate, chord: 0.08, span: 0.1, thickness: 0.001}
  left_hand:
    parent: left_arm
    at: [0, 0.1, 0]
    joints: [{name: left_fold, axis: x}]
    mass: 0.002
    center_of_mass: [0, 0.05, 0]
    shape: {type: plate, chord: 0.06, span: 0.1, thickness: 0.001}
wings:
  - name: left_wing
    segments:
      - body: left_arm
        strips: 2
        stations:
          - {span: 0, leading: 0.02, trailing: -0.06, incidence: 0.05}
          - {span: 0.1, leading: 0.02, trailing: -0.05, incidence: 0.03}
      - body: left_hand
        strips: 2
        stations:
          - {span: 0, leading: 0.02, trailing: -0.05, incidence: 0.03}
          - {span: 0.1, leading: 0, trailing: -0.02}
  - name: tail
    segments:
      - body: body
        at: [-0.15, 0, 0]
        strips: 2
        stations:
          - {span: -0.06, leading: 0, trailing: -0.05}
          - {span: 0.06, leading: 0, trailing: -0.05}
mirror: [{from: left, to: right}]
"""


def _robot(text: Any) -> Robot:
    return load_robot_text(json.dumps(text), "bird")


def _copy(text: Any, **words: str) -> Any:
    """Copy of a part of a file with other words in its names."""
    written = json.dumps(text)
    for old, new in words.items():
        written = written.replace(old, new)
    return json.loads(written)


def _described(strips: int, bodies: int) -> dict[str, Any]:
    """Bird whose left wing has so many strips a segment, on so many bodies."""
    text = yaml.safe_load(TEXT)
    arm, hand = segments = text["wings"][0]["segments"]
    for segment in segments:
        segment["strips"] = strips
    if bodies == 1:
        del text["bodies"]["left_hand"]
        hand["body"] = "left_arm"
        for station in hand["stations"]:
            station["span"] += 0.1
    return text


def _by_hand(text: dict[str, Any], span_axis: str = "y", tip_first: bool = False) -> dict[str, Any]:
    """Text of a robot whose right wing is written out, where the mirror made it."""
    text = _copy(text)
    del text["mirror"]
    for name in [name for name in text["bodies"] if "left" in name]:
        image = _copy(text["bodies"][name], left="right")
        for joint in image["joints"]:  # the axis of a turn along y is its own image
            joint["axis"] = joint["axis"].replace("x", "-x")
        image["at"][1] *= -1
        image["center_of_mass"][1] *= -1
        text["bodies"][name.replace("left", "right")] = image
    segments = []
    for segment in text["wings"][0]["segments"]:
        stations = segment["stations"]
        if span_axis == "y":
            stations = [{**k, "span": -k["span"]} for k in stations[::-1]]
        body = segment["body"].replace("left", "right")
        segments.append({**segment, "body": body, "stations": stations, "span_axis": span_axis})
    if tip_first:
        segments.reverse()
        text["wings"][0]["segments"].reverse()
    text["wings"].append({"name": "right_wing", "segments": segments})
    return text


def _pair(strips: int, bodies: int, span_axis: str, tip_first: bool) -> tuple[Robot, Robot]:
    text = _described(strips, bodies)
    mirrored = _robot(text)
    return mirrored, _robot(_by_hand(text, span_axis, tip_first))


WAYS = [
    (2, 2, "y", False),
    (1, 2, "y", True),
    (1, 2, "-y", False),
    (2, 1, "y", False),
    (2, 1, "y", True),
    (1, 1, "-y", True),
]


@pytest.fixture(scope="module", params=WAYS, ids=str)
def pair(request: pytest.FixtureRequest) -> tuple[Robot, Robot]:
    """A robot with a mirror, and the same one with both wings by hand."""
    return _pair(*request.param)


def test_strips_are_numbered_from_the_root_outward(pair: tuple[Robot, Robot]) -> None:
    """A right wing by hand was stored from its tip to its root, in two lifting lines."""
    mirrored, written = pair
    for name in ("left_wing", "right_wing"):
        one, other = ([s for s in robot.strips if s.wing == name] for robot in pair)
        assert [s.name for s in one] == [s.name for s in other]
        for a, b in zip(one, other, strict=True):
            assert mirrored.bodies[a.body].name == written.bodies[b.body].name
            for key in ("quarter_chord", "forward", "normal", "chord", "width"):
                assert getattr(a, key) == pytest.approx(getattr(b, key), abs=1e-15)
    assert chain_words(written) == "left_wing + right_wing; tail" == chain_words(mirrored)
    assert written.mirrored_wings == mirrored.mirrored_wings == (("left_wing", "right_wing"),)
    tips = wing_tips(written)
    assert tips["right_wing"][1] == pytest.approx(tips["left_wing"][1] * [1, -1, 1], abs=1e-15)


def _state(robot: Robot, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    names = [name for name in robot.dof_names if name not in "xyz"]
    q = robot.coordinates(**{name: 0.3 * rng.normal() for name in names})
    return q, robot.velocities(x=5.0, **{name: 4 * rng.normal() for name in names})


MODELS: dict[str, Callable[[Robot], Aerodynamics]] = {
    "quasi-steady": pt.QuasiSteady,
    "lifting line": pt.LiftingLine,
    "DeLaurier": pt.DeLaurier,
    "inflow": lambda robot: pt.air.Inflow(pt.QuasiSteady(robot)),
}


@pytest.mark.parametrize("name", MODELS)
def test_the_air_is_that_of_a_mirrored_wing(
    name: str, pair: tuple[Robot, Robot], rng: np.random.Generator
) -> None:
    """A lifting line lost 13 to 38 % of its lift, and the inflow took a root for a tip."""
    q, v = _state(pair[0], rng)
    models = [MODELS[name](robot) for robot in pair]
    state = rng.normal(size=models[0].state_size)
    forces, rates = zip(
        *((m.generalized_force(q, v, state), m.state_derivative(q, v, state)) for m in models),
        strict=True,
    )
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-9, atol=1e-12)  # rounding
    np.testing.assert_allclose(rates[1], rates[0], rtol=1e-9, atol=1e-9)


FRAMES = {
    "yaw": ([0, 0, np.pi / 2], [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    "roll": (
        [0.3, 0, 0],
        [[1, 0, 0], [0, np.cos(0.3), -np.sin(0.3)], [0, np.sin(0.3), np.cos(0.3)]],
    ),
}


@pytest.mark.parametrize("frame", FRAMES)
def test_wings_on_a_turned_frame_are_mirror_images(frame: str, rng: np.random.Generator) -> None:
    """Wings on a frame with turned axes were not recognized as mirror images."""
    text = _by_hand(_described(2, 2))
    angles, turn = FRAMES[frame]
    turned = _copy(text)
    turned["bodies"]["thorax"] = {"parent": "body", "massless": True, "orientation": angles}
    for name in ("left_arm", "right_arm"):
        arm = turned["bodies"][name]
        back = [-angle for angle in angles]
        arm.update(parent="thorax", at=list(np.array(arm["at"]) @ turn), orientation=back)
    pair = _robot(text), _robot(turned)
    assert pair[1].mirrored_wings == pair[0].mirrored_wings == (("left_wing", "right_wing"),)
    assert pair[1].joined_wings == pair[0].joined_wings
    assert robot_warnings(pair[1]) == robot_warnings(pair[0])  # axes are mirrored
    q, v = _state(pair[0], rng)
    for make in MODELS.values():
        models = [make(robot) for robot in pair]
        state = rng.normal(size=models[0].state_size)
        forces = [model.generalized_force(q, v, state) for model in models]
        np.testing.assert_allclose(forces[1], forces[0], rtol=1e-9, atol=1e-12)  # rounding
        rates = [model.state_derivative(q, v, state) for model in models]
        if isinstance(models[0], pt.air.Inflow):  # directions are in the axes of the frame
            rates = [rate[:3] for rate in rates]
        np.testing.assert_allclose(rates[1], rates[0], rtol=1e-9, atol=1e-9)


def test_a_flight_with_added_mass_and_inflow_is_that_of_a_mirrored_wing() -> None:
    """Two bodies a side, of one strip each, tips first."""
    ends = []
    for robot in _pair(1, 2, "y", True):
        gait = pt.gaits.sinusoidal(robot, frequency=4.0, plunge=0.5, fold=0.2, feather=0.1)
        flight = pt.simulate(
            robot, pt.air.Inflow(pt.LiftingLine(robot)), gait, duration=0.01, time_step=1e-3,
            v=robot.velocities(x=5.0), added_mass=pt.AddedMass(robot),
        )  # fmt: skip
        ends.append(np.r_[flight["v"].to_numpy()[-1], flight["aero_state"].to_numpy()[-1]])
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("share", [0.2, 0.7])
def test_a_lost_tip_is_lost_at_the_tip(share: float, pair: tuple[Robot, Robot]) -> None:
    """A right wing written by hand lost its root instead of its tip."""
    for wing in ("left_wing", "right_wing"):
        lost = [without_tip(robot, wing, share) for robot in pair]
        np.testing.assert_allclose(lost[1].parameters, lost[0].parameters, atol=1e-15)


def test_it_is_learned_as_a_mirrored_wing(
    pair: tuple[Robot, Robot], rng: np.random.Generator
) -> None:
    """Predictions of the default network with random weights, the wings' own terms included."""
    x = np.r_[(*_state(pair[0], rng), rng.normal(size=pair[0].dof))]
    networks = [LinearStripNetwork(robot) for robot in pair]
    assert networks[0].terms == networks[1].terms
    weights = rng.normal(size=networks[0].size)
    one, other = (network.evaluate(x[None], weights) for network in networks)
    np.testing.assert_allclose(other, one, rtol=1e-9, atol=1e-9)


def test_wings_of_any_names_that_are_images_are_of_one_kind() -> None:
    """Wings named port and starboard had coefficients apart: one learned nothing of the other."""
    words = _copy(_by_hand(_described(2, 2)), left_wing="port", right_wing="starboard")
    named = LinearStripNetwork(_robot(words))
    assert named.surfaces == ("port", "tail")
    assert named.size == LinearStripNetwork(_robot(_described(2, 2))).size


def _image(robot: Robot, vector: np.ndarray) -> np.ndarray:
    """Coordinates, rates or forces of the mirror image of a motion."""
    names, swap = robot.dof_names, {"left": "right", "right": "left"}
    twins = [swap.get(k.split("_")[0], "") + k.removeprefix(k.split("_")[0]) for k in names]
    places = [names.index(twin) if twin in names else i for i, twin in enumerate(twins)]
    return (
        np.array([-1.0 if name in {"y", "roll", "yaw"} else 1.0 for name in names]) * vector[places]
    )


@pytest.mark.parametrize("name", [*MODELS, "network", "network in attached flow"])
def test_the_mirror_image_of_a_motion_has_the_mirrored_force(
    name: str, rng: np.random.Generator
) -> None:
    """The span of corrections was to the left on both sides: a fifth of the largest force."""
    _, robot = _pair(1, 2, "y", True)
    motion = [*_state(robot, rng), np.zeros(robot.dof)]
    motions = motion, [_image(robot, one) for one in motion]
    if name in MODELS:
        forces = [MODELS[name](robot).generalized_force(q, v) for q, v, _ in motions]
    else:
        network = LinearStripNetwork(robot, attached="attached" in name)
        weights, time = rng.normal(size=network.size), np.zeros(1)
        rows = [
            network_inputs(network, weights, time, np.concatenate(one)[None]) for one in motions
        ]
        forces = [network.evaluate(row, weights)[0] for row in rows]
    np.testing.assert_allclose(forces[1], _image(robot, forces[0]), rtol=1e-9, atol=1e-9)


def test_a_robot_on_a_stand_has_one_hinge_a_side() -> None:
    """Each wing has its own hinge; the stand's joint was once taken for the hinge of both."""
    strokes = []
    for robot in _pair(2, 2, "y", False):
        held = robot.mounted_on(pt.load_robot("ur5e"), "tool")
        strokes.append(strokes_of(held))
    assert strokes[0] == strokes[1]


def test_wings_on_both_sides_stay_as_they_are() -> None:
    """Halves of a wing on one body, and one whose tips fold, are one lifting line."""
    text = _described(2, 2)
    del text["mirror"], text["wings"][1], text["bodies"]["left_hand"]
    arm = text["wings"][0]["segments"][0]
    inner = [{**k, "span": -k["span"]} for k in arm["stations"][::-1]]
    text["wings"][0]["segments"] = [{**arm, "stations": inner}, arm]
    halves = _robot(text)
    assert [k.quarter_chord[1] for k in halves.strips] == pytest.approx(
        [-0.075, -0.025, 0.025, 0.075]
    )
    tips = _copy(text["bodies"]["left_arm"], left="tip")
    other = _copy(tips, tip="end")
    text["bodies"] |= {
        "tip": {**tips, "parent": "left_arm", "at": [0, -0.1, 0]},
        "end": {**other, "parent": "left_arm", "at": [0, 0.1, 0]},
    }
    whole = text["wings"][0]["segments"]
    text["wings"][0]["segments"] = [
        {**whole[0], "body": "tip", "strips": 1},
        *whole,
        {**arm, "body": "end", "strips": 1},
    ]
    folding = _robot(text)
    (chain,) = strip_chains(folding)
    assert chain.strips == (0, 1, 2, 3, 4, 5) and chain.right == (-1,) * 6


def test_feathers_side_by_side_on_an_arm_are_in_their_order_along_it() -> None:
    """The file lists the bodies of the right wing from tip to root, all hinged to one arm."""
    text = _described(1, 1)
    del text["mirror"], text["wings"][1]
    stations = text["wings"][0]["segments"][0]["stations"]
    root = [{**k, "span": -k["span"] / 2} for k in stations[::-1]]
    segments = []
    for k in (2, 0, 1):
        feather = text["bodies"]["left_arm"] | {
            "parent": "left_arm",
            "at": [0, -0.05 * k, 0],
            "joints": [{"name": f"feather_{k}", "axis": "y"}],
        }
        text["bodies"][f"feather_{k}"] = feather
        segments.append({"body": f"feather_{k}", "strips": 2, "stations": root})
    text["wings"] = [{"name": "right_wing", "segments": segments}]
    robot = _robot(text)
    bodies = [robot.bodies[strip.body].name for strip in robot.strips]
    assert bodies == [f"feather_{k}" for k in (0, 0, 1, 1, 2, 2)]
    (chain,) = strip_chains(robot)
    assert chain.right == (1,) * 6


def test_a_flexible_right_wing_is_cut_as_its_mirror_image() -> None:
    """Strips of each piece go outward too."""
    text = _described(6, 1)
    arm = text["bodies"]["left_arm"]
    arm["center_of_mass"] = [0, 0.1, 0]
    arm["shape"]["span"] = 0.2
    arm["flexible"] = {"elements": 4, "bending": 0.03, "torsion": 0.005, "damping": 0.0}
    mirrored = _robot(text)
    written = _robot(_by_hand(text, "y", True))
    for one, other in zip(mirrored.strips, written.strips, strict=True):
        assert mirrored.bodies[one.body].name == written.bodies[other.body].name
        assert one.quarter_chord == pytest.approx(other.quarter_chord, abs=1e-15)
    assert strip_chains(mirrored) == strip_chains(written)


@pytest.mark.parametrize("sides", [("port", "starboard"), ("l", "r")])
def test_sides_have_the_words_of_the_mirror(sides: tuple[str, str]) -> None:
    """Only `left` and `right` made pairs: `plunge` named no joint, and trims freed each side."""
    text = TEXT + "cruise: {frequency: 4, amplitude: {plunge: 0.5}}\n"
    usual = load_robot_text(text)
    for word, other in zip(("left", "right"), sides, strict=True):
        text = text.replace(f"{word}_", f"{other}_").replace(f": {word}", f": {other}")
    robot = load_robot_text(text)
    assert robot.joints_named("plunge") == tuple(f"{side}_plunge" for side in sides)
    assert robot.twin(f"{sides[1]}_fold") == f"{sides[0]}_fold"
    gaits = [pt.gaits.cruise(one) for one in (usual, robot)]
    free = [symmetric_parameters(*one) for one in zip((usual, robot), gaits, strict=True)]
    assert free[0] == free[1]
    ways = [
        gait_family(one, gait, ("plunge_offset_difference",)).directions
        for one, gait in zip((usual, robot), gaits, strict=True)
    ]
    np.testing.assert_array_equal(*ways)


@pytest.mark.parametrize("sides", [("w1_", "w2_"), ("one", "two")])
def test_joints_of_wings_that_are_images_are_pairs_whatever_their_names(
    sides: tuple[str, str],
) -> None:
    """Sides without words of letters alone made no pairs: a trim freed each side by itself."""
    usual = _by_hand(_described(2, 2))
    robot = _robot(_copy(usual, left_=sides[0], right_=sides[1]))
    one, other = sides
    joints = ("plunge", "feather", "fold")
    assert {*robot.mirrored_joints} == {(one + k, other + k) for k in joints}
    assert {*robot.joint_groups.values()} == {*robot.mirrored_joints}
    named = [k if one[-1] == "_" else f"{one}{k}_{other}{k}" for k in joints]
    assert [*robot.joint_groups] == named
    assert robot.paired(f"{other}fold_offset") == f"{named[-1]}_offset"
    assert all(robot.joints_named(name) == robot.joint_groups[name] for name in named)


def test_the_left_is_where_it_lies() -> None:
    """Where a file began with the right wing, differences of left and right had the other sign."""
    usual = _by_hand(_described(2, 2))
    for name in ("bodies", "wings"):
        parts = usual[name]
        listed = isinstance(parts, list)
        usual[name] = parts[::-1] if listed else dict(reversed(parts.items()))
    robot = _robot(_copy(usual, left_="port_", right_="starboard_"))
    assert robot.mirrored_wings == (("starboard_wing", "port_wing"),)
    assert robot.side("port_plunge") == 1 and robot.side("starboard_plunge") == -1


def test_joints_on_axes_that_are_not_mirrored_are_told_and_no_pair() -> None:
    """Equal values of both are no symmetric motion."""
    text = _copy(_by_hand(_described(2, 2)), left_="w1_", right_="w2_")
    text["bodies"]["w2_arm"]["joints"][0]["axis"] = "x"
    robot = _robot(text)
    assert robot.twin("w1_plunge") == "w1_plunge" and robot.twin("w1_fold") == "w2_fold"
    assert any("joint w2_plunge: axis" in one for one in robot_warnings(robot))


def test_each_rule_of_a_mirror_makes_pairs() -> None:
    """Two rules of `mirror` made no pairs: `lf_plunge` flew alone, and trims freed each side."""
    usual = pt.load_robot("dragonfly")
    text = usual.source[: usual.source.index("cruise:")]
    rules = "{from: lf, to: rf}\n  - {from: lh, to: rh}"
    text = text.replace("left_fore", "lf").replace("left_hind", "lh")
    robot = load_robot_text(text.replace("{from: left, to: right}", rules))
    pairs = ("lf_plunge", "rf_plunge"), ("lh_plunge", "rh_plunge")
    assert {*pairs} <= {*robot.mirrored_joints} and len(robot.mirrored_joints) == 4
    free = symmetric_parameters(robot, pt.gaits.sinusoidal(robot, frequency=16.0, lf_plunge=0.1))
    gait = pt.gaits.sinusoidal(usual, frequency=16.0, left_fore_plunge=0.1)
    assert len(free) == len(symmetric_parameters(usual, gait))
    assert "lf_plunge_rf_plunge_offset" in free

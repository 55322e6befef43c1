"""One machine in different robot files: each model of the air gives the same force."""

from __future__ import annotations

from math import tan
from typing import Any

import numpy as np
import pytest
import yaml

import patagium as pt
from patagium.control.events import without_tip
from patagium.robot import Robot, load_robot_text
from patagium.robot.planform import placed, poses, sides_of

pytestmark = pytest.mark.usefixtures("interpreted")
BODY = {"floating": True, "mass": 0.3, "shape": {"type": "box", "size": [0.2, 0.05, 0.05]}}
ROUNDING = 1e-12
CHORD, HALF = 0.1, 0.4
"""Of a swept wing [m]."""


def written(bodies: dict[str, Any], **parts: Any) -> Robot:
    """Robot of bodies besides its trunk, and of further sections of its file."""
    content = {"name": "bird", "gravity": 9.81, "bodies": {"body": BODY, **bodies}, **parts}
    return load_robot_text(yaml.safe_dump(content, sort_keys=False), "bird")


def segment(body: str, strips: int, root: float, tip: float, sweep: float = 0.0) -> dict[str, Any]:
    """Segment of a wing between two spans along y of its body [m], with a sweep angle [rad]."""
    stations = [
        {"span": y, "leading": 0.025 - tan(sweep) * back, "trailing": -0.075 - tan(sweep) * back}
        for y, back in ((root, root), (tip, tip))
    ]
    return {"body": body, "strips": strips, "stations": stations}


def swept(sweep: float, form: str) -> Robot:
    """Swept wing of one rigid body, of one flexible body, or of four that are fixed together."""
    plate = {"type": "plate", "chord": CHORD, "span": HALF, "thickness": 0.002}
    wing = {"parent": "body", "mass": 0.02, "center_of_mass": [0, HALF / 2, 0], "shape": plate}
    if form == "flexible":
        wing["flexible"] = {"elements": 4, "bending": 10.0, "torsion": 10.0}
    bodies, segments = {"left_wing": wing}, [segment("left_wing", 4, 0.0, HALF, sweep)]
    if form == "cut":
        width, segments = HALF / 4, []
        for k in range(4):
            parent, back = (f"left_{k - 1}", -width * tan(sweep)) if k else ("left_wing", 0.0)
            at = [back, width if k else 0.0, 0.0]
            bodies[f"left_{k}"] = {"parent": parent, "at": at, "massless": True}
            segments.append(segment(f"left_{k}", 1, 0.0, width, sweep))
    wings = [{"name": "left_wing", "segments": segments}]
    return written(bodies, wings=wings, mirror=[{"from": "left", "to": "right"}])


@pytest.mark.parametrize("form", ["flexible", "cut"])
@pytest.mark.parametrize("sweep", [0.3, 0.8])
def test_sweep_is_that_of_the_wing_whichever_bodies_carry_it(sweep: float, form: str) -> None:
    """A flexible wing, or one of several bodies, had no sweep, or fell apart into single strips."""
    one, other = swept(sweep, "rigid"), swept(sweep, form)
    found = []
    for robot in (one, other):
        state = robot.coordinates(pitch=-0.08), robot.velocities(x=10.0)
        found.append(pt.LiftingLine(robot).generalized_force(*state)[:6])
    assert abs(found[0][2]) > 0.7
    assert found[1] == pytest.approx(found[0], rel=1e-9, abs=ROUNDING)  # inverse of the lattice


def framed(frame: float, by_hand: bool) -> Robot:
    """Wing halves of two fixed bodies of one strip each; frames lie at a share of the strip."""
    width, bodies, wings = 0.15, dict[str, Any](), []
    for side, sign in (("left", 1), ("right", -1)):
        if side == "right" and not by_hand:
            break
        segments = []
        for k in range(2):
            at = [0.0, sign * (0.02 + (k + frame) * width), 0.0]
            bodies[f"{side}_{k}"] = {"parent": "body", "at": at, "massless": True}
            ends = sorted((-sign * frame * width, sign * (1 - frame) * width))
            segments.append(segment(f"{side}_{k}", 1, *ends))
        wings.append({"name": f"{side}_wing", "segments": segments})
    mirror = {} if by_hand else {"mirror": [{"from": "left", "to": "right"}]}
    return written(bodies, wings=wings, **mirror)


@pytest.mark.parametrize("by_hand", [False, True])
@pytest.mark.parametrize("frame", [0.5, 1.0])
def test_air_does_not_know_where_a_body_has_its_frame(frame: float, by_hand: bool) -> None:
    """A strip whose body had its frame at the middle or the tip was taken for one turned inward."""
    forces, kept = [], []
    weights = np.linspace(-0.1, 0.1, 68)
    for robot in (framed(0.0, False), framed(frame, by_hand)):
        q = robot.coordinates(pitch=-0.08, roll=0.1)
        v = robot.velocities(x=10.0, y=1.0, roll=0.5)
        airs = pt.LiftingLine(robot), pt.air.LinearStrips(robot, corrections=weights)
        forces.append(np.concatenate([air.generalized_force(q, v) for air in airs]))
        less = without_tip(robot, "right_wing", 1 / 3)
        places = poses(less)
        strips = [strip for strip in less.strips if strip.wing == "right_wing"]
        ends = [placed(places[s.body], np.array(s.quarter_chord))[1] for s in strips]
        kept.append([(end, strip.width) for end, strip in zip(ends, strips, strict=True)])
    assert abs(forces[0][3]) > 0.01
    assert forces[1] == pytest.approx(forces[0], rel=1e-9, abs=ROUNDING)
    assert np.array(kept[1]) == pytest.approx(np.array(kept[0]), rel=ROUNDING)
    assert kept[0][-1][0] - kept[0][-1][1] / 2 == pytest.approx(-0.22)


def test_a_frame_under_a_wing_leaves_its_sides() -> None:
    """The strips inside of a frame at mid-span were taken for those of the other side."""
    joint = {"joints": [{"name": "left_plunge", "axis": "x"}], "massless": True, "parent": "body"}
    frame = {"parent": "left_root", "at": [0.0, HALF / 2, 0.0], "mass": 0.02}
    bodies = {"left_root": joint, "left_wing": frame | {"shape": {"type": "point"}}}
    wings = [
        {"name": "left_wing", "segments": [segment("left_wing", 4, -HALF / 2, HALF / 2)]},
    ]
    robot = written(bodies, wings=wings, mirror=[{"from": "left", "to": "right"}])
    assert {abs(side) for side in sides_of(robot)} == {1}
    assert [len({*sides_of(robot)[k : k + 4]}) for k in (0, 4)] == [1, 1]

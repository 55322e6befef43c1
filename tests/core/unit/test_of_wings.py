"""A polar or a section for each wing of a robot."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics.description import aero_from_description
from patagium.cli.estimates import air_model
from patagium.errors import PatagiumError
from patagium.robot import load_robot_text

pytestmark = pytest.mark.usefixtures("interpreted")

_GLIDER = """
name: glider
gravity: 9.81 m/s^2
bodies:
  body: {floating: true, mass: 300 g, shape: {type: box, size: [20 cm, 4 cm, 4 cm]}}
  left_half:
    parent: body
    at: [0, 1 cm, 0]
    mass: 20 g
    center_of_mass: [0, 20 cm, 0]
    shape: {type: plate, chord: 10 cm, span: 40 cm, thickness: 2 mm}
wings:
  - name: left_wing
    segments:
      - body: left_half
        strips: 2
        stations:
          - {span: 0 cm, leading: 3 cm, trailing: -7 cm}
          - {span: 40 cm, leading: 3 cm, trailing: -7 cm}
  - name: fin
    segments:
      - body: body
        at: [-30 cm, 0, 0]
        span_axis: z
        strips: 1
        stations:
          - {span: 0 cm, leading: 2 cm, trailing: -4 cm}
          - {span: 10 cm, leading: 2 cm, trailing: -4 cm}
mirror: [{from: left, to: right}]
"""
_ANGLES = np.radians([-90.0, -12.0, -4.0, 0.0, 4.0, 12.0, 90.0])
_CAMBERED = pt.air.TablePolar(
    tuple(_ANGLES), (0.0, -0.7, 0.0, 0.4, 0.8, 1.1, 0.0), (2.0, 0.2, 0.02, 0.02, 0.03, 0.2, 2.0)
)
_FLAT = pt.air.SmoothPolar(drag_rise=1.2)


def _kinds(model: str) -> tuple[Any, Any, Any, str]:
    """Class of a model, a cambered wing's polar or section, a flat one's, and their argument."""
    if model == "quasi-steady":
        return pt.QuasiSteady, _CAMBERED, _FLAT, "polar"
    camber = pt.air.measured_section(_CAMBERED.angle, _CAMBERED.lift, _CAMBERED.drag)
    return pt.LiftingLine, camber, pt.air.Section(), "section"


@pytest.fixture(scope="module")
def glider() -> pt.Robot:
    """A glider with a cambered wing, whose fin stands."""
    return load_robot_text(_GLIDER)


@pytest.mark.parametrize("model", ["quasi-steady", "lifting-line"])
def test_each_wing_has_the_forces_of_its_own_polar(glider: pt.Robot, model: str) -> None:
    make, camber, flat, argument = _kinds(model)
    q, v = glider.coordinates(pitch=0.05), glider.coordinates(x=9.0, y=0.4)
    wings = np.array([strip.wing for strip in glider.strips])
    state = None
    found = {}
    choices = {"camber": camber, "flat": flat, "each": {"left_wing": camber, "fin": flat}}
    for name, given in choices.items():
        air = make(glider, **{argument: given})
        state = np.zeros(air.state_size)
        found[name] = air.strips(q, v, state)["strip_force"]
    of_fin = wings == "fin"
    assert {*wings} == {"left_wing", "right_wing", "fin"}
    # no lag has begun, and the vortices of the fin lie in the plane of symmetry but for the slip
    near = 1e-12 if model == "quasi-steady" else 0.02
    assert np.allclose(found["each"][of_fin], found["flat"][of_fin], rtol=near, atol=near / 50)
    assert np.allclose(found["each"][~of_fin], found["camber"][~of_fin], rtol=near, atol=near / 50)
    assert abs(found["camber"][of_fin] - found["flat"][of_fin]).max() > 0.02  # N of side force


def test_a_cambered_wing_gives_a_flat_fin_no_side_force(glider: pt.Robot) -> None:
    polars = {"left_wing": _CAMBERED, "fin": _FLAT}
    q, v = glider.coordinates(), glider.coordinates(x=9.0)
    for polar, side in ((polars, 0.0), (_CAMBERED, 0.4 * 0.5 * 1.225 * 81 * 0.006)):
        force = pt.QuasiSteady(glider, polar=polar).generalized_force(q, v)
        assert abs(force[1]) == pytest.approx(side, rel=1e-9, abs=1e-12)  # C_L(0) = .4, rounding


def test_one_for_each_wing_that_is_the_same_is_one_for_all(glider: pt.Robot) -> None:
    q, v = glider.coordinates(pitch=0.1), glider.coordinates(x=8.0, z=-1.0, roll=2.0)
    for model in ("quasi-steady", "lifting-line"):
        make, camber, _, argument = _kinds(model)
        one = make(glider, **{argument: camber}).generalized_force(q, v)
        names = ("left_wing", "right_wing", "fin")
        each = make(glider, **{argument: dict.fromkeys(names, camber)}).generalized_force(q, v)
        assert np.allclose(one, each, rtol=1e-12, atol=1e-12)  # rounding


@pytest.mark.parametrize("model", ["quasi-steady", "lifting-line"])
def test_the_numbers_of_a_wing_are_learned_by_its_name(glider: pt.Robot, model: str) -> None:
    make, camber, flat, argument = _kinds(model)
    air = make(glider, **{argument: {"left_wing": camber, "fin": flat}})
    described = json.loads(json.dumps(air.describe()))
    assert aero_from_description(glider, described) == air
    number = "lift_amplitude" if model == "quasi-steady" else "lift_slope"
    names = [f"{argument}.fin.{number}", f"{argument}.left_wing.lift[3]"]
    names[1] = names[1] if model == "quasi-steady" else f"{argument}.left_wing.lift_slope"
    assert {*names} <= {*air.parameter_names}
    q, v = glider.coordinates(pitch=0.1), glider.coordinates(x=8.0, y=1.0)
    before = air.strips(q, v, np.zeros(air.state_size))["strip_force"]
    book = pt.GreyBox(air, {name: 0.1 for name in names})
    changed, _ = book.air_at(np.array([1.0, 0.0]))
    after = changed.strips(q, v, np.zeros(air.state_size))["strip_force"]
    wings = np.array([strip.wing for strip in glider.strips])
    moved = np.linalg.norm(after - before, axis=1)
    assert moved[wings == "fin"].min() > 20 * moved[wings != "fin"].max()


def test_rain_on_one_wing_leaves_the_others(glider: pt.Robot) -> None:
    air = pt.QuasiSteady(glider, polar={"left_wing": _CAMBERED, "fin": _FLAT})
    rain = pt.control.PolarEvent(time=0.0, factors={"fin.lift_amplitude": 0.5})
    _, wet = rain.changed(glider, air)
    assert wet.polar["fin"].lift_amplitude == pytest.approx(0.5 * _FLAT.lift_amplitude)
    assert wet.polar["left_wing"] == _CAMBERED and len({air, wet}) == 2
    with pytest.raises(PatagiumError, match="of fin.lift_amplitude, .*did you mean"):
        pt.control.PolarEvent(time=0.0, factors={"fin.lift_amplitud": 0.5}).changed(glider, air)


def test_a_wing_without_one_or_that_is_not_there_is_refused(glider: pt.Robot) -> None:
    with pytest.raises(PatagiumError, match="polar of fin: expected one: where wings have"):
        pt.QuasiSteady(glider, polar={"left_wing": _FLAT})
    with pytest.raises(PatagiumError, match="section by wing: .*did you mean right_wing"):
        section = pt.air.Section()
        pt.LiftingLine(glider, section={"left_wing": section, "rigt_wing": section, "fin": section})


def test_the_command_line_gives_a_wing_its_own_file(glider: pt.Robot, tmp_path: Path) -> None:
    file = tmp_path / "cambered.csv"
    rows = zip(np.degrees(_ANGLES), _CAMBERED.lift, _CAMBERED.drag, strict=True)
    file.write_text("alpha,CL,CD\n" + "".join(f"{a:.10g},{cl},{cd}\n" for a, cl, cd in rows))
    polar = pt.air.measured_polar(*pt.air.read_polar(file)[:3])
    each = air_model("quasi-steady", glider, pt.Air(), [f"left_wing={file}", "reynolds"]).polar
    reynolds = pt.air.ReynoldsPolar()
    assert each == {"left_wing": polar, "fin": reynolds}
    alone = air_model("lifting-line", glider, pt.Air(), [f"fin={file}"]).section
    section = pt.air.measured_section(*pt.air.read_polar(file))
    assert alone == {"left_wing": pt.air.Section(), "fin": section}
    with pytest.raises(PatagiumError, match=r"found no wing 'tail' \(wings: left_wing, fin, right"):
        air_model("quasi-steady", glider, pt.Air(), [f"tail={file}"])

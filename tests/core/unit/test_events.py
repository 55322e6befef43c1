"""Events: what a machine loses and gets, as numbers, and what cannot happen."""

from __future__ import annotations

import re
from importlib import resources

import numpy as np
import pytest

import patagium as pt
from patagium.control import (
    GustEvent,
    NoisyState,
    PayloadEvent,
    PolarEvent,
    StuckEvent,
    WingLossEvent,
    off_nominal,
)
from patagium.control.events import with_gusts, without_tip
from patagium.errors import ParameterError
from patagium.robot import load_robot_text
from patagium.robot.files import preset_text
from patagium.robot.planform import poses

PRESETS = ("aerobat", "ornithopter", "dragonfly", "hawk")
FORMER_ZEROS = {
    "ornithopter": {"left_wing.center_of_mass.z"},
    "hawk": {"left_hand.center_of_mass.z"},
}


def area(robot, wing):
    return sum(float(s.chord * s.width) for s in robot.strips if s.wing == wing)


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("share", [0.07, 1 / 3, 1.0])
def test_a_lost_tip_takes_area_and_mass(name, share):
    robot = pt.load_robot(name)
    wing = next(s.wing for s in robot.strips if s.wing.startswith("left"))
    cut = without_tip(robot, wing, share)
    names = [r.parameter_names for r in (cut, robot)]
    more = {k for k in names[0] if k not in names[1]}  # the wings of two presets are not flat
    assert more <= FORMER_ZEROS.get(name, set()) and set(names[1]) <= set(names[0])
    assert more or cut.structure == robot.structure  # nothing to compile
    assert cut.source != robot.source  # a flight can tell it
    other = wing.replace("left", "right")
    assert area(cut, other) == area(robot, other)
    assert area(cut, wing) < area(robot, wing)
    spans = [sum(float(s.width) for s in r.strips if s.wing == wing) for r in (robot, cut)]
    assert spans[1] == pytest.approx((1 - share) * spans[0], abs=1.01e-3 * spans[0])
    lighter = sum(a.mass - b.mass for a, b in zip(robot.bodies, cut.bodies, strict=True))
    bodies = {s.body for s in robot.strips if s.wing == wing}
    weight = sum(float(robot.bodies[k].mass) for k in bodies)
    assert 0 < lighter <= weight
    tips = [max(abs(s.quarter_chord[1]) for s in r.strips if s.wing == wing) for r in (robot, cut)]
    assert tips[1] < tips[0]


def test_the_mass_of_a_tip_is_that_of_plates():
    """A uniform plate that is cut is a shorter uniform plate."""
    m, c, b = 0.03, 0.05, 0.6
    text = f"""
name: plate
gravity: 9.81 m/s^2
bodies:
  body: {{floating: true, mass: 100 g, shape: {{type: box, size: [10 cm, 5 cm, 5 cm]}}}}
  left_wing:
    parent: body
    joints: [{{name: left_plunge, axis: x, limits: [-60 deg, 60 deg]}}]
    mass: 30 g
    center_of_mass: [-2.5 cm, 30 cm, 0]
    inertia: {{xx: {m * b**2 / 12}, yy: {m * c**2 / 12}, zz: {m * (b**2 + c**2) / 12}}}
wings:
  - name: left_wing
    segments:
      - body: left_wing
        strips: 6
        stations:
          - {{span: 0 cm, leading: 0 cm, trailing: -5 cm}}
          - {{span: 60 cm, leading: 0 cm, trailing: -5 cm}}
"""
    robot = load_robot_text(text)
    cut = without_tip(robot, "left_wing", 0.25)
    wing = cut.bodies[1]
    assert wing.mass == pytest.approx(0.75 * m, rel=1e-3)  # a thousandth of a strip remains
    assert wing.center_of_mass == pytest.approx((-0.025, 0.225, 0.0), rel=1e-3)
    exact = 0.75 * m / 12 * np.array([(0.75 * b) ** 2, c**2, (0.75 * b) ** 2 + c**2])
    assert wing.inertia[:3] == pytest.approx(exact, rel=3e-3)
    assert wing.inertia[3:] == (0.0, 0.0, 0.0)
    ends = [abs(s.quarter_chord[1]) + s.width / 2 for s in cut.strips]
    assert max(ends) == pytest.approx(0.75 * b, rel=1e-2)  # a thousandth of strips remains there
    assert sum(s.width for s in cut.strips) == pytest.approx(0.75 * b, rel=1e-3)


FLEXIBLE = """
name: flexible
gravity: 9.81 m/s^2
bodies:
  trunk: {floating: true, mass: 100 g, shape: {type: box, size: [10 cm, 3 cm, 3 cm]}}
  left_wing:
    parent: trunk
    joints: [{name: left_plunge, axis: x}]
    mass: 12 g
    center_of_mass: [-1 cm, 12 cm, 0]
    shape: {type: plate, chord: 6 cm, span: 24 cm, thickness: 1 mm}
    flexible: {elements: ELEMENTS, bending: 0.03 N m^2, torsion: 0.004 N m^2}
wings:
  - name: left_wing
    segments:
      - body: left_wing
        strips: STRIPS
        stations:
          - {span: 0 cm, leading: 2 cm, trailing: -4 cm}
          - {span: 24 cm, leading: 2 cm, trailing: -4 cm}
mirror: [{from: left, to: right}]
"""


def inertia_about_the_roots(robot):
    """Moments of inertia of both wings, nothing bent, about x and y at their roots [kg m^2]."""
    moments = np.zeros(2)
    for body, (position, _) in list(zip(robot.bodies, poses(robot), strict=True))[1:]:
        x, y, _ = position + np.array(body.center_of_mass)
        moments += np.array(body.inertia[:2]) + body.mass * np.array([y**2, x**2])
    return moments


@pytest.mark.parametrize(("elements", "strips", "side"), [(6, 8, "left"), (8, 9, "right")])
@pytest.mark.parametrize("share", [0.1, 0.4, 1.0])
def test_a_flexible_wing_loses_the_mass_that_a_rigid_one_loses(elements, strips, side, share):
    """A cut flexible wing lost 0.68 g instead of 1.2 g: pieces were scaled by whole strips."""
    text = FLEXIBLE.replace("ELEMENTS", str(elements)).replace("STRIPS", str(strips))
    robots = [load_robot_text(one) for one in (text, re.sub("    flexible: .*\n", "", text))]
    cut = [without_tip(robot, f"{side}_wing", share) for robot in robots]
    assert cut[0].structure == robots[0].structure
    # a thousandth of a lost strip or piece is left
    assert robots[0].mass - cut[0].mass == pytest.approx(share * 0.012, abs=0.002 * 0.012)
    bent, rigid = map(inertia_about_the_roots, cut)
    assert bent == pytest.approx(rigid, abs=0.001 * rigid[0])


def test_a_lamina_whose_moments_are_estimates_can_be_cut():
    """The excess of its normal moment of inertia stayed as the span shrank, as in no real body."""
    robot = pt.load_robot("ornithopter")
    xx, yy = robot.bodies[robot.body_index("left_wing")].inertia[:2]
    estimated = robot.with_parameters({"left_wing.inertia.zz": 1.08 * (xx + yy)})
    cut = without_tip(estimated, "left_wing", 0.9)
    moments = np.linalg.eigvalsh(cut.bodies[cut.body_index("left_wing")].tensor)
    assert 0 < moments[2] <= (1 + 1e-9) * (moments[0] + moments[1])


@pytest.mark.usefixtures("interpreted")
def test_what_is_lost_of_a_wing_lies_side_by_side():
    """In one place the vortices of two lost strips of a body made every force not a number."""
    robot = load_robot_text(re.sub(r"strips: \d", "strips: 4", preset_text("ornithopter")))
    q, v = robot.coordinates(pitch=-0.1), robot.velocities(x=6.0)
    lift = []
    for share in (0.2, 0.3, 0.5, 1.0):
        cut = without_tip(robot, "left_wing", share)
        lift.append(pt.LiftingLine(cut).generalized_force(q, v)[2])
        places = [s.quarter_chord[1] for s in cut.strips if s.wing == "left_wing"]
        apart, widths = np.diff(places), [s.width for s in cut.strips if s.wing == "left_wing"]
        assert apart == pytest.approx((np.array(widths[1:]) + widths[:-1]) / 2, rel=1e-9)
    assert (np.diff(lift) < 0).all() and lift[-1] > 0


def test_a_fuselage_stays_where_its_tail_is_lost():
    """Its mass went as the area of the tail that is fixed to it: 25 g became .025 g."""
    text = (resources.files("patagium.robot") / "template.yaml").read_text("utf-8")
    robot = load_robot_text(text)
    cut = without_tip(robot, "tail", 1.0)
    assert cut.bodies == robot.bodies and area(cut, "tail") < 0.01 * area(robot, "tail")
    slide = "joints: [{name: heave, type: prismatic, axis: z}]"
    held = load_robot_text(text.replace("floating: true", slide))
    assert without_tip(held, "tail", 1.0).bodies == held.bodies


def test_a_payload_is_a_point():
    robot = pt.load_robot("ornithopter")
    event = PayloadEvent(time=0.0, body="body", mass=0.05, position=(0.1, 0.0, 0.0))
    loaded, aero = event.changed(robot, pt.QuasiSteady(robot))
    body, own = loaded.bodies[0], robot.bodies[0]
    assert body.mass == pytest.approx(0.43) and aero.robot is loaded
    assert body.center_of_mass == pytest.approx((0.05 * 0.1 / 0.43, 0.0, 0.0), rel=1e-12)
    reduced = 0.38 * 0.05 / 0.43 * 0.1**2
    assert body.inertia[1] == pytest.approx(own.inertia[1] + reduced, rel=1e-12)
    assert body.inertia[0] == pytest.approx(own.inertia[0], rel=1e-12)


@pytest.mark.parametrize("event", [
    PayloadEvent(time=0.0, body="body", mass=0.03, position=(0.0, 0.2, -0.1)),
    WingLossEvent(time=0.0, wing="tailplane", share=0.3),
])  # fmt: skip
def test_a_centre_of_mass_moves_where_it_was_zero(event):
    """As that of the same machine with a centre that is a nanometre off its axes."""
    robot = pt.load_robot("ornithopter")
    aside = {f"{k}.center_of_mass.{i}": 1e-9 for k in ("body", "tailplane") for i in "yz"}
    moved, near = (
        event.changed(r, pt.QuasiSteady(r))[0] for r in (robot, robot.with_parameters(aside))
    )
    former = [body.center_of_mass for body in robot.bodies]
    apart = [a.center_of_mass[1] - b[1] for a, b in zip(moved.bodies, former, strict=True)]
    assert max(map(abs, apart)) > 0.01
    for one, other in zip(moved.bodies, near.bodies, strict=True):
        np.testing.assert_allclose(one.center_of_mass, other.center_of_mass, atol=2e-9)
        np.testing.assert_allclose(one.inertia, other.inertia, atol=1e-9)
    assert load_robot_text(moved.source).structure == moved.structure


def test_another_polar_of_any_air():
    robot, by_wing = pt.load_robot("aerobat"), {"left_wing": 6.0, "right_wing": 6}
    for aero, name in (
        (pt.QuasiSteady(robot), "lift_amplitude"),
        (pt.LiftingLine(robot), "profile_drag"),
        (pt.DeLaurier(robot), "friction_drag"),
        (pt.DeLaurier(robot, lift_slope=by_wing), "lift_slope.left_wing"),
        (pt.QuasiSteady(robot, polar=pt.air.SmoothPolar(lift_amplitude=2)), "lift_amplitude"),
        (pt.air.Inflow(pt.QuasiSteady(robot)), "lift_amplitude"),
    ):
        _, other = PolarEvent(time=0.0, factors={name: 0.5}).changed(robot, aero)
        assert other.structure == aero.structure
        moved = np.flatnonzero(other.parameters != aero.parameters)
        assert len(moved) == 1
        assert other.parameters[moved[0]] == 0.5 * aero.parameters[moved[0]]
    with pytest.raises(ParameterError, match="did you mean lift_amplitude"):
        PolarEvent(time=0.0, factors={"lift_amplitud": 1.0}).changed(robot, pt.QuasiSteady(robot))


def test_gusts_of_events_add_to_those_of_the_air():
    robot = pt.load_robot("aerobat")
    own = pt.air.OneMinusCosineGust((0.0, 0.0, 1.0), 0.0, 1.0)
    events = [
        GustEvent(time=0.2, velocity=(1.0, 0.0, 0.0), length_time=0.4),
        GustEvent(time=0.1, velocity=(0.0, 2.0, 0.0), length_time=0.05, stays=True),
        StuckEvent(time=0.1, command="frequency"),
    ]
    aero = with_gusts(pt.QuasiSteady(robot, pt.Air(gust=own)), events)
    upward = own.velocity_at(np.array([0.4]))[0, 2]
    assert aero.air.wind_at([0.4])[0] == pytest.approx([1.0, 2.0, upward])
    described = aero.air.describe()["gust"]
    assert described["name"] == "sum" and len(described["gusts"]) == 3
    swept = pt.air.TravelingGust(own, (1.0, 0.0, 0.0), 5.0)
    with pytest.raises(ParameterError, match="travels"):
        with_gusts(pt.QuasiSteady(robot, pt.Air(gust=swept)), events)


def test_masses_off_nominal_are_drawn_from_the_seed():
    robot = pt.load_robot("ornithopter")
    one, same, other = (off_nominal(robot, 0.02, seed) for seed in (1, 1, 2))
    assert (one.parameters == same.parameters).all()
    assert (one.parameters != other.parameters).any()
    assert one.structure == robot.structure
    off = np.array([a.mass / b.mass - 1 for a, b in zip(one.bodies, robot.bodies, strict=True)])
    assert (0 < abs(off)).all() and (abs(off) < 0.0601).all()
    with pytest.raises(ParameterError, match="below 0.3"):
        off_nominal(robot, 0.5, 1)


@pytest.mark.parametrize(
    ("event", "said"),
    [
        (WingLossEvent(time=0.0, wing="left_wng", share=0.1), "did you mean left_wing"),
        (WingLossEvent(time=0.0, wing="left_wing", share=0.0), "above 0, up to 1"),
        (PayloadEvent(time=0.0, body="bod", mass=0.1), "did you mean body"),
        (PayloadEvent(time=0.0, body="body", mass=-0.1), "mass: expected a positive number"),
        (PayloadEvent(time=0.0, body="body", mass=1e19), "mass: expected at most 1000 times"),
    ],
)
def test_what_cannot_happen_is_refused(event, said):
    robot = pt.load_robot("aerobat")
    with pytest.raises(ParameterError, match=said):
        event.changed(robot, pt.QuasiSteady(robot))


def test_wrong_numbers_are_refused():
    with pytest.raises(ParameterError, match="zero or more seconds"):
        StuckEvent(time=-1.0, command="frequency")
    with pytest.raises(ParameterError, match="below 1"):
        NoisyState(missing=1.0)
    with pytest.raises(ParameterError, match="z: expected zero or more"):
        NoisyState({"z": -1.0})
    with pytest.raises(ParameterError, match="did you mean velocity of z"):
        NoisyState({"velocity of zz": 1.0}).estimator(pt.trim(pt.load_robot("aerobat")), 1.0, 0)

"""Lifting lines run through a wing and its mirror image, through others where the file says so."""

from __future__ import annotations

import re

import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics import Aerodynamics
from patagium.aerodynamics.trailing_vortices import spans_and_areas
from patagium.errors import RobotFileError
from patagium.robot import Robot, load_robot_text, preset_text
from patagium.robot.strip_chains import chain_words, strip_chains

pytestmark = pytest.mark.usefixtures("interpreted")

CLOSE = preset_text("dragonfly").replace("at: [-2 cm, 2 cm", "at: [5.3 cm, 2 cm")
"""A dragonfly whose hind roots are nearer to the fore roots than half a chord."""
HIND = "  - name: left_hind\n"
SAID = CLOSE.replace(HIND, f"{HIND}    joins: [left_fore]\n")


@pytest.fixture(scope="module")
def close() -> Robot:
    return load_robot_text(CLOSE.replace("strips: 6", "strips: 2"))


def test_wings_one_behind_the_other_are_not_joined(close: Robot) -> None:
    assert chain_words(close) == "left_fore; left_hind; right_fore; right_hind"


def test_a_robot_file_may_join_wings_and_their_images() -> None:
    said = load_robot_text(SAID)
    assert chain_words(said) == "left_hind + left_fore; right_hind + right_fore"
    assert sorted(i for chain in strip_chains(said) for i in chain.strips) == [*range(24)]


def test_a_robot_file_may_part_a_wing_from_its_image() -> None:
    text = preset_text("aerobat-beta")
    assert chain_words(load_robot_text(text)) == "left_wing + right_wing"
    apart = text.replace("- name: left_wing\n", "- name: left_wing\n    joins: []\n")
    assert chain_words(load_robot_text(apart)) == "left_wing; right_wing"


def test_other_numbers_do_not_part_wings() -> None:
    robot = load_robot_text(preset_text("yeo-wing"))
    damaged = robot.with_parameters({"right_wing[0].chord": 0.03, "right_wing[0].width": 0.001})
    assert strip_chains(damaged) == strip_chains(robot)


def test_a_gap_of_half_a_chord_parts_wings_at_any_scale() -> None:
    # Rounding decided: a robot of twice the size flew in one line, and 4 % otherwise.
    found = set()
    for k in (1.0, 1.7, 2.0, 3.0, 7.0):
        arm = (
            f"  left_arm: {{parent: body, at: [0, {0.025 * k}, 0], mass: 1, shape: {{type: point}}"
        )
        text = WHOLE.replace("wings:", f"{arm}, center_of_mass: [0, {k}, 0]}}\nwings:")
        text += "  - name: left_arm\n    segments: [{body: left_arm, strips: 7, stations: ["
        text += f"{{span: 0, leading: {0.02 * k}, trailing: {-0.08 * k}}}, "
        text += f"{{span: {0.1 * k}, leading: {0.03 * k}, trailing: {-0.07 * k}}}, "
        text += f"{{span: {0.19 * k}, leading: 0, trailing: {-0.04 * k}}}]}}]\n"
        found.add(chain_words(load_robot_text(text + "mirror: [{from: left, to: right}]\n")))
    assert found == {"left_arm; right_arm"}


def test_a_wing_joins_no_wing_that_is_not_there() -> None:
    wrong = SAID.replace("[left_fore]", "[left_for]")
    with pytest.raises(RobotFileError, match=r"joins: .*did you mean left_fore\?"):
        load_robot_text(wrong)


def test_still_air_gives_four_close_wings_no_power(close: Robot) -> None:
    aero = pt.LiftingLine(close, pt.Air())
    step = 1 / close.cruise.frequency / 500
    flight = pt.simulate(
        close, aero, pt.gaits.cruise(close), duration=1000 * step, time_step=step,
        mount=pt.mounts.fixed(),
    )  # fmt: skip
    beat = flight.isel(time=slice(500, None))
    assert float(beat["aero_power"].mean()) < 0
    # a tip moves at 16 m/s over half a chord of 3 cm, pi c U / 2 of it at an angle of 1 rad
    assert float(abs(beat["circulation"]).max()) < 1.5
    assert float(abs(beat["downwash"]).max()) < 16.0
    assert flight.attrs["lifting_lines"] == chain_words(close)


WHOLE = """
name: wing
gravity: 9.81
bodies:
  body: {floating: true, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
wings:
"""
PART = """
  - name: %s
    joins: [%s]
    segments:
      - body: body
        strips: %d
        stations:
          - {span: %g, leading: 0.05, trailing: -0.15}
          - {span: %g, leading: 0.05, trailing: -0.15}
"""


@pytest.mark.parametrize("make", [pt.LiftingLine, pt.DeLaurier, pt.QuasiSteady])
def test_a_wing_written_in_parts_that_join_is_one_wing(make: type[Aerodynamics]) -> None:
    """Its span and area are those of the whole: in low aspect ratio, memory and ground effect."""
    parts = [
        ("left", "middle", 2, 0.2, 0.4),
        ("middle", "", 3, -0.1, 0.2),
        ("right", "middle", 3, -0.4, -0.1),
    ]
    forces = []
    for wings in (PART % ("wing", "", 8, -0.4, 0.4), "".join(PART % part for part in parts)):
        robot = load_robot_text(WHOLE + wings, "wing")
        q, v = robot.coordinates(pitch=-0.05), robot.velocities(x=9.0)
        forces.append(make(robot, pt.Air(ground=-0.1)).generalized_force(q, v))
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-9, atol=1e-9)


def test_a_flight_tells_the_lines_of_a_model_under_another() -> None:
    robot = load_robot_text(WHOLE + PART % ("wing", "", 2, -0.4, 0.4), "wing")
    aero = pt.air.WindShear(pt.LiftingLine(robot, pt.Air()))
    flight = pt.simulate(robot, aero, pt.gaits.still(robot), duration=2e-3, time_step=1e-3)
    assert flight.attrs["lifting_lines"] == chain_words(robot) != ""


def test_a_wing_that_differs_a_little_from_its_image_keeps_it() -> None:
    """Without it the aspect ratio was half, unless code of the symmetric robot was cached."""
    robot = pt.load_robot("aerobat")
    chords = [name for name in robot.parameter_names if re.match(r"right_wing\[\d\].chord", name)]
    values = dict(zip(robot.parameter_names, robot.parameters, strict=True))
    odd = robot.with_parameters({name: 1.05 * values[name] for name in chords})
    assert len(chords) == 5
    for machine in (robot, odd):
        sizes = np.array(spans_and_areas(machine, machine), float)
        half = sum(float(strip.width) for strip in robot.strips) / 2
        assert sizes[:, 0] == pytest.approx(2 * half, rel=1e-12)  # rounding
    assert sizes[5:, 1] == pytest.approx(1.05 * sizes[:5, 1], rel=1e-12)

"""The summary of a flight says where forces of the air are physically impossible."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.cli.main import run
from patagium.robot import load_robot_text
from patagium.simulation import aero_of
from patagium.simulation.flight_summary import flight_summary, hinged_strips

INSECT = """
name: hoverer
gravity: 9.81 m/s^2
bodies:
  left_wing:
    joints: [{name: left_sweep, axis: -z}, {name: left_feather, axis: -y}]
    mass: 0.02 g
    center_of_mass: [-0.3 cm, 2.5 cm, 0]
    shape: {type: plate, axis: y, chord: 1.8 cm, span: 5.2 cm, thickness: 0.1 mm}
wings:
  - name: left_wing
    segments:
      - body: left_wing
        strips: 3
        stations:
          - {span: 0 cm, leading: 0.5 cm, trailing: -1.3 cm}
          - {span: 5.2 cm, leading: 0.5 cm, trailing: -1.3 cm}
mirror: [{from: left, to: right}]
"""


@pytest.fixture(scope="module")
def flight() -> xr.Dataset:
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.cruise(robot)
    aero = pt.air.Inflow(pt.QuasiSteady(robot))
    return pt.simulate(
        robot, aero, gait, duration=2.2 / gait.frequency, time_step=5e-4, mount=pt.mounts.fixed()
    )


def sentences(flight: xr.Dataset) -> list[str]:
    return [w for w in flight_summary(flight)["warnings"] if "needs" not in w and "tumbl" not in w]


@pytest.mark.usefixtures("interpreted")
def test_a_sound_flight_has_no_findings(flight: xr.Dataset) -> None:
    assert not [w for w in sentences(flight) if "Still air" in w or "coefficient" in w]


def test_power_of_still_air_is_found(flight: xr.Dataset) -> None:
    broken = flight.assign(air_work=-flight["air_work"])
    (sentence,) = [w for w in sentences(broken) if "Still air gives" in w]
    power = np.diff(flight["air_work"].to_numpy()[-1000:])
    assert power.mean() < 0 and "wing" in sentence and "W on average" in sentence
    assert not [w for w in sentences(broken.assign(wind=flight["wind"] + 1.0)) if "Still" in w]
    blown = flight.assign(wind=flight["wind"] + 1.0, aero_power=-flight["aero_power"])
    assert [w for w in sentences(blown) if "Still air gives" in w]
    sheared = blown.assign(
        wind=blown["wind"] * np.linspace(1.0, 1.1, flight.sizes["time"])[:, None]
    )
    assert [w for w in sentences(sheared) if "Still air gives" in w]  # met on the way up
    air = pt.Air(gust=pt.air.RampGust((1.0, 0.0, 0.0), 0.0, 1.0))
    aero = pt.air.Inflow(pt.QuasiSteady(aero_of(flight).robot, air))
    changing = blown.assign_attrs(aero=json.dumps(aero.describe()))
    assert not [w for w in sentences(changing) if "Still air gives" in w]


def test_coefficients_and_downwash_beyond_limits_are_found(flight: xr.Dataset) -> None:
    force = flight["strip_force"].copy()
    force[300, 2] *= 1e3
    (sentence,) = [w for w in sentences(flight.assign(strip_force=force)) if "coefficient" in w]
    assert f"at {float(flight.time[300]):.3g} s" in sentence
    assert sentence.startswith(str(flight["strip"].values[2]))
    wash = flight["downwash"].copy()
    wash[200, 1] = 1.6e4
    (sentence,) = [w for w in sentences(flight.assign(downwash=wash)) if "downwash" in w]
    assert sentence.startswith(f"The downwash at {flight['strip'].values[1]} is 1.6e+04 m/s")


def test_power_with_inflow_is_that_on_the_robot(flight: xr.Dataset) -> None:
    """In still air the recorded power is the rate of the recorded work, inflow included."""
    power, work = flight["aero_power"].to_numpy(), flight["air_work"].to_numpy()
    time = flight["time"].to_numpy()
    done = np.append(0.0, np.cumsum(np.diff(time) * (power[1:] + power[:-1]) / 2))
    assert np.abs(done - work).max() < 1e-3 * np.abs(work).max()  # the trapezoid's own error


def test_a_wing_in_the_ground_is_found(flight: xr.Dataset) -> None:
    heights = flight["strip_point"].to_numpy()[:, :, 2]
    ground = float(np.median(heights))
    first = float(flight.time[int((heights < ground).any(axis=1).argmax())])
    aero = flight.attrs["aero"].replace('"gust": null', f'"gust": null, "ground": {ground}')
    (sentence,) = [w for w in sentences(flight.assign_attrs(aero=aero)) if "ground" in w]
    assert f"into the ground at {first:.3g} s" in sentence
    assert heights.min() < 0 and not [w for w in sentences(flight) if "ground" in w]
    shear = json.dumps(pt.air.WindShear(aero_of(flight), 2.0, exponent=1 / 7).describe())
    assert [w for w in sentences(flight.assign_attrs(aero=shear)) if "into the ground" in w]


@pytest.mark.parametrize("share", [0.02, 0.5])
def test_wings_too_slow_for_the_smoothing_are_told(flight: xr.Dataset, share: float) -> None:
    """The fastest strip of this flight moves at about 5 m/s."""
    slow = flight.assign(strip_airspeed=share * flight["strip_airspeed"])
    assert any("and forces err" in w for w in sentences(slow)) == (share < 0.1)


def test_a_vortex_ring_is_found(flight: xr.Dataset) -> None:
    """From half to twice the induced velocity of hover momentum theory does not hold."""
    names = list(aero_of(flight).state_names)
    induced = flight["aero_state"].copy()
    k = names.index("induced velocity of x")
    induced[:, k : k + 3] = np.array([0.0, 0.0, -1.0])
    for rising, found in ((0.2, False), (0.9, True), (3.0, False), (-0.9, False)):
        blown = flight.assign(
            wind=flight["wind"] * 0 + xr.DataArray([0.0, 0.0, rising], dims="axis"),
            aero_state=induced,
        )
        assert any("vortex ring" in w for w in sentences(blown)) == found, rising
    forward = flight.assign(
        wind=flight["wind"] * 0 + xr.DataArray([-3.0, 0.0, 0.9], dims="axis"), aero_state=induced
    )
    assert not any("vortex ring" in w for w in sentences(forward))


@pytest.mark.usefixtures("interpreted")
def test_a_wing_on_a_spring_is_told_of_the_force_point_that_moves() -> None:
    spring = "axis: -y, passive: true, stiffness: 1e-4 N m/rad, rest: 90 deg}"
    robot = load_robot_text(INSECT.replace("axis: -y}", spring))
    assert hinged_strips(robot) == [*range(len(robot.strips))]
    assert not hinged_strips(load_robot_text(INSECT))
    gait = pt.gaits.sinusoidal(robot, frequency=25.0, sweep=1.05)
    for point, told in (("switching", True), ("moving", False)):
        aero = pt.QuasiSteady(robot, force_point=point)
        flown = pt.simulate(robot, aero, gait, duration=0.1, time_step=1e-4)
        assert any("force_point" in w for w in sentences(flown)) == told


@pytest.mark.parametrize("verb", ["trim", "optimize"])
def test_searches_tell_of_it_too(verb: str, tmp_path: Path, capsys: Any) -> None:
    spring = "axis: -y, passive: true, stiffness: 1e-4 N m/rad, rest: 90 deg}"
    text = INSECT.replace("axis: -y}", spring)
    text += "cruise: {frequency: 25 Hz, amplitude: {sweep: 60 deg}, duration: 1 s}\n"
    (tmp_path / "held.yaml").write_text(text)
    with pytest.raises(SystemExit):
        run([verb, str(tmp_path / "held.yaml")])  # nothing of it floats
    err = capsys.readouterr().err
    assert "floating body" in err and "force_point" in err


@pytest.mark.parametrize("lowest, told", [(3.0, True), (30.0, False)])
@pytest.mark.usefixtures("interpreted")
def test_wings_that_clap_are_told(lowest: float, told: bool) -> None:
    # Four wings on one hinge a side, as of an X; both sides lie on one another at 0 degrees.
    plate = "{type: plate, chord: 7 cm, span: 14 cm, thickness: 0.1 mm}"
    text = "name: x\ngravity: 9.81 m/s^2\nbodies:\n  body: {mass: 12 g, shape: {type: point}}\n"
    wings = "wings:\n"
    for name in ("left_upper", "left_lower"):
        text += f"  {name}: {{parent: body, at: [0, 5 mm, 0], joints: [{{name: {name}_flap, "
        text += f"axis: x}}], mass: 1 g, center_of_mass: [-3 cm, 7 cm, 0], shape: {plate}}}\n"
        wings += f"  - name: {name}\n    segments: [{{body: {name}, strips: 5, stations: ["
        wings += "{span: 0 cm, leading: 1 cm, trailing: -6 cm}, "
        wings += "{span: 14 cm, leading: 1 cm, trailing: -6 cm}]}]\n"
    robot = load_robot_text(text + wings + "mirror: [{from: left, to: right}]\n", "x")
    mean = np.radians(lowest) + 0.3
    gait = pt.gaits.sinusoidal(
        robot, frequency=10.0, upper_flap=0.3, lower_flap=-0.3,
        offset={"upper_flap": mean, "lower_flap": -mean},
    )  # fmt: skip
    air = pt.QuasiSteady(robot, pt.Air(wind=(-3.0, 0.0, 0.0)))
    claps = [w for w in sentences(pt.simulate(robot, air, gait, duration=0.2)) if "clap" in w]
    assert len(claps) == told  # nothing was said
    if told:
        assert "upper and left_lower" in claps[0] or "upper and right_lower" in claps[0]
        assert "come within 0.1" in claps[0] or "come within 0.09" in claps[0]


@pytest.mark.parametrize("angle, told", [(90, False), (170, True)])
@pytest.mark.usefixtures("interpreted")
def test_a_wing_that_folds_over_itself_is_told(angle: float, told: bool) -> None:
    """Only different wings were compared: a hand over its arm had its own lift, untold."""
    plate = "{type: plate, chord: 5 cm, span: 8 cm, thickness: 1 mm}"
    text = "name: x\ngravity: 0 m/s^2\nbodies:\n  body: {mass: 12 g, shape: {type: point}}\n"
    edges = "leading: 1 cm, trailing: -4 cm}"
    segments, stations = "", f"stations: [{{span: 0 cm, {edges}, {{span: 8 cm, {edges}]"
    for name, parent, axis in (("arm", "body", "x"), ("hand", "arm", "z")):
        text += f"  {name}: {{parent: {parent}, at: [0, {8 * (name == 'hand')} cm, 0], joints: ["
        text += f"{{name: {name}_joint, axis: {axis}}}], mass: 1 g, center_of_mass: [0, 4 cm, 0], "
        text += f"shape: {plate}}}\n"
        segments += f"{{body: {name}, strips: 4, {stations}}}, "
    text += f"wings: [{{name: wing, segments: [{segments[:-2]}]}}]\n"
    robot = load_robot_text(text, "x")
    air = pt.QuasiSteady(robot, pt.Air(wind=(-5.0, 0.0, 0.0)))
    gait = pt.gaits.sinusoidal(
        robot, frequency=5.0, hand_joint=np.radians(angle / 2),
        offset={"hand_joint": -np.radians(angle / 2)},
    )  # fmt: skip
    said = [w for w in sentences(pt.simulate(robot, air, gait, duration=0.4)) if "cover" in w]
    assert len(said) == told
    assert not told or said[0].startswith("arm and hand come within")


@pytest.mark.usefixtures("interpreted")
def test_a_flight_without_weight_is_not_judged_by_it() -> None:
    robot = pt.load_robot("hawk").with_parameters({"gravity": 0.0})
    glide = pt.simulate(
        robot, pt.QuasiSteady(robot), pt.gaits.still(robot), duration=0.05, time_step=1e-3,
        v=robot.velocities(x=5.0, z=-2.0),
    )  # fmt: skip
    # It said "the air carries nan% of the weight".
    assert not [w for w in flight_summary(glide)["warnings"] if "nan" in w]


def test_a_hover_carries_its_weight_and_flies_no_way() -> None:
    # It said 1.003 of the weight, as first and last sample are one, and "flies backwards, at
    # 0.00012 m/s" of some.
    orbit = pt.trim(pt.load_robot("dragonfly"), speed=0.0)
    facts = flight_summary(orbit.flight(beats=2.0))
    assert facts["force_over_weight"] == pytest.approx(1.0, abs=2e-5)
    assert abs(facts["climb_rate"]) < 1e-6 and not [w for w in facts["warnings"] if "back" in w]

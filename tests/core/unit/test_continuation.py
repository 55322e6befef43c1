"""Continuation: a fold known in closed form, one of a robot, bifurcations, refusals, the verb."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from tests.robots import SPRUNG

import patagium as pt
from patagium.cli.main import run
from patagium.cli.trim import _branch, _range
from patagium.control import continue_orbit
from patagium.control.continuation import crossing_kind
from patagium.errors import ParameterError
from patagium.robot import load_robot_text
from patagium.robot.model import Actuator

from ...spoken import refusing_stdout

GLIDER = """
name: glider
gravity: 9.81
bodies:
  body:
    joints:
      - {name: x, type: prismatic, axis: x, passive: true}
      - {name: y, type: prismatic, axis: y, passive: true}
      - {name: z, type: prismatic, axis: z, passive: true}
      - {name: pitch, axis: y}
    mass: 0.1
    shape: {type: box, size: [0.1, 0.1, 0.1]}
wings:
  - name: wing
    segments:
      - body: body
        strips: 1
        stations: [{span: -0.4, leading: 0.02, trailing: -0.06},
                   {span: 0.4, leading: 0.02, trailing: -0.06}]
"""


def forward_speed(angle):
    """Speed forward of a steady glide at an angle of attack: u^2 = 2 m g C_L^2 / (rho S C^3)."""
    polar = pt.air.SmoothPolar()
    lift = polar.lift_amplitude * np.sin(2 * angle)
    drag = polar.zero_lift_drag + polar.drag_rise * np.sin(angle) ** 2
    total = np.hypot(lift, drag)
    return np.sqrt(2 * 0.1 * 9.81 / (1.225 * 0.064 * total)) * lift / total


@pytest.fixture(scope="module")
def aerobat():
    return pt.trim(pt.load_robot("aerobat"), speed=2.95)


def test_parameters_along_a_branch_count_from_the_same_gait(aerobat):
    told: list[tuple[int, int]] = []
    branch = continue_orbit(
        aerobat, "speed", (2.9, 3.0), progress=lambda done, total: told.append((done, total))
    )
    assert told == sorted(told) and told[-1][0] == len(branch.orbits) - 2 < told[-1][1] == 400
    place = int(np.argmin(np.abs(branch.values - aerobat.speed)))
    own = branch.orbits[place].parameters
    assert own == pytest.approx(aerobat.parameters, abs=1e-6)
    again = pt.trim(
        aerobat.robot, free=branch.free, gait=aerobat.gait, speed=float(branch.values[-1])
    )
    joints = [one.gait.motion(np.zeros(1)).position for one in (branch.orbits[-1], again)]
    np.testing.assert_allclose(*joints, atol=1e-6)


def test_a_fold_is_passed_where_its_closed_form_is():
    robot = load_robot_text(GLIDER)
    aero = pt.QuasiSteady(robot, polar=pt.air.SmoothPolar())
    orbit = pt.trim(
        robot, aero, pt.gaits.still(robot, pitch=0.1), climb=None, free=("pitch_offset",), steps=240
    )
    assert orbit.found, orbit
    branch = continue_orbit(orbit, "speed", (orbit.speed - 1.0, orbit.speed + 5.0), hold=())
    fold = next(one for one in branch.bifurcations if one.kind == "fold")
    best = minimize_scalar(
        lambda angle: -forward_speed(angle), bounds=(0.01, 0.5), method="bounded"
    )
    assert fold.value == pytest.approx(-best.fun, rel=1e-6)  # of bisection, squared
    turn = int(np.argmax(branch.values))
    assert 0 < turn < len(branch.values) - 1  # both sides of the fold
    assert max(orbit.residual for orbit in branch.orbits) <= 1e-12
    with pytest.raises(ParameterError, match="2 free parameters that move the conditions"):
        continue_orbit(orbit, "speed", (orbit.speed - 1.0, orbit.speed + 1.0))


def test_a_robot_passes_a_fold_and_multipliers_vary_continuously(aerobat):
    branch = continue_orbit(aerobat, "speed", (2.5, 3.0))
    assert branch.ends == ("the limit 3 m/s", "the limit 3 m/s")
    kinds = [one.kind for one in branch.bifurcations]
    assert kinds.count("fold") == 1 and "branch point" in kinds
    fold = branch.bifurcations[kinds.index("fold")]
    next_to = branch.orbits[int(np.argmin(branch.values)) + 2]
    near = {"gait": next_to.gait, "start": next_to, "free": branch.free}
    assert pt.trim(aerobat.robot, speed=fold.value + 1e-3, **near).found
    assert not pt.trim(aerobat.robot, speed=fold.value - 1e-3, **near).found  # none below
    crossing = branch.bifurcations[kinds.index("branch point")]
    assert abs(crossing.multiplier) == pytest.approx(1.0, abs=1e-6)
    sizes = np.abs(branch.multipliers)
    assert np.abs(np.diff(sizes[:, :4], axis=0)).max() < 0.1
    assert all(one.climb == pytest.approx(0.0, abs=1e-10) for one in branch.orbits)
    for row, orbit in list(zip(branch.summary(), branch.orbits, strict=True))[::4]:
        assert row["stable"] == pt.control.floquet(orbit).stable
    assert f"fold at {fold.value:.5g} m/s" in repr(branch)
    # Its two ends stood there, "3 to 3 m/s".
    assert f"along speed, {branch.values.min():.4g} to 3 m/s" in repr(branch)


def test_a_gait_parameter_is_a_parameter_too(aerobat):
    value = aerobat.parameters["frequency"]
    branch = continue_orbit(aerobat, "frequency", (value - 0.2, value))
    assert branch.values[0] == pytest.approx(value - 0.2, abs=1e-11)
    assert branch.orbits[-1].gait.frequency == pytest.approx(value)
    assert "frequency" in branch.free and len(branch.free) == 2  # and one that keeps the climb
    assert max(one.residual for one in branch.orbits) <= 1e-12


@pytest.mark.parametrize("most", [1.0, 0.102])
def test_a_branch_goes_up_to_the_limit_of_an_actuator(aerobat, most):
    """It ended a whole step before, or beyond it where the end asked for was beyond it."""
    actuators = {"feather_phase": Actuator("rad", (-0.1, 0.1), 5.0, 0.1, 1.0)}
    robot = replace(aerobat.robot, actuators=actuators)
    orbit = pt.trim(robot, free=("plunge_amplitude", "feather_offset"))
    branch = continue_orbit(orbit, "feather_phase", (-most, most))
    assert np.abs(branch.values[[0, -1]]) == pytest.approx([0.1, 0.1], abs=1e-4)
    assert all("its actuator gives -5.7" in end for end in branch.ends)


def test_a_branch_ends_where_a_passive_joint_comes_to_its_limit():
    """Its orbits went on, and could not be flown."""
    robot = load_robot_text(SPRUNG.replace("[-45 deg, 45 deg]", "[-45 deg, 37.3 deg]"))
    orbit = pt.trim(robot)
    branch = continue_orbit(orbit, "speed", (orbit.speed, orbit.speed + 1), points=20)
    assert branch.ends[1].startswith("left_feather would go from ")
    turned = branch.orbits[-1].flight(beats=1).q.sel(dof="left_feather").max().item()
    # steps of the branch end at 1e-4 of the longest, which changes the angle by a degree or so;
    # a beat of 240 steps misses .003 deg of its peak
    assert 37.29 < np.degrees(turned) < 37.3


def test_crossings_bear_the_names_of_the_field():
    assert crossing_kind(-1.0 + 0j) == "flip"
    assert crossing_kind(np.exp(1j)) == "Neimark-Sacker"
    assert crossing_kind(1.0 + 0j) == "branch point"


def test_limits_whose_difference_is_no_number_are_refused(aerobat):
    """Steps were then infinite, and half of one still is: the walk never ended."""
    with pytest.raises(ParameterError, match=r"limits.*a finite number apart"):
        continue_orbit(aerobat, "speed", (-1e308, 1e308), points=2)


def test_refusals(aerobat):
    with pytest.raises(ParameterError, match="hold the orbit's speed"):
        continue_orbit(aerobat, "speed", (4.0, 5.0))
    with pytest.raises(ParameterError, match="along"):
        continue_orbit(aerobat, "plunge", (0.0, 1.0))
    with pytest.raises(ParameterError, match="hold: expected one of speed, climb"):
        continue_orbit(aerobat, "speed", (2.0, 3.0), hold=("yaw",))
    for points in (0, -1):
        with pytest.raises(ParameterError, match="points: expected one orbit at least"):
            continue_orbit(aerobat, "speed", (2.0, 3.0), points=points)


def test_the_verb_shows_a_branch_and_a_picture(tmp_path, capsys):
    picture = tmp_path / "branch.svg"
    words = ["trim", "aerobat", "--along", "speed=3.9:4.1", "--figure", str(picture)]
    with pytest.raises(SystemExit) as left:
        run([*words, "--json"])
    assert not left.value.code
    told = json.loads(capsys.readouterr().out)
    ends = [told["orbits"][k]["speed_m/s"] for k in (0, -1)]
    assert ends == pytest.approx([3.9, 4.1], rel=1e-12)
    assert picture.read_text("utf-8").startswith("<?xml")
    with pytest.raises(SystemExit) as left:
        run(["trim", "aerobat", "--along", "speed"])
    assert left.value.code == 2


def test_a_branch_is_drawn_where_stdout_takes_nothing(aerobat, tmp_path):
    """The picture was lost when printing the table failed."""
    branch, picture = continue_orbit(aerobat, "speed", (2.94, 2.96)), tmp_path / "branch.svg"
    with refusing_stdout(pipe=False), pytest.raises(OSError, match="No space left"):
        _branch(branch, picture, as_json=False)
    assert picture.read_text("utf-8").startswith("<?xml")


@pytest.mark.parametrize("words", ["speed=4.1:3.9", "speed=390:410 cm/s", "speed=3.9 m/s:410 cm/s"])
def test_a_range_falls_or_has_units(words):
    name, limits = _range(words, {"speed": "m/s"})
    assert (name, limits) == ("speed", pytest.approx((3.9, 4.1)))

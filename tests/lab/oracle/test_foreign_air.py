"""Foreign air: records give back the other program's force, in its right place and time."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from patagium.aerodynamics import Air
from patagium.dynamics.dynamics import poses_at
from patagium.errors import ParameterError
from patagium.learning.default_learner import default_network
from patagium.learning.models.linear_strip import LinearStripNetwork
from patagium.learning.samples import samples
from patagium.learning.what_if import what_if
from patagium.sensing import training_data
from patagium.simulation import gait_period, load_flight
from patagium_lab.foreign import flights as foreign
from patagium_lab.foreign.kinematics import GaitRange, JointRange, Wingbeat, draw_wingbeats
from patagium_lab.foreign.mujoco_air import MujocoAir, free_flight, mounted_flight
from patagium_lab.foreign.record import foreign_record
from patagium_lab.foreign.subjects import FREE, LATTICE, MOUNTED, SUBJECTS, subject_robot
from patagium_lab.foreign.vortex_lattice import lattice_flight, lattice_solver, lattice_wrench
from patagium_lab.foreign.wings import WINGS, SingleWing

ROUNDING = 1e-9  # of inverse dynamics by two programs, over the largest force
GLIDE = Wingbeat(4.0, 5.0, 0.08, {"plunge": 0.0}, {"plunge": 0.0}, {"plunge": 0.0})
BEAT = Wingbeat(5.0, 3.0, 0.1, {"plunge": 0.5, "feather": 0.3, "sweep": 0.2}, {"feather": 1.2}, {})


def close(found: np.ndarray, expected: np.ndarray, tolerance: float = ROUNDING) -> None:
    assert np.abs(found - expected).max() <= tolerance * np.abs(expected).max()


def test_wingbeats_fill_their_ranges_and_only_the_seed_draws_them() -> None:
    ranges = GaitRange((4.0, 8.0), (2.0, 5.0), (0.0, 0.1), (JointRange("plunge", (0.2, 0.6)),))
    beats = draw_wingbeats(ranges, 8, 3)
    assert beats == draw_wingbeats(ranges, 8, 3) != draw_wingbeats(ranges, 8, 4)
    slots = sorted(int((beat.frequency - 4.0) / 4.0 * 8) for beat in beats)
    assert slots == list(range(8))  # each eighth of the range once
    assert {beat.phase["plunge"] for beat in beats} == {0.0}


@pytest.mark.parametrize("air", SUBJECTS)
def test_robots_and_gaits_are_kept_apart_by_the_seed(air: str) -> None:
    cases = foreign.cases(air, 13, gaits_apart=4, robots_apart=1)
    robots = {case.robot for case in cases}
    assert len(robots) >= 4 and len(cases) == foreign.GAITS * len(robots)
    apart = {robot: sum(c.apart for c in cases if c.robot == robot) for robot in robots}
    assert sorted(apart.values()) == [4] * (len(robots) - 1) + [foreign.GAITS]
    assert cases == foreign.cases(air, 13, gaits_apart=4, robots_apart=1)
    machines = {robot: subject_robot(robot) for robot in robots}
    for case in cases:
        case.wingbeat().gait(machines[case.robot])  # within the robot's limits


def test_a_flight_on_a_mount_gives_back_the_force_of_mujoco() -> None:
    pytest.importorskip("mujoco", reason="MuJoCo comes with the extra `bench`")
    robot, time = subject_robot("aerobat"), np.arange(40) * 1e-3
    wingbeat = foreign.Case(MOUNTED, "aerobat", 0, 13, False).wingbeat()
    flight = foreign_record(*mounted_flight(robot, wingbeat, time))
    _, state, force = training_data(flight)
    theirs = MujocoAir(robot, Air()).forces(state[:, : robot.dof], state[:, robot.dof :])
    close(force, theirs)
    close(flight["aero_force"].values, theirs)
    assert not flight["u1"].values[:, robot.passive].any()
    assert gait_period(flight) == pytest.approx(1.0 / wingbeat.frequency)


def test_the_air_of_mujoco_moves_with_its_wind() -> None:
    pytest.importorskip("mujoco", reason="MuJoCo comes with the extra `bench`")
    robot = WINGS["wing-tapered"].robot()
    q, v = np.zeros((1, robot.dof)), np.zeros((1, robot.dof))
    q[0, robot.index("pitch")] = -0.1
    still = MujocoAir(robot, Air(wind=(-4.0, 0.0, 0.0))).forces(q, v)
    v[0, robot.index("x")] = 4.0
    moving = MujocoAir(robot, Air()).forces(q, v)
    close(still, moving)
    assert moving[0, robot.index("z")] > 0 > moving[0, robot.index("x")]  # lift and drag


def test_mujoco_flies_what_our_dynamics_explain() -> None:
    pytest.importorskip("mujoco", reason="MuJoCo comes with the extra `bench`")
    robot, time = subject_robot("ornithopter"), np.arange(60) * 1e-3
    wingbeat = foreign.Case(FREE, "ornithopter", 0, 13, False).wingbeat()
    flights = [
        foreign_record(*free_flight(robot, wingbeat, time, body_drag=drag))
        for drag in (False, True)
    ]
    for flight in flights:
        scale = np.abs(flight["aero_force"].values).max()
        assert np.abs(flight["mount_force"].values).max() < ROUNDING * scale  # nobody holds it
        q, v, a = (flight[name].values for name in "qva")
        # central differences of samples 1 ms apart, over 4 Hz wingbeats
        close((q[2:] - q[:-2]) / 2e-3, v[1:-1], 1e-3)
        close((v[2:] - v[:-2]) / 2e-3, a[1:-1], 1e-2)
        gait = wingbeat.gait(robot).motion(time)
        close(q[:, list(robot.actuated)], gait.position, 1e-3)
    plain, dragged = (flight["aero_force"].values[0, robot.index("x")] for flight in flights)
    assert dragged < plain  # the body is held back


def test_a_stored_wing_is_a_whole_flight(tmp_path: Path) -> None:
    keys = foreign.stored_wrenches()
    assert foreign.STORED.stat().st_size < 200e3
    cases = [case for case in _lattice_cases() if case.key in keys]
    assert {case.robot for case in cases} == set(WINGS) and {case.apart for case in cases} == {
        True,
        False,
    }
    flight = foreign.kept_flight(cases[0], tmp_path)
    assert cases[0].path(tmp_path).is_file() and flight.equals(load_flight(cases[0].path(tmp_path)))
    _, _, force = training_data(flight)
    close(force, flight["aero_force"].values)


def _lattice_cases() -> list[foreign.Case]:
    return foreign.cases(LATTICE, 13, gaits_apart=4, robots_apart=2)


def test_a_wrench_on_the_wing_does_the_work_of_its_generalized_force() -> None:
    wing = WINGS["wing-slender"]
    count = 61
    constant = np.tile([0.3, -0.2, 0.5, 0.04, -0.03, 0.02], (count, 1))
    _, _, (q, v, _), force = lattice_flight(wing, BEAT, 1e-3, constant)
    robot = wing.robot()
    _, rotation = poses_at(robot, q)
    hub, blade = rotation[:, robot.body_index("hub")], rotation[:, robot.body_index("wing")]
    spin = blade[2:] @ blade[:-2].transpose(0, 2, 1) / 2e-3  # its skew part is the rate
    rate = np.stack([spin[:, 2, 1] - spin[:, 1, 2], spin[:, 0, 2] - spin[:, 2, 0],
                     spin[:, 1, 0] - spin[:, 0, 1]], axis=1) / 2  # fmt: skip
    push, twist = hub[1:-1] @ constant[0, :3], hub[1:-1] @ constant[0, 3:]
    power = (push * v[1:-1, :3]).sum(axis=1) + (twist * rate).sum(axis=1)
    # differences over 2 ms of a beat of 200 ms
    close((force * v).sum(axis=1)[1:-1], power, 2e-3)


def test_the_lattice_moves_as_the_robot_does() -> None:
    pytest.importorskip("pterasoftware", reason="PteraSoftware comes with the extra `foreign`")
    wing = WINGS["wing-slender"]
    robot, steps = wing.robot(), 20
    solver = lattice_solver(wing, BEAT, Air(), steps)
    for step in (3, 17):
        panels = solver.steady_problems[step].airplanes[0].wings[0].panels
        motion = BEAT.gait(robot).motion(np.array([step / (steps * BEAT.frequency)]))
        q = np.zeros((1, robot.dof))
        q[:, list(robot.actuated)] = motion.position
        _, rotation = poses_at(robot, q)
        turn = rotation[0, robot.body_index("wing")]
        edges = [(wing.ahead, wing.root, 0.0), (wing.ahead - wing.root_chord, wing.root, 0.0)]
        found = panels[0][0].Flpp_G_Cg, panels[-1][0].Blpp_G_Cg
        for place, theirs in zip(edges, found, strict=True):
            np.testing.assert_allclose(turn @ place, np.array(theirs) * [-1, 1, 1], atol=1e-9)


def test_the_lattice_lifts_a_still_wing_as_theory_does() -> None:
    pytest.importorskip("pterasoftware", reason="PteraSoftware comes with the extra `foreign`")
    wing = SingleWing("long", 0.1, 0.1, 0.6, 0.0)
    wrench = lattice_wrench(wing, GLIDE, steps=8)[-1]
    ratio, pressure = 0.6 / 0.1, 0.5 * 1.225 * GLIDE.speed**2
    slope = 2 * np.pi * ratio / (2 + np.sqrt(4 + ratio**2))  # Helmbold
    lift = wrench[2] * np.cos(GLIDE.incidence) - wrench[0] * np.sin(GLIDE.incidence)
    assert lift == pytest.approx(pressure * 0.06 * slope * GLIDE.incidence, rel=0.1)  # a lattice
    assert wrench[3] > 0  # it raises the left wing


@pytest.mark.parametrize("name", ["mujoco", "pterasoftware"])
def test_without_the_program_a_sentence_says_what_to_install(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ParameterError, match=r"pip install 'patagium-lab\[foreign\]'"):
        if name == "mujoco":
            MujocoAir(subject_robot("wing-square"), Air())
        else:
            lattice_wrench(WINGS["wing-square"], BEAT)


def test_a_record_leaves_untold_what_the_program_does_not_tell() -> None:
    case = next(c for c in _lattice_cases() if c.key in foreign.stored_wrenches())
    flight: xr.Dataset = foreign.make_flight(case)
    assert np.isnan(flight["strip_force"].values).all()
    assert "PteraSoftware" in flight.attrs["aero"]


@pytest.mark.parametrize(("wing", "gait"), [("wing-swept", 1), ("wing-tapered", 0)])
def test_attached_flow_is_not_asked_for_a_side_wind(wing: str, gait: int) -> None:
    """The suction of its side edges was mistaken for a side wind of half a meter a second."""
    flight = foreign.make_flight(foreign.Case(LATTICE, wing, gait, 13, apart=False))
    network = default_network(flight)
    assert isinstance(network, LinearStripNetwork) and network.attached
    time, x, y, _ = samples(flight, network)
    assert what_if(network, (time, x, y), None, gait_period(flight)) == []

"""A robot whose attitude is a quaternion: its file, coordinates, flights, networks, packets."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.flights import stored

import patagium as pt
from patagium.cli.main import run
from patagium.dynamics.dynamics import poses_at
from patagium.errors import FlightError, ParameterError, RobotFileError, ShapeError
from patagium.live.packets import flight_packets
from patagium.live.record import StreamFile
from patagium.report.figures import flight_overview
from patagium.robot import load_robot_text, preset_text
from patagium.robot.attitude import (
    body_accelerations,
    body_rates,
    quaternion_from_angles,
    without_flips,
)
from patagium.robot.drawing import draw_robot
from patagium.robot.planform import describe_robot, poses
from patagium.sensing.force.air_force import packet_columns
from patagium.viewer import replay


def _matrix(quaternions):
    """Body axes to world axes, (..., 3, 3), of quaternions qw, qx, qy, qz."""
    return Rotation.from_quat(np.roll(quaternions, -1, axis=-1)).as_matrix()


def _angles(quaternions):
    """Roll, pitch, yaw, (..., 3) [rad], of quaternions qw, qx, qy, qz."""
    return Rotation.from_quat(np.roll(quaternions, -1, axis=-1)).as_euler("ZYX")[..., ::-1]


AEROBAT = preset_text("aerobat")


@pytest.fixture(scope="module")
def pair(glider):
    return glider("euler"), glider("quaternion")


@pytest.fixture(scope="module")
def flight(pair):
    robot = pair[1]
    gait = pt.gaits.sinusoidal(robot, frequency=6.0, left_plunge=0.4, right_plunge=0.4)
    return pt.simulate(
        robot, pt.QuasiSteady(robot), gait, duration=0.2, time_step=5e-4,
        q=robot.coordinates(pitch=-0.3), v=robot.velocities(x=6.0, roll=2.0),
    )  # fmt: skip


def test_q_is_longer_than_v():
    robot = pt.load_robot("aerobat").with_attitude("quaternion")
    assert robot.dof == 14 and robot.coordinate_count == 15 and robot.state_size == 29
    assert robot.dof_names == pt.load_robot("aerobat").dof_names
    assert robot.coordinate_names[:8] == ("x", "y", "z", "qw", "qx", "qy", "qz", "left_plunge")
    assert robot.coordinate_units == ("m",) * 3 + ("1",) * 4 + ("rad",) * 8
    assert robot.floating_coordinates(robot.bodies[0]) == tuple(range(7))
    assert robot.coordinate_indices == (0, 1, 2, *range(4, 15))


def test_a_robot_with_angles_is_as_it_was():
    robot = pt.load_robot("aerobat")
    assert robot.attitude == "euler" and robot.coordinate_names == robot.dof_names
    assert robot.coordinate_indices == tuple(range(14)) and robot.state_size == 28
    assert pt.load_robot("yeo-wing").attitude is None


def test_coordinates_may_stand_in_any_order():
    """qw before the first of roll, pitch and yaw, wherever the file puts them."""
    text = AEROBAT.replace("[x, y, z, roll, pitch, yaw,", "[x, yaw, z, roll, pitch, y,")
    shuffled = load_robot_text(text).with_attitude("quaternion")
    assert shuffled.coordinate_names[:7] == ("x", "qw", "qz", "z", "qx", "qy", "y")
    assert shuffled.coordinate_indices == (0, *range(2, 15))
    straight = pt.load_robot("aerobat").with_attitude("quaternion")
    start = {"x": 1.0, "roll": 0.3, "pitch": -2.0, "yaw": 0.5, "left_elbow": 0.2}
    drawn = [poses(robot, robot.coordinates(**start)) for robot in (shuffled, straight)]
    for one, other in zip(*drawn, strict=True):
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1], other[1])


def test_coordinates_are_given_as_angles(pair):
    angles = {"roll": 0.3, "pitch": -1.2, "yaw": 2.0}
    by_angles, by_quaternion = (robot.coordinates(z=1.0, **angles) for robot in pair)
    assert by_quaternion[2] == 1.0
    np.testing.assert_array_equal(by_quaternion[3:7], quaternion_from_angles(list(angles.values())))
    for one, other in zip(poses(pair[0], by_angles), poses(pair[1], by_quaternion), strict=True):
        # rounding: half angles here, angles there
        np.testing.assert_allclose(one[0], other[0], atol=1e-15)
        np.testing.assert_allclose(one[1], other[1], atol=1e-15)
    np.testing.assert_array_equal(pair[1].coordinates()[3:7], [1.0, 0.0, 0.0, 0.0])
    assert pair[1].velocities(roll=2.0).tolist() == [0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0]
    with pytest.raises(ParameterError, match="qw"):
        pair[1].coordinates(qw=1.0)


def test_rates_of_angles_become_rates_of_the_body(rng):
    angles, rates, h = rng.normal(size=(5, 3)), rng.normal(size=(5, 3)), 1e-6
    before, after = (_matrix(quaternion_from_angles(angles + k * h * rates)) for k in (-1, 1))
    turning = np.swapaxes(before + after, -1, -2) / 2 @ ((after - before) / (2 * h))
    found = np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], axis=-1)
    np.testing.assert_allclose(found, body_rates(angles, rates), atol=1e-9)  # central difference

    faster = rng.normal(size=(5, 3))
    earlier, later = (body_rates(angles + k * h * rates, rates + k * h * faster) for k in (-1, 1))
    expected = (later - earlier) / (2 * h)
    np.testing.assert_allclose(body_accelerations(angles, rates, faster), expected, atol=1e-8)


def test_the_file_says_what_the_attitude_is():
    written = AEROBAT.replace(
        "    floating: true\n", "    floating: true\n    attitude: quaternion\n"
    )
    robot = load_robot_text(written)
    assert robot == pt.load_robot("aerobat").with_attitude("quaternion")
    assert pt.load_robot("aerobat").with_attitude("quaternion").source == written
    assert robot.with_attitude("euler") == pt.load_robot("aerobat")
    assert load_robot_text(robot.with_attitude("euler").source).attitude == "euler"
    assert load_robot_text(robot.with_parameters({"body.mass": 0.02}).source) == replace(
        robot.with_parameters({"body.mass": 0.02})
    )


def test_a_source_written_in_an_unusual_way_is_changed_too():
    text = AEROBAT.replace("    floating: true\n", "    'floating': yes\n")
    robot = load_robot_text(text).with_attitude("quaternion")
    assert load_robot_text(robot.source) == robot
    assert replace(robot, source="").with_attitude("euler").source == ""


def test_what_carries_another_has_the_attitude(pair):
    """A glider on a floating glider: the carrier's attitude is that of both."""
    robot = pair[0].mounted_on(pair[1], "tail")
    assert robot.attitude == "quaternion" and robot.coordinate_names[3] == "arm_qw"
    assert robot.dof == 10 and robot.coordinate_count == 11
    assert load_robot_text(robot.source) == replace(robot, name=load_robot_text(robot.source).name)
    again = load_robot_text(robot.with_attitude("euler").source)
    assert again.attitude == "euler" and again.coordinate_count == 10
    np.testing.assert_array_equal(
        robot.coordinates(arm_pitch=-1.5)[3:7], quaternion_from_angles([0.0, -1.5, 0.0])
    )
    by_name = "robot: aerobat\nmounted_on: aerobat\nat: left_plate\n"
    with pytest.raises(ParameterError, match="set there, found 'aerobat'"):
        load_robot_text(by_name).with_attitude("quaternion")


@pytest.mark.usefixtures("interpreted")
def test_a_path_carries_a_robot_with_a_quaternion_as_one_with_angles(pair):
    """Through way-points in all six, with a load cell under the hub: the same wrenches."""
    flights = []
    for robot in pair:
        path = pt.paths.waypoints(
            [0.0, 0.2, 0.4, 0.6],
            [
                [0.0, 0.0, 1.0, 0.1, -0.2, 0.3],
                [0.3, 0.1, 1.2, 0.4, 0.5, -0.2],
                [0.5, 0.3, 1.1, -0.3, 0.2, 0.6],
                [0.6, 0.2, 1.0, 0.0, 0.1, 0.2],
            ],
        )
        gait = pt.gaits.sinusoidal(robot, frequency=6.0, left_plunge=0.4, right_plunge=0.3)
        flights.append(
            pt.simulate(
                robot,
                pt.QuasiSteady(robot),
                gait,
                duration=0.5,
                time_step=1e-3,
                mount=pt.mounts.carried(path),
                load_cells=[pt.mounts.load_cell("hub")],
            )  # fmt: skip
        )
    by_angles, by_quaternion = flights
    lengths = np.linalg.norm(by_quaternion.q.values[:, 3:7], axis=1)
    np.testing.assert_allclose(lengths, 1.0, atol=1e-15)
    for name in ("strip_force", "mount_wrench", "load_cell_wrench", "u1", "kinetic_energy"):
        ours, theirs = by_quaternion[name].values, by_angles[name].values
        scale = np.abs(theirs).max()
        assert scale > 1e-4
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-11 * scale)  # rounding


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "floating: true\n",
            "floating: true\n    attitude: qaternion\n",
            "one of euler, quaternion, found 'qaternion'",
        ),
        (
            "parent: body\n",
            "parent: body\n    attitude: quaternion\n",
            "a body that is not floating",
        ),
    ],
)
def test_files_that_name_a_wrong_attitude_are_refused(old, new, words):
    with pytest.raises(RobotFileError, match=words):
        load_robot_text(AEROBAT.replace(old, new, 1))


def test_attitudes_that_cannot_be_are_refused():
    with pytest.raises(ParameterError, match="one of euler, quaternion"):
        pt.load_robot("aerobat").with_attitude("angles")
    with pytest.raises(ParameterError, match="a robot that floats"):
        pt.load_robot("yeo-wing").with_attitude("quaternion")


def test_a_joint_must_not_have_the_name_of_a_quaternions_part():
    box = "shape: {type: box, size: [1 cm, 1 cm, 1 cm]}"
    text = f"""
name: top
gravity: 9.8 m/s^2
bodies:
  body: {{floating: true, mass: 1 g, {box}}}
  wheel: {{parent: body, joints: [{{name: qx, axis: x}}], mass: 1 g, {box}}}
"""
    with pytest.raises(ParameterError, match="named once, found 'qx again'"):
        load_robot_text(text).with_attitude("quaternion")
    written = text.replace("floating: true", "floating: true, attitude: quaternion")
    with pytest.raises(RobotFileError, match=r"bodies.body.attitude: expected .* a joint qx too"):
        load_robot_text(written)


def test_a_flight_has_a_dimension_for_q(flight, pair, tmp_path):
    robot = pair[1]
    assert flight.q.dims == ("time", "coordinate") and flight.v.dims == ("time", "dof")
    assert tuple(flight.coordinate.values) == robot.coordinate_names
    assert flight.q.attrs["units"] == "m, rad or 1"
    again = pt.load_flight(pt.save_flight(flight, tmp_path / "f.nc"))
    assert again.identical(stored(flight))
    from patagium.simulation import robot_of

    assert robot_of(again) == robot
    angles = _angles(flight.q.sel(coordinate=["qw", "qx", "qy", "qz"]).values)
    assert np.ptp(angles[:, 0]) > 0.05
    with pytest.raises(FlightError, match="q: expected .*'coordinate'"):
        pt.save_flight(
            flight.assign(q=flight.v.assign_attrs(units="m, rad or 1")), tmp_path / "g.nc"
        )
    with pytest.raises(FlightError, match=r"coordinate: expected 9 .* in place of x, y, z, qw"):
        wrong = flight.assign_coords(coordinate=[f"c{k}" for k in range(9)])
        pt.save_flight(wrong, tmp_path / "g.nc")


def test_a_flight_and_a_robot_are_drawn(flight, pair):
    titles = [axes.get_title(loc="left") for axes in flight_overview(flight).axes]
    assert titles.count("Attitude") == 1 and "Joints" in titles
    assert describe_robot(pair[1])["coordinates"] == 9
    assert describe_robot(pair[1])["attitude"] == "quaternion"
    assert len(draw_robot(pair[1], flight.q.values[-1]).axes) == 3


@pytest.mark.usefixtures("interpreted")
def test_networks_that_know_the_wings_see_the_same(flight, pair):
    """In other coordinates the same networks say the same force, to rounding."""
    _, x, force = pt.training_data(flight)
    assert x.shape == (401, 17) and force.shape == (401, 8)
    # inverse dynamics of the recorded accelerations against the force that made them
    np.testing.assert_allclose(force, flight.aero_force.values, atol=1e-12)
    angles, rates = _angles(x[:, 3:7]), x[:, 12:15]
    matrix = np.stack([body_rates(angles, np.tile(unit, (401, 1))) for unit in np.eye(3)], axis=-1)
    of_angles = np.linalg.solve(matrix, rates[..., None])[..., 0]
    other = np.hstack([x[:, :3], angles, x[:, 7:9], x[:, 9:12], of_angles, x[:, 15:]])
    networks = [pt.StripNetwork(robot, (4,)) for robot in pair]
    assert networks[1].inputs >= 17
    weights = networks[0].initial(3)
    said = [n(s[200], weights) for n, s in zip(networks, [other, x], strict=True)]
    same = [0, 1, 2, 6, 7]  # forces, and moments at hinges
    scale = np.abs(said[0]).max()
    np.testing.assert_allclose(said[1][same], said[0][same], rtol=0, atol=1e-10 * scale)
    turned = matrix[200].T @ said[1][3:6]
    np.testing.assert_allclose(turned, said[0][3:6], rtol=0, atol=1e-10 * scale)


def test_a_learner_learns_a_flight(flight):
    from patagium.simulation import robot_of

    network = pt.StripNetwork(robot_of(flight), hidden=(4,))
    learner = pt.CubatureLearner(network, prior_std=0.3, measurement_std=1e-3)
    result = pt.identify(flight, learner, every=4)
    assert result.scores["nmse"]["z"] < 0.1


def test_a_flight_is_replayed(flight, pair, tmp_path):
    network = pt.StripNetwork(pair[1], hidden=(4,))
    learner = pt.CubatureLearner(network, prior_std=0.3, measurement_std=1e-3)
    page = replay(flight, tmp_path / "f.html", predicted=learner).read_text()
    assert "qw" in page and "nan" not in page.lower().split("<script")[0]
    position, rotation = poses_at(pair[1], flight.q.values)
    np.testing.assert_array_equal(position[:, 0], flight.q.values[:, :3])
    expected = _matrix(flight.q.values[:, 3:7])
    np.testing.assert_allclose(rotation[:, 0], expected, atol=1e-15)  # rounding


@pytest.mark.usefixtures("interpreted")
def test_cycles_of_a_hover_look_where_the_nose_points(pair):
    lifts = []
    for robot in pair:
        gait = pt.gaits.sinusoidal(robot, frequency=6.0, left_plunge=0.4, right_plunge=0.4)
        held = pt.simulate(
            robot, pt.QuasiSteady(robot), gait, duration=0.5, time_step=5e-4,
            q=robot.coordinates(yaw=2.0, pitch=-0.5), mount=pt.mounts.fixed(),
        )  # fmt: skip
        lifts.append(pt.cycle_statistics(held)["thrust"].values)
    assert np.abs(lifts[0]).max() > 1e-3
    np.testing.assert_allclose(lifts[1], lifts[0], atol=1e-12)  # rounding


def test_packets_hold_q_as_it_is(flight, pair, tmp_path):
    robot = pair[1]
    names = [column.name for column in packet_columns(robot)]
    assert names[1:10] == [f"q.{name}" for name in robot.coordinate_names] and len(names) == 34
    packets = flight_packets(flight)[:50]
    assert packets.shape == (50, 34)
    network = pt.StripNetwork(robot, hidden=(4,))
    pipelines = [
        pt.Pipeline(pt.CubatureLearner(network, prior_std=0.3, measurement_std=1e-3), robot)
        for _ in range(2)
    ]
    pipelines[1]._chain = None
    compiled, in_python = (pipeline.run(packets) for pipeline in pipelines)
    np.testing.assert_allclose(compiled.measurement, flight.aero_force.values[:50], atol=1e-12)
    np.testing.assert_allclose(in_python.prediction, compiled.prediction, atol=1e-9)
    file = StreamFile(tmp_path / "s.nc", pipelines[0])
    file.append(packets, compiled)
    import xarray as xr

    with xr.open_dataset(file.close({})) as kept:
        assert kept.q.dims == ("time", "coordinate")
        np.testing.assert_array_equal(kept.q.values, flight.q.values[:50])
        np.testing.assert_array_equal(kept.u1.values, flight.u1.values[:50])


def test_training_data_names_what_it_lacks(flight, pair):
    with pytest.raises(FlightError, match=r"q: expected \(time, dof\), found"):
        pt.training_data(flight, pair[0])


@pytest.mark.usefixtures("interpreted")
def test_the_command_line_flies_straight_up(pair, tmp_path, capsys):
    file, path = tmp_path / "glider.yaml", tmp_path / "up.nc"
    file.write_text(pair[0].source)
    words = [
        "simulate", str(file), "--pitch", "-90 deg", "--speed", "3", "--gait", "still",
        "--duration", "5 ms", "--time-step", "1e-4", "-o", str(path), "--json",
    ]  # fmt: skip

    def say(*said):
        with pytest.raises(SystemExit) as left:
            run(list(said))
        return left.value.code or 0, capsys.readouterr()

    code, answer = say(*words, "--attitude", "quaternion")
    assert code == 0 and json.loads(answer.out)["outcome"] == "COMPLETED"
    assert pt.load_flight(path).q.dims == ("time", "coordinate")
    assert say("check", str(path), "--json")[0] == 0
    code, answer = say(*words)
    assert code == 2 and "--attitude quaternion" in answer.err


def test_starts_that_cannot_be_are_refused(pair):
    robot = pair[1]
    fly = {"duration": 1e-3, "time_step": 5e-4}
    gait, aero = pt.gaits.still(robot), pt.QuasiSteady(robot)
    with pytest.raises(ParameterError, match=r"quaternion of length 1, found 'one of 2'"):
        pt.simulate(robot, aero, gait, q=robot.coordinates() * 2, **fly)
    with pytest.raises(ShapeError, match=r"q: expected shape \(9,\), found \(8,\)"):
        pt.simulate(robot, aero, gait, q=np.zeros(8), **fly)
    with pytest.raises(ParameterError, match=r"glider with a quaternion, found 'glider'"):
        pt.simulate(robot, pt.QuasiSteady(pair[0]), gait, **fly)
    with pytest.raises(ShapeError, match=r"\(9,\)"):
        aero.generalized_force(np.zeros(8), np.zeros(8))


def test_a_quaternion_of_zeros_is_refused_by_equations_points_and_air(pair):
    """A quaternion of zeros gave forces of NaN; those of the added mass were the last to do so."""
    robot = pair[1]
    dyn, aero = pt.Dynamics(robot), pt.QuasiSteady(robot)
    q, v = np.zeros(robot.coordinate_count), np.zeros(robot.dof)
    some = np.tile(robot.coordinates(), (3, 1))
    some[1, 3:7] = 0
    point = dyn.point(robot.bodies[0].name)
    for ask in (
        lambda: dyn.mass_matrix(q),
        lambda: dyn.batch.bias(some, np.zeros((3, robot.dof))),
        lambda: point.position(q),
        lambda: aero.generalized_force(q, v),
        lambda: aero.batch.strips(some, np.zeros((3, robot.dof))),
        lambda: pt.AddedMass(robot).generalized_force(q, v, v),
    ):
        with pytest.raises(ParameterError, match="expected a quaternion of length 1, such as"):
            ask()
    with pytest.raises(ShapeError):
        dyn.mass_matrix(np.zeros(3))


def test_signs_of_quaternions_are_made_alike_also_behind_a_right_angle():
    turns = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, -1.0, 0, 0], [0, -0.6, 0.8, 0]])
    expected = [turns[0], turns[1], -turns[2], -turns[3]]  # a product of zero is no flip
    np.testing.assert_array_equal(without_flips(turns), expected)

"""A carried robot is exactly where its path says; cells read what passes through them."""

import json

import numpy as np
import pytest
from tests.flights import stored

import patagium as pt
from patagium.errors import ParameterError
from patagium.robot.planform import poses
from patagium.sensing.force.measured_force import Measured, Wrench
from patagium.simulation.flight_summary import flight_summary
from patagium.simulation.mounts import with_load_cells

ROCKING = pt.paths.sinusoid(
    (0.1, 0.2, 1.0), frequency=3.0, phase={"z": 0.4}, y=0.1, z=0.05, pitch=0.3, yaw=0.2
)
STEP = {"duration": 0.02, "time_step": 5e-4}


def _flown(mount, cells=(), **options):
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.linkage(robot, frequency=5.0)
    air = pt.QuasiSteady(robot, pt.Air(wind=(-3, 0, 0)))
    return pt.simulate(robot, air, gait, mount=mount, load_cells=cells, **(STEP | options))


@pytest.fixture(scope="module")
def carried():
    cells = [pt.mounts.load_cell(k) for k in ("body", "left_humerus")]
    return _flown(pt.mounts.carried(ROCKING), cells)


def test_the_base_is_on_the_path_to_the_last_bit(carried):
    motion = ROCKING.motion(carried["time"].values)
    for name, expected in (
        ("q", motion.position),
        ("v", motion.velocity),
        ("a", motion.acceleration),
    ):
        np.testing.assert_array_equal(carried[name].values[:, :6], expected)
    assert carried.attrs["mount"] == "carried"
    assert json.loads(carried.attrs["mount_path"])["path"] == ROCKING.describe()
    assert carried.attrs["energy_audit"] < 1e-6 and carried.attrs["momentum_audit"] < 1e-6


def test_a_cell_under_the_body_reads_the_mounts_force(carried):
    """As a sensor does that reads the mount's wrench: the damper of the base is beyond both."""
    cell = pt.sensors.LoadCell(body="body", rate=1.0 / STEP["time_step"])
    shown = pt.sense(carried, [cell])["loadcell"]["wrench"]
    inside = carried["load_cell_wrench"].sel(load_cell="body").interp(time=shown["time"])
    assert np.abs(carried["damping_force"].sel(dof="pitch")).max() > 0.1
    np.testing.assert_allclose(inside, shown, atol=1e-9)


@pytest.mark.usefixtures("interpreted")
def test_a_cell_in_a_flight_tells_the_force_of_the_air(carried):
    """Inverse dynamics of the true motion less the cell's wrench is the force of the air."""
    time, n = carried["time"].values, carried.sizes["dof"]
    motion = carried.assign(
        covariance=(("time", "one", "other"), np.zeros((len(time), 3 * n, 3 * n)))
    )
    held = carried["load_cell_wrench"].sel(load_cell="body").values
    joints = carried["u1"].values
    forces = pt.inverse_dynamics_force(
        motion,
        joints=Measured(joints, np.zeros_like(joints)),
        mount=Wrench(
            Measured(held, np.zeros_like(held)), pt.sensors.LoadCell(body="body", rate=1.0)
        ),
    )
    np.testing.assert_allclose(forces.force, carried["aero_force"].values, atol=1e-9)


def test_a_cell_in_its_joints_axis_reads_the_joints_torque(carried):
    """The humerus turns about -z first: what its actuator gives passes through the cell."""
    cell = carried["load_cell_wrench"].sel(load_cell="left_humerus", component="moment_z")
    torque = carried["u1"].sel(dof="left_mediolateral")
    np.testing.assert_allclose(cell, -torque, atol=1e-14)


def test_a_carried_flight_is_kept_whole(carried, tmp_path):
    again = pt.load_flight(pt.save_flight(carried, tmp_path / "flight.nc"))
    assert again.identical(stored(carried))
    assert again["load_cell_wrench"].dims == ("time", "load_cell", "component")
    broken = carried.assign(load_cell_wrench=carried["load_cell_wrench"].assign_attrs(units="N"))
    with pytest.raises(pt.errors.FlightError, match="load_cell_wrench"):
        pt.save_flight(broken, tmp_path / "broken.nc")


def test_cells_change_no_motion(carried):
    plain = _flown(pt.mounts.carried(ROCKING))
    assert "load_cell_wrench" not in plain
    for name in ("q", "v", "a", "u1", "mount_wrench", "strip_force"):
        # another order of summation
        np.testing.assert_allclose(plain[name], carried[name], rtol=1e-9, atol=1e-13)


def test_a_still_path_is_a_fixed_mount():
    still = _flown(pt.mounts.carried(pt.paths.sinusoid((0, 0, 0), frequency=1.0)))
    fixed = _flown(pt.mounts.fixed())
    for name in ("q", "mount_wrench", "u1", "aero_force"):
        np.testing.assert_array_equal(still[name], fixed[name])
    assert json.loads(fixed.attrs["mount_path"]) is None


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2 + 0.01])
def test_a_mount_holds_no_singular_pitch(pitch):
    """The wrench of the mount lost a moment there without a word."""
    with pytest.raises(ParameterError, match="a held pitch .* a quaternion is not"):
        _flown(pt.mounts.fixed(), q=pt.load_robot("aerobat").coordinates(pitch=pitch))
    robot = pt.load_robot("aerobat").with_attitude("quaternion")
    upright = {"mount": pt.mounts.fixed(), "q": robot.coordinates(pitch=pitch)}
    flight = pt.simulate(robot, pt.QuasiSteady(robot), pt.gaits.still(robot), **upright, **STEP)
    assert not flight_summary(flight)["warnings"]


def test_a_carried_robot_neither_sinks_nor_flies_backwards():
    """The summary of a carried robot warned that it sinks, or flies backwards."""
    path = pt.paths.line((0, 0, 1), (-0.2, 0, 0.8), duration=0.2)
    facts = flight_summary(_flown(pt.mounts.carried(path), duration=0.2))
    assert facts["speed"] < -0.5 and facts["climb_rate"] < -0.5
    assert not [one for one in facts["warnings"] if one.startswith("It ")]


def test_a_plan_travels_with_the_flight():
    path = pt.paths.line((0.5, 0, 0.3), (0.5, 0.1, 0.35), duration=0.5)
    mount = pt.mounts.on_arm(pt.load_robot("ur5e"), path, orientation=(0, -np.pi / 2, 0))
    flight = _flown(mount)
    told = json.loads(flight.attrs["mount_path"])
    assert flight.attrs["mount"] == "arm" and told["arm"]["name"] == "ur5e"
    expected = path.motion(flight["time"].values).position
    np.testing.assert_array_equal(flight["q"].values[:, :6], expected)


def test_several_cells_may_cut_one_chain(rng):
    robot = pt.load_robot("aerobat")
    places = ("left_plunge", "left_humerus", "body", "right_plate")
    cells = [pt.mounts.load_cell(k, (0, 0.01, 0.02), (0.1, 0.2, 0.3)) for k in places]
    machine = with_load_cells(robot, cells)
    assert machine.dof == robot.dof + 24 and machine.floating
    q = rng.normal(size=robot.dof)
    held = np.concatenate([np.zeros(24), q])
    ours, theirs = (poses(k, x) for k, x in ((machine, held), (robot, q)))
    for body in robot.bodies:
        found = ours[machine.body_index(body.name)]
        for one, other in zip(found, theirs[robot.body_index(body.name)], strict=True):
            np.testing.assert_allclose(one, other, atol=1e-14)


def test_a_mount_that_cannot_be_is_refused():
    with pytest.raises(ParameterError, match="something holds"):
        _flown(pt.mounts.free(), [pt.mounts.load_cell("body")])
    with pytest.raises(ParameterError, match="a body or joint: body, left_humerus"):
        _flown(pt.mounts.fixed(), [pt.mounts.load_cell("tail")])
    with pytest.raises(ParameterError, match="one cell a place"):
        cells = [pt.mounts.load_cell(k) for k in ("left_humerus", "left_mediolateral")]
        _flown(pt.mounts.fixed(), cells)
    with pytest.raises(ParameterError, match="position"):
        pt.mounts.load_cell("body", (0, np.nan, 0))
    wing = pt.load_robot("yeo-wing")
    with pytest.raises(ParameterError, match="no floating body"):
        air = pt.QuasiSteady(wing, pt.Air())
        pt.simulate(wing, air, pt.gaits.still(wing), mount=pt.mounts.carried(ROCKING), **STEP)
    with pytest.raises(ParameterError, match="a path of x, y, z"):
        pt.mounts.carried(pt.gaits.still(wing))

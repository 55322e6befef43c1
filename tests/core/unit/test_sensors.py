"""What sensors show of a flight: the truth where they have no errors, at their own times."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

import patagium as pt
from patagium.errors import FlightError, LogError, ParameterError, ShapeError
from patagium.sensing.sensors import from_quaternion

S, P = pt.sensors, pt.sensors.presets


@pytest.fixture(scope="module")
def flight() -> xr.Dataset:
    robot = pt.load_robot("aerobat")
    aero = pt.QuasiSteady(robot, pt.Air())
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5)
    start = robot.coordinates(x=3.0, roll=2.0, yaw=1.0)
    return pt.simulate(robot, aero, gait, duration=0.1, time_step=2e-4, v=start)


def at_rest(duration: float = 20.0, attitude: tuple[float, float, float] = (0, 0, 0)) -> xr.Dataset:
    """A flight that stands still, as long as one likes."""
    robot = pt.load_robot("aerobat")
    time = np.linspace(0.0, duration, 101)
    q = np.zeros((len(time), robot.dof))
    q[:, 3:6] = attitude
    still = np.zeros_like(q)
    names = ("q", "v", "a", "u1")
    parts = {
        name: (("time", "dof"), values)
        for name, values in zip(names, (q, still, still, still), strict=True)
    }
    wrench = np.tile([0.0, 0.0, 0.2, 0.0, 0.0, 0.0], (len(time), 1))
    return xr.Dataset(
        parts | {"mount_wrench": (("time", "component"), wrench)},
        coords={"time": time, "dof": list(robot.dof_names)},
        attrs={"robot": robot.source, "robot_name": robot.name},
    )


def quarter_turn() -> tuple[tuple[float, ...], ...]:
    """A unit that points its x axis to the robot's left."""
    return ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def test_an_imu_at_rest_feels_the_ground_push_up() -> None:
    imu = S.Imu(body="body", rate=100.0)
    log = pt.sense(at_rest(1.0), [imu])
    g = log.robot.gravity
    np.testing.assert_allclose(log["imu"]["specific_force"], [[0, 0, g]] * 101, atol=1e-12)
    np.testing.assert_allclose(log["imu"]["angular_rate"], 0, atol=1e-12)
    rolled = pt.sense(at_rest(1.0, (np.pi / 2, 0, 0)), [imu])  # left wing up: y points up
    np.testing.assert_allclose(rolled["imu"]["specific_force"][0], [0, g, 0], atol=1e-12)


def test_specific_force_is_that_of_differentiated_velocities(flight: xr.Dataset) -> None:
    offset, turn = np.array([0.01, 0.03, -0.02]), np.array(quarter_turn())
    body = "left_plate"
    imu = S.Imu(body=body, rate=1000.0, position=tuple(offset), orientation=quarter_turn())
    log = pt.sense(flight, [imu])
    robot = log.robot
    point = pt.Dynamics(robot).point(body, offset)
    velocity = np.array(
        [point.velocity(q, v) for q, v in zip(flight["q"].values, flight["v"].values, strict=True)]
    )
    time = flight["time"].values
    step = time[1] - time[0]
    # fourth order; what is left is the step's: 3e-4 m/s^2 found
    acceleration = (velocity[:-4] - 8 * velocity[1:-3] + 8 * velocity[3:-1] - velocity[4:]) / (
        12 * step
    )
    up = np.array([0, 0, robot.gravity])
    for k in range(10, 90, 20):  # samples of the unit, each fifth of the flight
        j = 5 * k
        axes = [pt.Dynamics(robot).point(body, e) for e in np.eye(3)]
        origin = pt.Dynamics(robot).point(body)
        q = flight["q"].values[j]
        rotation = np.column_stack([axis.position(q) - origin.position(q) for axis in axes])
        felt = (rotation @ turn).T @ (acceleration[j - 2] + up)
        np.testing.assert_allclose(log["imu"]["specific_force"][k], felt, atol=1e-3)


def test_angular_rate_turns_the_captured_attitude(flight: xr.Dataset) -> None:
    common = {"body": "left_plate", "rate": 5000.0, "orientation": quarter_turn()}
    log = pt.sense(flight, [S.Imu(**common), S.MotionCapture(**common)])
    attitude = from_quaternion(log["motioncapture"]["quaternion"].values)
    rates = (attitude[:-1].inv() * attitude[1:]).as_rotvec() * 5000.0
    middle = (log["imu"]["angular_rate"].values[1:] + log["imu"]["angular_rate"].values[:-1]) / 2
    settled = slice(25, None)  # the roll it starts with is damped out in 2 ms
    # second order in the step: 2e-4^2 / 12 of what rates of 20 rad/s at 5 Hz do
    np.testing.assert_allclose(rates[settled], middle[settled], atol=2e-4)


def test_without_errors_a_sensor_shows_the_truth(flight: xr.Dataset) -> None:
    sensors = [
        P.icm_42688_p("body"),
        P.as5600(),
        P.prime_x_13("body"),
        P.ina226(torque_constant=1e-3, gear_ratio=50.0),
        P.nano17("body"),
    ]
    log = pt.sense(flight, [sensor.scaled(0.0) for sensor in sensors])
    for name, reading in log.readings.items():
        for variable in reading:
            np.testing.assert_allclose(
                reading[variable], log.truth[name][variable], atol=1e-14, err_msg=name
            )
    columns = [log.robot.index(name) for name in log["as5600"]["joint"].values]
    np.testing.assert_allclose(  # every fifth sample of the flight is one of the encoder
        log["as5600"]["position"], flight["q"].values[::5, columns], atol=1e-12
    )
    np.testing.assert_allclose(
        log["ina226"]["current"] * 0.05, flight["u1"].values[::5, columns], atol=1e-9
    )


def test_stamps_and_times_are_exact(flight: xr.Dataset) -> None:
    late = S.Encoder(rate=500.0, delay=4e-3, clock_offset=2.0, clock_drift=1e-3)
    log = pt.sense(flight, [late])
    stamps, times = log["encoder"]["time"].values, log.truth["encoder"]["true_time"].values
    np.testing.assert_allclose(np.diff(stamps), 1 / 500.0, atol=1e-12)
    np.testing.assert_allclose(stamps, (times + 4e-3) * 1.001 + 2.0, atol=1e-12)
    assert times[0] >= 0 and times[0] < 1 / 500.0
    assert times[-1] <= 0.1 and times[-1] > 0.1 - 1 / 500.0
    q = np.interp(times, flight["time"], flight["q"][:, log.robot.index("left_plunge")])
    # a straight line between samples: 2e-4^2 / 8 of an acceleration of 500 rad/s^2
    np.testing.assert_allclose(log["encoder"]["position"][:, 0], q, atol=3e-6)


def test_a_laboratory_is_not_told_delays_and_clocks(flight: xr.Dataset) -> None:
    log = pt.sense(flight, [S.Encoder(rate=500.0, delay=4e-3, clock_offset=2.0)])
    assert log.sensors["encoder"].delay == 0 and log.sensors["encoder"].clock_offset == 0
    assert log.truth["encoder"].attrs["delay"] == 4e-3
    assert not log.without_truth().truth


def test_one_seed_one_log_and_no_sensor_disturbs_another(flight: xr.Dataset) -> None:
    imu, encoder = P.icm_42688_p("body"), P.as5600()
    first = pt.sense(flight, [imu, encoder], seed=3)
    again = pt.sense(flight, [encoder, imu], seed=3)
    alone = pt.sense(flight, [imu], seed=3)
    other = pt.sense(flight, [imu], seed=4)
    for log in (again, alone):
        xr.testing.assert_identical(first["icm_42688_p"], log["icm_42688_p"])
    assert not first["icm_42688_p"].equals(other["icm_42688_p"])


def test_noise_density_is_seen_in_the_allan_deviation() -> None:
    imu = replace(P.icm_42688_p("body"), accelerometer_step=0.0, gyroscope_step=0.0)
    log = pt.sense(at_rest(), [imu])
    for variable, density in (
        ("specific_force", np.asarray(imu.accelerometer_density)),
        ("angular_rate", np.asarray(imu.gyroscope_density)),
    ):
        signal = log["icm_42688_p"][variable].values
        for span in (0.01, 0.1):  # s
            size = int(span * imu.rate)
            means = signal[: len(signal) // size * size].reshape(-1, size, 3).mean(axis=1)
            allan = np.sqrt(0.5 * np.mean(np.diff(means, axis=0) ** 2, axis=0))
            # one-sided density: N / sqrt(2 tau); 200 means or more, 15 % is three deviations
            np.testing.assert_allclose(allan, density / np.sqrt(2 * span), rtol=0.2)


def test_a_bias_walks_as_far_as_stated() -> None:
    imu = S.Imu(body="body", rate=50.0, gyroscope_walk=0.02)
    ends = [
        pt.sense(at_rest(4.0), [imu], seed=seed)["imu"]["angular_rate"].values[-1]
        for seed in range(16)
    ]
    # 48 ends: 10 % is one deviation of their own
    assert np.std(ends) == pytest.approx(0.02 * np.sqrt(4.0), rel=0.3)


def test_lost_frames_come_in_runs(flight: xr.Dataset) -> None:
    camera = S.MotionCapture(body="body", rate=200.0, dropout=0.2, dropout_length=0.05)
    reading = pt.sense(at_rest(100.0), [camera])["motioncapture"]
    lost = np.isnan(reading["position"].values[:, 0])
    np.testing.assert_array_equal(lost, np.isnan(reading["quaternion"].values[:, 2]))
    starts = np.count_nonzero(np.diff(lost.astype(int)) == 1)
    assert lost.mean() == pytest.approx(0.2, abs=0.04)  # 400 runs
    assert lost.sum() / starts / 200.0 == pytest.approx(0.05, rel=0.15)


def test_the_log_of_a_flight_is_that_of_its_motion_and_forces(flight: xr.Dataset) -> None:
    """Points of strips, (time, strip, axis), were taken for positions of a body."""
    log, small = pt.sensor_log(flight), pt.sensor_log(flight[["q", "v", "a", "u1"]])
    assert list(log) == list(small)
    assert all(log[name].identical(small[name]) for name in log)


def test_a_sensor_log_is_asked_for_its_sensors(flight: xr.Dataset) -> None:
    """`in` and `list` asked for a sensor named 0."""
    log = pt.sense(flight, [pt.sensors.presets.as5600()])
    assert "as5600" in log and "Imu" not in log
    assert list(log) == ["as5600"] and len(log) == 1


def test_a_load_cell_feels_what_holds_the_robot_at_its_own_place() -> None:
    flight = at_rest(1.0, (0.0, 0.0, np.pi / 2))  # yaw: the body's x points along the world's y
    cell = S.LoadCell(body="body", rate=100.0, position=(0.1, 0.0, 0.0))
    shown = pt.sense(flight, [cell])["loadcell"]["wrench"].values[0]
    # 0.2 N up at the world's origin, 0.1 m behind the cell: it turns the nose up, about +y
    np.testing.assert_allclose(shown, [0, 0, 0.2, 0, 0.02, 0], atol=1e-12)
    with pytest.raises(FlightError, match="expected wrist_wrench .* for a load cell"):
        pt.sense(flight, [replace(cell, wrench="wrist_wrench")])
    with pytest.raises(FlightError, match="found .*14"):
        pt.sense(flight, [replace(cell, wrench="u1")])
    both = flight["mount_wrench"].expand_dims(load_cell=["neck", "wrist"], axis=1)
    flight["cells"] = both * xr.DataArray([1.0, 2.0], dims="load_cell")
    wrist = S.LoadCell(rate=100.0, wrench="cells", at="wrist", position=(0.1, 0.0, 0.0))
    shown = pt.sense(flight, [wrist])["loadcell"]["wrench"].values[0]
    np.testing.assert_allclose(shown, [0, 0, 0.4, 0, 0, 0], atol=1e-12)  # already in its axes
    with pytest.raises(ParameterError, match="at: expected a load cell of the flight"):
        pt.sense(flight, [replace(wrist, at="tail")])


def test_a_low_pass_lags_and_settles(flight: xr.Dataset) -> None:
    from patagium.sensing.sensors.scene import low_pass

    time = np.arange(0.0, 1.0, 1e-3)
    tone = np.sin(2 * np.pi * 5.0 * time)
    passed = low_pass(time, tone, 5.0)
    tail = slice(600, None)
    expected = np.sin(2 * np.pi * 5.0 * time - np.pi / 4) / np.sqrt(2)
    # chords of a sine of 5 Hz: (2 pi 5 1e-3)^2 / 8
    np.testing.assert_allclose(passed[tail], expected[tail], atol=2e-4)
    np.testing.assert_array_equal(low_pass(time, np.ones(1000), 5.0), 1.0)


def test_a_log_comes_back_from_its_file_without_the_truth(
    flight: xr.Dataset, tmp_path: Path
) -> None:
    sensors = [P.icm_42688_p("body"), P.as5600(), P.nano17("body"), P.prime_x_13("body")]
    log = pt.sense(flight, sensors)
    path = pt.sensing.save_sensor_log(log, tmp_path / "flight.nc")
    again = pt.sensing.load_sensor_log(path)
    assert list(again.readings) == list(log.readings) and again.truth == {}
    assert again.robot == log.robot and again.mount == log.mount
    for name in log.readings:
        xr.testing.assert_equal(again[name], log[name])
        assert again.sensors[name] == log.sensors[name]
    with pytest.raises(LogError, match="no such file"):
        pt.sensing.load_sensor_log(tmp_path / "none.nc")
    (tmp_path / "bad.nc").write_text("no log")
    with pytest.raises(LogError, match="expected a sensor log"):
        pt.sensing.load_sensor_log(tmp_path / "bad.nc")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: S.Imu(body="body", rate=0.0), "rate: expected a positive number"),
        (lambda: S.Imu(body="body", rate=1.0, delay=-1.0), "delay: expected zero or more"),
        (lambda: S.Imu(body="body", rate=1.0, gyroscope_bias=-1.0), "gyroscope_bias"),
        (lambda: S.Imu(body="body", rate=1.0, gyroscope_range=0.0), "gyroscope_range"),
        (lambda: S.Imu(body="body", rate=1.0, orientation=np.eye(3) * 2), "a rotation"),
        (lambda: S.Imu(body="body", rate=1.0, clock_drift=0.5), "clock_drift"),
        (lambda: S.MotionCapture(body="body", rate=1.0, dropout=1.0), "dropout"),
        (lambda: S.MotorCurrent(rate=1.0, torque_constant=0.0), "torque_constant"),
        (lambda: S.Encoder(rate=1.0).scaled(-1.0), "factor"),
        (lambda: P.prime_x_13("body", rate=1000.0), "at most 240 Hz"),
        (lambda: P.as5600(settling=1.0), "settling"),
    ],
)
def test_what_cannot_be_is_refused(make: object, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        make()  # type: ignore[operator]


def test_shapes_bodies_and_names_are_checked(flight: xr.Dataset) -> None:
    with pytest.raises(ShapeError, match="position"):
        S.Imu(body="body", rate=1.0, position=(1.0, 2.0))
    with pytest.raises(ShapeError, match="cross_talk"):
        S.LoadCell(rate=1.0, cross_talk=np.eye(3))
    with pytest.raises(ParameterError, match="body: expected one of"):
        pt.sense(flight, [S.Imu(body="tail", rate=100.0)])
    with pytest.raises(ParameterError, match="coordinate: expected one of"):
        pt.sense(flight, [S.Encoder(joints=("tail",), rate=100.0)])
    with pytest.raises(ParameterError, match="a name of its own"):
        pt.sense(flight, [S.Encoder(rate=100.0), S.Encoder(rate=50.0)])
    with pytest.raises(FlightError, match="at least 2 samples at 1 Hz"):
        pt.sense(flight, [S.Encoder(rate=1.0)])
    with pytest.raises(ParameterError, match="sensor: expected one of encoder"):
        pt.sense(flight, [S.Encoder(rate=100.0)])["imu"]


@pytest.mark.usefixtures("interpreted")
def test_a_robot_by_quaternion_shows_the_same() -> None:
    robot = pt.load_robot("aerobat")
    shown = []
    for machine in (robot, robot.with_attitude("quaternion")):
        aero = pt.QuasiSteady(machine, pt.Air())
        gait = pt.gaits.sinusoidal(machine, frequency=5.0, plunge=0.5)
        start = {"q": machine.coordinates(pitch=0.3, yaw=2.0), "v": machine.velocities(z=1.0)}
        flown = pt.simulate(machine, aero, gait, duration=0.02, time_step=1e-4, **start)
        sensors = (P.icm_42688_p("body"), P.as5600(), P.prime_x_13("body"))
        log = pt.sense(flown, [sensor.scaled(0.0) for sensor in sensors])
        shown.append([log[s.name][name].values for s in sensors for name in log[s.name]])
    for one, other in zip(*shown, strict=True):
        # two integrations at 0.1 ms that agree to their own error
        np.testing.assert_allclose(one, other, atol=1e-5 * (1 + np.abs(one).max()))


@pytest.mark.usefixtures("interpreted")
def test_no_encoder_shows_a_part_of_a_quaternion() -> None:
    """An encoder of pitch showed the y component of the quaternion as an angle."""
    robot = pt.load_robot("hawk").with_attitude("quaternion")
    flown = pt.simulate(
        robot, pt.QuasiSteady(robot), pt.gaits.still(robot), duration=0.01, time_step=1e-3
    )
    with pytest.raises(ParameterError, match="no part of a quaternion"):
        pt.sense(flown, [S.Encoder(joints=("z", "pitch"), rate=500.0)])
    assert "encoder" in pt.sense(flown, [S.Encoder(joints=("z",), rate=500.0)]).readings


def test_attitude_noise_turns_about_the_frames_own_axes() -> None:
    camera = S.MotionCapture(body="body", rate=50.0, attitude_std=(0.0, 0.0, 0.01))
    flight = at_rest(20.0, (0.0, 0.5, 0.3))
    log = pt.sense(flight, [camera])
    shown = from_quaternion(log["motioncapture"]["quaternion"].values)
    true = from_quaternion(log.truth["motioncapture"]["quaternion"].values)
    error = (true.inv() * shown).as_rotvec()
    np.testing.assert_allclose(error[:, :2], 0, atol=1e-12)
    assert error[:, 2].std() == pytest.approx(0.01, rel=0.1)  # 1001 samples
    assert isinstance(shown, Rotation)

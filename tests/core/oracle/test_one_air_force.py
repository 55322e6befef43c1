"""One force of the air: a flight, its packets, its log and its measured motion give the same y."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.aerodynamics.gusts import OneMinusCosineGust
from patagium.errors import ParameterError
from patagium.live.packets import flight_packets
from patagium.live.pipeline import Pipeline
from patagium.live.record import StreamFile
from patagium.sensing.force.air_force import OPTIONAL_PARTS, packet_columns
from patagium.sensing.force.measured_force import Measured, Wrench, inverse_dynamics_force

SAME = 1e-9  # N, N m: rounding of forces of the size of the joints'
WIND = (-3.0, 0.2, 0.1)
CASES = ["free", "mount", "added mass", "added mass on a mount"]


@pytest.fixture(scope="module")
def robot() -> pt.Robot:
    return pt.load_robot("aerobat")


def flown(robot: pt.Robot, case: str) -> xr.Dataset:
    added = pt.AddedMass(robot, pt.Air(wind=WIND)) if "added" in case else None
    options: dict[str, Any] = {"added_mass": added}
    if "mount" in case:
        options |= {"mount": pt.mounts.fixed(), "q": robot.coordinates(z=0.3, yaw=0.2)}
    else:
        options |= {"v": robot.coordinates(x=3.0)}
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5)
    air = pt.QuasiSteady(robot, pt.Air(wind=WIND))
    return pt.simulate(robot, air, gait, duration=0.03, time_step=1e-3, **options)


@pytest.fixture(scope="module", params=CASES)
def flight(request: pytest.FixtureRequest, robot: pt.Robot) -> xr.Dataset:
    return flown(robot, request.param)


def pipeline(robot: pt.Robot, **options: Any) -> Pipeline:
    network = pt.DenseNetwork(2 * robot.dof, (4,), robot.dof_names, input_scale=10.0)
    learner = pt.CubatureLearner(network, prior_std=0.3, measurement_std=0.1, spread=1.7)
    return Pipeline(learner, robot, **options)


def carried_by(flight: xr.Dataset) -> tuple[str, ...]:
    return tuple(name for name in OPTIONAL_PARTS if name in flight)


@pytest.mark.parametrize("compiled", [True, False])
def test_packets_carry_what_the_flight_carried(
    flight: xr.Dataset, robot: pt.Robot, compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not compiled:
        monkeypatch.setattr("patagium.live.pipeline._chain", lambda *arguments: None)
    _, x, y = pt.training_data(flight)
    carried = carried_by(flight)
    stream = pipeline(robot, carried=carried)
    records = stream.run(flight_packets(flight, carried))
    np.testing.assert_allclose(records.measurement, y, rtol=0, atol=SAME)
    # the air's own force, as simulated: nothing else is in it
    np.testing.assert_allclose(y, flight["aero_force"], rtol=0, atol=SAME)


def test_what_packets_leave_out_is_ascribed_to_the_air(robot: pt.Robot) -> None:
    flight = flown(robot, "added mass on a mount")
    _, _, y = pt.training_data(flight)
    bare = pipeline(robot).run(flight_packets(flight)).measurement
    beside = (flight["mount_force"] + flight["added_mass_force"]).values
    assert np.abs(beside).max() > 0.05
    np.testing.assert_allclose(bare, y + beside, rtol=0, atol=SAME)


def test_added_mass_may_be_computed_instead_of_carried(robot: pt.Robot) -> None:
    flight = flown(robot, "added mass on a mount")
    _, _, y = pt.training_data(flight)
    model = pt.AddedMass(robot, pt.Air(wind=WIND))
    stream = pipeline(robot, carried=("mount_force",), added_mass=model)
    records = stream.run(flight_packets(flight, ("mount_force",)))
    np.testing.assert_allclose(records.measurement, y, rtol=0, atol=SAME)


@pytest.mark.usefixtures("interpreted")
def test_a_measured_motion_without_errors_gives_the_force_of_the_flight(robot: pt.Robot) -> None:
    flight = flown(robot, "added mass on a mount")
    _, _, y = pt.training_data(flight)
    count, n = y.shape
    motion = flight[["q", "v", "a"]].assign(
        covariance=(("time", "row", "column"), np.zeros((count, 3 * n, 3 * n)))
    )
    motion.attrs = dict(flight.attrs)
    cell = pt.sensors.LoadCell(name="cell", rate=1e3, force_std=1e-3, moment_std=1e-4)
    wrench = np.asarray(flight["mount_wrench"].values, float)
    found = inverse_dynamics_force(
        motion,
        joints=Measured(flight["u1"].values, np.zeros((count, n))),
        mount=Wrench(Measured(wrench, np.zeros((count, 6))), cell),
        added_mass=pt.AddedMass(robot, pt.Air(wind=WIND)),
    )
    np.testing.assert_allclose(found.force, y, rtol=0, atol=SAME)
    np.testing.assert_array_equal(found.covariance, 0.0)


def test_a_record_of_a_stream_is_a_flight_with_the_same_force(
    flight: xr.Dataset, robot: pt.Robot, tmp_path: Any
) -> None:
    _, _, y = pt.training_data(flight)
    carried = carried_by(flight)
    stream = pipeline(robot, carried=carried)
    packets = flight_packets(flight, carried)
    file = StreamFile(tmp_path / "stream.nc", stream)
    file.append(packets, stream.run(packets))
    with xr.open_dataset(file.close({})) as record:
        _, _, again = pt.training_data(record.load(), robot)
    np.testing.assert_allclose(again, y, rtol=0, atol=SAME)


def test_columns_name_what_is_carried(robot: pt.Robot) -> None:
    names = [column.name for column in packet_columns(robot, ("mount_force",))]
    assert names[: -robot.dof] == [column.name for column in packet_columns(robot)]
    assert names[-robot.dof :] == [f"mount_force.{name}" for name in robot.dof_names]
    assert packet_columns(robot, ("mount_force",))[-robot.dof].unit == "N"


def test_parts_without_a_meaning_are_refused(robot: pt.Robot) -> None:
    with pytest.raises(ParameterError, match="carried: expected names among damping_force"):
        pipeline(robot, carried=("aero_force",))
    model = pt.AddedMass(robot, pt.Air())
    with pytest.raises(ParameterError, match="None where packets carry its force"):
        pipeline(robot, carried=("added_mass_force",), added_mass=model)
    gusty = pt.AddedMass(robot, pt.Air(gust=OneMinusCosineGust((0.0, 0.0, 1.0), 0.0, 0.1)))
    with pytest.raises(ParameterError, match="steady wind"):
        pipeline(robot, added_mass=gusty)

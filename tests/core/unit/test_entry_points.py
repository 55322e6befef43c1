"""Arguments of a wrong kind at entry points of sections, logs, networks, flights and filters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium import air, learning, sensing
from patagium.errors import LogError, ParameterError, PatagiumError

ROBOT = pt.load_robot("aerobat")
LEARNER = pt.ExtendedLearner(pt.DenseNetwork(3, (4,), 2))
STATE = {"q": np.zeros(ROBOT.dof), "v": np.zeros(ROBOT.dof)}
ROWS = ([-0.2, 0.0, 0.2], [-1.0, 0.0, 1.0], [0.02, 0.02, 0.02])
PATH = pt.paths.line((0.5, 0.0, 0.3), (0.5, 0.1, 0.35), duration=0.5)
ODD: tuple[Any, ...] = ("x", object(), {1: 2}, [[1], [2, 3]], 1j, (one for one in "ab"))


def _history(**given: Any) -> Any:
    plain = {"time": [0.0, 0.01], "pitch": 0.1, "airspeed": 5.0, "chord": 0.1}
    return air.section_history(**{"model": pt.QuasiSteady, **plain, **given})


def _learned_air(**given: Any) -> Any:
    learner = pt.ExtendedLearner(pt.GreyBox(pt.QuasiSteady(ROBOT), {"density": 0.1}))
    return learning.model_of(learner).air(**given)


def _sections() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    table = dict(zip(("angle", "lift", "drag"), ROWS, strict=True))
    lags = {name: (0.1, 0.3) for name in ("rate", "lift", "circulation")}
    return {
        "lift_offset": (air.DickinsonPolar, {}),
        "zero_lift_drag": (air.SmoothPolar, {}),
        "viscosity": (air.ReynoldsPolar, {}),
        "angle": (air.TablePolar, table),
        "lift": (air.measured_section, table),
        "circulation": (air.Indicial, lags),
        "pitch": (_history, {}),
        "pitch_axis": (_history, {}),
        "path": (air.read_polar, {}),
    }


def _others() -> list[tuple[str, Callable[..., Any], dict[str, Any]]]:
    return [
        ("air", learning.LinearStripNetwork, {"robot": ROBOT}),
        ("measured", learning.LinearStripNetwork, {"robot": ROBOT}),
        ("robot", learning.LinearStripNetwork, {}),
        ("air", learning.default_learner, {"subject": ROBOT}),
        ("kind", air.register_polar, {}),
        ("blocks", learning.register_blocks, {"name": "own"}),
        ("flight", learning.identify, {"learner": LEARNER}),
        ("flight", learning.evaluate, {"model": LEARNER}),
        ("table", learning.network_for, {"hidden": (3,)}),
        ("description", learning.network_from_description, {}),
        ("learner", learning.model_of, {}),
        ("inputs", learning.model_of, {"learner": LEARNER}),
        ("path", sensing.load_mapping, {}),
        ("mapping", sensing.read_table, {"path": "x.csv"}),
        ("path", sensing.load_sensor_log, {}),
        ("log", sensing.save_sensor_log, {"path": "x.nc"}),
        ("linkage", pt.gaits.linkage, {"robot": ROBOT, "frequency": 5.0}),
        ("arm", pt.mounts.on_arm, {"path": PATH}),
        ("position", pt.mounts.on_arm, {"arm": pt.load_robot("ur5e"), "path": PATH}),
        ("start", pt.mounts.on_arm, {"arm": pt.load_robot("ur5e"), "path": PATH}),
        ("arm", ROBOT.mounted_on, {"at": "tool"}),
        ("attitude", ROBOT.with_attitude, {}),
        ("values", ROBOT.with_parameters, {}),
        ("name", ROBOT.joints_named, {}),
        ("robot", _learned_air, {}),
        ("air", _learned_air, {}),
        ("seed", learning.model_of(LEARNER).draw, {}),
        ("plan", pt.gaits.carried_gait, {"robot": ROBOT, "gait": pt.gaits.cruise(ROBOT)}),
        ("x", ROBOT.coordinates, {}),
        ("x", ROBOT.velocities, {}),
        ("seed", LEARNER.network.initial, {}),
        ("offset", pt.Dynamics(ROBOT).point, {"body": "body"}),
        ("q", pt.Dynamics(ROBOT).mass_matrix, {}),
        ("v", pt.Dynamics(ROBOT).bias, {"q": STATE["q"]}),
        ("q", pt.AddedMass(ROBOT).mass_matrix, {}),
        ("time", pt.Air().uniform_wind_at, {}),
        ("reduced_frequency", air.FOUR_STATE.lift_transfer, {}),
    ]  # fmt: skip


@pytest.mark.parametrize("value", ODD, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("name", _sections())
def test_an_odd_argument_of_a_section_is_refused_by_a_sentence(name: str, value: Any) -> None:
    function, given = _sections()[name]
    if (name, type(value)) == ("path", str):
        pytest.skip("a text is a path")
    with pytest.raises(PatagiumError):
        function(**{**given, name: value})


@pytest.mark.parametrize("value", ODD, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize(("name", "function", "given"), _others())
def test_an_odd_argument_is_refused_by_a_sentence(
    name: str, function: Callable[..., Any], given: dict[str, Any], value: Any
) -> None:
    if (name, type(value)) == ("name", str):
        pytest.skip("a joint that nobody has is none")
    with pytest.raises(PatagiumError):
        function(**given, **{name: value})


@pytest.mark.parametrize("value", ODD, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("method", ["advance", "step", "command", "fly"])
def test_a_flight_is_not_told_what_no_flight_understands(method: str, value: Any) -> None:
    gait = pt.gaits.cruise(ROBOT)
    flight = pt.Simulator(ROBOT, pt.QuasiSteady(ROBOT), gait, duration=0.01, time_step=1e-3)
    with pytest.raises(PatagiumError):
        getattr(flight, method)(value)
    assert flight.advance(1).name == "COMPLETED"


def test_a_class_is_no_controller() -> None:
    flown = {"aero": pt.QuasiSteady(ROBOT), "gait": pt.gaits.cruise(ROBOT), "duration": 0.01}
    with pytest.raises(ParameterError, match="^controller: expected a function or an object"):
        pt.simulate(ROBOT, **flown, controller=int)


def test_a_state_without_an_array_is_refused_by_its_name() -> None:
    with pytest.raises(ParameterError, match="state: expected an array numbers"):
        LEARNER.resume({"count": 1})
    with pytest.raises(ParameterError, match="network: expected of kind"):
        learning.learner_from_description({"kind": "extended"})


def test_a_path_of_other_coordinates_is_no_part_of_a_sum() -> None:
    for value in ODD:
        with pytest.raises(ParameterError, match="^path: expected"):
            pt.paths.superposed(PATH, value)


def test_a_log_without_times_is_refused_by_a_sentence() -> None:
    with pytest.raises(LogError, match="variable `time`"):
        pt.sensor_log(xr.Dataset(), ROBOT)


@pytest.mark.parametrize("horizon", [1e30, 2**63, 1e9])
def test_a_horizon_beyond_the_log_forecasts_nothing(horizon: float) -> None:
    """Times of the forecast were made for all of it: 10^30 s are no array."""
    time = 0.01 * np.arange(60)
    learner = pt.ExtendedLearner(pt.DenseNetwork(3, (4,), 2))
    x, y = np.sin(np.outer(time, [1.0, 2.0, 3.0])), np.cos(np.outer(time, [1.0, 2.0]))
    found = learning.stream(learner, time, x, y, every=5, horizons=horizon)
    assert [v for k, v in found.scores.items() if k.endswith("s_count")] == [0]

"""An ornithopter on its orbit, disturbed: with the predictive controller it comes back."""

from __future__ import annotations

import numpy as np

import patagium as pt
from patagium.control import PredictiveController

COMMANDS = ("frequency", "plunge_amplitude", "elevation_offset", "rudder_offset")


def test_a_disturbed_flight_comes_back_within_its_actuators(ornithopter_orbit):
    """Another mass than the model's, and samples that do not come."""
    orbit = ornithopter_orbit
    robot = orbit.robot
    true = robot.with_parameters({"body.mass": 0.384})  # 1 % more
    start = dict(zip(orbit.names, orbit.states[0], strict=True))
    q = robot.coordinates(pitch=start["pitch"] + 0.05)
    v = robot.velocities(
        roll=0.4, **{k: start[f"velocity of {k}"] + 0.1 for k in ("x", "z", "pitch")}
    )
    drift = {}
    for kind in ("free", "controlled"):
        controller = PredictiveController(orbit, COMMANDS)
        ticks = []

        def lossy(time, state, controller=controller, ticks=ticks):
            ticks.append(time)
            return controller(time, None if len(ticks) % 7 == 3 else state)

        flight = pt.simulate(
            true, pt.QuasiSteady(true, pt.Air()), orbit.gait,
            duration=300 * controller.period, time_step=controller.period / 40, q=q, v=v,
            throw=False, **(
                {"controller": lossy, "control_period": controller.period}
                if kind == "controlled" else {}
            ),
        )  # fmt: skip
        late = flight.isel(time=slice(-400, None))
        turned = max(np.abs(late.q.sel(dof=k).values).max() for k in ("roll", "yaw"))
        drift[kind] = turned, abs(float(late.q.sel(dof="z").values.mean()))
        if kind == "controlled":
            assert flight.attrs["outcome"] == "COMPLETED"
            assert np.ptp(late.q.sel(dof="z").values) < 0.4  # a beat heaves it by about .35 m
            assert controller.held == {"missing": 43}
            assert flight.attrs["commands_limited"] == 0
            assert "43 missing" in controller.report()
    assert drift["controlled"][0] < 0.01 < 0.04 < drift["free"][0]  # rad
    assert drift["controlled"][1] < 0.1 < 0.2 < drift["free"][1]  # m; measured .08 and .24

"""An ornithopter on its orbit, disturbed: with the predictive controller it comes back."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.control import PredictiveController
from patagium.native import compiler_name

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


def test_what_is_kept_of_the_orbit_gives_the_answers_of_each_program_alone(ornithopter_orbit):
    """From far off, where limits bite, the inverses of ten phases, and none."""
    if compiler_name() is None:
        pytest.skip("without a compiler nothing is kept")
    kept, plain = (PredictiveController(ornithopter_orbit, COMMANDS) for _ in range(2))
    rng, model = np.random.default_rng(3), kept.model
    last = np.zeros(len(COMMANDS))
    state = np.zeros(model.size)
    state[: len(model.kept)] = 0.3 * rng.standard_normal(len(model.kept))
    limits = 0
    for k in range(25):
        answers = []
        for one in (kept, plain):
            if one is plain:
                one.iteration.inverses = dict.fromkeys(range(model.parts))  # none of any phase
            answers.append(one.answer(k, state, last))
            status = int(one.iteration.program["status"])
            assert status == 0
        assert (int(kept.iteration.program["sweeps"]) == 0) < int(plain.iteration.program["sweeps"])
        # tolerance: 1e-9 of the commands' ranges in both
        np.testing.assert_allclose(answers[0], answers[1], atol=1e-7)
        limits += int((kept.iteration.program["change_force"] != 0).sum())
        last = answers[0]
        state = model.by_state[k % model.parts] @ state + model.by_input[k % model.parts] @ last
    assert limits > 20
    assert sorted(kept.iteration.inverses) == list(range(model.parts))
    kept.follow(ornithopter_orbit, {}, 30)  # another orbit: nothing of the former one is kept
    assert not kept.iteration.inverses

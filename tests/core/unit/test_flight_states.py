"""Parts of the state that not every flight has: passive wing joints, lag states, one strip."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import patagium as pt
from patagium.simulation.mounts import fixed
from patagium.simulation.state_layout import state_layout

TIME_CONSTANT = 0.02  # of the lag [s]


class LaggedAir(pt.QuasiSteady):
    """Quasi-steady forces that build up: times z, dz/dt = (1 - z) / time constant."""

    name = "lagged"

    @property
    def state_size(self):
        return 1

    @property
    def structure(self):
        return f"lagged {super().structure}"

    def expressions(self, robot, q, v, state, wind, parameters):
        air = super().expressions(robot, q, v, state, wind, parameters)
        return replace(
            air,
            generalized_force=air.generalized_force * state[0],
            strip_force=air.strip_force * state[0],
            power=air.power * state[0],
            state_derivative=ca.vertcat((1 - state[0]) / TIME_CONSTANT),
        )


@pytest.fixture(scope="module")
def robot():
    return pt.load_robot("aerobat")


@pytest.mark.usefixtures("interpreted")
def test_lag_states_start_at_zero_are_integrated_and_recorded(robot):
    flight = pt.simulate(
        robot, LaggedAir(robot), pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.3),
        duration=0.05, time_step=1e-4, v=robot.coordinates(x=4.0),
    )  # fmt: skip
    expected = 1 - np.exp(-flight.time.values / TIME_CONSTANT)
    assert flight.aero_state.shape == (501, 1)
    # fourth order: (h / time constant)^4 / 120 a step
    np.testing.assert_allclose(flight.aero_state.values[:, 0], expected, atol=1e-11)
    assert not flight.aero_force.values[0].any() and flight.aero_force.values[-1].any()
    assert flight.attrs["energy_audit"] < 1e-8  # fourth order at 1e-4 s


def test_a_joint_without_actuator_swings_by_itself(robot):
    actuated = tuple(i for i in robot.actuated if "feather" not in robot.dof_names[i])
    loose = replace(robot, actuated=actuated, source="")
    gait = pt.gaits.sinusoidal(loose, frequency=5.0, plunge=0.3)
    flight = pt.simulate(
        loose, pt.QuasiSteady(loose), gait, duration=0.05, time_step=2e-5,
        v=loose.coordinates(x=4.0),
    )  # fmt: skip
    feather = [loose.index(f"{side}_feather") for side in ("left", "right")]
    assert np.abs(flight.q.values[:, feather]).max() > 0.1
    assert not flight.u1.values[:, feather].any()
    assert flight.u1.values[:, list(actuated)].any(axis=0).all()
    # fourth order; an unloaded plate flutters fast
    assert flight.attrs["energy_audit"] < 1e-7
    assert flight.attrs["momentum_audit"] < 1e-7


@pytest.mark.usefixtures("interpreted")
def test_a_wing_of_one_strip_keeps_its_axis(robot):
    single = replace(robot, strips=robot.strips[:1], source="")
    flight = pt.simulate(
        single, pt.QuasiSteady(single), pt.gaits.still(single), duration=1e-3, time_step=1e-4,
        v=single.coordinates(x=4.0),
    )  # fmt: skip
    assert flight.strip_force.shape == (11, 1, 3)
    assert flight.angle_of_attack.shape == (11, 1)


def test_the_layout_names_every_entry_of_the_state(robot):
    free = state_layout(robot, LaggedAir(robot), pt.mounts.free())
    assert len(free.state_names) == free.size == 6 + 6 + 1 + 4 + 3
    assert free.state_names[:3] == ("x", "y", "z") and free.state_names[12] == "lag state 0"
    held = state_layout(robot, LaggedAir(robot), fixed())
    assert held.size == 8 and len(held.prescribed) == 14
    wing = pt.load_robot("yeo-wing")
    rooted = state_layout(wing, pt.QuasiSteady(wing), fixed())
    assert rooted.hidden == 6 and rooted.passive == () and len(rooted.prescribed) == 2

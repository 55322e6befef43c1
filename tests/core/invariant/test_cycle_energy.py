"""Closed cycles in still air, the energy of wake and carried air included: none gains."""

from __future__ import annotations

import numpy as np
import pytest

from patagium.aerodynamics import (
    AddedMass,
    Aerodynamics,
    DeLaurier,
    LiftingLine,
    QuasiSteady,
    Section,
)
from patagium.aerodynamics.indicial import ONE_STATE
from patagium.robot import Robot, load_robot

pytestmark = pytest.mark.usefixtures("interpreted")

FREQUENCY, STEPS, COUNT, CYCLES = 5.0, 100, 24, 3


class Beats:
    """Random periodic motions of all coordinates, flying on through still air."""

    def __init__(self, rng: np.random.Generator, amplitude: float) -> None:
        size = np.array([0.03] * 3 + [0.2] * 3 + [1.0] * 8) * amplitude
        self.cosine, self.sine = rng.normal(size=(2, COUNT, 14)) * size
        self.speed = rng.uniform(0.5, 3.0, size=COUNT)

    def __call__(self, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        omega = 2 * np.pi * FREQUENCY
        phase = 2 * np.pi * step / STEPS
        q = self.cosine * np.cos(phase) + self.sine * np.sin(phase)
        v = omega * (self.sine * np.cos(phase) - self.cosine * np.sin(phase))
        a = -(omega**2) * q
        v[:, 0] += self.speed
        return q, v, a


def works(aero: Aerodynamics, beats: Beats) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Work of strips and carried air on the robot over the last cycle, (N,) each [J].

    The third is what the carried air gave and took, each counted as positive.
    """
    carried, time_step = AddedMass(aero.robot, aero.air), 1 / (FREQUENCY * STEPS)
    z = np.zeros((COUNT, aero.state_size))
    of_strips, of_air, exchanged = np.zeros((3, COUNT))
    for k in range(CYCLES * STEPS):
        q, v, a = beats(k)
        if k >= (CYCLES - 1) * STEPS:
            of_strips += aero.batch.strips(q, v, z)["power"] * time_step
            for n in range(COUNT):
                force = carried.generalized_force(q[n], v[n], a[n])
                given = (force + carried.circulatory_force(q[n], v[n])) @ v[n] * time_step
                of_air[n] += given
                exchanged[n] += abs(given)
        if aero.state_size:
            half = z + 0.5 * time_step * aero.batch.state_derivative(q, v, z)
            q, v, _ = beats(k + 0.5)
            z = z + time_step * aero.batch.state_derivative(q, v, half)
    return of_strips, of_air, exchanged


@pytest.fixture(scope="module")
def aerobat() -> Robot:
    return load_robot("aerobat")


PLAIN = Section(profile_drag=0.0, stall_begins=1.2, stall_complete=1.4)


@pytest.mark.parametrize(
    ("name", "amplitude"),
    [("lifting line", 0.5), ("lifting line without drag", 0.1), ("strips", 0.5), ("quasi", 0.5)],
)
def test_no_closed_cycle_gains_energy(
    aerobat: Robot, rng: np.random.Generator, name: str, amplitude: float
) -> None:
    models: dict[str, Aerodynamics] = {
        "lifting line": LiftingLine(aerobat, lags=ONE_STATE),
        "lifting line without drag": LiftingLine(aerobat, lags=ONE_STATE, section=PLAIN),
        "strips": DeLaurier(aerobat),
        "quasi": QuasiSteady(aerobat),
    }
    of_strips, of_air, exchanged = works(models[name], Beats(rng, amplitude))
    assert (of_strips + of_air < 0).all()
    # what is carried along is given back at the end of a cycle: its energy is a state's
    assert (np.abs(of_air) < 1e-9 * exchanged).all()
    assert (exchanged > 1e-2 * np.abs(of_strips)).any()  # and it is no trifle

"""Velocities and accelerations of every gait are the derivatives of its positions."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt

STEP = 1e-5  # of central differences [s]


@pytest.fixture(scope="module")
def robot():
    return pt.load_robot("aerobat")


def gaits_of(robot, tmp_path):
    table = tmp_path / "gait.csv"
    rows = [f"{t},{np.sin(2 * np.pi * t / 0.2) + 0.3}" for t in np.linspace(0, 0.2, 30)]
    rows[-1] = f"0.2,{rows[0].split(',')[1]}"
    table.write_text("\n".join(["time [s],elbow [rad]", *rows]))
    feather = pt.gaits.sinusoidal(robot, frequency=5.0, feather=0.3, phase={"feather": 1.0})
    linkage = pt.gaits.linkage(robot, frequency=5.0, plunge_offset=0.1)
    return {
        "sinusoidal": feather,
        "fourier": pt.gaits.fourier(
            robot, frequency=3.0, plunge=(0.1, [(0.2, 0.3), (0.1, -0.2), (0.0, 0.05)])
        ),
        "linkage": linkage,
        "table": pt.gaits.from_csv(robot, table),
        "superposed": pt.gaits.superposed(robot, linkage, feather),
    }


@pytest.mark.parametrize("kind", ["sinusoidal", "fourier", "linkage", "table", "superposed"])
def test_derivatives_are_those_of_the_positions(robot, tmp_path, kind):
    gait = gaits_of(robot, tmp_path)[kind]
    time = np.linspace(0.013, 0.61, 41)
    before, here, after = (gait.motion(time + shift) for shift in (-STEP, 0.0, STEP))
    velocity = (after.position - before.position) / (2 * STEP)
    acceleration = (after.velocity - before.velocity) / (2 * STEP)
    # truncation h^2/6 of the third derivative, some 1e5 per s^3 and 1e7 per s^4; the
    # spline's third derivative jumps at its knots, h/2 of that
    np.testing.assert_allclose(here.velocity, velocity, atol=1e-4)
    np.testing.assert_allclose(
        here.acceleration, acceleration, atol=2e-1 if kind == "table" else 1e-2
    )
    assert np.abs(here.velocity).max() > 0.5 and np.abs(here.acceleration).max() > 10.0

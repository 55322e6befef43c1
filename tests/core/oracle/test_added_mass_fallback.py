"""A flight with added mass: compiled and on the virtual machine the same numbers."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.native import compiler_name


def test_flight_with_added_mass_is_the_same(monkeypatch):
    if compiler_name() is None:
        pytest.skip("no C compiler here to compare with")
    robot = pt.load_robot("aerobat")
    air = pt.Air(wind=(-1.0, 0.3, 0.1))

    def fly():
        return pt.simulate(
            robot,
            pt.QuasiSteady(robot, air),
            pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5, left_feather=0.1),
            duration=0.01,
            time_step=2e-4,
            v=robot.coordinates(x=3.0),
            added_mass=pt.AddedMass(robot, air),
        )

    compiled = fly()
    monkeypatch.setenv("PATAGIUM_COMPILER", "none")
    fallback = fly()
    for name in ("q", "v", "a", "u1", "added_mass_force", "added_mass_work", "fluid_energy"):
        ours, theirs = compiled[name].values, fallback[name].values
        # twice the roundings of 50 steps, multiply-adds fused in one of the two
        np.testing.assert_allclose(theirs, ours, rtol=0, atol=1e-11 * np.abs(ours).max())

"""With added mass the integrator keeps its order, and so do the energies' books."""

from __future__ import annotations

import numpy as np

import patagium as pt
from patagium.aerodynamics import SmoothPolar


def test_energy_of_a_free_robot_and_its_air_converges_with_order_four():
    """No drag, no lift: a frictionless robot flaps in still air, and only they exchange."""
    robot = pt.load_robot("aerobat").with_parameters({f"{k}.damping": 0.0 for k in DAMPED})
    airless = SmoothPolar(lift_amplitude=0.0, zero_lift_drag=0.0, drag_rise=0.0)
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6, feather=0.3, left_elbow=0.2)
    ends, audits = [], []
    # short enough for the order to show: the wings pass 30 to 50 degrees, where circulation fades
    for time_step in (5e-4, 2.5e-4, 1.25e-4, 3.125e-5):
        flight = pt.simulate(
            robot,
            pt.QuasiSteady(robot, polar=airless),
            gait,
            duration=0.2,
            time_step=time_step,
            v=robot.coordinates(x=1.0),
            added_mass=pt.AddedMass(robot),
        )
        energy = flight.kinetic_energy + flight.potential_energy + flight.fluid_energy
        books = energy - energy[0] - flight.joint_work - flight.air_work
        assert np.abs(flight.damping_work.values).max() == 0.0
        # robot, air and joints: nothing else has energy, at fourth order
        audits.append(float(np.abs(books).max()) / flight.attrs["energy_exchanged"])
        ends.append(np.concatenate([flight.q.values[-1], flight.v.values[-1]]))
    assert audits[-1] < 1e-6 and audits[2] < 1e-6, audits
    errors = [np.abs(end - ends[-1]).max() for end in ends[:-1]]
    slopes = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(np.abs(slopes - 4.0) < 0.3), (errors, slopes)


DAMPED = ("roll", "pitch", "yaw")

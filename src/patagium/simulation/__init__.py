"""Simulation: gaits, mounts, integration, and the record of a flight."""

from patagium.simulation import gaits, mounts, paths
from patagium.simulation.arm_reconstruction import carrier_of
from patagium.simulation.cycles import cycle_statistics
from patagium.simulation.flight import (
    QUANTITIES,
    added_mass_of,
    aero_of,
    audits,
    gait_period,
    quantities,
    robot_of,
)
from patagium.simulation.flight_files import check_flight, load_flight, save_flight
from patagium.simulation.simulate import simulate

__all__ = [
    "QUANTITIES",
    "added_mass_of",
    "aero_of",
    "audits",
    "carrier_of",
    "check_flight",
    "cycle_statistics",
    "gait_period",
    "gaits",
    "load_flight",
    "mounts",
    "paths",
    "quantities",
    "robot_of",
    "save_flight",
    "simulate",
]

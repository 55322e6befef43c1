"""Simulation: gaits, mounts, integration, and the record of a flight."""

from patagium.simulation import gaits, mounts, paths
from patagium.simulation.cycles import cycle_statistics
from patagium.simulation.flight import (
    QUANTITIES,
    added_mass_of,
    aero_of,
    air_of,
    audits,
    carrier_of,
    check_flight,
    gait_period,
    load_flight,
    quantities,
    robot_of,
    save_flight,
)
from patagium.simulation.simulator import FlightState, Simulator, simulate

__all__ = [
    "QUANTITIES",
    "FlightState",
    "Simulator",
    "added_mass_of",
    "aero_of",
    "air_of",
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

"""What happens next: gaits, mounts, integration, and the record of a flight."""

from patagium.simulation import gaits, mounts, paths, sensors
from patagium.simulation.arm_records import carrier_of
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
from patagium.simulation.published import simulate_published
from patagium.simulation.sensors import SensorLog, load_sensor_log, save_sensor_log, sense
from patagium.simulation.simulate import simulate

__all__ = [
    "SensorLog",
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
    "load_sensor_log",
    "mounts",
    "paths",
    "quantities",
    "robot_of",
    "save_flight",
    "save_sensor_log",
    "sense",
    "sensors",
    "simulate",
    "simulate_published",
]

from patagium.simulation import gaits as gaits
from patagium.simulation import mounts as mounts
from patagium.simulation import paths as paths
from patagium.simulation.cycles import cycle_statistics as cycle_statistics
from patagium.simulation.flight import QUANTITIES as QUANTITIES
from patagium.simulation.flight import added_mass_of as added_mass_of
from patagium.simulation.flight import aero_of as aero_of
from patagium.simulation.flight import air_of as air_of
from patagium.simulation.flight import audits as audits
from patagium.simulation.flight import carrier_of as carrier_of
from patagium.simulation.flight import check_flight as check_flight
from patagium.simulation.flight import gait_period as gait_period
from patagium.simulation.flight import load_flight as load_flight
from patagium.simulation.flight import quantities as quantities
from patagium.simulation.flight import robot_of as robot_of
from patagium.simulation.flight import save_flight as save_flight
from patagium.simulation.simulator import FlightState as FlightState
from patagium.simulation.simulator import Simulator as Simulator
from patagium.simulation.simulator import simulate as simulate

__all__: list[str]

"""Control: exact derivatives of a wingbeat, periodic orbits, their stability, feedback."""

from patagium.control.gait_family import GaitFamily, gait_family
from patagium.control.wingbeat import FlightMap, PrescribedRows, Segments

__all__ = ["FlightMap", "GaitFamily", "PrescribedRows", "Segments", "gait_family"]

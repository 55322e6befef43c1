"""Limits of the measured force: one source of error after the other taken away, or put in.

The noise is that of the data sheets, over the first eight; nothing is learned here. Neglected:
errors of two instruments that do not add up as squares.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import xarray as xr

from patagium.sensing import estimate_motion, sense
from patagium.sensing.sensors import Sensor
from patagium.simulation import load_flight
from patagium_lab.rig.flights import LEAST_BELIEVED
from patagium_lab.rig.learning import forces_of
from patagium_lab.rig.plan import CAMERAS, CELL, ENCODERS, WING_UNIT, LimitCase, RigPlan
from patagium_lab.rig.scores import measured_error

SPAN = 1.7
"""Duration of the part of the flight that is used [s]."""


def run_case(plan: RigPlan, case: LimitCase, sensors: list[Sensor], truth: Path) -> dict[str, Any]:
    """Worst error of the measured force by each source of forces, with one thing changed.

    Args:
        plan: Plan of the rig.
        case: The change.
        sensors: Instruments of the rig.
        truth: File of the flight.
    """
    flight = _first(load_flight(truth))
    changed = [s.scaled(LEAST_BELIEVED) if s.name in case.ideal else s for s in sensors]
    log = sense(flight, changed, seed=plan.seed).without_truth()
    wrong = dict(case.wrong)
    late = {s.name: s.clock_offset + s.delay - wrong.get(s.name, 0.0) for s in sensors}
    shifts = {name: late[name] for name in (WING_UNIT, ENCODERS, CAMERAS)}
    motion = estimate_motion(log, shifts=shifts, order=case.order)
    forces = forces_of(log, motion, plan.air(), cell_late=late[CELL])
    return {"case": case.name} | {
        name: measured_error(flight, samples) for name, samples in forces.items()
    }


def _first(flight: xr.Dataset) -> xr.Dataset:
    return flight.sel(time=slice(None, SPAN + 1e-9))

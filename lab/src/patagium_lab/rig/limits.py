"""What limits the measured force: one source of error after the other taken away, or put in.

At the noise of the data sheets, over the first eight; nothing is learned here. Neglected: how
errors of two instruments add up beyond their squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from patagium.sensing import estimate_motion, sense
from patagium.sensing.sensors import Sensor
from patagium.simulation import load_flight
from patagium_lab.rig.flights import LEAST_BELIEVED
from patagium_lab.rig.learning import forces_of
from patagium_lab.rig.plan import CAMERAS, CELL, ENCODERS, MOTORS, UNIT, WING_UNIT, RigPlan
from patagium_lab.rig.scores import measured_error

SPAN = 1.7
"""Of the flight that is looked at [s]."""
MISTAKE = 1e-3
"""By which a clock is wrong where that is looked at [s]."""


@dataclass(frozen=True)
class Case:
    """One thing changed against the rig as it is.

    Attributes:
        name: What, in words.
        ideal: Instruments with a tenth of their errors.
        wrong: Instruments to errors of their clocks that nobody corrects [s].
        order: Of the smoother of motion.
    """

    name: str
    ideal: tuple[str, ...] = ()
    wrong: tuple[tuple[str, float], ...] = ()
    order: int = 4


CASES = (
    Case("as on the data sheets, clocks known"),
    Case("encoders, a tenth of the errors", (ENCODERS,)),
    Case("inertial units, a tenth of the errors", (UNIT, WING_UNIT)),
    Case("cameras, a tenth of the errors", (CAMERAS,)),
    Case("load cell and motors, a tenth of the errors", (CELL, MOTORS)),
    Case("encoders .1 ms late", wrong=((ENCODERS, 1e-4),)),
    Case("encoders 1 ms late", wrong=((ENCODERS, MISTAKE),)),
    Case("cameras 1 ms late", wrong=((CAMERAS, MISTAKE),)),
    Case("load cell 1 ms late", wrong=((CELL, MISTAKE),)),
    Case("white jerk in the smoother, not snap", order=3),
)


def run_case(plan: RigPlan, case: Case, sensors: list[Sensor], truth: Path) -> dict[str, Any]:
    """Worst error of the measured force by each source, one thing changed.

    Args:
        plan: The plan.
        case: What is changed.
        sensors: The instruments.
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

"""Times of trims: periodic orbits of the presets and of a hovering butterfly, code compiled.

Each search begins from the preset's cruise, or from the published hover, and is made again and
again in one process. Times are those of the wall, one core.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from time import perf_counter

import numpy as np

import patagium as pt
from patagium.control import NoOrbit, Orbit
from patagium_lab.bench.result import Result
from patagium_lab.validation.cases.monarch import hovers

TIMES = 21
"""Searches of each orbit that are timed."""
ORBITS = (
    *("aerobat, cruise", "aerobat, 4.5 m/s", "ornithopter, cruise", "dragonfly, hover"),
    *("hawk, glide", "hawk, glide with wings that sweep and fold"),
    *("monarch butterfly, attitude prescribed", "monarch butterfly, attitude free"),
    "monarch butterfly, attitude free abdomen still",
)
"""Names of the orbits that are searched."""


def orbit_results(times: int = TIMES) -> Iterator[Result]:
    """Median time of the search of each orbit.

    Args:
        times: Searches of each that are timed.

    Yields:
        Times [s]; where there is no orbit, the reason.
    """
    for name, search in _searches().items():
        orbit = search()
        if isinstance(orbit, NoOrbit):
            yield Result(f"trim: {name}", None, "s", note=str(orbit))
            continue
        took = []
        for _ in range(times):
            begun = perf_counter()
            search()
            took.append(perf_counter() - begun)
        note = f"{orbit.iterations} Newton steps, {orbit.steps} time steps a beat"
        note += f", residual {orbit.residual:.0e}"
        yield Result(f"trim: {name}", float(np.median(took)), "s", note=note)


def _searches() -> dict[str, Callable[[], Orbit | NoOrbit]]:
    """Search of each orbit, its robot and air made."""
    robots = {name: pt.load_robot(name) for name in ("aerobat", "ornithopter", "dragonfly", "hawk")}
    trims = {name: partial(pt.trim, robot, pt.QuasiSteady(robot)) for name, robot in robots.items()}
    offset = {"elevation": 0.34, "sweep": 0.2, "fold": 0.3}
    beat = pt.gaits.sinusoidal(robots["hawk"], frequency=2.0, sweep=0.2, fold=0.3, offset=offset)
    found: list[Callable[[], Orbit | NoOrbit]] = [
        trims["aerobat"],
        partial(trims["aerobat"], speed=4.5),
        trims["ornithopter"],
        partial(trims["dragonfly"], speed=0.0),
        partial(trims["hawk"], climb=None),
        partial(trims["hawk"], gait=beat, climb=None),
    ]
    for one in hovers():
        aero = pt.QuasiSteady(one.robot, pt.Air(1.225), force_point="fixed")
        found.append(partial(pt.trim, one.robot, aero, one.gait, speed=0.0))
    return dict(zip(ORBITS, found, strict=True))

"""The figures of a flight: the machine, the flight at a glance, its strips, its wingbeat, its air.

Each is made where it will be seen: on a page, in print, on slides (`report.style.LOOKS`).
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from patagium.errors import FlightError
from patagium.learning import evaluate
from patagium.learning.parameter_paths import Trained
from patagium.report.figures import comparison, flight_overview, histories, wingbeat
from patagium.report.style import figures_for
from patagium.robot.drawing import draw_robot
from patagium.sensing import ForceSamples
from patagium.simulation import cycle_statistics, gait_period, robot_of


def flight_figures(
    flight: xr.Dataset, look: str = "page", model: Trained | None = None
) -> dict[str, Figure]:
    """Figures of a flight by name.

    Args:
        flight: Record of a flight.
        look: Use of the figures: "page", "paper" or "slides".
        model: Learned model of the air, its weights frozen; None for none.

    Returns:
        robot, flight; strips of a robot with wings; wingbeat where the gait has one and it fits;
        forces with a model.

    Raises:
        ParameterError: If there is no such look.
        FlightError: If the flight misses a quantity.
    """
    with figures_for(look):
        figures = {
            "robot": draw_robot(robot_of(flight), flight["q"].values[0]),
            "flight": flight_overview(flight),
        }
        if flight.sizes["strip"]:
            figures["strips"] = _strips(flight)
        if gait_period(flight) is not None:
            with suppress(FlightError):  # shorter than two wingbeats
                figures["wingbeat"] = wingbeat(cycle_statistics(flight))
        if model is not None:
            figures["forces"] = _forces(flight, model)
    return figures


def motion_figure(motion: xr.Dataset, forces: ForceSamples) -> Figure:
    """Attitude and forces of an estimated motion with their 95 % intervals, blank if not known."""
    robot, n = forces.robot, forces.robot.dof
    base = [*robot.floating_dofs]
    shown = base[3:] or list(range(min(n, 3)))
    measured = [robot.index(name) for name in forces.measured]
    known = motion["known"].values[:, None]
    spread = np.sqrt(np.einsum("nii->ni", motion["covariance"].values[:, :n, :n]))
    turns = np.array([robot.dof_units[i] == "rad" for i in shown])
    scale = np.where(turns, np.degrees(1.0), 1.0)
    angles = np.where(known, motion["q"].values[:, shown] * scale, np.nan)
    names = [robot.dof_names[i] for i in shown]
    names += [f"force of the air, {robot.dof_names[i]}" for i in measured]
    units = ["deg" if turn else "m" for turn in turns]
    units += [robot.force_units[i] for i in measured]
    return comparison(
        motion["time"].values,
        None,
        {"estimate": np.hstack([angles, forces.force[:, measured]])},
        names=names,
        units=units,
        std=np.hstack([spread[:, shown] * scale, forces.std[:, measured]]),
        columns=3,
    )


def _strips(flight: xr.Dataset) -> Figure:
    """Incidence, speed and force of the first wing's root, middle and tip."""
    names = [str(name) for name in flight["strip"].values]
    wing = names[0].partition("[")[0]
    of_wing = [k for k, name in enumerate(names) if name.partition("[")[0] == wing]
    chosen = sorted({of_wing[0], of_wing[len(of_wing) // 2], of_wing[-1]})
    force = np.linalg.norm(flight["strip_force"].values, axis=-1)
    shown = (
        ("Angle of attack", "deg", np.degrees(flight["angle_of_attack"].values)),
        ("Airspeed", "m/s", flight["strip_airspeed"].values),
        ("Force", "N", force),
    )
    groups = [(name, unit, {names[k]: one[:, k] for k in chosen}) for name, unit, one in shown]
    return histories(flight["time"], groups)


def _forces(flight: xr.Dataset, model: Trained) -> Figure:
    """Figure of every generalized force of the air that varies, and of its prediction."""
    record = evaluate(flight, model).prediction
    truth, learned = record["measurement"].values, record["prediction"].values
    moving = [k for k in range(truth.shape[1]) if np.ptp(truth[:, k]) > 0.0]
    return comparison(
        record["time"].values,
        truth[:, moving],
        {"learned": learned[:, moving]},
        names=[str(record["output"].values[k]) for k in moving],
        units=[str(record["unit"].values[k]) for k in moving],
        columns=2,
    )

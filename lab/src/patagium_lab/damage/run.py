"""Run of the study of a lost wing: flights in processes, and their errors."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

import patagium as pt
from patagium import control
from patagium.aerodynamics import Aerodynamics, Air, DrydenGust, QuasiSteady, SmoothPolar
from patagium.arrays import Array
from patagium.control import AdaptiveController, Orbit
from patagium.control.adaptation import MEMORY, AirWeights
from patagium.control.events import without_tip
from patagium.control.predictive import OrbitController
from patagium.simulation.simulator import FlightState
from patagium.simulation.steered_gait import SteeredGait
from patagium_lab.conditions import conditions
from patagium_lab.damage.plan import (
    CHANGE_COST,
    COMMANDS,
    ENCODERS,
    FORGETTING,
    FROZEN,
    GRADIENT,
    IMU,
    KNOWN,
    LOST,
    MARGIN,
    MASSES,
    NOISE,
    OFF,
    SCALES,
    TOLERABLE,
    DamagePlan,
    Flight,
)
from patagium_lab.gallery import Gallery
from patagium_lab.jobs import Job, run_jobs
from patagium_lab.study import Results, Stages

STEPS = 300
"""Time steps of a beat of the truth."""
WINDOW, SETTLED = 5, 10
"""Beats over which a flight is back, and over which errors before and at the end are taken."""
LENGTH_SCALE = 5.0
"""Length scale of the turbulence [m]."""


@cache
def design() -> Orbit:
    """Orbit of the Aerobat in the model's air, which the controllers follow."""
    robot = pt.load_robot("aerobat")
    return cast(Orbit, pt.trim(robot, QuasiSteady(robot, polar=SmoothPolar())))


def authority(shares: tuple[float, ...] = (0.2, 1 / 3, 0.4, 0.5, 0.6)) -> list[dict[str, Any]]:
    """Trims of the robot with one wing cut, in the air of the truth.

    Args:
        shares: Shares of the span of the left wing that are lost.

    Returns:
        Share, whether there is a trim, and the least room that a command keeps to its limit, over
        that at the orbit without loss [1].
    """
    orbit, rows = design(), []
    start = orbit
    for share in shares:
        robot = without_tip(orbit.robot, "left_wing", share)
        found = pt.trim(
            robot, QuasiSteady(robot), orbit.gait, free=COMMANDS, speed=orbit.speed, start=start
        )
        row: dict[str, Any] = {"share": share, "found": found.found}
        if isinstance(found, Orbit):
            start = found
            row |= {"room": _room(found)} | {
                name: float(found.states[:, found.names.index(name)].mean())
                for name in ("roll", "velocity of y")
            }
        rows.append(row)
    return rows


def _room(orbit: Orbit) -> float:
    """Least room of a command on an orbit, over that on the design orbit [1]."""
    steered = SteeredGait(design().robot, design().gait)
    rooms = []
    for name, value in orbit.parameters.items():
        low, high, _ = steered.limits(name)
        neutral = float(steered.neutral[steered.places(name)[0]])
        scale = steered.scale(name)
        own = 0.0 if name.endswith("_offset") else 1.0  # of the design orbit, in its own unit
        now = neutral + scale * (value - own)
        rooms.append(min(high - now, now - low) / min(high - neutral, neutral - low))
    return float(min(rooms))


class ForgettingOnly(AdaptiveController):
    """Adaptive controller that does not look for a lost wing tip.

    It learns from every wingbeat, and older wingbeats count less and less.
    """

    def _surprise(self, missed: Array, beat: Any) -> float:
        """Zero, so that no wingbeat is taken for one in which a wing tip was lost."""
        return 0.0


class GradientWeights(AirWeights):
    """Weights of the air that are learned by gradient descent, one step per wingbeat.

    Each step reduces the sum of squared errors of its wingbeat. Weights are scaled by their prior
    standard deviations, and the step size is 1 over the largest eigenvalue of the Hessian, so that
    nothing has to be set. Whether the weights predict better than the prior, and whether they have
    changed, is judged as in `AirWeights`.

    Args:
        prior: Weights before any flight, (n_w,) [1, N, N m].
        stds: Their standard deviations, (n_w,) [1, N, N m].
        memory: Number of wingbeats over which these two questions are judged.
    """

    def learn(self, slopes: ArrayLike, measured: ArrayLike, alike: float = 1.0) -> None:
        """Take one gradient step with the samples of a beat; see `AirWeights.learn`."""
        before, h = self.weights, np.asarray(slopes, float)
        super().learn(slopes, measured, alike)
        scaled = h * self.stds
        steepest = self.stds * (scaled.T @ (np.asarray(measured) - h @ before))
        self.weights = before + steepest / np.linalg.norm(scaled, 2) ** 2

    def forget(self, share: float) -> None:
        """Move the weights towards the prior: a share of 0 keeps them, 1 gives the prior."""
        before = self.weights
        super().forget(share)
        self.weights = before + share * (self.prior - before)


class _Told:
    """Adaptive controller that is told of the loss, or stops learning then.

    Args:
        controller: The controller.
        time: When the wing is lost [s].
        air: Model of the air around the robot without the tip; None: it stops learning.
    """

    def __init__(
        self, controller: AdaptiveController, time: float, air: Aerodynamics | None
    ) -> None:
        self.controller, self.time, self.air = controller, time, air
        self.period = controller.period

    def __call__(self, time: float, state: FlightState | None) -> dict[str, float]:
        """Commands for the interval that begins now."""
        if time >= self.time and np.isfinite(self.time):
            self.time = np.inf
            if self.air is None:
                self.controller.learning = False
            else:
                self.controller.take(self.air)
                self.controller.use(self.controller.weights, round(time / self.period))
        return self.controller(time, state)


def fly(flight: Flight) -> dict[str, Any]:
    """Figures of a flight of the study.

    Args:
        flight: The flight.

    Returns:
        Its description, and: error before the loss and over the last beats; error of each beat,
        after which it is back, worst one; effort, power, what became of the orbits; motion.
    """
    orbit = design()
    robot = orbit.robot
    draw = np.random.default_rng([flight.seed, 7])
    wing = ("left_wing", "right_wing")[flight.seed % 2]
    law = _law(flight.law, orbit)
    beat = orbit.period
    time = (flight.before + draw.uniform()) * beat
    loss = control.WingLossEvent(time=time, wing=wing, share=flight.share or 1.0)
    controller: Any = law
    if flight.learner != OFF:
        kind = ForgettingOnly if flight.learner == FORGETTING else AdaptiveController
        controller = adaptive = kind(law)
        if flight.learner == GRADIENT:
            own = adaptive.learner
            adaptive.learner = GradientWeights(own.prior, own.stds, MEMORY)
        if flight.learner in (FROZEN, KNOWN):
            cut = loss.changed(robot, orbit.aero)[1] if flight.learner == KNOWN else None
            controller = _Told(adaptive, time, cut)
    true = control.off_nominal(robot, MASSES, flight.seed)
    air = Air()
    if flight.gust:
        scales = (LENGTH_SCALE,) * 3
        air = Air(gust=DrydenGust((flight.gust,) * 3, scales, orbit.speed, flight.seed))
    flown = pt.fly(
        true,
        QuasiSteady(true, air),
        controller,
        orbit=orbit,
        duration=(flight.before + flight.after) * beat,
        sensors=_sensors() if flight.group == "sensed" else control.NoisyState(NOISE),
        events=[loss] if flight.share else [],
        seed=flight.seed,
        time_step=beat / STEPS * 1.0001,
        throw=False,
    )
    counts = dict(adaptive.counts) if flight.learner != OFF else {}
    return asdict(flight) | scored(flown, law, flight.before) | {"counts": counts}


def _sensors() -> control.TrackedState:
    """Inertial unit and cameras on the body, encoders, and the tracker behind them."""
    presets = pt.sensors.presets
    unit = replace(presets.icm_42688_p("body"), name="imu", **IMU)
    encoders = presets.as5600(rate=ENCODERS)
    return control.TrackedState([unit, encoders, presets.prime_x_13("body")])


def _law(name: str, orbit: Orbit) -> OrbitController:
    """Controller along the orbit, by its name in the plan."""
    if name == "linear":
        return control.LinearRegulator(
            orbit, COMMANDS, tolerable=TOLERABLE, change_cost=CHANGE_COST
        )
    return control.PredictiveController(orbit, COMMANDS, tolerable=TOLERABLE)


def scored(flown: xr.Dataset, law: OrbitController, before: int) -> dict[str, Any]:
    """Errors of a flight, by the means of its beats.

    Args:
        flown: The flight.
        law: Its controller, for the ranges of the commands.
        before: Beats before that in which the wing is lost.
    """
    orbit = design()
    beats = (flown.sizes["time"] - 1) // STEPS
    means = {}
    for name in LOST:
        moving = name.removeprefix("velocity of ")
        series = (flown["q"] if moving == name else flown["v"]).sel(dof=moving).values
        own = orbit.speed if name == "velocity of x" else 0.0
        if name == "z":
            own = float(orbit.states[:, orbit.names.index("z")].mean())
        means[name] = series[: beats * STEPS].reshape(beats, STEPS).mean(axis=1) - own
    error = np.sqrt(np.mean([(means[k] / size) ** 2 for k, size in SCALES.items()], axis=0))
    former = _rms(error[before - SETTLED : before])
    away = np.any([np.abs(means[k]) > size for k, size in LOST.items()], axis=0)
    windows = [_rms(error[k : k + WINDOW]) for k in range(before, beats - WINDOW + 1)]
    back = next((k for k, one in enumerate(windows) if one <= MARGIN * former), None)
    work = flown["joint_work"].values[::STEPS][: beats + 1]
    power = np.diff(work) / orbit.period
    return {
        "former": former,
        "end": _rms(error[-SETTLED:]),
        "worst": float(error[before:].max(initial=0.0)),
        "back": back,
        "lost": bool(away[before:].any() or not np.isfinite(flown["q"].values[-1]).all()),
        "effort": _effort(flown, law, before),
        "power_before": float(power[:before].mean()),
        "power_after": float(power[before:].mean()),
        "error": error.tolist(),
        "means": {name: series.tolist() for name, series in means.items()},
    }


def _rms(error: Array) -> float:
    return float(np.sqrt(np.mean(np.square(error)))) if len(error) else float("nan")


def _effort(flown: xr.Dataset, law: OrbitController, before: int) -> float:
    """Root mean square of the change of the commands from beat to beat, over half their ranges."""
    found = []
    for name, (low, high, _) in zip(law.model.commands, law.ends, strict=True):
        series = flown["command"].sel(command_name=name).values[before * STEPS :]
        scale = law.model.steered.scale(name)
        found.append(np.std(series * scale) / ((high - low) / 2))
    return _rms(np.array(found))


def run(plan: DamagePlan, out: Path, stages: Stages) -> Results:
    """Results of the study; flights that are in the folder already are taken as they are.

    Args:
        plan: Plan of the study.
        out: Folder of the results.
        stages: Receives progress.
    """
    kept = out / "flights.jsonl"
    rows = _read(kept)
    wanted = [one for one in plan.listed() if _key(asdict(one)) not in rows]
    with stages.stage("flights", 0.0, 0.95) as tell, kept.open("a") as file:
        jobs = [Job(fly, (one,), _cost(one)) for one in wanted]

        def keep(number: int, row: Mapping[str, Any]) -> None:
            file.write(json.dumps(row) + "\n")
            file.flush()

        run_jobs(jobs, tell, plan.workers, keep)
    rows = _read(kept)
    with stages.stage("authority", 0.95, 1.0):
        found = authority()
    metrics = {
        "environment": conditions(),
        "share": plan.share,
        "seed": plan.seed,
        "authority": found,
        "rows": [rows[_key(asdict(one))] for one in plan.listed()],
    }
    return Results(metrics, Gallery(out))


def _cost(flight: Flight) -> float:
    """Expected duration of a flight [s]."""
    sensed = 6.0 if flight.group == "sensed" else 0.0
    beats = (flight.before + flight.after) / (Flight.before + Flight.after)
    return sensed + beats * (1.5 if flight.learner == OFF else 3.0)


def _read(path: Path) -> dict[str, dict[str, Any]]:
    if not path.exists():
        return {}
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    return {_key(row): row for row in rows}


def _key(row: Mapping[str, Any]) -> str:
    """Name of a flight by its description."""
    return json.dumps([row[name] for name in Flight.__dataclass_fields__])

"""Run of the rig: the paper's experiment as its authors meant it, with arm, robot and sensors.

First half: fly and sense; logs are written. Second half: each log is read back, clocks, motion and
force are found, and the air is learned; nothing else is known. Then both halves are compared.
Neglected: hardware.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from patagium.sensing.sensors import Sensor
from patagium.simulation import robot_of
from patagium.viewer import replay
from patagium.whole_file import make_folder
from patagium_lab.conditions import conditions
from patagium_lab.gallery import Gallery
from patagium_lab.jobs import Job, run_jobs
from patagium_lab.rig import figures, scores
from patagium_lab.rig.flights import Flown, fly
from patagium_lab.rig.learning import LogResult, learn_from_log
from patagium_lab.rig.limits import run_case
from patagium_lab.rig.page import LEFT_OUT
from patagium_lab.rig.plan import (
    CAMERAS,
    CELL,
    ENCODERS,
    LIMIT_CASES,
    MOTORS,
    UNIT,
    WING_UNIT,
    RigPlan,
    learned_motion,
)
from patagium_lab.study import Results, Stages

_MOVING = "The flight on the arm, as it truly was"
LEARNING_COST, CASE_COST = 60.0, 10.0
"""Expected duration of a log, and of a case of the limits [s]."""


def run(plan: RigPlan, out: Path, stages: Stages) -> Results:
    """Fly, sense, learn from the logs, and compare with the truth.

    Learning runs in worker processes: a script that calls this needs the usual guard
    `if __name__ == "__main__":`.

    Args:
        plan: What is flown, measured and learned.
        out: Folder of flight.html, logs/, models/, truth/ and figures/.
        stages: Receives progress.

    Raises:
        PathError: If the arm cannot follow the path.
        ParameterError: If the robot does not fit the rig.
    """
    begun = time.perf_counter()
    with stages.stage("flying and sensing", 0.0, 0.1) as tell:
        flown = fly(plan, out, tell)
    with stages.stage("learning from logs", 0.1, 0.9) as tell:
        logs, limits = _learn(plan, flown, out, tell)
    with stages.stage("comparing with the truth", 0.9, 1.0):
        metrics = _metrics(plan, flown, logs, limits)
        cycles = scores.cycles(plan, flown.flight, _shown(logs)[1])
        metrics["cycles"] = {name: dict(one.attrs) for name, one in cycles.items()}
        gallery = Gallery(out / "figures")
        _draw(gallery, plan, flown, logs, metrics, cycles)
        metrics["replay"] = replay(flown.flight, out / "flight.html", title=_MOVING).name
    metrics["seconds"] = time.perf_counter() - begun
    return Results(metrics, gallery)


def _learn(
    plan: RigPlan, flown: Flown, out: Path, tell: Callable[[float], None]
) -> tuple[dict[float, LogResult], list[dict[str, Any]]]:
    """Result of each log, by its noise, and rows of what limits the measured force."""
    models = make_folder(out / "models")
    jobs = [Job(learn_from_log, (plan, log, models), LEARNING_COST) for log in flown.logs.values()]
    cases = [case for case in LIMIT_CASES if case.name in plan.limits]
    jobs += [Job(run_case, (plan, case, flown.sensors, flown.truth), CASE_COST) for case in cases]
    found = run_jobs(jobs, tell, plan.workers)
    count = len(flown.logs)
    return dict(zip(flown.logs, found[:count], strict=True)), found[count:]


def _metrics(
    plan: RigPlan, flown: Flown, runs: dict[float, LogResult], limits: list[dict[str, Any]]
) -> dict[str, Any]:
    metrics: dict[str, Any] = {
        "environment": conditions(),
        "plan": plan.describe(),
        "instruments": _instruments(flown.sensors),
        "arm": _arm(plan, flown),
        "noise": [
            {
                "noise": factor,
                "clocks": scores.clock_rows(flown.sensors, run),
                **scores.compare(plan, flown.flight, flown.unseen, run),
            }
            for factor, run in runs.items()
        ],
        "limits": limits,
        "left_out": list(LEFT_OUT),
    }
    metrics["targets"] = scores.targets(metrics)
    return metrics


def _draw(
    gallery: Gallery,
    plan: RigPlan,
    flown: Flown,
    runs: dict[float, LogResult],
    metrics: dict[str, Any],
    cycles: dict[str, Any],
) -> None:
    factor, run = _shown(runs)
    figures.flight_figure(gallery, flown.flight)
    figures.noise_figure(gallery, metrics["noise"])
    figures.force_figure(gallery, plan, flown.flight, run, factor)
    figures.wingbeat_figure(gallery, cycles, factor)
    if metrics["limits"]:
        figures.limits_figure(gallery, metrics["limits"])


def _shown(runs: dict[float, LogResult]) -> tuple[float, LogResult]:
    factor = 1.0 if 1.0 in runs else next(iter(runs))
    return factor, runs[factor]


def _arm(plan: RigPlan, flown: Flown) -> dict[str, dict[str, float]]:
    arm = learned_motion(plan, robot_of(flown.flight)).mount.plan
    return {} if arm is None else arm.demands()


def _instruments(sensors: Sequence[Sensor]) -> list[dict[str, Any]]:
    return [
        {"name": one.name, "part": _PARTS[one.name][0], "rate": one.rate,
         "errors": _PARTS[one.name][1]}
        for one in sensors
    ]  # fmt: skip


_PARTS = {
    UNIT: ("TDK ICM-42688-P on the body", "65 to 70 ug/sqrt(Hz), 2.8 mdeg/s/sqrt(Hz), biases"),
    WING_UNIT: ("TDK ICM-42688-P on a wing's first link", "the same"),
    ENCODERS: ("ams AS5600 on each joint", "12 bits a turn, .043 deg rms"),
    CAMERAS: ("OptiTrack PrimeX 13", ".2 mm, .5 deg"),
    CELL: ("ATI Nano17, SI-12-0.12", "1/320 N, 1/64 N mm a count"),
    MOTORS: ("TI INA226 on each motor", "2.5 uV a count, offset 2.5 uV, gain .02 %"),
}

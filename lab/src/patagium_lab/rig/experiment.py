"""The paper's experiment as its authors meant it: arm, robot and sensors, then logs alone.

First half: fly and sense, logs written. Second half: each log read back, clocks, motion and force
found, the air learned, nothing else known. Then both are compared. Neglected: hardware.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from patagium.learning.scores import json_ready
from patagium.report import write_page
from patagium.sensing.sensors import Sensor
from patagium.simulation import robot_of
from patagium.viewer import replay
from patagium.whole_file import write_whole
from patagium_lab.conditions import conditions
from patagium_lab.reproduction.figures import Gallery
from patagium_lab.rig import figures, scores
from patagium_lab.rig.flights import Flown, fly
from patagium_lab.rig.learning import LogRun, learn_from_log
from patagium_lab.rig.limits import CASES, run_case
from patagium_lab.rig.plan import (
    CAMERAS,
    CELL,
    ENCODERS,
    MOTORS,
    UNIT,
    WING_UNIT,
    RigPlan,
    learned_motion,
)
from patagium_lab.rig.report import LEFT_OUT, TITLE, facts, results, sections, summary
from patagium_lab.workers import WORKERS, Job, run_jobs

_MOVING = "The flight on the arm, as it truly was"
Stages = Callable[[str, float], None]
"""Told the stage and the part of all done, 0 to 1."""
LEARNING_COST, CASE_COST = 60.0, 10.0
"""About how long a log takes, and a case of the limits [s]."""


def run_rig(
    out: Path,
    plan: RigPlan,
    *,
    progress: Stages | None = None,
    workers: int = WORKERS,
    page: Path | None = None,
) -> Path:
    """Fly, sense, learn from logs, compare, report.

    Learning runs in worker processes: a script that calls this needs the usual guard
    `if __name__ == "__main__":`.

    Args:
        out: Folder of the results, made if need be.
        plan: What to do.
        progress: Told the stage and the part of all done.
        workers: Number of processes; 0: all in this one.
        page: A page of the results to write too, Markdown or HTML.

    Returns:
        Path of report.html; beside it flight.html, metrics.json, logs/, models/, truth/ and
        figures/.

    Raises:
        PathError: If the arm cannot follow.
        ParameterError: If the robot does not fit the rig.
    """
    begun = time.perf_counter()

    def told(stage: str, begin: float, end: float) -> Callable[[float], None]:
        def tell(part: float) -> None:
            if progress is not None:
                progress(stage, begin + part * (end - begin))

        tell(0.0)
        return tell

    out.mkdir(parents=True, exist_ok=True)
    flown = fly(plan, out, told("flying and sensing", 0.0, 0.1))
    runs, limits = _work(plan, flown, out, told("learning from logs", 0.1, 0.9), workers)
    told("comparing with the truth", 0.9, 1.0)
    metrics = _metrics(plan, flown, runs, limits)
    cycles = scores.cycles(plan, flown.flight, _shown(runs)[1])
    metrics["cycles"] = {name: dict(one.attrs) for name, one in cycles.items()}
    gallery = Gallery(out / "figures")
    _draw(gallery, plan, flown, runs, metrics, cycles)
    metrics["replay"] = replay(flown.flight, out / "flight.html", title=_MOVING).name
    metrics["seconds"] = time.perf_counter() - begun
    text = json.dumps(json_ready(metrics), indent=1, ensure_ascii=False)
    write_whole(out / "metrics.json", text + "\n")
    found, origin = summary(metrics), facts(metrics)
    report = write_page(
        out / "report.html", TITLE, sections(metrics, gallery.pictures), summary=found, facts=origin
    )
    if page is not None:
        write_page(page, TITLE, results(metrics, gallery.vectors()), summary=found, facts=origin)
    if progress is not None:
        progress("done", 1.0)
    return report


def _work(
    plan: RigPlan, flown: Flown, out: Path, tell: Callable[[float], None], workers: int
) -> tuple[dict[float, LogRun], list[dict[str, Any]]]:
    """What each log gave, and the limits."""
    models = out / "models"
    jobs = [
        Job(learn_from_log, (plan, path, models), LEARNING_COST) for path in flown.logs.values()
    ]
    if plan.limits:
        jobs += [
            Job(run_case, (plan, case, flown.sensors, flown.truth), CASE_COST) for case in CASES
        ]
    if workers:
        found = run_jobs(jobs, tell, workers)
    else:
        found = [job.function(*job.arguments) for job in jobs]
    count = len(flown.logs)
    return dict(zip(flown.logs, found[:count], strict=True)), found[count:]


def _metrics(
    plan: RigPlan, flown: Flown, runs: dict[float, LogRun], limits: list[dict[str, Any]]
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
    runs: dict[float, LogRun],
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


def _shown(runs: dict[float, LogRun]) -> tuple[float, LogRun]:
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

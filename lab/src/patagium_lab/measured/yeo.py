"""A measured flapping wing: its lift predicted, then learned cycle by cycle.

Flap angle in, lift of both wings out, nothing else measured. Each cycle is predicted with
the weights known when it begins, then streamed through the learner. The record is one
(averaged) cycle repeated: the error says what a model can represent and how fast it
learns. A quarter of the cycle that is not learned shows what it does elsewhere. Neglected: changes
from cycle to cycle, which the record does not hold.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from patagium.aerodynamics import Air, QuasiSteady
from patagium.arrays import Array
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.models.dense import DenseNetwork
from patagium.learning.models.network import Network
from patagium.learning.models.strip import StripNetwork
from patagium.learning.result import check
from patagium.learning.scores import IntervalSums, normalized_error
from patagium.report import PageSection, Table, picture
from patagium.report.figures import comparison
from patagium.robot import Robot, load_robot
from patagium.simulation import gaits
from patagium_lab.comparisons import learning_curves
from patagium_lab.measured.yeo_case import FourierSeries, YeoCase, load_yeo_case

CYCLES = 10
TEACHING_CYCLES = 3
"""Cycles of the quasi-steady model's own lift that the warm start is taught first."""
HIDDEN = (6,)
FLAP_SCALE = (0.4, 8.0)
"""Flap angle [rad] and rate [rad/s] that the dense network takes as one."""


@dataclass(frozen=True)
class YeoStudy:
    """Predicted and learned lift of the measured wing.

    Attributes:
        scores: Mean absolute errors [N] and the rest, by name; JSON-able.
        record: Dataset over phase, model, cycle: measured, quasi_steady, predicted (model,
            phase; last cycle), cycle_error (model, cycle) [N].
    """

    scores: dict[str, Any]
    record: xr.Dataset


@dataclass(frozen=True)
class _Candidate:
    """A network, its inputs over the cycle, its learner's settings, and lift it learns first."""

    network: Network
    x: Array
    setting: dict[str, float]
    teacher: Array | None = None

    def learner(self) -> CubatureLearner:
        learner = CubatureLearner(self.network, **self.setting)  # type: ignore[arg-type]
        if self.teacher is not None:
            for _ in range(TEACHING_CYCLES):
                _teach(learner, self.x, self.teacher)
        return learner


def lift_balance(robot: Robot) -> Array:
    """Matrix that sums the z components of the strip forces, (1, 3 n_strips) [1]."""
    row = np.zeros((1, 3 * len(robot.strips)))
    row[0, 2::3] = 1.0
    return row


def quasi_steady_lift(case: YeoCase, flap_angle: FourierSeries) -> Array:
    """Lift of both wings by blade elements with the Dickinson polar, untuned, (100,) [N].

    Args:
        case: The measured case.
        flap_angle: Flap angle of the wings.
    """
    robot, air = load_robot("yeo-wing"), _air(case)
    aero, state = QuasiSteady(robot, air), _state(robot, case, flap_angle)
    return np.array([aero.strips(*np.split(x, 2))["strip_force"][:, 2].sum() for x in state], float)


def yeo_study(cycles: int = CYCLES, progress: Callable[[int, int], None] | None = None) -> YeoStudy:
    """Quasi-steady prediction of the measured lift, and learning it online.

    Args:
        cycles: Number of cycles that are learned.
        progress: Receives the number of models done and of all models.
    """
    case = load_yeo_case()
    baseline = quasi_steady_lift(case, case.flap_angle)
    candidates = _candidates(case, baseline)
    errors, guesses, scores = {}, {}, _no_learning(case, baseline)
    for done, (name, candidate) in enumerate(candidates.items()):
        errors[name], guesses[name], more = _learn(case, candidate, cycles)
        scores |= {f"{name}: {key}": value for key, value in more.items()}
        if progress is not None:
            progress(done + 1, len(candidates))
    return YeoStudy(scores, _record(case, baseline, errors, guesses))


def yeo_sections(study: YeoStudy) -> list[PageSection]:
    """Section of a page with the study.

    Args:
        study: Results of `yeo_study`.
    """
    record, models = study.record, [str(m) for m in study.record["model"].values]
    curves = {name: record["predicted"].sel(model=name).values[:, None] for name in models}
    time = record["time"].values
    figure = comparison(
        time,
        record["measured"].values[:, None],
        {"quasi-steady": record["quasi_steady"].values[:, None], **curves},
        names=["Lift of both wings"],
        units=["N"],
        truth_name="measured",
    )
    cycle_time = record["cycle"].values * (time[1] - time[0]) * len(time)
    learning = learning_curves(
        cycle_time,
        {name: record["cycle_error"].sel(model=name).values for name in models},
        label="one-cycle-ahead mean absolute error [N]",
    )
    return [
        PageSection(
            "A measured flapping wing (Yeo et al. 2011)",
            [
                "Flap angle in, lift of both wings out; nothing else is measured. The record is "
                "one averaged cycle repeated, so holding the last cycle would score zero: the "
                "error says what each model can represent. The last column keeps each quarter "
                "of the cycle in turn from the learner and scores it there.",
                picture(figure, "Lift over a cycle: measured, untuned, and one cycle ahead."),
                picture(learning, "Error of the next cycle, before it is learned."),
                _table(study, models),
            ],
        )
    ]


def _candidates(case: YeoCase, baseline: Array) -> dict[str, _Candidate]:
    robot = load_robot("yeo-wing")
    strips = StripNetwork(robot, HIDDEN, _air(case), measured=lift_balance(robot))
    dense = DenseNetwork(2, HIDDEN, ("lift",), input_scale=FLAP_SCALE, output_scale=0.1)
    state = _state(robot, case, case.flap_angle)
    blank = {"prior_std": 0.5, "measurement_std": 0.005, "spread": 3**0.5}
    cold = {**blank, "prior_std": 0.2}
    warm = {**cold, "measurement_std": 0.01, "process_std": 0.001}
    flap = state[:, [robot.index("left_plunge"), robot.dof + robot.index("left_plunge")]]
    return {
        "strip network": _Candidate(strips, state, cold),
        "strip network, quasi-steady taught first": _Candidate(strips, state, warm, baseline),
        "dense network": _Candidate(dense, flap, blank),
    }


def _learn(
    case: YeoCase, candidate: _Candidate, cycles: int
) -> tuple[list[float], Array, dict[str, Any]]:
    learner, lift, errors = candidate.learner(), case.lift, []
    for cycle in range(cycles):
        guess = candidate.network.evaluate(candidate.x, learner.weights)[:, 0]
        errors.append(float(np.abs(lift - guess).mean()))
        if cycle < cycles - 1:
            _teach(learner, candidate.x, lift)
    checks = [check(learner, k, (candidate.x[k], lift[k : k + 1])) for k in range(len(lift))]
    intervals = IntervalSums(1)
    intervals.add(np.array([c.error for c in checks]), np.array([c.std for c in checks]))
    return (
        errors,
        guess,
        {
            "first cycle": errors[0],
            "second cycle": errors[1] if cycles > 1 else float("nan"),
            "last cycle": errors[-1],
            "last cycle nmse": float(normalized_error(lift[:, None], guess[:, None])[0]),
            "last cycle coverage": float(intervals.coverage_in_all),
            "unseen quarter": _unseen_quarter(case, candidate, cycles),
            "weights": candidate.network.size,
            "time_per_update": learner.time_per_update,
        },
    )


def _unseen_quarter(case: YeoCase, candidate: _Candidate, cycles: int) -> float:
    """Error in the quarter of the cycle that was never taught, mean over the four."""
    quarter = 4 * np.arange(len(case.lift)) // len(case.lift)
    errors = []
    for hidden in range(4):
        learner, seen = candidate.learner(), quarter != hidden
        for _ in range(cycles):
            _teach(learner, candidate.x[seen], case.lift[seen])
        guess = candidate.network.evaluate(candidate.x[~seen], learner.weights)[:, 0]
        errors.append(np.abs(case.lift[~seen] - guess).mean())
    return float(np.mean(errors))


def _no_learning(case: YeoCase, baseline: Array) -> dict[str, Any]:
    digitized = quasi_steady_lift(case, case.digitized_flap_angle)
    quarters = np.abs(case.lift - baseline).reshape(4, -1).mean(axis=1)
    return {
        "lift rms": float(np.sqrt(np.mean(case.lift**2))),
        "quasi-steady": float(np.abs(case.lift - baseline).mean()),
        "quasi-steady nmse": float(normalized_error(case.lift[:, None], baseline[:, None])[0]),
        "quasi-steady, digitized flap angle": float(np.abs(case.lift - digitized).mean()),
        "quasi-steady, scaled and shifted afterwards": float(
            np.abs(case.lift - np.polyval(np.polyfit(baseline, case.lift, 1), baseline)).mean()
        ),
        "quasi-steady, worst quarter": float(quarters.max()),
        "published": dict(case.published_error),
    }


def _record(
    case: YeoCase, baseline: Array, errors: dict[str, list[float]], guesses: dict[str, Array]
) -> xr.Dataset:
    models = list(errors)
    newton = {"units": "N"}
    return xr.Dataset(
        {
            "measured": (("phase",), case.lift, newton),
            "quasi_steady": (("phase",), baseline, newton),
            "predicted": (("model", "phase"), np.array([guesses[m] for m in models]), newton),
            "cycle_error": (("model", "cycle"), np.array([errors[m] for m in models]), newton),
        },
        coords={
            "phase": ("phase", case.phase, {"units": "rad"}),
            "time": ("phase", case.phase / (2 * np.pi * case.frequency), {"units": "s"}),
            "model": models,
            "cycle": np.arange(1, len(errors[models[0]]) + 1),
        },
        attrs={"source": case.source, "licence": case.licence},
    )


def _table(study: YeoStudy, models: list[str]) -> Table:
    scores = study.scores
    rows: list[list[Any]] = [
        [f"{name}, as published", None, error, None, None]
        for name, error in scores["published"].items()
    ]
    rows.append(["quasi-steady, ours, no learning", None, scores["quasi-steady"], None, None])
    for name in models:
        rows.append(
            [
                f"{name}, learned online ({scores[f'{name}: weights']} weights)",
                scores[f"{name}: second cycle"],
                scores[f"{name}: last cycle"],
                scores[f"{name}: last cycle coverage"],
                scores[f"{name}: unseen quarter"],
            ]
        )
    return Table(
        [
            "model",
            "error of the second cycle [N]",
            "error [N] (learned: last cycle)",
            "in the 95 % interval",
            "error in the unseen quarter [N]",
        ],
        rows,
        f"Mean absolute error of the lift, whose rms is {scores['lift rms']:.4f} N. Scaled and "
        "shifted afterwards to fit best, two numbers, the quasi-steady lift would err by "
        f"{scores['quasi-steady, scaled and shifted afterwards']:.4f} N.",
    )


def _teach(learner: CubatureLearner, x: Array, lift: Array) -> None:
    for sample, force in zip(x, lift, strict=True):
        learner.update(sample, [force])


def _air(case: YeoCase) -> Air:
    return Air(density=case.density, wind=(-case.airspeed, 0.0, 0.0))


def _state(robot: Robot, case: YeoCase, flap_angle: FourierSeries) -> Array:
    """[q, v] of the wings over one cycle, (100, 2n)."""
    series = list(zip(flap_angle.cosine, flap_angle.sine, strict=True))
    gait = gaits.fourier(robot, frequency=case.frequency, plunge=(flap_angle.mean, series))
    motion = gait.motion(case.phase / (2.0 * np.pi * case.frequency))
    return np.hstack([motion.position, motion.velocity])

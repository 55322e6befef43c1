"""The report of the reproduction: sections of prose, tables and pictures.

Every figure in it is among the metrics. Neglected: anything that was not run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from patagium.report import Block, Link, Note, Picture, Section, cell_text
from patagium_lab.reproduction.claims import claims_table
from patagium_lab.reproduction.errors import GENTLE_GAIT, error_table
from patagium_lab.reproduction.flights import PUBLISHED_GAIT
from patagium_lab.reproduction.plan import Plan
from patagium_lab.reproduction.tables import (
    aerodynamics_table,
    dynamics_table,
    flight_table,
    learner_table,
    limit_table,
    stage_table,
    starts_table,
    unseen_table,
)
from patagium_lab.reproduction.targets import targets_table
from patagium_lab.reproduction.unsteady_report import unsteady_section
from patagium_lab.verdicts import count_met

Metrics = Mapping[str, Any]
Pictures = Mapping[str, Picture]
FULL = Plan().duration
"""Of the flights whose targets are told [s]."""

RESULTS = (
    "Targets",
    "The claims of the paper",
    "Overhead of dynamics and of aerodynamics",
    "Learning the corrected flight",
    "Gaits never seen",
    "Air with memory",
    "How it was run",
)
"""Sections of the page of results."""
TITLE = "Morphing-wing flight and learned air: the paper, as published and corrected"


def sections(metrics: Metrics, pictures: Pictures, measured: Sequence[Section]) -> list[Section]:
    """The report in reading order.

    Args:
        metrics: Of the reproduction.
        pictures: By name.
        measured: Sections of the studies of measured data.
    """
    return [
        _experiments(metrics, pictures),
        Section("The claims of the paper", [_CLAIMS, claims_table(metrics)]),
        Section("Targets", _targets(metrics)),
        _errors(metrics),
        _overhead(metrics, pictures),
        _learning(metrics, pictures, "published"),
        _learning(metrics, pictures, "corrected"),
        _unseen(metrics, pictures),
        Section("What limits the dense network", [_LIMITS, limit_table(metrics)]),
        Section("The luck of the start", [_STARTS, starts_table(metrics)]),
        unsteady_section(metrics, pictures),
        *measured,
        Section("How it was run", [*_method(metrics), stage_table(metrics)]),
    ]


def results(metrics: Metrics, pictures: Pictures) -> list[Section]:
    """What came out, without what led there: the sections of a page of results.

    Args:
        metrics: Of the reproduction.
        pictures: By name.
    """
    whole = {section.title: section for section in sections(metrics, pictures, [])}
    return [whole[title] for title in RESULTS]


def summary(metrics: Metrics) -> str:
    """What was found, in a few sentences.

    Args:
        metrics: Of the reproduction.
    """
    met = sum(row["met"] is True for row in metrics["targets"])
    speed = metrics["flights"]["published"]["speed_largest"]
    return (
        "The paper learns the force of the air on a flapping robot with a neural network and a "
        "cubature Kalman filter. Its published experiment is run here as published, where the "
        f"robot reaches {cell_text(speed)} m/s, and corrected, where it flies within its means. "
        "**A network that knows how air pushes on strips learns both from one sample in 100 and "
        "predicts gaits it never saw.** Networks that know nothing, the paper's among them, follow "
        "the gait they are shown and nothing else, and in that least squares on random features "
        f"does better than they do. {met} of {len(metrics['targets'])} targets are met."
    )


def facts(metrics: Metrics) -> dict[str, str]:
    """Where the figures come from, for the foot of the page.

    Args:
        metrics: Of the reproduction.
    """
    made = f"`patagium reproduce`, flights of {metrics['plan']['duration']:g} s"
    return {"made by": made, **metrics["environment"]}


def _targets(metrics: Metrics) -> list[Block]:
    duration = metrics["plan"]["duration"]
    short = [
        Note(f"Short flights of {duration:g} s were asked for; targets are those of {FULL:g} s.")
    ]
    met = count_met(metrics["targets"])
    return [_TARGETS, *(short if duration < FULL else []), met, targets_table(metrics)]


def _experiments(metrics: Metrics, pictures: Pictures) -> Section:
    return Section(
        "Two experiments",
        [
            f"**As published**: {_gait(PUBLISHED_GAIT)}, the air with all its errors, joints "
            "overwritten at every step. **Corrected**: inertia, air and stepping mended (errors "
            "E1 to E9 of the report below), the wing driven by the robot's crank linkage and "
            "feathering, in free flight.",
            flight_table(metrics),
            *(
                Link(f"The {name.replace('_', ' ')} flight in three dimensions", address)
                for name, address in metrics["replays"].items()
            ),
            *_present(pictures, "published_flight", "corrected_flight"),
        ],
    )


def _errors(metrics: Metrics) -> Section:
    put_in, taken_away = metrics["errors"]["put_in"], metrics["errors"]["taken_away"]
    return Section(
        "What each error of the published experiment does",
        [
            "E1: a wing moving down is pushed down. E2: drag pushes a wing that moves backwards. "
            "E3: joints are overwritten at each step, so momentum and energy come from nowhere. "
            "E4: a factor 5 on both coefficients. E5: a polar for 0 to 90 degrees used at "
            "negative incidence too. E6: inertia entries swapped. E7: a yaw of 2 pi at the start, "
            "without effect on the motion, but 6.28 goes into a network whose inputs are not "
            "scaled. E9: incidence from the velocity of mid-chord, force at a quarter chord.",
            error_table(
                put_in, f"Each error alone put into the corrected model; {_gait(GENTLE_GAIT)}."
            ),
            error_table(
                taken_away,
                f"Each error alone taken away from the published one; {_gait(PUBLISHED_GAIT)}.",
            ),
            Note(
                "A run that nears the speed of sound is stopped; the time it flew is in the last "
                "column. The residuals compare changes of energy and momentum with the works and "
                "impulses of all forces there are."
            ),
        ],
    )


def _overhead(metrics: Metrics, pictures: Pictures) -> Section:
    return Section(
        "Overhead of dynamics and of aerodynamics",
        [
            "All on the same 14-coordinate robot, in one run. The published figure compares first "
            "calls of an interpreted symbolic model with compiled code of a differentiated one.",
            *_present(pictures, "overhead_dynamics"),
            dynamics_table(metrics),
            *_present(pictures, "overhead_aerodynamics"),
            aerodynamics_table(metrics),
        ],
    )


def _learning(metrics: Metrics, pictures: Pictures, flight: str) -> Section:
    names = ("body", "left_wing", "attitude")
    return Section(
        f"Learning the {flight} flight",
        [
            _LEARNING[flight],
            *_present(pictures, *(f"{flight}_forces_{name}" for name in names)),
            *_present(pictures, f"{flight}_innovation", f"{flight}_learning"),
            learner_table(metrics, flight),
        ],
    )


def _unseen(metrics: Metrics, pictures: Pictures) -> Section:
    beyond = [gait for gaits in metrics["flights"]["unseen_beyond"].values() for gait in gaits]
    return Section(
        "Gaits never seen",
        [
            "After the flight the weights are frozen and asked for the forces of other flights, "
            "each simulated on its own, true states in. Here physics inside the network decides.",
            *_present(pictures, "corrected_unseen", "published_unseen"),
            unseen_table(metrics, "corrected"),
            unseen_table(metrics, "published"),
            Note(
                "Gaits whose incidences leave the range that was learned ask for extrapolation "
                f"and are no target: {', '.join(beyond) or 'none here'}."
            ),
        ],
    )


def _method(metrics: Metrics) -> list[str | Note]:
    choices = metrics["choices"]
    blocks: list[str | Note] = [
        "Forces come from the flight by inverse dynamics, as the paper does it. Each sample is "
        "predicted by the weights known before it is used; with one sample in 100 used, all 100 "
        "of the interval count. Errors are divided by the variance of each force over the same "
        "span; forces that never move are left out.",
        f"Cubature points lie at {cell_text(choices['spread'])} standard deviations (the paper's "
        "rule: the square root of the number of weights). **Strip network**: inputs are the "
        "direction of the local flow, tanh, prior deviation "
        f"{cell_text(choices['weight_std'])} for each weight, measurement deviation "
        f"{cell_text(choices['strip_std']['published'])} N a strip published and "
        f"{cell_text(choices['strip_std']['corrected'])} N corrected, mapped to the forces "
        "by their lever arms; no process noise, no forgetting. With `pitch rate` the reduced "
        "pitch rate of the strip is a third input: the published air takes its incidence at "
        "mid-chord (E9), which two inputs cannot express. **Dense networks**: softplus; inputs "
        "and outputs scaled by the envelope in which the robot is known to move and the force of "
        f"a strip; prior deviation {cell_text(choices['dense_prior'])} over the square root of "
        f"the fan-in; measurement deviation {cell_text(choices['dense_noise'])} of the output "
        f"scale; memory {cell_text(choices['memory'])} s, but no less than "
        f"{cell_text(choices['least_memory'])} samples. These were chosen by small searches on "
        "these flights, the same for all runs of a family.",
    ]
    blocks += [Note(text) for text in metrics["left_out"]]
    return blocks


def _present(pictures: Pictures, *names: str) -> list[Picture]:
    return [pictures[name] for name in names if name in pictures]


def _gait(gait: Mapping[str, float]) -> str:
    return (
        f"{cell_text(gait['frequency'])} Hz, plunge ±{cell_text(gait['amplitude'])} rad, "
        f"{cell_text(gait['speed'])} m/s at the start"
    )


_CLAIMS = (
    "What the paper says, what the scripts behind it do, and what comes out when it is run. "
    "Errors E1 to E13 are numbered as in the project's notes."
)
_TARGETS = "What this reproduction set out to reach; where a target is missed it says so."
_LIMITS = (
    "A dense network of the experiment's size 8-20-14 on the published flight. What it cannot "
    "represent it takes for noise-free truth: the filter grows certain of the wrong weights and "
    "stops learning, unless it forgets. Forgetting makes it follow the gait of the moment, which "
    "is tracking, not knowledge: see the gaits never seen."
)
_STARTS = (
    "A network starts from random weights, and one start says little. The strip network is run "
    "from several."
)
_LEARNING = {
    "published": "The forces of the published experiment, all errors in them, grow a "
    "thousandfold in the first half second and then repeat with the gait.",
    "corrected": "The forces of the corrected flight: a few tenths of a newton, the robot slowly "
    "losing speed, so that the range of incidences drifts.",
}

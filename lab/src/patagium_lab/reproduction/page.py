"""Page of the reproduction: prose, tables and pictures, every figure from the metrics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from patagium.report import Block, KeyNumber, Link, Note, PageSection, cell_text
from patagium_lab.comparisons import seconds_text
from patagium_lab.gallery import Gallery
from patagium_lab.reproduction.claims import best_strip, claim_paragraphs, scores_of_trial
from patagium_lab.reproduction.errors import COLUMNS, GENTLE_GAIT, cited_errors
from patagium_lab.reproduction.flights import PUBLISHED_GAIT
from patagium_lab.reproduction.plan import ReproductionPlan
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
from patagium_lab.reproduction.unsteady_page import unsteady_section
from patagium_lab.study import Metrics, Page, Results, table_of
from patagium_lab.targets import count_met

FULL = ReproductionPlan().duration
"""Duration of the flights that the targets are meant for [s]."""
RESULTS = (
    "Targets",
    "The claims of the paper",
    "Overhead of dynamics and of aerodynamics",
    "Learning the corrected flight",
    "Gaits never seen",
    "Air with memory",
    "How it was run",
)
"""Titles of the sections of the page of results."""
TITLE = "Morphing-wing flight and learned air: the paper, as published and corrected"


def page(results: Results) -> Page:
    """Whole page of the reproduction.

    Args:
        results: Results of `run`.
    """
    metrics, gallery = results.metrics, results.gallery
    made = f"`patagium study reproduce`, flights of {metrics['plan']['duration']:g} s"
    sections = [
        _experiments(metrics, gallery),
        _claims(metrics),
        PageSection("Targets", _targets(metrics)),
        _errors(metrics),
        _overhead(metrics, gallery),
        _learning(metrics, gallery, "published"),
        _learning(metrics, gallery, "corrected"),
        _unseen(metrics, gallery),
        PageSection("What limits the dense network", [_LIMITS, limit_table(metrics)]),
        PageSection("The luck of the start", [_STARTS, starts_table(metrics)]),
        unsteady_section(metrics, gallery),
        *results.sections,
        PageSection("How it was run", [*_method(metrics), stage_table(metrics)]),
    ]
    facts = {"made by": made, **metrics["environment"]}
    return Page(TITLE, _summary(metrics), facts, sections, _opening(metrics, gallery))


def early_page(plan: ReproductionPlan, scores: Metrics, gallery: Gallery) -> Page:
    """First page: what is shown while the study still runs.

    Args:
        plan: What is run.
        scores: Scores of the strip network on the corrected flight.
        gallery: Figures drawn so far.
    """
    metrics = {"replays": {}, "learning": [scores], "start_spans": []}
    made = f"`patagium study reproduce`, flights of {plan.duration:g} s"
    text = "**The study still runs:** the whole report takes the place of this page; load it again."
    return Page(TITLE, text, {"made by": made}, [], _opening(metrics, gallery))


def _summary(metrics: Metrics) -> str:
    met = sum(row["met"] is True for row in metrics["targets"])
    return (
        "The paper learns the force of the air on a flapping robot while it flies. **A network "
        "that knows how air pushes on strips learns it from one sample in 100 and predicts gaits "
        "it never saw;** networks without such knowledge, the paper's among them, follow the "
        f"gait they are shown and no other. {met} of {len(metrics['targets'])} targets are met."
    )


def _opening(metrics: Metrics, gallery: Gallery) -> list[Block]:
    """First screen: a picture, a plot, and three numbers compared with the paper's."""
    address = metrics["replays"].get("corrected", "")
    shown = [replace(one, address=address) for one in gallery.pictures("corrected_still")]
    found = scores_of_trial(metrics, "corrected", best_strip("corrected"))
    spans = {(row["flight"], row["network"], row["every"]): row for row in metrics["start_spans"]}
    unseen = spans.get(("corrected", best_strip("corrected"), 100), {}).get("unseen_median")
    return [
        *shown,
        *gallery.pictures("corrected_lift"),
        KeyNumber(
            _percent(found.get("nmse_second_half_mean")),
            "Mean square error of the predicted forces over their variance, one sample in 100 "
            "learned.",
            "The paper: 0.04 %, and does not say of what.",
        ),
        KeyNumber(
            _percent(unseen),
            "The same error of the worst force on gaits that were never learned, weights frozen.",
            "The paper: shows the gait that it learns, while it learns it.",
        ),
        KeyNumber(
            seconds_text(found.get("time_per_update") or float("nan")),
            "Time of an update of the filter on one core; one sample in 100 leaves 10 ms.",
            "The paper: in real time, and gives no time.",
        ),
    ]


def _percent(share: float | None) -> str:
    return "not run" if share is None else f"{cell_text(100 * share)} %"


def _claims(metrics: Metrics) -> PageSection:
    text = claim_paragraphs(metrics)
    return PageSection("The claims of the paper", [_CLAIMS, *text, cited_errors(text)])


def _targets(metrics: Metrics) -> list[Block]:
    duration = metrics["plan"]["duration"]
    blocks: list[Block] = [
        "The targets were set before the runs; a target that is missed is marked."
    ]
    if duration < FULL:
        text = f"Short flights of {duration:g} s were asked for; targets are those of {FULL:g} s."
        blocks.append(Note(text))
    return [*blocks, count_met(metrics["targets"]), targets_table(metrics)]


def _experiments(metrics: Metrics, gallery: Gallery) -> PageSection:
    flights = {name: metrics["flights"][name] for name in ("published", "corrected")}
    return PageSection(
        "Two experiments",
        [
            f"**As published**: {_gait(PUBLISHED_GAIT)}, the air with all its errors, joints "
            "overwritten at every step. **Corrected**: inertia, air and stepping are corrected "
            "(errors E1 to E9 below), the wing is driven by the robot's crank linkage and by "
            "feathering, and the robot flies freely.",
            "As published the robot reaches "
            f"{cell_text(flights['published']['speed_largest'])} m/s; corrected it flies within "
            "its means.",
            *(
                Link(f"The {name.replace('_', ' ')} flight in three dimensions", address)
                for name, address in metrics["replays"].items()
            ),
            *gallery.pictures("published_flight", "corrected_flight"),
            flight_table(flights),
        ],
    )


def _errors(metrics: Metrics) -> PageSection:
    put_in = f"Each error alone put into the corrected model; {_gait(GENTLE_GAIT)}."
    taken_away = f"Each error alone taken away from the published model; {_gait(PUBLISHED_GAIT)}."
    return PageSection(
        "What each error of the published experiment does",
        [
            cited_errors([row["variant"] for row in metrics["errors"]["put_in"]]),
            table_of(COLUMNS, metrics["errors"]["put_in"], put_in),
            table_of(COLUMNS, metrics["errors"]["taken_away"], taken_away),
            Note(
                "A run that nears the speed of sound is stopped; the last column gives the time "
                "it flew. The residuals compare changes of energy and momentum with the works and "
                "impulses of all forces."
            ),
        ],
    )


def _overhead(metrics: Metrics, gallery: Gallery) -> PageSection:
    return PageSection(
        "Overhead of dynamics and of aerodynamics",
        [
            "All times are of the same robot of 14 coordinates, in one run. The published figure "
            "compares first calls of an interpreted symbolic model with compiled code of a "
            "differentiated model.",
            *gallery.pictures("overhead_dynamics", "overhead_aerodynamics"),
            dynamics_table(metrics),
            aerodynamics_table(metrics),
        ],
    )


def _learning(metrics: Metrics, gallery: Gallery, flight: str) -> PageSection:
    names = ("forces_body", "forces_left_wing", "forces_attitude", "innovation", "learning")
    return PageSection(
        f"Learning the {flight} flight",
        [
            _LEARNING[flight],
            *gallery.pictures(*(f"{flight}_{name}" for name in names)),
            learner_table(metrics, flight),
        ],
    )


def _unseen(metrics: Metrics, gallery: Gallery) -> PageSection:
    beyond = [gait for gaits in metrics["flights"]["unseen_beyond"].values() for gait in gaits]
    return PageSection(
        "Gaits never seen",
        [
            "After the flight the weights are frozen and predict the forces of other flights, "
            "each simulated on its own, from the true states. Here physics inside the network "
            "decides.",
            *gallery.pictures("corrected_unseen", "published_unseen"),
            unseen_table(metrics, "corrected"),
            unseen_table(metrics, "published"),
            Note(
                "Gaits whose incidences leave the range that was learned need extrapolation "
                f"and have no target: {', '.join(beyond) or 'none here'}."
            ),
        ],
    )


def _method(metrics: Metrics) -> list[Block]:
    choices = metrics["choices"]
    return [
        "Forces come from the flight by inverse dynamics, as in the paper. Each sample is "
        "predicted by the weights known before it is used; with one sample in 100 used, all 100 "
        "of the interval count. Errors are divided by the variance of each force over the same "
        "span; forces that never move are left out.",
        f"Cubature points lie at {cell_text(choices['spread'])} standard deviations (the paper's "
        "rule: the square root of the number of weights). **Strip network**: the inputs are the "
        "direction of the local flow, the activation is tanh, the prior standard deviation of "
        f"each weight is {cell_text(choices['weight_std'])}, and the standard deviation of a "
        f"strip's force is {cell_text(choices['strip_std']['published'])} N published and "
        f"{cell_text(choices['strip_std']['corrected'])} N corrected, mapped to the generalized "
        "forces by the strips' lever arms; there is no process noise and no forgetting. With "
        "`pitch rate` the reduced pitch rate of the strip is a third input: the published air "
        "takes its incidence at mid-chord (E9), which two inputs cannot express.",
        "**Dense networks**: the activation is softplus; inputs and outputs are scaled by the "
        "envelope in which the robot is known to move and by the force of a strip; the prior "
        f"standard deviation is {cell_text(choices['dense_prior'])} over the square root of the "
        f"fan-in; the measurement standard deviation is {cell_text(choices['dense_noise'])} of "
        f"the output scale; the memory is {cell_text(choices['memory'])} s, but no less than "
        f"{cell_text(choices['least_memory'])} samples. These numbers were chosen by small "
        "searches on these flights and are the same for all runs of a family.",
        *(Note(text) for text in metrics["left_out"]),
    ]


def _gait(gait: Mapping[str, float]) -> str:
    return (
        f"{cell_text(gait['frequency'])} Hz, plunge ±{cell_text(gait['amplitude'])} rad, "
        f"{cell_text(gait['speed'])} m/s at the start"
    )


_CLAIMS = (
    "Each claim of the paper stands beside what the published scripts do and beside what this "
    "reproduction finds. The errors that are cited are told at the end."
)
_LIMITS = (
    "These runs are of a dense network of the experiment's size, 8-20-14, on the published flight. "
    "The filter takes what the network cannot represent for exact truth: it grows certain of the "
    "wrong weights and stops learning, unless it forgets. Forgetting makes it follow the gait of "
    "the moment, which is tracking, not knowledge, as the gaits never seen show."
)
_STARTS = (
    "A network starts from random weights, and one start says little. The strip networks are run "
    "from as many as the table says."
)
_LEARNING = {
    "published": "The forces of the published experiment, all errors in them, grow a "
    "thousandfold in the first half second and then repeat with the gait.",
    "corrected": "The forces of the corrected flight are a few tenths of a newton. The robot "
    "slowly loses speed, so that the range of incidences drifts.",
}

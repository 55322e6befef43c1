"""Plan of the reproduction: what is run, and what is left out and why.

The whole takes a few minutes on two cores. Without a C compiler, or for a quick look, the longest
runs are left out and the page says so.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from patagium.native.compiler import compiler_command
from patagium_lab.bench.overhead import AIR_MODELS, AIR_NETWORKS, QUICK_RIVALS, RIVALS, USUAL_RIVALS
from patagium_lab.reproduction.cases import AS_RUN, FLIGHT_CASES, STRIPS, DenseSettings
from patagium_lab.reproduction.errors import HEADING, STEPPING, ErrorCase, error_cases
from patagium_lab.reproduction.trials import Trial
from patagium_lab.reproduction.unsteady_models import CANDIDATES

EVERY = (100, 10, 1)
USUAL_CANDIDATES = tuple(key for key in CANDIDATES if key != "grey")
"""Learners in air with memory but the grey box, which alone takes as long as all others."""
QUICK_ERRORS = ("corrected", "E2 drag pushes backwards", STEPPING, HEADING, "published")
"""Errors that a quick run flies."""
LIMITS = {
    "as run": ("dense_velocity", AS_RUN),
    "inputs not scaled (E7)": ("dense_velocity", replace(AS_RUN, scaled=False)),
    "never forgets": ("dense_velocity", replace(AS_RUN, memory=None)),
    "forgets in 1 s": ("dense_velocity", replace(AS_RUN, memory=1.0)),
    "forgets in 0.2 s": ("dense_velocity", replace(AS_RUN, memory=0.2)),
    "spread sqrt(n), the cubature rule": ("dense_velocity", replace(AS_RUN, spread=None)),
    "never forgets, spread sqrt(n)": (
        "dense_velocity",
        replace(AS_RUN, memory=None, spread=None),
    ),
    "measurement std ten times smaller": (
        "dense_velocity",
        replace(AS_RUN, noise=0.1 * AS_RUN.noise),
    ),
    "all 28 inputs": ("dense_published", AS_RUN),
    "all 28 inputs, two hidden layers": ("dense", AS_RUN),
}
"""Networks and settings that show what limits the dense network, one change at a time."""


@dataclass(frozen=True)
class ReproductionPlan:
    """Plan of the reproduction.

    Attributes:
        duration: Duration of each flight [s].
        unseen_duration: Duration of each flight that is not learned [s].
        every: Rates of samples: one in this many is learned.
        starts: Number of starts of the best strip network of each flight.
        other_starts: Number of starts of the other strip networks.
        dense_every: Large networks learn from one sample in this many at most.
        slow_every: What no target asks for learns from one sample in this many at most: least
            squares, strip networks but the best of each flight, and dense networks on the
            corrected flight; in air with memory all but the strips with a lag.
        gradient_every: Gradient steps learn from one sample in this many at most, with replay
            from one in 10.
        rivals: Formulations of the dynamics that are timed, keys of `overhead.RIVALS`.
        air_models: Models of the air that are timed, by name.
        air_networks: Networks beside those of the bench that are timed, by name.
        errors: Names of the errors that are flown; None: all.
        limits: Names of `LIMITS` that are run.
        yeo_cycles: Cycles of the measured wing.
        unsteady_duration: Duration of each flight through air with memory [s].
        unsteady_unseen_duration: Duration of each of those that is not learned [s].
        unsteady_every: Rates of samples in air with memory: one in this many is learned.
        unsteady_starts: Number of starts of the strip networks in air with memory.
        unsteady_candidates: Learners in air with memory, keys of `CANDIDATES`.
        crazyflie: Log of a quadrotor, `log16.csv.gz`, for a section on it.
    """

    duration: float = 2.0
    unseen_duration: float = 1.0
    every: tuple[int, ...] = EVERY
    starts: int = 8
    other_starts: int = 8
    dense_every: int = 1
    slow_every: int = 1
    gradient_every: int = 1
    rivals: tuple[str, ...] = tuple(RIVALS)
    air_models: tuple[str, ...] = AIR_MODELS
    air_networks: tuple[str, ...] = AIR_NETWORKS
    errors: tuple[str, ...] | None = None
    limits: tuple[str, ...] = tuple(LIMITS)
    yeo_cycles: int = 10
    unsteady_duration: float = 2.0
    unsteady_unseen_duration: float = 0.6
    unsteady_every: tuple[int, ...] = (100, 1)
    unsteady_starts: int = 3
    unsteady_candidates: tuple[str, ...] = tuple(CANDIDATES)
    crazyflie: Path | None = None

    @classmethod
    def of(
        cls, quick: bool = False, full: bool = False, crazyflie: Path | None = None
    ) -> ReproductionPlan:
        """The plan for this machine.

        Args:
            quick: Whether flights are short and runs are few.
            full: Whether formulations that compile for long are timed too, all networks start
                from many weights, and what no target asks for is learned from every sample.
            crazyflie: Log of a quadrotor, or None.
        """
        compiled = compiler_command() is not None
        dense_every = 1 if compiled else 100
        if full:
            return cls(dense_every=dense_every, crazyflie=crazyflie)
        if not quick:
            return cls(
                starts=4,
                other_starts=1,
                dense_every=dense_every,
                slow_every=10,
                gradient_every=100,
                rivals=USUAL_RIVALS,
                unsteady_starts=2,
                unsteady_candidates=USUAL_CANDIDATES,
                crazyflie=crazyflie,
            )
        return cls(
            duration=0.2,
            unseen_duration=0.1,
            every=(100,),
            starts=2,
            other_starts=1,
            dense_every=10 if compiled else 100,
            rivals=QUICK_RIVALS,
            air_models=AIR_MODELS[:1],
            air_networks=(),
            errors=QUICK_ERRORS,
            limits=tuple(LIMITS)[:3],
            yeo_cycles=3,
            unsteady_duration=0.2,
            unsteady_unseen_duration=0.1,
            unsteady_every=(100,),
            unsteady_starts=1,
            unsteady_candidates=USUAL_CANDIDATES,
            crazyflie=crazyflie,
        )

    def trials(self) -> list[Trial]:
        """Every run of a learner."""
        table = [trial for flight in FLIGHT_CASES for trial in self._table(flight)]
        starts = [
            Trial(flight, network, "cubature", every, seed, kind="start")
            for flight in FLIGHT_CASES
            for network in STRIPS[flight]
            for every in self.every
            if every > 1
            for seed in range(1, self._starts(flight, network))
        ]
        known = {trial.run for trial in table}
        return table + starts + [trial for trial in self.limit_trials() if trial.run not in known]

    def limit_trials(self) -> list[Trial]:
        """Trials of the table of limits; some are runs of the table of learners as well."""
        return [self._limit(label, *LIMITS[label]) for label in self.limits]

    def error_cases(self) -> list[ErrorCase]:
        """Every flight with errors."""
        cases = error_cases()
        return [case for case in cases if self.errors is None or case.name in self.errors]

    @property
    def left_out(self) -> list[str]:
        """Sentences about what is not run, and why."""
        words = [
            "The extended filter, a rival, learns from one sample in 10 at most, with the large "
            "network from one in 100. Gradient steps with replay learn from one sample in "
            f"{max(10, self.gradient_every)} at most, the cubature filter with the dense network "
            "of the paper's size from one in 10.",
        ]
        if self.dense_every > 1:
            words.append(
                f"Large networks learn from one sample in {self.dense_every} at most, because a "
                "short run was asked for or there is no C compiler."
            )
        missing = {
            "Only some of the errors are put in": self.errors is not None,
            "The published experiment's own C and the model without shared subexpressions, which "
            "compile for half a minute each, are not timed (`--full` times them)": (
                "published" not in self.rivals
            ),
            "Single gradient steps and, in air with memory, strip networks without it learn from "
            "one sample in 100 at most, least squares, strip networks but the best of each flight, "
            f"and dense networks on the corrected flight from one in {self.slow_every} (`--full`: "
            "from every sample)": self.slow_every > 1,
            "Strip networks but the best of each flight start once, and the grey box does not "
            "learn the air with memory (`--full`: several starts, and it does)": (
                self.other_starts == 1
            ),
            "Only some models of the air are timed": self.air_models != AIR_MODELS,
        }
        reason = ", because a short run was asked for." if self.errors is not None else "."
        return words + [text + reason for text, left_out in missing.items() if left_out]

    def describe(self) -> dict[str, Any]:
        """The plan as JSON-able values."""
        left_out = ("crazyflie", "errors", "limits", "rivals", "air_models", "air_networks")
        plan = {key: value for key, value in asdict(self).items() if key not in left_out}
        return {**plan, "published_overhead": "published" in self.rivals}

    def _starts(self, flight: str, network: str) -> int:
        """Number of starts of a strip network."""
        return self.starts if network == STRIPS[flight][0] else self.other_starts

    def _limit(self, label: str, network: str, settings: DenseSettings) -> Trial:
        every = max(10, self.dense_every)
        return Trial(
            "published", network, "cubature", every, settings=settings, label=label, kind="limit"
        )

    def _table(self, flight: str) -> list[Trial]:
        kept = (STRIPS[flight][0], "dense")
        return [
            Trial(
                flight,
                network,
                learner,
                every,
                keep=every == 100 and learner == "cubature" and network in kept,
            )
            for network, learner, fastest in self._methods(flight)
            for every in self.every
            if every >= fastest
        ]

    def _methods(self, flight: str) -> list[tuple[str, str, int]]:
        """Network, learner, and the highest rate of samples: one in this many."""
        slow, best = self.dense_every, STRIPS[flight][0]
        dense = slow if flight == "published" else max(slow, self.slow_every)
        return [
            (best, "cubature", 1),
            *((network, "cubature", self.slow_every) for network in STRIPS[flight][1:]),
            *((network, "cubature", dense) for network in ("dense", "dense_velocity")),
            ("dense_published", "cubature", max(10, slow)),
            (best, "extended", 10),
            ("dense_published", "extended", 100),
            *((network, "gradient", self.gradient_every) for network in (best, "dense_published")),
            *(
                (network, "replay", max(10, self.gradient_every))
                for network in (best, "dense_published")
            ),
            ("", "linear", self.slow_every),
            ("", "features", self.slow_every),
        ]

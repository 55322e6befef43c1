"""What the reproduction runs, and what it leaves out and why.

A run of the whole takes a few minutes on two cores; without a C compiler, or when a quick
look is asked for, the longest runs are left out and the report says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from patagium.native.compiler import compiler_path
from patagium_lab.reproduction.errors import HEADING, STEPPING, Case, error_cases
from patagium_lab.reproduction.learning import Trial
from patagium_lab.reproduction.subjects import AS_RUN, STRIPS, SUBJECTS, Setting

EVERY = (100, 10, 1)
QUICK_ERRORS = ("corrected", "E2 drag pushes backwards", STEPPING, HEADING, "published")
"""Variants of the errors in a short run."""
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
    "measurement deviation ten times smaller": (
        "dense_velocity",
        replace(AS_RUN, noise=0.1 * AS_RUN.noise),
    ),
    "all 28 inputs": ("dense_published", AS_RUN),
    "all 28 inputs, two hidden layers": ("dense", AS_RUN),
}
"""What is changed, one thing at a time, to find what limits the dense network."""


@dataclass(frozen=True)
class Plan:
    """How much is run.

    Attributes:
        duration: Of each flight [s].
        unseen_duration: Of each flight that is not learned [s].
        every: Rates of samples, one in so many.
        starts: How many starts of the strip network.
        dense_every: Large networks learn from one sample in so many at most.
        published_overhead: Whether the published C, which compiles for a minute, is timed.
        short_overhead: Whether only two models of the air are timed.
        errors: Variants of the errors that are flown, by name; None for all.
        yeo_cycles: Cycles of the measured wing.
        unsteady_duration: Of each flight through air with memory [s].
        unsteady_unseen_duration: Of each of those that is not learned [s].
        unsteady_every: Rates of samples there, one in so many.
        unsteady_starts: How many starts of the networks of strips there.
    """

    duration: float = 2.0
    unseen_duration: float = 1.0
    every: tuple[int, ...] = EVERY
    starts: int = 8
    dense_every: int = 1
    published_overhead: bool = True
    short_overhead: bool = False
    yeo_cycles: int = 10
    errors: tuple[str, ...] | None = None
    unsteady_duration: float = 2.0
    unsteady_unseen_duration: float = 0.6
    unsteady_every: tuple[int, ...] = (100, 1)
    unsteady_starts: int = 3

    @classmethod
    def of(cls, quick: bool) -> Plan:
        """The plan for this machine.

        Args:
            quick: Short flights and fewer runs.
        """
        compiled = compiler_path() is not None
        if quick:
            return cls(
                duration=0.2,
                unseen_duration=0.1,
                every=(100, 10),
                starts=2,
                dense_every=10 if compiled else 100,
                published_overhead=False,
                short_overhead=True,
                yeo_cycles=3,
                errors=QUICK_ERRORS,
                unsteady_duration=0.2,
                unsteady_unseen_duration=0.1,
                unsteady_every=(100,),
                unsteady_starts=1,
            )
        return cls(dense_every=1 if compiled else 100)

    def trials(self) -> list[Trial]:
        """Every run of a learner."""
        table = [trial for flight in SUBJECTS for trial in self._table(flight)]
        starts = [
            Trial(flight, network, "cubature", every, seed, kind="start")
            for flight in SUBJECTS
            for network in STRIPS[flight]
            for every in (100, 10)
            for seed in range(1, self.starts)
        ]
        limits = [
            Trial(
                "published",
                network,
                "cubature",
                max(10, self.dense_every),
                setting=setting,
                label=label,
                kind="limit",
            )
            for label, (network, setting) in self._limits().items()
        ]
        return table + starts + limits

    def error_cases(self) -> list[Case]:
        """Every variant of the errors to fly."""
        cases = error_cases()
        return [case for case in cases if self.errors is None or case.name in self.errors]

    @property
    def left_out(self) -> list[str]:
        """What was not run, and why, in sentences."""
        words = [
            "The extended filter, a rival, learns from one sample in 10 at most, with the large "
            "network from one in 100. Gradient steps with replay learn from one sample in 10 at "
            "most, and so does the cubature filter with the dense network of the paper's size.",
        ]
        if self.dense_every > 1:
            words.append(
                f"Large networks learn from one sample in {self.dense_every} at most: a short run "
                "was asked for, or there is no C compiler."
            )
        if self.errors is not None:
            words.append("Of the errors only some are put in: a short run was asked for.")
        if not self.published_overhead:
            words.append("The published experiment's own C is not timed: it compiles for a minute.")
        if self.short_overhead:
            words.append("Of the models of the air two are timed: a short run was asked for.")
        return words

    def describe(self) -> dict[str, Any]:
        """The plan as JSON-able values."""
        return {
            "duration": self.duration,
            "unseen_duration": self.unseen_duration,
            "every": list(self.every),
            "starts": self.starts,
            "dense_every": self.dense_every,
            "published_overhead": self.published_overhead,
            "unsteady_duration": self.unsteady_duration,
            "unsteady_unseen_duration": self.unsteady_unseen_duration,
            "unsteady_every": list(self.unsteady_every),
            "unsteady_starts": self.unsteady_starts,
        }

    def _limits(self) -> dict[str, tuple[str, Setting]]:
        return LIMITS if self.errors is None else dict(list(LIMITS.items())[:3])

    def _table(self, flight: str) -> list[Trial]:
        return [
            Trial(
                flight,
                network,
                learner,
                every,
                keep=every == 100
                and learner == "cubature"
                and network in (STRIPS[flight][0], "dense"),
            )
            for network, learner, rates in self._methods(flight)
            for every in self.every
            if every >= rates
        ]

    def _methods(self, flight: str) -> list[tuple[str, str, int]]:
        """Network, learner, and the most samples it learns from: one in so many."""
        slow = self.dense_every
        return [
            *((network, "cubature", 1) for network in STRIPS[flight]),
            *((network, "cubature", slow) for network in ("dense", "dense_velocity")),
            ("dense_published", "cubature", max(10, slow)),
            (STRIPS[flight][0], "extended", 10),
            ("dense_published", "extended", 100),
            *((network, "gradient", 1) for network in (STRIPS[flight][0], "dense_published")),
            *((network, "replay", 10) for network in (STRIPS[flight][0], "dense_published")),
            ("", "linear", 1),
            ("", "features", 1),
        ]

"""Learner whose weights a filter moves: settings, predictions, updates, state and file.

Two threads must not use one learner at the same time.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from inspect import cleandoc
from pathlib import Path
from time import perf_counter_ns
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from patagium.arguments import checked, of_kind
from patagium.arrays import Array, real_array
from patagium.errors import Outcome, ParameterError, ShapeError
from patagium.learning.filters.block_kernel import structure_and_kernel
from patagium.learning.filters.blocks import blocks_in
from patagium.learning.filters.kernel_memory import Compiled
from patagium.learning.filters.numbers import PRIOR, compact_settings, filter_numbers
from patagium.learning.filters.root import MatrixLost, lower_factor
from patagium.learning.filters.screening import NEWER, REFUSALS, Screen, lent
from patagium.learning.filters.state import arrays_like, packed, part, vector
from patagium.learning.filters.weight_covariance import BlockCovariance
from patagium.learning.filters.weight_filter import WeightFilter
from patagium.learning.learners.learner import (
    Learner,
    Stopwatch,
    as_input,
    diverged,
    found_part,
    row_by_row,
    shaped_sample,
)
from patagium.learning.learners.state_file import write_state
from patagium.learning.models.memory import memory_of, network_inputs
from patagium.learning.models.network import Network, center_of
from patagium.learning.models.physical import own_prior
from patagium.learning.settings import (
    FilterSettings,
    arguments_text,
    chosen_settings,
    learner_signature,
)

_LOOKS, _REST = 300, 1e-2  # samples looked back at; of the mean variance of the weights: rest
REFUSED_RUN = 10
"""Samples in a row that do not move a screened filter, after which its covariance begins anew."""


class FilterLearner(Learner):
    """Estimate of weights with a covariance, moved by one sample at a time.

    A subclass names the kind of the learner. Its constructor takes a record of settings and,
    by name, single settings that override it; signature and docstring list them.

    Args:
        network: Network whose weights are learned.
        settings: Record of settings; None: the defaults.
        seed: Seed of the weights to start from.
        **given: Settings by name, which override the record.

    Attributes:
        kind: Kind of the learner, as `FilterSettings` names it.
        settings: Settings of this learner.
        memory: Memory of the network between samples that come one by one; None without.

    Raises:
        ParameterError: If a setting is unknown or out of its range.
        ShapeError: If a standard deviation has another shape.
    """

    kind: ClassVar[str]

    def __init_subclass__(cls, kind: str) -> None:
        cls.kind = kind
        setattr(cls, "__signature__", learner_signature(kind))  # noqa: B010
        cls.__doc__ = cleandoc(cls.__doc__ or "").replace("    {settings}", arguments_text(kind))

    def __init__(
        self,
        network: Network,
        settings: FilterSettings | None = None,
        *,
        seed: int = 0,
        **given: Any,
    ) -> None:
        of_kind("network", network, Network)
        of_kind("seed", seed, int)
        chosen = chosen_settings(self.kind, settings, given)
        numbers = filter_numbers(network, chosen, self.kind)
        self._network, self._stopwatch = network, Stopwatch()
        self.memory = memory_of(network)
        self.settings = compact_settings(numbers)
        self._seed, self._numbers = seed, numbers
        self._filter = WeightFilter(numbers, structure_and_kernel(numbers), network.initial(seed))
        self._changes: list[int] = []
        self._refused_run = 0
        self._innovation_covariance = np.full((network.outputs, network.outputs), np.nan)
        self._seen = -1, np.zeros(0)  # samples learned when `look_back` saw these variances

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.count} samples learned by {self._network!r}>"

    def _repr_html_(self) -> str:
        from patagium.report.page import snippet

        facts = {"samples learned": self.count, "time of an update [s]": self.time_per_update}
        facts |= {name: count for name, count in self.events.items() if count}
        return snippet(type(self).__name__, facts) + self._network._repr_html_()

    def expect(self, x: Array, y: Array) -> None:
        """Take the ranges of a recorded log, by which faults of sensors are judged.

        Args:
            x: Inputs, (N, n_x) [units of x].
            y: Measurements, (N, n_y) [unit of y].
        """
        self._screen.bounds.expect(x, y)

    def look_back(self, time: Array, x: Array, gaps: ArrayLike = ()) -> None:
        """Look at a log that was learned, where a filter that forgets knows best what came last.

        Until the next sample, the usual variance of the weights is the geometric mean over samples
        drawn from the whole log, rests aside.

        Args:
            time: Increasing, (N,) [s].
            x: Measured inputs of the network, (N, n_measured) [units of x].
            gaps: First sample after each gap in time.
        """
        numbers, network, weights = self._numbers, self._network, self.weights
        forgets = numbers.has_process_noise or numbers.forgetting_factor < 1
        if not (forgets and self._screen.misfit.floor):
            return
        rows = network_inputs(network, weights, time, x, gaps)
        rows = rows[np.random.default_rng(0).integers(len(rows), size=_LOOKS)]
        kept, looks = self.kept_covariance(), map(network.encode_one, rows)
        slopes = (network.linearized(look, weights)[1] for look in looks)
        seen = np.array([kept.seen_by(slope).diagonal() for slope in slopes])
        flown = np.ma.masked_less_equal(seen, _REST * seen.mean(axis=0))
        self._seen = self.count, np.exp(np.ma.log(flown).mean(axis=0)).filled(0.0)

    @property
    def _screen(self) -> Screen:
        """Screening of the filter, which a copy of the filter makes anew."""
        return self._filter.screen

    @property
    def network(self) -> Network:
        """Network whose weights are learned."""
        return self._network

    @property
    def events(self) -> dict[str, int]:
        """Events of the samples so far, and their number.

        Channels of samples: missing (no number), outliers (down-weighted, or too far off to be
        used), stuck (inputs, while others move). Samples: bad_inputs (no numbers), late,
        duplicates, clock_resets (a clock that went back was believed), blind (no channel left),
        refused (the filter could not be moved by it), changes (the covariance was opened anew),
        covariance_resets (ten samples in a row were refused, and it begins anew). Values of
        sensors: out_of_range (no sensor says that), jumps (an input moved too far in one step),
        reopened (a range was widened to what a sensor kept saying).
        """
        return self._screen.events

    @property
    def count(self) -> int:
        """Number of samples learned."""
        return self._stopwatch.count

    @property
    def time_per_update(self) -> float:
        """Median wall-clock time of an update [s]; NaN before the first."""
        return self._stopwatch.median

    @property
    def weights(self) -> Array:
        """The estimate W, (n,)."""
        return self._filter.mean.copy()

    @property
    def covariance(self) -> Array:
        """Covariance P of the weights after the last sample, (n, n); symmetric."""
        return self._filter.covariance().dense(most=self._network.size)

    @property
    def variances(self) -> Array:
        """Variances of the weights, the diagonal of P, (n,)."""
        return self._filter.variances()

    @property
    def found(self) -> dict[str, Any]:
        """Settings that nobody gave, by name: what the rules or the samples so far say."""
        found: dict[str, Any] = {}
        if self.settings.prior_std is None and np.isnan(own_prior(self._network)).any():
            found["prior_std"] = PRIOR
        std = self.measurement_std
        if self.settings.measurement_std is None and np.isfinite(std).any():
            found["measurement_std"] = [one if np.isfinite(one) else None for one in std.tolist()]
        return found

    @property
    def prior(self) -> tuple[Array, Array]:
        """Weights it began with, and their variances, (n,) each."""
        return self._network.initial(self._seed), self._numbers.prior_variance.copy()

    @property
    def nis(self) -> float:
        """Normalized innovation squared e' P_yy^-1 e of the last sample; NaN before the first."""
        return self._filter.nis

    @property
    def changes(self) -> tuple[int, ...]:
        """Samples (counted from 1) at which a change was detected and the covariance opened."""
        return tuple(self._changes)

    @property
    def measurement_std(self) -> Array:
        """Standard deviation of the measurement, as given or estimated so far, (n_y,) [y].

        NaN before an output's first sample where nobody gave it.
        """
        return np.sqrt(self._screen.variances)

    @property
    def usual_std(self) -> Array | None:
        """Standard deviation that the weights gave to the flow of late, (n_y,) [y].

        None without `misfit`; there, an interval grows where the weights give more. Of all flow of
        a log after `look_back`, until the next sample.
        """
        return np.sqrt(self._usual) if self._screen.misfit.floor else None

    @property
    def _usual(self) -> Array:
        """Square of `usual_std`, (n_y,) [y^2]."""
        count, seen = self._seen
        return seen if count == self.count else self._screen.misfit.parts["usual"]

    @property
    def innovation_covariance(self) -> Array:
        """P_yy of the last sample learned, before it was used or doubted, (n_y, n_y)."""
        return self._innovation_covariance

    def predict(
        self, x: ArrayLike, std: ArrayLike | None = None, time: float | None = None
    ) -> tuple[Array, Array]:
        """Measurement at x before it is made.

        Args:
            x: Input, (n_x,) [units of x]; several, (N, n_x), give (N, n_y) and (N, n_y, n_y).
            time: Of the measurement [s], in the flow that is being learned: with `misfit`, what
                of the last error is expected then is part of the mean. None: what the weights
                alone give, in any flow.
            std: Standard deviation of this measurement on top of `measurement_std`, (n_y,) [unit
                of y]; see `update`.

        Returns:
            Mean, (n_y,), and covariance with the noise of the measurement, (n_y, n_y).

        Raises:
            ShapeError: If x has another shape.
            FilterDiverged: If it is not finite, or the covariance was lost.
        """
        if (rows := real_array("x", x)).ndim == 2:
            return row_by_row(lambda x: self.predict(x, std, time), rows, self._network.outputs)
        sample = as_input(self._network, rows)
        misfit = self._screen.misfit
        if not np.isfinite(sample).all():
            raise diverged(Outcome.NOT_FINITE, self.count, sample)
        usual = misfit.parts["usual"]
        try:
            with self._noisier(std), lent(usual, self._usual if time is None else usual):
                mean, covariance = self._filter.predict(sample)
                if time is not None and misfit.floor:
                    of_kind("time", time, float)
                    mean, covariance = misfit.carry(mean, covariance, time)
        except MatrixLost as lost:
            raise diverged(lost.outcome, self.count, sample) from None
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
            raise diverged(Outcome.NOT_FINITE, self.count, sample)
        return mean, covariance

    def carried(self, times: Array) -> Array:
        """Part of the last sample's error that is expected on top of the weights' prediction.

        Zero without `misfit`.

        Args:
            times: Times after the last sample, (N,) [s].

        Returns:
            (N, n_y) [unit of y].
        """
        times = np.ravel(real_array("times", times))
        misfit = self._screen.misfit
        return misfit.at(times) if misfit.floor else np.zeros((len(times), self._network.outputs))

    def update(
        self,
        x: ArrayLike,
        y: ArrayLike,
        time: float | None = None,
        std: ArrayLike | None = None,
    ) -> Array:
        """Learn one sample, or what of it can be used.

        Channels of y that are no numbers are left out. A sample that is late, has been there
        before, or whose input is no number changes nothing; see `events`.

        Args:
            x: Input, (n_x,) [units of x].
            y: Measurement, (n_y,) [unit of y].
            time: Of the sample [s]; None: not known, and it comes after the one before.
            std: Of this measurement on top of `measurement_std` (as given or as
                estimated), whose square it adds to, (n_y,) in the unit of y; None for none, NaN
                where y is missing.

        Returns:
            Innovation y - mean, (n_y,); NaN where nothing was learned.

        Raises:
            ShapeError: If an argument has another shape.
            ParameterError: If a deviation is negative.
            FilterDiverged: If the new weights would not be finite (with `screening` that is
                counted, and nothing changes) or the covariance is lost; the learner is then
                as it was before.
        """
        started = perf_counter_ns()
        sample, measured = shaped_sample(self._network, x, y)
        self._screen.stamp(time)
        with self._noisier(std):
            outcome, (mean, covariance) = self._filter.update(sample, measured)
        if outcome is not Outcome.COMPLETED:
            self._refuse(outcome, sample, measured)
            return np.full(len(measured), np.nan)
        self._refused_run = 0
        self._innovation_covariance = covariance
        self._act_on_alarm(self.count + 1)
        self._stopwatch.add(perf_counter_ns() - started)
        return np.where(self._screen.left_out, np.nan, measured - mean)

    def _noisier(self, std: ArrayLike | None) -> AbstractContextManager[None]:
        """More noise of the measurement for one sample; where the filter's C code looks for it."""
        if std is None:
            return nullcontext()
        added = real_array("std", std, self._screen.stated.shape)
        if (added < 0).any() or np.isinf(added).any():
            raise ParameterError("std", "zero or more", added.tolist())
        return self._screen.noisier(np.nan_to_num(added) ** 2)

    @property
    def compiled(self) -> Compiled | None:
        """Filter as C code calls it; None where a sample needs Python as well."""
        return self._filter.compiled

    def account_for(self, outcomes: ArrayLike, nanoseconds: ArrayLike) -> None:
        """Account for samples that C code learned through `compiled`, as `update` would.

        C code stops where an alarm is raised, for here the covariance is opened.

        Args:
            outcomes: Outcome of each sample, (N,) [1].
            nanoseconds: Time that each sample took, (N,) [ns].

        Raises:
            ShapeError: If there are not as many times as outcomes.
            FilterDiverged: If the covariance cannot be opened.
        """
        ends, took = real_array("outcomes", outcomes), real_array("nanoseconds", nanoseconds)
        if ends.ndim != 1 or took.shape != ends.shape:
            raise ShapeError("nanoseconds", (ends.size,), took.shape)
        screen, compiled, learned = self._screen, self.compiled, ends == Outcome.COMPLETED
        for duration in took[learned].astype(np.int64).tolist():
            self._stopwatch.add(duration)
        for done in learned[ends < Outcome.BAD_INPUT].tolist():
            self._refused_run = 0 if done else self._refused_run + 1
            if not (done or screen.believes):
                screen.note("refused")
        self._reset_if_lost()
        if compiled is not None and learned[-1:].any():
            self._innovation_covariance = compiled.covariance.copy()
        self._act_on_alarm(self.count)

    def _act_on_alarm(self, sample: int) -> None:
        monitor = self._screen.monitor
        if monitor.detection is not None and monitor.settle():
            self._changes.append(sample)
            self.reopen(monitor.detection.reopening)

    def _refuse(self, outcome: Outcome, x: Array, y: Array) -> None:
        if outcome in REFUSALS:
            return
        # a root is definite: what was not is P_yy, at an input beyond all reason
        lost = outcome is Outcome.COVARIANCE_LOST and self.settings.square_root == "cholesky"
        if self._screen.believes or lost:
            raise diverged(outcome, self.count, x, y)
        self._screen.note("refused")
        self._refused_run += 1
        self._reset_if_lost()

    def _reset_if_lost(self) -> None:
        """Begin the covariance anew where no sample moves the filter; the weights stay."""
        if self._refused_run < REFUSED_RUN or self._screen.believes:
            return
        self._filter.reset()
        self._refused_run = 0
        self._screen.note("covariance_resets")

    def reopen(self, share: float) -> None:
        """Doubt what was learned: P <- (1 - share) P + share P0, the weights as they are.

        Args:
            share: Of the covariance before any sample, 0 < share <= 1.

        Raises:
            ParameterError: If it is out of its range.
            FilterDiverged: If the covariance was lost.
        """
        of_kind("share", share, float)
        if not 0 < share <= 1:
            raise ParameterError("share", "above 0 and at most 1", share)
        try:
            self._filter.drift(1.0 - share, share * self._numbers.prior_variance)
        except MatrixLost as lost:
            raise diverged(lost.outcome, self.count) from None

    def describe(self) -> dict[str, Any]:
        """Kind, network and settings of the learner as JSON values, without the weights."""
        network = self._network.describe()
        settings = self.settings.describe(self.kind)
        given = {"kind": self.kind, "network": network, **settings, "seed": self._seed}
        return given | found_part(self.found)

    def kept_covariance(self) -> BlockCovariance:
        """Covariance of the weights as kept after the last sample."""
        return self._filter.covariance()

    def restart_clock(self) -> None:
        """Take the next sample whatever its time stamp: another log begins."""
        self._screen.restart_clock()

    def go_on_with(self, network: Network) -> None:
        """Go on learning the same weights of another network, such as one in other air.

        Args:
            network: Of the same kind and size.
        """
        made = type(self)(network, self.settings, seed=self._seed)
        made.resume(self.state())
        vars(self).update(vars(made))

    def go_on_from(self, weights: Array, covariance: Array) -> None:
        """Go on learning from other weights, such as those of `refine`.

        Args:
            weights: W, (n,) [1].
            covariance: P, (n, n) [1], of which the blocks of the covariance structure are taken.

        Raises:
            ParameterError: If a number is not finite, or P not symmetric and positive definite.
            ShapeError: If they are those of another number of weights.
        """
        n, blocks = self._network.size, blocks_in(self._numbers)
        weights = center_of("weights", real_array("weights", weights, (n,)), n)
        entries = real_array("covariance", covariance, (n, n)).ravel()
        covariance = center_of("covariance", entries, n * n).reshape(n, n)
        try:
            if not np.allclose(covariance, covariance.T, atol=1e-8 * np.abs(covariance).max()):
                raise MatrixLost(Outcome.COVARIANCE_LOST)
            root = packed([lower_factor(covariance[np.ix_(part, part)]) for part in blocks])
        except MatrixLost:
            expected = "a symmetric and positive definite matrix"
            raise ParameterError("covariance", expected, "another") from None
        self._filter.resume({"mean": weights, "nis": np.array(self.nis), "root": root})

    def state(self) -> dict[str, Any]:
        """All that the next samples depend on: arrays and JSON-able values by name."""
        return {
            "count": self.count,
            "changes": list(self._changes),
            "refused_run": self._refused_run,
            "innovation_covariance": self._innovation_covariance.copy(),
            **{f"filter_{name}": array for name, array in self._filter.state().items()},
            **({} if self.memory is None else self.memory.state()),
            **{f"screen_{name}": array.copy() for name, array in self._screen.arrays.items()},
        }

    @checked
    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from a state; wall-clock times of updates begin anew.

        Args:
            state: Of a learner with the same description.

        Raises:
            ParameterError: If something is missing.
            ShapeError: If an array has another shape.
        """
        screen, outputs = self._screen.arrays, self._network.outputs
        newer = {name: screen[name] for name in NEWER} | part(state, "screen_")
        counts = newer.get("counts", screen["counts"])  # events of later releases come last
        newer["counts"] = np.pad(counts, (0, max(len(screen["counts"]) - len(counts), 0)))
        seen = arrays_like(screen, newer)
        stopwatch, changes = Stopwatch(int(state["count"])), list(state["changes"])
        covariance = vector(state, "innovation_covariance", outputs, outputs)
        self._filter.resume(part(state, "filter_"))
        self._innovation_covariance, self._changes = covariance, changes
        self._refused_run = int(state.get("refused_run", 0))  # later than the first files
        if self.memory is not None:
            self.memory.resume(state)
        self._screen.restore(seen)
        self._stopwatch, self._seen = stopwatch, (-1, np.zeros(0))

    @checked
    def save(self, path: str | Path) -> Path:
        """Keep the learner in a file, from which `load_learner` makes one that goes on alike.

        Args:
            path: File, replaced whole or not at all, in a folder that is there.

        Returns:
            The path.

        Raises:
            OutputError: If it cannot be written; the file is then as it was.
        """
        return write_state(path, self.describe(), self.state())

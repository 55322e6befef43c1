"""Forecast of outputs a horizon ahead, from what is known at a time alone.

At time t, after the sample there was learned, the output at t + h is predicted: the measured
inputs are forecast by a `Motion` from samples up to t, and the network gives the output at them,
with the weights of time t. Without a model of the robot every input goes on as it did before:
it is held, or its last wingbeat is repeated from where it is now, whichever erred less at the
samples up to t. What the network misses a wingbeat before t + h (without a wingbeat: at t) is
known; corrected by it, the network gives the change from one wingbeat to the next. Beside the
network stand four rivals, which see the samples up to t as well:

- the last measured output, held,
- the mean of all outputs so far,
- the output one wingbeat (or as many as the horizon needs) before t + h,
- linear least squares of the output a horizon later on the inputs, the output and the output at
  three times before.

The forecast of each output is the mean of all these ways: the network, the network corrected, the
same with inputs that go on as before (where a model of the robot forecasts them otherwise), and
the rivals. A way weighs as the inverse sixth power of its mean absolute error in the forecasts
whose outcome is known by t, the latest counting most: the way that erred least lately decides.
Before an outcome is known, the network alone is taken.

Neglected: commands that are known beforehand; the uncertainty of the forecast inputs.

References:
    Hyndman & Athanasopoulos (2021), Forecasting: principles and practice, ch. 5: naive and
    seasonal naive forecasts; Taieb et al. (2012), A review and comparison of strategies for
    multi-step ahead time series forecasting, Expert Syst. Appl. 39: the direct forecast. Bates &
    Granger (1969), The combination of forecasts, Oper. Res. Q. 20: weights by recent errors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array, Bools, Indices, thin, usual_step
from patagium.learning.learners.learner import Learner
from patagium.learning.models.memory import ModelMemory, measured_inputs, network_inputs
from patagium.learning.models.network import Network
from patagium.learning.scores import ErrorSums, persistence, span_scores
from patagium.learning.wingbeats import duration, wingbeat_period

Horizons = Mapping[str, float] | Sequence[float | str] | float | str | None

MOST_FORECASTS = 100
"""Number of times from which a horizon is forecast at most, spread evenly.

As many forecasts a horizon earlier tell which way errs least.
"""
RIVALS = {
    "held": "held output",
    "average": "mean so far",
    "last_beat": "a wingbeat before",
    "least_squares": "linear least squares",
}
"""Rivals of the network by the last word of the names of their errors."""
METHODS = ("nmse", *RIVALS)
"""Forecast and its rivals, by the last word of the names of their errors."""
WAYS = (
    "network",
    "network, corrected by what it missed last",
    *RIVALS.values(),
    "network, corrected, inputs as before",
)
"""Ways to forecast, the last of them where a model of the robot forecasts the inputs otherwise."""
LAGS = 4
"""Outputs that linear least squares sees: that at t, and those at times before."""
_HALVES = ("", "_second_half")  # ends of the names of errors: of the whole run, and of its end
_RIDGE = 1e-3  # of the mean square of each regressor
_BEYOND = 30.0  # times its root mean square, beyond which the ridge counts a regressor's last value
_GROWTH = 1.25  # of the samples so far, after which a wingbeat that was found is looked for anew,
_PATIENCE = 1.05  # and one that was not: a search sees all samples
_TESTS = 40  # earlier times at which holding and repeating an input are compared
_KEEP = 0.9  # of the errors of each way from one known outcome to the next
_SHARP = 6  # power of the mean error by which a way weighs less
_EXACT = 1e-40  # of the largest error, below which ways are equally exact
_RUN_UP = 2.0  # wingbeats in which the memory of a network settles
_LONGEST = 2e-3  # s, step of a forecast motion, ...
_STEPS = 20  # ... of which a horizon has this many at least, if the log has them, ...
_OF_A_BEAT = 40  # ... and a wingbeat this many


class FrozenModel(NamedTuple):
    """Network with the weights and the memory of a time.

    Attributes:
        network: Network.
        weights: Weights, (n,) [1].
        memory: Memory at the last sample; a fork of it moves on.
    """

    network: Network
    weights: Array
    memory: ModelMemory

    def fork(self) -> FrozenModel:
        """Copy of the model whose memory goes on by itself."""
        memory = ModelMemory(self.network)
        memory.last = self.memory.last
        return self._replace(memory=memory)

    def predict(self, time: Array, x: Array) -> Array:
        """Output at the end of forecast inputs, (n_y,) [unit of y].

        Args:
            time: Times after the last sample, (N,) [s].
            x: Measured inputs at these, (N, n_measured) [units of x].
        """
        rows = self.fork().memory.recall(self.weights, time, x)
        return np.asarray(self.network.evaluate(rows[-1:], self.weights)[0])


class Motion(Protocol):
    """Forecast of the measured inputs of a network from samples up to one.

    Attributes:
        beating: Signals that show the wingbeat, (N, k) [their units].
    """

    beating: Array

    def path(self, last: int, ahead: Array, model: FrozenModel) -> Array:
        """Inputs at times after a sample, (N, n_measured) [units of x].

        Args:
            last: Sample from which on nothing is known.
            ahead: Times after it, increasing, (N,) [s].
            model: Model at the time of the sample.
        """

    def rule(self) -> str:
        """Rule of the last forecast, in words."""


class Repetition:
    """Forecast of signals that go on as before: held, or their last wingbeat repeated.

    A repeated signal goes on from where it is, so that one that drifts drifts on by as much.

    Args:
        time: Increasing, (N,) [s].
        values: Signals, (N, k) [their units].
        period: Wingbeat [s]; None to find it in the samples so far.
        beating: Signals that show the wingbeat, (N, m) [their units]; None: the values.
    """

    def __init__(
        self,
        time: Array,
        values: Array,
        period: float | None = None,
        beating: Array | None = None,
    ) -> None:
        self._time, self._values = time, values
        self.beating = values if beating is None else beating
        self._known, self._found, self._looked = period, period, 0
        self._repeated = np.zeros(values.shape[1], bool)

    def period(self, last: int) -> float | None:
        """Wingbeat as the samples up to one show it [s]; None before there is one."""
        begun = self._time[last] - self._time[0]
        if self._known is not None:
            return self._known if begun >= self._known else None
        if last + 1 >= (_GROWTH if self._found else _PATIENCE) * self._looked:
            self._looked = last + 1
            seen = slice(0, last + 1)
            self._found = wingbeat_period(self._time[seen], self.beating[seen])
        return self._found

    def path(self, last: int, ahead: Array, model: FrozenModel | None = None) -> Array:
        """Signals at times after a sample, (N, k) [their units]; see `Motion`."""
        period, now = self.period(last), self._values[last]
        if period is None:
            self._repeated = np.zeros(len(now), bool)
            return np.tile(now, (len(ahead), 1))
        self._repeated = self._repeats(last, float(ahead[-1]), period)
        return np.where(self._repeated, self.repeated(last, ahead, period), now)

    def repeated(self, last: int, ahead: Array, period: float) -> Array:
        """Signals that repeat their last wingbeats from where they are, (N, k) [their units].

        Args:
            last: Sample from which on nothing is known.
            ahead: Times after it, (N,) [s].
            period: Wingbeat [s].
        """
        now, beats = self._time[last], _whole_beats(ahead, period)
        then = self._at(now + ahead - beats, last) - self._at(now - beats, last)
        return np.asarray(self._values[last] + then)

    def rule(self) -> str:
        """Rule of the last forecast, in words; see `Motion`."""
        count, whole = int(self._repeated.sum()), len(self._repeated)
        if not count:
            return "inputs held"
        rest = "" if count == whole else f"; {whole - count} of {whole} inputs held"
        return f"last wingbeat of the inputs repeated{rest}"

    def beat_before(self, last: int, ahead: float, period: float) -> Array:
        """Signals at a time ahead less as many wingbeats as needed, (k,) [their units]."""
        then = self._time[[last]] + ahead - _whole_beats(ahead, period)
        return np.asarray(self._at(then, last)[0])

    def _at(self, times: Array, last: int) -> Array:
        """Signals between samples up to one, (N, k); beyond these the nearest is taken."""
        after = np.clip(np.searchsorted(self._time[: last + 1], times), 1, last)
        begin, end = self._time[after - 1], self._time[after]
        share = np.clip((times - begin) / (end - begin), 0.0, 1.0)[:, None]
        return (1 - share) * self._values[after - 1] + share * self._values[after]

    def _repeats(self, last: int, ahead: float, period: float) -> Bools:
        """Whether repeating a signal erred less than holding it so far, (k,)."""
        beats = _whole_beats(ahead, period)
        first, end = self._time[0] + beats, self._time[last] - ahead
        if end < first:
            return np.ones(self._values.shape[1], bool)
        tests = np.linspace(first, end, _TESTS)
        now, later, before, then = (
            self._at(times, last)
            for times in (tests, tests + ahead, tests - beats, tests + ahead - beats)
        )
        repeated = now + then - before
        errors = [((guess - later) ** 2).sum(axis=0) for guess in (repeated, now)]
        return np.asarray(errors[0] < errors[1])


def _whole_beats(ahead: Any, period: float) -> Any:
    """Least time of whole wingbeats that is not shorter than a time ahead [s]."""
    return np.ceil(ahead / period - 1e-9) * period


class _LeastSquares:
    """Direct linear forecast of outputs, learned from pairs of samples up to one.

    Args:
        x: Inputs, (N, n_x) [units of x].
        y: Outputs, all finite, (N, n_y) [unit of y].
        lead: Samples between an output and the regressors.
        lag: Samples between two lags.
    """

    def __init__(self, x: Array, y: Array, lead: int, lag: int) -> None:
        self._x, self._y, self._lead, self._lag = x, y, lead, lag
        self._done = (LAGS - 1) * lag  # first sample that has all its lags
        size = 1 + x.shape[1] + LAGS * y.shape[1]
        self._products = np.zeros((size, size))
        self._targets = np.zeros((size, y.shape[1]))

    def at(self, last: int) -> Array | None:
        """Output predicted a lead after a sample, (n_y,) [unit of y]; None before any pair."""
        end = last - self._lead + 1
        if end > self._done:
            rows = np.arange(self._done, end)
            known = self._regressors(rows)
            self._products += known.T @ known
            self._targets += known.T @ self._y[rows + self._lead]
            self._done = end
        if not self._products[0, 0]:
            return None
        now = self._regressors(np.array([last]))[0]
        size = np.sqrt(np.diagonal(self._products))
        size = np.maximum(size, np.abs(now) * np.sqrt(self._products[0, 0]) / _BEYOND)
        size = np.where(size > 0, size, 1.0)
        scaled = self._products / np.outer(size, size) + _RIDGE * np.eye(len(size))
        slopes = np.linalg.solve(scaled, self._targets / size[:, None]) / size[:, None]
        return np.asarray(now @ slopes)

    def _regressors(self, rows: Indices) -> Array:
        lagged = [self._y[rows - k * self._lag] for k in range(LAGS)]
        return np.hstack([np.ones((len(rows), 1)), self._x[rows], *lagged])


class _Mixture:
    """Mean of several ways to forecast, weighted output by output by the last known outcomes.

    Args:
        y: Outputs, (N, n_y) [unit of y]; NaN where not measured.
        ways: Number of ways.
    """

    def __init__(self, y: Array, ways: int) -> None:
        self._y, self._errors = y, np.zeros((ways, y.shape[1]))
        self._waiting: list[tuple[int, Array]] = []

    def weights(self, last: int, target: int, guesses: Array) -> Array:
        """Weight of each way, (ways, n_y) [1].

        Args:
            last: Sample from which on nothing is known.
            target: Sample that is forecast.
            guesses: Forecast by each way, (ways, n_y) [unit of y].
        """
        while self._waiting and self._waiting[0][0] <= last:
            place, before = self._waiting.pop(0)
            self._errors *= _KEEP
            self._errors += np.abs(np.nan_to_num(before - self._y[place]))
        self._waiting.append((target, guesses))
        if not self._errors.any():
            return np.outer(np.arange(len(guesses)) == 0, np.ones(guesses.shape[1]))
        most = self._errors.max(axis=0)
        found = np.maximum(self._errors / np.where(most > 0, most, 1.0), _EXACT) ** -_SHARP
        return np.asarray(found / found.sum(axis=0))


class ForecastSums:
    """Errors of the forecasts of a horizon and of its rivals, over one log or its blocks.

    Args:
        label: Name of the horizon.
        seconds: Its length [s].
        names: Names of the outputs, n_y.
        scale: Scale of each output, in which outputs are compared, (n_y,) or () [unit of y].
    """

    def __init__(
        self, label: str, seconds: float, names: Sequence[str], scale: ArrayLike = 1.0
    ) -> None:
        self.label, self.seconds, self._names = label, seconds, tuple(names)
        self._sums = {
            f"{method}{half}": ErrorSums(len(self._names), scale)
            for method in METHODS
            for half in _HALVES
        }
        self._taken = np.zeros((len(WAYS), len(self._names)), int)
        self.lead, self.count, self.lost, self.rule = 0, 0, 0, ""

    def add(self, y: Array, guesses: Mapping[str, Array], weights: Array, late: bool) -> None:
        """Count one forecast.

        Args:
            y: Output that was measured later, (n_y,) [unit of y].
            guesses: Forecast of each of `METHODS`, (n_y,) [unit of y].
            weights: Weight of the first of `WAYS`, (ways, n_y) [1].
            late: Whether it is in the second half.
        """
        self.count += 1
        if late:
            self._taken[weights.argmax(axis=0), np.arange(len(y))] += 1
        for method, guess in guesses.items():
            for half in _HALVES[: 1 + late]:
                self._sums[f"{method}{half}"].add(y[None], guess[None])

    def scores(self) -> dict[str, Any]:
        """Errors by name: `forecast_<label>_<method>`, whole and second half.

        `forecast_<label>_ways` counts, by output, the forecasts of the second half in which each
        way had the largest weight.
        """
        key = f"forecast_{self.label}"
        found: dict[str, Any] = {
            f"{key}_seconds": self.seconds,
            f"{key}_samples": self.lead,
            f"{key}_count": self.count,
            f"{key}_rule": self.rule,
            f"{key}_lost": self.lost,
        }
        if self.count < 2:
            return found
        for name, sums in self._sums.items():
            found |= span_scores(sums.nmse, self._names, f"{key}_{name}")
        found[f"{key}_ways"] = {
            name: {way: int(n) for way, n in zip(WAYS, counts, strict=True) if n}
            for name, counts in zip(self._names, self._taken.T, strict=True)
        }
        return found

    def state(self) -> dict[str, Array]:
        """All sums as arrays by name."""
        key = f"forecast {self.label}"
        counts = np.array([self.lead, self.count, self.lost])
        sums = {f"{key} {name}": one.sums for name, one in self._sums.items()}
        return {f"{key} counts": counts, f"{key} ways": self._taken, **sums}

    def resume(self, state: Mapping[str, Array]) -> None:
        """Go on from sums as `state` gave them, of the same outputs.

        Raises:
            KeyError: If a sum is missing.
        """
        key = f"forecast {self.label}"
        self.lead, self.count, self.lost = state[f"{key} counts"].tolist()
        self._taken = state[f"{key} ways"].copy()
        for name, one in self._sums.items():
            one.sums = state[f"{key} {name}"].copy()


class Forecaster:
    """Forecasts of one horizon along a block of samples.

    Args:
        sums: What counts the errors.
        learner: Learner at work.
        log: Time (N,) [s], measured inputs x (N, n_measured) and outputs y (N, n_y).
        used: Samples used for an update.
        gaps: First sample after each gap, across which nothing is forecast.
        motion: Forecast of the inputs; None: they are held, or their last wingbeat is repeated.
        period: Wingbeat, where it is known beforehand [s].
        half: First sample of the second half; it may be in another block.
    """

    def __init__(
        self,
        sums: ForecastSums,
        learner: Learner,
        log: tuple[Array, Array, Array],
        used: Indices,
        gaps: Indices,
        motion: Motion | None,
        period: float | None,
        half: int,
    ) -> None:
        self._time, x, y = log
        self._sums, self._learner, self._half = sums, learner, half
        every = np.arange(len(y))
        self._x, self._y = x, y
        self._known = np.where(np.isfinite(y), y, persistence(y, every))
        step = usual_step(self._time)
        sums.lead = max(1, round(min(sums.seconds / step, 1e15)))
        self._lead = min(sums.lead, len(y))  # beyond them nothing is forecast
        self._horizon = self._lead * step
        self._inputs = Repetition(self._time, x, period, None if motion is None else motion.beating)
        self._motion: Motion = self._inputs if motion is None else motion
        self._outputs = Repetition(self._time, self._known, period)
        ways = len(WAYS) - (motion is None)
        self._mixtures = [_Mixture(y, ways) for _ in range(2)]  # before the first wingbeat, later
        self._squares = _LeastSquares(x, self._known, self._lead, max(1, self._lead // LAGS))
        self._mean = np.cumsum(self._known, axis=0) / (every + 1)[:, None]
        self._least = np.minimum.accumulate(self._known)
        self._most = np.maximum.accumulate(self._known)
        last = used[used + self._lead < len(y)]
        crossed = np.searchsorted(gaps, last + self._lead, "right")
        last = last[crossed == np.searchsorted(gaps, last, "right")]
        counted = thin(last, MOST_FORECASTS)
        earlier = np.searchsorted(last, counted - self._lead, "right") - 1
        self._counted = set(counted.tolist())
        self._origins = self._counted | set(last[earlier[earlier >= 0]].tolist())

    def before(self, begin: int, memory: ModelMemory) -> None:
        """Forecast from the sample before an interval, if it is one of those chosen."""
        last = begin - 1
        if last not in self._origins:
            return
        ways = self._ways(last, memory)
        if ways is None:
            return
        target, mixture = last + self._lead, self._mixtures[self._inputs.period(last) is not None]
        span = self._most[last] - self._least[last]  # no forecast is farther out than it is wide
        near = np.clip(ways, self._least[last] - span, self._most[last] + span)
        weights = mixture.weights(last, target, near)
        if last in self._counted:
            mixed = (weights * near).sum(axis=0)
            guesses = dict(zip(METHODS, (mixed, *ways[2 : 2 + len(RIVALS)]), strict=True))
            self._sums.add(self._y[target], guesses, weights, last >= self._half)

    def _ways(self, last: int, memory: ModelMemory) -> Array | None:
        """Forecast by each way; None before linear least squares has anything to learn from."""
        squares = self._squares.at(last)
        if squares is None:
            return None
        model = FrozenModel(self._learner.network, self._learner.weights, memory)
        period, held = self._inputs.period(last), self._known[last]
        ahead = self._grid(period)
        times = self._time[last] + ahead
        x, motion = self._motion.path(last, ahead, model), self._motion
        if not np.isfinite(x).all():
            self._sums.lost += last in self._counted
            x, motion = self._inputs.path(last, ahead, model), self._inputs
        self._sums.rule = motion.rule()
        outputs = self._outputs
        beat = held if period is None else outputs.beat_before(last, self._horizon, period)
        guess, miss = model.predict(times, x), self._miss(last, period, model)
        ways = [guess, guess + miss, held, self._mean[last], beat, squares]
        if self._motion is not self._inputs:
            repeated = self._inputs.path(last, ahead, model)
            ways.append(model.predict(times, repeated) + miss)
        return np.where(np.isfinite(ways), ways, held)

    def _grid(self, period: float | None) -> Array:
        """Times of a forecast motion after its last sample, the last a horizon later, (N,) [s]."""
        longest = min(_LONGEST, np.inf if period is None else period / _OF_A_BEAT)
        count = min(self._lead, max(_STEPS, ceil(self._horizon / longest)))
        return np.asarray(np.arange(1, count + 1) * (self._horizon / count), float)

    def _miss(self, last: int, period: float | None, model: FrozenModel) -> Array:
        """Error of the network a wingbeat before what is forecast, or now, (n_y,) [unit of y]."""
        network, weights, _ = model
        place = begin = last
        if period is not None:
            then = self._time[last] + self._horizon - _whole_beats(self._horizon, period)
            place = int(np.clip(np.searchsorted(self._time[: last + 1], then), 0, last))
            if place and then - self._time[place - 1] < self._time[place] - then:
                place -= 1
            begin = int(np.searchsorted(self._time, self._time[place] - _RUN_UP * period))
        if measured_inputs(network) == network.inputs:
            begin = place
        span = slice(begin, place + 1)
        rows = network_inputs(network, weights, self._time[span], self._x[span])
        return np.asarray(self._known[place] - network.evaluate(rows[-1:], weights)[0])


def named_horizons(horizons: Horizons) -> dict[str, float]:
    """Label and length of each horizon [s].

    Args:
        horizons: Lengths by label; or one or several lengths, such as "100ms" or seconds.

    Raises:
        ParameterError: If one is no time or not positive.
    """
    if horizons is None:
        return {}
    if isinstance(horizons, Mapping):
        return {name: duration(f"horizon {name!r}", one) for name, one in horizons.items()}
    several = [horizons] if isinstance(horizons, str) or not np.iterable(horizons) else horizons
    lengths = [duration("horizon", one) for one in several]
    return {f"{1e3 * one:g}ms" if one < 1 else f"{one:g}s": one for one in lengths}

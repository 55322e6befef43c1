"""Error of the model, found from the data: noise that a filter assumes, interval that it states.

A model that is not the air errs in the same way whenever the same flow comes again. A filter that
takes such errors for white noise becomes sure of weights that fit one gait and no other. Here the
variance that the filter assumes of a sample is

    R_k = c max((floor s_k)^2, min(3 <r_k^2>, s_k^2)),

s the standard deviation of y_k so far, its network's offset counted as one sample, and r = y - y(W)
what a sample leaves after it was learned, averaged over 100 spans of correlation; a span has
c = s / rms(change of y from sample to sample) samples, for a sine 1 / (2 pi f) s whatever the rate
of the samples. The mean of y is no part of s, and a model that errs by more than s for long is
worse than a constant. The measurement's own noise, where it is known, is added. In an
output where the strips' forces cancel, such as the side force of a symmetric flight, noise of the
angles is all that is left, and a close fit of it would draw the weights that it shares with other
outputs to zero. So the standard deviation of each output's noise is at least a thirtieth of what
these forces would give if they did not cancel, though at most three hundred times what samples
leave, and a three-thousandth in any case: side forces that begin at rounding may grow a billion
times, and what they said when they were small would outweigh all that comes.

What a sample leaves is still there a moment later: the next sample is predicted with rho r on
top, rho = <e_k r_(k-1)> / <r_(k-1)^2> over 20 spans, at most .99, to the power of the time since
in mean steps. Predictions of other flow, without a time, are the weights' alone.

The variance that the filter states is another thing than the one that it assumes:

    max(<e_k^2> - <v_k>, 0) + v_k + 15 max(h_k - <h_k>, 0),

with e the errors of such predictions, v the variance that came with a sample as its own noise and
h the variance that the weights alone give, all averaged over 5 spans, at first over the last fifth
of all samples, h by its logarithm, so that the prior's and the first errors are soon forgotten: in
flow like that of late it is what the errors are, and it grows with the noise of a sample and in
flow that excites weights which the flow of late did not.
A rest, where the output that varies most and the variance of its weights nearly vanish, is no flow,
and leaves these averages as they are.
In the flow that is being learned its width is turned up by each error outside of it and down by
those inside, until it holds 95 %.

`kernels/misfit.h` does the same in C on the same arrays, and defines the numbers; 3, 5, 15, 20 and
100 were chosen on flights in foreign air (docs/foreign.md). Neglected: noise that is larger in some
flow than in other, but for the weights' part and what came with a sample.

References:
    Kennedy & O'Hagan (2001), Bayesian calibration of computer models, J. R. Stat. Soc. B 63;
    Gibbs & Candes (2021), Adaptive conformal inference under distribution shift, NeurIPS 34.
"""

from __future__ import annotations

from math import copysign, exp, isfinite, log, sqrt

import numpy as np
from numpy.typing import ArrayLike

from patagium.arrays import Array, Bools
from patagium.native.structs import header_numbers

_C = header_numbers("misfit.h")
_FAR = 10.0  # usual variances: new flow
_LAST, _MEAN_STEP = range(2)
PARTS = (
    *("level", "change", "before", "residual", "recent", "usual", "interval"),
    *("left", "carried", "lagged", "power", "alone", "width", "center", "sampled"),
)


class Misfit:
    """Memory of a model's error, arrays that the kernels share.

    Args:
        floor: Error that is assumed at least, over the deviation of each output; 0: no error.
        known: Variances of the measurement itself, (n_y,) [y^2].
        sample: Variances that came with the sample in hand, (n_y,) [y^2]; whoever gives it
            changes it from sample to sample.
        offset: Value of y that counts as one sample before the first, (n_y,) or () [y].
        levers: Factors from the square of each strip's force to those of the outputs, and from the
            square of each output to those of the strips' forces, of which the largest holds,
            (n_y, strips) each [y^2/N^2, N^2/y^2]; None: unknown.
        scale: Scale of each output, in which outputs are compared, (n_y,) or () [y].

    Attributes:
        floor: As given.
        parts: Arrays by name, (n_y,) each [1, y or y^2].
        clock: Stamp of the last sample [s], NaN: unknown; mean time between two [s], 0: unknown.
        heard: Samples of each channel so far, (n_y,) [1].
        span: Samples in a span of correlation.
        scale: Standard deviation stated over that assumed, of the last sample, (n_y,) [1].
    """

    def __init__(
        self,
        floor: float,
        known: Array,
        sample: Array,
        offset: ArrayLike = 0.0,
        levers: tuple[Array, Array] | None = None,
        scale: ArrayLike = 1.0,
    ) -> None:
        self.floor, self._known, self._sample = floor, known, sample
        self._unit = np.square(np.broadcast_to(scale, len(known)))
        self.parts = {name: np.zeros(len(known)) for name in PARTS}
        self.parts["center"][:] = offset
        self.levers = levers or (np.zeros((len(known), 0)),) * 2
        self.clock = np.array([np.nan, 0.0])
        self.heard = np.zeros(len(known), np.int64)
        self.span = _C.UNSEEN
        self.scale, self._weights = np.ones(len(known)), np.zeros(len(known))

    @property
    def _levels(self) -> Array:
        """Variances of the scaled measurements, (n_y,) [1]."""
        return np.asarray(self.parts["level"] / self._unit)

    @property
    def least(self) -> Array:
        """Smallest variances of an interval, a share of the largest scaled one, (n_y,) [y^2]."""
        return np.asarray(_C.LEAST * self._levels.max() * self._unit)

    @property
    def alone(self) -> Array:
        """Variance of the errors of the weights alone, without the samples' own, (n_y,) [y^2]."""
        return np.asarray(np.maximum(self.parts["alone"] - self.parts["sampled"], self.least))

    def at(self, time: ArrayLike) -> Array:
        """Part of the last error that is expected at a time, (n_y,), or at several, (N, n_y) [y].

        Args:
            time: Time, () or (N,) [s]; NaN: one step after the last sample.
        """
        last, mean = self.clock
        step = np.asarray(time, float) - last
        ahead = np.where((step >= 0) & (mean > 0), step / (mean or 1.0), 1.0)  # none is set back
        lagged, power = self.parts["lagged"], self.parts["power"]
        share = np.maximum(lagged, 0.0) / np.where(power > 0, power, np.inf)
        return np.asarray(self.parts["left"] * np.minimum(share, _C.STAYS) ** ahead[..., None])

    def carry(self, mean: Array, covariance: Array, time: float) -> tuple[Array, Array]:
        """Moments with what of the last error is expected, from those of the weights alone.

        Args:
            mean: Mean that the weights give, (n_y,) [y].
            covariance: As the filter stated it for them just now, (n_y, n_y) [y^2].
            time: Time [s].
        """
        parts, interval = self.parts, self.parts["interval"]
        nearer = interval - self._expected("alone") + self._expected("recent")
        nearer *= np.exp(2 * parts["width"])
        nearer = np.maximum(nearer, self.least)
        scale = np.sqrt(np.where(nearer > 0, nearer, interval) / interval)
        return mean + self.at(time), scale[:, None] * covariance * scale

    def follow(self, measured: Array, time: float) -> None:
        """Variances of the measurements, squares of their changes, and what the last error left.

        Args:
            time: Of the sample [s]; NaN: unknown.
            measured: Measurement y, (n_y,) [unit of y]; NaN where it is missing.
        """
        if not self.floor:
            return
        step, mean = time - self.clock[_LAST], self.clock[_MEAN_STEP]
        if isfinite(step) and step > 0:
            counted = min(step, _C.STEP * mean) if mean > 0 else step
            self.clock[_MEAN_STEP] += (counted - mean) / (_C.STEP if mean > 0 else 1.0)
        self.parts["carried"][:] = self.at(time)
        self.clock[_LAST] = time
        level, change, before, residual = (self.parts[name] for name in PARTS[:4])
        center = self.parts["center"]
        for k, y in enumerate(measured.tolist()):
            if not isfinite(y):
                continue
            self.heard[k] += 1
            n = int(self.heard[k])
            own = y - float(center[k])
            square = _capped(own * own, level[k], n)
            center[k] += copysign(sqrt(square), own) / (n + 1)
            level[k] += (square * n / (n + 1) - level[k]) / n
            if n == 1:
                residual[k] = _C.START * level[k]
            else:
                change[k] += (_capped((y - before[k]) ** 2, change[k], n) - change[k]) / (n - 1)
            before[k] = y

    def noise(self, load: Array) -> Array:
        """Variances that the filter assumes, (n_y,) [y^2].

        Args:
            load: Squares of the network's own scale, where nothing was measured yet, (n_y,) [y^2].
        """
        level, change = self.parts["level"], self.parts["change"]
        largest = float(self._levels.max())
        moving = (self._levels > _C.STILL * largest) & (change > 0)
        self.span = _C.UNSEEN
        if moving.any():
            logs = [log(a / b) / 2 for a, b in zip(level[moving], change[moving], strict=True)]
            self.span = min(max(exp(sum(logs) / len(logs)), 1.0), _C.MOST)
        own = _C.LEAST * np.where(load > 0, load, 1.0)
        least = self.least if largest > 0 else own
        residual = self.parts["residual"]
        least = np.maximum(least, self.least_noise(level))
        left = np.minimum(_C.LEFT * residual, level)
        misfit = np.maximum(self.floor**2 * level, left)
        return np.asarray(self._known + np.maximum(self.span * misfit, least))

    def least_noise(self, squares: Array) -> Array:
        """Least variances of the noise, as if forces of strips did not cancel, (n_y,) [y^2].

        Args:
            squares: Mean squares of the measurements, (n_y,) [y^2].
        """
        spread, told = self.levers
        apart = spread @ (told * squares[:, None]).max(axis=0, initial=0.0)
        coarse = np.minimum(_C.COARSE * apart, _C.MUCH * self.parts["residual"])
        return np.asarray(np.maximum(_C.SLIGHT * apart, coarse))

    def stated(self, variances: Array, noise: Array, carried: bool) -> Array:
        """Standard deviation that the filter states over that which it assumes, (n_y,) [1].

        Args:
            variances: Diagonal of P_yy, (n_y,) [y^2].
            noise: The part of it that is noise, (n_y,) [y^2].
            carried: Whether what the last sample left is part of the prediction.
        """
        self._weights, interval = variances - noise, self.parts["interval"]
        late = self._expected("recent" if carried else "alone")
        interval[:] = widened(late, self._weights, self.parts["usual"])
        if carried:
            interval *= np.exp(2 * self.parts["width"])
        interval[:] = np.where(interval > 0, np.maximum(interval, self.least), variances)
        self.scale = np.sqrt(interval / variances)
        return self.scale

    def _expected(self, name: str) -> Array:
        """Mean square of the errors of late, at the noise that came with this sample."""
        own = np.maximum(self.parts[name] - self.parts["sampled"], 0.0)
        return own + self._sample

    def learned(
        self,
        count: int,
        left: Array,
        innovation: Array,
        kept: Bools,
        doubted: Bools,
    ) -> None:
        """Averages after a sample.

        Args:
            count: Samples learned so far, this one included.
            left: What the sample leaves, y - y(W), (n_y,) [y]; ten times the usual size counts of
                it at most.
            innovation: (n_y,) [y].
            kept: Channels that were learned from, (n_y,) [1].
            doubted: Those of them whose innovation is beyond the limit of the screening, (n_y,)
                [1]: their error is not expected to last.
        """
        slow = max(1.0 / (count + _C.FIRST), 1.0 / (_C.LONG * self.span))
        fast = max(_C.SHORT / (count + _C.SHORT - 1.0), 1.0 / (_C.SHORT * self.span))
        middle = max(1.0 / (count + _C.FIRST), 1.0 / (_C.MIDDLE * self.span))
        residual, recent, usual = (self.parts[name] for name in PARTS[3:6])
        last, carried, lagged, power = (self.parts[name] for name in PARTS[7:11])
        before, alone, width = last.copy(), self.parts["alone"], self.parts["width"]
        sampled = self.parts["sampled"]
        last[:] = carried
        error, least = innovation - carried, self.least
        level, heard = self.parts["level"], self.parts["before"]
        top = self._levels.argmax()
        quiet = self._weights[top] < _C.REST * usual[top]
        if quiet and heard[top] ** 2 < _C.REST * level[top]:  # at rest
            fast = 0.0
        for k in np.flatnonzero(kept).tolist():
            stated = float(self.parts["interval"][k])
            missed = error[k] ** 2 > _C.QUANTILE * stated
            if missed or stated > least[k]:
                width[k] += _C.TURN * (float(missed) - _C.OUTSIDE)
            square = _capped(innovation[k] ** 2, alone[k], count)
            lagged[k] += middle * (copysign(sqrt(square), innovation[k]) * before[k] - lagged[k])
            power[k] += middle * (before[k] ** 2 - power[k])
            remains = _capped(left[k] ** 2, residual[k], count)
            if not doubted[k]:
                last[k] = copysign(sqrt(remains), left[k])
            residual[k] += slow * (remains - residual[k])
            recent[k] += fast * (_capped(error[k] ** 2, recent[k], count) - recent[k])
            alone[k] += fast * (square - alone[k])
            sampled[k] += fast * (self._sample[k] - sampled[k])
            here, before_it = float(self._weights[k]), float(usual[k])
            known = before_it > 0 and here > 0
            usual[k] = before_it * (here / before_it) ** fast if known else max(here, 0.0)


def widened(error: Array, weights: Array, usual: Array) -> Array:
    """Variance that is stated: that of late, more in flow that excites other weights, (n_y,) [y^2].

    Args:
        error: Mean square of the errors of late, (n_y,) [y^2].
        weights: Variance that the weights give here, (n_y,) [y^2].
        usual: Variance that the weights gave of late, (n_y,) [y^2].
    """
    return np.asarray(error + _C.BEYOND * np.maximum(weights - usual, 0.0))


def unseen(error: Array, stated: Array, usual: Array) -> Bools:
    """Outputs whose variance by the weights is ten times the usual one, (..., n_y).

    Args:
        error: Mean square of the errors of late, (n_y,) [y^2].
        stated: Variance stated here, as `widened` gives it, (..., n_y) [y^2].
        usual: Variance that the weights gave of late, (n_y,) [y^2].
    """
    return np.asarray(stated - error > _C.BEYOND * (_FAR - 1.0) * usual)


def _capped(square: float, mean: float, count: int) -> float:
    return min(square, _C.WILD * mean) if count > _C.FIRST and mean > 0 else square

"""Screening of samples: outliers, stuck and missing channels, late samples, noise.

What no sensor can say is refused first (`bounds`), whatever the settings. A channel that is no
number is left out: the others are learned from as if it were not there.
With `Screening`, so is one that moved before and now repeats one value; and an innovation beyond
a limit has its noise raised until it lies at the limit. With `NoiseEstimation` the
variances of the measurement follow the innovations. Samples that are late are refused. Whatever
happens is counted. `kernels/screening.h` does the same in C on the same arrays.
Neglected: channels that fail together in a way that each of them looks right.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from math import inf, isfinite, isnan

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaincinv

from patagium.arguments import of_kind
from patagium.arrays import Array, Bools
from patagium.errors import Outcome
from patagium.learning.filters.bounds import MEMORY, Bounds
from patagium.learning.filters.misfit import PARTS as MISFIT_PARTS
from patagium.learning.filters.misfit import Misfit
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.spread import Moments
from patagium.learning.models.network import Network
from patagium.learning.settings import ChangeDetection, FilterSettings
from patagium.native.structs import header_numbers

EVENTS = (
    *("missing", "outliers", "stuck", "bad_inputs", "late", "duplicates", "clock_resets"),
    *("blind", "refused", "changes", "out_of_range", "jumps", "reopened"),
    "covariance_resets",
)
"""What is counted: channels of samples for the first three and `out_of_range` to `reopened`, else
samples."""

REFUSALS = {
    Outcome.BAD_INPUT: "bad_inputs",
    Outcome.LATE: "late",
    Outcome.DUPLICATE: "duplicates",
    Outcome.BLIND: "blind",
}
"""Outcomes of samples that are not learned from, and no failure of the filter."""

_C = header_numbers("screening.h")
RELATIVE_NOISE = 0.1
"""Standard deviation of the noise to start from, over the scale of the output [1]."""
_STAMP, _LAST_STAMP, _LATE_STAMP, _RECENT, _BEFORE = range(5)  # of `numbers`
_LATE_RUN, _FILLED, _PLACE, _ALARM, _LEARNED = range(5)  # of `whole`
_PARTS = (
    *("noise", "steady", "loaded", "smallest", "load", "mean_load", "extra", "last"),
    *("offset", "scale", "largest"),
)
_MARKS = ("still", "moved", "left_out", "seen", "far")
NEWER = ("offset", "scale", "largest", "seen", "far", "heard", "clock", *MISFIT_PARTS, *MEMORY)
"""Arrays that files of earlier releases do not hold."""


class ChangeMonitor:
    """Test for changes of the air or the wing: recent innovations against those before them.

    The normalized innovation squared e' P_yy^-1 e of a sample with m channels is chi-square with
    m degrees of freedom where the filter is right. Its mean over a window, over its mean over a
    longer span before, is then F distributed, and stays so when P_yy is wrong by one factor all
    along: a filter that is too sure, or not sure enough, raises no alarm by that alone.
    Neglected: correlation of innovations in time, which raises more alarms than it should.

    Args:
        detection: What it tests for; None: nothing.
        channels: Number of channels m when none is missing: the limit is that of all of them.
    """

    def __init__(self, detection: ChangeDetection | None, channels: int) -> None:
        self.detection = detection
        self.window = 0 if detection is None else detection.window
        self.reference = 0 if detection is None else detection.reference
        self.ratio = inf if detection is None else _limit(detection, channels)
        self.numbers = np.zeros(5)
        self.whole = np.zeros(5, np.int64)
        self.past = np.zeros(self.window + self.reference)

    def settle(self) -> bool:
        """Whether a change was found since this was last asked: the alarm is taken back."""
        alarm, self.whole[_ALARM] = bool(self.whole[_ALARM]), 0
        return alarm

    def alarmed_by(self, nis: float, channels: int) -> bool:
        """Whether the innovations up to this one are too large; the test then starts anew.

        Args:
            nis: Normalized innovation squared e' P_yy^-1 e.
            channels: How many channels it is of.
        """
        if not self.window:
            return False
        size, place = len(self.past), int(self.whole[_PLACE])
        value, oldest = min(nis / channels, _C.LARGEST_NIS), self.past[place]
        self.past[place] = value
        self.numbers[_RECENT] += value
        if self.whole[_FILLED] >= self.window:
            moved = self.past[(place - self.window) % size]
            self.numbers[_RECENT] -= moved
            self.numbers[_BEFORE] += moved
        self.whole[_PLACE] = (place + 1) % size
        if self.whole[_FILLED] >= size:
            self.numbers[_BEFORE] -= oldest
        else:
            self.whole[_FILLED] += 1
            if self.whole[_FILLED] < size:
                return False
        recent, before = self.numbers[_RECENT] / self.window, self.numbers[_BEFORE] / self.reference
        if recent <= self.ratio * max(before, 1.0):
            return False
        self.numbers[[_RECENT, _BEFORE]], self.whole[[_FILLED, _PLACE]] = 0.0, 0
        self.whole[_ALARM] = 1
        return True


@contextmanager
def lent(place: Array, values: Array) -> Iterator[None]:
    """Context in which an array, which C code reads by its address, holds other values."""
    before = place.copy()
    place[:] = values
    try:
        yield
    finally:
        place[:] = before


class Screen:
    """Memory of the screening between samples: arrays that the kernels share.

    Where the noise is found, it starts as a share of each output's scale, the root of its mean
    square so far, or a tenth of the network's own scale where that is larger. It grows with the
    scale, and follows the innovations after the first samples.

    Args:
        noise: Variances of the measurement to start from, (n_y,) [y^2]; NaN where they are found
            from the samples.
        network: Network that is fed.
        settings: Settings of a filter, of which its three groups are read.
        offset: Value of y that the scale of each output is about, scalar or (n_y,) [unit of y].
        levers: As `Misfit` takes them.
    """

    def __init__(
        self,
        noise: Array,
        network: Network,
        settings: FilterSettings | None = None,
        offset: ArrayLike = 0.0,
        levers: tuple[Array, Array] | None = None,
    ) -> None:
        chosen, channels = settings or FilterSettings(), len(noise)
        screening, noise_estimation = chosen.screening, chosen.noise_estimation
        self.limit = inf if screening is None else screening.outlier_std
        self.stuck_samples = 0 if screening is None else screening.stuck_samples
        self.share = 0.0 if noise_estimation is None else 1.0 / noise_estimation.memory
        self.believes = screening is None
        self.monitor = ChangeMonitor(chosen.change_detection, channels)
        self.numbers, self.whole = self.monitor.numbers, self.monitor.whole
        self.counts = np.zeros(len(EVENTS), np.int64)
        self.parts = {name: np.zeros(channels) for name in _PARTS}
        self.marks = {name: np.zeros(channels, np.int64) for name in _MARKS}
        self.parts["noise"][:] = noise
        self.parts["steady"][:] = self.parts["loaded"][:] = noise / 2
        self.parts["smallest"][:] = 1e-12 * np.nan_to_num(noise)
        self.parts["last"][:] = np.nan
        self.parts["offset"][:] = offset
        self.relative = RELATIVE_NOISE if np.isnan(noise).any() else 0.0
        self.stated = np.zeros(channels)
        floor = 0.0 if chosen.misfit is None else chosen.misfit.floor
        self.bounds = Bounds(network)
        scale = self.bounds.scale[self.bounds.inputs :]
        self.misfit = Misfit(floor, noise.copy(), self.stated, offset, levers, scale)
        if self.misfit.floor:
            self.parts["steady"][:], self.parts["loaded"][:] = noise, 0.0
        self.numbers[:3] = np.nan, -inf, np.nan

    @property
    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Arrays of the memory, by name."""
        return {
            "numbers": self.numbers,
            "whole": self.whole,
            "counts": self.counts,
            "past": self.monitor.past,
            **self.parts,
            **self.marks,
            **self.misfit.parts,
            "heard": self.misfit.heard,
            "clock": self.misfit.clock,
            **self.bounds.arrays,
        }

    def restore(self, arrays: Mapping[str, NDArray[np.generic]]) -> None:
        """Take over the memory of another screening."""
        for name, array in self.arrays.items():
            array[...] = arrays[name]

    def bounded(self, x: Array, y: Array) -> Array | None:
        """Measurement within its bounds, (n_y,), NaN elsewhere; None where x is out of its own.

        Args:
            x: Input, (n_x,) [units of x].
            y: Measurement, (n_y,) [unit of y].
        """
        usable, within, events = self.bounds.bounded(x, y, float(self.numbers[_STAMP]))
        for event, count in {**events, "bad_inputs": int(not usable)}.items():
            self.note(event, count)
        return within if usable else None

    def stamp(self, time: float | None) -> None:
        """Note when the next sample was made [s]; None: not known, NaN: its clock told nothing."""
        if type(time) not in (float, np.float64):
            of_kind("time", time, float | None)
        self.numbers[_STAMP] = np.nan if time is None else time

    def restart_clock(self) -> None:
        """Take the next time stamp, whatever it is."""
        self.numbers[_LAST_STAMP], self.whole[_LATE_RUN] = -inf, 0
        self.bounds.forget_place()

    @property
    def events(self) -> dict[str, int]:
        """Number of each event."""
        return dict(zip(EVENTS, self.counts.tolist(), strict=True))

    @property
    def variances(self) -> Array:
        """Variances of the measurement at the mean load, (n_y,) [y^2]."""
        if self.misfit.floor:
            return np.where(self.misfit.heard > 0, self.misfit.alone, np.nan)
        if self.share == 0:
            return self.parts["noise"].copy()
        return self.parts["steady"] + self.parts["loaded"]

    @property
    def left_out(self) -> Bools:
        """Channels of the last sample that were not learned from, (n_y,)."""
        return self.marks["left_out"].astype(bool)

    def noisier(self, variance: Array) -> AbstractContextManager[None]:
        """Context in which a sample has more noise of the measurement.

        Args:
            variance: Variance added, (n_y,) [y^2].
        """
        place = self.stated if self.share or self.misfit.floor else self.parts["noise"]
        return lent(place, place + variance)

    def note(self, event: str, count: int = 1) -> None:
        """Count more of an event."""
        self.counts[EVENTS.index(event)] += count

    def admit(self) -> Outcome:
        """Outcome of the time stamp in `numbers`: COMPLETED if it is later than the one before."""
        stamp, last, late = self.numbers[:3]
        if isnan(stamp):
            return Outcome.COMPLETED
        if isfinite(stamp) and stamp > last:
            self.numbers[_LAST_STAMP], self.whole[_LATE_RUN] = stamp, 0
            return Outcome.COMPLETED
        if stamp == last:
            self.note("duplicates")
            return Outcome.DUPLICATE
        run = int(self.whole[_LATE_RUN])
        self.whole[_LATE_RUN] = run + 1 if run and stamp > late else 1
        self.numbers[_LATE_STAMP] = stamp
        if isfinite(stamp) and self.whole[_LATE_RUN] == _C.CLOCK_RUN:
            self.numbers[_LAST_STAMP], self.whole[_LATE_RUN] = stamp, 0
            self.note("clock_resets")
            return Outcome.COMPLETED
        self.note("late")
        return Outcome.LATE

    def noise(self, readout: Array) -> Array:
        """Variance of each channel at a sample, (n_y,).

        Args:
            readout: Readout of the network at the sample, (n_y, r) [unit of y].
        """
        parts = self.parts
        if self.share or (self.misfit.floor and not self.misfit.parts["level"].any()):
            parts["load"][:] = np.einsum("ij,ij->i", readout, readout)
        if self.share:
            if self.relative:
                for k in np.flatnonzero(self.marks["seen"] == 0).tolist():
                    self._start_noise(k, float(parts["load"][k]))
            own = parts["steady"] + parts["loaded"] * self._relative_load()
            parts["noise"][:] = own + self.stated
        if self.misfit.floor:
            parts["noise"][:] = self.misfit.noise(parts["load"]) + self.stated
        return parts["noise"].copy()

    def stated_covariance(self, covariance: Array, *, carried: bool) -> Array:
        """Covariance of y as the filter states it, (n_y, n_y) [y^2].

        Args:
            carried: Whether what the last sample left is part of the prediction.
            covariance: P_yy as the filter assumes it, (n_y, n_y) [y^2].
        """
        if not self.misfit.floor:
            return covariance
        scale = self.misfit.stated(np.diag(covariance), self.parts["noise"], carried)
        return scale[:, None] * covariance * scale

    def stated_innovation(self, innovation: Array) -> Array:
        """Innovation in the units that the filter assumes, larger where it states less, (n_y,).

        Args:
            innovation: Innovation, (n_y,) [y].
        """
        if not self.misfit.floor:
            return innovation
        error = np.where(self.left_out, 0.0, innovation - self.misfit.parts["carried"])
        return error / self.misfit.scale

    def follow(self, measured: Array) -> None:
        """Scale of the outputs from one more measurement.

        Args:
            measured: Measurement y, (n_y,) [unit of y].
        """
        self.misfit.follow(measured, float(self.numbers[_STAMP]))

    def screened(self, found: Moments, measured: Array) -> tuple[Moments, Array] | None:
        """Moments of y and innovation of a sample as the filter uses them; None if it uses none.

        Channels left out are none of the moments, and their innovation is zero; the noise of
        those doubted is raised.

        Args:
            found: Moments of y before it was measured.
            measured: Measurement y, (n_y,) [unit of y].
        """
        innovation = np.zeros(len(measured))
        variances = np.einsum("ij,ij->j", found.slopes, found.slopes) + np.diag(found.remainder)
        each = zip(measured.tolist(), found.mean.tolist(), variances.tolist(), strict=True)
        kept = [self._weigh(k, *numbers, innovation) for k, numbers in enumerate(each)]
        self.marks["left_out"][:] = np.logical_not(kept)
        if not any(kept):
            self.note("blind")
            return None
        out = self.left_out
        slopes, remainder = found.slopes.copy(), found.remainder + np.diag(self.parts["extra"])
        slopes[:, out] = 0.0
        remainder[out, :], remainder[:, out] = 0.0, 0.0
        remainder[out, out] = 1.0
        return Moments(found.mean, slopes, remainder), innovation

    def learned(
        self, mean: Array, innovation: Array, gain: Array, inverse: Array, nis: float
    ) -> None:
        """Update the variances and the test for changes after a sample.

        Args:
            mean: Mean of y that the weights gave, (n_y,) [y].
            innovation: Innovation, (n_y,) [y].
            gain: P_yy^-1 e, (n_y,) [1/y].
            inverse: Diagonal of P_yy^-1, (n_y,) [1/y^2].
            nis: e' P_yy^-1 e.
        """
        self.whole[_LEARNED] += 1
        kept = self.marks["left_out"] == 0
        if self.share:
            self._learn_noise(mean + innovation, gain, inverse, kept)
        if self.misfit.floor:
            left, doubted = self.parts["noise"] * gain, self.parts["extra"] > 0
            self.misfit.learned(int(self.whole[_LEARNED]), left, innovation, kept, doubted)
        if self.monitor.alarmed_by(nis, int(kept.sum())):
            self.note("changes")

    def _weigh(
        self, k: int, measured: float, mean: float, variance: float, innovation: Array
    ) -> bool:
        extra = self.parts["extra"]
        extra[k] = 0.0
        if not isfinite(measured):
            self.note("missing")
            return False
        if self.stuck_samples and self._stands(k, measured):
            self.note("stuck")
            return False
        apart = measured - mean
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = float(np.abs(apart) / np.sqrt(variance))
        if reach > self.limit:
            self.note("outliers")
            far = self.marks["far"]
            far[k] += not reach < _C.FAR
            if not reach < _C.FAR and far[k] < _C.FAR_RUN:
                return False
            extra[k] = (apart / self.limit) ** 2 - variance
        self.marks["far"][k] = 0
        innovation[k] = apart
        return True

    def _stands(self, k: int, measured: float) -> bool:
        last, marks = self.parts["last"], self.marks
        if measured == last[k]:
            marks["still"][k] += 1
            return bool(marks["still"][k] >= self.stuck_samples and marks["moved"][k])
        if not isnan(last[k]):
            marks["moved"][k] = 1
        marks["still"][k] = 1
        last[k] = measured
        return False

    def _relative_load(self) -> Array:
        load, usual = self.parts["load"], self.parts["mean_load"]
        return np.where(usual > 0, load / np.where(usual > 0, usual, 1.0), 1.0)

    def _start_noise(self, k: int, scale: float) -> None:
        """Noise of a channel begun as a share of a squared scale; 1 takes the place of none."""
        parts, own = self.parts, scale if scale > 0 else 1.0
        parts["largest"][k] = own
        self.misfit.parts["residual"][k] = share = self.relative * self.relative * own
        parts["steady"][k] = parts["loaded"][k] = share / 2

    def _follow_scale(self, k: int, measured: float) -> None:
        """Scale of a channel after a measurement."""
        parts, seen = self.parts, self.marks["seen"]
        seen[k] += 1
        apart = measured - parts["offset"][k]
        parts["scale"][k] += (apart * apart - parts["scale"][k]) / int(seen[k])
        scale = float(max(parts["scale"][k], _C.LEAST_SCALE * parts["load"][k]))
        growth = scale / parts["largest"][k]
        parts["smallest"][k] = _C.LEAST_NOISE * (scale if scale > 0 else parts["largest"][k]) / 2
        if seen[k] <= _C.FIRST_SAMPLES:
            self._start_noise(k, scale)
        elif growth > 1:
            parts["largest"][k] = scale
            parts["steady"][k] *= growth
            parts["loaded"][k] *= growth

    def _learn_noise(self, measured: Array, gain: Array, inverse: Array, kept: Bools) -> None:
        parts, relative = self.parts, self._relative_load()
        fresh = max(self.share, 1.0 / int(self.whole[_LEARNED]))
        parts["mean_load"] += fresh * (parts["load"] - parts["mean_load"])
        if self.relative:
            followed = kept & (parts["extra"] == 0)
            for k in np.flatnonzero(followed).tolist():
                self._follow_scale(k, float(measured[k]))
            kept = kept & ~(followed & (self.marks["seen"] <= _C.FIRST_SAMPLES))
        raised = (parts["noise"] + parts["extra"]) / parts["noise"]
        larger = np.maximum(parts["steady"], parts["loaded"] * relative)
        share = max(self.share, 1.0 / (int(self.whole[_LEARNED]) + _C.FIRST_MEMORY))
        rate = np.where(kept, share, 0.0)
        move = rate * raised * (parts["noise"] - self.stated) / larger * (gain**2 - inverse)
        residual = self.misfit.parts["residual"]
        residual += rate * ((parts["noise"] * gain) ** 2 - residual)
        smallest = np.maximum(parts["smallest"], self.misfit.least_noise(parts["scale"]) / 2)
        for name, factor in (("steady", move), ("loaded", relative * move)):
            part = parts[name]
            part[:] = np.maximum(part + part**2 * factor, smallest)


def new_screen(numbers: FilterNumbers) -> Screen:
    """Screening of a filter, before any sample."""
    network = numbers.network
    known = getattr(network, "offset", 0.0), getattr(network, "levers", None)
    return Screen(numbers.noise, network, numbers.settings, *known)


def _limit(detection: ChangeDetection, channels: int) -> float:
    """Quantile of F at the false alarm rate.

    P(F > x) = I_u(d2 / 2, d1 / 2) with u = d2 / (d2 + d1 x).
    """
    window, reference = detection.window * channels, detection.reference * channels
    share = float(betaincinv(reference / 2, window / 2, detection.false_alarm_rate))
    return reference * (1 - share) / (window * share)

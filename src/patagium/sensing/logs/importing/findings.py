"""Statistics of the stamps and numbers of a log, and findings that follow from them.

Statistics come from one pass, block by block in little memory. Time steps are counted in bins of
0.5 %, so their median is right to that. Each finding says what was expected, what was found, and
what to do. The rules compare sizes: a body at rest or in steady flight feels 1 g, no gyroscope
turns faster than 2,300 deg/s, rooms are smaller than 500 m. Mistakes that sizes cannot show are
found by `consistency`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from patagium.arguments import Progress
from patagium.arrays import Array, Bools, count_noise, find_gaps, runs
from patagium.sensing.logs.files.channels import NO_STAMP, Block, LogFile, Request, Stamps
from patagium.sensing.logs.mapping import conversion
from patagium.sensing.motion.encoder_faults import jumps_of

Keep = Callable[[Block, Bools], Array]

_WIDTH = 0.005
_BINS = 7600  # to 3e16 ns, a year
_SCATTER = 0.7
"""Mean square step over the variance from which numbers are noise: 2 of white noise, (w dt)^2 of
a motion."""
_DAYS = (2e4, 9e5)
"""Days since 1900 or the year 0, as spreadsheets and MATLAB count them, of the years 1954 on."""
_NEAR = 0.1
"""Share of the median step below which a step is nearly a duplicate."""
_FAST, _SLOW, _SLOWEST = 2e-4, 0.2, 100.0
"""Steps [s]: of few logs shorter; of a log of flight shorter; of a log with dates no longer."""
_DATES = (6.3e8, 4.1e9)
"""Seconds since 1970 of the years 1990 to 2099."""
_UNITS = {"s": 1e9, "ms": 1e6, "µs": 1e3, "ns": 1.0}
"""Units that stamps may be in [ns]."""
SECOND = 1_000_000_000
"""One second [ns]."""


class StampSurvey:
    """Statistics of the stamps of one stream in the order of the file.

    Attributes:
        rows: Number of rows.
        kept: Rows whose stamp is later than all before.
        missing: Rows without a usable stamp.
        duplicates: Rows that repeat the latest stamp.
        backwards: Rows stamped before the latest stamp.
        furthest_back: Longest step back [ns].
        first: First stamp [ns]; None before there is one.
        last: Latest stamp [ns].
        longest: Longest step forward [ns].
        longest_at: Stamp before the longest step [ns].
        unit: Unit of the stamps in the file [ns].
        far: Statistics of the numbers in the file, as if in ns, where none is a stamp in `unit`.
    """

    rows = kept = missing = duplicates = backwards = 0
    furthest_back = longest = longest_at = 0
    first: int | None = None
    last = NO_STAMP
    unit = 1e9
    far: StampSurvey | None = None
    _last_row = _last_back = 0

    def __init__(self) -> None:
        self._bins = np.zeros(_BINS, np.int64)
        self._sums = np.zeros(_BINS)

    def add(self, stamps: Stamps) -> Bools:
        """Add more stamps to the statistics.

        Args:
            stamps: Stamps, (k,) [ns].

        Returns:
            Whether each stamp is later than all before it, (k,).
        """
        self.rows += len(stamps)
        known = stamps != NO_STAMP
        self.missing += int((~known).sum())
        latest = np.maximum.accumulate(np.concatenate([[self.last], stamps]))[:-1]
        advances, back = known & (stamps > latest), known & (stamps < latest)
        self.duplicates += int((known & (stamps == latest)).sum())
        self.furthest_back = max(self.furthest_back, int((latest - stamps)[back].max(initial=0)))
        if advances.any():
            after = int(advances[::-1].argmax())
            self._last_row = self.rows - 1 - after
            self._last_back = self.backwards + int(back[: len(back) - after].sum())
        self.backwards += int(back.sum())
        self._count(stamps[advances])
        return np.asarray(advances, np.bool_)

    def _count(self, kept: Stamps) -> None:
        """Count steps of stamps, those that advance, and keep the longest one."""
        if not len(kept):
            return
        self.kept += len(kept)
        if self.first is None:
            self.first = int(kept[0])
        else:
            kept = np.insert(kept, 0, self.last)
        self.last, steps = int(kept[-1]), np.diff(kept)
        if not len(steps):
            return
        place = int(steps.argmax())
        if steps[place] > self.longest:
            self.longest, self.longest_at = int(steps[place]), int(kept[place])
        bins = np.minimum((np.log(steps) / _WIDTH).astype(np.int64), _BINS - 1)
        self._bins += np.bincount(bins, minlength=_BINS)
        self._sums += np.bincount(bins, steps.astype(float), minlength=_BINS)

    @property
    def median(self) -> float:
        """Median step, as the mean of its bin [s]; NaN with less than two stamps."""
        total = int(self._bins.sum())
        if not total:
            return float("nan")
        place = int(np.searchsorted(np.cumsum(self._bins), (total + 1) // 2))
        return float(self._sums[place] / self._bins[place]) / SECOND

    def _bin(self, factor: float) -> float:
        """Place of `factor` medians among the bins; 0 where there are no steps."""
        return math.log(factor * self.median * SECOND) / _WIDTH if self._bins.any() else 0.0

    def gaps(self, factor: float) -> int:
        """Number of steps that are longer than `factor` medians."""
        count = int(self._bins[math.ceil(self._bin(factor)) :].sum())
        return max(count, int(self.longest > factor * self.median * SECOND))

    @property
    def near_duplicates(self) -> int:
        """Number of steps that are shorter than a tenth of the median."""
        return int(self._bins[: max(0, int(self._bin(_NEAR)))].sum())

    @property
    def rate(self) -> float:
        """Number of rows a second between the first and the last time stamp [Hz].

        NaN if these are the same. Rows that follow after a clock was set back, until it is ahead
        again, take no time.
        """
        rows = self._last_row - self._last_back * self.set_back
        return rows / self.duration if self.duration > 0 else float("nan")

    @property
    def set_back(self) -> bool:
        """Whether the clock was set back, by more than ten median steps."""
        return self.furthest_back / SECOND > 10 * self.median

    @property
    def duration(self) -> float:
        """Time from the first to the latest stamp [s]."""
        return 0.0 if self.first is None else (self.last - self.first) / SECOND


class ValueSurvey:
    """Statistics of the numbers of one stream, channel by channel.

    Args:
        channels: Number of channels n.

    Attributes:
        count: Number of finite entries of each channel, (n,) [-].
        missing: Number of other entries of each channel, (n,) [-].
        low: Lowest number, (n,), in the unit of the file.
        high: Highest number, (n,), in the unit of the file.
    """

    def __init__(self, channels: int) -> None:
        self.count, self.missing = np.zeros((2, channels), np.int64)
        self.low = np.full(channels, np.inf)
        self.high = np.full(channels, -np.inf)
        self._sum, self._square, self._steps = np.zeros((3, channels))

    def add(self, values: Array) -> None:
        """Add more rows, (k, n) in the unit of the file, to the statistics."""
        if not len(values) or not values.shape[1]:
            return
        finite = np.isfinite(values)
        plain = np.where(finite, values, 0.0)
        self.count += finite.sum(axis=0)
        self.missing += (~finite).sum(axis=0)
        self.low = np.minimum(self.low, np.where(finite, values, np.inf).min(axis=0))
        self.high = np.maximum(self.high, np.where(finite, values, -np.inf).max(axis=0))
        with np.errstate(over="ignore", invalid="ignore"):
            self._sum += plain.sum(axis=0)
            self._square += (plain**2).sum(axis=0)
            self._steps += np.nansum(np.diff(values, axis=0) ** 2, axis=0)

    def _per_number(self, sums: Array) -> Array:
        return sums / np.where(self.count, self.count, np.nan)

    @property
    def mean(self) -> Array:
        """Mean of each channel, (n,); NaN where nothing is finite."""
        return self._per_number(self._sum)

    @property
    def rms(self) -> Array:
        """Root mean square of each channel, (n,); NaN where nothing is finite."""
        return np.sqrt(self._per_number(self._square))

    @property
    def change(self) -> Array:
        """Root mean square change from row to row, (n,); NaN where nothing is finite."""
        return np.sqrt(self._per_number(self._steps))

    @property
    def noise(self) -> Bools:
        """Whether each channel scatters about its mean from row to row and does not move, (n,)."""
        scatter = self._square - self.count * self.mean**2
        return np.asarray((self._steps >= _SCATTER * scatter) | (self.low == self.high))


class StreamSurvey:
    """Statistics of one stream.

    Args:
        channels: Number of channels.
        look: Number of numbers, of all channels together, that are kept from its beginning.

    Attributes:
        stamps: Statistics of its stamps.
        values: Statistics of its numbers.
    """

    def __init__(self, channels: int, look: int = 0) -> None:
        self.stamps, self.values = StampSurvey(), ValueSurvey(channels)
        self._room = look // max(1, channels)
        self._first = [(np.empty(0, np.int64), np.empty((0, channels)))]

    def add(self, stamps: Stamps, values: Array, advances: Bools) -> None:
        """Add rows, (k,) [ns] and (k, n); the first whose stamps advance are kept."""
        self.values.add(values)
        rows = np.flatnonzero(advances)[: self._room]
        self._room -= len(rows)
        if len(rows):
            self._first.append((stamps[rows], values[rows]))

    @property
    def first(self) -> tuple[Stamps, Array]:
        """Rows that were kept: stamps (k,) [ns] and numbers (k, n)."""
        stamps, values = zip(*self._first, strict=True)
        return np.concatenate(stamps), np.concatenate(values)


def survey_streams(
    log: LogFile,
    wanted: tuple[Request, ...],
    total: int,
    *,
    surveys: tuple[StreamSurvey, ...],
    keep: Keep | None = None,
    progress: Progress | None = None,
) -> None:
    """Statistics of the requested streams from one pass through a log.

    Args:
        log: The open log.
        wanted: Requests, one a stream.
        total: Number of rows of all streams, or an estimate, for `progress`.
        surveys: Statistics of each stream, which the rows are added to.
        keep: Called with each block and a bool for each row, whether its stamp advances; gives
            the values of the rows that are kept, of which the statistics are then taken alone.
        progress: Called now and then with the rows read and the rows in all.

    Raises:
        LogError: If the log is damaged, or a column holds text.
    """
    done = 0
    for block in log.blocks(wanted):
        if wanted[block.key].filled:
            own = [name != wanted[block.key].base.column for name in wanted[block.key].fields]
            rows = np.isfinite(block.values[:, own]).any(axis=1)
            block = block._replace(stamps=block.stamps[rows], values=block.values[rows])
        advances = surveys[block.key].stamps.add(block.stamps)
        values = block.values if keep is None else keep(block, advances)
        surveys[block.key].add(block.stamps, values, advances)
        done += len(block.stamps)
        if progress is not None:
            progress(done, max(total, done))
    for one, stamps in zip(wanted, (survey.stamps for survey in surveys), strict=True):
        stamps.unit = one.base.factor
        if one.base.kind == "column" and stamps.missing == stamps.rows > 0:
            stamps.far = StampSurvey()
            for block in log.blocks((one._replace(base=one.base._replace(factor=1.0)),)):
                stamps.far.add(block.stamps)


_FAR, _LEVELS, _CLIPPED, _RUN = 5.0, 50, 10, 3
_ABRUPT = 8.0
"""Step before a joint stands still over its count, and inverse over its usual step, of no motion
that slows down."""
SENSED = ("N", "N m", "m/s^2", "rad/s")
"""Units of sensors that saturate: load cells and inertial units."""
_ORDERED = re.compile(r"(?i)(^|[^a-z])(cmd|command|target|set_?point|desired|des|ref)")
"""Names of commands, which are not measured."""


def recorder_findings(
    where: str,
    stamps: Stamps,
    values: Array,
    gap: float,
    *,
    measured: bool,
    joint: bool = False,
    turn: float = 0.0,
) -> list[Finding]:
    """Findings about numbers that a recorder made: marks of missing ones, clipped or held samples.

    And jumps of angles: a step that is apart from those before and after it, see `jumps_of`.

    Args:
        where: Name of the quantity.
        stamps: Its first stamps, (N,) [ns].
        values: Its numbers there, (N,) [unit of the log]; NaN where some are missing.
        gap: Length from which a step is a gap, in median steps.
        measured: Whether they are measured, so that no command makes them stand still or end.
        joint: Whether they are those of an encoder, which may stand at a stop.
        turn: Change after which they begin again [unit of the log]; 0 if they do not.
    """
    ordered = _ORDERED.search(where) is not None
    measured, joint = measured and not ordered, joint and not ordered
    whole = np.insert(values, find_gaps(stamps, gap), np.nan)
    seen = np.isfinite(whole)
    marks = [*_marks(whole[seen])]  # before -999 degrees become 81
    if turn:
        whole[seen] = np.unwrap(whole[seen], period=turn)
    values = whole[seen]
    if len(np.unique(values)) < _LEVELS:
        return []
    steps = np.abs(np.diff(values))
    found = [*marks, *_clipped(values, steps, measured=measured, joint=joint)]
    changes = np.diff(np.flatnonzero(steps))
    every = float(np.median(changes))
    if (measured or joint) and every > 1 and (np.abs(changes - every) < 1).mean() > 0.9:
        if not count_noise(values):
            text = f"its numbers change every {every:g} samples: they are held between, and late; "
            found.append(("held", text + "import at the `rate` at which they change"))
    moves = (joint or (turn and not ordered)) and not marks
    jumps = jumps_of(whole)[0] if moves else ()
    if moves and (count := _wraps(values)):
        text = f"it jumps {count} times by more than half of its range against its motion: of an "
        text += "encoder that wraps, as before a gear, state its `turn`, such as 360 or 4096"
        found.append(("jump", text))
    elif len(jumps):
        largest = max((whole[k : k + 2] for k in jumps), key=lambda pair: abs(pair[1] - pair[0]))
        text = f"it jumps {len(jumps)} time(s), such as from {largest[0]:g} to {largest[1]:g}: "
        text += "leave bad samples empty; of a counter that was reset, import each part alone "
        found.append(("jump", text + "(`start` and `end`)"))
    return [Finding("warning", where, kind, text) for kind, text in found]


def _ends(values: Array) -> Iterator[tuple[float, int, int, float, bool]]:
    """Least and largest of many numbers, and none of a few.

    Yields:
        The number, its count, count of the number next to it, the distance to that, and whether
        it is far from all others.
    """
    levels, counts = np.unique(values, return_counts=True)
    for end, near, far in ((0, 1, -1), (-1, -2, 0)) if len(levels) >= _LEVELS else ():
        step = abs(levels[near] - levels[end])
        apart = bool(step > _FAR * abs(levels[near] - levels[far]))
        yield levels[end], int(counts[end]), int(counts[near]), step, apart


def _marks(values: Array) -> Iterator[tuple[str, str]]:
    """Warnings of a least or largest number that marks missing samples."""
    for mark, count, _, _, apart in _ends(values):
        if apart and (count > 1 or {*f"{abs(mark):g}"} == {"9"}):
            text = f"{mark:g} stands {count} time(s), far from all other numbers: if it marks what "
            yield "missing numbers", text + "is missing, leave these cells empty"


def _wraps(values: Array) -> int:
    """Number of steps beyond half of the range, if most are opposite to the steps around them."""
    steps = np.diff(values)
    far = np.flatnonzero(np.abs(steps[1:-1]) > 0.5 * np.ptp(values)) + 1
    against = (steps[far] * steps[far - 1] < 0) & (steps[far] * steps[far + 1] < 0)
    return len(far) if len(far) > 1 and against.mean() > 0.5 else 0


def _clipped(
    values: Array, steps: Array, *, measured: bool, joint: bool
) -> Iterator[tuple[str, str]]:
    """Warnings of clipped samples at the least and the largest number."""
    for mark, count, beside, step, apart in _ends(values):
        begins, ends = runs(values == mark).T
        begins = begins[ends - begins >= _RUN]
        before = steps[begins[begins > 1] - 2]
        usual = max(np.sqrt(np.mean(steps**2)) / _ABRUPT, _ABRUPT * step)
        abrupt = joint and len(before) >= _RUN and np.median(before) > usual
        if len(begins) >= _RUN and count > _CLIPPED * beside and not apart:
            if abrupt or (measured and mark):
                text = f"{count} of {len(values)} samples are at the end of its numbers, {mark:g}: "
                text += "if the sensor or its amplifier is at the end of its range there, leave "
                yield "clipped", text + "them empty"


GRAVITY = 9.80665
_FASTEST = 40.0  # rad/s
_NOISY = 0.1  # rad/s of a gyroscope at rest
_REST = 0.1  # share of a specific force by which it may change at rest
_FARTHEST = 500.0  # m
_QUICKEST = 150.0  # m/s
_CLOSE = 1.35
"""Ratio below which two sizes are alike."""


@dataclass(frozen=True)
class Finding:
    """Fact that a user should know before the log is used.

    Attributes:
        level: "warning", or "note" if no action is needed.
        where: Topic or quantity.
        kind: One or two words: "gap", "duplicate stamps", "unit" ...
        text: Description of what was found, and of what to do about it.
    """

    level: str
    where: str
    kind: str
    text: str


def stamp_findings(
    where: str, stamps: StampSurvey, gap: float, *, written: bool, kept: str | None = None
) -> list[Finding]:
    """Findings about the stamps of a stream.

    Args:
        where: Name of the stream.
        stamps: Statistics of its stamps.
        gap: Length from which a step is a gap, in median steps.
        written: Whether the unit of the stamps is one that a person wrote down or a guess, and
            not one that the format of the file states.
        kept: Row that the mapping keeps of those with the same stamp; None if it does not say.
    """
    found, doubt = [], time_doubt(stamps) if written else ""
    missing = 0 if stamps.far and doubt else stamps.missing
    rate = f"{stamps.rate:.4g} Hz" if stamps.rate > 0 else "RATE"
    even = f"`restamp: {rate}` if they were sampled evenly"
    keep = kept or f"left out; say `duplicates: keep-last` to keep the last of them, or {even}"
    back = f"an earlier one, by up to {stamps.furthest_back / SECOND:.4g} s; left out"
    back += f"; if the clock wraps or was set back, say `restamp: {rate}`" * stamps.set_back
    for count, kind, what in (
        (missing, "missing stamps", "without a stamp; left out"),
        (stamps.duplicates, "duplicate stamps", f"with the stamp of the one before; {keep}"),
        (stamps.backwards, "backward stamps", f"stamped before {back}"),
        (stamps.near_duplicates, "near-duplicate stamps", "less than a tenth of the median step "
         f"after the one before; kept; say {even}"),
    ):  # fmt: skip
        if count:
            level = "note" if kept and kind == "duplicate stamps" else "warning"
            found.append(Finding(level, where, kind, f"{count} of {stamps.rows} rows {what}"))
    gaps = stamps.gaps(gap)
    if gaps:
        at = (stamps.longest_at - (stamps.first or 0)) / SECOND
        text = f"{gaps} step(s) longer than {gap:g} times the median of {stamps.median:.4g} s, "
        text += f"the longest {stamps.longest / SECOND:.4g} s at {at:.6g} s; not bridged"
        found.append(Finding("warning", where, "gap", text))
    if doubt:
        found.append(Finding("warning", where, "unit of time", doubt))
    return found


def time_doubt(stamps: StampSurvey) -> str:
    """Doubt about the unit of stamps that a person wrote down, by their size; empty if none."""
    seen, scale = (stamps.far, stamps.unit) if stamps.far else (stamps, 1.0)
    median, first = seen.median * scale, (seen.first or 0) / SECOND * scale
    others = {u: f / stamps.unit for u, f in _UNITS.items() if f != stamps.unit}
    dates = [u for u, f in others.items()
             if _DATES[0] < first * f < _DATES[1] and 2e-6 <= median * f <= _SLOWEST]  # fmt: skip
    usual = (_FAST if dates else 2e-6) <= median <= _SLOW and not stamps.far
    if usual or not math.isfinite(median):
        return ""
    likely = [u for u, f in others.items() if 2e-6 <= median * f <= 1.0]
    fit = [*dates, *likely, "another"][0]
    if median < _SLOW and _DAYS[0] < first < _DAYS[1]:
        fit = "d (days, as spreadsheets and MATLAB count them)"
    return f"a median step of {median:.4g} s from {first:.4g} s on; is its unit perhaps {fit}?"


@dataclass(frozen=True)
class Sizes:
    """Size of a quantity in SI units.

    Attributes:
        unit: Unit as written in the mapping or the file.
        si: SI unit of the same dimension.
        factor: Factor from the unit to the SI unit.
        mean: Mean of each component, (n,) [si].
        rms: Root mean square of each component, (n,) [si].
        largest: Largest magnitude of any component [si].
        still: Whether all components are noise about their means.
        beside: Largest magnitude of the other numbers of its stream in the same unit [si].
    """

    unit: str
    si: str
    factor: float
    mean: Array
    rms: Array
    largest: float
    still: bool = False
    beside: float = 0.0


def sizes_of(
    values: ValueSurvey,
    places: list[int],
    unit: str,
    offset: ArrayLike = 0.0,
    *,
    others: Sequence[int] = (),
) -> Sizes:
    """Size of a quantity.

    Args:
        values: Statistics of the stream that holds it.
        places: Its components among the numbers of the stream.
        unit: Unit of the numbers.
        offset: Zero of the sensor, a number or one for each component, (n,) [unit].
        others: Numbers of the stream in the same unit.

    Raises:
        LogError: If the unit is unknown, or does not only scale.
    """
    factor, si = conversion(unit, None, "unit")
    zero = np.asarray(offset, float)
    ends = np.array([values.low[places], values.high[places]]) - zero
    beside = np.abs([values.low[list(others)], values.high[list(others)]])
    return Sizes(
        unit,
        si,
        factor,
        (values.mean[places] - zero) * factor,
        values.rms[places] * abs(factor),
        float(np.abs(ends).max()) * abs(factor),
        bool(values.noise[places].all()),
        float(beside[np.isfinite(beside)].max(initial=0.0)) * abs(factor),
    )


def is_still(sizes: Sizes) -> bool:
    """Whether a quantity is a specific force that does not change: the sensor is at rest."""
    change = np.sqrt(np.maximum(sizes.rms**2 - sizes.mean**2, 0.0))
    vector = sizes.si == "m/s^2" and len(sizes.rms) == 3
    return vector and bool(np.linalg.norm(change) < _REST * np.linalg.norm(sizes.rms))


def unit_findings(where: str, sizes: Sizes, *, still: bool = False) -> list[Finding]:
    """Finding that a quantity does not have the size that its unit suggests.

    Args:
        where: Name of the quantity.
        sizes: Its size.
        still: Whether the log has a specific force that does not change.
    """
    written = sizes.largest / sizes.factor
    guess = ""
    if sizes.si == "m/s^2":
        guess = _acceleration_guess(sizes)
    elif sizes.si == "rad/s" and sizes.unit != "rpm":  # of a motor
        if sizes.largest > _FASTEST or (still and _is(sizes, 1.0) and sizes.rms.max() > _NOISY):
            guess = "deg/s"
        elif not still and _is(sizes, math.radians(1)) and 0.3 < written < 6.5:
            guess = "rad/s" * _moves(sizes, _FASTEST)
    elif sizes.si == "rad":
        swings = bool((np.abs(sizes.mean) < 0.2 * sizes.largest).all())  # and does not turn on
        if _is(sizes, 1.0) and sizes.largest > (1 if swings else 2) * math.pi * 1.01:
            guess = "deg"
        elif _is(sizes, math.radians(1)) and 0.2 < written < 3.3 and _moves(sizes, 6.5):
            guess = "rad"
    elif sizes.si == "m":
        if sizes.largest > _FARTHEST:
            guess = "mm"
        elif _is(sizes, 1e-3) and 0.02 < written < 20.0 and _moves(sizes, 20.0):
            guess = "m"
    elif sizes.si == "m/s" and sizes.largest > _QUICKEST:
        guess = "mm/s"
    if not guess or _is(sizes, conversion(guess, None, "unit")[0]):  # and is in it
        return []
    size = float(np.linalg.norm(sizes.rms)) / sizes.factor
    text = f"in {sizes.unit} it reaches {written:.4g} (rms {size:.4g}); is it in {guess}?"
    return [Finding("warning", where, "unit", text)]


def _moves(sizes: Sizes, most: float) -> bool:
    """Whether the channel varies, and the channels beside it would fit the larger unit too."""
    return not sizes.still and sizes.beside <= most * sizes.factor


def _acceleration_guess(sizes: Sizes) -> str:
    vector = len(sizes.rms) == 3
    size = float(np.linalg.norm(sizes.rms)) if vector else abs(float(sizes.mean[0]))
    if not size or (size > 0.5 * GRAVITY and size < 3.0 * GRAVITY):
        return ""
    written = size / sizes.factor
    ones = {"m/s^2": GRAVITY, "g_0": 1.0, "mm/s^2": 1e3 * GRAVITY, "mg_0": 1e3}
    return next((u for u, one in ones.items() if 1 / _CLOSE < written / one < _CLOSE), "")


def number_findings(
    where: str, values: ValueSurvey, places: list[int], constant: str = "warning"
) -> list[Finding]:
    """Findings that numbers of a quantity are missing or not finite, or that it never changes.

    Args:
        where: Name of the quantity.
        values: Statistics of the stream that holds it.
        places: Its components among the numbers of the stream.
        constant: Level of the finding that it never changes; empty for none.
    """
    found, count, missing = [], values.count[places], values.missing[places]
    low, high = values.low[places], values.high[places]
    if lost := int(np.max(missing, initial=0)):
        total = int(np.max(count + missing))
        text = f"{lost} of {total} rows are no finite number; not used"
        found.append(Finding("warning", where, "missing numbers", text))
    if constant and places and ((count > 1) & (low == high)).all():
        text = f"never changes from {', '.join(f'{v + 0.0:.6g}' for v in low)}"
        found.append(Finding(constant, where, "constant", text))
    return found


def _is(sizes: Sizes, factor: float) -> bool:
    return abs(sizes.factor / factor - 1.0) < 1e-6

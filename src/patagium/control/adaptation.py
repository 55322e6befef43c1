"""Adaptive control: the model of the air relearns in flight, and the orbit follows it.

Once a beat the intervals that were flown are compared with what the model makes of them, by the
map of the flight and its exact derivatives by the weights of `LearnedAir`. The weights follow by
least squares that forget, the orbit is trimmed anew with them, and neutral values of the commands,
reference and gains follow the orbit: what integral action would do, for any cause that shows in
the motion (a wing that was cut, another polar, a weight that was never weighed, wind). A wing cut
in flight takes its mass along, which no weight of the air explains: what repeats within the beat
jumps, and the cut is sought that explains it. Gusts are told from what stays (`Disturbance`).
Neglected: what neither explains, which is noise to the weights; errors of the measured state.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import fdtri

from patagium.aerodynamics import AddedMass, Aerodynamics
from patagium.aerodynamics.learned_air import WRENCH, LearnedAir
from patagium.arguments import checked
from patagium.arrays import Array, real_array
from patagium.control.events import WingLossEvent
from patagium.control.orbit import NoOrbit, Orbit
from patagium.control.predictive import OrbitController, OuterController
from patagium.control.trimming import trim
from patagium.control.wingbeat import FlightMap, PrescribedRows
from patagium.errors import ParameterError
from patagium.simulation.simulator import FlightState, check_robots

EFFECTIVENESS_STD, WRENCH_STD = 0.15, 0.3
"""Standard deviations before any flight: of the effectiveness of a strip [1], and of the force
over the weight and the moment over weight times mean chord."""
NOISE_SHARE = 0.1
"""Standard deviation of the noise of an interval over what the strips do in it, at least."""
MEMORY = 10.0
"""Beats that are remembered, where nobody says."""
STIFFNESS = MappingProxyType({"roll": 0.1, "pitch": 0.1, "velocity of y": 0.1})
"""Changes of states of the orbit [rad, m/s] that weigh as much as a gait parameter changed by 0.3:
the commands rather than the attitude make up for what changed."""

SURPRISE = 6.0
"""Mean square of what differs within a beat, over that of the beats before, which the weights
cannot explain."""
FORGOTTEN = 0.8
"""Share of what was learned that is forgotten where a cut is found: what made up for the errors of
the model on one orbit does less so on another."""
UNLIKELY = 0.001
"""Probability that a disturbance without constant part is taken for a model that is wrong."""
DISTURBANCE_BEATS, SETTLED, LASTING = 50, 10, 0.95
"""Beats over which a disturbance is averaged, and before it is known; its correlation from one beat
to the next, at most and before it is known."""
RIPPLE_BEATS = 5.0
"""Beats over which the size of what differs within a beat is averaged."""
HARM, TRIAL, FIRST_PAUSE = 2.0, 5, 20
"""Mean square departure from the orbit that is followed, over that without weights, from which on
weights do harm; beats after which that is judged, and which first pass until they are tried again.
"""
LARGEST_CUT, LEAST_CUT = 0.6, 4
"""Largest share of a wing's span that is sought as lost; intervals of the cut wing, at least."""


class AirWeights:
    """Weights of `LearnedAir`, learned by least squares that forget.

    With y = H w + noise of a beat, both over the standard deviation of the noise,

        L <- c L + (1 - c) L0 + H'H,  b <- c b + (1 - c) L0 w0 + H'y,  w = L^-1 b

    minimizes the errors of all beats, forgotten by c = 1 - 1/memory a beat, and the distance from
    the prior, which is never forgotten: what the motion does not tell goes back to it.

    Args:
        prior: Weights before any flight, w0, (n_w,) [1, N, N m].
        stds: Their standard deviations, (n_w,) [1, N, N m].
        memory: Beats that are remembered.

    Attributes:
        weights: Estimate, (n_w,) [1, N, N m].

    Raises:
        ShapeError: If there is not a deviation for each weight.
        ParameterError: If the memory is not longer than a beat, or the prior none.
    """

    @checked
    def __init__(self, prior: ArrayLike, stds: ArrayLike, memory: float) -> None:
        if not memory > 1.0:
            raise ParameterError("memory", "more than one beat", memory)
        self.prior = real_array("prior", prior, ("N",)).copy()
        self.stds = real_array("stds", stds, self.prior.shape).copy()
        with np.errstate(all="ignore"):
            self._own = np.diag(self.stds**-2.0)
            self._information, self._vector = self._own.copy(), self._own @ self.prior
        if not ((self.stds > 0).all() and np.isfinite([*self._own, self._vector]).all()):
            expected = "a finite number and a positive deviation for each weight"
            raise ParameterError("prior and stds", expected, np.array([self.prior, self.stds]))
        self.weights, self._kept = self.prior.copy(), 1 - 1 / memory
        self._errors, self._count = np.zeros(2), 0.0

    @property
    def better(self) -> bool:
        """Whether the weights predicted the beats that came better than the prior did."""
        return bool(self._errors[0] < self._errors[1])

    @checked
    @np.errstate(all="ignore")
    def learn(self, slopes: ArrayLike, measured: ArrayLike, alike: float = 1.0) -> None:
        """Take the samples of a beat.

        Args:
            slopes: H, (N, n_w) [1].
            measured: y, (N,) [1].
            alike: Beats in a row that are alike: the memory is so many times as long.

        Raises:
            ShapeError: If the samples are not of these weights; nothing is learned then.
            ParameterError: If a number or its square is not finite, or `alike` is below one.
        """
        h = real_array("slopes", slopes, ("N", len(self.prior)))
        y = real_array("measured", measured, (len(h),))
        told, seen = h.T @ h, h.T @ y
        if not (alike >= 1 and np.isfinite([*told, seen]).all() and np.isfinite(y @ y)):
            expected = "finite numbers with finite squares, and of one beat at least"
            raise ParameterError("slopes, measured and alike", expected, (slopes, measured, alike))
        errors = [np.sum((y - h @ w) ** 2) for w in (self.weights, self.prior)]
        self.forget((1.0 - self._kept) / alike)
        self._errors += errors
        self._count += len(y)
        self._information += told
        self._vector += seen
        self.weights = np.asarray(np.linalg.solve(self._information, self._vector), float)

    @checked
    def forget(self, share: float) -> None:
        """Forget a share, 0 to 1, of what the beats told, as where the robot is another now.

        Raises:
            ParameterError: If it is no such share.
        """
        if not 0 <= share <= 1:
            raise ParameterError("share", "a number from 0 to 1", share)
        self._information += share * (self._own - self._information)
        self._vector += share * (self._own @ self.prior - self._vector)
        self._errors *= 1 - share
        self._count *= 1 - share
        self.weights = np.asarray(np.linalg.solve(self._information, self._vector), float)

    def differ(self, others: ArrayLike) -> bool:
        """Whether the weights differ from others, (n_w,) [1], by more than a standard deviation.

        That is of the errors made of late, where these are smaller than the noise.
        """
        gap = self.weights - real_array("others", others, self.weights.shape)
        variance = min(1.0, self._errors[0] / max(self._count, 1.0))
        return bool(gap @ self._information @ gap > len(gap) * variance)


class Disturbance:
    """Gusts: what comes and goes over several beats, no change of the robot's own air.

    What the design model misses of the mean of a beat has a constant part, the model's error, and
    one that varies. A beat is learned from with the variance of the second part times the number
    of beats that are alike, (1 + rho) / (1 - rho), with rho the correlation of a beat with the
    next, freed of its bias in few beats (Marriott and Pope 1954); that many beats tell no more
    than one, and the test of the first part has so many degrees of freedom less. Before `SETTLED`
    beats have told of it, rho is taken to be high, and the design model to be right. Neglected:
    gusts that last longer than `DISTURBANCE_BEATS`.

    Attributes:
        alike: Beats that are alike, by velocity, (velocities,) [1]; one at first.
        variance: Of the mean of a beat, (velocities,) [(m/s)^2, (rad/s)^2]; zero at first.
    """

    def __init__(self) -> None:
        self._missed: deque[Array] = deque(maxlen=DISTURBANCE_BEATS)
        self._mean = self.variance = np.zeros(1)
        self.alike = np.ones(1)

    @property
    def stays(self) -> bool:
        """Whether the constant part is more than the mean of what varies."""
        beats = max(1, len(self._missed))
        squares = self._mean**2 / np.maximum(self.variance / beats, 1e-300)
        size = len(self._mean)
        told = beats / float(np.mean(self.alike))
        return bool(squares.sum() > size * fdtri(size, told, 1 - UNLIKELY))

    def take(self, missed: Array) -> None:
        """Take what the design model misses of the mean of a beat, (velocities,) [m/s, rad/s]."""
        self._missed.extend([missed] if self._missed else [0 * missed, missed])
        beats = len(self._missed)
        self._mean = np.mean(self._missed, axis=0)
        apart = np.array(self._missed) - self._mean
        square = (apart**2).mean(axis=0)
        lagged = (apart[1:] * apart[:-1]).sum(axis=0) / beats
        told = lagged / np.where(square > 0, square, 1.0)
        told = np.minimum(told + (1 + 4 * told) / beats, LASTING)
        rho = np.clip(told + (LASTING - told) * SETTLED / (beats + SETTLED), 0.0, LASTING)
        self.alike = (1 + rho) / (1 - rho)
        self.variance = square * self.alike


class Departures:
    """Mean square departure from the reference orbit, with learned weights and without.

    A gust that lasts may be predicted well, one beat after the other, by weights on whose orbit the
    robot flies badly. Only the flight tells. Weights that do harm are left for some beats, for
    twice as many each time. Neglected: that gusts may be stronger while weights are followed.

    On the way to a new orbit the departure falls, and nothing is judged.

    Attributes:
        pause: Beats for which weights are not followed.
    """

    def __init__(self) -> None:
        self.pause, self._next = 0, FIRST_PAUSE
        self._without, self._with = [0.0, 0], [0.0, 0]  # mean square [1], beats

    def take(self, square: float, followed: bool) -> bool:
        """Take the square of a beat's mean departure [1], and say whether weights do harm."""
        mean, memory = self._without, DISTURBANCE_BEATS
        if followed:
            mean, memory = self._with, TRIAL
        else:
            self.pause = max(0, self.pause - 1)
            self._with = [0.0, 0]
        mean[1] += 1
        mean[0] += (square - mean[0]) / min(mean[1], memory)
        known = min(self._with[1], self._without[1]) >= TRIAL
        worse = self._with[0] > HARM * self._without[0] and square >= self._with[0]
        if known and worse:
            self.pause, self._next = self._next, 2 * self._next
        return known and worse


class _Beat(NamedTuple):
    """Samples of a beat for the weights, y = H w, interval by interval.

    Attributes:
        slopes: H, (m, velocities, n_w) [SI].
        measured: y, (m, velocities) [m/s, rad/s].
    """

    slopes: Array
    measured: Array


def _neutral(air: Aerodynamics) -> Array:
    """Weights of `LearnedAir` with which it is a model without states, (n_w,) [1, N, N m]."""
    if air.state_size:
        raise ParameterError("air", "air without states of its own (quasi-steady)", air.name)
    return np.asarray(LearnedAir(air).weights)


class AdaptiveController(OuterController):
    """Controller along an orbit that follows a model of the air, which relearns in flight.

    The model is used where it predicted better than the design model, within bounds: an
    effectiveness from 0 to 2, a force up to the weight. Where it has no orbit, or none that the
    commands can hold, the one before is followed on. A beat that differs from the others within
    itself more than any weights explain (`SURPRISE`) teaches nothing; each wing is cut in the model
    then, of air and masses alike, as far and from that interval on as explains it best. Where no
    cut does, nothing is learned until beats are explained again, and from the second such beat on
    the orbit is that without weights. So it is, too, where the flight departs from the orbit of the
    weights by more than it did without them (`Departures`).

    Args:
        controller: Controller along an orbit, whose robot and air are the design model.
        memory: Beats that are remembered.

    Raises:
        ParameterError: If the memory is not longer than a beat, the air has states of its own, or
            the controller follows no `Orbit` or has no command but the frequency.

    Attributes:
        learner: Weights of the air as they are learned.
        learning: Whether it learns; it may be switched on the way.
        weights: Weights of the orbit that is followed.
        orbit: Orbit that is followed.
        counts: Number of beats by what became of the orbit, and of the model.
    """

    @checked
    def __init__(self, controller: OrbitController, *, memory: float = MEMORY) -> None:
        model, orbit = controller.model, controller.model.orbit
        if not isinstance(orbit, Orbit):
            raise ParameterError("controller", "one along an orbit of pt.trim", orbit)
        if model.commands == ("frequency",):
            raise ParameterError("commands", "one beside the frequency", model.commands)
        self.controller, self._design, self._memory = controller, orbit, memory
        robot, ones = orbit.robot, np.ones(len(orbit.robot.strips))
        lever = float(np.mean([strip.chord for strip in robot.strips]))
        wrench = robot.scale_gravity * robot.mass * np.array([1.0, 1.0, lever])
        self._stds = np.r_[EFFECTIVENESS_STD * ones, WRENCH_STD * wrench]
        self._least, self._most = np.r_[0 * ones, -wrench], np.r_[2 * ones, wrench]
        self.learning = True
        self._begin()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} around {self.controller!r}>"

    def _begin(self) -> None:
        """Know the design model alone."""
        self.orbit, self._air, self._surprised = self._design, self._design.aero, False
        self.weights = _neutral(self._air)
        self.learner = AirWeights(self.weights, self._stds, self._memory)
        self._samples: dict[int, Array] = {}
        self._ripple: Array | None = None
        self._disturbance = Disturbance()
        self._departures = Departures()
        self.counts: Counter[str] = Counter()
        self._reason, self._failures, self._pause = "", 0, 0

    def restart(self) -> None:
        """Start anew, with nothing learned; see `OrbitController.restart`."""
        self.controller.restart()
        self._begin()

    def __call__(self, time: float, state: FlightState | None) -> dict[str, float]:
        """Commands for the interval that begins now; see `OrbitController`."""
        if self.controller.begins(time):
            self.restart()
        first, parts = self.model.number(time), self.model.parts
        if state is not None and abs(time - state.time) <= 0.5 * self.period:
            self._samples[first] = self.controller.measured(state, first)
        if first % parts == 0:
            if self.learning and first:
                self._relearn(first)
            self._samples = {k: x for k, x in self._samples.items() if k == first}
        return self.controller(time, state)

    def report(self) -> str:
        """Sentences about the samples that were held and the orbits that were found."""
        found = ", ".join(f"{count} {what}" for what, count in sorted(self.counts.items()))
        told = f"{self.controller.report()} Orbits of the beats: {found or 'none yet'}."
        if not self.counts["moved"] and (self._reason or self.counts["kept"]):
            why = f"its first orbit: {self._reason}" if self._reason else "what it saw may be gusts"
            told += f" The learned model was never followed; {why}."
        return told

    @checked
    def take(self, air: Aerodynamics) -> None:
        """Replace robot and air of the model, for example after a known loss of a wing tip.

        Most of what was learned is forgotten, and the beat so far teaches nothing.

        Raises:
            ParameterError: If the air is another robot's, has states of its own, or is learned.
        """
        check_robots(self._air.robot, air)
        _neutral(air)
        self._surprised = False
        self._departures = Departures()
        self._samples.clear()
        self._change(air)

    def _change(self, air: Aerodynamics) -> None:
        self._air, self._disturbance = air, Disturbance()
        self._failures = self._pause = 0
        self.learner.forget(FORGOTTEN)

    def use(self, weights: Array, first: int) -> bool:
        """Follow the orbit of other weights, (n_w,) [1, N, N m], from the interval `first` on.

        It says whether there is one.
        """
        design = self._design
        found = trim(
            self._air.robot,
            LearnedAir(self._air, weights),
            design.gait,
            free=self.model.commands,
            **{k: getattr(design, k) for k in ("speed", "climb", "turn_rate")},
            start=design,
            added_mass=self._added_mass(self._air),
            tolerable={k: size for k, size in STIFFNESS.items() if k in design.names},
        )
        if isinstance(found, NoOrbit):
            return self._failed("not found", found.reason)
        try:
            self.controller.follow(found, found.parameters, first)
        except ParameterError as error:
            return self._failed("not held by the commands", str(error))
        self.counts["moved"] += 1
        self._failures = 0
        self.orbit, self.weights = found, np.asarray(weights)
        return True

    def _failed(self, what: str, reason: str) -> bool:
        """Count a failed search; from the third in a row on searches pause, ever longer."""
        self.counts[what] += 1
        self._reason = self._reason or reason
        self._failures += 1
        self._pause = 2 ** min(self._failures, 12) // 8
        return False

    def _relearn(self, first: int) -> None:
        """Learn from the beat that ends, and follow the model where it is another."""
        beat = self._flown(first, self._air)
        if beat is None:
            self.counts["without samples"] += 1
            return
        surprise = self._surprise(self._missed(beat), beat)
        followed = not np.array_equal(self.weights, self.learner.prior)
        if self._departures.take(self._departed(first), followed):
            self.counts["weights did harm"] += 1
        if surprise > SURPRISE:
            self._departures = Departures()
            again, self._surprised = self._surprised, True
            if self._cut(first, beat, surprise):
                self.use(self._wanted(), first)
            else:
                self.counts["beyond the model"] += 1
                if again and followed:
                    self.use(self.learner.prior, first)
            return
        self._surprised = False
        self.learner.learn(*self._whitened(beat), float(np.mean(self._disturbance.alike)))
        wanted = self._wanted()
        if np.array_equal(wanted, self.weights) and self.orbit.robot is self._air.robot:
            self.counts["kept"] += 1
        elif self._pause:
            self._pause -= 1
            self.counts["not sought after failures"] += 1
        elif self.use(wanted, first) and wanted is self.learner.prior:
            self.counts["without weights"] += 1

    def _wanted(self) -> Array:
        """Weights to follow: those learned where they predict better and are others."""
        learner = self.learner
        if self._departures.pause or not (self._disturbance.stays and learner.better):
            return learner.prior
        if not learner.differ(self.weights):
            return self.weights
        return np.asarray(np.clip(learner.weights, self._least, self._most))

    def _cut(self, first: int, whole: _Beat, surprise: float) -> bool:
        """Whether the cut of a wing explains the beat before an interval; it is taken over then.

        The cut may have happened within the beat: its intervals are those of the whole wing, one
        that is left out, and at least `LEAST_CUT` of the cut wing. It explains the beat where what
        is left is no surprise, and a quarter at most: some cut always takes a part of a gust.
        """
        from scipy.optimize import minimize_scalar  # slow to import, rarely needed

        found: list[tuple[float, Aerodynamics]] = []
        before = self._missed(whole)
        for wing in self._air.robot.wing_names:

            def without(share: float, wing: str = wing) -> float:
                loss = WingLossEvent(time=0.0, wing=wing, share=share)
                air = loss.changed(self._air.robot, self._air)[1]
                beat, least = self._flown(first, air), np.inf
                if beat is not None and len(beat.measured) == len(before):
                    after = self._missed(beat)
                    cuts = range(1, len(after) - LEAST_CUT)
                    ways = [after, *(np.vstack([before[:k], after[k + 1 :]]) for k in cuts)]
                    least = min(self._surprise(way, whole) for way in ways)
                found.append((least, air))
                return least

            minimize_scalar(without, bounds=(0.0, LARGEST_CUT), options={"xatol": 0.005})
        least, air = min(found, key=lambda one: one[0])
        if not least <= min(SURPRISE, surprise / 4):
            return False
        self._change(air)
        self.counts["cut of a wing found"] += 1
        return True

    def _departed(self, first: int) -> float:
        """Square of the mean departure from the orbit in the beat before an interval [1]."""
        model, samples = self.model, self._samples
        beat = range(first - model.parts, first)
        apart = [model.course.apart(k, samples[k]) for k in beat if k in samples]
        kept = np.mean(apart, axis=0)[model.kept]
        return float(self.controller.weights[: len(kept)] @ kept**2)

    def _missed(self, beat: _Beat) -> Array:
        """Misfit of each interval that the weights leave, (m, velocities) [m/s, rad/s]."""
        return beat.measured - beat.slopes @ self.learner.weights

    def _surprise(self, missed: Array, beat: _Beat) -> float:
        """Mean square of what differs within a beat over that of the beats before; 0 at first."""
        if self._ripple is None:
            return 0.0
        return float((missed.var(axis=0) / (self._noise(beat) ** 2 + self._ripple)).mean())

    def _noise(self, beat: _Beat) -> Array:
        """Lower bound of the standard deviation of the noise in an interval, (velocities,)."""
        strips = slice(0, len(self.weights) - len(WRENCH))
        own = ((beat.slopes * self.learner.prior)[:, :, strips] ** 2).sum(axis=2).mean(axis=0)
        return np.asarray(NOISE_SHARE * np.sqrt(own))

    def _added_mass(self, air: Aerodynamics) -> AddedMass | None:
        """Inertia of the air around the robot of a model of the air, or None."""
        added = self._design.added_mass
        return None if added is None else replace(added, robot=air.robot)

    def _flown(self, first: int, air: Aerodynamics) -> _Beat | None:
        """Intervals of the beat before an interval whose ends were measured; None without any."""
        model, course, samples = self.model, self.model.course, self._samples
        places = range(first - model.parts, first)
        begin = np.array([samples.get(k, course.along(k)) for k in places])
        end = np.array([samples.get(k + 1, course.along(k + 1)) for k in places])
        learned = LearnedAir(air, self.weights)
        flight = FlightMap(air.robot, learned, self._added_mass(air), learned.weight_names)
        steps = -(-self.orbit.steps // model.parts)
        flown = flight.fly(begin, self._steered(model.time(places[0]), steps))
        moving = [k for k, name in enumerate(model.names) if name.startswith("velocity of ")]
        missed = course.seen(places[0], end - flown.ends)[:, moving]
        slopes = course.seen(places[0], flown.by_parameter.transpose(0, 2, 1))
        slopes = slopes.transpose(0, 2, 1)[:, moving]
        known = np.array([k in samples and k + 1 in samples for k in places])
        known &= np.isfinite(missed).all(axis=1) & np.isfinite(slopes).all(axis=(1, 2))
        if not known.any():
            return None
        return _Beat(slopes[known], missed[known] + slopes[known] @ self.weights)

    def _steered(self, time: float, steps: int) -> PrescribedRows:
        """Rows of a beat from a time [s] on, so many steps an interval, as the gait was steered."""
        step = self.period / steps
        times = time + 0.5 * step * np.arange(2 * steps * self.model.parts + 1)
        wind = self._design.aero.air.uniform_wind_at(times)
        table = np.column_stack([*self.model.steered.motion(times), wind])
        none = np.zeros((len(table), 0, table.shape[1] - 3))
        return PrescribedRows(table, none, step, np.zeros(0))

    def _whitened(self, beat: _Beat) -> tuple[Array, Array]:
        """H and y of a beat over their noise: its mean, and what differs from that.

        What models of the air differ in within a beat repeats and is no white noise: its size is
        taken from the beats, and those of a memory tell no more than one, else they would set
        the weights, and these the mean. The mean, which moves the flight, has the noise of its
        samples and that of the disturbance.
        """
        noise, ripple = self._noise(beat), self._missed(beat).var(axis=0)
        slopes, measured = (part.mean(axis=0) for part in beat)
        within, apart = beat.slopes - slopes, beat.measured - measured
        former = ripple if self._ripple is None else self._ripple
        self._ripple = former + (np.minimum(ripple, 2.0 * former) - former) / RIPPLE_BEATS
        self._disturbance.take(measured - slopes @ self.learner.prior)
        std = np.sqrt(self._memory * self.model.parts * (noise**2 + self._ripple))
        of_mean = np.sqrt(noise**2 / len(apart) + self._disturbance.variance)
        whole = np.vstack([slopes[None] / of_mean[:, None], within / std[:, None]])
        told = np.vstack([measured / of_mean, apart / std])
        return whole.reshape(-1, len(self.weights)), told.ravel()

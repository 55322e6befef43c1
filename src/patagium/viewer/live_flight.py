"""A simulation in its own time, shown, steered, and learned from as it flies.

Short pieces of flight are integrated as the clock goes; where that takes longer than it flies,
the flight falls behind and says so. Whatever time is left goes to a learner, along every sample
or as many as keep pace. Other load of the
machine is not measured.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from patagium.arrays import Array
from patagium.errors import Outcome
from patagium.learning.models.network import flight_terms
from patagium.live.loop import Counters
from patagium.live.pipeline import Pipeline, Records
from patagium.robot import Robot
from patagium.simulation.gait_models import Gait
from patagium.simulation.runge_kutta import times_of
from patagium.simulation.simulator import Simulator
from patagium.simulation.steered_gait import SteeredGait
from patagium.viewer.live_frames import Feed, Steering, Subject, counted, records_without_learner
from patagium.viewer.live_view import PERIOD, LiveView

LONGEST = 0.03
"""Flight that is integrated in one piece at most [s]."""
_NAP = 0.008  # s between pieces: shorter ones cost more than they show
_BEHIND = 0.2  # s after which lost time is given up
_MOST_AMPLITUDE, _FASTEST, _SLOWEST = 2.0, 3.0, 0.1  # over the gait's own
_MEMORY = 5_000.0  # samples that running scores reach back
_SHARE = 0.8  # of the time that integration leaves, for learning


def flight_subject(robot: Robot, gait: Gait, pipeline: Pipeline | None) -> Subject:
    """Subject of the page of a simulation.

    Args:
        robot: The machine.
        gait: Gait; it cannot be steered if it stands still.
        pipeline: Pipeline that learns; None where nothing is learned.
    """
    network = None if pipeline is None else pipeline.learner.network
    outputs = robot.dof_names if network is None else network.output_names
    steering = None
    if gait.period:
        most = min(_MOST_AMPLITUDE, SteeredGait(robot, gait).largest_amplitudes.min(initial=np.inf))
        own = 1.0 / gait.period
        steering = Steering(own, _SLOWEST * own, _FASTEST * own, max(1.0, most))
    title = f"{robot.name}: flying" + ("" if network is None else " and learning")
    return Subject(robot, tuple(outputs), network, title, gait.period, steering, strips=True)


class LiveFlight:
    """Flight in real time.

    Args:
        start: Begins a flight with a gait.
        robot: The machine.
        gait: Gait until it is steered.
        time_step: Step of the integrator [s].
        view: The page.
        subject: Subject of the page.
        pipeline: Pipeline that learns; None where nothing is learned.
        every: Samples from which one at most is learned.
    """

    def __init__(
        self,
        start: Callable[[Gait], Simulator],
        robot: Robot,
        gait: Gait,
        time_step: float,
        view: LiveView,
        subject: Subject,
        pipeline: Pipeline | None = None,
        every: int = 1,
    ) -> None:
        self._start, self._own = start, gait
        self._step, self._view, self._pipeline = time_step, view, pipeline
        self._steering = subject.steering
        network = subject.network
        self._feels_added_mass = network is None or not flight_terms(network).added_mass
        self._felt = [robot.index(name) for name in subject.outputs]
        learner = None if pipeline is None else pipeline.learner
        self._feed = Feed(view.letters, subject, learner)
        self._counters = Counters(len(subject.outputs), _MEMORY)
        self._every, self._share = every, every
        self._resets, self._paused = 0, False
        self._asked = (0.0, 0.0) if self._steering is None else (self._steering.frequency, 1.0)
        self._first = self._asked
        self._flown_for = self._learned_for = float("nan")  # processor time a step, a sample
        self._begin()

    def fly(self, stop: threading.Event, look: Callable[[], object] | None = None) -> xr.Dataset:
        """Fly to the end, or until `stop` is set; the flight since it last began.

        Returns:
            What was flown.
        """
        due = 0.0
        while not stop.is_set() and not self._over:
            self._obey()
            steps = self._steps_due()
            if steps:
                self._advance(steps)
            now = time.monotonic()
            if now >= due:
                self._post()
                due = now + PERIOD
                if look is not None:
                    look()
            if not steps:
                stop.wait(_NAP)
        self._post()
        return self._simulator.flight()

    @property
    def _over(self) -> bool:
        return self._outcome is Outcome.COMPLETED and self._done >= self._simulator.steps

    def _begin(self) -> None:
        """Fly from the start, by the gait's own frequency, on the way to what is asked for."""
        self._simulator = self._start(self._own)
        self._gait = self._simulator.steered if self._steering else None
        self._done, self._outcome, self._said = 0, Outcome.COMPLETED, ""
        self._show(np.zeros(1), {k: part[:1] for k, part in self._simulator.run.samples.items()})
        if self._asked != self._first:
            self._steer(*self._asked)
        self._anchor()

    def _anchor(self) -> None:
        self._clock, self._from = time.monotonic(), self._simulator.time

    def _obey(self) -> None:
        """Do what was asked for on the page."""
        command = self._view.command
        if command is None:
            return
        if (paused := bool(command["paused"])) != self._paused:
            self._paused = paused
            self._anchor()
        asked = float(command["frequency"]), float(command["amplitude"])
        steering = self._steering
        if asked != self._asked and steering is not None and steering.allows(*asked):
            self._steer(*asked)
        if (resets := int(command["resets"])) != self._resets:
            self._resets = resets
            self._begin()

    def _steer(self, frequency: float, amplitude: float) -> None:
        self._asked = frequency, amplitude
        self._simulator.command({"frequency": frequency, "amplitude": amplitude})

    def _steps_due(self) -> int:
        """Number of steps by which the flight is behind the clock."""
        if self._outcome is not Outcome.COMPLETED or self._paused:
            return 0
        behind = self._from + time.monotonic() - self._clock - self._simulator.time
        if behind > _BEHIND:
            self._anchor()
        return int(min(behind, LONGEST) / self._step)

    def _advance(self, steps: int) -> None:
        """Fly some steps, learn from them, and show what they brought."""
        began, before = time.thread_time(), self._done
        self._outcome = self._simulator.advance(steps)
        run = self._simulator.run
        self._done = run.steps
        if self._outcome is not Outcome.COMPLETED:
            self._said = self._simulator.message()
        if flown := run.steps - before:
            spent = (time.thread_time() - began) / flown
            self._flown_for = _running_mean(self._flown_for, spent)
            fresh = slice(before + 1, run.steps + 1)
            samples = {name: values[fresh] for name, values in run.samples.items()}
            times = times_of(fresh.start, flown, self._step)
            if self._pipeline is None:
                self._show(times, samples)
            else:
                self._learn(self._pipeline, times, samples)

    def _show(self, times: Array, samples: dict[str, Array]) -> None:
        """Show samples without a learner."""
        records = records_without_learner(samples["aero_force"][:, self._felt])
        self._feed.append(self._packets(times, samples), records)

    def _packets(self, times: Array, samples: dict[str, Array]) -> Array:
        """Packets that sensors would have sent, known forces beside the torque in u1."""
        self._strips = samples["strip_force"][-1]
        known = samples["u1"] + samples["mount_force"]
        if self._feels_added_mass and "added_mass_force" in samples:
            known = known + samples["added_mass_force"]
        return np.column_stack([times, samples["q"], samples["v"], samples["a"], known])

    def _learn(self, pipeline: Pipeline, times: Array, samples: dict[str, Array]) -> None:
        """Learn from as many samples as keep pace."""
        packets = self._packets(times, samples)
        chosen = packets[-round(times[0] / self._step) % self._share :: self._share]
        if not len(chosen):
            return
        began = time.thread_time()
        records: Records = pipeline.run(chosen)
        spent = (time.thread_time() - began) / len(chosen)
        self._learned_for = _running_mean(self._learned_for, spent)
        self._counters.add(records)
        self._feed.append(chosen, records)
        left = _SHARE * max(self._step - self._flown_for, 0.05 * self._step)
        self._share = max(self._every, math.ceil(self._learned_for / left))

    def _post(self) -> None:
        facts: dict[str, Any] = {
            "strip_force": self._strips,
            "share": self._share,
            "paused": self._paused,
            "ended": self._outcome is not Outcome.COMPLETED,
            "words": self._words(),
        }
        if self._gait is not None:
            facts["frequency"], facts["amplitude"] = self._gait.command_at(self._simulator.time)
        if self._pipeline is not None:
            facts |= counted(self._counters)
        self._feed.post(**facts)

    def _words(self) -> str:
        if self._outcome is not Outcome.COMPLETED:
            return f"The flight broke down; R flies again from the start. {self._said}"
        if self._over:
            return "The flight is over."
        return "Paused." if self._paused else ""


def _running_mean(before: float, now: float) -> float:
    """A running mean over about ten values."""
    return now if math.isnan(before) else 0.9 * before + 0.1 * now

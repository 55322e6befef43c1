"""Route of a flight along several orbits, such as straight on, through a turn, and straight on."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy

from patagium.arguments import checked
from patagium.control.orbit import Orbit
from patagium.control.predictive import OrbitController, OuterController
from patagium.errors import ParameterError, check_names
from patagium.robot import Robot
from patagium.simulation.gait_models import Gait
from patagium.simulation.mounts import Mount
from patagium.simulation.simulator import FlightState


class Route(OuterController):
    """Controller that switches from one orbit to the next at given times.

    At its time the orbit of each leg goes on from where the one before is, in its direction.
    Commands go there as fast as actuators do, the frequency too: the beat of the leg goes on from
    the phase of the one before, and `period`, which is a part of it, changes with it.

    Args:
        controller: Controller along the first orbit.
        legs: Orbit of each leg by the time at which it begins, rounded up to an interval of the
            controller [s]. It is found with the gait of the first orbit (`trim(gait=orbit.gait)`),
            and commands of the controller as free parameters.

    Raises:
        ParameterError: If a leg begins before the one before, has another robot, another gait
            or a free parameter that is no command, or cannot be followed by the controller.

    Attributes:
        legs: Orbit of each leg by its time [s].
    """

    @checked
    def __init__(self, controller: OrbitController, legs: Mapping[float, Orbit]) -> None:
        self._first = controller
        self.legs = dict(legs)
        self._legs: dict[float, tuple[Orbit, Mapping[str, float]]] = {}
        self.restart()
        for time, orbit in legs.items():
            if not time > max(self._legs, default=0.0):
                raise ParameterError("legs", "rising times, in seconds above 0", list(legs))
            name = f"legs: {time:g} s"
            self._legs[time] = orbit, self._parameters(name, orbit)
            try:
                self.controller.follow(*self._legs[time], self.model.number(time))
            except ParameterError as error:
                name = f"{name}: {error.name}"
                raise ParameterError(name, error.expected, error.found) from error
        self.restart()

    def _parameters(self, name: str, orbit: Orbit) -> Mapping[str, float]:
        """Values of the commands on the orbit of a leg; none where they stay neutral."""
        model = self._first.model
        if orbit.robot.dof_names != model.robot.dof_names:
            raise ParameterError(name, f"an orbit of {model.robot.name}", orbit.robot.name)
        if model.flies(orbit.gait):
            return {}
        if not model.flies(orbit.family.base):
            expected = "an orbit found with the gait of the first one (trim(gait=orbit.gait))"
            raise ParameterError(name, expected, orbit)
        check_names(f"{name}: free", orbit.parameters, model.commands, "of")
        return orbit.parameters

    def restart(self) -> None:
        """Start anew on the first orbit."""
        self.controller = copy(self._first)
        self.controller.restart()
        self._left = sorted(self._legs)

    def check_flight(self, robot: Robot, gait: Gait, mount: Mount) -> None:
        """Start anew, whose period a flight then takes, and refuse as `OrbitController` does."""
        self.restart()
        super().check_flight(robot, gait, mount)

    def report(self) -> str:
        """Sentences about the samples that were held and the legs that were begun."""
        begun = len(self._legs) - len(self._left)
        return f"{self.controller.report()} Legs begun: {begun} of {len(self._legs)}."

    def __call__(self, time: float, state: FlightState | None) -> dict[str, float]:
        """Commands for the interval that begins now; see `OrbitController`."""
        if self.controller.begins(time):
            self.restart()
        while self._left and self._left[0] <= time + 1e-6 * self.period:
            self.controller.follow(*self._legs[self._left.pop(0)], self.model.number(time))
        return self.controller(time, state)

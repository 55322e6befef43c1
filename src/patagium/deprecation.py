"""Old names of arguments and public names, which work for one release and warn; names removed.

Names whose home is another package, such as the laboratory, come from that package by the entry
point group `patagium.old_names`.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from typing import Any, TypeVar

from patagium.errors import ParameterError, similar
from patagium.plugins import OLD_NAMES, plugin

Call = TypeVar("Call", bound=Callable[..., Any])
Kind = TypeVar("Kind")


def with_new_names(
    given: Mapping[str, Any], names: Mapping[str, str], stacklevel: int = 3
) -> dict[str, Any]:
    """Arguments by their names of today.

    Args:
        given: Values by name of the argument.
        names: Old name to new name.
        stacklevel: Frames between the warning and the caller whose line it names.

    Raises:
        TypeError: If an argument is given by its old and its new name.
    """
    found = {name: value for name, value in given.items() if name not in names}
    for old in (name for name in given if name in names):
        if names[old] in given:
            raise TypeError(f"{old} is the old name of {names[old]}: give one of them")
        message = f"the argument {old} is called {names[old]}; the next release drops it"
        warnings.warn(message, DeprecationWarning, stacklevel=stacklevel)
        found[names[old]] = given[old]
    return found


def renamed_arguments(**names: str) -> Callable[[Call], Call]:
    """Decorator of a function that still takes old names of its keyword arguments.

    Args:
        **names: Old name to new name.
    """

    def decorated(call: Call) -> Call:
        @functools.wraps(call)
        def renaming(*args: Any, **given: Any) -> Any:
            if given.keys().isdisjoint(names):
                return call(*args, **given)
            return call(*args, **with_new_names(given, names))

        return renaming  # type: ignore[return-value]

    return decorated


def renamed_fields(**names: str) -> Callable[[type[Kind]], type[Kind]]:
    """Decorator of a class whose constructor still takes old names of its arguments.

    Args:
        **names: Old name to new name.
    """

    def decorated(kind: type[Kind]) -> type[Kind]:
        setattr(kind, "__init__", renamed_arguments(**names)(vars(kind)["__init__"]))  # noqa: B010
        return kind

    return decorated


_MOVED = {
    "patagium.air": """
        DrydenGust Indicial OneMinusCosineGust RampGust Section StallDelay TablePolar
        TravelingGust measured_section""",
    "patagium.errors": """
        CompilerError FilterDiverged FlightError LogError Outcome ParameterError PathError
        RobotFileError RobotFileWarning ShapeError SimulationFailed""",
    "patagium.learning": """
        ChangeDetection HiddenStripNetwork NoiseEstimation Screening""",
    "patagium.sensing": """
        ForceSamples Kalman MomentumObserver MotionTracker SavitzkyGolay SensorLog Spline
        cell_wrench estimate_shifts inspect_log load_cell_force load_sensor_log
        momentum_force motor_forces save_sensor_log""",
}
"""Names that stood at the top of the package, by their home."""
_DEFAULT = "the default, which errs less"
_REMOVED = {
    **dict.fromkeys(("FlowNetwork", "HiddenFlowNetwork"), f"LinearStripNetwork, {_DEFAULT}"),
    **dict.fromkeys(("flow", "hidden_flow"), f"linear_strip, {_DEFAULT}"),
    "LowRank": 'covariance="layer", which errs less',
    "low rank": "layer, which errs less",
    "residual network": "None: LinearStripNetwork learns what physics leaves, and errs less",
}
"""What takes the place of each network and structure that was removed, by class and by kind."""


@functools.cache
def former_names() -> dict[str, str]:
    """New dotted name of each name that stood at the top of the package."""
    homes = {home: names.split() for home, names in _MOVED.items()}
    return {name: f"{home}.{name}" for home, names in homes.items() for name in names}


def refuse_removed(where: str, name: object) -> None:
    """Error of a network or structure that was removed; nothing for any other name.

    Args:
        where: Module, option or key that names it.
        name: Class or kind of a network or covariance structure.

    Raises:
        ParameterError: If it was removed; the message says what to take in its place.
    """
    if isinstance(name, str) and name in _REMOVED:
        raise ParameterError(where, f"{_REMOVED[name]} ({name} was removed)", name)


def former_name(module: str, name: str, present: Iterable[str]) -> Any:
    """Object behind a former name of a module, with a warning that gives its new name.

    Args:
        module: Dotted name of the module that was asked.
        name: Attribute that was asked for.
        present: Names that the module has today, for a suggestion.

    Raises:
        AttributeError: If the module never had the name; it suggests a similar one.
        ParameterError: If what it names was removed.
    """
    refuse_removed(module, name)
    former = former_names()
    if name in former:
        home, _, attribute = former[name].rpartition(".")
        found = getattr(import_module(home), attribute)
    else:
        found = None if name.startswith("_") else plugin(OLD_NAMES, name)
        home, attribute = getattr(found, "__module__", ""), name
    if found is None:
        known = {word: former.get(word, word) for word in [*former, *present]}
        unknown = f"module {module!r} has no attribute {name!r}"
        raise AttributeError(unknown + similar(name, known))
    warnings.warn(f"{module}.{name} is now {home}.{attribute}", DeprecationWarning, stacklevel=3)
    return found

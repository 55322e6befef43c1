"""Former public names and the places where they are now.

A former name works for one release and warns. Names whose home is another package, such as the
laboratory, come from that package by the entry point group `patagium.old_names`.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from difflib import get_close_matches
from importlib import import_module
from typing import Any

from patagium.plugins import OLD_NAMES, plugin

_MOVED = {
    "patagium": {
        "patagium.air": """
            DrydenGust Indicial OneMinusCosineGust RampGust Section StallDelay TablePolar
            TravelingGust measured_section""",
        "patagium.errors": """
            CompilerError FilterDiverged FlightError LogError Outcome ParameterError PathError
            RobotFileError RobotFileWarning ShapeError SimulationFailed""",
        "patagium.learning": """
            ChangeDetection FlowNetwork HiddenFlowNetwork HiddenStripNetwork LowRank
            NoiseEstimation Screening""",
        "patagium.sensing": """
            ForceSamples Kalman MomentumObserver MotionTracker SavitzkyGolay SensorLog Spline
            cell_wrench estimate_shifts inspect_log load_cell_force load_sensor_log
            momentum_force motor_forces save_sensor_log""",
    },
    "patagium.identification": {
        "patagium.learning": """
            ChangeDetection CubatureLearner DenseNetwork ExtendedLearner FlowNetwork
            GradientLearner GreyBox HiddenFlowNetwork HiddenStripNetwork Identification
            LinearLearner LowRank Model NoiseEstimation Screening Settings StripNetwork Tuned
            evaluate evaluate_table identify identify_table learner_from_description
            load_identification load_learner load_model load_settings model_of network_for
            network_from_description refine save_learner save_model stream tune""",
        "patagium.live": "AutoSave Pipeline",
        "patagium.sensing": """
            ForceSamples Kalman MomentumObserver MotionTracker SavitzkyGolay Shifts Spline
            TableMapping cell_wrench estimate_motion estimate_shifts import_log inspect_log
            inverse_dynamics_force load_cell_force load_log load_mapping momentum_force
            motor_forces read_table training_data""",
    },
}
FORMER: dict[str, dict[str, str]] = {
    module: {name: f"{home}.{name}" for home, names in homes.items() for name in names.split()}
    for module, homes in _MOVED.items()
}
"""New dotted name of each former name, by the module that had it."""
FORMER["patagium.identification"]["Table"] = "patagium.sensing.LogTable"


def former_name(module: str, name: str, present: Iterable[str]) -> Any:
    """Object behind a former name of a module, with a warning that gives its new name.

    Args:
        module: Dotted name of the module that was asked.
        name: Attribute that was asked for.
        present: Names that the module has today, for a suggestion.

    Raises:
        AttributeError: If the module never had the name; it suggests a similar one.
    """
    former = FORMER[module]
    if name in former:
        home, _, attribute = former[name].rpartition(".")
        found = getattr(import_module(home), attribute)
    else:
        found = None if name.startswith("_") else plugin(OLD_NAMES, name)
        home, attribute = getattr(found, "__module__", ""), name
    if found is None:
        raise AttributeError(_unknown(module, name, present))
    warnings.warn(f"{module}.{name} is now {home}.{attribute}", DeprecationWarning, stacklevel=3)
    return found


def _unknown(module: str, name: str, present: Iterable[str]) -> str:
    """Sentence for an unknown name, with the most similar name that exists."""
    former = FORMER[module]
    known = {word.lower(): word for word in [*former, *present]}
    similar = get_close_matches(name.lower(), known, n=1)
    hint = ""
    if similar:
        word = known[similar[0]]
        hint = f"; did you mean {former.get(word, word)}?"
    return f"module {module!r} has no attribute {name!r}{hint}"

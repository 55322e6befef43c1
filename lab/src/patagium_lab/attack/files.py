"""Targets that are files: every format that the program reads, mutated from a valid file.

What is accepted must hold together: a log that was imported has rising time and finite numbers,
a robot a finite mass, a learner's file predicts as the one that was saved. Neglected: formats
read by plugins.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import patagium as pt
from patagium.cli.plan import event_of, load_plan
from patagium.errors import PatagiumError
from patagium.learning import load_identification, load_model, load_settings
from patagium.learning.learners.state_file import read_state, write_state
from patagium.robot.files import load_robot_text
from patagium.sensing.logs.importing.inspection import inspect_log
from patagium.sensing.logs.mapping import load_mapping
from patagium.sensing.logs.record import LogRecord, load_log
from patagium.sensing.sensors.sense import load_sensor_log
from patagium_lab.attack import seeds
from patagium_lab.attack.mutation import (
    HOSTILE,
    Draw,
    Mutation,
    mutated_bytes,
    mutated_json,
    mutated_table,
    mutated_text,
    mutated_tree,
    mutated_yaml,
)
from patagium_lab.attack.oracle import Target, WrongNumber
from patagium_lab.attack.recordings import recordings

Read = Callable[[Path], object]
Case = Callable[[Draw], object]
AREA = "files"
_NETCDF: dict[str, Read] = {
    "flight.nc": pt.load_flight,
    "identification.nc": load_identification,
    "imported log": load_log,
}
"""Readers of netCDF files whose content is attacked."""
_X = np.array([0.3, -0.2, 0.5])  # input of the predictions that are compared


def file_targets() -> Iterator[Target]:
    """Targets of the area, with their shares of the cases."""
    for name, mutate, read, cases in (
        ("robot.yaml", mutated_yaml, robot, 2.0),
        ("elastic.yaml", mutated_yaml, robot, 2.0),
        ("robot.urdf", mutated_text, robot, 3.0),
        ("plan.yaml", mutated_yaml, plan, 3.0),
        ("tracked.yaml", mutated_yaml, plan, 1.0),
        ("polar.txt", mutated_text, polar, 3.0),
        ("polar.csv", mutated_table, polar, 2.0),
        ("settings.yaml", mutated_yaml, load_settings, 5.0),
        ("gait.csv", mutated_table, gait, 6.0),
        ("model.json", mutated_json, model, 8.0),
        ("learner.state", mutated_bytes, state, 6.0),
        ("flight.nc", mutated_bytes, pt.load_flight, 0.3),
        ("sensors.nc", mutated_bytes, load_sensor_log, 0.3),
        ("identification.nc", mutated_bytes, load_identification, 0.3),
    ):
        yield Target(AREA, name, cases, _reading(name, mutate, read))
    for name in seeds.LEARNERS:
        yield Target(AREA, f"{name}, signed", 1.5, _signed_states(name))
    yield Target(AREA, "model.json, bytes", 4.0, _reading("model.json", mutated_bytes, model))
    yield Target(AREA, "mapping.yaml", 2.0, _mappings)
    yield Target(AREA, "imported log", 0.3, _imported)
    for name in ("flight.nc", "identification.nc", "imported log"):
        yield Target(AREA, f"{name}, content", 0.3, _contents(name))
    for kind, cases in (
        ("CSV", 0.7), ("gzipped CSV", 0.25), ("Parquet", 0.25), ("MAT", 0.4), ("ROS 1 bag", 0.25),
        ("ROS 2 bag", 0.25), ("MCAP", 0.4), ("ULog", 0.4), ("DataFlash", 0.3),
    ):  # fmt: skip
        yield Target(AREA, kind, cases, _logs(kind))


def robot(path: Path) -> None:
    """Read a robot file; its mass must be a finite number.

    Args:
        path: YAML or URDF.

    Raises:
        WrongNumber: If the mass is not, or the robot is another one from its own text.
    """
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        read = pt.load_robot(path)
    masses = np.array([body.mass for body in read.bodies])
    if not np.isfinite(masses).all():
        raise WrongNumber(f"masses {masses}")
    again = load_robot_text(read.source, "again")
    if again.dof_names != read.dof_names:
        raise WrongNumber(f"coordinates {read.dof_names}, from the robot's text {again.dof_names}")


def plan(path: Path) -> None:
    """Read a plan of a closed loop, and make its sensors and events.

    Args:
        path: YAML.
    """
    found = load_plan(path)
    found.sensors.known(seeds.robot())
    for event in found.events or ():
        event_of(event)


def polar(path: Path) -> None:
    """Read a polar and make a section of it, whose numbers must be finite.

    Args:
        path: Text of XFOIL, or CSV.

    Raises:
        WrongNumber: If a number of the section is not.
    """
    found = pt.air.measured_section(*pt.air.read_polar(path)).parameters
    if not np.isfinite(found).all():
        raise WrongNumber(f"numbers of the section {found}")


def gait(path: Path) -> None:
    """Read the table of a gait of `seeds.robot`.

    Args:
        path: CSV file.
    """
    pt.gaits.from_csv(seeds.robot(), path)


def model(path: Path) -> None:
    """Read a model and predict by it.

    Args:
        path: JSON file.
    """
    found = load_model(path)
    found.predict(np.zeros(found.network.inputs))


def state(path: Path) -> None:
    """Read a learner's file: it is refused, or predicts as the learner that was saved.

    Args:
        path: File with a digest.

    Raises:
        WrongNumber: If the prediction differs.
    """
    found = pt.load_learner(path)
    kept = seeds.learner()
    expected = kept.network(_X, kept.weights)
    if not np.array_equal(found.network(_X, found.weights), expected):
        raise WrongNumber("a damaged file of a learner was accepted and predicts otherwise")


def any_log(path: Path) -> None:
    """Inspect a log, and import it by the mapping of its kind.

    Args:
        path: The log.
    """
    with tempfile.TemporaryDirectory(prefix="patagium-") as folder:
        valid = recordings(Path(folder)).values()
        words = next(words for log, words in valid if log.suffix == path.suffix)
    mapping = path.parent / "mapping.yaml"
    mapping.write_text(yaml.safe_dump(words))
    log_checked(path.parent, path, mapping)


def log_checked(folder: Path, log: Path, mapping: Any) -> None:
    """Inspect a log and import it; what was imported must hold together.

    Args:
        folder: Folder for the import.
        log: The log.
        mapping: Meaning of its numbers, plain words or a file.

    Raises:
        WrongNumber: If time does not rise or a number is not finite.
        PatagiumError: If the log is refused by both.
    """
    try:
        inspect_log(log)
    except PatagiumError as refusal:
        if len(str(refusal)) > 20_000:
            raise WrongNumber("a refusal of more than 20,000 characters") from None
    out = folder / "out.nc"
    out.unlink(missing_ok=True)
    pt.import_log(log, mapping, out)
    with LogRecord(out) as record:
        if not (np.diff(record.time()) > 0).all():
            raise WrongNumber("time does not rise in an imported log")
        if not np.isfinite(record.values(record.labels)).all():
            raise WrongNumber("an imported log has numbers that are not finite")


READERS: dict[str, Read] = {
    "robot": robot,
    "settings": load_settings,
    "plan": plan,
    "polar": polar,
    "gait": gait,
    "model": model,
    "state": pt.load_learner,
    "flight": pt.load_flight,
    "sensors": load_sensor_log,
    "identification": load_identification,
    "imported": load_log,
    "mapping": load_mapping,
    "log": any_log,
}
"""Readers of the corpus, by the first word of the name of its files."""


def _reading(name: str, mutate: Mutation, read: Read) -> Callable[[Path], Case]:
    """Case of one file: mutated, written, read."""

    def prepare(folder: Path) -> Case:
        content = seeds.written(folder)[name].read_bytes()
        path = folder / f"case{Path(name).suffix}"

        def case(draw: Draw) -> None:
            path.write_bytes(mutate(content, draw))
            read(path)

        return case

    return prepare


def _signed_states(name: str) -> Callable[[Path], Case]:
    """Case of a learner's file whose content is hostile and whose digest is right."""

    def prepare(folder: Path) -> Case:
        path = folder / "signed.state"
        description, state = read_state(seeds.taught(seeds.LEARNERS[name]()).save(path))
        arrays = {k: v for k, v in state.items() if isinstance(v, np.ndarray)}
        plain = {k: v for k, v in state.items() if k not in arrays}

        def case(draw: Draw) -> None:
            words = mutated_tree({"d": description, "s": plain}, draw)
            found = {name: _odd_array(array, draw) for name, array in arrays.items()}
            try:
                state = {**found, **words["s"]}
                told: Any = words["d"]
                told = told[:9] if isinstance(told, list) else told
                write_state(path, told, state)  # a long list takes long to write
            except (TypeError, KeyError, ValueError):
                return  # the mutation left no two mappings
            learner = pt.load_learner(path)
            learner.update(np.zeros(learner.network.inputs), np.zeros(learner.network.outputs))

        return case

    return prepare


def _odd_array(array: Any, draw: Draw) -> Any:
    """Array as it is, or with another shape, type or number."""
    kind = int(draw.integers(12))
    if kind == 0:
        return array[..., :-1] if array.ndim else array
    if kind == 1:
        return array.astype(draw.choice(["complex128", "int8", "U4", "float16", "M8[s]"]))
    if kind == 2 and array.size and array.dtype.kind == "f":
        changed = array.copy()
        changed.flat[int(draw.integers(array.size))] = draw.choice([np.nan, np.inf, 1e300, -1.0])
        return changed
    return array.reshape(-1, 1) if kind == 3 else array


def _mappings(folder: Path) -> Case:
    """Case of a hostile mapping, given with a valid table."""
    files = recordings(folder)
    path = folder / "case.yaml"

    def case(draw: Draw) -> None:
        log, words = files["CSV" if draw.random() < 0.7 else "ULog"]
        path.write_bytes(mutated_yaml(yaml.safe_dump(words).encode(), draw))
        load_mapping(path)
        if draw.random() < 0.3:
            log_checked(folder, log, path)

    return case


def _logs(kind: str) -> Callable[[Path], Case]:
    """Case of a log of one kind."""

    def prepare(folder: Path) -> Case:
        log, words = recordings(folder)[kind]
        content, path = log.read_bytes(), folder / f"case{''.join(log.suffixes)}"
        mapping = folder / "case.yaml"
        mapping.write_text(yaml.safe_dump(words))
        mutate = mutated_table if kind == "CSV" else mutated_bytes

        def case(draw: Draw) -> None:
            path.write_bytes(mutate(content, draw))
            log_checked(folder, path, mapping)

        return case

    return prepare


def _imported_log(folder: Path) -> Path:
    log, words = recordings(folder)["CSV"]
    mapping = folder / "map.yaml"
    mapping.write_text(yaml.safe_dump(words))
    return pt.import_log(log, mapping, folder / "log.nc").path


def _imported(folder: Path) -> Case:
    """Case of a log that the program imported, with damaged bytes."""
    content, path = _imported_log(folder).read_bytes(), folder / "case.nc"

    def case(draw: Draw) -> None:
        path.write_bytes(mutated_bytes(content, draw))
        load_log(path)

    return case


def _contents(name: str) -> Callable[[Path], Case]:
    """Case of a netCDF file whose variables and attributes are hostile."""

    def prepare(folder: Path) -> Case:
        read: Read = _NETCDF[name]
        imported = name == "imported log"
        valid = _imported_log(folder) if imported else seeds.written(folder)[name]
        path = folder / "case.nc"

        def case(draw: Draw) -> None:
            shutil.copy(valid, path)
            with suppress(OSError, RuntimeError, AttributeError):  # of names and types in the way
                _odd_content(path, draw)
            read(path)

        return case

    return prepare


def _odd_content(path: Path, draw: Draw) -> None:
    """Change attributes and numbers of a netCDF file."""
    from netCDF4 import Dataset

    with Dataset(path, "a") as file:
        for _ in range(int(draw.choice([1, 1, 3]))):
            names = list(file.variables)
            variable = file.variables[names[int(draw.integers(len(names)))]]
            holder = file if draw.random() < 0.5 else variable
            kind = int(draw.integers(4))
            if kind == 0 and holder.ncattrs():
                holder.delncattr(draw.choice(holder.ncattrs()))
            elif kind == 1:
                _odd_attribute(holder, draw)
            elif kind == 2 and variable.dtype != str and variable.size:
                place = tuple(int(draw.integers(n)) for n in variable.shape)
                variable[place] = draw.choice([np.nan, np.inf, -1e308, 1e-320, 0.0])
            else:
                file.renameVariable(variable.name, f"odd{int(draw.integers(9))}")


def _odd_attribute(holder: Any, draw: Draw) -> None:
    """Change an attribute: hostile text, a number, or damaged text of its own."""
    name = str(draw.choice([*holder.ncattrs(), "odd"]))
    before = holder.getncattr(name) if name in holder.ncattrs() else ""
    if isinstance(before, str) and before and draw.random() < 0.6:
        text = mutated_text(before.encode(), draw).decode("utf-8", "replace").replace("\x00", "")
        holder.setncattr(name, text)
        return
    value = HOSTILE[int(draw.integers(len(HOSTILE)))]
    try:
        holder.setncattr(name, value if isinstance(value, float) else str(value))
    except (UnicodeEncodeError, ValueError):
        holder.setncattr(name, -1)

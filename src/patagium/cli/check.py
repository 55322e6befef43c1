"""`patagium check`: whether a robot file, a flight or a log can be used, and what it holds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from patagium.cli.options import JsonOption, MappingOption
from patagium.cli.words import MEANING, answer, existing
from patagium.errors import LogError, ParameterError, PatagiumError, command

if TYPE_CHECKING:
    from patagium.robot import Robot

EXAMPLES = (
    "patagium check my-robot.yaml",
    "patagium check flight.nc --json",
    "patagium check log.csv --mapping columns.yaml",
    "patagium check naca0012.txt",
)


def check(
    file: Annotated[
        Path,
        typer.Argument(
            help="Robot (.yaml, .urdf), plan (.yaml), flight or log (.nc), model (.json), table "
            "(.csv, .parquet), polar of a section (.csv, .txt, .dat)."
        ),
    ],
    mapping: MappingOption = None,
    as_json: JsonOption = False,
) -> None:
    """Say whether a file can be used, what it holds, and what is wrong with it.

    Leaves with 0 when it can be used, with 2 and the reasons when not.
    """
    from patagium.aerodynamics.polar_files import is_polar
    from patagium.learning import load_model
    from patagium.netcdf_file import kind_of
    from patagium.robot import load_robot, preset_names

    ending = file.suffix.lower()
    polar = mapping is None and ending in (".csv", ".txt", ".dat", ".pol", ".polar")
    if polar and (ending != ".csv" or is_polar(existing(file))):
        facts = _polar_facts(file)
    elif ending in (".csv", ".parquet", ".gz"):
        facts = _log_facts(file, mapping)
    elif mapping is not None:
        raise ParameterError("--mapping", "a table (.csv, .parquet) to go with it", str(file))
    elif ending == ".nc":
        facts = _netcdf_facts(file, as_json)
    elif ending == ".json":
        model = load_model(existing(file))
        facts = {"kind": "model", "network": repr(model.network), "learned from": model.source}
    elif ending in (".yaml", ".yml") and (plan := _plan_facts(file)):
        facts = plan
    elif "the option" in (kind := kind_of(file)):
        raise LogError(file, "a robot or a plan", kind)
    elif ending in (".yaml", ".yml", ".urdf") or str(file) in preset_names():
        facts = {"kind": "robot", **robot_facts(load_robot(str(file)))}
    else:
        expected = "a name ending in .yaml, .urdf, .nc, .json, .csv, .parquet, .txt or .dat"
        raise ParameterError("file", expected, str(file))
    answer(facts, as_json=as_json, title=f"{file} can be used")


def robot_facts(robot: Robot) -> dict[str, Any]:
    """Facts of one robot for a person, its joints and lifting lines among them."""
    from patagium.robot.planform import describe_robot
    from patagium.robot.strip_chains import chain_words

    moving = ", ".join(robot.actuated_names)
    lines = chain_words(robot)
    return describe_robot(robot) | {"actuated": moving, "lifting lines": lines}


def _plan_facts(file: Path) -> dict[str, Any] | None:
    """Facts of a plan; None where the file is a robot's."""
    from patagium.cli.plan import load_plan
    from patagium.limits import ROBOT_FILE
    from patagium.reading import parsed_yaml, text_of

    told = parsed_yaml(text_of(existing(file), ROBOT_FILE), str(file))
    if not isinstance(told, dict) or "robot" not in told:
        return None
    plan = load_plan(file)
    events = [one.type for one in plan.events or ()]
    return {"kind": "plan", "robot": plan.robot, "events": events}


def _polar_facts(file: Path) -> dict[str, Any]:
    """Facts of a polar, as `--polar` takes it, once blade elements can be made of it."""
    from math import degrees

    from patagium.aerodynamics import measured_polar, measured_section, read_polar

    table = read_polar(existing(file))
    polar = measured_polar(*table[:3])
    try:
        section = measured_section(polar.angle, polar.lift, polar.drag)
        lifting = f"lift slope {section.lift_slope:.3g} 1/rad, no lift at "
        lifting += f"{degrees(section.zero_lift_angle):.3g} deg"
    except PatagiumError as error:
        lifting = f"not usable: {error}"
    best = int(table.lift.argmax())
    return {
        "kind": "polar of a section",
        "rows": len(table.angle),
        "angle of attack [deg]": [degrees(table.angle[0]), degrees(table.angle[-1])],
        "largest C_L [1]": float(table.lift[best]),
        "at [deg]": degrees(table.angle[best]),
        "least C_D [1]": float(table.drag.min()),
        "moment": "none" if table.moment is None else "C_m about the quarter chord",
        "with a lifting line": lifting,
    }


def _netcdf_facts(file: Path, as_json: bool) -> dict[str, Any]:
    from patagium.cli.simulate import flight_facts, flight_table
    from patagium.netcdf_file import kind_of
    from patagium.sensing import load_sensor_log
    from patagium.sensing.logs.record import LOADED, is_log, load_log
    from patagium.sensing.sensors.sense import is_sensor_log
    from patagium.simulation import load_flight

    if is_log(file):
        return _log_facts(file, None)
    if is_sensor_log(existing(file)):
        log = load_sensor_log(file)
        samples = {name: f"{one.sizes['time']} samples" for name, one in log.readings.items()}
        return {"kind": "sensor log", "robot": log.robot.name, **samples}
    if not (kind := kind_of(file)).startswith(LOADED):
        facts = {"kind": "flight", **flight_facts(load_flight(existing(file)))}
        return facts if as_json else flight_table(facts)
    found = load_log(file)
    time, names = found["time"].values, found.data_vars
    return {
        "kind": kind.partition(",")[0],
        "robot": found.attrs["robot_name"],
        "samples": len(time),
        "duration [s]": float(time[-1] - time[0]) if len(time) else 0.0,
        "quantities": [f"{name} [{found[name].attrs.get('units', '1')}]" for name in names],
    }


def _log_facts(file: Path, mapping: Path | None) -> dict[str, Any]:
    from patagium.sensing.logs.importing.import_log import opened_log

    if mapping is None and file.suffix.lower() != ".nc":
        raise ParameterError("--mapping", f"a YAML file {command(MEANING, file)}", None)
    with opened_log(existing(file), mapping and existing(mapping)) as record:
        time = record.time()
        return {
            "kind": "imported log" if mapping is None else "log and its mapping",
            "samples": record.count,
            "duration [s]": float(time[-1] - time[0]),
            "numbers": [f"{name} [{unit}]" for name, unit in record.units.items()],
            "inputs": list(record.of_role("input")),
            "outputs": list(record.of_role("output")),
            "a flight": record.is_flight,
            "findings": [f"{one['where']}: {one['kind']}" for one in record.findings],
        }

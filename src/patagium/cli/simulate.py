"""`patagium simulate`: a robot, its air and its gait become a flight on disk."""

from __future__ import annotations

from functools import partial
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from patagium.cli import live as live_options
from patagium.cli import options
from patagium.cli.estimates import AirOption, chosen_air
from patagium.cli.learner_options import LearnerChoice, with_learner_options
from patagium.cli.mounting import MountKind, lengths, mount_from
from patagium.cli.options import option_in, vector_in
from patagium.cli.outputs import Outputs
from patagium.cli.words import (
    FLIGHT,
    Numbers,
    Vector,
    existing,
    named_quantities,
    only_given,
    progress_bar,
    say_next,
    tell,
    warn,
)
from patagium.errors import ParameterError, command
from patagium.limits import SWING, TILT

if TYPE_CHECKING:
    from collections.abc import Mapping

    from patagium.robot import Robot
    from patagium.simulation.gait_models import Gait


EXAMPLES = (
    "patagium simulate aerobat",
    'patagium simulate aerobat --plunge "45 deg" --speed "4 m/s" '
    '--duration "2 s" --time-step 1e-4 -o flight.nc',
    "patagium simulate aerobat --gait linkage --frequency 5 --mount fixed "
    '--wind "-3,0,0 m/s" --duration 1 --time-step 1e-4 --figure flight.png',
    "patagium simulate aerobat --gait linkage --frequency 5 --mount arm --path figure-of-eight "
    '--path-center "0.65,0,0.2" --path-size "0.9,0.3 m" --path-speed "2 m/s" --path-along 0,1,0 '
    '--path-across 0,0,1 --arm-turn "0,-90 deg,0" --load-cell body --duration 1 --time-step 1e-4',
    'patagium simulate aerobat --gait sinusoidal --frequency "5 Hz" --plunge "35 deg" '
    '--speed "3 m/s" --duration "60 s" --time-step 5e-4 --live',
)
PANELS = {
    "Gait": "gait plunge elbow feather amplitude phase offset",
    "Air and start": "aero polar inflow added_mass density wind ground pitch attitude",
    "Mount": "mount load_cell arm arm_at arm_turn arm_shift",
    "Path of the mount": "path path_center path_size path_speed path_frequency path_along "
    "path_across path_attitude path_amplitude",
    "Live view": "live_address settings",
}


@with_learner_options(file="Settings of a learner for --live, which patagium tune wrote")
def simulate(
    robot: options.RobotArgument,
    duration: options.DurationOption = None,
    time_step: Annotated[
        float | None,
        option_in("s", "Fixed step of the RK4, in s; by default a 400th of a wingbeat or shorter."),
    ] = None,
    gait: Annotated[
        str | None,
        typer.Option(
            help="Gait: sinusoidal, linkage, still, or a CSV table of one period, from rest; by "
            "default the robot's own, its numbers replaced by those given."
        ),
    ] = None,
    frequency: Annotated[
        float | None,
        option_in(
            "Hz", "Wing beats a second, in Hz; a table needs it whose last row is not its first."
        ),
    ] = None,
    plunge: Annotated[
        float | None, option_in("rad", "Amplitude of plunge, in rad.", most=SWING)
    ] = None,
    elbow: Annotated[
        float | None, option_in("rad", "Amplitude of the elbows, in rad.", most=SWING)
    ] = None,
    feather: Annotated[
        float | None, option_in("rad", "Amplitude of feathering, in rad.", most=SWING)
    ] = None,
    amplitude: Annotated[
        list[str] | None,
        typer.Option(help="Amplitude of any joint: left_plunge='30 deg'. Repeat it."),
    ] = None,
    phase: Annotated[
        list[str] | None, typer.Option(help="Lead of a joint: feather='90 deg'. Repeat it.")
    ] = None,
    offset: Annotated[
        list[str] | None, typer.Option(help="Mean of a joint: elbow='-10 deg'. Repeat it.")
    ] = None,
    aero: AirOption = "quasi-steady",
    polar: options.PolarOption = None,
    inflow: options.InflowOption = False,
    added_mass: Annotated[
        float | None,
        typer.Option(help="Factor of the added mass: 1 for long wings, .85 at aspect ratio 3."),
    ] = None,
    density: options.DensityOption = None,
    wind: options.WindOption = None,
    ground: Annotated[
        float | None,
        option_in(
            "m", "Height of the ground, world z, in m; without it there is none.", "a height"
        ),
    ] = None,
    speed: Annotated[float | None, option_in("m/s", "Initial speed forward, in m/s.")] = None,
    pitch: Annotated[
        float | None, option_in("rad", "Initial pitch, positive nose down, in rad.", most=TILT)
    ] = None,
    attitude: Annotated[
        Literal["euler", "quaternion"] | None,
        typer.Option(help="Coordinates of the attitude: quaternion for loops and vertical climbs."),
    ] = None,
    mount: Annotated[
        MountKind | None, typer.Option(help="Mount of the body; free by default when it can float.")
    ] = None,
    path: Annotated[
        str | None,
        typer.Option(
            help="Path of the mount: line, circle, figure-of-eight, sinusoid, or a CSV table."
        ),
    ] = None,
    path_center: Annotated[
        Vector | None, vector_in("m", "Center of the path (start of a line), in m: 0.6,0,0.2.")
    ] = None,
    path_size: Annotated[
        Numbers | None,
        typer.Option(
            parser=lengths,
            help="Radius, or length,width, or end minus start of a line, in m: 0.9,0.3.",
        ),
    ] = None,
    path_speed: Annotated[
        float | None, option_in("m/s", "Greatest speed on the path, in m/s.")
    ] = None,
    path_frequency: Annotated[
        float | None, option_in("Hz", "Frequency of the path, in Hz.")
    ] = None,
    path_along: Annotated[
        Vector | None,
        vector_in("", "Direction of an eight's length, or normal of a circle: 0,1,0."),
    ] = None,
    path_across: Annotated[
        Vector | None, vector_in("", "Direction of an eight's width: 0,0,1.")
    ] = None,
    path_attitude: Annotated[
        Vector | None, vector_in("rad", "Roll,pitch,yaw on the path, in rad: 0,0,90 deg.")
    ] = None,
    path_amplitude: Annotated[
        list[str] | None,
        typer.Option(help="Amplitude of a sinusoid: z='5 cm', pitch='10 deg'. Repeat it."),
    ] = None,
    arm: Annotated[
        str | None, typer.Option(help="Arm of --mount arm: a preset (ur5e by default) or a file.")
    ] = None,
    arm_at: Annotated[
        str | None, typer.Option(help="Body of the arm that holds the robot; by default tool.")
    ] = None,
    arm_turn: Annotated[
        Vector | None, vector_in("rad", "Roll,pitch,yaw of the robot on the arm, in rad.")
    ] = None,
    arm_shift: Annotated[
        Vector | None, vector_in("m", "Position of the robot on the arm, in m.")
    ] = None,
    load_cell: Annotated[
        list[str] | None,
        typer.Option(help="Body or joint whose wrench to record: body. Repeat it."),
    ] = None,
    output: options.FlightOutput = FLIGHT,
    figure: options.DrawingOption = None,
    live: live_options.LiveOption = False,
    live_address: live_options.LiveAddressOption = None,
    *,
    choice: LearnerChoice,
    as_json: options.JsonOption = False,
) -> None:
    """Fly a robot and keep the flight.

    Quantities are SI numbers, or text with a unit: "5 Hz", "30 deg", "3 m/s". What is not given
    comes from the section `cruise` of the robot's file, and is said.
    A flight that breaks down, or is ended by Ctrl-C, is kept up to there, in FILE.partial.nc, which
    replaces an earlier one; the exit code is then 2 or 130.
    With --live it flies as the clock goes, shown and steered in a browser (see `docs/live.md`).
    """
    from patagium.cli.interruption import interruptible
    from patagium.robot import load_robot
    from patagium.simulation import gaits, mounts
    from patagium.simulation import simulate as fly
    from patagium.simulation.simulator import DURATION, Simulator

    shown = live_options.served(live, live_address, choice.given)
    machine = load_robot(robot)
    if attitude is not None:
        machine = machine.with_attitude(attitude)
    own = machine.cruise if gait is None else None
    standing = not machine.floating or mount == "fixed"
    blown = wind or ((-own.speed, 0.0, 0.0) if own and standing else None)
    around: dict[str, Any] = {"density": density, "wind": blown, "ground": ground}
    model, carried, _ = chosen_air(aero, machine, polar, inflow, factor=added_mass, **around)
    sizes = {"plunge": plunge, "elbow": elbow, "feather": feather}
    moves = _gait(machine, gait, frequency, sizes, amplitude=amplitude, phase=phase, offset=offset)
    words = {
        "center": path_center, "size": path_size, "speed": path_speed,
        "frequency": path_frequency, "along": path_along, "across": path_across,
        "attitude": path_attitude, "amplitude": path_amplitude or None,
    }  # fmt: skip
    held = mount_from(mount, path, words, arm=arm, at=arm_at, turn=arm_turn, shift=arm_shift)
    if held is not None and held.path is not None and (speed or pitch):
        raise ParameterError("--speed, --pitch", "a path that says them", mount)
    told = f" in a wind of {own.speed:g} m/s" if own and standing and not wind else ""
    if own and machine.floating and (held is None or held.path is None):
        if speed is None and not standing:
            speed, told = own.speed, f" at {own.speed:g} m/s"
        if pitch is None:
            pitch, told = own.pitch, f"{told}, pitch {degrees(own.pitch):.1f} deg"
    q, v = gaits.level_start(machine, speed or 0.0, pitch or 0.0)
    usual = machine.cruise.duration if machine.cruise else DURATION
    conditions: dict[str, Any] = {
        "duration": usual if duration is None else duration,
        "time_step": time_step, "added_mass": carried, "mount": held,
        "load_cells": [mounts.load_cell(cell) for cell in load_cell or ()], "q": q, "v": v,
    }  # fmt: skip
    if shown:
        start = partial(Simulator, machine, model, **conditions)
        flight = live_options.fly_live(live_address, choice, start, machine, moves, model.air)
    else:
        with progress_bar(f"Flying {machine.name}") as bar, interruptible(bar) as progress:
            flight = fly(machine, model, moves, throw=False, progress=progress, **conditions)
    if not as_json:
        parts = [_cruise_words(machine, moves) + told] if own else []
        parts += [f"duration {usual:g} s"] * (duration is None)
        parts += [f"time step {flight.attrs['time_step']:g} s"] * (time_step is None)
        if parts:
            tell(f"Chosen for {machine.name}: {'; '.join(parts)}")
    keep(flight, output, figure, as_json)


def _cruise_words(machine: Robot, flown: Gait) -> str:
    from patagium.simulation import gaits

    whole = "its cruise" if flown == gaits.cruise(machine) else "the rest of its cruise"
    return f"{whole}, {f'{1.0 / flown.period:g} Hz' if flown.period else 'joints held'}"


def flight_facts(flight: Any) -> dict[str, Any]:
    """Facts of a flight for JSON, SI: how it flew, and audits of energy and momentum."""
    from patagium.simulation.flight_summary import flight_summary

    time = flight["time"].values
    told = {name: flight.attrs[name] for name in _TOLD if name in flight.attrs}
    told |= {"duration [s]": float(time[-1] - time[0]), "samples": int(time.size)}
    audits = {name: flight.attrs[name] for name in _AUDITS if name in flight.attrs}
    return flight_summary(flight) | told | audits


def flight_table(facts: dict[str, Any]) -> dict[str, Any]:
    """The facts of a flight as rows of a table, each with its unit."""
    rows = {}
    for name, value in facts.items():
        if name in ("roll", "pitch", "yaw"):
            ends = (f"{round(degrees(one), 1) + 0.0:.1f}" for one in value)
            value = " to ".join(ends).replace("-", "−")  # noqa: PLW2901
        if name != "warnings":
            rows[_LABELS.get(name, name)] = value
    return rows


_TOLD = ("robot_name", "mount", "stepping", "time_step", "outcome", "message")
_AUDITS = ("energy_audit", "fluid_energy_audit", "momentum_audit", "aero_power_largest")
_LABELS = {
    "time_step": "time step [s]",
    "means_over": "means are over",
    "frequency": "frequency of the gait [Hz]",
    "speed": "mean speed along the nose [m/s]",
    "climb_rate": "mean climb rate [m/s]",
    "height_change": "height change, start to end [m]",
    "roll": "roll [deg]",
    "pitch": "pitch, positive nose down [deg]",
    "yaw": "yaw [deg]",
    "force_over_weight": "mean vertical force of the air over weight [1]",
    "joint_power": "mean power of the joints [W]",
    "held_samples": "samples at which the last command was held",
    "energy_audit": "energy audit [1]",
    "fluid_energy_audit": "fluid energy audit [1]",
    "momentum_audit": "momentum audit [1]",
    "aero_power_largest": "aero power, largest [W]",
}


def _gait(
    machine: Robot,
    kind: str | None,
    frequency: float | None,
    amplitudes: Mapping[str, float | None],
    **words: list[str] | None,
) -> Gait:
    """Gait of the options: a sine where one of its numbers is given, else that of the robot."""
    from patagium.simulation import gaits

    def unit(name: str) -> str:
        joints = machine.joints_named(name)
        return machine.dof_units[machine.index(joints[0])] if joints else "rad"

    named, leads, means = (
        named_quantities(f"--{k}", given or (), *("rad", "an angle") if k == "phase" else (unit,))
        for k, given in words.items()
    )
    sizes = only_given(amplitudes) | named
    own, lacking = machine.cruise, False
    if kind is None and own is not None:
        held = own.frequency is None
        kind = "still" if held and frequency is None and not (sizes or leads) else "sinusoidal"
        lacking = held and kind == "sinusoidal" and not sizes
        sizes, leads, means = (
            _replaced(machine, former, given)
            for former, given in ((own.amplitude, sizes), (own.phase, leads), (own.offset, means))
        )
    kind = kind or "sinusoidal"
    if frequency is None and own is not None and kind in ("sinusoidal", "linkage"):
        frequency = own.frequency
    if kind == "linkage":
        gaits.check_linkage(machine)
    _refuse_what_is_unused(kind, frequency, sizes, leads, means)
    if kind == "still":
        return gaits.still(machine, **means)
    if kind not in ("sinusoidal", "linkage"):
        if not Path(kind).suffix and not Path(kind).exists():
            known = ("sinusoidal", "linkage", "still")
            expected = "sinusoidal, linkage, still or a CSV table of one period"
            raise ParameterError("--gait", expected, kind, known)
        return gaits.from_csv(machine, existing(Path(kind)), period=frequency and 1 / frequency)
    if frequency is None or lacking:
        joints = machine.actuated_names or ("JOINT",)
        moved = "plunge" if any("plunge" in one for one in joints) else joints[0]
        size = "5 cm" if unit(moved) == "m" else "30 deg"
        size = f", with --amplitude {moved}='{size}'" * (kind == "sinusoidal")
        expected = f"the beats a second of a {kind} gait, such as '5 Hz'{size}; or those of a "
        expected += "section `cruise` in the robot's file; or --gait still"
        raise ParameterError("--frequency", expected, frequency)
    if kind == "linkage":
        offsets: Any = {f"{name}_offset": value for name, value in means.items()}
        return gaits.linkage(machine, frequency=frequency, **offsets)
    return gaits.sinusoidal(machine, frequency=frequency, phase=leads, offset=means, **sizes)


def _replaced(
    machine: Robot, former: Mapping[str, float], given: Mapping[str, float]
) -> dict[str, float]:
    """Values of the cruise by joint, those of the joints that are given replaced."""
    named = {joint for name in given for joint in machine.joints_named(name)}
    values = {joint: v for name, v in former.items() for joint in machine.joints_named(name)}
    return {joint: v for joint, v in values.items() if joint not in named} | dict(given)


def _refuse_what_is_unused(kind: str, frequency: float | None, *named: Mapping[str, float]) -> None:
    sizes, leads, means = named
    known = {"sinusoidal": {*means}, "still": {*means}, "linkage": {"plunge", "elbow"}}
    unused = {
        "--frequency": frequency is not None and kind == "still",
        "an amplitude": bool(sizes) and kind != "sinusoidal",
        "--phase": bool(leads) and kind != "sinusoidal",
        "--offset": bool({*means} - known.get(kind, set())),
    }
    for option, wrong in unused.items():
        if wrong:
            raise ParameterError(option, f"nothing of the kind with --gait {kind}", "one")


def keep(flight: Any, output: Path, figure: Path | None, as_json: bool) -> None:
    """Write a flight and a drawing of it, and tell its facts.

    Args:
        flight: The flight, whole or up to where it broke.
        output: File for it; of one that broke FILE.partial.nc.
        figure: File for the drawing, or None.
        as_json: Whether facts are JSON.

    Raises:
        Exit: With 2 if the flight broke, 130 if it was interrupted.
        PatagiumError: If something was not saved.
    """
    from patagium.simulation import save_flight
    from patagium.simulation.flight_summary import BUOYANT

    broken = str(flight.attrs["outcome"]) != "COMPLETED"
    if broken:  # what is there already may be whole
        output = output.with_name(f"{output.stem}.partial{output.suffix}")
    outputs = Outputs()
    where = f"{output}{', in place of an earlier one' * output.exists()}"
    kept = outputs.attempt("flight", save_flight, flight, output)
    outputs.draw(figure, lambda drawn: drawn.flight_overview(flight))
    facts = flight_facts(flight) | ({"file": str(output)} if kept else {})
    outputs.answer("facts", facts if as_json else flight_table(facts), as_json, "Flight")
    for warning in facts["warnings"]:
        if not broken or warning == BUOYANT:  # the others are of what broke it
            warn(warning)
    outputs.check()
    if broken:
        warn(f"{flight.attrs['message']}; the flight is kept in {where}")
        raise typer.Exit(130 if flight.attrs["outcome"] == "INTERRUPTED" else 2)
    if not as_json:
        verbs = ("view", "identify")[: 1 + bool(flight.sizes.get("strip"))]
        say_next(*(command(f"patagium {verb} {{}}", output) for verb in verbs))

"""A flight as a page to look at: poses by the robot's own kinematics, forces as recorded.

The page shows samples of the flight, thinned to a few hundred a wingbeat, and interpolates
between them; how far that errs at the wing tips is computed and said on it. The flow is not shown.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from patagium.arguments import checked
from patagium.arrays import Array, Indices, find_gaps, stored
from patagium.dynamics.dynamics import poses_at
from patagium.errors import FlightError, ParameterError
from patagium.report.figures import events_of, off_reference
from patagium.report.page import page_path
from patagium.report.replay_page import Arrows, Mark, Replay, Series, Surface, write_replay
from patagium.report.still import OBLIQUE, draw_still
from patagium.robot import Robot
from patagium.robot.attitude import body_rates, without_flips
from patagium.robot.model import Body
from patagium.robot.planform import strip_corners
from patagium.robot.solids import Solid, carried_body, solids, tube, wing_tips
from patagium.sensing import training_data
from patagium.simulation import air_of, carrier_of, gait_period, robot_of
from patagium.simulation.flight import Carrier, aero_words
from patagium.viewer.predicted_forces import Predicted, Prediction, predict_flight


class CarryingArm(NamedTuple):
    """An arm on the ground, at F times.

    Attributes:
        names: Names of its bodies, its foot last.
        position: Position of each body in the world, (F, n_b, 3) [m].
        rotation: Body axes to world axes, (F, n_b, 3, 3).
        solids: Shapes of the bodies.
    """

    names: tuple[str, ...]
    position: Array
    rotation: Array
    solids: list[Solid]


def carrying_arm(robot: Robot, carrier: Carrier | None, frames: Indices) -> CarryingArm | None:
    """Arm under the robot of a flight; None if there is no arm.

    Of a robot composed with its arm only the foot: its links are bodies of the robot.
    """
    count = len(frames)
    ground = np.zeros((count, 1, 3)), np.broadcast_to(np.eye(3), (count, 1, 3, 3))
    if carrier is None:
        own = carried_body(robot)
        thick = [solid for solid in solids(robot) if solid.body < own]
        return CarryingArm(("foot",), *ground, _foot(robot, thick, 0)) if own else None
    arm = carrier.arm
    position, rotation = poses_at(arm, carrier.q[frames])
    drawn = solids(arm)
    return CarryingArm(
        (*(f"{arm.name} {body.name}" for body in arm.bodies), f"{arm.name} foot"),
        np.concatenate([position, ground[0]], axis=1),
        np.concatenate([rotation, ground[1]], axis=1),
        [
            *drawn,
            *_foot(arm, drawn, len(arm.bodies)),
            *_rod(drawn, arm.body_index(carrier.at), carrier.position),  # from the tool
        ],
    )


def _foot(arm: Robot, drawn: list[Solid], body: int) -> list[Solid]:
    """Column from the ground to the first joint."""
    found = _rod(drawn, body, arm.bodies[0].position, 1.4)
    return [one._replace(kind="cylinder") for one in found]


def _rod(drawn: list[Solid], body: int, end: ArrayLike, thicker: float = 1.0) -> list[Solid]:
    """Rod from the origin of a body, as thick as those drawn or thicker; none of no length."""
    along = np.array(end, float)
    if not np.linalg.norm(along) > 0:
        return []
    radius = max(solid.size[0] for solid in drawn if solid.kind == "capsule")
    return [tube(body, np.zeros(3), along, thicker * radius)]


_SINGULAR = 1e-3  # cosine of a pitch beyond which the angles say nothing of one direction


def floating_body(robot: Robot) -> tuple[int, Body] | None:
    """The body that floats, and its number; None if none or several do."""
    found = [*robot.floating_bodies.items()]
    return found[0] if len(found) == 1 else None


def _columns(names: tuple[str, ...], wanted: list[str], values: Array) -> Array | None:
    """Columns of the wanted names, (N, k); None where one of them is not known."""
    known = set(wanted) <= set(names)
    return values[:, [names.index(name) for name in wanted]] if known else None


def total_force(
    robot: Robot,
    names: tuple[str, ...],
    generalized: Array,
    q: Array,
    rotation: Array,
    arm: Array,
) -> tuple[Array, Array | None] | None:
    """Force and moment on the robot from generalized forces; None where they do not tell.

    Both are in world axes, (N, 3) [N] and [N m]; the moment is None without the attitude's part.

    Args:
        robot: The machine.
        names: Coordinates whose force is known, k.
        generalized: That force, (N, k) [N, N m].
        q: Coordinates, (N, n_q) [m, rad, 1].
        rotation: Floating body's axes to world axes, (N, 3, 3) [-].
        arm: Center of mass from the floating body's origin, world axes, (N, 3) [m].
    """
    floating = floating_body(robot)
    if floating is None:
        return None
    _, body = floating
    wanted = [robot.dof_names[k] for k in body.floating_dofs or ()]
    force, turning = (_columns(names, part, generalized) for part in (wanted[:3], wanted[3:]))
    if force is None:
        return None
    if turning is None:
        return force, None
    if not body.by_quaternion:
        angles = q[:, list(robot.floating_coordinates(body))[3:]]
        each = body_rates(angles[:, None], np.eye(3))  # J^T: a rate of one angle in body axes
        turning = np.einsum("nij,nj->ni", np.linalg.pinv(each, rcond=_SINGULAR), turning)
    return force, np.einsum("nij,nj->ni", rotation, turning) - np.cross(arm, force)


_BYTES = 1.4e6
"""Numbers a page may hold: with base64, three.js and the rest it stays below 3 MB."""
_LEAST_PER_BEAT = 24
"""Frames a wingbeat that a long flight keeps, whatever the page's size."""
_PLOTTED = 5
"""Forces that are plotted when the page opens."""
_SILENCE = 1e-12
"""Forces that vary less are rounding [N, N m]."""


@checked
def replay(
    flight: xr.Dataset,
    path: str | Path,
    *,
    predicted: Predicted | None = None,
    title: str | None = None,
    start: float | None = None,
    end: float | None = None,
    beside: Mapping[str, xr.Dataset] | None = None,
) -> Path:
    """A flight as one HTML page in three dimensions that opens from disk, offline.

    Bodies and wings stand where `Dynamics.point` puts them; forces on strips are arrows, true and
    predicted; generalized forces are plotted with a cursor.

    Args:
        flight: The flight.
        path: The page to write, in a folder that is there.
        predicted: A learner or model, asked with frozen weights, or the identification of this
            flight, as it predicted each sample; None: true forces only.
        title: Heading; None: the flight of the robot.
        start: First time to show [s]; None: the flight's first.
        end: Last time to show [s]; None: the flight's last.
        beside: Another flight by its name, drawn as a ghost in the same space and dashed in the
            plots: a predicted one, or before and after; of a closed loop else the reference.

    Returns:
        The path written.

    Raises:
        FlightError: If the flight does not carry its robot.
        ParameterError: If the span holds no two samples, the path ends in neither .html nor .htm,
            or beside another flight predicted forces are asked for too.
        ShapeError: If the model is of another robot.
        LogError: If the identification is of another flight.
    """
    page = page_path(path)
    if beside and predicted is not None:
        raise ParameterError("beside", "nothing with predicted forces", ", ".join(beside))
    shown = replay_content(flight, predicted, title, start, end)
    if "reference" in flight and not beside and predicted is None:
        wanted = flight["q"] - off_reference(flight)
        beside = {"reference": flight.assign(q=wanted)}
    for name, other in (beside or {}).items():
        shown = _beside(shown, replay_content(other, None, None, start, end), name)
    return write_replay(page, shown)


def _beside(shown: Replay, other: Replay, name: str) -> Replay:
    """Replay with a ghost of another, whose series are dashed where both have them."""
    found = {(one.group, one.name): one.values for one in other.series}
    begin, end = other.time[[0, -1]]
    step = (end - begin) / (len(other.time) - 1)  # the time that a stored frame stands for
    outside = (shown.time < begin - step) | (shown.time > end + step)
    gaps = np.array(other.gaps, int)
    time = np.insert(other.time, gaps, (other.time[gaps - 1] + other.time[gaps]) / 2)
    series = []
    for one in shown.series:
        values = found.get((one.group, one.name))
        if values is not None:
            values = np.interp(shown.time, time, np.insert(values, gaps, np.nan))
            values[outside] = np.nan
            alike = np.array_equal(values, one.values)
            one = one if alike else replace(one, predicted=values)
        series.append(one)
    notes = [*shown.notes]
    if outside.any():
        drawn = "at no time of this flight" if outside.all() else "at these times alone"
        notes.append(f"{name} has samples from {begin:g} to {end:g} s; its robot is drawn {drawn}.")
    both, ghost = ("this flight", name), replace(other, series=(), arrows=None)
    return replace(shown, series=series, names=both, other=ghost, notes=notes)


def replay_content(
    flight: xr.Dataset,
    predicted: Predicted | None = None,
    title: str | None = None,
    start: float | None = None,
    end: float | None = None,
) -> Replay:
    """Content of a page or a picture of a flight; see `replay` for arguments and errors."""
    robot = robot_of(flight)
    flight = _with_force(flight, robot)
    time = stored(flight, "time")
    period = gait_period(flight)
    span = _span(time, start, end)
    carrier, main = carrier_of(flight), carried_body(robot)
    arms = 0 if carrier is None else len(carrier.arm.bodies) + 1
    frames = _frames(span, time, period, _bytes_per_frame(robot, arms, predicted is not None))
    prediction = None if predicted is None else predict_flight(flight, robot, predicted, frames)
    shown = flight.isel(time=frames)
    arm = carrying_arm(robot, carrier, frames)
    q = stored(flight, "q")[span]
    position, rotation = poses_at(robot, q)
    origin, inside = position[:, main], frames - span[0]
    speed = np.linalg.norm(np.gradient(origin, time[span], axis=0), axis=1)
    bodies = [body.name for body in robot.bodies]
    placed, turned = position[inside], rotation[inside]
    drawn = [k._asdict() | ({"carrier": True} if k.body < main else {}) for k in solids(robot)]
    arrows = _arrows(shown, robot, (placed, turned), origin[inside], prediction)
    if arm is not None:
        count = len(bodies)
        drawn += [k._asdict() | {"body": k.body + count, "carrier": True} for k in arm.solids]
        bodies += arm.names
        placed = np.concatenate([placed, arm.position], axis=1)
        turned = np.concatenate([turned, arm.rotation], axis=1)
    beat = [] if period is None else [f"{1 / period:.3g} wingbeats a second"]
    air = aero_words(flight)
    model = [str(air["model"]).replace("_", " ")] if "model" in air else []
    return Replay(
        title=(title or f"Flight of {robot.name}").encode("utf-8", "replace").decode(),
        subtitle=" · ".join([robot.name, *beat, f"{time[span[-1]] - time[span[0]]:.4g} s", *model]),
        time=time[frames],
        period=period,
        bodies=bodies,
        origin=origin[inside],
        position=placed - origin[inside, None],
        quaternion=quaternions(turned),
        speed=speed[inside],
        solids=drawn,
        ground=None if arm is None else 0.0,
        surfaces=[Surface(s.wing, s.body, strip_corners(s)) for s in robot.strips],
        marks=[Mark(name, body, tip) for name, (body, tip) in wing_tips(robot).items()],
        arrows=arrows,
        series=_series(shown, robot, prediction),
        events=events_of(flight),
        gaps=np.unique(np.searchsorted(inside, find_gaps(time[span[0] : frames[-1] + 1]))).tolist(),
        notes=[
            _sampling(robot, time[span], inside, position, rotation),
            *_axes(arrows),
            *_wind(shown),
            *([] if arm is None else [_ARM]),
            *([] if prediction is None else [f"Predicted: {prediction.words}.", *prediction.notes]),
            *([] if prediction is None or prediction.std is None else [_SURE]),
        ],
    )


def _with_force(flight: xr.Dataset, robot: Robot) -> xr.Dataset:
    """Flight with the force of the air, also of an imported log, a record or a motion.

    Samples that lack a coordinate, or of a log a force that is known elsewhere, are left out.
    """
    flight = flight.isel(time=np.isfinite(stored(flight, "q")).all(axis=1))
    if "aero_force" not in flight and {"force", "u1"} & {*flight.data_vars}:
        force = flight["force"].values if "force" in flight else training_data(flight, robot)[2]
        known = np.isfinite(force)
        whole = known[:, known.any(axis=0)].all(axis=1)
        flight = flight.assign(aero_force=(("time", "dof"), force)).isel(time=whole)
    if flight.sizes["time"] < 2:
        raise FlightError("flight", "two samples with motion and force", "fewer")
    return flight


def quaternions(rotation: Array) -> Array:
    """Unit quaternions x y z w of rotation matrices, (..., 4), one sign along the first axis."""
    found = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_quat()
    return without_flips(found.reshape(*rotation.shape[:-2], 4))


def _span(time: Array, start: float | None, end: float | None) -> Indices:
    first = time[0] if start is None else start
    last = time[-1] if end is None else end
    tiny = 1e-9 * max(1.0, abs(last))
    found = np.flatnonzero((time >= first - tiny) & (time <= last + tiny))
    if len(found) < 2:
        limits = f"a span with two samples within {time[0]:g} to {time[-1]:g} s"
        raise ParameterError("start, end", limits, f"{first:g} to {last:g} s")
    return found


def _frames(span: Indices, time: Array, period: float | None, each: int) -> Indices:
    """Samples of the span at one stride, as many as the page has room for."""
    most = _BYTES / each
    if period is not None:
        most = max(most, _LEAST_PER_BEAT * (time[span[-1]] - time[span[0]]) / period)
    stride = max(1, int(np.ceil((len(span) - 1) / max(most, 2))))
    return span[::stride]


def _bytes_per_frame(robot: Robot, arms: int, predicted: bool) -> int:
    bodies = 7 * (len(robot.bodies) + arms)
    strips = (3 * len(robot.strips) + 6) * (3 if predicted else 2)
    plots = robot.dof * (4 if predicted else 2) + 1
    return 8 * 4 + 4 * (bodies + strips + plots)  # time and origin are doubles


def _arrows(
    shown: xr.Dataset,
    robot: Robot,
    poses: tuple[Array, Array],
    origin: Array,
    prediction: Prediction | None,
) -> Arrows | None:
    """Forces to be drawn as arrows, in world axes; None where no force is known."""
    if "aero_force" not in shown:
        there = ", ".join(map(str, shown.data_vars))
        raise FlightError(f"flight: expected aero_force (time, dof), but it holds {there}")
    position, rotation = poses
    center = center_of_mass(robot, position, rotation)
    held, floating = floating_body(robot) or (0, None)
    known = stored(shown, "q"), rotation[:, held], center - position[:, held]
    air = stored(shown, "aero_force", "time", "dof")
    whole = total_force(robot, robot.dof_names, air, *known)
    force = point = guess = None
    strips = bool(robot.strips) and "strip_force" in shown  # of a log only the total is known
    if strips:
        names = "strip_force", "strip_point"
        force, point = (stored(shown, name, "time", "strip", "axis") for name in names)
        whole = whole or (force.sum(axis=1), None)
        point = point - origin[:, None]
        guess = None if prediction is None else prediction.strips
    if whole is None or not np.isfinite(whole[0]).all() or not (strips or air.any()):
        return None
    told = std = None
    if prediction is not None:
        told = total_force(robot, prediction.names, prediction.generalized, *known)
        if floating is not None and prediction.std is not None:
            along = [robot.dof_names[k] for k in robot.floating_dofs[:3]]
            std = _columns(prediction.names, along, prediction.std)
    if told is None and guess is not None:
        told = guess.sum(axis=1), None
    total, moment = told or (None, None)
    return Arrows(point, force, guess, center - origin, whole[0], total, whole[1], moment, std)


def center_of_mass(robot: Robot, position: Array, rotation: Array) -> Array:
    """Center of mass of the robot at many states, without an arm under it, (N, 3) [m]."""
    mass = np.array([float(body.mass) for body in robot.bodies])
    mass[: carried_body(robot)] = 0.0
    offsets = np.array([body.center_of_mass for body in robot.bodies], float)
    centers = position + np.einsum("nbij,bj->nbi", rotation, offsets)
    return np.asarray(np.einsum("b,nbi->ni", mass / mass.sum(), centers))


def _series(shown: xr.Dataset, robot: Robot, prediction: Prediction | None) -> list[Series]:
    """Forces and coordinates over time, those of the robot's motion in degrees."""
    force = stored(shown, "aero_force", "time", "dof")
    q = stored(shown, "q")
    chosen = _chosen(robot, np.nan_to_num(force))
    found = []
    for k, (name, unit) in enumerate(zip(robot.dof_names, robot.force_units, strict=True)):
        guess = sure = None
        if np.isnan(force[:, k]).all():
            continue  # nothing measured what drives it
        if prediction is not None and name in prediction.names:
            place = prediction.names.index(name)
            guess = prediction.generalized[:, place]
            sure = None if prediction.std is None else prediction.std[:, place]
        found.append(Series(_FORCES, name, unit, force[:, k], guess, name in chosen, sure))
    units = zip(robot.coordinate_names, robot.coordinate_units, strict=True)
    for k, (name, unit) in enumerate(units):
        values, shown_in = (np.degrees(q[:, k]), "deg") if unit == "rad" else (q[:, k], unit)
        moving = not chosen and bool(np.ptp(values) > 0) and k < _PLOTTED
        found.append(Series("Coordinates", name, shown_in, values, None, moving))
    return found


def _chosen(robot: Robot, force: Array) -> list[str]:
    """Forces worth a first look: those that move, of mirrored joints the left ones."""
    loud = force.std(axis=0) > 1e-6 * max(force.std(axis=0).max(), _SILENCE)
    carried = robot.bodies[carried_body(robot) :]
    own = [robot.dof_names[joint.dof] for body in carried for joint in body.joints]
    order = [*("x", "z", "pitch"), *own, *robot.dof_names]
    names = [n for n in dict.fromkeys(order) if n in robot.dof_names and loud[robot.index(n)]]
    return [n for n in names if n not in _SIDEWAYS and robot.side(n) >= 0][:_PLOTTED]


def _axes(arrows: Arrows | None) -> list[str]:
    """Notes on axes, arrows and bodies."""
    words = "World axes: x forward, y left, z up."
    if arrows is not None:
        words += "" if arrows.force is None else " Arrows are forces of the air on strips."
        words += " The total force of the air is drawn at the center of mass."
    return [words, "Bodies without a shape are bones."]


def _wind(shown: xr.Dataset) -> list[str]:
    """Notes about wind and events; none where there are none."""
    notes = [f"At {when:.4g} s: {words}." for when, words in events_of(shown)]
    own = [air_of(shown).wind] if "wind" not in shown else shown["wind"].values
    wind = np.asarray(own, float)
    if wind.any():
        words = ", ".join(f"{k:.3g}" for k in wind[0])
        notes.append(f"Wind at first: ({words}) m/s, world axes.")
    return notes


def _sampling(
    robot: Robot,
    time: Array,
    inside: Indices,
    position: Array,
    rotation: Array,
) -> str:
    """Note on which samples are shown, on gaps, and on the error between those shown."""
    stride = int(inside[1] - inside[0])
    step = f"{1e3 * np.median(np.diff(time[inside])):.3g} ms apart"
    lost, gaps = "", find_gaps(time)
    if len(gaps):
        last = gaps[np.diff(time)[gaps - 1].argmax()]
        several = f"in {len(gaps)} gaps, the longest " if len(gaps) > 1 else ""
        lost = (
            f" No samples {several}from {time[last - 1]:g} to {time[last]:g} s: there the page "
            "interpolates the pose and shows neither forces nor values."
        )
    if stride == 1:
        return (
            f"All {len(time)} samples are shown, {step}; the page interpolates between them.{lost}"
        )
    error = _tip_error(robot, time, inside, position, rotation)
    return (
        f"Resampled for display: {len(inside)} of {len(time)} samples (one in {stride}, {step}). "
        "Between them the page interpolates; at the samples left out, wing tips err by at most "
        f"{1e3 * error:.2g} mm.{lost}"
    )


def _tip_error(
    robot: Robot, time: Array, inside: Indices, position: Array, rotation: Array
) -> float:
    """Largest distance of interpolated from computed wing tips, midway between frames [m]."""
    middle = inside[:-1] + int(inside[1] - inside[0]) // 2
    first, last = time[inside[:-1]], time[inside[1:]]
    part = ((time[middle] - first) / (last - first))[:, None, None]
    turns, places = quaternions(rotation[inside]), position[inside]
    mixed, between = (one[:-1] + part * np.diff(one, axis=0) for one in (turns, places))
    errors = [0.0]
    for body, offset in wing_tips(robot).values():
        guess = between[:, body] + Rotation.from_quat(mixed[:, body]).apply(offset)
        truth = position[middle, body] + rotation[middle, body] @ offset
        errors.append(float(np.linalg.norm(guess - truth, axis=1).max()))
    return max(errors)


_FORCES = "Generalized force of the air"
_SIDEWAYS = ("y", "roll", "yaw")
_ARM = "The arm that carries the robot stands on the world's origin."
_SURE = (
    "Bands, and the ellipsoid at the end of the predicted total (unless larger than the robot), "
    "are 95 % intervals."
)


@checked
def still(
    flight: xr.Dataset,
    time: float | None = None,
    *,
    predicted: Predicted | None = None,
    seen_from: tuple[float, float, float] = OBLIQUE,
) -> Figure:
    """A moment of a flight in perspective: what the replay page shows, as a drawing.

    Bodies, wings, forces on strips or in total (predicted ones as halos), and paths of the last
    wingbeat.

    Args:
        flight: The flight.
        time: Time [s]; None: the greatest force of the wingbeat in the middle of the flight.
        predicted: A learner or model, or the identification of this flight; see `replay`.
        seen_from: Direction from the robot to the eye, world axes, (3,) [-].

    Returns:
        A figure, to be saved as .png, .svg or .pdf.

    Raises:
        FlightError: If the flight does not carry its robot.
        ParameterError: If the time is not within the flight, or the eye straight above.
    """
    robot_of(flight)
    first, last = float(flight["time"][0]), float(flight["time"][-1])
    when = (first + last) / 2 if time is None else float(time)
    if not first <= when <= last:
        raise ParameterError("time", f"within {first:g} to {last:g} s", f"{when:g} s")
    if not np.hypot(*seen_from[:2]) > 0:
        raise ParameterError("seen_from", "a direction that is not straight up", seen_from)
    shown = replay_content(flight, predicted)
    away = np.abs(shown.time - when)
    if time is None and shown.arrows is not None:
        near = away <= max(away.min(), (shown.period or 0.0) / 2)
        away = np.where(near, -np.linalg.norm(shown.arrows.total, axis=1), np.inf)
    return draw_still(shown, int(away.argmin()), seen_from=seen_from)

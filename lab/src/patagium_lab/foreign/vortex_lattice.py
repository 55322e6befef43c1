"""Air of PteraSoftware's unsteady ring-vortex lattice around a single wing on a mount.

The lattice has no viscosity and no stall; its wake keeps its shape. It takes velocities as
backward differences, which are those of half a step before, so each force is ascribed to half a
step before its own time; what is left of the lag is the error of a step (`docs/foreign.md`). The
first wingbeat, which begins with an impulse, is left out.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from patagium.aerodynamics import Air
from patagium.arrays import Array
from patagium.dynamics.kinematics import body_poses, generalized_force
from patagium.errors import ParameterError
from patagium.robot import Robot
from patagium_lab.foreign.kinematics import Wingbeat
from patagium_lab.foreign.mujoco_air import Motion, carried_motion
from patagium_lab.foreign.programs import LATTICE_PROGRAM, program
from patagium_lab.foreign.record import ForeignOrigin
from patagium_lab.foreign.wings import AXES, SingleWing

STEPS = 60
"""Number of time steps in a wingbeat."""
BEATS = 6
"""Number of wingbeats, of which the first is left out."""
PANELS = (5, 8)
"""Number of panels along the chord and along the span."""
_WAKE = 120  # rows of the wake that are kept
_REFLECTED = np.array([-1.0, 1.0, 1.0])  # from the program's axes (aft, right, up) to a left wing


def lattice_flight(
    wing: SingleWing, wingbeat: Wingbeat, step: float, wrench: Array
) -> tuple[ForeignOrigin, Array, Motion, Array]:
    """Wingbeats of a single wing on a mount, with the force of the vortex lattice.

    Args:
        wing: The wing.
        wingbeat: The wingbeat.
        step: Time between two samples [s].
        wrench: Force and moment as `lattice_wrench` gives them, (K, 6) [N, N m].
    """
    robot, beat = wing.robot(), 1.0 / wingbeat.frequency
    stamps = (np.arange(len(wrench)) - 0.5) * (BEATS * beat / (len(wrench) - 1))
    time = np.arange(np.ceil(beat / step), np.floor(stamps[-1] / step)) * step
    loads = CubicSpline(stamps[1:], wrench[1:])(time)
    q, v, a = carried_motion(robot, wingbeat, time)
    force = _on_hinge(robot, q, loads)
    q[:, robot.index("x")] -= q[0, robot.index("x")]
    program = "PteraSoftware, unsteady ring-vortex lattice, on a mount"
    origin = ForeignOrigin(robot, Air(), program, wingbeat.gait(robot).describe(), "carried")
    return origin, time - time[0], (q, v, a), force


def lattice_wrench(wing: SingleWing, wingbeat: Wingbeat, steps: int = STEPS) -> Array:
    """Force and moment about the hinge at each step of the lattice, in the hub's axes.

    Args:
        wing: The wing.
        wingbeat: The wingbeat.
        steps: Number of time steps in a wingbeat.

    Returns:
        Force, then moment, (BEATS steps + 1, 6) [N, N m].

    Raises:
        ParameterError: If PteraSoftware is not installed.
    """
    solver = lattice_solver(wing, wingbeat, Air(), steps)
    solver.run(prescribed_wake=True, calculate_streamlines=False, show_progress=False)
    rows = []
    for problem in solver.steady_problems:
        plane, turn = problem.airplanes[0], problem.operating_point.T_pas_W_CgP1_to_GP1_CgP1
        force, moment = turn[:3, :3] @ plane.forces_W, turn[:3, :3] @ plane.moments_W_CgP1
        rows.append([*(force * _REFLECTED), *(moment * -_REFLECTED)])  # a mirror turns moments
    return np.array(rows, float)


def lattice_solver(wing: SingleWing, wingbeat: Wingbeat, air: Air, steps: int = STEPS) -> Any:
    """Solver of PteraSoftware, ready to run.

    Args:
        wing: The wing.
        wingbeat: The wingbeat.
        air: Its density.
        steps: Number of time steps in a wingbeat.

    Raises:
        ParameterError: If PteraSoftware is not installed.
    """
    ptera = program(LATTICE_PROGRAM)
    plane = _airplane(ptera, wing)
    period = 1.0 / wingbeat.frequency
    moved = [_turns(wingbeat, name) for name in AXES]
    movements = ptera.movements
    wings = movements.wing_movement.WingMovement(
        base_wing=plane.wings[0],
        wing_cross_section_movements=[
            movements.wing_cross_section_movement.WingCrossSectionMovement(
                base_wing_cross_section=k
            )
            for k in plane.wings[0].wing_cross_sections
        ],
        ampAngles_Gs_to_Wn_ixyz=tuple(size for size, _ in moved),
        periodAngles_Gs_to_Wn_ixyz=tuple(period if size else 0.0 for size, _ in moved),
        phaseAngles_Gs_to_Wn_ixyz=tuple(phase if size else 0.0 for size, phase in moved),
        rotationPointOffset_Gs_Ler=(wing.ahead, -wing.root, 0.0),
    )
    point = ptera.operating_point.OperatingPoint(
        rho=air.density, vCg__E=wingbeat.speed, alpha=float(np.rad2deg(wingbeat.incidence))
    )
    movement = movements.movement.Movement(
        airplane_movements=[
            movements.airplane_movement.AirplaneMovement(
                base_airplane=plane, wing_movements=[wings]
            )
        ],
        operating_point_movement=movements.operating_point_movement.OperatingPointMovement(
            base_operating_point=point
        ),
        delta_time=period / steps,
        num_steps=BEATS * steps + 1,
        max_wake_rows=_WAKE,
    )
    problem = ptera.problems.UnsteadyProblem(movement=movement)
    method = ptera.unsteady_ring_vortex_lattice_method
    return method.UnsteadyRingVortexLatticeMethodSolver(unsteady_problem=problem)


def _airplane(ptera: Any, wing: SingleWing) -> Any:
    """Airplane of the one wing, its center at the hinge, a right wing in the program's axes."""
    geometry = ptera.geometry
    flat = geometry.airfoil.Airfoil(name="naca0006")  # the lattice takes its mean line alone

    def section(chord: float, panels: int | None, place: tuple[float, float, float]) -> Any:
        return geometry.wing_cross_section.WingCrossSection(
            airfoil=flat,
            num_spanwise_panels=panels,
            chord=chord,
            Lp_Wcsp_Lpp=place,
            control_surface_symmetry_type=None,
            spanwise_spacing=None if panels is None else "uniform",
        )

    surface = geometry.wing.Wing(
        wing_cross_sections=[
            section(wing.root_chord, PANELS[1], (0.0, 0.0, 0.0)),
            section(wing.tip_chord, None, (wing.back, wing.span, 0.0)),
        ],
        Ler_Gs_Cgs=(-wing.ahead, wing.root, 0.0),
        num_chordwise_panels=PANELS[0],
        chordwise_spacing="uniform",
    )
    return geometry.airplane.Airplane(wings=[surface])


def _turns(wingbeat: Wingbeat, name: str) -> tuple[float, float]:
    """Amplitude and phase of a turn about an axis of the program [deg].

    Feathering and sweeping go the other way there, which half a turn of phase does.
    """
    size, phase = wingbeat.amplitude.get(name, 0.0), wingbeat.phase.get(name, 0.0)
    if wingbeat.offset.get(name, 0.0):
        raise ParameterError(f"offset of {name}", "zero for a wing on a hinge", wingbeat.offset)
    turned = phase + (0.0 if name == "plunge" else np.pi)
    degrees = float(np.rad2deg(np.pi - (np.pi - turned) % (2 * np.pi)))
    return float(np.rad2deg(size)), degrees


def _on_hinge(robot: Robot, q: Array, wrench: Array) -> Array:
    """Generalized force of a wrench on the wing, about the hinge in the hub's axes, (N, n)."""
    place, load = ca.SX.sym("q", robot.coordinate_count), ca.SX.sym("wrench", 6)
    hub, wing = robot.body_index("hub"), robot.body_index("wing")
    poses = body_poses(robot, place)
    turn = poses[wing].rotation.T @ poses[hub].rotation
    force = generalized_force(robot, place, {wing: (turn @ load[:3], turn @ load[3:])})
    call = ca.Function("on_hinge", [place, load], [ca.densify(force)])
    return np.array(call.map(len(q))(q.T, wrench.T)).T

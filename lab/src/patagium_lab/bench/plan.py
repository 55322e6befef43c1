"""Plan of the bench of times: its groups, in the parts of the page."""

from __future__ import annotations

from dataclasses import dataclass

from patagium.errors import ParameterError

OTHERS = ("energy", "published", "sympy", "sympy-without-cse", "symengine", "pinocchio", "mujoco",
          "python")  # fmt: skip
"""Groups whose rivals are another program or another way to the same numbers."""
PARTS: tuple[tuple[str, tuple[str, ...], str], ...] = (
    (
        "Equations of motion",
        ("dynamics", "batch"),
        "D, C v, G, their sums, inverse and forward dynamics; one state a call, and many states "
        "in one call.",
    ),
    (
        "Equations of motion, beside the energy form",
        ("energy", "published"),
        "Lagrange's equations by algorithmic differentiation of the energies: sharing "
        "subexpressions, and as the published experiment has it.",
    ),
    (
        "Equations of motion, beside symbolic algebra",
        ("sympy", "sympy-without-cse", "symengine"),
        "The same Lagrangian derived by SymPy and SymEngine, written as C and compiled alike, with "
        "and without shared subexpressions.",
    ),
    (
        "Equations of motion, beside other libraries",
        ("pinocchio", "mujoco"),
        "Pinocchio's C++ and MuJoCo's C on the same tree of bodies.",
    ),
    (
        "Equations of motion, called from Python",
        ("python",),
        "What a Python caller sees; most of it is the call itself.",
    ),
    (
        "Air and networks",
        ("aerodynamics", "air-models", "strips"),
        "The force of the air by its equations and by networks that learn it; every model of the "
        "air beside the quasi-steady one; the lifting line as strips grow in number.",
    ),
    (
        "Updates of a learner",
        ("update",),
        "One sample learned, beside the paper's Algorithm 1, beside the matrix products an update "
        "cannot do without, and beside the least arithmetic there is.",
    ),
    (
        "From packet to prediction",
        ("pipeline",),
        "A learner's whole work for a sample in one compiled call: packet, inverse dynamics, "
        "prediction with its covariance, update. At 10 kHz the response counts from when a packet "
        "was due.",
    ),
    (
        "Predictive control",
        ("programs",),
        "Quadratic programs of predictive control, from nothing and as the next sample of a "
        "controller, beside four other solvers.",
    ),
    (
        "From sensors to commands",
        ("tick",),
        "A tick of an autopilot at 10 kHz in one compiled call: a sample of the inertial unit and "
        "of the encoders, an update of the default learner, and commands of the linear regulator "
        "where an interval begins. A sample of the cameras comes 4.2 ms late, and what came since "
        "is taken again.",
    ),
    (
        "A flight",
        ("orbits", "simulation"),
        "Periodic orbits from the presets' cruise, by Newton's method with exact derivatives, "
        "where the code is compiled. Simulating free flight, everything recorded.",
    ),
    (
        "Compiling",
        ("compile",),
        "On an empty cache, everything included; from then on it is loaded in milliseconds.",
    ),
)
"""Parts of the page: title, groups of the bench, and what is compared."""
GROUPS = tuple(group for _, groups, _ in PARTS for group in groups)
"""Groups of the bench, in the order in which they run."""
QUICK = tuple(
    group
    for group in GROUPS
    if group not in ("published", "sympy-without-cse", "pinocchio", "strips", "pipeline", "compile")
)
"""Groups whose rivals compile in seconds."""


@dataclass(frozen=True)
class BenchPlan:
    """Groups that are timed.

    Attributes:
        groups: Names out of `GROUPS`.

    Raises:
        ParameterError: If a group is unknown.
    """

    groups: tuple[str, ...] = GROUPS

    def __post_init__(self) -> None:
        for name in self.groups:
            if name not in GROUPS:
                raise ParameterError("groups", f"some of {', '.join(GROUPS)}", name)

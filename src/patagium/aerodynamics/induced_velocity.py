"""Velocity that trailing vortices induce at strips with memory, and the normalwash they feel.

A lifting line and the networks built on one share this: the linear system of the circulations of
all strips, and a step of the lag states in which vortices and lags at its end feel each other.
Neglected: what `lifting_line` neglects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from patagium.aerodynamics.lag_states import Lags, Relaxation, lag_relaxation, lag_step
from patagium.aerodynamics.local_flow import StripMotion
from patagium.aerodynamics.smooth_functions import smooth_norm, smooth_sign
from patagium.aerodynamics.trailing_vortices import Lattice, StripChain, horseshoe_function


@dataclass(frozen=True)
class VortexSystem:
    """Strips of a robot, how they move and the trailing vortices they share.

    Attributes:
        chains: Strips that share trailing vortices, chain by chain.
        lattice: Places of strips and vortices.
        motions: Motion of each strip relative to the air, n.
    """

    chains: Sequence[StripChain]
    lattice: Lattice
    motions: Sequence[StripMotion]


@dataclass(frozen=True)
class Normalwash:
    """Normal velocities of the air at the strips of a lifting line, (n, 1) each [m/s].

    Attributes:
        effective: Of the undisturbed wind at three quarters of the chord and of the wind
            induced by the trailing vortices.
        lagged: What the lift answers to, phi(0) effective + sum_k a_k z_k.
        circulation: Bound circulation along forward x normal [m^2/s].
        induced: Velocity induced by the trailing vortices, lattice axes, (3, n) [m/s].
    """

    effective: ca.SX
    lagged: ca.SX
    circulation: ca.SX
    induced: ca.SX


def solve_normalwash(
    vortices: VortexSystem, geometric: ca.SX, state: ca.SX, lags: Lags, lift_slope: Any
) -> Normalwash:
    """Normalwashes of all strips; linear in the geometric ones and the state.

    Args:
        vortices: Strips and their trailing vortices.
        geometric: Undisturbed normalwash of each strip, (n, 1) [m/s].
        state: Lags strip by strip, (n_z, 1) [m/s].
        lags: Numbers of the memory.
        lift_slope: Lift slope of a section, or of each strip in turn [1/rad].
    """
    strips = range(len(vortices.motions))
    bound = [
        lags.first_circulation * geometric[i] + lags.lagged(lags.circulation, state, i)
        for i in strips
    ]
    feedthrough = lags.first_circulation
    signed, induced = _induced(vortices, bound, 1.0, feedthrough, lift_slope)
    effective = geometric + ca.sum1(vortices.lattice.normals * induced).T
    lagged = [lags.first_lift * effective[i] + lags.lagged(lags.lift, state, i) for i in strips]
    return Normalwash(effective, ca.vertcat(*lagged), signed, induced)


def implicit_lag_step(
    vortices: VortexSystem,
    geometric: ca.SX,
    state: ca.SX,
    step: Any,
    before: Relaxation,
    lags: Lags,
    lift_slope: Any,
) -> tuple[ca.SX, ca.SX]:
    """Lags one step later and the effective normalwashes there, found together.

    The step of `lag_step` in which lags and vortices at its end feel each other: still one
    linear system, and where the vortices turn the flow against what makes them, bounded at
    any step.

    Args:
        vortices: Strips and their trailing vortices at the end of the step.
        geometric: Undisturbed normalwash of each strip there, (n, 1) [m/s].
        state: Lags strip by strip at the beginning, (n_z, 1) [m/s].
        step: Length of the step [s].
        before: Relaxation of the lags at the beginning.
        lags: Numbers of the memory.
        lift_slope: Lift slope of a section [1/rad].

    Returns:
        Lags, (n_z, 1) [m/s], and effective normalwashes, (n, 1) [m/s], at the end.
    """
    motions = vortices.motions
    count, still = len(lags.rate), ca.SX.zeros(len(motions), 1)
    after = lag_relaxation(motions, still, lags)
    fixed = lag_step(state, step, before, after)
    unit = Relaxation(before.rate, 0 * before.target), Relaxation(after.rate, 1 + after.target)
    share = lag_step(0 * state, step, *unit)  # of the effective normalwash at the end
    bound, feedthrough = [], []
    for i in range(len(motions)):
        through = lags.first_circulation + lags.lagged(lags.circulation, share, i)
        held = lags.lagged(lags.circulation, fixed, i)
        feedthrough.append(through)
        bound.append(geometric[i] + held / through)
    _, induced = _induced(vortices, bound, feedthrough, 1.0, lift_slope)
    effective = geometric + ca.sum1(vortices.lattice.normals * induced).T
    reached = fixed + share * ca.vec(ca.repmat(effective.T, count, 1))
    return reached, effective


def _induced(
    vortices: VortexSystem,
    bound: Sequence[Any],
    shares: Any,
    feedthrough: Any,
    lift_slope: Any,
) -> tuple[ca.SX, ca.SX]:
    """Circulation along forward x normal, (n, 1), and velocity induced, (3, n).

    c = 1/2 chord a0 share (bound + feedthrough n . induced) of each strip.
    """
    chains, net, motions = vortices.chains, vortices.lattice, vortices.motions
    sizes = tuple(len(chain.strips) for chain in chains)
    order = [i for chain in chains for i in chain.strips]
    right = [sign for chain in chains for sign in chain.right]
    gain = []
    for i, along in zip(order, right, strict=True):
        sign = along * smooth_sign(motions[i].forward)
        share = shares[i] if isinstance(shares, list) else shares
        gain.append(sign * motions[i].strip.chord * lift_slope / 2 * share)
    circulation, induced = horseshoe_function(sizes)(
        *(net.points[:, order], net.normals[:, order]),
        *(net.edges, net.directions, net.core_squares),
        *(ca.vertcat(*gain), ca.vertcat(*[bound[i] for i in order]), feedthrough),
    )
    of_strip = [order.index(i) for i in range(len(order))]
    signed = [circulation[k] * right[k] for k in of_strip]
    return ca.vertcat(*signed), induced[:, of_strip]


def attached_lift(
    vortices: VortexSystem,
    wash: Normalwash,
    strip: int,
    gain: Any,
    pressure: Any,
    normal: Any,
) -> tuple[Any, Any]:
    """Lift of attached flow along the strip's forward and normal axes [N].

    L = pressure W, perpendicular to the wind at the force: undisturbed, induced by all legs, and
    by the wake shed across the span, (W - w_e) along the lift. Induced drag is the tilt.

    Args:
        vortices: Strips and their trailing vortices.
        wash: Normalwashes of all strips.
        strip: Index of the strip.
        gain: Lift of the lifting surface over that of the line.
        pressure: Lift per normalwash, 1/2 rho c ds a0 U [N s/m].
        normal: Normal velocity of the strip where the force acts [m/s].
    """
    motion, net = vortices.motions[strip], vortices.lattice
    forward, sign = motion.forward, smooth_sign(motion.forward)
    speed = smooth_norm(forward * forward + normal * normal)
    shed = sign * (wash.lagged[strip] - wash.effective[strip]) / speed
    induced = wash.induced[:, strip]
    wind_forward = -forward + gain * ca.dot(net.forwards[:, strip], induced) - shed * normal
    wind_normal = -normal + gain * ca.dot(net.normals[:, strip], induced) + shed * forward
    wind = smooth_norm(wind_forward * wind_forward + wind_normal * wind_normal)
    lift = sign * gain * net.shares[strip] * pressure * wash.lagged[strip] / wind
    return lift * wind_normal, -lift * wind_forward

"""Chains of strips: wings that one lifting line runs through.

Strips of a wing follow each other where their ends meet. A wing joins its mirror image where
their roots are near, as a body between them carries lift across; other wings join at their nearest
ends where the robot file says so (`joins`). All distances are those at zero coordinates.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from patagium.arrays import Array
from patagium.robot.model import Robot
from patagium.robot.planform import placed, poses, sides_of

JOINED = 0.5
"""Gap below which the ends of two strips are one, over their mean chord."""

Pair = tuple[str, str]
Pose = tuple[Array, Array]


@dataclass(frozen=True)
class StripChain:
    """Strips side by side that share legs.

    Attributes:
        strips: Indices in `robot.strips`, in order.
        right: For each strip 1 where the order runs along forward x normal (to the right
            of one who flies forward), else -1.
    """

    strips: tuple[int, ...]
    right: tuple[int, ...]

    @property
    def reverse(self) -> StripChain:
        """Chain seen from its other end."""
        return StripChain(self.strips[::-1], tuple(-sign for sign in self.right[::-1]))

    def __add__(self, other: StripChain) -> StripChain:
        return StripChain(self.strips + other.strips, self.right + other.right)


def strip_chains(robot: Robot) -> tuple[StripChain, ...]:
    """Chains of strips that share legs.

    Args:
        robot: The machine, in numbers; of its `joined_wings` mirror images are joined at their
            roots, others at their nearest ends.
    """
    places = poses(robot)
    chains: list[StripChain] = []
    for index in range(len(robot.strips)):
        new = StripChain((index,), (_order(robot, index),))
        last = chains[-1] if chains else None
        if last and _wings(robot, last) == _wings(robot, new) and _near(robot, places, last, new):
            chains[-1] = last + new
        else:
            chains.append(new)
    for pair in robot.joined_wings:
        images = {pair, pair[::-1]} & {*robot.mirrored_wings}
        if way := _way(robot, chains, pair, None if images else places):
            first, second = way
            kept = [k for k in chains if not {*k.strips} & {*first.strips, *second.strips}]
            chains = [*kept, first + second]
    return tuple(sorted(chains, key=lambda chain: min(chain.strips)))


def joined_images(robot: Robot, images: Iterable[Pair]) -> tuple[Pair, ...]:
    """Wings and their mirror images whose roots are nearer than half their mean chord."""
    places, chains = poses(robot), strip_chains(robot)
    ways = ((pair, _way(robot, chains, pair)) for pair in images)
    return tuple(pair for pair, way in ways if way and _near(robot, places, *way))


def chain_words(robot: Robot) -> str:
    """Wings of each lifting line, such as "left_wing + right_wing; tail"."""
    return "; ".join(" + ".join(_wings(robot, chain)) for chain in strip_chains(robot))


def _way(
    robot: Robot, chains: Sequence[StripChain], pair: Pair, places: list[Pose] | None = None
) -> tuple[StripChain, StripChain] | None:
    """Two chains whose ends at the roots of two wings face each other; in poses the nearest."""
    both = [way for chain in chains for way in (chain, chain.reverse)]

    def far(way: tuple[StripChain, StripChain]) -> tuple[float, ...]:
        if places is not None:
            return (_gap(robot, places, *way),)
        ends = (way[0].strips[-1], way[0].right[-1]), (way[1].strips[0], -way[1].right[0])
        still = [(np.zeros(3), np.eye(3))] * len(robot.bodies)  # each end in axes of its own body
        away = [float(np.linalg.norm(_end(robot, still, *end))) for end in ends]
        return sum(index for index, _ in ends), sum(away)

    ways = [
        (first, second)
        for first in both
        for second in both
        if (robot.strips[first.strips[-1]].wing, robot.strips[second.strips[0]].wing) == pair
        and not {*first.strips} & {*second.strips}
    ]
    return min(ways, key=far, default=None)


def _wings(robot: Robot, chain: StripChain) -> list[str]:
    return [*dict.fromkeys(robot.strips[i].wing for i in chain.strips)]


def _order(robot: Robot, index: int) -> int:
    """1 where the strips of a wing follow each other along forward x normal, else -1."""
    strip = robot.strips[index]
    same = [s for s in robot.strips if (s.wing, s.body) == (strip.wing, strip.body)]
    if len(same) > 1:
        along = np.subtract(same[-1].quarter_chord, same[0].quarter_chord)
        return 1 if np.dot(np.cross(strip.forward, strip.normal), along) > 0 else -1
    side = sides_of(robot)[index]
    if not side:
        return 1 if strip.mirrored else -1
    after = [s.body for s in robot.strips[index + 1 : index + 2] if s.wing == strip.wing]
    inwards = any(body <= robot.bodies[strip.body].parent for body in after)  # to the other side
    return 1 if (side < 0) != inwards else -1


def _near(robot: Robot, places: list[Pose], first: StripChain, second: StripChain) -> bool:
    """Whether the last strip of one chain ends where the first strip of another begins."""
    chord = robot.strips[first.strips[-1]].chord + robot.strips[second.strips[0]].chord
    least = JOINED * chord / 2 * (1 - 1e-9)  # at any scale alike
    return bool(_gap(robot, places, first, second) < least)


def _gap(robot: Robot, places: list[Pose], first: StripChain, second: StripChain) -> float:
    """Distance from the end of a chain to the beginning of another [m].

    Of one wing without its part along the chord: strips of a swept wing lie behind each other.
    """
    last, next_ = robot.strips[first.strips[-1]], robot.strips[second.strips[0]]
    end = _end(robot, places, first.strips[-1], first.right[-1])
    apart = end - _end(robot, places, second.strips[0], -second.right[0])
    if last.wing == next_.wing:
        forward = places[last.body][1] @ last.forward
        apart = apart - forward * (forward @ apart)
    return float(np.linalg.norm(apart))


def _end(robot: Robot, places: list[Pose], index: int, right: int) -> Array:
    """Right (1) or left (-1) end of a strip's quarter chord in the world, (3,) [m]."""
    strip = robot.strips[index]
    half = right * strip.width / 2
    offset = np.add(strip.quarter_chord, half * np.cross(strip.forward, strip.normal))
    return placed(places[strip.body], offset)

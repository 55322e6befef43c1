"""Wings cut into blade elements.

Between stations both edges are straight. Strips of a segment are equally wide;
each has the chord that keeps its area. Neglected: camber and thickness (they
belong to the polar), dihedral within a strip.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from patagium.robot.model import Strip
from patagium.robot.schema import Segment, WingPart

Array = NDArray[np.float64]


def cut_wing(wing: WingPart, body_index: dict[str, int]) -> Iterator[Strip]:
    """Strips of a wing, from the root outwards.

    Args:
        wing: Wing as the file describes it.
        body_index: Index of each body by name.
    """
    index = 0
    for segment in wing.segments:
        for point, forward, normal, chord, width in _cut(segment):
            yield Strip(
                name=f"{wing.name}[{index}]",
                wing=wing.name,
                body=body_index[segment.body],
                mirrored=False,
                quarter_chord=_triple(point),
                forward=_triple(forward),
                normal=_triple(normal),
                chord=_clean(chord),
                width=_clean(width),
            )
            index += 1


def _cut(segment: Segment) -> Iterator[tuple[Array, Array, Array, float, float]]:
    span = np.array([k.span for k in segment.stations])
    leading = np.array([k.leading for k in segment.stations])
    chord = leading - np.array([k.trailing for k in segment.stations])
    incidence = np.array([k.incidence for k in segment.stations])
    edges = np.linspace(span[0], span[-1], segment.strips + 1)
    area = np.diff(_integral(span, chord, edges))
    along = np.array(segment.span_axis)
    ahead, upward = _section_axes(along)
    for i in range(segment.strips):
        width = edges[i + 1] - edges[i]
        middle = (edges[i] + edges[i + 1]) / 2
        mean_chord = area[i] / width
        x = np.interp(middle, span, leading) - mean_chord / 4
        twist = float(np.interp(middle, span, incidence))
        forward = np.cos(twist) * ahead + np.sin(twist) * upward
        normal = np.cos(twist) * upward - np.sin(twist) * ahead
        point = np.array(segment.at) + middle * along + x * ahead
        yield point, forward, normal, mean_chord, width


def _section_axes(along: Array) -> tuple[Array, Array]:
    """Chord direction to the leading edge and upper normal of a span axis."""
    ahead = np.array([1.0, 0.0, 0.0])
    upward = np.cross(ahead, along)
    if upward[2] < 0:
        upward = -upward
    return ahead, upward


def _integral(span: Array, chord: Array, edges: Array) -> Array:
    """Area from the root to each edge under a piecewise linear chord (exact)."""
    slices = np.diff(span) * (chord[1:] + chord[:-1]) / 2
    area = np.concatenate([[0.0], np.cumsum(slices)])
    left = np.clip(np.searchsorted(span, edges, side="right") - 1, 0, len(span) - 2)
    step = edges - span[left]
    slope = (chord[left + 1] - chord[left]) / (span[left + 1] - span[left])
    return np.asarray(area[left] + step * (chord[left] + slope * step / 2))


def _triple(vector: Array) -> tuple[float, float, float]:
    x, y, z = (_clean(float(k)) for k in vector)
    return (x, y, z)


def _clean(value: float) -> float:
    """Fifteen digits, and an exact zero where rounding left a trace: zeros are structure."""
    return float(f"{value:.15g}") if abs(value) > 1e-16 else 0.0

"""Wings are cut into strips that keep area, place and twist."""

import numpy as np
import pytest

from patagium.robot.assembly import cut_wing
from patagium.robot.schema import WingPart


def _wing(**segment: object) -> WingPart:
    described = {"body": "plate", "strips": 3, **segment}
    return WingPart.model_validate({"name": "wing", "segments": [described]})


TAPERED = [
    {"span": 0.1, "leading": 0.02, "trailing": -0.08},
    {"span": 0.2, "leading": 0.03, "trailing": -0.05},
    {"span": 0.5, "leading": 0.01, "trailing": 0.01},
]


@pytest.mark.parametrize("strips", [1, 2, 3, 7, 50])
def test_strips_keep_the_area_whatever_their_number(strips):
    cut = list(cut_wing(_wing(stations=TAPERED, strips=strips), {"plate": 4}))
    area = sum(s.chord * s.width for s in cut)
    assert area == pytest.approx(0.1 * 0.09 + 0.3 * 0.04, rel=1e-13)
    assert {round(s.width, 14) for s in cut} == {round(0.4 / strips, 14)}
    assert {s.body for s in cut} == {4}
    assert [s.name for s in cut] == [f"wing[{i}]" for i in range(strips)]


def test_quarter_chord_lies_behind_the_leading_edge_at_mid_strip():
    (strip,) = cut_wing(_wing(stations=TAPERED[:2], strips=1, at=[0.01, 0.02, 0.03]), {"plate": 0})
    chord = 0.09
    expected = (0.01 + 0.025 - chord / 4, 0.02 + 0.15, 0.03)
    assert strip.quarter_chord == pytest.approx(expected, rel=1e-14)
    assert strip.chord == pytest.approx(chord, rel=1e-14)


@pytest.mark.parametrize(
    ("span_axis", "normal"),
    [
        ("y", (0, 0, 1)),
        ("-y", (0, 0, 1)),
        ("z", (0, -1, 0)),
        ([0, 1, 1], (0, -(0.5**0.5), 0.5**0.5)),
    ],
)
def test_normal_is_across_chord_and_span_and_never_down(span_axis, normal):
    (strip,) = cut_wing(_wing(stations=TAPERED[:2], strips=1, span_axis=span_axis), {"plate": 0})
    assert strip.normal == pytest.approx(normal, abs=1e-15)
    assert strip.forward == (1, 0, 0)


@pytest.mark.parametrize("span_axis", ["y", "-y"])
def test_positive_incidence_lifts_the_leading_edge(span_axis):
    stations = [{**k, "incidence": "10 deg"} for k in TAPERED[:2]]
    (strip,) = cut_wing(_wing(stations=stations, strips=1, span_axis=span_axis), {"plate": 0})
    angle = np.radians(10)
    assert strip.forward == pytest.approx((np.cos(angle), 0, np.sin(angle)), rel=1e-14)
    assert strip.normal == pytest.approx((-np.sin(angle), 0, np.cos(angle)), rel=1e-14)


def test_incidence_is_interpolated_along_the_span():
    stations = [{**TAPERED[0], "incidence": 0.0}, {**TAPERED[1], "incidence": 0.2}]
    cut = list(cut_wing(_wing(stations=stations, strips=2), {"plate": 0}))
    assert [np.arcsin(s.forward[2]) for s in cut] == pytest.approx([0.05, 0.15], rel=1e-13)


def test_strips_of_several_segments_are_numbered_outwards():
    inner = {"body": "a", "strips": 2, "stations": TAPERED[:2]}
    outer = {"body": "b", "strips": 1, "stations": TAPERED[1:]}
    wing = WingPart.model_validate({"name": "w", "segments": [inner, outer]})
    cut = list(cut_wing(wing, {"a": 0, "b": 1}))
    assert [(s.name, s.body) for s in cut] == [("w[0]", 0), ("w[1]", 0), ("w[2]", 1)]

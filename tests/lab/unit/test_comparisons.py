"""Figures that compare methods say what they were given."""

from __future__ import annotations

import numpy as np
import pytest

from patagium.errors import ShapeError
from patagium.report.style import legend_columns, width
from patagium_lab import comparisons as figures


def test_score_points_refuse_another_number_of_scores() -> None:
    with pytest.raises(ShapeError, match="ours"):
        figures.score_points(["x", "y"], {"ours": [1.0]})


def test_time_points_write_the_times_out() -> None:
    figure = figures.time_points({"D": {"ours": 4e-7, "rival": 3e-4}, "bias": {"ours": 5e-7}})
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert texts == ["400 ns", "500 ns", "300 µs"]
    assert figure.axes[0].get_xscale() == "log"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (9.996e-7, "1 µs"),
        (4.56e-9, "4.56 ns"),
        (0.0123, "12.3 ms"),
        (61.0, "61 s"),
        (450.0, "7.5 min"),
    ],
)
def test_seconds_read_in_their_unit(seconds: float, text: str) -> None:
    assert figures.seconds_text(seconds) == text


def test_learning_curve_is_a_running_mean() -> None:
    time = np.arange(100) * 0.01
    figure = figures.learning_curves(time, {"a": np.full(100, 3.0)}, span=0.1)
    np.testing.assert_allclose(
        figure.axes[0].get_lines()[0].get_ydata(), 3.0, rtol=1e-12
    )  # rounding


@pytest.mark.parametrize("words", [1, 3, 6])
def test_legend_stays_on_the_page(words: int) -> None:
    labels = [f"{' '.join(['network'] * words)} {i}" for i in range(7)]
    figure = figures.time_points({"D": dict.fromkeys(labels, 1e-3)})
    figure.draw_without_rendering()
    assert figure.legends[0].get_window_extent().x1 / figure.dpi <= width()
    assert legend_columns(["short"] * 7) == 5

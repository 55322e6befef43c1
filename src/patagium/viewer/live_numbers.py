"""Numbers of a live page as a small table, with their units."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from patagium.viewer.live_frames import Subject, message_of_frame

Row = tuple[str, str]

_STYLE = (
    "width:100%;border-collapse:collapse;font-size:13px;line-height:1.5;"
    "font-variant-numeric:tabular-nums"
)


def flight_rows(letter: Any, subject: Subject, pace: float) -> list[Row]:
    """Rows about the flight.

    Args:
        letter: The last frame.
        subject: Subject of the page.
        pace: Time flown over time on the clock.
    """
    rows = [("Time", f"{letter['time']:.2f} s")]
    base = next((b for b in subject.robot.bodies if b.floating_dofs is not None), None)
    if base is not None:
        along = list(base.floating_dofs or ())[:3]
        place = list(subject.robot.floating_coordinates(base))[:3]
        rows.append(("Speed", f"{np.linalg.norm(letter['v'][along]):.2f} m/s"))
        rows.append(("Position", "{:.2f}, {:.2f}, {:.2f} m".format(*letter["q"][place])))
    if subject.steering is not None:
        beat = f"{letter['frequency']:.2f} Hz, amplitude {letter['amplitude']:.0%}"
        rows.append(("Wingbeat", beat))
    if not letter["paused"]:
        rows.append(("Pace", f"{_number(pace, '.2f')} × real time"))
    return rows


def learner_rows(letter: Any, rate: float) -> list[Row]:
    """Rows about the learner.

    Args:
        letter: The last frame.
        rate: Samples a second on the clock [1/s].
    """
    rows = [
        ("Error (NMSE)", _number(letter["nmse"], ".2e")),
        ("In the 95 % interval", _number(100 * letter["coverage"], ".1f", " %")),
        ("Samples", f"{int(letter['samples']):,}".replace(",", " ")),
        ("Rate", _number(rate, ".0f", " /s")),
        ("Time a sample", _number(1e6 * letter["time_per_call"], ".1f", " µs")),
    ]
    if letter["load"] > 0:
        rows.append(("Load", _number(100 * letter["load"], ".0f", " %")))
    if letter["share"] > 1:
        rows.append(("Learned from", f"1 sample in {letter['share']:.0f}"))
    if letter["failed"]:
        rows.append(("Not learned", f"{int(letter['failed'])}"))
    return rows


def picture_rows(drawn: int, sent: int, meters_per_newton: float) -> list[Row]:
    """Rows about the picture.

    Args:
        drawn: Frames drawn.
        sent: Frames sent.
        meters_per_newton: Length of arrows.
    """
    rows = [("Frames drawn", f"{drawn} of {sent} sent")]
    if meters_per_newton > 0:
        rows.append(("Arrows", f"1 N is {100 * meters_per_newton:g} cm"))
    return rows


def table(*groups: Sequence[Row], key: Sequence[tuple[str, str]], letter: Any) -> str:
    """Groups of rows as HTML, with a message above them and the key of the colors below.

    Args:
        *groups: Names and values.
        key: What each color stands for.
        letter: The last frame, for its words.
    """
    words = message_of_frame(letter)
    tint = "#8f2d1d" if letter["ended"] else "#46627a"
    said = f'<p style="margin:0 0 6px;color:{tint};font-size:13px"><b>{escape(words)}</b></p>'
    lines: list[str] = []
    for group in groups:
        for place, (name, value) in enumerate(group):
            line = "border-top:1px solid #dbe2e8;" if place == 0 and lines else ""
            lines.append(
                f'<tr style="{line}"><td style="color:#5b6770">{escape(name)}</td>'
                f'<td style="text-align:right">{escape(value)}</td></tr>'
            )
    marks = " &nbsp; ".join(
        f'<span style="color:{color}">&#9632;</span> {escape(name)}' for name, color in key
    )
    return (
        f'<div id="live-numbers" style="padding:4px 12px 8px">{said if words else ""}'
        f'<table style="{_STYLE}">{"".join(lines)}</table>'
        f'<p style="margin:6px 0 0;font-size:12px">Force of the air: {marks}</p></div>'
    )


def _number(value: float, kind: str, unit: str = "") -> str:
    return f"{value:{kind}}{unit}" if np.isfinite(value) else "–"

"""The page of the bench of learners: tables and the figure of accuracy against time.

Everything on the page is computed from the rows. Neglected: significance; one start of the
weights, one flight each.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from patagium.report import PageSection, Table, cell_text, picture, write_page
from patagium.report.style import TRUTH, color, panels, styled
from patagium_lab.learners.entries import SPANS

Row = dict[str, Any]
SUMMARY = (
    "Our learners and other programs', on the same flights and the same log, every sample, each "
    "tuned by the same search: what an update costs, what it predicts, what its interval is worth."
)


def write_learners(path: str | Path, found: dict[str, Any]) -> Path:
    """The page.

    Args:
        path: File to write, Markdown or HTML.
        found: What `run_learners` gave.
    """
    facts = {"made by": "`patagium bench learners`", **found["conditions"]}
    title, sections = "Learners and their rivals", learners_sections(found)
    return write_page(path, title, sections, summary=SUMMARY, facts=facts)


def learners_sections(found: dict[str, Any]) -> list[PageSection]:
    """The page in reading order.

    Args:
        found: What `run_learners` gave.
    """
    plan, courses = found["plan"], found["courses"]
    caption = (
        f"Error 10 ms ahead after {plan['after'][-1]:g} s (or where a learner stopped, hollow) "
        "against the time of an update; numbers are those of the tables, blue ours, orange other "
        "programs', the dashed line is the last used sample held."
    )
    figure = picture(accuracy_against_time(courses), caption)
    return [
        PageSection("Error against time", [figure]),
        PageSection("How they were raced", _rules(plan)),
        *(_course(course, plan) for course in courses),
        PageSection("What was chosen", [_settings(courses)]),
    ]


def _rules(plan: Row) -> list[str]:
    spans = ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in SPANS.items())
    later = ", ".join(f"{t:g}" for t in plan["after"][1:])
    tuning = f"{plan['tuning']:g} s"
    return [
        "Every learner sees the same samples, 1,000 a second, in order. After each it predicts "
        "the samples until the next (hold), the next 10 ms, and one wingbeat (0.1 s for the "
        "quadrotor), its weights frozen and the true states given. Errors are mean square errors "
        "over the variance of the same samples, mean over the outputs that move from the start, "
        "in the wingbeat that follows the time at the head of a column. The interval is that "
        f"of 95 % at the next used sample, checked after {later} s: as it is, and scaled by the "
        "one factor that would have fitted the first part of the course.",
        f"**Each at its best by the same search.** On the first {tuning} of each course, "
        f"{plan['draws']} settings spread evenly over the same spans ({spans}; logarithmic) are "
        "tried for every learner, ours and others': all on its first quarter, the best quarter of "
        "them on the whole of it, by the error 10 ms ahead in the second half of what is flown. "
        f"Columns up to {tuning} are thus of samples the search has seen, later ones are "
        "not. A filter that is another's twin, equal to "
        "rounding or the same in single precision, takes its twin's setting: filterpy, Stone "
        "Soup and Algorithm 1 that of our cubature filter with points at √n (tests hold them to "
        "1e-8), dynamax that of our extended filter (to 1e-6: it adds 1e-9 to a diagonal). "
        "Roundings grow over thousands of samples where the measurement is taken to be nearly "
        "exact.",
        "**Dense learners share one network**, the paper's size on the flights (28-20-14, "
        "softplus, 874 weights) and 7-8-8-1 on the log, the same scales and the same first "
        "weights. pytagi has no softplus: its layers are ReLU, its first weights its own draw. "
        "The strip network (114 weights) knows the wings' geometry. Other programs' filters "
        "forget as ours do (covariance over a factor before each sample), but LoFi, which has a "
        "process noise of its own. filterpy is spared its time update, which would send all "
        "points through the identity. JAX computes in double precision, compiled, one sample a "
        "call.",
        "**Where they come from.** filterpy, Stone Soup and pytagi (before 0.2, which wants MPI) "
        "come with the extra `bench`. dynamax and rebayes-mini bring JAX, 350 MB of it, and a "
        "nightly build of TensorFlow Probability that a lock cannot hold: they take part where "
        "somebody installed them.",
        "**Time.** Median of an update as a Python caller sees it, all in turns on one core. "
        f"An entry may take {plan['limit']:g} s of processor time a course "
        f"({plan['twin_limit']:g} s if it is another program's twin): what slow ones did not "
        "reach is left empty.",
    ]


def _course(course: Row, plan: Row) -> PageSection:
    after = [f"{t:g}" for t in plan["after"]]
    rows = _numbered(course["rows"])
    ahead = Table(
        ("#", "learner", "program", "weights", "µs an update", *(f"{t} s" for t in after),
         "inside 95 %", "scaled", "samples"),
        [[number, row["title"], row["program"], row["weights"] or None, row["microseconds"],
          *(_error(row, t, "short") for t in after), _share(row["coverage"]),
          _share(row["scaled"]), _samples(row)]
         for number, row in rows],
        "Error 10 ms ahead, after so many seconds of flight.",
    )  # fmt: skip
    hold = f"{1e3 * course['hold']:.3g} ms"
    further = Table(
        ("#", "learner", *(f"hold after {t} s" for t in after),
         *(f"{course['beat_name']} after {t} s" for t in after)),
        [[number, row["title"], *(_error(row, t, "hold") for t in after),
          *(_error(row, t, "long") for t in after)] for number, row in rows],
        f"Error over the hold interval of {hold}, and over {course['beat_name']} "
        f"({course['beat']:.3g} s), weights frozen.",
    )  # fmt: skip
    said = (_front(course, plan), _behind(course, plan), _faster(course))
    return PageSection(course["title"], [course["note"], ahead, further, *said])


def _front(course: Row, plan: Row) -> str:
    """Who is beaten by nobody in time and error at once."""
    last = f"{plan['after'][-1]:g}"
    able = [
        (row["microseconds"], row["errors"][last]["short"], f"{row['title']} ({number})")
        for number, row in _numbered(course["rows"])
        if row["microseconds"] and last in row["errors"]
    ]
    best = [
        name
        for time, error, name in sorted(able)
        if np.isfinite(error) and not any(t < time and e <= error for t, e, _ in able)
    ]
    if not best:
        return f"Nobody came to {last} s."
    return (
        f"Nobody is both faster and better after {last} s than, from the fastest to the best: "
        f"{'; '.join(best)}."
    )


def _behind(course: Row, plan: Row) -> str:
    """Who would have done better to hold the last sample."""
    last = f"{plan['after'][-1]:g}"
    errors = {
        f"{row['title']} ({number})": row["errors"][last]["short"]
        for number, row in _numbered(course["rows"])
        if last in row["errors"]
    }
    held = next((e for name, e in errors.items() if name.endswith("(0)")), np.inf)
    worse = [name for name, error in errors.items() if not error <= held]
    return f"Worse there than the last used sample held: {'; '.join(worse) or 'nobody'}."


def _faster(course: Row) -> str:
    """How much faster ours are than the same filter elsewhere."""
    times = {row["key"]: row["microseconds"] for row in course["rows"] if row["microseconds"]}
    pairs = [
        f"{row['program'] if row['program'] != 'patagium' else row['title']} takes "
        f"{cell_text(times[row['key']] / times[row['twin']])} times as long"
        for row in course["rows"]
        if row["key"] in times and row["twin"] in times and not row["key"].endswith("32")
    ]
    return f"The same filter elsewhere, beside ours: {'; '.join(pairs) or 'none timed'}."


def _settings(courses: Sequence[Row]) -> Table:
    rows = [
        [f"{row['title']} ({number})", course["key"], *(row["setting"].get(k) for k in SPANS)]
        for course in courses
        for number, row in _numbered(course["rows"])
        if row["setting"] and not row["twin"]
    ]
    caption = (
        "Prior deviation (times 1/√fan-in), measurement deviation (in scales of the output), "
        "memory (in samples), spread, step, wandering (of the prior), gain."
    )
    return Table(("learner", "course", *SPANS), rows, caption)


def _numbered(rows: Sequence[Row]) -> list[tuple[int, Row]]:
    """Rows with the number of their entry, the same on all courses."""
    from patagium_lab.learners.entries import ENTRIES

    numbers = {one.key: number for number, one in enumerate(ENTRIES)}
    return [(numbers[row["key"]], row) for row in rows]


def _error(row: Row, after: str, kind: str) -> float | None:
    value = row["errors"].get(after, {}).get(kind)
    return None if value is None else float(value)


def _share(share: float | None) -> str | None:
    return f"{100 * share:.0f} %" if share is not None and np.isfinite(share) else None


def _samples(row: Row) -> str:
    return f"{row['samples']}" if row["outcome"] == "completed" else (
        f"{row['samples']}, {row['outcome']}" if row["samples"] else str(row["outcome"])
    )  # fmt: skip


@styled
def accuracy_against_time(courses: Sequence[Row]) -> Figure:
    """Error 10 ms ahead against the time of an update, one panel a course.

    Args:
        courses: Of `run_learners`.
    """
    figure, axes = panels(1, len(courses), row_height=4.0)
    for panel, course in zip(axes[0], courses, strict=True):
        for number, row in _numbered(course["rows"]):
            errors = [one["short"] for one in row["errors"].values() if np.isfinite(one["short"])]
            if not errors:
                continue
            if row["key"] == "persistence":
                panel.axhline(errors[-1], color=TRUTH, linestyle="--", linewidth=0.9)
            elif row["microseconds"]:
                shade = color(1 if row["program"] == "patagium" else 0)
                whole = row["outcome"] == "completed"
                place = (row["microseconds"], errors[-1])
                panel.plot(*place, "o", markersize=10, markeredgecolor=shade,
                           color=shade if whole else "white")  # fmt: skip
                panel.annotate(str(number), place, ha="center", va="center", fontsize=7.0,
                               color="white" if whole else shade)  # fmt: skip
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_title(course["title"])
        panel.set_xlabel("time of an update [µs]")
        panel.margins(0.1)
    axes[0, 0].set_ylabel("error 10 ms ahead [1]")
    return figure

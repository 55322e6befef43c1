"""Page of the comparison of learners: tables, and the figure of accuracy against time.

Everything on the page is computed from the results. Neglected: statistical significance; there is
one start of the weights and one flight of each kind.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from patagium.report import Block, PageSection, Table, cell_text, picture
from patagium.report.style import TRUTH, color, panels, styled
from patagium_lab.learners.entries import ENTRIES, SPANS
from patagium_lab.study import Columns, Page, table_of

Row = dict[str, Any]
TITLE = "Learners and their rivals"
SUMMARY = (
    "Our learners and those of other programs learn the same flights and the same log, each with "
    "settings of the same search. The page shows the time of an update, the error of the "
    "predictions, and the coverage of the intervals."
)


def page(results: Row) -> Page:
    """Whole page of the comparison of learners.

    Args:
        results: Results of `run`.
    """
    plan, courses = results["plan"], results["courses"]
    caption = (
        f"Error 10 ms ahead after {plan['after'][-1]:g} s (hollow: where a learner stopped) "
        "against the time of an update. The numbers are those of the tables, our learners are "
        "blue, those of other programs orange, and the dashed line is the last used sample held."
    )
    figure = picture(accuracy_against_time(courses), caption)
    sections = [
        PageSection("Error against time", [figure]),
        PageSection("How they were raced", _rules(plan)),
        *(_course(course, plan) for course in courses),
        PageSection("What was chosen", [_settings(courses)]),
    ]
    facts = {"made by": "`patagium study bench learners`", **results["conditions"]}
    return Page(TITLE, SUMMARY, facts, sections)


def _rules(plan: Row) -> list[Block]:
    spans = ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in SPANS.items())
    later = ", ".join(f"{t:g}" for t in plan["after"][1:])
    tuning = f"{plan['tuning']:g} s"
    return [
        "Every learner sees the same samples, 1,000 a second, in order. After each it predicts "
        "the samples until the next (hold), the next 10 ms, and one wingbeat (0.1 s for the "
        "quadrotor), with frozen weights and from the true states. Errors are mean square errors "
        "over the variance of the same samples, mean over the outputs that move from the start, "
        "in the wingbeat that follows the time in the heading of a column. The interval is that "
        f"of 95 % at the next used sample, checked after {later} s: as it is, and scaled by the "
        "factor that would have fitted the first part of the data set.",
        f"**All settings come from the same search.** On the first {tuning} of each data set, "
        f"{plan['draws']} settings spread evenly over the same ranges ({spans}; logarithmic) are "
        "tried for every learner, ours and others': all on its first quarter, the best quarter of "
        "them on the whole of it, by the error 10 ms ahead in the second half of the samples "
        f"learned. Columns up to {tuning} thus hold samples that the search has seen, later "
        "columns do not. A filter that is another's twin, equal to rounding or the same in single "
        "precision, takes its twin's settings: filterpy, Stone Soup and Algorithm 1 take those of "
        "our cubature filter with points at √n (tests hold them to 1e-8), dynamax those of our "
        "extended filter (to 1e-6, because it adds 1e-9 to a diagonal). Rounding errors grow over "
        "thousands of samples where the measurement is taken to be nearly exact.",
        "**Dense learners share one network**, the paper's size on the flights (28-20-14, "
        "softplus, 874 weights) and 7-8-8-1 on the log, with the same scales and the same first "
        "weights. pytagi has no softplus: its layers are ReLU, and it draws its own first weights. "
        "The strip network (114 weights) knows the wings' geometry. Other programs' filters "
        "forget as ours do (covariance over a factor before each sample), except LoFi, which has "
        "a process noise of its own. filterpy goes without its time update, which would send all "
        "points through the identity. JAX computes in double precision, compiled, one sample a "
        "call.",
        "**Programs.** filterpy, Stone Soup and pytagi (before 0.2, which wants MPI) come with the "
        "extra `bench`. dynamax and rebayes-mini bring JAX, 350 MB of it, and a nightly build of "
        "TensorFlow Probability that a lock file cannot hold: they take part where they are "
        "installed.",
        "**Time.** It is the median of an update as a Python caller sees it, all in turns on one "
        f"core. An entry may take {plan['limit']:g} s of processor time a data set "
        f"({plan['twin_limit']:g} s if it is another program's twin); cells that it did not reach "
        "in that time are empty.",
    ]


def _course(course: Row, plan: Row) -> PageSection:
    after = [f"{t:g}" for t in plan["after"]]
    rows = _numbered(course["rows"])
    errors: Columns = {f"error after {t} s [1]": _error(t, "short") for t in after}
    ahead: Columns = {
        "#": "number",
        "learner": "title",
        "program": "program",
        "weights": lambda row: row["weights"] or None,
        "time of an update [µs]": "microseconds",
        **errors,
        "inside 95 %": lambda row: _share(row["coverage"]),
        "inside 95 %, scaled": lambda row: _share(row["scaled"]),
        "samples": _samples,
    }
    beat = course["beat_name"]
    further: Columns = {
        "#": "number",
        "learner": "title",
        **{f"hold, after {t} s [1]": _error(t, "hold") for t in after},
        **{f"{beat}, after {t} s [1]": _error(t, "long") for t in after},
    }
    hold = f"{1e3 * course['hold']:.3g} ms"
    tables = (
        table_of(ahead, rows, "Normalized error 10 ms ahead, by time of flight."),
        table_of(
            further,
            rows,
            f"Normalized error over the hold interval of {hold}, and over {beat} "
            f"({course['beat']:.3g} s), with frozen weights.",
        ),
    )
    findings = (_front(course, plan), _behind(course, plan), _faster(course))
    return PageSection(course["title"], [course["note"], *tables, *findings])


def _name(row: Row) -> str:
    """Name of an entry with its number."""
    return f"{row['title']} ({row['number']})"


def _front(course: Row, plan: Row) -> str:
    """Learners that no other learner beats in both time and error."""
    last = f"{plan['after'][-1]:g}"
    able = [
        (row["microseconds"], row["errors"][last]["short"], _name(row))
        for row in _numbered(course["rows"])
        if row["microseconds"] and last in row["errors"]
    ]
    best = [
        name
        for time, error, name in sorted(able)
        if np.isfinite(error) and not any(t < time and e <= error for t, e, _ in able)
    ]
    if not best:
        return f"No learner reached {last} s."
    return f"Pareto-optimal after {last} s (fastest first): {'; '.join(best)}."


def _behind(course: Row, plan: Row) -> str:
    """Learners with a larger error than the last used sample held."""
    last = f"{plan['after'][-1]:g}"
    errors = {
        _name(row): row["errors"][last]["short"]
        for row in _numbered(course["rows"])
        if last in row["errors"]
    }
    held = next((e for name, e in errors.items() if name.endswith("(0)")), np.inf)
    worse = [name for name, error in errors.items() if not error <= held]
    return f"Worse after {last} s than the last used sample held: {'; '.join(worse) or 'none'}."


def _faster(course: Row) -> str:
    """Time of the same filter in other programs, over ours."""
    times = {row["key"]: row["microseconds"] for row in course["rows"] if row["microseconds"]}
    pairs = [
        f"{row['program'] if row['program'] != 'patagium' else row['title']} takes "
        f"{cell_text(times[row['key']] / times[row['twin']])} times as long as ours"
        for row in course["rows"]
        if row["key"] in times and row["twin"] in times and not row["key"].endswith("32")
    ]
    return f"The same filter in other programs: {'; '.join(pairs) or 'none was timed'}."


def _settings(courses: Sequence[Row]) -> Table:
    rows = [
        {"name": _name(row), "data set": course["key"], **row["setting"]}
        for course in courses
        for row in _numbered(course["rows"])
        if row["setting"] and not row["twin"]
    ]
    columns = {"learner": "name", "data set": "data set", **_SETTINGS}
    return table_of(columns, rows, "Settings that the search chose.")


_SETTINGS = {
    "prior std times √fan-in [1]": "prior",
    "noise std over output scale [1]": "noise",
    "memory [samples]": "memory",
    "spread [std]": "spread",
    "step size [1]": "rate",
    "process std over prior std [1]": "wander",
    "gain [1]": "gain",
}


def _numbered(rows: Sequence[Row]) -> list[Row]:
    """Rows with the number of their entry, which is the same on all data sets."""
    numbers = {one.key: number for number, one in enumerate(ENTRIES)}
    return [{"number": numbers[row["key"]], **row} for row in rows]


def _error(after: str, horizon: str) -> Callable[[Mapping[str, Any]], float | None]:
    """Cell of an error after a time, at a horizon."""

    def cell(row: Mapping[str, Any]) -> float | None:
        value = row["errors"].get(after, {}).get(horizon)
        return None if value is None else float(value)

    return cell


def _share(share: float | None) -> str | None:
    return f"{100 * share:.0f} %" if share is not None and np.isfinite(share) else None


def _samples(row: Mapping[str, Any]) -> str:
    return f"{row['samples']}" if row["outcome"] == "completed" else (
        f"{row['samples']}, {row['outcome']}" if row["samples"] else str(row["outcome"])
    )  # fmt: skip


@styled
def accuracy_against_time(courses: Sequence[Row]) -> Figure:
    """Figure of the error 10 ms ahead against the time of an update, one panel a data set.

    Args:
        courses: Results of each data set.
    """
    figure, axes = panels(1, len(courses), row_height=4.0)
    for panel, course in zip(axes[0], courses, strict=True):
        for row in _numbered(course["rows"]):
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
                panel.annotate(str(row["number"]), place, ha="center", va="center", fontsize=7.0,
                               color="white" if whole else shade)  # fmt: skip
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_title(course["title"])
        panel.set_xlabel("time of an update [µs]")
        panel.margins(0.1)
    axes[0, 0].set_ylabel("error 10 ms ahead [1]")
    return figure

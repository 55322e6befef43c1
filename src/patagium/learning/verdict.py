"""Verdict on the scores of an identification in words: its intervals, and what to beware of.

Neglected: luck, but for logs too short for any verdict.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import isfinite, sqrt
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from patagium.arrays import Array, Indices
from patagium.errors import Outcome
from patagium.learning.models.linear_strip import LinearStripNetwork
from patagium.learning.models.memory import network_inputs
from patagium.learning.models.network import Network
from patagium.learning.scores import INTERVAL, ErrorSums

_RIGHT = 0.88, 0.99  # shares in the 95 % interval that are about right
_NIS = 3.0  # times too large or too small
_MARGIN = 1.2  # times: NMSEs of noise differ by 3 sqrt(2/N) by chance, N = 450 samples
_TOLD = 3  # outputs that are named
_SMALL = 1e-6  # NMSE: errors below a thousandth of the standard deviation of each output
_UPDATES, _SAMPLES = 20, 60  # about a wingbeat of updates, and samples, of which half are scored
UNSEEN = 0.05
"""Share of samples in flow that was not learned, beyond which there is a warning."""
Block: TypeAlias = tuple[Array, Array, Array, ArrayLike, Indices | slice]
"""Times, x and y of samples, the first sample after each gap, and the rows that count."""


def with_verdict(scores: Mapping[str, Any]) -> dict[str, Any]:
    """Scores, and the verdict on them as "verdict": sentences, warnings last."""
    done = scores["outcome"] == Outcome.COMPLETED.name and "nmse_second_half" in scores
    if not done:
        return {**scores, "verdict": []}
    words = _short_words(scores) or [*_interval_words(scores), *_error_words(scores)]
    return {**scores, "verdict": [*words, *_warnings(scores)]}


def _short_words(scores: Mapping[str, Any]) -> list[str]:
    """Warning of a log too short for its errors and intervals to be judged."""
    found = {"samples": (scores["samples_predicted"], _SAMPLES)}
    if "frozen" not in scores:
        found["updates"] = scores["updates"], _UPDATES
    told = ", ".join(f"{n} {what} (of {least} at least)" for what, (n, least) in found.items())
    short = any(n < least for n, least in found.values())
    return [f"Warning: the log is too short to judge errors and intervals: {told}."] * short


def frozen_scores(network: Network, blocks: Iterable[Block], *weights: Array) -> dict[str, Any]:
    """NMSE of constant weights in rows of a log: physics alone, and weights that are given."""
    kinds = dict(zip(["frozen_second_half"], weights, strict=False))
    if isinstance(network, LinearStripNetwork):
        kinds["physics_second_half"] = network.initial(0)
    scale, names = getattr(network, "output_scale", 1.0), network.output_names
    sums = {name: ErrorSums(network.outputs, scale) for name in kinds}
    for time, x, y, gaps, rows in blocks:
        for name, kept in kinds.items():
            seen = network_inputs(network, kept, time, x, gaps)[rows]
            sums[name].add(y[rows], network.evaluate(seen, kept))
    return {key: dict(zip(names, one.nmse.tolist(), strict=True)) for key, one in sums.items()}


def _interval_words(scores: Mapping[str, Any]) -> list[str]:
    coverage, nis = scores["coverage_second_half"], scores["nis_second_half"]
    if not isfinite(coverage):
        return []
    inside = f"{100 * coverage:.0f} % of the errors are inside the 95 % interval"
    if coverage < _RIGHT[0]:
        reach = float(ndtri((1 + coverage) / 2))
        times = f"{INTERVAL / reach:.2g} times" if reach > 0 else "far"
        return [f"Intervals {times} too narrow ({inside})."]
    wide = 1 / sqrt(nis) if nis > 0 else float("inf")
    if coverage > _RIGHT[1] and wide**2 > _NIS:
        return [f"Intervals {wide:.2g} times too wide ({inside})."]
    each = scores["coverage_second_half_by_output"].items()
    narrow = ", ".join(f"{k} ({100 * one:.0f} %)" for k, one in each if one < _RIGHT[0])
    if narrow:
        return [f"Intervals about right in the mean ({inside}), but too narrow for {narrow}."]
    return [f"Intervals about right{', but for a few errors' * (nis > _NIS)} ({inside})."]


def _error_words(scores: Mapping[str, Any]) -> list[str]:
    """Warnings of errors larger than those of others, or than predicted."""
    warnings, error = [], scores["nmse_second_half"]
    rivals = {
        "persistence_second_half": "a measured sample, held",
        "physics_second_half": "physics alone, with nothing learned",
    }
    for key, rival in rivals.items():
        other = scores.get(key, {})
        names = [k for k, e in error.items() if e > max(_MARGIN * other.get(k, np.inf), _SMALL)]
        if names:
            outputs = f"{len(names)} outputs" if len(names) > _TOLD else ", ".join(names)
            warnings.append(f"Warning: the error of {outputs} is larger than that of {rival}.")
    return warnings + _frozen_words(scores) + _nis_words(scores)


def _warnings(scores: Mapping[str, Any]) -> list[str]:
    """Warnings of samples that taught nothing, of parameters and of flow that was not learned."""
    warnings, error = [], scores["nmse_second_half"]
    count, learned = scores["updates"], scores.get("updates_learned", 0)
    if learned < 0.99 * count and (learned or scores["events"]):
        events = ", ".join(f"{name} {number}" for name, number in scores["events"].items())
        text = f"{count - learned} of the {count} samples to learn from taught nothing"
        jumped = scores["events"].get("jumps", 0) > 0.05 * count
        remedy = " Of inputs that may jump, say `network.inputs_jump = True` before." * jumped
        warnings.append(f"Warning: {text} (events so far: {events}).{remedy}")
    if problem := scores.get("parameter_problem"):
        lost = ", ".join(name for name, one in error.items() if one >= 1)
        told = f" Nothing was learned of {lost}, as if they held noise alone." * bool(lost)
        warnings.append(f"Warning: no flight is made in this air. {problem}.{told}")
    unseen = scores.get("unseen_share", 0.0)
    if unseen > UNSEEN:
        warnings.append(
            f"Warning: {100 * unseen:.0f} % of the samples are flow that was not learned: there "
            "the weights alone make the prediction three times as uncertain as they used to."
        )
    return warnings


def _frozen_words(scores: Mapping[str, Any]) -> list[str]:
    """Warning if the last weights, kept fixed, predict the log far worse than while learning."""
    frozen, held = (scores.get(k, {}) for k in ("frozen_second_half", "persistence_second_half"))
    error, names = scores["nmse_second_half"], []
    physics = scores.get("physics_second_half")  # its carried error may rightly do more
    other = held if physics is None else physics
    for name, value in error.items():
        late = frozen.get(name, 0.0)
        far = late > max(10 * value, _MARGIN * other.get(name, np.inf), _SMALL)
        names += [name] * (far or (value < 1 and late > _MARGIN))
    if not names:
        return []
    names.sort(key=lambda name: float(error[name] / frozen[name]))
    told = ", ".join(f"{frozen[name]:.2g} for {name}" for name in names[:_TOLD])
    text = f"with the last weights, the NMSE would be {told}"
    text += ": the weights follow this log, and are no model of it"
    remedy = ". If the machine does not change, try `--prior-share 0 --noise-memory 1000`"
    return [f"Warning: {text}{remedy * (physics is None)}."]


def _nis_words(scores: Mapping[str, Any]) -> list[str]:
    """Warning of squared errors that are not what was predicted, in the mean or of an output."""
    error, nis = scores["nmse_second_half"], scores["nis_second_half"]
    if not isfinite(nis):
        return []
    if 1 / _NIS <= nis <= _NIS:
        each = scores["nis_second_half_by_output"].items()
        far = [(k, one) for k, one in each if not 1 / _NIS <= one <= _NIS and error[k] >= _SMALL]
        told = ", ".join(f"{one:.2g} times of {name}" for name, one in far)
        return [f"Warning: squared errors over what was predicted (NIS): {told}."] * bool(far)
    times = f"squared errors are {nis:.2g} times what was predicted (NIS)"
    if max(error.values()) < _SMALL:
        small = "below a thousandth of the standard deviation of each output"
        return [f"Note: {times}, but errors are {small}."]
    few = nis > _NIS and scores["coverage_second_half"] >= _RIGHT[0]
    few &= "outliers" not in scores.get("events", ("outliers",))  # nor of frozen weights
    remedy = "; if a few samples are wild, `--outlier-std 5` (`Screening`) weighs them less"
    return [f"Warning: {times}{remedy * few}."]

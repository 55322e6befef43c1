"""Learners through faults, damage and long runs, on a small scale."""

from __future__ import annotations

import json
import os
import warnings
from dataclasses import replace

import numpy as np
import pytest

import patagium as pt
from patagium.cli.main import run
from patagium.errors import ParameterError
from patagium.learning.filters.screening import ChangeMonitor
from patagium.learning.settings import ChangeDetection
from patagium_lab.attack import run as study
from patagium_lab.attack.calibration import flight_calibration
from patagium_lab.attack.campaign import (
    FIRST,
    WORST_RATIO,
    LearnerKind,
    fault_free,
    learner_of,
    measured_flight,
    one_run,
    run_fault,
    run_kill,
)
from patagium_lab.attack.damage import (
    BEAT,
    LONG,
    damaged,
    damaged_flight,
    filter_learner,
    recovery,
)
from patagium_lab.attack.endurance import single_precision, steady_glide
from patagium_lab.attack.faults import FAULTS
from patagium_lab.attack.motion_capture import capture_row, capture_rows
from patagium_lab.attack.plan import AttackPlan

KINDS = (
    LearnerKind("strip", "full", "float32", detects=True, seed=0),
    LearnerKind("dense", "node", "float64", detects=False, seed=1),
    LearnerKind("dense", "node", "float32", detects=True, seed=0),
)


@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.parametrize("kind", KINDS, ids=["strip full", "dense node", "dense node single"])
def test_a_fault_is_counted_and_survived(kind, name) -> None:
    row = run_fault(kind, FAULTS[name], np.random.default_rng([7, len(name)]))
    assert row["crash"] == "" and row["finite"] and row["definite"]
    assert row["counted"], row["events"]
    assert row["ratio"] <= WORST_RATIO


@pytest.mark.parametrize("name", ["spikes", "stuck"])
def test_the_campaign_would_see_a_learner_that_does_not_screen(name) -> None:
    """By its counts: the bounds ahead of every filter keep it alive."""
    row = run_fault(
        replace(KINDS[0], screened=False), FAULTS[name], np.random.default_rng([7, len(name)])
    )
    assert row["crash"] == "" and not row["counted"]


def test_a_twin_goes_on_bit_for_bit_from_where_the_fault_begins() -> None:
    kind = KINDS[0]
    twin, feed, learner = fault_free(kind), measured_flight(kind.seed).feed, learner_of(kind)
    for k in range(FIRST):
        learner.update(feed.x[k], feed.y[k], feed.time[k])
    other = learner_of(kind)
    other.resume(twin.state)
    assert (learner.weights == other.weights).all()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_no_state_is_lost_to_kill_9() -> None:
    rows = [run_kill(kind, np.random.default_rng([5, k])) for k, kind in enumerate(KINDS)]
    assert [row["lost"] for row in rows] == [False] * len(KINDS)


def test_a_run_is_drawn_from_seed_and_number() -> None:
    once, again = one_run(2, 1), one_run(2, 1)
    assert once == again and once["fault"] == "no input"
    assert once["events"] != one_run(3, 1)["events"]


@pytest.fixture(scope="module")
def broken():
    return damaged_flight((5, 3))


def test_damage_takes_a_third_of_one_wing_and_no_step_in_motion(broken) -> None:
    robot = pt.load_robot("aerobat")
    area = [
        {
            side: sum(s.chord * s.width for s in machine.strips if s.wing.startswith(side))
            for side in ("left", "right")
        }
        for machine in (robot, damaged(robot))
    ]
    assert area[1]["left"] == pytest.approx(2 / 3 * area[0]["left"])
    assert area[1]["right"] == area[0]["right"]
    trailing = [s.quarter_chord[0] + s.chord / 4 for m in (robot, damaged(robot)) for s in m.strips]
    np.testing.assert_allclose(trailing, trailing[0])  # the leading edge is still there
    steps = np.abs(np.diff(broken.x[:, : robot.dof], axis=0)).max(axis=1)
    assert steps[5 * BEAT - 1] <= steps.max()
    jump = np.abs(np.diff(broken.y, axis=0)).max(axis=1)
    assert jump.argmax() == 5 * BEAT - 1  # and the force has one


@pytest.fixture(scope="module")
def rows_of_damage(broken):
    detection = ChangeDetection(1e-9, window=50, reference=BEAT, reopening=0.3)
    detections = {"found": detection, "blind": None}
    return [
        recovery(name, broken, filter_learner(LONG, each)).row()
        for name, each in detections.items()
    ]


def test_damage_is_found_and_unlearned_within_three_beats(rows_of_damage) -> None:
    found, blind = rows_of_damage
    assert found["detected"] is not None and blind["detected"] is None
    assert found["hold_beats"] <= 3 and found["ahead_beats"] <= 3
    worse = np.array(blind["hold_ratios"]) * blind["hold_former"]
    better = np.array(found["hold_ratios"]) * found["hold_former"]
    assert better[1] < 0.25 * worse[1]  # measured: a tenth


def test_a_filter_that_is_not_sure_calls_no_smaller_surprise_a_change() -> None:
    monitor = ChangeMonitor(ChangeDetection(1e-6, 10, 50), 3)
    quiet = [monitor.alarmed_by(3 * nis, 3) for nis in (*[0.05] * 60, *[0.8] * 40)]
    assert not any(quiet)  # sixteen times as large, and still less than was predicted
    assert any(monitor.alarmed_by(3 * 20.0, 3) for _ in range(10))


def test_a_steady_glide_stays_below_the_prior() -> None:
    found = steady_glide(4000, share=1e-2)  # 40 memories
    assert found["below_prior"] and found["smallest"] < 0.2
    assert found["samples"] == 4000


@pytest.fixture(scope="module")
def precision():
    return single_precision(50_000)


def test_single_precision_is_as_good_as_double(precision) -> None:
    assert precision["refused"] == {"float64": 0, "float32": 0} and precision["definite"]
    assert precision["ratio"] == pytest.approx(1.0, abs=0.1)
    assert precision["error"]["float64"] < 0.1  # it learned


@pytest.fixture(scope="module")
def small(rows_of_damage, precision):
    draw = np.random.default_rng(1)
    faulted = {"run": 1, "fault": "no input"} | run_fault(KINDS[1], FAULTS["no input"], draw)
    killed = {"run": 10, "fault": "kill -9 while saving"} | run_kill(KINDS[1], draw)
    areas = {
        "faults": [faulted, killed],
        "damage": rows_of_damage,
        "calibration": [flight_calibration(0.1, 0.05)],
        "endurance": {"glide": steady_glide(400, share=1e-2), "precision": precision},
        "captures": capture_rows(0, 12),
    }
    return study.AttackResults(2, areas)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_the_command_writes_page_and_figures(small, monkeypatch, tmp_path, capsys) -> None:
    asked = []

    def found(plan, former, stages):
        asked.append(plan)
        return small

    monkeypatch.setattr(study, "run", found)
    page = tmp_path / "page.html"
    with pytest.raises(SystemExit) as left, warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        run(["stress", "--runs", "3", "--seed", "2", "--jobs", "1", "-o", str(page), "--json"])
    assert not left.value.code
    assert (asked[0].runs, asked[0].seed, asked[0].workers) == (3, 2, 1)
    figures = json.loads(capsys.readouterr().out)
    assert [row["fault"] for row in figures["faults"]] == ["no input", "kill -9 while saving"]
    assert all(not row["crashes"] and not row["lost_states"] for row in figures["faults"])
    assert figures["calibration"][0]["reliability"]["0.95"] > 0.8
    motion = figures["motion_capture"]
    assert motion["seeds"] == 12 and motion["median_error_deg"] < 1.0  # as `--captures 200` shows
    assert 1 / 1.5 < motion["ratio_median"] < 1.5 and motion["share_beyond_four"] < 0.01
    assert motion["seeds_with_more_than_1_percent_beyond_four"] <= 1
    text = page.read_text("utf-8")
    assert "lost states" in text and text.count("<img") == 3


def test_no_runs_and_no_workers_are_refused() -> None:
    with pytest.raises(ParameterError, match="runs"):
        AttackPlan(runs=0)
    with pytest.raises(ParameterError, match="jobs"):
        AttackPlan(workers=0)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("structure", ["full", "layer", "node"])
def test_no_input_however_far_stops_a_screened_learner(structure, dtype) -> None:
    learner = pt.CubatureLearner(
        pt.DenseNetwork(3, (6,), 2),
        prior_std=0.5,
        measurement_std=1e-3,
        spread=3**0.5,
        covariance=structure,
        dtype=dtype,
        screening=pt.learning.Screening(),
    )
    for size in np.logspace(0, 300, 61):
        learner.update([size, -size, 1.0], np.ones(2))
        learner.update([0.1, 0.2, 0.3], np.ones(2))
    assert np.isfinite(learner.weights).all()
    assert learner.events["out_of_range"] > 0 and learner.count > 61


@pytest.mark.parametrize("seed", [44, 71, 132])
def test_white_noise_of_cameras_is_not_taken_for_colored(seed: int) -> None:
    """Frames that jitter, and turns summed in a tumble, looked so: two times too cautious."""
    row = capture_row(seed)
    assert 1 / 1.5 < row["ratio"] < 1.5  # what is asked of stated deviations

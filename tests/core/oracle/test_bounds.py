"""Bounds of what sensors can say: no sample ends a filter, clean data is not touched."""

from __future__ import annotations

import inspect
import re
from typing import Any

import numpy as np
import pytest

import patagium as pt
from patagium.learning import Misfit, NoiseEstimation, Screening
from patagium.learning.filters import bounds, misfit, screening
from patagium.learning.filters.block_kernel import structure_and_kernel
from patagium.learning.filters.bounds import Bounds
from patagium.learning.filters.numbers import filter_numbers
from patagium.learning.filters.weight_filter import WeightFilter
from patagium.learning.samples import samples
from patagium.learning.settings import FilterSettings
from patagium.native import compiler_name
from patagium.native.structs import header_numbers

STEP = 1e-3


def flapping(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Angles and rates of two joints, and a force, noise included."""
    time = STEP * np.arange(count)[:, None]
    phase = 2 * np.pi * np.array([4.0, 5.3]) * time + np.array([0.3, 1.1])
    x = np.hstack([0.7 * np.sin(phase), 20 * np.cos(phase)])
    y = np.stack([x[:, 0] * x[:, 2] / 20, x[:, 1] + x[:, 3] / 20], axis=1)
    return x, y + 0.02 * np.random.default_rng(3).normal(size=y.shape)


def network() -> pt.DenseNetwork:
    return pt.DenseNetwork(4, (5,), 2, input_scale=[1.0, 1.0, 20.0, 20.0])


def late_error(learner: Any, x: np.ndarray, y: np.ndarray, begin: int) -> float:
    each = [learner.update(x[k], y[k], STEP * k) for k in range(begin, len(x))]
    return float(np.sqrt(np.nanmean(np.square(each[100:]))))


KINDS: dict[str, Any] = {
    "extended": lambda **o: pt.ExtendedLearner(network(), **o),
    "cubature": lambda **o: pt.CubatureLearner(network(), **o),
    "single": lambda **o: pt.CubatureLearner(network(), dtype="float32", **o),
    "node": lambda **o: pt.CubatureLearner(network(), covariance="node", **o),
}
OPTIONS: dict[str, dict[str, Any]] = {
    "plain": {"measurement_std": 0.05},
    "screened, noise found": {"screening": Screening(), "noise_estimation": NoiseEstimation()},
    "misfit": {"misfit": Misfit()},
}


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("kind", KINDS)
def test_no_wild_sample_ends_a_learner(kind: str, options: str) -> None:
    """Inputs of 1e50, measurements of 1e150, extremes; 1.5 times the error of a twin."""
    x, y = flapping(800)
    learner, twin = (KINDS[kind](**OPTIONS[options]) for _ in range(2))
    for k in range(400):
        learner.update(x[k], y[k], STEP * k)
        twin.update(x[k], y[k], STEP * k)
    draw = np.random.default_rng(0)
    wild_x, wild_y = x[400:440].copy(), y[400:440].copy()
    wild_x[0, 1], wild_y[1] = 1e50, 1e150
    wild_x[2:20] *= 10.0 ** draw.uniform(2, 300, (18, 4))
    wild_y[20:] *= 10.0 ** draw.uniform(2, 300, (20, 2))
    for k in range(40):
        learner.update(wild_x[k], wild_y[k], STEP * (400 + k))
        twin.update(x[400 + k], y[400 + k], STEP * (400 + k))
    assert learner.events["bad_inputs"] == 19 and learner.events["out_of_range"] >= 19 + 2 * 21 - 1
    assert twin.events["bad_inputs"] == twin.events["out_of_range"] == 0
    assert late_error(learner, x, y, 440) < 1.5 * late_error(twin, x, y, 440)
    assert (learner.measurement_std < 1.0).all()


@pytest.mark.parametrize("size, refused", [(2e7, 0), (1e12, 50)])
def test_accelerations_of_an_insect_are_no_wild_values(size: float, refused: int) -> None:
    """A wing turns by 2e7 rad/s^2 at 700 Hz; nothing was learned of a log above 1e6."""
    learner = pt.ExtendedLearner(pt.DenseNetwork(1, (), 1), measurement_std=0.1)
    for k, x in enumerate(size * np.cos(0.3 * np.arange(50.0))):
        learner.update([x], [x / size], 1e-4 * k)
    assert (learner.count, learner.events["bad_inputs"]) == (50 - refused, refused)


@pytest.mark.parametrize("structure", ["full", "layer", "node"])
def test_kernels_bound_as_their_twins(structure: str, rng: np.random.Generator) -> None:
    """Spikes, an encoder that jumps for 25 samples, an offset that stays until the range opens."""
    if compiler_name() is None:
        pytest.skip("no C compiler here")
    settings = FilterSettings(measurement_std=0.1, covariance=structure, spread=3**0.5)
    numbers = filter_numbers(network(), settings, "cubature")
    fast, plain = (
        WeightFilter(numbers, structure_and_kernel(numbers, one), network().initial(0))
        for one in (True, False)
    )
    x, y = flapping(800)
    wild = rng.random(x.shape) < 0.01
    x[150:300][wild[150:300]] *= 10.0 ** rng.uniform(1, 300, wild[150:300].sum())
    y[200:210] *= 1e20
    x[320:345, 0] -= 1.0
    x[400:550, 3] += 2000.0
    y[400:700, 1] += 500.0
    for k in range(800):
        fast.screen.numbers[0] = plain.screen.numbers[0] = np.nan if k % 7 == 3 else STEP * k
        assert fast.update(x[k], y[k])[0] == plain.update(x[k], y[k])[0]
        assert fast.screen.events == plain.screen.events
        for name, array in fast.screen.bounds.arrays.items():
            other = plain.screen.bounds.arrays[name]
            np.testing.assert_allclose(array, other, rtol=1e-12, err_msg=name)
    # 2e-7: inverses of triangles in Python, solutions with them in C, over 500 samples
    np.testing.assert_allclose(fast.mean, plain.mean, rtol=1e-6, atol=1e-9)
    found = fast.screen.events
    assert found["jumps"] >= 25 and found["out_of_range"] > 100 and found["reopened"] >= 2


@pytest.mark.parametrize("structure", ["full", "layer", "node"])
def test_compiled_and_python_filters_refuse_the_same_stuck_encoders(structure: str) -> None:
    """Cases: one encoder stuck, both joints at rest, and one joint at rest in each wingbeat."""
    if compiler_name() is None:
        pytest.skip("no C compiler here")
    settings = FilterSettings(measurement_std=0.1, covariance=structure, spread=3**0.5)
    numbers = filter_numbers(network(), settings, "cubature")
    screens = [
        WeightFilter(numbers, structure_and_kernel(numbers, one), network().initial(0))
        for one in (True, False)
    ]
    x, y = flapping(900)
    x[200:260, 1], x[300:350] = x[200, 1], x[300]
    x[500:, 0] = np.maximum(x[500:, 0], -0.5)
    for k in range(900):
        ends = []
        for each in screens:
            each.screen.numbers[0] = STEP * k
            ends.append((each.update(x[k], y[k])[0], each.screen.events))
        assert ends[0] == ends[1]
        for name, array in screens[0].screen.bounds.arrays.items():
            other = screens[1].screen.bounds.arrays[name]
            np.testing.assert_allclose(array, other, rtol=1e-12, err_msg=name)  # rounding
    assert screens[0].screen.events["stuck"] > 54


def test_clean_flapping_is_not_touched() -> None:
    """Flapping from rest, at any rate of the samples, with noise of the encoders."""
    x, y = flapping(6000)
    noisy = x + 1e-4 * np.random.default_rng(1).normal(size=x.shape)
    start = np.clip(np.arange(6000) / 400 - 0.5, 0, 1)[:, None]
    for every in (1, 4, 10):
        bounds = Bounds(network())
        for k in range(0, 6000, every):
            usable, within, events = bounds.bounded(start[k] * noisy[k], y[k], STEP * k)
            assert usable and np.isfinite(within).all() and not any(events.values()), k


@pytest.mark.parametrize("every", [3, 23, 40])
def test_samples_that_come_less_often_for_good_do_not_jump(every: int) -> None:
    """Samples at 1 kHz, then only one in `every`, as when a saved learner goes on."""
    x, y = flapping(6000)
    bounds = Bounds(network())
    for k in (*range(1500), *range(1500, 6000, every)):
        usable, _, events = bounds.bounded(x[k], y[k], STEP * k)
        assert usable and not any(events.values()), (k, events)


def test_an_encoder_that_jumps_within_its_range_is_refused() -> None:
    x, y = flapping(1000)
    learner = pt.ExtendedLearner(network(), measurement_std=0.05)
    for k in range(900):
        learner.update(x[k], y[k], STEP * k)
    before = learner.weights
    x[900, 0] -= np.copysign(0.8, x[900, 0])
    assert np.isnan(learner.update(x[900], y[900], 0.9)).all()
    np.testing.assert_array_equal(learner.weights, before)
    assert learner.events["jumps"] == 1
    assert np.isfinite(learner.update(x[901], y[901], 0.901)).all()


def test_an_encoder_that_jumps_for_a_while_is_refused_for_as_long() -> None:
    """Offset of 60 samples within its range; and one that stays, believed after a hundred."""
    x, y = flapping(1500)
    x[600:660, 0] += 0.6  # rad
    x[1200:, 1] += 0.6
    learner = pt.ExtendedLearner(network(), measurement_std=0.05)
    refused = [bool(np.isnan(learner.update(x[k], y[k], STEP * k)).all()) for k in range(1500)]
    assert not any(refused[:600]) and all(refused[600:660]) and not any(refused[660:1200])
    assert all(refused[1200:1300]) and not any(refused[1300:])
    assert learner.events["jumps"] == learner.events["bad_inputs"] == 160


def test_a_filter_that_glided_learns_when_it_flaps_again() -> None:
    """Twelve samples a beat, whose steps are those of jumps after a glide: at first refused."""
    beats, glide, dt = 60, 300, 0.2 / 12
    count = glide + 12 * beats
    time = dt * np.arange(count)[:, None]
    amplitude = np.clip((np.arange(count)[:, None] - glide) / 4, 0, 1)
    amplitude[:120] = 1.0
    q = 0.7 * amplitude * np.sin(10 * np.pi * time + np.array([0.3, 1.1]))
    q += 1e-4 * np.random.default_rng(0).normal(size=q.shape)
    x = np.hstack([q, np.gradient(q, dt, axis=0)])
    learner, bounds = pt.ExtendedLearner(network(), measurement_std=0.05), Bounds(network())
    compiled = [
        np.isfinite(learner.update(*one)).all() for one in zip(x, q, time[:, 0], strict=True)
    ]
    for taken in (
        compiled,
        [bounds.bounded(*one)[0] for one in zip(x, q, time[:, 0], strict=True)],
    ):
        assert all(taken[:glide]) and not all(taken[glide : glide + 12])
        assert all(taken[-360:])  # thirty beats later, at the latest


def test_a_stuck_encoder_is_refused_while_another_moves() -> None:
    """From the sixth equal value, for at most 100 samples; a rest in each wingbeat is accepted."""
    x, y = flapping(2000)
    x[900:950, 0] = x[900, 0]
    x[1300:1600, 1] = x[1300, 1]
    learner = pt.ExtendedLearner(network(), measurement_std=0.05)
    refused = [bool(np.isnan(learner.update(x[k], y[k], STEP * k)).all()) for k in range(2000)]
    # of the 49 and 299 repeats five are learned; the last few may wait for a step that is no jump
    assert not any(refused[:906]) and all(refused[906:950]) and not any(refused[971:1306])
    assert all(refused[1306:1406]) and not any(refused[1406:1600])
    assert learner.events["stuck"] == 44 + 100

    x, y = flapping(8000)
    x[:, 0] = np.maximum(x[:, 0], -0.5)
    learner = pt.ExtendedLearner(network(), measurement_std=0.05)
    beats = [np.isnan(learner.update(x[k], y[k], STEP * k)).all() for k in range(8000)]
    # the first rest of 63 samples after a hundred steps is refused but for its beginning
    assert sum(beats[:1000]) < 70 and not any(beats[1000:])


def test_a_command_may_jump_within_its_range() -> None:
    """The same samples: refused as states, learned as the columns of a table may be."""
    x, y = flapping(600)
    x[500, 0] = -x[500, 0] + 0.9
    counted = []
    for jumps in (False, True):
        inputs = pt.DenseNetwork(4, (5,), 2)
        inputs.inputs_jump = jumps
        again = type(inputs).from_description(inputs.describe())
        assert again.inputs_jump is jumps and ("inputs_jump" in inputs.describe()) is jumps
        learner = pt.ExtendedLearner(again, measurement_std=0.05)
        for k in range(600):
            learner.update(x[k], y[k], STEP * k)
        counted.append(learner.events.get("jumps", 0))
    assert counted == [1, 0]


def test_a_sensor_that_says_something_else_for_long_is_believed() -> None:
    """An offset of 2000 rad/s: the range opens after 100 samples, which is told."""
    x, y = flapping(700)
    x[300:, 2] += 2000.0
    learner = pt.ExtendedLearner(network(), measurement_std=0.05)
    for k in range(700):
        learner.update(x[k], y[k], STEP * k)
    assert learner.events["reopened"] == 1 and learner.events["bad_inputs"] == 100
    assert learner.count == 600


def test_a_sensor_stuck_at_a_wild_value_is_never_believed() -> None:
    x, y = flapping(900)
    x[300:800, 2] = 32767.0
    learner = pt.ExtendedLearner(network(), measurement_std=0.05)
    for k in range(900):
        learner.update(x[k], y[k], STEP * k)
    assert learner.events["bad_inputs"] == 500 and learner.events["reopened"] == 0


def test_outputs_far_from_wrong_weights_are_believed_in_the_end() -> None:
    """Weights that are sure and wrong by 1e6 deviations: the tenth sample in a row is used."""
    network = pt.DenseNetwork(1, (), 1)
    learner = pt.ExtendedLearner(
        network, measurement_std=1e-9, prior_std=1e-9, screening=Screening()
    )
    for k in range(30):
        learner.update([np.sin(0.1 * k)], [1.0 + 0.1 * np.sin(0.1 * k)], STEP * k)
    assert learner.events["blind"] in range(9, 28) and learner.count > 2


def test_a_learner_file_of_the_release_before_bounds_is_read() -> None:
    x, y = flapping(60)
    learner, again = (pt.ExtendedLearner(network(), measurement_std=0.05) for _ in range(2))
    for k in range(50):
        learner.update(x[k], y[k], STEP * k)
    state = learner.state()
    old = {name: value for name, value in state.items() if not name.startswith("screen_bound")}
    del old["screen_far"]
    old["screen_counts"] = state["screen_counts"][:10]
    again.resume(old)
    np.testing.assert_array_equal(again.update(x[50], y[50]), learner.update(x[50], y[50]))


@pytest.mark.parametrize("learner", [pt.ExtendedLearner, pt.CubatureLearner])
@pytest.mark.parametrize("structure", ["full", "layer", "node"])
@pytest.mark.parametrize("share", [0.0, 1e-4])
def test_a_covariance_that_refuses_every_sample_begins_anew(learner, structure, share) -> None:
    """A covariance of no numbers, as a damaged state may hold it."""
    x, y = flapping(400)
    told = {"covariance": structure, "prior_share": share, "measurement_std": 0.05}
    one = learner(network(), screening=Screening(), **told)
    for k in range(300):
        one.update(x[k], y[k], STEP * k)
    state = one.state()
    for name in state.keys() - {"filter_mean", "filter_nis"}:
        state[name] = state[name] * np.nan if name.startswith("filter_") else state[name]
    one.resume(state)
    for k in range(300, 400):
        one.update(x[k], y[k], STEP * k)
    assert one.events["refused"] == 10 and one.events["covariance_resets"] == 1
    assert one.count == 390 and np.isfinite(one.variances).all()
    mean, covariance = one.predict(x[-1])
    assert (np.abs(mean - y[-1]) < 6 * np.sqrt(np.diag(covariance))).all()


def test_the_numbers_of_the_bounds_stand_once() -> None:
    """Each constant of the filters is defined once, in a C header from which Python reads it."""
    for name, module in (("bounds", bounds), ("misfit", misfit), ("screening", screening)):
        defined = vars(header_numbers(f"{name}.h"))
        used = set(re.findall(r"\b_C\.([A-Z_]+)\b", inspect.getsource(module)))
        assert len(defined) >= 8 and used <= defined.keys() and len(used) > len(defined) - 2, name
    assert header_numbers("bounds.h").KNOWN == 20 and header_numbers("misfit.h").START == 0.02


def test_joints_that_rest_in_a_glide_are_not_stuck() -> None:
    """Wings that stop while the robot flies on cost a hundred samples; stuck encoders still do."""
    robot = pt.load_robot("aerobat")
    flight = pt.simulate(robot, duration=0.5, time_step=1e-3)
    begin, wings = 300, slice(6, None)
    for stuck in (False, True):
        glide = flight.copy(deep=True)
        glide.q.values[begin:, wings] = glide.q.values[begin, wings]
        if not stuck:
            glide.v.values[begin:, wings] = glide.a.values[begin:, wings] = 0.0
        learner = pt.identify(glide, every=1).learner
        counted = learner.events["stuck"]
        assert (counted > 0) == stuck
        bounds, total = Bounds(learner.network), 0
        time, x, y, _ = samples(glide, learner.network)
        for row, force, stamp in zip(x, y, time, strict=True):
            total += bounds.bounded(row, force, stamp)[2]["stuck"]
        assert total == counted


def test_a_recorded_log_that_begins_at_rest_is_learned_when_it_moves() -> None:
    """All of the first beats were refused: the range was that of the noise at rest."""
    x, y = flapping(600)
    draw = np.random.default_rng(5)
    swell = np.clip((np.arange(600)[:, None] - 300) / 100, 0.0, 1.0)
    x, y = (swell * one + 1e-4 * draw.normal(size=one.shape) for one in (x, y))
    log = np.vstack([y, np.full((1, 2), np.nan)])
    refused = []
    for known in (False, True):
        learner = pt.ExtendedLearner(pt.DenseNetwork(4, (5,), 2), misfit=Misfit())
        if known:
            learner.expect(np.vstack([x, x[-1:]]), log)
        for k in range(600):
            learner.update(x[k], y[k], STEP * k)
        refused.append(learner.events["bad_inputs"] + learner.events["out_of_range"])
    assert refused[0] > 100 and refused[1] == 0

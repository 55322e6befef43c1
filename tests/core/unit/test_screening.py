"""What a learner does with bad samples and bad clocks, and the noise it finds."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError

TOLD = {"prior_std": 0.5, "measurement_std": 0.1, "spread": 3**0.5}


@pytest.fixture(params=["compiled", "fallback"])
def engine(request, monkeypatch):
    if request.param == "fallback":
        monkeypatch.setenv("PATAGIUM_COMPILER", "none")
    return request.param


def learner_of(network=None, **options):
    return pt.CubatureLearner(network or pt.DenseNetwork(2, (4,), 2), **{**TOLD, **options})


def counted(learner):
    return {name: count for name, count in learner.events.items() if count}


def test_stamps_must_advance(engine):
    learner = learner_of()
    taken = [learner.update([0, 0], [1, 1], time) for time in (0.0, 1.0, 1.0, 0.5, 1.5, np.inf)]
    assert [bool(np.isfinite(each).all()) for each in taken] == [1, 1, 0, 0, 1, 0]
    assert counted(learner) == {"duplicates": 1, "late": 2}
    assert learner.count == 3


def test_a_clock_that_went_back_is_believed_in_the_end(engine):
    learner = learner_of()
    learner.update([0, 0], [1, 1], 1000.0)
    for k in range(20):
        learner.update([0, 0], [1, 1], 0.1 * k)
    assert counted(learner) == {"late": 9, "clock_resets": 1}
    assert learner.count == 12


def test_a_clock_that_stands_in_the_past_is_never_believed(engine):
    learner = learner_of()
    learner.update([0, 0], [1, 1], 1.0)
    for _ in range(50):
        learner.update([0, 0], [1, 1], 0.5)
    assert counted(learner) == {"late": 50}


def test_a_stuck_channel_is_left_out_until_it_moves(engine, rng):
    learner = learner_of(screening=pt.learning.Screening(stuck_samples=10))
    x = np.linspace(0, 60, 1200)
    y = np.column_stack([np.sin(x), np.cos(x)])
    y[600:900, 1] = y[600, 1]
    for k, sample in enumerate(y):
        innovation = learner.update([np.sin(x[k]), np.cos(x[k])], sample)
        if k in (700, 899):
            assert np.isnan(innovation[1]) and np.isfinite(innovation[0])
        if k in (599, 900):
            assert np.isfinite(innovation).all()
    assert learner.events["stuck"] == 300 - 9


def test_a_channel_that_never_moved_is_believed(engine):
    learner = learner_of(screening=pt.learning.Screening(stuck_samples=10))
    for k in range(100):
        learner.update([np.sin(0.1 * k), 0.0], [np.sin(0.1 * k), 0.0])
    assert learner.events["stuck"] == 0


def test_one_spike_hardly_moves_what_was_learned(engine, rng):
    network = pt.DenseNetwork(2, (4,), 2)
    learners = [
        learner_of(network, screening=screening) for screening in (None, pt.learning.Screening())
    ]
    xs = rng.normal(size=(300, 2))
    ys = np.sin(xs) + 0.1 * rng.normal(size=(300, 2))
    moves = []
    for learner in learners:
        for x, y in zip(xs, ys, strict=True):
            learner.update(x, y)
        before, seen = learner.weights, learner.events["outliers"]
        learner.update([1.0, 1.0], [10.0, 0.8])  # a hundred deviations
        moves.append(np.linalg.norm(learner.weights - before))
    assert moves[1] < 0.1 * moves[0]
    assert learners[1].events["outliers"] == seen + 1


def test_nothing_finite_or_not_stops_a_screened_learner(engine, rng):
    learner = learner_of(
        screening=pt.learning.Screening(), noise_estimation=pt.learning.NoiseEstimation(50)
    )
    odd = [np.nan, np.inf, -np.inf, 1e308, -1e308, 1e200, 1e-320, 0.0]
    for _ in range(400):
        x, y = rng.normal(size=2), rng.normal(size=2)
        x[rng.integers(2)] = rng.choice([*odd, 0.1])
        y[rng.integers(2)] = rng.choice([*odd, 0.1])
        learner.update(x, y, rng.choice([None, *odd]))
    assert np.isfinite(learner.weights).all() and np.isfinite(learner.measurement_std).all()
    assert np.linalg.eigvalsh(learner.covariance).min() > 0
    assert (learner.measurement_std > 0).all()


@pytest.mark.parametrize("start", [0.1, 3.0])
@pytest.mark.parametrize("structure", ["full", "node"])
def test_noise_is_found_channel_by_channel(structure, start, rng):
    network, true = pt.DenseNetwork(2, (), 3), np.array([0.02, 0.2, 1.0])
    teacher = network.initial(9)  # linear: nothing but the noise is left
    learner = learner_of(
        network,
        covariance=structure,
        measurement_std=start,
        noise_estimation=pt.learning.NoiseEstimation(300),
    )
    for x in rng.normal(size=(4000, 2)):
        learner.update(x, network(x, teacher) + true * rng.normal(size=3))
    # 300 samples give a deviation to 1 / sqrt(600) = 4 %; three of these
    np.testing.assert_allclose(learner.measurement_std, true, rtol=0.12)


def test_noise_that_goes_with_the_load_is_told_from_noise_that_does_not(rng):
    """Of a strip network in wind that comes and goes, the deviation follows the pressure."""
    robot = pt.load_robot("aerobat")
    network = pt.StripNetwork(robot, (4,), measured=["x", "z"])
    teacher, share = network.initial(3), 0.2
    learner = pt.CubatureLearner(
        network,
        prior_std=0.3,
        measurement_std=0.02,
        spread=3**0.5,
        noise_estimation=pt.learning.NoiseEstimation(500),
    )
    stds = []
    for _ in range(3000):
        speed = rng.choice([1.0, 4.0])
        x = np.concatenate([0.2 * rng.normal(size=robot.dof), 0.3 * rng.normal(size=robot.dof)])
        x[robot.dof : robot.dof + 3] = speed, 0.0, 0.1 * rng.normal()
        load = np.linalg.norm(network.encode_one(x).readout, axis=1)
        _, covariance = learner.predict(x)
        learner.update(x, network(x, teacher) + share * load * rng.normal(size=2))
        stds.append(np.append(np.sqrt(np.diag(covariance)) / (share * load), speed))
    slow, fast = (np.median([d[:2] for d in stds[2000:] if d[2] == v], axis=0) for v in (1.0, 4.0))
    np.testing.assert_allclose(fast, 1.0, rtol=0.15)  # 250 fast samples: 5 %, and the weights
    assert (slow < 4.0).all()  # one deviation for both would be 10 times too large here


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: pt.learning.Screening(outlier_std=1.0),
        lambda: pt.learning.Screening(outlier_std=np.nan),
        lambda: pt.learning.Screening(stuck_samples=1),
        lambda: pt.learning.NoiseEstimation(5),
        lambda: pt.learning.NoiseEstimation(10.5),
    ],
)
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ParameterError, match="outlier_std|stuck_samples|memory"):
        wrong()


def test_settings_are_described():
    learner = learner_of(
        screening=pt.learning.Screening(), noise_estimation=pt.learning.NoiseEstimation(50)
    )
    told = learner.describe()
    assert told["screening"] == {"outlier_std": 5.0, "stuck_samples": 50}
    assert told["noise_estimation"] == {"memory": 50}

"""Running scores of a stream, against the same over all its samples."""

from __future__ import annotations

import numpy as np
import pytest

from patagium.errors import Outcome
from patagium.learning.scores import normalized_error
from patagium.live.loop import Counters
from patagium.live.pipeline import Records


def records_of(y, guess, std, *, outcome=0.0, left_out=0.0, nanoseconds=1e4):
    rest = np.zeros((len(y), 4))
    rest[:, 1], rest[:, 2], rest[:, 3] = outcome, left_out, nanoseconds
    return Records(np.hstack([guess, std, y, rest]))


@pytest.fixture
def samples(rng):
    y = rng.normal(2.0, [1.0, 3.0, 0.0], (4000, 3))
    y[:, 2] = 5.0  # silent
    return y, y + rng.normal(0.0, 0.1, y.shape), np.full(y.shape, 0.1)


def test_with_a_long_memory_it_is_the_score_of_all(samples):
    y, guess, std = samples
    counters = Counters(3, 1e9)
    for start in range(0, 4000, 333):
        part = slice(start, start + 333)
        counters.add(records_of(y[part], guess[part], std[part]))
    # a weight fades by 4e-6 over the samples
    np.testing.assert_allclose(counters.nmse, normalized_error(y, guess), rtol=1e-4)
    assert counters.nmse_mean == pytest.approx(np.nanmean(normalized_error(y, guess)), rel=1e-4)
    assert counters.coverage == pytest.approx(0.95, abs=0.01)  # 12,000 draws: 0.002
    assert counters.coverage == pytest.approx(counters.coverage_in_all, rel=1e-5)


def test_blocks_do_not_matter(samples):
    y, guess, std = samples
    whole, single = Counters(3, 50.0), Counters(3, 50.0)
    whole.add(records_of(y, guess, std))
    for k in range(4000):
        single.add(records_of(*(a[k : k + 1] for a in samples)))
    np.testing.assert_allclose(single.nmse, whole.nmse, rtol=1e-9)  # rounding of 4000 steps
    assert single.coverage == pytest.approx(whole.coverage, rel=1e-9)


def test_a_short_memory_forgets(samples):
    y, guess, std = samples
    counters = Counters(3, 100.0)
    counters.add(records_of(y[:2000], guess[:2000] + 10.0, std[:2000]))
    assert counters.nmse_mean > 1 and counters.coverage == 0.0
    counters.add(records_of(y[2000:], guess[2000:], std[2000:]))
    assert counters.nmse_mean < 0.02 and counters.coverage > 0.9
    assert counters.coverage_in_all < 0.6


def test_what_was_left_out_or_not_foreseen_does_not_score(samples):
    y, guess, std = (a.copy() for a in samples)
    guess[::2] = np.nan
    outcome = np.where(np.arange(4000) % 2, Outcome.COMPLETED, Outcome.NOT_FINITE)
    y[1::4, 1] = 1e9
    left_out = np.where(np.arange(4000) % 4 == 1, 2.0, 0.0)
    counters = Counters(3, 1e9)
    counters.add(records_of(y, guess, std, outcome=outcome, left_out=left_out))
    assert counters.nmse[1] == pytest.approx(normalized_error(y[3::4], guess[3::4])[1], rel=1e-3)
    assert (counters.samples, counters.learned, counters.failed) == (4000, 2000, 2000)


def test_quantiles_of_durations(samples, rng):
    nanoseconds = rng.lognormal(10.0, 1.0, 4000)
    counters = Counters(3, 100.0)
    counters.add(records_of(*samples, nanoseconds=nanoseconds))
    for share in (0.5, 0.99, 0.999):
        expected = np.quantile(nanoseconds, share) * 1e-9
        assert counters.duration(share) == pytest.approx(expected, rel=0.05)  # bins of 1.2 %
    assert counters.duration(1.0) == nanoseconds.max() * 1e-9


def test_before_anything_it_knows_nothing():
    counters = Counters(3, 100.0)
    assert np.isnan([counters.nmse_mean, counters.coverage, counters.duration(0.5)]).all()

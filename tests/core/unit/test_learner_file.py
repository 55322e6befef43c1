"""The file of a learner: what it holds, and what is refused with a sentence."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import patagium as pt
from patagium.errors import LogError, ParameterError, ShapeError
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.learning.learners.state_file import FORMAT
from patagium.live import AutoSave


def learner_of(hidden: tuple[int, ...] = (4,), **options: Any) -> pt.CubatureLearner:
    network = pt.DenseNetwork(3, hidden, 2)
    setting = {"prior_std": 0.5, "measurement_std": 0.1, "covariance": "node"}
    return pt.CubatureLearner(network, **setting | options)


def taught(count: int = 20, **options: Any) -> pt.CubatureLearner:
    learner, draw = learner_of(**options), np.random.default_rng(5)
    for _ in range(count):
        learner.update(draw.normal(size=3), draw.normal(size=2))
    return learner


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    return taught().save(tmp_path / "learner.state")


def rewritten(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """The file with another header, its digest right."""
    first, _, rest = path.read_bytes().split(b"\n", 2)
    text, _, numbers = rest.partition(b"\n")
    header = json.loads(text)
    change(header)
    rest = json.dumps(header).encode() + b"\n" + numbers
    path.write_bytes(b"\n".join([first, hashlib.sha256(rest).hexdigest().encode(), rest]))


def test_it_stands_alone_in_a_new_folder(tmp_path: Path) -> None:
    learner = taught()
    path = learner.save(tmp_path / "learner")
    assert [file.name for file in path.parent.iterdir()] == ["learner"]
    assert path.stat().st_mode & 0o777 == 0o644
    again = pt.load_learner(path)
    assert isinstance(again, pt.CubatureLearner)
    assert np.isnan(again.time_per_update) and again.time_per_update is not None
    again.update([0, 0, 0], [0, 0])
    assert again.count == 21 and 1e-6 < again.time_per_update < 1.0


def test_its_header_is_for_reading(kept: Path) -> None:
    first, digest, text = kept.read_bytes().split(b"\n")[:3]
    assert first.decode() == FORMAT and len(digest) == 64
    header = json.loads(text)
    assert header["learner"]["kind"] == "cubature" and header["state"]["count"] == 20
    assert header["patagium_version"] == pt.__version__


def test_a_structured_covariance_takes_its_own_size_only(tmp_path: Path) -> None:
    big = learner_of((1000,), covariance="node", dtype="float32")
    numbers = big.network.size + 1000 * 4 * 5 // 2 + 2 * 1001 * 1002 // 2
    size = big.save(tmp_path / "node").stat().st_size
    assert size < 4 * numbers + 8 * big.network.size + 2000  # n^2 numbers: 144 MB
    assert pt.load_learner(tmp_path / "node").count == 0


def test_no_damaged_byte_goes_unseen(kept: Path, rng: np.random.Generator) -> None:
    content = kept.read_bytes()
    places = np.append(rng.integers(0, len(content), 200), [0, len(FORMAT), len(content) - 1])
    for place in places.tolist():
        damaged = bytearray(content)
        damaged[place] ^= 1 << int(rng.integers(8))
        kept.write_bytes(damaged)
        with pytest.raises(LogError, match=r"learner\.state: (damaged|expected)"):
            pt.load_learner(kept)
    for length in (0, 5, len(FORMAT) + 1, 90, len(content) // 2, len(content) - 1):
        kept.write_bytes(content[:length])
        with pytest.raises(LogError, match=r"learner\.state: (damaged|expected)"):
            pt.load_learner(kept)
    kept.write_bytes(content + b"\0")
    with pytest.raises(LogError, match="damaged"):
        pt.load_learner(kept)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"patagium learner 2\n", "expected a file of format 'patagium learner 1', found"),
        (b'{"format": "patagium model 2"}', "found a learned model, which `pt.load_model`"),
        (b"\x89HDF\r\n\x1a\n", "expected a file of format"),
    ],
)
def test_other_files_are_named(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(content)
    with pytest.raises(LogError, match=message):
        pt.load_learner(tmp_path / "file")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"none: .*found no such file"):
        pt.load_learner(tmp_path / "none")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda h: h["learner"].update(kind="oracle"), "of kind cubature, extended"),
        (lambda h: h["learner"].update(luck=1.0), "luck"),
        (lambda h: h["learner"].pop("network"), "network"),
        (lambda h: h["learner"]["network"].update(hidden=[5]), "expected shape"),
        (lambda h: h["learner"].update(covariance="layer"), "expected shape"),
        (lambda h: h["learner"].update(covariance={"rank": 2}), "covariance: expected one of"),
        (lambda h: h["learner"].update(prior_std=-1.0), "prior_std"),
        (lambda h: h["state"].pop("count"), "count"),
        (lambda h: h["arrays"].pop("filter_mean"), "filter_root|mean"),
        (lambda h: h["arrays"]["filter_root"].__setitem__(1, [10**6]), "cannot be made again"),
        (lambda h: h.pop("arrays"), "arrays"),
    ],
)
def test_contents_that_do_not_fit_are_refused(
    change: Callable[[dict[str, Any]], object], message: str, kept: Path
) -> None:
    rewritten(kept, change)
    with pytest.raises(LogError, match=message):
        pt.load_learner(kept)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (learner_of((5,)), r"network\.hidden: expected \[5\], found \[4\]"),
        (learner_of(prior_std=0.4), r"prior_std: expected 0\.4, found 0\.5"),
        (learner_of(covariance="full"), r"covariance: expected 'full', found 'node'"),
        (
            pt.ExtendedLearner(pt.DenseNetwork(3, (4,), 2)),
            r"kind: expected 'extended', found 'cubature'",
        ),
    ],
)
def test_another_learner_than_the_one_asked_for_is_refused(
    other: FilterLearner, message: str, kept: Path
) -> None:
    before = other.weights
    with pytest.raises(LogError, match=message):
        pt.load_learner(kept, like=other)
    np.testing.assert_array_equal(other.weights, before)


def test_centers_and_scales_may_differ(tmp_path: Path) -> None:
    scaled = pt.DenseNetwork(3, (4,), 2, input_center=1.0, output_scale=[2.0, 3.0])
    setting = {"prior_std": 0.5, "measurement_std": 0.1, "covariance": "node"}
    path = pt.CubatureLearner(scaled, **setting).save(tmp_path / "learner.state")
    again = pt.load_learner(path, like=learner_of())
    assert again.network.describe() == scaled.describe()


def test_a_difference_deep_in_a_long_value_is_shown(tmp_path: Path) -> None:
    one, other = (learner_of(prior_std=np.append(np.full(25, 0.5), last)) for last in (0.25, 0.75))
    path = one.save(tmp_path / "learner.state")
    with pytest.raises(LogError, match=r"expected \.\.\.[0., 5]*, 0\.75.* found \.\.\..*0\.25"):
        pt.load_learner(path, like=other)


def test_a_refused_state_leaves_the_learner_as_it_was() -> None:
    learner, state = taught(), taught(covariance="full").state()
    weights = learner.weights
    with pytest.raises(ValueError, match="shape"):
        learner.resume(state)
    np.testing.assert_array_equal(learner.weights, weights)
    assert learner.count == 20


def test_a_failed_save_leaves_the_file_as_it_was(kept: Path, monkeypatch: Any) -> None:
    before = kept.read_bytes()

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device", str(kept))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        taught(3).save(kept)
    assert kept.read_bytes() == before
    assert list(kept.parent.iterdir()) == [kept]


def test_drafts_of_the_killed_are_removed_in_time(kept: Path) -> None:
    old, fresh = (kept.parent / f".{kept.name}.{name}.part" for name in ("old", "fresh"))
    for draft in (old, fresh):
        draft.write_bytes(b"half a learner")
    os.utime(old, (1e9, 1e9))
    taught(3).save(kept)
    assert not old.exists() and fresh.exists()  # somebody may be writing the fresh one


class Clock:
    """Time that passes when it is told to."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now


def test_it_saves_when_due_and_only_then(tmp_path: Path, monkeypatch: Any) -> None:
    clock = Clock()
    monkeypatch.setattr("patagium.live.autosave.time", clock)
    learner = taught()
    saver = AutoSave(learner, tmp_path / "learner.state", 10.0)
    clock.now = 20.0
    assert not saver.tick()  # nothing was learned since it began
    learner.update([0, 0, 0], [1, 1])
    assert saver.tick() and saver.saves == 1
    learner.update([0, 0, 0], [1, 1])
    clock.now = 29.0
    assert not saver.tick()
    clock.now = 30.0
    assert saver.tick() and saver.saves == 2
    assert pt.load_learner(saver.path).count == 22
    saver.save()
    assert saver.saves == 3


def test_a_full_disk_does_not_stop_a_learner(tmp_path: Path, monkeypatch: Any) -> None:
    clock = Clock()
    monkeypatch.setattr("patagium.live.autosave.time", clock)
    (tmp_path / "file").write_text("no folder")
    learner = taught()
    saver = AutoSave(learner, tmp_path / "file" / "learner.state", 10.0)
    learner.update([0, 0, 0], [1, 1])
    clock.now = 20.0
    assert not saver.tick() and saver.failures == 1
    assert "cannot be written" in saver.problem
    assert not saver.tick() and saver.failures == 1  # it waits before it tries again
    saver.path, clock.now = tmp_path / "learner.state", 30.0
    assert saver.tick() and saver.problem == ""
    with pytest.raises(ParameterError, match="seconds"):
        AutoSave(learner, tmp_path, 0.0)


def test_a_clock_goes_on_unless_it_is_restarted(tmp_path: Path) -> None:
    learner = learner_of()
    learner.update([1, 0, 0], [1, 1], 5.0)
    again = pt.load_learner(learner.save(tmp_path / "learner.state"))
    again.update([1, 0, 0], [1, 1], 4.0)
    assert (again.count, again.events["late"]) == (1, 1)
    again.restart_clock()
    again.update([1, 0, 0], [1, 1], 4.0)
    assert (again.count, again.events["late"]) == (2, 1)


WRONG = (10**400, 1j, "1", "", b"1", [], {}, object(), True, np.array([1.0]), np.array(["a"]))


def test_arguments_of_a_wrong_kind_are_refused_by_a_sentence() -> None:
    """Each is a PatagiumError with the name of the argument, and nothing is learned."""
    one = taught()
    count, outputs = one.count, one.network.outputs
    x, y = np.zeros(one.network.inputs), np.zeros(outputs)
    for value in WRONG:
        with pytest.raises(ParameterError, match="time"):
            one.update(x, y, value)
    for value in (None, 1, [], "a"):
        with pytest.raises(ParameterError, match="state"):
            one.resume(value)
    for value in (None, 1, [], b"a"):
        with pytest.raises(ParameterError, match="path"):
            one.save(value)
    assert one.count == count


def test_arguments_of_filters_of_a_wrong_kind_are_refused_by_a_sentence() -> None:
    one = pt.ExtendedLearner(pt.DenseNetwork(2, (3,), 1), measurement_std=0.1)
    for value in (None, "a", [], {}, 1j, np.array([])):
        with pytest.raises(ParameterError, match="share"):
            one.reopen(value)
    for value in (None, "a", [["a"], [1, 2]]):
        with pytest.raises(ParameterError, match="outcomes"):
            one.account_for(value, [1])
        with pytest.raises(ParameterError, match="times"):
            one.carried(value)
    with pytest.raises(ShapeError, match="nanoseconds"):
        one.account_for([0], 1)

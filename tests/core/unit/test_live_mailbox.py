"""Letters in shared memory: the latest wins, none is torn, what was lost is known."""

from __future__ import annotations

import os
from multiprocessing import get_context

import numpy as np
import pytest

from patagium.viewer.live_frames import (
    TRACE,
    Feed,
    Mailbox,
    Subject,
    records_without_learner,
)

LAYOUT = [("number", "i8"), ("values", "f8", (300,))]


def test_letters_come_in_order_and_the_oldest_make_room():
    box = Mailbox(LAYOUT, 4)
    assert box.take() == [] and box.sent == 0
    for number in (1, 2):
        box.put({"number": number})
    assert [int(letter["number"]) for letter in box.take()] == [1, 2]
    assert box.take() == []
    for number in range(3, 13):
        box.put({"number": number, "values": float(number)})
    found = box.take()
    assert [int(letter["number"]) for letter in found] == [9, 10, 11, 12]
    assert all((letter["values"] == letter["number"]).all() for letter in found)
    assert box.sent == 12


def test_fields_that_are_not_named_are_zero():
    box = Mailbox(LAYOUT, 2)
    for _ in range(3):
        box.put({"number": 1, "values": 1.0})
    box.put({"number": 2})
    assert not box.take()[-1]["values"].any()


def _write(box, count):
    os.nice(5)
    for number in range(1, count + 1):
        box.put({"number": number, "values": float(number)})


def test_another_process_is_read_without_a_torn_letter():
    box, count = Mailbox(LAYOUT, 4), 2_000
    writer = get_context("spawn").Process(target=_write, args=(box, count))
    writer.start()
    seen = []
    while not seen or seen[-1] < count:
        assert writer.is_alive() or box.sent == count
        for letter in box.take():
            assert (letter["values"] == letter["number"]).all()
            seen.append(int(letter["number"]))
    writer.join()
    assert seen == sorted(set(seen)) and 1 < len(seen) <= count


class Interrupted:
    """Slots of a mailbox, or fields of them, that let another run after each step."""

    def __init__(self, inner, step):
        self.inner, self.step = inner, step

    def __len__(self):
        return len(self.inner)

    def __getitem__(self, key):
        return Interrupted(self.inner[key], self.step) if key != "number" else self.inner[key]

    def __setitem__(self, key, value):
        self.inner[key] = value
        self.step()

    def copy(self):
        found = self.inner.copy()
        self.step()
        return found


def test_a_letter_is_not_taken_while_it_is_written_or_overwritten():
    box = Mailbox(LAYOUT, 1)
    reader = Mailbox.__new__(Mailbox)
    reader.__setstate__(box.__getstate__())
    box.put({"number": 1, "values": 1.0})
    slots, seen = box._slots, []

    def look():
        reader._seen = 0
        seen.extend(reader.take())

    look()
    assert [int(letter["number"]) for letter in seen] == [1]
    box._slots = Interrupted(slots, look)
    box.put({"number": 2, "values": 2.0})
    assert len(seen) == 1  # the former one was being overwritten, the new one was not yet sent
    box._slots, reader._seen = slots, 0
    reader._slots = Interrupted(reader._slots, lambda: box.put({"number": 3, "values": 3.0}))
    assert reader.take() == []  # it changed while it was copied


@pytest.fixture
def subject():
    import patagium as pt

    robot = pt.load_robot("aerobat")
    return Subject(robot, robot.dof_names, None, "a robot")


def packets_and_records(first, count):
    packets = np.zeros((count, 57))
    packets[:, 0] = first + np.arange(count)
    packets[:, 1] = -packets[:, 0]
    return packets, records_without_learner(np.tile(packets[:, :1], (1, 14)))


def test_a_frame_has_the_last_sample_and_a_thinned_trace(subject):
    box = Mailbox(subject.layout, 4)
    feed = Feed(box, subject)
    feed.post(load=0.5)
    assert box.sent == 0  # nothing came yet
    for first, count in ((0, 100), (100, 3), (103, 500)):
        feed.append(*packets_and_records(first, count))
    feed.post(load=0.5, words="all " + "w" * 1000)
    letter = box.take()[0]
    assert letter["time"] == 602 and letter["q"][0] == -602 and letter["load"] == 0.5
    assert (letter["measurement"] == 602).all() and np.isnan(letter["prediction"]).all()
    trace = letter["trace"][: letter["traced"]]
    assert 3 <= len(trace) <= TRACE and (np.diff(trace[:, 0]) > 0).all()
    np.testing.assert_array_equal(trace[:, 1], trace[:, 0])  # time as the first force
    assert letter["words"].startswith(b"all www")
    feed.post()
    assert box.take()[0]["traced"] == 0  # the same sample, plotted once


def test_many_small_blocks_are_thinned_too(subject):
    box = Mailbox(subject.layout, 4)
    feed = Feed(box, subject)
    for first in range(1000):
        feed.append(*packets_and_records(first, 1))
    feed.post()
    letter = box.take()[0]
    times = letter["trace"][: letter["traced"], 0]
    assert letter["time"] == 999 and TRACE / 2 <= len(times) <= TRACE
    assert np.ptp(np.diff(times)) == 0  # evenly

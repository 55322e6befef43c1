"""Packets on their way in: what is read, what is refused, what is counted."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from patagium.errors import LogError, ParameterError
from patagium.live.packets import (
    DatagramPackets,
    Intake,
    TextPackets,
    datagrams,
    most_rows,
)
from patagium.live.sources import PacketQueue, address_of, source_of

NAMES = ("time", "q.a", "v.a", "a.a", "u1.a")
ROWS = np.arange(60.0).reshape(12, 5)


def sent(rows=3, session=7.0):
    return list(datagrams(ROWS, session, rows))


def received(messages):
    intake = Intake()
    reader = DatagramPackets(5, intake)
    return np.concatenate([reader.take(message) for message in messages]), intake


def test_a_text_is_read_whatever_its_pieces_and_its_order_of_columns():
    text = b"# a comment\nu1.a,spare,time,q.a,v.a,a.a\n"
    text += b"".join(b"%r,x,%r,%r,%r,%r\r\n" % (row[4], *row[:4]) for row in ROWS.tolist()) + b"\n"
    for size in (1, 7, len(text)):
        intake = Intake()
        reader = TextPackets(NAMES, intake)
        pieces = [text[k : k + size] for k in range(0, len(text), size)]
        np.testing.assert_array_equal(np.concatenate([reader.take(p) for p in pieces]), ROWS)
        reader.end()
        assert intake.counts["received"] == 12 and intake.bad_rows == 0


def test_bad_lines_are_counted_and_the_first_are_shown():
    intake = Intake()
    reader = TextPackets(NAMES, intake)
    lines = ["time,q.a,v.a,a.a,u1.a", "1,2,3,4,5", "1,2,3", "1,2,three,4,5", ",2,3,4,5"]
    lines += ["nan,2,3,4,5", "2,,3,inf,5", "3,2,3,4,5"]
    found = reader.take("\n".join(lines).encode())
    reader.end()
    np.testing.assert_array_equal(found, [[1, 2, 3, 4, 5], [2, np.nan, 3, np.inf, 5]])
    assert intake.counts == {
        "received": 2, "lost": 0, "repeated": 0, "bad_rows": 5, "dropped": 0
    }  # fmt: skip
    assert intake.examples == [
        "line 3: expected 5 fields, found 3",
        "line 4: expected a number, found 'three'",
        "line 5: expected a time, found nan",
    ]


def test_a_text_without_its_columns_is_refused():
    with pytest.raises(LogError, match=r"line 1: .* a\.a, u1\.a, found time, q\.a"):
        TextPackets(NAMES, Intake()).take(b"time,q.a,v.a\n1,2,3\n")


def test_datagrams_in_order_are_all_there():
    for rows in (1, 3, 5, 12):
        found, intake = received(sent(rows))
        np.testing.assert_array_equal(found, ROWS)
        assert intake.counts["received"] == 12 and sum(intake.counts.values()) == 12


def test_lost_doubled_and_overtaken_datagrams_are_counted():
    a, b, c, d = sent(3)
    found, intake = received([a, a, c, b, d])
    np.testing.assert_array_equal(found, np.delete(ROWS, [3, 4, 5], axis=0))
    assert (intake.received, intake.lost, intake.repeated) == (9, 3, 6)


def test_a_datagram_that_overlaps_gives_what_is_new():
    late = next(iter(datagrams(ROWS[2:8], 7.0, 6, first=2)))
    found, intake = received([sent(4)[0], late])
    np.testing.assert_array_equal(found, ROWS[:8])
    assert intake.repeated == 2


def test_a_new_session_starts_anew_and_a_late_listener_loses_nothing():
    found, intake = received([*sent(6)[1:], *sent(6, session=8.0)])
    np.testing.assert_array_equal(found, np.concatenate([ROWS[6:], ROWS]))
    assert intake.lost == intake.repeated == 0


@pytest.mark.parametrize(
    "broken",
    [
        b"",
        b"hello",
        np.zeros(1).tobytes(),
        np.zeros(6).tobytes(),
        np.array([np.nan, 0, 1, 2, 3, 4, 5]).tobytes(),
        np.array([7.0, -1, 1, 2, 3, 4, 5]).tobytes(),
        np.array([7.0, np.inf, 1, 2, 3, 4, 5]).tobytes(),
        np.array([7.0, 0, np.nan, 2, 3, 4, 5]).tobytes(),
    ],
)
def test_a_datagram_that_is_none_is_counted_and_harms_nothing(broken):
    first, *others = sent(4)
    found, intake = received([first, broken, *others])
    np.testing.assert_array_equal(found, ROWS)
    assert intake.bad_rows == 1 and len(intake.examples) == 1


def test_so_many_packets_fit_a_datagram():
    count = most_rows(57)
    assert len(next(datagrams(np.zeros((count, 57)), 0.0, count))) <= 65507
    assert len(next(datagrams(np.zeros((count + 1, 57)), 0.0, count + 1))) > 65507


def test_a_full_queue_drops_the_newest_and_counts_them():
    queue = PacketQueue(10, 5, Intake())
    queue.put(ROWS[:8], waits=False)
    queue.put(ROWS[8:], waits=False)
    assert queue.intake.dropped == 2
    np.testing.assert_array_equal(queue.take(4, 0.0), ROWS[:4])
    np.testing.assert_array_equal(queue.take(40, 0.0), ROWS[4:10])
    assert queue.take(40, 0.0).shape == (0, 5)


def test_who_can_wait_loses_nothing():
    queue = PacketQueue(2, 5, Intake())

    def write():
        queue.put(ROWS, waits=True)
        queue.close()

    writer = threading.Thread(target=write)
    writer.start()
    found = []
    while (part := queue.take(3, 1.0)) is not None:
        found.append(part)
    writer.join()
    np.testing.assert_array_equal(np.concatenate(found), ROWS)
    assert max(map(len, found)) <= 2 and queue.intake.dropped == 0


def test_what_went_wrong_while_reading_is_raised_where_it_is_taken():
    queue = PacketQueue(10, 5, Intake())
    queue.put(ROWS[:2], waits=True)
    queue.close(LogError("no header"))
    assert len(queue.take(5, 0.0)) == 2
    with pytest.raises(LogError, match="no header"):
        queue.take(5, 0.0)


def test_what_is_abandoned_is_counted():
    queue = PacketQueue(10, 5, Intake())
    queue.put(ROWS[:7], waits=True)
    assert len(queue.take(2, 0.0)) == 2
    queue.abandon()
    assert queue.take(2, 0.0) is None
    assert queue.intake.dropped == 5
    queue.put(ROWS, waits=True)  # does not wait for ever


def test_addresses():
    assert address_of("udp://127.0.0.1:9000") == ("127.0.0.1", 9000)
    assert address_of("udp://:9000") == ("127.0.0.1", 9000)
    assert address_of("udp://[::1]:9000") == ("::1", 9000)
    for words in ("udp://127.0.0.1", "udp://127.0.0.1:", "udp://here:99999"):
        with pytest.raises(ParameterError, match="address"):
            address_of(words)


def test_a_source_that_is_not_there(tmp_path):
    with pytest.raises(LogError, match="found none"):
        source_of(str(tmp_path / "no.csv"), NAMES)
    with pytest.raises(LogError, match="a folder"):
        source_of(str(tmp_path), NAMES)

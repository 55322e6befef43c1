"""Packets on their way in: what is read, what is refused, what is counted."""

from __future__ import annotations

import threading
import time

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies

from patagium.errors import LogError, ParameterError
from patagium.live.packets import (
    LONGEST_LINE,
    REACH,
    DatagramPackets,
    Intake,
    TextPackets,
    datagrams,
    most_rows,
    new_session,
    read_key,
)
from patagium.live.sources import DatagramSource, PacketQueue, address_of, source_of

NAMES = ("time", "q.a", "v.a", "a.a", "u1.a")
ROWS = np.arange(60.0).reshape(12, 5)
KEY = b"0123456789abcdef"


def sent(rows=3, session=7.0, first=0, key=None):
    return list(datagrams(ROWS, session, rows, first, key))


def received(messages, key=None):
    intake = Intake()
    reader = DatagramPackets(5, intake, key)
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
        "received": 2, "lost": 0, "repeated": 0, "bad_rows": 5, "resynchronized": 0,
        "unauthenticated": 0, "dropped": 0,
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
    assert (intake.received, intake.lost, intake.repeated) == (9, 0, 6)


def test_packets_that_others_overtook_are_not_lost():
    """Each was counted as lost and as repeated: a network that swaps looked like one that loses."""
    order = [0, 2, 1, 4, 3, 6, 5, 9, 5]  # 7 and 8 never come, 5 comes twice
    messages = list(datagrams(np.tile(ROWS, (3, 1)), 7.0, 3))
    _, intake = received([messages[k] for k in order])
    assert (intake.received, intake.lost, intake.repeated) == (3 * 5, 3 * 2, 3 * 4)


def test_what_a_run_keeps_of_its_losses_is_bounded():
    messages = list(datagrams(np.zeros((5 * REACH, 5)), 7.0, 1))
    intake = Intake()
    kept = DatagramPackets(5, intake)
    for message in messages[::4]:
        kept.take(message)
    (run,) = kept._runs
    assert len(run.missing) == REACH < intake.lost
    lost = intake.lost
    kept.take(messages[1])  # forgotten
    kept.take(messages[-7])
    assert (intake.lost, intake.repeated) == (lost - 1, 2)


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
        np.array([7.0, 4.5, 1, 2, 3, 4, 5]).tobytes(),
        np.array([7.0, 2.0**60, 1, 2, 3, 4, 5]).tobytes(),
        np.array([7.0, 2.0**52, 1, 2, 3, 4, 5]).tobytes(),
        np.array([7.0, 4.0]).tobytes(),
        np.array([7.0, 0, np.nan, 2, 3, 4, 5]).tobytes(),
    ],
)
def test_a_datagram_that_is_none_is_counted_and_harms_nothing(broken):
    first, *others = sent(4)
    found, intake = received([first, broken, *others])
    np.testing.assert_array_equal(found, ROWS)
    assert intake.bad_rows == 1 and len(intake.examples) == 1


def test_a_jump_of_the_sequence_counts_once_a_second_datagram_confirms_it():
    far = sent(3, first=1 << 50)
    found, intake = received([*sent(6), *far, *sent(6, first=12)])
    np.testing.assert_array_equal(found, np.concatenate([ROWS, ROWS[3:], ROWS]))
    assert (intake.bad_rows, intake.resynchronized, intake.lost) == (1, 1, 0)
    assert intake.examples == [f"datagram: expected sequence near 12, found {1 << 50}"]


def test_a_first_datagram_that_lies_mutes_nobody():
    found, intake = received([sent(6, first=1 << 50)[0], *sent(3)])
    np.testing.assert_array_equal(found, np.concatenate([ROWS[:6], ROWS[3:]]))
    assert intake.resynchronized == 1 and intake.bad_rows == 1


def test_a_datagram_within_reach_mutes_for_no_longer_than_the_reach():
    near = sent(12, first=REACH)[0]
    rest = datagrams(np.tile(ROWS, (2000, 1)), 7.0, 12)
    _, intake = received([next(rest), near, *rest])
    assert intake.received + intake.repeated == 2001 * 12
    assert (intake.lost, intake.repeated) == (0, REACH)


def test_interleaved_sessions_keep_their_counts():
    ours, theirs = sent(3), sent(3, session=8.0)
    mixed = [message for pair in zip(ours, theirs, strict=True) for message in pair]
    found, intake = received([*mixed, *mixed])
    np.testing.assert_array_equal(found, np.tile(ROWS.reshape(4, 3, 5), (1, 2, 1)).reshape(-1, 5))
    assert (intake.received, intake.repeated, intake.lost) == (24, 24, 0)


def test_sessions_cannot_be_guessed():
    sessions = {new_session() for _ in range(200)}
    assert len(sessions) == 200 and np.isfinite(list(sessions)).all()
    bits = np.unpackbits(np.array(list(sessions)).view(np.uint8).reshape(200, 8), axis=1)
    # each bit is set in half of them; six standard deviations
    assert (abs(bits.mean(axis=0) - 0.5) < 6 * 0.5 / np.sqrt(200)).all()


def test_only_what_the_key_signed_is_used():
    signed = sent(3, key=KEY)
    forged = [signed[1][:-1] + bytes([signed[1][-1] ^ 1]), *sent(3), b"", b"x" * 40]
    forged += sent(3, session=8.0, key=KEY[::-1])
    changed = bytearray(signed[1])
    changed[20] ^= 1
    found, intake = received([signed[0], *forged, bytes(changed), *signed[1:]], KEY)
    np.testing.assert_array_equal(found, ROWS)
    assert (intake.unauthenticated, intake.bad_rows, intake.lost) == (len(forged) + 1, 0, 0)
    assert intake.examples[0] == "datagram: its tag is missing or not that of the key"
    _, unkeyed = received(signed)
    assert unkeyed.bad_rows == 4 and "--key-file" in unkeyed.examples[0]


def test_a_key_that_others_can_read_or_guess_is_refused(tmp_path):
    file = tmp_path / "key"
    file.write_bytes(KEY + b"\n")
    file.chmod(0o600)
    assert read_key(file) == KEY
    file.chmod(0o640)
    with pytest.raises(ParameterError, match="chmod 600.*640"):
        read_key(file)
    file.chmod(0o600)
    for text in (b"", b"short\n", b"x" * 5000):
        file.write_bytes(text)
        with pytest.raises(ParameterError, match="16 to 4096 B"):
            read_key(file)
    with pytest.raises(ParameterError, match="can be read"):
        read_key(tmp_path)
    with pytest.raises(ParameterError, match="datagrams"):
        source_of("-", NAMES, key_file=file)


@pytest.mark.parametrize(
    ("host", "key", "said"),
    [
        ("127.0.0.1", None, None),
        ("localhost", None, None),
        ("0.0.0.0", None, "listened for at 0.0.0.0, beyond this machine, without a key"),
        ("0.0.0.0", KEY, "beyond this machine: only those with the tag of the key"),
    ],
)
def test_who_can_send_packets_is_said(host, key, said):
    source = DatagramSource(5, host, 0, key=key)
    source._socket.close()
    assert source.warning is None if said is None else said in source.warning


@hypothesis.given(
    strategies.lists(
        strategies.one_of(
            strategies.binary(max_size=130),
            strategies.tuples(
                strategies.sampled_from([7.0, 8.0, -0.0]),
                strategies.one_of(
                    strategies.integers(0, 40), strategies.floats(), strategies.just(2.0**60)
                ),
                strategies.lists(strategies.floats(width=64), max_size=15),
            ).map(lambda words: np.array([*words[:2], *words[2]]).tobytes()),
        ),
        max_size=20,
    ),
    strategies.sampled_from([None, KEY]),
)
@hypothesis.settings(deadline=None)
def test_no_datagram_harms_the_reader(messages, key):
    found, intake = received([sent(12, key=key)[0], *messages], key)
    assert intake.received == len(found) and np.isfinite(found[:, 0]).all()
    reached = intake.bad_rows + intake.unauthenticated
    assert 0 <= reached <= len(messages)
    if key is not None:
        assert intake.unauthenticated == len(messages)


@hypothesis.given(
    strategies.lists(strategies.integers(0, 30), max_size=60), strategies.integers(1, 3)
)
@hypothesis.settings(deadline=None)
def test_packets_are_used_once_and_in_order(order, rows):
    packets = np.arange(31.0 * rows * 5).reshape(-1, 5)
    messages = list(datagrams(packets, 7.0, rows))
    found, intake = received([messages[0], *(messages[k] for k in order)])
    newest, wanted = 0, [0]
    for k in order:
        if k > newest:
            newest, wanted = k, [*wanted, k]
    np.testing.assert_array_equal(found, packets.reshape(31, -1, 5)[wanted].reshape(-1, 5))
    assert intake.received == rows * len(wanted)
    assert intake.repeated == rows * (1 + len(order) - len(wanted))
    assert intake.lost == rows * (newest + 1 - len({0, *order}))


def test_a_line_without_end_is_bounded_in_memory_and_time():
    header, row = b"time,q.a,v.a,a.a,u1.a\n", b"1,2,3,4,5\n"
    with pytest.raises(LogError, match=r"line 1: .* 1048576 B.*udp://"):
        for reader in [TextPackets(NAMES, Intake())]:
            for _ in range(20):
                reader.take(b"\0" * 100_000)
    long = b"9" * (LONGEST_LINE + 1) + b"\n"
    for size in (70_000, 1 << 30):
        intake, text = Intake(), header + row + long + row + b"9" * 3_000_000
        reader = TextPackets(NAMES, intake)
        pieces = [text[k : k + size] for k in range(0, len(text), size)]
        found = np.concatenate([reader.take(piece) for piece in pieces])
        reader.end()
        np.testing.assert_array_equal(found, [[1, 2, 3, 4, 5]] * 2)
        assert intake.bad_rows == 2 and "within 1048576 B" in intake.examples[0]
    reader = TextPackets(NAMES, Intake())
    reader.take(header)
    began = time.process_time()
    for _ in range(400_000):
        reader.take(b"9")
    assert time.process_time() - began < 5.0  # .4 s; 40 s where each piece copies the line


@pytest.mark.parametrize("twice", ["time", "a.a"])
def test_a_column_that_is_there_twice_is_refused(twice):
    header = ",".join([*NAMES, "spare", "spare", twice]).encode()
    with pytest.raises(
        LogError, match=f"line 1: .* the columns {twice}, found time, q.*: each once"
    ):
        TextPackets(NAMES, Intake()).take(header + b"\n")


def test_digits_with_underscores_are_no_number():
    intake = Intake()
    found = TextPackets(NAMES, intake).take(",".join(NAMES).encode() + b"\n1,2,3,4,1_000\n")
    assert not len(found) and intake.examples == ["line 2: expected a number, found '1_000'"]


@pytest.mark.parametrize("mark", ["", '"'])
def test_marks_of_bytes_and_quotes_are_no_part_of_a_name(mark):
    text = b"\xef\xbb\xbf" + ",".join(mark + name + mark for name in NAMES).encode()
    text += b"\n1,2,3,4,5\n"
    np.testing.assert_array_equal(TextPackets(NAMES, Intake()).take(text), [[1, 2, 3, 4, 5]])


def test_a_header_cannot_flood_the_terminal():
    with pytest.raises(LogError) as refused:
        TextPackets(NAMES, Intake()).take(b"\x1b[2J" + b"k" * 100_000 + b"\n")
    assert len(str(refused.value)) < 200 and "\x1b" not in str(refused.value)


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
    with pytest.raises(LogError, match="found no such file"):
        source_of(str(tmp_path / "no.csv"), NAMES)
    with pytest.raises(LogError, match="a folder"):
        source_of(str(tmp_path), NAMES)

"""Packet codecs: known words, round trips, faults, real recordings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roller_core.codecs import (
    MAX_SPAN_NS,
    CodecError,
    PacketDecoder,
    PacketLengthError,
    PacketTimeError,
    UnknownEncodingError,
    encode,
)
from roller_core.events import EventArray

ENCODINGS = ("mono", "libcaer", "libcaer_cmp", "evt3")


def assert_same(a: EventArray, b: EventArray) -> None:
    for field in ("x", "y", "t_ns", "p"):
        np.testing.assert_array_equal(getattr(a, field), getattr(b, field), err_msg=field)


@st.composite
def event_arrays(draw: st.DrawFn) -> EventArray:
    """Up to 300 events in order of time, many with equal times and in columns."""
    n = draw(st.integers(0, 300))
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    steps_us = rng.choice([0, 0, 0, 1, 200, 5000], n)
    columns = rng.random() < 0.5
    x = np.sort(rng.integers(0, 640, n)) if columns else rng.integers(0, 640, n)
    if columns and n:
        x = np.repeat(x[: n // 8 + 1], 8)[:n]
    y = rng.integers(0, 480, n) if not columns else (np.arange(n) * int(rng.integers(1, 4))) % 480
    start_us = draw(st.integers(0, 1000))
    t_ns = (start_us + np.cumsum(steps_us)) * 1000
    return EventArray.from_arrays(x, y, t_ns, rng.integers(0, 2, n))


@pytest.mark.parametrize("encoding", ENCODINGS)
@settings(max_examples=60)
@given(events=event_arrays(), base_ms=st.integers(0, 10_000_000))
def test_round_trip(encoding: str, events: EventArray, base_ms: int) -> None:
    base_ns = 0 if encoding == "evt3" else base_ms * 1_000_000
    events = events.shifted(base_ns)
    payload = encode(encoding, events, base_ns)
    assert_same(PacketDecoder(encoding, 640, 480).decode(payload, base_ns).events, events)


def slow_libcaer_cmp(words: list[int], base_ns: int, width: int, height: int) -> list[list[int]]:
    """Fields of the events of a payload, word by word."""
    high = low = column = base_y = polarity = 0
    out = []
    for w in words:
        code, value = w >> 12, w & 0xFFF
        high, low = (value if code == k else v for k, v in enumerate((high, low)))
        t = base_ns + ((high << 12) | low) * 1000
        rows = []
        if code == 2:
            column = w & 0x7FF
        elif code == 3:
            rows = [(w & 0x7FF, value >> 11)]
        elif code == 4:
            base_y, polarity = w & 0x7FF, value >> 11
        elif code == 5:
            rows = [(base_y + bit, polarity) for bit in range(8) if w >> bit & 1]
            base_y += 8
        out += [[column, y, t, p] for y, p in rows if column < width and y < height]
    return out


@settings(max_examples=200)
@given(
    st.lists(st.tuples(st.sampled_from([0, 1, 2, 3, 3, 4, 5, 5, 9]), st.integers(0, 0xFFF))),
    st.sampled_from([(640, 480), (1200, 700), (2048, 2048), (9, 3)]),
)
def test_any_words_of_libcaer_cmp(words: list[tuple[int, int]], size: tuple[int, int]) -> None:
    """Vectors reach beyond the image, times go back: as a loop over single words has it."""
    payload = np.array([code << 12 | value for code, value in words], np.uint16)
    packet = PacketDecoder("libcaer_cmp", *size).decode(payload.tobytes(), 5000)
    want = slow_libcaer_cmp(payload.tolist(), 5000, *size)
    assert_same(packet.events, EventArray.from_arrays(*np.array(want, np.int64).reshape(-1, 4).T))
    if packet.ordered:
        assert np.all(np.diff(packet.events.t_ns) >= 0)


def test_libcaer_cmp_tells_whether_times_go_on() -> None:
    forth = np.array([0x1005, 0x2001, 0x3001, 0x1006, 0x3002], np.uint16)
    back = np.array([0x1005, 0x2001, 0x3001, 0x1004, 0x3002], np.uint16)
    for words, ordered in ((forth, True), (back, False)):
        packet = PacketDecoder("libcaer_cmp", 640, 480).decode(words.tobytes())
        assert packet.ordered is ordered


def test_libcaer_cmp_is_compact_on_columns() -> None:
    """64 rows of one column take 4 address words and 8 vectors, not 64 words."""
    n = 64
    events = EventArray.from_arrays([7] * n, np.arange(n), [0] * n, [1] * n)
    assert len(encode("libcaer_cmp", events, 0)) == 2 * (1 + 1 + 8)


def test_libcaer_cmp_keeps_rows_apart() -> None:
    """(10, 17), (11, 18): the common writer's stale row must not come back."""
    events = EventArray.from_arrays([10, 11], [17, 18], [0, 0], [1, 1])
    assert_same(
        PacketDecoder("libcaer_cmp", 640, 480).decode(encode("libcaer_cmp", events, 0)).events,
        events,
    )


def test_libcaer_cmp_longer_than_65_ms() -> None:
    events = EventArray.from_arrays([1, 2], [3, 4], [0, 70_123_000], [0, 1])
    assert_same(
        PacketDecoder("libcaer_cmp", 640, 480).decode(encode("libcaer_cmp", events, 0)).events,
        events,
    )


def test_known_words_mono_and_trigger() -> None:
    word = np.array([5 | (10 << 32) | (20 << 48) | (1 << 63)], np.uint64)
    got = PacketDecoder("mono", 640, 480).decode(word.tobytes(), 1000).events
    assert_same(got, EventArray.from_arrays([10], [20], [1005], [1]))
    edges = PacketDecoder("trigger", 640, 480).decode(word.tobytes(), 1000).triggers
    assert (edges.id[0], edges.t_ns[0], edges.edge[0]) == (10, 1005, 1)


def test_known_words_libcaer() -> None:
    words = np.array([1 | (1 << 1) | (20 << 2) | (10 << 17), 7, 0, 8], np.uint32)
    got = PacketDecoder("libcaer", 640, 480).decode(words.tobytes(), 1000).events
    assert_same(got, EventArray.from_arrays([10], [20], [8000], [1]))  # the invalid one is left out


def test_libcaer_time_rolls_over_within_a_packet() -> None:
    data = 1 | (10 << 17)
    words = np.array([data, 2**31 - 1, data, 0], np.uint32)
    t = PacketDecoder("libcaer", 640, 480).decode(words.tobytes()).events.t_ns
    assert t[1] - t[0] == 1000


def test_known_words_evt3() -> None:
    words = np.array(
        [0x2805, 0x8001, 0x6002, 0x0014, 0x2805, 0x3003, 0x5081, 0x4001, 0xA601], np.uint16
    )
    packet = PacketDecoder("evt3", 640, 480).decode(words.tobytes())
    t = ((1 << 12) | 2) * 1000
    # The first word comes before any time and can't be placed.
    assert_same(
        packet.events, EventArray.from_arrays([5, 3, 10, 11], [20] * 4, [t] * 4, [1, 0, 0, 0])
    )
    assert (packet.triggers.id[0], packet.triggers.edge[0], packet.triggers.t_ns[0]) == (6, 1, t)


def test_evt3_wraps_after_16_seconds_across_packets() -> None:
    decoder = PacketDecoder("evt3", 640, 480)
    step_ns = 3_000_000_000
    for k in range(20):
        one = EventArray.from_arrays([1], [2], [k * step_ns], [0])
        assert decoder.decode(encode("evt3", one, k * step_ns)).events.t_ns[0] == k * step_ns


@pytest.mark.parametrize("encoding", [*ENCODINGS, "trigger"])
def test_odd_length_is_refused(encoding: str) -> None:
    with pytest.raises(PacketLengthError, match="whole number"):
        PacketDecoder(encoding, 640, 480).decode(bytes(13))


def test_unknown_encoding_is_refused() -> None:
    with pytest.raises(UnknownEncodingError, match="'evt9'"):
        PacketDecoder("evt9", 640, 480)
    with pytest.raises(UnknownEncodingError):
        encode("trigger", EventArray.from_arrays([1], [1], [1], [1]), 0)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_times_that_do_not_fit_are_refused(encoding: str) -> None:
    late = EventArray.from_arrays([1, 1], [1, 1], [0, MAX_SPAN_NS[encoding] + 1000], [1, 1])
    backwards = EventArray.from_arrays([1, 1], [1, 1], [2000, 1000], [1, 1])
    early = EventArray.from_arrays([1], [1], [-1000], [1])
    for events in (late, backwards, early):
        with pytest.raises(PacketTimeError):
            encode(encoding, events, 0)


def test_pixels_that_do_not_fit_are_refused() -> None:
    with pytest.raises(CodecError, match="2047"):
        encode("libcaer_cmp", EventArray.from_arrays([3000], [1], [0], [1]), 0)


def test_events_outside_the_image_are_counted() -> None:
    events = EventArray.from_arrays([5, 700, 6], [5, 5, 500], [0, 1000, 2000], [1, 1, 1])
    packet = PacketDecoder("libcaer", 640, 480).decode(encode("libcaer", events, 0))
    assert len(packet.events) == 1
    assert packet.outside == 2

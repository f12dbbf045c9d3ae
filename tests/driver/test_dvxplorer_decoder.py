"""The decoder of the camera's words."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from driver.emulation.camera_words import (
    decode_plainly,
    encode_words,
    in_order,
    is_reference,
)
from roller_core.events import EventArray
from roller_driver.dvxplorer.decoder import WordDecoder

VECTOR = np.array([0x080003E8, 0x04201811, 0x88368005, 0x04001A7F, 0x80EF0080], np.uint32)
EXPECTED = [
    (1_000_003, 17, 104, 1),
    (1_000_003, 17, 106, 1),
    (1_000_003, 17, 127, 0),
    (1_000_003, 639, 479, 0),
]


def tuples(events):
    return list(zip((events.t_ns // 1000).tolist(), events.x.tolist(), events.y.tolist(),
                    events.p.tolist(), strict=True))  # fmt: skip


def decode(words, decoder=None):
    return tuples((decoder or WordDecoder()).decode(np.asarray(words, np.uint32).tobytes()))


def frame(ms, sub, x, *, start=True, y=8):
    """A reference (where ms is given), a column and one ON event."""
    reference = [] if ms is None else [0x08000000 | ms & 0x3FFFFF]
    return [*reference, 0x04000000 | start << 21 | sub << 11 | x, 0x80000001 | (y // 8) << 18]


def random_events(rng, n, span_us=20_000, start_us=5_000_000):
    t = np.sort(rng.integers(start_us, start_us + span_us, n)) // 100 * 100
    t[0] = start_us
    return EventArray.from_arrays(
        rng.integers(0, 640, n), rng.integers(0, 480, n), t * 1000, rng.integers(0, 2, n)
    )


def distinct(events):
    return sorted(set(tuples(events)))


def test_the_vendors_vector():
    assert decode(VECTOR) == EXPECTED
    assert decode_plainly(VECTOR) == EXPECTED


def test_our_encoder_writes_the_vendors_vector():
    t, x, y, p = zip(*EXPECTED, strict=True)
    events = EventArray.from_arrays(x, y, np.array(t) * 1000, p)
    assert encode_words(events).tolist() == VECTOR.tolist()


def test_transfers_may_break_anywhere():
    events = random_events(np.random.default_rng(1), 3000)
    raw = encode_words(events, padding=1).tobytes()
    for size in (1, 3, 4, 5, 1021, len(raw)):
        decoder = WordDecoder(words=8)
        out = [
            t for k in range(0, len(raw), size) for t in tuples(decoder.decode(raw[k : k + size]))
        ]
        assert sorted(out) == distinct(events)
        assert decoder.counts.errors == 0
        assert decoder.counts.padding > 0


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 400), st.booleans())
def test_any_events_come_back(seed, n, pairs):
    rng = np.random.default_rng(seed)
    # Around the overflow of the 22-bit reference now and then.
    start = int(rng.choice([0, 1_000_000, (2**22 - 5) * 1000]))
    events = random_events(rng, n, int(rng.integers(1, 50_000)), start)
    decoder = WordDecoder()
    out = decoder.decode(encode_words(events, pairs).tobytes())
    assert distinct(out) == distinct(events)
    assert len(out) == len(distinct(events))
    assert bool(np.all(np.diff(out.t_ns) >= 0))
    assert in_order(out).t_ns.tolist() == [1000 * t for t, *_ in distinct(events)]
    counts = decoder.counts
    assert (counts.errors, counts.dropped_frames, counts.events) == (0, 0, len(out))
    assert counts.frames == len(np.unique(out.t_ns))


@settings(max_examples=100)
@given(st.lists(st.one_of(
    st.integers(0, 2**32 - 1),
    st.integers(0, 300).map(lambda ms: 0x08000000 | ms),
    st.tuples(st.integers(0, 999), st.integers(0, 700), st.booleans()).map(
        lambda c: 0x04000000 | c[2] << 21 | c[0] << 11 | c[1]),
    st.integers(0, 2**31 - 1).map(lambda w: 0x80000000 | w),
), max_size=120), st.integers(1, 7))  # fmt: skip
def test_any_words_decode_as_the_plain_decoder_has_them(words, parts):
    expected = decode_plainly(np.array(words, np.uint32))
    decoder = WordDecoder()
    out = [t for part in np.array_split(np.array(words, np.uint32), parts)
           for t in decode(part, decoder)]  # fmt: skip
    assert out == expected
    assert all(x < 640 and y < 480 for _, x, y, _ in out)


def test_nothing_before_the_first_reference():
    decoder = WordDecoder()
    assert decode([*frame(None, 3, 5), *frame(7, 1, 5)], decoder) == [(7001, 5, 8, 1)]
    assert decoder.counts.dropped_frames == 0


def test_a_lost_reference_drops_frames_up_to_the_next():
    decoder = WordDecoder()
    words = [*frame(5, 100, 1), *frame(None, 900, 2), *frame(None, 100, 3), *frame(None, 300, 4),
             *frame(7, 100, 5)]  # fmt: skip
    assert decode(words, decoder) == [(5100, 1, 8, 1), (5900, 2, 8, 1), (7100, 5, 8, 1)]
    counts = decoder.counts
    assert (counts.lost_references, counts.dropped_frames, counts.dropped_words) == (1, 2, 2)


def test_a_column_that_jumps_back_drops_the_rest_of_the_frame():
    decoder = WordDecoder()
    words = [*frame(5, 100, 50), *frame(None, 100, 40, start=False),
             *frame(None, 100, 60, start=False), *frame(6, 100, 5)]  # fmt: skip
    assert decode(words, decoder) == [(5100, 50, 8, 1), (6100, 5, 8, 1)]
    counts = decoder.counts
    assert (counts.column_jumps, counts.dropped_frames, counts.dropped_words) == (1, 1, 2)


def test_lost_references_in_a_stream_are_counted():
    rng = np.random.default_rng(2)
    n = 4000
    t = np.repeat(np.arange(200) * 200 + 1_000_000, n // 200)
    events = EventArray.from_arrays(
        rng.integers(0, 640, n), rng.integers(0, 480, n), t * 1000, np.ones(n)
    )
    words = encode_words(events)
    at = np.flatnonzero(is_reference(words))[[5, 11, 20]]
    decoder = WordDecoder()
    out = decoder.decode(np.delete(words, at).tobytes())
    lost = np.isin(events.t_ns // 1_000_000, (words[at] & 0x3FFFFF))
    assert distinct(out) == distinct(events[~lost])
    counts = decoder.counts
    assert (counts.lost_references, counts.dropped_frames) == (3, 15)


def test_time_runs_on_over_the_references_overflow():
    last = 2**22 - 1
    words = [*frame(last, 10, 1), *frame(0, 10, 1), *frame(last // 2, 0, 1)]
    assert decode(words)[:2] == [(last * 1000 + 10, 1, 8, 1), (2**22 * 1000 + 10, 1, 8, 1)]


def test_a_single_reference_out_of_turn_is_not_believed():
    decoder = WordDecoder()
    words = [*frame(1000, 1, 1), *frame(900_000, 2, 2), *frame(1001, 3, 3)]
    assert [t for t, *_ in decode(words, decoder)] == [1_000_001, 1_001_003]
    assert (decoder.counts.bad_references, decoder.counts.time_steps) == (1, 0)


def test_a_clock_set_again_is_followed():
    decoder = WordDecoder()
    words = [*frame(3_000_000, 1, 1), *frame(2, 2, 2), *frame(3, 3, 3), *frame(4, 4, 4)]
    assert [t for t, *_ in decode(words, decoder)] == [3_000_000_001, 3003, 4004]
    assert decoder.counts.time_steps == 1


def test_corrupt_words_are_counted_and_skipped():
    decoder = WordDecoder()
    beyond = 0x80000000 | 60 << 18 | 1
    words = [*frame(5, 1, 1), beyond, 0x10000000, 0, *frame(None, 1, 700, start=False),
             *frame(None, 1, 9, start=False), *frame(None, 200, 3)]  # fmt: skip
    assert decode(words, decoder) == [(5001, 1, 8, 1), (5200, 3, 8, 1)]
    counts = decoder.counts
    assert (counts.bad_words, counts.padding, counts.dropped_frames) == (3, 1, 1)


def test_reset_forgets_time_but_not_counts():
    decoder = WordDecoder()
    decode([*frame(5000, 1, 1), 0x10000000], decoder)
    decoder.reset()
    assert decode(frame(3, 1, 1), decoder) == [(3001, 1, 8, 1)]
    assert decoder.counts.bad_words == 1


@given(
    st.lists(st.tuples(st.integers(0, 400), st.integers(1, 400)), min_size=1, max_size=4),
    st.integers(1, 7),
    st.integers(0, 2**31),
)
@settings(max_examples=60)
def test_after_gaps_events_have_their_own_times(gaps, piece, seed):
    """Transfers of odd lengths are missing: some events go, none comes at another time."""
    events = in_order(random_events(np.random.default_rng(seed), 600))
    raw, decoder, at = encode_words(events).tobytes(), WordDecoder(), 0
    found = []

    def decode_up_to(end):
        for k in range(at, min(end, len(raw)), piece):
            found.extend(tuples(decoder.decode(raw[k : min(k + piece, end)])))

    for until, missing in gaps:
        decode_up_to(at + until)
        at += until + missing
        decoder.leave_gap(missing)
    decode_up_to(len(raw))
    assert set(found) <= set(tuples(events))
    assert decoder.counts.bad_words == 0
    if at < len(raw) // 2:
        assert len(found) > 0.3 * len(events)

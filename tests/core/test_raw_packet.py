"""A packet's fields without decoding it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roller_core.bags import EVENT_PACKET, typestore
from roller_core.codecs import CodecError, PacketDecoder, RawPacket, count_events, encode
from roller_core.events import EventArray
from roller_core.outputs import stamp_ns
from roller_core.seq_gaps import SeqGaps

STORE = typestore()


def message(frame: str, encoding: str, payload: bytes, seq: int = 7) -> bytes:
    types = STORE.types
    packet = types[EVENT_PACKET](
        header=types["std_msgs/msg/Header"](
            types["builtin_interfaces/msg/Time"](1_700_000_000, 123_456_789), frame
        ),
        height=480,
        width=640,
        seq=seq,
        time_base=2**40 + 5,
        encoding=encoding,
        is_bigendian=False,
        events=np.frombuffer(payload, np.uint8),
    )
    return bytes(STORE.serialize_cdr(packet, EVENT_PACKET))


@settings(max_examples=50)
@given(
    frame=st.text(st.characters(codec="ascii", exclude_characters="\0"), max_size=20),
    encoding=st.sampled_from(["mono", "libcaer", "libcaer_cmp", "evt3", "trigger"]),
    payload=st.binary(max_size=50),
    seq=st.integers(0, 2**64 - 1),
)
def test_fields_are_those_of_the_message(
    frame: str, encoding: str, payload: bytes, seq: int
) -> None:
    packet = RawPacket.parse(message(frame, encoding, payload, seq))
    assert packet.stamp_ns == 1_700_000_000_123_456_789
    assert (packet.height, packet.width, packet.seq) == (480, 640, seq)
    assert packet.time_base_ns == 2**40 + 5
    assert packet.encoding == encoding
    assert bytes(packet.payload) == payload
    assert not packet.is_bigendian
    assert (stamp_ns(packet), packet.time_base) == (packet.stamp_ns, packet.time_base_ns)
    assert packet.events is packet.payload


def test_a_message_cut_anywhere_is_refused() -> None:
    whole = message("event_camera_optical_frame", "mono", bytes(range(16)))
    for size in range(len(whole)):
        with pytest.raises(CodecError):
            RawPacket.parse(whole[:size])


@pytest.mark.parametrize("encoding", ["mono", "libcaer", "libcaer_cmp", "evt3"])
def test_events_are_counted_as_a_decoder_finds_them(encoding: str) -> None:
    rng = np.random.default_rng(3)
    n = 500
    t_ns = np.sort(rng.integers(0, 900, n)) * 1000
    events = EventArray.from_arrays(
        rng.integers(0, 8, n) * 80, rng.integers(0, 480, n), t_ns, rng.integers(0, 2, n)
    )
    payload = encode(encoding, events, 0)
    decoded = PacketDecoder(encoding, 640, 480).decode(payload, 0).events
    assert count_events(encoding, payload) == len(decoded) == n
    assert count_events("evt9", payload) == 0


def test_gaps_in_the_numbers() -> None:
    gaps = SeqGaps()
    for t_ns, seq in enumerate([5, 6, 9, 10, 11, 12, 20]):
        gaps.see("/a", seq, t_ns * 10**9)
        gaps.see("/b", 100 + t_ns, t_ns * 10**9)  # whole
    gaps.see("/a", 0, 8 * 10**9)  # a driver that started anew
    gaps.see("/a", 1, 9 * 10**9)
    assert (gaps.lost, gaps.gaps) == (2 + 7, 2)
    assert gaps.describe(10**9) == "2 before 1.000 s, 7 before 5.000 s"
    # No cell loses an hour of packets in one place: it is another source.
    for seq in (2**63, 2**63 + 2, 2**64 - 1, 0):
        gaps.see("/a", seq, 10 * 10**9)
    assert (gaps.lost, gaps.gaps, gaps.restarts) == (2 + 7 + 1, 3, 1 + 3)
    # Two at once: neither's numbers are the other's gaps.
    for k in range(5):
        gaps.see("/two", k, 0, b"one")
        gaps.see("/two", 1000 + 2 * k, 0, b"other")
    assert (gaps.lost, gaps.restarts) == (2 + 7 + 1 + 4, 5)
    gaps.forget("/a")
    gaps.see("/a", 9, 11 * 10**9)
    assert (gaps.lost, gaps.restarts) == (2 + 7 + 1 + 4, 6)


@pytest.mark.parametrize("apart", [500, 2**19, 2**40])
def test_two_senders_that_a_bag_does_not_tell_apart_lose_only_what_each_does(apart: int) -> None:
    gaps = SeqGaps()
    for k in (k for k in range(1000) if k not in (400, 401)):
        gaps.see("/a", k, k)
        if k != 700:
            gaps.see("/a", apart + k, k)
    assert (gaps.lost, gaps.gaps, gaps.restarts) == (2 + 2 + 1, 3, 1)
    assert [gap.packets for gap in gaps.places] == [2, 2, 1]

"""Whatever bytes and fields a packet holds, it is decoded or refused by name."""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from roller_core.codecs import CodecError, PacketDecoder
from roller_core.errors import RollerError
from roller_core.event_stream import EventStream

ENCODINGS = st.sampled_from(["mono", "libcaer", "libcaer_cmp", "evt3", "trigger", "evt2", ""])
U32, U64 = st.integers(0, 2**32 - 1), st.integers(0, 2**64 - 1)
WIDTHS = st.sampled_from([(640, 480), (1, 1), (65_535, 65_535)])


@settings(max_examples=500)
@given(ENCODINGS, st.binary(max_size=256), U64, WIDTHS)
@example("mono", bytes(8), 2**63, (640, 480))
@example("mono", b"\xff" * 8, 2**62 - 1, (640, 480))
@example("libcaer", b"\xff" * 16, 2**64 - 1, (640, 480))
def test_any_payload_is_decoded_or_refused(
    encoding: str, payload: bytes, time_base_ns: int, size: tuple[int, int]
) -> None:
    try:
        packet = PacketDecoder(encoding, *size).decode(payload, time_base_ns)
    except CodecError:
        return
    events = packet.events
    assert np.all(events.x < size[0])
    assert np.all(events.y < size[1])
    assert np.all(events.p <= 1)


@settings(max_examples=200)
@given(
    st.lists(
        st.tuples(
            ENCODINGS,
            st.sampled_from([640, 0, 2**32 - 1]),
            U64,
            st.integers(-(2**31), 2**31 - 1),
            U64,
            st.binary(max_size=64),
        ),
        max_size=6,
    )
)
def test_a_stream_of_nonsense_is_refused_by_name(
    packets: list[tuple[str, int, int, int, int, bytes]],
) -> None:
    stream = EventStream(640, 480)
    newest = -(2**62)
    for encoding, width, seq, stamp_s, time_base_ns, payload in packets:
        try:
            events = stream.push(
                encoding, width, 480, seq, stamp_s * 1_000_000_000, time_base_ns, payload
            )
        except RollerError:
            newest = -(2**62)  # time may have jumped back
            continue
        if len(events):
            assert np.all(np.diff(events.t_ns) >= 0)
            assert events.t_ns[0] >= newest
            newest = int(events.t_ns[-1])

"""The stream of packets: times, order, and an account of what was lost."""

import numpy as np
import pytest

from roller_core.codecs import CodecError, PacketLengthError, encode
from roller_core.event_stream import EventStream, ImageSizeError
from roller_core.events import EventArray, EventArrayError
from roller_core.time_order import TimeBackwardsError

START_NS = 1_700_000_000_000_000_000
MS = 1_000_000


def push(
    stream: EventStream, seq: int, sensor_ns: int, arrival_ns: int, n: int = 10, **more: object
) -> EventArray:
    """A packet of events, 10 µs apart."""
    events = EventArray.from_arrays(
        np.arange(n), np.arange(n), sensor_ns + 10_000 * np.arange(n), np.ones(n)
    )
    fields = {"encoding": "libcaer_cmp", "width": 64, "height": 48, **more}
    payload = encode("libcaer_cmp", events, sensor_ns)
    return stream.push(
        fields["encoding"], fields["width"], fields["height"], seq, arrival_ns, sensor_ns, payload
    )  # type: ignore[arg-type]


def test_events_get_ros_time_from_the_first_arrival() -> None:
    stream = EventStream(64, 48)
    events = push(stream, 0, 5 * MS, START_NS)
    assert events.t_ns[0] == START_NS
    # A later arrival doesn't move the map, an earlier one does.
    late = push(stream, 1, 6 * MS, START_NS + MS + 300_000)
    assert late.t_ns[0] == START_NS + MS
    early = push(stream, 2, 7 * MS, START_NS + 2 * MS - 100_000)
    assert early.t_ns[0] == START_NS + 2 * MS - 100_000


def test_missing_numbers_are_lost_packets_but_a_new_start_is_not() -> None:
    stream = EventStream(64, 48)
    for seq in (0, 1, 4, 5, 0, 1):
        push(stream, seq, (1 + stream.counts.packets) * MS, START_NS + stream.counts.packets * MS)
    assert stream.counts.lost_packets == 2
    assert stream.counts.packets == 6
    assert stream.counts.events == 60


def test_times_never_run_backwards() -> None:
    """The clock's map may move back by its jitter: such events are held, none is lost."""
    rng = np.random.default_rng(0)
    stream, last, total = EventStream(64, 48), 0, 0
    for k in range(500):
        jitter = int(rng.exponential(200_000))
        events = push(stream, k, (k + 1) * MS, START_NS + k * MS + jitter)
        assert events.t_ns[0] >= last
        last, total = int(events.t_ns[-1]), total + len(events)
    assert total == 5000
    assert stream.counts.late_events == 0


def test_packets_in_the_wrong_order_are_told() -> None:
    """Within 5 ms they take the newest time, which moves their edges along the roll."""
    stream, total = EventStream(64, 48), 0
    for k in (0, 1, 3, 2, 4):
        total += len(push(stream, k, (10 + 2 * k) * MS, START_NS + 2 * k * MS))
    assert total == 50
    assert stream.counts.late_events == 10


def test_late_packets_are_left_out_and_counted() -> None:
    stream = EventStream(64, 48)
    push(stream, 0, 100 * MS, START_NS)
    push(stream, 1, 150 * MS, START_NS + 50 * MS)
    assert len(push(stream, 2, 120 * MS, START_NS + 20 * MS)) == 0
    assert stream.counts.late_events == 10


def test_a_jump_back_starts_anew_and_keeps_its_events() -> None:
    stream = EventStream(64, 48)
    push(stream, 0, 100 * MS, START_NS)
    with pytest.raises(TimeBackwardsError, match="runs backwards by 20") as caught:
        push(stream, 1, 5 * MS, START_NS - 20_000 * MS)
    assert len(caught.value.events) == 10
    after = push(stream, 2, 6 * MS, START_NS - 19_999 * MS)
    assert after.t_ns[0] == START_NS - 19_999 * MS
    assert stream.counts.clock_steps == 1


def test_a_short_recording_that_is_played_again_starts_anew() -> None:
    """Of less than a second, by the same publisher; its first packet holds no events."""
    stream = EventStream(64, 48)
    for k in range(20, 60):
        push(stream, k, 100 * MS + 10 * k * MS, START_NS + 10 * k * MS)
    assert len(push(stream, 20, 300 * MS, START_NS + 200 * MS, n=0)) == 0
    with pytest.raises(TimeBackwardsError, match=r"runs backwards by 0\.38") as caught:
        push(stream, 21, 310 * MS, START_NS + 210 * MS)
    assert len(caught.value.events) == 10
    assert len(push(stream, 22, 320 * MS, START_NS + 220 * MS)) == 10
    assert stream.counts.late_events == 0


def test_a_driver_started_again_goes_on_where_it_was() -> None:
    """Its numbers begin anew, time doesn't but for jitter."""
    stream = EventStream(64, 48)
    for seq in (70, 71, 0, 1):
        sensor_ns = (100 + stream.counts.packets) * MS
        jitter = 3 * MS if seq == 71 else 0
        assert len(push(stream, seq, sensor_ns + jitter, START_NS + sensor_ns)) == 10


def test_another_image_size_is_refused() -> None:
    stream, said = EventStream(64, 48), set()
    for seq in range(2):
        with pytest.raises(ImageSizeError) as caught:
            push(stream, seq, MS, START_NS, width=640, height=480)
        said.add(str(caught.value))
    (text,) = said  # the same of each: of a thousand packets a second it is said once
    assert "640×480 px but the camera is calibrated for 64×48" in text


def test_a_broken_packet_costs_only_itself() -> None:
    stream = EventStream(64, 48)
    push(stream, 0, MS, START_NS)
    with pytest.raises(PacketLengthError):
        stream.push("libcaer_cmp", 64, 48, 1, START_NS, MS, b"123")
    assert len(push(stream, 2, 3 * MS, START_NS + 2 * MS)) == 10
    assert stream.counts.lost_packets == 1


def test_arrays_must_fit_together() -> None:
    with pytest.raises(EventArrayError, match="field 'y'"):
        EventArray(
            np.zeros(3, np.uint16), np.zeros(2, np.uint16), np.zeros(3, np.int64),
            np.zeros(3, np.uint8),
        )  # fmt: skip


def test_what_can_not_be_decoded_is_counted() -> None:
    stream = EventStream(64, 48)
    push(stream, 0, MS, START_NS)
    for seq, (encoding, width) in enumerate([("libcaer_cmp", 64), ("evt9", 64), ("mono", 640)], 1):
        with pytest.raises((CodecError, ImageSizeError)):
            stream.push(encoding, width, 48, seq, START_NS, MS, b"123")
    push(stream, 4, 2 * MS, START_NS + MS)
    assert stream.counts.decode_errors == 3
    assert stream.counts.lost_packets == 3


def test_a_camera_whose_clock_goes_back_is_followed() -> None:
    """The host's clock goes on: events do, too, and nothing is lost but the map is made anew."""
    stream = EventStream(64, 48)
    for k in range(50):
        push(stream, k, 90_000 * MS + k * MS, START_NS + k * MS)
    got = [push(stream, 50 + k, k * MS, START_NS + (50 + k) * MS) for k in range(50)]
    starts = np.array([int(events.t_ns[0]) for events in got])
    np.testing.assert_array_equal(starts, START_NS + (50 + np.arange(50)) * MS)
    assert (stream.counts.clock_steps, stream.counts.late_events) == (1, 0)

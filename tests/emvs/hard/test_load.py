"""Too few events, too many, and all in one place; counters that must not overflow."""

import tracemalloc

import numpy as np
import pytest

from emvs.hard import world
from emvs.hard.world import ALL, PAPER
from emvs.scenes import MS
from roller_core.codecs import encode
from roller_core.errors import RollerError
from roller_core.event_stream import EventStream
from roller_core.events import EventArray

WIDTH, HEIGHT = world.CAMERA.width, world.CAMERA.height
DURATION_NS = round(world.DURATION_S * 1e9)


@pytest.fixture(scope="module")
def events() -> EventArray:
    return world.scan()


def hot_pixel(n: int, x: int = 160, y: int = 20) -> EventArray:
    t = np.linspace(0, DURATION_NS - 1, n).astype(np.int64)
    return EventArray.from_arrays(np.full(n, x), np.full(n, y), t, np.arange(n) % 2)


def together(*parts: EventArray) -> EventArray:
    return EventArray.concatenate(parts).sorted_by_time()


@pytest.mark.parametrize("method", ALL)
def test_a_single_event_has_no_depth(method: str) -> None:
    one = EventArray.from_arrays([160], [20], [50 * MS], [1])
    late = EventArray.from_arrays([0], [0], [99 * MS], [1])
    for events in (one, together(one, late)):
        assert not len(world.points_of(world.run(method, events, world.poses())))


@pytest.mark.parametrize("count", [10_000, 210_000])
@pytest.mark.parametrize("method", ALL)
def test_a_hot_pixel_has_no_depth(method: str, count: int) -> None:
    """Its ray sweeps every plane alike, and its trail ends where the window does.

    Of 210,000 events more are in a window than 16 bits count.
    """
    assert not len(world.points_of(world.run(method, hot_pixel(count), world.poses())))


@pytest.mark.parametrize("method", ALL)
def test_a_hot_pixel_leaves_the_others_depth_alone(events: EventArray, method: str) -> None:
    found = world.run(method, together(events, hot_pixel(10_000)), world.poses())
    world.assert_right(world.points_of(found))


@pytest.mark.parametrize("method", ALL)
def test_a_burst_of_a_million_events(events: EventArray, method: str) -> None:
    """Every event of a window 26 times: right depth, and memory for the events, not for more."""
    burst = events[(events.t_ns > 30 * MS) & (events.t_ns < 70 * MS)]
    burst = burst[np.repeat(np.arange(len(burst)), 1_000_000 // len(burst) - 1)]
    many = together(events, burst)
    assert len(many) > 1_000_000
    tracemalloc.start()
    try:
        found = world.run(method, many, world.poses(), **full_scale(method))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    world.assert_right(world.points_of(found))
    # A quarter of a kilobyte an event holds its ray in every stage; 48 MB the planes.
    assert peak < 256 * len(many) + 48e6


def full_scale(method: str) -> dict[str, object]:
    """The scale of the threshold is an absolute number of votes."""
    return {"paper": {"full_scale_votes": 4000.0, "threshold_c": 24.0}} if method in PAPER else {}


@pytest.mark.parametrize("method", ALL)
def test_everything_in_one_row(events: EventArray, method: str) -> None:
    """Parallax along the row suffices; a method that wants neighbours may give none."""
    row = events[events.y == 20]
    points = world.points_of(world.run(method, row, world.poses()))
    wrong = np.abs(world.errors_px(points)) > 2
    assert wrong.sum() <= 0.05 * len(points)


@pytest.mark.parametrize("method", ALL)
def test_everything_in_one_column(method: str) -> None:
    """A column sees each line once, from one place: nothing to tell depth by."""
    column = world.scan(share=1.0)
    column = column[column.x == 160]
    assert len(column) > 500
    assert not len(world.points_of(world.run(method, column, world.poses())))


@pytest.mark.parametrize("method", ALL)
def test_events_outside_the_image_are_refused(events: EventArray, method: str) -> None:
    """Not wrapped into the next row, or read from beyond the table of rays."""
    stray = EventArray.from_arrays([WIDTH], [3], [50 * MS], [1])
    with pytest.raises(RollerError, match="outside"):
        world.run(method, together(events, stray), world.poses())


@pytest.mark.parametrize("start", [2**31, 2**32, 2**53, 2**63, 2**64 - 10, 2**64])
def test_packet_numbers_may_be_as_large_as_the_field(start: int) -> None:
    """`seq` has 64 bits: near 2**63 a gap is its number of packets; 2**64 - 1 is followed by 0."""
    stream = EventStream(WIDTH, HEIGHT)
    payload = encode("libcaer_cmp", EventArray.from_arrays([1], [1], [0], [1]), 0)
    for k, seq in enumerate((start - 2, start - 1, start, start + 4)):
        now_ns = 10**18 + k * MS
        stream.push("libcaer_cmp", WIDTH, HEIGHT, seq % 2**64, now_ns, k * MS, payload)
    assert stream.counts.lost_packets == 3
    assert stream.counts.packets == stream.counts.events == 4


def test_counts_of_events_are_whole_numbers_of_any_size() -> None:
    stream = EventStream(WIDTH, HEIGHT)
    stream.counts.events = 2**63 - 1
    payload = encode("libcaer_cmp", hot_pixel(10), 0)
    stream.push("libcaer_cmp", WIDTH, HEIGHT, 0, 10**18, 0, payload)
    assert stream.counts.events == 2**63 + 9

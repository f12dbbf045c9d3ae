"""Clocks that roll over, drift, stutter and stop; poses that jitter or are missing."""

from itertools import pairwise

import numpy as np
import pytest

from emvs.hard import world
from emvs.hard.world import ALL, METHODS, SPEED_M_S
from emvs.scenes import MS, without
from roller_core.codecs import encode
from roller_core.event_stream import EventStream
from roller_core.events import EventArray
from roller_core.pose_track import PoseGapError, PoseTrack

EPOCH_NS = 1_790_000_000_000_000_000
WIDTH, HEIGHT = world.CAMERA.width, world.CAMERA.height


@pytest.fixture(scope="module")
def events() -> EventArray:
    return world.scan()


def libcaer_words(events: EventArray, t_us: np.ndarray) -> np.ndarray:
    """A packet as a libcaer driver writes it, with times of its own."""
    words = np.empty((len(events), 2), np.uint32)
    words[:, 0] = 1 | (events.p.astype(np.uint32) << 1) | (events.y.astype(np.uint32) << 2)
    words[:, 0] |= events.x.astype(np.uint32) << 17
    words[:, 1] = t_us
    return words.reshape(-1).view(np.uint8)


def through_stream(kind: str, events: EventArray, packet: int = 1500) -> EventArray:
    """Events as packets of a sensor whose time rolls over in the middle of them, decoded."""
    span_us = {"evt3": 2**24, "libcaer": 2**31, "driver": 2**32}[kind]
    t_us = span_us - 50_000 + events.t_ns // 1000
    cuts = set(range(0, len(events), packet)) | {len(events)}
    if kind == "driver":
        # The 32-bit time is in time_base, so no packet reaches over the end.
        cuts.add(int(np.searchsorted(t_us, span_us)))
    stream, out, ends = EventStream(WIDTH, HEIGHT), [], sorted(cuts)
    for seq, (a, b) in enumerate(pairwise(ends)):
        part, part_us = events[a:b], t_us[a:b]
        arrival = EPOCH_NS + int(part.t_ns[0])
        if kind == "evt3":
            # No time base: the low 24 bits of the time itself.
            moved, base, encoding = part.with_times(part_us * 1000), 0, "evt3"
            payload = encode("evt3", moved, int(moved.t_ns[0]))
        elif kind == "libcaer":
            turns = int(part_us[0]) // span_us
            payload, encoding = libcaer_words(part, part_us % span_us), "libcaer"
            base = turns * span_us * 1000
        else:
            base = int(part_us[0]) % span_us * 1000
            moved = part.with_times(part_us % span_us * 1000)
            payload, encoding = encode("libcaer_cmp", moved, base), "libcaer_cmp"
        out.append(stream.push(encoding, WIDTH, HEIGHT, seq, arrival, base, payload))
    assert stream.counts.events == len(events)
    assert stream.counts.late_events == stream.counts.lost_packets == 0
    return EventArray.concatenate(out)


@pytest.mark.parametrize("kind", ["evt3", "libcaer", "driver"])
def test_sensor_time_may_roll_over(events: EventArray, kind: str) -> None:
    """24, 31 or 32 bits of microseconds start again at 0: every event keeps its time, and with it
    every method its depth."""
    expected = events.shifted(EPOCH_NS)
    found = through_stream(kind, events)
    np.testing.assert_array_equal(found.t_ns, expected.t_ns)
    np.testing.assert_array_equal(np.sort(found.x), np.sort(expected.x))
    track = world.poses(start_ns=EPOCH_NS)
    world.assert_right(world.points_of(world.run("focus", found, track)))
    world.assert_right(world.points_of(world.run("surface", found, track)))


@pytest.mark.parametrize("method", ALL)
def test_a_clock_50_ppm_fast_is_put_right(events: EventArray, method: str) -> None:
    """After half a minute it is 1.5 ms off, 0.45 mm along the roll; the map takes it out.

    The depth of a baseline 50 ppm too long is off by 2 µm.
    """
    rng = np.random.default_rng(3)
    stream, start_s = EventStream(WIDTH, HEIGHT), 30.0
    quiet = np.arange(0, int(start_s * 1e9), 50 * MS)
    bounds = np.searchsorted(events.t_ns, np.arange(0, world.DURATION_S * 1e9 + 1, 2 * MS))
    parts = [EventArray.from_arrays([0], [0], [t], [1]) for t in quiet]
    shifted = events.shifted(int(start_s * 1e9))
    parts += [shifted[a:b] for a, b in pairwise(bounds) if b > a]
    out = []
    for seq, part in enumerate(parts):
        device = 5_000_000_000 + np.rint(part.t_ns / 1000 / (1 + 50e-6)).astype(np.int64) * 1000
        arrival = EPOCH_NS + int(part.t_ns[0]) + round(rng.exponential(200_000))
        base = int(device[0])
        payload = encode("libcaer_cmp", part.with_times(device), base)
        out.append(stream.push("libcaer_cmp", WIDTH, HEIGHT, seq, arrival, base, payload))
    found = EventArray.concatenate(out[len(quiet) :])
    begin = EPOCH_NS + int(start_s * 1e9)
    assert np.abs(np.sort(found.t_ns) - events.t_ns - begin).max() < 100_000
    points = world.points_of(world.run(method, found, world.poses(start_ns=begin)))
    world.assert_right(points)
    lines = world.line_positions()
    beside = np.abs(points[:, :1] - lines).min(axis=1)
    # 100 µs of rolling, half a pixel to the edge that an event marks, half to the pixel's middle.
    one_px = world.MIDDLE_M / world.CAMERA.fx
    assert np.median(beside) < 100e-6 * SPEED_M_S + one_px


@pytest.mark.parametrize("method", ALL)
def test_poses_may_jitter(events: EventArray, method: str) -> None:
    """30 µs in time and 5 µm in place are a fifth of a pixel."""
    rng, track = np.random.default_rng(0), PoseTrack()
    for k in range(16):
        stamp = 8 * MS * k + (round(rng.normal(0, 30_000)) if k else 0)
        place = [SPEED_M_S * 0.008 * k, 0.0, 0.0] + rng.normal(0, 5e-6, 3)
        track.append(stamp, place, world.UPRIGHT)
    world.assert_right(world.points_of(world.run(method, events, track)), typical_px=0.7)


@pytest.mark.parametrize("method", METHODS)
def test_a_gap_in_the_poses_costs_its_own_windows_alone(events: EventArray, method: str) -> None:
    """For the surface see test_surface_sweep: a gap ends its pass."""
    full = world.poses(max_gap_s=0.01)
    whole = world.run(method, events, full, window={"rule": "time"})
    # The second window is that from 33 to 67 ms.
    found = world.run(method, events, without(full, 41, 63), window={"rule": "time"})
    assert len(found) == len(whole) == 3
    refusals = world.refused_of(found[:2])
    assert len(refusals) == 1
    assert isinstance(refusals[0].fault, PoseGapError)
    np.testing.assert_array_equal(world.points_of(found[:1]), world.points_of(whole[:1]))
    np.testing.assert_array_equal(world.points_of(found[2:]), world.points_of(whole[2:]))
    assert len(world.points_of(found)) > 100


@pytest.mark.parametrize("method", METHODS)
def test_after_a_gap_windows_by_travel_restart(events: EventArray, method: str) -> None:
    track = without(world.poses(max_gap_s=0.01), 41, 63)
    found = world.run(method, events, track, window={"rule": "travel"})
    assert sum(isinstance(r.fault, PoseGapError) for r in world.refused_of(found)) >= 1
    maps = world.maps_of(found)
    assert [m.start_ns < 40 * MS for m in maps] == [True, False]
    world.assert_right(world.points_of(found), typical_px=0.7)


@pytest.mark.parametrize("method", ALL)
def test_read_out_in_frames_of_200_us(events: EventArray, method: str) -> None:
    """At 0.3 m/s 200 µs are a pixel: that smears evenly at all depths and doesn't bias."""
    framed = events.with_times(events.t_ns // 200_000 * 200_000)
    world.assert_right(world.points_of(world.run(method, framed, world.poses())), typical_px=0.7)


def frozen(strays: int) -> EventArray:
    """A window of edges that all have one time stamp, but for a few strays, and a last event."""
    rng = np.random.default_rng(1)
    x = rng.choice(np.arange(9, WIDTH, 23), 20_000)
    t = np.full(len(x), 16 * MS)
    t[:strays] = np.linspace(0, 32 * MS, strays).astype(np.int64)
    t[-1] = 95 * MS
    y = rng.integers(0, HEIGHT, len(x))
    return EventArray.from_arrays(x, y, t, np.ones(len(x))).sorted_by_time()


@pytest.mark.parametrize(
    ("method", "strays"), [*((method, 0) for method in METHODS), *((method, 20) for method in ALL)]
)
def test_events_of_one_time_have_no_parallax(method: str, strays: int) -> None:
    """The camera moved, but what it saw is from one place: no depth, however far poses reach.

    Nor where one event in a thousand is from elsewhere: parallax is what most events have.
    """
    assert not len(world.points_of(world.run(method, frozen(strays), world.poses())))

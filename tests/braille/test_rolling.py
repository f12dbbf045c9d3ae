"""Passes and batches from poses and events alone."""

from itertools import pairwise

import numpy as np
import pytest

from braille.synthetic import DOWN, START_NS, roll_track
from roller_braille.batches import Batch, BatchCutter, PassEnd
from roller_braille.reader_settings import BrailleSettings
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack


def clockwork(track: PoseTrack, rate_hz: float = 100_000.0) -> EventArray:
    """Events at even times, from the first pose to the last."""
    t = np.arange(track.start_ns, track.end_ns, round(1e9 / rate_hz))
    zero = np.zeros(len(t))
    return EventArray.from_arrays(zero, zero, t, zero)


def cut(track: PoseTrack, events: EventArray, **settings: object) -> list[Batch | PassEnd]:
    cutter = BatchCutter(BrailleSettings.create(settings), track)
    cutter.add(events)
    out = []
    while (item := cutter.cut(flush=True)) is not None:
        out.append(item)
    assert cutter.held_events == 0
    taken = sum(len(b.events) for b in out if isinstance(b, Batch))
    assert taken + cutter.still_events + cutter.events_without_pose == len(events)
    return out


def directions(items: list[Batch | PassEnd]) -> list[int]:
    return [i.roll.direction for i in items if isinstance(i, PassEnd)]


def test_batches_end_by_events_or_travel(monkeypatch: pytest.MonkeyPatch) -> None:
    track = roll_track([0.0, 0.1], [0.0, 1.0])
    by_travel = [b for b in cut(track, clockwork(track)) if isinstance(b, Batch)]
    assert all(len(b.events) < 20_000 for b in by_travel)
    # 1.5 mm, up to the next of the poses that come every 0.8 mm.
    assert len(by_travel) == pytest.approx(0.1 / 0.0016, abs=1)
    monkeypatch.setattr("roller_braille.batches._MOST_EVENTS", 1000)
    by_events = [b for b in cut(track, clockwork(track)) if isinstance(b, Batch)]
    assert {len(b.events) for b in by_events[:10]} <= {1000, *range(1, 1000)}
    assert max(len(b.events) for b in by_events) == 1000
    for one, two in pairwise(by_events):
        assert one.end_ns == two.start_ns
        if len(one.events) and len(two.events):
            assert one.events.t_ns[-1] <= two.events.t_ns[0]


def test_a_batch_ends_where_events_were_left_out() -> None:
    track = roll_track([0.0, 0.1], [0.0, 1.0])
    events = clockwork(track)
    first, last = 30_123, 41_877
    cutter = BatchCutter(BrailleSettings.create({}), track)
    cutter.add(events[:first])
    cutter.leave_gap()
    cutter.add(events[last:])
    batches = [b for b in iter(lambda: cutter.cut(flush=True), None) if isinstance(b, Batch)]
    before, after = events.t_ns[first - 1], events.t_ns[last]
    assert not [b for b in batches if b.start_ns <= before and b.end_ns > before + 1]
    assert not [b for b in batches if before < b.start_ns < after]
    assert sum(len(b.events) for b in batches) == len(events) - (last - first)
    assert {before + 1, after} <= {b.end_ns for b in batches} | {b.start_ns for b in batches}


def test_events_of_a_standstill_that_come_after_its_poses_belong_to_no_batch() -> None:
    """As of a bag, whose poses are all there before the first event comes."""
    track = roll_track([0.0, 0.0, 0.1], [0.0, 0.5, 1.5])
    events = clockwork(track)
    cutter = BatchCutter(BrailleSettings.create({}), track)
    batches: list[Batch] = []
    for first in range(0, len(events), 5000):
        cutter.add(events[first : first + 5000])
        batches += [b for b in iter(cutter.cut, None) if isinstance(b, Batch)]
    assert len(batches) > 30
    for batch in batches:
        assert len(batch.events)
        assert batch.start_ns <= batch.events.t_ns[0]
        assert batch.events.t_ns[-1] < batch.end_ns
    assert cutter.still_events == pytest.approx(50_000, rel=0.02)


def test_turning_back_begins_a_new_pass() -> None:
    track = roll_track([0.0, 0.05, 0.0], [0.0, 0.5, 1.0])
    assert directions(cut(track, clockwork(track))) == [1, -1]


def test_a_short_halt_does_not_end_a_pass_a_long_one_does() -> None:
    short = roll_track([0.0, 0.03, 0.03, 0.06], [0.0, 0.3, 0.8, 1.1])
    assert directions(cut(short, clockwork(short))) == [1]
    long = roll_track([0.0, 0.03, 0.03, 0.06], [0.0, 0.3, 1.8, 2.1])
    assert directions(cut(long, clockwork(long))) == [1, 1]


def test_a_sensor_that_trembles_does_not_roll() -> None:
    rng = np.random.default_rng(1)
    track = PoseTrack()
    for k in range(2000):
        noise = rng.normal(0, 3e-6, 3)
        track.append(START_NS + k * 1_000_000, noise, [1.0, 0.0, 0.0, 0.0])
    assert cut(track, clockwork(track)) == []


def test_moving_across_or_turning_is_not_rolling() -> None:
    track = PoseTrack()
    for k in range(100):
        track.append(START_NS + k * 8_000_000, [0.0, 0.001 * k, 0.0], [1.0, 0.0, 0.0, 0.0])
    assert cut(track, clockwork(track)) == []


def test_a_gap_in_the_poses_ends_the_pass() -> None:
    full = roll_track([0.0, 0.1], [0.0, 1.0])
    track = PoseTrack()
    for k in (*range(50), *range(75, len(full))):
        track.append(int(full.times_ns[k]), full.positions[k], full.quaternions[k])
    items = cut(track, clockwork(full))
    assert directions(items) == [1, 1]
    cutter = BatchCutter(BrailleSettings.create({}), track)
    cutter.add(clockwork(full))
    while cutter.cut(flush=True) is not None:
        pass
    assert cutter.events_without_pose == pytest.approx(0.2 * 100_000, rel=0.1)


def test_waiting_events_are_bounded() -> None:
    cutter = BatchCutter(BrailleSettings.create({"max_waiting_mb": 0.16}), PoseTrack())
    track = roll_track([0.0, 0.1], [0.0, 1.0])
    events = clockwork(track)
    for a in range(0, 50_000, 1000):
        cutter.add(events[a : a + 1000])
    assert cutter.held_events == 10_000
    assert cutter.dropped_events == 40_000
    assert cutter.cut() is None


def test_axes_are_those_of_the_camera_where_the_pass_begins() -> None:
    track = roll_track([0.0, 0.05], [0.0, 0.5])
    first = next(b for b in cut(track, clockwork(track)) if isinstance(b, Batch))
    np.testing.assert_allclose(first.roll.rotation, DOWN, atol=1e-12)
    np.testing.assert_allclose(first.roll.origin, track.positions[0])

"""The sweep in the surface's frame on analytic scenes: right heights, or none."""

import numpy as np
import pytest

from emvs.scenes import (
    CAMERA,
    MS,
    Motion,
    events_of,
    lines,
    rolling,
    tilted,
    tilted_scan,
    track_of,
    waking,
    without,
)
from roller_core.camera import Camera
from roller_core.dead_time import DeadTime
from roller_core.errors import SettingsError
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.transforms import rotation_vector_to_quaternion
from roller_emvs.evidence.field import Box, Mask
from roller_emvs.lines import refine
from roller_emvs.methods.surface import SurfacePatch, SurfaceSettings, SurfaceSweep
from roller_emvs.methods.surface.blocks import Block, BlockCutter
from roller_emvs.methods.surface.event_store import EventStore
from roller_emvs.methods.surface.narrow import narrowed
from roller_emvs.methods.surface.part_field import PartField, fits
from roller_emvs.methods.surface.strip import Strip
from roller_emvs.windows import RefusedWindow
from simulated_scans import Scans

DURATION_S = 0.12
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
VALUES = {"min_aperture_m": 0.013, "threads": 1}


def settings(**values: object) -> SurfaceSettings:
    return SurfaceSettings.create({**VALUES, **values})


def sweep(
    events: EventArray, track: PoseTrack, camera: Camera = CAMERA, **values: object
) -> tuple[list[SurfacePatch], list[RefusedWindow], SurfaceSweep]:
    engine = SurfaceSweep(settings(**values), camera, track)
    engine.add_events(events)
    found = list(engine.results(flush=True))
    patches = [f for f in found if isinstance(f, SurfacePatch)]
    return patches, [f for f in found if isinstance(f, RefusedWindow)], engine


def points_of(patches: list[SurfacePatch]) -> np.ndarray:
    return np.concatenate([p.points for p in patches]) if patches else np.empty((0, 3))


@pytest.fixture(scope="module")
def scan() -> EventArray:
    return tilted_scan(DURATION_S)


def test_a_tilted_plane_is_found(scan: EventArray) -> None:
    patches, _, engine = sweep(scan, track_of(rolling(0.3), DURATION_S))
    points = points_of(patches)
    assert len(points) > 2000
    errors = points[:, 2] - tilted(points[:, 0])
    # One pixel of parallax is 0.14 mm with this camera and view.
    assert np.median(np.abs(errors)) < 70e-6
    assert abs(np.median(errors)) < 70e-6
    assert np.abs(errors).max() < 300e-6
    assert engine.counts.points == len(points)
    assert engine.held_events == 0
    for patch in patches:
        assert len(patch.confidence) == len(patch.height) == len(patch)
        assert (patch.confidence >= 0).all()
        assert (patch.confidence <= 1).all()
        assert patch.start_ns < patch.end_ns
    # Each row once: blocks don't overlap along the roll.
    starts = [p.points[:, 0].min() for p in patches if len(p)]
    ends = [p.points[:, 0].max() for p in patches if len(p)]
    assert all(a <= b + 1e-9 for a, b in zip(ends, starts[1:], strict=False))


def test_what_pixels_tell_when_they_wake_up_is_no_edge(scan: EventArray) -> None:
    events = waking(scan, MS)
    patches, _, engine = sweep(events, track_of(rolling(0.3), DURATION_S))
    points = points_of(patches)
    edges = np.unique(lines(tilted)[:, 0])
    away = np.abs(points[:, 0, None] - edges).min(axis=1)
    assert len(points) > 1000
    # They lie 0.3 mm behind.
    assert np.mean(away < 1e-4) > 0.98
    assert engine.counts.dead_time_events > 0.4 * len(events)


def test_a_pass_waits_until_it_is_known_how_long_pixels_are_blind(scan: EventArray) -> None:
    """Its first events are looked at like all others."""
    events, track = waking(scan, MS), track_of(rolling(0.3), DURATION_S)
    few = events[events.x % 16 == 0]
    _, _, engine = sweep(few, track)
    informed = DeadTime(CAMERA.width, CAMERA.height)
    informed.measure(few)
    informed.without_followers(few, 0.3)
    assert engine.counts.dead_time_events == pytest.approx(informed.left_out, rel=0.01)
    # Where none is known after the first view's length nothing waits any longer.
    some = few[::20]
    engine = SurfaceSweep(settings(), CAMERA, track)
    engine.add_events(some)
    assert list(engine.results())
    assert engine.held_events < len(some)


def test_where_pixels_were_blind_light_isn_t_known_to_stand_still(scan: EventArray) -> None:
    """One event a wall doesn't get denser; a pixel that isn't blind for long tells more."""
    track = track_of(rolling(0.3), DURATION_S)
    blind, seeing = (sweep(waking(scan, ns), track)[0] for ns in (MS, MS // 2))
    assert min(np.concatenate([patch.sigma for patch in blind])) > 1.2e-4
    assert np.median(np.concatenate([patch.sigma for patch in seeing])) < 1e-4


def test_points_are_less_sure_where_pixels_were_blind(
    scan: EventArray, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a share of the travel meanwhile, 0.3 mm, on the least slope of a line."""
    events, track = waking(scan, MS), track_of(rolling(0.3), DURATION_S)
    less, _, engine = sweep(events, track)
    dead_time = engine._cutter.dead_time
    assert dead_time is not None
    assert dead_time.blind_m == pytest.approx(3e-4, rel=0.05)
    monkeypatch.setattr(refine, "_WAKES", 0.0)
    plain = sweep(events, track)[0]
    np.testing.assert_array_equal(points_of(less), points_of(plain))
    after, before = (np.concatenate([p.sigma for p in own]) for own in (less, plain))
    added = np.sqrt(after**2 - before**2)
    # Where no lines are near, sigma is of the neighbourhoods' own and larger.
    assert (added > 0).sum() > 500
    np.testing.assert_allclose(added[added > 0], 0.15 * 3e-4 * 0.6, rtol=0.05)


def test_a_pass_that_ends_where_events_were_left_out_is_counted(scan: EventArray) -> None:
    engine = SurfaceSweep(settings(), CAMERA, track_of(rolling(0.3), DURATION_S))
    for part in (scan[: len(scan) // 2], scan[len(scan) // 2 + 5000 :]):
        engine.add_events(part)
        engine.leave_gap()
    assert list(engine.results(flush=True))
    assert engine.counts.broken_passes == 1


def test_poses_that_are_no_longer_needed_may_go(scan: EventArray) -> None:
    batch_ms = 17
    whole = points_of(sweep(scan, track_of(rolling(0.3), DURATION_S))[0])
    track = PoseTrack()
    engine = SurfaceSweep(settings(), CAMERA, track)
    full = track_of(rolling(0.3), DURATION_S)
    parts: list[SurfacePatch] = []
    early = 0
    for start in range(0, int(DURATION_S * 1e3) + 40, batch_ms):
        end_ns = (start + batch_ms) * MS
        for t, p, q in zip(full.times_ns, full.positions, full.quaternions, strict=True):
            # Poses come late.
            if start * MS <= t + 20 * MS < end_ns:
                track.append(int(t), p, q)
        a, b = np.searchsorted(scan.t_ns, [start * MS, end_ns])
        engine.add_events(scan[a:b])
        parts += [f for f in engine.results() if isinstance(f, SurfacePatch)]
        if len(track) and engine.needed_from_ns is not None:
            track.discard_before(engine.needed_from_ns)
        early = len(parts)
    parts += [f for f in engine.results(flush=True) if isinstance(f, SurfacePatch)]
    assert 0 < early < len(parts)
    np.testing.assert_array_equal(points_of(parts), whole)


def test_threads_change_nothing(scan: EventArray) -> None:
    track = track_of(rolling(0.3), DURATION_S)
    one, two = (points_of(sweep(scan, track, threads=n)[0]) for n in (1, 2))
    np.testing.assert_array_equal(one, two)


def test_a_gap_in_poses_ends_the_pass(scan: EventArray) -> None:
    track = without(track_of(rolling(0.3), DURATION_S), 50, 75)
    track.max_gap_s = 0.01
    patches, refused, engine = sweep(scan, track)
    faults = [r for r in refused if r.fault is not None]
    assert len(faults) == 1
    assert "gap" in faults[0].reason
    assert engine.counts.events_without_pose == faults[0].events
    points = points_of(patches)
    assert np.median(np.abs(points[:, 2] - tilted(points[:, 0]))) < 70e-6


def test_a_stop_in_a_pass_adds_nothing(scan: EventArray) -> None:
    def motion(t: float) -> tuple[np.ndarray, np.ndarray]:
        return np.array([0.3 * (t if t < 0.064 else max(0.064, t - 0.5)), 0, 0]), UPRIGHT

    later = np.where(scan.t_ns < 64 * MS, scan.t_ns, scan.t_ns + 500 * MS)
    hot = np.arange(80, 540) * MS
    noise = EventArray.from_arrays(hot * 0 + 160, hot * 0 + 60, hot, hot * 0)
    events = EventArray.concatenate([scan.with_times(later), noise]).sorted_by_time()
    patches, _, engine = sweep(events, track_of(motion, DURATION_S + 0.5))
    assert engine.counts.still_events >= len(noise)
    points = points_of(patches)
    assert np.median(np.abs(points[:, 2] - tilted(points[:, 0]))) < 70e-6


def test_a_pass_is_over_when_the_sensor_stands_though_noise_goes_on(scan: EventArray) -> None:
    def motion(t: float) -> tuple[np.ndarray, np.ndarray]:
        return np.array([0.3 * min(t, DURATION_S), 0, 0]), UPRIGHT

    hot = np.arange(round(DURATION_S * 1e3), 6000) * MS
    noise = EventArray.from_arrays(hot * 0 + 160, hot * 0 + 60, hot, hot * 0)
    track = track_of(motion, 6.1)
    engine = SurfaceSweep(settings(), CAMERA, track)
    engine.add_events(EventArray.concatenate([scan, noise]))
    found = list(engine.results())
    assert engine.at_rest
    # Nothing is refused for the standstill; what the sweep holds is of the newest moments.
    whole, refused, _ = sweep(scan, track_of(motion, DURATION_S))
    patches = [f for f in found if isinstance(f, SurfacePatch)]
    assert len(found) - len(patches) == len(refused)
    assert len(points_of(patches)) == pytest.approx(len(points_of(whole)), rel=0.02)
    assert engine.counts.still_events > 3000
    assert engine.held_events < 2100


def test_a_backlog_is_dropped_and_counted(scan: EventArray) -> None:
    engine = SurfaceSweep(settings(max_waiting_mb=0.16), CAMERA, PoseTrack())
    for k in range(0, len(scan), 2000):
        engine.add_events(scan[k : k + 2000])
        assert not list(engine.results())
    assert engine.held_events <= 10_000
    assert engine.counts.dropped_events + engine.held_events == len(scan)


def test_rays_held_are_bounded_too(scan: EventArray) -> None:
    track = track_of(rolling(0.3), DURATION_S)
    _, _, engine = sweep(scan, track, max_waiting_mb=0.16)
    assert engine.counts.dropped_events > 0


def test_stairs_of_the_virtual_cell(scans: Scans) -> None:
    scan = scans.scan("stairs", speed=0.3, camera={"height": 120}, scene={"step_mm": 0.04})
    engine = SurfaceSweep(SurfaceSettings.create({}), scan.camera, scan.track)
    engine.add_events(scan.events)
    points = points_of([f for f in engine.results(flush=True) if isinstance(f, SurfacePatch)])
    truth, region = scan.truth, scan.truth.objects["stairs"]
    # Events are later than what caused them.
    x, y = points[:, 0] - 0.3 * truth.event_delay_ns * 1e-9, points[:, 1]
    on = (x > region.x0) & (x < region.x1) & (y > region.y0) & (y < region.y1)
    errors = np.abs(points[:, 2] - truth.height_at(x, y))[on]
    assert on.sum() > 6000
    assert np.mean(errors) < 70e-6
    assert np.median(errors) < 65e-6
    assert np.quantile(errors, 0.99) < 300e-6


def tilted_by(turn: list[float]) -> Motion:
    """Rolling with the camera turned by a rotation vector."""
    quaternion = rotation_vector_to_quaternion(turn)
    return lambda t: (np.array([0.3 * t, 0.0, 0.0]), quaternion)


def turned_while_rolling(t: float) -> tuple[np.ndarray, np.ndarray]:
    """A fifth of a radian in all, about an axis between the camera's."""
    turn = np.array([0.3, -0.5, 1.6]) * (t - 0.06)
    return np.array([0.3 * t, 0.0, 0.0]), rotation_vector_to_quaternion(turn)


def bent(sag_m: float) -> Motion:
    """A path that leaves its line by so much over the 36 mm."""

    def motion(t: float) -> tuple[np.ndarray, np.ndarray]:
        return np.array([0.3 * t, sag_m * (0.3 * t / 0.036) ** 2, 0.0]), UPRIGHT

    return motion


TALL = Camera(120, 320, 800.0, 800.0, 59.5, 159.5)


@pytest.mark.parametrize(
    ("motion", "camera", "straight"),
    [
        pytest.param(tilted_by([0.08, 0.1, 0.4]), CAMERA, {True}, id="hand-eye tilted"),
        pytest.param(tilted_by([0.0, 0.0, np.pi / 2]), TALL, {True}, id="along columns"),
        pytest.param(turned_while_rolling, CAMERA, {True}, id="turning"),
        # Rays of a row may part by half a pixel: the path may leave its line by 0.63 mm in view.
        pytest.param(bent(0.001), CAMERA, {True}, id="bent within the bound"),
        pytest.param(bent(0.005), CAMERA, {True, False}, id="bent beyond it"),
    ],
)
def test_heights_are_right_however_the_camera_goes(
    motion: Motion, camera: Camera, straight: set[bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    used = set()

    def watched(strip: Strip, block: Block) -> bool:
        used.add(fits(strip, block))
        return fits(strip, block)

    monkeypatch.setattr("roller_emvs.methods.surface.sweep.fits", watched)
    events = events_of(lines(tilted), motion, DURATION_S, camera=camera)
    patches, _, _ = sweep(events, track_of(motion, DURATION_S), camera)
    points = points_of(patches)
    assert used == straight
    assert len(points) > 1000
    errors = points[:, 2] - tilted(points[:, 0])
    assert np.median(np.abs(errors)) < 70e-6
    assert np.quantile(np.abs(errors), 0.98) < 300e-6


def test_both_ways_find_the_same(scan: EventArray, monkeypatch: pytest.MonkeyPatch) -> None:
    track = track_of(rolling(0.3), DURATION_S)
    by_parts = points_of(sweep(scan, track)[0])
    monkeypatch.setattr("roller_emvs.methods.surface.sweep.fits", lambda *_: False)
    by_rays = points_of(sweep(scan, track)[0])
    assert len(by_parts) > 0.9 * len(by_rays) > 1000
    errors = [np.median(np.abs(p[:, 2] - tilted(p[:, 0]))) for p in (by_parts, by_rays)]
    assert errors[0] < errors[1] + 5e-6


def test_what_holds_no_depth_is_cut_off(scan: EventArray, monkeypatch: pytest.MonkeyPatch) -> None:
    track = track_of(rolling(0.3), DURATION_S)
    # Beside what is seen in a part of the view, a few events of noise.
    noise = np.random.default_rng(1).random(len(scan)) < 2e-4
    part, boxes, cut = scan[(scan.y < 0.3 * CAMERA.height) | noise], [], PartField.cut_around

    def watched(field: PartField, cells: Mask, reach: int) -> tuple[PartField, Box] | None:
        found = cut(field, cells, reach)
        boxes.extend([] if found is None else [found[1]])
        return found

    monkeypatch.setattr(PartField, "cut_around", watched)
    found = points_of(sweep(part, track)[0])
    assert len(boxes) > 5
    monkeypatch.setattr("roller_emvs.evidence.field._MOST_CUT", 0.0)
    whole = points_of(sweep(part, track)[0])
    assert len(whole) > 200
    np.testing.assert_allclose(found, whole, atol=3e-7)


def test_what_holds_no_evidence_is_left_out_of_a_block(
    scan: EventArray, monkeypatch: pytest.MonkeyPatch
) -> None:
    name, calls = "roller_emvs.methods.surface.sweep.narrowed", []
    track = track_of(rolling(0.3), DURATION_S)

    def watched(
        block: Block, field: PartField, near: np.ndarray, pixel_m: float
    ) -> tuple[Block, PartField, np.ndarray]:
        found = narrowed(block, field, near, pixel_m)
        calls.append((block, field, near, *found))
        return found

    noise = np.random.default_rng(1).random(len(scan)) < 2e-5
    part = scan[(scan.y < 0.3 * CAMERA.height) | noise]
    monkeypatch.setattr(name, watched)
    found = points_of(sweep(part, track, block_m=0.03)[0])
    cut = [call for call in calls if call[4] is not call[1]]
    assert cut
    for block, field, near, narrow, kept, offset in cut:
        assert offset.shape == kept.cells
        assert offset.size < near.size
        assert np.isfinite(offset).sum() == np.isfinite(near).sum()
        assert block.start_m <= narrow.start_m < narrow.end_m <= block.end_m
        assert narrow.low_y_m >= block.low_y_m
        assert kept.aperture == field.aperture
    # As if it had been looked at.
    monkeypatch.setattr(name, lambda block, field, near, _: (block, field, near))
    whole = points_of(sweep(part, track, block_m=0.03)[0])
    assert len(whole) > 200
    np.testing.assert_allclose(found, whole, atol=1e-7)
    # Of what holds nothing something small is left.
    block, field, near = calls[0][:3]
    narrow, kept, _ = narrowed(block, field, np.full_like(near, np.nan), field.ray_slope_scale)
    assert max(kept.cells) < 40
    assert narrow.start_m < narrow.end_m


def store_of(counts: dict[int, int], length_m: float) -> EventStore:
    """A store that says how many events each length holds."""

    class Store:
        blocks = tuple(counts)
        span = staticmethod(lambda k: (0.0, length_m, 0.0, 0.01))
        times = staticmethod(lambda k: (k, k + 1))
        count = staticmethod(lambda k: counts.get(k, 0))

    return Store()  # type: ignore[return-value]


def test_lengths_with_few_events_are_one_block_and_wait_for_each_other() -> None:
    counts, length = {0: 5, 1: 5, 2: 9000, 3: 10, 4: 10, 5: 10, 6: 10}, 0.008
    cutter = BlockCutter(store_of(counts, length), length, 2)

    def lengths(behind: float) -> list[tuple[int, int, int]]:
        found = cutter.ready(behind * length, 0.1)
        return [(block.number, block.end, block.events) for block in found]

    assert lengths(2.5) == [(-1, 2, 10)]
    # The next is full of events, and the one after waits for what it may be joined with.
    assert lengths(4.5) == [(2, 3, 9000)]
    assert lengths(4.5) == []
    assert lengths(5.5) == []
    assert lengths(6.5) == [(3, 6, 30)]
    found = cutter.ready(6.5 * length, 0.1, flush=True)
    assert [(block.number, block.end, block.events) for block in found] == [(6, 8, 10)]
    assert found[0].sources == (5, 6)
    assert (found[0].start_m, found[0].end_m) == (6 * length, 8 * length)
    assert (found[0].first_ns, found[0].last_ns) == (6, 7)


@pytest.mark.parametrize(
    ("speed", "counts", "begins"),
    [
        (0.2, [30_000, 90_000, 200_000, 900_000], [0, 1, 2, 3]),
        (0.5, [30_000, 90_000, 200_000, 300_000], [0, 3]),
        (0.5, [30_000, 90_000, 300_000, 300_000], [0, 3]),
        (0.5, [30_000, 400_000, 200_000, 300_000], [0, 2, 3]),
        # The end of what lies on the plate goes with it, but not a bare plate with what is on it.
        (0.5, [30_000, 90_000, 200_000, 3000], [0]),
        (0.5, [30_000, 900_000, 3000, 3000, 3000], [0, 4]),
        (0.5, [300, 100, 200, 3000], [0, 3]),
    ],
)
def test_a_fast_sensor_joins_lengths_with_more_events(
    speed: float, counts: list[int], begins: list[int]
) -> None:
    length = 0.008
    cutter = BlockCutter(store_of(dict(enumerate(counts)), length), length, 480)
    cutter._done = -1
    found = cutter.ready(4.5 * length, speed, flush=True)
    assert [block.number for block in found if block.events] == begins


def test_a_block_waits_for_a_length_with_few_events_so_far() -> None:
    counts, length = {0: 30_000, 1: 400_000, 2: 5000, 3: 9000}, 0.008
    cutter = BlockCutter(store_of(counts, length), length, 480)
    cutter._done = -1
    assert cutter.ready(2.5 * length, 0.5) == []
    counts[2] = 9000
    assert [(block.number, block.end) for block in cutter.ready(3.5 * length, 0.5)] == [(0, 2)]


def test_settings_are_checked() -> None:
    with pytest.raises(SettingsError, match="depth_min_m"):
        settings(depth_min_m=0.05)

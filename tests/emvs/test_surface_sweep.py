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
    without,
)
from emvs.sweeps import DURATION_S, points_of, settings, sweep
from roller_core.camera import Camera
from roller_core.errors import SettingsError
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.transforms import rotation_vector_to_quaternion
from roller_emvs.evidence.field import Box, Mask
from roller_emvs.methods.surface import SurfacePatch, SurfaceSettings, SurfaceSweep
from roller_emvs.methods.surface.blocks import Block
from roller_emvs.methods.surface.narrow import narrowed
from roller_emvs.methods.surface.part_field import PartField, fits
from roller_emvs.methods.surface.strip import Strip
from simulated_scans import Scans

UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
TALL = Camera(120, 320, 800.0, 800.0, 59.5, 159.5)


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
    counts = engine.counts
    assert counts.events_without_pose == faults[0].events
    told = counts.events + counts.events_without_pose + counts.ramp_events + counts.still_events
    assert told == len(scan)  # each once
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


def test_settings_are_checked() -> None:
    with pytest.raises(SettingsError, match="depth_min_m"):
        settings(depth_min_m=0.05)

"""What no scan holds, and a library's user may give: refused, or nothing; no kernel goes astray."""

import numpy as np
import pytest

from emvs.scenes import CAMERA, MS, events_of, lines, rolling, tilted, tilted_scan, track_of
from roller_core.camera import Camera
from roller_core.dead_time import DeadTime
from roller_core.errors import SettingsError
from roller_core.events import EventArray, EventArrayError
from roller_core.hot_pixels import count_events
from roller_core.pose_track import PoseTrack
from roller_core.stage import ERROR
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.depth_stage import DepthStage, EmvsParameters
from roller_emvs.image_speed import ImageSpeed
from roller_emvs.methods.paper import _vote_kernels as kernels
from roller_emvs.methods.paper.votes import sweep_maximum
from roller_emvs.methods.surface import SurfaceSettings, SurfaceSweep
from roller_emvs.methods.surface.strip import Strip
from roller_emvs.pipeline import DepthPipeline
from roller_emvs.rays import RayBundle
from roller_emvs.windows import RefusedWindow

OUTSIDE = EventArray.from_arrays([CAMERA.width], [0], [0], [1])


def test_events_outside_the_image_are_counted_nowhere() -> None:
    with pytest.raises(EventArrayError, match="lies outside the image"):
        DeadTime(CAMERA.width, CAMERA.height).measure(OUTSIDE)
    with pytest.raises(EventArrayError, match="lies outside the image"):
        count_events(OUTSIDE, np.zeros((CAMERA.height, CAMERA.width), np.float32))


def test_an_image_of_poses_that_jump_is_not_made() -> None:
    events, track = events_of(lines(tilted), rolling(0.3), 0.1), PoseTrack()
    for k in range(16):
        jumped_m = 1e4 if k > 6 else 0.0
        track.append(k * 8 * MS, [jumped_m + 0.0024 * k, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
    assert ImageSpeed(CAMERA, track, 0.043, 0.047).share(events) is None


def test_a_camera_of_one_column_has_no_votes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A vote is shared by two columns: the last of all would be written beyond the end."""

    def reached(*_: object) -> None:
        raise AssertionError("the kernel was reached")

    monkeypatch.setattr(kernels, "_sweep_bands", reached)
    rays = np.zeros((10, 4), np.float32)
    votes, _ = sweep_maximum(
        RayBundle(rays, np.full(10, np.inf, np.float32)),
        Camera(1, 16, 100.0, 100.0, 0.0, 8.0), np.array([0.04, 0.05]),
    )  # fmt: skip
    assert not votes.any()


@pytest.mark.parametrize(("near_m", "far_m"), [(1e-6, 0.047), (1e-6, 5e-6), (1e-5, 0.047)])
def test_a_depth_so_near_that_nothing_is_in_view_is_refused(near_m: float, far_m: float) -> None:
    depths = {"depth_min_m": near_m, "depth_max_m": far_m}
    said = f"'depth_min_m' = {near_m:g}: the camera's view there is .* µm wide"
    with pytest.raises(SettingsError, match=said):
        DepthPipeline(DepthSettings.create(depths), CAMERA, PoseTrack())
    if far_m < 6 * near_m:
        with pytest.raises(SettingsError, match=said):
            SurfaceSweep(SurfaceSettings.create(depths), CAMERA, PoseTrack())
    stage = DepthStage(EmvsParameters.create(depths))
    with pytest.raises(SettingsError, match=said):
        stage.take_camera(CAMERA)
    stage.take_camera(CAMERA)  # said once
    level, text = stage.health()
    assert level == ERROR
    assert text.startswith(f"'depth_min_m' = {near_m:g}")
    DepthPipeline(DepthSettings.create({"depth_min_m": 1e-4}), CAMERA, PoseTrack())


def test_depths_of_millimetres_given_as_metres_are_refused() -> None:
    """Of 20 to 100 m there were twenty thousand blocks, each of all events."""
    settings = SurfaceSettings.create({"depth_min_m": 43.0, "depth_max_m": 47.0})
    with pytest.raises(SettingsError, match=r"'depth_min_m' = 43: a pixel is .* in metres"):
        SurfaceSweep(settings, CAMERA, PoseTrack())
    SurfaceSweep(settings.changed({"block_m": 0.1}), CAMERA, PoseTrack())


def test_windows_whose_poses_are_too_coarse_for_the_depth_range_say_so() -> None:
    """Their events were left out as of ramps, and nothing told of the windows."""
    path, events, rng = track_of(rolling(0.3), 0.12), tilted_scan(0.12), np.random.default_rng(0)
    track = PoseTrack()
    places = path.positions + rng.normal(0, 2e-5, path.positions.shape)
    track.extend(path.times_ns, places, path.quaternions)
    for near_m, refused in ((1e-3, True), (0.043, False)):
        pipeline = DepthPipeline(DepthSettings.create({"depth_min_m": near_m}), CAMERA, track)
        pipeline.add_events(events)
        found = list(pipeline.results(flush=True))
        reasons = [w.reason for w in found if isinstance(w, RefusedWindow)]
        assert any("a pixel at depth_min_m = 0.001 is 1.2 µm" in r for r in reasons) == refused


def test_poses_seconds_apart_place_events_as_closer_ones_do() -> None:
    """Beyond 2.1 s a time since a pose doesn't fit 32 bits."""
    rays = np.stack(
        np.meshgrid(
            (np.arange(CAMERA.width) - CAMERA.cx) / CAMERA.fx,
            (np.arange(CAMERA.height) - CAMERA.cy) / CAMERA.fy,
        ),
        axis=2,
    ).astype(np.float32)
    rng, n, speed_m_s = np.random.default_rng(4), 4000, 0.002
    t_ns = np.sort(rng.integers(0, 8_000_000_000, n))
    events = EventArray.from_arrays(
        rng.integers(0, CAMERA.width, n), rng.integers(0, CAMERA.height, n), t_ns, np.ones(n)
    )
    track = track_of(rolling(speed_m_s), 0.01)
    first = track.matrices([0])[0]

    def placed(step_ns: int) -> list[np.ndarray]:
        motion = np.array([1.0, 0.0, 0.0])
        strip = Strip(SurfaceSettings.create({}), CAMERA, rays, 0, first, motion)
        for t0 in range(0, 8_000_000_000, step_ns):
            ends = []
            for t in (t0, t0 + step_ns):
                pose = first.copy()
                pose[0, 3] += speed_m_s * t * 1e-9
                ends.append(strip.to_strip(pose))
            a, b = np.searchsorted(t_ns, (t0, t0 + step_ns))
            strip.add(events[a:b], t0, t0 + step_ns, ends[0], ends[1])
        return [np.sort(strip.store.events(k, 1, 0.0).x_m) for k in strip.store.blocks]

    close, apart = placed(1_000_000_000), placed(8_000_000_000)
    assert [len(x) for x in apart] == [len(x) for x in close]
    np.testing.assert_allclose(np.concatenate(apart), np.concatenate(close), atol=2e-6)

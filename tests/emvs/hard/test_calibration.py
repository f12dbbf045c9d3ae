"""Strong distortion up to the corner, and figures that aren't numbers."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from emvs.hard import world
from emvs.hard.world import ALL, CAMERA, SPEED_M_S, UPRIGHT
from emvs.scenes import rolling
from roller_core.camera import Camera, CameraError
from roller_core.errors import RollerError, SettingsError
from roller_core.events import EventArray, EventArrayError
from roller_core.pose_track import PoseTrack, PoseValueError
from roller_core.sensor_pose import SensorFrames
from roller_core.transforms import RotationError
from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import DepthSettings, StitcherSettings
from roller_emvs.stitcher import Stitcher

NAN, INF = float("nan"), float("inf")
WIDE = {"width": 320, "height": 96, "fx": 300.0, "fy": 300.0, "cx": 159.5, "cy": 47.5}
TRAVEL_M, DURATION_S = 0.02, 0.2
#: Barrel and cushion: the corner's pixel moves by 13 px and more.
DISTORTIONS = {
    "barrel": (-0.25, 0.05, 0.003, -0.003, 0.0), "cushion": (0.3, 0.05, 0.003, 0.003, 0.0),
}  # fmt: skip


def wide_tilted(x: np.ndarray) -> np.ndarray:
    return np.asarray(0.045 + 0.03 * (x - 0.03))


@cache
def wide_scan(kind: str) -> tuple[Camera, EventArray]:
    camera = Camera(**WIDE, distortion=DISTORTIONS[kind])  # type: ignore[arg-type]
    lines = world.line_positions(-0.03, 0.09, 0.003)
    motion = rolling(SPEED_M_S)
    events = world.scan(motion, wide_tilted, DURATION_S, camera, lines, step_s=3e-4, share=1.0)
    return camera, events


def assert_right_when_distorted(
    method: str, events: EventArray, camera: Camera, typical_px: float
) -> None:
    values: dict[str, object] = {"depth_min_m": 0.040, "depth_max_m": 0.050}
    if method != "surface":
        values |= {"window": {"travel_m": TRAVEL_M, "time_s": TRAVEL_M / SPEED_M_S}}
    track = world.poses(rolling(SPEED_M_S), DURATION_S)
    points = world.points_of(world.run(method, events, track, camera, **values), camera)
    one_pixel_m = world.pixel_m(TRAVEL_M, camera)
    world.assert_right(points, wide_tilted, one_pixel_m=one_pixel_m, typical_px=typical_px)


@pytest.mark.parametrize("kind", DISTORTIONS)
@pytest.mark.parametrize("method", ALL)
def test_depth_is_right_under_strong_distortion(method: str, kind: str) -> None:
    camera, events = wide_scan(kind)
    assert np.linalg.norm(camera.undistort([[0, 0]])[0]) > 10
    assert_right_when_distorted(method, events, camera, 0.7)


@pytest.mark.parametrize("kind", DISTORTIONS)
@pytest.mark.parametrize("method", ALL)
def test_depth_is_right_of_corners_alone(method: str, kind: str) -> None:
    """Of what the outer parts of the sensor saw, and nothing else."""
    camera, events = wide_scan(kind)
    outer = (np.abs(events.y - camera.cy) > 24) & (np.abs(events.x - camera.cx) > 60)
    assert_right_when_distorted(method, events[outer], camera, 1.0)


@pytest.mark.parametrize("bad", [NAN, INF, -INF])
@pytest.mark.parametrize("field", ["fx", "fy", "cx", "cy"])
def test_a_calibration_must_be_of_numbers(field: str, bad: float) -> None:
    with pytest.raises(CameraError, match="not finite"):
        Camera(**{**WIDE, field: bad})  # type: ignore[arg-type]
    with pytest.raises(CameraError, match="not finite"):
        Camera(**WIDE, distortion=(0.1, bad))  # type: ignore[arg-type]


def test_a_distortion_that_folds_the_image_is_refused() -> None:
    """Two directions on one pixel: what the outer pixels look at can't be known."""
    with pytest.raises(CameraError, match="distortion"):
        Camera(**WIDE, distortion=(-1.5, 0.0, 0.0, 0.0, 0.0)).undistortion_table()  # type: ignore[arg-type]


@pytest.mark.parametrize("bad", [NAN, INF])
def test_a_pose_must_be_of_numbers(bad: float) -> None:
    """It is refused where it enters, and the poses before and after it still give depth."""
    track = PoseTrack()
    for k in range(16):
        track.append(8_000_000 * k, [SPEED_M_S * 0.008 * k, 0, 0], UPRIGHT)
        with pytest.raises(PoseValueError, match="not finite"):
            track.append(8_000_000 * k + 1, [bad, 0, 0], UPRIGHT)
        with pytest.raises(PoseValueError, match="not finite"):
            track.append(8_000_000 * k + 1, [0, 0, 0], [0, 0, bad, 1])
    assert len(track) == 16
    world.assert_right(world.points_of(world.run("focus", world.scan(), track)))


@pytest.mark.parametrize("bad", [NAN, INF])
def test_a_mounting_must_be_of_numbers(bad: float) -> None:
    """The static transform from tool to camera says so itself, not each pose after it."""
    frames = SensorFrames()
    sensor = "event_camera_optical_frame"
    with pytest.raises(PoseValueError, match=f"tool0_controller.*{sensor}"):
        frames.add_static("tool0_controller", sensor, (0, bad, 0), UPRIGHT)
    with pytest.raises(RotationError):
        frames.add_static("tool0_controller", sensor, (0, 0, 0), (0, 0, bad, 1))
    assert frames.hand_eye is None


@pytest.mark.parametrize(
    "values",
    [
        {"depth_min_m": NAN},
        {"paper.weights": (NAN, 1.0, 1.0)},
        {"paper.reference_views": (0.0, INF, 1.0)},
    ],
)
def test_settings_must_be_of_numbers(values: dict[str, object]) -> None:
    with pytest.raises(SettingsError):
        DepthSettings.create(values)


@pytest.mark.parametrize("column", ["x", "y", "t_ns"])
@pytest.mark.parametrize("bad", [NAN, INF, -1e30])
def test_events_must_be_of_numbers_that_fit(column: str, bad: float) -> None:
    """A conversion to whole numbers would make some pixel or time of them."""
    columns = {name: np.array([0.0, 1.0]) for name in ("x", "y", "t_ns", "p")}
    columns[column][1] = bad
    with pytest.raises(EventArrayError, match=f"'{column}'"):
        EventArray.from_arrays(**columns)


@pytest.mark.parametrize("bad", [2, 255, -1, 1.5e3])
def test_polarities_are_none_or_one(bad: float) -> None:
    """Others would be counted beyond the end of an image of two kinds."""
    with pytest.raises(EventArrayError, match="'p'"):
        EventArray.from_arrays([0, 1], [0, 1], [0, 1], [1, bad])


def test_pixels_of_events_do_not_wrap() -> None:
    with pytest.raises(EventArrayError, match="'x'"):
        EventArray.from_arrays(np.array([-1]), np.array([0]), np.array([0]), np.array([0]))
    with pytest.raises(EventArrayError, match="'y'"):
        EventArray.from_arrays(np.array([0]), np.array([65536]), np.array([0]), np.array([0]))


def depth_map(change: Callable[[np.ndarray, np.ndarray, np.ndarray], None]) -> DepthMap:
    shape = (CAMERA.height, CAMERA.width)
    depth, sure = np.full(shape, 0.045, np.float32), np.full(shape, 0.5, np.float32)
    pose = np.eye(4)
    change(depth, sure, pose)
    return DepthMap(0, depth, sure, 1e-5 * sure, pose, 0, 0, 0)


@pytest.mark.parametrize("icp", [True, False])
@pytest.mark.parametrize("bad", [NAN, INF])
def test_no_point_comes_of_a_depth_or_confidence_that_is_no_number(bad: float, icp: bool) -> None:
    """Half of the pixels have no depth, another quarter no confidence: a quarter remains."""

    def change(depth: np.ndarray, sure: np.ndarray, pose: np.ndarray) -> None:
        depth[:20], sure[20:, :160] = bad, bad

    stitcher = Stitcher(StitcherSettings.create({"icp": icp, "voxel_m": 1e-6}), CAMERA)
    stitcher.add(depth_map(change))
    stitcher.add(depth_map(change))
    patch = stitcher.finish()
    assert len(patch) == 20 * 160
    assert np.isfinite(patch.columns()).all()


@pytest.mark.parametrize("bad", [NAN, INF])
def test_a_depth_map_of_no_place_is_refused(bad: float) -> None:
    """And the cloud so far stays."""

    def nowhere(depth: np.ndarray, sure: np.ndarray, pose: np.ndarray) -> None:
        pose[0, 3] = bad

    stitcher = Stitcher(StitcherSettings.create({}), CAMERA)
    stitcher.add(depth_map(lambda *_: None))
    before = len(stitcher.voxels)
    with pytest.raises(RollerError, match="pose"):
        stitcher.add(depth_map(nowhere))
    assert len(stitcher.voxels) == before

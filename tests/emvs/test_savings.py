"""Each saving of the depth engine gives what the plain form gives, or says by how much not."""

import numpy as np
import pytest

from emvs.scenes import CAMERA, events_of, lines, rolling, tilted, tilted_scan, track_of, turning
from roller_core import hot_pixels as hot_pixels_module
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.hot_pixels import count_events, find_hot_pixels
from roller_core.transforms import quaternion_to_matrix, rotation_vector_to_quaternion
from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.methods.paper import votes
from roller_emvs.methods.paper.shifted import shifted_planes
from roller_emvs.pipeline import DepthPipeline

DURATION_S = 0.12
BOUNDS = (0.043, 0.047)
SETTINGS = DepthSettings.create(
    {
        "method": "bma",
        "window.time_s": 0.03,
        "paper": {"threshold_c": 6.0, "full_scale_votes": 0.0, "planes": 200},
    }
)
#: Depth of one pixel of parallax of these windows, m.
PIXEL_M = 0.045**2 / (CAMERA.fx * 0.3 * 0.03)


@pytest.fixture(scope="module")
def scan() -> EventArray:
    return tilted_scan(DURATION_S)


def maps(scan: EventArray, **values: object) -> list[DepthMap]:
    track = track_of(rolling(0.3), DURATION_S)
    pipeline = DepthPipeline(SETTINGS.changed(values), CAMERA, track)
    pipeline.add_events(scan)
    return [m for m in pipeline.results(flush=True) if isinstance(m, DepthMap)]


@pytest.mark.parametrize("method", ["bma", "left_right", "emvs"])
def test_fewer_planes_and_shared_votes_give_the_same_depth(scan: EventArray, method: str) -> None:
    """To a quarter of a pixel of parallax at the median, a pixel at 95 % (the stated tolerance)."""
    plain = maps(scan, method=method, paper={"plane_rule": "fixed"})
    fast = maps(scan, method=method)
    assert len(plain) == len(fast) >= 3
    apart = []
    for a, b in zip(plain, fast, strict=True):
        assert (a.pose == b.pose).all()
        both = np.isfinite(a.depth) & np.isfinite(b.depth)
        assert both.sum() > 0.6 * np.isfinite(a.depth).sum()
        apart.append(np.abs(a.depth - b.depth)[both])
    assert np.median(np.concatenate(apart)) < PIXEL_M / 4
    assert np.quantile(np.concatenate(apart), 0.95) < PIXEL_M


def test_windows_of_too_many_rays_for_shared_votes_give_the_same_depth(
    scan: EventArray, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each view has its own sweep there, on planes of its own that lie as far apart.

    To half their distance at the median, which is a pixel of parallax.
    """
    shared = maps(scan)
    monkeypatch.setattr(votes, "_LEAST_WHOLE", 1000)
    own = maps(scan)
    assert len(shared) == len(own) >= 3
    for a, b in zip(shared, own, strict=True):
        assert (a.depth != b.depth).any()
        assert not np.array_equal(a.depth, b.depth, equal_nan=True)
        both = np.isfinite(a.depth) & np.isfinite(b.depth)
        assert both.sum() > 0.8 * np.isfinite(a.depth).sum()
        assert np.median(np.abs(a.depth - b.depth)[both]) < PIXEL_M / 2


@pytest.mark.parametrize("method", ["bma", "focus"])
def test_threads_change_nothing(scan: EventArray, method: str) -> None:
    plain, other = (maps(scan, method=method, threads=threads) for threads in (1, 3))
    for a, b in zip(plain, other, strict=True):
        np.testing.assert_array_equal(a.depth, b.depth)
        np.testing.assert_array_equal(a.confidence, b.confidence)


def test_views_are_shared_where_they_are_parallel() -> None:
    views = np.tile(np.eye(4), (3, 1, 1))
    views[:, 0, 3] = (-0.00452, 0.00003, 0.00448)
    found = shifted_planes(CAMERA, views, BOUNDS, SETTINGS.paper)
    assert found is not None
    planes, put = found.planes, found.views
    # A plane beyond either end, and one for each pixel of the window's parallax between.
    assert planes[0] < BOUNDS[0] < BOUNDS[1] < planes[-1]
    baseline = put[2, 0, 3] - put[0, 0, 3]
    step = CAMERA.fx * baseline * np.diff(1 / planes)
    np.testing.assert_allclose(step, -1.0, rtol=1e-9)
    from_middle = put[:, 0, 3] - found.middle[0, 3]
    for x, shift in zip(from_middle, found.half_shifts, strict=True):
        np.testing.assert_allclose(shift / 2, CAMERA.fx * x / planes, atol=1e-9)
    np.testing.assert_allclose(put[[0, 2], 0, 3], views[[0, 2], 0, 3], atol=1e-12)
    np.testing.assert_allclose(put[1, 0, 3], views[1, 0, 3], atol=6e-5)


def test_views_of_a_roller_that_gains_speed_are_shared() -> None:
    """Half the time is not half the travel; the middle view is put at half the travel."""
    views = np.tile(np.eye(4), (3, 1, 1))
    views[:, 0, 3] = (-0.0041, 0.0, 0.0049)
    found = shifted_planes(CAMERA, views, BOUNDS, SETTINGS.paper)
    assert found is not None
    np.testing.assert_allclose(found.views[:, 0, 3], (-0.0041, 0.0004, 0.0049), atol=1e-12)
    # It stood up to the middle of the window: the first two views are one.
    views[:2, 0, 3] = 0.0
    found = shifted_planes(CAMERA, views, BOUNDS, SETTINGS.paper)
    assert found is not None
    np.testing.assert_allclose(found.views[:, 0, 3], (0.0, 0.0, 0.0049), atol=1e-12)


def test_views_that_turn_or_lie_elsewhere_are_not_shared() -> None:
    views = np.tile(np.eye(4), (3, 1, 1))
    views[:, 0, 3] = (-0.0045, 0.0, 0.0045)
    assert shifted_planes(CAMERA, views, BOUNDS, SETTINGS.paper) is not None
    tilted_view = views.copy()
    turn = rotation_vector_to_quaternion([0.0, 0.01, 0.0])
    tilted_view[2, :3, :3] = quaternion_to_matrix(turn)
    assert shifted_planes(CAMERA, tilted_view, BOUNDS, SETTINGS.paper) is None
    quarter = views.copy()
    quarter[1, 0, 3] = 0.002
    assert shifted_planes(CAMERA, quarter, BOUNDS, SETTINGS.paper) is None
    upwards = views[:, [1, 0, 2, 3]].copy()
    assert shifted_planes(CAMERA, upwards, BOUNDS, SETTINGS.paper) is None
    dense = SETTINGS.changed({"paper.plane_rule": "fixed"}).paper
    assert shifted_planes(CAMERA, views, BOUNDS, dense) is None


def test_rolling_along_v_is_found_by_focus() -> None:
    """A camera mounted a quarter turn round: planes part along the image's columns."""
    upright = Camera(120, 320, 800.0, 800.0, 59.5, 159.5)
    quarter = rotation_vector_to_quaternion([0.0, 0.0, -np.pi / 2])

    def motion(t: float) -> tuple[np.ndarray, np.ndarray]:
        return np.array([0.3 * t, 0.0, 0.0]), quarter

    events = events_of(lines(tilted), motion, DURATION_S, camera=upright)
    settings = DepthSettings.create({"window.travel_m": 0.012})
    pipeline = DepthPipeline(settings, upright, track_of(motion, DURATION_S))
    pipeline.add_events(events)
    errors = []
    for found in pipeline.results(flush=True):
        if isinstance(found, DepthMap):
            y, x = np.nonzero(np.isfinite(found.depth))
            z = found.depth[y, x].astype(float)
            local = np.stack([(x - 59.5) / 800 * z, (y - 159.5) / 800 * z, z])
            base_x = (found.pose[:3, :3] @ local)[0] + found.pose[0, 3]
            errors.append(z - tilted(base_x))
    assert len(np.concatenate(errors)) > 2000
    assert np.median(np.abs(np.concatenate(errors))) < 80e-6


def test_few_busy_pixels_are_judged_as_many_are(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    counts = rng.poisson(0.4, (60, 90)).astype(np.float32)
    counts[rng.integers(0, 60, 60), rng.integers(0, 90, 60)] += rng.integers(0, 60, 60)
    counts[0, :3] += 20
    counts[-1, -2] = 90
    for columns_too in (False, True):
        few = find_hot_pixels(counts, columns_too)
        monkeypatch.setattr(hot_pixels_module, "_FEW", 0)
        np.testing.assert_array_equal(few, find_hot_pixels(counts, columns_too))
        monkeypatch.undo()
        assert few is not None


def hot_pixels(events: EventArray) -> np.ndarray | None:
    """Hot pixels by the events of one window, for any direction of travel."""
    counts = np.zeros((120, 320), np.float32)
    count_events(events, counts)
    return find_hot_pixels(counts, columns_too=True)


def test_a_pixel_that_fires_on_its_own_is_hot() -> None:
    rng = np.random.default_rng(0)
    n = 20_000
    x, y = rng.integers(0, 320, n), rng.integers(0, 120, n)
    t = np.arange(n)
    events = EventArray.from_arrays(x, y, t, t % 2)
    assert hot_pixels(events) is None
    fires = EventArray.from_arrays(np.full(300, 7), np.full(300, 5), np.arange(300), [0] * 300)
    hot = hot_pixels(EventArray.concatenate([events, fires]))
    assert hot is not None
    np.testing.assert_array_equal(np.argwhere(hot), [[5, 7]])
    # A row or a column of many events sees something.
    row = EventArray.from_arrays(t % 320, np.full(n, 60), t, t % 2)
    column = EventArray.from_arrays(np.full(n, 60), t % 120, t, t % 2)
    for seen in (row, column):
        assert hot_pixels(seen) is None


def test_a_turning_camera_is_voted_view_by_view() -> None:
    """Rotation on the spot has no parallax; with a baseline the general path takes over."""
    track = track_of(turning(0.5), DURATION_S)
    poses = track.matrices([0, 50_000_000, 100_000_000])
    relative = np.linalg.inv(poses[1]) @ poses
    assert shifted_planes(CAMERA, relative, BOUNDS, SETTINGS.paper) is None

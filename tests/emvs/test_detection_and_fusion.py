"""Threshold, masked median, warping and weighted fusion against slow forms."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emvs.scenes import CAMERA
from roller_emvs.methods.paper.fusion import ViewDepth, fuse_views, weighted_mean
from roller_emvs.methods.paper.median import masked_median
from roller_emvs.methods.paper.threshold import adaptive_threshold


def test_threshold_is_opencvs_without_saturation() -> None:
    votes = np.random.default_rng(0).gamma(2.0, 10.0, (60, 80)).astype(np.float32)
    gray = ((votes - votes.min()) * (255 / (votes.max() - votes.min()))).astype(np.uint8)
    expected = cv2.adaptiveThreshold(
        gray, 1, cv2.ADAPTIVE_THRESH_GAUSSIAN_C, cv2.THRESH_BINARY, 5, -16
    )
    mask = adaptive_threshold(votes, 16, 5, 0)
    agree = (mask == (expected > 0))[2:-2, 2:-2]
    # OpenCV rounds its mean in fixed point: a few ties fall the other way.
    assert agree.mean() > 0.995
    assert not mask[:2].any()
    assert not mask[:, -2:].any()


def test_threshold_does_not_depend_on_the_window() -> None:
    """With a fixed scale a bright pixel elsewhere changes nothing."""
    votes = np.random.default_rng(0).gamma(2.0, 3.0, (60, 80)).astype(np.float32)
    bright = votes.copy()
    bright[50, 70] = 1e4
    one, two = (adaptive_threshold(v, 16, 5, 64) for v in (votes, bright))
    np.testing.assert_array_equal(one[:40, :60], two[:40, :60])


def test_no_votes_no_mask() -> None:
    for scale in (0.0, 64.0):
        assert not adaptive_threshold(np.zeros((9, 9), np.float32), 0, 3, scale).any()


@settings(max_examples=25)
@given(
    seed=st.integers(0, 1000),
    size=st.sampled_from([1, 3, 7, 45, 91]),
    share=st.sampled_from([0.0, 0.02, 0.3, 1.0]),
)
def test_masked_median_equals_its_twin(seed: int, size: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    index = rng.integers(0, 500, (23, 31)).astype(np.uint16)
    mask = rng.random(index.shape) < share
    median = masked_median(index, mask, size, 500)
    half = size // 2
    for y in range(index.shape[0]):
        for x in range(index.shape[1]):
            if not mask[y, x]:
                assert np.isnan(median[y, x])
                continue
            window = np.s_[max(y - half, 0) : y + half + 1, max(x - half, 0) : x + half + 1]
            near = np.sort(index[window][mask[window]])
            # Half of the items lie on either side, those of the median's plane spread over it.
            plane = int(np.rint(np.nextafter(median[y, x], np.inf)))
            below, same = np.sum(near < plane), np.sum(near == plane)
            if not same:
                plane -= 1
                below, same = np.sum(near < plane), np.sum(near == plane)
            expected = plane - 0.5 + (len(near) / 2 - below) / same
            assert median[y, x] == pytest.approx(expected, abs=1e-4)


def image_view(depth: np.ndarray, pose: np.ndarray, weight: float) -> ViewDepth:
    """A view of an image's depths, NaN where there is none."""
    pixels = np.flatnonzero(np.isfinite(depth))
    found = depth.reshape(-1)[pixels].astype(np.float32)
    return ViewDepth(pixels, found, np.full_like(found, 0.5), pose, weight)


def plane_view(z_m: float, x_m: float, weight: float, columns: slice = slice(None)) -> ViewDepth:
    """A plane seen in some columns of a camera at x."""
    depth = np.full((CAMERA.height, CAMERA.width), np.nan)
    depth[:, columns] = z_m
    pose = np.eye(4)
    pose[0, 3] = x_m
    return image_view(depth, pose, weight)


def test_warping_a_plane_shifts_it() -> None:
    """1 mm sideways at 45 mm is F·B/Z = 17.8 px: 18 columns of one side stay empty."""
    depth, confidence = fuse_views([plane_view(0.045, 0.001, 1.0)], np.eye(4), CAMERA)
    seen = np.isfinite(depth)
    assert not seen[:, :18].any()
    assert seen[:, 18:].all()
    np.testing.assert_allclose(depth[seen], 0.045, rtol=1e-6)
    np.testing.assert_allclose(confidence[seen], 0.5)


def test_a_view_at_the_target_stays_as_it_is() -> None:
    view = plane_view(0.045, 0.001, 1.0, columns=slice(3, 7))
    depth, confidence = fuse_views([view], view.pose, CAMERA)
    assert np.isfinite(depth).any(axis=0).nonzero()[0].tolist() == [3, 4, 5, 6]
    for image, values in ((depth, view.depth), (confidence, 0.5)):
        np.testing.assert_array_equal(image[:, 3:7].reshape(-1), values)


def test_the_nearer_point_hides_the_farther() -> None:
    image = np.full((CAMERA.height, CAMERA.width), np.nan)
    image[60, 80], image[60, 81] = 0.047, 0.043
    view = image_view(image, np.eye(4), 1.0)
    target = np.eye(4)
    # Moved so that both land on one pixel.
    target[0, 3] = 1.0 / (CAMERA.fx * (1 / 0.043 - 1 / 0.047)) * 0.6
    depth, _ = fuse_views([view], target, CAMERA)
    assert np.nanmin(depth) == pytest.approx(0.043)


def test_weights_are_renormalised_where_a_view_is_missing() -> None:
    weights = (0.445, 0.333, 0.222)
    seen = (slice(50, 100), slice(50, 100), slice(0, 100))
    views = [
        plane_view(0.044 + 0.001 * k, 0.0, w, columns=c)
        for k, (w, c) in enumerate(zip(weights, seen, strict=True))
    ]
    depth, confidence = fuse_views(views, np.eye(4), CAMERA)
    np.testing.assert_allclose(depth[:, :50], 0.046, rtol=1e-6)
    expected = 0.445 * 0.044 + 0.333 * 0.045 + 0.222 * 0.046
    np.testing.assert_allclose(depth[:, 50:100], expected, rtol=1e-6)
    assert np.isnan(depth[:, 100:]).all()
    assert np.isnan(confidence[:, 100:]).all()


@pytest.mark.parametrize("views", [1, 3, 5])
def test_the_mean_is_that_of_what_is_there(views: int) -> None:
    rng = np.random.default_rng(views)
    depth, sure = rng.uniform(0.5, 1.5, (2, views, CAMERA.height, CAMERA.width)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.4] = np.nan
    weights = rng.uniform(0.1, 1.0, views)
    weights[-1] = 0.0 if views > 1 else 1.0
    seen = []
    for k, weight in enumerate(weights):
        pixels = np.flatnonzero(np.isfinite(depth[k]))
        own = depth[k].reshape(-1)[pixels], sure[k].reshape(-1)[pixels]
        seen.append(ViewDepth(pixels, *own, np.eye(4), weight))
    found = weighted_mean(seen, CAMERA)
    w = np.where(np.isfinite(depth), weights[:, None, None], 0.0)
    with np.errstate(invalid="ignore"):
        for mine, values in zip(found, (np.nan_to_num(depth), sure), strict=True):
            np.testing.assert_allclose(mine, (w * values).sum(axis=0) / w.sum(axis=0), rtol=1e-5)


def test_of_points_that_meet_in_a_pixel_the_nearest_counts() -> None:
    far = np.array([0.046, 0.044, 0.045], np.float32)
    sure = np.array([0.1, 0.2, 0.3], np.float32)
    view = ViewDepth(np.array([7, 7, 7]), far, sure, np.eye(4), 1.0)
    depth, confidence = weighted_mean([view], CAMERA)
    assert depth.reshape(-1)[7] == far[1]
    assert confidence.reshape(-1)[7] == sure[1]


def test_weights_need_not_sum_to_one() -> None:
    views = [plane_view(0.044, 0.0, 3.0), plane_view(0.046, 0.0, 1.0)]
    depth, _ = fuse_views(views, np.eye(4), CAMERA)
    np.testing.assert_allclose(depth, 0.0445, rtol=1e-6)

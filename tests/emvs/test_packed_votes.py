"""Votes of whole numbers against slow numpy twins."""

import cv2
import numpy as np
import pytest

from roller_core.camera import Camera
from roller_emvs.methods.paper import _packed_kernels as packed
from roller_emvs.methods.paper import _view_kernels as views
from roller_emvs.methods.paper.votes import sweep_views
from roller_emvs.rays import RayBundle

ROWS, WIDE, HEIGHT, W = 8, 96, 40, np.float32(20.0)


def random_rays(n: int = 400) -> np.ndarray:
    rng = np.random.default_rng(7)
    places = rng.uniform([-5, -3], [WIDE + 5, HEIGHT + 3], (n, 2))
    return np.concatenate([places.T, rng.normal(0, 0.1, (2, n))]).astype(np.float32)


def twin_votes(rays: np.ndarray, top: int, whole: int) -> tuple[np.ndarray, np.ndarray]:
    """Shares of the upper and of the lower row, by row above them and half pixel."""
    upper, lower = np.zeros((2, ROWS + 1, 2 * WIDE), int)
    for x0, y0, dx, dy in rays.T:
        x, y = x0 + dx * W, y0 + dy * W
        row, h = int(np.floor(y)), int(np.floor(2 * x))
        if not (0 <= x < WIDE - 1 and 0 <= y < HEIGHT - 1 and top - 1 <= row < top + ROWS):
            continue
        fx, fy = 2 * x - h, y - row
        for at, share in ((h, 1 - fx), (h + 1, fx)):
            upper[row - top + 1, at] += np.floor(whole * share * (1 - fy) + 0.5)
            lower[row - top + 1, at] += np.floor(whole * share * fy + 0.5)
    return upper, lower


@pytest.mark.parametrize("top", [0, 16, HEIGHT - ROWS])
def test_a_vote_adds_its_shares_of_two_rows_at_once(top: int) -> None:
    rays, whole = random_rays(), 255
    votes = np.zeros((ROWS + 2, 2, WIDE), np.int32)
    none = np.empty(0, np.float32)
    part = (0, rays.shape[1])
    packed._vote_packed(rays, part, none, W, top, HEIGHT, whole, votes, packed.chunk())
    halves = votes[:-1].transpose(0, 2, 1).reshape(ROWS + 1, -1)
    upper, lower = twin_votes(rays, top, whole)
    # A share may be rounded to either side.
    np.testing.assert_allclose(halves & 0xFFFF, upper, atol=1)
    np.testing.assert_allclose(halves >> 16, lower, atol=1)


def test_rays_vote_on_no_plane_behind_their_limit() -> None:
    rays = random_rays()
    limits = np.where(np.arange(rays.shape[1]) % 2, np.inf, W).astype(np.float32)
    some, same = np.zeros((2, ROWS + 2, 2, WIDE), np.int32)
    n, chunk = rays.shape[1], packed.chunk()
    packed._vote_packed(rays, (0, n), limits, W, 8, HEIGHT, 64, some, chunk)
    odd = np.ascontiguousarray(rays[:, 1::2])
    none = np.empty(0, np.float32)
    packed._vote_packed(odd, (0, n // 2), none, W, 8, HEIGHT, 64, same, chunk)
    np.testing.assert_array_equal(some[:-1], same[:-1])


def test_rays_are_counted_in_the_tiles_that_they_reach() -> None:
    rays = random_rays()
    first, last = np.float32(18.0), np.float32(25.0)
    starts, tiles = np.array([0, 200, 400]), WIDE // 32 + 1
    reached = np.zeros((2, ROWS + 1, tiles), np.int32)
    for k in range(2):
        packed._count_reached(rays, starts, k, 2, (first, last), packed.chunk(), reached)
    expected = np.zeros_like(reached)
    for b in range(2):
        for i in range(starts[b], starts[b + 1]):
            x = rays[0, i] + rays[2, i] * np.array([first, last])
            y = rays[1, i] + rays[3, i] * np.array([first, last]) - (b * ROWS - 1)
            rows = range(max(int(y.min() - 0.01), 0), min(int(y.max() + 0.01), ROWS) + 1)
            left, right = max(int((x.min() - 2) / 32), 0), min(int((x.max() + 3) / 32), tiles - 1)
            for r in rows:
                expected[b, r, left : right + 1] += 1
    np.testing.assert_array_equal(reached, expected)


def test_sums_of_two_rows_never_meet() -> None:
    for most in range(5000):
        whole = packed._whole(most)
        assert 0 <= whole <= 255
        # A hat of a pixel is twice a ray's vote at most, each of four shares rounded up.
        assert whole == 0 or most * (2 * whole + 2) < 1 << 15


def test_keys_hold_the_votes_of_a_row_and_a_rank() -> None:
    rng = np.random.default_rng(2)
    upper, lower = rng.integers(0, 4000, (2, 2, 2, WIDE)).astype(np.int32)
    votes, keys, rank = (upper | (lower << 16)).reshape(-1), np.zeros(WIDE, np.int32), 9
    # Whole positions of the second row, 1 to the last.
    packed._make_keys(votes, 2 * WIDE + 1, 3 * WIDE, 2 * WIDE, np.uint64(WIDE - 1), rank, keys, 1)
    hats = [2 * v[:, 0, 1:] + v[:, 1, :-1] + v[:, 1, 1:] for v in (upper, lower)]
    np.testing.assert_array_equal(keys[1:], ((hats[0][1] + hats[1][0]) << packed.RANK_BITS) | rank)


def test_runs_are_of_marked_tiles_side_by_side() -> None:
    marked, counts = np.array([[1, 0, 3, 1, 2], [0, 0, 0, 0, 0]]), np.empty(2, np.int64)
    runs = np.empty((2, 5, 2), np.int64)
    views._find_runs(marked, 150, runs, counts)
    assert counts.tolist() == [2, 0]
    np.testing.assert_array_equal(runs[0, :2], [[1, 32], [64, 149]])


@pytest.mark.parametrize("least", [1.0, 2.0, 4.0])
def test_around_what_has_votes_nothing_is_left_out(least: float) -> None:
    """Pixels with more votes, and those near them, are as they are where all is looked at."""
    rng = np.random.default_rng(11)
    planes, camera = np.linspace(0.043, 0.047, 7), Camera(320, 96, 200, 200, 160, 48)
    # Noise, and edges that some planes see sharp.
    noise = rng.uniform([0, 0], [320, 96], (300, 2))
    edge = np.column_stack([np.repeat([90.0, 200.5], 200), rng.uniform(20, 60, 400)])
    places = np.concatenate([noise, edge])
    rays = np.column_stack([places, rng.normal(0, 0.3, len(places)), 0 * places[:, 0]])
    rays[:, 0] -= rays[:, 2] / 0.045
    bundle = RayBundle(rays.astype(np.float32), np.full(len(rays), np.inf, np.float32))
    halves = np.stack([np.arange(-30, -30 + 7), np.zeros(7, int), np.arange(30, 30 - 7, -1)])
    every = sweep_views(bundle, camera, planes, halves)
    some = sweep_views(bundle, camera, planes, halves, 2, (least, 2))
    assert every is not None
    assert some is not None
    for view in range(3):
        above = (every[0][view] > least).astype(np.uint8)
        assert above.any()
        near = cv2.dilate(above, np.ones((5, 5), np.uint8)) > 0
        for a, b in zip(every, some, strict=True):
            np.testing.assert_array_equal(a[view][near], b[view][near])
    assert (some[0] > 0).sum() < (every[0] > 0).sum()

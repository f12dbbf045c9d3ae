"""Kernels of the evidence against slow forms: votes, what saw cells, pixels, order of rays."""

import cv2
import numpy as np
import pytest

from roller_emvs.bands import sort_into_bands
from roller_emvs.evidence import _kernels, _pixel_kernels, _seen_kernels
from roller_emvs.evidence._kernels import CELL_PX, ROW_PX, TILE_CELLS
from roller_emvs.evidence.blur import blurred
from roller_emvs.evidence.relief import enlarge

HEIGHT, WIDTH = 32, 48


def some_rays(n: int, rng: np.random.Generator, slope: float = 4000) -> np.ndarray:
    return np.column_stack(
        [
            rng.uniform(-3, WIDTH + 3, n),
            rng.uniform(-3, HEIGHT + 3, n),
            rng.normal(0, slope, (n, 2)),
        ]
    ).astype(np.float32)


def twin_measure(rays: np.ndarray, offset: float, top: float, rows: int) -> np.ndarray:
    """Squared five-tap slopes of votes that are linear along x and whole along y."""
    votes = np.zeros((rows, WIDTH), np.float64)
    for x, y, sx, sy in rays:
        a = np.float32(x + sx * np.float32(offset))
        b = np.float32((y + sy * np.float32(offset) - np.float32(top)) * np.float32(1 / ROW_PX))
        if 0 <= a < WIDTH - 1 and 0 <= b < rows:
            j = int(a)
            votes[int(b), j] += 1 - (a - j)
            votes[int(b), j + 1] += a - j
    slope = np.zeros_like(votes)
    slope[:, 2:-2] = 0.4 * (votes[:, 4:] - votes[:, :-4]) + (votes[:, 3:-1] - votes[:, 1:-3])
    per_cell = CELL_PX // ROW_PX
    shape = (rows // per_cell, per_cell, WIDTH // CELL_PX, CELL_PX)
    return (slope**2).reshape(shape).sum(axis=(1, 3))


def measure(
    rays: np.ndarray, starts: np.ndarray, reach: int, offsets: np.ndarray, tiles: np.ndarray
) -> np.ndarray:
    rows = HEIGHT // ROW_PX
    out = np.zeros((len(offsets), HEIGHT // CELL_PX, WIDTH // CELL_PX), np.float32)
    _kernels._measure_band(
        np.ascontiguousarray(rays.T), starts, reach, offsets, np.float32(-0.5), tiles,
        np.empty((rows + 1, WIDTH), np.float32), _kernels.chunk(),
        np.empty(TILE_CELLS * CELL_PX, np.float32), out,
    )  # fmt: skip
    return out


def test_focus_measure_is_that_of_the_votes_slopes() -> None:
    rays = some_rays(400, np.random.default_rng(1))
    rays[7, 0] = np.nan
    offsets = np.array([-5e-4, 0.0, 7e-4], np.float32)
    starts = np.array([0, 400, 400, 400])
    tiles = np.array([[0, 2]])
    found = measure(rays, starts, 9, offsets, tiles)
    for k, offset in enumerate(offsets):
        np.testing.assert_allclose(
            found[k],
            twin_measure(rays, float(offset), -0.5, HEIGHT // ROW_PX),
            rtol=2e-3,
            atol=2e-3,
        )


def test_rays_vote_near_their_plane_alone_and_skipped_tiles_stay_empty() -> None:
    rays = some_rays(300, np.random.default_rng(2))
    offsets = np.linspace(-5e-4, 5e-4, 5).astype(np.float32)
    starts = np.array([0, 60, 120, 180, 240, 300])
    found = measure(rays, starts, 1, offsets, np.array([[0, 4]]))
    for k in range(5):
        own = rays[starts[max(k - 1, 0)] : starts[min(k + 1, 4) + 1]]
        expected = twin_measure(own, float(offsets[k]), -0.5, HEIGHT // ROW_PX)
        np.testing.assert_allclose(found[k], expected, rtol=2e-3, atol=2e-3)
    skipped = measure(rays, starts, 1, offsets, np.array([[2, 3]]))
    assert not skipped[[0, 1, 4]].any()
    np.testing.assert_array_equal(skipped[2:4], found[2:4])


def test_planes_are_blurred_where_they_hold_something_and_are_wanted() -> None:
    rng = np.random.default_rng(9)
    for size in ((60, 20), (7, 5), (1, 3), (40, 61)):
        volume = np.zeros((4, *size), np.float32)
        for plane, rows in ((1, slice(3, 9)), (2, slice(-5, None)), (3, slice(0, None))):
            volume[plane, rows] = rng.gamma(1.0, 1.0, volume[plane, rows].shape)
        volume[1, 5:6] = 0
        expected = np.stack([cv2.GaussianBlur(plane, (0, 0), 1.25) for plane in volume])
        np.testing.assert_allclose(blurred(volume, 1.25), expected, rtol=1e-5, atol=1e-6)
        wanted = rng.integers(-2, 6, (size[0], 2)).astype(np.int32)
        k = np.arange(4)[:, None]
        asked = (wanted[:, 0] <= k) & (k <= wanted[:, 1])
        found = blurred(volume, 1.25, wanted)
        np.testing.assert_allclose(found[asked], expected[asked], rtol=1e-5, atol=1e-6)


def test_what_saw_cells_is_in_plain_words() -> None:
    rng = np.random.default_rng(10)
    shape = (14, 17)
    offset = rng.normal(0, 1, shape).astype(np.float32)
    offset[rng.random(shape) < 0.6] = np.nan
    offset[6:9] = np.nan
    grown = np.empty(shape, np.float32)
    _seen_kernels._grow(offset, np.empty(len(offset), np.bool_), grown)
    known = np.isfinite(offset)
    weight = cv2.blur(known.astype(np.float32), (3, 3))
    mean = cv2.blur(np.where(known, offset, 0), (3, 3))
    expected = np.where(weight > 1e-6, mean / np.maximum(weight, 1e-9), np.nan)
    np.testing.assert_allclose(grown, np.where(known, offset, expected), rtol=1e-4, atol=1e-5)

    count = rng.integers(0, 30, shape).astype(np.float32)
    slopes = rng.normal(2, 3, (30, *shape)) * (np.arange(30)[:, None, None] < count)
    sums = np.stack([count, slopes.sum(axis=0), (slopes**2).sum(axis=0)], axis=-1)
    found = np.empty((3, *shape), np.float32)
    _seen_kernels._statistics(sums.astype(np.float32), *found)
    some = np.maximum(count, 1)
    variance = (slopes**2).sum(axis=0) / some - (slopes.sum(axis=0) / some) ** 2
    np.testing.assert_array_equal(found[0], count)
    np.testing.assert_allclose(found[1], slopes.sum(axis=0) / some, rtol=1e-4, atol=1e-5)
    spread = np.sqrt(12 * np.maximum(variance, 0))
    np.testing.assert_allclose(found[2], spread, rtol=1e-2, atol=0.01)

    low, high = np.full(17, -0.3), np.linspace(-0.2, 0.4, 17)
    middle, spread = 0.5 * (low + high), high - low
    change = np.empty(shape, np.float32)
    _seen_kernels._change(
        count, found[1], middle, spread, 0.04, (1.0, 2.0), 2000.0, (0.4, 0.65), change
    )
    gain = (found[1] * 0.04 - middle) / (spread**2 / 12)
    gain /= 1 + (gain / 2) ** 2
    crossed = count / (2000 * spread)
    seeing = 1 - np.minimum(0.4 * crossed, 0.65)
    expected = np.where(count > 1, np.sqrt(crossed / seeing) * gain / seeing, 0)
    np.testing.assert_allclose(change, expected, rtol=1e-4, atol=1e-7)


def test_pixels_are_taken_that_are_sure_enough() -> None:
    rng = np.random.default_rng(11)
    cells = (HEIGHT // CELL_PX, WIDTH // CELL_PX)
    which = rng.integers(0, 3, (HEIGHT, WIDTH)).astype(np.uint8)
    spans = np.sort(rng.integers(0, cells[1] + 1, (cells[0], 2)), axis=1)
    surfaces = tuple(rng.normal(0, 1, (2, HEIGHT, WIDTH)).astype(np.float32))
    sure = tuple(rng.random((2, *cells)).astype(np.float32))
    scatter = rng.uniform(0, 2, cells).astype(np.float32)
    scatter[3, 4:6] = np.nan
    out = (*np.empty((2, which.size), np.int64), *np.empty((3, which.size), np.float32))
    limits = (1.0, 1.5, 0.2)
    count = _pixel_kernels._take(which, spans, surfaces, sure, scatter, limits, *out)
    wide = enlarge(scatter)
    wide = np.where(np.isfinite(wide), wide, 1.0)
    of_image = np.maximum(which.astype(int) - 1, 0)
    confidence = np.choose(of_image, [enlarge(own) for own in sure]) / (1 + wide**2)
    row, column = np.indices(which.shape) // CELL_PX
    inside = (column >= spans[row, 0]) & (column < spans[row, 1])
    keep = (which > 0) & inside & (wide < 1.5) & (confidence >= 0.2)
    at = np.nonzero(keep)
    for found, expected in zip(
        out, (*at, np.choose(of_image, surfaces)[at], confidence[at], wide[at]), strict=True
    ):
        np.testing.assert_allclose(found[:count], expected, rtol=1e-4, atol=1e-5)


def test_parts_of_the_aperture_are_as_wide() -> None:
    rng = np.random.default_rng(8)
    slope = rng.uniform(-11, 9, 500).astype(np.float32)
    part = np.empty(500, np.int32)
    _kernels._part_of(slope, np.float32(-10), np.float32(1 / 5), 4, part)
    # What lies beyond the aperture belongs to its end parts.
    expected = np.clip(np.floor((slope.astype(float) + 10) / 5), 0, 3)
    np.testing.assert_array_equal(part, expected)


def test_tiles_are_searched_where_their_cells_are() -> None:
    rng = np.random.default_rng(9)
    cells, rows = (9, 2 * TILE_CELLS + 3), 4
    first = rng.integers(0, 30, cells).astype(np.int32)
    last = first + rng.integers(0, 5, cells).astype(np.int32)
    nowhere = rng.random(cells) < 0.7
    nowhere[:rows, :TILE_CELLS] = True
    last[nowhere] = -1
    tiles = np.empty((3, 3, 2), np.int64)
    tiles[:] = 40, -1
    _kernels._tiles_searched(first, last, rows, tiles)
    for b in range(3):
        for t in range(3):
            own = np.s_[b * rows : (b + 1) * rows, t * TILE_CELLS : (t + 1) * TILE_CELLS]
            known = ~nowhere[own]
            expected = (
                (first[own][known].min(), last[own][known].max()) if known.any() else (40, -1)
            )
            assert tuple(tiles[b, t]) == expected


def test_rays_are_ordered_by_group_within_their_band() -> None:
    rng = np.random.default_rng(6)
    rays, plane = some_rays(200, rng), rng.integers(-1, 5, 200, np.int32)
    edges = np.array([0, 80, 80, 200])
    starts, out = np.empty((3, 6), np.int64), np.empty((4, 200), np.float32)
    _kernels._order_groups(rays.T.copy(), plane, edges, starts, out)
    for b in range(3):
        for k in range(5):
            own = slice(edges[b], edges[b + 1])
            expected = rays[own][plane[own] == k]
            np.testing.assert_array_equal(out.T[starts[b, k] : starts[b, k + 1]], expected)


@pytest.mark.parametrize("slope", [0.0, 3000.0])
def test_bands_hold_every_ray_that_can_reach_them(slope: float) -> None:
    rng = np.random.default_rng(7)
    rays = some_rays(300, rng, slope)
    rays[3, 1] = np.nan
    ends, rows, offset = (-5e-4, 5e-4), 8, 2
    bands = sort_into_bands(
        rays, ends, (HEIGHT, WIDTH), rows, (0.01, 1.01), offset, with_source=True
    )
    for b in range(HEIGHT // rows):
        held = set(bands.source[bands.starts[b] : bands.starts[b + 1]].tolist())
        assert 3 not in held
        for i in range(len(rays)):
            for plane in np.linspace(*ends, 9):
                x, y = rays[i, :2] + rays[i, 2:] * plane
                x += offset
                touched = {np.floor(y) // rows, (np.floor(y) + 1) // rows}
                if 0 <= x < WIDTH - 1 and 0 <= y < HEIGHT - 1 and b in touched:
                    assert i in held
    moved = rays[bands.source] + np.array([offset, 0, 0, 0], np.float32)
    np.testing.assert_array_equal(bands.rays.T, moved)
    for threads in (2, 5):
        shared = sort_into_bands(
            rays, ends, (HEIGHT, WIDTH), rows, (0.01, 1.01), offset, threads, True
        )
        for name in ("rays", "source", "starts"):
            np.testing.assert_array_equal(getattr(shared, name), getattr(bands, name))


def test_enlarging_keeps_a_linear_surface() -> None:
    cells = (np.arange(12)[None, :] * 4.0 + np.arange(8)[:, None] * 2.0).astype(np.float32)
    pixels = enlarge(cells)
    x, y = np.arange(48)[None, :], np.arange(32)[:, None]
    expected = (x - 1.5) / CELL_PX * 4 + (y - 1.5) / CELL_PX * 2
    np.testing.assert_allclose(pixels[2:-2, 2:-2], expected[2:-2, 2:-2], atol=1e-4)

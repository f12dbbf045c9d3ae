"""The kernels of the sweep in the surface's frame, and the store of its events, by slow forms."""

import numpy as np
import pytest

from roller_core.events import EventArray
from roller_core.transforms import F64, pose_matrix, rotation_vector_to_quaternion
from roller_emvs.evidence import CELL_PX
from roller_emvs.methods.surface import _event_kernels, _part_kernels, _sharpness_kernels
from roller_emvs.methods.surface._event_kernels import PIECES
from roller_emvs.methods.surface._part_kernels import (
    BIN_BITS,
    BINS_PX,
    MOST,
    ROW_PX,
    TILE_BINS,
    TILE_CELLS,
)
from roller_emvs.methods.surface.event_store import EventStore
from roller_emvs.methods.surface.part_field import whole_shifts


def place(
    events: EventArray, pixels: np.ndarray, first: F64, second: F64, steepest: float = np.inf
) -> tuple[np.ndarray, tuple[float, float, float]]:
    out = np.full((3, len(events) + 5), 99.0, np.float32)
    span = _event_kernels._place(
        events.x, events.y, events.t_ns, pixels, 1000, 9000, first, second, 0.045, steepest, out
    )
    return out[:, : len(events)], span


def test_rays_meet_the_plane_and_those_that_lean_too_far_are_left_out() -> None:
    rng = np.random.default_rng(0)
    pixels = rng.uniform(-0.3, 0.3, (20, 30, 2)).astype(np.float32)
    events = EventArray.from_arrays(
        rng.integers(0, 30, 1100), rng.integers(0, 20, 1100),
        np.sort(rng.integers(1000, 9000, 1100)), np.zeros(1100, int),
    )  # fmt: skip
    first = pose_matrix(np.array([0.01, 0.002, 0.0]), rotation_vector_to_quaternion([0, 0.1, 0.0]))
    second = pose_matrix(
        np.array([0.012, 0.001, 0.001]), rotation_vector_to_quaternion([0.02, 0.1, 0.01])
    )
    out, _ = place(events, pixels, first, second)
    expected = np.empty((3, 1100))
    for i in range(1100):
        pose = first + (events.t_ns[i] - 1000) / 8000 * (second - first)
        d = pose[:3, :3] @ [*pixels[events.y[i], events.x[i]].astype(float), 1.0]
        point = pose[:3, 3] + d / d[2] * (0.045 - pose[2, 3])
        expected[:, i] = [point[0] - 0.01, point[1], d[0] / d[2]]
    np.testing.assert_allclose(out, expected, atol=1e-8, rtol=1e-5)
    out, (low, high, most) = place(events, pixels, first, second, 0.2)
    inside = np.abs(expected[2]) <= 0.2
    np.testing.assert_array_equal(np.isfinite(out[0]), inside)
    assert (low, high) == (out[0, inside].min(), out[0, inside].max())
    assert most == np.abs(out[2, inside]).max()


def test_a_ray_that_looks_away_has_no_place() -> None:
    events = EventArray.from_arrays([0], [0], [1000], [0])
    away = np.diag([1.0, -1.0, -1.0, 1.0])
    out, (low, high, _) = place(events, np.zeros((1, 1, 2), np.float32), away, away)
    assert np.isnan(out[0, 0])
    assert low > high


#: Largest slope of the stores; what a place of theirs is off by at most, of blocks of 4 mm, and a
#: slope.
STEEPEST = 0.5
PLACE, SLOPE = 0.004 / PIECES / 65536, 1.01 * STEEPEST / 65536


def test_the_store_holds_each_event_once_and_reuses_what_is_released() -> None:
    rng = np.random.default_rng(2)
    length, low, start_ns = 0.004, -2, 10**15
    store = EventStore(length, STEEPEST)
    n = 30_000
    x = rng.uniform(-0.010, 0.018, n).astype(np.float32)
    x[7] = np.nan
    y, slope = rng.uniform(-0.3, 0.3, (2, n)).astype(np.float32)
    t = start_ns + np.sort(rng.integers(0, 10**9, n))
    p = rng.integers(0, 2, n)
    events = EventArray.from_arrays(np.zeros(n, int), np.zeros(n, int), t, p)
    placed = np.stack([x, y, slope])
    # In two goes, of which the second has more room than it fills.
    half = n // 2
    store.add(placed[:, :half].copy(), events[:half], -low * length, low, range(low, 4))
    wide = np.full((3, n), 9.0, np.float32)
    wide[:, : n - half] = placed[:, half:]
    store.add(wide, events[half:], -low * length, low, range(low, 4))
    number = np.floor(x.astype(float) / length)
    assert store.held == np.sum((number >= low) & (number < 4))
    assert store.blocks == list(range(low, 4))
    for k in range(low, 4):
        own = number == k
        assert store.count(k) == own.sum()
        assert store.times(k) == (t[own].min(), t[own].max())
        np.testing.assert_allclose(
            store.span(k),
            [x[own].min() - k * length, x[own].max() - k * length, y[own].min(), y[own].max()],
            atol=PLACE,
        )
        for polarity in range(2):
            found = store.events(k, polarity, 0.001)
            # Those of a piece lie together.
            piece = np.floor(
                store.events(k, polarity).x_m * (np.float32(PIECES) / np.float32(length))
            )
            assert np.all(np.diff(piece) >= 0)
            held = np.flatnonzero(own & (p == polarity))
            held, order = held[np.argsort(y[held])], np.argsort(found.y_m)
            np.testing.assert_allclose(found.x_m[order], x[held] - k * length + 0.001, atol=PLACE)
            np.testing.assert_array_equal(found.y_m[order], y[held])
            np.testing.assert_allclose(found.slope[order], slope[held], atol=SLOPE)
            inner = store.chains(k, polarity, 0.0016, 0.0024)[2].sum()
            assert inner == np.sum((piece >= 3) & (piece <= 4))
    pages = len(store.link)
    kept = store.events(1, 1)
    for k in (-2, -1, 0):
        assert store.release(k) == np.sum(number == k)
    store.add(placed, events, -low * length, low, [0])
    assert len(store.link) == pages
    assert store.count(0) == np.sum(number == 0)
    np.testing.assert_array_equal(store.events(1, 1).x_m, kept.x_m)
    assert len(store.events(-1, 0)) == 0


ROWS, PARTS, TILES, LEFT = 8, 8, 5, TILE_BINS
SHAPE = (ROWS, PARTS, TILES * TILE_BINS)
CELLS = ROWS // CELL_PX


def some_votes(
    rng: np.random.Generator, crowded: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Votes, where each row of cells begins, and the same as a histogram of `SHAPE`."""
    histogram = rng.poisson(0.3, SHAPE)
    if crowded:  # sums of all parts exceed a byte
        histogram[:, :, LEFT + 30] = 2 * MOST
    # Bins that count no further.
    histogram[2, 3, LEFT + 20], histogram[5, 1, LEFT + 40] = 2 * MOST, 5 * MOST
    row, part, at = (np.repeat(v, histogram.ravel()) for v in np.indices(SHAPE).reshape(3, -1))
    order = np.lexsort((rng.random(len(row)), row // CELL_PX))
    votes = ((row % CELL_PX * PARTS + part) << BIN_BITS | at)[order].astype(np.uint32)
    starts = np.searchsorted(row // CELL_PX, np.arange(CELLS + 1))
    return votes, starts, histogram


def base_of(of_row: int, of_part: int, rows: int) -> np.ndarray:
    """Where the image of a row and part begins, so many rows in one."""
    row, part = np.divmod(np.arange(CELL_PX * PARTS), PARTS)
    return np.asarray(row // rows * of_row + part * of_part)


def by_rows(histogram: np.ndarray, rows: int) -> np.ndarray:
    """Sums of so many rows, each bin up to so many times `MOST`."""
    sums = histogram.reshape(ROWS // rows, rows, *histogram.shape[1:]).sum(axis=1)
    return np.asarray(np.minimum(sums, rows * MOST), np.float64)


def test_blocks_that_no_event_came_to_are_forgotten_too() -> None:
    store, placed = EventStore(0.004, STEEPEST), np.array([[0.001], [0.0], [0.0]], np.float32)
    events = EventArray.from_arrays([0], [0], [5], [1])
    store.add(placed, events, 0.0, 0, range(4))
    store.release_before(0)
    assert store.blocks == [0]
    store.release_before(3)
    assert store.blocks == []
    assert store.held == 0
    assert list(store._slots) == [3]


def test_events_vote_in_their_part_row_and_bin() -> None:
    rng = np.random.default_rng(3)
    n, pixel, shift, top, least, width = 5000, 4e-5, 0.001, -0.0002, -0.3, 0.07
    store = EventStore(0.004, STEEPEST)
    placed = np.stack(
        [rng.uniform(0, 0.004, n), rng.uniform(-0.0003, 0.0003, n), rng.uniform(-0.4, 0.4, n)]
    ).astype(np.float32)
    # A bin that counts no further.
    placed[:, :200] = [[0.000203], [3e-6], [0.01]]
    events = EventArray.from_arrays(*np.zeros((2, n), int), np.arange(n), np.ones(n, int))
    store.add(placed, events, 0.0, 0, [0])
    tiles = np.zeros(CELLS * TILES + 1, np.int32)
    votes, lines = np.empty(n, np.uint32), np.empty(n, np.uint16)
    pieces, pages, counts = store.chains(0, 1)
    assert counts.sum() == n
    _part_kernels._locate(
        store.records, store.link, (-shift - pieces, pages, counts),
        (top, pixel, store.piece_m, STEEPEST), least, width, (-0.35, np.inf), SHAPE, float(LEFT),
        np.empty(_event_kernels.PAGE, np.int32), votes, lines, tiles,
    )  # fmt: skip
    starts = np.cumsum([0, *tiles[:-1].reshape(CELLS, TILES).sum(axis=1)])
    np.testing.assert_array_equal(starts, np.cumsum([0, *np.bincount(lines)[:CELLS]]))
    ordered = np.empty(n, np.uint32)
    _part_kernels._sort(votes, lines, starts.copy(), ordered)
    np.testing.assert_array_equal(ordered, votes[np.argsort(lines, kind="stable")])
    # As they are kept: in the order of the store.
    kept = store.events(0, 1)
    x, y, slope = (v.astype(float) for v in (kept.x_m, kept.y_m, kept.slope))
    bins = np.floor((x + shift) / pixel * BINS_PX + LEFT).astype(int)
    rows = np.floor((y - top) / pixel + 0.5).astype(int)
    parts = np.clip(np.floor((slope - least) / width), 0, PARTS - 1).astype(int)
    inside = (bins < SHAPE[2]) & (rows >= 0) & (rows < ROWS) & (slope >= -0.35)
    expected = np.zeros(SHAPE)
    np.add.at(expected, (rows[inside], parts[inside], bins[inside]), 1)
    assert expected.max() > 2 * MOST
    image = np.zeros((CELL_PX, *SHAPE[1:]), np.uint8)
    base = base_of(PARTS * SHAPE[2], SHAPE[2], 1)
    for i in range(CELLS):
        _part_kernels._count(ordered, starts[i], starts[i + 1], base, 0, MOST, image.reshape(-1))
        own = np.minimum(expected[i * CELL_PX : (i + 1) * CELL_PX], MOST)
        # Rounding may put an event beside the edge of a bin.
        assert np.abs(image - own).sum() <= 10
        _part_kernels._forget(ordered, starts[i], starts[i + 1], base, 0, image.reshape(-1))
        assert not image.any()
    by_tile = np.zeros((CELLS, TILES))
    np.add.at(by_tile, (rows[inside] // CELL_PX, bins[inside] // TILE_BINS), 1)
    assert np.abs(tiles[:-1].reshape(by_tile.shape) - by_tile).sum() <= 10
    assert tiles.sum() == n


def test_tiles_are_searched_on_the_planes_of_the_cells_around() -> None:
    rng = np.random.default_rng(6)
    shape, around, planes = (9, 4 * TILE_CELLS - 1), 2, 20
    first = rng.integers(-3, 15, shape).astype(np.int32)
    last = np.where(rng.random(shape) < 0.8, -1, first + 5).astype(np.int32)
    reached = rng.random((shape[0], 4)) < 0.7
    own, tiles = np.empty((2, *reached.shape, 2), np.int32)
    _sharpness_kernels._tiles_around(first, last, reached, around, planes, own, tiles)
    for i, t in np.ndindex(reached.shape):
        near = (
            slice(max(i - around, 0), i + around + 1),
            slice(max(t * TILE_CELLS - around, 0), (t + 1) * TILE_CELLS + around),
        )
        some = last[near] >= 0
        if reached[i, t] and some.any():
            expected = [first[near][some].min(), last[near][some].max()]
        else:
            expected = [planes, -1]
        np.testing.assert_array_equal(tiles[i, t], expected)


def twin_sharpness(votes: np.ndarray, bins_px: int) -> np.ndarray:
    """Squared slopes of bins' votes, each shared by two columns, mean over phases."""
    one = np.ones(bins_px)
    triangle = np.convolve(one, one) / bins_px
    shared = np.apply_along_axis(np.convolve, -1, votes, triangle, mode="same")
    taps = np.zeros(4 * bins_px + 1)
    taps[[0, bins_px, 3 * bins_px, 4 * bins_px]] = 0.4, 1.0, -1.0, -0.4
    slope = np.apply_along_axis(np.convolve, -1, shared, taps, mode="same")
    return np.asarray(slope**2 / bins_px)


@pytest.mark.parametrize("crowded", [True, False])
@pytest.mark.parametrize(("groups", "pairs", "halve"), [(1, 2, 0), (4, 1, 0), (4, 1, 1)])
def test_sharpness_is_that_of_the_sum_of_shifted_parts(
    groups: int, pairs: int, halve: int, crowded: bool
) -> None:
    rng = np.random.default_rng(4)
    votes, starts, histogram = some_votes(rng, crowded)
    shifts = rng.integers(-20, 21, (6, PARTS)) >> halve
    cells = (ROWS // CELL_PX, (TILES - 2) * TILE_CELLS - 1)
    tiles = np.array([[[0, 5], [2, 3], [5, 4]], [[1, 4], [0, 5], [0, 5]]], np.int32)
    bins, left, bins_px = SHAPE[2] >> halve, LEFT >> halve, BINS_PX >> halve
    found = np.zeros((6, *cells), np.float32)
    kinds = (np.uint8, np.uint16, np.uint16)
    buffers = tuple(np.full(bins + TILE_BINS, 77, kind) for kind in kinds)
    pair = (PARTS + 1) * bins
    base = np.minimum(base_of(pair, bins, ROW_PX), pairs * pair)
    image = np.zeros(pairs * pair + bins, np.uint8)
    for begin in range(2):
        _sharpness_kernels._measure(
            votes, starts, base, (*SHAPE[:2], bins), left, halve, begin, cells[0], 2, groups,
            pairs, image, shifts, tiles, buffers, np.full(bins, 9.0, np.float32), found,
        )  # fmt: skip
    assert not image.any()
    merged = histogram.reshape(*histogram.shape[:2], bins, -1).sum(axis=-1)
    counted = by_rows(merged, ROW_PX)
    for k in range(6):
        moved = np.stack(
            [np.roll(counted[:, j], shifts[k, j], axis=-1) for j in range(PARTS)], axis=1
        )
        total = np.zeros((ROWS // CELL_PX, bins))
        for part in np.split(moved, groups, axis=1):
            two = part.sum(axis=1).reshape(CELLS, CELL_PX // ROW_PX, -1)
            total += twin_sharpness(two[:, :pairs], bins_px).sum(axis=1)
        own = total[:, left : -left or None].reshape(cells[0], -1, CELL_PX * bins_px).sum(-1)
        own = own[:, : cells[1]]
        looked_at = (tiles[..., 0] <= k) & (k <= tiles[..., 1])
        looked_at = np.repeat(looked_at, TILE_CELLS, axis=1)[:, : cells[1]]
        np.testing.assert_allclose(found[k], np.where(looked_at, own, 0), rtol=1e-4, atol=1e-4)


def test_whether_sums_of_parts_fit_a_byte_however_they_are_moved() -> None:
    image = np.zeros((2, PARTS + 1, 64), np.uint8)
    image[:, :PARTS] = np.random.default_rng(8).integers(0, 9, (2, PARTS, 64))
    shape, most = (ROWS, PARTS, 64), int(image[1, :PARTS].max(axis=1).sum())
    rest = most - int(image[1, 3].max())
    for value, fits in ((255 - rest, True), (256 - rest, False)):
        image[1, 3, 7] = value
        assert _sharpness_kernels._fit_byte(image.reshape(-1), shape, 2, 1) == fits
        assert _sharpness_kernels._fit_byte(image.reshape(-1), shape, 1, 1)
        assert _sharpness_kernels._fit_byte(image.reshape(-1), shape, 2, PARTS // 2)


@pytest.mark.parametrize("every", [1, 50])
def test_an_image_is_made_zero_again(every: int) -> None:
    votes, starts, _ = some_votes(np.random.default_rng(9))
    votes = votes[starts[0] : starts[1] : every]
    image = np.zeros(CELL_PX * PARTS * SHAPE[2], np.uint8)
    base = base_of(PARTS * SHAPE[2], SHAPE[2], 1)
    _part_kernels._count(votes, 0, len(votes), base, 0, MOST, image)
    assert image.any()
    _part_kernels._forget(votes, 0, len(votes), base, 0, image)
    assert not image.any()


def test_what_meets_a_surface_is_gathered_from_the_parts() -> None:
    rng = np.random.default_rng(5)
    votes, starts, histogram = some_votes(rng)
    slopes = np.linspace(-12, 15, PARTS)
    per_offset = (BINS_PX * slopes).astype(np.float32)
    cells = (ROWS // CELL_PX, (TILES - 2) * TILE_CELLS)
    offset = rng.uniform(-0.9, 0.9, cells).astype(np.float32)
    offset[0, 3], offset[1, 5] = np.nan, 1.5
    sums = np.zeros((*cells, 3), np.float32)
    spread = np.float32(0.7)
    _part_kernels._gather_slopes(
        votes, starts, base_of(0, SHAPE[2], 1), SHAPE, LEFT, offset, np.float32(1), per_offset,
        slopes.astype(np.float32), spread, np.zeros(PARTS * SHAPE[2], np.uint8),
        (np.empty(SHAPE[2], np.uint8), np.empty(SHAPE[2], np.uint16)), sums,
    )  # fmt: skip
    pixels = np.repeat(np.repeat(offset, CELL_PX, 0), CELL_PX, 1)
    seen = rng.random((cells[0], cells[1] // TILE_CELLS)) < 0.7
    support = np.zeros(pixels.shape, np.float32)
    width = pixels.shape[1]
    buffers = (
        np.empty(SHAPE[2], np.uint8), np.empty(width, np.float32), *np.empty((3, width), np.int32)
    )  # fmt: skip
    _part_kernels._gather(
        votes, starts, base_of(PARTS * SHAPE[2], SHAPE[2], 1), SHAPE, LEFT, pixels, np.float32(1),
        seen, per_offset, np.zeros(CELL_PX * PARTS * SHAPE[2], np.uint8), buffers, support,
    )  # fmt: skip
    of_rows, of_cells = by_rows(histogram, 1), by_rows(histogram, CELL_PX)
    expected, expected_sums = np.zeros(pixels.shape), np.zeros((*cells, 3))
    for y in range(pixels.shape[0]):
        for x in range(pixels.shape[1]):
            z = pixels[y, x]
            if not abs(z) <= 1:
                continue
            for part, slope in enumerate(slopes):
                at = LEFT + x * BINS_PX - int(np.rint(per_offset[part] * z))
                expected[y, x] += of_rows[y, part, at : at + BINS_PX].sum()
                if y % CELL_PX == 0:
                    count = of_cells[y // CELL_PX, part, at : at + BINS_PX].sum()
                    expected_sums[y // CELL_PX, x // CELL_PX] += (
                        count, count * slope, count * (slope**2 + spread),
                    )  # fmt: skip
    reached = np.repeat(np.repeat(seen, CELL_PX, 0), CELL_PX * TILE_CELLS, 1)
    np.testing.assert_array_equal(support, np.where(reached, expected, 0))
    np.testing.assert_allclose(sums, expected_sums, rtol=1e-4, atol=1e-2)


def test_parts_move_by_whole_bins_to_the_plane_that_was_asked_for() -> None:
    slopes = (np.arange(24) - 11.5) * 600.0
    at = np.linspace(-0.002, 0.002, 31)
    shifts = whole_shifts(slopes, at)
    wanted = np.outer(at, slopes) * BINS_PX
    assert np.abs(shifts - wanted).max() <= 1
    # The plane on which the parts lie: their regression on slope. Rounded one by one they err more.
    each = np.rint(wanted)
    error, plain = (np.abs((s / BINS_PX) @ slopes / (slopes @ slopes) - at) for s in (shifts, each))
    assert np.sqrt(np.mean(error**2)) < 0.6 * np.sqrt(np.mean(plain**2))
    assert np.sqrt(np.mean(error**2)) < 2e-6

"""How the surface sweep's events vote in parts and are gathered from these, by slow forms."""

import numpy as np
import pytest

from roller_core.events import EventArray
from roller_emvs.evidence import CELL_PX
from roller_emvs.methods.surface import _event_kernels, _part_kernels
from roller_emvs.methods.surface._part_kernels import BINS_PX, MOST, TILE_BINS, TILE_CELLS
from roller_emvs.methods.surface.event_store import EventStore
from roller_emvs.methods.surface.part_field import whole_shifts

from .part_votes import CELLS, LEFT, PARTS, ROWS, SHAPE, TILES, base_of, by_rows, some_votes

#: Largest slope of the stores.
STEEPEST = 0.5


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

"""Loops over images of aperture parts; each has a numpy twin in the tests.

Images are of a band of rows at a time, so that they stay in a core's cache; see `_band_kernels`
for the events that they are counts of.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ._band_kernels import BAND_ROWS, BINS, _count, _count_columns, _mark
from ._kernels import CELL_PX, ROW_PX, _add_cells, _add_slopes

#: Columns beyond the grid from which votes are taken, for slopes at its border.
EDGE_PX = 4
#: Most counts of a bin: of votes, four of which fit a byte; of support; and of a cell's rows.
MOST_VOTES, MOST_SUPPORT, MOST_OF_LINE = 63, 255, 65535
#: Columns of cells that are looked at or left out together, and the events in their reach below
#: which they are left out: a peak takes more (`sweep._SPOTS`).
TILE_CELLS, _LEAST_EVENTS = 8, 16


@njit(cache=True, nogil=True, error_model="numpy")
def _measure_bands(  # type: ignore[no-untyped-def]
    events, starts, base, sources, ranges, first, step, reach, images, sums, votes, line, columns,
    measure,
):  # fmt: skip
    """Sharpness of a polarity's votes on all planes, by cell, of every `step`-th band of rows.

    `starts`, shape (bands + 1,), is where a band's events begin; `base` places them, see `_count`.
    `sources` and `ranges` are those of `_moves`. `images`, shape (parts or up to three more, rows
    of votes, BINS, columns), `sums`, shape (BINS, columns), `columns`, shape (columns of images,),
    and `votes` are for use; the latter begin and end `EDGE_PX` columns beyond the grid. Events come
    to a column of the grid from `reach` columns of the images, first and beyond the last.
    `measure`, shape (planes, rows, columns) of cells, zero, receives the sum of squared slopes
    along x, but for tiles that hardly an event reaches.
    """
    rows, _ = votes.shape
    planes, cell_rows, cell_columns = measure.shape
    per_cell = CELL_PX // ROW_PX
    tiles = -(-cell_columns // TILE_CELLS)
    flat = images.reshape(-1)
    for band in range(first, len(starts) - 1, step):
        if starts[band + 1] - starts[band] < _LEAST_EVENTS:
            continue
        cell_row = band * rows // per_cell
        count = min(rows, (cell_rows - cell_row) * per_cell)
        _count_columns(events, starts[band], starts[band + 1], columns)
        tile = 0
        counted = False
        while tile < tiles:
            # Tiles side by side that count are looked at in one go.
            begin = tile * TILE_CELLS
            while tile < tiles and _reached(columns, tile, reach):
                tile += 1
            end = min(tile * TILE_CELLS, cell_columns)
            if begin >= end:
                tile += 1
                continue
            if not counted:
                counted = True
                flat[:] = 0
                _count(
                    events, starts[band], starts[band + 1], base, True, images.shape[3],
                    np.uint8(MOST_VOTES), flat,
                )  # fmt: skip
            left, right = begin * CELL_PX, end * CELL_PX + 2 * EDGE_PX
            for k in range(planes):
                for row in range(count):
                    _add_parts(images, sources[k], ranges[k], row, left, right, sums)
                    _share_bins(sums, row, left, right, votes)
                for r in range(count // per_cell):
                    _add_slopes(votes, r * per_cell, left + EDGE_PX, right - EDGE_PX, line)
                    _add_cells(line[EDGE_PX:], begin, end, measure[k, cell_row + r])


@njit(cache=True, nogil=True)
def _reached(columns, tile, reach):  # type: ignore[no-untyped-def]
    """Whether events enough can come to a tile; `columns` are how many each column has."""
    low = max(tile * TILE_CELLS * CELL_PX + reach[0], 0)
    high = min((tile + 1) * TILE_CELLS * CELL_PX + reach[1], len(columns))
    total = np.int64(0)
    for c in range(low, high):
        total += columns[c]
    return total >= _LEAST_EVENTS


@njit(cache=True, nogil=True)
def _add_parts(images, sources, ranges, row, left, right, sums):  # type: ignore[no-untyped-def]
    """Votes of a row on a plane, columns `left` to `right`: all parts' images, each moved."""
    flat = images.reshape(-1)
    out = sums.reshape(-1)
    bins, width = sums.shape
    below = np.uint64(row * bins * images.shape[3])
    for p in range(bins):
        for i in range(np.uint64(right - left)):
            out[np.uint64(p * width + left) + i] = 0
        for group in range(len(ranges)):
            first = max(ranges[group, 0], left)
            last = min(ranges[group, 1], right)
            if first >= last:
                continue
            start = below + np.uint64(first)
            a = np.uint64(sources[p, group, 0]) + start
            b = np.uint64(sources[p, group, 1]) + start
            c = np.uint64(sources[p, group, 2]) + start
            d = np.uint64(sources[p, group, 3]) + start
            at = np.uint64(p * width + first)
            for i in range(np.uint64(last - first)):
                four = np.uint8(flat[a + i] + flat[b + i] + flat[c + i] + flat[d + i])
                out[at + i] += np.uint16(four)


@njit(cache=True, nogil=True)
def _share_bins(sums, row, left, right, votes):  # type: ignore[no-untyped-def]
    """From bins to pixels: a bin counts for the two pixels beside it, by how near they are."""
    flat = sums.reshape(-1)
    out = votes.reshape(-1)
    to = np.uint64(row * votes.shape[1])
    far = np.float32(0.25)
    near = np.float32(0.75)
    second = np.uint64(sums.shape[1])
    one = np.uint64(1)
    for c in range(np.uint64(left + 1), np.uint64(right - 1)):
        beside = np.float32(flat[second + c - one]) + np.float32(flat[c + one])
        own = np.float32(flat[c]) + np.float32(flat[second + c])
        out[to + c] = near * own + far * beside


@njit(cache=True, nogil=True)
def _slope_sums(  # type: ignore[no-untyped-def]
    events, starts, base, offset, slopes, square, phase, left, lines, sums
):
    """Count events, and add up their slopes along x and squares, that meet the surface.

    `offset` is the surface on cells, NaN where unknown; `square` the mean square of a part's
    slopes. `lines`, shape (rows of cells of a band, parts, columns and three more), for use, begin
    `left` columns before the grid; `base` places the events of a band in them.
    """
    height, width = offset.shape
    _, parts, wide = lines.shape
    flat = lines.reshape(-1)
    last = wide - CELL_PX + 1
    for i in range(height):
        band = i // (BAND_ROWS // CELL_PX)
        own = i % (BAND_ROWS // CELL_PX)
        if own == 0:
            counted = starts[band] == starts[band + 1]
            empty = counted
        if empty:
            continue
        for c in range(width):
            z = offset[i, c]
            if np.isnan(z):
                continue
            if not counted:
                counted = True
                flat[:] = 0
                _count(
                    events, starts[band], starts[band + 1], base, True, 0,
                    np.uint16(MOST_OF_LINE), flat,
                )  # fmt: skip
            count = np.float32(0)
            slope = np.float32(0)
            squares = np.float32(0)
            for j in range(parts):
                moved = np.rint(slopes[j] * z - phase[j] / np.float32(BINS))
                at = np.int64(c * CELL_PX + left) - np.int64(moved)
                if 0 <= at < last:
                    total = np.int64(0)
                    for x in range(CELL_PX):
                        total += lines[own, j, at + x]
                    n = np.float32(total)
                    count += n
                    slope += n * slopes[j]
                    squares += n * square[j]
            sums[i, c, 0] = count
            sums[i, c, 1] = slope
            sums[i, c, 2] = squares


@njit(cache=True, nogil=True, error_model="numpy")
def _support(  # type: ignore[no-untyped-def]
    events, starts, base, spans, depth, slopes, phase, margin, buffers, images, support
):
    """Count events at the pixels where they meet the surface `depth` (NaN: unknown).

    `spans` holds the columns that each part saw, from and to. `buffers` are for use: of a row's
    pixels float32, float32, int32 and int32, of one pixel more int32, and of each part and row
    bool. `images`, shape (parts, BAND_ROWS, bins), the last two of which stay empty, are for use;
    `base` places the events of a band in them.
    """
    parts, rows, bins = images.shape
    height, width = depth.shape
    flat = images.reshape(-1)
    out = support.reshape(-1)
    nowhere = np.float32(bins - 2)
    top = np.float32(BINS * (width + 2 * margin))
    left = np.float32(BINS * margin + 0.5)
    per_px = np.float32(BINS)
    column, z, place, total, before, seen = buffers
    counted = -1
    for row in range(height):
        band = row // rows
        if starts[band] == starts[band + 1]:
            continue
        known = 0
        low = np.float32(np.inf)
        high = np.float32(-np.inf)
        for c in range(width):
            before[c] = known
            here = depth[row, c]
            if not np.isnan(here):
                column[known] = c
                z[known] = here
                total[known] = 0
                known += 1
                low = min(low, here)
                high = max(high, here)
        before[width] = known
        if not known:
            continue
        if counted != band:
            counted = band
            flat[:] = 0
            most = np.uint8(MOST_SUPPORT)
            _count(events, starts[band], starts[band + 1], base, False, 0, most, flat)
            _mark(events, starts[band], starts[band + 1], seen)
        for j in range(parts):
            if not seen[j * rows + row % rows]:
                continue
            slope = slopes[j]
            shift = phase[j] + left
            least = spans[j, 0] - margin + int(np.floor(min(slope * low, slope * high))) - 1
            most_right = spans[j, 1] - margin + int(np.ceil(max(slope * low, slope * high))) + 1
            first = np.uint64(before[min(max(least, 0), width)])
            last = np.uint64(before[min(max(most_right, 0), width)])
            own = np.uint64((j * rows + row % rows) * bins)
            for i in range(first, last):
                b = np.floor(per_px * (column[i] - slope * z[i]) + shift)
                place[i] = np.int32(b if (b >= 0) & (b < top) else nowhere)
            for i in range(first, last):
                at = own + np.uint64(place[i])
                total[i] += np.int32(flat[at]) + np.int32(flat[at + np.uint64(1)])
        to = np.uint64(row * width)
        for i in range(np.uint64(known)):
            out[to + np.uint64(column[i])] = np.float32(total[i])

"""Loops over images of aperture parts; each has a numpy twin in the tests.

Images are of a band of rows at a time, so that they stay in a core's cache; see `_band_kernels`
for the events that they are counts of.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ._band_kernels import (
    BAND_ROWS,
    BIN,
    BIN_BITS,
    BINS,
    KEYS,
    ROW_BITS,
    _count,
    _count_columns,
    _mark,
)  # fmt: skip
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
    events, starts, lines, shifts, reach, margin, first, step, images, sums, votes, line, columns,
    measure,
):  # fmt: skip
    """Sharpness of a polarity's votes on all planes, by cell, of every `step`-th band of rows.

    `starts`, shape (bands + 1,), is where a band's events begin, `margin` how many columns of
    images lie before the grid. `lines` and `shifts`, shape (planes, BINS, parts or up to three
    more), are those of `_moves`, columns at most `reach` from where they were. `images` and
    `sums`, flat, `columns`, shape (columns of images,), `line` and `votes` are for use; the latter
    two begin and end `EDGE_PX` columns beyond the grid. `measure`, shape (planes, rows, columns)
    of cells, zero, receives the sum of squared slopes along x, but for tiles that hardly an event
    reaches.
    """
    rows, _ = votes.shape
    planes, cell_rows, cell_columns = measure.shape
    per_cell = CELL_PX // ROW_PX
    tiles = -(-cell_columns // TILE_CELLS)
    for band in range(first, len(starts) - 1, step):
        if starts[band + 1] - starts[band] < _LEAST_EVENTS:
            continue
        cell_row = band * rows // per_cell
        count = min(rows, (cell_rows - cell_row) * per_cell)
        _count_columns(events, starts[band], starts[band + 1], columns)
        tile = 0
        while tile < tiles:
            # Tiles side by side that count are looked at in one go.
            begin = tile * TILE_CELLS
            while tile < tiles and _reached(columns, tile, margin, reach):
                tile += 1
            end = min(tile * TILE_CELLS, cell_columns)
            if begin >= end:
                tile += 1
                continue
            # Columns of votes, and of the images that come to them.
            left, width = begin * CELL_PX, (end - begin) * CELL_PX + 2 * EDGE_PX
            wide = width + 2 * reach
            origin = left + margin - EDGE_PX - reach
            own = images[: lines.shape[2] * BINS * rows * wide + reach]
            own[:] = 0
            _count_votes(events, starts[band], starts[band + 1], origin, wide, rows, own)
            for k in range(planes):
                _add_parts(own, lines[k], shifts[k], rows, wide, reach, sums)
                for row in range(count):
                    _share_bins(sums, row * wide, rows * wide, width, votes[row, left:])
                for r in range(count // per_cell):
                    low, high = left + EDGE_PX, left + width - EDGE_PX
                    _add_slopes(votes, r * per_cell, low, high, line)
                    _add_cells(line[EDGE_PX:], begin, end, measure[k, cell_row + r])


@njit(cache=True, nogil=True)
def _reached(columns, tile, margin, reach):  # type: ignore[no-untyped-def]
    """Whether events enough can come to a tile; `columns` are how many each column has."""
    beyond = reach + EDGE_PX - 1
    low = max(tile * TILE_CELLS * CELL_PX + margin - beyond, 0)
    high = min((tile + 1) * TILE_CELLS * CELL_PX + margin + beyond, len(columns))
    total = np.int64(0)
    for c in range(low, high):
        total += columns[c]
    return total >= _LEAST_EVENTS


@njit(cache=True, nogil=True)
def _count_votes(events, first, last, origin, wide, rows, images):  # type: ignore[no-untyped-def]
    """Count events from one to another in `wide` columns from `origin` on, `ROW_PX` rows in one.

    `images` are flat: by part, phase, row and column.
    """
    most, per_row = np.uint8(MOST_VOTES), np.uint32(ROW_PX)
    for i in range(np.uint64(first), np.uint64(last)):
        event = events[i]
        column = np.int32((event & np.uint32(BIN)) >> np.uint32(1)) - np.int32(origin)
        if 0 <= column < wide:
            key = (event >> np.uint32(BIN_BITS)) & np.uint32(KEYS - 1)
            image = (key >> np.uint32(ROW_BITS)) * np.uint32(BINS) + (event & np.uint32(1))
            row = (key & np.uint32(BAND_ROWS - 1)) // per_row
            at = np.uint64(image * np.uint32(rows) + row) * np.uint64(wide) + np.uint64(column)
            images[at] += images[at] < most


@njit(cache=True, nogil=True)
def _add_parts(images, lines, shifts, rows, wide, reach, sums):  # type: ignore[no-untyped-def]
    """Votes on a plane: all parts' images, each moved; all rows in one go, flat.

    `sums` hold phase, row and column, `wide` columns to a row, the last 2 · `reach` of which mean
    nothing. Eight parts at once, and where four are left over, those first.
    """
    bins, parts = lines.shape
    size = np.uint64(rows * wide)
    count = size - np.uint64(2 * reach)
    for p in range(bins):
        to = np.uint64(p) * size
        if parts & 4:
            a, b, c, d = _begins(lines[p], shifts[p], 0, size, reach)
            for i in range(count):
                sums[to + i] = np.uint8(
                    images[a + i] + images[b + i] + images[c + i] + images[d + i]
                )
        else:
            for i in range(count):
                sums[to + i] = 0
        for n in range(parts & 4, parts, 8):
            a, b, c, d = _begins(lines[p], shifts[p], n, size, reach)
            e, f, g, h = _begins(lines[p], shifts[p], n + 4, size, reach)
            for i in range(count):
                four = np.uint8(images[a + i] + images[b + i] + images[c + i] + images[d + i])
                more = np.uint8(images[e + i] + images[f + i] + images[g + i] + images[h + i])
                sums[to + i] += np.uint16(four) + np.uint16(more)


@njit(cache=True, nogil=True)
def _begins(lines, shifts, n, size, reach):  # type: ignore[no-untyped-def]
    """Where four parts' images begin, each moved."""
    a = np.uint64(lines[n]) * size + np.uint64(reach + shifts[n])
    b = np.uint64(lines[n + 1]) * size + np.uint64(reach + shifts[n + 1])
    c = np.uint64(lines[n + 2]) * size + np.uint64(reach + shifts[n + 2])
    d = np.uint64(lines[n + 3]) * size + np.uint64(reach + shifts[n + 3])
    return a, b, c, d


@njit(cache=True, nogil=True)
def _share_bins(sums, first, apart, width, votes):  # type: ignore[no-untyped-def]
    """From bins to pixels: a bin counts for the two pixels beside it, by how near they are.

    A row of either phase begins at `first` of `sums` and `apart` further on.
    """
    far = np.float32(0.25)
    near = np.float32(0.75)
    one = np.uint64(1)
    a = np.uint64(first)
    b = np.uint64(first + apart)
    for c in range(one, np.uint64(width - 1)):
        beside = np.float32(sums[b + c - one]) + np.float32(sums[a + c + one])
        own = np.float32(sums[a + c]) + np.float32(sums[b + c])
        votes[c] = near * own + far * beside


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
                    events, starts[band], starts[band + 1], base, True,
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
    pixels float32 and float32, int32 for each of four parts, and int32, of one pixel more int32,
    and of each part and row bool. `images`, shape (parts, BAND_ROWS, bins), the last two of which
    stay empty, are for use; `base` places the events of a band in them.
    """
    parts, rows, bins = images.shape
    height, width = depth.shape
    flat = images.reshape(-1)
    out = support.reshape(-1)
    top = np.float32(BINS * (width + 2 * margin))
    left = np.float32(BINS * margin + 0.5)
    column, z, places, total, before, seen = buffers
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
            _count(events, starts[band], starts[band + 1], base, False, most, flat)
            _mark(events, starts[band], starts[band + 1], seen)
        for n in range(0, parts, 4):
            # Four at once: a pixel's sum is then loaded and stored a quarter as often.
            least, beyond = width, 0
            for j in range(n, min(n + 4, parts)):
                if seen[j * rows + row % rows]:
                    a, b = slopes[j] * low, slopes[j] * high
                    least = min(least, spans[j, 0] + int(np.floor(min(a, b))))
                    beyond = max(beyond, spans[j, 1] + int(np.ceil(max(a, b))))
            first = np.uint64(before[min(max(least - margin - 1, 0), width)])
            last = np.uint64(before[min(max(beyond - margin + 1, 0), width)])
            if first >= last:
                continue
            for j in range(4):
                own = min(n + j, parts - 1)
                begin = np.int32((own * rows + row % rows) * bins)
                right = top if n + j < parts else np.float32(0)
                _meet_bins(
                    column, z, first, last, slopes[own], phase[own] + left, right,
                    np.float32(bins - 2), begin, places[j],
                )  # fmt: skip
            _add_bins(flat, places, first, last, total)
        to = np.uint64(row * width)
        for i in range(np.uint64(known)):
            out[to + np.uint64(column[i])] = np.float32(total[i])


@njit(cache=True, nogil=True, error_model="numpy")
def _meet_bins(column, z, first, last, slope, shift, right, nowhere, begin, place):  # type: ignore[no-untyped-def]
    """First of the two bins of a part's image that meet each pixel's surface, from `begin` on."""
    per_px = np.float32(BINS)
    for i in range(first, last):
        b = np.floor(per_px * (column[i] - slope * z[i]) + shift)
        place[i] = np.int32(b if (b >= 0) & (b < right) else nowhere) + begin


@njit(cache=True, nogil=True)
def _add_bins(images, places, first, last, total):  # type: ignore[no-untyped-def]
    """Add two bins each of four images, flat."""
    one = np.uint64(1)
    p, q, r, s = places[0], places[1], places[2], places[3]
    for i in range(first, last):
        a = np.uint64(p[i])
        b = np.uint64(q[i])
        c = np.uint64(r[i])
        d = np.uint64(s[i])
        two = np.int32(images[a]) + np.int32(images[a + one])
        two += np.int32(images[b]) + np.int32(images[b + one])
        more = np.int32(images[c]) + np.int32(images[c + one])
        more += np.int32(images[d]) + np.int32(images[d + one])
        total[i] += two + more

"""Loops over histograms of aperture parts; each has a numpy twin in the tests.

A histogram is `counts`, flat, of rows, parts and bins; the place on a plane of what lies in a bin
is that bin further on by the part's shift. One entry beyond the end takes what goes nowhere.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_emvs.evidence import CELL_PX

from ._event_kernels import PAGE

#: Bins to a pixel.
BINS_PX = 4
#: Bins to a cell, and rows and bins to a tile that is looked at or left out as one.
CELL_BINS = CELL_PX * BINS_PX
TILE_CELLS = 4
TILE_BINS = TILE_CELLS * CELL_BINS
#: A bin counts no further, so that eight of them fit a byte.
MOST = 31
#: Bins before what is looked at that its slopes take in, and how many more are summed in all.
SIDE, _BESIDE = 11, 32
#: Bins that are summed in one go.
_CHUNK = np.uint64(32)
#: Rows to one row of votes.
ROW_PX = 2
#: The taps of the slope, 1 and 0.4, are 5 and 2 here, a vote in a column's middle counts 4, and
#: there are four phases to a pixel.
_SCALE = np.float32(1.0 / (4 * 20 * 20))


@njit(cache=True, nogil=True, error_model="numpy")
def _count(  # type: ignore[no-untyped-def]
    records, link, page, total, shift, pixel, top, least, width, shape, left, place, keep, counts,
    tiles,
):  # fmt: skip
    """Count a chain of events, x `shift` further on, in their part, row and bin.

    Unless told to `keep` them the bins become zero.

    `left` is the bin of x = 0; rows begin half a pixel before `top`. Parts are `width` wide in
    slope from `least` on; slopes beyond them go to the end parts. `tiles`, flat, of rows of cells
    and tiles, counts events too, those that go nowhere in its last entry. `place`, shape
    (2, PAGE), is a buffer.
    """
    rows, parts, bins = shape
    per_bin = np.float32(BINS_PX / pixel)
    per_row = np.float32(1.0 / pixel)
    x0 = np.float32(shift * per_bin + left)
    y0 = np.float32(0.5 - top * per_row)
    per_part = np.float32(1.0 / width)
    s0 = np.float32(-least / width)
    last = np.float32(parts - 1)
    zero = np.float32(0)
    right, below = np.float32(bins), np.float32(rows)
    nowhere, no_tile = np.int32(parts * rows * bins), np.int32(len(tiles) - 1)
    many, wide, line = np.int32(parts), np.int32(bins), np.int32(bins // TILE_BINS)
    times = np.uint8(keep)
    n = 0
    while page >= 0:
        size = np.uint64(min(PAGE, total - n))
        x, y, slope = records[page, 0], records[page, 1], records[page, 2]
        for i in range(size):
            a = x[i] * per_bin + x0
            b = y[i] * per_row + y0
            part = np.int32(min(max(slope[i] * per_part + s0, zero), last))
            inside = (a >= zero) & (a < right) & (b >= zero) & (b < below)
            row, column = np.int32(b), np.int32(a)
            at = (row * many + part) * wide + column
            tile = (row // np.int32(CELL_PX)) * line + column // np.int32(TILE_BINS)
            place[0, i] = at if inside else nowhere
            place[1, i] = tile if inside else no_tile
        for i in range(size):
            found = np.uint64(place[0, i])
            was = counts[found]
            counts[found] = (was + np.uint8(was < MOST)) * times
            tiles[np.uint64(place[1, i])] += np.int32(1)
        n += PAGE
        page = link[page]


@njit(cache=True, nogil=True, error_model="numpy")
def _add_parts(counts, shape, row, first, last, start, shifts, size, total):  # type: ignore[no-untyped-def]
    """Votes of a pair of rows on a plane: the sum of parts first to last, each at its shift.

    `start` is the bin on the plane of `total[0]`. The number of parts must be even, `size` so many
    chunks. Loops of a fixed length become vector instructions, with nothing left over.
    """
    _, parts, bins = shape
    chunks = np.uint64(size) // _CHUNK
    for i in range(np.uint64(size)):
        total[i] = 0
    for j in range(first, last, 2):
        a = np.uint64((row * parts + j) * bins + start - shifts[j])
        b = np.uint64((row * parts + j + 1) * bins + start - shifts[j + 1])
        c = a + np.uint64(parts * bins)
        d = b + np.uint64(parts * bins)
        for k in range(chunks):
            begin = k * _CHUNK
            for i in range(_CHUNK):
                at = begin + i
                four = np.uint8(counts[a + at] + counts[b + at] + counts[c + at] + counts[d + at])
                total[at] += np.uint16(four)


@njit(cache=True, nogil=True, error_model="numpy")
def _measure(  # type: ignore[no-untyped-def]
    counts, shape, left, begin, end, step, groups, pairs, shifts, tiles, total, sums, line, measure
):
    """Sharpness of the votes by plane and cell, of every `step`-th row of cells from `begin` on.

    The parts are summed in so many `groups`, of which each adds its own sharpness, of the first
    `pairs` of a cell's rows. `shifts`, shape (planes, parts), are of whole bins; `left` is the bin
    of the first cell. `tiles`, shape (rows of cells, tiles, 2), holds the first and last plane on
    which each counts. `measure`, shape (planes, rows, columns) of cells, is added to.
    """
    planes, _, cell_columns = measure.shape
    count = tiles.shape[1]
    own = shape[1] // groups
    for row in range(begin, end, step):
        low = planes
        high = -1
        for t in range(count):
            low = min(low, max(tiles[row, t, 0], 0))
            high = max(high, min(tiles[row, t, 1], planes - 1))
        for k in range(low, high + 1):
            t = 0
            while t < count:
                first = t
                while t < count and tiles[row, t, 0] <= k <= tiles[row, t, 1]:
                    t += 1
                if first == t:
                    t += 1
                    continue
                begin_cell = first * TILE_CELLS
                end_cell = min(t * TILE_CELLS, cell_columns)
                width = (t - first) * TILE_BINS
                start = left + begin_cell * CELL_BINS - SIDE
                for g in range(groups):
                    for pair in range(pairs):
                        _add_parts(
                            counts, shape, row * CELL_PX + pair * ROW_PX, g * own,
                            (g + 1) * own, start, shifts[k], width + _BESIDE, total,
                        )  # fmt: skip
                        _add_slopes(total, width, sums, line, g + pair)
                for cell in range(begin_cell, end_cell):
                    at = np.uint64((cell - begin_cell) * CELL_BINS)
                    found = np.float32(0)
                    for i in range(np.uint64(CELL_BINS)):
                        found += line[at + i]
                    measure[k, row, cell] += found * _SCALE


@njit(cache=True, nogil=True, error_model="numpy")
def _add_slopes(total, width, sums, line, before):  # type: ignore[no-untyped-def]
    """Squared slopes along x of votes shared by two columns, at every bin; see `_SCALE`.

    Four bins and four again give each vote the triangle that its share of two columns is. `total`
    begins `SIDE` bins before. `line` is added to if there is something `before`; `width` must be
    so many chunks.
    """
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    chunks = np.uint64(width + _BESIDE) // _CHUNK
    for k in range(chunks):
        begin = k * _CHUNK
        for i in range(_CHUNK):
            at = begin + i
            sums[at] = total[at] + total[at + one] + total[at + two] + total[at + three]
    for k in range(chunks):
        begin = k * _CHUNK
        for i in range(_CHUNK):
            at = begin + i
            total[at] = sums[at] + sums[at + one] + sums[at + two] + sums[at + three]
    for k in range(np.uint64(width) // _CHUNK):
        begin = k * _CHUNK
        for i in range(_CHUNK):
            at = begin + i
            far = np.int32(total[at + np.uint64(16)]) - np.int32(total[at])
            near = np.int32(total[at + np.uint64(12)]) - np.int32(total[at + np.uint64(4)])
            slope = np.float32(np.int32(2) * far + np.int32(5) * near)
            line[at] = (line[at] if before else np.float32(0)) + slope * slope


@njit(cache=True, nogil=True, error_model="numpy")
def _gather_slopes(  # type: ignore[no-untyped-def]
    counts, shape, left, offset, most, per_offset, middles, spread, sums
):
    """Events of each cell where its surface is: their count, slopes and squares.

    `offset` is the surface on cells, NaN where unknown, looked at up to `most`. `middles` are the
    slopes of the parts, `per_offset` their bins by unit of offset, `spread` the variance of slopes
    within a part.
    """
    _, parts, bins = shape
    height, width = offset.shape
    line = np.uint64(parts * bins)
    two, three = np.uint64(2) * line, np.uint64(3) * line
    for i in range(height):
        for j in range(width):
            z = offset[i, j]
            # Written so that NaN fails it.
            if not abs(z) <= most:
                continue
            count = np.float32(0)
            slope = np.float32(0)
            square = np.float32(0)
            for part in range(parts):
                shift = np.int64(np.rint(per_offset[part] * z))
                at = np.uint64((i * CELL_PX * parts + part) * bins + left + j * CELL_BINS - shift)
                n = np.uint32(0)
                for b in range(np.uint64(CELL_BINS)):
                    four = counts[at + b] + counts[at + line + b]
                    four += counts[at + two + b] + counts[at + three + b]
                    n += np.uint32(np.uint8(four))
                if n:
                    s = middles[part]
                    count += np.float32(n)
                    slope += np.float32(n) * s
                    square += np.float32(n) * (s * s + spread)
            sums[i, j, 0] = count
            sums[i, j, 1] = slope
            sums[i, j, 2] = square


@njit(cache=True, nogil=True, error_model="numpy")
def _gather(counts, shape, left, offset, most, seen, per_offset, support):  # type: ignore[no-untyped-def]
    """Events of each pixel where its surface is; of tiles of cells that are not `seen` none.

    `offset` is the surface by pixel, NaN where unknown, looked at up to `most`.
    """
    _, parts, bins = shape
    height, width = offset.shape
    one = np.uint64(1)
    for y in range(height):
        for cell in range(width // CELL_PX):
            if not seen[y // CELL_PX, cell // TILE_CELLS]:
                continue
            for x in range(cell * CELL_PX, (cell + 1) * CELL_PX):
                z = offset[y, x]
                if not abs(z) <= most:
                    continue
                n = np.uint32(0)
                for part in range(parts):
                    shift = np.int64(np.rint(per_offset[part] * z))
                    at = np.uint64((y * parts + part) * bins + left + x * BINS_PX - shift)
                    n += (
                        np.uint32(counts[at])
                        + np.uint32(counts[at + one])
                        + np.uint32(counts[at + np.uint64(2)])
                        + np.uint32(counts[at + np.uint64(3)])
                    )
                support[y, x] = np.float32(n)

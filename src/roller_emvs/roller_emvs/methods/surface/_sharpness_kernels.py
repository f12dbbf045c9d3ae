"""Loops over sums of aperture parts for how sharp they are; each has a numpy twin in the tests.

A plane of votes is the sum of the parts' images, see `_part_kernels`, each moved by whole bins.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ._part_kernels import CELL_BINS, MOST, ROW_PX, TILE_BINS, TILE_CELLS, _count, _forget

#: Bins before what is looked at that its slopes take in, of a quarter and of half a pixel, and how
#: many more are summed in all.
SIDE, HALF_SIDE, _BESIDE = 11, 5, 32
#: Votes of all parts in a bin at most: sixteen times as many, as slopes are of, fit 16 bits.
_MOST_TOTAL = 32767 // 16
#: Bins that are summed in one go.
_CHUNK = np.uint64(32)
#: The taps of the slope, 1 and 0.4, are 5 and 2 here. Of quarters a vote in a column's middle
#: counts 4, and there are four phases to a pixel; of halves two and two.
_SCALE, _HALF_SCALE = np.float32(1.0 / (4 * 20 * 20)), np.float32(1.0 / (2 * 10 * 10))


@njit(cache=True, nogil=True, error_model="numpy")
def _add_parts(pairs, shape, pair, first, last, start, shifts, size, total):  # type: ignore[no-untyped-def]
    """Votes of a pair of rows on a plane: the sum of parts first to last, each at its shift.

    `start` is the bin on the plane of `total[0]`, which is of bytes where no sum exceeds one, see
    `_fit_byte`, else of 16 bits. The number of parts must be even, `size` so many chunks. Loops of
    a fixed length become vector instructions, with nothing left over.
    """
    _, parts, bins = shape
    chunks, whole = np.uint64(size) // _CHUNK, total.dtype.type
    top = pair * (parts + 1)
    nothing = np.uint64((top + parts) * bins + start)
    for j in range(first, last, 4):
        a = np.uint64((top + j) * bins + start - shifts[j])
        b = np.uint64((top + j + 1) * bins + start - shifts[j + 1])
        more = j + 2 < last
        c = np.uint64((top + j + 2) * bins + start - shifts[j + 2]) if more else nothing
        d = np.uint64((top + j + 3) * bins + start - shifts[j + 3]) if more else nothing
        for k in range(chunks):
            begin = k * _CHUNK
            for i in range(_CHUNK):
                at = begin + i
                four = np.uint8(pairs[a + at] + pairs[b + at] + pairs[c + at] + pairs[d + at])
                total[at] = whole((total[at] if j > first else whole(0)) + whole(four))


@njit(cache=True, nogil=True, error_model="numpy")
def _fit_byte(pairs, shape, looks, groups):  # type: ignore[no-untyped-def]
    """Whether the sums of a group's parts fit a byte, wherever these are moved."""
    _, parts, bins = shape
    own = parts // groups
    for first in range(0, parts, own):
        for pair in range(looks):
            total = np.int64(0)
            for j in range(first, first + own):
                at = np.uint64((pair * (parts + 1) + j) * bins)
                most = np.uint8(0)
                for i in range(np.uint64(bins)):
                    votes = pairs[at + i]
                    most = votes if votes > most else most
                total += np.int64(most)
            if total > 255:
                return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _measure(  # type: ignore[no-untyped-def]
    votes, starts, base, shape, left, halve, begin, end, step, groups, looks, pairs, shifts, tiles,
    buffers, line, measure
):  # fmt: skip
    """Sharpness of the votes by plane and cell, of every `step`-th row of cells from `begin` on.

    Rows of cells begin in `votes` at `starts`. The parts are summed in so many `groups`, of which
    each adds its own sharpness. So many of a cell's pairs of rows are looked at; `pairs`, zero and
    flat, is the image of pairs, parts and one more that stays zero, and bins, at the places of
    `base`; the rows of others may count behind it. `shifts`, shape (planes, parts), are of whole
    bins; `left` is the bin of the first cell. If `halve` is 1, bins are half a pixel in place of a
    quarter. `tiles`, shape (rows of cells, tiles, 2), holds the
    first and last plane on which each counts. `buffers`, of bins uint8 and twice uint16, and `line`
    are for use. `measure`, shape (planes, rows, columns) of cells, is added to.
    """
    planes, _, cell_columns = measure.shape
    count = tiles.shape[1]
    _, parts, _ = shape
    own = parts // groups
    most = min(ROW_PX * MOST, _MOST_TOTAL // parts)
    cell_bins, tile_bins = CELL_BINS >> halve, TILE_BINS >> halve
    side = HALF_SIDE if halve else SIDE
    eight, total, sums = buffers
    for row in range(begin, end, step):
        low = planes
        high = -1
        for t in range(count):
            if max(tiles[row, t, 0], 0) <= min(tiles[row, t, 1], planes - 1):
                low = min(low, max(tiles[row, t, 0], 0))
                high = max(high, min(tiles[row, t, 1], planes - 1))
        if high < 0:
            continue
        _count(votes, starts[row], starts[row + 1], base, halve, most, pairs)
        few = _fit_byte(pairs, shape, looks, groups)
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
                width = (t - first) * tile_bins
                start = left + begin_cell * cell_bins - side
                for g in range(groups):
                    for pair in range(looks):
                        if few:
                            _add_parts(
                                pairs, shape, pair, g * own, (g + 1) * own, start, shifts[k],
                                width + _BESIDE, eight,
                            )  # fmt: skip
                            _sum_bins(eight, width + _BESIDE, halve, sums)
                        else:
                            _add_parts(
                                pairs, shape, pair, g * own, (g + 1) * own, start, shifts[k],
                                width + _BESIDE, total,
                            )  # fmt: skip
                            _sum_bins(total, width + _BESIDE, halve, sums)
                        if halve:
                            _add_half_slopes(sums, width, line, g + pair)
                        else:
                            _add_slopes(sums, width, total, line, g + pair)
                of_cells = measure[k, row, begin_cell:end_cell]
                if halve:
                    _add_half_cells(line, _HALF_SCALE, of_cells)
                else:
                    _add_cells(line, _SCALE, of_cells)
        _forget(votes, starts[row], starts[row + 1], base, halve, pairs)


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_bins(votes, size, halve, sums):  # type: ignore[no-untyped-def]
    """Sums of four bins from each on; of bins of half a pixel, of two and two again."""
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    chunks = np.uint64(size) // _CHUNK
    if halve:
        for k in range(chunks):
            begin = k * _CHUNK
            for i in range(_CHUNK):
                at = begin + i
                middle = np.uint16(votes[at + one])
                sums[at] = np.uint16(votes[at]) + middle + middle + np.uint16(votes[at + two])
    else:
        for k in range(chunks):
            begin = k * _CHUNK
            for i in range(_CHUNK):
                at = begin + i
                left = np.uint16(votes[at]) + np.uint16(votes[at + one])
                sums[at] = left + np.uint16(votes[at + two]) + np.uint16(votes[at + three])


@njit(cache=True, nogil=True, error_model="numpy")
def _add_slopes(sums, width, total, line, before):  # type: ignore[no-untyped-def]
    """Squared slopes along x of votes shared by two columns, at every bin; see `_SCALE`.

    Four bins, which `sums` are of, and four again, which `total` takes, give each vote the triangle
    that its share of two columns is. `sums` begin `SIDE` bins before. `line` is added to if there
    is something `before`; `width` must be so many chunks. Differences are of 16 bits: half as many
    instructions as of 32. What they are summed to is told to be of 32: else it would be of 64.
    """
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    for k in range(np.uint64(width + _BESIDE) // _CHUNK):
        begin = k * _CHUNK
        for i in range(_CHUNK):
            at = begin + i
            total[at] = sums[at] + sums[at + one] + sums[at + two] + sums[at + three]
    for k in range(np.uint64(width) // _CHUNK):
        begin = k * _CHUNK
        for i in range(_CHUNK):
            at = begin + i
            far = np.int16(total[at + np.uint64(16)] - total[at])
            near = np.int16(total[at + np.uint64(12)] - total[at + np.uint64(4)])
            both = np.int32(np.int32(2) * np.int32(far) + np.int32(5) * np.int32(near))
            slope = np.float32(both)
            line[at] = (line[at] if before else np.float32(0)) + slope * slope


@njit(cache=True, nogil=True, error_model="numpy")
def _add_half_slopes(sums, width, line, before):  # type: ignore[no-untyped-def]
    """`_add_slopes` of bins of half a pixel: two and two again are a vote's triangle."""
    two = np.uint64(2)
    for k in range(np.uint64(width) // _CHUNK):
        begin = k * _CHUNK
        for i in range(_CHUNK):
            at = begin + i
            far = np.int16(sums[at + np.uint64(8)] - sums[at])
            near = np.int16(sums[at + np.uint64(6)] - sums[at + two])
            both = np.int32(np.int32(2) * np.int32(far) + np.int32(5) * np.int32(near))
            slope = np.float32(both)
            line[at] = (line[at] if before else np.float32(0)) + slope * slope


@njit(cache=True, nogil=True, fastmath={"reassoc", "nsz"})
def _add_cells(line, scale, measure):  # type: ignore[no-untyped-def]
    """Add the sum of each cell's bins of a quarter pixel."""
    for cell in range(len(measure)):
        at = np.uint64(cell * CELL_BINS)
        found = np.float32(0)
        for i in range(np.uint64(CELL_BINS)):
            found += line[at + i]
        measure[cell] += found * scale


@njit(cache=True, nogil=True, fastmath={"reassoc", "nsz"})
def _add_half_cells(line, scale, measure):  # type: ignore[no-untyped-def]
    """`_add_cells` of bins of half a pixel."""
    for cell in range(len(measure)):
        at = np.uint64(cell * (CELL_BINS // 2))
        found = np.float32(0)
        for i in range(np.uint64(CELL_BINS // 2)):
            found += line[at + i]
        measure[cell] += found * scale


@njit(cache=True, nogil=True)
def _tiles_around(first, last, reached, around, planes, own, tiles):  # type: ignore[no-untyped-def]
    """First and last plane that the cells of each tile and those `around` are searched on.

    `first` and `last` are by cell, none is searched where `last` is negative. `tiles`, shape (rows
    of cells, tiles, 2), is of no plane where a tile isn't `reached`. `own`, of the same shape, is
    for use: what the cells of a row ask for in that row.
    """
    height, width = first.shape
    count = tiles.shape[1]
    own[:, :, 0], own[:, :, 1] = planes, -1
    for i in range(height):
        for j in range(width):
            if last[i, j] >= 0:
                left, right = max(j - around, 0), min(j + around, width - 1)
                for t in range(left // TILE_CELLS, right // TILE_CELLS + 1):
                    own[i, t, 0] = min(own[i, t, 0], first[i, j])
                    own[i, t, 1] = max(own[i, t, 1], last[i, j])
    for i in range(height):
        for t in range(count):
            tiles[i, t, 0], tiles[i, t, 1] = planes, -1
            if reached[i, t]:
                for row in range(max(i - around, 0), min(i + around + 1, height)):
                    tiles[i, t, 0] = min(tiles[i, t, 0], own[row, t, 0])
                    tiles[i, t, 1] = max(tiles[i, t, 1], own[row, t, 1])

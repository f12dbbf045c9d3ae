"""Loops over images of aperture parts; each has a numpy twin in the tests.

An event is a number, a vote: the row in its row of cells and its part above `BIN_BITS`, and its
bin. Images are of a row of cells at a time, so that they stay in a core's cache: of its rows, or of
sums of them, and of parts and bins. The place on a plane of what lies in a bin is that bin further
on by the part's shift.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_emvs.evidence import CELL_PX

from ._event_kernels import PAGE, _scales

#: Bins to a pixel.
BINS_PX = 4
#: Bins to a cell, and rows and bins to a tile that is looked at or left out as one.
CELL_BINS = CELL_PX * BINS_PX
TILE_CELLS = 4
TILE_BINS = TILE_CELLS * CELL_BINS
#: A bin of a row counts no further, so that eight of them fit a byte; one of two rows and one of
#: four so many times as far.
MOST = 31
#: Bits of a vote's bin.
BIN_BITS = 20
_BIN = (1 << BIN_BITS) - 1
#: Rows to one row of votes.
ROW_PX = 2
#: Bytes that are made zero in the time that one at a vote's place takes.
_AT_ONCE = 64


@njit(cache=True, nogil=True, error_model="numpy")
def _locate(  # type: ignore[no-untyped-def]
    records, link, chains, scales, least, width, ends, shape, left, tile, votes, lines, tiles
):
    """Where chains of events vote; `chains` and `scales` as of `_ray_kernels._rays`.

    `left` is the bin of x = 0; rows begin half a pixel before `top`. Parts are `width` wide in
    slope from `least` on; slopes beyond them go to the end parts, those beyond `ends` nowhere.
    `votes` and `lines`, shape (events,), take each event's vote and row of cells, one beyond the
    last for what goes nowhere. `tiles`, flat, of rows of cells and tiles, counts events too, those
    that go nowhere in its last entry. `tile`, shape (PAGE,), is a buffer.
    """
    rows, parts, bins = shape
    begins, pages, counts = chains
    top, pixel, piece_m, steepest = scales
    per_bin = np.float32(BINS_PX / pixel)
    per_x, first_x, per_slope, first_slope = _scales(piece_m, steepest)
    per_row = np.float32(1.0 / pixel)
    y0 = np.float32(0.5 - top * per_row)
    per_part = np.float32(1.0 / width)
    s0 = np.float32(-least / width)
    last = np.float32(parts - 1)
    zero = np.float32(0)
    right, below = np.float32(bins), np.float32(rows)
    first, final = np.float32(ends[0]), np.float32(ends[1])
    nowhere, no_tile = np.uint16(rows // CELL_PX), np.int32(len(tiles) - 1)
    many, tiles_of_row = np.int32(parts), np.int32(bins // TILE_BINS)
    done = 0
    for chain in range(len(pages)):
        page, n = pages[chain], 0
        x0 = np.float32(left + (first_x - begins[chain]) * per_bin)
        while page >= 0:
            size = np.uint64(min(PAGE, counts[chain] - n))
            x, slope, y = records[0][page, 0], records[0][page, 1], records[1][page]
            own, line_of = votes[done + n :], lines[done + n :]
            for i in range(size):
                a = np.float32(x[i]) * (per_x * per_bin) + x0
                b = y[i] * per_row + y0
                s = first_slope + np.float32(slope[i]) * per_slope
                part = np.int32(min(max(s * per_part + s0, zero), last))
                inside = (a >= zero) & (a < right) & (b >= zero) & (b < below)
                inside &= (s >= first) & (s <= final)
                row, column = np.int32(b), np.int32(a)
                line = row // np.int32(CELL_PX)
                key = (row - line * np.int32(CELL_PX)) * many + part
                own[i] = np.uint32((key << np.int32(BIN_BITS)) | column)
                line_of[i] = np.uint16(line) if inside else nowhere
                tile[i] = line * tiles_of_row + column // np.int32(TILE_BINS) if inside else no_tile
            for i in range(size):
                tiles[np.uint64(tile[i])] += np.int32(1)
            n += PAGE
            page = link[page]
        done += counts[chain]


@njit(cache=True, nogil=True)
def _sort(votes, lines, place, out):  # type: ignore[no-untyped-def]
    """Write votes at the place of their row of cells, which moves on."""
    for i in range(np.uint64(len(votes))):
        line = np.uint64(lines[i])
        out[np.uint64(place[line])] = votes[i]
        place[line] += 1


@njit(cache=True, nogil=True)
def _count(votes, first, last, base, halve, most, image):  # type: ignore[no-untyped-def]
    """Count votes from one to another up to `most` in an image, flat.

    `base`, shape (rows of a cell · parts,), is where what holds a row and part begins; of its bins
    `halve` times two are one.
    """
    by = np.uint32(halve)
    for i in range(np.uint64(first), np.uint64(last)):
        vote = votes[i]
        key = np.uint64(vote >> np.uint32(BIN_BITS))
        at = np.uint64(base[key]) + np.uint64((vote & np.uint32(_BIN)) >> by)
        image[at] += np.uint8(image[at] < most)


@njit(cache=True, nogil=True)
def _forget(votes, first, last, base, halve, image):  # type: ignore[no-untyped-def]
    """Make an image zero again: by its votes, or as a whole where these are many."""
    if (last - first) * _AT_ONCE > len(image):
        image[:] = 0
        return
    by = np.uint32(halve)
    for i in range(np.uint64(first), np.uint64(last)):
        vote = votes[i]
        key = np.uint64(vote >> np.uint32(BIN_BITS))
        image[np.uint64(base[key]) + np.uint64((vote & np.uint32(_BIN)) >> by)] = 0


@njit(cache=True, nogil=True, error_model="numpy")
def _gather_slopes(  # type: ignore[no-untyped-def]
    votes,
    starts,
    base,
    shape,
    left,
    offset,
    most,
    per_offset,
    middles,
    spread,
    image,
    buffers,
    sums,
):
    """Events of each cell where its surface is: their count, slopes and squares.

    `image`, zero and flat, is of parts and bins, all rows of a cell in one. `offset` is the surface
    on cells, NaN where unknown, looked at up to `most`. `middles` are the slopes of the parts,
    `per_offset` their bins by unit of offset, `spread` the variance of slopes within a part.
    `buffers`, of bins uint8 and uint16, are for use.
    """
    _, parts, bins = shape
    height, width = offset.shape
    one = np.uint64(1)
    eight, every = buffers
    for i in range(height):
        # From the first cell that has a surface to the last.
        first = width
        last = 0
        z = np.float32(0)
        for j in range(width):
            # Written so that NaN fails it.
            if abs(offset[i, j]) <= most:
                first = min(first, j)
                last = j + 1
                z = max(z, abs(offset[i, j]))
        if last <= first or starts[i + 1] == starts[i]:
            continue
        _count(votes, starts[i], starts[i + 1], base, 0, CELL_PX * MOST, image)
        for part in range(parts):
            apart = np.int64(np.ceil(abs(per_offset[part]) * z)) + 1
            low = max(left + first * CELL_BINS - apart, 0)
            size = np.uint64(min(left + last * CELL_BINS + apart, bins) - low)
            at = np.uint64(part * bins + low)
            for b in range(size - one):
                eight[b] = np.uint8(image[at + b] + image[at + b + one])
            for b in range(size - np.uint64(3)):
                every[b] = np.uint16(eight[b]) + np.uint16(eight[b + np.uint64(2)])
            s = middles[part]
            square = s * s + spread
            for j in range(first, last):
                if abs(offset[i, j]) <= most:
                    shift = np.int64(np.rint(per_offset[part] * offset[i, j]))
                    k = np.uint64(left + j * CELL_BINS - shift - low)
                    n = np.float32(
                        np.uint32(every[k])
                        + np.uint32(every[k + np.uint64(4)])
                        + np.uint32(every[k + np.uint64(8)])
                        + np.uint32(every[k + np.uint64(12)])
                    )
                    sums[i, j, 0] += n
                    sums[i, j, 1] += n * s
                    sums[i, j, 2] += n * square
        _forget(votes, starts[i], starts[i + 1], base, 0, image)


@njit(cache=True, nogil=True, error_model="numpy")
def _gather(  # type: ignore[no-untyped-def]
    votes, starts, base, shape, left, offset, most, seen, per_offset, image, buffers, support
):
    """Events of each pixel where its surface is; of tiles of cells that are not `seen` none.

    `image`, zero and flat, is of the rows of a cell, parts and bins. `offset` is the surface by
    pixel, NaN where unknown, looked at up to `most`. `buffers` are for use: of bins uint8, and of a
    row's pixels float32 and thrice int32.
    """
    for i in range(seen.shape[0]):
        if starts[i + 1] == starts[i]:
            continue
        _count(votes, starts[i], starts[i + 1], base, 0, MOST, image)
        for row in range(CELL_PX):
            y = i * CELL_PX + row
            _gather_row(
                image, row, shape, left, offset[y], most, seen[i], per_offset, buffers, support[y]
            )
        _forget(votes, starts[i], starts[i + 1], base, 0, image)


@njit(cache=True, nogil=True, error_model="numpy")
def _gather_row(image, row, shape, left, offset, most, seen, per_offset, buffers, support):  # type: ignore[no-untyped-def]
    """`_gather` of one row of an image."""
    _, parts, bins = shape
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    some, heights, places, total, bin_of = buffers
    n = 0
    z = np.float32(0)
    for cell in range(len(offset) // CELL_PX):
        if not seen[cell // TILE_CELLS]:
            continue
        for x in range(cell * CELL_PX, (cell + 1) * CELL_PX):
            if abs(offset[x]) <= most:
                heights[n] = offset[x]
                places[n] = x
                total[n] = 0
                z = max(z, abs(offset[x]))
                n += 1
    if n == 0:
        return
    for part in range(parts):
        per = per_offset[part]
        apart = np.int64(np.ceil(abs(per) * z)) + 1
        low = max(left + places[0] * BINS_PX - apart, 0)
        size = np.uint64(min(left + (places[n - 1] + 1) * BINS_PX + apart, bins - 3) - low)
        at = np.uint64((row * parts + part) * bins + low)
        for b in range(size):
            some[b] = np.uint8(
                image[at + b] + image[at + b + one] + image[at + b + two] + image[at + b + three]
            )
        begin = np.int32(left - low)
        # By itself, as vector instructions find places but don't look things up.
        for i in range(np.uint64(n)):
            shift = np.int32(np.rint(per * heights[i]))
            bin_of[i] = begin + places[i] * np.int32(BINS_PX) - shift
        for i in range(np.uint64(n)):
            total[i] += np.int32(some[np.uint32(bin_of[i])])
    for i in range(n):
        support[places[i]] = np.float32(total[i])

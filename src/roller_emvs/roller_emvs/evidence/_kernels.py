"""Loops over rays and votes for how sharp they are; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

#: Pixels to one cell of the grid that evidence is summed on.
CELL_PX = 4
#: Pixels to one row of votes. Planes part along x; two rows in one halve the work and lose no
#: more than edges lean within two pixels.
ROW_PX = 2
#: Columns of cells that are looked at or left out together.
TILE_CELLS = 16

#: Derivative of a Gaussian of 0.8 px, five taps: what is one pixel wide doesn't shine or fade
#: with its place between pixels.
_FAR, _NEAR = np.float32(0.4), np.float32(1.0)
#: Rays a tile, over which a band's tiles all count.
_MANY_RAYS = 128
#: Rays that are placed before they vote.
_CHUNK = 256


def chunk() -> tuple[np.ndarray, np.ndarray]:
    """Buffers of `_vote`: a place and a share for each ray at hand."""
    return np.empty(_CHUNK, np.int32), np.empty(_CHUNK, np.float32)


@njit(cache=True, nogil=True, error_model="numpy")
def _measure_bands(  # type: ignore[no-untyped-def]
    rays, starts, first, step, reach, offsets, tiles, votes, chunk, line, measure
):
    """Sharpness of every `step`-th band from `first` on; see `_measure_band`."""
    rows = (len(votes) - 1) * ROW_PX
    cells = rows // CELL_PX
    for b in range(first, len(starts), step):
        if starts[b, 0] < starts[b, -1]:
            top = np.float32(b * rows - 0.5)
            own = measure[:, b * cells : (b + 1) * cells]
            _measure_band(rays, starts[b], reach, offsets, top, tiles[b], votes, chunk, line, own)


@njit(cache=True, nogil=True, error_model="numpy")
def _vote(rays, a, b, offset, top, votes, chunk):  # type: ignore[no-untyped-def]
    """Votes of rays a to b on the plane `offset`, each shared by two columns.

    Places first, in a loop that the compiler turns into vector instructions, then votes. The
    last row of `votes` takes what goes nowhere. Loops count without sign from where they begin:
    slices made for them, and what may count from the end, take longer than the votes.
    """
    rows, width = votes.shape
    flat = votes.reshape(-1)
    x0, y0, dx, dy = rays[0], rays[1], rays[2], rays[3]
    places, shares = chunk
    one = np.float32(1)
    half = np.float32(1.0 / ROW_PX)
    below = np.float32(rows - 1)
    right = np.float32(width - 1)
    stride = np.float32(width)
    for start in range(a, b, len(places)):
        begin = np.uint64(start)
        count = np.uint64(min(len(places), b - start))
        for i in range(count):
            x = x0[begin + i] + dx[begin + i] * offset
            y = (y0[begin + i] + dy[begin + i] * offset - top) * half
            # Written so that NaN fails it.
            inside = (x >= 0) & (x < right) & (y >= 0) & (y < below)
            left = np.floor(x)
            shares[i] = x - left
            places[i] = np.int32((np.floor(y) * stride + left) if inside else below * stride)
        for i in range(count):
            at = np.uint64(places[i])
            flat[at] += one - shares[i]
            flat[at + np.uint64(1)] += shares[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _measure_band(  # type: ignore[no-untyped-def]
    rays, starts, reach, offsets, top, tiles, votes, chunk, line, measure
):
    """Sharpness of a band's votes on all planes, by cell.

    `rays`, shape (4, n), are ordered by the plane around which they vote: those of planes
    k - reach … k + reach lie between `starts[k - reach]` and `starts[k + reach + 1]`. `tiles`
    holds the first and last plane on which each tile of columns counts. `measure`, shape (planes,
    rows, columns) of cells, receives the sum of squared slopes along x.
    """
    width = votes.shape[1]
    planes, cell_rows, cell_columns = measure.shape
    for k in range(planes):
        a = starts[max(k - reach, 0)]
        b = starts[min(k + reach, planes - 1) + 1]
        if a == b:
            continue
        votes[:] = 0
        _vote(rays, a, b, offsets[k], top, votes, chunk)
        tile = 0
        while tile < len(tiles):
            # Tiles side by side that count are looked at in one go.
            begin = tile
            while tile < len(tiles) and tiles[tile, 0] <= k <= tiles[tile, 1]:
                tile += 1
            if begin == tile:
                tile += 1
                continue
            first = begin * TILE_CELLS
            last = min(tile * TILE_CELLS, cell_columns)
            low = max(first * CELL_PX, 2)
            high = min(last * CELL_PX, width - 2)
            line[first * CELL_PX : low] = 0
            line[high : last * CELL_PX] = 0
            for row in range(cell_rows):
                _add_slopes(votes, row * CELL_PX // ROW_PX, low, high, line)
                _add_cells(line, first, last, measure[k, row])


@njit(cache=True, nogil=True, fastmath=True)
def _add_slopes(votes, row, low, high, line):  # type: ignore[no-untyped-def]
    """Squared slopes at columns low to high, the sum of those of a cell's rows from `row` on."""
    flat = votes.reshape(-1)
    to = np.uint64(low)
    for r in range(CELL_PX // ROW_PX):
        # Of the five taps' first.
        at = np.uint64((row + r) * votes.shape[1] + low - 2)
        for i in range(np.uint64(high - low)):
            slope = _FAR * (flat[at + i + np.uint64(4)] - flat[at + i]) + _NEAR * (
                flat[at + i + np.uint64(3)] - flat[at + i + np.uint64(1)]
            )
            before = line[to + i] if r else np.float32(0)
            line[to + i] = before + slope * slope


@njit(cache=True, nogil=True)
def _add_cells(line, first, last, measure):  # type: ignore[no-untyped-def]
    """Sums of the columns of each cell."""
    for cell in range(np.uint64(first), np.uint64(last)):
        total = np.float32(0)
        for x in range(np.uint64(CELL_PX)):
            total += line[cell * np.uint64(CELL_PX) + x]
        measure[cell] = total


@njit(cache=True, nogil=True)
def _part_of(slope, least, per_slope, parts, part):  # type: ignore[no-untyped-def]
    """Part of the aperture that each ray belongs to; rays beyond it go to its end parts."""
    most = np.float32(parts - 1)
    for i in range(len(slope)):
        part[i] = np.int32(min(max((slope[i] - least) * per_slope, np.float32(0)), most))


@njit(cache=True, nogil=True)
def _order_groups(rays, group, edges, starts, out):  # type: ignore[no-untyped-def]
    """Counting sort of each band's rays by group; those of group -1 are left out.

    Fills `starts`, shape (bands, groups + 1).
    """
    bands, columns = starts.shape
    place = np.empty(columns, np.int64)
    n = 0
    for b in range(bands):
        place[:] = 0
        for i in range(edges[b], edges[b + 1]):
            if group[i] >= 0:
                place[group[i]] += 1
        for k in range(columns):
            count = place[k]
            place[k] = n
            starts[b, k] = n
            n += count
        for i in range(edges[b], edges[b + 1]):
            k = group[i]
            if k >= 0:
                for c in range(4):
                    out[c, place[k]] = rays[c, i]
                place[k] += 1


@njit(cache=True, nogil=True)
def _tiles_searched(first, last, rows, tiles):  # type: ignore[no-untyped-def]
    """First and last plane of each band's tiles, of those that their cells are searched on.

    `first` and `last` are by cell; none is searched where `last` is negative. A band has `rows`
    rows of cells. `tiles`, shape (bands, tiles, 2), must hold more than any plane and -1.
    """
    for i in range(len(first)):
        for j in range(first.shape[1]):
            if last[i, j] >= 0:
                tile = tiles[i // rows, j // TILE_CELLS]
                tile[0] = min(tile[0], first[i, j])
                tile[1] = max(tile[1], last[i, j])


@njit(cache=True, nogil=True)
def _tiles_reached(rays, first, last, low, high, seen):  # type: ignore[no-untyped-def]
    """Mark the tiles of columns that a band's rays pass between the offsets `low` and `high`.

    All of a band's where its rays are so many that looking at them takes longer than tiles do.
    """
    bands, count = seen.shape
    size = TILE_CELLS * CELL_PX
    for b in range(bands):
        if last[b] - first[b] > count * _MANY_RAYS:
            seen[b] = True
            continue
        for i in range(first[b], last[b]):
            x0 = rays[0, i] + rays[2, i] * low
            x1 = rays[0, i] + rays[2, i] * high
            # The slope at a pixel takes votes from two pixels beside it.
            left = max(int(min(x0, x1) - 2) // size, 0)
            right = min(int(max(x0, x1) + 3) // size, count - 1)
            for t in range(left, right + 1):
                seen[b, t] = True

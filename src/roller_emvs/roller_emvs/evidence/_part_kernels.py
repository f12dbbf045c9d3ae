"""Loops over images of aperture parts; each has a numpy twin in the tests.

Images are flat: by polarity, part, row, phase and column, a bin Q·column + phase, `BINS` = Q.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ._kernels import CELL_PX, ROW_PX, _add_cells, _add_slopes

#: Bins to a pixel along x.
BINS = 2
#: Columns beyond the grid from which votes are taken, for slopes at its border.
EDGE_PX = 4
#: Most counts of a bin of two rows that evidence is made of: four of them fit a byte.
_MOST = 63
#: Events that are placed before they are counted.
CHUNK = 512
#: Columns of cells that are looked at or left out together, and the events in their reach below
#: which they are left out: a peak takes more (`sweep._SPOTS`).
TILE_CELLS, _LEAST_EVENTS = 8, 16


@njit(cache=True, nogil=True, error_model="numpy")
def _scatter(  # type: ignore[no-untyped-def]
    x, y, polarity, table, starts, packets, part, to_middle, phase, shape, margin, buffers, images
):
    """Count the events of some packets in their part's image, on the middle plane.

    `table`, shape (height, width, 2), takes a pixel to an ideal one, NaN where its events don't
    count; `to_middle`, shape (packets, 3, 3), takes those to the middle plane. `images`, shape
    (2, parts, rows + 1, BINS, stride), begin `margin` columns before the grid of `shape` and end
    as many after it. Counts stop at 255; the last row takes what goes nowhere.
    """
    flat = images.reshape(-1)
    pixels = table.reshape(-1)
    camera_width = np.uint64(table.shape[1])
    _, parts, rows, bins, columns = images.shape
    size = np.uint64(rows * bins * columns)
    apart = np.uint64(parts) * size
    below = np.float32(shape[0])
    right = np.float32(shape[1] + 2 * margin)
    stride = np.float32(columns)
    per_row = np.float32(bins * columns)
    lost = below * per_row
    half = np.float32(0.5)
    left = np.float32(0.5 + margin)
    per_px = np.float32(bins)
    per_bin = np.float32(1.0 / bins)
    u, v, places = buffers
    two = np.uint64(2)
    for n in range(len(packets)):
        k = packets[n]
        m = to_middle[k]
        own = np.uint64(part[k]) * size
        shift = phase[part[k]]
        for start in range(starts[k], starts[k + 1], len(places)):
            begin = np.uint64(start)
            count = np.uint64(min(len(places), starts[k + 1] - start))
            for i in range(count):
                at = two * (np.uint64(y[begin + i]) * camera_width + np.uint64(x[begin + i]))
                u[i] = pixels[at]
                v[i] = pixels[at + np.uint64(1)]
            for i in range(count):
                w = m[2, 0] * u[i] + m[2, 1] * v[i] + m[2, 2]
                share = np.float32(1) / w
                a = (m[0, 0] * u[i] + m[0, 1] * v[i] + m[0, 2]) * share + left
                b = (m[1, 0] * u[i] + m[1, 1] * v[i] + m[1, 2]) * share + half
                # Written so that NaN fails it.
                inside = (w > 0) & (a >= 0) & (a < right) & (b >= 0) & (b < below)
                # Whole numbers as float32, which vector instructions take; below 2**24 exact.
                at_bin = np.floor(a * per_px + shift)
                column = np.floor(at_bin * per_bin)
                place = np.floor(b) * per_row + (at_bin - column * per_px) * stride + column
                places[i] = np.int32(place if inside else lost)
            for i in range(count):
                at = own + np.uint64(places[i]) + apart * np.uint64(polarity[begin + i] > 0)
                flat[at] += np.uint8(flat[at] < 255)


@njit(cache=True, nogil=True, error_model="numpy")
def _measure_bands(  # type: ignore[no-untyped-def]
    images, spans, sources, ranges, first, step, pad, reach, pairs, sums, votes, line, events,
    measure,
):  # fmt: skip
    """Sharpness of a polarity's votes on all planes, by cell, of every `step`-th band of rows.

    `images`, shape (parts, rows, BINS, stride). `spans` holds the columns that each part saw,
    from and to. `sources` and `ranges` are those of `_moves`. `pairs`, shape (parts or up to
    three more, BINS, rows of votes, pad + stride + pad), zero, `sums`, shape (BINS, columns),
    `events`, shape (stride,), and `votes` are for use; the latter begin and end `EDGE_PX` columns
    beyond the grid. Events come to a column of the grid from `reach` columns of the images, first
    and beyond the last. `measure`, shape (planes, rows, columns) of cells, zero, receives the sum
    of squared slopes along x, but for tiles that hardly an event reaches.
    """
    rows, _ = votes.shape
    planes, cell_rows, cell_columns = measure.shape
    per_cell = CELL_PX // ROW_PX
    tiles = -(-cell_columns // TILE_CELLS)
    for cell_row in range(first * rows // per_cell, cell_rows, step * rows // per_cell):
        count = min(rows, (cell_rows - cell_row) * per_cell)
        _add_rows(images, spans, cell_row * CELL_PX, count, pad, pairs, events)
        tile = 0
        while tile < tiles:
            # Tiles side by side that count are looked at in one go.
            begin = tile * TILE_CELLS
            while tile < tiles and _reached(events, tile, reach):
                tile += 1
            end = min(tile * TILE_CELLS, cell_columns)
            if begin >= end:
                tile += 1
                continue
            left, right = begin * CELL_PX, end * CELL_PX + 2 * EDGE_PX
            for k in range(planes):
                for row in range(count):
                    _add_parts(pairs, sources[k], ranges[k], row, left, right, sums)
                    _share_bins(sums, row, left, right, votes)
                for r in range(count // per_cell):
                    _add_slopes(votes, r * per_cell, left + EDGE_PX, right - EDGE_PX, line)
                    _add_cells(line[EDGE_PX:], begin, end, measure[k, cell_row + r])


@njit(cache=True, nogil=True)
def _reached(events, tile, reach):  # type: ignore[no-untyped-def]
    """Whether events enough can come to a tile; `events` are of each column."""
    low = max(tile * TILE_CELLS * CELL_PX + reach[0], 0)
    high = min((tile + 1) * TILE_CELLS * CELL_PX + reach[1], len(events))
    total = np.int64(0)
    for c in range(low, high):
        total += events[c]
    return total >= _LEAST_EVENTS


@njit(cache=True, nogil=True)
def _add_rows(images, spans, top, count, pad, pairs, events):  # type: ignore[no-untyped-def]
    """Sums of `ROW_PX` rows from the row `top` on, and of all of a column."""
    flat = images.reshape(-1)
    out = pairs.reshape(-1)
    parts, rows, bins, stride = images.shape
    wide = pairs.shape[3]
    events[:] = 0
    for j in range(parts):
        begin = spans[j, 0]
        start = np.uint64(begin)
        columns = np.uint64(max(spans[j, 1] - begin, 0))
        for row in range(count):
            for p in range(bins):
                at = np.uint64(((j * rows + top + row * ROW_PX) * bins + p) * stride + begin)
                below = at + np.uint64(bins * stride)
                to = np.uint64(((j * bins + p) * pairs.shape[2] + row) * wide + pad + begin)
                for c in range(columns):
                    total = np.uint16(flat[at + c]) + np.uint16(flat[below + c])
                    both = np.uint8(min(total, np.uint16(_MOST)))
                    out[to + c] = both
                    events[start + c] += np.uint16(both)


@njit(cache=True, nogil=True)
def _add_parts(pairs, sources, ranges, row, left, right, sums):  # type: ignore[no-untyped-def]
    """Votes of a row on a plane, columns `left` to `right`: all parts' images, each moved."""
    flat = pairs.reshape(-1)
    out = sums.reshape(-1)
    bins, width = sums.shape
    below = np.uint64(row * pairs.shape[3])
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
def _cell_sums(images, spans, pad, line, cells):  # type: ignore[no-untyped-def]
    """Counts of `CELL_PX` rows and columns, by part, row of cells and their first column.

    `cells`, shape (parts, rows of cells, columns), begin `pad` columns before the images.
    """
    flat = images.reshape(-1)
    out = cells.reshape(-1)
    parts, rows, bins, stride = images.shape
    _, height, wide = cells.shape
    before = np.uint64(pad)
    for j in range(parts):
        begin = np.uint64(spans[j, 0])
        count = np.uint64(max(spans[j, 1] - spans[j, 0], 0))
        line[:] = 0
        for i in range(height):
            for row in range(CELL_PX * bins):
                at = np.uint64(((j * rows + i * CELL_PX) * bins + row) * stride) + begin
                for c in range(count):
                    so_far = np.uint16(0) if row == 0 else line[before + begin + c]
                    line[before + begin + c] = so_far + np.uint16(flat[at + c])
            at = np.uint64((j * height + i) * wide)
            for c in range(np.uint64(wide)):
                out[at + c] = (
                    line[c]
                    + line[c + np.uint64(1)]
                    + line[c + np.uint64(2)]
                    + line[c + np.uint64(3)]
                )


@njit(cache=True, nogil=True)
def _slope_sums(cells, offset, slopes, square, phase, left, sums):  # type: ignore[no-untyped-def]
    """Count events, and add up their slopes along x and squares, that meet the surface.

    `offset` is the surface on cells, NaN where unknown; `square` the mean square of a part's
    slopes. `cells` begin `left` columns before the grid.
    """
    height, width = offset.shape
    parts, _, wide = cells.shape
    for i in range(height):
        for c in range(width):
            z = offset[i, c]
            if np.isnan(z):
                continue
            count = np.float32(0)
            slope = np.float32(0)
            squares = np.float32(0)
            for j in range(parts):
                moved = np.rint(slopes[j] * z - phase[j] / np.float32(BINS))
                at = np.int64(c * CELL_PX + left) - np.int64(moved)
                if 0 <= at < wide:
                    n = np.float32(cells[j, i, at])
                    count += n
                    slope += n * slopes[j]
                    squares += n * square[j]
            sums[i, c, 0] = count
            sums[i, c, 1] = slope
            sums[i, c, 2] = squares


@njit(cache=True, nogil=True, error_model="numpy")
def _support(images, spans, depth, slopes, phase, margin, buffers, support):  # type: ignore[no-untyped-def]
    """Count events at the pixels where they meet the surface `depth` (NaN: unknown).

    `buffers` are for use: of a row's pixels float32, float32, int32 and uint16, of one pixel more
    int32, and of a row's bins and one more uint16.
    """
    parts, rows, bins, columns = images.shape
    height, width = depth.shape
    flat = images.reshape(-1)
    out = support.reshape(-1)
    nowhere = np.float32(bins * columns)
    reached = np.uint64(width + 2 * margin)
    top = np.float32(bins * (width + 2 * margin))
    left = np.float32(bins * margin + 0.5)
    per_px = np.float32(bins)
    per_bin = np.float32(1.0 / bins)
    stride = np.float32(columns)
    column, z, place, total, before, both = buffers
    both[bins * columns] = 0
    for row in range(height):
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
        for j in range(parts):
            slope = slopes[j]
            shift = phase[j] + left
            least = spans[j, 0] - margin + int(np.floor(min(slope * low, slope * high))) - 1
            most = spans[j, 1] - margin + int(np.ceil(max(slope * low, slope * high))) + 1
            first = np.uint64(before[min(max(least, 0), width)])
            last = np.uint64(before[min(max(most, 0), width)])
            if first >= last:
                continue
            # Of each bin and the next, once for all pixels.
            for p in range(bins):
                own = np.uint64(((j * rows + row) * bins + p) * columns)
                after = own + np.uint64(columns if p < bins - 1 else 1 - p * columns)
                to = np.uint64(p * columns)
                for c in range(reached):
                    both[to + c] = np.uint16(flat[own + c]) + np.uint16(flat[after + c])
            for i in range(first, last):
                b = np.floor(per_px * (column[i] - slope * z[i]) + shift)
                inside = (b >= 0) & (b < top)
                # Whole numbers as float32, which vector instructions take; below 2**24 exact.
                at = np.floor(b * per_bin)
                place[i] = np.int32((b - at * per_px) * stride + at if inside else nowhere)
            for i in range(first, last):
                total[i] += both[np.uint64(place[i])]
        base = np.uint64(row * width)
        for i in range(np.uint64(known)):
            out[base + np.uint64(column[i])] = np.float32(total[i])

"""Loops that sort events by band of rows and count them; each has a numpy twin in the tests.

An event is a number: its bucket, a polarity and band of rows, and within it part of the aperture,
row and bin, a bin Q·column + phase, `BINS` = Q.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: Bins to a pixel along x.
BINS = 2
#: Rows of a band, px.
BAND_ROWS = 8
#: Bits of an event's bin, of its row in the band and of its part; the bucket's are above them.
BIN_BITS, ROW_BITS, PART_BITS = 13, 3, 6
_BUCKET = BIN_BITS + ROW_BITS + PART_BITS
BIN = (1 << BIN_BITS) - 1
#: Parts and rows that an event can tell.
KEYS = 1 << (ROW_BITS + PART_BITS)
#: Events that are placed before they are counted.
CHUNK = 512


@njit(cache=True, nogil=True, error_model="numpy")
def _place(  # type: ignore[no-untyped-def]
    x, y, polarity, table, starts, packets, part, to_middle, phase, shape, margin, buffers, events,
    counts,
):  # fmt: skip
    """Where the events of packets from one to another come on the middle plane, and how many where.

    `table`, shape (height, width, 2), takes a pixel to an ideal one, NaN where its events don't
    count; `to_middle`, shape (packets, 3, 3), takes those to the middle plane of a grid of `shape`
    and `margin` columns more on either side. `counts`, shape (buckets,), is zero; the last bucket
    takes what goes nowhere.
    """
    pixels = table.reshape(-1)
    camera_width = np.uint64(table.shape[1])
    below = np.float32(shape[0])
    right = np.float32(shape[1] + 2 * margin)
    half = np.float32(0.5)
    left = np.float32(0.5 + margin)
    per_px = np.float32(BINS)
    rows = np.float32(BAND_ROWS)
    per_row = np.float32(1.0 / BAND_ROWS)
    nowhere = np.int32(len(counts) - 1)
    bands = nowhere >> np.int32(1)
    u, v, buckets = buffers
    two = np.uint64(2)
    for k in range(packets[0], packets[1]):
        m = to_middle[k]
        own = np.int32(part[k] << (BIN_BITS + ROW_BITS))
        shift = phase[part[k]]
        for start in range(starts[k], starts[k + 1], len(buckets)):
            begin = np.uint64(start)
            count = np.uint64(min(len(buckets), starts[k + 1] - start))
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
                at_bin = np.int32(np.floor(a * per_px + shift) if inside else np.float32(0))
                line = np.floor(b) if inside else np.float32(0)
                band = np.floor(line * per_row)
                row = np.int32(line - band * rows)
                bucket = np.int32(band) + bands * np.int32(polarity[begin + i] > 0)
                bucket = bucket if inside else nowhere
                buckets[i] = bucket
                within = own | (row << np.int32(BIN_BITS)) | at_bin
                events[begin + i] = np.uint32((bucket << np.int32(_BUCKET)) | within)
            for i in range(count):
                counts[np.uint64(buckets[i])] += 1


@njit(cache=True, nogil=True)
def _sort(events, first, last, place, out):  # type: ignore[no-untyped-def]
    """Write events from one to another at the place of their bucket, which moves on."""
    for i in range(np.uint64(first), np.uint64(last)):
        bucket = np.uint64(events[i] >> np.uint32(_BUCKET))
        out[np.uint64(place[bucket])] = events[i]
        place[bucket] += 1


@njit(cache=True, nogil=True)
def _count(events, first, last, base, halved, most, out):  # type: ignore[no-untyped-def]
    """Count events from one to another up to `most`, in the image `out`, flat.

    `base`, shape (KEYS,), is where the image of a part and row begins; bins follow, or `halved`
    columns.
    """
    bits = np.uint32(halved)
    for i in range(np.uint64(first), np.uint64(last)):
        event = events[i]
        key = np.uint64((event >> np.uint32(BIN_BITS)) & np.uint32(KEYS - 1))
        at = np.uint64(base[key]) + np.uint64((event & np.uint32(BIN)) >> bits)
        out[at] += out[at] < most


@njit(cache=True, nogil=True)
def _count_columns(events, first, last, columns):  # type: ignore[no-untyped-def]
    """Events of each column of the images."""
    columns[:] = 0
    for i in range(np.uint64(first), np.uint64(last)):
        columns[np.uint64((events[i] & np.uint32(BIN)) >> np.uint32(1))] += 1


@njit(cache=True, nogil=True)
def _mark(events, first, last, seen):  # type: ignore[no-untyped-def]
    """Which parts and rows of a band have events, by what `_count` takes for `base`."""
    seen[:] = False
    for i in range(np.uint64(first), np.uint64(last)):
        seen[np.uint64((events[i] >> np.uint32(BIN_BITS)) & np.uint32(KEYS - 1))] = True

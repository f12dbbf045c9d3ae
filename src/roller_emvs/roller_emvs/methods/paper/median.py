"""Masked median of the planes that pixels' maxima lie on."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from roller_emvs.rays import F32, I64

from .threshold import Mask
from .votes import U16

#: Rows whose medians are taken at once, and the bits of a row's count.
_AT_ONCE, _LANE = 4, np.uint64(0xFFFF)


def median_at(index: U16, mask: Mask, size_px: int, levels: int) -> tuple[I64, F32]:
    """Median of the masked neighbours of each masked pixel.

    Values are taken as evenly spread over their plane's step, so the median lies between planes
    and few planes serve as well as many.

    Parameters
    ----------
    index : ndarray of uint16, shape (height, width)
        Plane of each pixel.
    mask : ndarray of bool, shape (height, width)
        Pixels that count.
    size_px : int
        Size of the square neighbourhood, odd, px.
    levels : int
        Number of planes.

    Returns
    -------
    pixels : ndarray of int64, shape (n,)
        Flat indices of the masked pixels, row by row.
    median : ndarray of float32, shape (n,)
        Median plane number of each.
    """
    pixels = np.flatnonzero(mask)
    return pixels, median_of(index, pixels, size_px, levels)


def median_of(index: U16, pixels: I64, size_px: int, levels: int) -> F32:
    """Median of the neighbours of each of some pixels that are among them; see `median_at`.

    Parameters
    ----------
    index : ndarray of uint16, shape (height, width)
        Plane of each pixel.
    pixels : ndarray of int64, shape (n,)
        Flat indices of the pixels that count, in order.
    size_px : int
        Size of the square neighbourhood, odd, px.
    levels : int
        Number of planes.

    Returns
    -------
    ndarray of float32, shape (n,)
        Median plane number of each.
    """
    width, count = index.shape[1], len(pixels)
    starts = np.zeros(width + 1, np.int64)
    rows, values = np.empty(count, np.int64), np.empty(count, np.uint16)
    _by_column(index.reshape(-1), pixels, starts, np.empty(width, np.int64), rows, values)
    first, last = np.empty((2, width), np.int64)
    median = np.empty(count, np.float32)
    _masked_median(
        rows, values, starts, pixels, size_px // 2, _lanes(size_px), np.zeros(levels, np.uint64),
        first, last, median,
    )  # fmt: skip
    return median


def _lanes(size_px: int) -> npt.NDArray[np.uint64]:
    """By how far an item lies below the top of the first of some rows' windows: 1 for each row.

    Each of `_AT_ONCE` rows has 16 bits, which hold the items of a window of 255 × 255.
    """
    below, row = np.arange(size_px + _AT_ONCE - 1)[:, None], np.arange(_AT_ONCE)
    inside = (below >= row) & (below < row + size_px)
    return np.asarray((inside.astype(np.uint64) << (16 * row).astype(np.uint64)).sum(axis=1))


def masked_median(index: U16, mask: Mask, size_px: int, levels: int) -> F32:
    """As an image what `median_at` gives by pixel, float32, NaN outside the mask."""
    pixels, median = median_at(index, mask, size_px, levels)
    image = np.full(index.shape, np.nan, np.float32)
    image.reshape(-1)[pixels] = median
    return image


@njit(cache=True, nogil=True)
def _by_column(index, pixels, starts, place, rows, values):  # type: ignore[no-untyped-def]
    """Rows and planes of pixels, column by column from the top, and where each column begins.

    `place`, of the columns, is for use; `starts` must be 0.
    """
    width = len(place)
    for i in range(len(pixels)):
        starts[pixels[i] % width + 1] += 1
    for x in range(width):
        starts[x + 1] += starts[x]
        place[x] = starts[x]
    for i in range(len(pixels)):
        y, x = pixels[i] // width, pixels[i] % width
        rows[place[x]] = y
        values[place[x]] = index[pixels[i]]
        place[x] += 1


@njit(cache=True, nogil=True)
def _grouped_median(histogram, count, lane):  # type: ignore[no-untyped-def]
    """Median of grouped data: items lie evenly over the step of their level.

    `lane` is the first bit of what counts.
    """
    half = 0.5 * np.int64((count >> lane) & _LANE)
    below, level, own = np.int64(0), 0, np.int64((histogram[0] >> lane) & _LANE)
    while below + own < half:
        below += own
        level += 1
        own = np.int64((histogram[np.uint64(level)] >> lane) & _LANE)
    return level - 0.5 + (half - below) / own


@njit(cache=True, nogil=True)
def _masked_median(rows, values, starts, pixels, radius, lanes, histogram, first, last, median):  # type: ignore[no-untyped-def]
    """Medians around pixels, of some rows at once: their windows have most items in common.

    `histogram`, uint64, holds the counts of each row side by side, see `_lanes`.
    """
    width = len(first)
    at, ends = np.empty(_AT_ONCE, np.int64), np.empty(_AT_ONCE, np.int64)
    n = 0
    for x in range(width):
        first[x] = starts[x]
        last[x] = starts[x]
    while n < len(pixels):
        y, left, right = pixels[n] // width, width, -1
        top = y - radius
        for j in range(_AT_ONCE):
            at[j] = n
            while n < len(pixels) and pixels[n] < (y + j + 1) * width:
                n += 1
            ends[j] = n
            if at[j] < n:
                left, right = min(left, pixels[at[j]] % width), max(right, pixels[n - 1] % width)
        begin, end = max(left - radius, 0), min(right + radius, width - 1)
        # Items of each column that lie within the windows of these rows.
        for x in range(begin, end + 1):
            while first[x] < starts[x + 1] and rows[first[x]] < top:
                first[x] += 1
            last[x] = max(last[x], first[x])
            while last[x] < starts[x + 1] and rows[last[x]] < top + len(lanes):
                last[x] += 1
        count = np.uint64(0)
        for x in range(left - 2 * radius, right + 1):
            new = x + radius
            if begin <= new <= end:
                for i in range(first[new], last[new]):
                    lane = lanes[np.uint64(rows[i] - top)]
                    histogram[values[i]] += lane
                    count += lane
            old = x - radius - 1
            if old >= begin:
                for i in range(first[old], last[old]):
                    lane = lanes[np.uint64(rows[i] - top)]
                    histogram[values[i]] -= lane
                    count -= lane
            for j in range(_AT_ONCE):
                if at[j] < ends[j] and pixels[at[j]] == (y + j) * width + x:
                    median[at[j]] = _grouped_median(histogram, count, np.uint64(16 * j))
                    at[j] += 1
        # Leave the histogram empty for the next rows.
        for x in range(max(right - radius, begin), end + 1):
            for i in range(first[x], last[x]):
                histogram[values[i]] -= lanes[np.uint64(rows[i] - top)]

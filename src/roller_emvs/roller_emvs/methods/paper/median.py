"""Masked median of the planes that pixels' maxima lie on."""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_emvs.rays import F32, I64

from .threshold import Mask
from .votes import U16


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
    histogram = np.zeros(levels, np.int32)
    coarse = np.zeros(levels // 16 + 1, np.int32)
    first, last = np.empty((2, width), np.int64)
    median = np.empty(count, np.float32)
    _masked_median(
        rows, values, starts, pixels, size_px // 2, histogram, coarse, first, last, median
    )
    return median


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
def _grouped_median(histogram, coarse, count):  # type: ignore[no-untyped-def]
    """Median of grouped data: items lie evenly over the step of their level."""
    half = 0.5 * count
    below = 0
    block = 0
    while below + coarse[block] < half:
        below += coarse[block]
        block += 1
    level = block * 16
    while below + histogram[level] < half:
        below += histogram[level]
        level += 1
    return level - 0.5 + (half - below) / histogram[level]


@njit(cache=True, nogil=True)
def _masked_median(  # type: ignore[no-untyped-def]
    rows, values, starts, pixels, radius, histogram, coarse, first, last, median
):
    width = len(first)
    n = 0
    for x in range(width):
        first[x] = starts[x]
        last[x] = starts[x]
    while n < len(pixels):
        y, end_of_row = pixels[n] // width, n
        while end_of_row < len(pixels) and pixels[end_of_row] < (y + 1) * width:
            end_of_row += 1
        left, right = pixels[n] % width, pixels[end_of_row - 1] % width
        begin, end = max(left - radius, 0), min(right + radius, width - 1)
        # Items of each column that lie within the rows of this window.
        for x in range(begin, end + 1):
            while first[x] < starts[x + 1] and rows[first[x]] < y - radius:
                first[x] += 1
            last[x] = max(last[x], first[x])
            while last[x] < starts[x + 1] and rows[last[x]] <= y + radius:
                last[x] += 1
        count = 0
        for x in range(left - 2 * radius, right + 1):
            new = x + radius
            if begin <= new <= end:
                for i in range(first[new], last[new]):
                    histogram[values[i]] += 1
                    coarse[values[i] >> 4] += 1
                count += last[new] - first[new]
            old = x - radius - 1
            if old >= begin:
                for i in range(first[old], last[old]):
                    histogram[values[i]] -= 1
                    coarse[values[i] >> 4] -= 1
                count -= last[old] - first[old]
            if n < end_of_row and pixels[n] == y * width + x:
                median[n] = _grouped_median(histogram, coarse, count)
                n += 1
        # Leave the histogram empty for the next row.
        for x in range(max(right - radius, begin), end + 1):
            for i in range(first[x], last[x]):
                histogram[values[i]] -= 1
                coarse[values[i] >> 4] -= 1

"""From votes to a semi-dense depth map: adaptive Gaussian threshold and masked median."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from roller_emvs.rays import F32, I64

from .votes import U16

#: Neighbourhood of the adaptive threshold, px (paper).
KERNEL_PX = 5

Mask = npt.NDArray[np.bool_]


def adaptive_threshold(votes: F32, c: float, kernel_px: int, full_scale_votes: float) -> Mask:
    """Pixels whose votes stand out of their neighbourhood (EMVS, section 5.2.3).

    Parameters
    ----------
    votes : ndarray of float32, shape (height, width)
        Maximum along each ray.
    c : float
        How far above the Gaussian mean of the neighbourhood, in 1/255 of full scale.
    kernel_px : int
        Size of the neighbourhood, odd, px.
    full_scale_votes : float
        Votes that count as 255; 0 stretches the window's own extremes over 0–255.

    Returns
    -------
    ndarray of bool, shape (height, width)
    """
    mask, scale = np.zeros(votes.shape, np.bool_), _scale(votes, full_scale_votes)
    if scale is not None:
        taps = _taps(kernel_px)
        _stand_out(votes, *scale, taps, np.float32(c), *_lines(votes, taps), mask)
    return mask


def margins(votes: F32, kernel_px: int, full_scale_votes: float) -> F32:
    """How far each pixel stands out: `adaptive_threshold` is where this exceeds a whole C.

    Returns
    -------
    ndarray of float32, shape (height, width)
        In 1/255 of full scale; -inf where no C of at least 0 takes the pixel.
    """
    found = np.full(votes.shape, -np.inf, np.float32)
    scale = _scale(votes, full_scale_votes)
    if scale is not None:
        taps = _taps(kernel_px)
        _margins(votes, *scale, taps, *_lines(votes, taps), found)
    return found


def _scale(votes: F32, full_scale_votes: float) -> tuple[np.float32, np.float32] | None:
    """Votes of level 0, and levels to a vote; None where all are the same."""
    if full_scale_votes > 0:
        return np.float32(0), np.float32(255.0 / full_scale_votes)
    low, high = float(votes.min()), float(votes.max())
    return (np.float32(low), np.float32(255.0 / (high - low))) if high > low else None


def _taps(kernel_px: int) -> F32:
    """A Gaussian from its middle on."""
    return np.asarray(cv2.getGaussianKernel(kernel_px, 0).ravel()[kernel_px // 2 :], np.float32)


def _lines(votes: F32, taps: F32) -> tuple[I64, F32, F32, F32]:
    """For use by `_mean`: places, levels and their sums of the rows at hand, and one of means."""
    rows, width = 2 * len(taps) - 1, votes.shape[1]
    levels, sums = np.empty((2, rows, width), np.float32)
    return np.empty(rows, np.int64), levels, sums, np.empty(width, np.float32)


@njit(cache=True, nogil=True)
def _add_by_taps(values, places, taps, count, out, to):  # type: ignore[no-untyped-def]
    """Sums by taps of what lies from some places on, in order, the middle one's in the middle.

    Places count without sign, so that loops become vector instructions; those of five at once take
    a fifth of the time.
    """
    size, reach, first = np.uint64(count), len(taps) - 1, np.uint64(to)
    middle = np.uint64(places[reach])
    if reach == 2:
        near, far = taps[1], taps[2]
        a, b = np.uint64(places[0]), np.uint64(places[1])
        d, e = np.uint64(places[3]), np.uint64(places[4])
        for x in range(size):
            total = taps[0] * values[middle + x] + near * (values[b + x] + values[d + x])
            out[first + x] = total + far * (values[a + x] + values[e + x])
        return
    for x in range(size):
        out[first + x] = taps[0] * values[middle + x]
    for k in range(1, reach + 1):
        before, after = np.uint64(places[reach - k]), np.uint64(places[reach + k])
        for x in range(size):
            out[first + x] += taps[k] * (values[before + x] + values[after + x])


@njit(cache=True, nogil=True)
def _add_row(votes, y, low, scale, taps, places, levels, sums):  # type: ignore[no-untyped-def]
    """Votes of a row in whole levels, as OpenCV's, and their sums along it, in the rows at hand."""
    width = votes.shape[1]
    begin, reach = (y % len(levels)) * width, len(taps) - 1
    flat, own, to = votes.reshape(-1), levels.reshape(-1), sums.reshape(-1)
    at, first = np.uint64(y * width), np.uint64(begin)
    for x in range(np.uint64(width)):
        own[first + x] = np.floor((flat[at + x] - low) * scale)
    for k in range(len(places)):
        places[k] = begin + k
    _add_by_taps(own, places, taps, max(width - 2 * reach, 0), to, begin + reach)


@njit(cache=True, nogil=True)
def _mean(y, taps, places, sums, mean):  # type: ignore[no-untyped-def]
    """Mean of the neighbourhood of each pixel of a row, rounded, from the rows at hand."""
    rows, width = sums.shape
    for k in range(len(places)):
        places[k] = ((y + k - len(taps) + 1) % rows) * width
    _add_by_taps(sums.reshape(-1), places, taps, width, mean, 0)
    for x in range(np.uint64(width)):
        mean[x] = np.rint(mean[x])


@njit(cache=True, nogil=True)
def _stand_out(votes, low, scale, taps, c, places, levels, sums, mean, mask):  # type: ignore[no-untyped-def]
    """Pixels whose level exceeds the mean around, rounded, by `c`.

    At the border the neighbourhood is cut off and every stray event stands out.
    """
    height, width = mask.shape
    border = max(len(taps) - 1, 1)
    first, count = np.uint64(border), np.uint64(max(width - 2 * border, 0))
    given, own, out = votes.reshape(-1), levels.reshape(-1), mask.reshape(-1)
    for y in range(height):
        _add_row(votes, y, low, scale, taps, places, levels, sums)
        row = y - (len(taps) - 1)
        if row >= border and row < height - border:
            _mean(row, taps, places, sums, mean)
            at = np.uint64(row * width) + first
            level = np.uint64((row % len(levels)) * width) + first
            for x in range(count):
                above = own[level + x] > mean[first + x] + c
                out[at + x] = above & (given[at + x] > 0)


@njit(cache=True, nogil=True)
def _margins(votes, low, scale, taps, places, levels, sums, mean, found):  # type: ignore[no-untyped-def]
    """By how much each pixel's level exceeds the mean around, where it has votes; `_stand_out`."""
    height, width = found.shape
    border = max(len(taps) - 1, 1)
    for y in range(height):
        _add_row(votes, y, low, scale, taps, places, levels, sums)
        row = y - (len(taps) - 1)
        if row >= border and row < height - border:
            _mean(row, taps, places, sums, mean)
            own = levels[row % len(levels)]
            for x in range(border, width - border):
                if votes[row, x] > 0:
                    found[row, x] = own[x] - mean[x]


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

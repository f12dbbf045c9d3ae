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
    levels = _levels(votes, kernel_px, full_scale_votes)
    mask = np.zeros(votes.shape, np.bool_)
    if levels is not None:
        # At the border the neighbourhood is cut off and every stray event stands out.
        _stand_out(*levels, votes, np.float32(c), max(kernel_px // 2, 1), mask)
    return mask


def margins(votes: F32, kernel_px: int, full_scale_votes: float) -> F32:
    """How far each pixel stands out: `adaptive_threshold` is where this exceeds a whole C.

    Returns
    -------
    ndarray of float32, shape (height, width)
        In 1/255 of full scale; -inf where no C of at least 0 takes the pixel.
    """
    found = np.full(votes.shape, -np.inf, np.float32)
    levels = _levels(votes, kernel_px, full_scale_votes)
    if levels is not None:
        border = max(kernel_px // 2, 1)
        own = (slice(border, votes.shape[0] - border), slice(border, votes.shape[1] - border))
        gray, mean = levels
        found[own] = np.where(votes > 0, gray - np.rint(mean), np.float32(-np.inf))[own]
    return found


def _levels(votes: F32, kernel_px: int, full_scale_votes: float) -> tuple[F32, F32] | None:
    """Votes in whole levels and their neighbourhood's mean; None where all are the same."""
    if full_scale_votes > 0:
        gray = votes * np.float32(255.0 / full_scale_votes)
    else:
        low, high = float(votes.min()), float(votes.max())
        if high <= low:
            return None
        gray = (votes - np.float32(low)) * np.float32(255.0 / (high - low))
    # OpenCV's adaptiveThreshold in whole levels, but without its saturation at 255.
    gray = np.floor(gray)
    mean = cv2.GaussianBlur(gray, (kernel_px, kernel_px), 0, borderType=cv2.BORDER_REPLICATE)
    return gray, np.asarray(mean, np.float32)


@njit(cache=True, nogil=True)
def _stand_out(gray, mean, votes, c, border, mask):  # type: ignore[no-untyped-def]
    height, width = mask.shape
    for y in range(border, height - border):
        own = slice(border, width - border)
        _above(gray[y, own], mean[y, own], votes[y, own], c, mask[y, own])


@njit(cache=True, nogil=True)
def _above(gray, mean, votes, c, mask):  # type: ignore[no-untyped-def]
    for x in range(len(mask)):
        mask[x] = (gray[x] > np.rint(mean[x]) + c) & (votes[x] > 0)


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
    starts = np.zeros(index.shape[1] + 1, np.int64)
    _count_columns(mask, starts)
    count = int(starts[-1])
    rows, values = np.empty(count, np.int64), np.empty(count, np.uint16)
    first = starts[:-1].copy()
    _gather_columns(index, mask, first, rows, values)
    histogram = np.zeros(levels, np.int32)
    coarse = np.zeros(levels // 16 + 1, np.int32)
    last = np.empty(index.shape[1], np.int64)
    pixels, median = np.empty(count, np.int64), np.empty(count, np.float32)
    _masked_median(
        rows, values, starts, mask, size_px // 2, histogram, coarse, first, last, pixels, median
    )
    return pixels, median


def masked_median(index: U16, mask: Mask, size_px: int, levels: int) -> F32:
    """As an image what `median_at` gives by pixel, float32, NaN outside the mask."""
    pixels, median = median_at(index, mask, size_px, levels)
    image = np.full(index.shape, np.nan, np.float32)
    image.reshape(-1)[pixels] = median
    return image


@njit(cache=True, nogil=True)
def _count_columns(mask, starts):  # type: ignore[no-untyped-def]
    """Where each column's masked pixels begin, one after the other."""
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            starts[x + 1] += mask[y, x]
    for x in range(mask.shape[1]):
        starts[x + 1] += starts[x]


@njit(cache=True, nogil=True)
def _gather_columns(index, mask, place, rows, values):  # type: ignore[no-untyped-def]
    """Masked pixels, column by column from the top."""
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if mask[y, x]:
                rows[place[x]] = y
                values[place[x]] = index[y, x]
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
    rows, values, starts, mask, radius, histogram, coarse, first, last, pixels, median
):
    height, width = mask.shape
    n = 0
    for x in range(width):
        first[x] = starts[x]
        last[x] = starts[x]
    for y in range(height):
        left, right = _ends(mask[y])
        if right < left:
            continue
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
            if x >= left and mask[y, x]:
                pixels[n] = y * width + x
                median[n] = _grouped_median(histogram, coarse, count)
                n += 1
        # Leave the histogram empty for the next row.
        for x in range(max(right - radius, begin), end + 1):
            for i in range(first[x], last[x]):
                histogram[values[i]] -= 1
                coarse[values[i] >> 4] -= 1


@njit(cache=True, nogil=True)
def _ends(row):  # type: ignore[no-untyped-def]
    """First and last masked pixel of a row; last before first where there is none."""
    left = 0
    right = len(row) - 1
    while left <= right and not row[left]:
        left += 1
    while right > left and not row[right]:
        right -= 1
    return left, right

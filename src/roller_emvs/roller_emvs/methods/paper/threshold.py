"""Adaptive Gaussian threshold: pixels whose votes stand out of their neighbourhood."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from roller_emvs.rays import F32, I64

#: Neighbourhood of the adaptive threshold, px (paper).
KERNEL_PX = 5
#: Columns of a row that are looked at together.
_BLOCK = 32

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
        blocks = np.empty((2, kernel_px, -(-votes.shape[1] // _BLOCK)), np.uint8)
        _stand_out(votes, *scale, taps, np.float32(c), *_lines(votes, taps), *blocks, mask)
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
def _find_strong(given, first, width, low, scale, c, out, to, strong):  # type: ignore[no-untyped-def]
    """Votes of a row in whole levels, as OpenCV's, and the blocks in which one exceeds `c`."""
    for b in range(len(strong)):
        count = np.uint64(min(_BLOCK, width - b * _BLOCK))
        at, own, some = np.uint64(first + b * _BLOCK), np.uint64(to + b * _BLOCK), np.int32(0)
        for x in range(count):
            level = np.floor((given[at + x] - low) * scale)
            out[own + x] = level
            some += np.int32(level > c)
        strong[b] = some > 0


@njit(cache=True, nogil=True)
def _stand_out(votes, low, scale, taps, c, places, levels, sums, mean, strong, summed, mask):  # type: ignore[no-untyped-def]
    """Pixels whose level exceeds the mean around, rounded, by `c`.

    At the border the neighbourhood is cut off and every stray event stands out. No mean is below
    0: blocks of a row without a level above `c`, `strong`, are passed over, and rows summed where
    a block beside needs it, `summed`.
    """
    height, width = mask.shape
    rows, reach = len(levels), len(taps) - 1
    border = max(reach, 1)
    given, own, out = votes.reshape(-1), levels.reshape(-1), mask.reshape(-1)
    along = sums.reshape(-1)
    for y in range(height):
        held = y % rows
        _find_strong(given, y * width, width, low, scale, c, own, held * width, strong[held])
        summed[held] = 0
        row = y - reach
        if row < border or row >= height - border:
            continue
        for b in range(strong.shape[1]):
            if not strong[row % rows, b]:
                continue
            x = max(b * _BLOCK, border)
            count = max(min((b + 1) * _BLOCK, width - border) - x, 0)
            for k in range(-reach, reach + 1):
                at = (row + k) % rows
                if not summed[at, b]:
                    for j in range(rows):
                        places[j] = at * width + x - reach + j
                    _add_by_taps(own, places, taps, count, along, at * width + x)
                    summed[at, b] = 1
            for j in range(rows):
                places[j] = ((row + j - reach) % rows) * width + x
            _add_by_taps(along, places, taps, count, mean, 0)
            first, level = np.uint64(row * width + x), np.uint64((row % rows) * width + x)
            for i in range(np.uint64(count)):
                above = own[level + i] > np.rint(mean[i]) + c
                out[first + i] = above & (given[first + i] > 0)


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

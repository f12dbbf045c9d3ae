"""Loops over votes and pixels; the dense form is the sweep's twin, the tests hold both."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def _vote_plane(rays, limits, w, plane):  # type: ignore[no-untyped-def]
    """Bilinear votes on the plane of inverse depth `w`."""
    height, width = plane.shape
    one = plane.dtype.type(1)
    for i in range(len(rays)):
        x = rays[i, 0] + rays[i, 2] * w
        y = rays[i, 1] + rays[i, 3] * w
        # Written so that NaN fails it.
        if x >= 0 and x < width - 1 and y >= 0 and y < height - 1 and w < limits[i]:
            xi = int(x)
            yi = int(y)
            fx = x - plane.dtype.type(xi)
            fy = y - plane.dtype.type(yi)
            gx = one - fx
            gy = one - fy
            plane[yi, xi] += gx * gy
            plane[yi, xi + 1] += fx * gy
            plane[yi + 1, xi] += gx * fy
            plane[yi + 1, xi + 1] += fx * fy


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep_bands(  # type: ignore[no-untyped-def]
    rays, limits, source, starts, first, step, tiles, inverse, plane, best, number, votes, index
):
    """Maxima of every `step`-th band from `first` on; see `_sweep_band` for the buffers."""
    height = len(votes)
    rows = len(best)
    for b in range(first, len(starts) - 1, step):
        if tiles and starts[b] == starts[b + 1]:
            continue
        own = slice(starts[b], starts[b + 1])
        best[:] = 0
        number[:] = 0
        top = b * rows
        _sweep_band(rays[own], limits, source[own], inverse, top, height, plane, best, number)
        for r in range(min(rows, height - top)):
            votes[top + r] = best[r]
            index[top + r] = number[r]


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep_bands_views(  # type: ignore[no-untyped-def]
    rays, limits, source, starts, first, step, tiles, inverse, halves, pad, hats, best, number,
    votes, index,
):  # fmt: skip
    """As `_sweep_bands`, for several views."""
    height = votes.shape[1]
    rows = best.shape[1]
    for b in range(first, len(starts) - 1, step):
        if tiles and starts[b] == starts[b + 1]:
            continue
        own = slice(starts[b], starts[b + 1])
        best[:] = 0
        number[:] = 0
        hats[:] = 0
        top = b * rows
        _sweep_band_views(
            rays[own], limits, source[own], inverse, halves, top, height, pad, hats, best, number
        )  # fmt: skip
        for j in range(len(votes)):
            for r in range(min(rows, height - top)):
                votes[j, top + r] = best[j, r]
                index[j, top + r] = number[j, r]


@njit(cache=True, nogil=True)
def _any_limited(limits, source, inverse):  # type: ignore[no-untyped-def]
    """Whether some plane lies behind the camera of some event."""
    return len(source) > 0 and limits[source].min() <= max(inverse[0], inverse[-1])


@njit(cache=True, nogil=True, error_model="numpy")
def _columns(rays, inverse, width):  # type: ignore[no-untyped-def]
    """First column that rays vote on over all planes, and the one after the last."""
    low = width
    high = 0
    near = inverse[0]
    far = inverse[-1]
    for i in range(len(rays)):
        a = rays[i, 0] + rays[i, 2] * near
        b = rays[i, 0] + rays[i, 2] * far
        # Written so that NaN changes nothing; one more column for rounding.
        if min(a, b) - 1 < low:
            low = int(max(min(a, b) - 1, 0.0))
        if max(a, b) + 3 > high:
            high = int(min(max(a, b) + 3, np.float64(width)))
    return low, high


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep_band(  # type: ignore[no-untyped-def]
    rays, limits, source, inverse, top, height, plane, best, number
):
    """Running maxima of a band's rows.

    `plane` holds the rows from `top` - 1 on and one below the band; `best` and `number` the
    band's own rows.
    """
    rows, width = plane.shape
    one = plane.dtype.type(1)
    flat = plane.reshape(-1)
    # Within the image and the rows at hand; written below so that NaN fails it.
    above = plane.dtype.type(max(top - 1, 0))
    below = plane.dtype.type(min(height, top + rows - 1) - 1)
    right = plane.dtype.type(width - 1)
    low, high = _columns(rays, inverse, width)
    limited = _any_limited(limits, source, inverse)
    for k in range(len(inverse)):
        w = inverse[k]
        plane[:, low:high] = 0
        for i in range(len(rays)):
            x = rays[i, 0] + rays[i, 2] * w
            y = rays[i, 1] + rays[i, 3] * w
            if not (x >= 0 and x < right and y >= above and y < below):
                continue
            if limited and w >= limits[source[i]]:
                continue
            row = np.int32(y)
            yi = row - (top - 1)
            xi = np.int32(x)
            fx = x - plane.dtype.type(xi)
            fy = y - plane.dtype.type(row)
            gx = one - fx
            gy = one - fy
            at = np.uint64(yi * width + xi)
            under = at + np.uint64(width)
            flat[at] += gx * gy
            flat[at + np.uint64(1)] += fx * gy
            flat[under] += gx * fy
            flat[under + np.uint64(1)] += fx * fy
        for r in range(len(best)):
            _keep_larger(
                plane[r + 1, low:high], np.int32(k), best[r, low:high], number[r, low:high]
            )


@njit(cache=True, nogil=True, error_model="numpy")
def _keep_larger(seen, k, best, number):  # type: ignore[no-untyped-def]
    for x in range(len(best)):
        votes = seen[x]
        better = votes > best[x]
        best[x] = votes if better else best[x]
        number[x] = k if better else number[x]


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep_band_views(  # type: ignore[no-untyped-def]
    rays, limits, source, inverse, halves, top, height, pad, votes, best, number
):
    """Running maxima of a band's rows in views shifted by halves of a pixel.

    Votes are hats on a grid of half pixels, shape (rows, 2, columns): its whole and its half
    positions, `pad` pixels wider than the image on either side. A hat of one pixel is the sum of
    the hat of half a pixel in its middle and half of those beside it, so the views' votes are
    exactly bilinear.
    """
    rows, _, wide = votes.shape
    views, own, width = best.shape
    one = votes.dtype.type(1)
    two = votes.dtype.type(2)
    flat = votes.reshape(-1)
    # Within the image and the rows at hand; written below so that NaN fails it.
    above = votes.dtype.type(max(top - 1, 0))
    below = votes.dtype.type(min(height, top + rows - 1) - 1)
    right = votes.dtype.type(wide - 1)
    low, high = _columns(rays, inverse, wide)
    limited = _any_limited(limits, source, inverse)
    for k in range(len(inverse)):
        w = inverse[k]
        votes[:, :, low:high] = 0
        for i in range(len(rays)):
            x = rays[i, 0] + rays[i, 2] * w
            y = rays[i, 1] + rays[i, 3] * w
            if not (x >= 0 and x < right and y >= above and y < below):
                continue
            if limited and w >= limits[source[i]]:
                continue
            row = np.int32(y)
            yi = row - (top - 1)
            h = x * two
            hi = np.int32(h)
            fx = h - votes.dtype.type(hi)
            fy = y - votes.dtype.type(row)
            gx = one - fx
            # Whole positions first, half ones behind them; the next is of the other kind.
            odd = hi & 1
            base = 2 * yi * wide
            at = np.uint64(base + odd * wide + (hi >> 1))
            beside = np.uint64(base + (1 - odd) * wide + ((hi + 1) >> 1))
            gy = one - fy
            under = np.uint64(2 * wide)
            flat[at] += gx * gy
            flat[beside] += fx * gy
            flat[at + under] += gx * fy
            flat[beside + under] += fx * fy
        for j in range(views):
            left = (halves[j, k] >> 1) + pad
            # The view's columns that see some of the votes; a hat reaches one beside it.
            first = max(low - left, 0)
            last = min(high - left, width)
            if last <= first:
                continue
            a = left + first
            b = left + last
            for r in range(own):
                # Half positions lie between whole ones: that of x is at x + 1/2.
                if halves[j, k] & 1:
                    _keep_larger_hat(
                        votes[r + 1, 1, a:b], votes[r + 1, 0, a : b + 1], np.int32(k),
                        best[j, r, first:last], number[j, r, first:last],
                    )  # fmt: skip
                else:
                    _keep_larger_hat(
                        votes[r + 1, 0, a:b], votes[r + 1, 1, a - 1 : b], np.int32(k),
                        best[j, r, first:last], number[j, r, first:last],
                    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def _keep_larger_hat(middle, beside, k, best, number):  # type: ignore[no-untyped-def]
    half = middle.dtype.type(0.5)
    for x in range(len(best)):
        votes = middle[x] + half * (beside[x] + beside[x + 1])
        better = votes > best[x]
        best[x] = votes if better else best[x]
        number[x] = k if better else number[x]

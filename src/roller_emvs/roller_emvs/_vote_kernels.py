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
def _sweep_band(rays, limits, inverse, top, height, plane, best, number):  # type: ignore[no-untyped-def]
    """Running maxima of a band's rows.

    `plane` holds the rows from `top` - 1 on and one below the band; `best` and `number` the
    band's own rows.
    """
    rows, width = plane.shape
    one = plane.dtype.type(1)
    flat = plane.reshape(-1)
    for k in range(len(inverse)):
        w = inverse[k]
        plane[:] = 0
        for i in range(len(rays)):
            x = rays[i, 0] + rays[i, 2] * w
            y = rays[i, 1] + rays[i, 3] * w
            if not (x >= 0 and x < width - 1 and y >= 0 and y < height - 1 and w < limits[i]):
                continue
            row = np.int32(y)
            yi = row - (top - 1)
            if yi < 0 or yi > rows - 2:
                continue
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
            _keep_larger(plane[r + 1], np.int32(k), best[r], number[r])


@njit(cache=True, nogil=True, error_model="numpy")
def _keep_larger(seen, k, best, number):  # type: ignore[no-untyped-def]
    for x in range(len(best)):
        votes = seen[x]
        better = votes > best[x]
        best[x] = votes if better else best[x]
        number[x] = k if better else number[x]


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep_band_views(  # type: ignore[no-untyped-def]
    rays, limits, inverse, halves, top, height, pad, even, odd, best, number
):
    """Running maxima of a band's rows in views shifted by halves of a pixel.

    Votes are hats on a grid of half pixels, `even` its whole and `odd` its half positions, `pad`
    pixels wider than the image on either side. A hat of one pixel is the sum of the hat of half
    a pixel in its middle and half of those beside it, so the views' votes are exactly bilinear.
    """
    rows, wide = even.shape
    views, own, width = best.shape
    one = even.dtype.type(1)
    two = even.dtype.type(2)
    flat_even = even.reshape(-1)
    flat_odd = odd.reshape(-1)
    for k in range(len(inverse)):
        w = inverse[k]
        even[:] = 0
        odd[:] = 0
        for i in range(len(rays)):
            x = rays[i, 0] + rays[i, 2] * w
            y = rays[i, 1] + rays[i, 3] * w
            if not (x >= 0 and x < wide - 1 and y >= 0 and y < height - 1 and w < limits[i]):
                continue
            row = np.int32(y)
            yi = row - (top - 1)
            if yi < 0 or yi > rows - 2:
                continue
            h = x * two
            hi = np.int32(h)
            fx = h - even.dtype.type(hi)
            fy = y - even.dtype.type(row)
            gx = one - fx
            gy = one - fy
            at = np.uint64(yi * wide + (hi >> 1))
            under = at + np.uint64(wide)
            if hi & 1:
                flat_odd[at] += gx * gy
                flat_odd[under] += gx * fy
                flat_even[at + np.uint64(1)] += fx * gy
                flat_even[under + np.uint64(1)] += fx * fy
            else:
                flat_even[at] += gx * gy
                flat_even[under] += gx * fy
                flat_odd[at] += fx * gy
                flat_odd[under] += fx * fy
        for j in range(views):
            left = (halves[j, k] >> 1) + pad
            for r in range(own):
                # Half positions lie between whole ones: odd[x] is at x + 1/2.
                if halves[j, k] & 1:
                    _keep_larger_hat(
                        odd[r + 1, left : left + width], even[r + 1, left : left + width + 1],
                        np.int32(k), best[j, r], number[j, r],
                    )  # fmt: skip
                else:
                    _keep_larger_hat(
                        even[r + 1, left : left + width],
                        odd[r + 1, left - 1 : left + width],
                        np.int32(k), best[j, r], number[j, r],
                    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def _keep_larger_hat(middle, beside, k, best, number):  # type: ignore[no-untyped-def]
    half = middle.dtype.type(0.5)
    for x in range(len(best)):
        votes = middle[x] + half * (beside[x] + beside[x + 1])
        better = votes > best[x]
        best[x] = votes if better else best[x]
        number[x] = k if better else number[x]

"""Loops over the pages of a store that make rays of events, a page at a time, and use them.

Rays of a block take more memory than its events do, and they are needed twice: once for where they
meet the surface, once in order of that. So they are made twice, and none is kept.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_emvs.evidence._meet_kernels import _ground
from roller_emvs.lines._kernels import _by_pixel

from ._event_kernels import PAGE, _scales


@njit(cache=True, nogil=True, error_model="numpy")
def _page(records, page, count, begin, scales, every, ends, own):  # type: ignore[no-untyped-def]
    """Every n-th event of a page as a ray in pixels from (`begin`, `top`) on; how many.

    `scales`: `top`, `pixel`, length of a piece and steepest slope; `begin` is from a piece on.
    Rays are straight across; those whose slope isn't within `ends`, shape (2,), are left out: of
    most pages none or all are. `own`, shape (PAGE, 4), takes them.
    """
    top, pixel, piece_m, steepest = scales
    per, step, zero = np.float32(1.0 / pixel), np.uint64(every), np.float32(0)
    per_x, first_x, per_slope, first_slope = _scales(piece_m, steepest)
    left = (first_x - np.float32(begin)) * per
    top, per_x = np.float32(top), per_x * per
    least, most = np.float32(ends[0]), np.float32(ends[1])
    xs, slopes, ys = records[0][page, 0], records[0][page, 1], records[1][page]
    n = np.uint64(-(-min(PAGE, count) // every))
    outside = False
    for k in range(n):
        i = k * step
        slope = first_slope + np.float32(slopes[i]) * per_slope
        outside |= (slope < least) | (slope > most)
        own[k, 0] = left + np.float32(xs[i]) * per_x
        own[k, 1] = (ys[i] - top) * per
        own[k, 2] = slope * per
        own[k, 3] = zero
    if outside:
        kept = np.uint64(0)
        for k in range(n):
            a, b, along = own[k, 0], own[k, 1], own[k, 2]
            slope = first_slope + np.float32(slopes[k * step]) * per_slope
            own[kept, 0] = a
            own[kept, 1] = b
            own[kept, 2] = along
            kept += np.uint64((slope >= least) & (slope <= most))
        n = kept
    return np.int64(n)


@njit(cache=True, nogil=True, error_model="numpy")
def _rays(records, link, chains, scales, every, ends, out):  # type: ignore[no-untyped-def]
    """Every n-th event of chains of pages as rays; how many. `scales` as of `_page`.

    `chains` are where the rays' frame begins, from each piece on, first pages and counts. `out`,
    shape (n, 4), needs room for those that are left out too.
    """
    begins, pages, counts = chains
    done = 0
    for chain in range(len(pages)):
        page, count = pages[chain], counts[chain]
        while page >= 0:
            done += _page(records, page, count, begins[chain], scales, every, ends, out[done:])
            count -= PAGE
            page = link[page]
    return done


@njit(cache=True, nogil=True, error_model="numpy")
def _ground_pages(  # type: ignore[no-untyped-def]
    records, link, chains, scales, every, ends, surface, start, width, own, pixel, counted
):
    """`_ground` of the rays of chains of pages, as of `_rays`; how many. `own` is for use."""
    begins, pages, counts = chains
    corner = (0.0, 0.0)
    done = 0
    for chain in range(len(pages)):
        page, count = pages[chain], counts[chain]
        while page >= 0:
            n = _page(records, page, count, begins[chain], scales, every, ends, own)
            _ground(own[:n], corner, surface, start, width, pixel[done : done + n], counted)
            done += n
            count -= PAGE
            page = link[page]
    return done


@njit(cache=True, nogil=True, error_model="numpy")
def _pages_by_pixel(records, link, chains, scales, every, ends, own, pixel, place, out):  # type: ignore[no-untyped-def]
    """`_by_pixel` of the rays of chains of pages, as of `_rays`. `own` is for use."""
    begins, pages, counts = chains
    done = 0
    for chain in range(len(pages)):
        page, count = pages[chain], counts[chain]
        while page >= 0:
            n = _page(records, page, count, begins[chain], scales, every, ends, own)
            _by_pixel(own[:n], pixel[done : done + n], place, out)
            done += n
            count -= PAGE
            page = link[page]

"""Kernels of the Braille reader; `warp.py` holds their NumPy twins."""

from __future__ import annotations

import math

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def _vote(x, y, t, p, table, knots_ns, maps, strip, newest):  # type: ignore[no-untyped-def]
    """Warp events onto the surface and count them there.

    x, y: uint16 (n,); t: int64 (n,), growing; p: uint8 (n,), 0 or 1; table: float32 (h, w, 2),
    pixels whose u is below -1e8 are left out; knots_ns: int64 (k,), k >= 2; maps: float64
    (k, 3, 3), pixel to (column, row)
    of the strip at the knots, linear in between; strip: float32 (2, rows, columns), counted into
    by polarity;
    newest: int64 (columns,), time of each column's newest event. Returns the events counted.
    """
    _, rows, columns = strip.shape
    last = len(knots_ns) - 2
    k = 0
    used = 0
    m = np.zeros((3, 3))
    made_ns, made = 0, False
    for i in range(len(x)):
        row = np.uint64(y[i])
        column = np.uint64(x[i])
        u = table[row, column, 0]
        if u < -1e8:
            continue
        v = table[row, column, 1]
        # Events of one read-out share their time, and so their map.
        if not made or t[i] != made_ns:
            made_ns, made = t[i], True
            while k < last and made_ns >= knots_ns[k + 1]:
                k += 1
            f = (made_ns - knots_ns[k]) / (knots_ns[k + 1] - knots_ns[k])
            for j in range(3):
                for n in range(3):
                    m[j, n] = (1.0 - f) * maps[k, j, n] + f * maps[k + 1, j, n]
        w = m[2, 0] * u + m[2, 1] * v + m[2, 2]
        if w == 0.0:  # it looks along the surface
            continue
        ci = math.floor((m[0, 0] * u + m[0, 1] * v + m[0, 2]) / w + 0.5)
        ri = math.floor((m[1, 0] * u + m[1, 1] * v + m[1, 2]) / w + 0.5)
        if 0 <= ci < columns and 0 <= ri < rows:
            strip[p[i], ri, ci] += 1.0
            newest[ci] = made_ns
            used += 1
    return used


@numba.njit(cache=True, nogil=True)
def _contrasts(along, offset, down, scales, px, first, image, out):  # type: ignore[no-untyped-def]
    """Contrast of the image of warped events at each of some scales of their offset.

    along, offset, down: float64 (n,), metres: place of the camera, of the event from there, and of
    the event across the roll; scales: float64 (k,); px: metres a pixel; first: float64 (2,), place
    of the first column and row; image: float64 (rows, columns), scratch; out: float64 (k,), set to
    the sum of squares of the image. An event is shared by two columns, by its distance to them.
    """
    rows, columns = image.shape
    for k in range(len(scales)):
        image[:] = 0.0
        for i in range(len(along)):
            c = (along[i] + scales[k] * offset[i] - first[0]) / px
            r = math.floor((down[i] - first[1]) / px + 0.5)
            ci = math.floor(c)
            if 0 <= ci < columns - 1 and 0 <= r < rows:
                image[r, ci] += 1.0 - (c - ci)
                image[r, ci + 1] += c - ci
        total = 0.0
        for r in range(rows):
            for ci in range(columns):
                total += image[r, ci] * image[r, ci]
        out[k] = total

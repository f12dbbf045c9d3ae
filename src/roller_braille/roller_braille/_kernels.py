"""Kernels of the Braille reader; `warp.py` holds their NumPy twins."""

from __future__ import annotations

import math

import numba
import numpy as np

from roller_core._array_kernels import _median_of_few

#: Events that are warped before they are counted.
_CHUNK = 512


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _place(count, when, u, v, m, d, right, below, column, place):  # type: ignore[no-untyped-def]
    """Column and place in a strip's image of events at pixels u, v; place -1 outside it.

    m, d: float64 (3, 3), map and its change over the time between two knots, of which `when`,
    float64 (n,), is the share. A function of its own, over arrays of its own: so the compiler
    takes several events at once.
    """
    m00, m01, m02 = m[0, 0], m[0, 1], m[0, 2]
    m10, m11, m12 = m[1, 0], m[1, 1], m[1, 2]
    m20, m21, m22 = m[2, 0], m[2, 1], m[2, 2]
    d00, d01, d02 = d[0, 0], d[0, 1], d[0, 2]
    d10, d11, d12 = d[1, 0], d[1, 1], d[1, 2]
    d20, d21, d22 = d[2, 0], d[2, 1], d[2, 2]
    for i in range(count):
        f, a, b = when[i], np.float64(u[i]), np.float64(v[i])
        w = (m20 + f * d20) * a + (m21 + f * d21) * b + m22 + f * d22
        c = (m00 + f * d00) * a + (m01 + f * d01) * b + m02 + f * d02
        r = (m10 + f * d10) * a + (m11 + f * d11) * b + m12 + f * d12
        w = 1.0 / w
        c = np.floor(c * w + 0.5)
        r = np.floor(r * w + 0.5)
        # Written so that NaN fails it: of w = 0, which looks along the surface.
        inside = (a >= -1e8) & (c >= 0) & (c < right) & (r >= 0) & (r < below)
        column[i] = np.int32(c if inside else 0.0)
        place[i] = np.int32(r * right + c if inside else -1.0)


@numba.njit(cache=True, nogil=True, error_model="numpy")
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
    flat = strip.reshape(-1)
    pixels = table.reshape(-1)
    width = np.uint64(table.shape[1])
    size = np.uint64(rows * columns)
    one, two = np.uint64(1), np.uint64(2)
    when = np.empty(_CHUNK, np.float64)
    u, v = np.empty(_CHUNK, np.float32), np.empty(_CHUNK, np.float32)
    column, place = np.empty(_CHUNK, np.int32), np.empty(_CHUNK, np.int32)
    right, below = np.float64(columns), np.float64(rows)
    last = len(knots_ns) - 2
    k = start = used = 0
    while start < len(x):
        while k < last and t[start] >= knots_ns[k + 1]:
            k += 1
        stop = min(start + _CHUNK, len(x))
        while k < last and t[stop - 1] >= knots_ns[k + 1]:
            stop -= 1
        begin = np.uint64(start)
        count = np.uint64(stop - start)
        share = 1.0 / (knots_ns[k + 1] - knots_ns[k])
        for i in range(count):
            at = two * (np.uint64(y[begin + i]) * width + np.uint64(x[begin + i]))
            u[i] = pixels[at]
            v[i] = pixels[at + one]
            when[i] = (t[begin + i] - knots_ns[k]) * share
        m = maps[k]
        _place(count, when, u, v, m, maps[k + 1] - m, right, below, column, place)
        for i in range(count):
            if place[i] >= 0:
                flat[np.uint64(place[i]) + size * np.uint64(p[begin + i])] += np.float32(1)
                newest[np.uint64(column[i])] = t[begin + i]
                used += 1
        start = stop
    return used


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sample(x, y, t, table, least, knots_ns, maps, travel, along, offset, down):  # type: ignore[no-untyped-def]
    """Warp events by the map of the knot before each; how many, without those of pixels left out.

    Fields as in `_vote`; least: pixels with a u no greater are left out; travel: float64 (k,),
    places of the camera; along, offset, down: float64 (n,), written to, see `contrast.Sample`.
    """
    n = k = 0
    last = len(knots_ns) - 2
    for i in range(len(x)):
        u, v = np.float64(table[y[i], x[i], 0]), np.float64(table[y[i], x[i], 1])
        if not u > least:
            continue
        while k < last and t[i] >= knots_ns[k + 1]:
            k += 1
        f = (t[i] - knots_ns[k]) / (knots_ns[k + 1] - knots_ns[k])
        m = maps[k]
        w = m[2, 0] * u + m[2, 1] * v + m[2, 2]
        along[n] = travel[k] + f * (travel[k + 1] - travel[k])
        offset[n] = (m[0, 0] * u + m[0, 1] * v + m[0, 2]) / w - travel[k]
        down[n] = (m[1, 0] * u + m[1, 1] * v + m[1, 2]) / w
        n += 1
    return n


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


@numba.njit(cache=True, nogil=True)
def _medians(patches, room, out):  # type: ignore[no-untyped-def]
    """Median of each pixel of some patches, float32 (k, rows, columns); `room` is of k."""
    _, rows, columns = patches.shape
    for i in range(rows):
        for j in range(columns):
            for k in range(len(room)):
                room[k] = patches[k, i, j]
            out[i, j] = _median_of_few(room)

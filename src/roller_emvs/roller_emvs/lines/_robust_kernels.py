"""Robust fits of lines to the events around places; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_core._array_kernels import _copy

from ._track_kernels import _LOOK, _PER_PX, _first_track

#: Events that are worked on together, and where those lie that fill them up, px.
_VECTOR = np.uint64(16)
_AWAY = np.float32(1e6)
#: Least share of the weights that holds a line: where events spread wider than the fit looks, what
#: it leaves out on one side balances what it takes on the other.
_SLACK = 0.05
#: Width of a band, one deviation, px, from which on it may be of several tracks, and up to which a
#: track is one. On the virtual cell, whose read-out frames and thresholds blur tracks, hardly any
#: is as narrow; where they show, 0.2.
_WIDE_PX, _TRACK_PX = 0.5, 0.28
#: Distance from a track from which on an event counts for nothing, px, and rounds of its fit.
_TRACK_TUKEY_PX, _TRACK_ROUNDS = 1.0, 2
#: Lines of a wide band that are looked at before it is known whether tracks show, the share of them
#: that have any if so, and of how many others one is still looked at if not.
_PROBES, _SHOWS, _STILL = 8, 0.1, 16


@njit(cache=True, nogil=True, error_model="numpy")
def _window(rays, starts, width, place, half, sample, every, some):  # type: ignore[no-untyped-def]
    """Events around a place (row, column and offset): x and y from there on, and slopes.

    `every`, shape (3, room), receives all, `some` about `sample` of them, evenly, if they are more
    than twice as many; returns their numbers, 0 of `some` if it has none. Those further than `half`
    across are put out of reach, as is what fills the last vector.
    """
    rows = (len(starts) - 1) // width
    r, c, z = np.int64(place[0]), np.int64(place[1]), np.float32(place[2])
    left, above, across = np.float32(c), np.float32(r), np.float32(half[1])
    reach_x, reach_y = np.int64(np.ceil(half[0])) + 1, np.int64(np.ceil(half[1]))
    low, high = max(c - reach_x, 0), min(c + reach_x + 1, width)
    top, bottom = max(r - reach_y, 0), min(r + reach_y + 1, rows)
    count = 0
    for i in range(top, bottom):
        count += starts[i * width + high] - starts[i * width + low]
    stride = np.uint64(max(count // sample, 1))
    n = few = np.uint64(0)
    for i in range(top, bottom):
        first = np.uint64(starts[i * width + low])
        size = np.uint64(starts[i * width + high]) - first
        for k in range(size):
            e = first + k
            y = rays[e, 1] + rays[e, 3] * z - above
            x = rays[e, 0] + rays[e, 2] * z - left
            every[0, n + k] = x if abs(y) <= across else _AWAY
            every[1, n + k] = y
            every[2, n + k] = rays[e, 2]
        if stride > np.uint64(1):
            for k in range(np.uint64(0), size, stride):
                for value in range(3):
                    some[value, few] = every[value, n + k]
                few += np.uint64(1)
        n += size
    for k in range(_VECTOR):
        every[0, n + k] = some[0, few + k] = _AWAY
        every[1, n + k] = every[2, n + k] = np.float32(0)
        some[1, few + k] = some[2, few + k] = np.float32(0)
    return n, few


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _sums(events, count, line, middle, half, tukey, evenly):  # type: ignore[no-untyped-def]
    """Weighted sums over events: 1, a, y, a², ay, y²; x, xa, xy; squared weights.

    And what a robust fit's variance is of: the squares of what it sums, and how fast that changes
    with the residual.

    a are slopes from `middle` on, and the residuals those of a `line` p, d, m. Events within
    `half` of it count `evenly`, or by Tukey's weights.
    """
    p, d, m = np.float32(line[0]), np.float32(line[1]), np.float32(line[2])
    zero, one = np.float32(0), np.float32(1)
    middle, half, per = np.float32(middle), np.float32(half), np.float32(1.0 / tukey)
    s0 = sa = sy = saa = say = syy = sx = sxa = sxy = sww = spp = srw = zero
    for i in range(-(-count // _VECTOR) * _VECTOR):
        x, y, a = events[0, i], events[1, i], events[2, i] - middle
        rest = x - p - d * a - m * y
        if evenly:
            w = one if abs(rest) <= half else zero
            v = w
        else:
            u = rest * per
            u = max(one - u * u, zero)
            v = u
            w = u * u
        wa = w * a
        wy = w * y
        s0 += w
        sa += wa
        sy += wy
        saa += wa * a
        say += wa * y
        syy += wy * y
        sx += w * x
        sxa += wa * x
        sxy += wy * x
        sww += w * w
        srw += w * w * rest * rest
        spp += v * (np.float32(5) * v - np.float32(4))
    return s0, sa, sy, saa, say, syy, sx, sxa, sxy, sww, srw, spp


@njit(cache=True, nogil=True, error_model="numpy")
def _round(events, count, line, middle, half, tukey, evenly, fit):  # type: ignore[no-untyped-def]
    """One round of a fit: moves the `line`, fills `fit`; whether events fix it.

    `fit` takes the middle of the slopes and, of slopes from there on and rows, whose sums are
    weighted: their number, both sums, squares about the means of slopes, of both and of rows; the
    sum of squared weights; the residuals' variance before the round, for the line's (Huber's of an
    M-estimate). Other arguments as of `_sums`.
    """
    sums = _sums(events, count, line, middle, half, tukey, evenly)
    s0, sa, sy = np.float64(sums[0]), np.float64(sums[1]), np.float64(sums[2])
    saa, say, syy = np.float64(sums[3]), np.float64(sums[4]), np.float64(sums[5])
    sx, sxa, sxy = np.float64(sums[6]), np.float64(sums[7]), np.float64(sums[8])
    if s0 < 8:
        return False
    if evenly:
        # Slopes count from about their mean, so that the sums keep their digits.
        middle = sa / s0
        saa -= sa * middle
        say -= sy * middle
        sxa -= sx * middle
        sa = 0.0
    ya = say - sa * sy / s0
    aa = saa - sa * sa / s0
    yy = syy - sy * sy / s0
    xa = sxa - sx * sa / s0
    xy = sxy - sx * sy / s0
    det = aa * yy - ya * ya
    if not det > 1e-9 * aa * yy:
        return False
    d = (xa * yy - xy * ya) / det
    m = (xy * aa - xa * ya) / det
    p = (sx - d * sa - m * sy) / s0
    if abs(p) > half:
        return False
    line[0] = p
    line[1] = d
    line[2] = m
    fit[0] = middle
    fit[1] = s0
    fit[2] = sa
    fit[3] = sy
    fit[4] = aa
    fit[5] = ya
    fit[6] = yy
    fit[7] = np.float64(sums[9])
    fit[8] = np.float64(sums[10]) * s0 / max(np.float64(sums[11]), _SLACK * s0) ** 2
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _fit_lines(rays, starts, width, row, column, height, half, tukey, rounds, sample, forward, out):  # type: ignore[no-untyped-def]
    """Fit x - x_r = p + slope·d + m·(y - y_r) to the events around each place, robustly.

    `rays` are by pixel of an image `width` wide, pixel k's from `starts[k]` on;
    `height` is the offset of each place, `half` the half width and height of the window, px. All
    rounds but the last take about `sample` of the events. Where they lie in tracks, the line is of
    the first; see `_first_track` for `forward`. `out` takes by place p, d, m; variance
    of p, covariance of p and d, variance of d, all by unit of the residuals' variance; events of
    equal weight; the mean and the variance of the slopes; what the residuals' variance counts as
    for the line's (Huber's variance of an M-estimate). NaN where events fix no line.
    """
    room = 0
    for k in range(len(row)):
        reach = np.int64(np.ceil(half[1])) + 1
        first, last = max(row[k] - reach, 0) * width, min((row[k] + reach) * width, len(starts) - 1)
        room = max(room, starts[last] - starts[first])
    every = np.empty((3, room + _VECTOR), np.float32)
    some = np.empty_like(every)
    line, before, fit = np.empty(3), np.empty(3), np.zeros(9)
    # With one on either side for what lies outside.
    bins = np.empty(int(2 * half[0] * _PER_PX) + 2, np.int32)
    looks, bin_of = np.empty((2, 2 * _LOOK), np.float32), np.empty(2 * _LOOK, np.int32)
    wide = looked = tracks = 0
    for k in range(len(row)):
        out[k, :] = np.nan
        place = (row[k], column[k], height[k])
        count, few = _window(rays, starts, width, place, half, sample, every, some)
        events, n = (some, few) if few else (every, count)
        line[:] = 0.0
        fit[0] = 0.0
        held = True
        for it in range(rounds):
            held = held and _round(events, n, line, fit[0], half[0], tukey, it == 0, fit)
        if not held:
            continue
        reach = tukey
        if fit[8] > _WIDE_PX**2:
            wide += 1
            if looked < _PROBES or tracks >= _SHOWS * looked or wide % _STILL == 0:
                looked += 1
                _copy(line, before)
                _first_track(
                    events, n, line, fit[0], half[0], fit[4] / fit[1], forward, looks, bin_of, bins
                )
                for _ in range(_TRACK_ROUNDS):
                    held = held and _round(
                        events, n, line, fit[0], half[0], _TRACK_TUKEY_PX, False, fit
                    )
                if held and fit[8] <= _TRACK_PX**2:
                    reach = _TRACK_TUKEY_PX
                    tracks += 1
                else:
                    _copy(before, line)
        if not _round(every, count, line, fit[0], half[0], reach, rounds == 0, fit):
            continue
        middle, s0, sa, sy = fit[0], fit[1], fit[2], fit[3]
        aa, ya, yy = fit[4], fit[5], fit[6]
        det = aa * yy - ya * ya
        ymean = sy / s0
        vaa = yy / det
        vyy = aa / det
        vay = -ya / det
        # From slopes about `middle` to slopes about none.
        at = sa / s0 + middle
        out[k, 0] = line[0] - line[1] * middle
        out[k, 1] = line[1]
        out[k, 2] = line[2]
        out[k, 3] = 1 / s0 + at * at * vaa + 2 * at * ymean * vay + ymean * ymean * vyy
        out[k, 4] = -at * vaa - ymean * vay
        out[k, 5] = vaa
        out[k, 6] = s0 * s0 / fit[7]
        out[k, 7] = at
        out[k, 8] = aa / s0
        out[k, 9] = fit[8]

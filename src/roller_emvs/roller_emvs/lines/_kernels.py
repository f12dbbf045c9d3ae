"""Loops over events that fit lines to them; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

_ROUNDS = 4


@njit(cache=True, nogil=True)
def _ground(rays, surface, start, pixel, counts):  # type: ignore[no-untyped-def]
    """Pixel in which each event meets the surface (-1: none), and how many meet each.

    `surface` is the offset by pixel, NaN where it is unknown; a ray is followed from `start`.
    """
    height, width = surface.shape
    half = np.float32(0.5)
    for i in range(len(rays)):
        x = rays[i, 0] + half
        y = rays[i, 1] + half
        z = start
        found = -1
        for _ in range(_ROUNDS):
            a = x + rays[i, 2] * z
            b = y + rays[i, 3] * z
            if not ((a >= 0) & (a < width) & (b >= 0) & (b < height)):
                found = -1
                break
            # Unsigned, as what may be negative is checked to count from the end.
            row = np.uint32(b)
            column = np.uint32(a)
            here = surface[row, column]
            if np.isnan(here):
                found = -1
                break
            found = np.int64(row) * width + np.int64(column)
            if here == z:
                break
            z = here
        pixel[i] = found
        if found >= 0:
            counts[found] += 1


@njit(cache=True, nogil=True)
def _by_pixel(rays, pixel, place, out):  # type: ignore[no-untyped-def]
    """Rays in the order of their pixels; `place` is where each pixel's begin, and is moved on."""
    for i in range(len(pixel)):
        p = pixel[i]
        if p >= 0:
            n = place[p]
            for c in range(4):
                out[n, c] = rays[i, c]
            place[p] = n + 1


@njit(cache=True, nogil=True)
def _ridges(density, floor, share, reach, step, row, column):  # type: ignore[no-untyped-def]
    """Pixels of every `step`-th row that hold the most of their neighbours along the row.

    They must hold `floor`, and `share` of the most within `reach` columns. Returns their number;
    `row` and `column` hold as many as there is room for.
    """
    height, width = density.shape
    n = 0
    for y in range(0, height, step):
        for x in range(1, width - 1):
            d = density[y, x]
            if d < floor or d < density[y, x - 1] or d <= density[y, x + 1]:
                continue
            most = d
            for k in range(max(x - reach, 0), min(x + reach + 1, width)):
                most = max(most, density[y, k])
            if d >= share * most and n < len(row):
                row[n] = y
                column[n] = x
                n += 1
    return n


@njit(cache=True, nogil=True)
def _fit_lines(rays, starts, width, row, column, height, half, tukey, rounds, sample, out):  # type: ignore[no-untyped-def]
    """Fit x - x_r = p + slope·d + m·(y - y_r) to the events around each place, robustly.

    `rays` are by pixel of an image `width` wide, pixel k's from `starts[k]` on; `height` is the
    offset of each place, `half` the half width and height of the window, px. All rounds but the
    last take about `sample` of the events. `out` takes by place p, d, m; variance of p, covariance
    of p and d, variance of d, all by unit of the residuals' variance; events of equal weight; the
    mean and the variance of the slopes; the residuals' variance. NaN where events fix no line.
    """
    rows = (len(starts) - 1) // width
    reach_x = int(np.ceil(half[0])) + 1
    reach_y = int(np.ceil(half[1]))
    for k in range(len(row)):
        r = row[k]
        c = column[k]
        z = height[k]
        out[k, :] = np.nan
        low = max(c - reach_x, 0)
        high = min(c + reach_x + 1, width)
        top = max(r - reach_y, 0)
        bottom = min(r + reach_y + 1, rows)
        count = 0
        for i in range(top, bottom):
            count += starts[i * width + high] - starts[i * width + low]
        stride = max(count // sample, 1)
        p = 0.0
        d = 0.0
        m = 0.0
        middle = 0.0
        for it in range(rounds + 1):
            step = 1 if it == rounds else stride
            s0 = sa = sy = saa = say = syy = 0.0
            sx = sxa = sxy = sxx = sww = 0.0
            for i in range(top, bottom):
                for e in range(starts[i * width + low], starts[i * width + high], step):
                    slope = rays[e, 2]
                    x = rays[e, 0] + slope * z - c
                    y = rays[e, 1] + rays[e, 3] * z - r
                    if abs(y) > half[1]:
                        continue
                    a = slope - middle
                    rest = x - p - a * d - m * y
                    if it == 0:
                        if abs(rest) > half[0]:
                            continue
                        w = 1.0
                    else:
                        u = rest / tukey
                        u = 1.0 - u * u
                        if u <= 0:
                            continue
                        w = u * u
                    s0 += w
                    sa += w * a
                    sy += w * y
                    saa += w * a * a
                    say += w * a * y
                    syy += w * y * y
                    sx += w * x
                    sxa += w * x * a
                    sxy += w * x * y
                    sxx += w * rest * rest
                    sww += w * w
            if s0 < 8:
                break
            if it == 0:
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
                break
            d = (xa * yy - xy * ya) / det
            m = (xy * aa - xa * ya) / det
            p = (sx - d * sa - m * sy) / s0
            if abs(p) > half[0]:
                break
            if it == rounds:
                ymean = sy / s0
                vaa = yy / det
                vyy = aa / det
                vay = -ya / det
                # From slopes about `middle` to slopes about none.
                at = sa / s0 + middle
                out[k, 0] = p - d * middle
                out[k, 1] = d
                out[k, 2] = m
                out[k, 3] = 1 / s0 + at * at * vaa + 2 * at * ymean * vay + ymean * ymean * vyy
                out[k, 4] = -at * vaa - ymean * vay
                out[k, 5] = vaa
                out[k, 6] = s0 * s0 / sww
                out[k, 7] = at
                out[k, 8] = aa / s0
                out[k, 9] = sxx / s0


@njit(cache=True, nogil=True)
def _vote(row, x, slope, offset, last, reach_y, reach_x, most, votes, near):  # type: ignore[no-untyped-def]
    """Median offset of the lines along each line's contour, and how many there are.

    Lines are sorted by row; `last[k]` is where the rows from `row[k]` + `reach_y` on begin.
    """
    values = np.empty(most)
    first = 0
    for k in range(len(row)):
        while row[first] < row[k] - reach_y:
            first += 1
        n = 0
        for j in range(first, last[k]):
            if abs(x[j] - x[k] - slope[k] * (row[j] - row[k])) < reach_x and n < most:
                values[n] = offset[j]
                n += 1
        votes[k] = np.median(values[:n])
        near[k] = n

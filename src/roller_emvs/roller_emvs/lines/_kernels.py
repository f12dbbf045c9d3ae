"""Loops over events that fit lines to them; each has a numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_core._array_kernels import _median_of_few

#: Events that are worked on together, and where those lie that fill them up, px.
_VECTOR = np.uint64(16)
_AWAY = np.float32(1e6)
#: Least share of the weights that holds a line: where events spread wider than the fit looks, what
#: it leaves out on one side balances what it takes on the other.
_SLACK = 0.05


@njit(cache=True, nogil=True)
def _starts(counts, wanted, starts, place):  # type: ignore[no-untyped-def]
    """Where the events of each pixel begin if those of `wanted` pixels are put in order; how many.

    `wanted`, shape (rows, columns), is of the image, all others are flat.

    `place` is the same, -1 where there are none, as in the last entry of `counts`: nowhere.
    """
    n, none = np.int32(0), np.int32(-1)
    height, width = wanted.shape
    flat, size = wanted.reshape(-1), np.uint64(width)
    for i in range(height):
        begin, some = np.uint64(i * width), False
        for j in range(size):
            some |= flat[begin + j] != 0
        if some:
            for j in range(size):
                count = counts[begin + j] if flat[begin + j] else np.int32(0)
                starts[begin + j] = n
                place[begin + j] = n if count else none
                n += count
        else:
            for j in range(size):
                starts[begin + j] = n
                place[begin + j] = none
    starts[-1] = n
    place[-1] = -1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _by_pixel(rays, pixel, place, out):  # type: ignore[no-untyped-def]
    """Rays in the order of their pixels.

    `place` is where each pixel's begin, and is moved on; below 0, they are left out.
    """
    one, two, three, four = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4)
    own, flat = rays.reshape(-1), out.reshape(-1)
    for i in range(np.uint64(len(pixel))):
        k = np.uint64(pixel[i])
        n = place[k]
        if n >= 0:
            # All are read before any is written, so that a ray is moved in one go.
            at, to = four * i, four * np.uint64(n)
            x, y, along, across = own[at], own[at + one], own[at + two], own[at + three]
            flat[to] = x
            flat[to + one] = y
            flat[to + two] = along
            flat[to + three] = across
            place[k] = n + 1


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
def _fit_lines(rays, starts, width, row, column, height, half, tukey, rounds, sample, out):  # type: ignore[no-untyped-def]
    """Fit x - x_r = p + slope·d + m·(y - y_r) to the events around each place, robustly.

    `rays` are by pixel of an image `width` wide, pixel k's from `starts[k]` on;
    `height` is the offset of each place, `half` the half width and height of the window, px. All
    rounds but the last take about `sample` of the events. `out` takes by place p, d, m; variance
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
    line = np.empty(3)
    for k in range(len(row)):
        out[k, :] = np.nan
        place = (row[k], column[k], height[k])
        count, few = _window(rays, starts, width, place, half, sample, every, some)
        line[:] = 0.0
        middle = 0.0
        for it in range(rounds + 1):
            last = it == rounds
            events, n = (some, few) if few and not last else (every, count)
            sums = _sums(events, n, line, middle, half[0], tukey, it == 0)
            s0, sa, sy = np.float64(sums[0]), np.float64(sums[1]), np.float64(sums[2])
            saa, say, syy = np.float64(sums[3]), np.float64(sums[4]), np.float64(sums[5])
            sx, sxa, sxy = np.float64(sums[6]), np.float64(sums[7]), np.float64(sums[8])
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
            line[0] = p
            line[1] = d
            line[2] = m
            if last:
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
                out[k, 6] = s0 * s0 / np.float64(sums[9])
                out[k, 7] = at
                out[k, 8] = aa / s0
                out[k, 9] = np.float64(sums[10]) * s0 / max(np.float64(sums[11]), _SLACK * s0) ** 2


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
        votes[k] = _median_of_few(values[:n])
        near[k] = n


@njit(cache=True, nogil=True)
def _along(row, x, slope, value, variance, last, reach_y, reach_x, spread, mean, left):  # type: ignore[no-untyped-def]
    """Mean of a value of the lines along each line's contour, and its variance if none is shared.

    By their variance and a Gaussian over rows of deviation `spread`. Lines are sorted by row;
    `last[k]` is where the rows from `row[k]` + `reach_y` on begin.
    """
    first = 0
    for k in range(len(row)):
        while row[first] < row[k] - reach_y:
            first += 1
        total = summed = squares = 0.0
        for j in range(first, last[k]):
            rows = row[j] - row[k]
            if abs(x[j] - x[k] - 0.5 * (slope[k] + slope[j]) * rows) < reach_x:
                w = np.exp(-0.5 * (rows / spread) ** 2) / variance[j]
                total += w
                summed += w * value[j]
                squares += w * w * variance[j]
        mean[k] = summed / total
        left[k] = squares / total**2

"""Loops over events that place them on a strip and keep them; each has a twin in the tests.

A record of the store is where an event lies in its piece of a block, and its slope, as 16 bits
each, and y as float32: places are rounded to some hundredths of a micrometre, far less than a pixel
of the sensor.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_core._array_kernels import _least, _most

#: Events to a page of the store.
PAGE = 2048
#: Pieces of a block of the store, so that what reaches another block need not be looked for in all.
PIECES = 8
#: What a place in a piece, and a slope, is a number of.
NUMBERS = 1 << 16
#: Events that are placed together.
_CHUNK = 512


@njit(cache=True, nogil=True, error_model="numpy")
def _bounds(x, slope):  # type: ignore[no-untyped-def]
    """Least and largest x, and the largest slope either way; where x is NaN neither counts.

    Of what has the same place in its chunk first: that much vector instructions compare.
    """
    inf, zero = np.float32(np.inf), np.float32(0)
    low, high, most = np.empty((3, _CHUNK), np.float32)
    low[:], high[:], most[:] = inf, -inf, zero
    for start in range(0, len(x), _CHUNK):
        begin = np.uint64(start)
        for i in range(np.uint64(min(_CHUNK, len(x) - start))):
            place = x[begin + i]
            known = place == place
            below = place if known else inf
            above = place if known else -inf
            steep = abs(slope[begin + i]) if known else zero
            low[i] = below if below < low[i] else low[i]
            high[i] = above if above > high[i] else high[i]
            most[i] = steep if steep > most[i] else most[i]
    return _least(low), _most(high), _most(most)


@njit(cache=True, nogil=True, error_model="numpy")
def _place(x, y, t, rays, t0, t1, first, second, z, steepest, out):  # type: ignore[no-untyped-def]
    """Where rays meet the plane z, and their slopes along x.

    `rays` holds the direction (x, y at unit depth) of every pixel. Between the poses `first` at t0
    and `second` at t1, shape (4, 4), position and rotation go linearly: a pose interval turns by
    far less than it takes to notice. `out`, shape (3, n), receives x from the first pose's on, y
    and slope; x is NaN for rays that don't meet the plane or lean more than `steepest`. Returns the
    least and the largest x and the largest slope.
    """
    per_ns = np.float32(1.0 / (t1 - t0))
    r00, r01, r02 = np.float32(first[0, 0]), np.float32(first[0, 1]), np.float32(first[0, 2])
    r10, r11, r12 = np.float32(first[1, 0]), np.float32(first[1, 1]), np.float32(first[1, 2])
    r20, r21, r22 = np.float32(first[2, 0]), np.float32(first[2, 1]), np.float32(first[2, 2])
    by = second - first
    q00, q01, q02 = np.float32(by[0, 0]), np.float32(by[0, 1]), np.float32(by[0, 2])
    q10, q11, q12 = np.float32(by[1, 0]), np.float32(by[1, 1]), np.float32(by[1, 2])
    q20, q21, q22 = np.float32(by[2, 0]), np.float32(by[2, 1]), np.float32(by[2, 2])
    y0 = np.float32(first[1, 3])
    away0 = np.float32(z - first[2, 3])
    dx, dy, dz = np.float32(by[0, 3]), np.float32(by[1, 3]), np.float32(by[2, 3])
    least, one, nan = np.float32(1e-6), np.float32(1), np.float32(np.nan)
    limit = np.float32(steepest)
    to_x, to_y, to_slope = out[0], out[1], out[2]
    pixels = rays.reshape(-1)
    width, two = np.uint64(rays.shape[1]), np.uint64(2)
    for start in range(0, len(x), _CHUNK):
        begin, count = np.uint64(start), np.uint64(min(_CHUNK, len(x) - start))
        for i in range(count):
            at = two * (np.uint64(y[begin + i]) * width + np.uint64(x[begin + i]))
            to_x[begin + i] = pixels[at]
            to_y[begin + i] = pixels[at + np.uint64(1)]
        for i in range(count):
            f = np.float32(np.int32(t[begin + i] - t0)) * per_ns
            a = to_x[begin + i]
            b = to_y[begin + i]
            d2 = (r20 + f * q20) * a + (r21 + f * q21) * b + (r22 + f * q22)
            per = one / max(d2, least)
            sx = ((r00 + f * q00) * a + (r01 + f * q01) * b + (r02 + f * q02)) * per
            sy = ((r10 + f * q10) * a + (r11 + f * q11) * b + (r12 + f * q12)) * per
            away = away0 - f * dz
            meets = (d2 > least) & (abs(sx) <= limit)
            place = f * dx + sx * away
            to_x[begin + i] = place if meets else nan
            to_y[begin + i] = y0 + f * dy + sy * away
            to_slope[begin + i] = sx
    return _bounds(to_x[: len(x)], to_slope[: len(x)])


@njit(cache=True, nogil=True, error_model="numpy")
def _keep(  # type: ignore[no-untyped-def]
    placed, t, polarity, start, length, steepest, slots, records, link, free, free_count, pages,
    counts, ends,
):  # fmt: skip
    """Append events to the pages of their block, polarity and piece; how many, and free pages left.

    `placed` is as of `_place`, its slopes up to `steepest`, `start` the place of the block of
    `slots[0]` in its x. `records`, uint16 of shape (pages, 2, PAGE) and float32 of shape (pages,
    PAGE), receive place in the piece and slope, and y. `pages` holds the first and last page of
    each slot and of each polarity's pieces, -1 for none, `counts` their events; `ends` a slot's
    first and last time. Places are counted without sign: what may count from the end is looked at
    twice.
    """
    per_piece = np.float32(PIECES / length)
    start = np.float32(start)
    one, two, page_size = np.uint64(1), np.uint64(2), np.uint64(PAGE)
    zero, of_block, none = np.float32(0), np.int32(PIECES), np.int32(-1)
    inside = np.float32(len(slots) * PIECES)
    many, most = np.float32(NUMBERS), np.float32(NUMBERS - 1)
    per_slope, middle = np.float32(NUMBERS / (2 * steepest)), np.float32(NUMBERS / 2)
    to, to_y = records[0].reshape(-1), records[1].reshape(-1)
    last_page, held = pages.reshape(-1), counts.reshape(-1)
    chains = np.uint64(2 * PIECES)
    xs, ys, slopes = placed[0], placed[1], placed[2]
    block, own = np.empty((2, _CHUNK), np.int32)
    number, lean = np.empty((2, _CHUNK), np.uint16)
    kept = 0
    for begin in range(0, len(t), _CHUNK):
        first = np.uint64(begin)
        some = np.uint64(min(_CHUNK, len(t) - begin))
        # Of many at once: what needs no page.
        for i in range(some):
            x = (xs[first + i] - start) * per_piece
            # Written so that NaN fails it.
            seen = (x >= zero) & (x < inside)
            x = x if seen else zero
            piece = np.int32(x)
            k = piece // of_block
            number[i] = np.uint16(np.int32(min((x - np.float32(piece)) * many, most)))
            s = slopes[first + i] * per_slope + middle
            lean[i] = np.uint16(np.int32(min(max(s, zero), most) if seen else zero))
            block[i] = k if seen else none
            own[i] = piece - k * of_block + (of_block if polarity[first + i] > 0 else np.int32(0))
        for i in range(some):
            if block[i] < 0 or slots[np.uint64(block[i])] < 0:
                continue
            slot = np.uint64(slots[np.uint64(block[i])])
            chain = slot * chains + np.uint64(own[i])
            n = np.uint64(held[chain]) % page_size
            if n == 0:
                free_count -= 1
                new = free[free_count]
                link[new] = -1
                page = last_page[two * chain + one]
                if page < 0:
                    last_page[two * chain] = new
                else:
                    link[page] = new
                last_page[two * chain + one] = new
            held[chain] += 1
            at = np.uint64(last_page[two * chain + one]) * page_size
            to[two * at + n] = number[i]
            to[two * at + page_size + n] = lean[i]
            to_y[at + n] = ys[first + i]
            time = t[first + i]
            if time < ends[slot, 0]:
                ends[slot, 0] = time
            ends[slot, 1] = time
            kept += 1
    return kept, free_count


@njit(cache=True, nogil=True)
def _scales(piece_m, steepest):  # type: ignore[no-untyped-def]
    """Place by number and that of number 0, within a piece, metres; the same of slopes."""
    place, slope = piece_m / NUMBERS, 2 * steepest / NUMBERS
    return (
        np.float32(place), np.float32(0.5 * place), np.float32(slope),
        np.float32(0.5 * slope - steepest),
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "nsz"})
def _span(records, link, pages, counts, piece_m):  # type: ignore[no-untyped-def]
    """Least and largest x and y of chains of pages, one a piece: by vector instructions.

    `pages` holds the first page of each chain, `counts` its events. None is NaN.
    """
    inf = np.float32(np.inf)
    low_x, high_x, low_y, high_y = inf, -inf, inf, -inf
    per, begin, _, _ = _scales(piece_m, 1.0)
    for chain in range(len(pages)):
        page, left = pages[chain], counts[chain]
        least, most = np.uint16(NUMBERS - 1), np.uint16(0)
        while page >= 0:
            xs, ys = records[0][page, 0], records[1][page]
            for i in range(min(PAGE, left)):
                least = xs[i] if xs[i] < least else least
                most = xs[i] if xs[i] > most else most
                low_y = ys[i] if ys[i] < low_y else low_y
                high_y = ys[i] if ys[i] > high_y else high_y
            left -= PAGE
            page = link[page]
        if counts[chain] > 0:
            start = np.float32((chain % PIECES) * piece_m) + begin
            low_x = min(low_x, start + np.float32(least) * per)
            high_x = max(high_x, start + np.float32(most) * per)
    return low_x, high_x, low_y, high_y


@njit(cache=True, nogil=True)
def _collect(records, link, page, count, piece_m, steepest, start, x, y, slope):  # type: ignore[no-untyped-def]
    """Events of a chain of pages, a piece that begins at `start`, into arrays."""
    per_x, first_x, per_slope, first_slope = _scales(piece_m, steepest)
    first_x += np.float32(start)
    n = 0
    while page >= 0:
        for i in range(min(PAGE, count - n)):
            x[n + i] = first_x + np.float32(records[0][page, 0, i]) * per_x
            y[n + i] = records[1][page, i]
            slope[n + i] = first_slope + np.float32(records[0][page, 1, i]) * per_slope
        n += PAGE
        page = link[page]


@njit(cache=True, nogil=True)
def _release(link, page, free, free_count):  # type: ignore[no-untyped-def]
    """Give a chain of pages back; free pages then."""
    while page >= 0:
        free[free_count] = page
        free_count += 1
        page = link[page]
    return free_count

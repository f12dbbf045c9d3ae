"""Inner loops of the event sensor: from log intensity of rows to latched, read-out events.

Times are int64 nanoseconds of the sensor's clock since the simulation began. Chance comes from a
hash of (seed, pixel, draw number), so results don't depend on the order in which rows are done.

An event is one 64-bit word: time [63:23], x [22:12], y [11:1], polarity [0], which sorts into
read-out order: frame by frame, column by column, row by row.

Kernels that work on rows allocate nothing and count no references: see `_render_kernels`.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ._render_kernels import _expect_row, _see_level_row, _shade_level_row, _shade_row, _trace_row

#: Events one pixel may emit between two rendered frames; any more wait for the next frame.
MAX_PER_STEP = 4
TIME_SHIFT = 23
#: Frames that flat parts of the surface are watched at a time, where nothing much is printed on the
#: skin: a print needs every frame.
GROUP = 4
#: Pixels side by side that are looked at for relief together.
_SEGMENT = 64
_RELIEF, _FLAT, _LEVEL = 0, 1, 2
#: No read-out can be pending, no noise event due.
NEVER = np.int64(2**62)
#: Pixels are looked at this much before their signal is so far from the level, as it is rounded.
_EARLY = np.float32(1e-5)


@numba.njit(cache=True, nogil=True, _nrt=False, inline="always")
def _uniform(seed, pixel, draw):  # type: ignore[no-untyped-def]
    """Uniform number in (0, 1) from a hash (splitmix64's finaliser) of its arguments."""
    h = np.uint64(seed) + np.uint64(pixel) * np.uint64(0x9E3779B97F4A7C15)
    h ^= np.uint64(draw) * np.uint64(0xD1B54A32D192ED03)
    h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    h ^= h >> np.uint64(31)
    return (np.float64(h >> np.uint64(11)) + 0.5) * (1.0 / 9007199254740992.0)


@numba.njit(cache=True, nogil=True, _nrt=False)
def _next_noise(t, rate_hz, seed, pixel, draw):  # type: ignore[no-untyped-def]
    """Time of the next noise event of a pixel after `t`."""
    if rate_hz <= 0.0:
        return NEVER
    wait = -math.log(_uniform(seed, pixel, draw)) / rate_hz * 1e9
    return t + np.int64(min(wait, 1e18)) + 1


@numba.njit(cache=True, nogil=True, _nrt=False, error_model="numpy")
def _pixel_events(  # type: ignore[no-untyped-def]
    t0, t1, l0, l1, x, y, pixel, state, level, noise, draws, on, off, rate, timing, seed, out, n
):
    """Events of one pixel while its signal goes linearly from `l0` at `t0` to `l1` at `t1`.

    `state` is the time until which the pixel is held (0: free), `level` the signal it compares
    with, `noise` the time of its next noise event. Returns the four states and the number of
    events in `out`.
    """
    latency, jitter, refractory, readout, on_share = timing
    last = n + MAX_PER_STEP
    t = t0
    slope = (l1 - l0) / np.float64(t1 - t0)
    while n < last:
        if state > 0:
            if state >= t1:
                break
            # The pixel is let go and starts from the signal as it is now.
            t = max(t, state)
            state = np.int64(0)
            level = np.float32(l0 + slope * np.float64(t - t0))
            if noise < t:
                draws += 1
                noise = _next_noise(t, rate, seed, pixel, draws)
        crossing = NEVER
        polarity = 0
        if slope > 0.0 and l1 - level >= on:
            crossing = t0 + np.int64((level + on - l0) / slope)
            polarity = 1
        elif slope < 0.0 and level - l1 >= off:
            crossing = t0 + np.int64((level - off - l0) / slope)
        if crossing != NEVER:
            crossing = min(max(crossing, t), t1)
        if noise < t1 and noise < crossing:
            at = max(noise, t)
            draws += 1
            polarity = 1 if _uniform(seed, pixel, draws) < on_share else 0
            draws += 1
            noise = _next_noise(at, rate, seed, pixel, draws)
            level = np.float32(l0 + slope * np.float64(at - t0))
        elif crossing != NEVER:
            at = crossing
            level += on if polarity == 1 else -off
        else:
            break
        seen = at + latency
        if jitter > 0:
            draws += 2
            u = _uniform(seed, pixel, draws - 1)
            w = _uniform(seed, pixel, draws)
            normal = math.sqrt(-2.0 * math.log(u)) * math.cos(2.0 * math.pi * w)
            seen = max(seen + np.int64(normal * jitter), at)
        if readout > 0:
            # Latched until the next read-out frame; the pixel is held so long.
            seen = (seen // readout + 1) * readout
            state = max(at + refractory, seen)
        elif refractory > 0:
            state = at + refractory
        t = at
        out[n] = (
            (np.uint64(seen) << np.uint64(TIME_SHIFT))
            | (np.uint64(x) << np.uint64(12))
            | (np.uint64(y) << np.uint64(1))
            | np.uint64(polarity)
        )
        n += 1
    return state, level, noise, draws, n


@numba.njit(cache=True, nogil=True, _nrt=False, inline="always")
def _watch(level, held, noise, on, off):  # type: ignore[no-untyped-def]
    """Signal down to which, signal up to which and time until which nothing happens to a pixel."""
    if held > 0:
        return np.float32(-np.inf), np.float32(np.inf), held
    return level - off + _EARLY, level + on - _EARLY, noise


@numba.njit(cache=True, nogil=True, _nrt=False)
def _watch_all(level, held, noise, on, off, watch):  # type: ignore[no-untyped-def]
    """`_watch` of pixels, shape (h, w), into `watch`."""
    low, high, wake = watch
    for v in range(level.shape[0]):
        for u in range(level.shape[1]):
            low[v, u], high[v, u], wake[v, u] = _watch(
                level[v, u], held[v, u], noise[v, u], on[v, u], off[v, u]
            )


@numba.njit(cache=True, nogil=True, _nrt=False, error_model="numpy")
def _sensor_row(  # type: ignore[no-untyped-def]
    t0, t1, tau, new, x0, y, width, before, signal, level, watch, held, noise, draws, on, off,
    rate, timing, seed, after, busy, out, n,
):  # fmt: skip
    """Advance pixels of one row from `t0` to `t1`, at whose end the log intensity is `new`.

    Parameters
    ----------
    t0, t1 : int
        Begin and end, ns.
    tau : float
        Time constant of the pixels' low pass, ns; 0: none.
    new : ndarray of float32, shape (w,)
        Log intensity at `t1`.
    x0, y, width : int
        First pixel's place and the image's width.
    before, signal, level, on, off, rate : ndarray of float32, shape (w,)
        Log intensity at `t0`; low-passed signal; compared level; thresholds; noise rate in Hz.
    watch : tuple of ndarray, shape (w,)
        When a pixel has to be looked at: its signal at most so low (float32) or at least so high
        (float32), or the time (int64); see `_watch`.
    held, noise, draws : ndarray of int64, shape (w,)
        Time until which the pixel is held, next noise event, random numbers drawn.
    timing : tuple of int and float
        Latency, its jitter, refractory time and period of the read-out, ns; ON share of noise.
    seed : int
        Seed of the random numbers.
    after, busy : ndarray of float32, of bool, shape (w,)
        Scratch: the signal at `t1`, and which pixels are looked at.
    out, n : ndarray of uint64, int
        Event buffer with room for MAX_PER_STEP events a pixel, and the number in it.

    Returns
    -------
    int
        Number of events in the buffer.
    """
    w = len(new)
    # The exact answer of the low pass to an input that goes linearly from `before` to `new`.
    keep = np.float32(0.0)
    of_old = np.float32(0.0)
    if tau > 0.0:
        a = np.float64(t1 - t0) / tau
        e = math.exp(-a)
        keep = np.float32(e)
        of_old = np.float32((1.0 - e) / a - e)
    of_new = np.float32(1.0) - keep - of_old
    low, high, wake = watch
    # Loops over few arrays each, and without branches, are done by vector instructions.
    for u in range(w):
        after[u] = of_new * new[u] + of_old * before[u] + keep * signal[u]
    for u in range(w):
        before[u] = new[u]
    for u in range(w):
        busy[u] = (after[u] <= low[u]) | (after[u] >= high[u])
    for u in range(w):
        busy[u] |= wake[u] < t1
    for u in range(w):
        if busy[u]:
            held[u], level[u], noise[u], draws[u], n = _pixel_events(
                t0, t1, np.float64(signal[u]), np.float64(after[u]), x0 + u, y,
                np.int64(y) * width + x0 + u, held[u], level[u], noise[u], draws[u], on[u], off[u],
                rate[u], timing, seed, out, n,
            )  # fmt: skip
            low[u], high[u], wake[u] = _watch(level[u], held[u], noise[u], on[u], off[u])
    for u in range(w):
        signal[u] = after[u]
    return n


@numba.njit(cache=True, nogil=True, _nrt=False)
def _is_active(xl, xr, yn, first, last, active, origin):  # type: ignore[no-untyped-def]
    """Whether any relief lies where the rays from `xl` to `xr` look, from one camera to another."""
    z = first[2]
    step = origin[2]
    left = math.floor((min(first[0], last[0]) + xl * z - origin[0]) / step)
    right = math.floor((max(first[0], last[0]) + xr * z - origin[0]) / step)
    row = math.floor((first[1] - yn * z - origin[1]) / step)
    row = min(max(row, 0), active.shape[0] - 1)
    for column in range(max(left, 0), min(right, active.shape[1] - 1) + 1):
        if active[row, column]:
            return True
    return False


@numba.njit(cache=True, nogil=True, _nrt=False)
def _kind(xl, xr, yn, first, last, active, origin, roller):  # type: ignore[no-untyped-def]
    """What the rays from `xl` to `xr` see from one camera to another.

    `_RELIEF`; `_FLAT`: no relief; or `_LEVEL`: none, in full contact all of them.
    """
    if _is_active(xl, xr, yn, first, last, active, origin):
        return _RELIEF
    x = max(abs(xl), abs(xr)) * last[2]
    full = last[2] + roller[2]
    return _LEVEL if x * x + full * full < roller[0] * roller[0] else _FLAT


def row_buffers(width: int) -> tuple[np.ndarray, ...]:
    """Buffers of `_simulate_rows`: coating, log intensity, signal, and which pixels to look at."""
    # Each by itself: of rows of one array the loops over them are four times slower.
    return (*(np.empty(width, np.float32) for _ in range(3)), np.empty(width, np.bool_))


@numba.njit(cache=True, nogil=True, _nrt=False, error_model="numpy")
def _simulate_rows(  # type: ignore[no-untyped-def]
    begin_row, end_row,
    xn, yn, flat, shape, active, active_origin, cameras, times, tau, roller, origin, light,
    level_light, level_mm, depth, slopes, before, signal, level, watch, held, noise, draws, on, off,
    rate, timing, seed, group, first, scratch, buffers, out, counts,
):  # fmt: skip
    """Render and watch rows `begin_row` to `end_row` over a chunk of frames.

    `times` and `cameras` begin with those that the chunk starts from. Frames are done `group` at a
    time; parts of a row that see only flat plate are rendered at a group's last frame alone. Row v
    goes on from frame `first[v]` and stops early, leaving `first[v]` at the next frame to do, when
    its buffer `out[v]` might overflow; the caller empties the buffers and calls again.
    `level_light` is `lit` and `rise` of `_shade_level_row`, the first with the camera `level_mm`
    over the plate. `scratch` is from `trace_scratch`, `buffers` from `row_buffers`.
    """
    w = xn.shape[1]
    lit, rise = level_light
    coat, seen, after, busy = buffers
    low, high, wake = watch
    sx, sy = slopes
    for v in range(begin_row, end_row):
        # A plain 0 has a type of its own, which everything called would be compiled for once more.
        n = np.int64(0)
        i = first[v]
        while i < len(cameras) - 1 and n + w * MAX_PER_STEP * group <= out.shape[1]:
            stop = min(i + group, len(cameras) - 1)
            camera, last = cameras[i + 1], cameras[stop]
            a = 0
            while a < w:
                # What lies side by side and sees the same is done together.
                kind, b = -1, a
                while b < w:
                    c = min(b + _SEGMENT, w)
                    own = _kind(
                        xn[v, b], xn[v, c - 1], yn[v, b], camera, last, active, active_origin,
                        roller,
                    )  # fmt: skip
                    if b > a and own != kind:
                        break
                    kind, b = own, c
                m = b - a
                t0 = times[i]
                for j in range(i if kind == _RELIEF else stop - 1, stop):
                    if kind == _LEVEL:
                        _see_level_row(
                            xn[v, a:b], yn[v, a:b], flat, shape, cameras[j + 1], origin,
                            scratch, depth[v, a:b], coat[:m],
                        )  # fmt: skip
                        _shade_level_row(
                            lit[v, a:b], rise[v, a:b], cameras[j + 1, 2] - level_mm, coat[:m],
                            seen[:m],
                        )  # fmt: skip
                        sx[v, a:b], sy[v, a:b] = np.float32(0), np.float32(0)
                    else:
                        if kind == _RELIEF:
                            moved = cameras[j + 1, 0] - cameras[j, 0]
                            _expect_row(
                                xn[v, a:b], yn[v, a:b], sx[v, a:b], sy[v, a:b], moved,
                                depth[v, a:b],
                            )  # fmt: skip
                        _trace_row(
                            xn[v, a:b], yn[v, a:b], flat, shape, cameras[j + 1], roller, origin,
                            scratch, depth[v, a:b], sx[v, a:b], sy[v, a:b], coat[:m],
                        )  # fmt: skip
                        _shade_row(
                            xn[v, a:b], yn[v, a:b], depth[v, a:b], sx[v, a:b], sy[v, a:b],
                            coat[:m], light, seen[:m],
                        )  # fmt: skip
                    n = _sensor_row(
                        t0, times[j + 1], tau, seen[:m], a, v, w, before[v, a:b], signal[v, a:b],
                        level[v, a:b], (low[v, a:b], high[v, a:b], wake[v, a:b]), held[v, a:b],
                        noise[v, a:b], draws[v, a:b], on[v, a:b], off[v, a:b], rate[v, a:b],
                        timing, seed, after[:m], busy[:m], out[v], n,
                    )  # fmt: skip
                    t0 = times[j + 1]
                a = b
            i = stop
        first[v] = i
        counts[v] = n


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _render_rows(  # type: ignore[no-untyped-def]
    xn, yn, flat, shape, camera, roller, origin, light, scratch, depth, sx, sy, out
):
    """Render one frame; `depth` holds first guesses and becomes the depth."""
    h, w = xn.shape
    coat = np.empty(w, np.float32)
    for v in range(h):
        _trace_row(
            xn[v], yn[v], flat, shape, camera, roller, origin, scratch, depth[v], sx[v], sy[v], coat
        )
        _shade_row(xn[v], yn[v], depth[v], sx[v], sy[v], coat, light, out[v])

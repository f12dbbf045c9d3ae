"""The event sensor: state of all pixels, read-out, rate cap."""

from __future__ import annotations

import functools
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from . import _sensor_kernels as kernels
from ._render_kernels import trace_scratch
from .cell_settings import SensorSettings
from .optics import SurfaceMaps, lit_level
from .relief import F32, F64

U64 = npt.NDArray[np.uint64]
I64 = npt.NDArray[np.int64]
_MASK_11 = np.uint64(0x7FF)
_CAP_FRAME_NS = 200_000
#: Share of ON among noise events.
_ON_SHARE = 0.6
#: Median rate of a hot pixel.
_HOT_HZ = 500.0
#: Events one row's buffer holds, in units of what a group of frames may give.
_BUFFER_GROUPS = 2
#: Parts that each thread's share of the rows is cut into: some rows see more than others.
_PARTS_A_THREAD = 4
#: Rise of the camera over which it is told how the light on level plate changes, mm.
_RISE_MM = 0.1


@functools.cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="virtual_sensor")


def unpack(words: U64) -> tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint16], I64, npt.NDArray]:
    """x, y, t_ns and polarity of packed events."""
    t = (words >> np.uint64(kernels.TIME_SHIFT)).astype(np.int64)
    x = ((words >> np.uint64(12)) & _MASK_11).astype(np.uint16)
    y = ((words >> np.uint64(1)) & _MASK_11).astype(np.uint16)
    return x, y, t, (words & np.uint64(1)).astype(np.uint8)


class EventSensor:
    """An event sensor that watches the skin.

    Parameters
    ----------
    rays : tuple of ndarray of float32, shape (h, w)
        x/z and y/z of each pixel's ray.
    maps : SurfaceMaps
        What is fixed to the surface.
    roller : ndarray of float64, shape (4,)
        See `truth.Truth.roller`.
    light : ndarray of float32, shape (24,)
        See `optics.light_vector`.
    settings : SensorSettings
        Thresholds, noise, timing.
    seed : int
        Seed of everything that differs from pixel to pixel or is left to chance.
    threads : int
        Threads to use; 0: as many as there are cores.
    printed : bool
        Whether flat parts of the surface are watched at every frame, as a print on the skin needs;
        at every fourth if not.
    """

    def __init__(
        self,
        rays: tuple[F32, F32],
        maps: SurfaceMaps,
        roller: F64,
        light: F32,
        settings: SensorSettings,
        seed: int,
        threads: int = 0,
        printed: bool = False,
    ) -> None:
        self._threads = threads or os.cpu_count() or 1
        self._group = 1 if printed else kernels.GROUP
        self._xn, self._yn = rays
        self._maps, self._roller, self._light = maps, roller, light
        self.settings = settings
        #: Events the rate cap has cut.
        self.dropped = 0
        #: Events read out.
        self.count = 0
        h, w = self._xn.shape
        shape = (h, w)
        rng = np.random.default_rng([seed, 17])
        s = settings

        def threshold() -> F32:
            spread = rng.normal(s.threshold, s.threshold_spread, shape)
            return np.maximum(spread, s.threshold / 4).astype(np.float32)

        self._on, self._off = threshold(), threshold()
        rate = np.full(shape, s.background_hz, np.float32)
        hot = rng.random(shape) < s.hot_share
        rate[hot] += (_HOT_HZ * np.exp(rng.normal(0.0, 0.7, shape)))[hot].astype(np.float32)
        self._rate = rate
        self._draws = np.zeros(shape, np.int64)
        wait = rng.exponential(1.0, shape) / np.maximum(rate, 1e-12) * 1e9
        self._noise = np.where(rate > 0, np.minimum(wait, 1e18), kernels.NEVER).astype(np.int64)
        self._held = np.zeros(shape, np.int64)
        self._before = np.zeros(shape, np.float32)
        self._signal = np.zeros(shape, np.float32)
        self._level = np.zeros(shape, np.float32)
        # When each pixel has to be looked at, by its signal and by time.
        self._watch = (*np.empty((2, *shape), np.float32), np.empty(shape, np.int64))
        # Where pixels' rays ended last, and the skin's slopes there along x and y.
        self._depth = np.full(shape, roller[0], np.float32)
        self._slopes = (np.zeros(shape, np.float32), np.zeros(shape, np.float32))
        # Log intensity of level plate with the camera so high, and how it grows by mm.
        self._level_light = (np.zeros(shape, np.float32), np.zeros(shape, np.float32))
        self._level_mm = 0.0
        self._camera: F64 = np.zeros(3)
        self._time = 0
        self._seed = np.uint64((seed * 0x9E3779B97F4A7C15 + 0x1234567) % 2**64)
        timing = (s.latency_us, s.jitter_us, s.refractory_us, s.readout_us)
        self._timing = (*(np.int64(round(v * 1e3)) for v in timing), _ON_SHARE)
        self._out = np.empty(
            (h, w * kernels.MAX_PER_STEP * kernels.GROUP * _BUFFER_GROUPS), np.uint64
        )
        self._pending = np.empty(0, np.uint64)

    def start(self, camera: F64) -> None:
        """Settle all pixels on what the camera sees at the start, at time 0.

        Parameters
        ----------
        camera : ndarray of float64, shape (3,)
            Camera x, y over the plate and height above its face, mm.
        """
        shape = self._xn.shape
        self._camera = camera
        self._depth[:] = camera[2]
        kernels._render_rows(
            self._xn, self._yn, self._maps.flat, self._maps.shape, camera, self._roller,
            self._maps.origin, self._light, trace_scratch(shape[1]), self._depth,
            *self._slopes, self._signal,
        )  # fmt: skip
        self._level_mm = float(camera[2])
        low, lit, high = (
            lit_level(self._xn, self._yn, self._level_mm + up_mm, self._light)
            for up_mm in (-_RISE_MM, 0.0, _RISE_MM)
        )
        slope = (high - low) / (2 * _RISE_MM)
        self._level_light = lit.astype(np.float32), slope.astype(np.float32)
        self._before[:] = self._signal
        # Pixels have fired at some time before: what is left lies anywhere within the thresholds.
        rng = np.random.default_rng([int(self._seed) % 2**32, 19])
        phase = rng.uniform(-0.5, 0.5, shape).astype(np.float32)
        self._level[:] = self._signal + phase * np.where(phase > 0, self._on, self._off)
        kernels._watch_all(self._level, self._held, self._noise, self._on, self._off, self._watch)

    def advance(self, cameras: F64, times_ns: I64) -> U64:
        """Watch while the camera moves through places at times.

        Parameters
        ----------
        cameras : ndarray of float64, shape (n, 3)
            Camera x, y over the plate and height above its face, mm.
        times_ns : ndarray of int64, shape (n,)
            Sensor time since the start, growing, after the last of the call before.

        Returns
        -------
        ndarray of uint64
            Packed events read out up to the last time, in read-out order (see `unpack`).
        """
        times = np.concatenate([[self._time], times_ns]).astype(np.int64)
        places = np.concatenate([[self._camera], cameras])
        hz = self.settings.bandwidth_hz
        tau_ns = 1e9 / (2 * np.pi * hz) if hz > 0 else 0.0
        first = np.zeros(len(self._xn), np.int64)
        counts = np.zeros(len(self._xn), np.int64)
        parts = [self._pending]
        edges = np.linspace(0, len(first), _PARTS_A_THREAD * self._threads + 1).astype(np.int64)

        width = self._xn.shape[1]

        def simulate(begin_row: np.int64, end_row: np.int64) -> None:
            kernels._simulate_rows(
                begin_row, end_row,
                self._xn, self._yn, self._maps.flat, self._maps.shape, self._maps.active,
                self._maps.active_origin, places, times, tau_ns, self._roller, self._maps.origin,
                self._light, self._level_light, self._level_mm, self._depth, self._slopes,
                self._before, self._signal, self._level, self._watch, self._held, self._noise,
                self._draws, self._on, self._off, self._rate, self._timing, self._seed, self._group,
                first, trace_scratch(width), kernels.row_buffers(width), self._out,
                counts,
            )  # fmt: skip

        while int(first.min()) < len(times_ns):
            # Taken from the pool to the last, so that an error is raised here.
            list(_pool(self._threads).map(simulate, edges[:-1], edges[1:]))
            parts += [row[:n] for row, n in zip(self._out, counts, strict=True) if n]
            parts = [np.concatenate(parts)]
        words = parts[0]
        words.sort()
        self._time, self._camera = int(times[-1]), places[-1]
        # An event is read out at or after its instant, so all up to now are known.
        limit = np.uint64((self._time + 1) << kernels.TIME_SHIFT)
        cut = int(np.searchsorted(words, limit))
        self._pending = words[cut:]
        ready = self._capped(words[:cut])
        self.count += len(ready)
        return ready

    def _capped(self, words: U64) -> U64:
        """Keep at most the cap's share of each read-out frame, evenly over its columns."""
        s = self.settings
        if s.rate_cap_mev_s <= 0 or not len(words):
            return words
        frame_ns = int(s.readout_us * 1e3) or _CAP_FRAME_NS
        most = max(int(s.rate_cap_mev_s * frame_ns * 1e-3), 1)
        if len(words) <= most:
            return words
        frame = (words >> np.uint64(kernels.TIME_SHIFT)).astype(np.int64) // frame_ns
        starts = np.flatnonzero(np.diff(frame, prepend=frame[0] - 1))
        kept = []
        for a, b in zip(starts, np.append(starts[1:], len(words)), strict=True):
            part = words[a:b]
            if b - a > most:
                self.dropped += int(b - a) - most
                part = part[np.arange(most) * (b - a) // most]
            kept.append(part)
        return np.concatenate(kept)

"""How fast the skin's image moves, as a share of what the poses say.

An image that moves at a share s of the robot's speed looks like a surface at the depth Z / s. So
one number, looked for like a depth but far beyond the range of depths, tells rolling (1) from
slipping and from a roller that stands (0). A slip that looks like a depth in the range can't be
told from it, and isn't told.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.transforms import F64

from .rays import F32, make_packets, rays_in_view

#: Events that are looked at, at most and at least.
_MOST, _LEAST = 6_000, 800
#: Events that share a pose.
_PACKET = 64
#: Shares that are tried: near 1 as close as a peak is wide.
_SHARES = np.r_[0.0:0.8:0.05, 0.8:1.2:0.02, 1.2:1.7:0.05]
#: Shares that are tried while none of these is sharp: of a surface that lies far before the range
#: of depths, and of poses that go the other way. So often, unless one of these is found.
_FAR_SHARES = np.r_[-1.3:-0.7:0.03, 1.7:6.0:0.05]
_MOST_FAR = 3
#: So much beyond what the depth range allows is still rolling, for what the share errs by.
_LEEWAY = 0.03
#: Bins along and across the motion, px.
_BINS_PX = np.array([2.0, 8.0])
#: Bins of an image at most: some thousand times as many as of one that moves as it should.
_MOST_BINS = 2.0**23
#: A share is believed when it is sharper than chance by so many standard deviations, and slipping
#: when it is so many times as sharp as all that would be rolling.
_SURE, _CLEARER = 8.0, 1.5


class ImageSpeed:
    """Finds the share of the poses' speed at which the image of a few events is sharpest.

    Parameters
    ----------
    camera : Camera
        Calibration.
    track : PoseTrack
        Camera in base; grows meanwhile.
    depth_min_m, depth_max_m : float
        Between which depths the surface lies, metres.
    """

    def __init__(
        self, camera: Camera, track: PoseTrack, depth_min_m: float, depth_max_m: float
    ) -> None:
        self._camera, self._track = camera, track
        self._depth_m = 0.5 * (depth_min_m + depth_max_m)
        least, most = self._depth_m / depth_max_m, self._depth_m / depth_min_m
        self._rolls = (least - _LEEWAY < _SHARES) & (most + _LEEWAY > _SHARES)
        self._table: F32 = camera.undistortion_table()
        #: Events by pixel; zero between two looks.
        self._counts = np.zeros(self._table.shape[:2], np.uint16)
        #: How often far shares may still be looked at in vain.
        self._far_left = _MOST_FAR

    def rolls(self, share: float) -> bool:
        """Whether a surface in the range of depths could look so."""
        return bool(self._rolls[np.argmin(np.abs(_SHARES - share))])

    def share(self, events: EventArray) -> float | None:
        """The share of the poses' speed at which the image is sharpest; None: it isn't clear."""
        events = self._quiet(events[:: -(-len(events) // _MOST) or 1])
        n = len(events)
        if n < _LEAST:
            return None
        packets = make_packets(events, self._table, self._track, _PACKET)
        view = packets.poses[len(packets.poses) // 2]
        # A row for each number, as the loop over events takes them.
        rays: F32 = np.ascontiguousarray(
            rays_in_view(packets, self._camera, view).rays.T, np.float32
        )
        rays[2:] /= self._depth_m
        size = np.array([self._camera.width, self._camera.height], np.float64)
        if np.ptp(rays[3]) > np.ptp(rays[2]):
            rays, size = rays[[1, 0, 3, 2]], size[::-1]
        signs = events.p.astype(np.int16) * np.int16(2) - np.int16(1)
        sharp = _sharpness_by_share(rays, size, signs, _SHARES)
        best = int(np.argmax(sharp))
        if sharp[best] < _SURE:
            return self._far_share(rays, size, signs)
        self._far_left = 0
        rolling = float(sharp[self._rolls].max())
        if not self._rolls[best] and sharp[best] < _CLEARER * rolling:
            return None
        return float(_SHARES[best])

    def _far_share(self, rays: F32, size: F64, signs: npt.NDArray[np.int16]) -> float | None:
        """A share far from all that could be rolling or slipping."""
        if not self._far_left:
            return None
        self._far_left -= 1
        sharp = _sharpness_by_share(rays, size, signs, _FAR_SHARES)
        best = int(np.argmax(sharp))
        if sharp[best] < _SURE:
            return None
        self._far_left = _MOST_FAR
        return float(_FAR_SHARES[best])

    def _quiet(self, events: EventArray) -> EventArray:
        """The events of pixels that don't fire far more than others: hot ones stand."""
        kept = np.empty(len(events), np.bool_)
        # Every other event and all of them are of one type so: numba compiles for each.
        x, y = np.ascontiguousarray(events.x), np.ascontiguousarray(events.y)
        _keep_quiet(x, y, self._counts, kept)
        return events[kept]


def _sharpness_by_share(
    rays: F32, size: F64, signs: npt.NDArray[np.int16], shares: F64
) -> npt.NDArray[np.float64]:
    """How sharp the image is at some shares of the speed, in what it is by chance.

    Parameters
    ----------
    rays : ndarray of float32, shape (4, n)
        Place at infinity along and across the motion and its shift at full speed, px.
    size : ndarray, shape (2,)
        Of the image, along and across the motion, px.
    signs : ndarray of int16, shape (n,)
        Of the events, 1 and -1.
    shares : ndarray, shape (k,)
        Shares of the speed.
    """
    n, most = len(signs), float(np.abs(shares).max())
    margin = [float(max(-moved.min(), moved.max())) * most + 2.0 for moved in rays[2:]]
    wanted = (size + 2 * np.array(margin)) / _BINS_PX
    if not float(wanted.prod()) < _MOST_BINS:  # poses that jump by metres; NaN fails it too
        return np.zeros(len(shares))
    columns, rows = np.ceil(wanted).astype(np.int64)
    bins = rays.copy()
    bins[0] += margin[0]
    bins[1] += margin[1]
    bins /= np.tile(_BINS_PX, 2).astype(np.float32)[:, None]
    sharp = np.empty(len(shares))
    image, places = np.empty((rows + 1, columns), np.int16), np.empty(n, np.int32)
    _sharpness(bins, signs, shares.astype(np.float32), places, image, sharp)
    return np.asarray(sharp / np.sqrt(8.0 * n * n / (rows * columns) + 4.0 * n))


@njit(cache=True, nogil=True)
def _keep_quiet(x, y, counts, kept):  # type: ignore[no-untyped-def]
    """Whether each event's pixel fires no more than some times as often as pixels that fire.

    counts (height, width): zero, and left so.
    """
    pixels = 0
    for i in range(len(x)):
        pixels += counts[y[i], x[i]] == 0
        counts[y[i], x[i]] += np.uint16(1)
    most = 2.0 + 3.0 * len(x) / max(pixels, 1)
    for i in range(len(x)):
        kept[i] = counts[y[i], x[i]] <= most
    for i in range(len(x)):
        counts[y[i], x[i]] = 0


@njit(cache=True, nogil=True, error_model="numpy")
def _sharpness(bins, signs, shares, places, image, out):  # type: ignore[no-untyped-def]
    """How much neighbouring bins along the motion differ, beyond chance, by share of the speed.

    bins (4, n): place at infinity and its shift at full speed, in bins; signs (n,): of the events;
    image (rows + 1, columns): of the bins, the last row for what lies outside; out (shares,).
    Whole numbers, which vector instructions add up in any order: no more than 20,000 events. Sums
    and products are told to be of 32 bits, else they would be of 64.
    """
    rows, columns = image.shape[0] - 1, image.shape[1]
    flat = image.reshape(-1)
    x0, y0, dx, dy = bins[0], bins[1], bins[2], bins[3]
    right, below = np.float32(columns), np.float32(rows)
    zero = np.float32(0)
    for k in range(len(shares)):
        share = shares[k]
        inside = np.int32(0)
        for i in range(np.uint64(len(signs))):
            u = x0[i] + share * dx[i]
            v = y0[i] + share * dy[i]
            # Written so that NaN fails it.
            seen = (u >= zero) & (u < right) & (v >= zero) & (v < below)
            inside = np.int32(inside + np.int32(seen))
            places[i] = np.int32(np.floor(v) * right + np.floor(u) if seen else below * right)
        flat[:] = 0
        for i in range(np.uint64(len(signs))):
            flat[np.uint64(places[i])] += signs[i]
        total = np.int32(0)
        for r in range(rows):
            start = np.uint64(r * columns)
            for c in range(start, start + np.uint64(columns - 1)):
                step = np.int32(np.int32(flat[c + np.uint64(1)]) - np.int32(flat[c]))
                total = np.int32(total + np.int32(step * step))
        out[k] = total - 2.0 * inside

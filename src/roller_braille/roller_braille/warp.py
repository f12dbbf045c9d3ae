"""Motion compensation: from events to places on the surface.

A point of the surface at depth Z moves through the image at u̇ = -F·v/Z. Over a time in which the
camera moves ΔX along the roll, an event at u is thus warped to u + F·ΔX/Z at the reference time,
and a pixel of the warped image is the place X + Z·(u - c_x)/F of the surface. Instead of a constant
speed times the time, ΔX is the travel between the poses, so ramps and vibration are right; and the
two steps are one map from pixel to surface, a homography, linear in time between knots.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.hot_pixels import count_events, find_hot_pixels
from roller_core.passes import Pass
from roller_core.pose_track import PoseTrack
from roller_core.transforms import F64, quaternion_to_matrix

from . import _kernels as kernels
from .reader_settings import BrailleSettings

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]

#: Pixel of the table that is left out.
OUTSIDE = -1e9
_KNOT_NS = 500_000


@dataclass(frozen=True)
class Knots:
    """Maps from pixel to surface at times."""

    #: At least two. Shape (k,).
    times_ns: I64
    #: Ideal pixel to travel along the roll and place down the image, metres, in the pass's axes.
    #: Shape (k, 3, 3).
    maps: F64
    #: Travel of the camera itself, metres. Shape (k,).
    along: F64


class Warp:
    """Warps events of one camera.

    Parameters
    ----------
    settings : BrailleSettings
        Depth and width of the view.
    camera : Camera
        Calibration.
    track : PoseTrack
        Camera in base.
    """

    def __init__(self, settings: BrailleSettings, camera: Camera, track: PoseTrack) -> None:
        self._settings = settings
        self._track = track
        self._inverse_k = np.linalg.inv(camera.K)
        self.table = camera.undistortion_table().copy()
        half_px = settings.view_half_width_m / settings.depth_m * camera.fx
        self.table[np.abs(self.table[..., 0] - camera.cx) > half_px] = OUTSIDE
        last = [camera.width - 1.0, camera.height - 1.0]
        corners = camera.rays(camera.undistort(np.array([[0.0, 0.0], last])))
        #: Half height of the view on the surface, metres.
        self.half_height_m = float(np.abs(corners[:, 1]).max()) * settings.depth_m

    def knots(self, roll: Pass, start_ns: int, end_ns: int) -> Knots:
        """Maps at evenly spaced times of an interval and at its ends.

        Raises
        ------
        PoseError
            If poses are missing.
        """
        count = max(2, -(-(end_ns - start_ns) // _KNOT_NS) + 1)
        times = start_ns + np.round(np.linspace(0.0, end_ns - start_ns, count)).astype(np.int64)
        times = np.unique(np.append(times, start_ns + 1))
        positions, quaternions = self._track.sample(times)
        centre = (positions - roll.origin) @ roll.rotation
        rotation = roll.rotation.T @ quaternion_to_matrix(quaternions)
        depth = self._depths(positions, roll)
        # Ray (x, y, z) = R K^-1 (u, v, 1) meets the surface at X = C_x + Z x/z, Y = C_y + Z y/z.
        rays = rotation @ self._inverse_k
        maps = np.empty_like(rays)
        maps[:, 0] = depth[:, None] * rays[:, 0] + centre[:, :1] * rays[:, 2]
        maps[:, 1] = depth[:, None] * rays[:, 1] + centre[:, 1:2] * rays[:, 2]
        maps[:, 2] = rays[:, 2]
        maps[:, 0] *= roll.direction
        return Knots(times, maps, centre[:, 0] * roll.direction)

    def _depths(self, positions: F64, roll: Pass) -> F64:
        """Depth of the surface along the camera's axis, metres, at places of the camera."""
        s = self._settings
        axis = roll.rotation[:, 2]
        if s.depth_source == "fixed" or abs(axis[2]) < 0.1:
            return np.full(len(positions), s.depth_m)
        return np.clip((s.surface_z_m - positions[:, 2]) / axis[2], s.depth_m / 2, s.depth_m * 2)

    def depth_at(self, roll: Pass) -> float:
        """Depth of the surface where a pass begins, metres."""
        return float(self._depths(roll.origin[None], roll)[0])

    def surface_points(
        self, roll: Pass, along: npt.ArrayLike, down: npt.ArrayLike, z: float
    ) -> F64:
        """Points of the mosaic in base, metres, shape (n, 3).

        Parameters
        ----------
        roll : Pass
            The pass.
        along, down : array_like, shape (n,)
            Travel along the roll and place down the image, metres.
        z : float
            Depth of the surface below the origin of the pass, metres.
        """
        x = np.atleast_1d(np.asarray(along, np.float64)) * roll.direction
        y = np.atleast_1d(np.asarray(down, np.float64))
        local = np.stack([x, y, np.full_like(x, z)], axis=-1)
        return np.asarray(local @ roll.rotation.T + roll.origin)


def vote(events: EventArray, table: F32, knots: Knots, raster: F64, strip: F32, newest: I64) -> int:
    """Warp events and count them in a strip.

    Parameters
    ----------
    events : EventArray
        In order of time.
    table : ndarray of float32, shape (height, width, 2)
        Ideal pixels; those left out have a u of `OUTSIDE`.
    knots : Knots
        Maps.
    raster : ndarray of float64, shape (3, 3)
        From metres to columns and rows of the strip.
    strip : ndarray of float32, shape (2, rows, columns)
        Counted into, OFF events first, then ON events.
    newest : ndarray of int64, shape (columns,)
        Set to the time of each column's newest event, ns.

    Returns
    -------
    int
        Events counted.
    """
    maps = np.ascontiguousarray(raster @ knots.maps)
    return int(
        kernels._vote(
            events.x, events.y, events.t_ns, events.p, table, knots.times_ns, maps, strip, newest
        )
    )


def warm_up() -> None:
    """Compile the kernels, or load them, before there is anything to be late for."""
    knots = Knots(np.array([0, 1], np.int64), np.tile(np.eye(3), (2, 1, 1)), np.zeros(2))
    strip, newest = np.zeros((2, 1, 1), np.float32), np.zeros(1, np.int64)
    vote(EventArray.empty(), np.zeros((1, 1, 2), np.float32), knots, np.eye(3), strip, newest)
    no = np.zeros(0)
    none = EventArray.empty()
    table = np.zeros((1, 1, 2), np.float32)
    kernels._sample(
        none.x, none.y, none.t_ns, table, 0.0, knots.times_ns, knots.maps, no, no, no, no
    )
    kernels._contrasts(no, no, no, no, 1.0, np.zeros(2), np.zeros((1, 1)), no)
    count_events(EventArray.empty(), np.zeros((1, 1), np.float32))


#: Batches between two looks at the counts: often among the first ones, then seldom.
_EVERY_EARLY, _EARLY, _EVERY = 5, 20, 25


class PixelTable:
    """Keeps the pixel table of the warp free of hot pixels.

    Parameters
    ----------
    table : ndarray of float32, shape (height, width, 2)
        Ideal pixels, as `vote` takes them.
    """

    def __init__(self, table: F32) -> None:
        #: The table without hot pixels.
        self.table = table.copy()
        self._all = table[..., 0].copy()
        self._counts = np.zeros(table.shape[:2], np.float32)
        self._batches = 0
        #: Hot pixels known.
        self.hot_pixels = 0

    def add(self, events: EventArray) -> None:
        """Take a batch of events of a rolling sensor."""
        count_events(events, self._counts)
        self._batches += 1
        if self._batches % (_EVERY_EARLY if self._batches <= _EARLY else _EVERY):
            return
        hot = find_hot_pixels(self._counts, columns_too=False)
        self.table[..., 0] = self._all if hot is None else np.where(hot, OUTSIDE, self._all)
        self.hot_pixels = 0 if hot is None else int(hot.sum())

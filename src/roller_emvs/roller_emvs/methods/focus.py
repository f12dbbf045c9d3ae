"""Depth from neighbourhood evidence: the plane on which the warped events are sharpest.

A single pixel's vote count hardly changes with depth where an edge is as wide as the parallax.
The sharpness of the votes over a neighbourhood does. Planes are spaced by parallax, evenly in
inverse depth, and the peak is found between planes; see `evidence`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_core.camera import Camera
from roller_core.transforms import F64, inverse_pose
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.evidence import CELL_PX, RayField, find_depths, measured_pixels
from roller_emvs.rays import F32, Packets, rays_in_view
from roller_emvs.stopwatch import Stopwatch


def focus_depth(
    packets: Packets,
    camera: Camera,
    view: F64,
    settings: DepthSettings,
    watch: Stopwatch,
) -> tuple[F32, F32, F32]:
    """Depth, confidence and sigma of one window in a reference view.

    Parameters
    ----------
    packets : Packets
        Events of the window.
    camera : Camera
        Intrinsics.
    view : ndarray of float64, shape (4, 4)
        Reference camera in base.
    settings : DepthSettings
        Depth range, patch, threads and `focus`.
    watch : Stopwatch
        Takes the time by stage.

    Returns
    -------
    depth, confidence, sigma : ndarray of float32, shape (height, width)
        Metres, 0–1 and metres; NaN where there is no depth.
    """
    s = settings
    near, far = 1.0 / s.depth_min_m, 1.0 / s.depth_max_m
    middle, half = 0.5 * (near + far), 0.5 * (near - far)
    with watch("rays"):
        field, turned = _window_field(packets, camera, view, middle, s.patch_half_length_m)
    with watch("votes"):
        depths = find_depths(field, -half, half, s.focus, threads=s.threads)
    depth = np.full((camera.height, camera.width), np.nan, np.float32)
    confidence, sigma = np.full_like(depth, np.nan), np.full_like(depth, np.nan)
    with watch("points"):
        found = measured_pixels(field, depths, s.focus, s.threads)
        row, column = (found.column, found.row) if turned else (found.row, found.column)
        keep = (row < camera.height) & (column < camera.width) & (np.abs(found.offset) <= half)
        row, column = row[keep], column[keep]
        depth[row, column] = 1.0 / (middle + found.offset[keep])
        confidence[row, column] = found.confidence[keep]
        sigma[row, column] = found.sigma[keep] * depth[row, column] ** 2
    return depth, confidence, sigma


def _window_field(
    packets: Packets, camera: Camera, view: F64, middle: float, patch_half_length_m: float
) -> tuple[RayField, bool]:
    """Rays of a window on the pixels of the reference view; their offset is inverse depth.

    `middle` is the inverse depth of offset 0, 1/m. True where rows and columns have changed
    places, as planes part along the image's columns.
    """
    bundle = rays_in_view(packets, camera, view)
    rays = bundle.rays.astype(np.float32, copy=False)
    centres = (inverse_pose(view) @ packets.poses)[:, :3, 3]
    travel = np.ptp(centres[:, :2] * [camera.fx, camera.fy], axis=0)
    turned = bool(travel[1] > travel[0])
    along = 1 if turned else 0
    focal = camera.fy if turned else camera.fx
    shape = (camera.width, camera.height) if turned else (camera.height, camera.width)
    placed = np.empty_like(rays)
    off_count = len(rays) - int(np.count_nonzero(packets.polarity))
    bounds = np.array([0, off_count, len(rays)], np.int64)
    _place(rays, packets.polarity, turned, np.float32(middle), off_count, placed)
    padded = (-(-shape[0] // CELL_PX) * CELL_PX, -(-shape[1] // CELL_PX) * CELL_PX)
    # A column's point was in view from where the camera saw it at a pixel.
    left, right = 0.0, shape[1] - 1.0
    if patch_half_length_m:
        axis, reach = (camera.cy if turned else camera.cx), patch_half_length_m * middle * focal
        left, right = max(axis - reach, left), min(axis + reach, right)
    x = (np.arange(padded[1] // CELL_PX) + 0.5) * CELL_PX - 0.5
    slopes = np.stack(
        [
            np.maximum((x - right) / middle, focal * centres[:, along].min()),
            np.minimum((x - left) / middle, focal * centres[:, along].max()),
        ]
    )
    seconds = max((packets.end_ns - packets.start_ns) * 1e-9, 1e-9)
    speed = float(travel.max()) * middle / seconds
    field = RayField(padded, slopes, -middle / focal, -(middle**2), focal, speed, placed, bounds)
    return field, turned


@njit(cache=True, nogil=True)
def _place(rays, polarity, turned, middle, off_count, out):  # type: ignore[no-untyped-def]
    """Rays on the middle plane, OFF before ON; with x and y changed over if `turned`."""
    off = 0
    on = off_count
    a = 1 if turned else 0
    b = 1 - a
    for i in range(len(rays)):
        if polarity[i] > 0:
            k = on
            on += 1
        else:
            k = off
            off += 1
        out[k, 0] = rays[i, a] + middle * rays[i, 2 + a]
        out[k, 1] = rays[i, b] + middle * rays[i, 2 + b]
        out[k, 2] = rays[i, 2 + a]
        out[k, 3] = rays[i, 2 + b]

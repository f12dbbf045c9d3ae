"""The paper's method in its plain form: whole volumes, every plane, nothing saved.

What the depth engine's savings are measured against, in time and in depth.
"""

from __future__ import annotations

import time

import numpy as np
from numba import njit

from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.methods.paper.fusion import ViewDepth, fuse_views
from roller_emvs.methods.paper.median import median_at
from roller_emvs.methods.paper.threshold import KERNEL_PX, adaptive_threshold
from roller_emvs.methods.paper.votes import dense_volume
from roller_emvs.rays import make_packets, rays_in_view

from .windows import Piece

#: Planes of the paper.
PLANES = 500


def dense_reference(piece: Piece, settings: DepthSettings) -> DepthMap:
    """Depth map of a window from one volume of 500 planes a reference view.

    Parameters
    ----------
    piece : Piece
        The window.
    settings : DepthSettings
        Depth range, views, threshold, median and fusion of method `bma`; its savings don't count.
    """
    s, camera, track = settings, piece.scan.camera, piece.scan.track
    table = camera.undistortion_table()
    span = piece.end_ns - piece.start_ns
    middle_ns = piece.start_ns + span // 2
    planes = np.linspace(s.depth_min_m, s.depth_max_m, PLANES)
    begin = time.perf_counter()
    packets = make_packets(piece.events, table, track, s.packet_events)
    target = track.matrices([middle_ns])[0]
    views = []
    for fraction, weight in s.views():
        pose = track.matrices([piece.start_ns + round(fraction * span)])[0]
        volume = dense_volume(rays_in_view(packets, camera, pose), camera, planes)
        votes = np.empty(volume.shape[1:], np.float32)
        index = np.empty(volume.shape[1:], np.uint16)
        _maximum(volume, votes, index)
        mask = adaptive_threshold(votes, s.paper.threshold_c, KERNEL_PX, s.paper.full_scale_votes)
        # What peaks on an end plane may lie beyond it.
        mask &= (index > 0) & (index < PLANES - 1)
        pixels, median = median_at(index, mask, s.paper.median_px, PLANES)
        far = np.interp(median, np.arange(PLANES), planes).astype(np.float32)
        sure = np.clip(votes.reshape(-1)[pixels] / np.float32(255), 0, 1)
        views.append(ViewDepth(pixels, far, sure, pose, weight))
    depth, confidence = fuse_views(views, target, camera)
    total = (time.perf_counter() - begin) * 1e3
    return DepthMap(
        middle_ns,
        depth,
        confidence,
        np.full_like(depth, np.nan),
        target,
        piece.start_ns,
        piece.end_ns,
        len(piece.events),
        {"total": round(total, 3)},
    )


@njit(cache=True, nogil=True)
def _maximum(volume, votes, index):  # type: ignore[no-untyped-def]
    """Greatest of each pixel's planes, the first of equals: argmax in the volume's own order."""
    planes = volume.shape[0]
    flat = volume.reshape(planes, -1)
    best = votes.reshape(-1)
    where = index.reshape(-1)
    best[:] = 0
    where[:] = 0
    for k in range(planes):
        plane = flat[k]
        for i in range(plane.size):
            better = plane[i] > best[i]
            best[i] = plane[i] if better else best[i]
            where[i] = np.uint16(k) if better else where[i]

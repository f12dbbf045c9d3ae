"""Events as rays seen from a reference view.

An event of packet k at pixel (u, v) is the ray C + s·d, C the packet's camera centre and d its
direction, both in the reference view. It meets the plane Z at

    X / Z = (d_x / d_z)·(1 - C_z / Z) + C_x / Z

so one rotated pixel per event and one scale and shift per packet and plane give its position on
every plane: the two-step homography of Rebecq et al. (EMVS, IJCV 2018, section 7.1) in the form
that needs no canonical plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.transforms import F64, inverse_pose

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]

#: Pixel of a ray that never meets a plane in front of the reference view.
OUTSIDE = -1e9


@dataclass(frozen=True)
class Packets:
    """Events in packets that share a pose.

    Attributes
    ----------
    u, v : ndarray of float32, shape (n,)
        Ideal pinhole pixels of the events.
    starts : ndarray of int64, shape (k + 1,)
        Where packets begin; the last entry is n.
    poses : ndarray of float64, shape (k, 4, 4)
        Camera in base at each packet's median event.
    """

    u: F32
    v: F32
    starts: I64
    poses: F64


@dataclass(frozen=True)
class RayBundle:
    """Rays of events in one reference view.

    Attributes
    ----------
    u, v : ndarray of float32, shape (n,)
        Pixels of the rotated rays: where they pierce a plane at infinity.
    starts : ndarray of int64, shape (k + 1,)
        Where packets begin.
    centres : ndarray of float64, shape (k, 3)
        Camera centres of the packets in the reference view, metres.
    """

    u: F32
    v: F32
    starts: I64
    centres: F64


def make_packets(events: EventArray, table: F32, track: PoseTrack, packet_events: int) -> Packets:
    """Group events in packets at the pose of their median event (paper, section on EMVS).

    The last packet may be smaller; no event is dropped.

    Parameters
    ----------
    events : EventArray
        In order of time, at least one.
    table : ndarray of float32, shape (height, width, 2)
        `Camera.undistortion_table`.
    track : PoseTrack
        Camera in base.
    packet_events : int
        Events a packet.

    Raises
    ------
    PoseError
        Where the track has no pose.
    """
    n = len(events)
    starts = np.append(np.arange(0, n, packet_events, dtype=np.int64), n)
    medians = (starts[:-1] + starts[1:] - 1) // 2
    poses = track.matrices(events.t_ns[medians])
    u, v = np.empty(n, np.float32), np.empty(n, np.float32)
    _look_up(events.x, events.y, table, u, v)
    return Packets(u, v, starts, poses)


def rays_in_view(packets: Packets, camera: Camera, view: F64) -> RayBundle:
    """Rays of packets in a reference view.

    Absolute poses stay float64 until they are relative to the view, so a robot base kilometres
    away costs no precision.

    Parameters
    ----------
    packets : Packets
        Events and poses.
    camera : Camera
        Intrinsics.
    view : ndarray of float64, shape (4, 4)
        Reference camera in base.
    """
    relative = inverse_pose(view) @ packets.poses
    u, v = np.empty_like(packets.u), np.empty_like(packets.v)
    # Homography at infinity K·R·K^-1 of each packet.
    h = camera.K @ relative[:, :3, :3] @ np.linalg.inv(camera.K)
    _rotate(packets.u, packets.v, packets.starts, h, u, v)
    return RayBundle(u, v, packets.starts, np.ascontiguousarray(relative[:, :3, 3]))


def depth_planes(near_m: float, far_m: float, count: int, spacing: str) -> F64:
    """Depths of the planes, near to far, both ends included, shape (count,), metres."""
    if spacing == "inverse_depth":
        return 1.0 / np.linspace(1.0 / near_m, 1.0 / far_m, count)
    return np.linspace(near_m, far_m, count)


def plane_coefficients(rays: RayBundle, camera: Camera, planes: F64) -> tuple[F32, F32, F32]:
    """Scale and shifts that take rotated pixels onto planes.

    Returns
    -------
    scale, shift_u, shift_v : ndarray of float32, shape (planes, packets)
        Pixel on the plane = scale · rotated pixel + shift.
    """
    c = rays.centres
    z = planes[:, None]
    scale = 1.0 - c[None, :, 2] / z
    shift_u = camera.fx * c[None, :, 0] / z + camera.cx * (1.0 - scale)
    shift_v = camera.fy * c[None, :, 1] / z + camera.cy * (1.0 - scale)
    # A plane behind a packet's camera can't be what that camera saw.
    behind = scale <= 0
    scale = np.where(behind, 0.0, scale)
    shift_u = np.where(behind, OUTSIDE, shift_u)
    return scale.astype(np.float32), shift_u.astype(np.float32), shift_v.astype(np.float32)


@njit(cache=True, nogil=True)
def _look_up(x, y, table, u, v):  # type: ignore[no-untyped-def]
    for i in range(len(x)):
        u[i] = table[y[i], x[i], 0]
        v[i] = table[y[i], x[i], 1]


@njit(cache=True, nogil=True)
def _rotate(u, v, starts, h, out_u, out_v):  # type: ignore[no-untyped-def]
    for k in range(len(starts) - 1):
        m = h[k]
        for i in range(starts[k], starts[k + 1]):
            a = np.float64(u[i])
            b = np.float64(v[i])
            w = m[2, 0] * a + m[2, 1] * b + m[2, 2]
            if w > 1e-6:
                out_u[i] = (m[0, 0] * a + m[0, 1] * b + m[0, 2]) / w
                out_v[i] = (m[1, 0] * a + m[1, 1] * b + m[1, 2]) / w
            else:
                out_u[i] = OUTSIDE
                out_v[i] = OUTSIDE

"""Events as rays seen from a reference view.

An event of packet k at pixel (u, v) is the ray C + s·d, C the packet's camera centre and d its
direction, both in the reference view. With w = 1 / Z it meets the plane Z at the pixel

    u + w·(fx·C_x - (u - cx)·C_z),   v + w·(fy·C_y - (v - cy)·C_z)

(u, v) being where d pierces the plane at infinity. The position is linear in inverse depth, so a
ray is four numbers and a plane one, whatever the motion: the two-step homography of Rebecq et al.
(EMVS, IJCV 2018, section 7.1) in the form that needs no canonical plane.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from numba import njit

from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.transforms import F64, inverse_pose

from ._pose_kernels import _matrices, _seen

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]

#: Parallax over the depth range below which there is no depth, px.
MIN_PARALLAX_PX = 2.0
#: Pixel of a ray that never meets a plane in front of the reference view.
OUTSIDE = -1e9
#: Cuts of a packet at most.
_MOST_CUTS = 1000
#: Events that are looked up before they are placed.
_CHUNK = 256


@dataclass(frozen=True)
class Packets:
    """Events in packets that share a pose."""

    #: The events, in order of time.
    events: EventArray
    #: Ideal pinhole pixel of every pixel; NaN where events don't count. Shape (height, width, 2).
    table: F32
    #: Where packets begin; the last entry is n. Shape (k + 1,).
    starts: I64
    #: Camera in base at each packet's median event. Shape (k, 4, 4).
    poses: F64

    def sample(self, every: int) -> Packets:
        """Every n-th event, at the pose of its packet."""
        part = self.events[::every]
        events = EventArray(*map(np.ascontiguousarray, (part.x, part.y, part.t_ns, part.p)))
        return replace(self, events=events, starts=-(-self.starts // every))


@dataclass(frozen=True)
class RayBundle:
    """Rays of events in one reference view."""

    #: Pixel (u, v) at infinity and its change with inverse depth (px·m). Shape (n, 4).
    rays: npt.NDArray[np.floating]
    #: Inverse depth from which planes lie behind the event's camera, 1/m; inf where none do. Shape
    #: (n,).
    limits: npt.NDArray[np.floating]

    def __len__(self) -> int:
        return len(self.rays)


def make_packets(
    events: EventArray,
    table: F32,
    track: PoseTrack,
    packet_events: int,
    most_travel_m: float = math.inf,
) -> Packets:
    """Group events in packets at the pose of their median event (paper, section on EMVS).

    The last packet may be smaller; no event is dropped. So many events may take as long as the
    surface needs to pass pixels by, where they are few, and where a packet begins in one read-out
    frame and ends in the next, whose events come column by column: the image's last and first
    columns would be half a frame off. `most_travel_m` cuts these packets.

    Parameters
    ----------
    events : EventArray
        In order of time, at least one.
    table : ndarray of float32, shape (height, width, 2)
        `Camera.undistortion_table`, NaN where events don't count.
    track : PoseTrack
        Camera in base.
    packet_events : int
        Events a packet.
    most_travel_m : float
        Way of the camera, m, during which events share a pose at the most, where it goes evenly.

    Raises
    ------
    PoseError
        Where the track has no pose.
    """
    n = len(events)
    starts = np.append(np.arange(0, n, packet_events, dtype=np.int64), n)
    if most_travel_m < math.inf:
        starts = _split(starts, events.t_ns, track, most_travel_m)
    medians = (starts[:-1] + starts[1:] - 1) // 2
    return Packets(events, table, starts, matrices_at(track, events.t_ns[medians]))


def _split(starts: I64, t_ns: I64, track: PoseTrack, most_m: float) -> I64:
    """Where packets begin once those that last longer than a way are cut, evenly in time."""
    ends_ns = t_ns[np.minimum(starts, len(t_ns) - 1)]
    since, known = ends_ns - ends_ns[0], track.times_ns - ends_ns[0]
    x, y, z = (np.diff(np.interp(since, known, axis)) for axis in track.positions.T)
    # Poses that are kilometres off give no depth; they mustn't take all memory for it.
    parts = np.minimum(np.ceil(np.sqrt(x * x + y * y + z * z) / most_m), _MOST_CUTS).astype(
        np.int64
    )
    long = np.flatnonzero(parts > 1)
    packet = np.repeat(long, parts[long] - 1)
    part = 1 + np.arange(len(packet)) - np.searchsorted(packet, packet)
    cuts_ns = ends_ns[packet] + np.diff(ends_ns)[packet] * part // parts[packet]
    # Two sorted runs, which a stable sort merges.
    out = np.sort(np.concatenate([starts, np.searchsorted(t_ns, cuts_ns)]), kind="stable")
    return out[np.append(True, np.diff(out) > 0)]


def matrices_at(track: PoseTrack, t_ns: npt.ArrayLike) -> F64:
    """`PoseTrack.matrices`, shape (n, 4, 4), in a tenth of the time.

    Parameters
    ----------
    track : PoseTrack
        Poses.
    t_ns : array_like of int, shape (n,)
        Times, ns, at least one.

    Raises
    ------
    PoseError
        Where the track has no pose.
    """
    times = np.asarray(t_ns, np.int64)
    track.check(int(times.min()), int(times.max()))
    out = np.empty((len(times), 4, 4))
    _matrices(track.times_ns, track.positions, track.quaternions, times, out)
    return out


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
    events, count = packets.events, len(packets.poses)
    h, centres = np.empty((count, 3, 3), np.float32), np.empty((count, 3), np.float32)
    _seen(inverse_pose(view), packets.poses, camera.K, np.linalg.inv(camera.K), h, centres)
    rays, limits = np.empty((len(events), 4), np.float32), np.empty(len(events), np.float32)
    intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32)
    pixels = np.empty((2, _CHUNK), np.float32)
    _make_rays(
        events.x, events.y, packets.table, packets.starts, h, centres, intrinsics, pixels, rays,
        limits,
    )  # fmt: skip
    return RayBundle(rays, limits)


def parallax_px(packets: Packets, camera: Camera, view: F64, near_m: float, far_m: float) -> float:
    """Pixels by which nearest and farthest plane part over the places that events come from.

    F·B·(1/near - 1/far) for a baseline B across the optical axis: the spread of the packets'
    camera centres, weighted by their events, so that a stray event doesn't stand for a path.
    """
    to_view = inverse_pose(view)
    centres = packets.poses[:, :3, 3] @ to_view[:2, :3].T + to_view[:2, 3]
    weight = np.diff(packets.starts) / packets.starts[-1]
    variance = weight @ (centres - weight @ centres) ** 2
    # An even spread over B has the variance B²/12.
    baseline = float(np.sqrt(12.0 * variance.sum()))
    return max(camera.fx, camera.fy) * baseline * (1.0 / near_m - 1.0 / far_m)


@njit(cache=True, nogil=True, error_model="numpy")
def _make_rays(  # type: ignore[no-untyped-def]
    x, y, table, starts, h, centres, intrinsics, pixels, rays, limits
):
    """Rays of packets; `pixels` is for use. Those that meet nothing in front are OUTSIDE."""
    real = rays.dtype.type
    fx, fy, cx, cy = intrinsics
    one, zero, outside, nearest = real(1), real(0), real(OUTSIDE), real(1e-6)
    never = real(np.inf)
    flat = table.reshape(-1)
    width = np.uint64(table.shape[1])
    a, b = pixels[0], pixels[1]
    for k in range(len(starts) - 1):
        m = h[k]
        right, down, forward = centres[k, 0] * fx, centres[k, 1] * fy, centres[k, 2]
        # A plane behind a packet's camera can't be what that camera saw.
        limit = one / forward if forward > zero else never
        for start in range(starts[k], starts[k + 1], len(a)):
            begin = np.uint64(start)
            count = np.uint64(min(len(a), starts[k + 1] - start))
            for i in range(count):
                at = np.uint64(2) * (np.uint64(y[begin + i]) * width + np.uint64(x[begin + i]))
                a[i] = flat[at]
                b[i] = flat[at + np.uint64(1)]
            for i in range(count):
                w = m[2, 0] * a[i] + m[2, 1] * b[i] + m[2, 2]
                share = one / w
                p = (m[0, 0] * a[i] + m[0, 1] * b[i] + m[0, 2]) * share
                q = (m[1, 0] * a[i] + m[1, 1] * b[i] + m[1, 2]) * share
                # Written so that NaN fails it.
                seen = w > nearest
                rays[begin + i, 0] = p if seen else outside
                rays[begin + i, 1] = q if seen else outside
                rays[begin + i, 2] = right - (p - cx) * forward if seen else zero
                rays[begin + i, 3] = down - (q - cy) * forward if seen else zero
                limits[begin + i] = limit if seen else never

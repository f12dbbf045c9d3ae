"""The strip: a frame on the surface for one pass of the sensor, cut into blocks of rows.

x points along the motion, z away from the camera. A ray is kept as the point where it meets one
plane of the strip and its two slopes, relative to the block, so float32 suffices however far the
robot's base is.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.events import EventArray
from roller_core.transforms import F64
from roller_emvs.evidence import CELL_PX, RayField
from roller_emvs.rays import F32

from . import _kernels
from .surface_settings import SurfaceSettings

#: Rows beyond a block's ends that its evidence reaches into, m.
MARGIN_M = 0.001


class MotionError(RollerError):
    """A motion that a strip can't follow."""


@dataclass
class Block:
    """Rays that can reach the rows start_m ≤ x < end_m of a strip.

    Attributes
    ----------
    start_m, end_m : float
        Rows, metres along the strip.
    rays : list of ndarray of float32, shape (n, 4)
        x from `start_m`, y, and slopes, metres.
    polarity : list of ndarray of uint8, shape (n,)
        Of the rays' events.
    first_ns, last_ns : int
        Times of its first and last event.
    """

    start_m: float
    end_m: float
    rays: list[F32] = field(default_factory=list)
    polarity: list[npt.NDArray[np.uint8]] = field(default_factory=list)
    first_ns: int = 0
    last_ns: int = 0
    events: int = 0


class Strip:
    """Frame and waiting blocks of one pass.

    Parameters
    ----------
    settings : SurfaceSettings
        Depth range, block length, patch.
    camera : Camera
        Intrinsics.
    rays : ndarray of float32, shape (height, width, 2)
        Direction of every pixel at unit depth, free of distortion.
    pose : ndarray, shape (4, 4)
        Camera in base where the pass begins; the origin of the strip.
    motion : ndarray, shape (3,)
        Direction of the motion in base.

    Raises
    ------
    MotionError
        If the sensor moves along its own axis.
    """

    def __init__(
        self, settings: SurfaceSettings, camera: Camera, rays: F32, pose: F64, motion: F64
    ) -> None:
        s = settings
        axis = pose[:3, 2]
        along = motion / np.linalg.norm(motion)
        if abs(along @ axis) > 0.5:
            raise MotionError("the sensor moves along its optical axis: no parallax, no depth")
        depth_axis = axis - (axis @ along) * along
        depth_axis /= np.linalg.norm(depth_axis)
        self.settings = s
        #: Strip to base.
        self.rotation = np.stack([along, np.cross(depth_axis, along), depth_axis], axis=1)
        self.origin = pose[:3, 3].copy()
        self.middle_m = 0.5 * (s.depth_min_m + s.depth_max_m)
        self.pixel_m = self.middle_m / max(camera.fx, camera.fy)
        self._pixel_rays = rays
        #: Path of the camera's centre: least and most x, for what each row was seen from.
        self.seen_m = (0.0, 0.0)
        self._slopes = (np.inf, -np.inf)
        self._travel_m, self._travel_ns = 0.0, 0
        self.focal_px = float(max(camera.fx, camera.fy))
        self.blocks: dict[int, Block] = {}
        self._done = -(2**62)
        border = np.concatenate([rays[0], rays[-1], rays[:, 0], rays[:, -1]])
        self._border = np.column_stack([border, np.ones(len(border))]).astype(np.float64)

    @property
    def held_rays(self) -> int:
        """Rays that wait; one that reaches two blocks counts twice."""
        return sum(b.events for b in self.blocks.values())

    @property
    def speed_m_s(self) -> float:
        """Mean speed of the camera while there were events."""
        return self._travel_m / self._travel_ns * 1e9 if self._travel_ns else 0.0

    def to_strip(self, pose: F64) -> F64:
        """A pose in base as one in the strip, shape (4, 4)."""
        out = np.eye(4)
        out[:3, :3] = self.rotation.T @ pose[:3, :3]
        out[:3, 3] = self.rotation.T @ (pose[:3, 3] - self.origin)
        return out

    def to_base(self, points: F64) -> F64:
        """Points of the strip in base, shape (n, 3)."""
        return points @ self.rotation.T + self.origin

    def view(self, pose: F64) -> tuple[float, float, float]:
        """Least and most slope along x of the image, and least x in view; pose in the strip."""
        d = self._border @ pose[:3, :3].T
        slope = d[:, 0] / np.maximum(d[:, 2], 1e-6)
        reach = [self.settings.depth_min_m, self.settings.depth_max_m]
        return (
            float(slope.min()),
            float(slope.max()),
            float(pose[0, 3] + min(slope.min() * z for z in reach)),
        )

    def add(self, events: EventArray, t0: int, t1: int, pose0: F64, pose1: F64) -> None:
        """Take the events between two poses, given in the strip."""
        s = self.settings
        self._travel_m += float(np.linalg.norm(pose1[:3, 3] - pose0[:3, 3]))
        self._travel_ns += t1 - t0
        rays = np.empty((4, len(events)))
        _kernels._place(
            events.x, events.y, events.t_ns, self._pixel_rays, t0, t1, pose0[:3, 3], pose1[:3, 3],
            pose0[:3, :3], pose1[:3, :3], self.middle_m, rays,
        )  # fmt: skip
        half_length = s.patch_half_length_m or np.inf
        x_min, x_max, steepest = _kernels._span(rays, half_length / self.middle_m)
        if x_min > x_max:
            return
        # Rays lean: over the depth range they also reach beside the point in the middle.
        drift = max(abs(pose0[2, 3]), abs(pose1[2, 3]))
        reach = MARGIN_M + steepest * (0.5 * (s.depth_max_m - s.depth_min_m) + drift)
        low = max(int(np.floor((x_min - reach) / s.block_m)), self._done + 1)
        high = int(np.floor((x_max + reach) / s.block_m))
        if high >= low:
            self._keep(rays, events, reach, low, high)

    def _keep(self, rays: F64, events: EventArray, reach: float, low: int, high: int) -> None:
        """Rays to those of the blocks low to high that they can reach."""
        length, blocks = self.settings.block_m, np.arange(low, high + 1)
        counts, limits = np.zeros(len(blocks), np.int64), np.iinfo(np.int64)
        times = np.tile([limits.max, limits.min], (len(blocks), 1))
        first, last = np.empty(len(events), np.int64), np.empty(len(events), np.int64)
        _kernels._find_blocks(rays, reach, length, (low, high), first, last, counts)
        ends = np.cumsum(counts)
        out, polarity = np.empty((ends[-1], 4), np.float32), np.empty(ends[-1], np.uint8)
        _kernels._list_blocks(
            rays, events.p, events.t_ns, first, last, blocks * length, ends - counts, out,
            polarity, times,
        )  # fmt: skip
        for k, count, end, (first_ns, last_ns) in zip(blocks, counts, ends, times, strict=True):
            if not count:
                continue
            block = self.blocks.setdefault(int(k), Block(k * length, (k + 1) * length))
            # Copies: a part of what all blocks share would keep the whole.
            block.rays.append(out[end - count : end].copy())
            block.polarity.append(polarity[end - count : end].copy())
            if not block.events:
                block.first_ns = int(first_ns)
            block.last_ns = int(last_ns)
            block.events += int(count)

    def advance(self, pose: F64) -> None:
        """The camera came to a pose, given in the strip."""
        low, high = self.seen_m
        self.seen_m = (min(low, float(pose[0, 3])), max(high, float(pose[0, 3])))
        least, most, _ = self.view(pose)
        if self.settings.patch_half_length_m:
            edge = self.settings.patch_half_length_m / self.middle_m
            least, most = max(least, -edge), min(most, edge)
        self._slopes = (min(self._slopes[0], least), max(self._slopes[1], most))

    def slopes_seen(self, x: npt.NDArray[np.floating]) -> tuple[F64, F64]:
        """Least and most slope from which points at x were in view so far."""
        low, high = self.seen_m
        least, most = self._slopes
        return (
            np.maximum((x - high) / self.middle_m, least),
            np.minimum((x - low) / self.middle_m, most),
        )

    def take(self, before_m: float) -> list[Block]:
        """Blocks that no ray reaches any more as all rows before `before_m` are out of view."""
        ready = sorted(k for k, b in self.blocks.items() if b.end_m + MARGIN_M <= before_m)
        if ready:
            self._done = max(self._done, ready[-1])
        return [self.blocks.pop(k) for k in ready]

    def drop_oldest(self) -> int:
        """Forget the oldest block; how many rays it held."""
        k = min(self.blocks)
        self._done = max(self._done, k)
        return self.blocks.pop(k).events


def block_field(strip: Strip, block: Block) -> tuple[RayField, float, float]:
    """Rays of a block on a grid of its own.

    Parameters
    ----------
    strip : Strip
        The pass.
    block : Block
        With at least one event.

    Returns
    -------
    field : RayField
        Offset is metres from the strip's middle plane.
    left, top : float
        Strip coordinates of the first pixel, metres.
    """
    parts = list(zip(block.rays, block.polarity, strict=True))
    spans = [_kernels._rows(*part) for part in parts]
    top, bottom = float(min(s[0] for s in spans)), float(max(s[1] for s in spans))
    off_count = sum(s[2] for s in spans)
    pixel = strip.pixel_m
    size = CELL_PX * pixel
    shape = (
        max(int(np.ceil((bottom - top) / size)), 2) * CELL_PX,
        max(int(np.ceil((block.end_m - block.start_m + 2 * MARGIN_M) / size)), 2) * CELL_PX,
    )
    bounds = np.array([0, off_count, block.events], np.int64)
    ordered, place = np.empty((block.events, 4), np.float32), bounds[:2].copy()
    corner = np.array([-MARGIN_M, top], np.float32)
    for part in parts:
        _kernels._to_pixels(*part, corner, np.float32(pixel), place, ordered)
    left = block.start_m - MARGIN_M
    columns = left + (np.arange(shape[1] // CELL_PX) + 0.5) * size
    slopes = np.stack(strip.slopes_seen(columns)) / pixel
    speed = strip.speed_m_s / pixel
    field = RayField(shape, slopes, pixel, 1.0, strip.focal_px, speed, ordered, bounds)
    return field, left, top

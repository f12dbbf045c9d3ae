"""The strip: a frame on the surface for one pass of the sensor, cut into blocks of rows.

x points along the motion, z away from the camera. An event is kept as the point where its ray
meets one plane of the strip and the ray's slope along x, relative to its block, so float32 suffices
however far the robot's base is. Its slope across follows from where the camera was.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.events import EventArray
from roller_core.transforms import F64
from roller_emvs.evidence import CELL_PX
from roller_emvs.rays import F32

from . import _event_kernels as kernels
from .blocks import MARGIN_M, Block, BlockCutter
from .camera_path import CameraPath
from .event_store import EventStore, StripEvents
from .surface_settings import SurfaceSettings

#: Where a block begins, from the chain's piece on, first page and number of events, of each chain
#: of pages.
Chains = tuple[F64, npt.NDArray[np.int32], npt.NDArray[np.int64]]
#: Slopes beyond those of the first pose that still count, as far as a camera may tilt in a pass:
#: 20° and more. The steepest of all, 76°.
_MORE_SLOPE, _STEEPEST = 0.5, 4.0
#: Longest time between poses in which an event's time fits 32 bits, ns.
_LONGEST_STEP_NS = 2_000_000_000
#: Size of the grid's pixels at most, in that of the camera's on the nearest surface.
_COARSEST = 1.05
#: A surface that lies so much further or nearer than assumed was seen from other slopes; depths
#: from which on that is sure.
_NEAR, _LEAST_DEPTHS = 0.05, 100


class MotionError(RollerError):
    """A motion that a strip can't follow."""


class Strip:
    """Frame and waiting events of one pass.

    Parameters
    ----------
    settings : SurfaceSettings
        Depth range, block length, patch.
    camera : Camera
        Calibration.
    rays : ndarray of float32, shape (height, width, 2)
        Direction of every pixel, at unit depth.
    start_ns : int
        When the pass begins, ROS time.
    pose : ndarray of float64, shape (4, 4)
        Camera in base where the pass begins.
    motion : ndarray of float64, shape (3,)
        Direction of the pass in base.

    Raises
    ------
    MotionError
        If the camera moves along its axis.
    """

    def __init__(
        self,
        settings: SurfaceSettings,
        camera: Camera,
        rays: F32,
        start_ns: int,
        pose: F64,
        motion: F64,
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
        self.half_m = 0.5 * (s.depth_max_m - s.depth_min_m)
        self.focal_px = float(max(camera.fx, camera.fy))
        #: Depth at which the surface lies, as far as is known; see `learn_depth`.
        self.depth_m = self.middle_m
        self._knows_depth = False
        self.pixel_m = min(self.middle_m, _COARSEST * s.depth_min_m) / self.focal_px
        self._pixel_rays = rays
        # Slopes are greatest and least at corners of the hull, however the camera turns.
        border = cv2.convexHull(np.concatenate([rays[0], rays[-1], rays[:, 0], rays[:, -1]]))[:, 0]
        self._border = np.column_stack([border, np.ones(len(border))]).astype(np.float64)
        self.store = EventStore(s.block_m, self._steepest(pose))
        self._blocks = BlockCutter(self.store, s.block_m, len(rays))
        self._placed = np.empty((3, 0), np.float32)
        self._path = CameraPath(start_ns)
        #: Least and most x of it, for what each row was seen from.
        self.seen_m = (0.0, 0.0)
        self._slopes = (np.inf, -np.inf)
        #: Least and most slope along x of the rays that count, as `patch_ends` finds them.
        self.ends = (-np.inf, np.inf)
        self._travel_m, self._travel_ns = 0.0, 0
        #: Rows before it are out of view.
        self._behind_m = -np.inf

    @property
    def held_events(self) -> int:
        """Events that wait."""
        return self.store.held

    @property
    def speed_m_s(self) -> float:
        """Mean speed of the camera while there were events."""
        return self._travel_m / self._travel_ns * 1e9 if self._travel_ns else 0.0

    @property
    def slopes(self) -> tuple[float, float]:
        """Least and most slope along x of the rays so far that count."""
        return max(self._slopes[0], self.ends[0]), min(self._slopes[1], self.ends[1])

    def _steepest(self, pose: F64) -> float:
        """Largest slope of a ray that counts, of a camera that began so and tilts no further."""
        if self.settings.patch_half_length_m:
            return self.settings.patch_half_length_m / self.middle_m
        d = self._border @ (self.rotation.T @ pose[:3, :3]).T
        slopes = np.linalg.norm(d[:, :2], axis=1) / np.maximum(d[:, 2], 1e-6)
        return min(float(slopes.max()) + _MORE_SLOPE, _STEEPEST)

    def to_strip(self, pose: F64) -> F64:
        """A pose in base as one in the strip, shape (4, 4)."""
        out = np.empty((4, 4))
        out[3] = 0.0, 0.0, 0.0, 1.0
        out[:3, :3] = self.rotation.T @ pose[:3, :3]
        out[:3, 3] = self.rotation.T @ (pose[:3, 3] - self.origin)
        return out

    def to_base(self, points: F64) -> F64:
        """Points of the strip in base, shape (n, 3)."""
        return points @ self.rotation.T + self.origin

    def add(self, events: EventArray, t0: int, t1: int, pose0: F64, pose1: F64) -> None:
        """Take the events between two poses, given in the strip."""
        if t1 - t0 > _LONGEST_STEP_NS:
            middle = t0 + (t1 - t0) // 2
            pose = pose0 + (middle - t0) / (t1 - t0) * (pose1 - pose0)
            before = int(np.searchsorted(events.t_ns, middle))
            self.add(events[:before], t0, middle, pose0, pose)
            self.add(events[before:], middle, t1, pose, pose1)
            return
        s = self.settings
        self._travel_m += float(np.linalg.norm(pose1[:3, 3] - pose0[:3, 3]))
        self._travel_ns += t1 - t0
        if self._placed.shape[1] < len(events):
            self._placed = np.empty((3, len(events)), np.float32)
        x_min, x_max, steepest = kernels._place(
            events.x, events.y, events.t_ns, self._pixel_rays, t0, t1, pose0, pose1,
            self.middle_m, self.store.steepest, self._placed,
        )  # fmt: skip
        if x_min > x_max:
            return
        # Rays lean: over the depth range they also reach beside the point in the middle.
        drift = max(abs(pose0[2, 3]), abs(pose1[2, 3]))
        self._blocks.reach(MARGIN_M + steepest * (self.half_m + drift))
        at, length = float(pose0[0, 3]), s.block_m
        low = int(np.floor((at + x_min) / length))
        high = int(np.floor((at + x_max) / length))
        low = self._blocks.open_from(low)
        if high >= low:
            self.store.add(self._placed, events, at - low * length, low, range(low, high + 1))

    def advance(self, t_ns: int, pose: F64) -> None:
        """The camera came to a pose, given in the strip."""
        self._path.add(t_ns, pose[:3, 3])
        low, high = self.seen_m
        self.seen_m = (min(low, float(pose[0, 3])), max(high, float(pose[0, 3])))
        d = self._border @ pose[:3, :3].T
        slope = d[:, 0] / np.maximum(d[:, 2], 1e-6)
        least, most = float(slope.min()), float(slope.max())
        ends = (self.settings.depth_min_m, self.settings.depth_max_m)
        self._behind_m = float(pose[0, 3]) + min(least * z for z in ends)
        if self.settings.patch_half_length_m:
            edge = self.settings.patch_half_length_m / self.middle_m
            least, most = max(least, -edge), min(most, edge)
        self._slopes = (min(self._slopes[0], least), max(self._slopes[1], most))

    def learn_depth(self, offsets: npt.NDArray[np.floating]) -> bool:
        """Take the offsets of a block's depths; whether what was assumed of them is too far off.

        Of a wide range of depths the surface is anywhere, and its rows are seen from elsewhere.
        """
        if len(offsets) < _LEAST_DEPTHS:
            return False
        depth_m = self.middle_m + float(np.median(offsets))
        if abs(depth_m - self.depth_m) <= _NEAR * self.depth_m:
            return False
        first, self._knows_depth = not self._knows_depth, True
        self.depth_m = depth_m
        return first

    def slopes_seen(self, x: npt.NDArray[np.floating]) -> tuple[F64, F64]:
        """Least and most slope from which points at x were in view so far."""
        low, high = self.seen_m
        least, most = self.slopes
        return (
            np.maximum((x - high) / self.depth_m, least),
            np.minimum((x - low) / self.depth_m, most),
        )

    def cell_columns(self, block: Block) -> F64:
        """Middles of the columns of cells of a block's grid, which has margins; along the strip."""
        size = CELL_PX * self.pixel_m
        count = max(int(np.ceil((block.end_m - block.start_m + 2 * MARGIN_M) / size)), 2)
        return np.asarray(block.start_m - MARGIN_M + (np.arange(count) + 0.5) * size)

    def aperture_m(self, block: Block) -> float:
        """Travel of the camera during which the best seen of a block's rows were in view."""
        low, high = self.slopes_seen(self.cell_columns(block))
        return max(float((high - low).max()), 0.0) * self.depth_m

    def ready(self, flush: bool = False) -> list[Block]:
        """Blocks that no event reaches any more as their rows are out of view, in order."""
        return self._blocks.ready(self._behind_m, self.speed_m_s, flush)

    def release(self, block: Block) -> None:
        """A block was measured: events that reach none of those that follow are forgotten."""
        self._blocks.release(block)
        held = self.store.blocks
        if held:
            self._path.forget_before(self.store.times(held[0])[0])

    def drop_oldest(self) -> int:
        """Forget the oldest block and the rows that its events reach; how many events it held."""
        return self._blocks.drop_oldest()

    def events(self, block: Block, polarity: int) -> StripEvents:
        """Events that reach the rows of a block, of one polarity; x from the block's start on."""
        length = self.settings.block_m
        parts = [self.store.events(j, polarity, (j - block.number) * length) for j in block.sources]
        names = ("x_m", "y_m", "slope")
        every = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        least, most = self.ends
        within = (every["slope"] >= least) & (every["slope"] <= most)
        return StripEvents(*(every[name][within] for name in names))

    def chains(self, block: Block, polarity: int, reach_m: float) -> Chains:
        """Pages of the store with the events within some distance of a block."""
        length = self.settings.block_m
        # Of a whole block 0, to the bit: what is about its rows may begin later, and end earlier.
        later = block.start_m - block.number * length
        earlier = block.end_m - block.end * length
        begins, pages, counts = [], [], []
        for j in block.sources:
            begin = (block.number - j) * length + later
            ends = begin - reach_m, (block.end - j) * length + earlier + reach_m
            starts, first_pages, of_pieces = self.store.chains(j, polarity, *ends)
            begins.append(begin - starts)
            pages.append(first_pages)
            counts.append(of_pieces)
        return np.concatenate(begins), np.concatenate(pages), np.concatenate(counts)

    def scales(self, block: Block) -> tuple[float, float, float, float]:
        """Least y of a block, pixel of its grid and piece of the store, m; the steepest slope."""
        return block.low_y_m, self.pixel_m, self.store.piece_m, self.store.steepest

    def centres(self, block: Block) -> F64:
        """Path of the camera's centre while a block's events came, in the strip, shape (n, 3)."""
        return self._path.centres(block.first_ns, block.last_ns)

    def speed_of(self, block: Block) -> float:
        """Mean speed of the camera along the strip while a block's events came, but for stops."""
        least_m_s = self.settings.min_speed_m_s
        return self._path.speed_m_s(block.first_ns, block.last_ns, least_m_s)

    def fan(self, block: Block, y_m: F64) -> F64:
        """Slopes dy/dz of a block's rays through y on the middle plane, for a straight path."""
        _, y, z = self.centres(block).mean(axis=0)
        return np.asarray((y_m - y) / (self.middle_m - z), np.float64)

    def across(self, events: StripEvents, start_m: float) -> F32:
        """Slopes dy/dz of events' rays, from where the camera was; their x is from `start_m` on."""
        x = events.x_m.astype(np.float64) + start_m
        y, z = self._path.across_at(x, events.slope, self.middle_m)
        return np.asarray((events.y_m - y) / (self.middle_m - z), np.float32)

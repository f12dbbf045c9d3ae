"""A window's events on the pixels of its reference view, by their rays or by aperture parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from roller_core.camera import Camera
from roller_core.transforms import F64, inverse_pose
from roller_emvs.evidence import CELL_PX, PartImages, Parts, RayField
from roller_emvs.evidence.part_images import sort_events
from roller_emvs.rays import Packets, rays_in_view

#: Events a pixel of the image from which on parts cost less than rays.
_LEAST_EVENTS = 1.0
#: Pixels by which events may leave their row, and their part's image, at an end of the range.
_MOST_ACROSS_PX, _MOST_BESIDE_PX = 0.5, 0.7
#: Parallax of a part, px over the range: its events leave its image by a quarter of that.
_PART_PX = 1.2
#: Parts of a window: fewer are no better than rays, more take memory.
_FEWEST_PARTS, _MOST_PARTS = 6, 56
#: Share of the parts that must have so much of the mean part's events: by how much images are moved
#: is rounded, which evens out over many.
_FILLED, _OF_MEAN = 0.5, 0.1
#: Rows and columns of a grid up to which a number tells where on it an event lies.
_MOST_PX = 3840


@dataclass(frozen=True)
class WindowView:
    """How a window's events are seen from its reference view."""

    #: The events.
    packets: Packets
    #: Intrinsics.
    camera: Camera
    #: Reference camera in base. Shape (4, 4).
    view: F64
    #: Inverse depths of the range, 1/m: offset 0, and the offset of either end.
    middle: float
    half: float
    #: Whether planes part along the image's columns, so that rows and columns change places.
    turned: bool
    #: Packets' cameras in the reference view. Shape (packets, 4, 4).
    relative: F64
    #: Least and most slope that each column can have been seen from. Shape (2, columns of cells).
    slopes: F64
    #: Speed of the surface through the image, px/s.
    speed_px_s: float
    #: 1 where the camera moves along the parallax' columns, -1 where it moves against them.
    direction: float

    @classmethod
    def of(
        cls,
        packets: Packets,
        camera: Camera,
        view: F64,
        depths_m: tuple[float, float],
        ends: tuple[float, float] = (-np.inf, np.inf),
    ) -> WindowView:
        """A window's view for a range of depths, nearest and farthest, of rays between slopes."""
        c, (near, far) = camera, (1.0 / depths_m[0], 1.0 / depths_m[1])
        middle = 0.5 * (near + far)
        relative = inverse_pose(view) @ packets.poses
        travel = np.ptp(relative[:, :2, 3] * [c.fx, c.fy], axis=0)
        turned = bool(travel[1] > travel[0])
        focal, axis, columns = (c.fy, c.cy, c.height) if turned else (c.fx, c.cx, c.width)
        # A column's point was in view from where the camera saw it at a pixel.
        left, right = max(axis + ends[0] * focal, 0.0), min(axis + ends[1] * focal, columns - 1.0)
        x = (np.arange(-(-columns // CELL_PX)) + 0.5) * CELL_PX - 0.5
        along = focal * relative[:, 1 if turned else 0, 3]
        slopes = np.stack(
            [
                np.maximum((x - right) / middle, along.min()),
                np.minimum((x - left) / middle, along.max()),
            ]
        )
        times = packets.events.t_ns
        seconds = max(float(times[-1] - times[0]) * 1e-9, 1e-9)
        speed = float(travel.max()) * middle / seconds
        half = 0.5 * (near - far)
        direction = 1.0 if along[-1] >= along[0] else -1.0
        return cls(packets, c, view, middle, half, turned, relative, slopes, speed, direction)

    @property
    def focal_px(self) -> float:
        """Focal length along the parallax, px."""
        return self.camera.fy if self.turned else self.camera.fx

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns that the parallax goes along, px; multiples of `CELL_PX`."""
        rows, columns = self.camera.height, self.camera.width
        if self.turned:
            rows, columns = columns, rows
        return -(-rows // CELL_PX) * CELL_PX, -(-columns // CELL_PX) * CELL_PX

    @property
    def _of_field(self) -> tuple[tuple[int, int], F64, float, float, float, float, float]:
        focal = self.focal_px
        return (
            self.shape,
            self.slopes,
            -self.middle / focal,
            -(self.middle**2),
            focal,
            self.speed_px_s,
            self.direction,
        )

    def ray_field(self) -> RayField:
        """Rays of all events; their offset is inverse depth less `middle`."""
        polarity = self.packets.events.p
        rays = rays_in_view(self.packets, self.camera, self.view).rays
        rays = rays.astype(np.float32, copy=False)
        placed, off_count = np.empty_like(rays), len(rays) - int(np.count_nonzero(polarity))
        _place(rays, polarity, self.turned, np.float32(self.middle), off_count, placed)
        return RayField(*self._of_field, placed, np.array([0, off_count, len(rays)], np.int64))

    def parts(self) -> Parts | None:
        """Parts of the aperture; None for few events or where the motion doesn't fit them.

        It fits where events stay in their row and their part's image over the whole range, and
        were seen from most of the way.
        """
        c, p = self.camera, self.packets
        if len(p.events) < _LEAST_EVENTS * c.width * c.height or max(self.shape) > _MOST_PX:
            return None
        x, y, z = self.relative[:, :3, 3].T
        edge_x, edge_y = max(c.cx, c.width - c.cx), max(c.cy, c.height - c.cy)
        along, across, beside, out = c.fx * x, c.fy * y, edge_x, edge_y
        if self.turned:
            along, across, beside, out = across, along, out, beside
        if (np.abs(across) + out * np.abs(z)).max() * self.half > _MOST_ACROSS_PX:
            return None
        low, high = float(along.min()), float(along.max())
        count = int(np.ceil((high - low) * 2 * self.half / _PART_PX))
        if not _FEWEST_PARTS <= count <= _MOST_PARTS:
            return None
        width = (high - low) / count
        # Packets as far apart as parts share would lie on their borders, here or there by rounding.
        number = np.minimum(((along - low) / width + 1e-3).astype(np.int64), count - 1)
        events = np.bincount(number, np.diff(p.starts), count)
        if (events > _OF_MEAN * events.mean()).mean() < _FILLED:
            return None
        slopes = low + (np.arange(count, dtype=np.float64) + 0.5) * width
        leaves = np.abs(along - slopes[number]) + beside * np.abs(z)
        if leaves.max() * self.half > _MOST_BESIDE_PX:
            return None
        return Parts(slopes, width, number)

    def part_images(self, parts: Parts, threads: int = 1) -> PartImages:
        """Every event's vote in the image of its part.

        Parameters
        ----------
        parts : Parts
            Of this window.
        threads : int
            Threads that share the events.
        """
        p = self.packets
        # What comes into the grid on a plane, the one beyond either end of the range included.
        margin = int(1.3 * np.abs(parts.slopes).max() * self.half) + 2
        events, starts, spans = sort_events(
            p.events, p.table, p.starts, self._to_middle(), parts, self.shape, margin, threads
        )
        return PartImages(*self._of_field, parts, margin, spans, events, starts)

    def _to_middle(self) -> F64:
        """Homographies from a packet's pixels to those on the middle plane, (packets, 3, 3)."""
        c, w, r = self.camera, self.middle, self.relative
        x, y, z = r[:, :3, 3].T[..., None]
        # The rotation times K^-1, its rows times K, and from infinity to the middle plane.
        at = np.stack([r[:, :3, 0] / c.fx, r[:, :3, 1] / c.fy, r[:, :3, 2]], axis=2)
        at[..., 2] -= at[..., 0] * c.cx + at[..., 1] * c.cy
        forward = at[:, 2].copy()
        at[:, 0] = (1 - w * z) * (c.fx * at[:, 0] + c.cx * forward)
        at[:, 1] = (1 - w * z) * (c.fy * at[:, 1] + c.cy * forward)
        at[:, 0] += w * (c.fx * x + c.cx * z) * forward
        at[:, 1] += w * (c.fy * y + c.cy * z) * forward
        return at[:, [1, 0, 2]] if self.turned else at


@njit(cache=True, nogil=True)
def _place(rays, polarity, turned, middle, off_count, out):  # type: ignore[no-untyped-def]
    """Rays on the middle plane, OFF before ON; with x and y changed over if `turned`."""
    one, two, three, four = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4)
    off, on = np.uint64(0), np.uint64(off_count)
    a = one if turned else np.uint64(0)
    b = one - a
    flat, to = rays.reshape(-1), out.reshape(-1)
    for i in range(np.uint64(len(polarity))):
        at = four * i
        positive = polarity[i] > 0
        k = four * (on if positive else off)
        on += np.uint64(positive)
        off += np.uint64(not positive)
        x, y, dx, dy = flat[at + a], flat[at + b], flat[at + two + a], flat[at + two + b]
        to[k] = x + middle * dx
        to[k + one] = y + middle * dy
        to[k + two] = dx
        to[k + three] = dy

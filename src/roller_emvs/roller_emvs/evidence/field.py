"""What evidence is summed from: a grid of pixels, and rays on it.

A ray meets the plane of parameter `offset` at pixel (x, y) + offset · (slope_x, slope_y). In a
reference view the parameter is inverse depth, in a strip on the surface it is height; both are
linear.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64
from roller_emvs.rays import F32

from . import _meet_kernels as meet
from ._kernels import CELL_PX

I32 = npt.NDArray[np.int32]
Mask = npt.NDArray[np.bool_]
#: Rows and columns of cells.
Box = tuple[slice, slice]

#: Depths, at most, of which a median is taken.
_SAMPLE = 1000
#: A grid is cut where less than this share of it is left.
_MOST_CUT = 0.8


@dataclass(frozen=True)
class EvidenceField(ABC):
    """Events of a window or block on a grid of pixels, x along the parallax."""

    #: Rows and columns of the grid, px; multiples of `CELL_PX`.
    shape: tuple[int, int]
    #: Least and most slope along x from which each column was in view. Shape (2, columns of cells).
    slopes: F64
    #: From a slope to the ray's slope dx/dz at the surface.
    ray_slope_scale: float
    #: From metres of depth, away from the camera, to the offset.
    offset_per_m: float
    #: Focal length, px.
    focal_px: float
    #: Speed of the surface through the image, px/s.
    speed_px_s: float
    #: 1 where the camera moves along x, -1 where it moves against it.
    direction: float
    #: Speed of the camera while these events came, m/s; None: the one that `speed_px_s` is of.
    camera_m_s: float | None = field(default=None, kw_only=True)
    #: Most spread of slopes of any column of the grid that this was cut from; None: of its own.
    most_spread: float | None = field(default=None, kw_only=True)
    #: Whether it is a part that was cut from a larger grid.
    is_part: bool = field(default=False, kw_only=True)

    @property
    def cells(self) -> tuple[int, int]:
        """Rows and columns of cells."""
        return self.shape[0] // CELL_PX, self.shape[1] // CELL_PX

    @cached_property
    def aperture(self) -> float:
        """Most spread of slopes of any column: pixels of parallax by unit of offset."""
        if self.most_spread is not None:
            return self.most_spread
        return float(max((self.slopes[1] - self.slopes[0]).max(), 0.0))

    @cached_property
    def middles(self) -> F64:
        """Middle of the slopes that each column of cells was seen with; 0 where it never was."""
        low, high = self.slopes
        return np.where(high > low, 0.5 * (low + high), 0.0)

    @cached_property
    def apertures(self) -> F32:
        """Spread of slopes of each column of cells, float32."""
        return np.maximum(self.slopes[1] - self.slopes[0], 0.0).astype(np.float32)

    @property
    def speed_m_s(self) -> float:
        """Speed of the camera over the surface, m/s."""
        if self.camera_m_s is not None:
            return self.camera_m_s
        return self.speed_px_s * self._pixel_m

    @property
    def _pixel_m(self) -> float:
        """Size of a pixel on the surface, m."""
        return abs(self.ray_slope_scale / self.offset_per_m)

    @property
    def slope_per_px(self) -> float:
        """From a change of offset by px along x to dh/dx of the surface along the motion."""
        return self.direction / (self.offset_per_m * self._pixel_m)

    def planes_in_effect(self, at: F64) -> F64 | None:
        """Offsets that planes have in effect, shape (planes, columns of cells); None: as asked."""
        return None

    def cut_around(self, cells: Mask, reach: int) -> tuple[EvidenceField, Box] | None:
        """The same on some cells and those around, and where they lie.

        None where that is most of the grid, or where the field can't be cut.
        """
        return None

    @abstractmethod
    def slope_sums(self, offset: F32, polarity: int) -> F32:
        """Count of the events that meet the surface, their slopes and squares, by cell.

        Parameters
        ----------
        offset : ndarray of float32, shape (rows, columns)
            Surface on cells, NaN where there is none.
        polarity : int
            0 for OFF, 1 for ON events.

        Returns
        -------
        ndarray of float32, shape (rows, columns, 3)
        """

    @abstractmethod
    def support(self, offset: F32, polarity: int) -> F32:
        """Count of the events that meet the surface, by pixel; `offset` is by pixel too."""


@dataclass(frozen=True)
class RayField(EvidenceField):
    """Rays in pixels of a grid."""

    #: x, y on the plane of offset 0, px, and slopes, px by unit of offset; OFF events first. Shape
    #: (n, 4).
    rays: F32
    #: Where OFF and ON events begin, and the end. Shape (3,).
    bounds: npt.NDArray[np.int64]

    #: Column and row of the grid's first pixel in what the rays are in.
    corner: tuple[float, float] = (0.0, 0.0)

    def some(self, polarity: int, every: int = 1) -> F32:
        """Rays of every n-th OFF (0) or ON (1) event, float32, shape (n, 4)."""
        own = self.rays[self.bounds[polarity] : self.bounds[polarity + 1] : every]
        return np.ascontiguousarray(own)

    def cut_around(self, cells: Mask, reach: int) -> tuple[RayField, Box] | None:
        """See `EvidenceField`."""
        box = box_around(cells, reach, 1)
        if box is None:
            return None
        rows, columns = box
        left, top = self.corner
        corner = left + CELL_PX * columns.start, top + CELL_PX * rows.start
        part = replace(
            self, shape=shape_of(box), slopes=self.slopes[:, columns], corner=corner,
            most_spread=self.aperture, is_part=True,
        )  # fmt: skip
        return part, box

    def slope_sums(self, offset: F32, polarity: int) -> F32:
        """See `EvidenceField`."""
        sums, start = np.zeros((*self.cells, 3), np.float32), sample_median(offset)
        if start is not None:
            first, last = int(self.bounds[polarity]), int(self.bounds[polarity + 1])
            flat, width = np.append(offset, np.float32(np.nan)), offset.shape[1]
            meet._meet(self.rays, first, last, self.corner, flat, start, width, sums.reshape(-1))
        return sums

    def support(self, offset: F32, polarity: int) -> F32:
        """See `EvidenceField`."""
        first, last = int(self.bounds[polarity]), int(self.bounds[polarity + 1])
        _, counts = ground(self.rays[first:last], offset, self.corner)
        return counts[:-1].reshape(self.shape).astype(np.float32)


def box_around(cells: Mask, reach: int, step: int) -> Box | None:
    """Some cells and those around, columns in steps; None where that is most of them, or none."""
    if not cells.any():
        return None
    box = []
    for axis, by in ((0, 1), (1, step)):
        known, count = np.asarray(cells.any(axis=1 - axis)), cells.shape[axis]
        first = max(int(known.argmax()) - reach, 0) // by * by
        last = -(-(count - int(known[::-1].argmax()) + reach) // by) * by
        box.append(slice(first, min(last, count)))
    size = (box[0].stop - box[0].start) * (box[1].stop - box[1].start)
    return (box[0], box[1]) if size < _MOST_CUT * cells.size else None


def shape_of(box: Box) -> tuple[int, int]:
    """Rows and columns of a part of a grid, px."""
    rows, columns = box
    return CELL_PX * (rows.stop - rows.start), CELL_PX * (columns.stop - columns.start)


def ground(rays: F32, surface: F32, corner: tuple[float, float] = (0.0, 0.0)) -> tuple[I32, I32]:
    """Pixel in which each ray, float32, shape (n, 4), meets a surface, and how many meet each.

    Pixels are of the flat image; `surface` is the offset by pixel, NaN where it is unknown. The
    last entry of the counts is of rays that meet it nowhere.
    """
    pixel, counts = np.empty(len(rays), np.int32), np.zeros(surface.size + 1, np.int32)
    start = sample_median(surface)
    if start is None:
        pixel[:], counts[-1] = surface.size, len(rays)
    else:
        flat = np.append(surface, np.float32(np.nan))
        meet._ground(rays, corner, flat, start, surface.shape[1], pixel, counts)
    return pixel, counts


def sample_median(values: F32) -> np.float32 | None:
    """Median of a sample of the values that are finite; None if there are none.

    Of offsets it is where rays begin to look for the surface.
    """
    for sample in (values.ravel()[:: values.size // _SAMPLE + 1], values):
        known = sample[np.isfinite(sample)]
        if len(known):
            return np.float32(np.sort(known)[len(known) // 2])
    return None

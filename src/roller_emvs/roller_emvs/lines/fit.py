"""A line through the events of each feature, by polarity: where it lies and how high.

An event on a feature at (x, offset) meets another plane beside it by its ray's slope times the
distance of the planes. So the events of one feature, placed on any plane near it, lie on a line
over their slopes, whose inclination is what the plane's offset lacks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64
from roller_emvs.evidence.blur import blurred
from roller_emvs.rays import F32

from . import _kernels as kernels
from . import _robust_kernels as robust_kernels
from .ray_source import RaySource

I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]

#: Half width along the parallax and across it of the events that a line is fitted to, px.
_WINDOW_PX = 2.9, 4.75
#: Distance from which on an event counts for nothing, px, and rounds of the robust fit.
_TUKEY_PX, _ROUNDS = 2.1, 3
#: Events that the rounds before the last take.
_SAMPLE = 300
#: Rows from line to line, px; and under a texture, where lines are many. Their windows overlap.
ROW_STEP, TEXTURE_ROW_STEP = 2, 4
#: A line's pixel holds this share of the events of the fullest one nearby.
_LEAST_SHARE, _NEARBY_PX = 0.4, 3
#: Spread of the count of events that the place of a line is taken from, rows and columns, px.
_BLUR_PX = 2.0, 0.8
#: Columns beside those wanted whose events count into them, px.
_BESIDE_PX = 4
#: Events, a variance of the rays' slopes dx/dz and a largest correction, m, for a line to be one.
_LEAST_EVENTS, LEAST_VARIANCE, _MOST_M = 30.0, 0.012, 5e-4
#: Least width of the band in which a line's events lie, one deviation, px: pixels are no smaller.
_LEAST_BAND_PX = 0.05
#: A line further than this from the median of its contour is none, m; the contour's half length
#: and half width, px.
_VOTE_M, _CONTOUR_PX = 1.2e-4, (6, 1.5)
_MOST_VOTES = 64
#: What a line's height adds to the surface is the mean of the lines along its contour, by what each
#: is sure of and a Gaussian of this deviation; its half length, rows.
_ALONG_ROWS, _REACH_ROWS = 5.0, 10
#: Events of a pixel's crossing come of one threshold: their number counts as this share.
INDEPENDENT = 0.5


@dataclass(frozen=True)
class Lines:
    """Lines of one polarity, sorted by row; arrays of shape (n,)."""

    #: Row, px.
    row: I64
    #: Column, px.
    x: F64
    #: Columns by row.
    tilt: F64
    #: Of the plane that the line lies on.
    offset: F64
    #: Variance of x, covariance of x and offset, variance of the offset. Shape (n, 3).
    variance: F64
    #: Events that the fit rests on, of equal weight.
    events: F64
    #: Mean slope of the rays.
    lean: F64
    #: Variance of the slopes.
    spread: F64
    #: Width of the band in which its events lie, one deviation, px; at most half the window's.
    band: F64

    def __len__(self) -> int:
        return len(self.row)

    def __getitem__(self, which: npt.NDArray[np.bool_]) -> Lines:
        return Lines(**{name: values[which] for name, values in self.__dict__.items()})


_NONE = np.empty(0)
NO_LINES = Lines(np.empty(0, np.int64), _NONE, _NONE, _NONE, np.empty((0, 3)), *[_NONE] * 4)


def fit_lines(
    rays: RaySource,
    surface: F32,
    columns: tuple[int, int],
    offset_per_m: float,
    slope_scale: float,
    direction: float,
    row_step: int = ROW_STEP,
) -> Lines:
    """Fit a line wherever the events of one polarity gather along the parallax.

    Parameters
    ----------
    rays : RaySource
        Events of that polarity.
    surface : ndarray of float32, shape (height, width)
        Offset by pixel, NaN where it is unknown.
    columns : tuple of int
        First column in which lines are wanted, and the one after the last.
    offset_per_m : float
        From metres of depth to the offset.
    slope_scale : float
        From slopes to the rays' dx/dz.
    direction : float
        1 where the camera moves along x, -1 where it moves against it.
    row_step : int
        Rows from line to line, px.
    """
    height, width = surface.shape
    pixel, counts = rays.ground(surface)
    row, column = _crests(counts[:-1].reshape(height, width), columns, row_step)
    if not len(row):
        return NO_LINES
    at = surface[row, column].astype(np.float64)
    ordered, starts = _near(rays, pixel, counts, row, column, width)
    out = np.empty((len(row), 10))
    robust_kernels._fit_lines(
        ordered, starts, width, row, column, at, np.array(_WINDOW_PX), _TUKEY_PX, _ROUNDS,
        _SAMPLE, direction, out,
    )  # fmt: skip
    p, d, tilt, v_x, v_xd, v_d, events, lean, spread, robust = out.T
    steps = np.abs(d / offset_per_m)
    with np.errstate(invalid="ignore"):
        keep = (
            np.isfinite(at)
            & (events >= _LEAST_EVENTS)
            & (spread * slope_scale**2 >= LEAST_VARIANCE)
            & (steps <= _MOST_M)
        )
    robust = np.maximum(robust, _LEAST_BAND_PX**2)
    variance = (robust / INDEPENDENT)[:, None] * np.stack([v_x, -v_xd, v_d], axis=1)
    # What lies beyond the window isn't seen, nor how wide such a band is.
    band = np.minimum(np.sqrt(robust), _WINDOW_PX[0] / 2)
    # A ray's offset counts from the plane that it was placed on: away from there x falls short.
    lines = Lines(row, column + p, tilt, at - d, variance, events, lean, spread, band)[keep]
    agreeing = _agreeing(lines, _VOTE_M * abs(offset_per_m))
    return _averaged(lines[agreeing], d[keep][agreeing], row_step)


def _crests(counts: I32, columns: tuple[int, int], row_step: int) -> tuple[I64, I64]:
    """Rows and columns of the pixels, between two columns, where events gather along the row.

    Of every `row_step`-th row.
    """
    (height, width), (first, last) = counts.shape, columns
    begin, end = max(first - _BESIDE_PX, 0), min(last + _BESIDE_PX, width)
    wanted = np.empty((height, 2), np.int32)
    wanted[:] = 1, 0
    wanted[::row_step] = 0, 0
    density = blurred(counts[None, :, begin:end].astype(np.float32), _BLUR_PX, wanted)[0]
    density[:, : first - begin] = 0
    density[:, last - begin :] = 0
    # A window of even density must hold the events that a line needs.
    floor = _LEAST_EVENTS / (4 * _WINDOW_PX[1] * _TUKEY_PX)
    row, column = np.empty((2, height * (last - first) // 4 + 1), np.int64)
    count = kernels._ridges(density, floor, _LEAST_SHARE, _NEARBY_PX, row_step, row, column)
    return row[:count], column[:count] + begin


def _near(
    rays: RaySource, pixel: I32, counts: I32, row: I64, column: I64, width: int
) -> tuple[F32, I32]:
    """Rays that lie in the windows around some places, by pixel, and where each pixel's begin."""
    wanted = np.zeros((len(counts) // width, width), np.uint8)
    wanted[row, column] = 1
    reach = [2 * int(np.ceil(half)) + 3 for half in _WINDOW_PX]
    cv2.dilate(wanted, np.ones((reach[1], reach[0]), np.uint8), dst=wanted)
    starts, place = np.empty((2, len(counts)), np.int32)
    ordered = np.empty((kernels._starts(counts, wanted, starts, place), 4), np.float32)
    rays.by_pixel(pixel, place, ordered)
    return ordered, starts


def _agreeing(lines: Lines, most: float) -> npt.NDArray[np.bool_]:
    """Which lines agree with others along their contour."""
    votes, near = np.empty(len(lines)), np.empty(len(lines), np.int64)
    reach_y, reach_x = _CONTOUR_PX
    ends = np.searchsorted(lines.row, lines.row + reach_y, side="right")
    kernels._vote(
        lines.row, lines.x, lines.tilt, lines.offset, ends, reach_y, reach_x, _MOST_VOTES,
        votes, near,
    )  # fmt: skip
    return np.asarray((np.abs(lines.offset - votes) <= most) & (near > 1))


def _averaged(lines: Lines, lack: F64, row_step: int) -> Lines:
    """Lines whose offset less the surface's, `lack`, is the mean along their contour.

    Not the offset itself: that would level a surface that bends along the contour.
    """
    own = lines.variance[:, 2]
    mean, left = np.empty(len(lines)), np.empty(len(lines))
    ends = np.searchsorted(lines.row, lines.row + _REACH_ROWS, side="right")
    kernels._along(
        lines.row, lines.x, lines.tilt, lack, own, ends, _REACH_ROWS, _CONTOUR_PX[1], _ALONG_ROWS,
        mean, left,
    )  # fmt: skip
    variance = lines.variance.copy()
    shared = 2 * _WINDOW_PX[1] / row_step  # so many neighbours have the same events
    variance[:, 2] = np.minimum(shared * left, own)
    return replace(lines, offset=lines.offset + lack - mean, variance=variance)

"""A grid of dots in an event stream: dots that blink on a screen, or that are shaken a little.

A dot that blinks gives events all over itself and nothing around it, so the image of event counts
shows the grid as a photograph would. The grid is OpenCV's asymmetric one: every other row is moved
by half the distance of its dots, and with an odd number of rows it has one way round only.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.transforms import F64

F32 = npt.NDArray[np.float32]

#: Events are counted over this long, ns; a view stands still over two such windows or more.
WINDOW_NS = 300_000_000
LEAST_WINDOWS = 2
#: A grid that has moved no further stands still, px: by what its dots have in common, as each is
#: found by chance a little off, the more the softer the lens.
_STILL_PX = 0.4
#: Fewest events of a window in which it is worth to look.
_LEAST_EVENTS = 3000
_BLUR_PX = 1.5
#: A dot's events lie within this share of the distance to its neighbours.
_DOT_SHARE = 0.38


@dataclass(frozen=True)
class DotGrid:
    """The target."""

    #: Distance of neighbouring dots of a row, metres.
    pitch_m: float
    #: Dots a row, and rows, which must be odd.
    columns: int = 4
    rows: int = 11

    @property
    def points_m(self) -> F32:
        """Places of the dots on the target, shape (rows × columns, 3), metres, z = 0."""
        row, column = np.divmod(np.arange(self.rows * self.columns), self.columns)
        x, y = (2 * column + row % 2) * 0.5, row * 0.5
        return (self.pitch_m * np.stack([x, y, 0 * x], axis=1)).astype(np.float32)

    def to_dots(self, place: F64) -> F64:
        """Distance of places on the target to the dot that they are next to.

        The dots are on a square lattice that is turned by 45°, whose lines run along x + y and
        x - y.

        Parameters
        ----------
        place : ndarray of float64, shape (n, 2)
            x and y, in pitches.

        Returns
        -------
        ndarray of float64, shape (n,)
            In pitches; inf where the lattice goes on and the grid doesn't.
        """
        x, y = place.T
        first, second = np.rint(x + y), np.rint(x - y)
        row = first - second
        column = (first + second - row % 2) / 2
        there = (row >= 0) & (row < self.rows) & (column >= 0) & (column < self.columns)
        away = np.hypot(x - 0.5 * (first + second), y - 0.5 * row)
        return np.where(there, away, np.inf)


@dataclass(frozen=True)
class GridView:
    """The grid as it stood still for a while."""

    #: From when to when.
    begin_ns: int
    end_ns: int
    #: The dots' middles, observed u, v. Shape (n, 2).
    pixels: F32
    #: Width of the dots' edges, from 20 to 80 % of their events, px: how sharp the lens is.
    edge_px: float


def find_grid(counts: npt.NDArray[np.integer], grid: DotGrid) -> F32 | None:
    """The dots' middles in an image of event counts.

    Parameters
    ----------
    counts : ndarray of int, shape (height, width)
        Events by pixel.
    grid : DotGrid
        What to look for.

    Returns
    -------
    ndarray of float32, shape (n, 2), or None
        u, v of each dot in the order of `DotGrid.points_m`; None if the grid isn't there.
    """
    # A hot pixel counts no more than a pixel of a dot.
    usual = max(float(np.percentile(counts[counts > 0], 80)), 1.0) if counts.any() else 1.0
    clipped = np.minimum(counts, usual).astype(np.float32) / usual
    smooth = cv2.GaussianBlur(clipped, (0, 0), _BLUR_PX)
    image = (255 * (1.0 - np.clip(smooth / max(float(smooth.max()), 1e-6), 0, 1))).astype(np.uint8)
    options = cv2.SimpleBlobDetector.Params()
    options.minArea, options.maxArea = 20.0, 0.01 * image.size
    options.minThreshold, options.maxThreshold, options.thresholdStep = 60.0, 220.0, 20.0
    options.minDistBetweenBlobs = 4.0
    options.filterByConvexity, options.minConvexity = True, 0.85
    options.filterByCircularity = options.filterByInertia = False
    found, dots = cv2.findCirclesGrid(
        image,
        (grid.columns, grid.rows),
        flags=cv2.CALIB_CB_ASYMMETRIC_GRID | cv2.CALIB_CB_CLUSTERING,
        blobDetector=cv2.SimpleBlobDetector.create(options),
    )
    if not found:
        return None
    return _middles(clipped, np.asarray(dots, np.float32).reshape(-1, 2))


def _middles(clipped: F32, dots: F32) -> F32:
    """Centroids of the events around each dot."""
    apart = np.linalg.norm(dots[:, None] - dots[None], axis=2) + 1e9 * np.eye(len(dots))
    radius = _DOT_SHARE * apart.min(axis=1)
    v, u = np.mgrid[: clipped.shape[0], : clipped.shape[1]].astype(np.float32)
    out = dots.copy()
    for k, reach in enumerate(radius):
        for _ in range(3):
            x, y = out[k]
            box = np.s_[
                max(int(y - reach), 0) : int(y + reach) + 2,
                max(int(x - reach), 0) : int(x + reach) + 2,
            ]
            weight = clipped[box] * (np.hypot(u[box] - x, v[box] - y) <= reach)
            total = float(weight.sum())
            if total > 0:
                out[k] = (weight * u[box]).sum() / total, (weight * v[box]).sum() / total
    return out


def edge_width_px(counts: npt.NDArray[np.integer], pixels: F32, grid: DotGrid) -> float:
    """Distance over which the density of events falls from 80 to 20 % at the dots' edges, px.

    The places of pixels on the target come by the homography of the grid, so a tilt of the target
    doesn't widen the edges.
    """
    on_target, _ = cv2.findHomography(pixels, grid.points_m[:, :2] / grid.pitch_m)
    every = np.stack(np.meshgrid(*(np.arange(n) for n in counts.shape[::-1])), -1).reshape(-1, 1, 2)
    place = cv2.perspectiveTransform(every.astype(np.float64), on_target)[:, 0]
    bins = np.linspace(0.0, 0.5 * np.sqrt(0.5), 41)
    nearest = grid.to_dots(place)
    most = np.percentile(counts[counts > 0], 80)
    events, _ = np.histogram(nearest, bins, weights=np.minimum(counts.ravel(), most))
    pixels_there, _ = np.histogram(nearest, bins)
    density = events / np.maximum(pixels_there, 1)
    top, floor = density[:8].max(), density[-8:].min()
    level = np.minimum.accumulate((density - floor) / max(top - floor, 1e-9))
    radius = 0.5 * (bins[1:] + bins[:-1])
    ends = np.interp([-0.8, -0.2], -level, radius)
    scale = float(np.sqrt(abs(np.linalg.det(on_target[:2, :2]))))
    return float((ends[1] - ends[0]) / max(scale, 1e-12))


def moved_px(before: F32, after: F32) -> float:
    """How far the dots moved at most, as a whole: shifted, turned, nearer or tilted; px."""
    ones = np.column_stack([before, np.ones(len(before))]).astype(np.float64)
    ones -= [*before.mean(axis=0), 0.0]
    whole = ones @ np.linalg.lstsq(ones, (after - before).astype(np.float64), rcond=None)[0]
    return float(np.abs(whole).max())


class GridWatcher:
    """Looks for the grid while events come, and keeps where it stood still.

    Parameters
    ----------
    camera : Camera
        For the image size alone.
    grid : DotGrid
        What to look for.
    """

    def __init__(self, camera: Camera, grid: DotGrid) -> None:
        self.views: list[GridView] = []
        self.windows = self.found = 0
        self._size = (camera.height, camera.width)
        self._grid = grid
        self._counts = np.zeros(camera.height * camera.width, np.int32)
        self._begin_ns: int | None = None
        self._still: list[tuple[int, F32]] = []
        self._sample = self._counts.reshape(self._size)  # a window of the view
        self._last: tuple[npt.NDArray[np.int32], F32] | None = None

    @property
    def edge_px(self) -> float:
        """Width of the dots' edges: of a usual view, or where last seen; NaN if never."""
        if self.views:
            return float(np.median([view.edge_px for view in self.views]))
        return edge_width_px(*self._last, self._grid) if self._last else float("nan")

    def add_events(self, events: EventArray) -> None:
        """Take events in order of time."""
        while len(events):
            first = int(events.t_ns[0])
            if self._begin_ns is None or first >= self._begin_ns + 2 * WINDOW_NS:
                self._close()
                self._begin_ns = first
            end = int(np.searchsorted(events.t_ns, self._begin_ns + WINDOW_NS))
            head, events = events[:end], events[end:]
            place = head.y.astype(np.int64) * self._size[1] + head.x
            self._counts += np.bincount(place, minlength=len(self._counts)).astype(np.int32)
            if len(events):
                self._close()
                self._begin_ns += WINDOW_NS

    def finish(self) -> list[GridView]:
        """All views; nothing comes any more."""
        self._close()
        self._end_view()
        return self.views

    def _close(self) -> None:
        """Look for the grid in the window that is complete."""
        if self._begin_ns is None:
            return
        counts = self._counts.reshape(self._size)
        dots = None
        if counts.sum() >= _LEAST_EVENTS:
            self.windows += 1
            dots = find_grid(counts, self._grid)
        if dots is None:
            self._end_view()
        else:
            self.found += 1
            if self._still and moved_px(self._still[0][1], dots) > _STILL_PX:
                self._end_view()
            self._still.append((self._begin_ns, dots))
            self._last = counts.copy(), dots
            if len(self._still) <= LEAST_WINDOWS:
                self._sample = counts.copy()
        self._counts[:] = 0

    def _end_view(self) -> None:
        if len(self._still) >= LEAST_WINDOWS:
            times, dots = zip(*self._still, strict=True)
            # The target may have come to rest, or moved away, within the first and last window.
            inner = np.s_[1:-1] if len(dots) > 2 else np.s_[:]
            self.views.append(
                GridView(
                    times[0],
                    times[-1] + WINDOW_NS,
                    np.mean(dots[inner], axis=0, dtype=np.float32),
                    edge_width_px(self._sample, dots[LEAST_WINDOWS - 1], self._grid),
                )
            )
        self._still = []


def target_page(grid: DotGrid) -> str:
    """An HTML page that shows the grid blinking, to open full screen on a phone or tablet.

    Parameters
    ----------
    grid : DotGrid
        The target; its true pitch on that screen has to be measured.
    """
    mm = grid.points_m[:, :2].astype(np.float64) * 1e3
    pitch = grid.pitch_m * 1e3
    width, height = mm[:, 0].max() + pitch, mm[:, 1].max() + pitch
    dots = "".join(
        f'<circle cx="{x + pitch / 2:.3f}" cy="{y + pitch / 2:.3f}" r="{0.2 * pitch:.3f}"/>'
        for x, y in mm
    )
    return (
        "<!doctype html><meta charset=utf-8><title>Target</title><style>"
        "html,body{margin:0;background:#888;height:100%;display:grid;place-items:center}"
        f"@keyframes b{{50%{{opacity:0}}}}g{{animation:b 0.25s steps(1) "
        "infinite}</style>"
        f'<svg width="{width:.3f}mm" height="{height:.3f}mm" viewBox="0 0 {width:.3f} '
        f'{height:.3f}"><rect width="100%" height="100%" fill="#fff"/><g>{dots}</g></svg>\n'
    )

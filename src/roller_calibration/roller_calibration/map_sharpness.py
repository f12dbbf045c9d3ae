"""How sharp a map events draw on a plane, and where it is sharpest.

How sharp it is falls by less within a degree of a tilt than it scatters from one tilt to the next,
and whatever climbs stays where it began. So the top is that of a paraboloid fitted to the sharpness
over all of the hill (response surface; Box and Wilson, J. R. Stat. Soc. B 13, 1951).

What the top is off by comes from the texture, which all events of a pass share: each piece of it is
sharpest a little elsewhere. So bands of the map get paraboloids of their own, and their slopes at
the common top tell how far it would be elsewhere on other texture (sandwich estimate with clusters;
Liang and Zeger, Biometrika 73, 1986).
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from roller_core.transforms import F64

from . import _plane_kernels as kernels

#: Largest turn about the optical axis and largest tilt that are looked for, degrees.
MOST_TURN_DEG = 3.0
#: Edge of the map's cells, of the blur: no whole px, so that rows of pixels lie in them in all
#: ways; and the map's border, px: what the largest tilts move it by.
_CELL, _PAD_PX = 0.488, 120.0
#: Share of the sharpness lost at the foot of the hill that a paraboloid is fitted to, and at how
#: many points it is fitted.
_LOST, _POINTS = 0.015, 64
#: Turns (degrees) and height (m) between which the foot is looked for, and the factor from one to
#: the next.
_LEAST_WIDTHS = np.array([0.25, 0.25, 0.05, 5e-5])
_MOST_WIDTHS = np.array([MOST_TURN_DEG, MOST_TURN_DEG, MOST_TURN_DEG, 2e-3])
_WIDER = 1.4
#: Bands that the map is cut into along each of its axes.
_BANDS = 16
#: Cells around those with events that their blur reaches.
_REACH = round(4 / _CELL) + 1


class MapSharpness:
    """How sharp a map some events draw on a plane level in base.

    It goes by four values: the camera's turn about its x, y and z (degrees), and the plane's
    height (metres).

    Parameters
    ----------
    rays : ndarray, shape (n, 3)
        Directions of events in the camera.
    rotations : ndarray, shape (n, 3, 3)
        The camera's, as its poses have it; its x near base's.
    positions : ndarray, shape (n, 3)
        The camera's, metres.
    depth_m, pixel_m : float
        Height at which the plane about is, and what a pixel sees of it.
    own : slice
        The events that count.
    blur_px : float
        Standard deviation of the map's blur.
    """

    def __init__(
        self,
        rays: F64,
        rotations: F64,
        positions: F64,
        depth_m: float,
        pixel_m: float,
        own: slice,
        blur_px: float,
    ) -> None:
        self._rays, self._rotations = rays[own], rotations[own]
        self._positions = positions[own]
        self._cell_m = _CELL * blur_px * pixel_m
        pad = np.ceil(_PAD_PX / (_CELL * blur_px))
        # The map's size is fixed, or its border would count.
        self._places = np.empty((len(self._rays), 2))
        self._place(np.array([0.0, 0.0, 0.0, depth_m]))
        self._origin = self._places.min(axis=0) - pad
        shape = np.ceil(np.ptp(self._places, axis=0) + 2 * pad).astype(int)
        self._counts, self._blurred = np.zeros((2, *shape), np.float32)

    def _place(self, values: F64) -> None:
        """Find where the events lie on the plane, in cells."""
        turn = Rotation.from_rotvec(np.radians(values[:3])).as_matrix()
        kernels._place(
            self._rays, self._rotations, self._positions, turn, values[3], self._cell_m,
            self._places,
        )  # fmt: skip

    def __call__(self, values: F64) -> float:
        """Sum of squares of the map by the events on it; 0 where none is."""
        drawn = self._drawn(values)
        return float(np.square(drawn[0]).sum() / drawn[1]) if drawn else 0.0

    def _drawn(self, values: F64) -> tuple[npt.NDArray[np.float32], int, list[int]] | None:
        """The blurred map where it isn't empty, the events on it, and its first row and column."""
        self._place(values)
        count, *box = kernels._draw(self._places, self._origin, self._counts)
        if not count:
            return None
        # Beyond the events all is 0, and blurred for nothing.
        own = tuple(
            slice(max(first - _REACH, 0), last + _REACH + 1) for first, last in (box[:2], box[2:])
        )
        drawn, blurred = self._counts[own], self._blurred[own]
        cv2.GaussianBlur(drawn, (0, 0), 1 / _CELL, dst=blurred)
        drawn[:] = 0
        return blurred, count, [part.start for part in own]

    def _bands(self, values: F64, edges: F64) -> F64:
        """What each of some bands cut across x, then of some cut across y, has of the sharpness.

        Their edges, shape (2, bands + 1), count from the mean of the events: what moves all of the
        map alike says nothing.
        """
        drawn = self._drawn(values)
        bands = np.zeros((2, edges.shape[1] - 1))
        if drawn:
            blurred, count, first = drawn
            np.square(blurred, out=blurred)
            at = edges + (self._places.mean(axis=0) - self._origin - first)[:, None]
            for axis in range(2):
                profile = blurred.sum(axis=1 - axis, dtype=np.float64) / count
                upto = np.concatenate([[0.0], np.cumsum(profile)])
                bands[axis] = np.diff(np.interp(at[axis], np.arange(len(upto)), upto))
        return bands.ravel()

    def _edges(self, values: F64) -> F64:
        """Edges of bands as wide as each other, the first and last of which have no end."""
        self._place(values)
        low, high = self._places.min(axis=0), self._places.max(axis=0)
        edges = np.linspace(low, high, _BANDS + 1, axis=1) - self._places.mean(axis=0)[:, None]
        edges[:, 0], edges[:, -1] = -np.inf, np.inf
        return edges

    def climb(self, start: F64) -> F64:
        """A sharper map near a start."""
        steps = np.array([0.5, 0.5, 0.1, 1e-4])
        corners = np.vstack([start, start + np.diag(steps)])
        found = minimize(
            lambda values: -self(values),
            start,
            method="Nelder-Mead",
            options={"initial_simplex": corners, "xatol": 1e-3, "fatol": 1e-6, "maxfev": 100},
        )
        return np.asarray(found.x, np.float64)

    def widths(self, at: F64) -> F64:
        """How far from a top its hill's foot is, along each parameter."""
        foot = (1 - _LOST) * self(at)
        widths = _LEAST_WIDTHS.copy()
        for k, aside in enumerate(np.eye(4)):
            while widths[k] < _MOST_WIDTHS[k]:
                beside = widths[k] * aside
                if (self(at + beside) + self(at - beside)) / 2 < foot:
                    break
                widths[k] *= _WIDER
        return np.minimum(widths, _MOST_WIDTHS)

    def top(self, near: F64, widths: F64, rng: np.random.Generator) -> tuple[F64, F64]:
        """The top of the hill near a place, by a paraboloid fitted within the widths.

        Returns the top and its standard error by the bands of the map, shape (4,) each.
        """
        i, j = np.triu_indices(4)
        aside = rng.uniform(-1, 1, (_POINTS, 4))
        terms = np.column_stack([np.ones(_POINTS), aside, aside[:, i] * aside[:, j]])
        edges = self._edges(near)
        bands = np.array([self._bands(near + widths * place, edges) for place in aside])
        fitted = np.linalg.lstsq(terms, bands, rcond=None)[0].T
        slopes = fitted[:, 1:5]
        bends = np.zeros((len(fitted), 4, 4))
        bends[:, i, j] += fitted[:, 5:]
        bends[:, j, i] += fitted[:, 5:]
        # Along axes on which the hill doesn't bend down there is no top.
        curvature, axes = np.linalg.eigh(bends[:_BANDS].sum(axis=0))
        reach = np.where(curvature < 0, -1 / np.minimum(curvature, -1e-12), 0.0)
        to_top = (axes * reach) @ axes.T
        moved = np.clip(to_top @ slopes[:_BANDS].sum(axis=0), -1, 1)
        own = ((slopes + bends @ moved) @ to_top).reshape(2, _BANDS, 4)
        across_x, across_y = widths * np.sqrt(np.square(own).sum(axis=1))
        # A turn about an axis moves texture along the other, over the edges that are cut there.
        error = np.maximum(across_x, across_y)
        error[0], error[1] = across_x[0], across_y[1]
        return near + widths * moved, error

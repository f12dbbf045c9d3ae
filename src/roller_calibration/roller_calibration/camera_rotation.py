"""How the camera is turned against what its poses say, from a straight pass over a flat plate.

Events put on the plate's plane by the right poses draw a sharp map of its texture; a turn blurs it.
A turn about the optical axis moves what crosses the image sideways and shows at once. A tilt moves
everything alike, but for the perspective, and shows a twentieth as well: how sharp the map is then
falls by less within a degree than it scatters from one tilt to the next, and whatever climbs stays
where it began. So the top is that of a paraboloid fitted to the sharpness over all of the hill
(response surface; Box and Wilson, J. R. Stat. Soc. B 13, 1951). The camera's position on the tool
moves the whole map and can't be found, nor can a tilt of the plate itself from one of the camera:
the plate counts as level in base.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from roller_core.errors import RollerError
from roller_core.transforms import F64

from . import _plane_kernels as kernels
from .recordings import Scan

#: Largest turn about the optical axis and largest tilt that are looked for, degrees.
MOST_TURN_DEG = 3.0
#: Events that are looked at, in the first search and in each of the parts that are compared.
_FIRST_EVENTS, _EVENTS, _PARTS = 30_000, 80_000, 4
_LEAST_EVENTS, _LEAST_TRAVEL_M = 20_000, 0.01
#: Steps of the first search, and blur of its map and the last one's, px.
_TURNS, _HEIGHTS, _BLURS_PX = 21, 11, (3.0, 1.5)
#: Edge of the map's cells, of the blur: no whole px, so that rows of pixels lie in them in all
#: ways; and the map's border, px: what the largest tilts move it by.
_CELL, _PAD_PX = 0.488, 120.0
#: Share of the sharpness lost at the foot of the hill that a paraboloid is fitted to, the points
#: that it is fitted to, and how often, each time about the top found last.
_LOST, _POINTS, _FITS = 0.015, 64, 2
#: Turns (degrees) and height (m) between which the foot is looked for, and the factor from one to
#: the next.
_LEAST_WIDTHS = np.array([0.25, 0.25, 0.05, 5e-5])
_MOST_WIDTHS = np.array([MOST_TURN_DEG, MOST_TURN_DEG, MOST_TURN_DEG, 2e-3])
_WIDER = 1.4
#: The best map must be this much sharper than the usual one of the first search.
_LEAST_GAIN = 1.05
#: The most that a pass may deviate from a straight line, as a share of its path.
_MOST_BEND = 0.05
#: Cosine of the largest angle between the optical axis and base's z.
_LEAST_LEVEL = 0.95
#: Cells around those with events that their blur reaches.
_REACH = round(4 / _CELL) + 1


class CameraRotationError(RollerError):
    """A pass from which the camera's turn can't be found."""


@dataclass(frozen=True)
class CameraRotation:
    """How the camera is turned against its poses."""

    #: Rotation vector in the camera's frame: about the image's rows (a tilt along the columns),
    #: about its columns, and about the optical axis. Shape (3,).
    vector_deg: F64
    #: Standard error by the scatter of parts of the events. Shape (3,).
    deviation_deg: F64
    #: Height of the plate in base, as these poses have it, metres.
    height_m: float
    #: Events that counted.
    events: int

    @property
    def rotation(self) -> F64:
        """Put behind the camera's rotation, on the tool as in base; shape (3, 3)."""
        turn = Rotation.from_rotvec(np.radians(self.vector_deg))
        return np.asarray(turn.as_matrix(), np.float64)


def find_camera_rotation(
    scan: Scan,
    depth_range_m: tuple[float, float],
    report: Callable[[float], None] = lambda _share: None,
) -> CameraRotation:
    """Find the turn of a camera that rolled straight over a flat plate, level in base.

    Parameters
    ----------
    scan : Scan
        The pass.
    depth_range_m : tuple of float
        Between which the plate lies, metres.
    report : callable
        Gets the share done.

    Raises
    ------
    CameraRotationError
        If the pass is short or bent, or the plate shows too little texture.
    """
    rays, rotations, positions = _rays(scan)
    # A camera that looks down has the plate below it.
    side = float(rotations[:, 2, 2].mean())
    if abs(side) < _LEAST_LEVEL:
        raise CameraRotationError(
            "the camera doesn't look along base's z: the plate isn't level in base"
        )
    depth_m = float(np.copysign(np.mean(depth_range_m), side))
    centre = positions.mean(axis=0)
    positions = positions - centre
    views = (rays, rotations, positions, depth_m, abs(depth_m) / scan.camera.fx)
    first = _Sharpness(*views, slice(0, _FIRST_EVENTS), _BLURS_PX[0])
    turns = np.linspace(-MOST_TURN_DEG, MOST_TURN_DEG, _TURNS)
    heights = np.copysign(np.linspace(*depth_range_m, _HEIGHTS), side)
    grid = np.array([[first(np.array([0, 0, t, h])) for h in heights] for t in turns])
    k, j = np.unravel_index(int(np.argmax(grid)), grid.shape)
    if grid.max() < _LEAST_GAIN * np.median(grid):
        raise CameraRotationError(
            "the plate shows too little texture: its map is equally sharp however the camera is "
            "turned"
        )
    if k in (0, _TURNS - 1) or j in (0, _HEIGHTS - 1):
        raise CameraRotationError(
            f"no plate between {depth_range_m[0] * 1e3:g} and {depth_range_m[1] * 1e3:g} mm with "
            f"the camera turned by less than {MOST_TURN_DEG:g}°: check the poses, or the range"
        )
    start = first.climb(np.array([0, 0, turns[k], heights[j]]))
    size = min(_EVENTS, len(rays) // _PARTS)
    found, widths = np.empty((_PARTS, 4)), None
    for n in range(_PARTS):
        report((n + 1) / (_PARTS + 1))
        part = _Sharpness(*views, slice(n * size, (n + 1) * size), _BLURS_PX[1])
        near = part.climb(start)
        widths = part.widths(near) if widths is None else widths
        found[n] = part.top(near, widths, np.random.default_rng(n))
    if np.abs(found[:, :3]).max() > 1.5 * MOST_TURN_DEG:
        raise CameraRotationError(
            "the parts of the pass don't agree on a turn of some degrees: is the plate flat, with "
            "texture all over the image?"
        )
    vector = found[:, :3].mean(axis=0)
    scatter = found[:, :3].std(axis=0, ddof=1) / np.sqrt(_PARTS)
    return CameraRotation(vector, scatter, float(found[:, 3].mean() + centre[2]), size * _PARTS)


def _rays(scan: Scan) -> tuple[F64, F64, F64]:
    """Directions of events in the camera, rotations and positions of the camera; shuffled."""
    events, camera, track = scan.events, scan.camera, scan.track
    inside = (events.t_ns >= track.start_ns) & (events.t_ns <= track.end_ns)
    number = np.flatnonzero(inside)
    centered = track.positions - track.positions.mean(axis=0)
    spread = np.linalg.svd(centered, compute_uv=False)
    length = float(np.ptp(centered @ np.linalg.svd(centered, full_matrices=False)[2][0]))
    if length < _LEAST_TRAVEL_M:
        raise CameraRotationError(
            f"the pass is {length * 1e3:.1f} mm long, less than {_LEAST_TRAVEL_M * 1e3:g} mm"
        )
    if spread[1] > _MOST_BEND * spread[0]:
        raise CameraRotationError("the pass isn't straight")
    if len(number) < _LEAST_EVENTS:
        raise CameraRotationError(
            f"{len(number)} events, fewer than {_LEAST_EVENTS}: too few events"
        )
    rng = np.random.default_rng(0)
    number = rng.permutation(number)[: _EVENTS * _PARTS]
    table = camera.undistortion_table()
    # Events lie anywhere in their pixels; as grid points they would beat with the map's cells.
    pixels = table[events.y[number], events.x[number]] + rng.uniform(-0.5, 0.5, (len(number), 2))
    rays = camera.rays(pixels)
    times = events.t_ns[number]
    return rays, track.matrices(times)[:, :3, :3], track.sample(times)[0]


class _Sharpness:
    """How sharp a map some events draw on a plane level in base.

    Parameters are the turn about x, y and z (degrees) and the plane's height.
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
        middle = self._places(np.array([0.0, 0.0, 0.0, depth_m]))
        self._origin = middle.min(axis=0) - pad
        shape = np.ceil(np.ptp(middle, axis=0) + 2 * pad).astype(int)
        self._counts, self._blurred = np.zeros((2, *shape), np.float32)

    def _places(self, values: F64) -> F64:
        """Where the events lie on the plane, in cells, shape (n, 2)."""
        turn = Rotation.from_rotvec(np.radians(values[:3])).as_matrix()
        places = np.empty((len(self._rays), 2))
        kernels._place(
            self._rays, self._rotations, self._positions, turn, values[3], self._cell_m, places
        )
        return places

    def __call__(self, values: F64) -> float:
        places = self._places(values)
        count, *box = kernels._draw(places, self._origin, self._counts)
        if not count:
            return 0.0
        # Beyond the events all is 0, and blurred for nothing.
        own = tuple(
            slice(max(first - _REACH, 0), last + _REACH + 1) for first, last in (box[:2], box[2:])
        )
        drawn, blurred = self._counts[own], self._blurred[own]
        cv2.GaussianBlur(drawn, (0, 0), 1 / _CELL, dst=blurred)
        drawn[:] = 0
        return float(np.square(blurred).sum() / count)

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

    def top(self, near: F64, widths: F64, rng: np.random.Generator) -> F64:
        """The top of the hill near a place, by paraboloids fitted within the widths."""
        i, j = np.triu_indices(4)
        aside = rng.uniform(-1, 1, (_POINTS, 4))
        terms = np.column_stack([np.ones(_POINTS), aside, aside[:, i] * aside[:, j]])
        for _ in range(_FITS):
            height = np.array([self(near + widths * place) for place in aside])
            found = np.linalg.lstsq(terms, height, rcond=None)[0]
            bend = np.zeros((4, 4))
            bend[i, j] += found[5:]
            bend[j, i] += found[5:]
            # Along axes on which it doesn't bend down there is no top.
            curvature, axes = np.linalg.eigh(bend)
            slope = axes.T @ found[1:5]
            moved = np.where(curvature < 0, -slope / np.minimum(curvature, -1e-12), 0.0)
            near = near + widths * np.clip(axes @ moved, -1, 1)
        return near

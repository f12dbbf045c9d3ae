"""How the camera is turned against what its poses say, from a straight pass over a flat plate.

Events put on the plate's plane by the right poses draw a sharp map of its texture; a turn blurs it.
A turn about the optical axis moves what crosses the image sideways and shows at once. A tilt moves
everything alike, but for the perspective, and shows a twentieth as well. The camera's position on
the tool moves the whole map and can't be found, nor can a tilt of the plate itself from one of the
camera: the plate counts as level in base.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from roller_core.errors import RollerError
from roller_core.pose_track import PoseTrack
from roller_core.transforms import F64

from .map_sharpness import MOST_TURN_DEG, MapSharpness
from .recordings import Scan

#: Events that are looked at, in the first search and in each of the parts that are compared.
_FIRST_EVENTS, _EVENTS, _PARTS = 30_000, 80_000, 4
_LEAST_EVENTS, _LEAST_TRAVEL_M = 20_000, 0.01
#: Steps of the first search, and blur of its map and the last one's, px.
_TURNS, _HEIGHTS, _BLURS_PX = 21, 11, (3.0, 1.5)
#: The best map must be this much sharper than the usual one of the first search.
_LEAST_GAIN = 1.05
#: The most that a pass may deviate from a straight line, as a share of its path.
_MOST_BEND = 0.05
#: Cosine of the largest angle between the optical axis and base's z.
_LEAST_LEVEL = 0.95


class CameraRotationError(RollerError):
    """A pass from which the camera's turn can't be found."""


@dataclass(frozen=True)
class CameraRotation:
    """How the camera is turned against its poses."""

    #: Rotation vector in the camera's frame: about the image's rows (a tilt along the columns),
    #: about its columns, and about the optical axis. Shape (3,).
    vector_deg: F64
    #: Standard error: the scatter of parts of the events, or that of bands of the plate, whose
    #: texture the parts share, where that is larger. Shape (3,).
    deviation_deg: F64
    #: Height of the plate in base, as these poses have it, metres.
    height_m: float
    #: Events that counted.
    events: int

    def turned(self, scan: Scan) -> Scan:
        """A scan with its camera's poses turned."""
        track = PoseTrack(scan.track.max_gap_s)
        turned = (Rotation.from_quat(scan.track.quaternions) * self._own).as_quat()
        track.extend(scan.track.times_ns, scan.track.positions, turned)
        return replace(scan, track=track)

    @property
    def rotation(self) -> F64:
        """Put behind the camera's rotation, on the tool as in base; shape (3, 3)."""
        return np.asarray(self._own.as_matrix(), np.float64)

    @property
    def _own(self) -> Rotation:
        return Rotation.from_rotvec(np.radians(self.vector_deg))


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
    # Base's axes along the camera's, as tilts move texture along those.
    heading = np.arctan2(*rotations[:, 1::-1, 0].mean(axis=0))
    level = Rotation.from_euler("z", -heading).as_matrix()
    rotations, positions = level @ rotations, (positions - centre) @ level.T
    views = (rays, rotations, positions, depth_m, abs(depth_m) / scan.camera.fx)
    first = MapSharpness(*views, slice(0, _FIRST_EVENTS), _BLURS_PX[0])
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
    near = first.climb(np.array([0, 0, turns[k], heights[j]]))
    size = min(_EVENTS, len(rays) // _PARTS)
    found, errors, widths = np.empty((_PARTS, 4)), np.empty((_PARTS, 4)), None
    for n in range(_PARTS):
        report((n + 1) / (_PARTS + 1))
        part = MapSharpness(*views, slice(n * size, (n + 1) * size), _BLURS_PX[1])
        rng = np.random.default_rng(n)
        if widths is None:
            near = part.climb(near)
            widths = part.widths(near)
            near, _ = part.top(near, widths, rng)
        # All parts' tops are near that of the first.
        found[n], errors[n] = part.top(near, widths, rng)
    if np.abs(found[:, :3]).max() > 1.5 * MOST_TURN_DEG:
        raise CameraRotationError(
            "the parts of the pass don't agree on a turn of some degrees: is the plate flat, with "
            "texture all over the image?"
        )
    vector = found[:, :3].mean(axis=0)
    scatter = found[:, :3].std(axis=0, ddof=1) / np.sqrt(_PARTS)
    shared = np.sqrt(np.square(errors[:, :3]).mean(axis=0))
    height_m = float(found[:, 3].mean() + centre[2])
    return CameraRotation(vector, np.maximum(scatter, shared), height_m, size * _PARTS)


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

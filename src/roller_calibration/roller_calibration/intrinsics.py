"""The camera's intrinsics from views of a grid of dots (Zhang 2000, by OpenCV)."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.transforms import F64

from .dot_grid import DotGrid, GridView

#: Fewest views; views whose dots lie closer than this to those of another add nothing, px.
LEAST_VIEWS, _OTHER_VIEW_PX = 6, 8.0
#: Residual (root mean square) above which views don't belong together; and least angle between
#: the target's normals in two of the views: seen from the front alone, size and distance are one.
MOST_RMS_PX, LEAST_TILT_DEG = 0.7, 10.0
#: A view this many times worse than the median is left out.
_OUTLIER = 3.0
#: Focal lengths that lie apart by so many of their deviations, and by this share, are of two
#: lenses; those along rows and columns, of a grid that is longer one way than it should be.
_APART, _APART_SHARE = 5.0, 0.003
_LONGER, _LONGER_SHARE = 3.0, 0.005
#: Cells of the image by which the spread of the dots is judged.
_CELLS = (8, 6)


class IntrinsicsError(RollerError):
    """Views from which the intrinsics can't be found."""


@dataclass(frozen=True)
class Intrinsics:
    """A calibrated camera."""

    #: With distortion k1, k2, p1, p2.
    camera: Camera
    #: Standard deviations of fx, fy, cx, cy, px. Shape (4,).
    deviation: F64
    #: Root mean square residual of the dots.
    rms_px: float
    #: Views that count.
    views: int
    #: Views that fit badly and don't.
    left_out: int
    #: Share of the image's cells (8 × 6) that hold dots.
    covered: float

    @property
    def longer(self) -> float:
        """By what share fx is longer than fy, if by more than chance; else 0.

        Pixels are square; a page that was printed longer one way is not.
        """
        share = self.camera.fx / self.camera.fy - 1.0
        chance = float(np.hypot(*self.deviation[:2])) / self.camera.fy
        return share if abs(share) > max(_LONGER * chance, _LONGER_SHARE) else 0.0


def different_views(views: Sequence[GridView]) -> list[GridView]:
    """Views that differ from one another; of like ones the first."""
    kept: list[GridView] = []
    for view in views:
        apart = [np.abs(view.pixels - other.pixels).max() for other in kept]
        if min(apart, default=np.inf) > _OTHER_VIEW_PX:
            kept.append(view)
    return kept


def find_intrinsics(views: Sequence[GridView], grid: DotGrid, size: tuple[int, int]) -> Intrinsics:
    """Intrinsics from views of the grid.

    Parameters
    ----------
    views : sequence of GridView
        Of one camera.
    grid : DotGrid
        The target.
    size : tuple of int
        Width and height of the image, px.

    Raises
    ------
    IntrinsicsError
        If there are too few different views, they don't fit one camera, or leave its focal length
        open because the target was never tilted.
    """
    chosen = different_views(views)
    if len(chosen) < LEAST_VIEWS:
        raise IntrinsicsError(
            f"{len(chosen)} different views of the grid; {LEAST_VIEWS} are needed, 15 are better: "
            "hold the target still for 2 s at each of many places and tilts"
        )
    left_out = 0
    while True:
        rms, k, d, deviation, by_view, tilt_deg = _solve(chosen, grid, size)
        worst = int(np.argmax(by_view))
        if by_view[worst] <= _OUTLIER * np.median(by_view) or len(chosen) <= LEAST_VIEWS:
            break
        del chosen[worst]
        left_out += 1
    if not np.isfinite(rms) or rms > MOST_RMS_PX:
        raise IntrinsicsError(
            f"the views don't fit one camera: the dots are off by {rms:.2f} px; is the target "
            "flat, and its pitch the same everywhere?"
        )
    if tilt_deg < LEAST_TILT_DEG:
        raise IntrinsicsError(
            f"the focal length stays open: the views are tilted by {tilt_deg:.1f}° at most against "
            "each other; tilt the target by 20 to 40° in some of them, about both axes"
        )
    pixels = np.concatenate([view.pixels for view in chosen])
    cells = (pixels / size * _CELLS).astype(int).clip(0, np.array(_CELLS) - 1)
    camera = Camera(*size, k[0, 0], k[1, 1], k[0, 2], k[1, 2], tuple(d.ravel()[:4]))
    share = len(np.unique(cells, axis=0)) / (_CELLS[0] * _CELLS[1])
    return Intrinsics(camera, deviation, float(rms), len(chosen), left_out, share)


def check_one_lens(
    parts: Mapping[str, Sequence[GridView]], grid: DotGrid, size: tuple[int, int]
) -> None:
    """See that all parts of the views are of one focal length.

    Their mean fits the dots of two hardly worse than either, as distance makes up for much.

    Parameters
    ----------
    parts : mapping
        Views by what to call them; a part with too few, or too little tilt, says nothing.
    grid, size
        As of `find_intrinsics`.

    Raises
    ------
    IntrinsicsError
        If two parts differ by more than chance.
    """
    found: list[tuple[str, Intrinsics]] = []
    for name, views in parts.items():
        try:
            found.append((name, find_intrinsics(views, grid, size)))
        except IntrinsicsError:
            continue
    for (one, a), (other, b) in itertools.combinations(found, 2):
        (fx, fy, *_), (gx, gy, *_) = a.deviation, b.deviation
        for f, g, s, t in (
            (a.camera.fx, b.camera.fx, fx, gx), (a.camera.fy, b.camera.fy, fy, gy),
        ):  # fmt: skip
            if abs(f - g) > max(_APART * float(np.hypot(s, t)), _APART_SHARE * f):
                raise IntrinsicsError(
                    f"the views don't fit one camera: a focal length of {f:.1f} ± {s:.1f} px in "
                    f"{one}, of {g:.1f} ± {t:.1f} px in {other}; was the lens turned in between?"
                )


def _solve(
    views: Sequence[GridView], grid: DotGrid, size: tuple[int, int]
) -> tuple[float, F64, F64, F64, F64, float]:
    """Residual, K, distortion, deviations of fx fy cx cy, residuals by view (px), most tilt (°)."""
    # k3 needs dots out to the corners of a wide lens; the roller's sees some 33°.
    rms, k, d, turns, _, deviation, _, by_view = cv2.calibrateCameraExtended(
        [grid.points_m] * len(views),
        [view.pixels for view in views],
        size, None, None, flags=cv2.CALIB_FIX_K3,  # type: ignore[arg-type]
    )  # fmt: skip
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    tilt_deg = float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1)).max()))
    return float(rms), k, d, deviation.ravel()[:4], by_view.ravel(), tilt_deg


def grid_in_camera(view: GridView, grid: DotGrid, camera: Camera) -> F64:
    """Pose of the grid in the camera's optical frame, shape (4, 4), metres.

    Raises
    ------
    IntrinsicsError
        If the dots have no pose.
    """
    pixels = camera.undistort(view.pixels)
    found, turn, position = cv2.solvePnP(
        grid.points_m, pixels, camera.K, np.zeros(4), flags=cv2.SOLVEPNP_IPPE
    )
    if not found:
        raise IntrinsicsError("a view of the grid has no pose: is the camera's calibration right?")
    pose = np.eye(4)
    turn, position = cv2.solvePnPRefineLM(
        grid.points_m, pixels, camera.K, np.zeros(4), turn, position
    )
    pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(turn)[0], position.ravel()
    return pose

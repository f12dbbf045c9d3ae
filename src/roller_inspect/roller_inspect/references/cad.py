"""CAD as the reference: a triangle mesh in base."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from roller_core.transforms import F64
from roller_inspect.height_map.height_map import F32, Bools, HeightMap

from .field import Field, compare_field
from .model_file import read_model
from .reference import Comparison, ReferenceError

#: The model is looked at this far around the map, m.
_AROUND_M = 2e-3
#: The model may lie so far above or below the map, m.
_REACH_M = 0.05
#: Beside a wall of the model neither skin nor depth follow it: how far, m, where it is so much
#: steeper than what lies around, by a Gaussian of this deviation, m; and the share of what they may
#: be off there that is its standard uncertainty.
_BRIDGED_M, _FOLLOWED, _AROUND_WALL_M, _OFF = 6e-4, 0.3, 5e-4, 0.5


class CadReference:
    """A mesh in base, metres; what differs from it is missing or extra material.

    Parameters
    ----------
    vertices_m : ndarray, shape (n, 3)
        Metres, in the frame of `base_from_cad`.
    triangles : ndarray of int, shape (m, 3)
        Corners.
    base_from_cad : ndarray, shape (4, 4), optional
        Where the model lies in base; without it its coordinates are base's.
    """

    name = "cad"
    models_part = True

    def __init__(
        self, vertices_m: F64, triangles: np.ndarray, base_from_cad: F64 | None = None
    ) -> None:
        pose = np.eye(4) if base_from_cad is None else base_from_cad
        self.vertices_m = np.asarray(vertices_m, np.float64) @ pose[:3, :3].T + pose[:3, 3]
        self.triangles = np.asarray(triangles, np.int64)

    @classmethod
    def load(cls, path: Path, base_from_cad: F64 | None = None) -> CadReference:
        """Read an STL, or another mesh that open3d reads, in metres; STEP in its own unit.

        Raises
        ------
        ReferenceError
            If it can't be read, breaks off, is longer than any part, or is STEP and cascadio isn't
            installed.
        """
        return cls(*read_model(path), base_from_cad)

    def compare(self, height_map: HeightMap, masked: Bools | None = None) -> Comparison:
        """See `Reference`."""
        self._check_place(height_map)
        found = compare_field(self._field(height_map), height_map, self.name, masked)
        return replace(found, of_walls=True)

    def _check_place(self, height_map: HeightMap) -> None:
        """Refuse a model in millimetres or far from the map."""
        x, y = height_map.x_m[[0, -1]], height_map.y_m[[0, -1]]
        corners = height_map.in_base(*np.meshgrid(x, y), 0.0).reshape(-1, 3)
        low, high = corners.min(axis=0) - _REACH_M, corners.max(axis=0) + _REACH_M
        first, last = self.vertices_m.min(axis=0), self.vertices_m.max(axis=0)
        far = np.maximum(np.maximum(first - high, low - last), 0.0)
        size, scanned = last - first, np.ptp(corners, axis=0).max()
        if size.max() > 50 * max(scanned, 0.02) and size.max() > 2.0:
            raise ReferenceError(
                f"reference cad: the model is {size.max():.3g} m long; is it in millimetres? "
                "Models are in metres: scale it by 0.001"
            )
        if far.any():
            raise ReferenceError(
                f"reference cad: the model lies {float(np.linalg.norm(far)) + _REACH_M:.3g} m from "
                "the scan; models are in the recipe's frame, metres"
            )

    def _field(self, height_map: HeightMap) -> Field:
        """The model's upper side over the map's grid, and a little around."""
        import open3d

        o3d: Any = open3d
        step = height_map.step_m
        n = round(_AROUND_M / step)
        x = height_map.x_m[0] + np.arange(-n, len(height_map.x_m) + n) * step
        y = height_map.y_m[0] + np.arange(-n, len(height_map.y_m) + n) * step
        base = height_map.base_from_map
        # Near the map's middle float32 keeps fractions of a micrometre.
        middle = np.array([x.mean(), y.mean(), 0.0])
        local = (self.vertices_m - base[:3, 3]) @ base[:3, :3] - middle
        top = float(local[:, 2].max()) + 1e-3
        scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        scene.add_triangles(
            o3d.core.Tensor(local.astype(np.float32)),
            o3d.core.Tensor(self.triangles.astype(np.uint32)),
        )
        rays = np.zeros((len(y), len(x), 6), np.float32)
        rays[..., 0] = x - middle[0]
        rays[..., 1] = (y - middle[1])[:, None]
        rays[..., 2], rays[..., 5] = top, -1.0
        away = scene.cast_rays(o3d.core.Tensor(rays), nthreads=1)["t_hit"].numpy()
        height: F32 = np.where(np.isfinite(away), top - away, np.nan).astype(np.float32)
        height[np.abs(height) > _REACH_M] = np.nan
        return Field(x, y, height, _OFF * unfollowed(height, step))


def unfollowed(height_m: F32, step_m: float) -> F32:
    """How far off a surface heights may lie that bridge its walls and round their tops, m.

    Parameters
    ----------
    height_m : ndarray of float32, shape (rows, columns)
        The surface; NaN where there is none.
    step_m : float
        Edge of a cell.

    Returns
    -------
    ndarray of float32, shape (rows, columns)
        Up to the surfaces above and below it, near by, that are nowhere steeper against what lies
        around: 0 where it is no steeper itself, as on a slope.
    """
    n = round(_BRIDGED_M / step_m)
    away = step_m * np.hypot(*np.mgrid[-n : n + 1, -n : n + 1])
    near, slope = away <= _BRIDGED_M, -_FOLLOWED * away
    none = ~np.isfinite(height_m)
    wide = _AROUND_WALL_M / step_m
    share = ndimage.gaussian_filter((~none).astype(np.float64), wide)
    around = ndimage.gaussian_filter(np.where(none, 0.0, height_m), wide) / np.maximum(share, 1e-9)
    rest = height_m - around
    above, below = (
        sign * ndimage.grey_dilation(
            np.where(none, -np.inf, sign * rest), footprint=near, structure=slope, mode="nearest"
        )
        for sign in (1.0, -1.0)
    )  # fmt: skip
    return np.where(none, 0.0, np.maximum(above - rest, rest - below)).astype(np.float32)

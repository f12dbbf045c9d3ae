"""Plates from triangle meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .cell_settings import SceneSettings
from .errors import SceneError
from .plates import new_plate
from .relief import F64, Scene

#: Least length and width, mm: a few pixels.
_LEAST_MM = 0.2


def mesh_scene(path: str, settings: SceneSettings) -> Scene:
    """A plate with the upper side of a mesh on it, seen from +z, its lowest corner at the face.

    Parameters
    ----------
    path : str
        An STL (or any mesh open3d reads), z up, x along the roll.
    settings : SceneSettings
        `mesh_unit`, margins and grid.

    Raises
    ------
    SceneError
        If the file can't be read or the relief is higher than the roller can press.
    """
    import open3d  # late: it takes a second to load and only this scene needs it

    o3d: Any = open3d  # its stubs leave out NumPy arrays

    if not Path(path).is_file():
        raise SceneError(f"mesh {path}: no such file")
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        mesh = o3d.io.read_triangle_mesh(path)
    if not len(mesh.triangles):
        raise SceneError(f"mesh {path}: no triangles in it; is it an STL file?")
    vertices = np.asarray(mesh.vertices) * (1.0 if settings.mesh_unit == "mm" else 1e3)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    size = high - low
    if size[2] > 3.0:
        raise SceneError(
            f"mesh {path}: {size[2]:.3g} mm high in unit '{settings.mesh_unit}'; the roller takes "
            "up to 3 mm; check mesh_unit and that z points up"
        )
    if min(size[:2]) < _LEAST_MM:
        raise SceneError(
            f"mesh {path}: {size[0]:.3g} × {size[1]:.3g} mm in unit '{settings.mesh_unit}', too "
            "small to be seen; check mesh_unit"
        )
    plate = new_plate(settings, float(size[0]))
    x0, half = settings.margin_mm, float(size[1]) / 2
    centre = (low[1] + high[1]) / 2
    caster = o3d.t.geometry.RaycastingScene()
    caster.add_triangles(
        o3d.core.Tensor(vertices.astype(np.float32)),
        o3d.core.Tensor(np.asarray(mesh.triangles).astype(np.uint32)),
    )

    def top(x: F64, y: F64) -> F64:
        rays = np.zeros((*x.shape, 6), np.float32)
        rays[..., 0] = x - x0 + low[0]
        rays[..., 1] = y + centre
        rays[..., 2] = high[2] + 1.0
        rays[..., 5] = -1.0
        distance = caster.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
        return np.where(np.isfinite(distance), size[2] + 1.0 - distance, 0.0)

    plate.put("mesh", (x0, x0 + float(size[0]), -half, half), top)
    return plate.scene(f"mesh:{path}", min(1.8, 4.0 - float(size[2])))

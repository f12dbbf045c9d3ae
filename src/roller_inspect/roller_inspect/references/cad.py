"""CAD as the reference: a triangle mesh in base."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from roller_core.transforms import F64
from roller_inspect.height_map.height_map import F32, Bools, HeightMap

from .field import Field, compare_field
from .reference import Comparison, ReferenceError

#: The model is looked at this far around the map, m.
_AROUND_M = 2e-3
#: The model may lie so far above or below the map, m.
_REACH_M = 0.05
#: STEP to GLB: metres whatever the file's unit, chords 2 µm off its curves at most. In a process of
#: its own, for the library writes to the terminal, and a damaged file can end it.
_STEP_TO_GLB = "import sys, cascadio as c; c.step_to_glb(*sys.argv[1:], tol_linear=0.002)"
#: Bytes before a binary STL's triangles, the last four of which say how many there are, and of
#: each; more are not believed.
_STL_HEAD, _STL_TRIANGLE, _MOST_TRIANGLES = 84, 50, 100_000_000


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
            If it can't be read, or is STEP and cascadio isn't installed.
        """
        if not path.is_file():
            raise ReferenceError(f"reference cad: {path}: no such file")
        if path.suffix.lower() in (".step", ".stp"):
            vertices, triangles = _read_step(path)
        else:
            vertices, triangles = _read_mesh(path)
        if not len(triangles):
            raise ReferenceError(f"reference cad: {path}: {_why_empty(path)}")
        if not np.isfinite(vertices).all():
            raise ReferenceError(
                f"reference cad: {path}: a corner of a triangle isn't a number; export it anew"
            )
        return cls(vertices, triangles, base_from_cad)

    def compare(self, height_map: HeightMap, masked: Bools | None = None) -> Comparison:
        """See `Reference`."""
        self._check_place(height_map)
        return compare_field(self._field(height_map), height_map, self.name, masked)

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
        return Field(x, y, height, np.zeros_like(height))


def _read_mesh(path: Path) -> tuple[F64, np.ndarray]:
    """Vertices and triangles of a file; none if it isn't one."""
    import open3d  # late: it takes a second to load and only CAD needs it

    o3d: Any = open3d  # its stubs leave out NumPy arrays
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        mesh = o3d.io.read_triangle_mesh(str(path))
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles)


def _why_empty(path: Path) -> str:
    """Why a file gave no triangles."""
    with path.open("rb") as file:
        head = file.read(_STL_HEAD)
    if path.suffix.lower() == ".stl" and len(head) == _STL_HEAD and not head.startswith(b"solid"):
        announced = int.from_bytes(head[-4:], "little")
        there = (path.stat().st_size - _STL_HEAD) // _STL_TRIANGLE
        if there < announced < _MOST_TRIANGLES:
            return f"it breaks off after {there} of {announced} triangles; export it anew"
    return "no triangles in it; is it an STL or STEP file?"


def _read_step(path: Path) -> tuple[F64, np.ndarray]:
    """The same of a STEP file, metres."""
    if find_spec("cascadio") is None:
        raise ReferenceError(
            f"reference cad: {path}: STEP needs cascadio ({sys.executable} -m pip install "
            "cascadio); or export an STL in metres"
        )
    with TemporaryDirectory(prefix="roller_step_") as folder:
        mesh = Path(folder) / "part.glb"
        command = [sys.executable, "-c", _STEP_TO_GLB, str(path.resolve()), str(mesh)]
        subprocess.run(command, capture_output=True)
        if not mesh.is_file():
            raise ReferenceError(f"reference cad: {path}: can't be read; is it a STEP file?")
        return _read_mesh(mesh)

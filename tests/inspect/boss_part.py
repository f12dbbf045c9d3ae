"""A plate with a boss: inspected, as a height map and as a model."""

import numpy as np

from roller_core.transforms import F64
from roller_inspect.height_map import HeightMap
from roller_inspect.pieces import Found
from roller_inspect.references import Reference, SelfReference
from roller_inspect.surface_inspector import InspectionSettings, SurfaceInspector

from .analytic_surface import Surface, scan

BOSS = (0.012, 0.0)


def part(x: F64, y: F64) -> F64:
    """A plate with a boss whose walls the skin rounds."""
    r = np.hypot(x - BOSS[0], y - BOSS[1])
    return 3e-4 / (1 + np.exp((r - 2.5e-3) / 1.5e-4))


def inspect(surface: Surface, reference: Reference, seed: int = 0, **options: object) -> Found:
    inspector = SurfaceInspector(InspectionSettings.create({}), reference)
    for patch in scan(surface, length_m=0.024, width_m=0.01, seed=seed, **options):  # type: ignore[arg-type]
        inspector.add(patch)
    return inspector.finish()


def map_of(surface: Surface, seed: int = 0) -> HeightMap:
    found = inspect(surface, SelfReference(), seed).height_map
    assert found is not None
    return found


def mesh_of(surface: Surface, shift: tuple[float, float, float]) -> tuple[F64, np.ndarray]:
    step = 1e-4
    x, y = np.meshgrid(np.arange(-0.002, 0.027, step), np.arange(-0.007, 0.007, step))
    ny, nx = x.shape
    k = np.arange(ny * nx).reshape(ny, nx)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[:-1, 1:], k[1:, :-1], k[1:, 1:]))
    vertices = np.column_stack([x.ravel(), y.ravel(), surface(x, y).ravel()]) + shift
    return vertices, np.concatenate([np.column_stack([a, b, d]), np.column_stack([a, d, c])])

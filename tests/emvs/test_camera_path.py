"""Where the camera was while it saw an event: by the place of its ray, as a pass goes one way."""

from __future__ import annotations

import numpy as np
import pytest

from roller_emvs.methods.surface.camera_path import CameraPath

PLANE_M = 0.045


def path_of(x_m: np.ndarray, y_m: np.ndarray, z_m: np.ndarray) -> CameraPath:
    path = CameraPath(0)
    for k, centre in enumerate(np.stack([x_m, y_m, z_m], axis=1)):
        path.add((k + 1) * 8_000_000, centre)
    return path


@pytest.mark.parametrize("still", [False, True])
def test_the_place_of_a_ray_tells_where_the_camera_was(still: bool) -> None:
    rng = np.random.default_rng(1)
    x = np.linspace(0.001, 0.06, 150)
    if still:
        x[60:70] = x[60]
    y, z = 0.002 * np.sin(x / 0.02), 0.0015 * np.sin(x / 0.01)
    at, slope = rng.uniform(0, len(x) - 1, 3000), rng.uniform(-0.35, 0.35, 3000)
    own_x, own_y, own_z = (np.interp(at, np.arange(len(x)), v) for v in (x, y, z))
    seen = own_x + slope * (PLANE_M - own_z)
    found_y, found_z = path_of(x, y, z).across_at(seen, slope.astype(np.float32), PLANE_M)
    np.testing.assert_allclose(found_z, own_z, atol=2e-6)
    np.testing.assert_allclose(found_y, own_y, atol=2e-6)


def test_a_small_step_back_does_not_matter() -> None:
    x = np.linspace(0.001, 0.06, 150)
    x[80] -= 0.0003
    y, z = 0.1 * x, np.zeros(150)
    slope = np.zeros(150, np.float32)
    found_y, _ = path_of(x, y, z).across_at(x, slope, PLANE_M)
    np.testing.assert_allclose(found_y, y, atol=0.1 * 0.0008)

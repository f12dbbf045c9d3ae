import numpy as np
import pytest

from roller_sim.cell_settings import SkinSettings
from roller_sim.relief import HeightMap
from roller_sim.skin import _envelope, press_depth_mm, skin_over

STEP = 0.02e-3


def block(width_mm=4.0, height_mm=0.5, plate_mm=8.0, hole_mm=0.0):
    n = round(plate_mm / 0.02)
    x = (np.arange(n) - n // 2) * 0.02
    top = np.abs(x) <= width_mm / 2
    hole = np.abs(x) <= hole_mm / 2
    grid = np.outer(top, top) & ~np.outer(hole, hole)
    return HeightMap((grid * height_mm * 1e-3).astype(np.float32), 0.0, 0.0, STEP)


def slopes(height):
    return np.abs(np.diff(height, axis=0)).max() / STEP, np.abs(
        np.diff(height, axis=1)
    ).max() / STEP


@pytest.mark.parametrize("limit", [0.5, 1.0, 2.0])
def test_skin_is_never_steeper_than_the_limit(limit, monkeypatch):
    monkeypatch.setattr("roller_sim.skin._MAX_SLOPE", limit)
    skin = skin_over(block(), SkinSettings.create({}))
    assert max(slopes(skin.height)) <= limit * 1.001


def test_skin_touches_flat_tops_and_plate_and_never_sinks_far_below():
    relief = block()
    skin = skin_over(relief, SkinSettings.create({}))
    middle = relief.height.shape[0] // 2
    assert skin.height[middle, middle] == pytest.approx(0.5e-3, abs=1e-9)
    assert skin.height[2, 2] == pytest.approx(0.0, abs=1e-9)
    # Only convex edges are rounded off, by less than slope times smoothing.
    assert float((relief.height - skin.height).max()) < 2 * 0.08e-3
    assert float((skin.height >= relief.height - 1e-9).mean()) > 0.9


def test_light_contact_spans_what_full_contact_fills():
    relief = block(width_mm=3.0, hole_mm=1.2)
    middle = relief.height.shape[0] // 2
    reached = {
        contact: float(
            skin_over(relief, SkinSettings.create({"contact": contact})).height[middle, middle]
        )
        for contact in ("light", "medium", "full")
    }
    assert reached["full"] < 0.1e-3 < reached["medium"] < reached["light"]


def test_press_depth_scales_with_contact():
    assert press_depth_mm(SkinSettings.create({}), 2.0) == 2.0
    assert press_depth_mm(SkinSettings.create({"press_mm": 1.5}), 2.0) == 1.5
    assert press_depth_mm(SkinSettings.create({"contact": "light"}), 2.0) == pytest.approx(0.4)


def test_envelope_kernel_equals_its_numpy_twin():
    rng = np.random.default_rng(3)
    height = (rng.random((13, 17)) ** 6).astype(np.float32)
    limit = 0.07
    i, j = np.indices(height.shape)
    best = np.full(height.shape, -np.inf)
    for a, b in np.ndindex(height.shape):
        dy, dx = np.abs(i - a), np.abs(j - b)
        # Shortest path over direct and diagonal neighbours.
        path = np.maximum(dx, dy) + (np.sqrt(2) - 1) * np.minimum(dx, dy)
        best = np.maximum(best, height[a, b] - limit * path)
    _envelope(height, limit)
    np.testing.assert_allclose(height, best, atol=1e-5)

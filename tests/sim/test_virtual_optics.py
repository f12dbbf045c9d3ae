import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from roller_sim import _render_kernels as kernels
from roller_sim import _sensor_kernels as sensor_kernels
from roller_sim import optics
from roller_sim.cell import VirtualCell
from roller_sim.cell_settings import LightSettings
from roller_sim.optics import light_vector, lit_level, ring_field, speckle
from sim import virtual_twins as twins

#: Every eighth pixel of a full image: wide rays at little cost.
WIDE = {"width": 80, "height": 60, "focal_px": 1066 / 8}


def at(cell, x_mm):
    """ROS time at which the camera is over x."""
    t = np.linspace(0, cell.duration_s, 4001)
    return cell.truth.start_ros_ns + round(
        1e9 * t[np.argmin(np.abs(cell.path.along(t) - x_mm * 1e-3))]
    )


def position_mm(cell, when):
    return cell.truth.camera_positions(when)[0] * 1e3


def rays(cell):
    c = cell.camera
    u, v = np.meshgrid(np.arange(c.width), np.arange(c.height))
    return (u - c.cx) / c.fx, (v - c.cy) / c.fy


def log_image(cell, position):
    xn, yn = (r.astype(np.float32).ravel() for r in rays(cell))
    z = np.full(len(xn), position[2], np.float32)
    sx, sy, coat, out = (np.empty_like(z) for _ in range(4))
    maps = cell._maps
    kernels._trace_row(
        xn, yn, maps.flat, maps.shape, position, cell.truth.roller, maps.origin,
        kernels.trace_scratch(len(z)), z, sx, sy, coat,
    )  # fmt: skip
    kernels._shade_row(xn, yn, z, sx, sy, coat, cell._light, out)
    return xn, yn, z, sx, sy, coat, out


RENDERED = """
import hashlib
import numpy as np
from roller_sim import _sensor_kernels as kernels
from roller_sim._render_kernels import trace_scratch
from sim import virtual_twins as twins
from roller_sim.cell import VirtualCell

cell = VirtualCell(twins.small("bumps", width=640, height=480))
truth, maps = cell.truth, cell._maps
middle = truth.start_ros_ns + truth.duration_ns // 2
camera = (truth.camera_positions(middle)[0] - truth.origin_m) * 1e3
depth = np.full(cell._rays[0].shape, camera[2], np.float32)
sx, sy, out = (np.empty_like(depth) for _ in range(3))
kernels._render_rows(
    *cell._rays, maps.flat, maps.shape, camera, truth.roller, maps.origin, cell._light,
    trace_scratch(640), depth, sx, sy, out,
)
assert np.ptp(out) > 0.1
print(hashlib.sha256(out.tobytes() + depth.tobytes() + sx.tobytes()).hexdigest())
"""


def test_kernels_from_the_cache_render_the_same_bits_as_those_just_compiled(tmp_path):
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(tmp_path),
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), *filter(None, sys.path)]),
    }
    compiled, loaded = (
        subprocess.run(
            [sys.executable, "-c", RENDERED],
            env=environment, capture_output=True, text=True, check=True, timeout=300,
        ).stdout
        for _ in range(2)
    )  # fmt: skip
    assert compiled == loaded != ""


def test_fast_log():
    x = np.geomspace(1e-3, 50, 20001).astype(np.float32)
    got = np.array([kernels._fast_log.py_func(v) for v in x[::50]])
    np.testing.assert_allclose(got, np.log(x[::50].astype(np.float64)), atol=5e-6)


@pytest.mark.parametrize("contact", ["full", "light"])
@pytest.mark.parametrize("scene", ["sparse_sphere", "bumps"])
def test_rendering_equals_its_numpy_twin(scene, contact):
    camera = {"width": 40, "height": 30, "focal_px": 1066 / 16}
    cell = VirtualCell(twins.small(scene, camera=camera, skin={"contact": contact}))
    position = position_mm(cell, at(cell, 5.0))
    xn, yn, z, sx, sy, coat, out = log_image(cell, position)
    maps = cell._maps
    want = twins.trace(
        xn.astype(float), yn.astype(float), maps.values, position, cell.truth.roller, maps.origin
    )
    np.testing.assert_allclose(z, want[0], atol=2e-3)
    assert np.mean(np.abs(z - want[0])) < 1e-4
    for got, expected in zip((sx, sy, coat), want[1:], strict=True):
        assert np.quantile(np.abs(got - expected), 0.99) < 0.02
        assert np.mean(np.abs(got - expected)) < 2e-3
    light = cell.settings.light
    bright = twins.shade(xn.astype(float), yn.astype(float), *want, light)
    assert np.quantile(np.abs(out - bright), 0.99) < 0.02
    assert np.mean(np.abs(out - bright)) < 4e-3


def test_slopes_say_where_rays_end_once_the_camera_has_moved():
    """On a slope all of its depth is told, on level ground, where nothing changes, none."""
    x, y = np.array([-0.2, 0.0, 0.3, 0.1], np.float32), np.zeros(4, np.float32)
    slope = np.array([0.5, 0.5, -0.4, 0.0], np.float32)
    # The plane z = a + slope · x, seen from a camera that moves along x.
    a = np.float32(45.0)
    depth = a / (1 - slope * x)
    kernels._expect_row(x, y, slope, np.zeros_like(slope), 0.02, depth)
    np.testing.assert_allclose(depth, (a + slope * 0.02) / (1 - slope * x), rtol=1e-6)


@pytest.mark.parametrize("again", [0.0, 1.0])
@pytest.mark.parametrize("contact", ["full", "light"])
def test_each_ray_of_a_row_ends_where_it_would_alone(contact, again):
    """Rays that need more steps go on side by side; a guess far off changes nothing."""
    camera = {"width": 640, "height": 8, "focal_px": 1066.0}
    cell = VirtualCell(twins.small("bumps", camera=camera, skin={"contact": contact}))
    position, maps = position_mm(cell, at(cell, 5.0)), cell._maps
    xn, yn = cell._rays[0][4], cell._rays[1][4]
    place = (maps.flat, maps.shape, position, cell.truth.roller, maps.origin)
    row, single = (np.full((4, len(xn)), position[2] + again, np.float32) for _ in range(2))
    kernels._trace_row(xn, yn, *place, kernels.trace_scratch(len(xn)), *row)
    for u in range(len(xn)):
        one = slice(u, u + 1)
        kernels._trace_row(xn[one], yn[one], *place, kernels.trace_scratch(1), *single[:, one])
    assert np.ptp(row[0]) > 0.1
    np.testing.assert_allclose(row, single, atol=2e-4)


@pytest.mark.parametrize("contact", ["full", "light"])
def test_level_plate_in_contact_is_seen_as_where_rays_are_followed(contact):
    camera = {"width": 640, "height": 8, "focal_px": 1066.0}
    cell = VirtualCell(twins.small("three_lines", camera=camera, skin={"contact": contact}))
    maps, roller, (all_x, all_y) = cell._maps, cell.truth.roller, cell._rays
    place = (maps.shape, maps.origin)
    seen = 0
    for x_mm in (-8.0, 0.0, 5.0):
        position = position_mm(cell, at(cell, x_mm))
        for a in range(0, 640, 16):
            xn, yn = all_x[4, a : a + 16], all_y[4, a : a + 16]
            kind = sensor_kernels._kind(
                xn[0], xn[-1], yn[0], position, position, maps.active, maps.active_origin, roller
            )
            if kind != sensor_kernels._LEVEL:
                continue
            scratch, light = kernels.trace_scratch(16), cell._light
            depth, coat, bright = np.zeros((3, 16), np.float32)
            kernels._see_level_row(
                xn, yn, maps.flat, place[0], position, place[1], scratch, depth, coat
            )
            lit, higher = (
                lit_level(xn, yn, z, light) for z in (position[2] - 0.04, position[2] + 0.06)
            )
            rise = (higher - lit) / 0.1
            kernels._shade_level_row(
                lit.astype(np.float32), rise.astype(np.float32), 0.04, coat, bright
            )
            want = [np.full(16, position[2], np.float32), *np.empty((4, 16), np.float32)]
            kernels._trace_row(
                xn, yn, maps.flat, place[0], position, roller, place[1], scratch, *want[:4]
            )
            kernels._shade_row(xn, yn, *want[:4], light, want[4])
            np.testing.assert_array_equal(depth, np.float32(position[2]))
            np.testing.assert_allclose(want[1:3], 0, atol=2e-5)
            for got, expected in zip((depth, coat, bright), (want[0], *want[3:]), strict=True):
                np.testing.assert_allclose(got, expected, atol=2e-5)
            seen += 1
    assert 15 < seen < 100


@pytest.mark.parametrize("kind", ["ring", "dome", "strong"])
def test_light_on_level_plate_is_that_of_any_surface(kind):
    light = light_vector(LightSettings.create({"kind": kind}), 17.0)
    xn, yn = (np.float32(0.3) * a for a in np.random.default_rng(4).random((2, 200), np.float32))
    level, out = np.zeros_like(xn), np.empty_like(xn)
    for height_mm in (43.5, 46.0):
        z = np.full_like(xn, height_mm)
        kernels._shade_row(xn, yn, z, level, level, level, light, out)
        np.testing.assert_allclose(lit_level(xn, yn, height_mm, light), out, atol=5e-6)


def test_a_view_past_the_roller_is_rendered():
    """At 320 of 300 px from the middle a ray lies 46 degrees aside, and meets nothing of it."""
    camera = {"width": 640, "height": 8, "focal_px": 300.0}
    cell = VirtualCell(twins.small("bumps", camera=camera))
    position = position_mm(cell, at(cell, 5.0))
    for found in log_image(cell, position):
        assert np.isfinite(found).all()


def test_light_is_fitted_within_a_percent(monkeypatch):
    monkeypatch.setitem(optics.MIXES, "ring", optics.Mix(0.0, 1.0, 0.0, 0.6))
    vector = light_vector(LightSettings.create({}), 17.0)
    r = np.linspace(0.0, 16.5, 50)
    for depth in (43.0, 45.0, 47.0):
        z = np.full(len(r), depth, np.float32)
        flat = np.zeros(len(r), np.float32)
        out = np.empty(len(r), np.float32)
        xn = (r / depth).astype(np.float32)
        kernels._shade_row(xn, flat, z, flat, flat, flat, vector, out)
        exact = ring_field(r, 0 * r, np.full(len(r), depth))[2]
        scale = ring_field(np.zeros(1), np.zeros(1), np.full(1, 45.0))[2]
        np.testing.assert_allclose(np.exp(out), exact / scale, rtol=0.01)


@pytest.mark.parametrize("part", [0, 1, 2], ids=["ambient", "diffuse", "specular"])
def test_each_part_of_the_light_counts_at_the_middle(part, monkeypatch):
    monkeypatch.setitem(optics.MIXES, "ring", optics.Mix(*np.eye(3)[part], 0.6))
    vector = light_vector(LightSettings.create({}), 17.0)
    zero, z, out = np.zeros(1, np.float32), np.full(1, 45.0, np.float32), np.empty(1, np.float32)
    kernels._shade_row(zero, zero, z, zero, zero, zero, vector, out)
    assert out[0] == pytest.approx(0.0, abs=0.01)


def test_the_dome_lights_a_slope_the_same_wherever_it_is_in_the_image():
    light = LightSettings.create({"kind": "dome"})
    vector = light_vector(light, 17.0)
    xn, slope = (a.ravel().astype(np.float32) for a in
                 np.meshgrid(np.linspace(-0.3, 0.3, 7), np.linspace(-2, 2, 9)))  # fmt: skip
    zero, out = np.zeros_like(xn), np.empty_like(xn)
    for depth in (43.5, 46.5):
        z = np.full_like(xn, depth)
        kernels._shade_row(xn, zero, z, slope, zero, zero, vector, out)
        upright = 1 / np.sqrt(1 + slope**2)
        gloss = 0.15 / (1 + (slope / 0.6) ** 2) ** 2
        want = np.log(0.5 * (1 + upright) + 0.5 * upright + gloss)
        np.testing.assert_allclose(out, want, atol=1e-5)


def test_speckle_has_the_strength_and_length_set():
    light = LightSettings.create({"speckle": 0.04, "speckle_mm": 0.2})
    noise = speckle((400, 500), 0.02, light, 5)
    assert noise.std() == pytest.approx(0.04, rel=0.05)
    shifted = float(np.mean(noise[:, 10:] * noise[:, :-10])) / float(noise.var())
    assert shifted == pytest.approx(np.exp(-1), abs=0.06)
    assert not speckle((4, 4), 0.02, LightSettings.create({"speckle": 0.0}), 5).any()


def test_depth_of_a_flat_plate_is_exact():
    cell = VirtualCell(
        twins.small("flat", camera=WIDE, skin={"press_mm": 1.0}, motion={"vibration_um": 0.0})
    )
    depth = cell.truth.seen_images(at(cell, 5.0))[0] * 1e3
    xn, _ = rays(cell)
    half = np.sqrt(47.0**2 - 46.0**2)
    inside = np.abs(xn) * 46.0 < half - 0.3
    outside = np.abs(xn) * 46.0 > half + 0.3
    np.testing.assert_allclose(depth[inside], 46.0, atol=1e-4)
    # Undeformed, the coating is at R cos θ on its ray.
    np.testing.assert_allclose(depth[outside], (47.0 / np.sqrt(1 + xn**2))[outside], atol=1e-3)
    contact = cell.truth.seen_images(at(cell, 5.0))[1]
    assert contact[inside].all()
    assert not contact[outside].any()


def test_depth_of_stairs_is_exact_on_the_treads():
    cell = VirtualCell(twins.small("stairs", motion={"vibration_um": 0.0}, width=81, height=49))
    x0 = cell.scene.regions[0].x0 * 1e3
    for tread, rise in ((0.5, 0.2), (3.5, 0.8), (4.5, 1.0), (7.5, 0.4)):
        when = at(cell, x0 + 1.1 * tread)
        depth = cell.truth.seen_at(when, [[40.0, 24.0]])[0]
        assert depth[0] == pytest.approx((45.0 - rise) * 1e-3, abs=2e-6)
    x = cell.truth.camera_positions(when)[0, 0]
    assert cell.truth.height_at(x, 0.0) == pytest.approx(0.4e-3, abs=1e-6)


def test_speckle_moves_with_the_surface_in_contact_and_turns_outside():
    cell = VirtualCell(
        twins.small("flat", camera=WIDE | {"width": 640, "height": 9, "focal_px": 1066.0},
                    skin={"press_mm": 1.0}, light={"speckle_mm": 0.3},
                    motion={"vibration_um": 0.0})
    )  # fmt: skip
    shift = 2.0
    here = np.array([10.0, 0.0, 46.0])
    there = here + (shift, 0, 0)
    xn, _, z, *_, first, _ = log_image(cell, here)
    second = log_image(cell, there)[5]
    row = slice(4 * 640, 5 * 640)
    x, a, b = (xn * z)[row], first[row], second[row]
    half = float(cell.truth.roller[1])

    def material(x):
        turned = np.abs(x) - half
        turned = 47.0 * (np.arcsin(np.abs(x) / 47.0) - np.arcsin(half / 47.0))
        return np.where(np.abs(x) > half, np.sign(x) * (half + turned), x)

    # What is seen at material coordinate m now is seen at m - shift after the camera moved on.
    later = np.interp(material(x), material(x) + shift, b)
    inside = (np.abs(x) < half - 0.2) & (np.abs(x - shift) < half - 0.2)
    outside = (x > half + shift + 0.3) | ((x < -half - 0.3) & (x > x[0] + shift))
    for part in (inside, outside):
        assert part.sum() > 20
        assert np.corrcoef(a[part], later[part])[0, 1] > 0.98

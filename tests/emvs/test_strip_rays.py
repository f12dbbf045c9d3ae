"""Rays of a strip, which are made of the pages of its store whenever they are needed."""

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_emvs.evidence.field import ground
from roller_emvs.lines.ray_source import RayArray
from roller_emvs.methods.surface import SurfaceSettings
from roller_emvs.methods.surface.blocks import MARGIN_M
from roller_emvs.methods.surface.event_store import EventStore
from roller_emvs.methods.surface.strip import Strip
from roller_emvs.methods.surface.strip_rays import StripRays

LENGTH_M, PIXEL_M, TOP_M, STEEPEST = 0.004, 4e-5, -0.001, 0.8
SHAPE = (64, 180)


@pytest.fixture
def store() -> EventStore:
    """A store of two blocks, with more than a page of events in a piece."""
    rng = np.random.default_rng(3)
    n = 70_000
    placed = np.stack(
        [rng.uniform(0, 0.008, n), rng.uniform(-0.001, 0.0015, n), rng.uniform(-0.3, 0.3, n)]
    ).astype(np.float32)
    events = EventArray.from_arrays(*np.zeros((2, n), int), np.arange(n), rng.integers(0, 2, n))
    store = EventStore(LENGTH_M, STEEPEST)
    store.add(placed, events, 0.0, 0, range(2))
    return store


def strip_of(store: EventStore, ends: tuple[float, float]) -> Any:
    """What `StripRays` asks of a strip: its first block, and what reaches it of the second."""

    def chains(block: object, polarity: int, reach_m: float) -> tuple[np.ndarray, ...]:
        own = store.chains(0, polarity), store.chains(1, polarity, -np.inf, reach_m)
        return (
            np.concatenate([-own[0][0], -LENGTH_M - own[1][0]]),
            np.concatenate([own[0][1], own[1][1]]),
            np.concatenate([own[0][2], own[1][2]]),
        )

    return SimpleNamespace(
        store=store, ends=ends, chains=chains,
        scales=lambda block: (TOP_M, PIXEL_M, store.piece_m, STEEPEST),
    )  # fmt: skip


@pytest.mark.parametrize("every", [1, 2, 8])
@pytest.mark.parametrize("ends", [(-np.inf, np.inf), (-0.1, 0.2), (0.5, 0.6)])
def test_rays_of_pages_are_those_of_the_events(
    store: EventStore, every: int, ends: tuple[float, float]
) -> None:
    block: Any = None
    rays = StripRays(strip_of(store, ends), block, 1, 0.001, every)
    expected = []
    for k, (low, high) in enumerate([(0, 8), (0, 3)]):
        own = store.events(k, 1, k * LENGTH_M)
        counts = store.chains(k, 1)[2]
        for a, b in list(pairwise(np.cumsum([0, *counts])))[low:high]:
            some = slice(a, b, every)
            expected.append(np.stack([own.x_m[some], own.y_m[some], own.slope[some]], axis=1))
    wanted = np.concatenate(expected)
    wanted = wanted[(wanted[:, 2] >= ends[0]) & (wanted[:, 2] <= ends[1])]
    wanted = np.column_stack([wanted + [MARGIN_M, -TOP_M, 0.0], np.zeros(len(wanted))]) / PIXEL_M
    found = rays.array()
    np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-3)
    rng = np.random.default_rng(4)
    surface = rng.uniform(-3e-4, 3e-4, SHAPE).astype(np.float32)
    surface[10:20] = np.nan
    for own in (surface, np.full(SHAPE, np.float32(np.nan))):
        pixel, counted = rays.ground(own)
        by_one, all_counted = ground(found, own)
        np.testing.assert_array_equal(pixel, by_one)
        np.testing.assert_array_equal(counted, all_counted)
        counted[-1] = 0
        place = (np.cumsum(counted) - counted).astype(np.int32)
        place[counted == 0] = -1
        ordered, as_array = np.zeros((2, int(counted.sum()), 4), np.float32)
        RayArray(found).by_pixel(pixel, place.copy(), as_array)
        rays.by_pixel(pixel, place, ordered)
        np.testing.assert_array_equal(ordered, as_array)


def test_a_step_that_a_page_is_no_multiple_of_is_refused(store: EventStore) -> None:
    block: Any = None
    with pytest.raises(ValueError, match="no multiple"):
        StripRays(strip_of(store, (-1.0, 1.0)), block, 0, 0.001, 3)


def test_places_are_kept_to_hundredths_of_a_micrometre_of_usual_blocks() -> None:
    store, rng = EventStore(0.008, STEEPEST), np.random.default_rng(5)
    x, slope = rng.uniform(0, 0.008, 5000), rng.uniform(-0.8, 0.8, 5000)
    x[:3], slope[:2] = (0.0, 0.001, np.nextafter(np.float32(0.008), 0)), (-0.8, 0.8)
    order = np.argsort(x)
    placed = np.stack([x, x, slope])[:, order].astype(np.float32)
    zeros = np.zeros((2, 5000), int)
    store.add(placed, EventArray.from_arrays(*zeros, zeros[0], zeros[0]), 0.0, 0, [0])
    kept = store.events(0, 0)
    np.testing.assert_array_equal(kept.y_m, placed[0])
    off = kept.x_m - placed[0]
    assert np.abs(off).max() < 1.2e-8
    assert abs(off.mean()) < 5e-10
    assert np.abs(kept.slope - placed[2]).max() < 1.25e-5


@pytest.mark.parametrize("tilt_deg", [-20.0, 20.0])
def test_no_event_is_lost_where_the_camera_tilts_in_a_pass(tilt_deg: float) -> None:
    camera = Camera(64, 48, 100.0, 100.0, 31.5, 23.5)  # 18° to either side
    table = camera.undistortion_table().astype(np.float64)
    rays = ((table - (camera.cx, camera.cy)) / (camera.fx, camera.fy)).astype(np.float32)
    first, second = np.eye(4), np.eye(4)
    second[:3, :3] = Rotation.from_euler("y", tilt_deg, degrees=True).as_matrix()
    second[0, 3] = 1e-3
    strip = Strip(SurfaceSettings.create({}), camera, rays, 0, first, np.array([1.0, 0.0, 0.0]))
    y, x = (v.ravel() for v in np.indices(rays.shape[:2]))
    late = EventArray.from_arrays(x, y, np.full(len(x), 9_999), np.zeros(len(x), int))
    strip.add(late, 0, 10_000, first, second)
    assert strip.held_events == len(x)
    steepest = np.tan(np.radians(20)) + 0.32
    assert max(abs(strip.store.events(k, 0).slope).max() for k in strip.store.blocks) > steepest

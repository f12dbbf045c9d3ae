"""Scenes that look alike at several depths or places: no confident wrong answer."""

import numpy as np
import pytest

from emvs.hard import world
from emvs.hard.world import ALL, CAMERA, pending
from emvs.scenes import MS, depth_map
from roller_core.events import EventArray
from roller_emvs.depth_settings import StitcherSettings
from roller_emvs.registration import Refinement
from roller_emvs.stitcher import Stitcher

PITCH_M = 0.0004
#: Between the places that the strobed scan sees from.
STEP_M = 0.0108


@pytest.mark.parametrize("pitch_m", [0.0003, 0.0013])
@pytest.mark.parametrize("method", ALL)
def test_lines_at_a_constant_pitch(method: str, pitch_m: float) -> None:
    """Seen from end to end, neighbours align at one depth alone; at others they smear."""
    lines = np.arange(-0.012, 0.045, pitch_m)
    events = world.scan(lines=lines, depth=world.flat(world.MIDDLE_M), share=0.2)
    points = world.points_of(world.run(method, events, world.poses()))
    errors = np.abs(world.errors_px(points, world.flat(world.MIDDLE_M)))
    assert np.sum(errors > 2) <= 0.05 * max(len(errors), 1)


def strobed() -> EventArray:
    """Lines at a constant pitch, lit for a moment every 10.8 mm.

    From places that are k·STEP apart, lines that are PITCH apart align at 45 mm, each with itself,
    and at 43.4 mm, each with its neighbour, just as well: 45·(1 - PITCH/(STEP + PITCH)).
    """
    lines = np.arange(-0.02, 0.06, PITCH_M)
    t, x = [], []
    for k in range(4):
        u = CAMERA.fx * (lines - STEP_M * k) / world.MIDDLE_M + CAMERA.cx
        u = np.rint(u[(u > 0) & (u < CAMERA.width - 1)]).astype(int)
        x.append(np.repeat(u, CAMERA.height * 20))
        t.append(np.full(len(x[-1]), round(STEP_M * k / world.SPEED_M_S * 1e9)))
    xs, ts = np.concatenate(x), np.concatenate(t)
    return EventArray.from_arrays(xs, np.arange(len(xs)) % CAMERA.height, ts, np.ones(len(xs)))


@pytest.mark.parametrize(
    "method",
    pending((*ALL, "left_right"), ("bma", "left_right"), "a second peak as high is not looked for"),
)
def test_two_depths_that_fit_alike(method: str) -> None:
    """Nothing in the data tells them apart, so neither may be given with confidence."""
    events = strobed()
    values = {} if method == "surface" else {"window": {"rule": "all"}}
    points = world.points_of(world.run(method, events, world.poses(), **values))
    errors = np.abs(world.errors_px(points, world.flat(world.MIDDLE_M)))
    assert np.sum(errors > 2) <= 0.05 * max(len(errors), 1)


def stitched(relief: np.ndarray, again: np.ndarray) -> tuple[Stitcher, Refinement]:
    stitcher = Stitcher(StitcherSettings.create({}), CAMERA)
    stitcher.add(depth_map(relief))
    stitcher.add(depth_map(again))
    assert stitcher.last_refinement is not None
    return stitcher, stitcher.last_refinement


X, Y = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))


def test_icp_leaves_a_nearly_flat_plate_alone() -> None:
    """Noise of 2 µm is no relief: nothing fixes a slide along the plate."""
    rng = np.random.default_rng(0)
    plates = [0.045 + rng.normal(0, 2e-6, X.shape) for _ in range(2)]
    stitcher, found = stitched(*plates)
    assert not found.accepted
    assert "does not fix" in found.reason
    heights = stitcher.finish().points[:, 2]
    assert np.abs(heights - 0.045).max() < 2e-5


def test_icp_leaves_a_grating_alone() -> None:
    """Ridges across the roll fix no slide along them."""
    grating = 0.045 + 2e-4 * np.sin(2 * np.pi * X / 24)
    _, found = stitched(grating, np.roll(grating, 12, axis=1))
    assert not found.accepted
    np.testing.assert_array_equal(found.correction, np.eye(4))


@pytest.mark.parametrize("shift_px", [8, 12, 16])
def test_icp_does_not_slide_to_the_next_of_bumps_that_repeat(shift_px: int) -> None:
    """An egg box of 24 px = 1.35 mm, moved by a third to two thirds of that: the distance to the
    nearest fit, the right one or its neighbour, is further than a robot errs."""
    bumps = 0.045 + 2e-4 * np.sin(2 * np.pi * X / 24) * np.sin(2 * np.pi * Y / 24)
    _, found = stitched(bumps, np.roll(bumps, shift_px, axis=1))
    assert not found.accepted
    np.testing.assert_array_equal(found.correction, np.eye(4))


def test_icp_finds_nothing_where_bumps_fit_their_neighbours() -> None:
    """Moved by a whole period all fits: no correction is the right one, the robot is believed."""
    bumps = 0.045 + 2e-4 * np.sin(2 * np.pi * X / 20) * np.sin(2 * np.pi * Y / 20)
    _, found = stitched(bumps, np.roll(bumps, 20, axis=1))
    assert not found.accepted


@pytest.mark.parametrize("method", ALL)
def test_a_blank_plate_gives_no_depth(method: str) -> None:
    """Noise alone, of which any neighbourhood's sharpest plane is as good as another."""
    rng = np.random.default_rng(4)
    n = 60_000
    t = np.sort(rng.integers(0, 100 * MS, n))
    x, y = rng.integers(0, CAMERA.width, n), rng.integers(0, CAMERA.height, n)
    noise = EventArray.from_arrays(x, y, t, rng.integers(0, 2, n))
    points = world.points_of(world.run(method, noise, world.poses()))
    # The default scan, of twice as many events, gives 200 and more.
    assert len(points) <= 20

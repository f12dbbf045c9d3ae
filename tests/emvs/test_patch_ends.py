"""Where the skin leaves the surface: events of a texture that lie beside their lines there."""

import numpy as np
import pytest

from emvs.textured_scans import steady, swept_points, true_track
from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.lines.fit import TEXTURE_ROW_STEP
from roller_emvs.lines.near_lines import near_lines
from roller_emvs.lines.patch_ends import _BESIDE, _MOST_PX, PatchEnds, _add_beside
from roller_emvs.methods.surface import SurfaceSettings, SurfaceSweep
from roller_emvs.pipeline import DepthPipeline
from roller_sim.presets import COATINGS
from simulated_scans import Scans, SimulatedScan

#: What is within this of the plate's face is of it, m.
LEVEL_M = 5e-6

PIXEL_M, FOCAL_PX, SLOPE = 4.2e-5, 1000.0, 0.3
SHAPE = (40, 80)
COLUMNS = np.arange(8.0, 76.0, 6.0)
LINES = [(row, x) for row in range(0, SHAPE[0], TEXTURE_ROW_STEP) for x in COLUMNS]


def block(
    lifted_px: tuple[float, float],
    tilted_m: float = 0.0,
    seed: int = 1,
    seen: tuple[float, float] = (-SLOPE, SLOPE),
) -> list[np.ndarray]:
    """OFF and ON events of a texture, whose skin is off the surface in so many end columns.

    They lie up to half a pixel outwards there, and all of them by a depth more than the lines say.
    """
    rng = np.random.default_rng(seed)
    rays = []
    for _ in range(2):
        n = 250_000
        slope = rng.uniform(*seen, n)
        low, high = ((SLOPE + s * slope) * FOCAL_PX for s in (1, -1))
        out = 0.5 * np.maximum(1 - high / max(lifted_px[1], 1e-9), 0)
        out -= 0.5 * np.maximum(1 - low / max(lifted_px[0], 1e-9), 0)
        x = rng.choice(COLUMNS, n) + out + slope / PIXEL_M * tilted_m + rng.normal(0, 0.4, n)
        y = rng.uniform(-0.5, SHAPE[0] - 0.5, n)
        rays.append(np.column_stack([x, y, slope / PIXEL_M, np.zeros(n)]).astype(np.float32))
    return rays


def look(ends: PatchEnds, rays: list[np.ndarray]) -> bool:
    """Show both polarities' events, and the lines that the texture really has."""
    surface, (row, column) = np.zeros(SHAPE, np.float32), np.array(LINES).T
    for own in rays:
        at = own[:, 2].astype(np.float64) * PIXEL_M
        ends.look(own, at, surface, row.astype(np.int64), column, np.zeros(len(row)))
    return ends.find()


@pytest.mark.parametrize("lifted", [(16.0, 16.0), (30.0, 12.0), (0.0, 24.0)])
def test_columns_that_are_off_the_surface_are_found(lifted: tuple[float, float]) -> None:
    ends = PatchEnds((-SLOPE, SLOPE), FOCAL_PX)
    # A depth that the lines lack by a little isn't taken for it.
    rays = block(lifted, tilted_m=8e-6)
    assert look(ends, rays)
    assert ends.known
    for off_px, end in zip(lifted, ends.ends, strict=True):
        if off_px:
            assert off_px - 4 <= (SLOPE - abs(end)) * FOCAL_PX <= off_px + 8
        else:
            assert np.isinf(end)


def test_where_the_skin_is_on_the_surface_all_columns_count() -> None:
    for seed in range(5):
        ends = PatchEnds((-SLOPE, SLOPE), FOCAL_PX)
        rays = block((0.0, 0.0), tilted_m=8e-6, seed=seed)
        assert not look(ends, rays)
        assert ends.known
        assert ends.ends == (-np.inf, np.inf)


def test_an_end_is_known_once_it_was_seen() -> None:
    ends = PatchEnds((-SLOPE, SLOPE), FOCAL_PX)
    rays = block((16.0, 16.0), seen=(-SLOPE, 0.5 * SLOPE))
    assert look(ends, rays)
    assert not ends.known
    assert np.isfinite(ends.ends[0])
    assert np.isinf(ends.ends[1])
    rays = block((16.0, 16.0), seen=(-0.5 * SLOPE, SLOPE))
    low = ends.ends[0]
    assert look(ends, rays)
    assert ends.known
    assert ends.ends[0] == low
    assert np.isfinite(ends.ends[1])


def test_an_end_that_the_outermost_columns_did_not_see_is_not_known() -> None:
    """At a pass's begin the front columns have seen little, those further in much."""
    ends = PatchEnds((-SLOPE, SLOPE), FOCAL_PX)
    rays = block((16.0, 16.0), seen=(-SLOPE, 0.92 * SLOPE))
    few = [own[:1500] for own in block((0.0, 0.0), seen=(0.9 * SLOPE, SLOPE))]
    look(ends, [np.concatenate(both) for both in zip(rays, few, strict=True)])
    assert not ends.known
    assert look(ends, block((16.0, 16.0)))
    assert ends.known
    assert np.isfinite(ends.ends).all()


def test_an_end_that_is_off_shows_in_few_events() -> None:
    """As of a part of the camera's rows; that it is on the surface takes more of them."""
    ends = PatchEnds((-SLOPE, SLOPE), FOCAL_PX)
    rays = block((16.0, 0.0))
    assert not look(ends, [own[1::18] for own in rays])
    assert look(ends, [own[2::18] for own in rays])
    assert not ends.known
    assert 12 <= (SLOPE + ends.ends[0]) * FOCAL_PX <= 28
    assert np.isinf(ends.ends[1])
    # Where many come, the next look tells it better.
    ends = PatchEnds((-SLOPE, SLOPE), FOCAL_PX)
    assert not look(ends, [own[::9] for own in rays])


def test_an_end_that_hardly_sees_anything_is_known_in_the_end() -> None:
    ends = PatchEnds((-SLOPE, SLOPE), FOCAL_PX)
    rays = block((16.0, 0.0), seen=(-SLOPE, 0.9 * SLOPE))
    looked = 0
    while not ends.known and looked < 10:
        look(ends, rays)
        looked += 1
    assert 1 < looked < 10
    assert np.isfinite(ends.ends[0])
    assert np.isinf(ends.ends[1])


@pytest.mark.parametrize("lifted_px", [150.0, 250.0, 400.0])
def test_more_than_a_fifth_of_the_image_is_no_end(lifted_px: float) -> None:
    ends = PatchEnds((-SLOPE, SLOPE), FOCAL_PX)
    look(ends, block((lifted_px, 0.0)))
    low, high = np.clip(ends.ends, -SLOPE, SLOPE)
    assert low + SLOPE <= 0.2 * 2 * SLOPE
    assert SLOPE - high <= 0.2 * 2 * SLOPE


def test_few_events_say_nothing() -> None:
    ends = PatchEnds((-SLOPE, SLOPE), FOCAL_PX)
    rays = block((16.0, 16.0))
    assert not look(ends, [own[::40] for own in rays])
    assert not ends.known


def test_distances_beside_lines_are_those_of_a_plain_sum() -> None:
    rng = np.random.default_rng(3)
    n, low, per_bin, bins = 5000, -0.3, 20 / 0.6, 20
    row, column = np.array(LINES).T
    offset = rng.uniform(-1e-4, 1e-4, len(row))
    near = near_lines(row.astype(np.int64), column, SHAPE, _BESIDE, TEXTURE_ROW_STEP)
    pixel = rng.integers(0, SHAPE[0] * SHAPE[1] + 1, n).astype(np.int32)
    slope, seen_at = rng.uniform(-0.32, 0.32, (2, n))
    x = pixel % SHAPE[1] + rng.uniform(-1.5, 1.5, n)
    rays = np.column_stack([x, np.zeros(n), slope / PIXEL_M, np.zeros(n)]).astype(np.float32)
    sums, counts = np.zeros(bins), np.zeros(bins, np.int64)
    _add_beside(rays, seen_at, pixel, near, column, offset, _MOST_PX, low, per_bin, sums, counts)
    expected, number = np.zeros(bins), np.zeros(bins, int)
    for ray, s, at in zip(rays.astype(np.float64), seen_at, pixel, strict=True):
        if at == SHAPE[0] * SHAPE[1]:
            continue
        own = [k for k in range(len(row)) if at // SHAPE[1] - row[k] in (-1, 0, 1, 2)]
        own = [k for k in own if abs(at % SHAPE[1] - column[k]) <= 1]
        if not own:
            continue
        apart = ray[0] + ray[2] * offset[own[0]] - column[own[0]]
        bin_ = int(np.floor((s - low) * per_bin))
        if abs(apart) <= _MOST_PX and 0 <= bin_ < bins:
            expected[bin_] += apart
            number[bin_] += 1
    np.testing.assert_allclose(counts, number, atol=1)
    np.testing.assert_allclose(sums, expected, atol=2)
    assert counts.sum() > 500


def left_out_px(ends: PatchEnds, scan: SimulatedScan) -> list[float]:
    """Columns at either end of the image that don't count."""
    return [0.5 * scan.camera.width - abs(end) * scan.camera.fx for end in ends.ends]


def test_a_textured_plate_lies_where_it_is(scans: Scans, monkeypatch: pytest.MonkeyPatch) -> None:
    """The virtual roller's skin leaves the plate some 16 columns before the image ends."""
    scene = {"margin_mm": 2.0, "step_mm": 0.03, "defects": 3, "defect_kinds": ["dent"]}
    light = {"kind": "dome", "speckle": 0.08}
    scan = scans.scan("defects", scene=scene, camera={"height": 96}, light=light)
    track, biases_um = true_track(scan), []
    for looks in (True, False):
        if not looks:
            monkeypatch.setattr(PatchEnds, "find", lambda self: False)
        sweep = SurfaceSweep(SurfaceSettings.create({}), scan.camera, track)
        x, y, z = swept_points(sweep, scan).T
        height = scan.truth.height_at(x, y)
        face = height > height.max() - LEVEL_M
        assert face.sum() > 5000
        biases_um.append(1e6 * float(np.median((z - height)[face])))
        assert sweep._pass
        if looks:
            for columns in left_out_px(sweep._pass[2], scan):
                assert 10 < columns < 40
    with_ends, without = biases_um
    assert abs(with_ends) < 0.7 * without < 8


def test_windows_find_the_ends_too(scans: Scans) -> None:
    scene = {"margin_mm": 6.0, "step_mm": 0.03, "defects": 3, "defect_kinds": ["dent"]}
    light = {"kind": "dome", "speckle": 0.08}
    scan = scans.scan("defects", scene=scene, camera={"height": 240}, light=light)
    pipeline = DepthPipeline(DepthSettings.create({}), scan.camera, true_track(scan))
    pipeline.add_events(steady(scan))
    maps = [found for found in pipeline.results(flush=True) if isinstance(found, DepthMap)]
    assert len(maps) >= 2
    assert pipeline._ends
    for columns in left_out_px(pipeline._ends, scan):
        assert 10 < columns < 40


def test_no_ends_are_found_where_the_skin_stays_on_the_surface(scans: Scans) -> None:
    """Pressed onto the stairs it does; events that share a pose across frames would look like it
    doesn't."""
    scan = scans.scan("stairs", scene={"margin_mm": 2.0, "step_mm": 0.03}, **COATINGS["textured"])
    pipeline = DepthPipeline(DepthSettings.create({}), scan.camera, true_track(scan))
    pipeline.add_events(steady(scan))
    assert len(list(pipeline.results(flush=True))) >= 2
    assert pipeline._ends
    assert pipeline._ends.known
    assert left_out_px(pipeline._ends, scan) == [-np.inf, -np.inf]

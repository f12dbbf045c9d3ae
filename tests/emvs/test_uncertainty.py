"""`sigma` of points: what it follows, and that it holds where all of a printed skin is seen."""

from pathlib import Path

import numpy as np
import pytest

from roller_core.parameter_files import read_parameters
from roller_emvs.depth_stage import EmvsParameters
from roller_emvs.evidence import CELL_PX, RayField
from roller_emvs.evidence.sweep import Depths
from roller_emvs.evidence.uncertainty import agreed_share, point_sigma, seen_around
from roller_emvs.methods.surface import SurfaceSweep
from roller_emvs.pipeline import DepthPipeline
from roller_emvs.surface_stage import SurfaceParameters
from roller_emvs.windows import RefusedWindow
from roller_inspect.results.truth_tally import SurfaceTally
from roller_sim.presets import COATINGS
from simulated_scans import Scans

CELLS = (30, 40)
PARALLAX = 200.0  # px by unit of offset
FIELD = RayField(
    (CELLS[0] * CELL_PX, CELLS[1] * CELL_PX),
    np.stack([np.full(CELLS[1], -PARALLAX / 2), np.full(CELLS[1], PARALLAX / 2)]),
    1.0, 1.0, 1000.0, 1e4, 1.0, np.empty((0, 4), np.float32), np.zeros(3, np.int64),
)  # fmt: skip
MIDDLE = np.array([60]), np.array([80])
#: Of plate around the stairs, and up to which height it counts as level.
MARGIN_M, LEVEL_M = 0.002, 2e-5
CALIBRATION = Path(__file__).parents[2] / "config" / "virtual_cell_ring.yaml"


def depths(known: np.ndarray) -> Depths:
    values = np.where(known, 0.0, np.nan).astype(np.float32)
    return Depths(values, *[np.zeros(CELLS, np.float32)] * 5)


def sigmas_px(seen: np.ndarray, scatter_px: float, drift_px: float = 0.0) -> tuple[float, float]:
    """Of a point in the middle of a level surface, by itself and as those around agree."""
    level, scatter = np.zeros(CELLS, np.float32), np.array([scatter_px], np.float32)
    place = (FIELD, level, *MIDDLE, scatter, seen)
    alone = np.hypot(point_sigma(*place), np.float32(drift_px / PARALLAX))
    agreed = alone * agreed_share(*place, alone)
    return float(alone[0] * PARALLAX), float(agreed[0] * PARALLAX)


def test_where_both_polarities_are_seen_all_around_what_they_scatter_tells() -> None:
    everywhere, nowhere = np.ones(CELLS, bool), np.zeros(CELLS, bool)
    both = seen_around([depths(everywhere)] * 2)
    one = seen_around([depths(everywhere), depths(nowhere)])
    np.testing.assert_allclose(both, 1.0, rtol=1e-6)
    np.testing.assert_allclose(one, 0.5, rtol=1e-6)
    for scatter in (0.0, 0.1, 0.3, 1.0):
        alone, agreed = sigmas_px(both, scatter)
        assert scatter <= agreed <= alone
        assert sigmas_px(one, scatter)[0] == sigmas_px(one, scatter)[1] >= alone
    assert sigmas_px(both, 0.05)[1] < 0.2
    # Drift would set the polarities apart, which scatters.
    assert sigmas_px(both, 0.05, 0.6)[1] == pytest.approx(sigmas_px(both, 0.05)[1], rel=1e-5)
    assert sigmas_px(one, 0.05, 0.6)[1] > 0.6


def test_loops_over_points_are_their_plain_twins() -> None:
    rng = np.random.default_rng(8)
    row, column = rng.integers(0, CELLS[0] * 4, 500), rng.integers(0, CELLS[1] * 4, 500)
    fitted, scatter = rng.normal(0, 0.1, CELLS), rng.uniform(0, 2, 500)
    fitted[rng.random(CELLS) < 0.1] = np.nan
    seen = rng.random(CELLS)
    seen[rng.random(CELLS) < 0.5] = 1.0
    place = (fitted.astype(np.float32), row, column, scatter.astype(np.float32))
    sigma = point_sigma(FIELD, *place, seen.astype(np.float32))
    share = agreed_share(FIELD, *place, seen.astype(np.float32), sigma)
    i, j = row // CELL_PX, column // CELL_PX
    slope = np.nan_to_num(np.hypot(*np.gradient(fitted)))[i, j] / CELL_PX
    peak = np.interp(seen[i, j], [0.2, 0.6], [1.0, 0.5])
    np.testing.assert_allclose(
        sigma, np.hypot(np.hypot(scatter, peak) / PARALLAX, slope), rtol=1e-5
    )
    agreed = np.hypot(np.hypot(2 * scatter, 0.1) / PARALLAX, slope)
    expected = np.where(seen[i, j] >= 0.98, np.minimum(agreed / sigma, 1), 1)
    np.testing.assert_allclose(share, expected, rtol=1e-5)
    assert 0 < np.count_nonzero(share < 1) < len(share)


def test_few_cells_that_lie_alone_are_less_sure() -> None:
    """Of a scan's ends: of a cell with no other around a depth is hardly worth its parallax."""
    alone = np.zeros(CELLS, bool)
    alone[14:17, 19:22] = True
    band = np.zeros(CELLS, bool)
    band[11:20] = True
    few, some = (seen_around([depths(known)] * 2) for known in (alone, band))
    assert sigmas_px(few, 0.1)[1] > 0.9
    assert sigmas_px(some, 0.1)[1] == pytest.approx(np.hypot(0.1, 0.5), rel=1e-5)


@pytest.mark.parametrize("method", ["focus", "surface"])
def test_sigma_holds_under_a_printed_texture_and_is_no_wider_than_it_must_be(
    method: str, scans: Scans
) -> None:
    """Calibrated, in a light that travels: flat ground and walls alike."""
    scene = {"margin_mm": MARGIN_M * 1e3, "step_mm": 0.03}
    scan = scans.scan("stairs", scene=scene, **COATINGS["textured"])
    errors, sigmas, level = [], [], []
    if method == "focus":
        section = read_parameters(CALIBRATION, "emvs")
        depth = DepthPipeline(EmvsParameters.create(section), scan.camera, scan.track)
        depth.add_events(scan.events)
        for found in depth.results(flush=True):
            if not isinstance(found, RefusedWindow):
                seen, contact = scan.truth.seen_images(found.stamp_ns - scan.truth.event_delay_ns)
                known = np.isfinite(found.depth) & contact
                errors.append((found.depth - seen)[known])
                sigmas.append(found.sigma[known])
                level.append(seen[known] > seen[contact].max() - LEVEL_M)
    else:
        section = read_parameters(CALIBRATION, "surface")
        sweep = SurfaceSweep(SurfaceParameters.create(section), scan.camera, scan.track)
        sweep.add_events(scan.events)
        stairs = scan.truth.objects["stairs"]
        for patch in sweep.results(flush=True):
            if not isinstance(patch, RefusedWindow):
                tally = SurfaceTally(scan.truth)
                tally.add_points(patch.points, patch.stamp_ns)
                x, y, z = tally.points.T
                known = (x > stairs.x0 - MARGIN_M) & (x < stairs.x1 + MARGIN_M)
                height = scan.truth.height_at(x, y)
                errors.append((z - height)[known])
                sigmas.append(patch.sigma[known])
                level.append(height[known] < LEVEL_M)
    error, sigma = np.abs(np.concatenate(errors)), np.concatenate(sigmas)
    flat = np.concatenate(level)
    for part in (flat, ~flat):
        assert part.sum() > 5_000
        assert (error <= 2 * sigma)[part].mean() > 0.93
    # On level ground; without looking around it is three to four times what two thirds err by.
    assert np.median(sigma[flat]) < 2.2 * np.quantile(error[flat], 0.68)


def test_what_both_polarities_share_doesnt_show_in_how_they_agree(scans: Scans) -> None:
    """An instrument whose edges drift by the side of their wall: both polarities alike."""
    scene = {"margin_mm": MARGIN_M * 1e3, "step_mm": 0.03}
    scan = scans.scan("stairs", scene=scene, **COATINGS["textured"])
    section, medians = read_parameters(CALIBRATION, "emvs"), []
    for side_m in ((0.0, 0.0), (1e-9, 1e-9)):
        drift = {**section["edge_drift"], "side_m": side_m}
        settings = EmvsParameters.create({**section, "edge_drift": drift})
        depth = DepthPipeline(settings, scan.camera, scan.track)
        depth.add_events(scan.events)
        maps = [m for m in depth.results(flush=True) if not isinstance(m, RefusedWindow)]
        medians.append(np.median(np.concatenate([m.sigma[np.isfinite(m.depth)] for m in maps])))
    assert medians[1] > 1.25 * medians[0]

"""Points follow a wider neighbourhood where that sees no relief."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.ndimage import gaussian_filter

from emvs.textured_scans import steady, swept_points
from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.evidence import CELL_PX, Relief, follow_wider
from roller_emvs.evidence.evidence_settings import SurfaceEvidence
from roller_emvs.methods.surface import SurfaceSettings, SurfaceSweep
from roller_emvs.pipeline import DepthPipeline
from roller_evaluation.plate_surface import seen_area
from roller_inspect.results.truth_tally import TruthTally
from roller_sim.presets import COATINGS
from simulated_scans import Scans, SimulatedScan

#: Offsets are in metres, pixels of 43 µm; half a millimetre of offset is a pixel of parallax.
PX_M, APERTURE = 43e-6, 2000.0
CELLS = 60, 80
FIELD: Any = SimpleNamespace(cells=CELLS, aperture=APERTURE)
SIGMA_M = 12e-6
EVIDENCE = SurfaceEvidence.create({})

Heights = npt.NDArray[np.float64]


def places(rng: np.random.Generator) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """One pixel of seven."""
    rows, columns = (CELL_PX * count for count in CELLS)
    return np.nonzero(rng.random((rows, columns)) < 1 / 7)


def noise(rng: np.random.Generator) -> Heights:
    """By pixel: neighbours err alike, as they are of the same evidence."""
    shape = tuple(CELL_PX * count for count in CELLS)
    values = gaussian_filter(rng.standard_normal(shape), 3.5)
    return np.asarray(SIGMA_M * values / values.std(), np.float64)


def points(truth: Heights, errors: Heights, at: tuple[Any, Any]) -> Relief:
    n, empty = len(at[0]), (np.empty((0, 0), np.float32),) * 2
    sigma, one = np.full(n, SIGMA_M, np.float32), np.ones(n, np.float32)
    return Relief(
        *at, (truth + errors)[at], one, sigma, one, np.zeros(n, np.float32), empty, empty, empty[0]
    )


def relief(name: str) -> Heights:
    """A flat plate with a slope, one with a dent of 0.2 mm, one with a step; a cylinder."""
    rows, columns = (CELL_PX * count for count in CELLS)
    down, along = np.indices((rows, columns))
    y, x = PX_M * (down - rows / 2), PX_M * (along - columns / 2)
    flat = 0.02 * x - 0.01 * y
    made = {
        "flat": flat,
        "dent": flat + 0.2e-3 * np.exp(-(x**2 + y**2) / (2 * (0.4e-3) ** 2)),
        "step": flat + 0.2e-3 / (1 + np.exp(-x / 0.05e-3)),
        "cylinder": x**2 / (2 * 15e-3),
    }
    return np.asarray(made[name], np.float64)


def errors_um(name: str, seed: int = 1) -> tuple[Heights, Heights, tuple[Any, Any]]:
    """Errors before and after, and where."""
    rng = np.random.default_rng(seed)
    truth, at = relief(name), places(rng)
    given = points(truth, noise(rng), at)
    found = follow_wider(given, FIELD, EVIDENCE)
    return 1e6 * (given.offset - truth[at]), 1e6 * (found.offset - truth[at]), at


def test_a_flat_place_is_the_mean_of_more_depths() -> None:
    before, after, _ = errors_um("flat")
    assert after.std() < 0.6 * before.std()
    assert abs(after.mean()) < 1.0


@pytest.mark.parametrize("name", ["dent", "step"])
def test_relief_is_not_levelled(name: str) -> None:
    before, after, (row, column) = errors_um(name)
    rows, columns = (CELL_PX * count for count in CELLS)
    away = np.abs(column - columns / 2)
    if name == "dent":
        away = np.hypot(away, row - rows / 2)
    near = away < 0.4e-3 / PX_M
    assert np.sqrt((after[near] ** 2).mean()) < 1.25 * np.sqrt((before[near] ** 2).mean())
    # What is flat around it gains as elsewhere.
    far = away > 2.5e-3 / PX_M
    assert after[far].std() < 0.7 * before[far].std()


def test_a_surface_that_bends_evenly_stays_where_it_is() -> None:
    before, after, (row, column) = errors_um("cylinder")
    rows, columns = (CELL_PX * count for count in CELLS)
    inside = (abs(row - rows / 2) < rows / 4) & (abs(column - columns / 2) < columns / 4)
    assert abs(after[inside].mean() - before[inside].mean()) < 1.5
    assert after[inside].std() < before[inside].std()


@pytest.mark.parametrize("name", ["waves", "stairs"])
def test_a_surface_that_is_relief_all_over_is_not_taken_for_flat(name: str) -> None:
    rng = np.random.default_rng(3)
    rows, columns = (CELL_PX * count for count in CELLS)
    x = PX_M * np.arange(columns)
    if name == "waves":
        height = 0.1e-3 * np.sin(2 * np.pi * x / 1.5e-3)
    else:
        height = sum(
            0.25e-3 / (1 + np.exp((at - x) / 0.06e-3)) for at in np.arange(2e-3, 12e-3, 1e-3)
        )
    truth, at = np.tile(height, (rows, 1)), places(rng)
    given = points(truth, noise(rng), at)
    found = follow_wider(given, FIELD, EVIDENCE)
    before, after = (1e6 * (each.offset - truth[at]) for each in (given, found))
    assert np.sqrt((after**2).mean()) < 1.3 * np.sqrt((before**2).mean())


def test_points_that_follow_are_surer_and_stay_in_their_places() -> None:
    rng = np.random.default_rng(2)
    at = places(rng)
    given = points(relief("step"), noise(rng), at)
    found = follow_wider(given, FIELD, EVIDENCE)
    for name in ("row", "column", "confidence", "agreed"):
        np.testing.assert_array_equal(getattr(found, name), getattr(given, name))
    assert (found.sigma <= given.sigma).all()
    away = np.abs(at[1] - CELL_PX * CELLS[1] / 2)
    assert np.median(found.sigma[away > 2.5e-3 / PX_M]) < 0.9 * SIGMA_M
    assert np.median(found.sigma[away < 0.1e-3 / PX_M]) > 0.97 * SIGMA_M


def test_no_points_are_no_points() -> None:
    nowhere = np.empty(0, np.int64), np.empty(0, np.int64)
    flat = relief("flat")
    assert not len(follow_wider(points(flat, 0 * flat, nowhere), FIELD, EVIDENCE).row)


def textured(scans: Scans) -> SimulatedScan:
    scene = {"margin_mm": 2.0, "step_mm": 0.03, "defects": 4, "defect_kinds": ["dent"]}
    return scans.scan("defects", scene=scene, camera={"height": 96}, **COATINGS["textured"])


def test_surface_errs_less_for_it(scans: Scans) -> None:
    scan = textured(scans)
    area, errors_um = seen_area(scan), []
    for averages in (True, False):
        settings = SurfaceSettings.create({"average_flats": averages})
        sweep = SurfaceSweep(settings, scan.camera, scan.track)
        found = swept_points(sweep, scan)
        x, y, z = found[area.contains(*found[:, :2].T)].T
        errors_um.append(float(1e6 * np.abs(z - scan.truth.height_at(x, y)).mean()))
    assert errors_um[0] < 0.9 * errors_um[1]


def test_focus_errs_less_for_it(scans: Scans) -> None:
    scan = textured(scans)
    errors_um = []
    for averages in (True, False):
        settings = DepthSettings.create({"method": "focus", "average_flats": averages})
        pipeline = DepthPipeline(settings, scan.camera, scan.track)
        pipeline.add_events(steady(scan))
        tally = TruthTally(scan.truth)
        for found in pipeline.results(flush=True):
            if isinstance(found, DepthMap):
                tally.add(found)
        errors_um.append(tally.summary()["all"]["mae_um"])
    assert errors_um[0] < 0.98 * errors_um[1]

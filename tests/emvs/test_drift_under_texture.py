"""What is printed on the skin lies where it is: the slope tells nothing of its drift."""

from pathlib import Path

import numpy as np
import pytest

from emvs.textured_scans import steady, swept_points
from roller_core.parameter_files import read_parameters
from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.evidence import is_textured
from roller_emvs.evidence.surface_slope import evened_changes
from roller_emvs.evidence.sweep import Depths
from roller_emvs.lines.edge_drift import TERMS, EdgeDriftSettings, edge_drift
from roller_emvs.methods.surface import SurfacePatch, SurfaceSettings, SurfaceSweep
from roller_emvs.pipeline import DepthPipeline
from roller_evaluation.plate_surface import seen_area
from roller_sim.presets import COATINGS
from simulated_scans import Scans, SimulatedScan

CALIBRATION = Path(__file__).parents[2] / "config" / "virtual_cell_ring.yaml"


@pytest.fixture(scope="module")
def drift() -> EdgeDriftSettings:
    """The virtual ring's, by speed."""
    found = SurfaceSettings.create(
        {"edge_drift": read_parameters(CALIBRATION, "surface")["edge_drift"]}
    )
    return found.edge_drift


@pytest.fixture
def scan(scans: Scans) -> SimulatedScan:
    scene = {"margin_mm": 2.0, "step_mm": 0.03, "defects": 4, "defect_kinds": ["dent"]}
    return scans.scan("defects", scene=scene, camera={"height": 96}, **COATINGS["textured"])


@pytest.mark.parametrize(("share", "before", "textured"), [
    (0.95, False, True), (0.8, False, False), (0.6, True, True), (0.3, True, False),
])  # fmt: skip
def test_once_seen_a_print_shows_by_less(share: float, before: bool, textured: bool) -> None:
    offset = np.where(np.arange(1000).reshape(20, 50) < 1000 * share, 0, np.nan)
    offset = offset.astype(np.float32)
    depths = [Depths(offset, offset, offset, 0, 0, offset) for _ in range(2)]
    assert is_textured(depths, before) == textured


def test_a_print_goes_on_to_the_end_of_a_pass(scan: SimulatedScan) -> None:
    sweep = SurfaceSweep(SurfaceSettings.create({}), scan.camera, scan.track)
    sweep.add_events(steady(scan))
    patches = [p for p in sweep.results(flush=True) if isinstance(p, SurfacePatch)]
    first = [p.textured for p in patches].index(True)
    # The very last rows are seen by a part of the patch that shows next to nothing.
    assert all(p.textured for p in patches[first:-1])
    assert len(patches) - first > 4


def with_more_by_slope(drift: EdgeDriftSettings) -> EdgeDriftSettings:
    off, _, on, _ = drift.coefficients_m
    return drift.changed({"coefficients_m": (off, 2e-4, on, -2e-4), "even_m": (1e-4, 1e-4)})


@pytest.mark.parametrize("polarity", [0, 1])
def test_slopes_tell_nothing(drift: EdgeDriftSettings, polarity: int) -> None:
    full = with_more_by_slope(drift).changed({"side_m": (5e-5, 5e-5)})
    slope, change = np.linspace(-0.8, 0.8, 9), np.linspace(0.3, -0.3, 9)
    side = np.linspace(-1, 1, 9)
    expected = full.coefficients_m[2 * polarity] * change + full.side_m[polarity] * side
    for speed_m_s in (0.1, 0.3, 0.5):
        height, _ = edge_drift(full.under_texture(), polarity, slope, change, side, speed_m_s)
        np.testing.assert_allclose(height, expected, atol=1e-9)
    assert any(full.by_speed_s[1::TERMS])
    bare = EdgeDriftSettings.create({})
    assert bare.under_texture() == bare


def test_specks_around_tell_one_change_of_contrast() -> None:
    rng, shape = np.random.default_rng(2), (40, 60)
    change = (0.4 + rng.normal(0, 0.3, shape)).astype(np.float32)
    offset = np.where(rng.random(shape) < 0.6, 0, np.nan).astype(np.float32)
    told = change[np.isfinite(offset)].mean()
    change[np.isnan(offset)] = 9.0  # of cells without a depth nothing counts
    one, other = (Depths(offset, offset, offset, 0, 0, sign * change) for sign in (1, -1))
    for sign, found in zip((1, -1), evened_changes([one, other]), strict=True):
        inner = sign * found.change[8:-8, 8:-8]
        assert inner.mean() == pytest.approx(told, abs=0.01)
        assert inner.std() < 0.06
        np.testing.assert_array_equal(found.offset, offset)


def test_surface_takes_no_drift_by_slope_out(scan: SimulatedScan, drift: EdgeDriftSettings) -> None:
    found = []
    for own in (drift, with_more_by_slope(drift)):
        settings = SurfaceSettings.create({}).changed({"edge_drift": own.model_dump()})
        points = swept_points(SurfaceSweep(settings, scan.camera, scan.track), scan)
        # The first and the last rows were seen too shortly to show their texture.
        found.append(points[seen_area(scan).contains(*points[:, :2].T)])
    np.testing.assert_array_equal(*found)
    assert len(found[0]) > 1000


def test_focus_takes_no_drift_by_slope_out(scan: SimulatedScan, drift: EdgeDriftSettings) -> None:
    found = []
    for own in (drift, with_more_by_slope(drift)):
        settings = DepthSettings.create({"method": "focus"}).changed(
            {"edge_drift": own.model_dump()}
        )
        pipeline = DepthPipeline(settings, scan.camera, scan.track)
        pipeline.add_events(steady(scan))
        found.append([m.depth for m in pipeline.results(flush=True) if isinstance(m, DepthMap)])
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)
    assert found[0]

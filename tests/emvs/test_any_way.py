"""`surface` under a print: by rays as right as by parts, wherever in the range the surface lies."""

import numpy as np
import pytest

from emvs.textured_scans import swept_points
from roller_core.errors import SettingsError
from roller_emvs.methods.surface import SurfaceSettings, SurfaceSweep
from roller_evaluation.plate_surface import seen_area
from roller_sim.presets import COATINGS
from simulated_scans import Scans, SimulatedScan


@pytest.fixture
def scan(scans: Scans) -> SimulatedScan:
    scene, camera = {"margin_mm": 2.0, "step_mm": 0.03}, {"height": 320}
    return scans.scan("stairs", scene=scene, camera=camera, **COATINGS["textured"])


def points_of(scan: SimulatedScan, near_m: float, far_m: float) -> np.ndarray:
    """What a range of depths finds, shape (n, 3)."""
    depths = {"depth_min_m": near_m, "depth_max_m": far_m}
    settings = SurfaceSettings.create({**depths, "event_delay_s": 0.00043})
    return swept_points(SurfaceSweep(settings, scan.camera, scan.track), scan)


def errors_um(
    scan: SimulatedScan, near_m: float, far_m: float, least: int = 1000, ends: bool = False
) -> np.ndarray:
    """Of the points, which must be so many; with or without those of the first and last rows."""
    points = points_of(scan, near_m, far_m)
    points = points if ends else points[seen_area(scan).contains(*points[:, :2].T)]
    assert len(points) > least
    x, y, z = points.T
    return np.asarray(np.abs(z - scan.truth.height_at(x, y)) * 1e6)


@pytest.mark.scan
def test_rays_are_as_right_as_parts(scan: SimulatedScan, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sensor rows stay apart, whatever the plane: mixed they err by twice as much."""
    depths = 0.0435, 0.0485  # a millimetre before the middle
    by_parts = errors_um(scan, *depths, ends=True)
    monkeypatch.setattr("roller_emvs.methods.surface.sweep.fits", lambda *_: False)
    by_rays = errors_um(scan, *depths, int(0.9 * len(by_parts)), ends=True)
    assert by_rays.mean() < 1.25 * by_parts.mean()


@pytest.mark.scan
@pytest.mark.parametrize("depths", [(0.0435, 0.06), (0.043, 0.08), (0.03, 0.047)])
def test_the_surface_may_lie_anywhere_in_the_range(
    scan: SimulatedScan, depths: tuple[float, float]
) -> None:
    usual = errors_um(scan, 0.043, 0.047)
    errors = errors_um(scan, *depths, int(0.8 * len(usual)))
    assert np.median(errors) < 1.6 * np.median(usual)
    # The first and last rows were seen from elsewhere than a surface in the middle would be.
    assert (errors_um(scan, *depths, ends=True) > 500).mean() < 0.002


@pytest.mark.scan
def test_a_first_block_is_measured_where_it_turns_out_to_lie(scan: SimulatedScan) -> None:
    """Seen as in the middle of so wide a range its rows would be left out for 4 mm."""
    assert points_of(scan, 0.043, 0.2)[:, 0].min() < 0


def test_a_range_that_no_grid_suits_is_refused() -> None:
    with pytest.raises(SettingsError, match="more than 6 times as far"):
        SurfaceSettings.create({"depth_min_m": 0.01, "depth_max_m": 0.2})

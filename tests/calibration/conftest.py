"""Recordings that several tests of calibrations read."""

from pathlib import Path

import pytest

from calibration.scans import ROLLING, sphere_pass, write_scan
from roller_core.camera import Camera


@pytest.fixture(scope="session")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings, camera and parameters that all tests share."""
    folder = tmp_path_factory.mktemp("calibrate")
    # Dots are as bright as dots are: votes are scaled by their own extremes.
    write_scan(folder / "pass", sphere_pass())
    write_scan(folder / "beside", sphere_pass(across_m=0.0022))
    write_scan(folder / "plate", sphere_pass(dots=0, plate_dots=700))
    write_scan(folder / "few", sphere_pass(dots=6, plate_dots=0))
    ROLLING.to_yaml(folder / "camera.yaml")
    Camera(320, 140, 900.0, 900.0, 159.5, 69.5).to_yaml(folder / "other.yaml")
    (folder / "params.yaml").write_text("emvs: {ros__parameters: {paper.full_scale_votes: 0.0}}\n")
    return folder

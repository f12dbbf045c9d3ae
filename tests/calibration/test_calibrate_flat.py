"""`roller calibrate flat` on a scan of the virtual cell, ramps and all."""

from __future__ import annotations

from pathlib import Path

import pytest

from roller_bringup.cli import main
from roller_inspect.pipeline import InspectionSettings


def test_a_scan_with_ramps_gives_the_depth_range(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scan, file = tmp_path / "flat", tmp_path / "range.yaml"
    textured = ["--set", "light.speckle=0.08", "--set", "camera.height=160"]
    assert main(["simulate", "flat", "--speed", "0.3", *textured, "-o", str(scan)]) == 0
    assert main(["calibrate", "flat", str(scan), "-o", str(file)]) == 0
    assert "a margin of 0.5 mm" in capsys.readouterr().out
    settings = InspectionSettings.load(file)
    for part in (settings.depth, settings.surface):
        assert part.depth_min_m == pytest.approx(0.043, abs=1e-4)
        assert part.depth_max_m == pytest.approx(0.047, abs=1e-4)

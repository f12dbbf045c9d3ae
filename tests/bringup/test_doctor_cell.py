"""How far a cell is calibrated, by its files."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest

from roller_bringup.doctor.commissioning import CellFiles, check_commissioning
from roller_core.calibration_file import calibration_record, write_calibration
from roller_core.camera import Camera

CAMERA = Camera(640, 480, 1066.0, 1066.0, 320.0, 240.0)


@pytest.fixture
def files(tmp_path: Path) -> CellFiles:
    """A cell with all but the sphere and the edge drift."""
    out = CellFiles(tmp_path / "cell.yaml", tmp_path / "hand_eye.yaml", tmp_path / "camera.yaml")
    assert out.params is not None
    assert out.hand_eye is not None
    assert out.camera_info is not None
    CAMERA.to_yaml(out.camera_info)
    delay = calibration_record("", [], CAMERA, event_delay_s=4e-4, deviation_s=2e-5)
    write_calibration(out.params, "time_offset", [], {"emvs": {"event_delay_s": 4e-4}}, delay)
    flat = calibration_record("A7", [], CAMERA, plate_m=0.047)
    write_calibration(out.params, "flat", [], {"emvs": {"depth_min_m": 0.045}}, flat, out.params)
    pairs = calibration_record("", [], None, rms_m=2e-4, rms_deg=0.1, pairs=12)
    place = {"hand_eye_m": [0.01, 0.0, 0.08]}
    write_calibration(out.hand_eye, "hand_eye", [], {"ur10": place}, pairs)
    return out


def levels(files: CellFiles, now: datetime | None = None) -> dict[str, str]:
    return {r.name: r.level for r in check_commissioning(files, now)}


def test_each_step_says_whether_it_is_done_and_what_to_do_next(files: CellFiles) -> None:
    results = {r.name: r for r in check_commissioning(files)}
    assert {n for n, r in results.items() if r.level != "OK"} == {"edge drift"}
    assert "roller calibrate edge-drift" in results["edge drift"].advice
    assert "0.20 mm" in results["hand-eye"].found
    assert "4.00e-04" in results["time offset"].found
    assert set(levels(CellFiles()).values()) == {"warning", "OK"}


def test_what_is_old_of_another_skin_or_another_camera(files: CellFiles) -> None:
    later = datetime.now(timezone.utc) + timedelta(days=400)
    assert levels(files, later)["flat plate"] == "warning"
    assert files.params is not None
    record = calibration_record("B2", [], CAMERA, method="bma")
    write_calibration(files.params, "sphere", [], {"emvs": {}}, record, files.params)
    assert levels(files)["skin"] == "warning"
    assert files.camera_info is not None
    replace(CAMERA, fx=1200.0).to_yaml(files.camera_info)
    assert levels(files)["calibration"] == "fault"


def test_files_that_cannot_be_read_are_faults(files: CellFiles, tmp_path: Path) -> None:
    broken = tmp_path / "broken.yaml"
    broken.write_text("[1")
    found = levels(CellFiles(broken, broken, broken))
    assert {found[n] for n in ("intrinsics", "hand-eye", "calibration")} == {"fault"}
    empty = tmp_path / "empty.yaml"
    empty.write_text("/**/ur10:\n  ros__parameters: {}\n")
    assert levels(replace(files, hand_eye=empty))["hand-eye"] == "fault"

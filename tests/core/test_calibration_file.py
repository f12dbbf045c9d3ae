"""Calibration files: what was found before is carried over or kept, never lost."""

from pathlib import Path

import pytest

from roller_core.calibration_file import (
    calibration_record,
    check_same_camera,
    read_record,
    write_calibration,
)
from roller_core.camera import Camera, OtherCameraError
from roller_core.errors import SettingsError, UnwritableOutputError
from roller_core.parameter_files import read_parameters


def calibrate(path: Path, kind: str, base: Path | None = None, **values: float) -> None:
    write_calibration(path, kind, [], {"emvs": values}, calibration_record("", [], None), base)


def test_another_calibration_in_the_file_is_carried_over_or_stays(tmp_path: Path) -> None:
    cell = tmp_path / "cell.yaml"
    calibrate(cell, "flat", depth_min_m=0.042)
    calibrate(cell, "flat", depth_min_m=0.043)  # the same once more
    before = cell.read_text()
    with pytest.raises(UnwritableOutputError, match="holds the calibration 'flat' and 1 more, whi"):
        calibrate(cell, "time_offset", event_delay_s=4e-4)
    assert cell.read_text() == before
    (beside,) = (path for path in tmp_path.iterdir() if path != cell)
    assert read_parameters(beside, "emvs") == {"event_delay_s": 4e-4}
    calibrate(cell, "time_offset", cell, event_delay_s=4e-4)
    assert read_parameters(cell, "emvs") == {"depth_min_m": 0.043, "event_delay_s": 4e-4}
    assert all(read_record(cell, kind) for kind in ("flat", "time_offset"))


def test_what_was_changed_by_hand_stays_unless_it_was_read(tmp_path: Path) -> None:
    cell = tmp_path / "cell.yaml"
    calibrate(cell, "flat", depth_min_m=0.042, depth_max_m=0.047)
    cell.write_text(cell.read_text().replace("0.047", "0.049 # my own"))
    with pytest.raises(UnwritableOutputError, match="was changed since roller wrote it"):
        calibrate(cell, "flat", depth_min_m=0.043, depth_max_m=0.047)
    assert "0.049 # my own" in cell.read_text()
    calibrate(cell, "time_offset", cell, event_delay_s=4e-4)
    assert read_parameters(cell, "emvs")["depth_max_m"] == 0.049


def test_another_camera_is_seen_without_the_record_too(tmp_path: Path) -> None:
    cell, camera = tmp_path / "cell.yaml", Camera(640, 480, 1066.0, 1066.0, 319.5, 239.5)
    text = "surface: {ros__parameters: {calibrated_camera: %s}}"
    for same in ([0.0], list(camera.intrinsics)):
        cell.write_text(text % same)
        check_same_camera(cell, camera)
    cell.write_text(text % [640.0, 480.0, 900.0, 900.0, 319.5, 239.5])
    with pytest.raises(OtherCameraError, match=r"parameters of 'surface' .* another camera"):
        check_same_camera(cell, camera)
    cell.write_text(text % "5")
    with pytest.raises(SettingsError, match="calibrated_camera of 'surface' can't be read"):
        check_same_camera(cell, camera)

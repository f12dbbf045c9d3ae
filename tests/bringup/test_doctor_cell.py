"""How far a cell is calibrated, by its files."""

import json
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest

from roller_bringup.doctor.commissioning import CellFiles, check_commissioning, next_step
from roller_bringup.doctor.machine import HostSettings, find_host, judge_host
from roller_bringup.doctor.result import Result
from roller_core.calibration_file import SECTION, calibration_record, write_calibration
from roller_core.camera import Camera
from roller_core.parameter_files import read_parameters

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
    left = {n for n, r in results.items() if r.level != "OK"}
    assert left == {"edge drift", "acceptance"}
    assert "roller calibrate edge-drift" in results["edge drift"].advice
    assert "0.20 mm" in results["hand-eye"].found
    assert "0.400 ± 0.020 ms" in results["time offset"].found
    assert "47.00 mm" in results["flat plate"].found
    new = {r.name: r for r in check_commissioning(CellFiles())}
    assert {r.level for r in new.values()} == {"warning", "OK"}
    # There is no file yet that the first could go on with.
    assert "--params" not in new["time offset"].advice
    assert "--params cell.yaml" in new["flat plate"].advice


def test_a_place_that_a_scan_turned_is_still_that_of_its_pairs(files: CellFiles) -> None:
    place = files.hand_eye
    assert place is not None
    turn = calibration_record("", [], None, turn_deg=[0.1, 0.0, 0.5])
    ur10 = {"ur10": read_parameters(place, "ur10")}
    write_calibration(place, "hand_eye_turn", [], ur10, turn, place)
    found = {r.name: r for r in check_commissioning(files)}["hand-eye"]
    assert found.level == "OK"
    assert "12 pairs" in found.found
    assert f"turned by a scan, {turn['date'][:10]}" in found.found
    # Pairs that were recorded since know nothing of that turn.
    pairs = calibration_record("", [], None, rms_m=2e-4, rms_deg=0.1, pairs=9)
    pairs["date"] = "2999-01-01T00:00:00"
    write_calibration(place, "hand_eye", [], ur10, pairs, place)
    found = {r.name: r for r in check_commissioning(files)}["hand-eye"]
    assert "9 pairs" in found.found
    assert "turned" not in found.found


def test_the_next_step_is_said(files: CellFiles) -> None:
    after = next_step(check_commissioning(files))
    assert after.startswith("next is edge drift, see docs/commissioning.md: roller calibrate edge")
    assert next_step(check_commissioning(CellFiles())).startswith("next is intrinsics")
    assert next_step([Result("camera", "fault", "none"), Result("hand-eye", "OK", "")]) == ""


def test_files_that_are_still_to_be_made_are_steps_to_go(tmp_path: Path) -> None:
    """As on the first day of a cell, with the command of the page on commissioning."""
    names = "cell.yaml", "hand_eye.yaml", "camera.yaml", "golden", "certificate"
    named = {r.name: r for r in check_commissioning(CellFiles(*(tmp_path / n for n in names)))}
    new = {r.name: r for r in check_commissioning(CellFiles())}
    assert {n: r.level for n, r in named.items()} == {n: r.level for n, r in new.items()}
    for step in ("intrinsics", "hand-eye", "time offset", "acceptance"):
        assert named[step].found.endswith("isn't there")
        assert named[step].advice.startswith("roller calibrate ")
    assert "--params" not in named["time offset"].advice


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


def test_a_certificate_holds_for_the_calibration_it_was_made_with(
    files: CellFiles, tmp_path: Path
) -> None:
    assert files.params is not None
    dates = {k: r["date"] for k, r in read_parameters(files.params, SECTION).items()}
    record = calibration_record(
        "",
        [],
        CAMERA,
        verdict="accepted",
        reasons=[],
        gauges={"sphere": {"reached": {"error_m": 3e-5}}, "plate": {"reached": {"error_m": 9e-6}}},
        calibrations=dates,
    )
    path = tmp_path / "certificate.json"

    def result(**changed: object) -> Result:
        path.write_text(json.dumps({**record, **changed}))
        return {r.name: r for r in check_commissioning(replace(files, certificate=tmp_path))}[
            "acceptance"
        ]

    assert result().level == "OK"
    assert "errors of 30 µm on the sphere, 9 µm on the plate" in result().found
    assert "calibrated again" in result(calibrations={}).found
    assert result(date="2020-01-01T00:00:00Z").level == "warning"
    refused = result(verdict="not accepted", reasons=["too little was seen"])
    assert (refused.level, refused.found) == ("fault", "not accepted: too little was seen")
    assert result(gauges=None).level == "fault"


def test_a_golden_scan_that_cannot_be_read_is_a_fault(files: CellFiles, tmp_path: Path) -> None:
    assert levels(files)["golden scan"] == "OK"
    assert levels(replace(files, golden=tmp_path))["golden scan"] == "fault"


def test_the_hosts_settings_are_read_and_judged(tmp_path: Path) -> None:
    for name, text in (
        ("proc/sys/net/core/rmem_max", "212992"),
        ("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "powersave"),
        ("sys/kernel/realtime", "1"),
    ):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text(text + "\n")
    found = find_host(tmp_path)
    assert (found.governor, found.socket_bytes, found.realtime_kernel) == (
        "powersave",
        212992,
        True,
    )
    slow = judge_host(found)
    assert slow.level == "warning"
    assert "cpupower" in slow.advice
    assert "rmem_max" in slow.advice
    assert judge_host(HostSettings("performance", 1 << 24, False, 0)).level == "OK"
    assert judge_host(find_host(tmp_path / "nothing")).level == "OK"


def test_files_that_cannot_be_read_are_faults(files: CellFiles, tmp_path: Path) -> None:
    broken = tmp_path / "broken.yaml"
    broken.write_text("[1")
    found = levels(CellFiles(broken, broken, broken))
    assert {found[n] for n in ("intrinsics", "hand-eye", "calibration")} == {"fault"}
    empty = tmp_path / "empty.yaml"
    empty.write_text("/**/ur10:\n  ros__parameters: {}\n")
    assert levels(replace(files, hand_eye=empty))["hand-eye"] == "fault"

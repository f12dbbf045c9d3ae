"""What `roller inspect teach` refuses to learn from."""

import json
from pathlib import Path
from typing import Any

import pytest

from recording.bags import Recipe, write_bag
from roller_bringup.cli import main

Capture = pytest.CaptureFixture[str]


def teach(tmp_path: Path, *words: str) -> int:
    return main(["inspect", "teach", *words, "--output", str(tmp_path / "golden")])


@pytest.mark.parametrize(
    ("inspection", "totals", "why"),
    [
        ({"faults": ["bag: breaks off"]}, {}, "bag: breaks off"),
        ({"contact": ["slipping: the image moves"]}, {}, "slipping: the image moves"),
        ({}, {"packets": 80, "lost_packets": 20}, "20% of the event packets were lost"),
    ],
)
def test_a_result_with_faults(
    inspection: dict[str, Any], totals: dict[str, int], why: str, tmp_path: Path, capsys: Capture
) -> None:
    scan = tmp_path / "scan"
    scan.mkdir()
    (scan / "height_map.npz").touch()
    (scan / "inspection.json").write_text(json.dumps(inspection))
    (scan / "report.json").write_text(json.dumps({"totals": totals}))
    assert teach(tmp_path, str(scan)) == 1
    assert f"nothing is learnt from a scan with faults: {why}" in capsys.readouterr().err


def test_a_scan_of_which_packets_are_missing(tmp_path: Path, capsys: Capture) -> None:
    def every_fourth(topic: str, n: int, message: Any) -> Any:
        return None if topic == "/event_camera/events" and n % 4 == 1 else message

    source = write_bag(tmp_path / "scan", Recipe(edit=every_fourth))
    assert teach(tmp_path, str(source)) == 1
    assert "% of the event packets were lost" in capsys.readouterr().err


def test_a_calibration_of_another_camera(tmp_path: Path, capsys: Capture) -> None:
    made = {"width": 320, "height": 120, "model": "plumb_bob", "distortion": [0.0] * 5}
    record = {"edge_drift": {"camera": made | {"intrinsics": [700.0, 700.0, 160.0, 60.0]}}}
    params = tmp_path / "cell.yaml"
    params.write_text(json.dumps({"/**/calibration": {"ros__parameters": record}}))
    assert teach(tmp_path, str(write_bag(tmp_path / "scan")), "--params", str(params)) == 1
    assert "was calibrated with another camera" in capsys.readouterr().err


def test_parameters_of_the_inspection(tmp_path: Path, capsys: Capture) -> None:
    """As `roller inspect` takes them: when a part ends, and the recipe."""
    params = tmp_path / "cell.yaml"
    words = (str(write_bag(tmp_path / "scan")), "--params", str(params))
    params.write_text("inspect:\n  ros__parameters: {idle_flush: 60.0}\n")
    assert teach(tmp_path, *words) == 1
    assert "idle_flush" in capsys.readouterr().err
    params.write_text(f"inspect:\n  ros__parameters: {{recipe: {tmp_path}/none.yaml}}\n")
    assert teach(tmp_path, *words) == 1
    assert "none.yaml" in capsys.readouterr().err

"""What `roller inspect teach` refuses to learn from."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from recording.bags import Recipe, write_bag
from roller_bringup.cli import main

from .boss_part import map_of, part

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


SETTINGS = {
    "surface": {"event_delay_s": 0.0, "edge_drift": {"off": [0.0]}, "threads": 1},
    "emvs": {"method": "focus"},
}


def result(
    folder: Path, seed: int, camera: str = "ours", grid_m: float = 1e-4, **report: Any
) -> str:
    """As much of an inspection's result as a reference is taught from."""
    folder.mkdir()
    map_of(part, seed).save(folder / "height_map.npz")
    inspection = {"traceability": {"camera": camera}, "recipe": {"grid_m": grid_m}}
    (folder / "inspection.json").write_text(json.dumps(inspection))
    written = {"method": "surface", "settings": SETTINGS} | report
    (folder / "report.json").write_text(json.dumps(written))
    return str(folder)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"settings": SETTINGS | {"surface": {"event_delay_s": 4e-4}}},
         r"other settings \(surface\.event_delay_s\)"),
        ({"method": "focus"}, "method focus, not surface"),
        ({"camera": "another"}, "camera another, not ours"),
        ({"grid_m": 2e-4}, "grid_m 0.0002, not 0.0001"),
    ],
)  # fmt: skip
def test_results_that_were_measured_otherwise(
    change: dict[str, Any], why: str, tmp_path: Path, capsys: Capture
) -> None:
    good = [result(tmp_path / name, k) for k, name in enumerate(("one", "two"))]
    other = result(tmp_path / "other", 3, **change)
    assert teach(tmp_path, *good, other) == 1
    said = rf"error: {other} was measured otherwise than {good[0]}: {why}; "
    assert re.match(said, capsys.readouterr().err)
    assert not (tmp_path / "golden").exists()
    # What doesn't matter to the surface may differ, and what isn't known is believed.
    machine = {"surface": SETTINGS["surface"] | {"threads": 2}, "emvs": {"method": "bma"}}
    fine = result(tmp_path / "fine", 4, settings=machine)
    bare = result(tmp_path / "bare", 5, camera="", grid_m=0.0, method="", settings={})
    assert teach(tmp_path, *good, fine, bare) == 0


def test_options_that_results_dont_keep_to(tmp_path: Path, capsys: Capture) -> None:
    good = [result(tmp_path / name, k) for k, name in enumerate(("one", "two"))]
    params, recipe = tmp_path / "cell.yaml", tmp_path / "recipe.yaml"
    params.write_text("/**/surface: {ros__parameters: {event_delay_s: 0.0004}}\n")
    recipe.write_text("schema: roller-recipe/1\ngrid_m: 2.0e-4\n")
    for words, why in (
        (("--params", str(params)), "than the options ask for: other settings (surface.event_del"),
        (("--method", "bma"), "than the options ask for: method surface, not bma"),
        (("--recipe", str(recipe)), "than --recipe: grid_m 0.0001, not 0.0002"),
    ):
        assert teach(tmp_path, *good, *words) == 1
        assert f"error: {good[0]} was measured otherwise {why}" in capsys.readouterr().err

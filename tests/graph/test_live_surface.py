"""The method `surface` in the live graph, in separate processes over DDS."""

import json
from pathlib import Path

import pytest

from graph.graph_world import check_keys
from roller_bringup.demo_inspection import inspect_recorded
from roller_bringup.launching import load
from roller_bringup.live import run_until_done
from roller_emvs.ply import read_ply
from roller_inspect.recipe import Recipe
from roller_inspect.results.recorded import gather
from roller_inspect.results.run_report import Report

pytestmark = pytest.mark.graph

LAUNCH = Path(__file__).resolve().parents[2] / "launch" / "virtual.launch.xml"
POINTS = "/roller/surface/points"
SURFACE = "{min_aperture_m: 0.009, threads: 1}"
STATUS, INSPECTED = "surface: points", "inspect: findings"


def test_virtual_cell_to_surface(domain: int, tmp_path: Path) -> None:
    """Virtual cell, surface and recorder: near the truth, nothing lost."""
    overrides = tmp_path / "overrides.yaml"
    cell = (
        f"{{truth_output: {tmp_path / 'truth'}, "
        "scene: {margin_mm: 4.0, width_mm: 6.0, step_mm: 0.04}, camera: {height: 180}}"
    )
    # A part that is finished later than the outputs are quiet is waited for.
    late = "inspect:\n  ros__parameters: {idle_flush_s: 4.0}\n"
    overrides.write_text(f"virtual_cell:\n  ros__parameters: {cell}\n{late}")
    arguments = {
        "scene": "stairs", "speed": "0.1", "method": "surface", "braille": "false",
        "inspect": "true",
        "params": str(overrides), "record": "true", "output": str(tmp_path / "bag"),
    }  # fmt: skip
    seen = run_until_done(load(LAUNCH, arguments), timeout_s=240)
    report = Report("live", "surface", {})
    gather(tmp_path / "bag", tmp_path, tmp_path / "truth", report)
    assert report.totals["lag_s"] >= 0
    written = json.loads((tmp_path / "report.json").read_text())

    stairs = written["truth"]["objects"]["stairs"]
    assert stairs["points"] > 5000
    assert stairs["near_edge_mae_um"] < 60
    assert stairs["edges_measured"] > 0.7

    check_keys(STATUS, seen.statuses[STATUS][1])
    figures = {name: int(v) for name, v in seen.statuses[STATUS][1].items() if v.isdigit()}
    for name in (
        "lost_packets", "late_events", "dropped_events", "dropped_messages", "faults",
        "waiting_events", "waiting_messages",
    ):  # fmt: skip
        assert figures[name] == 0, name
    # The first and the last events lie outside the robot's poses.
    assert figures["events_without_pose"] < 1e-3 * figures["events"]
    assert figures["blocks"] >= report.totals["depth_windows"] == seen.received[POINTS]
    # Every block gave its account, every event is in one.
    assert len(report.windows) == figures["blocks"] + figures["refused_blocks"]
    assert sum(w["cpu_ms"] for w in report.windows) > 0
    assert sum(w["points"] for w in report.windows) == figures["points"]
    # Every point once: in the clouds, in the recording and in the file.
    assert figures["points"] == written["totals"]["surface_points"]
    assert figures["points"] == len(read_ply(tmp_path / "surface.ply")["x"])
    assert "/roller/depth/camera_info" not in seen.received
    # A plain coating shows the edges alone: the part, finished when nothing more comes, says so.
    check_keys(INSPECTED, seen.statuses[INSPECTED][1])
    assert seen.statuses[INSPECTED][1]["verdict"] == "unmeasured"
    assert int(seen.statuses[INSPECTED][1]["points"]) == figures["points"]
    assert seen.received["/roller/inspection/findings"] > 1
    # From its recording it is judged as it was live.
    again = inspect_recorded(tmp_path / "bag", Recipe.create({}), "again").judgement
    assert again.verdict == "unmeasured"
    measured = float(seen.statuses[INSPECTED][1]["measured"])
    assert again.coverage.measured == pytest.approx(measured, abs=0.02)

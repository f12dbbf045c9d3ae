"""The whole chain over DDS: virtual cell to depth, cloud and text, in separate processes."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graph.graph_world import Processes, Watcher, check_keys
from roller_braille.braille_stage import BrailleStage
from roller_bringup.launching import load
from roller_bringup.live import run_until_done
from roller_core.stage import Stage
from roller_emvs.depth_stage import DepthStage
from roller_emvs.ply import read_ply
from roller_emvs.stitcher_stage import StitcherStage
from roller_emvs.surface_stage import SurfaceStage
from roller_inspect.inspect_stage import InspectStage
from roller_inspect.results.recorded import gather
from roller_inspect.results.run_report import Report
from roller_ros import qos
from roller_ros.stage_node import StageNode

pytestmark = pytest.mark.graph

LAUNCH = Path(__file__).resolve().parents[2] / "launch" / "virtual.launch.xml"


def test_virtual_cell_to_text(watch: Callable[..., Watcher], tmp_path: Path) -> None:
    overrides = tmp_path / "overrides.yaml"
    overrides.write_text(
        "virtual_cell:\n"
        "  ros__parameters:\n"
        f"    truth_output: {tmp_path / 'truth'}\n"
        "    scene: {text: 'dfhj', margin_mm: 3.0, step_mm: 0.03}\n"
        "    camera: {width: 280, height: 166, focal_px: 711.0}\n"
    )
    plan = load(
        LAUNCH,
        {
            "scene": "braille",
            "speed": "0.3",
            "params": str(overrides),
            "record": "true",
            "output": str(tmp_path / "bag"),
        },
    )
    seen = run_until_done(plan, timeout_s=240)
    report = Report("live", "focus", {})
    gather(tmp_path / "bag", tmp_path, tmp_path / "truth", report)
    written = json.loads((tmp_path / "report.json").read_text())
    assert written["totals"]["braille_text"] == ["dfhj"]
    assert written["truth"]["text"] == "dfhj"
    # The account of each window came with it.
    windows = [w for w in written["windows"] if w["points"]]
    assert len(windows) == written["totals"]["depth_windows"]
    for window in windows:
        assert window["events"] > 0
        assert window["end_s"] > window["start_s"]
        assert window["cpu_ms"] > 0
        assert window["milliseconds"]["total"] > 0
    braille = written["truth"]["objects"]["braille"]
    assert braille["points"] > 2000
    assert braille["mae_um"] < 300
    cloud = read_ply(tmp_path / "surface.ply")
    assert len(cloud["x"]) > 2000
    # Dots are 0.48 mm high.
    assert np.percentile(cloud["height"], 98) < 0.8e-3
    depth = seen.statuses["emvs: depth"][1]
    assert int(depth["lost_packets"]) == 0
    assert int(depth["dropped_events"]) == 0
    assert seen.received["/roller/braille/cells"] == 4
    assert written["totals"]["depth_windows"] == int(depth["windows"])
    # Of depth maps the observer takes the cameras, not their megabytes; the last comes again. No
    # scan waits for it, so on busy cores it may miss the first.
    assert 1 <= seen.received["/roller/depth/camera_info"] <= int(depth["windows"]) + 1
    assert "/roller/depth/image" not in seen.received
    for status in ("virtual_cell: scan", "braille: text"):
        check_keys(status, seen.statuses[status][1])
    # Four letters give hardly enough to see the factor by; if it is found, it is right.
    travel_scale = seen.statuses["braille: text"][1]["travel_scale"]
    assert travel_scale == "" or float(travel_scale) == pytest.approx(1.0, abs=0.03)


def test_publishers_offer_what_the_contract_says(
    watch: Callable[..., Watcher], processes: Processes
) -> None:
    """Reliability and durability of every topic, asked of the graph itself."""
    watcher = watch()
    node = watcher.node
    processes.start(
        "virtual_cell", "{scene: {name: flat}, wait_s: 60.0, subscribers: 9, prepare: false}"
    )
    stages: list[type[Stage[Any]]] = [
        DepthStage, StitcherStage, SurfaceStage, BrailleStage, InspectStage
    ]  # fmt: skip
    made = [StageNode(kind, context=node.context) for kind in stages]
    expected = {
        "/event_camera/events": qos.EVENTS,
        "/event_camera/camera_info": qos.LATCHED,
        "/tf": qos.TF,
        "/tf_static": qos.TF_STATIC,
        "/roller/depth/image": qos.DEPTH,
        "/roller/depth/confidence": qos.DEPTH,
        "/roller/depth/sigma": qos.DEPTH,
        "/roller/depth/camera_info": qos.DEPTH,
        "/roller/depth/account": qos.DEPTH,
        "/roller/surface/account": qos.DEPTH,
        "/roller/surface/points": qos.SURFACE,
        "/roller/surface/map": qos.LATCHED,
        "/roller/braille/cells": qos.BRAILLE,
        "/roller/braille/text": qos.TEXT,
        "/roller/braille/markers": qos.MARKERS,
        "/roller/inspection/findings": qos.LATCHED,
        "/roller/inspection/markers": qos.LATCHED,
        "/roller/inspection/deviation": qos.SURFACE,
    }
    watcher.spin_until(
        lambda: all(node.get_publishers_info_by_topic(t) for t in expected), 90, "publishers"
    )
    for topic, profile in expected.items():
        for info in node.get_publishers_info_by_topic(topic):
            offered = info.qos_profile
            assert offered.reliability == profile.reliability, topic
            assert offered.durability == profile.durability, topic
    for one in made:
        one.destroy_node()

"""The method `surface` in the live graph, in separate processes over DDS."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Reader

from graph.graph_world import Processes, Watcher, check_keys
from recording.bags import write_bag
from roller_bringup.cli import main
from roller_bringup.launching import load
from roller_bringup.live import run_until_done
from roller_core.bags import typestore
from roller_emvs.ply import read_ply
from roller_inspect.results.recorded import gather
from roller_inspect.results.run_report import Report

pytestmark = pytest.mark.graph

LAUNCH = Path(__file__).resolve().parents[2] / "launch" / "virtual.launch.xml"
POINTS = "/roller/surface/points"
SURFACE = "{min_aperture_m: 0.009, threads: 1}"
STATUS = "surface: points"


def test_virtual_cell_to_surface(domain: int, tmp_path: Path) -> None:
    """Virtual cell, surface and recorder: near the truth, nothing lost."""
    overrides = tmp_path / "overrides.yaml"
    cell = (
        f"{{truth_output: {tmp_path / 'truth'}, subscribers: 2, pose_subscribers: 2, "
        "scene: {margin_mm: 4.0}}"
    )
    overrides.write_text(f"virtual_cell:\n  ros__parameters: {cell}\n")
    arguments = {
        "scene": "stairs", "speed": "0.3", "method": "surface", "braille": "false",
        "params": str(overrides), "record": "true", "output": str(tmp_path / "bag"),
    }  # fmt: skip
    seen = run_until_done(load(LAUNCH, arguments), timeout_s=240)
    report = Report("live", "surface", {})
    gather(tmp_path / "bag", tmp_path, tmp_path / "truth", report)
    written = json.loads((tmp_path / "report.json").read_text())

    stairs = written["truth"]["objects"]["stairs"]
    assert stairs["points"] > 8000
    assert stairs["near_edge_mae_um"] < 60
    assert stairs["edges_measured"] > 0.8

    check_keys(STATUS, seen.statuses[STATUS][1])
    figures = {name: int(v) for name, v in seen.statuses[STATUS][1].items() if v.isdigit()}
    for name in (
        "lost_packets", "late_events", "dropped_events", "dropped_messages", "faults",
        "waiting_events", "waiting_messages",
    ):  # fmt: skip
        assert figures[name] == 0, name
    # The first and the last events lie outside the robot's poses.
    assert figures["events_without_pose"] < 1e-3 * figures["events"]
    assert figures["blocks"] >= len(report.windows) == seen.received[POINTS]
    # Every point once: in the clouds, in the recording and in the file.
    assert figures["points"] == written["totals"]["surface_points"]
    assert figures["points"] == len(read_ply(tmp_path / "surface.ply")["x"])
    assert "/roller/depth/image" not in seen.received


def test_replay_equals_live(
    processes: Processes, watch: Callable[..., Watcher], tmp_path: Path
) -> None:
    """One bag through the live node and through the replay: the same clouds, byte by byte."""
    bag = write_bag(tmp_path / "scan")
    params = tmp_path / "params.yaml"
    params.write_text(f"surface:\n  ros__parameters: {SURFACE}\n")
    words = ["replay", str(bag), "--output", str(tmp_path / "out"), "--no-picture"]
    words += ["--no-braille", "--method", "surface"]
    assert main([*words, "--params", str(params)]) == 0
    expected = replayed_clouds(tmp_path / "out")
    assert len(expected) >= 2

    watcher = watch(POINTS)
    processes.start("surface", SURFACE)
    watcher.spin_until(lambda: bool(watcher.statuses[STATUS]), 60, "start of surface")
    assert "waiting for event_camera/camera_info" in watcher.messages_of(STATUS)
    processes.start("player", f"{{bag: {bag}, pose_subscribers: 1}}")
    clouds = watcher.seen[POINTS]
    watcher.spin_until(lambda: len(clouds) >= len(expected), 60, "all clouds")
    late = watch(POINTS)
    late.spin_until(lambda: len(late.seen[POINTS]) >= len(expected), 20, "the clouds for RViz")
    points = sum(m.width for m in clouds)
    watcher.spin_until(lambda: watcher.value(STATUS, "points") == points, 20, "the last figures")
    assert watcher.value(STATUS, "lost_packets") == 0

    assert [described(m) for m in clouds] == expected
    assert [described(m) for m in late.seen[POINTS]] == expected
    for message in clouds:
        assert message.header.frame_id == "base"
        assert [f.name for f in message.fields] == ["x", "y", "z", "height", "confidence"]
    assert set(processes.stop().values()) == {0}


def described(message: Any) -> tuple[int, int, bytes]:
    """Stamp, number of points and the points themselves."""
    stamp = message.header.stamp
    nanoseconds = int(stamp.sec) * 10**9 + int(stamp.nanosec)
    return nanoseconds, int(message.width), np.asarray(message.data, np.uint8).tobytes()


def replayed_clouds(output: Path) -> list[tuple[int, int, bytes]]:
    store, found = typestore(), []
    with Reader(output / "result") as reader:
        for connection, _, data in reader.messages():
            if connection.topic == POINTS:
                found.append(described(store.deserialize_cdr(data, connection.msgtype)))
    return found

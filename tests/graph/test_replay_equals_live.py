"""One bag through the live graph and through the replay gives the same."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from tf2_msgs.msg import TFMessage

from graph.graph_world import Processes, Watcher
from recording.bags import Recipe, write_bag
from roller_bringup.cli import main
from roller_core.bags import typestore
from roller_emvs.ply import read_ply
from roller_ros import qos

pytestmark = pytest.mark.graph

#: A machine that stalls for a second must not make the nodes take it for the scan's end.
DEPTH = "{window.travel_m: 0.006, focus.sigma_px: 3.0, idle_flush_s: 4.0}"
STITCHER = "{idle_flush_s: 5.5}"
TOPICS = (
    "/roller/depth/image",
    "/roller/depth/confidence",
    "/roller/depth/camera_info",
    "/roller/surface/points",
    "/event_camera/events",
)


def test_replay_equals_live(
    processes: Processes, watch: Callable[..., Watcher], tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / "scan")
    params = tmp_path / "params.yaml"
    params.write_text(f"emvs:\n  ros__parameters: {DEPTH}\n")
    words = ["replay", str(bag), "--output", str(tmp_path / "out"), "--no-picture"]
    assert main([*words, "--params", str(params)]) == 0
    expected = replayed_depths(tmp_path / "out")
    assert len(expected) >= 3

    watcher = watch(*TOPICS)
    processes.start("emvs", DEPTH)
    processes.start("stitcher", STITCHER)
    processes.start("recorder", f"{{output: {tmp_path / 'live'}}}")
    # Who begins late to hear the robot has other windows, or leaves depth maps out.
    ready = ("emvs: depth", "stitcher: surface", "recorder: recording")
    watcher.spin_until(lambda: all(watcher.statuses[n] for n in ready), 60, "start of the nodes")
    processes.start("player", f"{{bag: {bag}, subscribers: 3, pose_subscribers: 3}}")
    seen = watcher.seen
    watcher.spin_until(
        lambda: len(seen["/roller/depth/image"]) >= len(expected), 60, "all depth maps"
    )
    stitched = "stitcher: surface"
    watcher.spin_until(
        lambda: watcher.value(stitched, "depth_maps") == len(expected)
        and watcher.value(stitched, "voxels_in_view") == 0
        and sum(m.width for m in seen[TOPICS[3]]) == watcher.value(stitched, "points") > 0,
        60, "the surface",
    )  # fmt: skip
    watcher.check_keys(
        "emvs: depth", "stitcher: surface", "player: playback", "recorder: recording"
    )
    assert watcher.value("emvs: depth", "lost_packets") == 0
    assert watcher.value("emvs: depth", "events") > 0

    live = {stamp_of(m): pixels_of(m) for m in seen["/roller/depth/image"]}
    assert list(live) == list(expected)
    for stamp, depth in live.items():
        np.testing.assert_array_equal(depth, expected[stamp])
    for message in seen["/roller/depth/image"]:
        assert message.encoding == "32FC1"
        assert message.header.frame_id == "event_camera_optical_frame"
    assert [stamp_of(m) for m in seen["/roller/depth/camera_info"]] == list(expected)

    clouds = [np.frombuffer(m.data, np.float32).reshape(-1, 5) for m in seen[TOPICS[3]]]
    rows = np.concatenate(clouds)
    surface = read_ply(tmp_path / "out" / "surface.ply")
    assert len(rows) == len(surface["x"])
    order_live, order_file = (
        np.lexsort(rows[:, :3].T),
        np.lexsort(np.stack([surface[k].astype(np.float32) for k in "xyz"])),
    )
    np.testing.assert_allclose(rows[order_live, 2], surface["z"][order_file], atol=1e-6)
    assert all(m.header.frame_id == "base" for m in seen[TOPICS[3]])

    codes = processes.stop()
    assert set(codes.values()) == {0}, codes
    check_recording(tmp_path / "live", bag)


def check_recording(recorded: Path, bag: Path) -> None:
    """The recorder wrote every packet, and its bag replays."""
    counts = []
    for path in (bag, recorded):
        with Reader(path) as reader:
            names = {c.topic: c.msgcount for c in reader.connections}
            counts.append((names["/event_camera/events"], names["/tf"], names["/tf_static"]))
    assert counts[0] == counts[1]
    words = ["replay", str(recorded), "--output", str(recorded.parent / "again"), "--no-picture"]
    assert main(words) == 0


def stamp_of(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def pixels_of(message: Any) -> np.ndarray:
    return np.frombuffer(message.data, np.float32).reshape(message.height, message.width)


def replayed_depths(output: Path) -> dict[int, np.ndarray]:
    store, found = typestore(), {}
    with Reader(output / "result") as reader:
        for connection, _, data in reader.messages():
            if connection.topic == "/roller/depth/image":
                message = store.deserialize_cdr(data, connection.msgtype)
                found[stamp_of(message)] = pixels_of(message)
    return found


def test_nodes_report_and_go_on(
    processes: Processes, watch: Callable[..., Watcher], tmp_path: Path
) -> None:
    """Broken packets and a gap in the poses: a diagnostic each, and depth before and after."""
    from dataclasses import replace

    def edit(topic: str, n: int, message: Any) -> Any:
        if topic == "/event_camera/events" and n == 5:
            return replace(message, events=message.events[:-1])
        if topic == "/event_camera/events" and n == 6:
            return replace(message, encoding="evt9")
        if topic == "/event_camera/events" and n == 7:
            return replace(message, width=64)
        if topic == "/event_camera/events" and n == 8:
            return None
        if topic == "/tf" and n == 4:
            message.transforms[0].transform.rotation.w = 0.0
            message.transforms[0].transform.rotation.x = 0.0
            message.transforms[0].transform.rotation.y = 0.0
            message.transforms[0].transform.rotation.z = 0.0
        return message

    bag = write_bag(tmp_path / "scan", Recipe(edit=edit))
    watcher = watch("/roller/depth/image")
    processes.start("emvs", DEPTH)
    watcher.spin_until(lambda: bool(watcher.statuses["emvs: depth"]), 60, "start of emvs")
    assert "waiting for event_camera/camera_info" in watcher.messages_of("emvs: depth")
    processes.start("player", f"{{bag: {bag}, pose_subscribers: 1}}")
    status = "emvs: depth"
    watcher.spin_until(
        lambda: len(watcher.seen["/roller/depth/image"]) >= 3, 60, "depth in spite of faults"
    )
    watcher.spin(1.5)
    said = " / ".join(watcher.messages_of(status))
    for part in ("no whole number", "'evt9'", "64×120 px", "quaternion is zero"):
        assert part in said, said
    # One packet is missing; the broken ones and the one between decoders count as lost too.
    assert watcher.value(status, "lost_packets") >= 1
    assert watcher.value(status, "faults") == 4
    assert watcher.value(status, "decode_errors") == 3
    assert processes.stop()["emvs"] == 0


def test_two_that_publish_the_robots_poses_are_told_and_one_is_followed(
    processes: Processes, watch: Callable[..., Watcher], tmp_path: Path
) -> None:
    """Poses of a second node, elsewhere and in between, leave the depth as it is."""
    bag = write_bag(tmp_path / "scan")
    words = ["replay", str(bag), "--output", str(tmp_path / "out"), "--no-picture"]
    params = tmp_path / "params.yaml"
    params.write_text(f"emvs:\n  ros__parameters: {DEPTH}\n")
    assert main([*words, "--params", str(params)]) == 0
    expected = replayed_depths(tmp_path / "out")
    watcher = watch("/roller/depth/image", "/tf")
    other = watcher.node.create_publisher(TFMessage, "/tf", qos.TF)
    processes.start("emvs", DEPTH)
    processes.start("stitcher")
    watcher.spin_until(
        lambda: bool(watcher.statuses["emvs: depth"] and watcher.statuses["stitcher: surface"]),
        60, "start of the nodes",
    )  # fmt: skip
    processes.start("player", f"{{bag: {bag}, pose_subscribers: 3}}")
    # A second robot begins to talk as soon as the first has, and goes on.
    watcher.spin_until(lambda: bool(watcher.seen["/tf"]), 30, "poses")
    answered = 0
    status = "emvs: depth"

    def disturb() -> bool:
        nonlocal answered
        for message in watcher.seen["/tf"][answered:]:
            if message.transforms[0].transform.translation.z < 5.0:
                strange = copy.deepcopy(message)
                strange.transforms[0].transform.translation.z += 10.0
                other.publish(strange)
        answered = len(watcher.seen["/tf"])
        return len(watcher.seen["/roller/depth/image"]) >= len(expected)

    watcher.spin_until(disturb, 60, "depth in spite of the other")
    for name in (status, "stitcher: surface"):
        watcher.spin_until(
            lambda name=name: any("publish base -> tool0" in m for m in watcher.messages_of(name)),
            10, "the fault",
        )  # fmt: skip
        told = next(m for m in watcher.messages_of(name) if "publish base -> tool0" in m)
        assert "/player and /watcher publish" in told
        assert "/player is followed" in told
        assert watcher.value(name, "foreign_poses") > 0
    live = {stamp_of(m): pixels_of(m) for m in watcher.seen["/roller/depth/image"]}
    assert list(live) == list(expected)
    for stamp, depth in live.items():
        np.testing.assert_array_equal(depth, expected[stamp])


def test_a_source_that_starts_again_is_followed(
    processes: Processes, watch: Callable[..., Watcher], tmp_path: Path
) -> None:
    """The same bag played twice into one graph: time jumps back, depth comes twice."""
    bag = write_bag(tmp_path / "scan")
    watcher = watch("/roller/depth/image")
    processes.start("emvs", DEPTH)
    watcher.spin_until(lambda: bool(watcher.statuses["emvs: depth"]), 60, "start of emvs")
    processes.start(
        "player", f"{{bag: {bag}, pose_subscribers: 1, exit_when_done: true, linger_s: 6.0}}"
    )
    player = processes.running["player"]
    watcher.spin_until(lambda: player.poll() is not None, 60, "end of the first playing")
    assert player.poll() == 0
    first = [stamp_of(m) for m in watcher.seen["/roller/depth/image"]]
    assert len(first) >= 3
    # A later recording of the same: everything ten seconds earlier.
    earlier = write_bag(tmp_path / "earlier", Recipe(edit=ten_seconds_earlier))
    processes.start("player", f"{{bag: {earlier}, pose_subscribers: 1}}")
    watcher.spin_until(
        lambda: len(watcher.seen["/roller/depth/image"]) >= 2 * len(first), 60, "depth once more"
    )
    again = [stamp_of(m) for m in watcher.seen["/roller/depth/image"]][len(first) :]
    assert [s + 10 * 10**9 for s in again] == first


def ten_seconds_earlier(topic: str, n: int, message: Any) -> Any:
    stamped = message.transforms if hasattr(message, "transforms") else [message]
    headers = [item.header for item in stamped]
    for header in headers:
        header.stamp.sec -= 10
    return message


@pytest.mark.parametrize(
    ("name", "parameters", "message"),
    [
        ("emvs", "{paper.planes: 1}", "planes"),
        ("emvs", "{depth_min_m: 0.05}", "depth_min_m"),
        ("emvs", "{method: magic}", "method"),
        ("emvs", "{method: surface}", "it has a node of its own, 'surface'"),
        ("surface", "{depth_min_m: 0.05}", "depth_min_m"),
        ("player", "{bag: /nowhere}", "there is no such file or folder"),
        ("player", "{}", "'bag' is empty"),
        ("recorder", "{output: /proc/nowhere}", "can't be written"),
    ],
)
def test_bad_parameters_stop_a_node_with_one_line(
    processes: Processes, watch: Callable[..., Watcher], name: str, parameters: str, message: str
) -> None:
    processes.start(name, parameters)
    assert processes.running[name].wait(timeout=60) == 1
    assert message in processes.log(name)
    assert "Traceback" not in processes.log(name)

"""One bag through the live graph and through the replay gives the same."""

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from event_camera_msgs.msg import EventPacket
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from graph.graph_world import Processes, Watcher
from recording.bags import read_messages, write_bag
from roller_bringup.cli import main
from roller_emvs.ply import read_ply
from roller_ros import qos

pytestmark = pytest.mark.graph

#: A machine that stalls for a second must not make the nodes take it for the scan's end.
DEPTH = "{window.travel_m: 0.006, focus.sigma_px: 3.0, idle_flush_s: 4.0}"
STITCHER = "{idle_flush_s: 5.5, map.folder: %s/maps}"
MAP = "/roller/surface/map"
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
    processes.start("stitcher", STITCHER % tmp_path)
    processes.start("recorder", f"{{output: {tmp_path / 'live'}}}")
    # Who begins late to hear the robot has other windows, or leaves depth maps out.
    ready = ("emvs: depth", "stitcher: surface", "recorder: recording")
    watcher.spin_until(lambda: all(watcher.statuses[n] for n in ready), 60, "start of the nodes")
    times: list[Clock] = []
    watcher.node.create_subscription(Clock, "/clock", times.append, qos.REPEATED)
    listeners = "subscribers: 4, listeners: 'emvs, stitcher, recorder'"
    processes.start("player", f"{{bag: {bag}, {listeners}, clock: true}}")
    watcher.spin_until(lambda: watcher.node.count_publishers("/clock") > 0, 60, "/clock")
    # The fourth: what the player learns of last, so it knows who listens to /clock.
    watcher.node.create_subscription(EventPacket, TOPICS[4], lambda _: None, qos.EVENTS)
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
    check_parameters(watcher, "emvs", "stitcher", "player", "recorder")
    late = watch(TOPICS[3], MAP)
    late.spin_until(
        lambda: len(late.seen[TOPICS[3]]) >= len(seen[TOPICS[3]]) and len(late.seen[MAP]) > 0,
        20, "the clouds for RViz",
    )  # fmt: skip
    check_map(late, tmp_path / "out" / "result", tmp_path / "maps")
    watcher.check_keys(
        "emvs: depth", "stitcher: surface", "player: playback", "recorder: recording"
    )
    assert watcher.value("emvs: depth", "lost_packets") == 0
    assert watcher.value("emvs: depth", "events") > 0
    # The bag is old: how late its depth is means nothing.
    assert watcher.statuses["emvs: depth"][-1][1]["window_latency_s"] == ""
    check_clock(times, bag)

    live = {stamp_of(m): pixels_of(m) for m in seen["/roller/depth/image"]}
    assert list(live) == list(expected)
    for stamp, depth in live.items():
        np.testing.assert_array_equal(depth, expected[stamp])
    for message in seen["/roller/depth/image"]:
        assert message.encoding == "32FC1"
        assert message.header.frame_id == "event_camera_optical_frame"
    stamps = list(expected)
    told = [stamp_of(m) for m in seen["/roller/depth/camera_info"]]
    assert told == [*stamps, stamps[-1]]  # once more after the last

    clouds = [np.frombuffer(m.data, np.float32).reshape(-1, 6) for m in seen[TOPICS[3]]]
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


def check_map(late: Watcher, result: Path, folder: Path) -> None:
    """Who comes late sees the scan, as the replay has it; it is saved and cleared on request."""
    (shown,) = late.seen[MAP]
    ((_, expected),) = read_messages(result, MAP)
    assert bytes(shown.data) == bytes(expected.data)
    assert [f.name for f in shown.fields] == ["x", "y", "z", "height", "confidence", "sigma"]
    saved = late.call("/stitcher/save", Trigger, Trigger.Request())
    assert saved.success
    assert [str(path) for path in folder.iterdir()] == [saved.message]
    assert len(read_ply(saved.message)["x"]) == shown.width > 1000
    assert late.call("/stitcher/clear", Trigger, Trigger.Request()).success
    late.spin_until(lambda: late.seen[MAP][-1].width == 0, 20, "the empty map")
    refused = late.call("/stitcher/save", Trigger, Trigger.Request())
    assert (refused.success, refused.message) == (False, "the map is empty: nothing is saved")


def check_clock(times: list[Clock], bag: Path) -> None:
    """/clock goes through the bag's time."""
    told = [time.clock.sec * 10**9 + time.clock.nanosec for time in times]
    with Reader(bag) as reader:
        begin, end = reader.start_time, reader.end_time
    assert len(told) > 2
    assert begin <= told[0] < told[-1] <= end
    assert told == sorted(set(told))


def check_parameters(watcher: Watcher, *nodes: str) -> None:
    """Every node lists, describes and gives its parameters over its services."""
    for node in nodes:
        listed = watcher.call(f"/{node}/list_parameters", ListParameters, ListParameters.Request())
        names = listed.result.names
        assert len(names) > 3, node
        described = watcher.call(
            f"/{node}/describe_parameters",
            DescribeParameters,
            DescribeParameters.Request(names=names),
        )
        assert [d.name for d in described.descriptors] == names
        values = watcher.call(
            f"/{node}/get_parameters", GetParameters, GetParameters.Request(names=names)
        ).values
        assert len(values) == len(names)


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
    images = read_messages(output / "result", "/roller/depth/image")
    return {stamp_of(message): pixels_of(message) for _, message in images}


def test_two_that_publish_the_robots_poses_are_reported_and_one_is_followed(
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
    processes.start("player", f"{{bag: {bag}, listeners: 'emvs, stitcher, watcher'}}")
    # A second robot begins to talk soon after the first has, and goes on.
    watcher.spin_until(lambda: len(watcher.seen["/tf"]) > 3, 30, "poses")
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
        reported = next(m for m in watcher.messages_of(name) if "publish base -> tool0" in m)
        assert "/player and /watcher publish" in reported
        assert "/player is followed" in reported
        assert watcher.value(name, "foreign_poses") > 0
    live = {stamp_of(m): pixels_of(m) for m in watcher.seen["/roller/depth/image"]}
    assert list(live) == list(expected)
    for stamp, depth in live.items():
        np.testing.assert_array_equal(depth, expected[stamp])

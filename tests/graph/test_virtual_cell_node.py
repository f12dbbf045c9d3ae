"""The virtual cell as a node: two of them in one graph, and one that can't start."""

import time

import pytest

pytest.importorskip("rclpy")

from event_camera_msgs.msg import EventPacket
from sensor_msgs.msg import CameraInfo, Image

from roller_core.event_stream import EventStream
from roller_core.outputs import stamp_ns
from roller_ros import qos
from roller_sim.truth_files import load_truth

pytestmark = pytest.mark.graph

SETTINGS = (
    "scene: {name: three_lines, margin_mm: 1.5, width_mm: 6.0}, "
    "camera: {width: 80, height: 48}, motion: {speed: 0.3, hold_s: 0.05}"
)


def test_two_cells_scan_in_one_graph(processes, watch, tmp_path):
    watcher = watch("/tf", "/tf_static")
    topics = {}
    for side in ("left", "right"):
        for name, kind, quality in (
            ("events", EventPacket, qos.EVENTS),
            ("camera_info", CameraInfo, qos.LATCHED),
            ("image_raw", Image, qos.PREVIEW),
        ):
            keep = topics[side, name] = []
            topic = f"/{side}/event_camera/{name}"
            watcher.node.create_subscription(kind, topic, keep.append, quality)
        parameters = (
            f"{SETTINGS}, tf_prefix: {side}_, sensor_frame: {side}_camera, "
            f"truth_output: {tmp_path / side}, exit_when_done: {str(side == 'left').lower()}"
        )
        processes.start("virtual_cell", f"{{{parameters}}}", side)
    left = processes.running["left/virtual_cell"]
    watcher.spin_until(lambda: left.poll() is not None, 120, "end of the left cell")
    assert left.poll() == 0
    watcher.spin_until(
        lambda: "finished" in watcher.messages_of("right/virtual_cell: scan"),
        120,
        "end of the right cell",
    )
    assert processes.stop()["right/virtual_cell"] == 0
    for side in ("left", "right"):
        stream = EventStream(80, 48)
        for m in topics[side, "events"]:
            stream.push(
                m.encoding, m.width, m.height, m.seq, stamp_ns(m), m.time_base,
                m.events,
            )  # fmt: skip
        assert stream.counts.events > 1000
        assert stream.counts.lost_packets == 0
        assert topics[side, "camera_info"][0].width == 80
        assert topics[side, "image_raw"][0].encoding == "mono8"
        fixed = [t for m in watcher.seen["/tf_static"] for t in m.transforms]
        frames = {(t.header.frame_id, t.child_frame_id) for t in fixed}
        assert (f"{side}_tool0_controller", f"{side}_camera") in frames
        moved = [t for m in watcher.seen["/tf"] for t in m.transforms]
        own = [t for t in moved if t.child_frame_id == f"{side}_tool0_controller"]
        assert {t.header.frame_id for t in own} == {f"{side}_base"}
        stamps = [stamp_ns(t) for t in own]
        truth = load_truth(tmp_path / side)
        assert truth.start_ros_ns < stamps[0] < stamps[-1] < truth.start_ros_ns + 10**9
        assert abs(truth.start_ros_ns - time.time_ns()) < 600e9


def test_an_unknown_scene_is_refused_in_one_line(processes):
    processes.start("virtual_cell", "{scene: {name: cube}}")
    assert processes.running["virtual_cell"].wait(timeout=120) == 1
    assert "error: no scene 'cube'; there are demo" in processes.log("virtual_cell")

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip("rclpy")

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from event_camera_msgs.msg import EventPacket
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from roller_core.event_stream import EventStream
from roller_ros import messages, qos
from roller_sim.truth import Truth

pytestmark = pytest.mark.graph

NODE = "import sys; from roller_sim.virtual_cell_node import main; main()"
PARAMETERS = """
virtual_cell:
  ros__parameters:
    settle_s: 0.3
    linger_s: 0.3
    truth_output: {truth}
    scene: {{name: {scene}, margin_mm: 1.5, width_mm: 6.0}}
    camera: {{width: 80, height: 48}}
    motion: {{speed: 0.3, hold_s: 0.05}}
    exit_when_done: {exit}
"""


class Cell:
    """The node in a process of its own, and an observer of its topics."""

    def __init__(self, tmp_path, domain, scene="three_lines", leave=False):
        self.truth = tmp_path / "truth"
        file = tmp_path / "cell.yaml"
        text = PARAMETERS.format(scene=scene, truth=self.truth, exit=str(leave).lower())
        file.write_text(text)
        self.process = subprocess.Popen(
            [sys.executable, "-c", NODE, "--ros-args", "--params-file", str(file)],
            stderr=subprocess.PIPE,
            text=True,
        )
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node("observer", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.seen = {name: [] for name in ("events", "info", "image", "tf", "static", "states")}
        for name, kind, topic, quality in (
            ("events", EventPacket, "/event_camera/events", qos.EVENTS),
            ("info", CameraInfo, "/event_camera/camera_info", qos.LATCHED),
            ("image", Image, "/event_camera/image_raw", qos.PREVIEW),
            ("tf", TFMessage, "/tf", qos.TF),
            ("static", TFMessage, "/tf_static", qos.TF_STATIC),
        ):
            self.node.create_subscription(kind, topic, self.seen[name].append, quality)
        self.node.create_subscription(
            DiagnosticArray, "/diagnostics", self._diagnose, qos.DIAGNOSTICS
        )

    def _diagnose(self, message):
        for status in message.status:
            if status.name == "virtual_cell: scan":
                self.seen["states"].append(status.message)

    def spin(self, until, seconds=40.0):
        end = time.monotonic() + seconds
        while time.monotonic() < end and not until():
            self.executor.spin_once(timeout_sec=0.05)

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()
        for sign in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            if self.process.poll() is not None:
                break
            self.process.send_signal(sign)
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                continue
        return self.process.returncode


def test_node_scans_and_says_when_it_is_done(tmp_path, domain):
    cell = Cell(tmp_path, domain)
    try:
        cell.spin(lambda: "finished" in cell.seen["states"])
        assert cell.seen["states"][-1] == "finished"
        assert cell.process.poll() is None
    finally:
        code = cell.close()
    assert code == 0
    seen = cell.seen
    stream = EventStream(80, 48)
    for m in seen["events"]:
        stream.push(
            m.encoding, m.width, m.height, m.seq, messages.to_ns(m.header.stamp), m.time_base,
            m.events,
        )  # fmt: skip
    assert stream.counts.events > 1000
    assert stream.counts.lost_packets == 0
    assert (seen["info"][0].width, seen["image"][0].encoding) == (80, "mono8")
    (fixed,) = seen["static"][0].transforms
    assert (fixed.header.frame_id, fixed.child_frame_id) == (
        "tool0_controller",
        "event_camera_optical_frame",
    )
    stamps = [messages.to_ns(m.transforms[0].header.stamp) for m in seen["tf"]]
    truth = Truth.load(cell.truth)
    assert truth.start_ros_ns < stamps[0] < stamps[-1] < truth.start_ros_ns + 10**9
    assert abs(truth.start_ros_ns - time.time_ns()) < 60e9


def test_node_ends_by_itself_when_told_to(tmp_path, domain):
    cell = Cell(tmp_path, domain, leave=True)
    try:
        cell.spin(lambda: cell.process.poll() is not None)
        assert cell.process.poll() == 0
    finally:
        cell.close()


def test_node_refuses_an_unknown_scene_in_one_line(tmp_path, domain):
    cell = Cell(tmp_path, domain, scene="cube")
    try:
        assert cell.process.wait(40) == 1
        assert "error: no scene 'cube'; there are demo" in cell.process.stderr.read()
    finally:
        cell.close()

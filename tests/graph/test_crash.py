"""A fault of ours in a node's work ends its process with one line, at once."""

import pytest

pytest.importorskip("rclpy")

from event_camera_msgs.msg import EventPacket

from graph.forked import ForkedProcess
from roller_ros import qos

pytestmark = pytest.mark.graph


@pytest.mark.parametrize(("error", "traceback"), [("ValueError", False), ("BaseException", True)])
def test_a_worker_that_dies_ends_the_node(watch, tmp_path, monkeypatch, error, traceback):
    watcher = watch()
    publisher = watcher.node.create_publisher(EventPacket, "/event_camera/events", qos.EVENTS)
    watcher.node.create_timer(0.05, lambda: publisher.publish(EventPacket()))
    monkeypatch.setenv("BROKEN_NODE", error)
    monkeypatch.setenv("ROLLER_TRACEBACK", str(int(traceback)))
    process = ForkedProcess("graph.broken_node", [], tmp_path / "log")
    try:
        watcher.spin_until(lambda: process.poll() is not None, 60, "end of the node")
    finally:
        process.kill()
    lines = (tmp_path / "log").read_text().splitlines()
    # How many messages waited may follow: on a busy machine some have.
    (end,) = [i for i, line in enumerate(lines) if line.startswith("error: ")]
    assert process.poll() == 1
    assert lines[end].startswith(f"error: {error}: not foreseen (a fault of roller, the node ends")
    assert bool(end) == traceback
    assert traceback == any("take_packet" in text for text in lines[:end])

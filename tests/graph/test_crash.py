"""A fault of ours in a node's work ends its process with one line, at once."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")

from event_camera_msgs.msg import EventPacket

from roller_ros import qos

pytestmark = pytest.mark.graph

NODE = """
import sys
from roller_emvs.depth_stage import DepthStage
from roller_ros.node_main import run_node
from roller_ros.stage_node import StageNode

class Broken(DepthStage):
    def warm_up(self):
        pass

    def take_packet(self, packet):
        raise {error}("not\\nforeseen")

sys.exit(run_node(lambda: StageNode(Broken)))
"""


@pytest.mark.parametrize(("error", "traceback"), [("ValueError", False), ("BaseException", True)])
def test_a_worker_that_dies_ends_the_node(watch, error, traceback):
    watcher = watch()
    publisher = watcher.node.create_publisher(EventPacket, "/event_camera/events", qos.EVENTS)
    watcher.node.create_timer(0.05, lambda: publisher.publish(EventPacket()))
    environment = {k: v for k, v in os.environ.items() if k != "ROLLER_TRACEBACK"}
    if traceback:
        environment["ROLLER_TRACEBACK"] = "1"
    process = subprocess.Popen(
        [sys.executable, "-c", NODE.format(error=error)],
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )
    try:
        watcher.spin_until(lambda: process.poll() is not None, 60, "end of the node")
        *before, line = process.communicate()[1].strip().splitlines()
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 1
    assert line.startswith(f"error: {error}: not foreseen (a fault of roller, the node ends")
    assert bool(before) == traceback
    assert traceback == any("take_packet" in text for text in before)

"""The runner with real ROS 2 nodes: names, remappings and parameters arrive."""

from __future__ import annotations

import io
import os
import sys
import time

import pytest

from roller_bringup import launching
from roller_bringup.launching import Runner
from roller_bringup.launching.output import Screen

pytest.importorskip("rclpy")
pytestmark = [pytest.mark.graph, pytest.mark.xdist_group("graph")]

NODE = """
import sys
import rclpy
from rclpy.node import Node
from std_msgs.msg import String

from roller_ros.node_main import run_node


class Relay(Node):
    def __init__(self):
        super().__init__("unnamed", automatically_declare_parameters_from_overrides=True)
        value = self.get_parameter("value").value
        self.publisher = self.create_publisher(String, "out", 10)
        self.create_subscription(String, "in", lambda m: print("heard", m.data, flush=True), 10)
        self.create_timer(0.1, lambda: self.publisher.publish(String(data=f"{value!r}")))
        print("I am", self.get_fully_qualified_name(), flush=True)


sys.exit(run_node(Relay))
"""


def test_nodes_talk_and_stop(world, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(100 + os.getpid() % 100))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    program = world.files / "relay.py"
    program.write_text(NODE)
    world.script("relay", f'exec {sys.executable} {program} "$@"')
    (world.files / "p.yaml").write_text(
        "/**: {ros__parameters: {value: wildcard}}\nb: {ros__parameters: {value: from file}}\n"
    )
    path = world.launch(
        """
        <group><push-ros-namespace namespace="left"/>
        <node pkg="demo" exec="relay" name="a">
          <param name="value" value="0.5"/><remap from="in" to="/right/said"/>
        </node></group>
        <node pkg="demo" exec="relay" name="b">
          <param from="$(dirname)/p.yaml"/>
          <remap from="out" to="/right/said"/><remap from="in" to="/left/out"/>
        </node>
        """
    )
    text = io.StringIO()
    with Runner(launching.load(path), Screen(text)) as runner:
        deadline = time.monotonic() + 30
        wanted = ("[a] I am /left/a", "[b] I am /b", "[a] heard 'from file'", "[b] heard 0.5")
        while not all(line in text.getvalue() for line in wanted):
            assert runner.poll() is None, text.getvalue()
            assert time.monotonic() < deadline, text.getvalue()
            time.sleep(0.05)
        assert runner.stop() == 0
    assert runner.exit_codes == {"a": 0, "b": 0}, text.getvalue()

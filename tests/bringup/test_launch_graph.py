"""The runner with real ROS 2 nodes: names, namespaces and parameters arrive."""

import io
import sys
from pathlib import Path

import pytest

from roller_bringup import launching
from roller_bringup.launching import Runner
from roller_bringup.launching.process import Screen
from waiting import wait_until

pytest.importorskip("rclpy")
pytestmark = pytest.mark.graph

NODE = """
import sys
from pathlib import Path
from std_msgs.msg import String

from roller_ros.node import RollerNode
from roller_ros.node_main import run_node


class Relay(RollerNode):
    def __init__(self):
        super().__init__("unnamed", automatically_declare_parameters_from_overrides=True)
        words = [self.get_parameter(name).value for name in ("a", "b", "c")]
        self.publisher = self.create_publisher(String, "said", 10)
        self.create_subscription(String, "said", lambda m: print("heard", m.data, flush=True), 10)
        self.create_timer(0.1, lambda: self.publisher.publish(String(data=f"{words}")))
        print("I am", self.get_fully_qualified_name(), flush=True)


sys.exit(run_node(Relay))
"""
CELL = """
<arg name="namespace"/>
<group><push-ros-namespace namespace="$(var namespace)"/>
  <node pkg="demo" exec="relay" name="relay">
    <param from="{0}/config.yaml"/><param from="{0}/arguments.yaml" allow_substs="true"/>
    <param from="{0}/mine.yaml"/>
  </node>
</group>
"""


def test_two_cells_in_one_graph(world, domain):
    program = world.files / "relay.py"
    program.write_text(NODE)
    world.script("relay", f'exec {sys.executable} {program} "$@"')
    for name, values in (
        ("config", "{a: 1, b: 1, c: none}"),
        ("arguments", "{b: 2, c: '$(var namespace)'}"),
        ("mine", "{a: 3}"),
    ):
        path = world.files / f"{name}.yaml"
        path.write_text(f"/**/relay:\n  ros__parameters: {values}\n")
    part = world.launch(CELL.format(world.files), "part.launch.xml")
    cells = (
        f'<include file="{part}"><arg name="namespace" value="{name}"/></include>'
        for name in ("left", "right", "")
    )
    text = io.StringIO()
    with Runner(launching.load(world.launch("".join(cells))), Screen(text)) as runner:
        wanted = {
            f"[{label}] {said}"
            for label, cell in (("left/relay", "left"), ("right/relay", "right"), ("relay", ""))
            for said in (f"I am /{label}", f"heard [3, 2, '{cell}']")
        }

        def heard_all() -> bool:
            assert runner.poll() is None, text.getvalue()
            return wanted <= set(text.getvalue().splitlines())

        wait_until(heard_all, text.getvalue)
        assert runner.stop() == 0
    heard = {line for line in text.getvalue().splitlines() if "heard" in line}
    assert len(heard) == 3, heard
    assert set(runner.exit_codes.values()) == {0}, text.getvalue()


@pytest.mark.parametrize("name", ['it\'s #1: "x"', "123", "true"])
def test_ros_reads_names_of_launch_arguments_as_they_are(name, domain):
    """What our files write is a text for ROS's own reader of parameter files too."""
    from rclpy import init
    from rclpy.context import Context
    from rclpy.node import Node

    path = Path(__file__).parents[2] / "launch" / "virtual.launch.xml"
    given = {"record": "true", "inspect": "true", "output": name, "recipe": name, "scene": name}
    wanted = {"recorder": "output", "inspect": "recipe", "virtual_cell": "scene.name"}
    with launching.load(path, given) as plan:
        for process in plan.processes:
            if process.name in wanted:
                context = Context()
                init(args=list(process.command), context=context)
                ours = Node(
                    process.name,
                    context=context,
                    automatically_declare_parameters_from_overrides=True,
                )
                assert ours.get_parameter(wanted[process.name]).value == name
                ours.destroy_node()
                context.try_shutdown()

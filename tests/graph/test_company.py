"""A graph is not started where one of its nodes runs already."""

from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from roller_bringup.launching import LaunchPlan, NodeProcess
from roller_bringup.live import GraphError, check_no_duplicate_nodes

pytestmark = pytest.mark.graph


def test_a_second_graph_is_refused(watch):
    watcher = watch()
    plan = LaunchPlan(Path("test.launch.xml"))
    plan.processes.append(NodeProcess("emvs", ("true",), {}))
    check_no_duplicate_nodes(plan)
    plan.processes.append(NodeProcess(watcher.node.get_name(), ("true",), {}))
    with pytest.raises(GraphError, match=r"already running in ROS domain .*: watcher; stop"):
        check_no_duplicate_nodes(plan, wait_s=5.0)
    plan.close()

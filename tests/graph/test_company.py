"""A graph is not started where one of its nodes runs already."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from roller_bringup.launching import LaunchPlan, NodeProcess
from roller_bringup.live import GraphError, refuse_company

pytestmark = [pytest.mark.graph, pytest.mark.xdist_group("graph")]


def test_a_second_graph_is_refused(watch):
    watcher = watch()
    plan = LaunchPlan(Path("test.launch.xml"))
    plan.processes.append(NodeProcess("emvs", ("true",), {}))
    refuse_company(plan)
    plan.processes.append(NodeProcess(watcher.node.get_name(), ("true",), {}))
    with pytest.raises(GraphError, match=r"already running in ROS domain .*: watcher; stop"):
        refuse_company(plan, wait_s=5.0)
    plan.close()

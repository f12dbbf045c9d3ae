"""`roller view` beside a graph: it shows what is published, and misses a node that ends."""

import http.client
import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest
from rclpy.node import Node
from roller_msgs.msg import Finding, FindingArray

from graph.graph_world import Processes, Watcher
from roller_core import outputs
from roller_core.outputs import Cloud, Output
from roller_core.pose_track import Pose
from roller_emvs.patch import SURFACE_FIELDS
from roller_inspect.inspect_stage import DEVIATION_FIELDS
from roller_ros import messages, topics

pytestmark = pytest.mark.graph


@pytest.fixture
def port(domain: int) -> Iterator[int]:
    """Of a server that runs."""
    command = [sys.executable, "-m", "roller_bringup.cli", "view", "--port", "0"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as run:
        assert run.stdout is not None
        found = re.search(r"http://127\.0\.0\.1:(\d+)/", run.stdout.readline())
        assert found, run.stderr and run.stderr.read()
        try:
            yield int(found[1])
        finally:
            run.send_signal(2)
            _, said = run.communicate(timeout=60)
    # Ctrl-C ends it with the browser still looking on.
    assert run.returncode in (0, 130), said
    assert "Traceback" not in said
    assert "--namespace left shows another cell; shown is that without a namespace" in said


class Source:
    """Publishes what a rolling cell does."""

    def __init__(self, node: Node) -> None:
        results = (outputs.SURFACE_POINTS, outputs.BRAILLE_TEXT, outputs.DEPTH_IMAGE)
        inspected = (outputs.FINDINGS, outputs.DEVIATION)
        names = (*results, *inspected, outputs.TF, outputs.WRENCH)
        self._publishers = {name: topics.publisher(node, name) for name in names}
        self.x_m = 0.0

    def roll(self) -> None:
        now = time.time_ns()
        self.x_m += 0.005  # twenty times a second: 0.1 m/s
        pose = messages.transform(
            Pose(np.array([now * 1e-10 % 1e3, 0, 0]), np.array([0, 0, 0, 1.0])), now, "base",
            "tool0_controller",
        )  # fmt: skip
        self._publishers[outputs.TF].publish(topics.BY_NAME[outputs.TF].type(transforms=[pose]))
        wrench = topics.BY_NAME[outputs.WRENCH].type()
        wrench.wrench.force.z = -25.0
        self._publishers[outputs.WRENCH].publish(wrench)
        rng = np.random.default_rng(int(self.x_m * 1e6))
        rows = rng.uniform(0, 1e-4, (200, len(SURFACE_FIELDS)))
        rows[:, :2] = rng.uniform(0, (0.005, 0.01), (200, 2))
        rows[:, 0] += self.x_m
        found = Finding(id=7, kind="dent", verdict="nonconform", depth=-2e-4)
        found.depth_uncertainty, found.area_uncertainty = 2e-5, np.nan
        found.center.x = self.x_m
        listed = FindingArray(verdict="nonconform", measured=0.5, unmeasured=0.5, findings=[found])
        self._publishers[outputs.FINDINGS].publish(listed)
        cells = np.column_stack([rows[:, :3], rows[:, 3:4], np.ones(200), np.full(200, 2)])
        depth = np.full((480, 640), 0.03, np.float32)
        for name, data in (
            (outputs.SURFACE_POINTS, Cloud(rows.astype(np.float32), SURFACE_FIELDS)),
            (outputs.DEVIATION, Cloud(cells.astype(np.float32), DEVIATION_FIELDS)),
            (outputs.BRAILLE_TEXT, "plate seven"),
            (outputs.DEPTH_IMAGE, depth),
        ):
            self._publishers[name].publish(messages.to_message(Output(name, now, "base", data)))

    def publish_nonsense(self) -> None:
        """A force, a pose, a point and shares that aren't finite."""
        wrench, tf = topics.BY_NAME[outputs.WRENCH].type(), topics.BY_NAME[outputs.TF].type()
        place, turn = np.array([np.nan, 0, 0]), np.array([0, 0, 0, 1.0])
        tf.transforms.append(
            messages.transform(Pose(place, turn), time.time_ns(), "base", "tool0_controller")
        )
        wrench.wrench.force.z = np.nan
        self._publishers[outputs.WRENCH].publish(wrench)
        self._publishers[outputs.TF].publish(tf)
        rows = np.full((2, len(SURFACE_FIELDS)), np.nan, np.float32)
        points = Output(outputs.SURFACE_POINTS, time.time_ns(), "base", Cloud(rows, SURFACE_FIELDS))
        self._publishers[outputs.SURFACE_POINTS].publish(messages.to_message(points))
        self._publishers[outputs.FINDINGS].publish(FindingArray(measured=np.nan))


def refuse(name: str) -> None:
    """NaN is a number to Python's JSON, and to no browser's."""
    raise AssertionError(f"{name} in what the page gets")


def states(port: int) -> Iterator[dict]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    connection.request("GET", "/api/events")
    for line in connection.getresponse():
        if line.startswith(b"data: "):
            yield json.loads(line[6:], parse_constant=refuse)


def test_a_graph_is_shown(port, processes: Processes, watch) -> None:
    watcher: Watcher = watch()
    source = Source(watcher.node)
    processes.start("stitcher")
    processes.start("stitcher", namespace="left")  # another cell's, which isn't shown
    end, sent = time.monotonic() + 120, 0

    def until(what: str, holds) -> dict:
        nonlocal sent
        for state in states(port):
            assert time.monotonic() < end, f"{what}: {state}"
            source.roll()
            sent += 200
            if holds(state):
                return state
        raise AssertionError(f"{what}: the stream ended")

    until("rolling", lambda s: s["big"]["word"] == "ROLLING" and s["map"]["points"] > 1000)
    state = until("all figures", lambda s: s["lag_s"] is not None and s["depth_revision"] > 2)
    assert state["speed_m_s"] == pytest.approx(0.1, rel=0.02)
    assert state["force_n"] == 25.0
    assert state["map"]["points"] <= sent
    assert state["map"]["head"][0] <= source.x_m + 0.005
    assert state["coverage"] == {"measured": 0.5, "continued": 0.0, "unmeasured": 0.5}
    assert state["map"]["layers"] == ["height", "deviation"]
    assert state["facts"] == {"verdict so far": "nonconform"}
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    connection.request("GET", "/api/findings")
    (found,) = json.loads(connection.getresponse().read())
    assert (found["id"], found["depth_m"], found["verdict"]) == ("7", -2e-4, "nonconform")
    assert found["uncertainty"]["depth_m"] == 2e-5
    assert "area_m2" not in found["uncertainty"]
    assert state["text_revision"] == 1
    for _ in zip(range(20), states(port), strict=False):
        source.publish_nonsense()
    state = next(states(port))
    assert state["force_n"] == 25.0
    assert [node["name"] for node in state["nodes"]] == ["stitcher: surface"]
    processes.stop()
    state = until("the node is missed", lambda s: s["big"]["word"] in ("NODE LOST", "STOPPED"))
    assert state["nodes"][0]["level"] == "gone"
    # Another graph: what the first one left isn't taken for its own.
    watcher.spin_until(lambda: not watcher.node.count_publishers("/diagnostics"), 30, "its end")
    processes.start("braille")
    end = time.monotonic() + 120  # a node that starts cold compiles its kernels
    for state in states(port):
        assert time.monotonic() < end, state
        if [node["name"] for node in state["nodes"]] == ["braille: text"]:
            break
    assert state["big"]["word"] != "NODE LOST"
    assert (state["facts"], state["depth_revision"], state["text_revision"]) == ({}, 0, 2)
    assert state["map"]["points"] == 0

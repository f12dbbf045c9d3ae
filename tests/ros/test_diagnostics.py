"""Rates, and floods of faults."""

import threading
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.context import Context

from roller_core.clock import SensorClock
from roller_core.outputs import CONTACT, Output, Result, ScanFault
from roller_core.sensor_pose import PoseCounts
from roller_emvs.stitcher_stage import StitcherStage
from roller_ros import diagnostics
from roller_ros.diagnostics import Diagnostics, Meter
from roller_ros.stage_node import StageNode


class FakeNode:
    """As much of a node as diagnostics need."""

    def __init__(self):
        self.sent, self.logged = [], []

    def get_fully_qualified_name(self):
        return "/emvs"

    def create_publisher(self, kind, topic, quality):
        return self

    def create_timer(self, period_s, callback, clock):
        return None

    def get_logger(self):
        return self

    def get_clock(self):
        return self

    def now(self):
        return self

    def to_msg(self):
        from builtin_interfaces.msg import Time

        return Time()

    def warning(self, text):
        self.logged.append(text)

    def publish(self, message):
        (status,) = message.status
        self.sent.append((status.level, status.message, {v.key: v.value for v in status.values}))


def test_rates_are_those_since_the_last_look():
    now = [10.0]
    meter = Meter(lambda: now[0])
    now[0] = 12.0
    assert meter.rates(events=100, poses=50) == {"events": 50.0, "poses": 25.0}
    now[0] = 12.5
    assert meter.rates(events=100, poses=75) == {"events": 0.0, "poses": 50.0}
    # Made anew, it counts from zero.
    now[0] = 13.5
    assert meter.rates(events=7, poses=75) == {"events": 7.0, "poses": 0.0}


def test_a_fault_is_told_at_once_and_once_more():
    node = FakeNode()
    found = Diagnostics(node, "depth", lambda: (diagnostics.OK, "running", {"a": 1}))
    found.fault("it broke")
    found.fault("it broke")
    assert [m for _, m, _ in node.sent] == node.logged == ["it broke"]
    found.publish()
    found.publish()
    assert node.sent[1:] == [
        (diagnostics.ERROR, "it broke", {"a": "1"}), (diagnostics.OK, "running", {"a": "1"}),
    ]  # fmt: skip


def test_a_flood_of_faults_does_not_flood_the_graph():
    node = FakeNode()
    found = Diagnostics(node, "depth", lambda: (diagnostics.OK, "running", {}))
    for k in range(500):
        found.fault(f"pose {k} is wrong")
    assert 10 <= len(node.sent) < 100  # ten a second, and this takes no ten seconds
    found.publish()
    assert node.sent[-1][1] == "pose 499 is wrong"


def test_a_warning_hides_no_error():
    node, level = FakeNode(), [diagnostics.OK]
    found = Diagnostics(node, "depth", lambda: (level[0], "running", {}))
    for said in ("a short window", "it broke", "another short window"):
        found.fault(said, diagnostics.ERROR if said == "it broke" else diagnostics.WARN)
    found.publish()
    warn, error = diagnostics.WARN, diagnostics.ERROR
    told = [(warn, "a short window"), (error, "it broke"), (error, "it broke")]
    assert [(at, text) for at, text, _ in node.sent] == told
    level[0] = diagnostics.ERROR
    found.fault("a short window", diagnostics.WARN)
    found.publish()
    assert node.sent[-1][:2] == (diagnostics.ERROR, "running")


def test_windows_without_a_result_are_an_error_where_the_scan_is_bad_or_gives_none():
    told, output = [], SimpleNamespace(publish=lambda _: None)
    none, points = Result(None, notice="too little travel"), Result(1)
    slips = Output(CONTACT, 1, "", ScanFault("slipping"))
    given = [none, points, Result(None, (slips,), "slipping"), none, none, none, none]
    node = SimpleNamespace(
        stage=SimpleNamespace(results=lambda _: given),
        _outputs={CONTACT: output},
        _empty=0,
        _diagnostics=SimpleNamespace(fault=lambda text, level: told.append((text, level))),
    )
    StageNode._publish(node)
    levels = [level for _, level in told]
    warn, error = diagnostics.WARN, diagnostics.ERROR
    assert levels == [warn, error, warn, warn, error, error]


def test_a_node_that_compiles_its_kernels_says_so(domain, monkeypatch):
    """It doesn't spin yet, and would be silent for minutes."""
    told, said = [], threading.Event()

    def send(_, level, message, values):
        told.append((level, message))
        said.set()

    class Compiling(StitcherStage):
        def warm_up(self):
            said.wait(5)

    monkeypatch.setattr(Diagnostics, "_send", send)
    context = Context()
    rclpy.init(context=context)
    node = StageNode(Compiling, context=context)
    try:
        assert told
        assert told[0][0] == diagnostics.WARN
        assert told[0][1].startswith("not ready: it compiles its kernels")
    finally:
        node.destroy_node()
        context.try_shutdown()


def test_figures_of_a_clock_and_of_poses():
    clock = SensorClock()
    for k in range(3000):
        clock.observe(k * 10_000_000, 10**18 + k * 10_000_500 + (k % 7) * 100_000)
    figures = diagnostics.clock_figures(clock)
    assert figures["clock_skew_ppm"] == pytest.approx(50, abs=1)
    assert figures["clock_steps"] == 0
    assert 0 <= figures["clock_scatter_us"] < 100
    assert diagnostics.pose_figures(PoseCounts(5, 1, 0.25, 2)) == {
        "poses": 5, "pose_gaps": 1, "longest_pose_gap_s": 0.25, "pose_jumps": 2,
    }  # fmt: skip

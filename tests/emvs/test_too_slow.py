"""A stage that doesn't get all: fed faster than it works, or after packets were lost.

It leaves out whole windows, the others are as ever; inspection is told of what was lost.
"""

import threading
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from event_camera_msgs.msg import EventPacket
from rclpy.context import Context
from rclpy.parameter import Parameter
from tf2_msgs.msg import TFMessage

from roller_core import outputs
from roller_core.camera import Camera
from roller_core.codecs import encode
from roller_core.events import EventArray
from roller_core.frame_transforms import Transform
from roller_core.outputs import Result
from roller_core.pose_track import Pose
from roller_core.stage import ERROR, OK
from roller_emvs.depth_stage import DepthStage
from roller_emvs.windows import Window
from roller_ros import diagnostics, messages
from roller_ros.feeding import LeftOut, backlog_for, bulk_of, feed
from roller_ros.stage_node import StageNode
from waiting import wait_until

CAMERA = Camera(640, 480, 1066.0, 1066.0, 319.5, 239.5)
MS = 1_000_000
START_NS = 1_000_000_000
UNIT = (0.0, 0.0, 0.0, 1.0)
STILL = Pose(np.zeros(3), np.array(UNIT))
PACKETS, EACH = 2000, 200


class Windows(DepthStage):
    """Gives the windows alone."""

    def warm_up(self):
        pass

    def _pipeline_results(self, pipeline, flush):
        for window in pipeline.windows(flush):
            pipeline._count(0 if isinstance(window, Window) else None)
            yield Result(window)


def packet(number: int) -> EventPacket:
    """A millisecond of events; none in the very first, when the clock's map is settled."""
    rng = np.random.default_rng(number)
    t = np.sort(rng.integers(0, MS // 1000, EACH)) * 1000 + number * MS
    t[0] = number * MS
    pixels = rng.integers(0, 480, (2, EACH))
    events = EventArray.from_arrays(*pixels, t, np.arange(EACH) % 2)
    found = EventPacket(
        encoding="mono",
        width=640,
        height=480,
        seq=number,
        time_base=number * MS,
        events=messages.payload(encode("mono", events, number * MS)),
    )
    found.header = messages.header(START_NS + number * MS, "camera")
    return found


def pose(t_ns: int) -> Transform:
    return Transform("base", "tool0_controller", t_ns, (0.3e-9 * (t_ns - START_NS), 0, 0), UNIT)


def new_stage(**settings: object) -> Windows:
    stage = Windows(Windows.model.create({"window": {"rule": "travel"}, **settings}))
    stage.take_transform(
        Transform("tool0_controller", stage.settings.sensor_frame, 0, (0, 0, 0), UNIT, True)
    )
    stage.take_camera(CAMERA)
    return stage


def key(window: Window) -> tuple[int, int, bytes]:
    e = window.events
    return window.start_ns, window.end_ns, b"".join(a.tobytes() for a in (e.t_ns, e.x, e.y, e.p))


class Feeding:
    """What a node does with messages, with a stage that stands still while it is to."""

    def __init__(self, stage: Windows) -> None:
        self.stage = stage
        self.found: list[Window] = []
        self.faults: list[Exception] = []

    def take(self, item) -> None:
        topic, message = item
        if isinstance(message, Transform):
            self.stage.take_transform(message)
        else:
            feed(self.stage, topic, message, self.faults.append)
        self.found += [r.found for r in self.stage.results()]

    def flush(self) -> None:
        self.found += [r.found for r in self.stage.results(flush=True)]


@pytest.mark.parametrize(
    ("lost", "sent", "told"),
    [
        (range(300, 320), 400, "6% of the event packets were lost: 20 of 321"),  # at once
        (range(20, 50), 100, "30% of the event packets were lost: 30 of 100"),  # when it ends
        (range(300, 310), 400, None),
    ],
)
def test_lost_packets_are_told_to_inspection_once_a_scan(lost, sent, told):
    stage = new_stage()
    results: list[Result] = []
    for number in (n for n in range(sent) if n not in lost):
        if number % 8 == 0:
            stage.take_transform(pose(START_NS + number * MS))
        feed(stage, outputs.EVENTS, packet(number), [].append)
        results += stage.results()
    for _ in range(2):  # the second has nothing to end
        results += stage.results(flush=True)
    found = [(r.notice, o) for r in results for o in r.outputs if o.topic == outputs.CONTACT]
    assert [notice for notice, _ in found] == ([told] if told else [])
    for notice, output in found:
        assert output.data == outputs.ScanFault(notice, "data")
        assert output.t_ns == START_NS + lost.stop * MS
        message = messages.to_message(output)
        taken: list[outputs.Output] = []
        stage.take_output = taken.append  # type: ignore[method-assign]
        feed(stage, outputs.CONTACT, message, [].append)
        assert taken == [output]


@pytest.mark.parametrize(
    "limit", [{"max_waiting_mb": 1.0}, {"max_latency_s": 0.5}], ids=["bytes", "latency"]
)
@pytest.mark.parametrize("rule", ["travel", "time"])
def test_whole_windows_are_left_out_and_counted(limit, rule):
    undisturbed = Feeding(new_stage(window={"rule": rule}))
    slow = Feeding(new_stage(window={"rule": rule}, **limit))
    queue = backlog_for(slow.stage.settings, Windows)
    most_bytes = 0
    for number in range(PACKETS):
        items = [(outputs.EVENTS, packet(number))]
        if number % 8 == 0:
            items.append((outputs.TF, pose(START_NS + number * MS)))
        for item in items:
            undisturbed.take(item)
            is_packet = isinstance(item[1], EventPacket)
            queue.add(item, bulk=bulk_of(item[1]) if is_packet else None)
        most_bytes = max(most_bytes, queue.waiting_bytes)
        # It takes a message for every three that come.
        if number % 3 == 0 and (entry := queue.take()):
            slow.take(entry.item)
    for entry in iter(queue.take, None):
        slow.take(entry.item)
    undisturbed.flush()
    slow.flush()
    expected = {key(w) for w in undisturbed.found}
    got = {key(w) for w in slow.found}
    assert 0 < len(got) < len(expected)
    assert got <= expected
    totals = slow.stage.totals()
    assert totals["left_out_windows"] == len(expected) - len(got)
    assert totals["events_without_pose"] == undisturbed.stage.totals()["events_without_pose"]
    assert slow.stage.frames.counts.poses == undisturbed.stage.frames.counts.poses
    assert slow.stage.too_slow()[1] == (
        f"too slow: {totals['left_out_windows']} of {len(expected)} windows left out"
    )
    counts = slow.stage.counts()
    assert counts["lost_packets"] == 0
    assert counts["left_out_packets"] == queue.left_out > 0
    if "max_waiting_mb" in limit:
        assert most_bytes <= 1_000_000
    assert not slow.faults


@pytest.mark.parametrize("rests", [False, True])
def test_poses_that_end_before_the_events_are_told(rests):
    """At once, and at the end too if the robot moved."""
    stage = new_stage()
    for number in range(700):
        t_ns = START_NS + number * MS
        if number <= 104 and number % 8 == 0:
            stage.take_transform(replace(pose(START_NS if rests else t_ns), t_ns=t_ns))
        stage.take_packet(packet(number))
        if number == 600:
            assert stage.health() == (OK, "")
    lost = "poses base -> tool0_controller are missing: the newest is 0.6 s older than the newest"
    level, text = stage.health()
    assert level == ERROR
    assert text.startswith(lost)
    told = [o for r in stage.results(flush=True) for o in r.outputs if o.topic == outputs.CONTACT]
    assert [(o.t_ns, o.data.part) for o in told] == [(START_NS + 104 * MS, "data")] * (not rests)
    assert all(o.data.text.startswith(lost) for o in told)
    assert stage.health() == (OK, "")


def test_the_end_of_a_scan_whose_poses_come_late_is_not_kept_back(domain):
    """Without events for a while, all was flushed that had its poses by then."""
    context = Context()
    rclpy.init(context=context)
    node = StageNode(
        Windows, context=context, parameter_overrides=[Parameter("idle_flush_s", value=0.1)]
    )
    try:
        flushed, results = threading.Event(), node.stage.results

        def noted(flush=False):
            yield from results(flush)
            if flush:
                flushed.set()

        node.stage.results = noted
        submit, sensor = node._worker.submit, node.stage.settings.sensor_frame
        mounted = messages.transform(STILL, 0, "tool0_controller", sensor)
        submit((outputs.TF_STATIC, TFMessage(transforms=[mounted])), False)
        submit((outputs.CAMERA_INFO, messages.camera_info(CAMERA, 0, "camera")))
        for number in range(200):
            submit((outputs.EVENTS, packet(number)))
        assert flushed.wait(60)
        for k in range(26):
            moved = Pose(np.array([0.3e-9 * 8 * k * MS, 0, 0]), STILL.quaternion)
            late = messages.transform(moved, START_NS + 8 * k * MS, "base", "tool0_controller")
            submit((outputs.TF, TFMessage(transforms=[late])), False)
        wait_until(lambda: node.stage.totals()["windows"], node._status)
        wait_until(lambda: not node.stage.pipeline.held_events, node._status)
    finally:
        node.destroy_node()
        context.try_shutdown()


def test_small_packets_before_the_camera_are_bounded_too():
    """Most of their memory is not events'."""
    stage = Windows(Windows.model.create({"max_waiting_mb": 0.1}))
    for _ in range(1000):
        stage.take_packet(EventPacket())
    assert stage.left_out_packets >= 800


def test_results_go_out_before_what_is_told_of_others(domain, monkeypatch):
    context = Context()
    rclpy.init(context=context)
    node = StageNode(Windows, context=context)
    try:
        info = outputs.Output(outputs.DEPTH_INFO, START_NS, "camera", CAMERA)
        given = [Result(None, notice="no depth"), Result(None, (info,))]
        monkeypatch.setattr(node.stage, "results", lambda flush: iter(given))
        done = []
        monkeypatch.setattr(node._outputs[outputs.DEPTH_INFO], "publish", done.append)
        monkeypatch.setattr(node._diagnostics, "fault", lambda text, _: done.append(text))
        node._publish()
        assert len(done) == 2
        assert done[1] == "no depth"
    finally:
        node.destroy_node()
        context.try_shutdown()


def test_the_warning_ends_with_it_and_an_end_says_what_waited(domain, capsys, monkeypatch):
    context = Context()
    rclpy.init(context=context)
    node = StageNode(Windows, context=context)
    try:
        mounted = Transform(
            "tool0_controller", node.stage.settings.sensor_frame, 0, (0, 0, 0), UNIT, True
        )
        for transform in (mounted, pose(START_NS), pose(START_NS + 8 * MS)):
            node.stage.take_transform(transform)
        feed(node.stage, outputs.CAMERA_INFO, messages.camera_info(CAMERA, 0, "camera"), print)
        feed(node.stage, outputs.EVENTS, LeftOut(7), print)
        said = [node._status() for _ in range(2)]
        assert said[0][:2] == (diagnostics.WARN, "too slow: 7 packets of events left out")
        assert "too slow" not in said[1][1]
        assert said[1][2]["left_out_packets"] == 7
        node._worker.backlog.dropped = 3  # poses that waited too long
        assert node._status()[:2] == (diagnostics.WARN, said[0][1])
        monkeypatch.setattr(Windows, "lost_packets", 1)
        assert node._status()[:2] == (diagnostics.WARN, "data were lost")
        node._worker.backlog.dropped = 0
        monkeypatch.undo()
        with node._working:  # its worker can't begin
            for number in range(3):
                node._worker.submit((outputs.EVENTS, packet(number)))
            node._worker._stop.set()
    finally:
        node.destroy_node()
        context.try_shutdown()
    last = capsys.readouterr().err.strip()
    assert last.startswith("ended before its work was done: ")
    assert f"{EACH} events were in windows" in last or "messages waited" in last

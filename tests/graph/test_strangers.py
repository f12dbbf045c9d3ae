"""Two cameras in one graph: one is followed, the other is refused, counted and named."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import TransformStamped
from rclpy.context import Context
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo
from tf2_msgs.msg import TFMessage

from roller_core import outputs
from roller_core.camera import Camera
from roller_core.codecs import encode
from roller_core.events import EventArray
from roller_core.outputs import Output
from roller_emvs.stitcher_stage import StitcherStage
from roller_ros import messages, qos, topics

pytestmark = pytest.mark.graph

FRAME, STATUS = "event_camera_optical_frame", "emvs: depth"
STITCHED = "stitcher: surface"
EVENTS = 50
CAMERA = Camera(640, 480, 1066.0, 1066.0, 319.5, 239.5)
OTHER = Camera(320, 240, 900.0, 900.0, 160.0, 120.0)


class FakeCamera:
    """A node's camera, which sends its calibration once and packets by the timer of another."""

    def __init__(self, node: Node, timer: Node, seq: int, step: int, camera: Camera) -> None:
        self.node, self.seq, self.step, self.silent = node, seq, step, False
        self.camera = camera
        self.sent = 0
        self._start_ns = node.get_clock().now().nanoseconds
        self._events = node.create_publisher(EventPacket, "/event_camera/events", qos.EVENTS)
        self._info = node.create_publisher(CameraInfo, "/event_camera/camera_info", qos.LATCHED)
        self._info.publish(messages.camera_info(camera, 0, FRAME))
        timer.create_timer(0.02, self.send)

    def send(self) -> None:
        if self.silent:
            return
        now = self.node.get_clock().now().nanoseconds
        k, base = np.arange(EVENTS), now - self._start_ns
        events = EventArray.from_arrays(k, k, base + k * 1000, k % 2)
        packet = EventPacket(
            encoding="mono",
            width=self.camera.width,
            height=self.camera.height,
            seq=self.seq,
            time_base=base,
            events=messages.payload(encode("mono", events, base)),
        )
        packet.header = messages.header(now, FRAME)
        self._events.publish(packet)
        self.seq += self.step
        self.sent += 1


def pose(parent, child, t_ns=0):
    item = TransformStamped(header=messages.header(t_ns, parent), child_frame_id=child)
    item.transform.rotation.w = 1.0
    return item


@pytest.fixture
def stranger(domain):
    """A node of another process, as far as the graph can tell."""
    context = Context()
    rclpy.init(context=context)
    node = Node("stranger", context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


def test_one_camera_is_followed_and_the_other_refused(processes, watch, stranger):
    watcher = watch()
    ours = FakeCamera(watcher.node, watcher.node, 0, 1, CAMERA)
    theirs = FakeCamera(stranger, watcher.node, 2**40, 2**41, OTHER)
    theirs.silent = True
    processes.start("emvs")  # late: both have latched their calibration
    watcher.spin_until(lambda: watcher.value(STATUS, "events") > 500, 60, "events")
    theirs.silent = False
    topic = "/event_camera/events"
    told = f"/watcher and /stranger publish {topic}; /watcher is followed: stop all but one"
    watcher.spin_until(lambda: watcher.has_said(STATUS, told), 30, "the conflict")
    watcher.spin_until(lambda: watcher.value(STATUS, "foreign_packets") > 50, 30, "refusals")
    assert watcher.value(STATUS, "foreign_camera_infos") > 0
    for key in ("lost_packets", "seq_restarts"):
        assert watcher.value(STATUS, key) == 0
    # Until our calibration came, theirs may have been the only one.
    early = watcher.value(STATUS, "decode_errors")
    assert early < 100
    assert watcher.value(STATUS, "events") <= EVENTS * ours.sent
    watcher.check_keys(STATUS)
    # The first falls silent: the other is followed, with its calibration; its leaps are no loss.
    ours.silent = True
    before = watcher.value(STATUS, "events")
    watcher.spin_until(
        lambda: watcher.value(STATUS, "events") > before + 500, 30, "events of the other"
    )
    assert watcher.value(STATUS, "lost_packets") == 0
    assert watcher.value(STATUS, "decode_errors") == early
    assert 0 < watcher.value(STATUS, "seq_restarts") <= theirs.sent
    assert processes.stop() == {"emvs": 0}


def test_a_strangers_depth_camera_begins_no_map_anew(processes, watch, stranger):
    watcher = watch()
    own = {name: topics.publisher(watcher.node, name) for name in StitcherStage.inputs}
    theirs = topics.publisher(stranger, outputs.DEPTH_INFO)
    own[outputs.TF_STATIC].publish(TFMessage(transforms=[pose("tool0_controller", FRAME)]))
    depth = np.full((480, 640), np.nan, np.float32)
    depth[::40, ::40] = 0.045

    def send() -> None:
        now = watcher.node.get_clock().now().nanoseconds
        own[outputs.TF].publish(TFMessage(transforms=[pose("base", "tool0_controller", now)]))
        for name in (outputs.DEPTH_CONFIDENCE, outputs.DEPTH_SIGMA, outputs.DEPTH_IMAGE):
            own[name].publish(messages.to_message(Output(name, now - 50_000_000, FRAME, depth)))
        own[outputs.DEPTH_INFO].publish(messages.camera_info(CAMERA, now, FRAME))

    processes.start("stitcher")
    # The stranger, which sends but a part of what makes a depth map, is heard first.
    watcher.node.create_timer(0.04, lambda: theirs.publish(messages.camera_info(OTHER, 0, FRAME)))
    watcher.spin_until(lambda: watcher.value(STITCHED, "foreign_results") >= 0, 60, "the stitcher")
    watcher.spin(0.5)
    watcher.node.create_timer(0.04, send)
    watcher.spin_until(lambda: watcher.value(STITCHED, "depth_maps") > 20, 60, "depth maps")
    told = "; /watcher is followed: stop all but one"
    watcher.spin_until(lambda: watcher.has_said(STITCHED, told), 30, "the conflict")
    assert watcher.value(STITCHED, "foreign_results") > 0
    assert watcher.value(STITCHED, "faults") == 0
    assert processes.stop() == {"stitcher": 0}

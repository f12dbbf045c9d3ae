"""The cell's drivers as nodes: an emulated camera and an emulated robot come out as topics."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import TwistStamped
from tf2_msgs.msg import TFMessage

from driver.emulation.camera_words import in_order
from driver.emulation.controller_process import ControllerProcess
from graph.graph_world import EMULATED_CAMERA
from own import LOOPBACK
from roller_core.camera import Camera
from roller_core.codecs import PacketDecoder
from roller_core.events import EventArray
from roller_core.outputs import stamp_ns
from roller_core.pose_track import Pose
from roller_ros import messages, qos
from roller_ros.images import image_to_array

pytestmark = pytest.mark.graph

EVENTS, INFO = "/event_camera/events", "/event_camera/camera_info"
IMAGE, WRENCH = "/event_camera/image_raw", "/roller/robot/wrench"
CAMERA, ROBOT = "event_camera: camera", "ur10: robot"


def test_devices_come_out_as_topics_through_their_troubles(
    emulated_camera, processes, watch, tmp_path
):
    pytest.importorskip("rtde_receive", reason="ur_rtde has no wheels for this Python")
    calibration = tmp_path / "camera.yaml"
    Camera(640, 480, 1066.0, 1066.0, 319.5, 239.5).to_yaml(calibration)
    watcher = watch(EVENTS, INFO, IMAGE, "/tf", "/tf_static", WRENCH)
    seen = watcher.seen
    velocity = seen["velocity"]
    watcher.node.create_subscription(TwistStamped, "/ur10/tool_velocity", velocity.append, qos.TF)

    def wait_for_message(words: str) -> None:
        watcher.spin_until(lambda: watcher.has_said(ROBOT, words), 60, words)

    def wait_for_poses(count: int) -> None:
        wanted = len(seen["/tf"]) + count
        watcher.spin_until(lambda: len(seen["/tf"]) > wanted, 60, "poses")

    with ControllerProcess(rate_hz=125, speed_m_s=0.3) as controller:
        processes.start(
            "event_camera",
            f"{{{EMULATED_CAMERA}, camerainfo_url: 'file://{calibration}', encoding: libcaer, "
            # A reader of best effort has 1000 packets to catch up: four seconds of these.
            "event_message_time_threshold: 0.004}",
        )
        processes.start(
            "ur10",
            f"{{robot_ip: {LOOPBACK}, tf_prefix: left_, hand_eye_m: [0.01, 0.0, 0.08], "
            "hand_eye_rotation_rad: [0.0, 0.0, 0.7], most_force_n: 40.0}",
        )
        watcher.spin_until(
            lambda: len(seen[EVENTS]) > 400 and len(seen["/tf"]) > 250 and seen[IMAGE], 90, "data"
        )
        watcher.spin_until(lambda: watcher.value(ROBOT, "samples") > 0, 60, "robot diagnostics")
        check_poses(watcher)
        check_events(watcher, emulated_camera)
        (force,) = {(m.header.frame_id, m.wrench.force.z) for m in seen[WRENCH]}
        assert force == ("left_base", 20.0)
        controller.send("force 55")
        wait_for_message("pressed too hard: 55.0 N, the limit is 40 N")
        controller.send("force 20")
        controller.send("pose_z nan")
        wait_for_message("poses are no numbers, and left out")
        controller.send("pose_z 0.3")
        wait_for_poses(10)
        controller.send("protective_stop")
        wait_for_message("the robot stands: protective stop")
        controller.send("normal")
        controller.send("disconnect")
        wait_for_message("the connection was lost")
        wait_for_poses(100)
        controller.send("step_back 100")
        wait_for_message("the controller's clock has jumped")
        wait_for_poses(100)
        # Stamps are ROS time and go on.
        stamps = [stamp_ns(t) for m in seen["/tf"] for t in m.transforms]
        assert np.diff(stamps).min() > -20e6
        # Counted by connection: on a busy machine there may be a new one since.
        told = [float(v.get("clock_steps_back", 0)) for _, v in watcher.statuses[ROBOT]]
        assert max(told) >= 1
        publish_foreign_poses(watcher)
        wait_for_message("another node publishes left_tool0_controller")
        controller.stop()
        controller.start(refuse_protocol=True)
        wait_for_message("refuses RTDE protocol version 2; its software must be 3.3 or newer")
    info = seen[INFO][0]
    assert (info.width, info.k[0], info.header.frame_id) == (
        640, 1066.0, "event_camera_optical_frame",
    )  # fmt: skip
    assert seen[IMAGE][-1].encoding == "mono8"
    assert len(np.unique(image_to_array(seen[IMAGE][-1]))) >= 3
    watcher.check_keys(CAMERA, ROBOT)
    assert watcher.value(CAMERA, "decode_errors") == 0
    assert watcher.value(CAMERA, "packets_dropped") == 0
    assert watcher.messages_of(CAMERA)[-1] == "streaming"
    codes = processes.stop()
    assert codes == {"event_camera": 0, "ur10": 0}
    for name in codes:
        assert "Traceback" not in processes.log(name), processes.log(name)


def publish_foreign_poses(watcher):
    """Move the robot's tool from another node, until the watcher ends."""
    other = watcher.node.create_publisher(TFMessage, "/tf", qos.TF)
    pose = Pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))

    def publish() -> None:
        now = watcher.node.get_clock().now().nanoseconds
        moved = messages.transform(pose, now, "map", "left_tool0_controller")
        other.publish(TFMessage(transforms=[moved]))

    watcher.node.create_timer(0.05, publish)


def check_events(watcher, sent):
    packets = watcher.seen[EVENTS]
    first = packets[0]
    assert (first.width, first.height, first.encoding) == (640, 480, "libcaer")
    steps = np.diff([p.seq for p in packets])
    assert steps.min() == 1
    # A busy machine may lose some on the way here: a second of them or more came one by one.
    cuts = np.concatenate([[0], np.flatnonzero(steps > 1) + 1, [len(packets)]])
    longest = int(np.argmax(np.diff(cuts)))
    packets = packets[cuts[longest] : cuts[longest + 1]]
    assert len(packets) > 250
    decoder = PacketDecoder("libcaer", 640, 480)
    parts = [decoder.decode(p.events, p.time_base).events for p in packets]
    spans_ns = [int(e.t_ns[-1] - e.t_ns[0]) for e in parts]
    assert 2_000_000 < max(spans_ns) < 4_000_000
    got = EventArray.concatenate(parts)
    assert np.all(np.diff(got.t_ns) >= 0)
    # Each round of the stream is half a second later than the one before; whole rounds are alike.
    round_ = (got.t_ns - 1_000_000_000) // 500_000_000
    second = int(round_[0]) + 1
    part = in_order(got[round_ == second].shifted(-500_000_000 * second))
    distinct = np.unique(np.stack([sent.t_ns, sent.x, sent.y, sent.p], 1), axis=0)
    assert np.array_equal(np.stack([part.t_ns, part.x, part.y, part.p], 1), distinct)
    # Stamps are the host's and run with the sensor's clock.
    stamps = np.array([stamp_ns(p) for p in packets])
    assert np.all(np.diff(stamps) >= 0)


def check_poses(watcher):
    items = [t for m in watcher.seen["/tf"] for t in m.transforms]
    assert {(t.header.frame_id, t.child_frame_id) for t in items} == {
        ("left_base", "left_tool0_controller")
    }
    stamps = np.array([stamp_ns(t) for t in items[:200]])
    x = np.array([t.transform.translation.x for t in items[:200]])
    steps = np.diff(stamps)
    cycles = np.rint(steps / 8e6)
    assert cycles.min() == 1  # a busy host misses some
    assert np.median(np.abs(steps - cycles * 8e6)) < 1e5
    speed = np.median(np.abs(np.diff(x)) / (steps * 1e-9))
    assert speed == pytest.approx(0.3, rel=0.02)
    assert abs(watcher.seen["velocity"][0].twist.linear.x) == pytest.approx(0.3)
    (static,) = watcher.seen["/tf_static"][0].transforms
    assert (static.header.frame_id, static.child_frame_id) == (
        "left_tool0_controller", "event_camera_optical_frame",
    )  # fmt: skip
    assert static.transform.translation.z == pytest.approx(0.08)
    assert static.transform.rotation.z == pytest.approx(np.sin(0.35))


def test_a_parameter_that_makes_no_sense_ends_the_node_in_one_line(processes):
    processes.start("event_camera", "{encoding: evt2}")
    assert processes.running["event_camera"].wait(timeout=120) == 1
    (line,) = [x for x in processes.log("event_camera").splitlines() if x.startswith("error: ")]
    assert "'encoding' = 'evt2': can't be written" in line


def test_a_device_has_no_simulated_clock(emulated_camera, processes, watch):
    """Nobody publishes /clock: stamps would be zero, and no pose would come out."""
    pytest.importorskip("rtde_receive", reason="ur_rtde has no wheels for this Python")
    watcher = watch()
    with ControllerProcess():
        processes.start("event_camera", f"{{{EMULATED_CAMERA}, use_sim_time: true}}")
        processes.start("ur10", f"{{robot_ip: {LOOPBACK}, use_sim_time: true}}")
        watcher.spin_until(
            lambda: all(watcher.has_said(name, "use_sim_time is set") for name in (CAMERA, ROBOT)),
            60,
            "both devices",
        )
    assert set(processes.stop().values()) == {0}


def test_without_devices_the_nodes_say_so_and_stay(processes, watch, tmp_path, monkeypatch):
    (tmp_path / "nothing.py").write_text(
        "from driver.emulation.usb_backend import EmulatedBackend as none\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    watcher = watch("/tf_static")
    processes.start("event_camera", "{backend: 'nothing:none'}")
    processes.start("ur10", f"{{robot_ip: {LOOPBACK}}}")
    # Where another driver connects to the robot, the camera's place is published all the same.
    processes.start("ur10", "{connect: false}", "unset")
    processes.start("ur10", "{connect: false, hand_eye_identity: true, tf_prefix: left_}", "left")
    watcher.spin_until(
        lambda: (
            watcher.has_said(CAMERA, "no DVXplorer Mini is plugged in")
            and watcher.has_said(ROBOT, "it can't be reached")
            and watcher.has_said(f"unset/{ROBOT}", "the camera's place on the tool is not set")
            and watcher.has_said(f"left/{ROBOT}", "another node connects to the robot")
            and watcher.seen["/tf_static"]
        ),
        120,
        "all messages",
    )
    (static,) = watcher.seen["/tf_static"]
    assert [t.header.frame_id for t in static.transforms] == ["left_tool0_controller"]
    assert set(processes.stop().values()) == {0}

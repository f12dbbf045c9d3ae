"""The event camera's node with an emulated camera: a drop-in, its life and its faults."""

from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("rclpy")

from event_camera_msgs.msg import EventPacket
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from driver.emulation import usb_backend
from driver.emulation.camera_words import encode_words
from graph.graph_world import EMULATED_CAMERA, Watcher
from roller_core.events import EventArray
from roller_ros import qos

pytestmark = pytest.mark.graph

EVENTS, CAMERA = "/event_camera/events", "event_camera: camera"

#: What launch files of libcaer_driver give for a DVXplorer, some of it not known here.
LIBCAER = (
    "device_type: dvxplorer, device_id: 1, serial: '', camera_frame_id: event_camera, "
    "camerainfo_url: '', encoding: libcaer_cmp, event_message_time_threshold: 1.0e-3, "
    "event_message_size_threshold: 1000000000, event_send_queue_size: 1000, "
    "statistics_print_interval: 2.0, time_reset_delay: 2, dvs_enabled: true, "
    "bias_sensitivity: 2, polarity_flatten: false, polarity_on_only: false, "
    "polarity_off_only: false, subsample_enabled: false, roi_enabled: false, roi_start_col: 0, "
    "roi_start_row: 0, roi_end_col: 639, roi_end_row: 479, imu_accel_enabled: true"
)


def test_it_takes_the_place_of_libcaer_driver(emulated_camera, processes, watch):
    """Its parameters, node, topic and quality of service; nothing sent while nobody listens.

    And its life as a managed node.
    """
    watcher = watch()
    processes.start("event_camera", f"{{{EMULATED_CAMERA}, {LIBCAER}}}")
    watcher.spin_until(lambda: watcher.value(CAMERA, "packet_rate_hz") > 100, 90, "streaming")
    assert watcher.value(CAMERA, "packets_sent") == 0
    assert watcher.messages_of(CAMERA)[-1] == "streaming, not calibrated: set camerainfo_url"
    (info,) = watcher.node.get_publishers_info_by_topic(EVENTS)
    assert (info.node_name, info.node_namespace) == ("event_camera", "/")
    assert info.topic_type == "event_camera_msgs/msg/EventPacket"
    assert info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert info.qos_profile.durability == DurabilityPolicy.VOLATILE
    # With a subscriber, libcaer_driver's frame is in every header.
    packets = []
    watcher.node.create_subscription(EventPacket, EVENTS, packets.append, qos.EVENTS)
    watcher.spin_until(lambda: len(packets) > 20, 60, "packets")
    assert {p.header.frame_id for p in packets} == {"event_camera"}
    assert packets[0].encoding == "libcaer_cmp"
    # Biases can be set while it streams; the rest is as it started.
    for name, value, refused in (
        ("bias_sensitivity", 4, ""),
        ("bias_sensitivity", 5, "out of range"),
        ("contrast_threshold_on", "much", "a whole number is expected"),
        ("roi_enabled", True, "read-only"),
    ):
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]
        )
        (result,) = watcher.call("/event_camera/set_parameters", SetParameters, request).results
        assert result.successful == (not refused)
        assert refused in result.reason
        assert "\n" not in result.reason
    transition = transitions(watcher)
    assert transition(0) == "active"
    assert transition(Transition.TRANSITION_DEACTIVATE) == "inactive"
    watcher.spin_until(lambda: watcher.messages_of(CAMERA)[-1] == "inactive", 60, "a status")
    # What it sent before may still wait here.
    count = watcher.spin_until_quiet(packets)
    assert transition(Transition.TRANSITION_ACTIVATE) == "active"
    watcher.spin_until(lambda: len(packets) > count + 20, 60, "packets again")
    assert transition(Transition.TRANSITION_DEACTIVATE) == "inactive"
    assert transition(Transition.TRANSITION_CLEANUP) == "unconfigured"
    assert transition(Transition.TRANSITION_UNCONFIGURED_SHUTDOWN) == "finalized"
    watcher.spin_until(lambda: watcher.has_said(CAMERA, "shut down: start"), 60, "its end")
    assert processes.stop() == {"event_camera": 0}


def transitions(watcher: Watcher) -> Callable[[int], str]:
    """Asks the camera's node for a transition; the state that it is in afterwards."""
    change = watcher.node.create_client(ChangeState, "/event_camera/change_state")
    state = watcher.node.create_client(GetState, "/event_camera/get_state")
    watcher.spin_until(change.service_is_ready, 90, "the node's services")

    def ask(client, request):
        future = client.call_async(request)
        watcher.spin_until(future.done, 60, "an answer")
        return future.result()

    def transition(number: int) -> str:
        if number:
            assert ask(change, ChangeState.Request(transition=Transition(id=number))).success
        return ask(state, GetState.Request()).current_state.label

    return transition


def test_a_camera_whose_clock_goes_back_is_told(processes, watch, tmp_path, monkeypatch):
    t_us = np.repeat(200 * np.arange(2500), 40)
    pixels = np.random.default_rng(2).integers(0, 640 * 480, len(t_us))
    x, y, p = pixels % 640, pixels // 640, pixels % 2
    scans = [
        encode_words(EventArray.from_arrays(x, y, (t_us + start) * 1000, p))
        for start in (90_000_000, 1_000_000)
    ]
    words = np.concatenate(scans)
    words.tofile(tmp_path / "words.u4")
    monkeypatch.setenv(usb_backend.EVENTS_VARIABLE, str(tmp_path / "words.u4"))
    monkeypatch.setenv(usb_backend.RATE_VARIABLE, str(words.nbytes / 2))
    watcher = watch()
    processes.start("event_camera", f"{{{EMULATED_CAMERA}, autostart: false}}")
    transition = transitions(watcher)
    # Told once, in the second after: who listens must be there before.
    watcher.spin_until(lambda: "inactive" in watcher.messages_of(CAMERA), 90, "a status")
    assert transition(0) == "unconfigured"
    assert transition(Transition.TRANSITION_CONFIGURE) == "inactive"
    assert transition(Transition.TRANSITION_ACTIVATE) == "active"
    watcher.spin_until(
        lambda: "streaming; the camera's clock has jumped" in watcher.messages_of(CAMERA), 90,
        "the warning",
    )  # fmt: skip
    assert watcher.value(CAMERA, "clock_steps") == 1
    assert watcher.value(CAMERA, "clock_resets") == 1

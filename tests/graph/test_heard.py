"""A publisher learns when its subscribers have what it sent."""

from __future__ import annotations

import signal
import threading
import time

import pytest

pytest.importorskip("rclpy")

from sensor_msgs.msg import Image
from tf2_msgs.msg import TFMessage

from graph.graph_world import Processes, Watcher
from roller_ros import qos
from roller_ros.heard import wait_until_heard

pytestmark = [pytest.mark.graph, pytest.mark.xdist_group("graph")]


def test_it_waits_for_a_subscriber_that_is_held_up(processes: Processes, watch) -> None:
    watcher: Watcher = watch()
    publisher = watcher.node.create_publisher(TFMessage, "/tf", qos.TF)
    never = threading.Event()
    assert wait_until_heard(publisher, 5.0, never)  # nobody listens
    processes.start("stitcher")
    watcher.spin_until(lambda: publisher.get_subscription_count() > 0, 30, "the subscriber")
    publisher.publish(TFMessage())
    assert wait_until_heard(publisher, 20.0, never)

    process = processes.running["stitcher"]
    process.send_signal(signal.SIGSTOP)
    try:
        publisher.publish(TFMessage())
        assert not wait_until_heard(publisher, 0.5, never)
        stop = threading.Event()
        stop.set()
        begin = time.monotonic()
        assert not wait_until_heard(publisher, 600.0, stop)
        assert time.monotonic() - begin < 300.0
    finally:
        process.send_signal(signal.SIGCONT)
    assert wait_until_heard(publisher, 20.0, never)


def test_best_effort_is_not_waited_for(watch) -> None:
    watcher: Watcher = watch()
    assert wait_until_heard(
        watcher.node.create_publisher(Image, "/image", qos.PREVIEW), 0.0, threading.Event()
    )

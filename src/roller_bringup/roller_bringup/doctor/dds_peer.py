"""The process that sends what `dds.exchange_messages` waits for: `python -m … TOPIC SECONDS`."""

from __future__ import annotations

import sys
import time

import numpy as np

#: Bytes: a status, and a depth image (640×480 of float32).
SMALL, LARGE = 64, 640 * 480 * 4
MESSAGES = 20
_PERIOD_S = 0.04


def main(topic: str, timeout_s: float) -> int:
    """Wait for a subscriber and send to it."""
    import rclpy
    from rclpy.node import Node
    from std_msgs.msg import UInt8MultiArray

    from roller_ros import messages, qos
    from roller_ros.refusals import init_ros

    init_ros()
    node = Node("doctor_peer")
    small = node.create_publisher(UInt8MultiArray, f"{topic}_small", qos.DEPTH)
    large = node.create_publisher(UInt8MultiArray, f"{topic}_large", qos.EVENTS)
    end = time.monotonic() + timeout_s
    while not (small.get_subscription_count() and large.get_subscription_count()):
        if time.monotonic() > end:
            return 1
        time.sleep(0.02)
    time.sleep(0.5)  # the other side may know of us a moment later
    for _ in range(MESSAGES):
        for publisher, size in ((small, SMALL), (large, LARGE)):
            data = np.zeros(size, np.uint8)
            data[:8] = np.array([time.monotonic_ns()]).view(np.uint8)
            publisher.publish(UInt8MultiArray(data=messages.payload(data)))
        time.sleep(_PERIOD_S)
    # What was sent last lies in this process's shared memory until it is read.
    time.sleep(0.5)
    node.destroy_node()
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], float(sys.argv[2])))

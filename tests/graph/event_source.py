"""Publishes event packets at a rate, with poses and calibration; reports what it sent.

Also for measuring a recorder: ``python tests/graph/event_source.py --rate 10 --seconds 60``.
"""

import argparse
import json
import struct
import time
import zlib
from pathlib import Path

import numpy as np
import rclpy
from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from roller_core.camera import Camera
from roller_core.codecs import RawPacket, encode
from roller_core.events import EventArray
from roller_ros import messages, qos

FRAME = "event_camera_optical_frame"
WIDTH, HEIGHT = 640, 480
#: Packets that are made beforehand and sent in turns.
KINDS = 20


def main() -> None:
    """Wait for a subscriber, publish, and write what was sent."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--encoding", default="mono")
    parser.add_argument("--rate", type=float, default=10.0, help="10^6 events a second")
    parser.add_argument("--packet-ms", type=float, default=1.0, help="time in a packet")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--images", action="store_true", help="also 25 pictures a second")
    parser.add_argument(
        "--skip", type=int, nargs="*", default=[], help="numbers of packets that are not sent"
    )
    parser.add_argument(
        "--sent", type=Path, help="file for the checksum of the events of each packet sent"
    )
    args = parser.parse_args()
    rclpy.init(args=[])
    node = rclpy.create_node("event_source")
    try:
        print(json.dumps(run(node, args)), flush=True)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def run(node: Node, args: argparse.Namespace) -> dict[str, float]:
    """Publish everything; figures of what was sent."""
    events = node.create_publisher(EventPacket, "/event_camera/events", qos.EVENTS)
    # Not latched, as some drivers have it.
    info = node.create_publisher(CameraInfo, "/event_camera/camera_info", 10)
    images = node.create_publisher(Image, "/event_camera/image_raw", qos.PREVIEW)
    tf = node.create_publisher(TFMessage, "/tf", qos.TF)
    tf_static = node.create_publisher(TFMessage, "/tf_static", qos.TF_STATIC)
    tf_static.publish(TFMessage(transforms=[transform("tool0_controller", FRAME)]))
    count = round(args.rate * 1e3 * args.packet_ms)
    span_ns = round(args.packet_ms * 1e6)
    made = [packet(args.encoding, count, span_ns, seed) for seed in range(KINDS)]
    picture = Image(
        height=HEIGHT,
        width=WIDTH,
        encoding="mono8",
        step=WIDTH,
        data=messages.payload(np.zeros(WIDTH * HEIGHT, np.uint8)),
    )
    camera = messages.camera_info(Camera(WIDTH, HEIGHT, 500.0, 500.0, 320.0, 240.0), 0, FRAME)
    wait_for_subscriber(events)
    time.sleep(2.5)  # until a subscriber has asked for what is offered
    total = round(args.seconds * 1e3 / args.packet_ms)
    skip, sent, size = frozenset(args.skip), {}, 0
    begin, cpu = time.monotonic(), time.process_time()
    for seq in range(total):
        wait = begin + seq * args.packet_ms * 1e-3 - time.monotonic()
        if wait > 0:
            time.sleep(wait)
        if seq not in skip:
            data = numbered(made[seq % KINDS], seq, seq * span_ns)
            events.publish(data)
            size += len(data)
            if args.sent:
                sent[seq] = zlib.crc32(RawPacket.parse(data).payload)
        if seq % 8 == 0:
            tf.publish(TFMessage(transforms=[transform("base", "tool0_controller")]))
        if seq % 40 == 0:
            info.publish(camera)
            if args.images:
                images.publish(picture)
    spent = time.monotonic() - begin
    if args.sent:
        args.sent.write_text(json.dumps(sent))
    time.sleep(1.0)
    return {
        "packets": total - len(skip),
        "events_per_packet": count,
        "million_events_per_s": round(total * count / spent * 1e-6, 3),
        "mb_per_s": round(size / spent * 1e-6, 2),
        "cores": round((time.process_time() - cpu) / spent, 3),
    }


def packet(encoding: str, count: int, span_ns: int, seed: int) -> bytearray:
    """A serialized packet of edges that move: columns of events at the same time."""
    rng = np.random.default_rng(seed)
    t_ns = rng.integers(0, span_ns // 1000, count) * 1000
    x, y, p = rng.integers(0, 20, count) * 32, rng.integers(0, HEIGHT, count), t_ns // 1000 % 2
    order = np.lexsort((y, p, x, t_ns))
    events = EventArray.from_arrays(x[order], y[order], t_ns[order], p[order])
    message = EventPacket(
        height=HEIGHT,
        width=WIDTH,
        encoding=encoding,
        events=messages.payload(encode(encoding, events, 0)),
    )
    message.header.frame_id = FRAME
    return bytearray(serialize_message(message))


def numbered(data: bytearray, seq: int, time_base_ns: int) -> bytes:
    """The packet with a number, a time base and the time of now."""
    sec, nanosec = divmod(time.time_ns(), 10**9)
    struct.pack_into("<iI", data, 4, sec, nanosec)
    # After stamp, frame and image size, each aligned to its own size.
    length = struct.unpack_from("<I", data, 12)[0]
    at = -(-(-(-(12 + length) // 4) * 4 + 8) // 8) * 8
    struct.pack_into("<QQ", data, 4 + at, seq, time_base_ns)
    return bytes(data)


def transform(parent: str, child: str) -> TransformStamped:
    """A unit transform of now."""
    return TransformStamped(header=messages.header(time.time_ns(), parent), child_frame_id=child)


def wait_for_subscriber(publisher: rclpy.publisher.Publisher, timeout_s: float = 30.0) -> None:
    """Wait until somebody listens."""
    end = time.monotonic() + timeout_s
    while publisher.get_subscription_count() < 1 and time.monotonic() < end:
        time.sleep(0.05)


if __name__ == "__main__":
    main()

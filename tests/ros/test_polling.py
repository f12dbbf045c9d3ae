"""Topics whose messages are taken by a thread of their own."""

import struct
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")

import rclpy
from event_camera_msgs.msg import EventPacket
from rclpy.context import Context
from rclpy.node import Node
from std_msgs.msg import String

from roller_core import outputs
from roller_core.codecs import CodecError, RawPacket
from roller_core.errors import RollerError
from roller_ros import qos
from roller_ros.feeding import feed, packet_of
from roller_ros.polling import Poller
from waiting import wait_until

COUNT = 500
#: An empty event packet with the number 258.
BIG_ENDIAN = bytes([0, 0, 0, 0]) + struct.pack(
    ">iI I4s II QQ I1s ?2x I", 3, 4, 1, b"\0", 480, 640, 258, 5, 1, b"\0", False, 0
)


@pytest.fixture
def nodes(domain: int) -> Iterator[tuple[Node, Node]]:
    """Two nodes that nobody spins."""
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    made = Node("taker", context=context), Node("giver", context=context)
    yield made
    for node in made:
        node.destroy_node()
    context.try_shutdown()


def test_all_messages_come_in_order_without_an_executor(nodes: tuple[Node, Node]) -> None:
    taker, giver = nodes
    taken: list[tuple[str, Any]] = []
    poller = Poller(taker)
    poller.subscribe(String, "words", lambda m, info: taken.append((m.data, info)), qos.EVERY_TF)
    poller.start()
    words = giver.create_publisher(String, "words", qos.EVERY_TF)
    wait_until(lambda: words.get_subscription_count() == 1)
    for n in range(COUNT):
        words.publish(String(data=str(n)))
    wait_until(lambda: len(taken) == COUNT)
    poller.stop()
    assert [word for word, _ in taken] == [str(n) for n in range(COUNT)]
    assert all(info["publisher_gid"] for _, info in taken)
    words.publish(String(data="late"))
    assert len(taken) == COUNT


def test_messages_may_be_made_of_their_serialized_form(nodes: tuple[Node, Node]) -> None:
    taker, giver = nodes
    taken: list[Any] = []
    poller = Poller(taker)
    poller.subscribe(
        EventPacket, "events", lambda m, info: taken.append((m, info)), qos.EVERY_TF, packet_of
    )
    poller.start()
    packets = giver.create_publisher(EventPacket, "events", qos.EVERY_TF)
    wait_until(lambda: packets.get_subscription_count() == 1)
    sent = EventPacket(encoding="mono", seq=7, is_bigendian=True, time_base=5, events=[1, 2, 3])
    sent.header.stamp.sec, sent.header.stamp.nanosec = 3, 4
    packets.publish(sent)
    wait_until(lambda: len(taken) == 1)
    poller.stop()
    packet, info = taken[0]
    assert isinstance(packet, RawPacket)
    assert info["publisher_gid"]
    assert (packet.encoding, packet.seq, packet.is_bigendian) == ("mono", 7, True)
    assert (packet.stamp_ns, packet.time_base) == (3_000_000_004, 5)
    assert bytes(packet.events) == bytes([1, 2, 3])
    # What isn't parsed goes through rclpy: a big-endian message, as another machine may send it.
    assert packet_of(BIG_ENDIAN).seq == 258


def test_a_packet_that_is_none_is_a_fault_and_no_end() -> None:
    faults: list[RollerError] = []
    for cdr in (b"", b"\x00\x01\x00\x00" + bytes(range(1, 200)), BIG_ENDIAN[:40]):
        feed(None, outputs.EVENTS, packet_of(cdr), faults.append)
    assert len(faults) == 3
    assert all(isinstance(fault, CodecError) for fault in faults)


def test_a_publisher_that_does_not_suit_is_told_once(
    nodes: tuple[Node, Node], monkeypatch: pytest.MonkeyPatch
) -> None:
    taker, giver = nodes
    told: list[str] = []
    monkeypatch.setattr(taker.get_logger(), "warning", told.append)
    poller = Poller(taker)
    poller.subscribe(String, "words", lambda m, info: None, qos.EVERY_TF)
    for quality in (qos.EVERY_TF, qos.EVENTS):
        giver.create_publisher(String, "words", quality)
    wait_until(lambda: len(taker.get_publishers_info_by_topic("words")) == 2)
    poller.warn_of_unsuited()
    poller.warn_of_unsuited()
    assert len(told) == 1
    assert "/giver on /words" in told[0]

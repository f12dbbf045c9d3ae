"""Topics whose messages are taken by a thread of their own."""

from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from std_msgs.msg import String

from roller_ros import qos
from roller_ros.polling import Poller
from waiting import wait_until

COUNT = 500


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

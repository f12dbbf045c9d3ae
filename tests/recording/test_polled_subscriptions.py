"""What a recording takes out of the middleware."""

from collections.abc import Iterator

import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import String

from roller_recording.raw_message import RawMessage
from roller_recording.writing.polled_subscriptions import PolledSubscriptions
from roller_ros import qos
from roller_ros.topics import Topic
from waiting import wait_until

WORDS = Topic("/words", String, qos.EVERY_TF)


@pytest.fixture
def node(domain: int) -> Iterator[Node]:
    """A node that nobody spins."""
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    made = Node("recorder", context=context)
    yield made
    made.destroy_node()
    context.try_shutdown()


def test_what_arrived_before_the_end_is_taken(node: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also what came after the thread looked for the last time."""
    monkeypatch.setattr("roller_recording.writing.polled_subscriptions.PERIOD_S", 3600.0)
    taken: list[RawMessage] = []
    polled = PolledSubscriptions(node, [WORDS], taken.extend, lambda *_: None)
    words = node.create_publisher(String, WORDS.name, WORDS.qos)
    wait_until(lambda: words.get_subscription_count() == 1)
    for n in range(3):
        words.publish(String(data=f"word {n}"))
    assert words.wait_for_all_acked(Duration(seconds=10))
    assert taken == []
    polled.stop()
    assert [message.topic for message in taken] == ["/words"] * 3
    assert [b"word %d" % n in bytes(m.data) for n, m in enumerate(taken)] == [True] * 3

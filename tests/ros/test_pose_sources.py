"""Two publishers of the robot's poses: one is followed, the other is told."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from roller_ros.sources import OneSource
from roller_ros.tf import PoseSources

OURS, THEIRS = b"\x01" * 16, b"\x02" * 16


def message(parent="base", child="tool0_controller"):
    item = TransformStamped(child_frame_id=child)
    item.header.frame_id = parent
    return TFMessage(transforms=[item])


def sent_by(gid):
    return {"publisher_gid": {"implementation_identifier": "x", "data": gid}}


class Graph:
    """What the node knows of /tf's publishers; its ids are longer than the messages'."""

    def get_publishers_info_by_topic(self, topic):
        assert topic == "/tf"
        return [
            SimpleNamespace(node_name=name, endpoint_gid=list(gid + bytes(8)))
            for name, gid in (("ur10", OURS), ("ur_driver", THEIRS))
        ]


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def sources(clock):
    return PoseSources("base", "tool0_controller", clock)


def test_one_publisher(sources):
    assert all(sources.takes(message(), sent_by(OURS)) for _ in range(3))
    assert sources.pose_conflict(Graph()) == ""


def test_the_second_is_left_out_and_told_until_it_is_gone(sources, clock):
    assert sources.takes(message(), sent_by(OURS))
    assert not sources.takes(message(), sent_by(THEIRS))
    clock.now += 0.1
    assert sources.takes(message(), sent_by(OURS))
    told = sources.pose_conflict(Graph())
    assert told.startswith("/ur10 and /ur_driver publish base -> tool0_controller on /tf; /ur10 is")
    assert "publish_tf of ur10 to false" in told
    assert sources.foreign == 1
    clock.now += 3.1
    assert sources.pose_conflict(Graph()) == ""


def test_another_is_followed_when_the_first_is_silent(sources, clock):
    assert sources.takes(message(), sent_by(OURS))
    clock.now += 0.6
    assert sources.takes(message(), sent_by(THEIRS))
    assert not sources.takes(message(), sent_by(OURS))
    assert "/ur_driver is followed" in sources.pose_conflict(Graph())


def test_a_node_that_was_busy_does_not_take_that_for_silence(sources, clock):
    def arrived(gid, at_s):
        return sent_by(gid) | {"received_timestamp": round(at_s * 1e9)}

    assert sources.takes(message(), arrived(OURS, 100.0))
    clock.now += 10.0
    assert not sources.takes(message(), arrived(THEIRS, 100.01))
    assert sources.takes(message(), arrived(OURS, 100.02))
    assert sources.takes(message(), arrived(THEIRS, 100.53))


def test_who_sends_once_is_followed_until_it_is_gone(clock):
    cameras = OneSource(latched=True, clock_s=clock)
    assert cameras.accepts(sent_by(OURS))
    clock.now += 100.0
    assert not cameras.accepts(sent_by(THEIRS))
    clock.now += 100.0
    cameras.keep_to({OURS, THEIRS})
    told = cameras.conflict(Graph(), ["/tf"], "it", "stop one")
    assert told == "/ur10 and /ur_driver publish it; /ur10 is followed: stop one"
    cameras.keep_to({THEIRS})
    assert cameras.accepts(sent_by(THEIRS))
    assert cameras.conflict(Graph(), ["/tf"], "it", "stop one") == ""


def test_who_sends_but_a_part_gives_way_to_who_sends_all(clock):
    results = OneSource(latched=True, clock_s=clock)
    assert results.accepts(sent_by(THEIRS))
    results.keep_to({OURS, THEIRS}, whole=[{OURS, THEIRS}, {THEIRS}])
    assert results.followed == THEIRS, "it sends all"
    results.keep_to({OURS, THEIRS}, whole=[{OURS}, {THEIRS}])
    assert results.followed == THEIRS, "nobody sends all"
    results.keep_to({OURS, THEIRS}, whole=[{OURS, THEIRS}, {OURS}])
    assert results.followed == OURS
    assert not results.accepts(sent_by(THEIRS))


def test_other_frames_are_nobodys_business(sources):
    assert sources.takes(message(), sent_by(OURS))
    assert sources.takes(message("map", "base"), sent_by(THEIRS))
    assert sources.takes(message("/base", "/tool0_controller"), sent_by(OURS))
    assert sources.pose_conflict(Graph()) == ""


def test_where_publishers_are_not_told_apart_all_are_taken(sources):
    for info in ({}, {"publisher_gid": None}):
        assert sources.takes(message(), info)
    assert sources.pose_conflict(Graph()) == ""


def test_a_publisher_that_has_left(sources):
    assert sources.takes(message(), sent_by(OURS))
    assert not sources.takes(message(), sent_by(b"\x03" * 16))
    assert "/ur10 and a node that is gone publish" in sources.pose_conflict(Graph())


def test_a_node_that_was_started_again_is_followed_while_the_dead_one_is_in_the_graph(clock):
    results = OneSource(latched=True, clock_s=clock, processes=True)
    assert results.accepts(sent_by(OURS))
    clock.now += 5.0
    assert not results.accepts(sent_by(THEIRS))
    results.keep_to_name({OURS: "/emvs", THEIRS: "/left/emvs"})
    assert results.followed == OURS[:12], "another node's are not taken"
    results.keep_to_name({OURS: "/emvs", THEIRS: "/emvs"})
    assert results.accepts(sent_by(THEIRS))


def test_a_second_node_of_the_same_name_is_left_out_while_the_first_sends(clock):
    results = OneSource(latched=True, clock_s=clock, processes=True)
    for _ in range(10):
        assert results.accepts(sent_by(OURS))
        clock.now += 1.0
        assert not results.accepts(sent_by(THEIRS))
        results.keep_to_name({OURS: "/emvs", THEIRS: "/emvs"})
    clock.now += 10.0
    results.keep_to_name({OURS: "/emvs", THEIRS: "/emvs"})
    assert results.followed == OURS[:12], "both were silent"

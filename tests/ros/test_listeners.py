"""Waiting for who listens."""

import threading
import time

import pytest

pytest.importorskip("rclpy")

from rclpy.node import NodeNameNonExistentError

from roller_ros.listeners import PlaySettings, wait_for_listeners

#: Much longer than any of the waits below.
LONG_S = 30.0


class Heard:
    """A publisher with as many subscribers as are set."""

    topic_name = "/events"

    def __init__(self, count: int) -> None:
        self.count = count

    def get_subscription_count(self) -> int:
        return self.count


class Others:
    """A graph of nodes with the topics that each listens to."""

    def __init__(self, **topics: list[str]) -> None:
        self.topics = topics

    def get_namespace(self) -> str:
        return "/left"

    def get_subscriber_names_and_types_by_node(self, name, namespace):
        assert namespace == "/left"
        if name not in self.topics:
            raise NodeNameNonExistentError(name)
        return [(topic, []) for topic in self.topics[name]]


@pytest.fixture
def wait_in_thread(monkeypatch):
    def begin(graph, events, settle_s=0.05, stop=None, **settings):
        monkeypatch.setattr("roller_ros.listeners.SETTLE_S", settle_s)
        found: list[str] = []
        chosen = PlaySettings.create({"wait_s": LONG_S} | settings)
        stop = stop or threading.Event()
        wait = threading.Thread(
            target=lambda: found.append(wait_for_listeners(graph, events, chosen, stop))
        )
        wait.start()
        return wait, found

    return begin


def test_events_have_to_be_heard_and_named_nodes_to_listen(wait_in_thread):
    """A node is there before it listens; /clock is nothing that it waits with."""
    events, graph = Heard(2), Others(emvs=["/tf"])
    thread, found = wait_in_thread(graph, events, listeners="emvs, stitcher,inspect", subscribers=3)
    for change in (
        lambda: graph.topics.update(stitcher=["/left/roller/depth/image"]),
        lambda: graph.topics.update(inspect=["/clock", "/parameter_events"]),
        lambda: setattr(events, "count", 3),
    ):
        change()
        thread.join(0.2)
        assert thread.is_alive()
    graph.topics["inspect"] = ["/clock", "/left/roller/surface/points"]
    thread.join(LONG_S)
    assert found == [""]


def test_it_settles_anew_with_each_that_comes(wait_in_thread):
    events = Heard(1)
    thread, found = wait_in_thread(Others(), events, 1.0)
    begun = time.monotonic()
    for count in range(2, 8):
        time.sleep(0.25)
        events.count = count
        last = time.monotonic()
    assert thread.is_alive() or last - begun > 3.0  # a machine that stalls
    thread.join(LONG_S)
    assert found == [""]


def test_who_did_not_come_is_told(wait_in_thread):
    thread, found = wait_in_thread(
        Others(emvs=["/tf"]), Heard(1), 0.0, wait_s=0.1, subscribers=3, listeners="emvs,braille"
    )
    thread.join(LONG_S)
    told = "(/events 1 of 3; nothing of braille); it begins without them"
    assert found == [f"not all subscribers came in 0.1 s {told}"]


def test_for_whom_it_waits_is_told_meanwhile(monkeypatch):
    """One that ended with an error is not to be waited for in silence."""
    monkeypatch.setattr("roller_ros.listeners.SETTLE_S", 0.0)
    told: list[str] = []
    graph = Others(emvs=["/tf"])

    def tell(text: str) -> None:
        told.append(text.partition(":")[0])
        graph.topics[{1: "stitcher", 2: "braille"}.get(len(told), "emvs")] = ["/tf"]

    chosen = PlaySettings.create({"listeners": "emvs,braille,stitcher", "wait_s": LONG_S})
    assert wait_for_listeners(graph, Heard(1), chosen, threading.Event(), tell) == ""
    assert told == [
        "waiting for braille, stitcher",
        "waiting for braille",
        "waiting for subscribers of /events",
    ]


def test_those_that_come_and_go_are_not_waited_for_without_end(wait_in_thread):
    class Flapping(Heard):
        def get_subscription_count(self) -> int:
            self.count += 1
            return self.count

    thread, found = wait_in_thread(Others(), Flapping(0), 0.3, wait_s=0.1)
    thread.join(LONG_S)
    assert found == [""]


def test_an_interrupt_ends_the_waiting_without_a_word(wait_in_thread):
    stop = threading.Event()
    thread, found = wait_in_thread(Others(), Heard(0), 0.0, stop)
    stop.set()
    thread.join(LONG_S)
    assert found == [""]

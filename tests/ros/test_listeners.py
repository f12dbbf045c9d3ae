"""Waiting for who listens."""

import threading
import time

import pytest

pytest.importorskip("rclpy")

from roller_ros.listeners import wait_for_listeners

#: Much longer than any of the waits below.
LONG_S = 30.0


class Heard:
    """A publisher with as many subscribers as are set."""

    topic_name = "/tf"

    def __init__(self, count: int) -> None:
        self.count = count

    def get_subscription_count(self) -> int:
        return self.count


@pytest.fixture
def wait_in_thread(monkeypatch):
    def begin(wanted, wait_s, settle_s, stop) -> tuple[threading.Thread, list[str]]:
        monkeypatch.setattr("roller_ros.listeners.SETTLE_S", settle_s)
        found: list[str] = []
        wait = threading.Thread(
            target=lambda: found.append(wait_for_listeners(wanted, wait_s, stop))
        )
        wait.start()
        return wait, found

    return begin


def test_all_topics_have_to_be_heard(wait_in_thread):
    events, poses, stop = Heard(2), Heard(0), threading.Event()
    thread, found = wait_in_thread([(events, 2), (poses, 1)], LONG_S, 0.05, stop)
    thread.join(0.4)
    assert thread.is_alive()
    poses.count = 1
    thread.join(LONG_S)
    assert found == [""]


def test_it_settles_anew_with_each_that_comes(wait_in_thread):
    events, stop = Heard(1), threading.Event()
    thread, found = wait_in_thread([(events, 1)], LONG_S, 1.0, stop)
    begun = time.monotonic()
    for count in range(2, 8):
        time.sleep(0.25)
        events.count = count
        last = time.monotonic()
    assert thread.is_alive() or last - begun > 3.0  # a machine that stalls
    thread.join(LONG_S)
    assert found == [""]


def test_who_did_not_come_is_told(wait_in_thread):
    thread, found = wait_in_thread([(Heard(1), 3)], 0.1, 0.0, threading.Event())
    thread.join(LONG_S)
    assert found == ["not all subscribers came in 0.1 s (/tf 1 of 3); it begins without them"]


def test_those_that_come_and_go_are_not_waited_for_without_end(wait_in_thread):
    class Flapping(Heard):
        def get_subscription_count(self) -> int:
            self.count += 1
            return self.count

    thread, found = wait_in_thread([(Flapping(0), 1)], 0.1, 0.3, threading.Event())
    thread.join(LONG_S)
    assert found == [""]


def test_an_interrupt_ends_the_waiting_without_a_word(wait_in_thread):
    stop = threading.Event()
    thread, found = wait_in_thread([(Heard(0), 1)], LONG_S, 0.0, stop)
    stop.set()
    thread.join(LONG_S)
    assert found == [""]

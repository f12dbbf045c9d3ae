"""The nodes' working thread."""

import threading
import time
from collections.abc import Callable, Iterator

import pytest

pytest.importorskip("rclpy")

from roller_ros import worker as module
from roller_ros.backlog import Backlog, Bulk
from roller_ros.worker import Worker
from waiting import wait_until

#: Much longer than any of the waits below.
LONG_S = 30.0


class Made:
    """A worker that notes what it did."""

    def __init__(self, idle_s: float, limit: int = 100, **bulk: object) -> None:
        self.did: list[object] = []
        self.settled = False
        self.gate = threading.Event()
        self.gate.set()
        self.worker: Worker[object] = Worker(
            self._handle, lambda: self.did.append("idle"), idle_s, Backlog(limit, **bulk),
            lambda: self.settled,
        )  # fmt: skip

    def _handle(self, item: object) -> None:
        self.gate.wait(LONG_S)
        self.did.append(item)

    def until(self, done: Callable[[], bool]) -> None:
        wait_until(done, lambda: self.did, LONG_S)

    def poses_until_idle(self) -> None:
        """Submit what doesn't keep awake, all the while."""
        end = time.monotonic() + LONG_S
        while "idle" not in self.did:
            assert time.monotonic() < end
            self.worker.submit("pose", False)
            time.sleep(0.01)


@pytest.fixture
def make() -> Iterator[Callable[..., Made]]:
    made: list[Made] = []

    def create(idle_s: float, limit: int = 100, **bulk: object) -> Made:
        made.append(Made(idle_s, limit, **bulk))
        return made[-1]

    yield create
    for each in made:
        each.gate.set()
        each.worker.stop()


def test_items_are_handled_in_order_and_then_it_is_idle_once(make):
    made = make(0.05)
    for item in range(20):
        made.worker.submit(item)
    made.until(lambda: made.did == [*range(20), "idle"])
    time.sleep(0.3)
    assert made.did == [*range(20), "idle"]
    made.worker.submit("more")
    made.until(lambda: made.did[20:] == ["idle", "more", "idle"])


def test_what_does_not_keep_awake_neither_delays_nor_repeats_idleness(make):
    made = make(0.2)
    made.worker.submit("pose", False)
    made.worker.submit("event")
    made.poses_until_idle()
    made.worker.submit("pose", False)
    time.sleep(0.4)
    assert made.did.count("idle") == 1


def test_where_nothing_more_is_to_come_it_is_idle_sooner(make):
    made = make(4 * LONG_S)
    made.worker.submit(1)
    time.sleep(0.3)
    assert made.did == [1]
    made = make(1.0)
    made.settled = True
    # Far less than what it would wait else has passed in short waits, however slow the machine is.
    made.worker._idle_s = LONG_S
    made.worker._handle(2)
    assert not made.worker._long_enough(0.0, LONG_S / 4 - 0.1)
    assert made.worker._long_enough(0.0, LONG_S / 4)
    made.settled = False
    assert not made.worker._long_enough(LONG_S - 0.1, LONG_S)
    assert made.worker._long_enough(LONG_S, 0.0)


def test_what_keeps_awake_does_so_until_nothing_more_is_to_come(make):
    made = make(0.4)
    made.worker._handle = lambda _: made.worker.keep_awake()
    made.settled = True
    made.worker.submit("event")
    made.poses_until_idle()


def test_a_machine_that_stood_still_was_not_idle(make, monkeypatch):
    """The clock leaps on, as after a suspend; what was on its way comes before the idle work."""
    leap = 0.0

    class Clock:
        @staticmethod
        def monotonic() -> float:
            return time.monotonic() + leap

        sleep = staticmethod(time.sleep)

    monkeypatch.setattr(module, "time", Clock)
    made = make(2.0)
    made.worker.submit(1)
    made.until(lambda: made.did == [1])
    leap = 1000.0
    time.sleep(0.3)
    made.worker.submit(2)
    made.until(lambda: len(made.did) == 2)
    assert made.did == [1, 2]
    made.until(lambda: made.did == [1, 2, "idle"])


def test_work_on_what_had_come_is_time_in_which_nothing_came(make, monkeypatch):
    """When a backlog is worked off long after the last came, it is idle at once."""
    made = make(0.45)

    class Clock:
        @staticmethod
        def monotonic() -> float:
            return 0.1 * len(made.did)

    monkeypatch.setattr(module, "time", Clock)
    made.gate.clear()
    for item in range(8):
        made.worker.submit(item)
    made.gate.set()
    made.until(lambda: made.did == [*range(8), "idle"])


def test_the_oldest_is_dropped_and_counted(make):
    made = make(LONG_S, limit=3)
    made.gate.clear()
    made.worker.submit("first")
    made.until(lambda: made.worker.waiting == 1 and not made.did)
    time.sleep(0.05)  # now in hand
    for item in range(5):
        made.worker.submit(item)
    assert made.worker.backlog.dropped == 2
    made.gate.set()
    assert made.worker.drain(LONG_S)
    made.until(lambda: made.did == ["first", 2, 3, 4])


def test_bulk_is_left_out_in_stretches_and_the_rest_never():
    queue: Backlog[object] = Backlog(100, most_bytes=1000, gap=lambda count: ("gap", count))
    for k in range(15):
        queue.add(f"pose {k}")
        queue.add(k, bulk=Bulk(100, k))
        assert queue.waiting_bytes <= 1000
    queue.add("huge", bulk=Bulk(5000, 15))  # what came last stays
    assert (queue.left_out, queue.dropped, queue.waiting_bytes) == (15, 0, 5000)
    items = [entry.item for entry in iter(queue.take, None)]
    assert [i for i in items if "pose" in str(i)] == [f"pose {k}" for k in range(15)]
    assert [i for i in items if isinstance(i, tuple)] == [("gap", 6), ("gap", 9)]
    assert items[-1] == "huge"
    assert queue.waiting_bytes == 0


def test_what_is_far_behind_the_newest_is_left_out():
    queue: Backlog[object] = Backlog(100, most_behind_ns=100, gap=lambda count: ("gap", count))
    for t_ns in range(0, 120, 10):
        queue.add(t_ns, bulk=Bulk(1, t_ns))
    assert [e.item for e in iter(queue.take, None)] == [("gap", 6), *range(60, 120, 10)]

"""A scan that was played ends once the others have no work left."""

import threading
import time
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from roller_ros import listeners
from roller_ros.listeners import PlayingNode
from roller_ros.work_left import WorkLeft


class Player:
    """As much of a node as is needed."""

    def __init__(self, cell: str = "") -> None:
        self.cell, self.warned = cell, []

    def get_name(self) -> str:
        return "player"

    def get_fully_qualified_name(self) -> str:
        return f"/{self.cell}player"

    def create_subscription(self, *_: object) -> None:
        """Statuses are handed on by the tests."""

    def get_logger(self) -> SimpleNamespace:
        return SimpleNamespace(warning=self.warned.append)


def status(name: str, waiting: str | None, **more: str) -> DiagnosticArray:
    values = {} if waiting is None else {"waiting_messages": waiting}
    said = [KeyValue(key=key, value=value) for key, value in (values | more).items()]
    return DiagnosticArray(status=[DiagnosticStatus(name=name, values=said)])


@pytest.mark.parametrize(
    ("cell", "name", "waiting", "counts"),
    [
        ("", "emvs: depth", "3", True),
        ("", "emvs: depth", "0", False),
        ("", "emvs: depth", None, False),
        ("", "player: playback", "3", False),  # itself
        ("", "left/emvs: depth", "3", False),  # another cell's
        ("left/", "left/emvs: depth", "3", True),
        ("left/", "emvs: depth", "3", False),
        ("left/", "left/far/emvs: depth", "3", False),
    ],
)
def test_whose_work_counts(cell: str, name: str, waiting: str | None, counts: bool) -> None:
    now = [10.0]
    others = WorkLeft(Player(cell), lambda: now[0])
    now[0] = 15.0
    others.take(status(name, waiting))
    assert others.quiet_s == (0.0 if counts else 5.0)
    assert others.who == ("emvs" if counts else "")


@pytest.fixture
def finish(monkeypatch):
    """End a scan, as the thread that plays does."""
    monkeypatch.setattr(listeners, "LINGER_S", 0.01)
    monkeypatch.setattr(listeners, "QUIET_S", 0.3)

    def begin(others: WorkLeft | None) -> tuple[threading.Thread, SimpleNamespace]:
        node = Player()
        ending = SimpleNamespace(
            _others=others,
            _stop=threading.Event(),
            _done=threading.Event(),
            get_logger=node.get_logger,
            warned=node.warned,
        )
        thread = threading.Thread(target=PlayingNode._finish, args=(ending,))
        thread.start()
        return thread, ending

    return begin


def test_it_ends_when_nobody_has_had_work_for_a_while(finish) -> None:
    others = WorkLeft(Player())
    thread, ending = finish(others)
    for _ in range(10):
        others.take(status("emvs: depth", "1"))
        told = time.monotonic()
        time.sleep(0.1)
    assert not ending._done.is_set()
    thread.join(30)
    assert ending._done.is_set()
    assert time.monotonic() - told >= 0.3
    assert not ending.warned


def test_it_doesnt_wait_for_ever(finish, monkeypatch) -> None:
    monkeypatch.setattr(listeners, "MOST_S", 0.2)
    monkeypatch.setattr(listeners, "QUIET_S", 1e9)
    others = WorkLeft(Player())
    others.take(status("emvs: depth", "1"))
    thread, ending = finish(others)
    thread.join(30)
    assert ending._done.is_set()
    (line,) = ending.warned
    assert line.startswith("emvs still has work left")


def test_one_that_is_stopped_or_stays_ends_nothing(finish) -> None:
    thread, ending = finish(None)
    thread.join(30)
    assert ending._state == "finished"
    assert not ending._done.is_set()
    others = WorkLeft(Player(), lambda: 0.0)
    thread, ending = finish(others)
    ending._stop.set()
    thread.join(30)
    assert not ending._done.is_set()


#: A node that takes events, and one that takes what that gives.
EMVS = {"name": "emvs: depth", "packets": "1"}
STITCHER = {"name": "stitcher: surface"}


def test_nodes_are_asked_in_the_order_of_their_work() -> None:
    now = [0.0]
    others = WorkLeft(Player(), lambda: now[0])

    def say(node: dict[str, str], idle: str, at_s: float, waiting: str = "0") -> str:
        now[0] = at_s
        others.take(status(waiting=waiting, idle=idle, **node))
        return asked.unfinished

    for node in (EMVS, STITCHER):
        others.take(status(waiting="0", idle="1", **node))
    others.take(status("recorder: recording", "5"))  # it processes nothing
    asked = others.ask()
    assert asked.unfinished == "emvs, stitcher"  # what was said before doesn't count
    assert say(STITCHER, "1", 0.2) == "emvs, stitcher"  # more may come of emvs
    assert say(EMVS, "0", 0.4) == "emvs, stitcher"
    assert say(EMVS, "1", 1.4, waiting="2") == "emvs, stitcher"
    assert say(EMVS, "1", 2.4) == "stitcher"
    assert say(STITCHER, "1", 2.45) == "stitcher"  # its last result may be on its way
    assert say(STITCHER, "0", 3.4) == "stitcher"
    assert say(EMVS, "1", 3.42) == "stitcher"
    assert say(STITCHER, "1", 3.45) == ""
    assert say(EMVS, "0", 4.4) == "emvs"
    now[0] = 20.0
    assert others.ask().unfinished == ""  # all are gone


def test_two_may_ask_at_once_and_each_is_told() -> None:
    now = [0.0]
    others = WorkLeft(Player(), lambda: now[0])
    others.take(status(waiting="0", idle="1", **EMVS))
    first = others.ask()
    now[0] = 0.5
    others.take(status(waiting="0", idle="1", **EMVS))
    assert first.unfinished == ""
    second = others.ask()
    assert second.unfinished == "emvs"
    first.open = False
    third = others.ask()
    now[0] = 1.5
    others.take(status(waiting="0", idle="1", **EMVS))
    assert second.unfinished == third.unfinished == ""

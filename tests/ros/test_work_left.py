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


def status(name: str, waiting: str | None) -> DiagnosticArray:
    values = [] if waiting is None else [KeyValue(key="waiting_messages", value=waiting)]
    return DiagnosticArray(status=[DiagnosticStatus(name=name, values=values)])


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

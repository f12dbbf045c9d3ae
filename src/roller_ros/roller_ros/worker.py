"""A thread that does a node's work in order, so that callbacks return at once."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

from rclpy.task import Future

from roller_core.watched_thread import WatchedThread

from .backlog import Backlog, Bulk

T = TypeVar("T")

#: Longest time that the thread waits at once, s.
_WAIT_S = 0.1
#: Share of the idle time after which it is enough where nothing more is to come.
_SETTLED = 0.25
#: Longest time that the item at hand may take to its end, s.
ENDS_WITHIN_S = 5.0
#: Done when this process has to end: with the error of the program that ended a worker, or None.
ENDED: Future[BaseException | None] = Future()


def end_process(error: BaseException) -> None:
    """Have this process end with a fault of ours: one that stands still unseen would be worse.

    The thread that spins ends the node; from another, its end would wait for that one.
    """
    if not ENDED.done():
        ENDED.set_result(error)


class Worker(Generic[T]):
    """Handles items one after the other in its own thread.

    Parameters
    ----------
    handle : callable
        Takes one item.
    on_idle : callable
        Called once when nothing came for `idle_s`.
    idle_s : float
        Seconds in which nothing came, as this thread saw them pass. Time in which the process or
        the machine stood still doesn't count: what came meanwhile is still on its way.
    backlog : Backlog
        What waits, and how much of it may.
    settled : callable
        Asked when nothing came for a quarter of `idle_s`: True, and it has been long enough.
    """

    def __init__(
        self,
        handle: Callable[[T], None],
        on_idle: Callable[[], None],
        idle_s: float,
        backlog: Backlog[T],
        settled: Callable[[], bool] = lambda: False,
    ) -> None:
        self._handle = handle
        self._on_idle = on_idle
        self._idle_s = idle_s
        self._settled = settled
        self.backlog = backlog
        self._ready = threading.Condition()
        self._stop = threading.Event()
        self._busy = False
        #: Whether nothing has come since the work was done that is done when nothing comes.
        self.idle = True
        self._submitted = 0  # items that keep awake
        self._came = 0  # the same, and those that turned out to
        self._thread = WatchedThread("worker", self._work, self._stop, end_process)
        self._thread.start()

    def submit(self, item: T, keeps_awake: bool = True, bulk: Bulk | None = None) -> None:
        """Queue an item.

        Parameters
        ----------
        item : T
            What to handle.
        keeps_awake : bool
            Whether it counts for `idle_s`: a robot's poses go on when nothing happens.
        bulk : Bulk, optional
            Makes it one of those that are left out where there is no keeping up with them.
        """
        with self._ready:
            self.backlog.add(item, bulk)
            self._submitted += keeps_awake
            self._came += keeps_awake
            self._ready.notify()

    def keep_awake(self) -> None:
        """Let the item at hand count for `idle_s`, but where all is settled."""
        with self._ready:
            self._came += 1

    @property
    def waiting(self) -> int:
        """Items in the queue, and one more while one is being handled or idle work is done."""
        return len(self.backlog) + self._busy

    def drain(self, timeout_s: float) -> bool:
        """Wait until nothing waits; False if that took too long."""
        end = time.monotonic() + timeout_s
        while self.backlog and self._thread.is_alive():
            if time.monotonic() > end:
                return False
            time.sleep(0.01)
        return True

    def stop(self) -> None:
        """Finish the item at hand and end; what waits is dropped."""
        with self._ready:
            self._stop.set()
            self._ready.notify()
        self._thread.end(ENDS_WITHIN_S)

    def _work(self) -> None:
        # Idle time is the sum of short waits in vain, each counted as no longer than it was to be,
        # and of work on what had come before: while it lasted, more could have come.
        idle_s, came = 0.0, 0
        # The same without what `keep_awake` says: all came long ago where a queue was worked off.
        quiet_s, submitted = 0.0, 0
        while True:
            begun = time.monotonic()
            with self._ready:
                if not self.backlog and not self._stop.is_set():
                    self._ready.wait(_WAIT_S)
                if self._stop.is_set():
                    return
                entry = self.backlog.take()
                self._busy = entry is not None
            if entry is not None:
                self._handle(entry.item)
            passed_s = min(time.monotonic() - begun, _WAIT_S)
            if self._came != came:
                idle_s, self.idle, came = 0.0, False, self._came
            else:
                idle_s += passed_s
            if self._submitted != submitted:
                quiet_s, submitted = 0.0, self._submitted
            else:
                quiet_s += passed_s
            if not self.idle and not self.backlog and self._long_enough(idle_s, quiet_s):
                self._busy = True
                self._on_idle()
                self.idle = True
            self._busy = False

    def _long_enough(self, idle_s: float, quiet_s: float) -> bool:
        sooner = quiet_s >= self._idle_s * _SETTLED and self._settled()
        return sooner or idle_s >= self._idle_s

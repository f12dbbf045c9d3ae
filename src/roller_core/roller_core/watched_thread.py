"""A thread that doesn't die unseen."""

from __future__ import annotations

import threading
from collections.abc import Callable

#: Takes what ended a thread that should have gone on.
OnFailure = Callable[[BaseException], None]


class WatchedThread(threading.Thread):
    """Runs until it is told to end, and hands on what ends it before: others would wait for ever.

    Parameters
    ----------
    name : str
        Its name.
    work : callable
        Looks at `stop` now and then.
    stop : threading.Event
        Set once it has to end: what fails after that fails because of the end.
    on_failure : callable, optional
        Takes what ended it, in this thread; without it Python prints the traceback.
    """

    def __init__(
        self,
        name: str,
        work: Callable[[], None],
        stop: threading.Event,
        on_failure: OnFailure | None = None,
    ) -> None:
        super().__init__(name=name, daemon=True)
        self._work, self._ends, self._on_failure = work, stop, on_failure

    def run(self) -> None:
        """See `threading.Thread`."""
        try:
            self._work()
        except BaseException as error:  # also a panic of a library in Rust, which is no Exception
            if self._ends.is_set():
                return
            if self._on_failure is None:
                raise
            self._on_failure(error)

    def end(self, timeout_s: float | None = None) -> None:
        """Have it end, and wait for that, so long at most; it may not have begun."""
        self._ends.set()
        if self.is_alive():
            self.join(timeout=timeout_s)

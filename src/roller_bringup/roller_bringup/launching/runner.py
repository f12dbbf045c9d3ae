"""Starting the processes of a plan, watching them and stopping them."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from .output import Screen, standard_screen
from .plan import LaunchPlan, NodeProcess
from .process import RunningProcess, describe

#: How a process may end once it was asked to.
_ORDERLY = {0, -signal.SIGINT, -signal.SIGTERM, 128 + signal.SIGINT, 128 + signal.SIGTERM}
_STEPS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)


class Runner:
    """A plan's processes while they run.

    Parameters
    ----------
    plan
        What to run.
    screen
        Where output goes; standard output by default.
    grace_s
        How long processes have after SIGINT, and again after SIGTERM, before the next harder
        signal, seconds.

    Examples
    --------
    >>> with Runner(load("virtual.launch.xml")) as runner:
    ...     while runner.poll() is None:
    ...         time.sleep(0.1)
    """

    def __init__(
        self, plan: LaunchPlan, screen: Screen | None = None, grace_s: float = 5.0
    ) -> None:
        self.plan = plan
        self.screen = screen or standard_screen()
        self.grace_s = grace_s
        self.exit_codes: dict[str, int] = {}
        self._running: list[RunningProcess] = []
        self._again: list[tuple[float, NodeProcess]] = []
        self._result: int | None = None
        self._hurry = threading.Event()

    def start(self) -> None:
        """Start all processes.

        Raises
        ------
        LaunchError
            One can't be started; those already running are stopped.
        """
        try:
            for node in self.plan.processes:
                self._start(node)
        except BaseException:
            self.stop()
            raise

    def _start(self, node: NodeProcess) -> None:
        process = RunningProcess(node, self.screen.writer(node.name))
        self._running.append(process)
        self._say(f"{node.name} started (process {process.pid})")

    def _say(self, text: str) -> None:
        self.screen.line("launch", text)

    def poll(self) -> int | None:
        """See what became of the processes; start those again that are to be.

        Returns
        -------
        int or None
            None while there is something to wait for. Otherwise the exit code: 0 when a required
            process finished well, or all did; 1 when a required one failed, or, with none
            required, any did. Other processes may still run: `stop` ends them.
        """
        if self._result is not None:
            return self._result
        for process in list(self._running):
            code = process.poll()
            if code is None:
                continue
            self._running.remove(process)
            process.finish()
            node = process.node
            self.exit_codes[node.name] = code
            self._say(f"{node.name} {describe(code)}")
            if node.required:
                self._result = 0 if code == 0 else 1
                return self._result
            if node.respawn:
                self._again.append((time.monotonic() + node.respawn_delay_s, node))
        for due, node in list(self._again):
            if time.monotonic() >= due:
                self._again.remove((due, node))
                self._start(node)
        if not self._running and not self._again:
            self._result = 0 if all(code == 0 for code in self.exit_codes.values()) else 1
        return self._result

    def stop(self) -> int:
        """End what still runs: SIGINT, then SIGTERM, then SIGKILL.

        Returns
        -------
        int
            0 when all ended in order, 1 when one failed while stopping or had to be killed.
        """
        self._again.clear()
        stopping, self._running = self._running, []
        if stopping:
            self._say(f"stopping {', '.join(process.node.name for process in stopping)}")
        clean = True
        for step in _STEPS:
            if not stopping:
                break
            for process in stopping:
                if step is not signal.SIGINT:
                    self._say(f"{process.node.name} still runs; sending {step.name}")
                process.signal(step)
            deadline = time.monotonic() + self.grace_s
            while stopping and time.monotonic() < deadline and not self._hurry.is_set():
                stopping = [process for process in stopping if not self._ended(process)]
                if stopping:
                    stopping[0].wait(0.05)
            self._hurry.clear()
        for process in stopping:
            # Killed, but not gone: it hangs in the kernel. Nothing more can be done.
            self._say(f"{process.node.name} can't be ended")
            clean = False
        for node in self.plan.processes:
            if self.exit_codes.get(node.name, 0) not in _ORDERLY:
                clean = False
        self.plan.close()
        return 0 if clean else 1

    def _ended(self, process: RunningProcess) -> bool:
        code = process.poll()
        if code is None:
            return False
        process.finish()
        self.exit_codes[process.node.name] = code
        if code not in _ORDERLY:
            self._say(f"{process.node.name} {describe(code)} while stopping")
        return True

    def hurry(self) -> None:
        """Have a `stop` under way go on to its next, harder signal."""
        self._hurry.set()

    def __enter__(self) -> Runner:
        try:
            # A signal between a process's start and our knowing of it would leave it running.
            with _deferring():
                self.start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        # A second signal, of one who is out of patience, must not leave nodes running.
        with _handling(lambda *_: self.hurry()):
            self.stop()


def run(plan: LaunchPlan, screen: Screen | None = None, grace_s: float = 5.0) -> int:
    """Run a plan until a required process ends, all end, or SIGINT, SIGTERM or SIGHUP comes.

    A second signal while stopping doesn't wait for the processes' grace.

    Returns
    -------
    int
        0 after a signal when all ended in order, or when a required process finished well; 1
        otherwise.
    """
    runner = Runner(plan, screen, grace_s)
    asked = threading.Event()

    def handle(_number: int, _frame: FrameType | None) -> None:
        if asked.is_set():
            runner.hurry()
        asked.set()

    with _handling(handle):
        runner.start()
        try:
            result = None
            while result is None and not asked.wait(0.05):
                result = runner.poll()
        finally:
            stopped = runner.stop()
    if result is None:
        return stopped
    # A required node's own word counts; others may have been ended on the way.
    return result


@contextmanager
def _handling(handler: Any) -> Iterator[None]:
    """Handle the signals that ask for an end for a while (the main thread's privilege)."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    wanted = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # else nohup keeps us alive
        wanted.append(signal.SIGHUP)
    before = {number: signal.signal(number, handler) for number in wanted}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)


@contextmanager
def _deferring() -> Iterator[None]:
    """Let signals that ask for an end count only afterwards."""
    came: list[int] = []
    with _handling(lambda number, _: came.append(number)):
        yield
    for number in came[:1]:
        signal.raise_signal(number)

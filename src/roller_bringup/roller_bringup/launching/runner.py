"""Starting the processes of a plan, watching them and stopping them."""

from __future__ import annotations

import signal
import threading
import time
from types import FrameType

from roller_core.signals import handling_ends

from .plan import LaunchPlan
from .process import RunningProcess, Screen, describe

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
        How long processes have after SIGINT, where the launch file says nothing else
        (`sigterm_timeout`), and again after SIGTERM, before the next harder signal, seconds.

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
        self.screen = screen or Screen()
        self.grace_s = grace_s
        self.exit_codes: dict[str, int] = {}
        self._running: list[RunningProcess] = []
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
                self._running.append(RunningProcess(node, self.screen))
        except BaseException:
            self.stop()
            raise

    def _say(self, text: str) -> None:
        self.screen.line("launch", text)

    def _sort_out(self) -> None:
        """Take those that ended from those that run."""
        for process in list(self._running):
            code = process.poll()
            if code is not None:
                self._running.remove(process)
                self.exit_codes[process.node.label] = code
                self._say(f"{process.node.label} {describe(code)}")

    def poll(self) -> int | None:
        """See what became of the processes.

        Returns
        -------
        int or None
            None while there is something to wait for. Otherwise the exit code: 0 when a required
            process finished well, or all did; 1 when a required one failed, or, with none
            required, any did. Other processes may still run: `stop` ends them.
        """
        self._sort_out()
        codes = self.exit_codes
        for node in self.plan.processes:
            if node.required and node.label in codes:
                return 0 if codes[node.label] == 0 else 1
        return None if self._running else int(any(codes.values()))

    def stop(self) -> int:
        """End what still runs: SIGINT, then SIGTERM, then SIGKILL.

        Returns
        -------
        int
            0 when all ended in order, 1 when one failed while stopping or had to be killed.
        """
        if self._running:
            self._say(f"stopping {', '.join(process.node.label for process in self._running)}")
        # By process: signals still to be sent, and when the next is due.
        left = {process.pid: list(_STEPS) for process in self._running}
        due = dict.fromkeys(left, 0.0)
        while any(left[p.pid] or time.monotonic() < due[p.pid] for p in self._running):
            if self._hurry.is_set():
                self._hurry.clear()
                due = dict.fromkeys(due, 0.0)
            for process in self._running:
                now = time.monotonic()
                if left[process.pid] and now >= due[process.pid]:
                    step = left[process.pid].pop(0)
                    if step is not signal.SIGINT:
                        self._say(f"{process.node.label} still runs; sending {step.name}")
                    process.signal(step)
                    own = process.node.grace_s if step is signal.SIGINT else None
                    due[process.pid] = now + (self.grace_s if own is None else own)
            time.sleep(0.02)
            self._sort_out()
        for process in self._running:
            # Killed, but not gone: it hangs in the kernel. Nothing more can be done.
            self._say(f"{process.node.label} can't be ended")
        clean = not self._running and set(self.exit_codes.values()) <= _ORDERLY
        self._running = []
        self.plan.close()
        return 0 if clean else 1

    def hurry(self) -> None:
        """Have a `stop` under way go on to its next, harder signal."""
        self._hurry.set()

    def __enter__(self) -> Runner:
        came: list[int] = []
        try:
            # A signal between a process's start and our knowing of it would leave it running.
            with handling_ends(lambda number, _: came.append(number)):
                self.start()
            for number in came[:1]:
                signal.raise_signal(number)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        # A second signal, of one who is out of patience, must not leave nodes running.
        with handling_ends(lambda *_: self.hurry()):
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

    with handling_ends(handle):
        runner.start()
        try:
            result = None
            while result is None and not asked.wait(0.05):
                result = runner.poll()
        finally:
            stopped = runner.stop()
    # A required node's own word counts; others may have been ended on the way.
    return stopped if result is None else result

"""Whether the controller's tool is the one that the camera's place was found with."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence

from roller_core.transforms import rotation_vector_to_quaternion
from roller_core.watched_thread import OnFailure, WatchedThread

from .errors import OtherToolError, RobotFault
from .rtde import read_tcp_offset, tcp_offsets

#: Tools that differ by no more than this are the same.
_SAME_TOOL_M, _SAME_TOOL_RAD = 1e-4, 1e-3


class ToolCheck:
    """Compares the controller's tool centre point with the expected one, where it tells it.

    A program may set another tool while poses come, which would be of that one: so it is watched
    in a thread.

    Parameters
    ----------
    host : str
        The controller's address.
    expected : sequence of float
        x y z in metres, rotation vector in rad; another length: nothing is checked.
    timeout_s, retry_s : float
        Longest wait for an answer, and pause before asking again, s.
    poses_come : callable
        Whether there are poses that another tool would spoil.
    on_failure : callable, optional
        See `WatchedThread`.
    """

    def __init__(
        self,
        host: str,
        expected: Sequence[float],
        timeout_s: float,
        retry_s: float,
        poses_come: Callable[[], bool],
        on_failure: OnFailure | None = None,
    ) -> None:
        self._host = host
        self._expected = expected
        self._timeout_s = timeout_s
        self._retry_s = retry_s
        self._poses_come = poses_come
        self._other: OtherToolError | None = None
        self._stop = threading.Event()
        self._thread = WatchedThread("tool", self._watch, self._stop, on_failure)

    @property
    def _asked_for(self) -> bool:
        return len(self._expected) == 6

    def start(self) -> None:
        """Begin to watch."""
        if self._asked_for:
            self._thread.start()

    def stop(self) -> None:
        """Watch no longer."""
        self._thread.end(10.0)

    def check(self) -> None:
        """Ask once.

        Raises
        ------
        OtherToolError
            If the tools differ by more than 0.1 mm or 1 mrad.
        """
        if self._asked_for:
            found = read_tcp_offset(self._host, self._timeout_s)
            if found is not None:
                self._compare(found)

    def begin(self) -> None:
        """Forget what was seen: poses of another connection follow."""
        self._other = None

    def raise_if_other(self) -> None:
        """Say if another tool was seen since the beginning.

        Raises
        ------
        OtherToolError
            See `check`.
        """
        if self._other is not None:
            raise self._other

    def _watch(self) -> None:
        while not self._stop.is_set():
            try:
                for found in tcp_offsets(self._host, self._timeout_s):
                    if self._stop.is_set():
                        return
                    if self._poses_come():
                        self._compare(found)
            except OtherToolError as error:
                self._other = error
            except RobotFault:
                pass  # who receives the poses sees it too
            self._stop.wait(self._retry_s)

    def _compare(self, found: Sequence[float]) -> None:
        away_m = math.dist(found[:3], self._expected[:3])
        ours, theirs = (rotation_vector_to_quaternion(v[3:]) for v in (self._expected, found))
        turned = 2 * math.acos(min(1.0, abs(float(ours @ theirs))))
        if away_m > _SAME_TOOL_M or turned > _SAME_TOOL_RAD:
            raise OtherToolError(
                f"robot {self._host}: its tool centre point "
                f"({', '.join(f'{v:.5g}' for v in found)}) is {away_m * 1e3:.2f} mm and "
                f"{math.degrees(turned):.2f} deg from the one that the camera's place was found "
                "with (tcp_offset): set it on the controller, or calibrate"
            )

"""Keeps poses coming from the controller: connects, reads untorn, connects again."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from roller_core.watched_thread import OnFailure, WatchedThread

from .errors import MissingLibraryError, ProtocolRefusedError, RobotFault, RobotLostError
from .receiver_status import RECEIVING, SEARCHING, STOPPED, ReceiverStatus
from .rtde import ANSWER_TIMEOUT_S, Controller, ask_controller
from .tool_check import ToolCheck

T = TypeVar("T")

#: What the controller is asked to send.
VARIABLES = [
    "timestamp",
    "actual_TCP_pose",
    "actual_TCP_speed",
    "robot_mode",
    "safety_mode",
]
#: What it may be without.
FORCE = "actual_TCP_force"
_POLL_S = 0.0002
#: A controller's time that leaps by so much more than passed here was set, s.
_CLOCK_SET_S = 0.5


@dataclass(frozen=True, slots=True)
class RobotSample:
    """One state of the robot."""

    #: The controller's clock, ns.
    controller_ns: int
    #: When the host had it, ns.
    arrival_ns: int
    #: TCP in base: x y z in metres, rotation vector in rad.
    pose: tuple[float, ...]
    #: Its velocity in base: m/s and rad/s.
    speed: tuple[float, ...]
    #: Force and torque at the TCP, along the axes of base: N and Nm; empty where the controller
    #: doesn't say, or says what is no number.
    wrench: tuple[float, ...] = ()


def open_receiver(host: str, variables: Sequence[str] = VARIABLES) -> Any:
    """Connect the robot's library.

    Raises
    ------
    MissingLibraryError
        If it is not installed.
    ProtocolRefusedError
        If the controller doesn't send what it is asked for.
    """
    try:
        from rtde_receive import RTDEReceiveInterface
    except ImportError as error:
        raise MissingLibraryError(
            "the package ur_rtde is not installed: pip install ur-rtde (it has wheels up to "
            "Python 3.12), or apt install ros-$ROS_DISTRO-ur and set start_robot:=false"
        ) from error
    try:
        return RTDEReceiveInterface(host, variables=list(variables))
    except Exception as error:  # the library raises what its C++ throws
        raise ProtocolRefusedError(
            f"robot {host}: the controller did not start to send ({str(error).strip()})"
        ) from error


class RobotReceiver:
    """Reads the robot's state in a thread until it is stopped.

    Parameters
    ----------
    host : str
        The controller's address.
    on_sample : callable
        Takes each sample, in the receiver's thread.
    on_change : callable
        Takes each new state and its fault.
    on_failure : callable, optional
        Takes what ended one of its threads, which is a fault of ours: see `WatchedThread`.
    clock_ns : callable
        The host's time, ns.
    connect_timeout_s : float
        Longest wait for an answer of the controller, s.
    retry_s : float
        Pause between attempts to connect, s.
    silence_s : float
        Without a sample for so long the connection is lost, s.
    tcp_offset : sequence of float
        See `ToolCheck`.
    """

    def __init__(
        self,
        host: str,
        on_sample: Callable[[RobotSample], None],
        *,
        on_change: Callable[[str, str], None] | None = None,
        on_failure: OnFailure | None = None,
        clock_ns: Callable[[], int] = time.time_ns,
        connect_timeout_s: float = ANSWER_TIMEOUT_S,
        retry_s: float = 1.0,
        silence_s: float = 0.5,
        tcp_offset: Sequence[float] = (),
    ) -> None:
        self._host = host
        self._on_sample = on_sample
        self._on_change = on_change
        self._clock_ns = clock_ns
        self._connect_timeout_s = connect_timeout_s
        self._retry_s = retry_s
        self._silence_s = silence_s
        self._has_force = False
        self.status = ReceiverStatus()
        self._tool = ToolCheck(
            host, tcp_offset, connect_timeout_s, retry_s,
            lambda: self.status.state == RECEIVING, on_failure,
        )  # fmt: skip
        self._stop = threading.Event()
        self._thread = WatchedThread("robot", self._run, self._stop, on_failure)

    def start(self) -> None:
        """Start to look for the robot."""
        self._thread.start()
        self._tool.start()

    def stop(self) -> None:
        """Close the connection and end."""
        self._stop.set()
        self._tool.stop()
        self._thread.end(10.0)

    def _change(self, state: str, fault: str) -> None:
        s = self.status
        if (state, fault) != (s.state, s.fault):
            s.state, s.fault = state, fault
            if self._on_change is not None:
                self._on_change(state, fault)

    def _run(self) -> None:
        self._change(SEARCHING, "")
        while not self._stop.is_set():
            try:
                controller = ask_controller(
                    self._host, VARIABLES, self._connect_timeout_s, spare=[FORCE]
                )
                self._has_force = FORCE not in controller.lacks
                self._tool.check()
                variables = [*VARIABLES, FORCE] if self._has_force else VARIABLES
                interface = open_receiver(self._host, variables)
            except RobotFault as error:
                self._change(SEARCHING, str(error))
                self._stop.wait(self._retry_s)
                continue
            try:
                self.status.controller = controller
                self.status.connects += 1
                self._receive(interface, controller)
            except RobotFault as error:
                self._change(SEARCHING, str(error))
                self._stop.wait(min(self._retry_s, 0.2))
            finally:
                with suppress(Exception):  # the library raises what its C++ throws
                    interface.disconnect()
        self._change(STOPPED, "")

    def _receive(self, interface: Any, controller: Controller) -> None:
        period_ns = controller.period_ns
        period_s = period_ns * 1e-9
        s = self.status
        last_ns, last_seen = -1, time.monotonic()
        self._tool.begin()
        while not self._stop.is_set():
            self._tool.raise_if_other()
            stamp = self._ask(interface.getTimestamp)
            now = time.monotonic()
            controller_ns = round(stamp * 1e9)
            if controller_ns == last_ns or stamp == 0.0:
                if not self._ask(interface.isConnected):
                    raise RobotLostError(f"robot {self._host}: the connection was lost")
                if now - last_seen > self._silence_s:
                    raise RobotLostError(
                        f"robot {self._host}: nothing came for {self._silence_s:g} s"
                    )
                time.sleep(_POLL_S)
                continue
            sample = self._ask(partial(self._untorn, interface, stamp))
            if s.state != RECEIVING:
                self._change(RECEIVING, "")
            # A torn read ends with a newer sample than it began with.
            controller_ns = sample.controller_ns
            if last_ns >= 0:
                step = controller_ns - last_ns
                # So long nothing was missing: the controller's clock was set.
                jumped = step * 1e-9 > now - last_seen + _CLOCK_SET_S
                if step < 0:
                    s.steps_back += 1
                elif step > 1.5 * period_ns and not jumped:
                    s.missed += round(step / period_ns) - 1
                    s.gaps += 1
                if not jumped:
                    s.longest_gap_s = max(s.longest_gap_s, step * 1e-9)
            last_ns, last_seen = controller_ns, now
            s.samples += 1
            if all(map(math.isfinite, (*sample.pose, *sample.speed))):
                self._on_sample(sample)
            else:
                s.not_finite += 1
            # The next one is most of a period away; then look often.
            time.sleep(0.7 * period_s)

    def _ask(self, question: Callable[[], T]) -> T:
        """What the library answers; it raises what its C++ throws."""
        try:
            return question()
        except Exception as error:
            raise RobotLostError(
                f"robot {self._host}: its state can't be read ({str(error).strip()})"
            ) from error

    def _untorn(self, interface: Any, stamp: float) -> RobotSample:
        """Read until the time stamp is the same before and after."""
        while True:
            arrival_ns = self._clock_ns()
            pose = tuple(interface.getActualTCPPose())
            speed = tuple(interface.getActualTCPSpeed())
            wrench = tuple(interface.getActualTCPForce()) if self._has_force else ()
            if not all(map(math.isfinite, wrench)):
                wrench = ()
            self.status.safety_mode = int(interface.getSafetyMode())
            self.status.robot_mode = int(interface.getRobotMode())
            after = interface.getTimestamp()
            if after == stamp:
                return RobotSample(round(stamp * 1e9), arrival_ns, pose, speed, wrench)
            self.status.torn += 1
            stamp = after

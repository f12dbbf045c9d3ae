"""Keeps poses coming from the controller: connects, reads untorn, connects again."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from roller_core.transforms import rotation_vector_to_quaternion

from .errors import (
    MissingLibraryError,
    OtherToolError,
    ProtocolRefusedError,
    RobotFault,
    RobotLostError,
)
from .rtde import Controller, ask_controller, read_tcp_offset, tcp_offsets

SEARCHING = "searching"
RECEIVING = "receiving"
STOPPED = "stopped"

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
SAFETY_MODES = {
    1: "normal",
    2: "reduced",
    3: "protective stop",
    4: "recovery",
    5: "safeguard stop",
    6: "system emergency stop",
    7: "robot emergency stop",
    8: "violation",
    9: "fault",
    10: "validate joint id",
    11: "undefined",
    12: "automatic mode safeguard stop",
    13: "three-position enabling stop",
}
_RUNNING_SAFELY = (1, 2)
_POLL_S = 0.0002
#: Tools that differ by no more than this are the same.
_SAME_TOOL_M, _SAME_TOOL_RAD = 1e-4, 1e-3


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
    #: doesn't say.
    wrench: tuple[float, ...] = ()


@dataclass(slots=True)
class ReceiverStatus:
    """How the receiver is."""

    #: `searching`, `receiving` or `stopped`.
    state: str = STOPPED
    #: What keeps it from receiving, or ended it last time; empty: nothing.
    fault: str = ""
    #: Who answered.
    controller: Controller | None = None
    #: Connections made; samples received.
    connects: int = 0
    samples: int = 0
    #: Samples that never came, by the steps of the controller's clock.
    missed: int = 0
    #: Times that samples were missed in a row, or one was.
    gaps: int = 0
    #: Longest step of the controller's clock from sample to sample, s.
    longest_gap_s: float = 0.0
    #: Reads repeated because a new sample came in the middle.
    torn: int = 0
    #: Times that the controller's clock went back.
    steps_back: int = 0
    #: As the controller reports them; 0 and -1 before it does.
    safety_mode: int = 0
    robot_mode: int = -1

    @property
    def safety(self) -> str:
        """The safety mode in words."""
        return SAFETY_MODES.get(self.safety_mode, "not known")

    @property
    def stopped_for_safety(self) -> bool:
        """Whether the robot stands for safety's sake."""
        return self.safety_mode not in (0, *_RUNNING_SAFELY)


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


def check_tool(host: str, expected: Sequence[float], timeout_s: float) -> None:
    """Compare the controller's tool centre point with the expected one, where it tells it.

    Parameters
    ----------
    host : str
        The controller's address.
    expected : sequence of float, length 6
        x y z in metres, rotation vector in rad.
    timeout_s : float
        Longest wait, s.

    Raises
    ------
    OtherToolError
        If they differ by more than 0.1 mm or 1 mrad.
    """
    found = read_tcp_offset(host, timeout_s)
    if found is not None:
        _compare_tools(host, found, expected)


def _compare_tools(host: str, found: Sequence[float], expected: Sequence[float]) -> None:
    away_m = math.dist(found[:3], expected[:3])
    ours, theirs = (rotation_vector_to_quaternion(v[3:]) for v in (expected, found))
    turned = 2 * math.acos(min(1.0, abs(float(ours @ theirs))))
    if away_m > _SAME_TOOL_M or turned > _SAME_TOOL_RAD:
        raise OtherToolError(
            f"robot {host}: its tool centre point ({', '.join(f'{v:.5g}' for v in found)}) is "
            f"{away_m * 1e3:.2f} mm and {math.degrees(turned):.2f} deg from the one that the "
            "camera's place was found with (tcp_offset): set it on the controller, or calibrate"
        )


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
    clock_ns : callable
        The host's time, ns.
    connect_timeout_s, retry_s, silence_s : float
        See `Ur10Parameters`.
    tcp_offset : sequence of float
        See `check_tool`, which is asked again while poses come; another length: not checked.
    """

    def __init__(
        self,
        host: str,
        on_sample: Callable[[RobotSample], None],
        *,
        on_change: Callable[[str, str], None] | None = None,
        clock_ns: Callable[[], int] = time.time_ns,
        connect_timeout_s: float = 2.0,
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
        self._tcp_offset = tcp_offset
        self._has_force = False
        self._other_tool: OtherToolError | None = None
        self.status = ReceiverStatus()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="robot", daemon=True)
        self._tool_thread = threading.Thread(target=self._watch_tool, name="tool", daemon=True)

    def start(self) -> None:
        """Start to look for the robot."""
        self._thread.start()
        if len(self._tcp_offset) == 6:
            self._tool_thread.start()

    def stop(self) -> None:
        """Close the connection and end."""
        self._stop.set()
        for thread in (self._thread, self._tool_thread):
            if thread.is_alive():
                thread.join(timeout=10.0)

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
                if len(self._tcp_offset) == 6:
                    check_tool(self._host, self._tcp_offset, self._connect_timeout_s)
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
                interface.disconnect()
        self._change(STOPPED, "")

    def _watch_tool(self) -> None:
        """See whether a program sets another tool while poses come: they would be of that one."""
        while not self._stop.is_set():
            try:
                for found in tcp_offsets(self._host, self._connect_timeout_s):
                    if self._stop.is_set():
                        return
                    if self.status.state == RECEIVING:
                        _compare_tools(self._host, found, self._tcp_offset)
            except OtherToolError as error:
                self._other_tool = error
            except RobotFault:
                pass  # who receives the poses sees it too
            self._stop.wait(self._retry_s)

    def _receive(self, interface: Any, controller: Controller) -> None:
        period_ns = controller.period_ns
        period_s = period_ns * 1e-9
        s = self.status
        last_ns, last_seen = -1, time.monotonic()
        self._other_tool = None
        while not self._stop.is_set():
            if self._other_tool is not None:
                raise self._other_tool
            stamp = interface.getTimestamp()
            now = time.monotonic()
            controller_ns = round(stamp * 1e9)
            if controller_ns == last_ns or stamp == 0.0:
                if not interface.isConnected():
                    raise RobotLostError(f"robot {self._host}: the connection was lost")
                if now - last_seen > self._silence_s:
                    raise RobotLostError(
                        f"robot {self._host}: nothing came for {self._silence_s:g} s"
                    )
                time.sleep(_POLL_S)
                continue
            sample = self._untorn(interface, stamp)
            if s.state != RECEIVING:
                self._change(RECEIVING, "")
            # A torn read ends with a newer sample than it began with.
            controller_ns = sample.controller_ns
            if last_ns >= 0:
                step = controller_ns - last_ns
                if step < 0:
                    s.steps_back += 1
                elif step > 1.5 * period_ns:
                    s.missed += round(step / period_ns) - 1
                    s.gaps += 1
                s.longest_gap_s = max(s.longest_gap_s, step * 1e-9)
            last_ns, last_seen = controller_ns, now
            s.samples += 1
            self._on_sample(sample)
            # The next one is most of a period away; then look often.
            time.sleep(0.7 * period_s)

    def _untorn(self, interface: Any, stamp: float) -> RobotSample:
        """Read until the time stamp is the same before and after."""
        while True:
            arrival_ns = self._clock_ns()
            pose = tuple(interface.getActualTCPPose())
            speed = tuple(interface.getActualTCPSpeed())
            wrench = tuple(interface.getActualTCPForce()) if self._has_force else ()
            self.status.safety_mode = int(interface.getSafetyMode())
            self.status.robot_mode = int(interface.getRobotMode())
            after = interface.getTimestamp()
            if after == stamp:
                return RobotSample(round(stamp * 1e9), arrival_ns, pose, speed, wrench)
            self.status.torn += 1
            stamp = after

"""A model of the DVXplorer Mini: answers control requests and sends a stream of words."""

import threading
import time
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from roller_driver.dvxplorer import protocol as p

MAX_PACKET = 1024


class Stall(Exception):
    """The device answers with a STALL."""


@dataclass
class Fault:
    """Something that happens once `at_byte` bytes of the stream were sent.

    `kind` is one of stall, unplug, short (one short transfer) and silence (`seconds` long).
    """

    at_byte: int
    kind: str
    seconds: float = 0.0


@dataclass
class CameraModel:
    """One camera.

    Parameters
    ----------
    stream : bytes
        What it sends after it is started; the words of a scan.
    firmware, model : int
        Low and high byte of bcdDevice.
    serial : str
        Serial number.
    faults : list of Fault
        What goes wrong, in the order of their places.
    bytes_per_s : float
        Pace of the stream; 0: as fast as it is read.
    endpoint_delay_s : float
        How long after it was opened the event endpoint appears.
    alternate : int
        Alternate setting of the interface that has the event endpoint.
    unanswered : set of (module, parameter)
        Reads that it never answers.
    repeat_ms : int
        Not 0: the stream begins again when it ends, so many milliseconds later in its own time.
    """

    stream: bytes = b""
    firmware: int = 10
    model: int = p.MODEL_MINI
    serial: str = "DVX00042"
    faults: list[Fault] = field(default_factory=list)
    bytes_per_s: float = 0.0
    endpoint_delay_s: float = 0.0
    alternate: int = 0
    unanswered: set[tuple[int, int]] = field(default_factory=set)
    repeat_ms: int = 0

    def __post_init__(self) -> None:
        self.values: dict[tuple[int, int], int] = {
            (p.MODULE_DVS, p.DVS_WIDTH): p.WIDTH,
            (p.MODULE_DVS, p.DVS_HEIGHT): p.HEIGHT,
            (p.MODULE_DVS, p.DVS_ORIENTATION): 0,
            (p.MODULE_IMU, p.IMU_TYPE): 1,
            (p.MODULE_IMU, p.IMU_ORIENTATION): 0,
        }
        if self.firmware < p.FIRST_NEW_FIRMWARE:
            self.values |= {
                (p.MODULE_SYSTEM, p.SYSTEM_LOGIC_VERSION): p.LOGIC_VERSION,
                (p.MODULE_SYSTEM, p.SYSTEM_LOGIC_PATCH): p.LEAST_LOGIC_PATCH,
                (p.MODULE_SYSTEM, p.SYSTEM_CHIP): 20,
            }
        self.log: list[tuple[str, int, int, int]] = []
        self.plugged = True
        self.open_count = 0
        self.halted = False
        self.sent = 0
        self._began = 0.0
        self._opened = 0.0
        self._silent_until = 0.0
        self._position = 0
        self._pending = deque(sorted(self.faults, key=lambda f: f.at_byte))
        self._changed = threading.Condition()

    @property
    def streaming(self) -> bool:
        """Whether it was asked to send."""
        if self.firmware >= p.FIRST_NEW_FIRMWARE:
            return self.values.get((p.MODULE_DVS, p.DVS_RUN), 0) == 1
        return self.values.get((p.MODULE_SENSOR, p.REG_MODE), 0) == p.MODE_STREAM

    def opened(self) -> None:
        """A program opened it."""
        self.open_count += 1
        self._opened = time.monotonic()

    @property
    def has_endpoint(self) -> bool:
        """Whether the event endpoint is there yet."""
        return time.monotonic() - self._opened >= self.endpoint_delay_s

    def unplug(self) -> None:
        """Pull the cable; all state is lost."""
        with self._changed:
            self._lose_state()
            self._changed.notify_all()

    def plug(self, stream: bytes | None = None) -> None:
        """Plug it in again, perhaps to send something else."""
        if stream is not None:
            self.stream = stream
            self._position = 0
        self.plugged = True

    def control_out(self, request: int, value: int, index: int, data: bytes) -> None:
        """Answer a vendor OUT request."""
        if request in (p.REQUEST_LOG_LEVEL, p.REQUEST_FLUSH):
            if self.firmware < p.FIRST_NEW_FIRMWARE:
                raise Stall
            self.log.append(("vendor", request, value, index))
            return
        if request != p.REQUEST_PARAMETER or len(data) != p.value_length(self.firmware):
            raise Stall
        was = self.streaming
        with self._changed:
            number = int.from_bytes(data, "big")
            self.values[value, index] = number
            self.log.append(("write", value, index, number))
            if self.streaming and not was:
                self._began = time.monotonic()
                self.sent = 0
            self._changed.notify_all()

    def control_in(self, request: int, value: int, index: int, length: int) -> bytes | None:
        """Answer a vendor IN request; None: not at all."""
        self.log.append(("read", value, index, length))
        if (value, index) in self.unanswered:
            return None
        if request != p.REQUEST_PARAMETER or length != p.value_length(self.firmware):
            raise Stall
        return self.values.get((value, index), 0).to_bytes(length, "big")

    def clear_halt(self) -> None:
        """End a halt of the event endpoint."""
        self.halted = False
        self.log.append(("clear_halt", p.DATA_ENDPOINT, 0, 0))

    def read(self, size: int, timeout_s: float) -> bytes | None:
        """Next bytes of the stream; None when none come in time.

        Raises
        ------
        Stall
            If the endpoint is halted.
        ConnectionError
            If it isn't plugged in.
        """
        end = time.monotonic() + timeout_s
        with self._changed:
            while True:
                if not self.plugged:
                    raise ConnectionError
                if self.halted:
                    raise Stall
                length = self._ready(size)
                if length:
                    data = self.stream[self._position : self._position + length]
                    self._position += length
                    self.sent += length
                    if self.repeat_ms and self._position >= len(self.stream):
                        self.stream = _later(self.stream, self.repeat_ms)
                        self._position = 0
                    return data
                wait = end - time.monotonic()
                if wait <= 0:
                    return None
                self._changed.wait(min(wait, 0.002))

    def _ready(self, size: int) -> int:
        """Bytes that can be sent now; applies a fault that is due."""
        if not self.streaming or time.monotonic() < self._silent_until:
            return 0
        length = min(size, len(self.stream) - self._position)
        if self.bytes_per_s:
            due = int((time.monotonic() - self._began) * self.bytes_per_s) - self.sent
            # Whole bus packets, as long as more is to come.
            due = due // MAX_PACKET * MAX_PACKET if due < length else length
            length = min(length, due)
        if not self._pending:
            return length
        ahead = self._pending[0].at_byte - self._position
        if ahead > 0:
            return min(length, ahead)
        fault = self._pending.popleft()
        if fault.kind == "short":
            return min(length, 10)
        if fault.kind == "stall":
            self.halted = True
        elif fault.kind == "silence":
            self._silent_until = time.monotonic() + fault.seconds
        elif fault.kind == "unplug":
            self._lose_state()
        return 0

    def _lose_state(self) -> None:
        self.plugged = False
        self.halted = False
        for key in [(p.MODULE_DVS, p.DVS_RUN), (p.MODULE_SENSOR, p.REG_MODE)]:
            self.values.pop(key, None)


def _later(stream: bytes, ms: int) -> bytes:
    """The same words, their references `ms` later."""
    words = np.frombuffer(stream, "<u4").copy()
    references = (words >> np.uint32(26)) == 2
    words[references] = 2 << 26 | (words[references] + np.uint32(ms)) & 0x3FFFFF
    return words.tobytes()

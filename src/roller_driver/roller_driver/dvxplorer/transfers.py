"""A thread that does nothing but read from the camera."""

from __future__ import annotations

import queue
import threading
from array import array
from collections.abc import Callable
from dataclasses import dataclass

from .device import CameraDevice
from .errors import CameraControlError, CameraLostError

_TIMEOUT_MS = 100
_MAX_STALLS = 10
_RUN_DELAY_S = 0.02


@dataclass(slots=True)
class TransferCounts:
    """What the USB layer did."""

    #: Reads that brought data, and how much.
    transfers: int = 0
    bytes: int = 0
    #: Reads that ran into the time-out without data.
    empty: int = 0
    #: Halts of the endpoint, cleared.
    stalls: int = 0
    #: Transfers thrown away because too much waited for the decoder.
    overruns: int = 0


@dataclass(frozen=True, slots=True)
class Transfer:
    """What one read brought."""

    data: bytes
    #: When, host's time, ns.
    arrival_ns: int
    #: Bytes thrown away since the one before.
    missing_bytes: int


class TransferReader:
    """Reads transfers into a queue, so that no other work holds up the USB layer.

    The queue is bounded by bytes, not by transfers: a camera may end one with every read-out frame,
    and then thousands a second hold little.

    Parameters
    ----------
    device : CameraDevice
        Set up, not yet running.
    clock_ns : callable
        The host's time, ns.
    counts : TransferCounts
        Counted on.
    transfer_bytes : int
        Size of one read.
    most_bytes : int
        Bytes that may wait for the decoder.
    """

    def __init__(
        self,
        device: CameraDevice,
        clock_ns: Callable[[], int],
        counts: TransferCounts,
        transfer_bytes: int,
        most_bytes: int,
    ) -> None:
        self._device = device
        self._clock_ns = clock_ns
        self._counts = counts
        self._buffer = array("B", bytes(transfer_bytes))
        self._most_bytes = most_bytes
        self._waiting: queue.SimpleQueue[Transfer] = queue.SimpleQueue()
        # Each is written by one thread alone.
        self._put_bytes = self._got_bytes = self._missing_bytes = 0
        self._fault: Exception | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="usb", daemon=True)
        self._starter = threading.Timer(_RUN_DELAY_S, self._start_stream)
        self._starter.daemon = True

    def start(self) -> None:
        """Begin to read, and then let the camera begin to send."""
        self._device.prepare()
        self._thread.start()
        self._starter.start()

    def next(self, timeout_s: float) -> Transfer | None:
        """The next transfer; None when none came in time.

        Raises
        ------
        Exception
            What ended the reading, once all that came before is handed out: a `CameraFault`, or
            what is a fault of ours.
        """
        try:
            transfer = self._waiting.get(timeout=timeout_s)
        except queue.Empty:
            if self._fault is not None:
                raise self._fault from None
            return None
        self._got_bytes += len(transfer.data)
        return transfer

    def stop(self) -> None:
        """End the thread; the camera is left running."""
        self._stop.set()
        self._starter.cancel()
        self._starter.join(timeout=3.0)
        self._thread.join(timeout=3.0)

    def _start_stream(self) -> None:
        try:
            self._device.run()
        except Exception as error:  # who asks for the next transfer is told
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        self._fault = self._fault or error
        self._stop.set()

    def _run(self) -> None:
        try:
            self._read()
        except Exception as error:
            self._fail(error)

    def _read(self) -> None:
        stalls = 0
        view = memoryview(self._buffer)
        while not self._stop.is_set():
            try:
                length = self._device.read(self._buffer, _TIMEOUT_MS)
            except CameraControlError as error:
                stalls += 1
                self._counts.stalls += 1
                if stalls > _MAX_STALLS:
                    raise CameraLostError(f"{error} {stalls} times in a row") from error
                self._device.clear_halt()
                continue
            arrival_ns = self._clock_ns()
            stalls = 0
            if not length:
                self._counts.empty += 1
                continue
            self._counts.transfers += 1
            self._counts.bytes += length
            if self._put_bytes - self._got_bytes + length > self._most_bytes:
                self._counts.overruns += 1
                self._missing_bytes += length
            else:
                self._put_bytes += length
                self._waiting.put(Transfer(bytes(view[:length]), arrival_ns, self._missing_bytes))
                self._missing_bytes = 0

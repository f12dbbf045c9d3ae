"""Keeps a camera streaming: connects, decodes, cuts packets, and connects again when it's lost."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

from roller_core.events import EventArray
from roller_core.watched_thread import OnFailure, WatchedThread

from .camera_settings import SensorSettings
from .decoder import DecoderCounts, WordDecoder
from .device import CameraDevice
from .errors import CameraFault, CameraLostError
from .packets import EventPart, Packetiser
from .transfers import TransferCounts, TransferReader

SEARCHING = "searching"
STREAMING = "streaming"
SILENT = "silent"
STOPPED = "stopped"

_SILENT_S = 2.0
_POLL_S = 0.05
#: What may wait for the decoder: a second of a busy scan.
_MOST_BYTES = 32 << 20


@dataclass(frozen=True, slots=True)
class ReaderSettings:
    """How the stream is read and cut."""

    #: Longest packet, ns of sensor time.
    span_ns: int = 1_000_000
    #: Most events a packet.
    max_events: int = 48_000
    #: Size of one USB read.
    transfer_bytes: int = 65536
    #: Pause between attempts to connect, s.
    retry_s: float = 1.0


@dataclass(frozen=True, slots=True)
class ReaderStatus:
    """How the reader is."""

    #: `searching`, `streaming`, `silent` (streaming, but nothing came for 2 s) or `stopped`.
    state: str = STOPPED
    #: What keeps it from streaming, or what ended the stream last time; empty: nothing yet.
    fault: str = ""
    #: Name of the camera, and its firmware.
    camera: str = ""
    firmware: int = 0
    #: Times that a camera began to stream.
    connects: int = 0
    #: Packets handed out.
    packets: int = 0
    #: Faults of the stream.
    decoder: DecoderCounts = field(default_factory=DecoderCounts)
    #: What the USB layer did.
    usb: TransferCounts = field(default_factory=TransferCounts)


class CameraReader:
    """Streams from the camera in threads of its own until it is stopped.

    Parameters
    ----------
    connect : callable
        Opens the camera and sets it up, or raises a `CameraFault`; tried again until it succeeds.
    on_packet : callable
        Takes each packet, in the reader's thread.
    on_events : callable
        Takes each transfer's events, in the reader's thread; its arrays are used again.
    on_change : callable
        Takes each new state and its fault.
    on_failure : callable, optional
        Takes what ended its thread, which is a fault of ours: see `WatchedThread`.
    settings : ReaderSettings
        How the stream is read.
    clock_ns : callable
        The host's time, ns.
    """

    def __init__(
        self,
        connect: Callable[[], CameraDevice],
        on_packet: Callable[[EventPart], None],
        *,
        on_events: Callable[[EventArray], None] | None = None,
        on_change: Callable[[str, str], None] | None = None,
        on_failure: OnFailure | None = None,
        settings: ReaderSettings | None = None,
        clock_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._connect = connect
        self._on_packet = on_packet
        self._on_events = on_events
        self._on_change = on_change
        self._settings = settings or ReaderSettings()
        self._clock_ns = clock_ns
        self._decoder = WordDecoder(words=self._settings.transfer_bytes // 4 + 1)
        self._packetiser = Packetiser(self._settings.span_ns, self._settings.max_events, self._emit)
        self._usb = TransferCounts()
        self._state, self._fault, self._camera = STOPPED, "", ""
        self._firmware = self._connects = self._packets = 0
        self._device: CameraDevice | None = None
        self._stop = threading.Event()
        self._thread = WatchedThread("event camera", self._run, self._stop, on_failure)

    def start(self) -> None:
        """Start to look for the camera."""
        self._thread.start()

    def stop(self) -> None:
        """Stop the stream and let go of the camera."""
        self._thread.end(10.0)

    def set_biases(self, settings: SensorSettings) -> None:
        """Set the biases of the camera that streams, if one does.

        Raises
        ------
        CameraControlError
            If it refuses them.
        """
        if (device := self._device) is not None:
            with suppress(CameraLostError):
                device.set_biases(settings)

    @property
    def status(self) -> ReaderStatus:
        """How it is now."""
        return ReaderStatus(
            state=self._state,
            fault=self._fault,
            camera=self._camera,
            firmware=self._firmware,
            connects=self._connects,
            packets=self._packets,
            decoder=self._decoder.counts,
            usb=self._usb,
        )

    def _emit(self, part: EventPart) -> None:
        self._packets += 1
        self._on_packet(part)

    def _change(self, state: str, fault: str | None = None) -> None:
        new = self._fault if fault is None else fault
        if (state, new) != (self._state, self._fault):
            self._state, self._fault = state, new
            if self._on_change is not None:
                self._on_change(state, new)

    def _run(self) -> None:
        self._change(SEARCHING)
        while not self._stop.is_set():
            try:
                device = self._connect()
            except CameraFault as error:
                self._change(SEARCHING, str(error))
                self._stop.wait(self._settings.retry_s)
                continue
            try:
                self._device = device
                self._stream(device)
            except CameraFault as error:
                self._device = None
                self._change(SEARCHING, str(error))
                self._stop.wait(min(self._settings.retry_s, 0.2))
            finally:
                self._device = None
                device.close()
                self._packetiser.flush()
        self._change(STOPPED)

    def _stream(self, device: CameraDevice) -> None:
        s = self._settings
        self._camera, self._firmware = device.name, device.firmware
        # A camera that restarts counts its time from zero again.
        self._decoder.reset()
        reader = TransferReader(device, self._clock_ns, self._usb, s.transfer_bytes, _MOST_BYTES)
        reader.start()
        self._connects += 1
        self._change(STREAMING, "")
        last = time.monotonic()
        try:
            while not self._stop.is_set():
                transfer = reader.next(_POLL_S)
                now = time.monotonic()
                if transfer is None:
                    self._packetiser.tick(self._clock_ns())
                    if now - last > _SILENT_S:
                        self._change(SILENT, "the camera sends nothing")
                    continue
                last = now
                if self._state != STREAMING:
                    self._change(STREAMING, "")
                if transfer.missing_bytes:
                    self._decoder.leave_gap(transfer.missing_bytes)
                events = self._decoder.decode(transfer.data)
                if len(events):
                    if self._on_events is not None:
                        self._on_events(events)
                    self._packetiser.add(events, transfer.arrival_ns)
        finally:
            reader.stop()

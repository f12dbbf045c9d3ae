"""One open camera: set up, started, read and stopped."""

from __future__ import annotations

import contextlib
import errno
import time
from array import array
from collections.abc import Iterator, Sequence
from typing import Any

import usb.core
import usb.util

from . import protocol as p
from . import sequences
from .camera_settings import SensorSettings
from .errors import CameraControlError, CameraFault, CameraLostError, UnknownFirmwareError
from .protocol import ClearHalt, Read, Step, Vendor, Wait, Write

_CONTROL_TIMEOUT_MS = 1000
_OPTIONAL_TIMEOUT_MS = 250


class CameraDevice:
    """An open camera; made by `discovery.open_camera`.

    Parameters
    ----------
    device : usb.core.Device
        Configured, its interface claimed.
    firmware : int
        Low byte of bcdDevice.
    serial : str
        Serial number; empty where it can't be read.
    """

    def __init__(self, device: Any, firmware: int, serial: str) -> None:
        self._device = device
        self.firmware = firmware
        self.serial = serial
        self.orientation = 0
        self._thresholds = (-1, -1)

    @property
    def name(self) -> str:
        """Name for messages."""
        return f"DVXplorer Mini {self.serial or '(no serial number)'}"

    def identify(self) -> None:
        """Check who it is.

        Raises
        ------
        UnknownFirmwareError
            If it answers as no known camera does.
        CameraControlError
            If it doesn't answer.
        """
        self._send(sequences.identify(self.firmware))

    def configure(self, settings: SensorSettings) -> None:
        """Check who it is and set the sensor up.

        Raises
        ------
        UnknownFirmwareError
            If it answers as no known camera does.
        CameraControlError
            If it refuses a setting or doesn't answer.
        """
        self.identify()
        self._thresholds = settings.contrast_threshold_on, settings.contrast_threshold_off
        self._send(sequences.configure(self.firmware, settings, self.orientation))

    @property
    def ignored(self) -> str:
        """What of the settings the camera doesn't have, in words; empty: nothing."""
        if self.firmware >= p.FIRST_NEW_FIRMWARE or self._thresholds == (-1, -1):
            return ""
        return (
            f"firmware {self.firmware} has no contrast_threshold_on and _off: set bias_sensitivity"
        )

    def set_biases(self, settings: SensorSettings) -> None:
        """Set the biases, also while it streams.

        Raises
        ------
        CameraControlError
            If the camera refuses them, or has no setting that is changed.
        """
        before = self._thresholds
        self._thresholds = settings.contrast_threshold_on, settings.contrast_threshold_off
        if self._thresholds != before and self.ignored:
            why, self._thresholds = self.ignored, before
            raise CameraControlError(f"{self.name}: {why}")
        self._send(sequences.set_biases(self.firmware, settings))

    def prepare(self) -> None:
        """Make ready for reading; call before the first `read`."""
        self._send(sequences.before_reading(self.firmware))

    def run(self) -> None:
        """Begin the stream; call while a `read` waits, or the first data may be lost."""
        self._send(sequences.run(self.firmware))

    def read(self, buffer: array[int], timeout_ms: int) -> int:
        """Read one transfer.

        Returns
        -------
        int
            Bytes read; 0 when none came in time.

        Raises
        ------
        CameraControlError
            When the endpoint is halted; clear it with `clear_halt`.
        CameraLostError
            When the camera is gone.
        """
        try:
            return int(self._device.read(p.DATA_ENDPOINT, buffer, timeout_ms))
        except usb.core.USBTimeoutError:
            return 0
        except usb.core.USBError as error:
            if error.errno == errno.EPIPE:
                raise CameraControlError(f"{self.name}: the event endpoint stalled") from error
            raise CameraLostError(f"{self.name}: reading failed ({error.strerror})") from error

    def clear_halt(self) -> None:
        """Clear the data endpoint's halt."""
        self._send((ClearHalt(),))

    def close(self) -> None:
        """Stop the stream, as far as the camera still listens, and let go of it."""
        with contextlib.suppress(CameraFault):
            self._send(sequences.stop(self.firmware))
        self.let_go()

    def let_go(self) -> None:
        """Let go of it as it is."""
        with contextlib.suppress(usb.core.USBError):
            usb.util.dispose_resources(self._device)

    def _send(self, steps: Sequence[Step]) -> None:
        for step in steps:
            try:
                self._step(step)
            except usb.core.USBError as error:
                if error.errno == errno.ENODEV:
                    raise CameraLostError(f"{self.name}: it was unplugged") from error
                raise CameraControlError(
                    f"{self.name}: {step} failed ({error.strerror}); unplug it and plug it in again"
                ) from error

    def _step(self, step: Step) -> None:
        if isinstance(step, Wait):
            time.sleep(step.seconds)
        elif isinstance(step, ClearHalt):
            self._device.clear_halt(p.DATA_ENDPOINT)
        elif isinstance(step, Write):
            value = step.value.to_bytes(p.value_length(self.firmware), "big")
            self._control(p.VENDOR_OUT, p.REQUEST_PARAMETER, step.module, step.parameter, value)
        elif isinstance(step, Vendor):
            with _unless_gone():
                self._control(p.VENDOR_OUT, step.request, step.value, 0, b"", False)
        else:
            self._read_parameter(step)

    def _read_parameter(self, step: Read) -> None:
        length = p.value_length(self.firmware)
        where = (p.VENDOR_IN, p.REQUEST_PARAMETER, step.module, step.parameter)
        if step.required:
            answer = self._control(*where, length)
        else:
            answer = b""
            with _unless_gone():
                answer = self._control(*where, length, False)
        if len(answer) != length:
            if step.required:
                raise UnknownFirmwareError(f"{self.name}: no answer for its {step.what}")
            return
        value = int.from_bytes(answer, "big")
        wanted = step.exactly if step.exactly is not None else step.at_least
        wrong = (step.exactly is not None and value != step.exactly) or (
            step.at_least is not None and value < step.at_least
        )
        if wrong:
            raise UnknownFirmwareError(
                f"{self.name}: its {step.what} is {value}, known is {wanted}; update the camera's "
                "firmware with the vendor's tool"
            )
        if (step.module, step.parameter) == (p.MODULE_DVS, p.DVS_ORIENTATION):
            self.orientation = value

    def _control(
        self, kind: int, request: int, value: int, index: int, data: Any, required: bool = True
    ) -> bytes:
        timeout = _CONTROL_TIMEOUT_MS if required else _OPTIONAL_TIMEOUT_MS
        answer = self._device.ctrl_transfer(kind, request, value, index, data, timeout)
        return bytes(answer) if kind & 0x80 else b""


@contextlib.contextmanager
def _unless_gone() -> Iterator[None]:
    """Let a request go unanswered, but not a camera go missing."""
    try:
        yield
    except usb.core.USBError as error:
        if error.errno == errno.ENODEV:
            raise

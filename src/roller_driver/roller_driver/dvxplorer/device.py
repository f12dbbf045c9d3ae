"""One camera: found, opened, set up, started, read and stopped."""

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
from .errors import (
    CameraBusyError,
    CameraControlError,
    CameraFault,
    CameraLostError,
    CameraNotFoundError,
    CameraPermissionError,
    EndpointMissingError,
    UnknownFirmwareError,
    WrongDeviceError,
)
from .protocol import ClearHalt, Read, Step, Vendor, Wait, Write
from .settings import SensorSettings

UDEV_RULE = "99-roller-event-camera.rules"
_CONTROL_TIMEOUT_MS = 1000
_OPTIONAL_TIMEOUT_MS = 250
_ENDPOINT_WAIT_S = 2.0


class CameraDevice:
    """An open camera; made by `open_camera`.

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

    @property
    def name(self) -> str:
        """Name for messages."""
        return f"DVXplorer Mini {self.serial or '(no serial number)'}"

    def configure(self, settings: SensorSettings) -> None:
        """Check who it is and set the sensor up.

        Raises
        ------
        UnknownFirmwareError
            If it answers as no known camera does.
        CameraControlError
            If it refuses a setting or doesn't answer.
        """
        self._send(sequences.identify(self.firmware))
        self._send(sequences.configure(self.firmware, settings, self.orientation))

    def prepare(self) -> None:
        """Make ready for reading; call before the first `read`."""
        self._send(sequences.before_reading(self.firmware))

    def run(self) -> None:
        """Begin the stream; call while a `read` waits, or the first data may be lost."""
        self._send(sequences.run(self.firmware))

    def reset_time(self) -> bool:
        """Set the sensor's clock to zero; False where the firmware has no known way to."""
        steps = sequences.reset_time(self.firmware)
        self._send(steps)
        return bool(steps)

    def read(self, buffer: array[int], timeout_ms: int) -> int:
        """Read one transfer.

        Parameters
        ----------
        buffer : array of 'B'
            Takes the data.
        timeout_ms : int
            Longest wait.

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


def open_camera(backend: Any, serial: str = "") -> CameraDevice:
    """Find a camera and take hold of it.

    Parameters
    ----------
    backend : usb.backend.IBackend
        The USB library.
    serial : str
        Serial number; empty: the first camera found.

    Raises
    ------
    CameraNotFoundError, WrongDeviceError, UnknownFirmwareError, CameraPermissionError
        As their names say.
    CameraBusyError, EndpointMissingError, CameraLostError
        As their names say.
    """
    device, found = _find(backend, serial)
    name = f"DVXplorer Mini {found}".strip()
    model, firmware = device.bcdDevice >> 8, device.bcdDevice & 0xFF
    if model != p.MODEL_MINI:
        raise WrongDeviceError(
            f"the device {p.VENDOR_ID:04x}:{p.PRODUCT_ID:04x} {found} is not a DVXplorer Mini "
            f"(model {model}, not {p.MODEL_MINI}); this driver knows no other"
        )
    if firmware < p.OLDEST_FIRMWARE:
        raise UnknownFirmwareError(
            f"{name}: firmware {firmware} is not known, {p.OLDEST_FIRMWARE} is the oldest that is; "
            "update it with the vendor's tool"
        )
    try:
        _claim(device, name)
    except usb.core.USBError as error:
        usb.util.dispose_resources(device)
        raise _fault(error, name) from error
    except CameraFault:
        usb.util.dispose_resources(device)
        raise
    return CameraDevice(device, firmware, found)


def _find(backend: Any, serial: str) -> tuple[Any, str]:
    devices = usb.core.find(
        find_all=True, backend=backend, idVendor=p.VENDOR_ID, idProduct=p.PRODUCT_ID
    )
    others = []
    for device in devices:
        try:
            found = device.serial_number or ""
        except (usb.core.USBError, ValueError) as error:
            _raise_if_not_permitted(device, error)
            found = ""
        if serial in ("", found):
            return device, found
        others.append(found or "(none)")
        usb.util.dispose_resources(device)
    if others:
        raise CameraNotFoundError(
            f"no DVXplorer Mini with serial number '{serial}'; plugged in: {', '.join(others)}"
        )
    raise CameraNotFoundError(
        f"no DVXplorer Mini is plugged in (no USB device {p.VENDOR_ID:04x}:{p.PRODUCT_ID:04x})"
    )


def _raise_if_not_permitted(device: Any, error: Exception) -> None:
    """Tell a device that may not be opened from one without a serial number."""
    try:
        device.get_active_configuration()
    except usb.core.USBError as reason:
        if reason.errno in (errno.EACCES, errno.EPERM, errno.EBUSY, errno.ENODEV):
            raise _fault(reason, "the DVXplorer Mini") from error


def _claim(device: Any, name: str) -> None:
    """Set the configuration, claim the interface and find the endpoint, which may come late."""
    try:
        active = device.get_active_configuration().bConfigurationValue
    except usb.core.USBError as error:
        if error.errno is not None:
            raise
        active = 0
    if active != p.CONFIGURATION:
        device.set_configuration(p.CONFIGURATION)
    usb.util.claim_interface(device, p.INTERFACE)
    end = time.monotonic() + _ENDPOINT_WAIT_S
    while True:
        for interface in device.get_active_configuration():
            if interface.bInterfaceNumber != p.INTERFACE:
                continue
            if any(e.bEndpointAddress == p.DATA_ENDPOINT for e in interface):
                if interface.bAlternateSetting != 0:
                    interface.set_altsetting()
                return
        if time.monotonic() > end:
            raise EndpointMissingError(
                f"{name}: it has no endpoint 0x{p.DATA_ENDPOINT:02x} for events; unplug it and "
                "plug it in again"
            )
        time.sleep(0.1)


def _fault(error: Any, name: str) -> CameraFault:
    if error.errno in (errno.EACCES, errno.EPERM):
        return CameraPermissionError(
            f"{name}: no permission to open it; install the rule with 'sudo cp config/{UDEV_RULE} "
            "/etc/udev/rules.d/ && sudo udevadm control --reload' and plug the camera in again"
        )
    if error.errno == errno.EBUSY:
        return CameraBusyError(f"{name}: another program holds it; stop that program first")
    if error.errno in (errno.ENODEV, errno.EIO):
        return CameraLostError(f"{name}: it went away while it was opened")
    return CameraControlError(f"{name}: it can't be opened ({error.strerror or error})")

"""Finds a camera and takes hold of it."""

from __future__ import annotations

import errno
import time
from typing import Any

import usb.core
import usb.util

from . import protocol as p
from .device import CameraDevice
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

UDEV_RULE = "99-roller-event-camera.rules"
_ENDPOINT_WAIT_S = 2.0


def open_camera(backend: Any, serial: str = "") -> CameraDevice:
    """Find a camera and take hold of it.

    Parameters
    ----------
    backend : usb.backend.IBackend
        The USB library.
    serial : str
        Serial number; empty: the first camera that can be taken.

    Raises
    ------
    CameraNotFoundError, WrongDeviceError, UnknownFirmwareError, CameraPermissionError
        As their names say; where there are several devices, of the first of them.
    CameraBusyError, EndpointMissingError, CameraLostError
        As their names say.
    """
    devices = usb.core.find(
        find_all=True, backend=backend, idVendor=p.VENDOR_ID, idProduct=p.PRODUCT_ID
    )
    faults: list[CameraFault] = []
    others = []
    for device in devices:
        try:
            found = _serial_number(device)
            if serial in ("", found):
                return _open(device, found)
            others.append(found or "(none)")
        except CameraFault as error:
            faults.append(error)
        usb.util.dispose_resources(device)
    if faults:
        raise faults[0]
    if others:
        raise CameraNotFoundError(
            f"no DVXplorer Mini with serial number '{serial}'; plugged in: {', '.join(others)}"
        )
    raise CameraNotFoundError(
        f"no DVXplorer Mini is plugged in (no USB device {p.VENDOR_ID:04x}:{p.PRODUCT_ID:04x})"
    )


def _open(device: Any, serial: str) -> CameraDevice:
    name = f"DVXplorer Mini {serial}".strip()
    model, firmware = device.bcdDevice >> 8, device.bcdDevice & 0xFF
    if model != p.MODEL_MINI:
        raise WrongDeviceError(
            f"the device {p.VENDOR_ID:04x}:{p.PRODUCT_ID:04x} {serial} is not a DVXplorer Mini "
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
        raise _fault(error, name) from error
    return CameraDevice(device, firmware, serial)


def _serial_number(device: Any) -> str:
    """A device's serial number; empty if it has none.

    Raises
    ------
    CameraFault
        If it can't be asked: of a device that may not be opened.
    """
    try:
        return device.serial_number or ""
    except (usb.core.USBError, ValueError) as error:
        # One that may not be opened, or one without a serial number.
        try:
            device.get_active_configuration()
        except usb.core.USBError as reason:
            if reason.errno in (errno.EACCES, errno.EPERM, errno.EBUSY, errno.ENODEV):
                raise _fault(reason, "the DVXplorer Mini") from error
        return ""


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

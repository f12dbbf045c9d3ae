"""A pyusb backend in process: the camera's model in place of libusb."""

from __future__ import annotations

import errno
import json
import os
import time
from array import array
from types import SimpleNamespace
from typing import Any

import numpy as np
import usb.backend
from usb.core import USBError, USBTimeoutError

from roller_driver.dvxplorer import protocol as p

from .camera_model import MAX_PACKET, CameraModel, Stall
from .paced_camera import PacedCamera

#: Environment variables that `from_environment` reads.
EVENTS_VARIABLE = "EMULATED_CAMERA_WORDS"
RATE_VARIABLE = "EMULATED_CAMERA_BYTES_PER_S"
REPEAT_VARIABLE = "EMULATED_CAMERA_REPEAT_MS"
PACE_VARIABLE = "EMULATED_CAMERA_PACE"
HELD_VARIABLE = "EMULATED_CAMERA_HELD"


def from_environment() -> EmulatedBackend:
    """A backend with one camera that sends the words in a file, over and over where asked.

    For nodes, which are processes of their own: parameter `backend` =
    `driver.emulation.usb_backend:from_environment`. EMULATED_CAMERA_PACE has the settings of a
    `PacedCamera` as JSON; with EMULATED_CAMERA_HELD another program holds the camera.
    """
    words = np.fromfile(os.environ[EVENTS_VARIABLE], "<u4")
    if PACE_VARIABLE in os.environ:
        pace = json.loads(os.environ[PACE_VARIABLE])
        return EmulatedBackend(PacedCamera(words.tobytes(), **pace))
    rate = float(os.environ.get(RATE_VARIABLE, "0"))
    repeat = int(os.environ.get(REPEAT_VARIABLE, "0"))
    backend = EmulatedBackend(CameraModel(words.tobytes(), bytes_per_s=rate, repeat_ms=repeat))
    backend.held = HELD_VARIABLE in os.environ
    return backend


class EmulatedBackend(usb.backend.IBackend):
    """Presents camera models as USB devices.

    Parameters
    ----------
    models : CameraModel
        Cameras on the bus.

    Attributes
    ----------
    forbidden : bool or set of str
        Whether opening is refused for want of permission; or the serial numbers of which it is.
    held : bool or set of str
        Whether another program holds the interface; or of which.
    """

    def __init__(self, *models: CameraModel) -> None:
        super().__init__()
        self.models = list(models)
        self.forbidden: bool | set[str] = False
        self.held: bool | set[str] = False

    def enumerate_devices(self) -> Any:
        return [model for model in self.models if model.plugged]

    def get_parent(self, dev: CameraModel) -> None:
        return None

    def get_device_descriptor(self, dev: CameraModel) -> Any:
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x0310, bDeviceClass=0, bDeviceSubClass=0,
            bDeviceProtocol=0, bMaxPacketSize0=9, idVendor=p.VENDOR_ID, idProduct=p.PRODUCT_ID,
            bcdDevice=dev.model << 8 | dev.firmware, iManufacturer=1, iProduct=2,
            iSerialNumber=3, bNumConfigurations=1, bus=1, address=2, port_number=1,
            port_numbers=(1,), speed=4,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev: CameraModel, config: int) -> Any:
        if config:
            raise IndexError
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=0, bNumInterfaces=1,
            bConfigurationValue=1, iConfiguration=0, bmAttributes=0x80, bMaxPower=50,
            extra_descriptors=[],
        )  # fmt: skip

    def get_interface_descriptor(self, dev: CameraModel, intf: int, alt: int, config: int) -> Any:
        if intf or config or alt > dev.alternate:
            raise IndexError
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=alt,
            bNumEndpoints=len(self._endpoints(dev, alt)), bInterfaceClass=255,
            bInterfaceSubClass=0, bInterfaceProtocol=0, iInterface=0, extra_descriptors=[],
        )  # fmt: skip

    def get_endpoint_descriptor(
        self, dev: CameraModel, ep: int, intf: int, alt: int, config: int
    ) -> Any:
        endpoints = self._endpoints(dev, alt)
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=endpoints[ep],
            bmAttributes=2 if endpoints[ep] == p.DATA_ENDPOINT else 3,
            wMaxPacketSize=MAX_PACKET, bInterval=0, bRefresh=0, bSynchAddress=0,
            extra_descriptors=[],
        )  # fmt: skip

    def _endpoints(self, dev: CameraModel, alt: int) -> list[int]:
        return [0x81, p.DATA_ENDPOINT] if dev.has_endpoint and alt == dev.alternate else [0x81]

    def open_device(self, dev: CameraModel) -> CameraModel:
        self._present(dev)
        if _among(self.forbidden, dev):
            raise USBError("Access denied (insufficient permissions)", -3, errno.EACCES)
        dev.opened()
        return dev

    def close_device(self, dev_handle: CameraModel) -> None:
        pass

    def set_configuration(self, dev_handle: CameraModel, config_value: int) -> None:
        self._present(dev_handle)

    def get_configuration(self, dev_handle: CameraModel) -> int:
        self._present(dev_handle)
        return 1

    def set_interface_altsetting(self, dev_handle: CameraModel, intf: int, alt: int) -> None:
        dev_handle.log.append(("alternate", intf, alt, 0))

    def claim_interface(self, dev_handle: CameraModel, intf: int) -> None:
        self._present(dev_handle)
        if _among(self.held, dev_handle):
            raise USBError("Resource busy", -6, errno.EBUSY)

    def release_interface(self, dev_handle: CameraModel, intf: int) -> None:
        self._present(dev_handle)

    def clear_halt(self, dev_handle: CameraModel, ep: int) -> None:
        self._present(dev_handle)
        dev_handle.clear_halt()

    def bulk_read(
        self, dev_handle: CameraModel, ep: int, intf: int, buff: array[int], timeout: int
    ) -> int:
        try:
            data = dev_handle.read(len(buff), timeout / 1000)
        except Stall:
            raise USBError("Pipe error", -9, errno.EPIPE) from None
        except ConnectionError:
            raise _gone() from None
        if data is None:
            raise USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)
        memoryview(buff)[: len(data)] = data
        return len(data)

    def ctrl_transfer(
        self,
        dev_handle: CameraModel,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: array[int],
        timeout: int,
    ) -> int:
        self._present(dev_handle)
        if bmRequestType == 0x80 and bRequest == 6:
            answer: bytes | None = string_descriptor(wValue & 0xFF, dev_handle)
        else:
            try:
                if not bmRequestType & 0x80:
                    dev_handle.control_out(bRequest, wValue, wIndex, bytes(data))
                    return len(data)
                answer = dev_handle.control_in(bRequest, wValue, wIndex, len(data))
            except Stall:
                raise USBError("Pipe error", -9, errno.EPIPE) from None
        if answer is None:
            time.sleep(timeout / 1000)
            raise USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)
        answer = answer[: len(data)]
        memoryview(data)[: len(answer)] = answer
        return len(answer)

    def _present(self, dev: CameraModel) -> None:
        if not dev.plugged:
            raise _gone()


def _gone() -> USBError:
    return USBError("No such device (it may have been disconnected)", -4, errno.ENODEV)


def string_descriptor(index: int, model: CameraModel) -> bytes:
    """String descriptor of the camera."""
    if index == 0:
        return b"\x04\x03\x09\x04"
    text = ["", "iniVation AG", "DVXplorer Mini", model.serial][index].encode("utf-16-le")
    return bytes([len(text) + 2, 3]) + text


def _among(which: bool | set[str], model: CameraModel) -> bool:
    return which if isinstance(which, bool) else model.serial in which

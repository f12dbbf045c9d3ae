"""Runs a program that sees an emulated camera through the real libusb.

    python -m driver.emulation.umockdev_host '{"words": "FILE", "firmware": 10}' PROGRAM ...

umockdev's library is preloaded into the program; this process answers its USB ioctls from the
camera's model. Needs Debian's umockdev, gir1.2-umockdev-1.0 and python3-gi, and to be root.
"""

# ruff: noqa: E402 (gi must be told its version before it is used)

import errno
import json
import os
import struct
import subprocess
import sys
import threading
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append("/usr/lib/python3/dist-packages")  # where Debian keeps gi

import gi

gi.require_version("UMockdev", "1.0")
from gi.repository import GLib, UMockdev

from driver.emulation.camera_model import CameraModel, Stall
from driver.emulation.usb_backend import string_descriptor
from roller_driver.dvxplorer import protocol as p

PRELOAD = "libumockdev-preload.so.0"
NODE = "/dev/bus/usb/001/002"

# From linux/usbdevice_fs.h, 64 bits.
SUBMIT, REAP, REAP_NOW, DISCARD = 0x8038550A, 0x4008550C, 0x4008550D, 0x550B
CAPABILITIES, CLEAR_HALT = 0x8004551A, 0x80045515
HARMLESS = {
    0x8004550F,  # claim interface
    0x80045510,  # release interface
    0x80045505,  # set configuration
    0x80085504,  # set interface
    0x80045503,  # reset endpoint
    0x5514,  # reset
    CLEAR_HALT,
}
URB = struct.Struct("=BB2xiI4xQiiiiiIQ")
STATUS_AT, BUFFER_AT, LENGTH_AT = 4, 16, 28
CONTROL, BULK = 2, 3
NO_SIZE_LIMIT = 0x04


class Urb:
    """A transfer the program submitted."""

    def __init__(self, data: Any) -> None:
        self.data = data
        fields = URB.unpack(bytes(data.retrieve()))
        self.kind, self.endpoint = fields[0], fields[1]
        self.length = fields[5]
        self.buffer = data.resolve(BUFFER_AT, self.length) if self.length else None

    def finish(self, status: int, length: int) -> None:
        """Write how it went into the program's memory."""
        self.data.update(STATUS_AT, struct.pack("=i", status))
        self.data.update(LENGTH_AT, struct.pack("=i", length))


class Handler(UMockdev.IoctlBase):
    """Answers the program's ioctls."""

    def __init__(self, model: CameraModel) -> None:
        super().__init__()
        self.model = model
        self.waiting: deque[Urb] = deque()
        self.finished: deque[Urb] = deque()

    def do_handle_ioctl(self, client: Any) -> bool:
        request, argument = client.get_request() & 0xFFFFFFFF, client.get_arg()
        result = (0, 0)
        if request == CAPABILITIES:
            # One URB a transfer, however long: a short one needs no cancelling of those behind it.
            argument.resolve(0, 4).update(0, struct.pack("=I", NO_SIZE_LIMIT))
        elif request == SUBMIT:
            self._submit(Urb(argument.resolve(0, URB.size)))
        elif request in (REAP, REAP_NOW):
            result = self._reap(argument)
        elif request == DISCARD:
            result = self._discard(bytes(argument.retrieve()))
        elif request in HARMLESS:
            if request == CLEAR_HALT:
                self.model.clear_halt()
        else:
            result = (-1, errno.ENOTTY)
        client.complete(*result)
        return True

    def _submit(self, urb: Urb) -> None:
        if urb.kind != CONTROL:
            self.waiting.append(urb)
            return
        raw = bytes(urb.buffer.retrieve())
        kind, request, value, index, length = struct.unpack("<BBHHH", raw[:8])
        try:
            if kind & 0x80:
                if kind == 0x80 and request == 6 and value >> 8 == 3:
                    answer: bytes | None = string_descriptor(value & 0xFF, self.model)
                elif kind == p.VENDOR_IN:
                    answer = self.model.control_in(request, value, index, length)
                else:
                    raise Stall
                answer = (answer or b"")[:length]
                if answer:
                    urb.buffer.update(8, answer)
                urb.finish(0, len(answer))
            else:
                if kind == p.VENDOR_OUT:
                    self.model.control_out(request, value, index, raw[8 : 8 + length])
                urb.finish(0, length)
        except Stall:
            urb.finish(-errno.EPIPE, 0)
        self.finished.append(urb)

    def _reap(self, argument: Any) -> tuple[int, int]:
        if not self.finished:
            self._send()
        if not self.finished:
            return (-1, errno.EAGAIN)
        argument.resolve(0, 8).set_ptr(0, self.finished.popleft().data)
        return (0, 0)

    def _send(self) -> None:
        """Give data to the oldest read that waits."""
        for urb in self.waiting:
            if urb.kind == BULK and urb.endpoint == p.DATA_ENDPOINT:
                try:
                    data = self.model.read(urb.length, 0.0)
                except Stall:
                    urb.finish(-errno.EPIPE, 0)
                else:
                    if not data:
                        return
                    urb.buffer.update(0, data)
                    urb.finish(0, len(data))
                self.waiting.remove(urb)
                self.finished.append(urb)
                return

    def _discard(self, address: bytes) -> tuple[int, int]:
        wanted = int.from_bytes(address, "little")
        for urb in self.waiting:
            if urb.data.client_addr == wanted:
                self.waiting.remove(urb)
                urb.finish(-errno.ENOENT, 0)
                self.finished.append(urb)
                return (0, 0)
        return (-1, errno.EINVAL)


def descriptors(model: CameraModel) -> bytes:
    """Device and configuration descriptors with both endpoints."""
    release = model.model << 8 | model.firmware
    device = struct.pack(
        "<BBHBBBBHHHBBBB",
        *(18, 1, 0x0310, 0, 0, 0, 9, p.VENDOR_ID, p.PRODUCT_ID, release, 1, 2, 3, 1),
    )
    companion = bytes([6, 0x30, 0, 0, 0, 0])
    body = struct.pack("<9B", 9, 4, 0, 0, 2, 255, 0, 0, 0)
    body += struct.pack("<BBBBHB", 7, 5, 0x81, 3, 64, 1) + companion
    body += struct.pack("<BBBBHB", 7, 5, p.DATA_ENDPOINT, 2, 1024, 0) + companion
    return device + struct.pack("<BBHBBBBB", 9, 2, 9 + len(body), 1, 1, 0, 0x80, 50) + body


def description(model: CameraModel) -> str:
    """The device as umockdev reads it."""
    raw = descriptors(model).hex().upper()
    release = f"{model.model << 8 | model.firmware:04x}"
    return f"""P: /devices/pci0000:00/0000:00:14.0/usb1/1-1
N: bus/usb/001/002={raw}
E: DEVNAME={NODE}
E: DEVTYPE=usb_device
E: SUBSYSTEM=usb
E: BUSNUM=001
E: DEVNUM=002
E: PRODUCT={p.VENDOR_ID:x}/{p.PRODUCT_ID:x}/{int(release, 16):x}
A: busnum=1\\n
A: devnum=2\\n
A: devpath=1\\n
A: speed=5000\\n
A: bConfigurationValue=1\\n
A: bNumConfigurations=1\\n
A: bNumInterfaces= 1\\n
A: idVendor={p.VENDOR_ID:04x}\\n
A: idProduct={p.PRODUCT_ID:04x}\\n
A: bcdDevice={release}\\n
A: manufacturer=iniVation AG\\n
A: product=DVXplorer Mini\\n
A: serial={model.serial}\\n
H: descriptors={raw}
"""


def main() -> int:
    """Present the camera and run the program; its exit code."""
    settings, *program = sys.argv[1:]
    given = json.loads(settings)
    stream = np.fromfile(Path(given.pop("words")), "<u4").tobytes()
    model = CameraModel(stream, **given)
    testbed = UMockdev.Testbed.new()
    testbed.add_from_string(description(model))
    handler = Handler(model)
    testbed.attach_ioctl(NODE, handler)
    loop = GLib.MainLoop()
    code = []

    def run() -> None:
        environment = {"LD_PRELOAD": PRELOAD, "UMOCKDEV_DIR": testbed.get_root_dir()}
        done = subprocess.run(program, env=os.environ | environment, check=False)
        code.append(done.returncode)
        GLib.idle_add(loop.quit)

    threading.Thread(target=run, daemon=True).start()
    loop.run()
    return code[0]


if __name__ == "__main__":
    sys.exit(main())

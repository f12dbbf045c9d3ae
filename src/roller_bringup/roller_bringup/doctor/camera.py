"""The event camera: on a fast port, open to this user, known, held by no other program."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from roller_driver.dvxplorer import protocol
from roller_driver.dvxplorer.backends import load_backend
from roller_driver.dvxplorer.discovery import UDEV_RULE, open_camera
from roller_driver.dvxplorer.errors import (
    BackendError,
    CameraBusyError,
    CameraFault,
    CameraNotFoundError,
)

from .result import Result, fault, ok, warning

RULES = ("/etc/udev/rules.d", "/run/udev/rules.d", "/usr/lib/udev/rules.d", "/lib/udev/rules.d")
DEVICES = "/sys/bus/usb/devices"
NODES = "/dev/bus/usb"
#: Below, event words of a busy scan don't fit.
_SUPER_SPEED_MBIT = 5000
_INSTALL = (
    f"sudo cp config/{UDEV_RULE} /etc/udev/rules.d/ && sudo udevadm control --reload, then plug "
    "the camera in again"
)


@dataclass(frozen=True)
class UsbNode:
    """A camera on the bus: its device node, whether it may be opened, its speed in Mbit/s."""

    path: str
    may_open: bool
    speed_mbit: float


@dataclass(frozen=True)
class UsbFacts:
    """Rule files that name the camera, cameras on the bus, and whether the user is root."""

    rules: tuple[str, ...] = ()
    nodes: tuple[UsbNode, ...] = ()
    root: bool = False


def find_usb(rules: Sequence[str] = RULES, devices: str = DEVICES, nodes: str = NODES) -> UsbFacts:
    """Look for the udev rule and for cameras."""
    return UsbFacts(
        tuple(_find_rules(rules)), tuple(_find_nodes(Path(devices), Path(nodes))), os.geteuid() == 0
    )


def judge_usb(facts: UsbFacts, asked: bool = False) -> Result:
    """Whether this user may open the camera."""
    name = "USB"
    closed = [node.path for node in facts.nodes if not node.may_open]
    if closed:
        why = "although the rule is there" if facts.rules else "and no rule for it is installed"
        advice = _INSTALL
        if facts.rules:
            advice = "plug the camera in again; over ssh be a member of plugdev"
        return fault(name, f"{', '.join(closed)} may not be opened, {why}", advice)
    slow = [node for node in facts.nodes if 0 < node.speed_mbit < _SUPER_SPEED_MBIT]
    if slow:
        found = f"{slow[0].path} runs at {slow[0].speed_mbit:g} Mbit/s: busy scans lose events"
        return warning(name, found, "plug the camera into a USB 3 port, with a USB 3 cable")
    if facts.nodes:
        return ok(name, f"{facts.nodes[0].path} may be opened")
    if facts.rules:
        return ok(name, f"rule {facts.rules[0]}")
    missing = "no udev rule for the camera is installed: only root may open it"
    return (fault if asked and not facts.root else warning)(name, missing, _INSTALL)


def _find_rules(folders: Sequence[str]) -> Iterable[str]:
    seen = set()
    for folder in folders:
        for path in sorted(Path(folder).glob("*.rules")):
            real = path.resolve()
            if real in seen:
                continue  # /lib is a link on many machines
            seen.add(real)
            try:
                text = path.read_text(errors="replace").lower()
            except OSError:
                continue
            if any(_names_camera(line) for line in text.splitlines()):
                yield str(path)


def _names_camera(line: str) -> bool:
    vendor, product = f'"{protocol.VENDOR_ID:04x}"', f'"{protocol.PRODUCT_ID:04x}"'
    if line.lstrip().startswith("#") or vendor not in line:
        return False
    return product in line or "idproduct" not in line


def _find_nodes(devices: Path, nodes: Path) -> Iterable[UsbNode]:
    for device in sorted(devices.glob("*")):
        try:
            ids = [int(_text(device / name), 16) for name in ("idVendor", "idProduct")]
            if ids != [protocol.VENDOR_ID, protocol.PRODUCT_ID]:
                continue
            bus, number = (int(_text(device / name)) for name in ("busnum", "devnum"))
            speed = float(_text(device / "speed"))
        except (OSError, ValueError):
            continue
        path = nodes / f"{bus:03d}" / f"{number:03d}"
        yield UsbNode(str(path), os.access(path, os.R_OK | os.W_OK), speed)


def _text(path: Path) -> str:
    return path.read_text().strip()


def check_camera(serial: str = "", backend: str = "", asked: bool = False) -> Result:
    """Open the camera, ask it who it is and close it.

    Parameters
    ----------
    serial : str
        Serial number; empty: the first camera.
    backend : str
        See `roller_driver.dvxplorer.backends.load_backend`.
    asked : bool
        Whether a camera must be there.
    """
    try:
        camera = open_camera(load_backend(backend), serial)
        try:
            camera.identify()
        finally:
            camera.let_go()
    except CameraFault as error:
        return _judge(error, asked)
    return ok("camera", f"{camera.name}, firmware {camera.firmware}")


def _judge(error: CameraFault, asked: bool) -> Result:
    missing = isinstance(error, CameraNotFoundError | CameraBusyError | BackendError)
    # The driver's faults say what to do.
    text, _, advice = str(error).partition("; ")
    if isinstance(error, CameraNotFoundError):
        text = str(error)
        advice = "plug it in; without one, the virtual cell takes its place (`make demo`)"
    elif isinstance(error, CameraBusyError):
        text = str(error)
        advice = "if that is the node event_camera all is well; else stop the other program"
    return Result("camera", "warning" if missing and not asked else "fault", text, advice)

"""All checks in their order."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from roller_bringup.launching.locate import NotFoundError, package_share

from .commissioning import CellFiles, check_commissioning
from .result import Result

#: How long the host's clock is watched.
_WATCH_S = 1.0


@dataclass(frozen=True)
class Request:
    """What is asked for."""

    #: Serial number of the camera that must be there, empty for any; None: none need be.
    camera: str | None = None
    #: The robot that must be there; empty: none need be.
    robot_ip: str = ""
    #: Where recordings are to go.
    output: Path = Path("recording")
    #: USB library, see `roller_driver.dvxplorer.backends.load_backend`.
    backend: str = ""
    #: The cell's files; None: how far it is set up isn't asked.
    cell: CellFiles | None = None


def examine(request: Request, report: Callable[[str], None] = lambda _: None) -> Iterator[Result]:
    """Run all checks.

    Parameters
    ----------
    request : Request
        What is asked for.
    report : callable
        Takes the name of each check before it runs.
    """
    try:
        share: Path | None = package_share("roller_bringup")
    except NotFoundError:
        share = None
    for name, check in _CHECKS.items():
        report(name)
        try:
            yield from check(request, share)
        except ImportError as error:
            yield Result(name, "fault", f"can't be looked at ({error})", "see libraries, above")


def _libraries(request: Request, share: Path | None) -> Iterator[Result]:
    from . import libraries

    yield libraries.judge_libraries(libraries.find_libraries())


def _ros(request: Request, share: Path | None) -> Iterator[Result]:
    from . import ros

    yield ros.judge_ros(ros.find_ros())
    yield ros.judge_rviz(ros.find_rviz())


def _dds(request: Request, share: Path | None) -> Iterator[Result]:
    from . import dds

    yield dds.judge_transport(dds.find_transport())
    profile = share / "config" / "fastdds.xml" if share is not None else None
    yield dds.judge_exchange(dds.exchange_messages(profile))


def _camera(request: Request, share: Path | None) -> Iterator[Result]:
    from . import camera

    asked = request.camera is not None
    yield camera.judge_usb(camera.find_usb(), asked)
    yield camera.check_camera(request.camera or "", request.backend, asked)


def _robot(request: Request, share: Path | None) -> Iterator[Result]:
    from . import robot

    host = request.robot_ip
    if not host and share is not None:
        host = robot.configured_address(share / "config" / "ur10.yaml")
    yield robot.check_robot(host, bool(request.robot_ip))


def _machine(request: Request, share: Path | None) -> Iterator[Result]:
    from . import machine

    yield machine.check_machine(machine.cores(), machine.free_memory())
    yield machine.check_disk(*machine.measure_disk(request.output))


def _clock(request: Request, share: Path | None) -> Iterator[Result]:
    from . import clock

    before = clock.Reading.take()
    time.sleep(_WATCH_S)
    yield clock.judge_clock(clock.find_clock(before, clock.Reading.take()))


def _cell(request: Request, share: Path | None) -> Iterator[Result]:
    if request.cell is not None:
        from . import machine

        yield machine.judge_host(machine.find_host())
        yield from check_commissioning(request.cell)


#: Each imports what it needs when it runs: a library that is missing spoils its own check alone.
_CHECKS: dict[str, Callable[[Request, Path | None], Iterator[Result]]] = {
    "libraries": _libraries,
    "ROS 2": _ros,
    "DDS": _dds,
    "camera": _camera,
    "robot": _robot,
    "machine and disk": _machine,
    "clock": _clock,
    "calibration": _cell,
}

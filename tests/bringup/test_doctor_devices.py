"""The doctor's checks of camera and robot, each with faults put in."""

import socket
import struct
import threading
from pathlib import Path

import pytest

from driver.emulation.camera_model import CameraModel
from driver.emulation.usb_backend import EmulatedBackend
from roller_bringup.doctor import camera, robot
from roller_bringup.doctor.camera import UsbFacts, UsbNode
from roller_bringup.doctor.result import Result

ROOT = Path(__file__).parents[2]


def a_bus(folder: Path, speed: str = "5000") -> tuple[str, str]:
    """sysfs and device nodes of a bus with a hub and the camera."""
    for name, ids in {"usb1": ("1d6b", "0003"), "1-1": ("152a", "8419")}.items():
        device = folder / "devices" / name
        device.mkdir(parents=True)
        values = {"idVendor": ids[0], "idProduct": ids[1], "busnum": "1", "devnum": "7"}
        for key, value in (values | {"speed": speed}).items():
            (device / key).write_text(value + "\n")
    (folder / "nodes" / "001").mkdir(parents=True)
    (folder / "nodes" / "001" / "007").touch()
    return str(folder / "devices"), str(folder / "nodes")


def test_a_camera_on_the_bus_and_the_rule(tmp_path):
    devices, nodes = a_bus(tmp_path)
    facts = camera.find_usb([str(ROOT / "config"), str(tmp_path)], devices, nodes)
    assert facts.rules == (str(ROOT / "config" / "99-roller-event-camera.rules"),)
    assert facts.nodes == (UsbNode(f"{nodes}/001/007", True, 5000.0),)
    assert camera.judge_usb(facts, asked=True).level == "OK"


def test_rules_of_others_do_not_count(tmp_path):
    (tmp_path / "a.rules").write_text('ATTR{idVendor}=="152a", ATTR{idProduct}=="840d"\n')
    (tmp_path / "b.rules").write_text('# "152a" "8419"\n')
    assert camera.find_usb([str(tmp_path)], str(tmp_path), str(tmp_path)).rules == ()
    (tmp_path / "c.rules").write_text('SUBSYSTEM=="usb", ATTRS{idVendor}=="152A", MODE="666"\n')
    assert len(camera.find_usb([str(tmp_path)], str(tmp_path), str(tmp_path)).rules) == 1


@pytest.mark.parametrize(
    ("facts", "asked", "level", "says"),
    [
        (UsbFacts(), False, "warning", "no udev rule"),
        (UsbFacts(), True, "fault", "no udev rule"),
        (UsbFacts(root=True), True, "warning", "only root"),
        (UsbFacts(("/etc/a.rules",)), True, "OK", "rule /etc/a.rules"),
        (UsbFacts(nodes=(UsbNode("/dev/x", False, 5000),)), False, "fault", "no rule"),
        (
            UsbFacts(("/etc/a.rules",), (UsbNode("/dev/x", False, 5000),)),
            False, "fault", "although the rule is there",
        ),
        (UsbFacts(nodes=(UsbNode("/dev/x", True, 480),)), True, "warning", "480 Mbit/s"),
    ],
)  # fmt: skip
def test_usb_by_its_facts(facts, asked, level, says):
    result = camera.judge_usb(facts, asked)
    assert result.level == level
    assert says in result.found
    assert bool(result.advice) == (level != "OK")


@pytest.fixture
def bus(monkeypatch):
    """An emulated bus in place of libusb's."""
    backend = EmulatedBackend(CameraModel(firmware=10))
    monkeypatch.setattr(camera, "load_backend", lambda name: backend)
    return backend


def test_a_camera_that_is_fine(bus):
    assert camera.check_camera() == Result("camera", "OK", "DVXplorer Mini DVX00042, firmware 10")
    # It was asked, not set.
    assert {kind for kind, *_ in bus.models[0].log} <= {"read", "vendor"}


def test_a_camera_of_another_number(bus):
    result = camera.check_camera("A7", asked=True)
    assert (result.level, "plugged in: DVX00042" in result.found) == ("fault", True)


@pytest.mark.parametrize("asked", [False, True])
def test_no_camera_or_a_busy_one(bus, asked):
    bus.held = True
    busy = camera.check_camera(asked=asked)
    assert "another program holds it" in busy.found
    assert "event_camera" in busy.advice
    bus.models.clear()
    gone = camera.check_camera(asked=asked)
    assert "no DVXplorer Mini is plugged in" in gone.found
    assert busy.level == gone.level == ("fault" if asked else "warning")


def test_a_camera_that_cannot_be_used_is_a_fault_even_unasked(bus):
    bus.forbidden = True
    result = camera.check_camera()
    assert (result.level, "install the rule" in result.advice) == ("fault", True)
    bus.forbidden = False
    bus.models[:] = [CameraModel(firmware=7)]
    result = camera.check_camera()
    assert (result.level, "firmware 7 is not known" in result.found) == ("fault", True)
    bus.models[:] = [CameraModel(model=0)]
    assert camera.check_camera().level == "fault"
    bus.models[:] = [CameraModel(firmware=9)]
    bus.models[0].values[6, 0] = 17
    result = camera.check_camera()
    assert "logic version is 17" in result.found
    assert "update the camera's firmware" in result.advice


def test_a_backend_that_cannot_be_loaded():
    result = camera.check_camera(backend="nowhere:x")
    assert (result.level, "nowhere:x" in result.found) == ("warning", True)


# Robot.


def answering(*answers: bytes) -> int:
    """A controller that gives these answers to one client; its port."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        connection, _ = server.accept()
        with connection, server:
            for answer in answers:
                connection.recv(4096)
                connection.sendall(answer)
            connection.recv(4096)

    threading.Thread(target=serve, daemon=True).start()
    return int(server.getsockname()[1])


def frame(kind: str, payload: bytes) -> bytes:
    return struct.pack(">HB", len(payload) + 3, ord(kind)) + payload


def test_a_robot_that_answers():
    types = b"\x01DOUBLE,VECTOR6D,VECTOR6D,INT32,INT32"
    port = answering(
        frame("V", b"\x01"), frame("v", struct.pack(">4I", 5, 11, 1, 0)), frame("O", types)
    )
    result = robot.check_robot("127.0.0.1", True, port)
    assert result == Result("robot", "OK", "127.0.0.1: controller 5.11.1.0 (e-series)")


def test_a_robot_that_refuses():
    result = robot.check_robot("127.0.0.1", True, answering(frame("V", b"\x00")))
    assert (result.level, "refuses RTDE protocol version 2" in result.found) == ("fault", True)
    assert "must be 3.3 or newer" in result.advice


@pytest.mark.parametrize(("asked", "level"), [(False, "warning"), (True, "fault")])
def test_no_robot(asked, level):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    result = robot.check_robot("127.0.0.1", asked, port, 0.5)
    assert result.level == level
    assert "can't be reached" in result.found
    assert "the cable" in result.advice


def test_a_robot_is_looked_for_where_the_parameters_say(tmp_path):
    file = tmp_path / "ur10.yaml"
    file.write_text("ur10: {ros__parameters: {robot_ip: 10.0.0.9}}\n")
    assert robot.configured_address(file) == "10.0.0.9"
    assert robot.configured_address(ROOT / "config" / "ur10.yaml") == ""
    assert robot.configured_address(tmp_path / "none.yaml") == ""
    assert robot.check_robot("").level == "warning"

"""The robot's receiver with the real library against an emulated controller on loopback."""

import socket
import sys
import threading
from itertools import pairwise

import numpy as np
import pytest

from driver.emulation import rtde_controller
from driver.emulation.controller_process import ControllerProcess
from own import LOOPBACK
from roller_core.clock import SensorClock
from roller_driver.ur10 import receiver
from roller_driver.ur10.contact_watch import ContactWatch
from roller_driver.ur10.errors import (
    MissingLibraryError,
    ProtocolRefusedError,
    RobotUnreachableError,
)
from roller_driver.ur10.receiver import VARIABLES, RobotReceiver, open_receiver
from roller_driver.ur10.receiver_status import RECEIVING, SEARCHING
from roller_driver.ur10.rtde import ask_controller
from waiting import wait_until

pytest.importorskip("rtde_receive", reason="ur_rtde has no wheels for this Python")

HOST = LOOPBACK


class Running:
    """A receiver, and what it handed out."""

    def __init__(self, **settings):
        self.samples, self.changes = [], []
        self.receiver = RobotReceiver(
            HOST, self.samples.append, on_change=lambda *c: self.changes.append(c),
            retry_s=0.1, connect_timeout_s=1.0, **settings,
        )  # fmt: skip

    def __enter__(self):
        self.receiver.start()
        return self

    def __exit__(self, *_):
        self.receiver.stop()

    def wait(self, condition, timeout_s=10.0):
        wait_until(condition, lambda: (self.receiver.status, self.changes), timeout_s)

    def wait_for(self, n):
        self.wait(lambda: len(self.samples) >= n)


@pytest.mark.parametrize(("rate", "period_ns"), [(125, 8_000_000), (500, 2_000_000)])
def test_every_sample_comes_untorn_at_the_controllers_rate(rate, period_ns):
    settings = {"rate_hz": rate, "speed_m_s": 0.5, "profile": "circle"}
    with ControllerProcess(**settings), Running() as running:
        running.wait_for(60)
    samples, status = running.samples, running.receiver.status
    times = np.array([s.controller_ns for s in samples])
    steps = np.diff(times)
    # Other processes may take the machine for a while; what is missed must be counted.
    assert np.all(steps > 0)
    assert int((np.rint(steps / period_ns) - 1).sum()) == status.missed
    model = rtde_controller.Settings(**settings)
    for sample in samples:
        t = sample.controller_ns * 1e-9 - model.clock_start_s
        pose, speed = rtde_controller.motion(model, t)
        assert sample.pose == pytest.approx(pose, abs=1e-8)
        assert sample.speed == pytest.approx(speed, abs=1e-7)
    assert status.controller is not None
    assert status.controller.rate_hz == rate
    assert (status.mode, status.safety, status.stopped_for_safety) == ("running", "normal", False)


def test_the_receiver_follows_a_controller_through_its_troubles():
    with ControllerProcess() as controller, Running(silence_s=0.15) as running:
        status, samples = running.receiver.status, running.samples
        running.wait_for(20)

        controller.send("protective_stop")
        running.wait(lambda: status.stopped_for_safety)
        assert status.safety == "protective stop"
        running.wait_for(len(samples) + 10)
        assert samples[-1].speed == (0.0,) * 6
        controller.send("normal")
        running.wait(lambda: not status.stopped_for_safety)

        controller.send("step_back 10")
        running.wait(lambda: status.steps_back == 1)
        running.wait_for(len(samples) + 10)

        missed, before_ns = status.missed, samples[-1].controller_ns
        controller.send("step_back -100")  # forward: none is missing
        running.wait(lambda: samples[-1].controller_ns > before_ns + 90e9)
        running.wait_for(len(samples) + 10)
        assert status.longest_gap_s < 50.0
        assert status.missed - missed < 1000

        controller.send("silence 0.5")
        running.wait(lambda: "nothing came for 0.15 s" in str(running.changes))
        running.wait_for(len(samples) + 10)

        connects = status.connects
        controller.send("disconnect")
        running.wait(lambda: "the connection was lost" in str(running.changes))
        running.wait_for(len(samples) + 10)
        assert status.connects > connects

        controller.stop()
        running.wait(lambda: "can't be reached" in status.fault)
        controller.start(clock_start_s=5.0)
        running.wait(lambda: samples[-1].controller_ns < 100e9)
    states = [state for state, _ in running.changes]
    assert states[:3] == [SEARCHING, RECEIVING, SEARCHING]
    assert states[-2:] == [RECEIVING, "stopped"]


def test_late_packets_do_not_move_the_clock():
    with ControllerProcess(clock_ppm=50) as controller, Running() as running:
        for _ in range(2):
            running.wait_for(len(running.samples) + 40)
            controller.send("late 0.05")
        running.wait_for(len(running.samples) + 40)
    clock = SensorClock()
    late, ahead_ns = [], []
    for sample in running.samples:
        clock.observe(sample.controller_ns, sample.arrival_ns)
        late.append(clock.residual_s)
        stamp = int(clock.to_ros_ns(sample.controller_ns))
        ahead_ns.append(stamp - sample.controller_ns)
        if len(late) > 30:
            assert stamp - sample.arrival_ns < 5e6
    # The first after the pause is late, unless the burst that follows hid it.
    assert max(late) > 0.02 or running.receiver.status.missed > 0
    assert np.ptp(ahead_ns[30:]) < 5e6
    assert clock.steps == 0


def test_a_refused_protocol_version_is_reported():
    with ControllerProcess(refuse_protocol=True), Running() as running:
        running.wait(lambda: "refuses RTDE protocol version 2" in running.receiver.status.fault)
        assert running.receiver.status.state == SEARCHING


def test_a_variable_that_the_controller_does_not_have():
    """The library would end the process; the handshake finds it first."""
    with (
        ControllerProcess(missing=["safety_mode"]),
        pytest.raises(ProtocolRefusedError, match=r"3\.15\.8\.0 \(CB3\) doesn't know safety_mode"),
    ):
        ask_controller(HOST, VARIABLES)


@pytest.mark.parametrize("missing", [[], ["actual_TCP_force"]])
def test_the_force_where_the_controller_gives_it(missing):
    with ControllerProcess(missing=missing) as controller, Running() as running:
        running.wait_for(5)
        controller.send("force 31.5")
        forces = [0.0, 0.0, 31.5, 0.0, 0.0, 0.0]
        running.wait(lambda: running.samples[-1].wrench == tuple([] if missing else forces))
        running.wait_for(len(running.samples) + 5)


def test_what_the_library_throws_is_a_lost_connection(monkeypatch):
    opened, failures = receiver.open_receiver, [RuntimeError("std::exception")]

    class Failing:
        def __init__(self, interface):
            self._interface = interface

        def __getattr__(self, name):
            if name == "getActualTCPPose" and failures:
                raise failures.pop()
            return getattr(self._interface, name)

    monkeypatch.setattr(receiver, "open_receiver", lambda *a: Failing(opened(*a)))
    with ControllerProcess(), Running() as running:
        running.wait_for(5)
    assert any("state can't be read (std::exception)" in fault for _, fault in running.changes)
    assert running.receiver.status.connects == 2


def test_a_fault_of_ours_is_handed_on_and_not_a_receiver_that_stands_still():
    failed, broken = [], RuntimeError("broken")

    def fail(_):
        raise broken

    with ControllerProcess(), Running(on_failure=failed.append) as running:
        running.receiver._on_sample = fail
        running.wait(lambda: failed)
    assert failed == [broken]


def test_what_is_no_number_is_left_out_and_counted():
    with ControllerProcess() as controller, Running() as running:
        running.wait_for(5)
        controller.send("force nan")
        running.wait(lambda: running.samples[-1].wrench == ())
        controller.send("pose_z nan")
        running.wait(lambda: running.receiver.status.not_finite > 5)
        count = len(running.samples)
        controller.send("pose_z 0.25")
        running.wait_for(count + 5)
    assert np.isfinite([sample.pose for sample in running.samples]).all()


def test_contact():
    rolling, still = (0.3, 0, 0), (0.0, 0, 0)
    watch = ContactWatch(least_n=10, most_n=40)

    def verdict(*forces, speed=rolling):
        for force in forces:
            watch.take((0, 0, -force), speed)
        return watch.verdict()

    assert verdict(0, 2, 5) == ""  # it has not touched yet
    assert verdict(20, 39) == ""
    assert verdict(20, 41, 20).startswith("pressed too hard: 41.0 N")
    assert verdict(20) == ""
    assert verdict(5, 20).startswith("contact lost")
    assert verdict(20) == ""
    for _ in range(3):  # for as long as it rolls on without
        assert verdict(2, 2).startswith("contact lost")
    assert verdict(20) == ""
    assert verdict(5, speed=still) == ""  # it is lifted
    assert watch.force_n == 5
    assert verdict(0) == ""
    assert verdict(20) == ""
    assert verdict(5, 0, speed=(0.05, 0.0, 0.3)) == ""  # straight away from the part
    assert verdict(0) == ""  # and home
    free = ContactWatch(0, 0)
    free.take((0, 0, 1e3), rolling)
    free.take((0, 0, 0), rolling)
    assert free.verdict() == ""


def test_no_robot():
    with socket.create_server((HOST, 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(RobotUnreachableError, match=f"robot {HOST}:{port}: it can't be reached"):
        ask_controller(HOST, VARIABLES, 0.5, port)


@pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n" + bytes(30000)])
def test_something_else_answers(answer):
    with socket.create_server((HOST, 0)) as server:

        def serve():
            connection, _ = server.accept()
            with connection:
                connection.recv(100)
                connection.sendall(answer)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        with pytest.raises(ProtocolRefusedError, match="check robot_ip"):
            ask_controller(HOST, VARIABLES, 1.0, server.getsockname()[1])
        thread.join()


def test_one_that_says_nothing():
    with (
        socket.create_server((HOST, 0)) as server,
        pytest.raises(RobotUnreachableError, match="no answer"),
    ):
        ask_controller(HOST, VARIABLES, 0.2, server.getsockname()[1])


def test_without_the_library(monkeypatch):
    monkeypatch.setitem(sys.modules, "rtde_receive", None)
    with pytest.raises(MissingLibraryError, match="pip install ur-rtde"):
        open_receiver(HOST)


def test_the_line_goes_to_and_fro():
    s = rtde_controller.Settings(speed_m_s=0.1, length_m=0.2)
    xs = [rtde_controller.motion(s, t / 10)[0][0] - s.start[0] for t in range(80)]
    assert (min(xs), max(xs)) == (0.0, pytest.approx(0.2))
    assert all(abs(b - a) == pytest.approx(0.01) for a, b in pairwise(xs))


TOOL = [0.0, 0.01, 0.1, 0.0, 0.0, 0.5]


@pytest.mark.parametrize("missing", [[], ["tcp_offset"]])
def test_the_tool_that_was_calibrated_or_a_controller_that_does_not_tell_it(missing):
    expected = TOOL if not missing else [1.0] * 6
    with ControllerProcess(missing=missing), Running(tcp_offset=expected) as running:
        running.wait_for(10)


@pytest.mark.parametrize(
    ("place", "value", "says"),
    [(2, 0.1005, "is 0.50 mm and 0.00 deg from"), (5, 0.51, "is 0.00 mm and 0.57 deg from")],
)
def test_another_tool_than_the_calibrated_one_gives_no_poses(place, value, says):
    expected = [value if k == place else v for k, v in enumerate(TOOL)]
    with ControllerProcess(), Running(tcp_offset=expected) as running:
        running.wait(lambda: any(says in fault for _, fault in running.changes))
        assert running.receiver.status.state == SEARCHING
        assert running.samples == []


def test_a_tool_that_is_set_while_poses_come_ends_them_until_it_is_the_calibrated_one_again():
    """A robot's program sets its tool when it starts, long after the connection."""
    with ControllerProcess() as controller, Running(tcp_offset=TOOL) as running:
        running.wait_for(10)
        controller.send("tool_z 0.105")
        running.wait(lambda: any("is 5.00 mm and" in fault for _, fault in running.changes))
        assert running.receiver.status.state == SEARCHING
        count = len(running.samples)
        controller.send("tool_z 0.1")
        running.wait_for(count + 10)

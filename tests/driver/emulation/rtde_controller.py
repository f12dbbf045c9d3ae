"""An emulated UR controller that speaks RTDE on port 30004, as a process of its own.

    python -m driver.emulation.rtde_controller '{"rate_hz": 125, "profile": "line"}'

It prints `ready` with the time of its first tick (CLOCK_MONOTONIC, s) and then takes commands on
its standard input, one a line: `protective_stop`, `normal`, `disconnect`, `late SECONDS`,
`silence SECONDS`, `step_back SECONDS`, `force N`, `pose_z METRES` (of all poses), `tool_z METRES`,
`start SECONDS` (CLOCK_MONOTONIC: when the trajectory begins), `quit`.
"""

import json
import math
import os
import select
import socket
import struct
import sys
import time
from dataclasses import dataclass, field

import numpy as np

TYPES = {
    "timestamp": ("DOUBLE", ">d"),
    "actual_TCP_pose": ("VECTOR6D", ">6d"),
    "actual_TCP_speed": ("VECTOR6D", ">6d"),
    "actual_TCP_force": ("VECTOR6D", ">6d"),
    "tcp_offset": ("VECTOR6D", ">6d"),
    "robot_mode": ("INT32", ">i"),
    "safety_mode": ("INT32", ">i"),
}
NORMAL, PROTECTIVE_STOP = 1, 3
RUNNING = 7


@dataclass
class Settings:
    """What the controller is like.

    Parameters
    ----------
    rate_hz : float
        125 (CB3) or 500 (e-series); the version follows.
    profile : str
        `still`, `line` (to and fro along x at constant speed) or `circle`.
    trajectory : str
        In place of a profile, a file (.npz): times `t_s` and poses `pose`, shape (n, 6); linear
        between them, at rest before `start` was sent and after the end.
    period_s : float
        Not 0: the trajectory begins again after so long.
    speed_m_s, length_m : float
        Of the line; the circle has that speed and `length_m` as its diameter.
    start : tuple of float
        Pose at the beginning: m, and rotation vector in rad.
    clock_ppm : float
        Rate error of its clock.
    clock_start_s : float
        What its clock shows when it starts.
    refuse_protocol : bool
        Whether it refuses every protocol version.
    missing : list of str
        Variables that it says it doesn't have.
    tcp_offset : list of float
        Tool centre point on the flange: m, and rotation vector in rad.
    force_n : float
        Force along z of base; the command `force N` changes it.
    """

    rate_hz: float = 125.0
    profile: str = "line"
    speed_m_s: float = 0.1
    length_m: float = 0.2
    start: tuple[float, ...] = (0.4, -0.2, 0.3, 3.1, 0.2, -0.1)
    trajectory: str = ""
    period_s: float = 0.0
    clock_ppm: float = 0.0
    clock_start_s: float = 1234.0
    refuse_protocol: bool = False
    missing: list[str] = field(default_factory=list)
    tcp_offset: list[float] = field(default_factory=lambda: [0.0, 0.01, 0.1, 0.0, 0.0, 0.5])
    force_n: float = 20.0
    host: str = "127.0.0.1"
    port: int = 30004


def motion(s: Settings, t: float) -> tuple[list[float], list[float]]:
    """Pose and speed at controller time `t` seconds after the start."""
    pose, speed = list(s.start), [0.0] * 6
    if s.profile == "line":
        # A triangle wave.
        path = s.speed_m_s * t % (2 * s.length_m)
        forth = path < s.length_m
        pose[0] += path if forth else 2 * s.length_m - path
        speed[0] = s.speed_m_s if forth else -s.speed_m_s
    elif s.profile == "circle":
        r = s.length_m / 2
        a = s.speed_m_s / r * t
        pose[0] += r * math.cos(a)
        pose[1] += r * math.sin(a)
        speed[0], speed[1] = -s.speed_m_s * math.sin(a), s.speed_m_s * math.cos(a)
    return pose, speed


def frame(kind: bytes, payload: bytes = b"") -> bytes:
    return struct.pack(">HB", len(payload) + 3, kind[0]) + payload


class Trajectory:
    """Poses read from a file, from a moment on."""

    def __init__(self, path: str, period_s: float) -> None:
        self._period_s = period_s or math.inf
        with np.load(path) as data:
            self._t, self._columns = data["t_s"], data["pose"].T.copy()
        self.start_s = math.inf

    def at(self, now_s: float) -> tuple[list[float], list[float]]:
        """Pose and speed at a time, s of CLOCK_MONOTONIC."""
        t = max(now_s - self.start_s, 0.0) % self._period_s
        pose, before = self._pose_at(t), self._pose_at(t - 1e-3)
        return pose.tolist(), ((pose - before) * 1e3).tolist()

    def _pose_at(self, t: float) -> np.ndarray:
        return np.array([np.interp(t, self._t, column) for column in self._columns])


class Client:
    """One connection."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.data = b""
        self.names: list[str] = []
        self.running = False

    def receive(self, settings: Settings) -> bool:
        """Answer what came; False when the other side is gone."""
        try:
            data = self.connection.recv(4096)
        except OSError:
            return False
        self.data += data
        while len(self.data) >= 3:
            size, kind = struct.unpack(">HB", self.data[:3])
            if len(self.data) < size:
                break
            payload, self.data = self.data[3:size], self.data[size:]
            answer = self._answer(bytes([kind]), payload, settings)
            if answer is not None:
                self.connection.sendall(answer)
        return bool(data)

    def _answer(self, kind: bytes, payload: bytes, settings: Settings) -> bytes | None:
        if kind == b"V":
            (version,) = struct.unpack(">H", payload)
            ok = version == 2 and not settings.refuse_protocol
            return frame(b"V", bytes([ok]))
        if kind == b"v":
            version = (3, 15, 8, 0) if settings.rate_hz < 500 else (5, 11, 1, 0)
            return frame(b"v", struct.pack(">4I", *version))
        if kind == b"O":
            # The robot's library ends the list with a comma.
            self.names = payload[8:].decode().rstrip(",").split(",")
            types = [
                TYPES[n][0] if n in TYPES and n not in settings.missing else "NOT_FOUND"
                for n in self.names
            ]
            return frame(b"O", b"\x01" + ",".join(types).encode())
        if kind == b"I":
            return frame(b"I", b"\x01" + b"UINT32")
        if kind in (b"S", b"P"):
            self.running = kind == b"S"
            return frame(kind, b"\x01")
        return None

    def send(self, values: dict[str, object]) -> None:
        packed = b"\x01"
        for name in self.names:
            form, value = TYPES[name][1], values[name]
            packed += struct.pack(form, *(value if isinstance(value, list) else [value]))
        self.connection.sendall(frame(b"U", packed))


class ControllerModel:
    """Serves clients and moves."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.server = socket.create_server((settings.host, settings.port), reuse_port=False)
        self.clients: list[Client] = []
        self.safety = NORMAL
        self.late_s = 0.0
        self.silent_until = 0.0
        self.stopped_at: float | None = None
        self.clock_shift_s = 0.0
        self.begin_s = 0.0
        self.pose_z: float | None = None
        self.trajectory = (
            Trajectory(settings.trajectory, settings.period_s) if settings.trajectory else None
        )

    def run(self) -> None:
        """Serve until asked to quit."""
        period = 1.0 / self.settings.rate_hz
        begin = self.begin_s = time.monotonic()
        tick = 0
        print(f"ready {begin!r}", flush=True)
        ready = -1
        while True:
            due = begin + tick * period
            if ready != tick:
                # Worked out before it is due, so that it leaves on time.
                pose, ready = self._pose(tick * period), tick
            wait = due - time.monotonic()
            watched = [self.server, sys.stdin, *(c.connection for c in self.clients)]
            readable, _, _ = select.select(watched, [], [], max(wait, 0))
            for item in readable:
                if item is self.server:
                    connection, _ = self.server.accept()
                    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self.clients.append(Client(connection))
                elif item is sys.stdin:
                    # Not readline: what it buffers, select doesn't see.
                    data = os.read(sys.stdin.fileno(), 4096).decode()
                    if not data or "quit" in data.split():
                        return
                    for line in data.splitlines():
                        self.command(*line.split())
                else:
                    self._serve(next(c for c in self.clients if c.connection is item))
            if time.monotonic() < due:
                continue
            if self.late_s:
                time.sleep(self.late_s)
                self.late_s = 0.0
            if time.monotonic() >= self.silent_until:
                self._send_all(tick * period, *pose)
            tick += 1

    def command(self, name: str, value: str = "0") -> None:
        """Obey a line of the standard input."""
        if name == "protective_stop":
            self.safety = PROTECTIVE_STOP
        elif name == "normal":
            self.safety = NORMAL
            self.stopped_at = None
        elif name == "disconnect":
            for client in self.clients:
                client.connection.close()
            self.clients.clear()
        elif name == "late":
            self.late_s = float(value)
        elif name == "silence":
            self.silent_until = time.monotonic() + float(value)
        elif name == "start" and self.trajectory is not None:
            self.trajectory.start_s = float(value)
        elif name == "force":
            self.settings.force_n = float(value)
        elif name == "pose_z":
            self.pose_z = float(value)
        elif name == "tool_z":
            self.settings.tcp_offset[2] = float(value)
        elif name == "step_back":
            self.clock_shift_s -= float(value)

    def _serve(self, client: Client) -> None:
        if not client.receive(self.settings):
            client.connection.close()
            self.clients.remove(client)

    def _pose(self, t: float) -> tuple[list[float], list[float]]:
        s = self.settings
        if self.safety == PROTECTIVE_STOP and self.stopped_at is None:
            self.stopped_at = t
        t_path = t if self.stopped_at is None else self.stopped_at
        if self.trajectory is not None:
            pose, speed = self.trajectory.at(self.begin_s + t_path)
        else:
            pose, speed = motion(s, t_path)
        if self.pose_z is not None:
            pose[2] = self.pose_z
        if self.stopped_at is not None:
            speed = [0.0] * 6
        return pose, speed

    def _send_all(self, t: float, pose: list[float], speed: list[float]) -> None:
        s = self.settings
        stamp = s.clock_start_s + t * (1 + s.clock_ppm * 1e-6) + self.clock_shift_s
        values: dict[str, object] = {
            "timestamp": stamp,
            "actual_TCP_pose": pose,
            "actual_TCP_speed": speed,
            "actual_TCP_force": [0.0, 0.0, s.force_n, 0.0, 0.0, 0.0],
            "tcp_offset": s.tcp_offset,
            "robot_mode": RUNNING,
            "safety_mode": self.safety,
        }
        for client in list(self.clients):
            if client.running:
                try:
                    client.send(values)
                except OSError:
                    client.connection.close()
                    self.clients.remove(client)


if __name__ == "__main__":
    given = json.loads(sys.argv[1]) if len(sys.argv) > 1 else {}
    try:
        ControllerModel(Settings(**given)).run()
    except KeyboardInterrupt:
        sys.exit(0)

"""Frames of the UR controllers' Real-Time Data Exchange, and a first handshake.

The robot's library holds Python's lock while it connects, says little when that fails and ends the
process when the controller doesn't have a variable that it asks for. So a plain handshake asks
first whether there is a controller, which, and whether it has what we want.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from .errors import ProtocolRefusedError, RobotUnreachableError

PORT = 30004
PROTOCOL_VERSION = 2
REQUEST_PROTOCOL_VERSION = 86
GET_CONTROL_VERSION = 118
SETUP_OUTPUTS = 79
START = 83
DATA = 85
TEXT_MESSAGE = 77
#: Longest wait for an answer of the controller, s.
ANSWER_TIMEOUT_S = 2.0
_HEADER = struct.Struct(">HB")


@dataclass(frozen=True, slots=True)
class Controller:
    """Software version of a controller."""

    #: Major, minor, bugfix, build; the first three alone also serve.
    version: tuple[int, ...]
    #: Variables that it was asked for and doesn't know.
    lacks: tuple[str, ...] = ()

    @property
    def rate_hz(self) -> float:
        """Poses a second that it sends: 125 with CB3 (version 3), 500 with the e-series."""
        return 125.0 if self.version[0] < 5 else 500.0

    @property
    def period_ns(self) -> int:
        """Nanoseconds from pose to pose."""
        return round(1e9 / self.rate_hz)

    def __str__(self) -> str:
        series = "CB3" if self.version[0] < 5 else "e-series"
        return f"{'.'.join(map(str, self.version))} ({series})"


def frame(kind: int, payload: bytes = b"") -> bytes:
    """One RTDE frame: size (header included), type, payload."""
    return _HEADER.pack(len(payload) + _HEADER.size, kind) + payload


def receive(connection: socket.socket) -> tuple[int, bytes]:
    """Read one frame: type and payload.

    Raises
    ------
    ConnectionError
        If the other side closed the connection.
    TimeoutError
        If nothing came in the socket's time-out.
    """
    size, kind = _HEADER.unpack(_exactly(connection, _HEADER.size))
    return kind, _exactly(connection, max(size - _HEADER.size, 0))


def _exactly(connection: socket.socket, length: int) -> bytes:
    data = b""
    while len(data) < length:
        part = connection.recv(length - len(data))
        if not part:
            raise ConnectionError("the connection was closed")
        data += part
    return data


def ask_controller(
    host: str,
    variables: Sequence[str],
    timeout_s: float = ANSWER_TIMEOUT_S,
    port: int = PORT,
    spare: Sequence[str] = (),
) -> Controller:
    """Say hello, ask for the version and whether the controller has the variables.

    Those that can be spared may be missing: see `Controller.lacks`.

    Raises
    ------
    RobotUnreachableError
        If nothing answers in time.
    ProtocolRefusedError
        If the answer is not RTDE, protocol version 2 is refused or a variable is missing.
    """
    where = f"robot {host}:{port}"
    try:
        with socket.create_connection((host, port), timeout=timeout_s) as connection:
            connection.settimeout(timeout_s)
            version = struct.pack(">H", PROTOCOL_VERSION)
            connection.sendall(frame(REQUEST_PROTOCOL_VERSION, version))
            kind, payload = _answer(connection, where)
            if kind != REQUEST_PROTOCOL_VERSION:
                raise ProtocolRefusedError(
                    f"{where}: what answers does not speak RTDE; check robot_ip"
                )
            if payload[:1] != b"\x01":
                raise ProtocolRefusedError(
                    f"{where}: the controller refuses RTDE protocol version {PROTOCOL_VERSION}; "
                    "its software must be 3.3 or newer"
                )
            connection.sendall(frame(GET_CONTROL_VERSION))
            kind, payload = _answer(connection, where)
            if kind != GET_CONTROL_VERSION or len(payload) < 12:
                raise ProtocolRefusedError(f"{where}: the controller doesn't give its version")
            count = min(len(payload) // 4, 4)
            controller = Controller(struct.unpack(f">{count}I", payload[: 4 * count]))
            wanted = [*variables, *spare]
            request = struct.pack(">d", controller.rate_hz) + ",".join(wanted).encode()
            connection.sendall(frame(SETUP_OUTPUTS, request))
            kind, payload = _answer(connection, where)
            types = payload[1:].decode("ascii", "replace").split(",")
            if kind != SETUP_OUTPUTS or len(types) != len(wanted):
                raise ProtocolRefusedError(f"{where}: the controller refuses to send {wanted}")
            lacks = tuple(n for n, t in zip(wanted, types, strict=True) if t == "NOT_FOUND")
            if missing := [name for name in lacks if name not in spare]:
                raise ProtocolRefusedError(
                    f"{where}: the controller {controller} doesn't know {', '.join(missing)}; "
                    "update its software"
                )
            return replace(controller, lacks=lacks)
    except OSError as error:
        reason = "no answer" if isinstance(error, TimeoutError) else (error.strerror or str(error))
        raise RobotUnreachableError(
            f"{where}: it can't be reached ({reason}); check robot_ip, the cable and that the "
            "robot is on"
        ) from error


def read_tcp_offset(host: str, timeout_s: float = ANSWER_TIMEOUT_S) -> tuple[float, ...] | None:
    """The tool centre point on the flange: x y z in metres, rotation vector in rad.

    Returns
    -------
    tuple of float, length 6, or None
        None where the controller doesn't tell it (older software).

    Raises
    ------
    RobotUnreachableError
        If it doesn't come in time.
    """
    return next(tcp_offsets(host, timeout_s), None)


def tcp_offsets(host: str, timeout_s: float = ANSWER_TIMEOUT_S) -> Iterator[tuple[float, ...]]:
    """The tool centre point ten times a second, see `read_tcp_offset`.

    None come where the controller doesn't tell it.

    Raises
    ------
    RobotUnreachableError
        If one doesn't come in time.
    """
    request = struct.pack(">d", 10.0) + b"tcp_offset"
    try:
        with socket.create_connection((host, PORT), timeout=timeout_s) as connection:
            connection.settimeout(timeout_s)
            for kind, payload in (
                (REQUEST_PROTOCOL_VERSION, struct.pack(">H", PROTOCOL_VERSION)),
                (SETUP_OUTPUTS, request),
                (START, b""),
            ):
                connection.sendall(frame(kind, payload))
                answer = _answer(connection, f"robot {host}:{PORT}")[1]
                if kind == SETUP_OUTPUTS and answer[1:] != b"VECTOR6D":
                    return
            while True:
                kind, payload = receive(connection)
                if kind == DATA and len(payload) == 1 + 6 * 8:
                    yield struct.unpack(">6d", payload[1:])
    except OSError as error:
        raise RobotUnreachableError(
            f"robot {host}:{PORT}: its tool centre point can't be read ({error})"
        ) from error


def _answer(connection: socket.socket, where: str) -> tuple[int, bytes]:
    """The next frame that is no text message."""
    for _ in range(20):
        try:
            kind, payload = receive(connection)
        except ConnectionError as error:
            raise ProtocolRefusedError(
                f"{where}: it closed the connection instead of speaking RTDE; check robot_ip"
            ) from error
        if kind != TEXT_MESSAGE:
            return kind, payload
    raise ProtocolRefusedError(f"{where}: it sends text only; check robot_ip")

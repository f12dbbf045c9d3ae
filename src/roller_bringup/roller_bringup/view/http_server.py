"""The page's HTTP server: its address, and connections that hold up nobody."""

from __future__ import annotations

import asyncio
import socket

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from roller_core.errors import RollerError

from .viewers import Viewers

#: Connections at most, of all browsers.
_MOST_CONNECTIONS = 64
#: A connection that brings no whole request for so long is closed, s.
_REQUEST_S = 5.0


class AddressError(RollerError):
    """The address can't be listened at."""


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens at an address; port 0: at one that is free.

    Raises
    ------
    AddressError
        If it can't.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except (OSError, OverflowError, TypeError) as error:  # the last of a name that isn't one
        reason = getattr(error, "strerror", None) or error
        raise AddressError(
            f"{host} port {port}: can't listen there ({reason}); give another --host or --port"
        ) from error


def check_address(host: str, port: int) -> None:
    """See whether an address can be listened at, before what is shown takes its time.

    Raises
    ------
    AddressError
        If it can't.
    """
    listen(host, port).close()


class HttpServer(uvicorn.Server):
    """Serves an application; ends the viewers' streams before it waits for them.

    Parameters
    ----------
    app : ASGI application
        What answers.
    viewers : Viewers
        Who listens to streams.
    """

    def __init__(self, app: ASGIApp, viewers: Viewers) -> None:
        super().__init__(
            uvicorn.Config(
                app,
                http=_Protocol,
                log_level="error",
                access_log=False,
                ws="none",
                limit_concurrency=_MOST_CONNECTIONS,
                timeout_graceful_shutdown=1,
                server_header=False,
            )
        )
        self._viewers = viewers

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Stop; see `uvicorn.Server`."""
        self._viewers.close()
        await super().shutdown(sockets)


class _Protocol(H11Protocol):
    """Closes connections that bring no request: they count against the limit of everybody."""

    _waiting: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._watch()

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        if self._waiting is not None:
            self._waiting.cancel()
            self._waiting = None

    def _watch(self) -> None:
        """Give it time for a request, counted from when none was under way."""
        if self._answering():
            if self._waiting is not None:
                self._waiting.cancel()
                self._waiting = None
        elif self._waiting is None and not self.transport.is_closing():
            self._waiting = self.loop.call_later(_REQUEST_S, self._give_up)

    def _answering(self) -> bool:
        return self.cycle is not None and not self.cycle.response_complete

    def _give_up(self) -> None:
        self._waiting = None
        if not self._answering():
            self.transport.abort()

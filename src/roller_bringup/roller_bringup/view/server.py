"""Serves the page: a scene as server-sent events, tiles on request, and a result's files."""

from __future__ import annotations

import asyncio
import json
import re
import secrets
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from ipaddress import ip_address
from pathlib import Path

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    JSONResponse,
    PlainTextResponse,
    RedirectResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from roller_core.errors import RollerError

from .result import offered_files
from .scene import Scene
from .viewers import Viewers

_PAGE = Path(__file__).parent / "page"
#: Between two frames, s.
_PERIOD_S = 0.18
#: A frame is sent after this long even where nothing changed, s.
_HEARTBEAT_S = 2.0
_COOKIE = "roller_view"
#: Connections at most, of all browsers.
_MOST_CONNECTIONS = 64
#: A connection that brings no whole request for so long is closed, s.
_REQUEST_S = 5.0
#: Everything is from here; what a result says never becomes code.
_PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
#: A result's own pages may draw, and reach nothing.
_FILE_POLICY = (
    "sandbox allow-scripts; default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
    "script-src 'unsafe-inline'"
)
#: What a browser asks for: a name or an address, and perhaps a port.
_HOST = re.compile(r"(?:\[([^\[\]@]+)\]|([^:\[\]@]+))(?::\d{1,5})?")
_INLINE = frozenset({".html", ".png", ".txt", ".json", ".csv", ".pdf"})


class AddressError(RollerError):
    """The address can't be listened at."""


class PageServer:
    """A server of one scene.

    Parameters
    ----------
    scene : Scene
        What is shown.
    host : str
        Address to listen at. Any other than one of this machine alone needs a token, which is in
        `url`.
    port : int
        Port; 0: one that is free.

    Raises
    ------
    AddressError
        If it can't listen there.
    """

    def __init__(self, scene: Scene, host: str = "127.0.0.1", port: int = 8090) -> None:
        self._scene = scene
        self.viewers = Viewers()
        self._socket = _listen(host, port)
        self.port = int(self._socket.getsockname()[1])
        self.token = "" if _is_loopback(host) else secrets.token_urlsafe(16)
        shown = socket.gethostname() if host in ("0.0.0.0", "::") else host
        self._hosts = {"localhost", "127.0.0.1", "::1", host}
        self.url = f"http://{f'[{shown}]' if ':' in shown else shown}:{self.port}/"
        if self.token:
            self.url += f"?token={self.token}"
        self.app = Starlette(
            routes=[
                Route("/", self._page),
                Route("/api/events", self._events),
                Route("/api/map", self._map),
                Route("/api/depth", self._depth),
                Route("/api/text", self._text),
                Route("/api/findings", self._findings),
                Route("/api/files", self._files),
                Route("/files/{name:path}", self._file),
                Mount("/page", StaticFiles(directory=_PAGE)),
            ],
            middleware=[Middleware(self._guarded)],
            lifespan=self._lifespan,
        )
        self._server = _Server(
            self.viewers,
            uvicorn.Config(
                self.app,
                http=_Protocol,
                log_level="error",
                access_log=False,
                ws="none",
                limit_concurrency=_MOST_CONNECTIONS,
                timeout_graceful_shutdown=1,
                server_header=False,
            ),
        )

    def run(self) -> None:
        """Serve until it is asked to end."""
        self._server.run(sockets=[self._socket])

    def stop(self) -> None:
        """End soon; for other threads."""
        self._server.should_exit = True

    def _refusal(self, request: Request) -> Response | None:
        """Let in who has the token; without one, only who asked for this machine by name."""
        if self.token:
            given = request.query_params.get("token") or request.cookies.get(_COOKIE, "")
            if not secrets.compare_digest(given.encode(), self.token.encode()):
                return PlainTextResponse("open the address that `roller view` printed", 401)
        elif _asked_host(request) not in self._hosts:
            # A page of elsewhere that had its own name point here.
            return PlainTextResponse("this address isn't served", 421)
        return None

    def _guarded(self, app: ASGIApp) -> ASGIApp:
        """Refuse strangers, and have browsers run nothing but our own page."""

        async def guarded(scope: Scope, receive: Receive, send: Send) -> None:
            async def send_with_headers(message: Message) -> None:
                if message["type"] == "http.response.start":
                    headers = MutableHeaders(scope=message)
                    headers.setdefault("Content-Security-Policy", _PAGE_POLICY)
                    headers.setdefault("Cache-Control", "no-store")
                    headers["X-Content-Type-Options"] = "nosniff"
                    headers["Referrer-Policy"] = "no-referrer"
                await send(message)

            refusal = self._refusal(Request(scope)) if scope["type"] == "http" else None
            await (refusal or app)(scope, receive, send_with_headers)

        return guarded

    async def _page(self, request: Request) -> Response:
        if "token" not in request.query_params:
            return FileResponse(_PAGE / "index.html")
        response = RedirectResponse("/", 303)
        response.set_cookie(_COOKIE, self.token, httponly=True, samesite="strict")
        return response

    async def _events(self, _: Request) -> Response:
        return StreamingResponse(self.viewers.stream(), media_type="text/event-stream")

    async def _map(self, request: Request) -> Response:
        try:
            since = int(request.query_params.get("since", "-1"))
        except ValueError:
            return PlainTextResponse("since must be a revision", 400)
        return _binary(self._scene.map_answer(request.query_params.get("epoch", ""), since))

    async def _depth(self, _: Request) -> Response:
        return _binary(self._scene.depth_answer())

    async def _text(self, _: Request) -> Response:
        return PlainTextResponse(self._scene.text)

    async def _findings(self, _: Request) -> Response:
        return JSONResponse(self._scene.findings)

    async def _files(self, _: Request) -> Response:
        folder = self._scene.folder
        found = offered_files(folder) if folder is not None else ()
        return JSONResponse([{"name": name, "bytes": size} for name, size in found])

    async def _file(self, request: Request) -> Response:
        name, folder = request.path_params["name"], self._scene.folder
        if folder is None or name not in dict(offered_files(folder)):
            return PlainTextResponse("there is no such file", 404)
        path = folder / name
        kind = "inline" if path.suffix in _INLINE else "attachment"
        response = FileResponse(path, filename=path.name, content_disposition_type=kind)
        response.headers["Content-Security-Policy"] = _FILE_POLICY
        return response

    @asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        task = asyncio.create_task(self._send_frames())
        try:
            yield
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    async def _send_frames(self) -> None:
        before, sent_s, seen, due_s = "", 0.0, 0, time.monotonic()
        while True:
            # Work, and a loop that is late, don't add up: five frames a second are five.
            due_s = max(due_s + _PERIOD_S, time.monotonic())
            await asyncio.sleep(due_s - time.monotonic())
            if not len(self.viewers):
                seen = 0
                continue
            now_s = time.monotonic()
            state = self._scene.state(now_s)
            state |= {"viewers": len(self.viewers), "dropped_frames": self.viewers.dropped}
            data = json.dumps(state, separators=(",", ":"))
            # Who has just come waits for nothing.
            if data != before or len(self.viewers) > seen or now_s - sent_s > _HEARTBEAT_S:
                self.viewers.offer(data)
                before, sent_s = data, now_s
            seen = len(self.viewers)


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


class _Server(uvicorn.Server):
    """Ends the streams before it waits for them."""

    def __init__(self, viewers: Viewers, config: uvicorn.Config) -> None:
        super().__init__(config)
        self._viewers = viewers

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._viewers.close()
        await super().shutdown(sockets)


def _asked_host(request: Request) -> str:
    """Name or address that was asked for; empty if it is neither."""
    # `request.url` puts the server's own address in place of what it can't read.
    found = _HOST.fullmatch(request.headers.get("host", ""))
    return (found[1] or found[2]).lower() if found else ""


def _binary(data: bytes) -> Response:
    return Response(data, media_type="application/octet-stream")


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def check_address(host: str, port: int) -> None:
    """See whether an address can be listened at, before what is shown takes its time.

    Raises
    ------
    AddressError
        If it can't.
    """
    _listen(host, port).close()


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except (OSError, OverflowError, TypeError) as error:  # the last of a name that isn't one
        reason = getattr(error, "strerror", None) or error
        raise AddressError(
            f"{host} port {port}: can't listen there ({reason}); give another --host or --port"
        ) from error

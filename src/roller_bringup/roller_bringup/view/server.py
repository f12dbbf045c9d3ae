"""Serves the page: a scene as server-sent events, tiles on request, and a result's files."""

from __future__ import annotations

import asyncio
import json
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    JSONResponse,
    PlainTextResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from .access import FILE_POLICY, Access
from .http_server import HttpServer, listen
from .result import offered_files
from .scene import Scene
from .viewers import Viewers

_PAGE = Path(__file__).parent / "page"
#: Between two frames, s.
_PERIOD_S = 0.18
#: A frame is sent after this long even where nothing changed, s.
_HEARTBEAT_S = 2.0
_INLINE = frozenset({".html", ".png", ".txt", ".json", ".csv", ".pdf"})


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
        self._socket = listen(host, port)
        self.port = int(self._socket.getsockname()[1])
        self._access = Access(host)
        self.token = self._access.token
        shown = socket.gethostname() if host in ("0.0.0.0", "::") else host
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
            middleware=[Middleware(self._access.guarded)],
            lifespan=self._lifespan,
        )
        self._server = HttpServer(self.app, self.viewers)

    def run(self) -> None:
        """Serve until it is asked to end."""
        self._server.run(sockets=[self._socket])

    def stop(self) -> None:
        """End soon; for other threads."""
        self._server.should_exit = True

    async def _page(self, request: Request) -> Response:
        if "token" not in request.query_params:
            return FileResponse(_PAGE / "index.html")
        return self._access.remember_token()

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
        response.headers["Content-Security-Policy"] = FILE_POLICY
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
                continue
            now_s = time.monotonic()
            state = self._scene.state(now_s)
            state |= {"viewers": len(self.viewers), "dropped_frames": self.viewers.dropped}
            data = json.dumps(state, separators=(",", ":"))
            # Who has just come waits for nothing.
            if data != before or self.viewers.came > seen or now_s - sent_s > _HEARTBEAT_S:
                self.viewers.offer(data)
                before, sent_s = data, now_s
            seen = self.viewers.came


def _binary(data: bytes) -> Response:
    return Response(data, media_type="application/octet-stream")

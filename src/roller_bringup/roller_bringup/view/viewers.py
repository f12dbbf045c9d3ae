"""Browsers that look on: each has a short queue, and one that is slow misses frames."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator

#: Frames that wait for one browser at most.
QUEUE = 4


class Viewer:
    """One browser's queue."""

    def __init__(self) -> None:
        self.dropped = 0
        self.closed = False
        self._frames: deque[bytes] = deque()
        self._ready = asyncio.Event()

    def offer(self, frame: bytes) -> None:
        """Queue a frame; the oldest goes when there are too many."""
        if len(self._frames) >= QUEUE:
            self._frames.popleft()
            self.dropped += 1
        self._frames.append(frame)
        self._ready.set()

    def close(self) -> None:
        """End its frames."""
        self.closed = True
        self._ready.set()

    async def frames(self) -> AsyncIterator[bytes]:
        """Frames as the browser takes them, until it is closed."""
        while not self.closed:
            await self._ready.wait()
            while self._frames:
                yield self._frames.popleft()
            self._ready.clear()


class Viewers:
    """All browsers."""

    def __init__(self) -> None:
        self._all: set[Viewer] = set()
        self._gone = self._number = 0
        #: How many have come; as many may have left.
        self.came = 0

    def __len__(self) -> int:
        return len(self._all)

    @property
    def dropped(self) -> int:
        """Frames that browsers missed, also of those that have left."""
        return self._gone + sum(viewer.dropped for viewer in self._all)

    def offer(self, data: str) -> None:
        """Queue data, one line, for all as a server-sent event."""
        self._number += 1
        frame = f"id: {self._number}\ndata: {data}\n\n".encode()
        for viewer in self._all:
            viewer.offer(frame)

    def close(self) -> None:
        """End all streams: a server that ends waits for them."""
        for viewer in self._all:
            viewer.close()

    async def stream(self) -> AsyncIterator[bytes]:
        """One browser's frames, for as long as it looks on."""
        viewer = Viewer()
        self._all.add(viewer)
        self.came += 1
        try:
            yield b"retry: 1000\n\n"
            async for frame in viewer.frames():
                yield frame
        finally:
            self._all.discard(viewer)
            self._gone += viewer.dropped

"""MCAP storage that is readable up to the last whole chunk, whatever ends the writing.

`rosbags` writes the format. What is added here: a chunk reaches the file in one piece or not at
all, has a checksum, and can be closed before it is full.
"""

from __future__ import annotations

import os
import zlib
from collections import deque
from itertools import islice
from pathlib import Path
from typing import Any

import zstandard
from rosbags.rosbag2 import CompressionMode
from rosbags.rosbag2.storage_mcap import McapWriter

#: Where a chunk's record has its checksum, bytes.
_CRC = slice(24, 28)
#: Pieces that the operating system takes at once.
_PARTS = 512


class AtomicFile:
    """A file to which what was written since the last flush goes whole or not at all.

    Parameters
    ----------
    path : path
        An existing file, which is written on.
    """

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC)
        self._size = os.fstat(self._fd).st_size
        self.parts: list[bytes | memoryview] = []
        self._pending = 0
        self.closed = False

    def write(self, data: bytes | memoryview) -> int:
        """Keep data for the next flush; they must not change until then."""
        self.parts.append(data)
        self._pending += len(data)
        return len(data)

    def tell(self) -> int:
        """Bytes written so far, also those that wait."""
        return self._size + self._pending

    def flush(self) -> None:
        """Hand what waits to the operating system.

        Raises
        ------
        OSError
            If it doesn't fit; the file is then as it was before.
        """
        rest = deque(memoryview(part) for part in self.parts)
        size, self.parts, self._pending = self._pending, [], 0
        try:
            while rest:
                written = os.writev(self._fd, list(islice(rest, _PARTS)))
                while rest and written >= len(rest[0]):
                    written -= len(rest.popleft())
                if written:
                    rest[0] = rest[0][written:]
        except OSError:
            os.ftruncate(self._fd, self._size)
            raise
        self._size += size

    def sync(self) -> None:
        """Wait until what was flushed is on the disk."""
        os.fdatasync(self._fd)

    def close(self) -> None:
        """Flush and close."""
        if not self.closed:
            try:
                self.flush()
            finally:
                self.closed = True
                os.close(self._fd)

    def discard(self) -> None:
        """Close without what waits."""
        self.parts, self._pending = [], 0
        self.close()


class WholeMcapWriter(McapWriter):
    """Storage for `rosbags.rosbag2.Writer`; chunks end at a megabyte or when told to.

    Attributes
    ----------
    unwritten : dict
        Messages by connection of a chunk that the disk didn't take.
    """

    bio: Any  # AtomicFile does what McapWriter needs of a file

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        super().__init__(path, compression)
        self.bio.close()
        self.bio = AtomicFile(self.path)
        if self.compression:
            # At this level a core compresses more than the fastest sensor sends.
            self.compressor = zstandard.ZstdCompressor(level=1).compress
        self.unwritten: dict[int, int] = {}
        self._closing = False

    @property
    def pending(self) -> bool:
        """Whether messages wait for their chunk to be closed and handed over."""
        return bool(self.chunk.msgs) or self._closing

    def close_chunk(self) -> None:
        """Close the chunk and hand it to the operating system.

        Raises
        ------
        OSError
            If the disk doesn't take it; the file then ends with the chunk before.
        """
        self._closing = True  # before the library forgets the chunk
        counts = {cid: len(messages) for cid, messages in self.chunk.msgs.items()}
        checksum, first = zlib.crc32(self.chunk.bio.getbuffer()), len(self.bio.parts)
        super().close_chunk()
        # The library leaves it zero, which stands for none; before the body are opcode and length.
        self.bio.parts[first + 2][_CRC] = checksum.to_bytes(4, "little")
        try:
            self.bio.flush()
        except OSError:
            self.chunks.pop()
            for cid, count in counts.items():
                self.channel_stats[cid] -= count
                self.unwritten[cid] = self.unwritten.get(cid, 0) + count
            raise
        finally:
            self._closing = False

    def abort(self) -> None:
        """Close the file as it is."""
        self.bio.discard()

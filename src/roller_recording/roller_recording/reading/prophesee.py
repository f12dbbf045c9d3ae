"""Prophesee `.raw` files: lines of text that begin with '%', then words of EVT 3.0."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from roller_core.codecs import DecodedPacket, PacketDecoder
from roller_core.events import EventArray

from .base import RecordingError, TruncatedRecordingError

ENCODING = "evt3"
_BLOCK_BYTES = 1_000_000
#: EVT 3.0 has no pixels beyond this.
_MOST_PIXELS = 2048


def event_stream(path: Path, wanted: str | None = None) -> tuple[int, int, int]:
    """Where the words of a file begin, byte, and its width and height, px; 0 if it doesn't say.

    Parameters
    ----------
    path : path
        The file.
    wanted : str, optional
        Such a file has one stream of events, so there is nothing to choose.

    Raises
    ------
    RecordingError
        If it isn't EVT 3.0.
    """
    lines, begin = _header(path)
    text = "\n".join(lines)
    if wanted is not None:
        raise RecordingError(f"{path}: a .raw file has one stream of events; leave out --topic")
    if not re.search(r"^% *(evt 3\.0|format EVT3)", text, re.MULTILINE | re.IGNORECASE):
        named = re.search(r"^% *(?:evt|format) +([^;\n]+)", text, re.MULTILINE)
        raise RecordingError(
            f"{path}: is not of EVT 3.0 ({named[1] if named else 'its header names no format'}); "
            "other formats of .raw files are not read"
        )
    if size := re.search(r"^% *geometry +(\d+)x(\d+)", text, re.MULTILINE | re.IGNORECASE):
        return begin, int(size[1]), int(size[2])
    width, height = re.search(r"width=(\d+)", text), re.search(r"height=(\d+)", text)
    return begin, int(width[1]) if width else 0, int(height[1]) if height else 0


def read_events(path: Path, begin: int) -> Iterator[EventArray]:
    """Events of a file, block by block, times as recorded (µs to ns); errors of `read_blocks`."""
    for _, _, packet in read_blocks(path, begin):
        yield packet.events


def read_blocks(path: Path, begin: int) -> Iterator[tuple[int, bytes, DecodedPacket]]:
    """Blocks of a file: the byte that they begin at, their words, and what these hold.

    Raises
    ------
    RecordingError
        If the file can't be read.
    TruncatedRecordingError
        At its end, if that is no whole word.
    """
    _, width, height = event_stream(path)
    decoder = PacketDecoder("evt3", width or _MOST_PIXELS, height or _MOST_PIXELS)
    try:
        with open(path, "rb") as file:
            file.seek(begin)
            while block := file.read(_BLOCK_BYTES):
                words = block[: len(block) // 2 * 2]
                yield file.tell() - len(block), words, decoder.decode(words)
                if len(block) % 2:
                    raise TruncatedRecordingError(
                        f"{path}: cut off at byte {file.tell()}, in the middle of a word; "
                        "what came before is read"
                    )
    except OSError as error:
        raise RecordingError(f"{path}: can't be read ({error.strerror})") from error


def _header(path: Path) -> tuple[list[str], int]:
    """The lines of the header and where the data begin, byte."""
    lines, begin = [], 0
    try:
        with open(path, "rb") as file:
            while re.match(rb"%[ A-Za-z\r\n]", file.peek(2)[:2]):  # words may begin with a % too
                line = file.readline(10_000)
                begin += len(line)
                lines.append(line.decode("ascii", "replace").rstrip())
                if lines[-1].replace(" ", "") == "%end":
                    break
    except OSError as error:
        raise RecordingError(f"{path}: can't be read ({error.strerror})") from error
    return lines, begin

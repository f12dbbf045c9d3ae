"""Reading an MCAP file that was cut off: every whole chunk before the cut."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import breakup_chunk

from roller_recording.raw_message import RawMessage

from .base import MalformedRecordingError, RecordingError, TruncatedRecordingError
from .storage import Storage, reason

_MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
_HOLDS_DATA = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK)


class _CutError(Exception):
    """The file ends in the middle of what starts at `offset`."""

    def __init__(self, offset: int, data_ended: bool) -> None:
        super().__init__()
        self.offset = offset
        self.data_ended = data_ended


class McapScan(Storage):
    """An MCAP file without its index, in the order it was written.

    Raises
    ------
    RecordingError
        If it is no MCAP file.
    """

    def __init__(self, path: Path, shown: Path | None = None) -> None:
        super().__init__(path, shown)
        self._survey(self._read(None))

    def messages(self, topics: set[str]) -> Iterator[RawMessage | RecordingError]:
        """Messages of some topics; broken chunks are passed over with a fault each."""
        yield from self._read(topics)

    def _read(self, topics: set[str] | None) -> Iterator[RawMessage | RecordingError]:
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        count, start_ns, last_ns = 0, None, 0
        with open(self.path, "rb") as stream:
            try:
                for item in _contents(self.path, self.shown, stream):
                    if isinstance(item, RecordingError):
                        yield item
                    elif isinstance(item, Schema):
                        schemas[item.id] = item
                    elif isinstance(item, Channel):
                        channels[item.id] = item
                    elif item.channel_id in channels:
                        count, last_ns = count + 1, max(last_ns, item.log_time)
                        start_ns = last_ns if start_ns is None else start_ns
                        channel = channels[item.channel_id]
                        if topics is None or channel.topic in topics:
                            schema = schemas.get(channel.schema_id)
                            kind = schema.name if schema else ""
                            yield RawMessage(item.log_time, channel.topic, item.data, kind)
            except _CutError as cut:
                yield self._cut(cut, count, (last_ns - (start_ns or 0)) * 1e-9)

    def _cut(self, cut: _CutError, count: int, span_s: float) -> RecordingError:
        where = f"bag {self.shown}: cut off at byte {cut.offset}"
        if cut.data_ended:
            return TruncatedRecordingError(f"{where}, in the index; all {count} messages are read")
        if not count:
            return TruncatedRecordingError(
                f"{where}, before the first whole chunk; nothing is read"
            )
        return TruncatedRecordingError(
            f"{where}, after {span_s:.3f} s; the {count} messages before are read"
        )


def _contents(
    path: Path, shown: Path, stream: BinaryIO
) -> Iterator[Schema | Channel | Message | RecordingError]:
    """What chunks and the file itself hold, in order."""
    for offset, opcode, body in _records(path, shown, stream):
        data = ReadDataStream(BytesIO(body))
        try:
            if opcode == Opcode.CHUNK:
                found: list[Any] = breakup_chunk(Chunk.read(data), validate_crc=True)
            elif opcode == Opcode.MESSAGE:
                found = [Message.read(data, len(body))]
            else:
                found = [(Schema if opcode == Opcode.SCHEMA else Channel).read(data)]
        except Exception as error:  # a broken body raises whatever its bytes lead to
            yield MalformedRecordingError(
                f"bag {shown}: the record at byte {offset} is broken ({reason(error)}); "
                "it is left out"
            )
            continue
        yield from found


def _records(path: Path, shown: Path, stream: BinaryIO) -> Iterator[tuple[int, int, bytes]]:
    """Offset, opcode and body of the records with data, up to the footer."""
    size = path.stat().st_size
    if stream.read(len(_MAGIC)) != _MAGIC:
        raise RecordingError(f"bag {shown}: {'is no MCAP file' if size else 'is empty'}")
    offset, data_ended = len(_MAGIC), False
    while True:
        head = stream.read(_HEAD.size)
        # Opcode 0 is none: the zeros that a power cut can leave.
        if len(head) < _HEAD.size or not head[0]:
            raise _CutError(offset, data_ended)
        opcode, length = _HEAD.unpack(head)
        if length > size - offset - _HEAD.size:
            raise _CutError(offset, data_ended)
        if opcode == Opcode.FOOTER:
            if stream.read(length + len(_MAGIC))[length:] != _MAGIC:
                raise _CutError(offset, data_ended)
            return
        data_ended = data_ended or opcode == Opcode.DATA_END
        if opcode in _HOLDS_DATA and not data_ended:
            yield offset, opcode, stream.read(length)
        else:
            stream.seek(length, 1)
        offset += _HEAD.size + length

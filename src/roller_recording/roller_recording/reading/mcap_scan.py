"""Reading an MCAP file that was cut off: every whole chunk before the cut."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BytesIO
from typing import Any, BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import breakup_chunk

from roller_recording.raw_message import RawMessage

from .base import MalformedRecordingError, RecordingError
from .storage import BreaksOffError, Items, ScannedFile, reason

_MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
_HOLDS_DATA = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK)


class McapScan(ScannedFile):
    """An MCAP file without its index, in the order it was written.

    Raises
    ------
    RecordingError
        If it is no MCAP file.
    """

    unit = "chunks"

    def _contents(self) -> Items:
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        self.unchecked = 0
        with open(self.path, "rb") as stream:
            for item in self._parts(stream):
                if isinstance(item, RecordingError):
                    yield item
                elif isinstance(item, Schema):
                    schemas[item.id] = item
                elif isinstance(item, Channel):
                    channels[item.id] = item
                elif channel := channels.get(item.channel_id):
                    schema = schemas.get(channel.schema_id)
                    kind = schema.name if schema else ""
                    yield RawMessage(item.log_time, channel.topic, item.data, kind)

    def _parts(self, stream: BinaryIO) -> Iterator[Schema | Channel | Message | RecordingError]:
        """What chunks and the file itself hold, in order."""
        for offset, opcode, body in self._records(stream):
            data = ReadDataStream(BytesIO(body))
            try:
                if opcode == Opcode.CHUNK:
                    chunk = Chunk.read(data)
                    self.unchecked += not chunk.uncompressed_crc
                    found: list[Any] = breakup_chunk(chunk, validate_crc=True)
                elif opcode == Opcode.MESSAGE:
                    found = [Message.read(data, len(body))]
                else:
                    found = [(Schema if opcode == Opcode.SCHEMA else Channel).read(data)]
            except Exception as error:  # a broken body raises whatever its bytes lead to
                yield MalformedRecordingError(
                    f"bag {self.shown}: the record at byte {offset} is broken ({reason(error)}); "
                    "it is left out"
                )
                continue
            yield from found

    def _records(self, stream: BinaryIO) -> Iterator[tuple[int, int, bytes]]:
        """Offset, opcode and body of the records with data, up to the footer."""
        size = self.path.stat().st_size
        if stream.read(len(_MAGIC)) != _MAGIC:
            raise RecordingError(f"bag {self.shown}: {'is no MCAP file' if size else 'is empty'}")
        offset, data_ended = len(_MAGIC), False
        while True:
            head = stream.read(_HEAD.size)
            opcode, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
            rest = stream.read(length + len(_MAGIC)) if opcode == Opcode.FOOTER else b""
            if opcode == Opcode.FOOTER and rest[length:] == _MAGIC:
                return
            # Opcode 0 is none: the zeros that a power cut can leave.
            if rest or not opcode or length > size - offset - _HEAD.size:
                raise BreaksOffError(f"cut off at byte {offset},", data_ended)
            data_ended = data_ended or opcode == Opcode.DATA_END
            if opcode in _HOLDS_DATA and not data_ended:
                yield offset, opcode, stream.read(length)
            else:
                stream.seek(length, 1)
            offset += _HEAD.size + length

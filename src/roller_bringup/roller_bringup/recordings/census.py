"""Counting what a recording holds."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from roller_core.bags import EVENT_ARRAY, EVENT_PACKET, typestore
from roller_core.codecs import PacketDecoder
from roller_core.errors import RollerError

from .base import RecordingError


@dataclass
class Census:
    """Counts of a recording.

    Attributes
    ----------
    packets, events, on, off, triggers_rising, triggers_falling, outside : int
        Of all event topics.
    encodings : set of str
        Of the packets.
    size : tuple of int
        Image width and height, px.
    first_ns, last_ns : int or None
        Sensor time of the first and last event.
    topics : Counter
        Messages by topic, for bags.
    faults : list of str
        What was wrong.
    """

    packets: int = 0
    events: int = 0
    on: int = 0
    triggers_rising: int = 0
    triggers_falling: int = 0
    outside: int = 0
    encodings: set[str] = field(default_factory=set)
    size: tuple[int, int] = (0, 0)
    first_ns: int | None = None
    last_ns: int | None = None
    topics: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)

    @property
    def off(self) -> int:
        """OFF events."""
        return self.events - self.on

    def lines(self) -> list[str]:
        """The counts, for people."""
        span = ((self.last_ns or 0) - (self.first_ns or 0)) * 1e-9
        out = [
            f"encoding   {', '.join(sorted(self.encodings)) or '-'}",
            f"image      {self.size[0]} x {self.size[1]} px",
            f"packets    {self.packets}",
            f"events     {self.events} ({self.on} ON, {self.off} OFF)",
            f"triggers   {self.triggers_rising} rising, {self.triggers_falling} falling",
            f"duration   {span:.6f} s",
        ]
        if self.outside:
            out.append(f"outside    {self.outside} events outside the image")
        out += [f"topic      {name}: {n} messages" for name, n in sorted(self.topics.items())]
        return out

    def add(self, events: Any, outside: int = 0) -> None:
        """Count decoded events."""
        self.packets += 1
        self.events += len(events)
        self.on += int(events.p.sum())
        self.outside += outside
        if len(events):
            if self.first_ns is None:
                self.first_ns = int(events.t_ns[0])
            self.last_ns = int(events.t_ns[-1])


def take_census(path: Path) -> Census:
    """Count the events of a rosbag2 or AEDAT4 file.

    Raises
    ------
    RollerError
        If it can't be read at all.
    """
    if not path.exists():
        raise RecordingError(f"{path}: there is no such file or folder")
    census = Census()
    if path.is_file() and path.suffix.lower() in (".aedat4", ".aedat"):
        from .aedat4 import read_events, stream_size

        census.size = stream_size(path)
        census.encodings.add("aedat4")
        try:
            for events in read_events(path):
                census.add(events)
        except RecordingError as error:
            census.faults.append(str(error))
        return census
    _count_bag(path, census)
    return census


def _count_bag(path: Path, census: Census) -> None:
    from .bag_reader import BagReader

    reader, store = BagReader(path), typestore()
    decoders: dict[tuple[str, str], PacketDecoder] = {}
    for item in reader.messages(set(reader.topics)):
        if isinstance(item, RecordingError):
            census.faults.append(str(item))
            break
        census.topics[item.topic] += 1
        if item.type not in (EVENT_PACKET, EVENT_ARRAY):
            continue
        try:
            message: Any = store.deserialize_cdr(item.data, item.type)
            key = (item.topic, message.encoding)
            if key not in decoders:
                decoders[key] = PacketDecoder(message.encoding, message.width, message.height)
            packet = decoders[key].decode(message.events, message.time_base)
        except RollerError as error:
            census.faults.append(str(error))
            continue
        census.encodings.add(message.encoding)
        census.size = (message.width, message.height)
        census.add(packet.events, packet.outside)
        census.triggers_rising += int(packet.triggers.edge.sum())
        census.triggers_falling += len(packet.triggers) - int(packet.triggers.edge.sum())

"""Counting what a recording holds."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from roller_core.bags import EVENT_ARRAY, EVENT_PACKET, typestore
from roller_core.codecs import DecodedPacket, PacketDecoder, Payload, unknown_words
from roller_core.errors import RollerError
from roller_core.seq_gaps import SeqGaps
from roller_core.time_order import JITTER_NS, TimeBackwardsError, TimeOrder

from .base import MalformedRecordingError, RecordingError, check_path, is_dataset
from .event_file import BlockReader, EventReader, reader_of

#: Of more faults of a kind the rest is counted.
_MOST_FAULTS = 100


@dataclass
class SensorSpan:
    """How long a sensor sent, over its starts."""

    #: How often its time began anew.
    restarts: int = 0
    _before_ns: int = 0
    _first_ns: int | None = None
    _last_ns: int = 0

    @property
    def duration_s(self) -> float:
        """From the first event to the last of each start, together, s."""
        return (self._before_ns + self._last_ns - (self._first_ns or 0)) * 1e-9

    def add(self, first_ns: int, last_ns: int) -> None:
        """Take the times of a packet's first and last event."""
        if self._first_ns is None:
            self._first_ns = first_ns
        elif first_ns < self._last_ns - JITTER_NS:
            self._before_ns += self._last_ns - self._first_ns
            self._first_ns = first_ns
            self.restarts += 1
        self._last_ns = last_ns


@dataclass
class RecordingSummary:
    """Counts of a recording, of all its event topics."""

    packets: int = 0
    events: int = 0
    on: int = 0
    triggers_rising: int = 0
    triggers_falling: int = 0
    outside: int = 0
    untimed: int = 0
    #: Words that mean nothing in their encoding.
    unknown_words: int = 0
    #: Of the packets.
    encodings: set[str] = field(default_factory=set)
    #: Image width and height, px.
    size: tuple[int, int] = (0, 0)
    #: Sensor time by topic.
    spans: dict[str, SensorSpan] = field(default_factory=dict)
    #: Messages by topic, for bags.
    topics: Counter[str] = field(default_factory=Counter)
    #: Event packets that are missing.
    gaps: SeqGaps = field(default_factory=SeqGaps)
    #: Log time of a bag's first message, ns.
    start_ns: int = 0
    #: What is odd and costs no data; what was wrong.
    notes: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    _first_unknown: str = ""
    _kinds: Counter[str] = field(default_factory=Counter)

    @property
    def off(self) -> int:
        """OFF events."""
        return self.events - self.on

    def lines(self) -> list[str]:
        """The counts, for people."""
        span = max(self.spans.values(), key=lambda one: one.duration_s, default=SensorSpan())
        anew = f", the sensor's time began {span.restarts} times anew" if span.restarts else ""
        out = [
            f"encoding   {', '.join(sorted(self.encodings)) or '-'}",
            f"image      {self.size[0]} x {self.size[1]} px",
            f"packets    {self.packets}",
            f"events     {self.events} ({self.on} ON, {self.off} OFF)",
            f"triggers   {self.triggers_rising} rising, {self.triggers_falling} falling",
            f"duration   {span.duration_s:.6f} s{anew}",
        ]
        if self.gaps.lost:
            out.append(
                f"lost       {self.gaps.lost} packets in {self.gaps.gaps} gaps: "
                f"{self.gaps.describe(self.start_ns)}"
            )
        if self.gaps.restarts:
            out.append(
                f"restarts   {self.gaps.restarts} times the packets' numbers fell or leapt: a "
                "source that started anew, or another"
            )
        if self.outside:
            out.append(f"outside    {self.outside} events outside the image")
        if self.untimed:
            out.append(f"untimed    {self.untimed} events before the first time")
        out += [f"topic      {name}: {n} messages" for name, n in sorted(self.topics.items())]
        out += [f"note       {note}" for note in self.notes]
        return out

    def add(self, events: Any, outside: int = 0, topic: str = "") -> None:
        """Count decoded events."""
        self.packets += 1
        self.events += len(events)
        self.on += int(events.p.sum())
        self.outside += outside
        if len(events):
            span = self.spans.setdefault(topic, SensorSpan())
            span.add(int(events.t_ns[0]), int(events.t_ns[-1]))

    def add_packet(
        self,
        encoding: str,
        payload: Payload,
        packet: DecodedPacket,
        at: str,
        begin: int = 0,
        topic: str = "",
    ) -> None:
        """Count a packet and what of it could not be decoded.

        Parameters
        ----------
        encoding, payload
            Of the packet.
        packet : DecodedPacket
            What was decoded of it.
        at : str
            Where it is, for people; a byte's number follows.
        begin : int
            Number of its first byte.
        topic : str
            On which it came.
        """
        self.add(packet.events, packet.outside, topic)
        self.untimed += packet.untimed
        self.triggers_rising += int(packet.triggers.edge.sum())
        self.triggers_falling += len(packet.triggers) - int(packet.triggers.edge.sum())
        unknown = unknown_words(encoding, payload)
        if len(unknown) and not self.unknown_words:
            self._first_unknown = f"{at}{begin + unknown[0]} ({encoding})"
        self.unknown_words += len(unknown)

    def add_fault(self, error: Exception) -> None:
        """Note what is wrong; of each kind so many, the rest is counted."""
        kind = type(error).__name__
        self._kinds[kind] += 1
        if self._kinds[kind] <= _MOST_FAULTS:
            self.faults.append(str(error))

    def end(self) -> None:
        """All is counted: what could not be decoded is a fault."""
        for kind, n in self._kinds.items():
            if n > _MOST_FAULTS:
                self.faults.append(f"{n - _MOST_FAULTS} more of this kind ({kind})")
        if self.unknown_words:
            self.faults.append(
                f"{self.unknown_words} words mean nothing in their encoding, the first "
                f"{self._first_unknown}: damaged, or of another encoding"
            )


def summarise(path: Path, topic: str | None = None, check: bool = False) -> RecordingSummary:
    """Count the events of a bag or of a file of events.

    Parameters
    ----------
    path : path
        The recording.
    topic : str, optional
        Topic of the event packets to count; all if not given. For AEDAT4 the number of the stream.
    check : bool
        Whether to decode the messages of all topics, and to hold a bag's index against what is
        there.

    Raises
    ------
    RollerError
        If it can't be read at all.
    """
    check_path(path)
    summary = RecordingSummary()
    if (reader := reader_of(path)) is not None:
        stream, *size = reader.event_stream(path, topic)
        summary.size = (size[0], size[1])
        summary.encodings.add(reader.ENCODING)
        try:
            _count_file(path, summary, reader, stream)
        except RecordingError as error:
            summary.add_fault(error)
    elif is_dataset(path):
        _count_dataset(path, summary)
    else:
        _count_bag(path, summary, topic, check)
    summary.end()
    return summary


def _count_file(path: Path, summary: RecordingSummary, reader: EventReader, stream: int) -> None:
    if not isinstance(reader, BlockReader):
        order = TimeOrder()
        for events in reader.read_events(path, stream):
            summary.add(events)
            try:
                order.take(events.sorted_by_time())
            except TimeBackwardsError as error:
                summary.add_fault(error)
        return
    for begin, words, packet in reader.read_blocks(path, stream):
        summary.add_packet(reader.ENCODING, words, packet, f"in {path}, byte ", begin)


def _count_dataset(path: Path, summary: RecordingSummary) -> None:
    from .dataset import EventsText

    text = EventsText(path)
    summary.size = text.image_size()
    summary.encodings.add("text")
    for step in text.items(summary.size):
        summary.add(step.events)
        for fault in step.faults:
            summary.add_fault(fault)
    summary.outside = text.counts.outside_events


def _count_bag(path: Path, summary: RecordingSummary, topic: str | None, check: bool) -> None:
    from .bag_reader import BagReader
    from .event_topic import event_topic

    reader, store = BagReader(path), typestore()
    if topic is not None:
        event_topic(reader.topics, path, topic)
    summary.notes = reader.notes
    summary.notes += [
        f"the recorder says: {name.replace('_', ' ')}: {value}"
        for name, value in reader.custom.items()
        if value != "0"
    ]
    summary.start_ns = reader.start_ns
    decoders: dict[tuple[str, str], PacketDecoder] = {}
    for item in reader.messages(set(reader.topics)):
        if isinstance(item, RecordingError):
            summary.add_fault(item)
            continue
        summary.topics[item.topic] += 1
        counted = item.type in (EVENT_PACKET, EVENT_ARRAY) and topic in (None, item.topic)
        if not counted and not (check and item.type in store.fielddefs):
            continue
        try:
            message: Any = store.deserialize_cdr(item.data, item.type)
            if not counted:
                continue
            summary.gaps.see(item.topic, message.seq, item.t_ns)
            key = (item.topic, message.encoding)
            if key not in decoders:
                decoders[key] = PacketDecoder(message.encoding, message.width, message.height)
            packet = decoders[key].decode(message.events, message.time_base)
        except RollerError as error:
            where = f"bag {path}: {item.topic} at {item.t_ns * 1e-9:.6f} s"
            summary.add_fault(type(error)(f"{where}: {error}"))
            continue
        except Exception as error:  # a damaged message raises whatever its bytes lead to
            summary.add_fault(
                MalformedRecordingError(
                    f"bag {path}: a message on {item.topic} at {item.t_ns * 1e-9:.6f} s is "
                    f"malformed ({error})"
                )
            )
            continue
        summary.encodings.add(message.encoding)
        summary.size = (message.width, message.height)
        where = f"on {item.topic} at {item.t_ns * 1e-9:.6f} s, byte "
        summary.add_packet(message.encoding, message.events, packet, where, topic=item.topic)
    if check:
        faults, notes = reader.check(summary.topics)
        if not summary.faults:  # else reported already
            for fault in faults:
                summary.add_fault(fault)
        summary.notes += notes
        summary.notes.append(f"checked: {summary.topics.total()} messages are read and decoded")

"""What of a stream never reached the bag, where and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from roller_core.seq_gaps import SeqGaps
from roller_recording.raw_message import RawMessage


@dataclass
class Dropped:
    """Messages of a topic that came and were not written."""

    #: How many.
    messages: int = 0
    #: Arrival of the first and the last, ns.
    first_ns: int = 0
    last_ns: int = 0

    def add(self, t_ns: int, messages: int = 1) -> None:
        """Count some that came until `t_ns`."""
        self.first_ns = self.first_ns if self.messages else t_ns
        self.last_ns = t_ns
        self.messages += messages


@dataclass
class Losses:
    """What was lost, by where it was lost."""

    #: Event packets that never came here: lost by the driver or on the network.
    before: SeqGaps = field(default_factory=SeqGaps)
    #: How often the middleware's queue of a topic was full when messages were taken: some may have
    #: been lost there. Event packets between others are counted in `before` too.
    overflows: Counter[str] = field(default_factory=Counter)
    #: Event packets of other cameras that sent at the same time, by topic.
    foreign: dict[str, Dropped] = field(default_factory=dict)
    #: Messages for which the queue had no room, by topic.
    dropped: dict[str, Dropped] = field(default_factory=dict)
    #: Messages that the disk didn't take, or that came after it was full, by topic.
    unwritten: dict[str, Dropped] = field(default_factory=dict)

    @property
    def foreign_packets(self) -> int:
        """Event packets of other cameras, left out."""
        return sum(d.messages for d in self.foreign.values())

    @property
    def here(self) -> int:
        """Messages that came and are not in the bag."""
        both = (*self.dropped.values(), *self.unwritten.values())
        return sum(d.messages for d in both)

    @property
    def total(self) -> int:
        """Everything that is known to be lost, messages."""
        return self.before.lost + self.here

    def drop(self, message: RawMessage) -> None:
        """Count a message that the queue had no room for."""
        self.dropped.setdefault(message.topic, Dropped()).add(message.t_ns)

    def leave_to_others(self, message: RawMessage) -> None:
        """Count an event packet of another camera than the one that is recorded."""
        self.foreign.setdefault(message.topic, Dropped()).add(message.t_ns)

    def leave_out(self, topic: str, t_ns: int, messages: int = 1) -> None:
        """Count messages that the disk didn't take."""
        self.unwritten.setdefault(topic, Dropped()).add(t_ns, messages)

    def lines(self, start_ns: int) -> list[str]:
        """One line for each kind of loss, for people; seconds count from `start_ns`."""
        out = []
        if self.before.lost:
            out.append(
                f"{self.before.lost} event packets in {self.before.gaps} gaps never came "
                f"(driver or DDS): {self.before.describe(start_ns)}"
            )
        if self.overflows:
            listed = ", ".join(f"{topic} ({n}×)" for topic, n in sorted(self.overflows.items()))
            out.append(f"DDS's queue was full, messages may be missing: {listed}")
        if self.foreign:
            out.append(
                "another camera sent at the same time (stop all but one), not written: "
                + _by_topic(self.foreign, start_ns)
            )
        if self.dropped:
            out.append(
                "the queue was full (the disk is too slow), not written: "
                + _by_topic(self.dropped, start_ns)
            )
        if self.unwritten:
            out.append("not written at the end: " + _by_topic(self.unwritten, start_ns))
        return out

    def notes(self) -> dict[str, str]:
        """The counts, for a bag's metadata."""
        return {
            "event_packets_lost_before_recorder": str(self.before.lost),
            "event_packet_numbers_restarted": str(self.before.restarts),
            "event_packets_of_other_cameras": str(self.foreign_packets),
            "messages_dropped_by_recorder": str(sum(d.messages for d in self.dropped.values())),
            "messages_not_written": str(sum(d.messages for d in self.unwritten.values())),
        }


@dataclass(frozen=True)
class Progress:
    """How a recording goes."""

    #: Written, by topic.
    messages: Mapping[str, int]
    #: Event packets and the events in them, written.
    packets: int
    events: int
    #: Size of the bag.
    bytes_written: int
    #: In the queue.
    waiting_bytes: int
    waiting_messages: int
    #: See `Losses`, and `SeqGaps` for the first two.
    lost_before: int
    seq_restarts: int
    foreign_packets: int
    lost_here: int


def _by_topic(dropped: Mapping[str, Dropped], start_ns: int) -> str:
    return ", ".join(
        f"{d.messages} of {topic} from {(d.first_ns - start_ns) * 1e-9:.3f} "
        f"to {(d.last_ns - start_ns) * 1e-9:.3f} s"
        for topic, d in sorted(dropped.items())
    )

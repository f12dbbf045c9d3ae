"""From a stream of event packets to events in ROS time, with an account of what was lost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from roller_core.codecs.decoder import Payload

from .clock import SensorClock
from .codecs import CodecError, PacketDecoder
from .errors import RollerError
from .events import EventArray
from .outputs import stamp_ns
from .seq_gaps import SeqGaps
from .time_order import TimeOrder


class StreamError(RollerError):
    """A packet that doesn't fit the stream it came in."""


class ImageSizeError(StreamError):
    """A packet of another image size than the camera's."""


@dataclass(slots=True)
class StreamCounts:
    """What a stream held so far."""

    packets: int = 0
    events: int = 0
    lost_packets: int = 0
    seq_restarts: int = 0
    outside_events: int = 0
    late_events: int = 0
    decode_errors: int = 0
    clock_steps: int = 0


class EventStream:
    """Decodes packets in order and stamps their events with ROS time.

    Parameters
    ----------
    width, height : int
        Image size that the camera's calibration is for, px.
    """

    def __init__(self, width: int, height: int) -> None:
        self.width = width
        self.height = height
        self.clock = SensorClock()
        self.counts = StreamCounts()
        self._decoder: PacketDecoder | None = None
        self._gaps = SeqGaps()
        self._order = TimeOrder()
        # Whether numbers began anew since the last events: a packet may hold none.
        self._renumbered = False

    @property
    def newest_ns(self) -> int | None:
        """Time of the newest event, ROS time; None before the first."""
        return self._order.last_ns

    def new_source(self, width: int, height: int) -> None:
        """Another source follows, of an image size in px; the counts go on."""
        self.width, self.height = width, height
        self.clock = SensorClock()
        self._decoder = self._order.last_ns = None
        self._gaps.forget("")

    def skip(self, packets: int) -> None:
        """Packets were left out on purpose: they are not lost."""
        self._gaps.skip("", packets)

    def push_message(self, message: Any) -> EventArray:
        """Decode an event_camera_msgs/EventPacket, of a live graph or of a bag.

        Parameters
        ----------
        message : EventPacket
            The packet, as rclpy or rosbags has it.

        Returns
        -------
        EventArray
            See `push`.

        Raises
        ------
        CodecError
            If it is big-endian or can't be decoded.
        ImageSizeError, TimeBackwardsError
            See `push`.
        """
        if message.is_bigendian and message.encoding != "evt3":  # which is little-endian always
            self.counts.decode_errors += 1
            raise CodecError(
                f"event packet {message.seq} is big-endian; only little-endian ones are read"
            )
        return self.push(
            message.encoding,
            message.width,
            message.height,
            message.seq,
            stamp_ns(message),
            message.time_base,
            message.events,
        )

    def push(
        self,
        encoding: str,
        width: int,
        height: int,
        seq: int,
        stamp_ns: int,
        time_base_ns: int,
        payload: Payload,
    ) -> EventArray:
        """Decode one packet.

        Parameters
        ----------
        encoding, width, height, seq
            The message's fields.
        stamp_ns : int
            The message's `header.stamp`: arrival at the host, ROS time, ns.
        time_base_ns : int
            The message's `time_base`, sensor time, ns.
        payload : bytes-like
            The message's `events`.

        Returns
        -------
        EventArray
            In order of time, ROS time; never before events of earlier packets.

        Raises
        ------
        ImageSizeError
            If the packet is for another image size.
        CodecError
            If it can't be decoded.
        TimeBackwardsError
            If time jumped back by more than a second, or with the packets' numbers; the stream then
            starts anew.
        """
        if (width, height) != (self.width, self.height):
            self.counts.decode_errors += 1
            raise ImageSizeError(
                f"event packets are for {width}×{height} px but the camera is calibrated for "
                f"{self.width}×{self.height} px; use the calibration of this camera"
            )
        try:
            if self._decoder is None or self._decoder.encoding != encoding:
                self._decoder = PacketDecoder(encoding, width, height)
            packet = self._decoder.decode(payload, time_base_ns)
        except CodecError:
            self.counts.decode_errors += 1
            raise
        # One that can't be decoded is missing like one that never came.
        before, late = self._gaps.restarts, self._gaps.late
        self._gaps.see("", seq, stamp_ns)
        self._renumbered |= self._gaps.restarts > before
        late = self._gaps.late - late
        self.counts.lost_packets = self._gaps.lost
        self.counts.seq_restarts = self._gaps.restarts
        events = packet.events if packet.ordered else packet.events.sorted_by_time()
        self.counts.packets += 1
        self.counts.outside_events += packet.outside
        self.counts.events += len(events)
        if not len(events):
            return events
        steps = self.clock.steps
        self.clock.observe(int(events.t_ns[0]), stamp_ns)
        self.counts.clock_steps += self.clock.steps - steps
        times = self.clock.to_ros_ns(events.t_ns)
        renumbered, self._renumbered = self._renumbered, False
        events = self._order.take(events.with_times(times), renumbered, late > 0)
        self.counts.late_events = self._order.late_events
        return events

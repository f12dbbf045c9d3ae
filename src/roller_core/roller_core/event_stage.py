"""A stage that takes events: what nodes `emvs`, `surface` and `braille` have in common."""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from . import outputs
from .camera import Camera, OtherCameraError
from .codecs import ENCODED_ENCODINGS, encode
from .early_packets import EarlyPackets
from .errors import RollerError
from .event_stream import EventStream, StreamCounts
from .events import EventArray
from .frame_settings import StreamSettings
from .outputs import Output, Result, ScanFault, stamp_ns
from .pose_track import PoseTrack
from .result_times import ResultTimes
from .scan_watch import SETTLED_NS, ScanWatch
from .stage import ERROR, OK, WARN, Stage
from .time_order import TimeBackwardsError

#: As many events as a packet of a busy scan has, about.
_USUAL_EVENTS = 5000


class Pipeline(Protocol):
    """What is needed of a pipeline of events."""

    camera: Camera

    @property
    def counts(self) -> Any:
        """What was done and lost so far, a dataclass; `dropped_events`, `events_without_pose`."""

    @property
    def held_events(self) -> int:
        """Events that wait."""

    @property
    def needed_from_ns(self) -> int | None:
        """Poses from before this time are no longer needed."""

    def add_events(self, events: EventArray) -> None:
        """Take events in order of time."""

    def leave_gap(self) -> None:
        """Some events were left out between those before and those after."""

    def miss(self) -> None:
        """Some events never came between those before and those after."""


P = TypeVar("P", bound=Pipeline)
E = TypeVar("E", bound=StreamSettings)


class EventStage(Stage[E], Generic[E, P]):
    """A stage that takes events and drives a pipeline with them."""

    inputs = (outputs.EVENTS, outputs.CAMERA_INFO, outputs.TF, outputs.TF_STATIC)

    def __init__(self, settings: E) -> None:
        super().__init__(settings)
        self.pipeline: P | None = None
        self.stream: EventStream | None = None
        #: Why the camera isn't taken; empty: it is.
        self.refused = ""
        #: Packets left out to keep up.
        self.left_out_packets = 0
        self._early = EarlyPackets(settings.max_waiting_mb * 1e6)
        self._times = ResultTimes()
        self._past: Counter[str] = Counter()
        self._watch = ScanWatch(self.frames)

    def warm_up(self) -> None:
        """Load what decodes packets and maps their times; a stage adds what it needs."""
        at, t = np.zeros(_USUAL_EVENTS), np.arange(_USUAL_EVENTS) * 1000
        for encoding in ENCODED_ENCODINGS:
            stream = EventStream(8, 8)
            for seq, t_ns in enumerate((0, 1_000_000_000)):
                events = EventArray.from_arrays(at, at, t_ns + t, at)
                payload = bytearray(encode(encoding, events, t_ns))
                stream.push(encoding, 8, 8, seq, 1_000_000_000 + t_ns, t_ns, payload)

    def take_camera(self, camera: Camera) -> None:
        """Take the calibration, then the packets that came before it; see `Stage`.

        Raises
        ------
        OtherCameraError
            If the settings are for another camera; nothing is taken until one comes that fits.
        RollerError
            If nothing can be made of it; as above.
        """
        wanted = self.settings.calibrated_camera
        if any(wanted) and not camera.same_intrinsics(wanted):
            self.refuse_camera(
                f"the camera ({camera}) isn't the one that the node's parameters were "
                "calibrated with (calibrated_camera): calibrate again, or leave params:= away"
            )
            raise OtherCameraError(self.refused)
        if self.camera == camera:
            return
        self.refused = ""
        if self.stream is None:
            self.stream = EventStream(camera.width, camera.height)
        else:
            self._finish()
            self.stream.new_source(camera.width, camera.height)
        self.camera = camera
        try:
            self._begin()
        except RollerError as error:
            self.refuse_camera(str(error))
            self.camera = camera  # the same again says nothing new
            raise
        for packet in self._early.take_all():
            try:
                if packet is None:
                    self.new_source()
                else:
                    self.take_packet(packet)
            except RollerError as error:
                self._left.append(Result(None, fault=error))

    def refuse_camera(self, reason: str) -> None:
        """Take nothing until another calibration comes."""
        self.pipeline = self.stream = self.camera = None
        self.refused = reason

    def new_source(self) -> None:
        """Finish what there is: packets of another source follow, poses go on."""
        if self.stream is None:
            self._early.new_source()
            return
        self._finish()
        self.stream.new_source(self.stream.width, self.stream.height)
        self._anew = True
        self._begin()

    def leave_out(self, packets: int) -> None:
        """Some packets are left out, as there is no keeping up with them."""
        self.left_out_packets += packets
        if self.stream is not None:
            self.stream.skip(packets)
        if self.pipeline is not None:
            self.pipeline.leave_gap()

    def too_slow(self) -> tuple[int, str]:
        """What was left out to keep up, so far: a number that grows with it, and in words."""
        out = self.left_out_packets
        return out, f"too slow: {out} packets of events left out"

    def take_packet(self, packet: Any) -> None:
        """Decode an event packet and take its events; see `EventStream.push_message`."""
        if self.stream is None:
            self.left_out_packets += self._early.add(packet)
            return
        lost = self.stream.counts.lost_packets
        try:
            events = self.stream.push_message(packet)
        except TimeBackwardsError as error:
            self.restart()
            self.take_events(error.events)
            raise
        lost = self.stream.counts.lost_packets - lost
        if self.pipeline is not None and lost > 0:
            self.pipeline.miss()
        self._watch.take_packet(stamp_ns(packet), lost)
        self.take_events(events)

    def take_events(self, events: EventArray) -> None:
        """Take decoded events in order of time, ROS time; the camera must have come."""
        if self.pipeline is not None and len(events):
            self._watch.take_events(int(events.t_ns[-1]))
            self.pipeline.add_events(events)

    def health(self) -> tuple[int, str]:
        """See `Stage`."""
        if self.refused:
            return ERROR, self.refused
        if self.pipeline is None:
            return WARN, f"waiting for {outputs.CAMERA_INFO}"
        if missing := self.frames.missing():
            return WARN, missing
        ended = self._poses_ended()
        return (ERROR, ended) if ended else (OK, "")

    @property
    def poses_behind_ns(self) -> int:
        """By how much the newest event is newer than the newest pose, ns; 0: it isn't."""
        rest, newest = self.frames.rest_ns, self.stream.newest_ns if self.stream else None
        return 0 if rest is None or newest is None else max(newest - rest[1], 0)

    def _poses_ended(self) -> str:
        """What to report of events that wait for poses that don't come any more; or nothing."""
        return self._watch.poses_ended(self.poses_behind_ns) if self.waits_for_poses else ""

    @property
    def waits_for_poses(self) -> bool:
        """See `Stage`."""
        return self.pipeline is not None and self.pipeline.held_events > 0

    @property
    def settled(self) -> bool:
        """Whether the robot is at rest, and events of after that have come."""
        rest, newest = self.frames.rest_ns, self.stream.newest_ns if self.stream else None
        if rest is None or newest is None:
            return False
        since, until = rest
        return min(until, newest) >= since + SETTLED_NS

    @property
    def lost(self) -> bool:
        """Whether packets or events were lost, or came so late that they were left out."""
        late = self.stream.counts.late_events if self.stream is not None else 0
        return bool(self.lost_packets or late or self.totals().get("dropped_events"))

    @property
    def lost_packets(self) -> int:
        """Packets that never came."""
        return self.stream.counts.lost_packets if self.stream is not None else 0

    def rated(self) -> Mapping[str, float]:
        """See `Stage`."""
        stream = self.stream.counts if self.stream is not None else StreamCounts()
        return {
            "event_rate_per_s": stream.events,
            "packet_rate_hz": stream.packets,
            "pose_rate_hz": self.frames.counts.poses,
        }

    def counts(self) -> Mapping[str, object]:
        """See `Stage`."""
        stream = self.stream.counts if self.stream is not None else StreamCounts()
        found: dict[str, object] = {
            "events": stream.events,
            "packets": stream.packets,
            "lost_packets": stream.lost_packets,
            "seq_restarts": stream.seq_restarts,
            "left_out_packets": self.left_out_packets,
            "decode_errors": stream.decode_errors,
            "late_events": stream.late_events,
            "events_outside_image": stream.outside_events,
        }
        if self.pipeline is not None:
            totals = self.totals()
            found |= {
                "dropped_events": totals["dropped_events"],
                "events_without_pose": totals["events_without_pose"],
                "waiting_events": self.pipeline.held_events,
                **self._pipeline_counts(self.pipeline, totals),
            }
        return found

    def totals(self) -> dict[str, int]:
        """What the pipeline counted, with those before a restart."""
        current = Counter(asdict(self.pipeline.counts)) if self.pipeline is not None else Counter()
        return {name: n + self._past[name] for name, n in current.items()}

    @abstractmethod
    def _make(self, camera: Camera, track: PoseTrack) -> P:
        """A pipeline that begins."""

    @abstractmethod
    def _pipeline_results(self, pipeline: P, flush: bool) -> Iterator[Result]: ...

    @abstractmethod
    def _pipeline_counts(self, pipeline: P, totals: Mapping[str, int]) -> Mapping[str, object]:
        """What the status says of the pipeline, of its totals and of its state."""

    def _begin(self) -> None:
        if self.pipeline is not None:
            self._past.update(asdict(self.pipeline.counts))
        if self.camera is not None:
            self.pipeline = self._make(self.camera, self.frames.track)

    def _results(self, flush: bool) -> Iterator[Result]:
        if self.pipeline is None:
            return
        if flush:
            self._watch.end(self._poses_ended())
        for t_ns, text in self._watch.take_reports():
            if outputs.CONTACT in self.outputs:  # where the surface is worked out
                fault = Output(outputs.CONTACT, t_ns, "", ScanFault(text, "data"))
                yield Result(None, (fault,), text)
        yield from self._pipeline_results(self.pipeline, flush)
        needed = self.pipeline.needed_from_ns
        if needed is not None and len(self.frames.track):
            self.frames.track.discard_before(needed)

    def _came(self, t_ns: int, milliseconds: float | None = None) -> None:
        """Note a result of a time, and how long it took where that is known."""
        self._times.came(t_ns, self.clock_ns(), milliseconds)

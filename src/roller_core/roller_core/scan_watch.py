"""What keeps a scan from being whole: packets that are lost, poses or events that end early."""

from __future__ import annotations

from typing import NamedTuple

from . import outputs
from .passes import travel_since
from .sensor_pose import SensorFrames
from .seq_gaps import MOST_MISSING

#: Poses and events from so long after the robot came to rest say that its scan is over, ns: the
#: clocks of both agree by far less.
SETTLED_NS = 50_000_000
#: Events so much newer than the newest pose show that poses don't come any more, ns.
_NO_POSES_NS = 500_000_000
#: A camera that gives not one event over so much of the way, m, in so long, ns, is gone: pixels are
#: never all quiet.
_NO_EVENTS_M, _NO_EVENTS_NS = 0.01, 100_000_000
#: Packets from which on the share of lost ones is reported at once; of fewer at their end.
_LEAST_PACKETS = 200


class ScanReport(NamedTuple):
    """What a scan lacks."""

    #: Since when, ROS time, ns.
    t_ns: int
    #: What, for people.
    text: str


class ScanWatch:
    """Watches a scan for data that don't come, and reports each lack once.

    Parameters
    ----------
    frames : SensorFrames
        Poses of the sensor; who has them goes on adding to them.
    """

    def __init__(self, frames: SensorFrames) -> None:
        self._frames = frames
        self._losses = LossShare()
        self._reports: list[ScanReport] = []
        # Of the events, and of those after which it was reported that none came.
        self._last_event_ns = self._ended_ns = 0

    def take_packet(self, stamp_ns: int, lost: int) -> None:
        """Take a packet's arrival, ns, and how many are missing before it."""
        self._add(self._losses.see(stamp_ns, lost))

    def take_events(self, newest_ns: int) -> None:
        """Take the time of the newest event, ROS time, ns."""
        self._last_event_ns = newest_ns

    def end(self, poses_ended: str) -> None:
        """No more comes for now; `poses_ended` as of that method."""
        self._add(self._losses.end())
        self._add(self._events_ended())
        if poses_ended and (rest := self._frames.rest_ns):
            # Of a robot that stands after its scan nobody misses poses.
            moved = rest[1] - rest[0] < SETTLED_NS
            self._add(ScanReport(rest[1], poses_ended) if moved else None)

    def take_reports(self) -> list[ScanReport]:
        """What there is to report since the last time."""
        found, self._reports = self._reports, []
        return found

    def poses_ended(self, behind_ns: int) -> str:
        """What to report of events so much newer than the newest pose, ns; empty: nothing."""
        if behind_ns < _NO_POSES_NS:
            return ""
        return (
            f"poses {self._frames.base} -> {self._frames.moving} are missing: the newest is "
            f"{behind_ns * 1e-9:.1f} s older than the newest event"
        )

    def _events_ended(self) -> ScanReport | None:
        """A way that the sensor went on without any events."""
        newest, track = self._last_event_ns, self._frames.track
        if not len(track) or newest in (0, self._ended_ns):
            return None
        gone_m = travel_since(track, newest)
        if gone_m < _NO_EVENTS_M or track.end_ns < newest + _NO_EVENTS_NS:
            return None
        self._ended_ns = newest
        return ScanReport(
            newest,
            f"{outputs.EVENTS_ENDED} over the last {gone_m * 1e3:.0f} mm of the way: the camera, "
            "or its recording, ended before the scan",
        )

    def _add(self, report: ScanReport | None) -> None:
        if report is not None:
            self._reports.append(report)


class LossShare:
    """Reports once a scan when too many of its packets are missing."""

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self._came = self._missing = self._last_ns = 0
        self._reported = False

    def see(self, t_ns: int, missing: int) -> ScanReport | None:
        """Take a packet's arrival, ns, and how many are missing before it."""
        self._came += 1
        self._missing += missing
        self._last_ns = t_ns if missing else self._last_ns
        return self._report() if missing and self._came >= _LEAST_PACKETS else None

    def end(self) -> ScanReport | None:
        """The scan is over; see `see`."""
        report = self._report()
        self._begin()
        return report

    def _report(self) -> ScanReport | None:
        every = self._came + self._missing
        if self._reported or self._missing <= MOST_MISSING * every:
            return None
        self._reported = True
        share = f"{self._missing / every:.0%} of the event packets were lost"
        return ScanReport(self._last_ns, f"{share}: {self._missing} of {every}")

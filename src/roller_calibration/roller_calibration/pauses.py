"""A robot's pauses within a pass, taken out of the recording: the pass goes on after them.

A live node can't know that it will, and ends the pass: what was in view then is seen by a part of
its events, before and again after. Whoever has the whole recording need not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from roller_core.events import EventArray
from roller_core.passes import REST_M, STANDSTILL_S
from roller_core.pose_track import PoseTrack

from .recordings import Scan

#: What stays of a pause at each end, s: events come late, and pixels are blind for a while.
_STAYS_S = 0.05


def without_pauses(scan: Scan) -> Scan:
    """A scan without the times in which the robot stood for so long that a pass would end.

    Events of them are noise; what follows moves up, poses and events alike. Before the first motion
    and after the last one nothing changes.
    """
    times, places = scan.track.times_ns, scan.track.positions
    keep, late_ns = np.ones(len(times), np.bool_), np.zeros(len(times), np.int64)
    events = scan.events
    parts, from_ns, gone_ns = [], int(events.t_ns[0]) if len(events) else 0, 0
    for first, last in _pauses(scan.track):
        begin_ns, end_ns = int(times[first]), int(times[last])
        parts.append(_between(events, from_ns, begin_ns, gone_ns))
        from_ns, gone_ns = end_ns, gone_ns + end_ns - begin_ns
        keep[first + 1 : last + 1] = False
        late_ns[last:] = gone_ns
    if not gone_ns:
        return scan
    parts.append(_between(events, from_ns, int(events.t_ns[-1]) + 1, gone_ns))
    track = PoseTrack(scan.track.max_gap_s)
    track.extend((times - late_ns)[keep], places[keep], scan.track.quaternions[keep])
    return replace(scan, events=EventArray.concatenate(parts), track=track)


def _between(events: EventArray, begin_ns: int, end_ns: int, earlier_ns: int) -> EventArray:
    """Events of a time, moved up."""
    a, b = np.searchsorted(events.t_ns, [begin_ns, end_ns])
    part = events[int(a) : int(b)]
    return replace(part, t_ns=part.t_ns - earlier_ns)


def _pauses(track: PoseTrack) -> Iterator[tuple[int, int]]:
    """Numbers of the first and last pose of what is to go, for each pause."""
    times, places = track.times_ns, track.positions
    stays_ns = round(_STAYS_S * 1e9)
    ahead = np.searchsorted(times, times + round(STANDSTILL_S * 1e9))
    k = 0
    while k < len(times) and ahead[k] < len(times):
        away = np.linalg.norm(places[k : ahead[k] + 1] - places[k], axis=1)
        if (away >= REST_M).any():
            k += 1 if away[-1] < REST_M else int(np.argmax(away >= REST_M))
            continue
        end = int(ahead[k])
        while end + 1 < len(times) and np.linalg.norm(places[end + 1] - places[k]) < REST_M:
            end += 1
        first = int(np.searchsorted(times, times[k] + stays_ns))
        last = int(np.searchsorted(times, times[end] - stays_ns, side="right")) - 1
        if k > 0 and end + 1 < len(times) and first < last:
            yield first, last
        k = end + 1

"""Whether the skin sticks to the surface, piece by piece of travel."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numba import njit

from roller_core.camera import Camera
from roller_core.event_queue import EventCutter
from roller_core.events import EventArray
from roller_core.pose_track import PoseError, PoseTrack

from .image_speed import ImageSpeed

#: Travel of the sensor that is judged at once, m, and the longest that it may take, ns.
_PIECE_M, _LONGEST_NS = 0.010, 2_000_000_000
#: Travel from which on a piece that isn't whole is judged with a window that ends in it, m.
_REST_M = 0.004
_FORGOTTEN_NS = 5 * _LONGEST_NS
#: One event of so many is looked at.
_OF = 8
_MOST_WAITING = 1_000_000
#: Below this share the image stands.
_STANDS = 0.2
#: Cells in which contact is seen, px; of a skin with texture, this share of them is never empty. On
#: a plain one relief that fills the view leaves events in up to 0.7 of them.
_CELL_PX, _TEXTURED = 16, 0.8


@dataclass(frozen=True)
class ContactState:
    """What was seen of the contact over the newest piece of travel."""

    #: Of the image, as a share of what the poses say; None where too little was seen.
    image_speed: float | None = None
    #: Rectangle in which the skin was seen to move.
    area_m2: float = 0.0
    #: Share of it with events, 0–1.
    fill: float = 0.0
    #: Share of the whole image with events.
    cells: float = 0.0
    #: What is wrong; empty: nothing that can be seen.
    fault: str = ""


class ContactWatch(EventCutter):
    """Judges the contact piece by piece of travel, by events and poses alone.

    A piece of which events are missing isn't judged: it would look like a skin that stands still.

    Parameters
    ----------
    camera : Camera
        Calibration.
    track : PoseTrack
        Camera in base; grows meanwhile.
    depth_min_m, depth_max_m : float
        Between which depths the surface lies, metres.
    """

    def __init__(
        self, camera: Camera, track: PoseTrack, depth_min_m: float, depth_max_m: float
    ) -> None:
        super().__init__(_MOST_WAITING, track)
        self.state = ContactState()
        self._camera, self._depth_m = camera, 0.5 * (depth_min_m + depth_max_m)
        self._speed = ImageSpeed(camera, track, depth_min_m, depth_max_m)
        self._seen = 0
        self._from_ns: int | None = None
        self._bad: deque[tuple[int, int, str]] = deque()
        #: Of the piece that has begun: its start, its events so far and what was wrong with it.
        self._begun: tuple[int, int, str] | None = None
        self._active: deque[float] = deque(maxlen=20)

    @property
    def needed_from_ns(self) -> int | None:
        """Poses from before this time are no longer needed; None while it isn't known."""
        return self._from_ns

    def add(self, events: EventArray) -> None:
        """Take events in order of time."""
        first = -self._seen % _OF
        self._seen += len(events)
        part = events[first::_OF]
        # Copies, as views would keep all events.
        copies = part.x.copy(), part.y.copy(), part.t_ns.copy(), part.p.copy()
        super().add(EventArray(*copies))
        if self._from_ns is not None and self._queue.newest_ns - self._from_ns > _FORGOTTEN_NS:
            self._skip(self._queue.newest_ns - _LONGEST_NS)  # nobody asks: the sensor stands

    def fault(self, start_ns: int, end_ns: int) -> str:
        """What is wrong with the contact in a span; the spans asked for go on in time.

        Returns
        -------
        str
            Empty where nothing was seen to be wrong.
        """
        self._judge(end_ns)
        while self._bad and self._bad[0][1] <= start_ns:
            self._bad.popleft()
        found = next((fault for a, _, fault in self._bad if a < end_ns), "")
        return found or self._rest(end_ns)

    def _rest(self, until_ns: int) -> str:
        """What is wrong with a piece that has hardly begun, as far as it goes."""
        start_ns = self._from_ns
        if start_ns is None or self._end(start_ns, until_ns, _REST_M) is None:
            return ""
        if self._in_gap(start_ns, until_ns):
            return ""
        before = self._queue.count_before(start_ns)
        events = self._queue.first(self._queue.count_before(until_ns))[before:]
        # The last blocks of a pass ask for the same.
        if self._begun is None or self._begun[:2] != (start_ns, len(events)):
            try:
                fault = self._look(events, start_ns, until_ns).fault
            except PoseError:
                return ""
            self._begun = start_ns, len(events), fault
        return self._begun[2]

    def _judge(self, until_ns: int) -> None:
        """Judge all pieces of travel that are complete at a time."""
        track = self._track
        while len(self._queue) and len(track):
            if self._from_ns is None:
                self._from_ns = max(self._queue.first_ns, track.start_ns)
            start_ns = self._from_ns
            until = min(until_ns, track.end_ns)
            if until <= start_ns:
                return
            end_ns = self._end(start_ns, until)
            if end_ns is None:
                if until - start_ns > _LONGEST_NS:
                    self._skip(until)
                return
            self._queue.drop_before(start_ns)
            events = self._queue.take(self._queue.count_before(end_ns))
            self._from_ns = end_ns
            if self._in_gap(start_ns, end_ns):
                continue
            try:
                self.state = self._look(events, start_ns, end_ns)
            except PoseError:
                continue
            self._active.append(self.state.cells)
            if self.state.fault:
                self._bad.append((start_ns, end_ns, self.state.fault))

    def _skip(self, t_ns: int) -> None:
        self._queue.drop_before(t_ns)
        self._from_ns = t_ns

    def _end(self, start_ns: int, until_ns: int, length_m: float = _PIECE_M) -> int | None:
        """When the sensor has gone a piece's length; None: not yet."""
        times = self._track.times_ns
        begin = max(int(np.searchsorted(times, start_ns, side="right")) - 1, 0)
        end = int(np.searchsorted(times, until_ns, side="right"))
        places = self._track.positions[begin:end]
        if not len(places):
            return None
        far = np.flatnonzero(np.linalg.norm(places - places[0], axis=1) >= length_m)
        return int(times[begin + far[0]]) if len(far) and begin + far[0] else None

    def _look(self, events: EventArray, start_ns: int, end_ns: int) -> ContactState:
        """Judge one piece.

        Raises
        ------
        PoseError
            Where poses are missing.
        """
        if end_ns - start_ns > _LONGEST_NS:
            return ContactState()
        cells, area_m2, fill = self._cells(events)
        usual = float(np.median(self._active)) if self._active else 0.0
        if usual > _TEXTURED and cells < 0.1 * usual:
            return ContactState(
                None, area_m2, fill, cells, "contact lost: the skin is still while the robot rolls"
            )
        share = self._speed.share(events)
        fault = ""
        if share is not None and share < -_STANDS:
            fault = (
                "the image moves against the robot: are the poses, or the hand-eye, inverted, or "
                "quaternions not x, y, z, w?"
            )
        elif share is not None and share < _STANDS:
            fault = (
                "contact lost: the image stands while the robot rolls, or the surface lies far "
                "beyond depth_max_m"
            )
        elif share is not None and not self._speed.rolls(share):
            fault = (
                f"slipping: the image moves at {share:.0%} of the robot's speed, or the surface "
                f"lies at {1e3 * self._depth_m / share:.0f} mm, out of depth_min_m … depth_max_m"
            )
        return ContactState(share, area_m2, fill, cells, fault)

    def _cells(self, events: EventArray) -> tuple[float, float, float]:
        """Share of the image's cells that move, m² of their rectangle, and its share of them."""
        camera = self._camera
        columns, rows = -(-camera.width // _CELL_PX), -(-camera.height // _CELL_PX)
        counts = np.zeros((rows, columns), np.int64)
        _count_cells(events.x, events.y, counts)
        active = counts > max(3.0, 0.15 * counts[counts > 0].mean() if len(events) else 0.0)
        if not active.any():
            return 0.0, 0.0, 0.0
        row, column = np.nonzero(active)
        ends = np.rint(np.array([0.02, 0.98]) * (len(row) - 1)).astype(np.int64)
        (top, bottom), (left, right) = row[ends], np.sort(column)[ends]
        box = (bottom - top + 1) * (right - left + 1)
        filled = active[top : bottom + 1, left : right + 1].sum() / box
        cell_m2 = (_CELL_PX * self._depth_m) ** 2 / (camera.fx * camera.fy)
        return float(active.mean()), float(box * cell_m2), float(filled)


@njit(cache=True, nogil=True)
def _count_cells(x, y, counts):  # type: ignore[no-untyped-def]
    """Count events by the cell of their pixel."""
    for i in range(len(x)):
        counts[y[i] // np.uint16(_CELL_PX), x[i] // np.uint16(_CELL_PX)] += 1

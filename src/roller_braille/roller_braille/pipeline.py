"""The one pipeline from events and poses to Braille cells.

The node, the replay command and the tests all drive this object.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseError, PoseTrack

from .batches import Batch, BatchCutter, PassEnd
from .cells import Cell
from .page import Page
from .pass_reader import PassReader
from .reader_settings import BrailleSettings
from .translation import TextLine
from .warm_up import warm_up
from .warp import PixelTable, Warp

_MOST_TIMES = 100_000


@dataclass(slots=True)
class BrailleCounts:
    """What the reader did so far."""

    #: Batches warped, and those left out because poses were missing.
    batches: int = 0
    refused_batches: int = 0
    #: In the batches warped.
    events: int = 0
    #: Passes over the surface, spots that may be dots.
    passes: int = 0
    dots: int = 0
    #: Cells given, those of them not readable, cells seen again by a later pass, and those of them
    #: that were given once more, as they can be read since.
    cells: int = 0
    unreadable_cells: int = 0
    repeated_cells: int = 0
    reread_cells: int = 0
    #: Events while the sensor didn't roll, events that no pose was there for, and events dropped
    #: because too many waited.
    still_events: int = 0
    events_without_pose: int = 0
    dropped_events: int = 0
    #: Pixels that are left out because they fire on their own.
    hot_pixels: int = 0


class BraillePipeline:
    """Events and poses in, Braille cells out.

    Parameters
    ----------
    settings : BrailleSettings
        Method and its parameters.
    camera : Camera
        Calibration of the camera that the events are from.
    track : PoseTrack
        Camera optical frame in base; the caller goes on adding poses to it.
    """

    def __init__(self, settings: BrailleSettings, camera: Camera, track: PoseTrack) -> None:
        self.settings = settings
        self.camera = camera
        self.track = track
        self._counts = BrailleCounts()
        self._cutter = BatchCutter(settings, track)
        self._warp = Warp(settings, camera, track)
        self._pixels = PixelTable(self._warp.table)
        self._page = Page(settings, self._warp)
        self._reader: PassReader | None = None
        #: The poses' travel by that which the events show, where it was last known; None before.
        self.travel_scale: float | None = None
        warm_up(settings.spacing)
        #: Why the newest batches left out were so.
        self.refusals: deque[str] = deque(maxlen=100)
        #: Time that each of the newest batches took, ms.
        self.milliseconds: deque[float] = deque(maxlen=_MOST_TIMES)

    @property
    def counts(self) -> BrailleCounts:
        """What was done and lost so far."""
        counts, cutter = self._counts, self._cutter
        counts.still_events = cutter.still_events
        counts.events_without_pose = cutter.events_without_pose
        counts.dropped_events = cutter.dropped_events
        counts.hot_pixels = self._pixels.hot_pixels
        counts.repeated_cells, counts.reread_cells = self._page.repeated, self._page.reread
        return counts

    @property
    def held_events(self) -> int:
        """Events that wait for their batch to be complete."""
        return self._cutter.held_events

    @property
    def needed_from_ns(self) -> int | None:
        """Poses from before this time are no longer needed; None while it isn't known."""
        return self._cutter.needed_from_ns

    def add_events(self, events: EventArray) -> None:
        """Take events in order of time, ROS time.

        Raises
        ------
        EventArrayError
            If one is older than the one before it.
        """
        events.check_order()
        self._cutter.add(events.compensate_delay(self.settings.event_delay_s))

    def leave_gap(self) -> None:
        """Some events were left out, as there was no keeping up with them."""
        self._cutter.leave_gap()

    def miss(self) -> None:
        """Some events never came: a batch does without them."""

    def text(self) -> list[str]:
        """Lines of text read so far, in the order in which they lie on the page.

        A cell whose dots are not certain stands there as U+FFFD, one whose dots are certain but
        have no meaning in the code as its Braille pattern.
        """
        return self._page.text()

    def newest_lines(self, most: int) -> Iterator[str]:
        """The lines from the last to the first; of a longer one its last `most` cells."""
        return self._page.newest_lines(most)

    def lines(self) -> list[TextLine]:
        """Cells of the lines read so far, as seen: what `text` was read from."""
        return self._page.lines()

    def results(self, flush: bool = False) -> Iterator[Cell]:
        """Cells that are complete; of a line in reading order, see `line_order`.

        Each comes once, but for one that could not be read, or that hung on such a one: with the
        same line and column it comes again once a later pass reads it.

        Parameters
        ----------
        flush : bool
            No more events will come for now: what is left makes up the last batch, and lines end
            here.
        """
        while (item := self._cutter.cut(flush)) is not None:
            begin = time.perf_counter()
            cells = self._end(item) if isinstance(item, PassEnd) else self._read(item)
            if isinstance(item, Batch):
                self.milliseconds.append((time.perf_counter() - begin) * 1e3)
            for cell in cells:
                self._counts.cells += 1
                self._counts.unreadable_cells += not cell.readable
                yield cell

    def _read(self, batch: Batch) -> list[Cell]:
        if self._reader is None:
            self._reader = PassReader(self.settings, self._warp, batch.roll)
            self._counts.passes += 1
        reader = self._reader
        try:
            self._pixels.add(batch.events)
            reader.add(batch, self._pixels.table)
        except PoseError as error:
            self._counts.refused_batches += 1
            self.refusals.append(str(error))
            return []
        self._counts.batches += 1
        self._counts.events += len(batch.events)
        before = reader.dots
        reader.advance()
        if self.settings.max_scale_error and reader.travel.scale is not None:
            self.travel_scale = reader.travel.scale
        self._counts.dots += reader.dots - before
        return list(self._page.collect(reader, over=False))

    def _end(self, _: PassEnd) -> list[Cell]:
        reader, self._reader = self._reader, None
        if reader is None:
            return []
        before = reader.dots
        reader.advance(final=True)
        self._counts.dots += reader.dots - before
        return list(self._page.collect(reader, over=True))

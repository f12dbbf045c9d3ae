"""What node `braille` does: event packets and poses in, Braille cells and text out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain

from roller_core import outputs
from roller_core.camera import Camera
from roller_core.event_stage import EventStage
from roller_core.frame_settings import StreamSettings, smoothing_field
from roller_core.outputs import Output, Result
from roller_core.pose_track import PoseTrack
from roller_core.result_times import figures_of

from .cells import Cell
from .page import newest_text
from .pipeline import BraillePipeline
from .reader_settings import POSE_SMOOTHING, BrailleSettings, Spacing
from .translation import TextLine
from .warm_up import warm_up

#: Characters that the topic of the text holds at most, two pages of Braille: it comes with each
#: cell, and who is late gets the last hundred.
_MOST_TEXT = 2000
#: Newest cells whose markers are known again: of what RViz is given it shows no more.
_MOST_MARKERS = 20_000
#: Lines that are kept of scans before.
_MOST_EARLIER = 10_000


class BrailleParameters(BrailleSettings, StreamSettings):
    """Parameters of the node: the reader's settings and the stage's."""

    pose_smoothing: int = smoothing_field(POSE_SMOOTHING)


@dataclass(frozen=True)
class CellMarkers:
    """A cell to be shown."""

    #: What was read.
    cell: Cell
    #: Identity of the markers: one for each line and column.
    number: int
    #: Sizes of dots and letters.
    spacing: Spacing
    #: Whether it was shown before, and is read otherwise now.
    again: bool = False


@dataclass(frozen=True)
class NoMarkers:
    """All cells that were shown are to go: they are of an earlier scan."""


class BrailleStage(EventStage[BrailleParameters, BraillePipeline]):
    """Gives the cells of `BraillePipeline`, with each the text so far and its markers.

    Text that was read before the source started again stays, until it is cleared; its markers go.
    """

    node, part = "braille", "text"
    model = BrailleParameters
    outputs = (outputs.BRAILLE_CELLS, outputs.BRAILLE_TEXT, outputs.BRAILLE_MARKERS)

    def __init__(self, settings: BrailleParameters) -> None:
        super().__init__(settings)
        self._earlier: list[str] = []
        self._earlier_lines: list[TextLine] = []
        self._cells = 0
        # Of cells by line and column the numbers of their markers.
        self._markers: dict[tuple[int, int], int] = {}
        self._last_ns: int | None = None  # of the newest cell that is shown

    def warm_up(self) -> None:
        """Load the kernels."""
        super().warm_up()
        warm_up(self.settings.spacing)

    def services(self) -> Mapping[str, Callable[[], str]]:
        """See `Stage`."""
        return {"clear": self.clear}

    def clear(self) -> str:
        """Begin a new scan and forget the text."""
        t_ns = self._last_ns
        said = super().clear()
        self._earlier, self._earlier_lines = [], []
        self._left.append(self._give(outputs.BRAILLE_TEXT, t_ns or 0, ""))
        return said

    def text(self) -> list[str]:
        """Lines of text read so far."""
        return self._earlier + (self.pipeline.text() if self.pipeline is not None else [])

    def newest_text(self) -> str:
        """The end of the text."""
        now = self.pipeline.newest_lines(_MOST_TEXT) if self.pipeline is not None else ()
        return newest_text(chain(now, reversed(self._earlier)), _MOST_TEXT)

    def lines(self) -> list[TextLine]:
        """Cells of the lines read so far."""
        now = self.pipeline.lines() if self.pipeline is not None else []
        before = len(self._earlier)
        return self._earlier_lines + [TextLine(line, before + line.number) for line in now]

    def _begin(self) -> None:
        super()._begin()
        self._markers.clear()
        if self._last_ns is not None:
            self._left.append(self._give(outputs.BRAILLE_MARKERS, self._last_ns, NoMarkers()))
            self._last_ns = None

    def _give(self, topic: str, t_ns: int, data: object) -> Result:
        return Result(None, (Output(topic, t_ns, self.settings.base_frame, data),))

    def _make(self, camera: Camera, track: PoseTrack) -> BraillePipeline:
        self._earlier, self._earlier_lines = self.text(), self.lines()
        if (many := len(self._earlier) - _MOST_EARLIER) > 0:  # numbers of lines stay
            self._earlier[:many] = many * [""]
            self._earlier_lines[:many] = [
                TextLine((), n.number) for n in self._earlier_lines[:many]
            ]
        return BraillePipeline(self.settings, camera, track)

    def _pipeline_results(self, pipeline: BraillePipeline, flush: bool) -> Iterator[Result]:
        for found in pipeline.results(flush):
            cell = replace(found, line=found.line + len(self._earlier))
            self._came(cell.stamp_ns)
            yield Result(cell, self._cell_outputs(cell))
        for reason in pipeline.refusals:
            yield Result(None, notice=reason)
        pipeline.refusals.clear()

    def _cell_outputs(self, cell: Cell) -> tuple[Output, ...]:
        self._cells += 1
        place = cell.line, cell.column
        again = place in self._markers
        number = self._markers.setdefault(place, self._cells)
        if len(self._markers) > _MOST_MARKERS:
            del self._markers[next(iter(self._markers))]
        markers = CellMarkers(cell, number, self.settings.spacing, again)
        data = (cell, self.newest_text(), markers)
        t, frame = cell.stamp_ns, self.settings.base_frame
        self._last_ns = t
        return tuple(Output(n, t, frame, d) for n, d in zip(self.outputs, data, strict=True))

    def _pipeline_counts(
        self, pipeline: BraillePipeline, totals: Mapping[str, int]
    ) -> Mapping[str, object]:
        scale = pipeline.travel_scale
        return {
            "still_events": totals["still_events"],
            "batches": totals["batches"],
            "refused_batches": totals["refused_batches"],
            **figures_of("batch", list(pipeline.milliseconds)[-1000:]),
            "cells": totals["cells"],
            "unreadable_cells": totals["unreadable_cells"],
            "repeated_cells": totals["repeated_cells"],
            "reread_cells": totals["reread_cells"],
            "cell_latency_s": self._times.latency_s,
            "travel_scale": "" if scale is None else round(scale, 4),
        }

"""A recording through the pipeline, offline: no DDS, as fast as it goes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from roller_braille.cells import Cell
from roller_core.errors import RollerError, UnwritableOutputError
from roller_core.output_folder import release_reserve
from roller_emvs.depth_map import DepthMap
from roller_emvs.methods.surface import SurfacePatch
from roller_emvs.windows import RefusedWindow
from roller_inspect.results.result_writer import ResultWriter
from roller_inspect.results.run_report import Report
from roller_inspect.results.truth_tally import SurfaceTally, TruthTally
from roller_recording.reading import Recording, RecordingError

from .pipeline import DepthResult, Inspection, InspectionSettings


def replay(
    recording: Recording,
    settings: InspectionSettings,
    output: Path,
    source: Path,
    braille: bool = True,
    progress: Callable[[float], None] | None = None,
) -> Report:
    """Process a recording and write all results.

    Whatever goes wrong in the middle, results from before it are written.

    Parameters
    ----------
    recording : Recording
        Opened input.
    settings : InspectionSettings
        Of all parts.
    output : path
        Folder for the results.
    source : path
        What the recording was opened from, for the report and to find its truth.
    braille : bool
        Whether to read Braille.
    progress : callable, optional
        Told the share done, 0–1.

    Returns
    -------
    Report
        Written to `report.json` too; its `faults` are empty if all was well.

    Raises
    ------
    UnwritableOutputError
        If no results can be written; a disk that gets full is a fault in the report.
    """
    writer = ResultWriter(
        output,
        recording.camera,
        recording.sensor_frame,
        recording.base_frame,
        settings.braille.spacing,
    )
    report = Report(
        str(source),
        settings.depth.method,
        {
            "emvs": settings.depth.model_dump(),
            "stitcher": settings.stitcher.model_dump(),
            "braille": settings.braille.model_dump(),
            "surface": settings.surface.model_dump(),
        },
    )
    inspection = Inspection(settings, recording.camera, recording.track, braille)
    surface = settings.depth.method == "surface"
    delay_s = (settings.surface if surface else settings.depth).event_delay_s
    tally = (SurfaceTally if surface else TruthTally).beside(source, delay_s)
    run = _Run(inspection, writer, report, tally)
    begin, full = time.perf_counter(), False
    try:
        for step in recording.steps():
            for fault in step.faults:
                report.add_fault(fault)
            if len(step.events):
                run.take_span(int(step.events.t_ns[0]), int(step.events.t_ns[-1]))
                inspection.add_events(step.events)
                run.collect_what_goes()
            if progress is not None:
                progress(step.progress)
        run.collect_what_goes(flush=True)
        run.compare_clocks(recording, source)
    except UnwritableOutputError as error:
        report.add_fault(error)
        full = True
    finally:
        run.finish(recording, time.perf_counter() - begin, full)
    return report


class _Run:
    """Takes results where they belong."""

    def __init__(
        self,
        inspection: Inspection,
        writer: ResultWriter,
        report: Report,
        tally: TruthTally | SurfaceTally | None,
    ) -> None:
        self._inspection = inspection
        self._writer = writer
        self._report = report
        self._tally = tally
        self._cells = 0
        self._truth_s = 0.0
        self._first_ns: int | None = None
        self._last_ns = 0

    def take_span(self, first_ns: int, last_ns: int) -> None:
        if self._first_ns is None:
            self._first_ns = first_ns
        self._last_ns = last_ns

    def compare_clocks(self, recording: Recording, source: Path) -> None:
        """Report poses that none of the events falls into."""
        track = recording.track
        if self._first_ns is None or not len(track):
            return
        if self._last_ns < track.start_ns or self._first_ns > track.end_ns:
            self._report.add_fault(
                RecordingError(
                    f"{source}: no event lies within the poses: events from "
                    f"{self._first_ns * 1e-9:.3f} to {self._last_ns * 1e-9:.3f} s, poses from "
                    f"{track.start_ns * 1e-9:.3f} to {track.end_ns * 1e-9:.3f} s; "
                    "are they in the same clock?"
                )
            )

    def collect_what_goes(self, flush: bool = False) -> None:
        """Collect; a part that fails is reported and doesn't stop the others."""
        try:
            self.collect(flush)
        except UnwritableOutputError:
            raise
        except RollerError as error:
            self._report.add_fault(error)

    def collect(self, flush: bool = False) -> None:
        for found in self._inspection.results(flush):
            if isinstance(found, RefusedWindow):
                self._report.add_window(found)
                if found.fault is not None:
                    self._report.add_fault(found.fault)
            elif isinstance(found, SurfacePatch):
                self._report.add_window(found)
                self._writer.write_rows(found)
                self._compare(found)
            elif isinstance(found, DepthResult):
                self._report.add_window(found.depth_map)
                self._writer.write_mapped(found)
                self._compare(found.depth_map)
            else:
                assert isinstance(found, Cell)
                self._cells += 1
                self._writer.write_cell(found, self._lines())

    def finish(self, recording: Recording, spent_s: float, full: bool) -> None:
        """Write what is left and the account of all; a full disk takes only the latter."""
        try:
            if not full:
                self._writer.write_patch(self._inspection.finish())
        except UnwritableOutputError as error:
            self._report.add_fault(error)
        release_reserve(self._writer.folder)
        braille = self._inspection.braille
        code = self._inspection.settings.braille.code
        self._writer.close(braille.lines() if braille is not None else [], code)
        lines = self._lines()
        duration_s = (self._last_ns - (self._first_ns or 0)) * 1e-9
        spent_s -= self._truth_s
        stitcher = self._inspection.stitcher
        self._report.totals = {
            **asdict(recording.counts),
            **{f"depth_{k}": v for k, v in asdict(self._inspection.depth.counts).items()},
            "surface_points": self._writer.surface_points,
            "icp_tried": stitcher.icp_tried,
            "icp_accepted": stitcher.icp_accepted,
            "braille_cells": self._cells,
            "braille_text": lines,
            "recording_s": round(duration_s, 6),
            "processing_s": round(spent_s, 3),
            "times_faster_than_recorded": round(duration_s / spent_s, 3) if spent_s > 0 else None,
        }
        if self._tally is not None:
            self._report.truth = self._tally.summary()
        self._report.write(self._writer.folder / "report.json")

    def _lines(self) -> list[str]:
        braille = self._inspection.braille
        return braille.text() if braille is not None else []

    def _compare(self, found: DepthMap | SurfacePatch) -> None:
        if self._tally is None:
            return
        begin = time.perf_counter()
        self._tally.add(found)  # type: ignore[arg-type]  # the tally fits the method
        # The comparison is no part of the processing that is timed.
        self._truth_s += time.perf_counter() - begin

"""A recording through the pipeline, offline: no DDS, as fast as it goes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from roller_core.errors import RollerError, UnwritableOutputError
from roller_core.output_folder import release_reserve
from roller_core.outputs import Result
from roller_core.transforms import quaternion_to_matrix
from roller_emvs.depth_map import DepthMap
from roller_emvs.methods.surface import SurfacePatch
from roller_emvs.windows import RefusedWindow
from roller_recording.reading import Recording, RecordingError
from roller_recording.reading.base import MissingTopicError

from .pipeline import Pipeline, PipelineSettings
from .results.result_writer import ResultWriter
from .results.run_report import Report
from .results.truth_tally import SurfaceTally, TruthTally

if TYPE_CHECKING:  # what inspects loads scipy
    from .inspect_stage import InspectStage

#: Share of the events that may come before the first pose or after the last: the robot stands then.
_MOST_LOST = 0.05
#: Part of a camera's axis along base's z from which on it looks up.
_LOOKS_UP = 0.02


def replay(
    recording: Recording,
    settings: PipelineSettings,
    output: Path,
    source: Path,
    braille: bool = True,
    progress: Callable[[float], None] | None = None,
    inspect: InspectStage | None = None,
    take: Callable[[Result], None] = lambda result: None,
) -> Report:
    """Process a recording and write all results.

    Whatever goes wrong in the middle, results from before it are written.

    Parameters
    ----------
    recording : Recording
        Opened input.
    settings : PipelineSettings
        Of all parts.
    output : path
        Folder for the results.
    source : path
        What the recording was opened from, for the report and to find its truth.
    braille : bool
        Whether to read Braille.
    progress : callable, optional
        Takes the share done, 0–1.
    inspect : InspectStage, optional
        Inspects the surface in the same run.
    take : callable, optional
        Takes every result too.

    Returns
    -------
    Report
        Written to `report.json` too; its `faults` are empty if all was well.

    Raises
    ------
    UnwritableOutputError
        If no results can be written; a disk that gets full is a fault in the report.
    """
    if inspect is not None:
        settings = settings.for_inspection()
    surface = settings.sweeps
    report = Report(
        str(source),
        settings.depth.method,
        {
            "emvs": settings.depth.model_dump(),
            "stitcher": settings.stitcher.model_dump(),
            "braille": settings.braille.model_dump(),
            "surface": settings.surface.model_dump(),
        },
        edge_drift=str(settings.surface.edge_drift) if surface else settings.depth.drift_text,
    )
    pipeline = Pipeline(
        settings, recording.camera, recording.poses, braille, report.add_fault, inspect
    )
    writer = ResultWriter(output, pipeline.depth.settings.base_frame)
    delay_s = (settings.surface if surface else settings.depth).event_delay_s
    tally = (SurfaceTally if surface else TruthTally).beside(source, delay_s)
    run = _Run(pipeline, writer, report, tally, take)
    begin, full = time.perf_counter(), False
    try:
        for step in recording.items():
            for fault in step.faults:
                report.add_fault(fault)
            for transform in step.transforms:
                pipeline.take_transform(transform)
            if step.force is not None:
                pipeline.take_force(*step.force)
            if step.restart:
                pipeline.restart()
                run.restarted = True
            if len(step.events):
                run.take_span(int(step.events.t_ns[0]), int(step.events.t_ns[-1]))
                pipeline.add_events(step.events, step.renumbered)
                run.collect_what_goes()
            if progress is not None:
                progress(step.progress)
        run.collect_what_goes(flush=True)
        run.check_poses(recording, source)
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
        pipeline: Pipeline,
        writer: ResultWriter,
        report: Report,
        tally: TruthTally | SurfaceTally | None,
        take: Callable[[Result], None],
    ) -> None:
        self._pipeline = pipeline
        self._writer = writer
        self._report = report
        self._tally = tally
        self._also = take
        self._truth_s = 0.0
        #: Whether time ran backwards, which is a fault of its own.
        self.restarted = False
        self._first_ns: int | None = None
        self._last_ns = 0

    def take_span(self, first_ns: int, last_ns: int) -> None:
        if self._first_ns is None:
            self._first_ns = first_ns
        self._first_ns = min(self._first_ns, first_ns)
        self._last_ns = max(self._last_ns, last_ns)

    def check_poses(self, recording: Recording, source: Path) -> None:
        """Report poses that are missing, that none of the events falls into, or maps without."""
        missing = {stage.frames.missing(): None for stage in self._pipeline.stages}
        for line in filter(None, missing):
            self._report.add_fault(MissingTopicError(f"{recording.source}: {line}"))
        stitcher = self._pipeline.stitcher
        if stitcher is not None and stitcher.left_out:
            self._report.add_fault(
                RecordingError(f"{source}: {stitcher.left_out} depth maps left out: no pose")
            )
        given = recording.poses is not None  # on /tf base is the robot's, which stands upright
        if self._pipeline.inspect is not None and given and self._looks_up():
            self._report.add_fault(
                RecordingError(
                    f"{source}: by its poses the camera looks up, along +z of "
                    f"{self._pipeline.depth.frames.base}: dents would pass for rises, as heights "
                    "count from the surface to the camera; turn the poses' frame over"
                )
            )
        span = self._pipeline.depth.frames.span_ns
        if self._first_ns is None or span is None or self.restarted:
            return
        if self._last_ns < span[0] or self._first_ns > span[1]:
            self._report.add_fault(
                RecordingError(
                    f"{source}: no event lies within the poses: events from "
                    f"{self._first_ns * 1e-9:.3f} to {self._last_ns * 1e-9:.3f} s, poses from "
                    f"{span[0] * 1e-9:.3f} to {span[1] * 1e-9:.3f} s; "
                    "are they in the same clock?"
                )
            )
            return
        apart_s = max(span[0] - self._first_ns, self._last_ns - span[1]) * 1e-9
        events, lost = recording.counts.events, self._pipeline.depth.totals()["events_without_pose"]
        if apart_s > self._pipeline.settings.max_pose_gap_s and lost > _MOST_LOST * events:
            self._report.add_fault(
                RecordingError(
                    f"{source}: {lost / events:.0%} of the events have no pose: events from "
                    f"{self._first_ns * 1e-9:.3f} to {self._last_ns * 1e-9:.3f} s, poses from "
                    f"{span[0] * 1e-9:.3f} to {span[1] * 1e-9:.3f} s"
                )
            )

    def _looks_up(self) -> bool:
        """Whether the camera looks at the surface from below."""
        turns = self._pipeline.depth.frames.track.quaternions
        if not len(turns):
            return False
        axis = quaternion_to_matrix(turns[len(turns) // 2])[:, 2]
        return bool(axis[2] > _LOOKS_UP)

    def collect_what_goes(self, flush: bool = False) -> None:
        """Collect; a part that fails is reported and doesn't stop the others."""
        try:
            for result in self._pipeline.results(flush):
                self._take(result)
        except UnwritableOutputError:
            raise
        except RollerError as error:
            self._report.add_fault(error)

    def _take(self, result: Result) -> None:
        found = result.found
        if result.fault is not None:
            self._report.add_fault(result.fault)
        if isinstance(found, RefusedWindow | DepthMap | SurfacePatch):
            self._report.add_window(found.stamp_ns, found.account)
        if isinstance(found, RefusedWindow) and found.fault is not None:
            self._report.add_fault(found.fault)
        self._writer.write(result)
        self._also(result)
        if self._tally is not None and isinstance(found, DepthMap | SurfacePatch):
            begin = time.perf_counter()
            self._tally.add(found)  # type: ignore[arg-type]  # the tally fits the method
            # The comparison is no part of the processing that is timed.
            self._truth_s += time.perf_counter() - begin

    def finish(self, recording: Recording, spent_s: float, full: bool) -> None:
        """Write what is left and the account of all; a full disk takes only the latter."""
        braille, stitcher = self._pipeline.braille, self._pipeline.stitcher
        try:
            if not full and stitcher is not None:  # something, where the run was interrupted
                for result in stitcher.results(flush=True):
                    self._take(result)
        except UnwritableOutputError as error:
            self._report.add_fault(error)
        release_reserve(self._writer.folder)
        if full and self._pipeline.inspect is not None:  # of the points that found room
            for result in self._pipeline.inspect.results(flush=True):
                self._also(result)
        self._writer.close(
            braille.lines() if braille is not None else [], self._pipeline.settings.braille.code
        )
        duration_s = (self._last_ns - (self._first_ns or 0)) * 1e-9
        spent_s -= self._truth_s
        refined = stitcher.counts() if stitcher is not None else {}
        self._report.totals = {
            **asdict(recording.counts),
            **{f"depth_{k}": v for k, v in self._pipeline.depth.totals().items()},
            "surface_points": self._writer.surface_points,
            "icp_tried": refined.get("icp_tried", 0),
            "icp_accepted": refined.get("icp_accepted", 0),
            "braille_cells": self._writer.cells,
            "braille_text": braille.text() if braille is not None else [],
            "recording_s": round(duration_s, 6),
            "processing_s": round(spent_s, 3),
            "times_faster_than_recorded": round(duration_s / spent_s, 3) if spent_s > 0 else None,
        }
        if self._tally is not None:
            self._report.truth = self._tally.summary()
        self._report.write(self._writer.folder / "report.json")

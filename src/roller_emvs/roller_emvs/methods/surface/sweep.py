"""Events and poses in, points of the surface out."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.pose_track import PoseTrack
from roller_emvs.engine import DepthEngine
from roller_emvs.evidence import find_depths, measured_pixels
from roller_emvs.patch import Patch
from roller_emvs.stopwatch import Stopwatch
from roller_emvs.windows import RefusedWindow

from .pass_cutter import PassCutter
from .strip import Block, Strip, block_field
from .surface_settings import SurfaceSettings

#: Parts of the image along the roll that a coarse depth is the sum of: a row crosses all of it,
#: and over such an aperture relief that repeats has side lobes.
_PARTS = 4


@dataclass(frozen=True)
class SurfacePatch(Patch):
    """Rows of the surface that are done, and the account of how they came about.

    Attributes
    ----------
    start_ns, end_ns : int
        Times of the first and last event that could reach the rows, ROS time.
    events : int
        Events voted.
    milliseconds : dict
        Time by stage, ms.
    cpu_ms : float
        Processor time of all threads of the process meanwhile, ms; 0 where it isn't known.
    """

    start_ns: int = 0
    end_ns: int = 0
    events: int = 0
    milliseconds: dict[str, float] = field(default_factory=dict)
    cpu_ms: float = 0.0

    @property
    def stamp_ns(self) -> int:
        """Middle of the time in which the rows were in view."""
        return (self.start_ns + self.end_ns) // 2


class SurfaceSweep(DepthEngine[PassCutter]):
    """Votes events into a strip fixed to the surface; rows leave when they are out of view.

    Parameters
    ----------
    settings : SurfaceSettings
        Parameters.
    camera : Camera
        Calibration of the camera that the events are from.
    track : PoseTrack
        Camera optical frame in base; the caller goes on adding poses to it.
    """

    def __init__(self, settings: SurfaceSettings, camera: Camera, track: PoseTrack) -> None:
        super().__init__(settings, camera, track, PassCutter(settings, camera, track))
        self.settings = settings
        self.milliseconds: dict[str, float] = {}

    def results(self, flush: bool = False) -> Iterator[SurfacePatch | RefusedWindow]:
        """Rows that are done, in order along each pass, each once.

        Parameters
        ----------
        flush : bool
            No more events will come: rows still in view are done too.
        """
        for found in self._cutter.cut(flush):
            if isinstance(found, RefusedWindow):
                self._counts.events += found.events
                result: SurfacePatch | RefusedWindow = found
            else:
                strip, block = found
                self._counts.events += block.events
                try:
                    result = self._measure(strip, block)
                except RollerError as error:
                    result = RefusedWindow(block.first_ns, block.last_ns, block.events, str(error))
            self._count(None if isinstance(result, RefusedWindow) else len(result))
            yield result
        self._counts.broken_passes = self._cutter.broken_passes

    def _measure(self, strip: Strip, block: Block) -> SurfacePatch | RefusedWindow:
        s, watch, begin = self.settings, Stopwatch(), time.perf_counter()
        cpu_s = time.process_time()
        middle = strip.middle_m
        with watch("arrange"):
            field, left, top = block_field(strip, block)
        aperture_m = field.aperture * strip.pixel_m * middle
        if aperture_m < s.min_aperture_m:
            return RefusedWindow(
                block.first_ns,
                block.last_ns,
                block.events,
                f"rows seen over {aperture_m * 1e3:.1f} mm of travel, "
                f"less than {s.min_aperture_m * 1e3:g} mm: too little parallax",
            )
        half = 0.5 * (s.depth_max_m - s.depth_min_m)
        with watch("votes"):
            depths = find_depths(field, -half, half, s.evidence, _PARTS, s.threads)
        with watch("points"):
            found = measured_pixels(field, depths, s.evidence, s.threads)
            x = found.column * strip.pixel_m + left
            local = np.stack([x, found.row * strip.pixel_m + top, found.offset + middle], axis=-1)
            keep = (x >= block.start_m) & (x < block.end_m) & (np.abs(found.offset) <= half)
            keep &= self._seen(strip, x)
            points = strip.to_base(local[keep])
        watch.milliseconds["total"] = (time.perf_counter() - begin) * 1e3
        for stage, spent in watch.milliseconds.items():
            self.milliseconds[stage] = self.milliseconds.get(stage, 0.0) + spent
        return SurfacePatch(
            points,
            (points[:, 2] - s.surface_z_m).astype(np.float32),
            found.confidence[keep],
            found.sigma[keep],
            block.first_ns,
            block.last_ns,
            block.events,
            {k: round(v, 3) for k, v in watch.milliseconds.items()},
            round((time.process_time() - cpu_s) * 1e3, 3),
        )

    def _seen(self, strip: Strip, x: np.ndarray) -> np.ndarray:
        """Rows that were in view over enough travel; near the ends of a pass some weren't."""
        low, high = strip.slopes_seen(x)
        return np.asarray((high - low) * strip.middle_m >= self.settings.min_aperture_m)

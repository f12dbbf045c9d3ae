"""Events and poses in, points of the surface out."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from roller_core.camera import Camera
from roller_core.dead_time import DeadTime
from roller_core.errors import RollerError, SettingsError
from roller_core.pose_track import PoseTrack
from roller_core.transforms import F64
from roller_emvs.engine import DepthEngine
from roller_emvs.evidence import (
    Depths,
    EvidenceField,
    Relief,
    find_depths,
    follow_wider,
    is_textured,
    measured_pixels,
)
from roller_emvs.lines.line_points import LinePoints
from roller_emvs.lines.neighbourhoods import depth_points
from roller_emvs.lines.patch_ends import PatchEnds
from roller_emvs.lines.path_error import PathError
from roller_emvs.lines.ray_source import RayArray
from roller_emvs.lines.refine import refine
from roller_emvs.lines.travelling_light import TravellingLight
from roller_emvs.rays import F32
from roller_emvs.stopwatch import Stopwatch
from roller_emvs.windows import RefusedWindow

from .block_work import BlockWork, find_ends, learn_path
from .blocks import Block
from .narrow import narrowed
from .part_depths import find_coarsely, find_part_depths
from .part_field import COARSE_PARTS, PartField, fits, part_field
from .pass_cutter import PassCutter
from .strip import Strip
from .strip_rays import StripRays, ray_field
from .surface_patch import SurfacePatch
from .surface_settings import SurfaceSettings

#: Every second event is enough for lines.
_LINES_EVERY = 2

#: Measured pixels, and where they lie on the strip along and across, metres.
Measured = tuple[Relief, F64, F64]


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

    Raises
    ------
    SettingsError
        If the nearest depth is too near for any view of it, or so far that a pixel of it is wider
        than a block.
    """

    def __init__(self, settings: SurfaceSettings, camera: Camera, track: PoseTrack) -> None:
        _check_pixel(settings, camera)
        super().__init__(settings, camera, track, PassCutter(settings, camera, track))
        self._cutter.dead_time = DeadTime(camera.width, camera.height)
        self.settings = settings
        self._drifts = settings.edge_drift, settings.edge_drift.under_texture()
        # Whether any block so far was.
        self._textured = False
        self._pass: tuple[Strip, TravellingLight, PatchEnds, PathError] | None = None
        #: Takes the lines of each block as they were fitted: places in base, shape (n, 3), metres,
        #: the strip's axes in base (along the motion, across, away from the camera), and the rest.
        self.on_lines: Callable[[F64, F64, LinePoints], None] | None = None
        #: Takes the depths of neighbourhoods in the same form.
        self.on_depths: Callable[[F64, F64, LinePoints], None] | None = None

    @property
    def at_rest(self) -> bool:
        """Whether the last pass ended where the sensor came to rest: the scan may be over."""
        return self._cutter.at_rest

    def results(self, flush: bool = False) -> Iterator[SurfacePatch | RefusedWindow]:
        """Rows that are done, in order along each pass, each once.

        Parameters
        ----------
        flush : bool
            No more events will come: rows still in view are done too.
        """
        for found in self._cutter.cut(flush):
            if isinstance(found, RefusedWindow):
                if found.fault is None:  # else they count as without a pose
                    self._counts.events += found.events
                result: SurfacePatch | RefusedWindow = found
            else:
                strip, block = found
                self._counts.events += block.events
                span = block.first_ns, block.last_ns, block.events
                try:
                    result = self._refused(*span) or self._measure(strip, block)
                except RollerError as error:
                    result = RefusedWindow(*span, str(error))
                strip.release(block)
            self._count(None if isinstance(result, RefusedWindow) else len(result))
            yield result
        self._counts.broken_passes = self._cutter.broken_passes

    def _measure(self, strip: Strip, block: Block) -> SurfacePatch | RefusedWindow:
        s, watch, begin = self.settings, Stopwatch(), time.perf_counter()
        cpu_s = time.process_time()
        aperture_m = strip.aperture_m(block)
        if aperture_m < s.min_aperture_m:
            return RefusedWindow(
                block.first_ns,
                block.last_ns,
                block.events,
                f"rows seen over {aperture_m * 1e3:.1f} mm of travel, "
                f"less than {s.min_aperture_m * 1e3:g} mm: too little parallax",
            )
        measured = None
        while (
            measured is None
        ):  # anew once it is seen where the surface lies and the skin leaves it
            by = self._by_parts if fits(strip, block) else self._by_rays
            measured = by(strip, block, watch)
        found, x, y = measured
        with watch("points"):
            local = np.stack([x, y, found.offset + strip.middle_m], axis=-1)
            keep = (x >= block.start_m) & (x < block.end_m)
            keep &= (np.abs(found.offset) <= strip.half_m) & self._seen(strip, x)
            points = strip.to_base(local[keep])
        watch.milliseconds["total"] = (time.perf_counter() - begin) * 1e3
        return SurfacePatch(
            points,
            (points[:, 2] - s.surface_z_m).astype(np.float32),
            found.confidence[keep],
            (found.sigma * found.agreed)[keep],
            block.first_ns,
            block.last_ns,
            block.events,
            {k: round(v, 3) for k, v in watch.milliseconds.items()},
            round((time.process_time() - cpu_s) * 1e3, 3),
            watch.cpu_ms,
            found.textured,
        )

    def _by_parts(self, strip: Strip, block: Block, watch: Stopwatch) -> Measured | None:
        """Measured pixels, and where they lie on the strip, for a straight path."""
        s = self.settings
        with watch("arrange"):
            whole = part_field(strip, block, s.evidence.planes_per_px, s.threads)
        with watch("votes"):
            near = find_coarsely(whole, strip.half_m, s.evidence, s.threads)
            block, field, near = narrowed(block, whole, near, strip.pixel_m)
            depths = find_part_depths(field, near, strip.half_m, s.evidence, s.threads)
        if strip.learn_depth(_offsets(depths)):
            return None
        with watch("points"):
            found = self._measured(field, depths)
        with watch("lines"):
            rays = partial(StripRays, strip, block, reach_m=field.reach_m)
            work = BlockWork(
                strip, block, field, lambda polarity, every: rays(polarity, every=every)
            )
            return self._refined(work, depths, found)

    def _by_rays(self, strip: Strip, block: Block, watch: Stopwatch) -> Measured | None:
        """The same for any path."""
        s, half = self.settings, strip.half_m
        with watch("arrange"):
            field = ray_field(strip, block)
        with watch("votes"):
            depths = find_depths(field, -half, half, s.evidence, COARSE_PARTS, s.threads)
        if strip.learn_depth(_offsets(depths)):
            return None
        with watch("points"):
            found = self._measured(field, depths)
        with watch("lines"):
            work = BlockWork(strip, block, field, lambda k, every: RayArray(field.some(k, every)))
            return self._refined(work, depths, found)

    def _measured(self, field: EvidenceField, depths: list[Depths]) -> Relief:
        s, wanted = self.settings, self.on_lines is not None
        # A part of a grid is cut where there is no texture.
        textured = not field.is_part and is_textured(depths, self._textured)
        self._textured |= textured
        return measured_pixels(
            field, depths, s.evidence, s.edge_drift, s.threads, wanted, textured=textured
        )

    def _refined(self, work: BlockWork, depths: list[Depths], found: Relief) -> Measured | None:
        """Points that follow lines, and where they lie; None if rays beyond the patch counted."""
        s, field = self.settings, work.field
        if not any(np.isfinite(own.offset).any() for own in depths):
            return found, np.empty(0), np.empty(0)
        light, ends, path = self._pass_of(work.strip)
        late = self._cutter.dead_time
        blind_m = late.blind_m if late else 0.0
        textured = found.textured  # it has events and points enough
        found, lines = refine(
            field, found, lambda polarity: work.rays(polarity, _LINES_EVERY), work.columns,
            self._drifts[textured], light, blind_m, s.threads, as_points=not textured,
        )  # fmt: skip
        if textured and not ends.known and find_ends(ends, work, found, lines, _LINES_EVERY):
            work.strip.ends = ends.ends
            return None
        if self.on_lines is not None:
            self.on_lines(*work.in_base(lines), lines)
        if self.on_depths is not None:
            points = depth_points(field, depths, work.columns, textured)
            self.on_depths(*work.in_base(points), points)
        x = work.along(found.column)
        if textured and isinstance(field, PartField):  # of others the path isn't straight
            learn_path(path, work, found, lines)
            lacks = path.lacks_m(x).astype(found.offset.dtype)
            found = replace(found, offset=found.offset + lacks)
        if textured and s.average_flats:
            found = follow_wider(found, field, s.evidence, s.threads)
        return found, x, work.across(found.row, found.offset)

    def _pass_of(self, strip: Strip) -> tuple[TravellingLight, PatchEnds, PathError]:
        """What the strip's pass says of its light, of where the skin lies on it, and its poses."""
        if self._pass is None or self._pass[0] is not strip:
            self._pass = (
                strip, TravellingLight(), PatchEnds(strip.slopes, strip.focal_px),
                PathError(strip.slopes, strip.middle_m),
            )  # fmt: skip
        return self._pass[1:]

    def _seen(self, strip: Strip, x: np.ndarray) -> np.ndarray:
        """Rows that were in view over enough travel; near the ends of a pass some weren't."""
        low, high = strip.slopes_seen(x)
        return np.asarray((high - low) * strip.depth_m >= self.settings.min_aperture_m)


def _check_pixel(s: SurfaceSettings, camera: Camera) -> None:
    """Refuse what would cut the surface into thousands of blocks that all events reach."""
    pixel_m = s.depth_min_m / max(camera.fx, camera.fy)
    if pixel_m > s.block_m:
        raise SettingsError(
            f"'depth_min_m' = {s.depth_min_m:g}: a pixel is {pixel_m * 1e3:.2g} mm wide there, "
            f"wider than a block (block_m = {s.block_m:g}); set depth_min_m and depth_max_m around "
            "the surface, in metres"
        )


def _offsets(depths: list[Depths]) -> F32:
    """Those of the cells that have one."""
    every = np.concatenate([own.offset.ravel() for own in depths])
    return np.asarray(every[np.isfinite(every)])

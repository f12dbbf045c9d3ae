"""Depth, surface and text from one stream: what a replay runs without DDS."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from roller_braille.cells import Cell
from roller_braille.pipeline import BraillePipeline
from roller_braille.reader_settings import BrailleSettings
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.settings import read_parameters
from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import DepthSettings, StitcherSettings
from roller_emvs.methods.surface import SurfacePatch, SurfaceSettings, SurfaceSweep
from roller_emvs.patch import Patch
from roller_emvs.pipeline import DepthPipeline
from roller_emvs.stitcher import Stitcher
from roller_emvs.windows import RefusedWindow

_FRAMES = frozenset(
    {
        "base_frame",
        "moving_frame",
        "sensor_frame",
        "pose_smoothing",
        "idle_flush_s",
        "calibrated_camera",
    }
)
#: Parameters of the nodes that only make sense in a graph.
_GRAPH_ONLY = {
    "emvs": _FRAMES,
    "stitcher": _FRAMES | {"max_pose_gap_s"},
    "braille": _FRAMES,
    "surface": _FRAMES,
}

#: Settings of the sweep in the surface's frame that the other parts have too.
_SHARED = frozenset(
    {
        "depth_min_m",
        "depth_max_m",
        "threads",
        "max_backlog_events",
        "surface_z_m",
        "event_delay_s",
        "max_pose_gap_s",
    }
)


@dataclass(frozen=True)
class InspectionSettings:
    """Settings of the parts, as their nodes take them."""

    depth: DepthSettings
    stitcher: StitcherSettings
    braille: BrailleSettings
    surface: SurfaceSettings = field(default_factory=lambda: SurfaceSettings.create({}))

    @classmethod
    def load(cls, path: Path | None = None, method: str | None = None) -> InspectionSettings:
        """Read a ROS 2 parameter file with sections `emvs`, `stitcher`, `braille` and `surface`.

        What `surface` doesn't say of depth range, threads, times and nominal surface, `emvs` and
        `stitcher` say for it; the node `surface` of the live graph has its own section alone.

        Parameters
        ----------
        path : path, optional
            Without it all defaults hold.
        method : str, optional
            Goes before the file's `method`.

        Raises
        ------
        SettingsError
            Naming the entry that is wrong.
        """

        def section(node: str) -> dict[str, Any]:
            values = read_parameters(path, node) if path else {}
            return {k: v for k, v in values.items() if k not in _GRAPH_ONLY.get(node, _FRAMES)}

        source = str(path) if path else "settings"
        depth = section("emvs")
        if method:
            depth["method"] = method
        stitcher = section("stitcher")
        shared = {k: v for k, v in {**depth, **stitcher}.items() if k in _SHARED}
        return cls(
            DepthSettings.create(depth, source),
            StitcherSettings.create(stitcher, source),
            BrailleSettings.create(section("braille"), source),
            SurfaceSettings.create({**shared, **section("surface")}, source),
        )

    @property
    def max_pose_gap_s(self) -> float:
        """Longest time between two poses to interpolate over, of the method that is chosen."""
        return (self.surface if self.depth.method == "surface" else self.depth).max_pose_gap_s


@dataclass(frozen=True)
class DepthResult:
    """A depth map and the points of the surface that it completed."""

    depth_map: DepthMap
    patch: Patch


class Inspection:
    """Events and poses in; depth maps, surface and Braille cells out.

    Parameters
    ----------
    settings : InspectionSettings
        Of all parts.
    camera : Camera
        Calibration.
    track : PoseTrack
        Camera in base; the caller goes on adding poses.
    braille : bool
        Whether to read Braille.
    """

    def __init__(
        self,
        settings: InspectionSettings,
        camera: Camera,
        track: PoseTrack,
        braille: bool = True,
    ) -> None:
        self.settings = settings
        self.depth: DepthPipeline | SurfaceSweep
        if settings.depth.method == "surface":
            self.depth = SurfaceSweep(settings.surface, camera, track)
        else:
            self.depth = DepthPipeline(settings.depth, camera, track)
        self.stitcher = Stitcher(settings.stitcher, camera)
        self.braille = BraillePipeline(settings.braille, camera, track) if braille else None
        self._track = track

    def add_events(self, events: EventArray) -> None:
        """Take events in order of time, ROS time."""
        self.depth.add_events(events)
        if self.braille is not None:
            self.braille.add_events(events)

    def results(
        self, flush: bool = False
    ) -> Iterator[DepthResult | SurfacePatch | RefusedWindow | Cell]:
        """What is complete by now; with `flush` all that is left."""
        for found in self.depth.results(flush):
            if isinstance(found, RefusedWindow | SurfacePatch):
                yield found
            else:
                yield DepthResult(found, self.stitcher.add(found))
        if self.braille is not None:
            yield from self.braille.results(flush)
        self._forget_poses()

    def finish(self) -> Patch:
        """The last points of the surface."""
        return self.stitcher.finish()

    def _forget_poses(self) -> None:
        needed = [self.depth.needed_from_ns]
        if self.braille is not None:
            needed.append(self.braille.needed_from_ns)
        if len(self._track) > 10_000 and None not in needed:
            self._track.discard_before(min(t for t in needed if t is not None))

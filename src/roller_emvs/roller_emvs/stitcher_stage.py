"""What node `stitcher` does: depth maps and poses in, patches of the surface out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from roller_core import outputs
from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.frame_settings import FollowedFrames, idle_flush_field
from roller_core.outputs import Output, Result
from roller_core.pose_track import PoseError, PoseExtrapolationError
from roller_core.stage import OK, WARN, Stage
from roller_core.transforms import F64

from .depth_map import F32, DepthMap
from .depth_settings import StitcherSettings
from .patch import Patch, patch_output
from .stitcher import Stitcher
from .surface_map import MapKeeper, MapSettings

_MOST_PENDING = 100
#: A depth map that lacks a part while so many newer ones are whole will never be.
_MOST_BEHIND = 4
#: A stamp this far ahead of the newest pose is none of this graph's, ns.
_MOST_AHEAD_NS = 60_000_000_000


class DepthImageError(RollerError):
    """A depth image that doesn't fit its camera."""


class StitcherParameters(StitcherSettings, FollowedFrames):
    """Parameters of the node: the stitcher's settings, the map's and the stage's."""

    map: MapSettings = MapSettings.create({})

    idle_flush_s: float = idle_flush_field(
        1.5, "depth maps for this long what is in view is published too"
    )


@dataclass
class _Parts:
    """Depth, confidence and sigma of one time, which come one by one."""

    image: F32 | None = None
    confidence: F32 | None = None
    sigma: F32 | None = None

    @property
    def complete(self) -> bool:
        return not (self.image is None or self.confidence is None or self.sigma is None)


class StitcherStage(Stage[StitcherParameters]):
    """Gives the patches of `Stitcher`: points that are out of view, each once.

    Beside them the map of the scan, see `MapKeeper`.
    """

    node, part = "stitcher", "surface"
    model = StitcherParameters
    inputs = (
        outputs.DEPTH_INFO,
        outputs.DEPTH_CONFIDENCE,
        outputs.DEPTH_SIGMA,
        outputs.DEPTH_IMAGE,
        outputs.TF,
        outputs.TF_STATIC,
    )
    outputs = (outputs.SURFACE_POINTS, outputs.SURFACE_MAP)
    most_waiting = 5000

    def __init__(self, settings: StitcherParameters) -> None:
        super().__init__(settings)
        self.stitcher: Stitcher | None = None
        self.map = MapKeeper(settings.map, settings.base_frame)
        #: Depth maps without a pose or a part.
        self.left_out = 0
        self._pending: dict[int, _Parts] = {}
        self._last_ns = 0
        # Stamp of the newest camera, and of the depth map after which no more come for now.
        self._camera_ns = self._end_ns = -1
        self._maps = self._points = 0

    def warm_up(self) -> None:
        """Load what a correction of the pose takes: half a second."""
        camera = Camera(32, 32, 300.0, 300.0, 15.5, 15.5)
        stitcher, flat = Stitcher(self.settings, camera), np.full((32, 32), 0.045, np.float32)
        for k in range(2):
            stitcher.add(DepthMap(k, flat, flat, flat, np.eye(4), k, k, 0))
        stitcher.finish()

    def services(self) -> Mapping[str, Callable[[], str]]:
        """See `Stage`."""
        return {"clear": self.clear, "save": self.map.save}

    def take_camera(self, camera: Camera) -> None:
        """Take the camera of the depth maps."""
        if self.camera is None:  # parts of its first depth map may have come before
            self.camera, self.stitcher = camera, Stitcher(self.settings, camera)
        elif self.camera != camera:
            self.camera = camera
            self._begin()

    def take_output(self, output: Output) -> None:
        """Take what the depth stage gives: camera, confidence, sigma or depth."""
        if isinstance(output.data, Camera):
            self.take_camera(output.data)
            if output.t_ns == self._camera_ns:
                self._end_ns = output.t_ns
            self._camera_ns = output.t_ns
            return
        parts = self._pending.setdefault(output.t_ns, _Parts())
        if output.topic == outputs.DEPTH_IMAGE:
            parts.image = output.data
        elif output.topic == outputs.DEPTH_SIGMA:
            parts.sigma = output.data
        else:
            parts.confidence = output.data
        if self.stitcher is None or not len(self.frames.track):
            while len(self._pending) > _MOST_PENDING:
                del self._pending[max(self._pending)]
                self.left_out += 1

    def health(self) -> tuple[int, str]:
        """See `Stage`."""
        if self._pending and (missing := self.frames.missing()):
            return WARN, missing
        if self.left_out:
            return WARN, "depth maps were left out"
        return OK, "" if self.stitcher is not None else "waiting for depth maps"

    def rated(self) -> Mapping[str, float]:
        """See `Stage`."""
        return {"depth_map_rate_hz": self._maps, "pose_rate_hz": self.frames.counts.poses}

    def counts(self) -> Mapping[str, object]:
        """See `Stage`."""
        stitcher = self.stitcher
        found = stitcher.last_refinement if stitcher is not None else None
        return {
            "depth_maps": self._maps,
            "left_out": self.left_out,
            "points": self._points,
            "map_points": len(self.map),
            "voxels_in_view": len(stitcher.voxels) if stitcher is not None else 0,
            "waiting_maps": len(self._pending),
            "icp_tried": stitcher.icp_tried if stitcher is not None else 0,
            "icp_accepted": stitcher.icp_accepted if stitcher is not None else 0,
            "icp_last": (found.reason or "accepted") if found else "",
        }

    def _begin(self) -> None:
        self.left_out += len(self._pending)
        self._pending.clear()
        self.map.clear()
        if self.camera is not None:
            self.stitcher = Stitcher(self.settings, self.camera)

    def _results(self, flush: bool) -> Iterator[Result]:
        while (found := self._next()) is not None:
            stamp, parts, pose = found
            yield from self._give(self._add(stamp, parts, pose))
            self.frames.track.discard_before(stamp)
        # The depth map may come after the word that it was the last.
        flush = flush or self._end_ns == self._last_ns
        if flush and self.stitcher is not None:
            self._end_ns = -1
            yield from self._give(self.stitcher.finish())
        yield from self.map.results(flush)

    def _next(self) -> tuple[int, _Parts, F64] | None:
        """The oldest depth map, if it is complete and its pose is known."""
        track = self.frames.track
        while self.stitcher is not None and self._pending and len(track):
            stamp = min(self._pending)
            parts = self._pending[stamp]
            whole = sum(each.complete for each in self._pending.values())
            over = len(self._pending) > _MOST_PENDING or (
                not parts.complete and whole >= _MOST_BEHIND
            )
            if over and (far := max(self._pending)) > track.end_ns + _MOST_AHEAD_NS:
                # Its pose won't come; the oldest one's may.
                del self._pending[far]
                self.left_out += 1
                continue
            if not parts.complete and not over:
                return None
            pose = None
            try:
                pose = track.matrices([stamp])[0]
            except PoseExtrapolationError:
                if stamp > track.end_ns and not over:
                    return None  # the pose is still to come
            except PoseError:
                pass
            del self._pending[stamp]
            if pose is not None and parts.complete:
                return stamp, parts, pose
            self.left_out += 1
        return None

    def _add(self, stamp: int, parts: _Parts, pose: F64) -> Patch:
        stitcher, images = self.stitcher, (parts.image, parts.confidence, parts.sigma)
        assert stitcher is not None
        expected = (stitcher.camera.height, stitcher.camera.width)
        depth, sure, sigma = (np.asarray(image, np.float32) for image in images)
        if any(image.shape != expected for image in (depth, sure, sigma)):
            raise DepthImageError(
                f"depth image of {depth.shape} px but camera_info of {expected}; are two depth "
                "nodes publishing?"
            )
        self._last_ns = stamp
        self._maps += 1
        return stitcher.add(DepthMap(stamp, depth, sure, sigma, pose, stamp, stamp, 0))

    def _give(self, patch: Patch) -> Iterator[Result]:
        if len(patch):
            self._points += len(patch)
            cloud = patch_output(patch, self._last_ns, self.settings.base_frame)
            yield Result(patch, (cloud,))
            self.map.add(patch, self._last_ns)
            yield from self.map.results(flush=False)

"""What node `surface` does: event packets and poses in, points of the surface out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from roller_core import outputs
from roller_core.camera import Camera
from roller_core.event_stage import EventStage
from roller_core.frame_settings import StreamSettings
from roller_core.outputs import Output, Result
from roller_core.pose_track import PoseTrack

from .engine import contact_figures
from .methods.surface import SurfaceSettings, SurfaceSweep
from .patch import patch_output
from .surface_map import MapKeeper, MapSettings
from .warm_up import warm_up
from .windows import RefusedWindow


class SurfaceParameters(SurfaceSettings, StreamSettings):
    """Parameters of the node: the sweep's settings, the map's and the stage's."""

    map: MapSettings = MapSettings.create({})


class SurfaceStage(EventStage[SurfaceParameters, SurfaceSweep]):
    """Gives the results of `SurfaceSweep`: each block of rows once, when it is out of view.

    Beside them the map of the scan, see `MapKeeper`.
    """

    node, part = "surface", "points"
    memory_ahead = 4
    model = SurfaceParameters
    outputs = (
        outputs.SURFACE_POINTS,
        outputs.SURFACE_ACCOUNT,
        outputs.SURFACE_MAP,
        outputs.CONTACT,
    )

    def __init__(self, settings: SurfaceParameters) -> None:
        super().__init__(settings)
        self.map = MapKeeper(settings.map, settings.base_frame)

    def services(self) -> Mapping[str, Callable[[], str]]:
        """See `Stage`."""
        return {"clear": self.clear, "save": self.map.save}

    def warm_up(self) -> None:
        """Load the kernels."""
        super().warm_up()
        warm_up(self.settings)

    def _make(self, camera: Camera, track: PoseTrack) -> SurfaceSweep:
        return SurfaceSweep(self.settings, camera, track)

    def _pipeline_results(self, pipeline: SurfaceSweep, flush: bool) -> Iterator[Result]:
        for found in pipeline.results(flush):
            account = Output(
                outputs.SURFACE_ACCOUNT, found.stamp_ns, self.settings.base_frame, found.account
            )
            if isinstance(found, RefusedWindow):
                yield found.result("block", "points", account)
            else:
                self._came(found.end_ns, found.milliseconds.get("total", 0.0))
                cloud = patch_output(found, found.stamp_ns, self.settings.base_frame)
                yield Result(found, (cloud, account) if len(found) else (account,))
                if len(found):
                    self.map.add(found, found.stamp_ns)
                    yield from self.map.results(flush=False)
        yield from self.map.results(flush or pipeline.at_rest)

    def _begin(self) -> None:
        super()._begin()
        self.map.clear()

    def _pipeline_counts(
        self, pipeline: SurfaceSweep, totals: Mapping[str, int]
    ) -> Mapping[str, object]:
        return {
            "points": totals["points"],
            "blocks": totals["windows"],
            "refused_blocks": totals["refused_windows"],
            "broken_passes": totals["broken_passes"],
            "still_events": totals["still_events"],
            "ramp_events": totals["ramp_events"],
            "dead_time_events": totals["dead_time_events"],
            "map_points": len(self.map),
            "edge_drift": str(self.settings.edge_drift),
            **contact_figures(pipeline),
            **self._times.figures("block"),
            "block_latency_s": self._times.latency_s,
        }

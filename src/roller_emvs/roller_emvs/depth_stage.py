"""What node `emvs` does: event packets and poses in, depth maps out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from roller_core import outputs
from roller_core.camera import Camera
from roller_core.event_stage import EventStage
from roller_core.frame_settings import StreamSettings
from roller_core.outputs import Output, Result
from roller_core.pose_track import PoseTrack

from .depth_map import DepthMap, pinhole
from .depth_settings import DepthSettings
from .engine import contact_figures
from .pipeline import DepthPipeline, refuse_surface
from .warm_up import warm_up
from .windows import RefusedWindow


class EmvsParameters(DepthSettings, StreamSettings):
    """Parameters of the node: the depth engine's settings and the stage's."""


class DepthStage(EventStage[EmvsParameters, DepthPipeline]):
    """Gives the depth maps of `DepthPipeline`, each with its confidence, sigma and camera.

    The camera comes once more after the last, when no more come for now.

    Raises
    ------
    SettingsError
        For a method that makes no depth maps.
    """

    node, part = "emvs", "depth"
    memory_ahead = 4
    model = EmvsParameters
    outputs = (
        outputs.DEPTH_INFO,
        outputs.DEPTH_CONFIDENCE,
        outputs.DEPTH_SIGMA,
        outputs.DEPTH_IMAGE,
        outputs.DEPTH_ACCOUNT,
        outputs.CONTACT,
    )

    def __init__(self, settings: EmvsParameters) -> None:
        refuse_surface(settings)
        super().__init__(settings)
        #: Stamp of the newest depth map; None after a flush.
        self._newest_ns: int | None = None

    def warm_up(self) -> None:
        """Load the kernels."""
        super().warm_up()
        warm_up(self.settings)

    def too_slow(self) -> tuple[int, str]:
        """See `EventStage`."""
        totals = self.totals()
        out = totals.get("left_out_windows", 0)
        every = out + totals.get("windows", 0) + totals.get("refused_windows", 0)
        packets, text = super().too_slow()
        return packets + out, f"too slow: {out} of {every} windows left out" if out else text

    def _make(self, camera: Camera, track: PoseTrack) -> DepthPipeline:
        return DepthPipeline(self.settings, camera, track)

    def _pipeline_results(self, pipeline: DepthPipeline, flush: bool) -> Iterator[Result]:
        camera = pinhole(pipeline.camera)
        for found in pipeline.results(flush):
            if isinstance(found, RefusedWindow):
                yield found.result("window", "depth", self._account(found))
            else:
                self._came(found.end_ns, found.milliseconds.get("total", 0.0))
                self._newest_ns = found.stamp_ns
                yield Result(found, self._depth_outputs(found, camera))
                if pipeline.at_rest:
                    yield from self._last(camera)
        if flush:
            yield from self._last(camera)

    def _last(self, camera: Camera) -> Iterator[Result]:
        """The camera once more: the stitcher need not wait to know that no more come for now."""
        if self._newest_ns is not None:
            again = Output(outputs.DEPTH_INFO, self._newest_ns, self.settings.sensor_frame, camera)
            self._newest_ns = None
            yield Result(None, (again,))

    def _depth_outputs(self, found: DepthMap, camera: Camera) -> tuple[Output, ...]:
        t, frame = found.stamp_ns, self.settings.sensor_frame
        data = (camera, found.confidence, found.sigma, found.depth)
        given = (Output(n, t, frame, d) for n, d in zip(self.outputs[:4], data, strict=True))
        return *given, self._account(found)

    def _account(self, found: DepthMap | RefusedWindow) -> Output:
        frame = self.settings.sensor_frame
        return Output(outputs.DEPTH_ACCOUNT, found.stamp_ns, frame, found.account)

    def _pipeline_counts(
        self, pipeline: DepthPipeline, totals: Mapping[str, int]
    ) -> Mapping[str, object]:
        return {
            "windows": totals["windows"],
            "refused_windows": totals["refused_windows"],
            "left_out_windows": totals["left_out_windows"],
            "ramp_events": totals["ramp_events"],
            "dead_time_events": totals["dead_time_events"],
            "edge_drift": self.settings.drift_text,
            **contact_figures(pipeline),
            **self._times.figures("window"),
            "window_latency_s": self._times.latency_s,
        }

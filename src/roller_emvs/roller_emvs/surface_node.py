"""Node `surface`: event packets and poses in, points of the surface out."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Mapping

from sensor_msgs.msg import PointCloud2

from roller_core.camera import Camera
from roller_core.pose_track import PoseTrack
from roller_emvs.methods.surface import SurfacePatch, SurfaceSettings, SurfaceSweep
from roller_ros import qos
from roller_ros.node_main import run_node
from roller_ros.stream_node import StreamNode, StreamParameters, percentile

from .messages import surface_message
from .warm_up import warm_up
from .windows import RefusedWindow


class SurfaceParameters(SurfaceSettings, StreamParameters):
    """Parameters of the node: the sweep's settings and the graph's."""


class SurfaceNode(StreamNode[SurfaceSweep]):
    """Publishes the results of `SurfaceSweep`: each block of rows once, when it is out of view."""

    def __init__(self) -> None:
        super().__init__("surface", "points", SurfaceParameters)
        self._settings = SurfaceSettings.create(
            {name: getattr(self.parameters, name) for name in SurfaceSettings.model_fields}
        )
        self._latency_s = 0.0
        self._block_ms: deque[float] = deque(maxlen=1000)
        self._points = self.create_publisher(PointCloud2, "/roller/surface/points", qos.SURFACE)
        warm_up(self._settings)
        self.listen()

    def make_pipeline(self, camera: Camera, track: PoseTrack) -> SurfaceSweep:
        """Begin with a camera, or begin anew."""
        return SurfaceSweep(self._settings, camera, track)

    def publish_results(self, pipeline: SurfaceSweep, flush: bool) -> None:
        """Publish rows that are done; report blocks that give none."""
        for found in pipeline.results(flush):
            if isinstance(found, RefusedWindow):
                self.diagnostics.fault(
                    f"block at {found.start_ns * 1e-9:.3f} s gives no points: {found.reason}"
                )
            else:
                self._publish(found)

    def figures(self, pipeline: SurfaceSweep) -> Mapping[str, object]:
        """Points, blocks and their times."""
        counts = pipeline.counts
        return {
            "points": counts.points,
            "blocks": counts.windows,
            "refused_blocks": counts.refused_windows,
            "still_events": counts.still_events,
            "block_ms_median": percentile(self._block_ms, 50),
            "block_ms_p95": percentile(self._block_ms, 95),
            "block_latency_s": round(self._latency_s, 4),
        }

    def _publish(self, found: SurfacePatch) -> None:
        self._block_ms.append(found.milliseconds.get("total", 0.0))
        if len(found):
            frame = self.parameters.base_frame
            self._points.publish(surface_message(found, found.stamp_ns, frame))
        self._latency_s = (self.get_clock().now().nanoseconds - found.end_ns) * 1e-9


def main() -> None:
    """Run the node."""
    sys.exit(run_node(SurfaceNode))

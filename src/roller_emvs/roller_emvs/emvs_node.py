"""Node `emvs`: event packets and poses in, depth maps out."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Mapping

from sensor_msgs.msg import CameraInfo, Image

from roller_core.camera import Camera
from roller_core.pose_track import PoseTrack
from roller_ros import messages, qos
from roller_ros.node_main import run_node
from roller_ros.stream_node import StreamNode, StreamParameters, percentile

from .depth_map import DepthMap, pinhole
from .depth_settings import DepthSettings
from .pipeline import DepthPipeline, refuse_surface
from .warm_up import warm_up
from .windows import RefusedWindow


class EmvsParameters(DepthSettings, StreamParameters):
    """Parameters of the node: the depth engine's settings and the graph's."""


class EmvsNode(StreamNode[DepthPipeline]):
    """Publishes the results of `DepthPipeline`."""

    def __init__(self) -> None:
        super().__init__("emvs", "depth", EmvsParameters)
        self._settings = DepthSettings.create(
            {name: getattr(self.parameters, name) for name in DepthSettings.model_fields}
        )
        refuse_surface(self._settings)
        self._latency_s = 0.0
        self._window_ms: deque[float] = deque(maxlen=1000)
        self._image = self.create_publisher(Image, "/roller/depth/image", qos.DEPTH)
        self._confidence = self.create_publisher(Image, "/roller/depth/confidence", qos.DEPTH)
        self._info = self.create_publisher(CameraInfo, "/roller/depth/camera_info", qos.DEPTH)
        warm_up(self._settings)
        self.listen()

    def make_pipeline(self, camera: Camera, track: PoseTrack) -> DepthPipeline:
        """Begin with a camera, or begin anew."""
        return DepthPipeline(self._settings, camera, track)

    def publish_results(self, pipeline: DepthPipeline, flush: bool) -> None:
        """Publish depth maps; report windows that give none."""
        for found in pipeline.results(flush):
            if isinstance(found, RefusedWindow):
                self.diagnostics.fault(
                    f"window at {found.start_ns * 1e-9:.3f} s gives no depth: {found.reason}"
                )
            else:
                self._publish(found, pinhole(pipeline.camera))

    def figures(self, pipeline: DepthPipeline) -> Mapping[str, object]:
        """Windows and their times."""
        counts = pipeline.counts
        return {
            "windows": counts.windows,
            "refused_windows": counts.refused_windows,
            "window_ms_median": percentile(self._window_ms, 50),
            "window_ms_p95": percentile(self._window_ms, 95),
            "window_latency_s": round(self._latency_s, 4),
        }

    def _publish(self, found: DepthMap, camera: Camera) -> None:
        t, frame = found.stamp_ns, self.parameters.sensor_frame
        self._info.publish(messages.camera_info(camera, t, frame))
        self._confidence.publish(messages.image(found.confidence, t, frame))
        self._image.publish(messages.image(found.depth, t, frame))
        self._window_ms.append(found.milliseconds.get("total", 0.0))
        self._latency_s = (self.get_clock().now().nanoseconds - found.end_ns) * 1e-9


def main() -> None:
    """Run the node."""
    sys.exit(run_node(EmvsNode))

"""Node `braille`: event packets and poses in, Braille cells and text out."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from roller_msgs.msg import BrailleCell
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from roller_core.camera import Camera
from roller_core.pose_track import PoseTrack
from roller_ros import qos
from roller_ros.frames_settings import smoothing_field
from roller_ros.node_main import run_node
from roller_ros.stream_node import StreamNode, StreamParameters, percentile

from .cells import Cell
from .messages import cell_markers, cell_message, text_message
from .pipeline import BraillePipeline
from .reader_settings import POSE_SMOOTHING, BrailleSettings
from .warp import warm_up


class BrailleParameters(BrailleSettings, StreamParameters):
    """Parameters of the node: the reader's settings and the graph's."""

    pose_smoothing: int = smoothing_field(POSE_SMOOTHING)


class BrailleNode(StreamNode[BraillePipeline]):
    """Publishes the cells and the text of `BraillePipeline`."""

    def __init__(self) -> None:
        super().__init__("braille", "text", BrailleParameters)
        self._settings = BrailleSettings.create(
            {name: getattr(self.parameters, name) for name in BrailleSettings.model_fields}
        )
        self._latency_s = 0.0
        #: Text of pipelines before a restart, and all markers.
        self._earlier: list[str] = []
        self._text: list[str] = []
        self._markers: list[Marker] = []
        self._cells = self.create_publisher(BrailleCell, "/roller/braille/cells", qos.BRAILLE)
        self._texts = self.create_publisher(String, "/roller/braille/text", qos.BRAILLE)
        self._shown = self.create_publisher(MarkerArray, "/roller/braille/markers", qos.MARKERS)
        # Loading kernels takes a second, which would come with the first camera_info.
        warm_up()
        self.listen()

    def make_pipeline(self, camera: Camera, track: PoseTrack) -> BraillePipeline:
        """Begin with a camera, or begin anew; text read before stays."""
        self._earlier = list(self._text)
        return BraillePipeline(self._settings, camera, track)

    def publish_results(self, pipeline: BraillePipeline, flush: bool) -> None:
        """Publish cells, and with them the text so far and all markers."""
        cells = list(pipeline.results(flush))
        for cell in cells:
            self._publish(cell)
        if cells:
            self._text = [*self._earlier, *pipeline.text()]
            self._texts.publish(text_message(self._text))
            self._shown.publish(MarkerArray(markers=self._markers))
            now = self.get_clock().now().nanoseconds
            self._latency_s = (now - cells[-1].stamp_ns) * 1e-9
        for reason in pipeline.refusals:
            self.fault(reason)
        pipeline.refusals.clear()

    def figures(self, pipeline: BraillePipeline) -> Mapping[str, object]:
        """Frames, cells and their times."""
        counts = pipeline.counts
        recent = list(pipeline.milliseconds)[-1000:]
        return {
            "still_events": counts.still_events,
            "frames": counts.frames,
            "refused_frames": counts.refused_frames,
            "frame_ms_median": percentile(recent, 50),
            "frame_ms_p95": percentile(recent, 95),
            "cells": counts.cells,
            "unreadable_cells": counts.unreadable_cells,
            "repeated_cells": counts.repeated_cells,
            "cell_latency_s": round(self._latency_s, 4),
            "way_scale": "" if pipeline.way_scale is None else round(pipeline.way_scale, 4),
        }

    def _publish(self, cell: Cell) -> None:
        frame = self.parameters.base_frame
        self._cells.publish(cell_message(cell, frame, len(self._earlier)))
        number = len(self._markers) // 2
        self._markers += cell_markers(cell, number, frame, self._settings.spacing)


def main() -> None:
    """Run the node."""
    sys.exit(run_node(BrailleNode))

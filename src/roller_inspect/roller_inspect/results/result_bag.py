"""The /roller topics of a run as a rosbag2 (MCAP)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message
from visualization_msgs.msg import MarkerArray

from roller_braille.cells import Cell
from roller_braille.messages import cell_markers, cell_message, text_message
from roller_braille.reader_settings import Spacing
from roller_core.bag_writer import BagWriter
from roller_core.bags import bag_qos
from roller_core.camera import Camera
from roller_emvs.depth_map import DepthMap, pinhole
from roller_emvs.messages import surface_message
from roller_emvs.patch import Patch
from roller_ros import messages

_TYPES = {
    "/roller/depth/image": "sensor_msgs/msg/Image",
    "/roller/depth/confidence": "sensor_msgs/msg/Image",
    "/roller/depth/camera_info": "sensor_msgs/msg/CameraInfo",
    "/roller/surface/points": "sensor_msgs/msg/PointCloud2",
    "/roller/braille/cells": "roller_msgs/msg/BrailleCell",
    "/roller/braille/text": "std_msgs/msg/String",
    "/roller/braille/markers": "visualization_msgs/msg/MarkerArray",
}
_LATCHED = {"/roller/surface/points", "/roller/braille/markers"}


class ResultBag:
    """Writes results as the nodes would publish them.

    Parameters
    ----------
    path : path
        Bag folder to make.
    camera : Camera
        Of the depth maps.
    sensor_frame, base_frame : str
        Frames of depth images and of the surface.
    spacing : Spacing
        Sizes of Braille, for the markers.

    Raises
    ------
    UnwritableOutputError
        If it can't be written.
    """

    def __init__(
        self, path: Path, camera: Camera, sensor_frame: str, base_frame: str, spacing: Spacing
    ) -> None:
        self._camera = pinhole(camera)
        self._sensor_frame = sensor_frame
        self._base_frame = base_frame
        self._spacing = spacing
        self._cells = 0
        # Depth images are mostly NaN: a tenth of their size when compressed.
        self._writer = BagWriter(
            path,
            {
                topic: (kind, bag_qos(50, reliable=True, latched=topic in _LATCHED))
                for topic, kind in _TYPES.items()
            },
            compress=True,
        )
        self._writer.declare_all()

    def write_depth(self, found: DepthMap) -> None:
        """Depth image, confidence and camera_info at the window's reference time."""
        t, frame = found.stamp_ns, self._sensor_frame
        self._put("/roller/depth/image", t, messages.image(found.depth, t, frame))
        self._put("/roller/depth/confidence", t, messages.image(found.confidence, t, frame))
        self._put("/roller/depth/camera_info", t, messages.camera_info(self._camera, t, frame))

    def write_patch(self, patch: Patch, t_ns: int) -> None:
        """Points of the surface; an empty patch is passed over."""
        if len(patch):
            cloud = surface_message(patch, t_ns, self._base_frame)
            self._put("/roller/surface/points", t_ns, cloud)

    def write_cell(self, cell: Cell, lines: list[str]) -> None:
        """A Braille cell, the text so far and the cell's markers."""
        t = cell.stamp_ns
        self._put("/roller/braille/cells", t, cell_message(cell, self._base_frame))
        self._put("/roller/braille/text", t, text_message(lines))
        self._cells += 1
        markers = cell_markers(cell, self._cells, self._base_frame, self._spacing)
        self._put("/roller/braille/markers", t, MarkerArray(markers=markers))

    def close(self) -> None:
        """Finish the bag.

        Raises
        ------
        BagFullError
            If the disk doesn't take its end; what was written before is readable.
        """
        self._writer.flush()
        self._writer.close()

    def _put(self, topic: str, t_ns: int, message: Any) -> None:
        self._writer.write(topic, int(np.int64(t_ns)), serialize_message(message))

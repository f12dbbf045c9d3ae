"""Node `stitcher`: depth maps and poses in, patches of the surface out."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from tf2_msgs.msg import TFMessage

from roller_core.errors import RollerError
from roller_core.pose_track import PoseError, PoseExtrapolationError, PoseOrderError
from roller_core.sensor_pose import SensorFrames
from roller_ros import diagnostics, messages, qos
from roller_ros.frames_settings import FollowedFrames
from roller_ros.node_main import run_node
from roller_ros.parameters import declare_settings
from roller_ros.tf import PoseSources, take_transforms
from roller_ros.worker import Worker

from .depth_map import DepthMap
from .depth_settings import StitcherSettings
from .messages import surface_message
from .patch import Patch
from .stitcher import Stitcher

_MOST_PENDING = 100


class StitcherParameters(StitcherSettings, FollowedFrames):
    """Parameters of the node: the stitcher's settings and the graph's frames."""

    max_pose_gap_s: float = Field(
        0.1, ge=0.001, le=10.0, description="Longest time between two poses to interpolate over, s."
    )
    idle_flush_s: float = Field(
        1.5,
        ge=0.05,
        le=60.0,
        description="Without depth maps for this long what is in view is published too, s.",
    )


@dataclass
class _Parts:
    """Messages of one depth map, which come one by one."""

    image: Image | None = None
    confidence: Image | None = None

    @property
    def complete(self) -> bool:
        return self.image is not None and self.confidence is not None


Item = tuple[str, Image | CameraInfo | TFMessage]


class StitcherNode(Node):
    """Translates messages into calls of `Stitcher` and its patches into messages."""

    def __init__(self) -> None:
        super().__init__("stitcher")
        p = declare_settings(self, StitcherParameters)
        self._parameters = p
        self._settings = StitcherSettings.create(
            {name: getattr(p, name) for name in StitcherSettings.model_fields}
        )
        self._frames = SensorFrames(
            p.base_frame, p.moving_frame, p.sensor_frame, p.max_pose_gap_s, p.pose_smoothing
        )
        self._stitcher: Stitcher | None = None
        self._pending: dict[int, _Parts] = {}
        self._last_ns = 0
        self._maps = self._points = self._faults = self._left_out = 0
        self._sources = PoseSources(p.base_frame, p.moving_frame)
        self._meter = diagnostics.Meter()
        self._publisher = self.create_publisher(PointCloud2, "/roller/surface/points", qos.SURFACE)
        self._diagnostics = diagnostics.Diagnostics(self, "surface", self._status)
        self._worker: Worker[Item] = Worker(self._handle, self._flush, p.idle_flush_s, 5000)
        for name, kind, topic, quality in (
            ("info", CameraInfo, "/roller/depth/camera_info", qos.DEPTH),
            ("confidence", Image, "/roller/depth/confidence", qos.DEPTH),
            ("image", Image, "/roller/depth/image", qos.DEPTH),
            ("static", TFMessage, "/tf_static", qos.TF_STATIC),
        ):
            awake = kind is not TFMessage
            self.create_subscription(
                kind,
                topic,
                lambda m, name=name, awake=awake: self._worker.submit((name, m), awake),
                quality,
            )

        self.create_subscription(TFMessage, "/tf", self._take_tf, qos.EVERY_TF)

    def _take_tf(self, message: TFMessage, info: Mapping[str, Any]) -> None:
        if self._sources.accepts(message, info):
            self._worker.submit(("tf", message), False)

    def destroy_node(self) -> None:
        """Stop the worker first: it publishes."""
        if hasattr(self, "_worker"):  # else the node gave up before it had one
            self._worker.stop()
        super().destroy_node()

    def _handle(self, item: Item) -> None:
        name, message = item
        try:
            if isinstance(message, TFMessage):
                take_transforms(self._frames, message, name == "static", self._pose_fault)
            elif isinstance(message, CameraInfo):
                camera = messages.camera_from_info(message)
                if self._stitcher is None or self._stitcher.camera != camera:
                    self._stitcher = Stitcher(self._settings, camera)
            else:
                stamp = messages.to_ns(message.header.stamp)
                setattr(self._pending.setdefault(stamp, _Parts()), name, message)
            self._stitch()
        except (RollerError, ValueError) as error:
            self._faults += 1
            self._diagnostics.fault(str(error))

    def _pose_fault(self, error: RollerError) -> None:
        self._faults += 1
        self._diagnostics.fault(str(error))
        if isinstance(error, PoseOrderError) and error.behind_s > 1.0:
            self._flush()
            self._frames.restart()
            self._pending.clear()

    def _stitch(self) -> None:
        """Stitch what is complete and whose pose is known, in order of time."""
        while self._stitcher is not None and self._pending and len(self._frames.track):
            stamp = min(self._pending)
            parts = self._pending[stamp]
            over = len(self._pending) > _MOST_PENDING
            if not parts.complete and not over:
                return
            try:
                pose = self._frames.track.at(stamp).matrix
            except PoseExtrapolationError:
                if stamp > self._frames.track.end_ns and not over:
                    return  # the pose is still to come
                pose = None
            except PoseError:
                pose = None
            del self._pending[stamp]
            if pose is None or parts.image is None or parts.confidence is None:
                self._left_out += 1
                continue
            self._add(self._stitcher, stamp, parts.image, parts.confidence, pose)
            self._frames.track.discard_before(stamp)

    def _add(
        self, stitcher: Stitcher, stamp: int, image: Image, confidence: Image, pose: np.ndarray
    ) -> None:
        depth = messages.image_to_array(image).astype(np.float32, copy=False)
        sure = messages.image_to_array(confidence).astype(np.float32, copy=False)
        expected = (stitcher.camera.height, stitcher.camera.width)
        if depth.shape != expected or sure.shape != expected:
            raise ValueError(
                f"depth image of {depth.shape} px but camera_info of {expected}; are two depth "
                "nodes publishing?"
            )
        self._last_ns = stamp
        self._maps += 1
        self._publish(stitcher.add(DepthMap(stamp, depth, sure, pose, stamp, stamp, 0)))

    def _flush(self) -> None:
        self._frames.finish()
        self._stitch()
        if self._stitcher is not None:
            self._publish(self._stitcher.finish())

    def _publish(self, patch: Patch) -> None:
        if not len(patch):
            return
        self._points += len(patch)
        self._publisher.publish(surface_message(patch, self._last_ns, self._parameters.base_frame))

    def _status(self) -> tuple[bytes, str, Mapping[str, object]]:
        stitcher, frames = self._stitcher, self._frames.counts
        found = stitcher.last_refinement if stitcher is not None else None
        rates = self._meter.rates(maps=self._maps, poses=frames.poses)
        level, message = diagnostics.OK, "running"
        conflict = self._sources.conflict(self)
        if conflict:
            level, message = diagnostics.ERROR, conflict
        elif stitcher is None:
            message = "waiting for depth maps"
        elif self._worker.dropped or self._left_out:
            level, message = diagnostics.WARN, "depth maps were left out"
        return (
            level,
            message,
            {
                "depth_map_rate_hz": rates["maps"],
                "pose_rate_hz": rates["poses"],
                "depth_maps": self._maps,
                "left_out": self._left_out,
                "points": self._points,
                "voxels_in_view": len(stitcher.voxels) if stitcher is not None else 0,
                "waiting_maps": len(self._pending),
                "waiting_messages": self._worker.waiting,
                "dropped_messages": self._worker.dropped,
                **diagnostics.pose_figures(frames),
                "foreign_poses": self._sources.foreign,
                "icp_tried": stitcher.icp_tried if stitcher is not None else 0,
                "icp_accepted": stitcher.icp_accepted if stitcher is not None else 0,
                "icp_last": (found.reason or "accepted") if found else "",
                "faults": self._faults,
            },
        )


def main() -> None:
    """Run the node."""
    sys.exit(run_node(StitcherNode))

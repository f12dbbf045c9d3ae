"""A running graph as a scene: what waits is taken now and then, the newest of it counts."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from roller_msgs.msg import FindingArray
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from roller_core import outputs
from roller_core.frame_names import BASE_FRAME, TOOL_FRAME
from roller_core.last_resort import ends_within
from roller_core.serialized_cloud import SerializedCloud
from roller_ros import qos
from roller_ros.dds_profile import sharing_less
from roller_ros.images import image_to_array
from roller_ros.polling import subscribe_quietly, waiting
from roller_ros.refusals import init_ros

from . import health
from .clouds import clouds_of, columns_of
from .findings import plain_finding
from .grid import CONTINUED, MEASURED
from .scene import Scene

#: Between two looks at what has come, s. Often enough for a page, and an executor that wakes for
#: each pose would take a tenth of a core.
_PERIOD_S = 0.15
#: Poses this far apart give the speed, s.
_SPEED_OVER_S = 0.08
#: Without poses for so long nobody knows the speed, s.
_POSES_GONE_S = 1.0
#: Without results for so long there is no lag to tell of, s.
_RESULTS_GONE_S = 2.0
#: A stamp older than this is of a recording: no lag can be told from it, s.
_MOST_LAG_S = 30.0
#: The list of findings is read again after this many times what reading it took: it is sent whole
#: with every strip, and hundreds of findings would take half a core.
_LIST_PAUSE = 30.0
#: Messages of a topic that are taken at once, for little memory, and how often in one look: after a
#: jam the rest waits for the next.
_AT_ONCE, _PORTIONS = 3, 7
#: Columns of a cloud that the map needs.
_NEEDED = ("x", "y", "height")
_NEEDED_OF_DEVIATION = ("x", "y", "deviation", "state")
#: Only the newest message of these topics is read.
_LATEST = QoSProfile(depth=1, reliability=qos.PREVIEW.reliability)


class Graph:
    """Subscribes to a graph and fills a scene; a context manager."""

    def __init__(self, scene: Scene, namespace: str = "") -> None:
        self._scene = scene
        self._cell = namespace.strip("/")
        self._other_cells: set[str] = set()
        self._context = Context()
        with sharing_less():
            init_ros(context=self._context)
            self._node = Node(
                "view",
                namespace=namespace,
                context=self._context,
                start_parameter_services=False,
                enable_rosout=False,
            )
        self._map_points = 0.0
        self._tool = TOOL_FRAME
        self._pose: tuple[int, Any] | None = None
        self._pose_seen_s = self._lag_seen_s = 0.0
        self._stamp_ns = 0
        self._ended = False
        self._not_shown: set[str] = set()
        self._list: bytes | None = None
        self._list_due_s = 0.0
        self._subscriptions: dict[str, tuple[Any, Callable[[list[bytes]], None]]] = {}
        # The latched map first: it holds what is there when we come.
        self._subscribe(outputs.SURFACE_MAP, PointCloud2, qos.LATCHED, self._take_map)
        self._subscribe(outputs.SURFACE_POINTS, PointCloud2, qos.SURFACE, self._take_points)
        self._subscribe(outputs.DEPTH_IMAGE, Image, _LATEST, self._take_depth)
        self._subscribe(outputs.BRAILLE_TEXT, String, qos.TEXT, self._take_text)
        self._subscribe(outputs.TF, TFMessage, QoSProfile(depth=5), self._take_tf)
        self._subscribe(outputs.FINDINGS, FindingArray, qos.LATCHED, self._take_findings)
        self._subscribe(outputs.DEVIATION, PointCloud2, qos.SURFACE, self._take_deviation)
        self._subscribe(outputs.WRENCH, WrenchStamped, _LATEST, self._take_wrench)
        self._subscribe(
            outputs.DIAGNOSTICS, DiagnosticArray, QoSProfile(depth=200), self._take_statuses
        )
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Graph:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        with ends_within(5, 0):  # other nodes leave too, see `RollerNode`
            self._node.destroy_node()
            self._context.try_shutdown()

    def _subscribe(
        self, name: str, kind: Any, quality: QoSProfile, take: Callable[[list[bytes]], None]
    ) -> None:
        subscription = subscribe_quietly(self._node, kind, name, quality, raw=True)
        self._subscriptions[name] = (subscription, take)

    def _run(self) -> None:
        while not self._stop.wait(_PERIOD_S):
            for subscription, take in list(self._subscriptions.values()):
                for _ in range(_PORTIONS):
                    if not (found := _take_some(subscription)):
                        break
                    with self._scene.lock, self._left_out(subscription.topic_name):
                        take(found)
            with self._left_out(outputs.FINDINGS):
                self._read_list()
            if time.monotonic() - self._lag_seen_s > _RESULTS_GONE_S:
                self._scene.lag_s = None
            if time.monotonic() - self._pose_seen_s > _POSES_GONE_S:
                self._scene.speed_m_s = self._scene.force_n = self._pose = None
            if not self._ended and self._scene.stopped(time.monotonic()):
                self._ended = not self._node.count_publishers(outputs.DIAGNOSTICS)

    @contextmanager
    def _left_out(self, topic: str) -> Iterator[None]:
        """Leave out what can't be shown, whatever is wrong with it; the others go on."""
        try:
            yield
        except Exception as error:
            if topic not in self._not_shown:
                self._not_shown.add(topic)
                what = f"{type(error).__name__}: {error}"
                print(f"warning: messages of {topic} can't be shown ({what})", file=sys.stderr)

    def _take_map(self, found: list[bytes]) -> None:
        """Take the map as it was when we came; afterwards the points themselves are enough."""
        if clouds := clouds_of(found[-1:], _NEEDED):
            self._add(clouds)
        subscription, _ = self._subscriptions.pop(outputs.SURFACE_MAP)
        self._node.destroy_subscription(subscription)

    def _take_points(self, found: list[bytes]) -> None:
        """Take what came since the last look at once: it costs little more than one cloud."""
        clouds: list[SerializedCloud] = []
        for cloud in clouds_of(found, _NEEDED):
            if cloud.stamp_ns < self._stamp_ns - 1_000_000_000:
                self._scene.clear_map()  # the source restarted
                clouds.clear()
            self._stamp_ns = cloud.stamp_ns
            # Two cells share /tf: the robot is the one whose base the points are in.
            self._tool = cloud.frame_id.removesuffix(BASE_FRAME) + TOOL_FRAME
            clouds.append(cloud)
        if clouds:
            self._add(clouds)
            head = clouds[-1].cloud.columns[:, :2].mean(axis=0, dtype=float)
            self._scene.head = tuple(head.tolist()) if np.isfinite(head).all() else None
            self._take_lag(self._stamp_ns)

    def _add(self, clouds: Sequence[SerializedCloud]) -> None:
        x, y, height = columns_of(clouds, _NEEDED)
        self._scene.grid.add(x.astype(np.float64), y.astype(np.float64), {"height": height})

    def _take_deviation(self, found: list[bytes]) -> None:
        if not (clouds := clouds_of(found, _NEEDED_OF_DEVIATION)):
            return
        x, y, deviation, state = columns_of(clouds, _NEEDED_OF_DEVIATION)
        states = np.where(state == MEASURED, MEASURED, CONTINUED).astype(np.uint8)
        # What was looked at is said by the points.
        self._scene.grid.add(
            x.astype(np.float64), y.astype(np.float64), {"deviation": deviation}, states,
            looked_at=False,
        )  # fmt: skip

    def _take_findings(self, found: list[bytes]) -> None:
        """Keep the list as it came, until it is time to read it."""
        self._list = found[-1]

    def _read_list(self) -> None:
        begin_s = time.monotonic()
        if self._list is None or begin_s < self._list_due_s:
            return
        with self._scene.lock:
            self._show_list(deserialize_message(self._list, FindingArray))
        self._list = None
        end_s = time.monotonic()
        self._list_due_s = end_s + _LIST_PAUSE * (end_s - begin_s)

    def _show_list(self, message: Any) -> None:
        self._scene.take_findings([plain_finding(item) for item in message.findings])
        shares = (message.measured, message.continued, message.unmeasured)
        names = ("measured", "continued", "unmeasured")
        known = np.isfinite(shares).all()
        self._scene.coverage = dict(zip(names, map(float, shares), strict=True)) if known else None
        so_far = "verdict" if message.finished else "verdict so far"
        facts = {"part": message.part, so_far: message.verdict, "because": message.reason}
        self._scene.facts = {name: text for name, text in facts.items() if text}

    def _take_depth(self, found: list[bytes]) -> None:
        """Keep the image as it came: it is only read when a browser asks for it."""
        data = found[-1]
        self._scene.take_depth(
            lambda: image_to_array(deserialize_message(data, Image)).astype(np.float32, copy=False)
        )

    def _take_lag(self, stamp_ns: int) -> None:
        lag_s = (time.time_ns() - stamp_ns) * 1e-9
        self._scene.lag_s = lag_s if 0.0 <= lag_s < _MOST_LAG_S else None
        self._lag_seen_s = time.monotonic()

    def _take_text(self, found: list[bytes]) -> None:
        self._scene.take_text(deserialize_message(found[-1], String).data)

    def _take_tf(self, found: list[bytes]) -> None:
        for data in found:
            for transform in deserialize_message(data, TFMessage).transforms:
                if transform.child_frame_id == self._tool:
                    self._take_pose(transform)

    def _take_pose(self, transform: Any) -> None:
        self._pose_seen_s = time.monotonic()
        stamp_ns = outputs.stamp_ns(transform)
        t = transform.transform.translation
        place = np.array([t.x, t.y, t.z])
        if not np.isfinite(place).all():
            return
        before_ns, before = self._pose or (stamp_ns, place)
        passed_s = (stamp_ns - before_ns) * 1e-9
        if passed_s > _SPEED_OVER_S:
            self._scene.speed_m_s = float(np.linalg.norm(place - before)) / passed_s
        if self._pose is None or passed_s > _SPEED_OVER_S or passed_s < 0:
            self._pose = (stamp_ns, place)

    def _take_wrench(self, found: list[bytes]) -> None:
        force = deserialize_message(found[-1], WrenchStamped).wrench.force
        force_n = float(np.linalg.norm([force.x, force.y, force.z]))
        if np.isfinite(force_n):  # JSON, and so the page, knows no other numbers
            self._scene.force_n = force_n

    def _take_statuses(self, found: list[bytes]) -> None:
        for data in found:
            for status in deserialize_message(data, DiagnosticArray).status:
                cell = status.name.partition(":")[0].rpartition("/")[0]
                if cell == self._cell:
                    self._take_status(status)
                elif cell not in self._other_cells:
                    self._other_cells.add(cell)
                    shown = f"that in {self._cell}" if self._cell else "that without a namespace"
                    other = f"--namespace {cell}" if cell else "no --namespace"
                    print(f"{other} shows another cell; shown is {shown}", file=sys.stderr)

    def _take_status(self, status: Any) -> None:
        if self._ended:  # another graph begins
            self._ended, self._stamp_ns, self._map_points = False, 0, 0.0
            self._list = None
            self._scene.restart()
        node = self._scene.nodes.setdefault(status.name, health.Node(status.name))
        node.level, node.message = status.level[0], status.message
        node.seen_s = time.monotonic()
        if status.values:
            node.values = {item.key: item.value for item in status.values}
            self._see_whether_cleared(node)

    def _see_whether_cleared(self, node: health.Node) -> None:
        """Begin anew with a node that forgot its map: a service asked it to."""
        points = health.number([node], "map_points")
        if points is None:
            return
        # Larger voxels take three quarters of the points, no more.
        if points < self._map_points / 8:
            self._scene.clear_map()
        self._map_points = points


def _take_some(subscription: Any) -> list[bytes]:
    """What waits, the oldest first."""
    return [data for data, _ in islice(waiting(subscription, raw=True), _AT_ONCE)]

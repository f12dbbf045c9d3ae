"""Bags of an analytic scan, whole or with something missing or wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from emvs.scenes import CAMERA, events_of, lines, rolling, tilted, track_of
from roller_core.bags import EVENT_ARRAY, EVENT_PACKET, typestore
from roller_core.camera import Camera
from roller_core.codecs import encode
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_recording.raw_message import RawMessage
from roller_ros import topics

#: Type and offered quality of service of our topics.
KINDS = {t.path: (t.type_name, topics.offered(t)) for t in topics.ALL}
START_NS = 1_700_000_000_000_000_000
SENSOR_START_NS = 5_000_000_000
DURATION_S = 0.08
SPEED = 0.3
#: Camera in tool0_controller: turned about z, moved.
HAND_EYE_POSITION = (0.02, -0.01, 0.05)
HAND_EYE_ROTATION = (0.0, 0.0, float(np.sin(0.2)), float(np.cos(0.2)))


@cache
def scan() -> EventArray:
    """Events in sensor time; a tilted plane with lines rolls by."""
    return events_of(lines(tilted), rolling(SPEED), DURATION_S, SENSOR_START_NS)


def camera_track() -> PoseTrack:
    """Camera in base, ROS time."""
    return track_of(rolling(SPEED), DURATION_S, START_NS)


@dataclass
class Recipe:
    """What a bag holds, and what is wrong with it.

    Attributes
    ----------
    edit : callable
        Takes (topic, number of the message on it, message) and returns the message to write,
        or None to leave it out.
    """

    encoding: str = "libcaer_cmp"
    storage: StoragePlugin = StoragePlugin.MCAP
    event_type: str = EVENT_PACKET
    camera: Camera | None = CAMERA
    tf: bool = True
    tf_static: bool = True
    namespace: str = "/event_camera"
    compression: CompressionMode = CompressionMode.NONE
    edit: Callable[[str, int, Any], Any] = field(default=lambda topic, n, message: message)


def bag_messages(recipe: Recipe) -> Iterator[tuple[int, str, str, bytes]]:
    """Log time, topic, type and CDR of all messages, in order of time."""
    store = typestore()
    items: list[tuple[int, str, str, Any]] = []
    if recipe.camera is not None:
        items.append((START_NS - 3, *_camera_info(store, recipe.camera)))
    if recipe.tf_static:
        items.append((START_NS - 2, *_static(store)))
    if recipe.tf:
        items += _poses(store)
    items += _packets(store, recipe)
    items.sort(key=lambda item: item[0])
    counts: dict[str, int] = {}
    for t_ns, topic, kind, message in items:
        n = counts[topic] = counts.get(topic, -1) + 1
        edited = recipe.edit(topic, n, message)
        if edited is not None:
            name = topic.replace("/event_camera", recipe.namespace)
            yield t_ns, name, kind, bytes(store.serialize_cdr(edited, kind))


def raw_messages(recipe: Recipe) -> list[RawMessage]:
    """The same as a recorder takes them."""
    return [RawMessage(t_ns, topic, data) for t_ns, topic, _, data in bag_messages(recipe)]


def write_bag(path: Path, recipe: Recipe | None = None) -> Path:
    """Write a rosbag2 as the recipe says."""
    recipe = recipe or Recipe()
    writer = Writer(path, version=9, storage_plugin=recipe.storage)
    writer.set_compression(recipe.compression, CompressionFormat.ZSTD)
    write_messages(writer, bag_messages(recipe))
    return path


def write_messages(writer: Writer, messages: Iterable[tuple[int, str, str, bytes]]) -> None:
    """Write messages to a bag that isn't open yet."""
    store, connections = typestore(), {}
    with writer:
        for t_ns, topic, kind, data in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], t_ns, data)


def _header(store: Any, t_ns: int, frame: str) -> Any:
    stamp = store.types["builtin_interfaces/msg/Time"](t_ns // 10**9, t_ns % 10**9)
    return store.types["std_msgs/msg/Header"](stamp, frame)


def _camera_info(store: Any, camera: Camera) -> tuple[str, str, Any]:
    kind = "sensor_msgs/msg/CameraInfo"
    roi = store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    message = store.types[kind](
        header=_header(store, START_NS, "event_camera_optical_frame"),
        height=camera.height,
        width=camera.width,
        distortion_model=camera.model,
        d=np.array(camera.distortion),
        k=camera.K.ravel(),
        r=np.eye(3).ravel(),
        p=np.hstack([camera.K, np.zeros((3, 1))]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=roi,
    )
    return "/event_camera/camera_info", kind, message


def _transform(store: Any, t_ns: int, parent: str, child: str, p: Any, q: Any) -> Any:
    types = store.types
    transform = types["geometry_msgs/msg/Transform"](
        types["geometry_msgs/msg/Vector3"](*map(float, p)),
        types["geometry_msgs/msg/Quaternion"](*map(float, q)),
    )
    stamped = types["geometry_msgs/msg/TransformStamped"](
        _header(store, t_ns, parent), child, transform
    )
    return types["tf2_msgs/msg/TFMessage"]([stamped])


def _static(store: Any) -> tuple[str, str, Any]:
    message = _transform(
        store, START_NS, "tool0_controller", "event_camera_optical_frame",
        HAND_EYE_POSITION, HAND_EYE_ROTATION,
    )  # fmt: skip
    return "/tf_static", "tf2_msgs/msg/TFMessage", message


def _poses(store: Any) -> list[tuple[int, str, str, Any]]:
    from roller_core.transforms import inverse_pose, pose_matrix

    tool_from_camera = inverse_pose(pose_matrix(HAND_EYE_POSITION, HAND_EYE_ROTATION))
    tool = camera_track().transformed(tool_from_camera)
    out = []
    for t, p, q in zip(tool.times_ns, tool.positions, tool.quaternions, strict=True):
        message = _transform(store, int(t), "base", "tool0_controller", p, q)
        out.append((int(t) + 1_500_000, "/tf", "tf2_msgs/msg/TFMessage", message))
    return out


def _packets(store: Any, recipe: Recipe) -> list[tuple[int, str, str, Any]]:
    events, out = scan(), []
    span = 1_000_000
    first = SENSOR_START_NS
    for seq in range(round(DURATION_S * 1e9) // span):
        base = first + seq * span
        a, b = np.searchsorted(events.t_ns, [base, base + span])
        # Arrival of the first event; sensor and ROS time differ by a constant.
        stamp = START_NS + int(events.t_ns[a]) - SENSOR_START_NS
        message = store.types[recipe.event_type](
            header=_header(store, stamp, "event_camera_optical_frame"),
            height=CAMERA.height,
            width=CAMERA.width,
            seq=seq,
            time_base=base,
            encoding=recipe.encoding,
            is_bigendian=False,
            events=encode(recipe.encoding, events[a:b], base),
        )
        out.append((stamp + span, "/event_camera/events", recipe.event_type, message))
    return out


__all__ = [
    "CAMERA",
    "EVENT_ARRAY",
    "EVENT_PACKET",
    "KINDS",
    "Recipe",
    "bag_messages",
    "camera_track",
    "raw_messages",
    "scan",
    "write_bag",
    "write_messages",
]

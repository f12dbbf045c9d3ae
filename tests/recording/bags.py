"""Bags of an analytic scan, whole or with something missing or wrong."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer

from emvs.scenes import CAMERA, events_of, lines, rolling, tilted, track_of
from roller_core.bags import EVENT_ARRAY, EVENT_PACKET, typestore
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.frame_names import BASE_FRAME, CAMERA_FRAME, TOOL_FRAME
from roller_core.pose_track import PoseTrack
from roller_core.transforms import inverse_pose, matrix_to_quaternion, pose_matrix
from roller_recording.raw_message import RawMessage
from roller_recording.reading import open_recording
from roller_ros import topics
from roller_sim.bag import BagMessages
from roller_sim.cell import Packet

#: Type and offered quality of service of our topics.
KINDS = {t.path: (t.type_name, topics.offered(t)) for t in topics.ALL}
CAMERA_INFO, TF_MESSAGE = "sensor_msgs/msg/CameraInfo", "tf2_msgs/msg/TFMessage"
WRENCH = "geometry_msgs/msg/WrenchStamped"
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
    force_n: float | None = None
    compression: CompressionMode = CompressionMode.NONE
    edit: Callable[[str, int, Any], Any] = field(default=lambda topic, n, message: message)


def bag_messages(recipe: Recipe) -> Iterator[tuple[int, str, str, bytes]]:
    """Log time, topic, type and CDR of all messages, in order of time."""
    make = BagMessages(recipe.camera or CAMERA)
    items: list[tuple[int, str, str, Any]] = []
    if recipe.camera is not None:
        info = make.camera_info(START_NS)
        items.append((START_NS - 3, "/event_camera/camera_info", CAMERA_INFO, info))
    if recipe.tf_static:
        fixed = make.transform(
            START_NS, TOOL_FRAME, CAMERA_FRAME, HAND_EYE_POSITION, HAND_EYE_ROTATION
        )
        items.append((START_NS - 2, "/tf_static", TF_MESSAGE, fixed))
    if recipe.tf:
        items += _poses(make)
    items += _packets(make, recipe)
    if recipe.force_n is not None:
        force, none = (
            make.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=z)
            for z in (-recipe.force_n, 0.0)
        )
        for t_ns in range(START_NS, START_NS + int(DURATION_S * 1e9), 8_000_000):
            wrench = make.make("geometry_msgs/msg/Wrench", force=force, torque=none)
            stamped = make.make(WRENCH, header=make.header(t_ns, BASE_FRAME), wrench=wrench)
            items.append((t_ns, "/roller/robot/wrench", WRENCH, stamped))
    items.sort(key=lambda item: item[0])
    counts: dict[str, int] = {}
    for t_ns, topic, kind, message in items:
        n = counts[topic] = counts.get(topic, -1) + 1
        edited = recipe.edit(topic, n, message)
        if edited is not None:
            name = topic.replace("/event_camera", recipe.namespace)
            yield t_ns, name, kind, bytes(make.store.serialize_cdr(edited, kind))


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


def read_messages(bag: Path, topic: str) -> Iterator[tuple[int, Any]]:
    """Log times and messages of a topic."""
    store = typestore()
    with Reader(bag) as reader:
        for connection, log_ns, data in reader.messages():
            if connection.topic == topic:
                yield log_ns, store.deserialize_cdr(data, connection.msgtype)


def read(path: Path, **options: Any) -> EventArray:
    """What a replay of a bag gets; nothing may be wrong with it."""
    recording = open_recording(path, **options)
    parts = []
    for step in recording.steps():
        assert step.faults == ()
        parts.append(step.events)
    assert recording.counts.lost_packets == 0
    assert len(recording.track) > 0
    return EventArray.concatenate(parts)


def events_in(path: Path, **options: Any) -> int:
    """How many events that are."""
    return len(read(path, **options))


def write_tum(track: PoseTrack, path: Path) -> None:
    """Write lines `t x y z qx qy qz qw`, seconds and metres."""
    with path.open("w") as file:
        for t, p, q in zip(track.times_ns, track.positions, track.quaternions, strict=True):
            values = " ".join(f"{v:.12g}" for v in (*p, *q))
            file.write(f"{int(t) // 10**9}.{int(t) % 10**9:09d} {values}\n")


def write_dataset(folder: Path, events: EventArray, track: PoseTrack, camera: Camera) -> Path:
    """Write a folder of the public event-camera dataset; both begin at zero there."""
    folder.mkdir()
    columns = (events.t_ns * 1e-9, events.x, events.y, events.p)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    # Three times as fast as `np.savetxt`.
    (folder / "events.txt").write_text("".join(map("%.9f %d %d %d\n".__mod__, rows)))
    write_tum(track, folder / "groundtruth.txt")
    c = camera
    (folder / "calib.txt").write_text(f"{c.fx} {c.fy} {c.cx} {c.cy} 0 0 0 0 0\n")
    return folder


def analytic_dataset(folder: Path, most: int | None = None) -> Path:
    """The scan, or its first events, as such a folder."""
    track = track_of(rolling(SPEED), DURATION_S)
    return write_dataset(folder, scan()[:most].shifted(-SENSOR_START_NS), track, CAMERA)


def _poses(make: BagMessages) -> list[tuple[int, str, str, Any]]:
    tool_from_camera = inverse_pose(pose_matrix(HAND_EYE_POSITION, HAND_EYE_ROTATION))
    times = camera_track().times_ns
    out = []
    for t, m in zip(times.tolist(), camera_track().matrices(times) @ tool_from_camera, strict=True):
        pose = make.transform(t, BASE_FRAME, TOOL_FRAME, m[:3, 3], matrix_to_quaternion(m[:3, :3]))
        out.append((t + 1_500_000, "/tf", TF_MESSAGE, pose))
    return out


def _packets(make: BagMessages, recipe: Recipe) -> list[tuple[int, str, str, Any]]:
    events, out = scan(), []
    span = 1_000_000
    for seq in range(round(DURATION_S * 1e9) // span):
        base = SENSOR_START_NS + seq * span
        a, b = np.searchsorted(events.t_ns, [base, base + span])
        # Arrival of the first event; sensor and ROS time differ by a constant.
        stamp = START_NS + int(events.t_ns[a]) - SENSOR_START_NS
        packet = Packet(seq, stamp, base, stamp + span, events[a:b])
        message = make.packet(packet, recipe.encoding, recipe.event_type)
        out.append((packet.arrival_ns, "/event_camera/events", recipe.event_type, message))
    return out


__all__ = [
    "CAMERA",
    "EVENT_ARRAY",
    "EVENT_PACKET",
    "KINDS",
    "Recipe",
    "analytic_dataset",
    "bag_messages",
    "camera_track",
    "raw_messages",
    "read_messages",
    "scan",
    "write_bag",
    "write_dataset",
    "write_messages",
]

"""Writes a simulated scan as a rosbag2 folder, with its truth beside the messages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Qos

from roller_core.bag_writer import BagWriter
from roller_core.bags import EVENT_PACKET, bag_qos, typestore
from roller_core.camera import Camera
from roller_core.codecs import encode
from roller_core.errors import UnwritableOutputError
from roller_core.frame_names import BASE_FRAME, CAMERA_FRAME, TOOL_FRAME
from roller_core.output_folder import release_reserve
from roller_core.outputs import CAMERA_INFO, EVENTS, PREVIEW, TF, TF_STATIC, bag_topic
from roller_core.transforms import matrix_to_quaternion

from .cell import Packet, Picture, PoseSample, VirtualCell
from .truth_files import save_truth

_EVENTS, _INFO, _IMAGE = map(bag_topic, (EVENTS, CAMERA_INFO, PREVIEW))
#: Topic: type and offered quality of service.
TOPICS: dict[str, tuple[str, list[Qos]]] = {
    _EVENTS: (EVENT_PACKET, bag_qos(1000, reliable=False)),
    _INFO: ("sensor_msgs/msg/CameraInfo", bag_qos(1, latched=True)),
    _IMAGE: ("sensor_msgs/msg/Image", bag_qos(10)),
    TF: ("tf2_msgs/msg/TFMessage", bag_qos(100)),
    TF_STATIC: ("tf2_msgs/msg/TFMessage", bag_qos(1, latched=True)),
}


@dataclass(frozen=True)
class BagSummary:
    """What was written: packets and events, events cut by the rate cap, poses, images."""

    path: Path
    packets: int
    events: int
    dropped: int
    poses: int
    images: int


class BagMessages:
    """Builds a cell's messages as `rosbags` has them."""

    def __init__(self, camera: Camera) -> None:
        self.store = typestore()
        self._types = self.store.types
        self._camera = camera

    def make(self, name: str, **fields: Any) -> Any:
        """A message of a type such as `sensor_msgs/msg/Image`."""
        return self._types[name](**fields)

    def header(self, stamp_ns: int, frame: str) -> Any:
        """A header."""
        sec, nanosec = divmod(stamp_ns, 1_000_000_000)
        stamp = self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def transform(
        self, stamp_ns: int, parent: str, child: str, position: Any, quaternion: Any
    ) -> Any:
        """One transform as a TFMessage."""
        x, y, z = (float(v) for v in position)
        move = self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)
        qx, qy, qz, qw = (float(v) for v in quaternion)
        turn = self.make("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw)
        stamped = self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(stamp_ns, parent),
            child_frame_id=child,
            transform=self.make("geometry_msgs/msg/Transform", translation=move, rotation=turn),
        )
        return self.make("tf2_msgs/msg/TFMessage", transforms=[stamped])

    def camera_info(self, stamp_ns: int) -> Any:
        """The calibration."""
        camera = self._camera
        roi = self.make(
            "sensor_msgs/msg/RegionOfInterest",
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False,
        )  # fmt: skip
        return self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(stamp_ns, CAMERA_FRAME),
            height=camera.height,
            width=camera.width,
            distortion_model=camera.model,
            d=np.array(camera.distortion, np.float64),
            k=camera.K.ravel(),
            r=np.eye(3).ravel(),
            p=np.hstack([camera.K, np.zeros((3, 1))]).ravel(),
            binning_x=0,
            binning_y=0,
            roi=roi,
        )

    def packet(self, packet: Packet, encoding: str, kind: str = EVENT_PACKET) -> Any:
        """One event packet."""
        return self.make(
            kind,
            header=self.header(packet.stamp_ns, CAMERA_FRAME),
            height=self._camera.height,
            width=self._camera.width,
            seq=packet.seq,
            time_base=packet.time_base_ns,
            encoding=encoding,
            is_bigendian=False,
            events=encode(encoding, packet.events, packet.time_base_ns),
        )

    def image(self, picture: Picture) -> Any:
        """One intensity image."""
        height, width = picture.image.shape
        return self.make(
            "sensor_msgs/msg/Image",
            header=self.header(picture.stamp_ns, CAMERA_FRAME),
            height=height,
            width=width,
            encoding="mono8",
            is_bigendian=0,
            step=width,
            data=picture.image.reshape(-1),
        )


def write_bag(
    cell: VirtualCell, path: Path | str, progress: Callable[[float], None] | None = None
) -> BagSummary:
    """Simulate a scan and write it as a rosbag2 folder (MCAP) with its truth.

    Parameters
    ----------
    cell : VirtualCell
        The cell, not run before.
    path : path
        Folder to make; may be there if it is empty.
    progress : callable, optional
        Called now and then with the share done, 0 to 1.

    Raises
    ------
    UnwritableOutputError
        If the folder holds something or can't be made, or if the disk gets full; what was
        written before is then whole.
    """
    path = Path(path)
    messages = BagMessages(cell.camera)
    writer = BagWriter(path, TOPICS)
    counts = {Packet: 0, PoseSample: 0, Picture: 0}

    def put(topic: str, arrival_ns: int, message: Any) -> None:
        data = messages.store.serialize_cdr(message, TOPICS[topic][0])
        writer.write(topic, arrival_ns, data)

    try:
        writer.declare_all()
        start = cell.truth.start_ros_ns
        put(_INFO, start, messages.camera_info(start))
        rotation = matrix_to_quaternion(cell.hand_eye[:3, :3])
        fixed = messages.transform(start, TOOL_FRAME, CAMERA_FRAME, cell.hand_eye[:3, 3], rotation)
        put(TF_STATIC, start, fixed)
        save_truth(cell.truth, path)
        encoding = cell.settings.packets.encoding
        for item in cell.run():
            counts[type(item)] += 1
            if isinstance(item, Packet):
                put(_EVENTS, item.arrival_ns, messages.packet(item, encoding))
            elif isinstance(item, PoseSample):
                tf = messages.transform(
                    item.stamp_ns, BASE_FRAME, TOOL_FRAME, item.position, item.quaternion
                )
                put(TF, item.arrival_ns, tf)
            else:
                put(_IMAGE, item.arrival_ns, messages.image(item))
            if progress is not None:
                progress(cell.progress)
        writer.flush()
    except OSError as error:
        raise UnwritableOutputError(f"{path}: can't be written ({error.strerror})") from error
    finally:
        release_reserve(path)
        writer.close()
    return BagSummary(
        path,
        counts[Packet],
        cell.event_count,
        cell.dropped_count,
        counts[PoseSample],
        counts[Picture],
    )

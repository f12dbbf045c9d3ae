"""Messages as a stage takes them, and how many may wait for it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from tf2_msgs.msg import TFMessage

from roller_core import outputs
from roller_core.camera import Camera
from roller_core.codecs import CodecError, RawPacket
from roller_core.early_packets import PACKET_BYTES
from roller_core.errors import RollerError
from roller_core.frame_settings import FollowedFrames, StreamSettings
from roller_core.frame_transforms import transforms_of
from roller_core.outputs import Output, ScanFault, stamp_ns
from roller_core.stage import Stage

from .backlog import Backlog, Bulk
from .images import image_to_array

#: In place of a packet: those that follow are of another publisher.
NEW_SOURCE = object()


@dataclass(frozen=True, slots=True)
class LeftOut:
    """In place of packets: so many are left out."""

    packets: int


def feed(stage: Any, topic: str, message: Any, on_fault: Callable[[RollerError], None]) -> None:
    """Give a message to a stage as plain data.

    Parameters
    ----------
    stage : Stage
        Takes it.
    topic : str
        Where it came, as in `Stage.inputs`.
    message : message
        An event packet, camera_info, transforms, an image or a cloud.
    on_fault : callable
        Called with the reason when the message, or a part of it, is left out.
    """
    if isinstance(message, TFMessage):
        for transform in transforms_of(message, static=topic == outputs.TF_STATIC):
            try:
                stage.take_transform(transform)
            except RollerError as error:
                on_fault(error)
        return

    def give(data: Any) -> None:
        stage.take_output(Output(topic, stamp_ns(message), message.header.frame_id, data))

    try:
        if isinstance(message, RollerError):
            raise message
        if message is NEW_SOURCE:
            stage.new_source()
        elif isinstance(message, LeftOut):
            stage.leave_out(message.packets)
        elif isinstance(message, (RawPacket, EventPacket)):
            stage.take_packet(message)
        elif isinstance(message, CameraInfo):
            try:
                camera = Camera.from_info(message)
            except RollerError as error:
                if topic != outputs.DEPTH_INFO:
                    stage.refuse_camera(str(error))
                raise
            if topic == outputs.DEPTH_INFO:
                give(camera)
            else:
                stage.take_camera(camera)
        elif isinstance(message, Image):
            give(image_to_array(message))
        elif isinstance(message, PointCloud2):
            give(outputs.cloud_of(message))
        elif isinstance(message, DiagnosticArray):
            for status in message.status:
                give(ScanFault(status.message, status.name))
        elif isinstance(message, WrenchStamped):
            f = message.wrench.force
            stage.take_force(stamp_ns(message), math.hypot(f.x, f.y, f.z))
    except RollerError as error:
        on_fault(error)


def backlog_for(settings: FollowedFrames, kind: type[Stage[Any]]) -> Backlog[tuple[str, Any]]:
    """What may wait for a stage: event packets are left out in stretches, nothing else for them."""
    if not isinstance(settings, StreamSettings):
        return Backlog(kind.most_waiting)
    return Backlog(
        kind.most_waiting,
        round(settings.max_waiting_mb * 1e6),
        round(settings.max_latency_s * 1e9),
        lambda packets: (outputs.EVENTS, LeftOut(packets)),
    )


def packet_of(cdr: bytes) -> RawPacket | EventPacket | CodecError:
    """A serialized event packet's fields, or why it has none; the events aren't copied.

    rclpy copies them three times, with the interpreter's lock held.
    """
    try:
        return RawPacket.parse(cdr)
    except CodecError as error:
        try:  # of a big-endian machine, perhaps
            return deserialize_message(cdr, EventPacket)
        except Exception:
            return error


def bulk_of(packet: RawPacket | EventPacket) -> Bulk:
    """What a packet counts for in a backlog."""
    return Bulk(len(packet.events) + PACKET_BYTES, stamp_ns(packet))

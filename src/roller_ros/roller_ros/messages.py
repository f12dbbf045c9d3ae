"""Between messages and arrays."""

from __future__ import annotations

from array import array
from functools import singledispatch
from typing import Any

import numpy as np
import numpy.typing as npt
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from std_msgs.msg import Header, String

from roller_core.camera import Camera
from roller_core.outputs import Cloud, Output, ScanFault
from roller_core.pose_track import Pose
from roller_core.window_account import WindowAccount


@singledispatch
def message_of(data: Any, output: Output) -> Any:
    """Message of what an output holds, by its type; packages register what is their own."""
    raise TypeError(f"{output.topic}: no message for {type(data).__name__}")


def to_message(output: Output) -> Any:
    """The message by which an output is published, and written to a replay's bag."""
    return message_of(output.data, output)


def to_time(t_ns: int) -> Time:
    """Time message of nanoseconds."""
    return Time(sec=int(t_ns) // 1_000_000_000, nanosec=int(t_ns) % 1_000_000_000)


def header(t_ns: int, frame_id: str) -> Header:
    """Header of a time and a frame."""
    return Header(stamp=to_time(t_ns), frame_id=frame_id)


def payload(values: npt.NDArray[np.generic]) -> array[int]:
    """Bytes for a `uint8[]` field; rclpy takes an `array` without copying it item by item."""
    out = array("B")
    out.frombytes(np.ascontiguousarray(values).view(np.uint8).reshape(-1).data)
    return out


def camera_info(camera: Camera, t_ns: int, frame_id: str) -> CameraInfo:
    """CameraInfo message of a camera."""
    k = camera.K
    return CameraInfo(
        header=header(t_ns, frame_id),
        width=camera.width,
        height=camera.height,
        distortion_model=camera.model,
        d=list(camera.distortion),
        k=k.ravel().tolist(),
        r=np.eye(3).ravel().tolist(),
        p=np.hstack([k, np.zeros((3, 1))]).ravel().tolist(),
    )


def image(values: npt.NDArray[np.generic], t_ns: int, frame_id: str) -> Image:
    """Image message of float32 (32FC1) or uint8 (mono8) pixels, shape (height, width)."""
    encoding = {"float32": "32FC1", "uint8": "mono8"}[values.dtype.name]
    height, width = values.shape
    return Image(
        header=header(t_ns, frame_id),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=width * values.itemsize,
        data=payload(values),
    )


def point_cloud(cloud: Cloud, t_ns: int, frame_id: str) -> PointCloud2:
    """PointCloud2 of float32 columns."""
    n = len(cloud.names)
    fields = [
        PointField(name=name, offset=4 * k, datatype=PointField.FLOAT32, count=1)
        for k, name in enumerate(cloud.names)
    ]
    return PointCloud2(
        header=header(t_ns, frame_id),
        height=1,
        width=len(cloud.columns),
        fields=fields,
        is_bigendian=False,
        point_step=4 * n,
        row_step=4 * n * len(cloud.columns),
        data=payload(cloud.columns),
        is_dense=True,
    )


@message_of.register
def _(data: np.ndarray, output: Output) -> Image:
    return image(data, output.t_ns, output.frame_id)


@message_of.register
def _(data: Camera, output: Output) -> CameraInfo:
    return camera_info(data, output.t_ns, output.frame_id)


@message_of.register
def _(data: Cloud, output: Output) -> PointCloud2:
    return point_cloud(data, output.t_ns, output.frame_id)


@message_of.register
def _(data: str, output: Output) -> String:
    return String(data=data)


def transform(pose: Pose, t_ns: int, parent: str, child: str) -> TransformStamped:
    """TransformStamped of a pose."""
    out = TransformStamped(header=header(t_ns, parent), child_frame_id=child)
    t, r = out.transform.translation, out.transform.rotation
    t.x, t.y, t.z = (float(v) for v in pose.position)
    r.x, r.y, r.z, r.w = (float(v) for v in pose.quaternion)
    return out


@message_of.register
def contact_message(data: ScanFault, output: Output) -> DiagnosticArray:
    """Message of a stretch in which something was wrong."""
    status = DiagnosticStatus(level=DiagnosticStatus.ERROR, name=data.part, message=data.text)
    return DiagnosticArray(header=header(output.t_ns, output.frame_id), status=[status])


@message_of.register
def account_message(data: WindowAccount, output: Output) -> DiagnosticArray:
    """Message of a window's account; a warning where something was lost."""
    status = DiagnosticStatus(
        level=DiagnosticStatus.WARN if data.lost else DiagnosticStatus.OK,
        name="window",
        message="; ".join(data.lost),
        values=[KeyValue(key=name, value=value) for name, value in data.pairs()],
    )
    return DiagnosticArray(header=header(output.t_ns, output.frame_id), status=[status])

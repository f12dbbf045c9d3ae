"""Between messages and arrays."""

from __future__ import annotations

from array import array

import numpy as np
import numpy.typing as npt
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from std_msgs.msg import Header

from roller_core.camera import Camera
from roller_core.pose_track import Pose


def to_ns(stamp: Time) -> int:
    """Nanoseconds of a time message."""
    return stamp.sec * 1_000_000_000 + stamp.nanosec


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


def camera_from_info(message: CameraInfo) -> Camera:
    """Camera of a CameraInfo message.

    Raises
    ------
    CameraError
        If the camera isn't calibrated or its model not known.
    """
    return Camera.from_matrix(
        message.width, message.height, message.k, message.d, message.distortion_model
    )


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


def image_to_array(message: Image) -> npt.NDArray[np.generic]:
    """Pixels, shape (height, width), of a 32FC1 or mono8 image.

    Raises
    ------
    ValueError
        If the encoding is another one.
    """
    kinds = {"32FC1": "<f4", "mono8": "u1"}
    if message.encoding not in kinds:
        raise ValueError(f"image encoding '{message.encoding}' is not one of {', '.join(kinds)}")
    kind = np.dtype(kinds[message.encoding])
    rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
    return rows[:, : message.width * kind.itemsize].view(kind)


def point_cloud(
    points: npt.NDArray[np.float32], names: tuple[str, ...], t_ns: int, frame_id: str
) -> PointCloud2:
    """PointCloud2 of float32 columns, shape (n, len(names)), the first three x, y, z in metres."""
    n = len(names)
    fields = [
        PointField(name=name, offset=4 * k, datatype=PointField.FLOAT32, count=1)
        for k, name in enumerate(names)
    ]
    return PointCloud2(
        header=header(t_ns, frame_id),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=4 * n,
        row_step=4 * n * len(points),
        data=payload(points),
        is_dense=True,
    )


def transform(pose: Pose, t_ns: int, parent: str, child: str) -> TransformStamped:
    """TransformStamped of a pose."""
    out = TransformStamped(header=header(t_ns, parent), child_frame_id=child)
    t, r = out.transform.translation, out.transform.rotation
    t.x, t.y, t.z = (float(v) for v in pose.position)
    r.x, r.y, r.z, r.w = (float(v) for v in pose.quaternion)
    return out

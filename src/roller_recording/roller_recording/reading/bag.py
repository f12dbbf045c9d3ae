"""rosbag2 folders with the graph's topics."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from roller_core.bags import typestore
from roller_core.camera import Camera, CameraError
from roller_core.errors import RollerError
from roller_core.event_stream import EventStream
from roller_core.events import EventArray
from roller_core.frame_transforms import transforms_of
from roller_core.outputs import TF, TF_STATIC, force_topic, stamp_ns
from roller_core.sensor_pose import SensorFrames
from roller_core.time_order import TimeBackwardsError
from roller_core.timing_settings import DEFAULT_MAX_POSE_GAP_S

from .bag_reader import BagReader
from .base import MalformedRecordingError, MissingTopicError, Recording, RecordingError, Step
from .event_topic import event_topic, listed

_TF_TYPE = "tf2_msgs/msg/TFMessage"
_INFO_TYPE = "sensor_msgs/msg/CameraInfo"


class BagRecording(Recording):
    """A rosbag2 (MCAP or SQLite), healthy or damaged.

    Parameters
    ----------
    path : path
        Bag folder, or a storage file of one.
    poses : path, optional
        TUM file in ROS time, for bags without /tf.
    camera : Camera, optional
        Calibration, for bags without CameraInfo; goes before the bag's own.
    max_gap_s : float
        See `PoseTrack`.
    topic : str, optional
        Topic of the event packets, where there are several.

    Raises
    ------
    MissingTopicError
        If the bag has no events, no calibration or no poses.
    RecordingError
        If it can't be read at all.
    """

    #: Where the calibration that is used comes from, if it is the bag's own.
    _info_topic: str | None = None

    def __init__(
        self,
        path: Path,
        poses: Path | None = None,
        camera: Camera | None = None,
        max_gap_s: float = DEFAULT_MAX_POSE_GAP_S,
        topic: str | None = None,
    ) -> None:
        self._path = path
        self.source = f"bag {path}"
        self._reader = BagReader(path)
        self._store = typestore()
        try:
            self._find(poses, camera, max_gap_s, topic)
        except MissingTopicError as error:
            # What is missing may have come after the cut.
            cut = "".join(f" ({fault})" for fault in self._reader.faults[:1])
            raise MissingTopicError(f"{error}{cut}") from error
        self._stream = EventStream(self.camera.width, self.camera.height)
        self.counts = self._stream.counts
        self.duration_s = self._reader.duration_s

    def _find(
        self, poses: Path | None, camera: Camera | None, max_gap_s: float, topic: str | None
    ) -> None:
        """Make sure of events, poses and calibration."""
        path = self._path
        self._topic = event_topic(self._reader.topics, path, topic)
        self._frames = SensorFrames(max_gap_s=max_gap_s)  # of who reads by `steps`
        if poses is not None:
            self.poses = self._read_poses(poses, max_gap_s)
        elif self._reader.topics.get(TF) != _TF_TYPE:
            raise MissingTopicError(
                f"bag {path}: there are no poses (topic /tf, {_TF_TYPE}); "
                f"give --poses FILE (TUM); it has {listed(self._reader.topics)}"
            )
        self._info_topic = None if camera else f"{self._topic.rsplit('/', 1)[0]}/camera_info"
        self.camera = camera or self._calibration()

    def items(self) -> Iterator[Step]:
        """Read message by message; a packet that can't be decoded is left out, with a fault."""
        yield from self._first_step()
        wrench = force_topic(self._topic)
        wanted = {self._topic, wrench} | ({TF, TF_STATIC} if self.poses is None else set())
        wanted |= {self._info_topic} if self._info_topic else set()
        progress = 0.0
        for item in self._reader.messages(wanted):
            if isinstance(item, RecordingError):
                yield Step(EventArray.empty(), progress, (item,))
                continue
            progress = self._reader.progress(item.t_ns)
            try:
                message: Any = self._store.deserialize_cdr(item.data, item.type)
            except Exception as error:
                fault = MalformedRecordingError(
                    f"bag {self._path}: a message on {item.topic} at {item.t_ns * 1e-9:.6f} s is "
                    f"malformed ({error}); it is left out"
                )
                yield Step(EventArray.empty(), progress, (fault,))
                continue
            if item.topic == self._topic:
                yield self._decode(message, item.t_ns, progress)
            elif item.topic == self._info_topic:
                yield Step(EventArray.empty(), progress, self._other_camera(message, item.t_ns))
            elif item.topic == wrench:
                f = message.wrench.force
                force = (stamp_ns(message), math.hypot(f.x, f.y, f.z))
                yield Step(EventArray.empty(), progress, force=force)
            else:
                found = tuple(transforms_of(message, static=item.topic == TF_STATIC))
                yield Step(EventArray.empty(), progress, transforms=found)

    def _decode(self, message: Any, t_ns: int, progress: float) -> Step:
        before = self.counts.seq_restarts
        try:
            events = self._stream.push_message(message)
            return Step(events, progress, renumbered=self.counts.seq_restarts > before)
        except TimeBackwardsError as error:
            return Step(error.events, progress, (error,), restart=True)
        except RollerError as error:
            where = f"bag {self._path}: {self._topic} at {t_ns * 1e-9:.6f} s"
            return Step(EventArray.empty(), progress, (type(error)(f"{where}: {error}"),))

    def _other_camera(self, info: Any, t_ns: int) -> tuple[RecordingError, ...]:
        """A fault, if the camera's calibration isn't the bag's first."""
        try:
            if Camera.from_info(info) == self.camera:
                return ()
        except RollerError:
            pass  # no calibration at all
        return (
            MalformedRecordingError(
                f"bag {self._path}: {self._info_topic} says another camera or calibration at "
                f"{t_ns * 1e-9:.6f} s; all is measured with the first; give --camera FILE"
            ),
        )

    def _calibration(self) -> Camera:
        infos = {n for n, kind in self._reader.topics.items() if kind == _INFO_TYPE}
        topic = f"{self._topic.rsplit('/', 1)[0]}/camera_info"
        if topic not in infos:
            raise MissingTopicError(
                f"bag {self._path}: there is no {topic} ({_INFO_TYPE}); "
                f"give --camera FILE (ROS camera_info); it has {listed(self._reader.topics)}"
            )
        for item in self._reader.messages({topic}):
            if isinstance(item, RecordingError):
                continue  # reported again when the events are read
            try:
                info: Any = self._store.deserialize_cdr(item.data, item.type)
            except Exception as error:  # a damaged message raises whatever its bytes lead to
                raise MalformedRecordingError(
                    f"bag {self._path}: {topic} is malformed ({error}); give --camera FILE"
                ) from error
            try:
                return Camera.from_info(info)
            except CameraError as error:
                raise CameraError(
                    f"bag {self._path}: {topic}: {error}; give --camera FILE"
                ) from error
        raise MissingTopicError(f"bag {self._path}: {topic} holds no message; give --camera FILE")

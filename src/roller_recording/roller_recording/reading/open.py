"""Which kind of recording a path is."""

from __future__ import annotations

from pathlib import Path

from roller_core.camera import Camera
from roller_core.timing_settings import DEFAULT_MAX_POSE_GAP_S

from .base import Recording, check_path, is_dataset
from .event_file import EventFileRecording, reader_of


def open_recording(
    path: Path,
    poses: Path | None = None,
    camera_file: Path | None = None,
    max_gap_s: float = DEFAULT_MAX_POSE_GAP_S,
    topic: str | None = None,
) -> Recording:
    """Open a bag, a file of events, or a folder of the public event-camera dataset.

    Parameters
    ----------
    path : path
        Recording.
    poses : path, optional
        TUM file, camera optical frame in base.
    camera_file : path, optional
        ROS camera_info YAML.
    max_gap_s : float
        See `PoseTrack`.
    topic : str, optional
        Topic of the event packets, for bags that have several; for AEDAT4 the number of the stream.

    Raises
    ------
    RecordingError, CameraError, PoseError
        With one line that says what is wrong.
    """
    camera = Camera.from_yaml(camera_file) if camera_file else None
    check_path(path)
    # The readers bring heavy libraries; only the one that is needed is loaded.
    if is_dataset(path):
        from .dataset import DatasetRecording

        return DatasetRecording(path, poses, camera, max_gap_s)
    if (reader := reader_of(path)) is not None:
        return EventFileRecording(path, reader, poses, camera, max_gap_s, topic)
    from .bag import BagRecording

    return BagRecording(path, poses, camera, max_gap_s, topic)

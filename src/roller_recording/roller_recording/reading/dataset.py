"""Folders in the format of the public event-camera dataset (Mueggler et al., IJRR 2017)."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from roller_core.camera import Camera, CameraError
from roller_core.event_stream import StreamCounts
from roller_core.events import EventArray
from roller_core.text_file import TextFileError, read_text
from roller_core.timing_settings import DEFAULT_MAX_POSE_GAP_S

from .base import MalformedRecordingError, Recording, RecordingError, Step, TruncatedRecordingError

_CHUNK_BYTES = 4_000_000
#: Times beyond this are none, s: in ns they fit no 64 bits.
_MOST_S = 2.0**62 * 1e-9
#: Stands for pixels that fit no uint16.
_BEYOND_PX = 65535
#: Image sizes of the sensors that such folders were recorded with; the folder doesn't say.
_SENSORS = ((128, 128), (240, 180), (346, 260), (640, 480), (1280, 720))


class EventsText:
    """The file `events.txt` of a folder, lines t x y p; those that begin with # say nothing.

    Parameters
    ----------
    folder : path
        The recording.

    Raises
    ------
    RecordingError
        If there is no such file.
    """

    def __init__(self, folder: Path) -> None:
        self._events = folder / "events.txt"
        if not self._events.is_file():
            raise RecordingError(f"{folder}: there is no events.txt (lines 't x y p')")
        self.counts = StreamCounts()

    def items(self, size_px: tuple[int, int]) -> Iterator[Step]:
        """Read chunks of lines; stop at the first that is malformed.

        Parameters
        ----------
        size_px : tuple of int
            Width and height of the image; what lies outside is left out and counted.
        """
        size = max(self._events.stat().st_size, 1)
        last_ns = -(2**62)
        for events, line, done, broken in self._chunks():
            faults: tuple[RecordingError, ...] = (broken,) if broken else ()
            kept = events
            if len(events):
                steps = np.diff(events.t_ns, prepend=max(last_ns, -(2**62)))
                back = np.flatnonzero(steps < 0)
                if len(back):
                    k = int(back[0])
                    faults = (
                        MalformedRecordingError(
                            f"{self._events}, line {line + k}: time runs backwards by "
                            f"{-int(steps[k]) * 1e-9:.6f} s; what came before is kept"
                        ),
                    )
                    kept = events[:k]
                inside = (kept.x < size_px[0]) & (kept.y < size_px[1])
                self.counts.outside_events += int(len(kept) - inside.sum())
                kept = kept[inside]
                self.counts.events += len(kept)
                if len(kept):
                    last_ns = int(kept.t_ns[-1])
            yield Step(kept, min(done / size, 1.0), faults)
            if faults:
                return

    def _chunks(self) -> Iterator[tuple[EventArray, int, int, RecordingError | None]]:
        """Events, number of their first line, bytes read, and what ended the file early."""
        line, done, rest = 1, 0, b""
        with open(self._events, "rb") as file:
            while True:
                block = file.read(_CHUNK_BYTES)
                done += len(block)
                text = rest + block
                cut = text.rfind(b"\n") + 1 if block else len(text)
                rest, text = text[cut:], text[:cut]
                if text.strip():
                    events, fault = self._parse(text, line, at_end=not block)
                    yield events, line, done, fault
                    if fault:
                        return
                    line += text.count(b"\n")
                if not block:
                    return

    def _parse(
        self, text: bytes, line: int, at_end: bool
    ) -> tuple[EventArray, RecordingError | None]:
        try:
            with warnings.catch_warnings(category=UserWarning, action="ignore"):  # of no lines
                return _events_of(np.loadtxt(io.BytesIO(text), ndmin=2)), None
        except ValueError:
            pass
        # One line is bad: keep the ones before it.
        lines = text.split(b"\n")
        good: list[list[float]] = []
        for k, item in enumerate(lines):
            if not (said := item.partition(b"#")[0].split()):
                continue
            try:
                row = [float(v) for v in said]
                if len(row) != 4 or not _sound(np.array(row)):
                    raise ValueError
            except ValueError:
                kind = TruncatedRecordingError if at_end else MalformedRecordingError
                return _events_of(np.array(good).reshape(-1, 4)), kind(
                    f"{self._events}, line {line + k}: expected 't x y p', got "
                    f"'{item[:40].decode(errors='replace').strip()}'; what came before is kept"
                )
            good.append(row)
        return _events_of(np.array(good).reshape(-1, 4)), None

    def image_size(self) -> tuple[int, int]:
        """Width and height of the smallest known sensor that holds the first events, px.

        Raises
        ------
        RecordingError
            If there are no events, or none holds them.
        """
        first = next(self._chunks(), None)
        if first is None or not len(first[0]):
            raise RecordingError(f"{self._events}: there are no events")
        # A stray pixel out of all bounds must not choose the sensor.
        inside = (first[0].x < _BEYOND_PX) & (first[0].y < _BEYOND_PX)
        held = first[0][inside] if inside.any() else first[0]
        x, y = np.percentile(held.x, 99.9), np.percentile(held.y, 99.9)
        for width, height in _SENSORS:
            if x < width and y < height:
                return width, height
        raise RecordingError(
            f"{self._events}: pixels up to ({x:.0f}, {y:.0f}) fit no known sensor; "
            "give --camera FILE"
        )


class DatasetRecording(Recording):
    """`events.txt` (t x y p), `groundtruth.txt` (TUM) and `calib.txt` (fx fy cx cy k1 k2 p1 p2 k3).

    Parameters
    ----------
    folder : path
        The recording.
    poses : path, optional
        Other poses than `groundtruth.txt`, TUM.
    camera : Camera, optional
        Another calibration than `calib.txt`; needed where the image size can't be guessed.
    max_gap_s : float
        See `PoseTrack`.

    Raises
    ------
    RecordingError, CameraError, PoseError
        If a file is missing or malformed.
    """

    def __init__(
        self,
        folder: Path,
        poses: Path | None = None,
        camera: Camera | None = None,
        max_gap_s: float = DEFAULT_MAX_POSE_GAP_S,
    ) -> None:
        self.source = str(folder)
        self._text = EventsText(folder)
        self.poses = self._read_poses(poses or folder / "groundtruth.txt", max_gap_s)
        self.counts = self._text.counts
        self.camera = camera or self._calibration(folder / "calib.txt")
        self.duration_s = (self.poses.end_ns - self.poses.start_ns) * 1e-9

    def items(self) -> Iterator[Step]:
        """See `EventsText`."""
        yield from self._first_step()
        yield from self._text.items((self.camera.width, self.camera.height))

    def _calibration(self, path: Path) -> Camera:
        expected = f"camera {path}: expected 'fx fy cx cy k1 k2 p1 p2 k3'"
        try:
            values = [float(v) for v in read_text(path).split()]
        except TextFileError as error:
            raise CameraError(f"camera {error}; give --camera FILE") from error
        except ValueError as error:
            raise CameraError(expected) from error
        if not 4 <= len(values) <= 9:
            raise CameraError(expected)
        width, height = self._text.image_size()
        fx, fy, cx, cy = values[:4]
        try:
            return Camera(width, height, fx, fy, cx, cy, tuple(values[4:]))
        except CameraError as error:
            raise CameraError(f"camera {path}: {error}") from error


def _events_of(rows: np.ndarray) -> EventArray:
    """Events of rows t, x, y, p.

    Raises
    ------
    ValueError
        If some have other columns, or a value that is none.
    """
    if not rows.size:
        return EventArray.empty()
    if rows.shape[1] != 4 or not _sound(rows):
        raise ValueError("not four numbers a row")
    # Pixels that fit no uint16 are out of every image; they are counted as such later.
    fits = (rows[:, 1:3] >= 0) & (rows[:, 1:3] < _BEYOND_PX)
    xy = np.where(fits, rows[:, 1:3], _BEYOND_PX)
    return EventArray.from_arrays(
        xy[:, 0], xy[:, 1], np.rint(rows[:, 0] * 1e9).astype(np.int64), rows[:, 3] > 0
    )


def _sound(rows: np.ndarray) -> bool:
    """Whether all numbers are finite and times fit their field."""
    return bool(np.isfinite(rows).all() and (np.abs(rows[..., 0]) < _MOST_S).all())

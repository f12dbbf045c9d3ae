"""A simulated scan as the two devices of a cell would see it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.transforms import inverse_pose, matrix_to_quaternion
from roller_sim.cell import VirtualCell
from roller_sim.cell_settings import VirtualCellSettings
from roller_sim.motion import CAMERA_DOWN, START_SENSOR_NS

from .camera_words import encode_words

_GRID_S = 1e-3
WIDTH, HEIGHT = 640, 480


@dataclass(frozen=True)
class EmulatedScan:
    """What the devices are fed with, and what is true.

    Parameters
    ----------
    cell : VirtualCell
        What was simulated.
    events : EventArray
        In sensor time, as the camera stamps them.
    camera : Camera
        Of 640 × 480 px; what was simulated lies in its middle.
    """

    cell: VirtualCell
    events: EventArray
    camera: Camera

    @classmethod
    def simulate(cls, **settings: dict[str, object]) -> EmulatedScan:
        """Simulate until a tenth of a second after the robot has stopped."""
        cell = VirtualCell(VirtualCellSettings.create(settings))
        rate = 1 + cell.settings.clock.drift_ppm * 1e-6
        end_ns = (cell.duration_s - cell.settings.motion.hold_s + 0.1) * rate * 1e9
        parts = []
        for now_ns, part in cell.raw_events():
            parts.append(part)
            if now_ns > end_ns:
                break
        events = EventArray.concatenate(parts)
        events = events[: int(np.searchsorted(events.t_ns, end_ns))]
        events = events.shifted(START_SENSOR_NS)
        small = cell.camera
        dx, dy = (WIDTH - small.width) // 2, (HEIGHT - small.height) // 2
        placed = EventArray(
            events.x + np.uint16(dx), events.y + np.uint16(dy), events.t_ns, events.p
        )
        camera = Camera(WIDTH, HEIGHT, small.fx, small.fy, small.cx + dx, small.cy + dy)
        return cls(cell, placed, camera)

    @property
    def duration_s(self) -> float:
        """From the begin to the last event."""
        return float(self.seconds_of(self.events.t_ns[-1:])[0])

    def seconds_of(self, sensor_ns: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """True time since the begin of sensor times, s."""
        elapsed = np.asarray(sensor_ns, np.int64) - START_SENSOR_NS
        return np.asarray(elapsed * 1e-9 / (1 + self.cell.settings.clock.drift_ppm * 1e-6))

    def write_words(self, path: Path) -> dict[str, object]:
        """Write what the camera sends; the settings of its `PacedCamera`."""
        encode_words(self.events).tofile(path)
        ppm = self.cell.settings.clock.drift_ppm
        return {"first_us": START_SENSOR_NS // 1000, "clock_ppm": ppm}

    def write_trajectory(self, path: Path) -> Path:
        """Write the tool's true poses as the controller gives them."""
        t = np.arange(0.0, self.cell.duration_s + _GRID_S, _GRID_S)
        to_tool = inverse_pose(self.cell.hand_eye)
        position = self.cell.path.in_base(t) + CAMERA_DOWN @ to_tool[:3, 3]
        turn = Rotation.from_matrix(CAMERA_DOWN @ to_tool[:3, :3]).as_rotvec()
        rotation = np.broadcast_to(turn, position.shape)
        np.savez(path, t_s=t, pose=np.hstack([position, rotation]))
        return path

    def camera_track(
        self, t_s: npt.ArrayLike, stamps_ns: npt.ArrayLike, max_gap_s: float
    ) -> PoseTrack:
        """True camera poses in base at times since the begin, stamped as asked."""
        track = PoseTrack(max_gap_s)
        turn = matrix_to_quaternion(CAMERA_DOWN)
        grid = np.arange(0.0, self.cell.duration_s + _GRID_S, _GRID_S)
        path = self.cell.path.in_base(grid)
        t = np.clip(np.asarray(t_s, np.float64), 0.0, None)
        for stamp, row in zip(
            np.asarray(stamps_ns, np.int64),
            np.stack([np.interp(t, grid, column) for column in path.T], axis=1),
            strict=True,
        ):
            track.append(int(stamp), row, turn)
        return track

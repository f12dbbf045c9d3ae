"""How the robot carries the camera over the plate, and what it says about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.camera import Camera
from roller_core.transforms import (
    matrix_to_quaternion,
    multiply_quaternions,
    quaternion_to_matrix,
    rotation_vector_to_quaternion,
)

from .cell_settings import CameraSettings, ClockSettings, MotionSettings
from .errors import VirtualCellError

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
#: The camera looks straight down: its x is base x, its y is base -y, its z is base -z.
CAMERA_DOWN = np.diag([1.0, -1.0, -1.0])
_TONES = 5
#: Mean delay of a pose, µs.
_POSE_LATENCY_US = 1500.0
#: Noise of rotations by that of positions, µrad/µm.
_URAD_A_UM = 2.5
#: The camera's place and rotation vector in tool0_controller.
HAND_EYE_M, HAND_EYE_ROTATION_RAD = (0.012, -0.031, 0.084), (0.08, -0.05, 0.7)
#: ROS time and sensor time at the start.
START_ROS_NS, START_SENSOR_NS = 1_700_000_000_000_000_000, 3_700_000_000
#: Least delay of a packet.
PACKET_LATENCY_US = 150.0


class Path:
    """The camera's true path: ramps, constant speed, standstill, and a little vibration.

    Parameters
    ----------
    settings : MotionSettings
        With `start_mm` and `end_mm` given.
    height_m : float
        Height of the camera over the plate's face.
    seed : int
        Seed of the vibration.

    Raises
    ------
    VirtualCellError
        If start and end are missing or coincide.
    """

    def __init__(self, settings: MotionSettings, height_m: float, seed: int) -> None:
        s = settings
        if s.start_mm is None or s.end_mm is None or abs(s.end_mm - s.start_mm) < 1e-6:
            raise VirtualCellError("the scan needs a start and an end that differ")
        self.settings, self.height_m, self.seed = settings, height_m, seed
        sign = float(np.sign(s.end_mm - s.start_mm))
        a, ramp = sign * s.acceleration, s.speed / s.acceleration
        even = abs(s.end_mm - s.start_mm) * 1e-3 / s.speed
        parts = [(s.hold_s, 0.0), (ramp, a), (even, 0.0), (ramp, -a), (s.hold_s, 0.0)]
        if s.reverse:
            parts += [(duration, -rate) for duration, rate in parts[1:]]
        durations, self._a = np.array(parts).T
        self._v = np.concatenate([[0.0], np.cumsum(self._a * durations)])[:-1]
        steps = self._v * durations + self._a * durations**2 / 2
        start = s.start_mm * 1e-3 - sign * s.speed * ramp / 2
        self._x = start + np.concatenate([[0.0], np.cumsum(steps)])[:-1]
        self._times = np.concatenate([[0.0], np.cumsum(durations)])
        rng = np.random.default_rng([seed, 11])
        self._frequency = rng.uniform(6.0, 90.0, (3, _TONES))
        self._phase = rng.uniform(0, 2 * np.pi, (3, _TONES))

    @property
    def duration_s(self) -> float:
        """From the first standstill's begin to the last one's end."""
        return float(self._times[-1])

    @property
    def even_s(self) -> tuple[float, float]:
        """Begin and end of the (first) stretch at constant speed."""
        return float(self._times[2]), float(self._times[3])

    @property
    def x_range_m(self) -> tuple[float, float]:
        """Smallest and largest x the camera reaches, over the plate."""
        x = self.along(np.linspace(0.0, self.duration_s, 2001))
        return float(x.min()), float(x.max())

    def _part(self, t: F64) -> tuple[npt.NDArray[np.intp], F64]:
        t = np.clip(t, 0.0, self.duration_s)
        i = np.clip(np.searchsorted(self._times, t, side="right") - 1, 0, len(self._v) - 1)
        return i, t - self._times[i]

    def along(self, t_s: npt.ArrayLike) -> F64:
        """Nominal x over the plate in metres at times from the start."""
        i, dt = self._part(np.asarray(t_s, np.float64))
        return np.asarray(self._x[i] + self._v[i] * dt + self._a[i] * dt**2 / 2)

    def speed(self, t_s: npt.ArrayLike) -> F64:
        """Nominal speed along x, m/s."""
        i, dt = self._part(np.asarray(t_s, np.float64))
        return np.asarray(self._v[i] + self._a[i] * dt)

    def over_plate(self, t_s: npt.ArrayLike) -> F64:
        """True camera positions in the plate's frame, metres, shape (n, 3)."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        out = np.zeros((len(t), 3))
        out[:, 0] = self.along(t)
        out[:, 2] = self.height_m
        if self.settings.vibration_um > 0:
            amplitude = self.settings.vibration_um * 1e-6 * np.sqrt(2.0 / _TONES)
            for tone in range(_TONES):
                turns = 2 * np.pi * t[:, None] * self._frequency[:, tone]
                out += amplitude * np.sin(turns + self._phase[:, tone])
        return out

    def in_base(self, t_s: npt.ArrayLike) -> F64:
        """True camera positions in `base`, metres, shape (n, 3)."""
        return self.over_plate(t_s) + np.asarray(self.settings.plate_origin_m)

    def frame_times(self, length_m: float, longest_s: float) -> F64:
        """Times between which the camera moves no more than a length, and no longer than that.

        Parameters
        ----------
        length_m : float
            Longest path between two times.
        longest_s : float
            Longest time, for standstill.

        Returns
        -------
        ndarray of float64
            Seconds from the start; the first is 0 and the last is not before `duration_s`.
        """
        grid = np.arange(0.0, self.duration_s + 2 * longest_s, min(2e-5, longest_s / 5))
        rate = np.maximum(np.abs(self.speed(grid)) / length_m, 1.0 / longest_s)
        count = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(grid))])
        n = int(np.searchsorted(grid, self.duration_s))
        last = int(np.ceil(count[min(n, len(count) - 1)]))
        return np.interp(np.arange(last + 1), count, grid)


def make_camera(settings: CameraSettings) -> Camera:
    """The camera of the virtual cell."""
    cx, cy = settings.principal_point_px
    return Camera(
        settings.width,
        settings.height,
        settings.focal_px,
        settings.focal_px,
        (settings.width - 1) / 2 if cx < 0 else cx,
        (settings.height - 1) / 2 if cy < 0 else cy,
        tuple(settings.distortion),
    )


def hand_eye() -> F64:
    """The camera's pose in tool0_controller, 4×4, metres."""
    out = np.eye(4)
    out[:3, :3] = quaternion_to_matrix(rotation_vector_to_quaternion(HAND_EYE_ROTATION_RAD))
    out[:3, 3] = HAND_EYE_M
    return out


@dataclass(frozen=True)
class PoseStream:
    """Poses of tool0_controller in base as the robot's controller reports them."""

    #: Time stamp and arrival at the host, ROS time. Shape (n,).
    stamp_ns: I64
    arrival_ns: I64
    #: Metres. Shape (n, 3).
    position: F64
    #: x, y, z, w. Shape (n, 4).
    quaternion: F64

    @classmethod
    def record(cls, path: Path, clock: ClockSettings, seed: int) -> PoseStream:
        """What the robot reports while it goes along a path."""
        rng = np.random.default_rng([seed, 13])
        period = 1.0 / clock.pose_rate_hz
        t = np.arange(0.3 * period, path.duration_s + 2 * period, period)
        to_tool = np.linalg.inv(hand_eye())
        rotation = CAMERA_DOWN @ to_tool[:3, :3]
        position = path.in_base(t) + CAMERA_DOWN @ to_tool[:3, 3]
        position += rng.normal(0.0, 1.0, position.shape) * clock.pose_noise_um * 1e-6
        true_q = matrix_to_quaternion(rotation)
        tilt = rng.normal(0.0, 1.0, position.shape) * clock.pose_noise_um * _URAD_A_UM * 1e-6
        quaternion = np.array(
            [multiply_quaternions(rotation_vector_to_quaternion(v), true_q) for v in tilt]
        )
        error_us = clock.pose_offset_us + clock.pose_jitter_us * rng.normal(0.0, 1.0, len(t))
        stamp = START_ROS_NS + np.round(t * 1e9 + error_us * 1e3).astype(np.int64)
        delay_us = _POSE_LATENCY_US * (0.7 + 0.3 * rng.exponential(1.0, len(t)))
        arrival = START_ROS_NS + np.round(t * 1e9 + delay_us * 1e3).astype(np.int64)
        return cls(
            np.maximum.accumulate(stamp), np.maximum.accumulate(arrival), position, quaternion
        )

"""A depth map and the account of how it came about."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from roller_core.camera import Camera
from roller_core.transforms import F64
from roller_core.window_account import WindowAccount

F32 = npt.NDArray[np.float32]


@dataclass(frozen=True)
class DepthMap:
    """Depth seen from one reference view."""

    #: Reference time, ROS time, ns.
    stamp_ns: int
    #: Metres along z; NaN = not measured. Pixels are ideal pinhole pixels of the camera's K. Shape
    #: (height, width).
    depth: F32
    #: 0–1; NaN where there is no depth. Shape (height, width).
    confidence: F32
    #: Standard uncertainty of the depth, metres; NaN where there is no depth. Shape
    #: (height, width).
    sigma: F32
    #: Camera optical frame in base at the reference time. Shape (4, 4).
    pose: F64
    #: The window, ROS time, ns.
    start_ns: int
    end_ns: int
    #: Events in the window.
    events: int
    #: Time by stage, ms.
    milliseconds: dict[str, float] = field(default_factory=dict)
    #: What was lost or refused in this window, one line each.
    notes: tuple[str, ...] = ()
    #: Processor time of all threads of the process meanwhile, ms; 0 where it isn't known.
    cpu_ms: float = 0.0
    #: The same by stage.
    stage_cpu_ms: dict[str, float] = field(default_factory=dict)

    @property
    def points(self) -> int:
        """Number of measured pixels."""
        return int(np.count_nonzero(np.isfinite(self.depth)))

    @property
    def account(self) -> WindowAccount:
        """Counts and times beside the depth."""
        return WindowAccount(
            self.start_ns, self.end_ns, self.events, self.points,
            self.milliseconds, self.cpu_ms, self.notes,
        )  # fmt: skip


def back_project(depth: F32, camera: Camera) -> tuple[F64, npt.NDArray[np.int64]]:
    """Points of a depth map in the camera frame (paper, eq. back-projection).

    Parameters
    ----------
    depth : ndarray of float32, shape (height, width)
        Metres, NaN = not measured.
    camera : Camera
        Intrinsics; the map's pixels are free of distortion.

    Returns
    -------
    points : ndarray of float64, shape (n, 3)
        Metres, row by row.
    pixels : ndarray of int64, shape (n,)
        Flat index of each point's pixel.
    """
    flat = depth.reshape(-1)
    pixels = np.flatnonzero(np.isfinite(flat))
    z = flat[pixels].astype(np.float64)
    x = (pixels % depth.shape[1] - camera.cx) / camera.fx * z
    y = (pixels // depth.shape[1] - camera.cy) / camera.fy * z
    return np.stack([x, y, z], axis=-1), pixels


def pinhole(camera: Camera) -> Camera:
    """The camera that depth maps belong to: the same K without distortion."""
    return Camera(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)

"""What is known exactly about a simulated scan."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import cached_property

import numpy as np
import numpy.typing as npt

from . import _render_kernels as kernels
from .cell_settings import VirtualCellSettings
from .motion import (
    PACKET_LATENCY_US,
    START_ROS_NS,
    Path,
    hand_eye,
    make_camera,
)
from .optics import SurfaceMaps
from .relief import F32, F64, BrailleMark, DefectMark, HeightMap, Region

#: Rounding of the skin at the border of the patch, mm.
_BLEND_MM = 0.05


class Truth:
    """The true surface, camera path and text of a simulated scan.

    Parameters
    ----------
    settings : VirtualCellSettings
        All settings, with start and end of the motion filled in.
    press_mm : float
        Press depth below the plate's face.
    skin, relief : HeightMap
        Shape of the skin where it is pressed on, and the bare surface or what reads it; metres
        over the face, in the plate's frame.
    regions : tuple of Region
        Objects, in the plate's frame.
    text : str
        What the Braille says.
    marks : tuple of BrailleMark
        The Braille cells.
    defects : tuple of DefectMark
        The defects, in the plate's frame.
    """

    def __init__(
        self,
        settings: VirtualCellSettings,
        press_mm: float,
        skin: HeightMap,
        relief: HeightMap | Callable[[], HeightMap],
        regions: tuple[Region, ...],
        text: str,
        marks: tuple[BrailleMark, ...],
        defects: tuple[DefectMark, ...] = (),
    ) -> None:
        self.settings, self.press_mm = settings, press_mm
        self.skin, self._relief = skin, relief
        self.regions, self.text, self.marks, self.defects = regions, text, marks, defects
        self.camera = make_camera(settings.camera)
        self.radius_mm = settings.camera.roller_radius_mm
        self.path = Path(settings.motion, (self.radius_mm - press_mm) * 1e-3, settings.seed)
        self.origin_m = np.asarray(settings.motion.plate_origin_m, np.float64)
        self.start_ros_ns = START_ROS_NS

    @cached_property
    def relief(self) -> HeightMap:
        """The bare object; few ask for it, so it is read when it is asked for."""
        return self._relief if isinstance(self._relief, HeightMap) else self._relief()

    @property
    def roller(self) -> F64:
        """Radius, half patch length, blend width (mm), half patch angle (rad), shape (4,)."""
        r, d = self.radius_mm, self.press_mm
        half = np.sqrt(max(r**2 - (r - d) ** 2, 0.0)) if d > 0 else 0.0
        return np.array([r, half, _BLEND_MM, np.arcsin(half / r)])

    @property
    def objects(self) -> dict[str, Region]:
        """Objects by name, in `base`, metres."""
        ox, oy, _ = self.origin_m
        return {
            r.name: Region(r.name, r.x0 + ox, r.x1 + ox, r.y0 + oy, r.y1 + oy) for r in self.regions
        }

    @property
    def hand_eye(self) -> F64:
        """True pose of the camera in tool0_controller, 4×4."""
        return hand_eye()

    @property
    def event_delay_ns(self) -> int:
        """How much later than the brightness change an event's time stamp is, on average.

        The pixel's low pass and latency, half a read-out frame, and the least delay of a packet,
        which no clock map can see. At speed v the surface found lies v times this further along.
        """
        s = self.settings.sensor
        low_pass_us = 1e6 / (2 * np.pi * s.bandwidth_hz) if s.bandwidth_hz > 0 else 0.0
        total_us = low_pass_us + s.latency_us + s.readout_us / 2 + PACKET_LATENCY_US
        return round(total_us * 1e3)

    @property
    def duration_ns(self) -> int:
        """Length of the scan with its standstills."""
        return round(self.path.duration_s * 1e9)

    def camera_positions(self, t_ros_ns: npt.ArrayLike) -> F64:
        """True positions of the camera in `base` at ROS times, metres, shape (n, 3)."""
        t = (np.atleast_1d(np.asarray(t_ros_ns, np.int64)) - self.start_ros_ns) * 1e-9
        return self.path.in_base(t)

    def height_at(self, x: npt.ArrayLike, y: npt.ArrayLike) -> F64:
        """Height of the skin, which is what the camera sees, at points of `base`, metres."""
        ox, oy, oz = self.origin_m
        return self.skin.sample(np.asarray(x) - ox, np.asarray(y) - oy) + oz

    def seen_images(self, when: int) -> tuple[F32, npt.NDArray[np.bool_]]:
        """`seen_at` of every pixel, shape (height, width); depths are float32."""
        depth, contact = self._seen(when, self._all_rays)
        shape = self.camera.height, self.camera.width
        return depth.reshape(shape).astype(np.float32), contact.reshape(shape)

    def places(self, t_ros_ns: int, depth: F64) -> tuple[F64, F64]:
        """X and y in `base` of what each pixel of a depth image shows, metres."""
        camera, (x0, y0, _) = self.camera, self.camera_positions(t_ros_ns)[0]
        u, v = np.arange(camera.width)[None, :], np.arange(camera.height)[:, None]
        # The camera looks straight down: base x with u, base y against v.
        x = x0 + (u - camera.cx) / camera.fx * depth
        return x, y0 - (v - camera.cy) / camera.fy * depth

    @cached_property
    def _all_rays(self) -> F64:
        u, v = np.meshgrid(np.arange(self.camera.width), np.arange(self.camera.height))
        return self._rays(np.stack([u, v], axis=-1).reshape(-1, 2))

    def _rays(self, pixels: npt.ArrayLike) -> F64:
        return self.camera.rays(self.camera.undistort(np.asarray(pixels, np.float64)))

    @cached_property
    def _maps(self) -> SurfaceMaps:
        bare = self.settings.light.model_copy(update={"speckle": 0.0})
        return SurfaceMaps.build(self.skin, bare, 0)

    def seen_at(self, when: int, pixels: npt.ArrayLike) -> tuple[F64, npt.NDArray[np.bool_]]:
        """Depth of the skin along pixels' rays, and whether it is pressed on the surface there.

        Parameters
        ----------
        when : int
            ROS time, ns.
        pixels : array_like, shape (n, 2)
            Observed u, v, px.

        Returns
        -------
        ndarray of float64 and of bool, shape (n,)
            Metres, z of the camera frame.
        """
        return self._seen(when, self._rays(pixels))

    def _seen(self, when: int, rays: F64) -> tuple[F64, npt.NDArray[np.bool_]]:
        position = (self.camera_positions(when)[0] - self.origin_m) * 1e3
        xn, yn = rays[:, 0].astype(np.float32), rays[:, 1].astype(np.float32)
        z = np.full(len(xn), position[2], np.float32)
        found = np.empty((3, len(xn)), np.float32)
        # Twice: the second call starts at the solution and ends within a fraction of its tolerance.
        for _ in range(2):
            kernels._trace_row(
                xn, yn, self._maps.flat, self._maps.shape, position, self.roller,
                self._maps.origin, kernels.trace_scratch(len(z)), z, *found,
            )  # fmt: skip
        x, y = xn * z, yn * z
        over = self.skin.sample((position[0] + x) * 1e-3, (position[1] - y) * 1e-3) * 1e3
        radius, _, blend, _ = self.roller
        free = np.sqrt(np.maximum(radius**2 - x.astype(np.float64) ** 2, 0.0))
        return z.astype(np.float64) * 1e-3, position[2] - over + blend <= free

    def starting_at(self, start_ros_ns: int) -> Truth:
        """The same scan, begun at another ROS time."""
        out = copy.copy(self)
        out.start_ros_ns = start_ros_ns
        return out

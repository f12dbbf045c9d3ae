"""The pinhole camera with lens distortion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from .camera_errors import CameraError, OtherCameraError
from .camera_file import entries_of, file_text
from .text_file import TextFileError, read_yaml

__all__ = ["Camera", "CameraError", "OtherCameraError"]

F64 = npt.NDArray[np.float64]

_COEFFICIENTS = {"plumb_bob": 5, "rational_polynomial": 8, "equidistant": 4}
#: A direction that leads further than this from its pixel is not that pixel's, px.
_MAX_MISS_PX = 0.1
#: Largest side of an image, px: what addresses of 11 bits reach; event cameras have half of that.
#: Tables and volumes grow with it.
_MOST_PX = 2048
#: Focal lengths of what is a camera: from a fisheye of few pixels to a field of view of 6° over the
#: largest image; and how many times one is the other at most, where pixels are square. Else a grid
#: on the surface, of the finer pixels, would have more of them than any memory.
_FOCAL_PX, _ASPECT = (1.0, 2e4), 3.0
#: A part of a sensor has the optical axis elsewhere on it, px, and no further.
_MOST_OFF_PX = 2 * _MOST_PX
_ITERATE = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
#: What a matrix's zeros may be off by.
_ROUNDED = 1e-6
#: Focal lengths and centre, and distortion, of one camera differ by no more than this.
_SAME_SHARE, _SAME_DISTORTION = 1e-3, 1e-4


@dataclass(frozen=True)
class Camera:
    """Intrinsic calibration, as `sensor_msgs/CameraInfo` holds it.

    Raises
    ------
    CameraError
        If a figure is not finite, not positive where it must be or too large, or the model isn't
        known.
    """

    #: Image size, px.
    width: int
    height: int
    #: Focal lengths and principal point, px.
    fx: float
    fy: float
    cx: float
    cy: float
    #: `plumb_bob`: k1 k2 p1 p2 k3; `rational_polynomial`: k1 k2 p1 p2 k3 k4 k5 k6; `equidistant`:
    #: k1 k2 k3 k4. Missing trailing ones are zero.
    distortion: tuple[float, ...] = ()
    #: Distortion model's name.
    model: str = "plumb_bob"

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise CameraError(f"image size {self.width}×{self.height} px is not positive")
        if max(self.width, self.height) > _MOST_PX:
            raise CameraError(
                f"image size {self.width}×{self.height} px is over {_MOST_PX} px a side"
            )
        if not np.all(np.isfinite([self.fx, self.fy, self.cx, self.cy, *self.distortion])):
            raise CameraError("the camera calibration holds a value that is not finite")
        if self.fx <= 0 or self.fy <= 0:
            raise CameraError(
                f"focal length {self.fx:g}, {self.fy:g} px is not positive; "
                "is the camera calibrated?"
            )
        self._check_optics()
        if self.model not in _COEFFICIENTS:
            raise CameraError(
                f"distortion model '{self.model}' isn't known; known are {', '.join(_COEFFICIENTS)}"
            )
        n = _COEFFICIENTS[self.model]
        if len(self.distortion) > n:
            raise CameraError(f"{self.model} has {n} coefficients, not {len(self.distortion)}")
        padded = tuple(float(d) for d in self.distortion) + (0.0,) * (n - len(self.distortion))
        object.__setattr__(self, "distortion", padded)

    def _check_optics(self) -> None:
        focal = f"focal length {self.fx:g}, {self.fy:g} px"
        least, most = min(self.fx, self.fy), max(self.fx, self.fy)
        if least < _FOCAL_PX[0] or most > _FOCAL_PX[1]:
            raise CameraError(
                f"{focal} isn't between {_FOCAL_PX[0]:g} and {_FOCAL_PX[1]:g} px; is it in pixels?"
            )
        if most > _ASPECT * least:
            raise CameraError(
                f"{focal} differs by more than {_ASPECT:g} times from x to y; "
                "was the camera calibrated well?"
            )
        if max(abs(self.cx), abs(self.cy)) > _MOST_OFF_PX:
            raise CameraError(
                f"principal point {self.cx:g}, {self.cy:g} px is further than {_MOST_OFF_PX} px "
                "from the image's corner; is it in pixels?"
            )

    @property
    def intrinsics(self) -> tuple[float, ...]:
        """What distinguishes cameras: width, height, fx, fy, cx, cy (px), distortion."""
        plain = (self.width, self.height, self.fx, self.fy, self.cx, self.cy)
        return tuple(map(float, plain + self.distortion))

    def same_intrinsics(self, intrinsics: Sequence[float]) -> bool:
        """Whether figures, as `intrinsics` gives them, are those of this camera and lens.

        Coefficients of distortion that are left out are zero.
        """
        own = np.array(self.intrinsics)
        if not 6 <= len(intrinsics) <= len(own):
            return False
        other = np.append(np.asarray(intrinsics, np.float64), np.zeros(len(own) - len(intrinsics)))
        return bool(
            (own[:2] == other[:2]).all()
            and np.allclose(own[2:6], other[2:6], rtol=_SAME_SHARE)
            and np.allclose(own[6:], other[6:], rtol=0, atol=_SAME_DISTORTION)
        )

    def __str__(self) -> str:
        """Size and intrinsics, for messages."""
        return (
            f"{self.width}×{self.height} px, F {self.fx:.1f}, {self.fy:.1f}, centre "
            f"{self.cx:.1f}, {self.cy:.1f} px"
        )

    @property
    def K(self) -> F64:
        """Intrinsic matrix, shape (3, 3), px."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def is_distorted(self) -> bool:
        """Whether any distortion coefficient differs from zero."""
        return any(self.distortion)

    def undistort(self, pixels: npt.ArrayLike) -> F64:
        """Ideal pinhole pixels of observed ones.

        Parameters
        ----------
        pixels : array_like, shape (n, 2)
            Observed u, v in px.

        Returns
        -------
        ndarray of float64, shape (n, 2)
            Pixels of a camera of the same `K` without distortion.
        """
        points = np.asarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        if not self.is_distorted:
            return points[:, 0, :].copy()
        d = np.array(self.distortion)
        if self.model == "equidistant":
            out = cv2.fisheye.undistortPoints(points, self.K, d, P=self.K)
        else:
            out = cv2.undistortPointsIter(points, self.K, d, None, self.K, _ITERATE)
        return np.asarray(out, dtype=np.float64)[:, 0, :]

    def distort(self, pixels: npt.ArrayLike) -> F64:
        """Observed pixels of ideal pinhole ones: the inverse of `undistort`, shapes (n, 2)."""
        return self.project(self.rays(pixels))

    def undistortion_table(self) -> npt.NDArray[np.float32]:
        """Ideal pinhole pixel of every sensor pixel, float32, shape (height, width, 2), (u, v).

        Whoever asks again gets the same array, which is not to be written to.

        Raises
        ------
        CameraError
            If the distortion folds the image: a pixel that no direction, or a wrong one, leads to.
        """
        return _table_of(self)

    def rays(self, pixels: npt.ArrayLike) -> F64:
        """Directions (x, y, 1) of ideal pinhole pixels, shape (n, 3)."""
        p = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        x = (p[:, 0] - self.cx) / self.fx
        y = (p[:, 1] - self.cy) / self.fy
        return np.stack([x, y, np.ones(len(p))], axis=-1)

    def project(self, points: npt.ArrayLike) -> F64:
        """Observed pixels (with distortion) of points in the camera frame.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            Metres; z > 0.

        Returns
        -------
        ndarray of float64, shape (n, 2)
            u, v in px.
        """
        p = np.asarray(points, dtype=np.float64).reshape(-1, 1, 3)
        if not len(p):
            return np.empty((0, 2))
        zero = np.zeros(3)
        d = np.array(self.distortion)
        if self.model == "equidistant":
            out, _ = cv2.fisheye.projectPoints(p, zero, zero, self.K, d)
        else:
            out, _ = cv2.projectPoints(p, zero, zero, self.K, d)
        return np.asarray(out, dtype=np.float64).reshape(-1, 2)

    @classmethod
    def from_matrix(
        cls,
        width: int,
        height: int,
        k: Sequence[float],
        d: Sequence[float] = (),
        model: str = "plumb_bob",
    ) -> Camera:
        """From the fields of `sensor_msgs/CameraInfo`: K row by row, D, distortion model.

        Raises
        ------
        CameraError
            If K has no nine entries or a value makes no sense.
        """
        values = [float(v) for v in k]
        if len(values) != 9:
            raise CameraError(f"the intrinsic matrix has {len(values)} entries, not 9")
        rest = np.abs(np.array([values[1], values[3], *values[6:]]) - [0, 0, 0, 0, 1])
        if np.isfinite(values).all() and any(values) and rest.max() > _ROUNDED:
            raise CameraError("the intrinsic matrix isn't (fx 0 cx, 0 fy cy, 0 0 1): is it K?")
        coefficients = tuple(float(v) for v in d)
        return cls(
            int(width),
            int(height),
            values[0],
            values[4],
            values[2],
            values[5],
            coefficients,
            model or "plumb_bob",
        )

    @classmethod
    def from_yaml(cls, path: Path | str) -> Camera:
        """Read a ROS camera_info YAML file (as camera_calibration writes it).

        Raises
        ------
        CameraError
            If the file can't be read or an entry is missing or wrong.
        """
        try:
            return cls.from_matrix(*entries_of(read_yaml(path)))
        except TextFileError as error:
            raise CameraError(f"camera {error}") from error
        except CameraError as error:
            raise CameraError(f"camera {path}: {error}") from error

    @classmethod
    def from_info(cls, info: Any) -> Camera:
        """Camera of a `sensor_msgs/CameraInfo`, of rclpy or of a bag.

        Raises
        ------
        CameraError
            If the camera isn't calibrated or its model not known.
        """
        return cls.from_matrix(info.width, info.height, info.k, info.d, info.distortion_model)

    def to_yaml(self, path: Path | str, name: str = "event_camera") -> None:
        """Write a ROS camera_info YAML file."""
        Path(path).write_text(self.yaml_text(name))

    def yaml_text(self, name: str = "event_camera") -> str:
        """The text of a ROS camera_info YAML file."""
        size = (self.width, self.height)
        return file_text(name, size, self.K, self.model, self.distortion)


@lru_cache(maxsize=2)
def _table_of(camera: Camera) -> npt.NDArray[np.float32]:
    """See `Camera.undistortion_table`; a distorted one takes a good part of a second."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2)
    table = camera.undistort(pixels)
    if camera.is_distorted:
        apart = np.linalg.norm(camera.distort(table) - pixels, axis=1)
        # Written so that NaN fails it.
        bad = np.flatnonzero(~(apart < _MAX_MISS_PX))
        if len(bad):
            where = pixels[bad[len(bad) // 2]]
            raise CameraError(
                f"the distortion can't be undone at {len(bad)} of {len(pixels)} pixels, such "
                f"as ({where[0]}, {where[1]}); calibrate with targets up to the corners"
            )
    return table.reshape(camera.height, camera.width, 2).astype(np.float32)

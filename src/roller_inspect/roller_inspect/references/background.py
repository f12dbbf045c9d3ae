"""The scan's own background as the reference."""

from __future__ import annotations

import cv2
import numpy as np
from scipy import ndimage

from roller_inspect.height_map.height_map import Bools, HeightMap
from roller_inspect.height_map.medians import spread_blocks

from .nominal import tukey
from .reference import Alignment, Comparison, rms_robust

#: Reach of the background, the standard deviation of its Gaussian window, m: what is wider belongs
#: to it.
_REACH_M = 4e-3
#: It is computed on cells of this size, m.
_COARSE_M = 5e-4
_ROUNDS = 6


class SelfReference:
    """The surface around each place, robustly: what is smaller than some millimetres shows."""

    name = "self"
    models_part = False

    def compare(self, height_map: HeightMap, masked: Bools | None = None) -> Comparison:
        """See `Reference`."""
        used = height_map.measured(masked)
        background, sigma = self._background(height_map, used)
        deviation = (height_map.height_m - background).astype(np.float32)
        residual = deviation[used]
        return Comparison(
            deviation,
            sigma,
            Alignment("self", np.eye(4), (), rms_robust(residual), int(used.sum())),
        )

    def _background(self, height_map: HeightMap, used: Bools) -> tuple[np.ndarray, np.ndarray]:
        """Local planes by weighted least squares over blocks, Tukey's weights."""
        step = height_map.step_m
        k = max(1, round(_COARSE_M / step))
        ny, nx = (-(-n // k) for n in height_map.shape)
        pad = [(0, ny * k - used.shape[0]), (0, nx * k - used.shape[1])]
        heights = np.where(used, height_map.height_m, np.float32(0))
        share, mean = (
            cv2.resize(np.pad(v, pad), (nx, ny), interpolation=cv2.INTER_AREA).astype(np.float64)
            for v in (used.astype(np.float32), heights)
        )
        count = np.rint(share * k**2)
        mean = np.divide(mean, share, out=np.zeros_like(mean), where=count > 0)
        reach = _REACH_M / (k * step)
        weight = (count > 0).astype(np.float64)
        background = np.zeros((ny, nx))
        for _ in range(_ROUNDS):
            background = _local_plane(mean, weight, reach)
            residual = mean - background
            weight = np.zeros_like(count)
            weight[count > 0] = tukey(residual[count > 0])
        spread = rms_robust((mean - background)[count > 0])
        total = ndimage.gaussian_filter(weight, reach) * 4 * np.pi * reach**2
        sigma = spread / np.sqrt(np.maximum(total, 1.0))
        size = (nx * k, ny * k)
        fine = cv2.resize(background.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
        fine_sigma = spread_blocks(sigma, k, height_map.shape).astype(np.float32)
        return fine[: height_map.shape[0], : height_map.shape[1]], fine_sigma


def _local_plane(z: np.ndarray, weight: np.ndarray, reach: float) -> np.ndarray:
    """Value of the plane fitted around each cell with a Gaussian window, cells.

    Moments are about each cell itself: what is far away takes no digits from them.
    """
    along = np.arange(-int(3.0 * reach + 0.5), int(3.0 * reach + 0.5) + 1, dtype=np.float64)
    window = np.exp(-0.5 * np.square(along / reach))
    window /= window.sum()
    kernels = [(window * along**power).astype(np.float32) for power in range(3)]

    def moment(values: np.ndarray, x: int, y: int) -> np.ndarray:
        return cv2.sepFilter2D(
            values, cv2.CV_32F, kernels[x], kernels[y], borderType=cv2.BORDER_CONSTANT
        )

    weight = weight.astype(np.float32)
    heights = weight * z.astype(np.float32)
    share = np.maximum(moment(weight, 0, 0), np.float32(1e-12))
    mx, my, xx, yy, xy = (
        moment(weight, x, y) / share for x, y in ((1, 0), (0, 1), (2, 0), (0, 2), (1, 1))
    )
    mz, xz, yz = (moment(heights, x, y) / share for x, y in ((0, 0), (1, 0), (0, 1)))
    # A little ridge: with few cells the plane is level.
    ridge = np.float32(0.05 * reach**2)
    sxx, syy, sxy = xx - mx * mx + ridge, yy - my * my + ridge, xy - mx * my
    sxz, syz = xz - mx * mz, yz - my * mz
    det = sxx * syy - sxy**2
    a = (sxz * syy - syz * sxy) / det
    b = (syz * sxx - sxz * sxy) / det
    return np.asarray(mz - a * mx - b * my, np.float64)

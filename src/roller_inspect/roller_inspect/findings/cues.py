"""What speaks for a finding, cell by cell: the height's deviation at several scales."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from roller_inspect.height_map.height_map import CONTINUED, F32, MEASURED, U8, Bools, HeightMap
from roller_inspect.references.reference import Comparison

from .finder_settings import FindingSettings

#: Standard deviations of the Gaussians, m.
SCALES_M = (1e-4, 2e-4, 5e-4)
#: Weight of continued cells, which repeat what measured ones say.
_CONTINUED_WEIGHT = 0.1
#: A smoothed height needs the weight of so many measured cells, in part of its Gaussian.
_LEAST_SHARE = 0.05
#: Noise at every scale is at least this, m: what no test resolved.
_LEAST_SIGMA_M = 2e-6
#: Noise is taken from blocks of this size, m.
_BLOCK_M = 5e-3


@dataclass(frozen=True)
class Cues:
    """What speaks for a finding.

    Attributes
    ----------
    z : ndarray of float32, shape (ny, nx)
        Signed deviation in its standard uncertainty, of the scale where it is largest; 0 where
        nothing is known.
    weak, strong : ndarray of bool, shape (ny, nx)
        Cells that may belong to a finding, and that make one.
    noise_m : ndarray of float32, shape (scales,)
        Standard uncertainty of a smoothed height by scale, as the scan itself shows it.
    """

    z: F32
    weak: Bools
    strong: Bools
    noise_m: F32


def smoothed(values: F32, weight: F32, scale_cells: float) -> tuple[F32, F32]:
    """Normalised convolution with a Gaussian: mean, and share of the window with weight."""
    share = ndimage.gaussian_filter(weight, scale_cells, mode="constant", truncate=3.0)
    total = ndimage.gaussian_filter(
        np.where(weight > 0, values, 0).astype(np.float32) * weight,
        scale_cells,
        mode="constant",
        truncate=3.0,
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(share > 1e-6, total / share, np.nan)
    return mean.astype(np.float32), share


def cell_weights(height_map: HeightMap, deviation_m: F32) -> F32:
    """Weights of cells in smoothing: 1 for measured ones, relative to their uncertainty."""
    finite = np.isfinite(deviation_m)
    state = height_map.state
    weight = np.where(state == MEASURED, 1.0, np.where(state == CONTINUED, _CONTINUED_WEIGHT, 0.0))
    measured = finite & (state == MEASURED)
    if measured.any():
        usual = float(np.median(height_map.sigma_m[measured]))
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.clip((usual / height_map.sigma_m) ** 2, 0.1, 2.0)
        weight = weight * np.where(np.isfinite(ratio), ratio, 0.1)
    return np.where(finite, weight, 0.0).astype(np.float32)


def height_cue(height_map: HeightMap, comparison: Comparison, settings: FindingSettings) -> Cues:
    """Cells whose smoothed height differs from the reference by more than chance."""
    step = height_map.step_m
    weight = cell_weights(height_map, comparison.deviation_m)
    edge = _edge(height_map.state, settings.edge_exclusion_m / step)
    best = np.zeros(height_map.shape, np.float32)
    noises = []
    for scale in SCALES_M:
        mean, share = smoothed(comparison.deviation_m, weight, max(scale / step, 0.5))
        usable = (share > _LEAST_SHARE) & np.isfinite(mean) & ~edge
        noise = _noise(mean, usable & (weight > 0), step)
        noises.append(float(np.median(noise[usable])) if usable.any() else float("nan"))
        sigma = np.hypot(noise, comparison.sigma_m)
        z = np.where(usable, mean / sigma, 0.0).astype(np.float32)
        best = np.where(np.abs(z) > np.abs(best), z, best)
    size = np.abs(best)
    return Cues(
        best, size > settings.weak_z, size > settings.strong_z, np.array(noises, np.float32)
    )


def _noise(mean: F32, usable: Bools, step_m: float) -> npt.NDArray[np.float64]:
    """Robust spread of a smoothed deviation: that of the block, never below the whole's."""
    if not usable.any():
        return np.full(mean.shape, np.inf)
    whole = 1.4826 * float(np.median(np.abs(mean[usable])))
    k = max(1, round(_BLOCK_M / step_m))
    ny, nx = (-(-n // k) for n in mean.shape)
    blocks = np.full((ny, nx), whole)
    for j in range(ny):
        for i in range(nx):
            part = (slice(j * k, (j + 1) * k), slice(i * k, (i + 1) * k))
            values = mean[part][usable[part]]
            if len(values) > k:
                blocks[j, i] = 1.4826 * float(np.median(np.abs(values)))
    # A block full of a finding says nothing of the noise.
    blocks = np.clip(blocks, whole, 2.0 * whole)
    rows = np.minimum(np.arange(mean.shape[0]) // k, ny - 1)
    columns = np.minimum(np.arange(mean.shape[1]) // k, nx - 1)
    return np.maximum(blocks[rows[:, None], columns[None, :]], _LEAST_SIGMA_M)


def _edge(state: U8, cells: float) -> Bools:
    """Cells nearer to the outside than some cells."""
    if cells <= 0:
        return np.zeros(state.shape, bool)
    inside = np.pad(state > 0, 1)
    return np.asarray(ndimage.distance_transform_edt(inside)[1:-1, 1:-1] <= cells)

"""Depth from neighbourhood evidence: the plane on which the warped events are sharpest.

A single pixel's vote count hardly changes with depth where an edge is as wide as the parallax.
The squared votes summed over a neighbourhood do: that is local contrast maximisation (Gallego et
al., CVPR 2018) on the planes of a disparity space image. Planes are spaced by parallax, evenly
in inverse depth, and the peak is found between planes.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
from numba import njit

from roller_core.camera import Camera
from roller_core.errors import RollerError
from roller_core.transforms import F64, inverse_pose

from .rays import F32, Packets, RayBundle, depth_planes, plane_coefficients, rays_in_view
from .settings import DepthSettings
from .stopwatch import Stopwatch
from .votes import _vote_plane

#: Pixels of the image to one of the grid that evidence is summed on. Evidence is smooth over
#: `focus_sigma_px`, so the coarse grid loses nothing and costs a sixteenth.
GRID_PX = 4


class ParallaxError(RollerError):
    """A window in which depth can't be told from the motion."""


def parallax_px(packets: Packets, camera: Camera, view: F64, near_m: float, far_m: float) -> float:
    """Most pixels by which nearest and farthest plane part over the window's camera centres.

    F·B·(1/near - 1/far) for a baseline B across the optical axis.
    """
    centres = (inverse_pose(view) @ packets.poses)[:, :3, 3]
    baseline = np.linalg.norm(np.ptp(centres[:, :2], axis=0))
    return float(max(camera.fx, camera.fy) * baseline * (1.0 / near_m - 1.0 / far_m))


def focus_depth(
    packets: Packets, camera: Camera, view: F64, settings: DepthSettings, watch: Stopwatch
) -> tuple[F32, F32]:
    """Depth and confidence of one window in a reference view.

    Parameters
    ----------
    packets : Packets
        Events of the window.
    camera : Camera
        Intrinsics.
    view : ndarray of float64, shape (4, 4)
        Reference camera in base.
    settings : DepthSettings
        The `focus_*` entries, depth range and threads.
    watch : Stopwatch
        Takes the time by stage.

    Returns
    -------
    depth, confidence : ndarray of float32, shape (height, width)
        Metres and 0–1; NaN where there is no depth.

    Raises
    ------
    ParallaxError
        If the motion gives less parallax than `focus_min_parallax_px`.
    """
    s = settings
    parallax = parallax_px(packets, camera, view, s.depth_min_m, s.depth_max_m)
    if parallax < s.focus_min_parallax_px:
        raise ParallaxError(
            f"parallax of {parallax:.2f} px over the depth range is below "
            f"{s.focus_min_parallax_px:g} px: too little motion across the view for a depth"
        )
    count = int(np.clip(np.ceil(parallax * s.focus_planes_per_px) + 1, 5, s.focus_max_planes))
    # One plane beyond either end, so that a peak on the first or last plane is a peak.
    step = (1 / s.depth_min_m - 1 / s.depth_max_m) / (count - 1)
    near, far = 1 / (1 / s.depth_min_m + step), 1 / max(1 / s.depth_max_m - step, 1e-9)
    planes = depth_planes(near, far, count + 2, "inverse_depth")
    with watch("votes"):
        rays = rays_in_view(packets, camera, view)
        scores = _score_planes(rays, camera, planes, s.focus_sigma_px, s.threads)
    with watch("peak"):
        shape = scores.shape[1:]
        peak, contrast = np.empty(shape, np.float32), np.empty(shape, np.float32)
        _find_peak(scores, peak, contrast)
        # Back to metres between planes: inverse depth is linear in the plane's number.
        inverse = (1 / planes[0] - peak * step).astype(np.float32)
        size = (camera.width, camera.height)
        depth = (1.0 / _enlarge(inverse, size)).astype(np.float32)
        confidence = _enlarge(contrast, size)
    with watch("support"):
        support = _warped_events(rays, camera, depth)
        mean = cv2.GaussianBlur(support, (0, 0), 2.0 * s.focus_sigma_px)
        keep = (support >= s.focus_min_votes) & (support > mean)
        keep &= (confidence >= s.focus_min_confidence) & np.isfinite(depth)
        keep &= (depth >= s.depth_min_m) & (depth <= s.depth_max_m)
        # A pixel alone is noise, or a hot pixel's trail: edges come in company.
        company = cv2.boxFilter(keep.astype(np.float32), -1, (9, 9), normalize=False)
        keep &= company > s.focus_min_neighbours
        depth[~keep] = np.nan
        confidence[~keep] = np.nan
    return depth, confidence


def _score_planes(
    rays: RayBundle, camera: Camera, planes: F64, sigma_px: float, threads: int
) -> F32:
    """Evidence of every plane on the grid, float32, shape (planes, rows, columns).

    The energy of the votes' gradient along the parallax: it is largest where the warped events
    are sharpest, and unlike the energy of the votes it doesn't care for how many there are.
    """
    scale, shift_u, shift_v = plane_coefficients(rays, camera, planes)
    along_u, along_v = parallax_direction(rays.centres)
    rows, columns = -(-camera.height // GRID_PX), -(-camera.width // GRID_PX)
    scores = np.empty((len(planes), rows, columns), np.float32)

    def run(numbers: range) -> None:
        votes = np.empty((camera.height, camera.width), np.float32)
        energy = np.empty((rows, columns), np.float32)
        for k in numbers:
            votes[:] = 0
            _vote_plane(rays.u, rays.v, rays.starts, scale[k], shift_u[k], shift_v[k], votes)
            # A line one pixel wide would shine or fade with its place between pixels.
            cv2.GaussianBlur(votes, (3, 3), 0, dst=votes)
            _gradient_energy(votes, along_u, along_v, energy)
            cv2.GaussianBlur(energy, (0, 0), sigma_px / GRID_PX, dst=scores[k])

    parts = [range(k, len(planes), threads) for k in range(min(threads, len(planes)))]
    if len(parts) == 1:
        run(parts[0])
    else:
        with ThreadPoolExecutor(len(parts)) as pool:
            list(pool.map(run, parts))
    return scores


def parallax_direction(centres: F64) -> tuple[np.float32, np.float32]:
    """Unit direction in the image along which planes part, from camera centres, shape (k, 3)."""
    spread = centres[:, :2] - centres[:, :2].mean(axis=0)
    _, _, axes = np.linalg.svd(spread, full_matrices=False)
    return np.float32(axes[0, 0]), np.float32(axes[0, 1])


def _enlarge(values: F32, size: tuple[int, int]) -> F32:
    """From the grid to image pixels, bilinear."""
    enlarged = cv2.resize(
        values,
        (values.shape[1] * GRID_PX, values.shape[0] * GRID_PX),
        interpolation=cv2.INTER_LINEAR,
    )
    return np.ascontiguousarray(enlarged[: size[1], : size[0]])


def _warped_events(rays: RayBundle, camera: Camera, depth: F32) -> F32:
    """Image of events warped to the depth that each meets, shape (height, width)."""
    image = np.zeros(depth.shape, np.float32)
    middle = np.float64(np.nanmedian(depth)) if np.isfinite(depth).any() else 1.0
    _warp_to_depth(
        rays.u,
        rays.v,
        rays.starts,
        rays.centres,
        depth,
        middle,
        camera.fx,
        camera.fy,
        camera.cx,
        camera.cy,
        image,
    )
    return image


@njit(cache=True, nogil=True, fastmath=True)
def _gradient_energy(votes, along_u, along_v, energy):  # type: ignore[no-untyped-def]
    """Squared Sobel derivative along a direction, summed over the cells of the grid."""
    height, width = votes.shape
    energy[:] = 0
    for y in range(1, height - 1):
        above, here, below = votes[y - 1], votes[y], votes[y + 1]
        row = energy[y // GRID_PX]
        for cell in range(row.size):
            total = np.float32(0)
            for x in range(max(cell * GRID_PX, 1), min(cell * GRID_PX + GRID_PX, width - 1)):
                right = above[x + 1] + np.float32(2) * here[x + 1] + below[x + 1]
                left = above[x - 1] + np.float32(2) * here[x - 1] + below[x - 1]
                down = below[x - 1] + np.float32(2) * below[x] + below[x + 1]
                up = above[x - 1] + np.float32(2) * above[x] + above[x + 1]
                slope = along_u * (right - left) + along_v * (down - up)
                total += slope * slope
            row[cell] += total


@njit(cache=True, nogil=True)
def _find_peak(scores, peak, contrast):  # type: ignore[no-untyped-def]
    """Position of the highest score between planes, NaN at the ends, and how it stands out."""
    n, height, width = scores.shape
    for y in range(height):
        for x in range(width):
            best = 0
            total = np.float32(0)
            for k in range(n):
                value = scores[k, y, x]
                total += value
                if value > scores[best, y, x]:
                    best = k
            top = scores[best, y, x]
            if best == 0 or best == n - 1 or top <= 0:
                peak[y, x] = np.nan
                contrast[y, x] = 0
                continue
            left = scores[best - 1, y, x]
            right = scores[best + 1, y, x]
            bend = left - 2 * top + right
            peak[y, x] = best + (0.5 * (left - right) / bend if bend < 0 else 0.0)
            contrast[y, x] = 1 - total / (n * top)


@njit(cache=True, nogil=True)
def _warp_to_depth(u, v, starts, centres, depth, middle, fx, fy, cx, cy, image):  # type: ignore[no-untyped-def]
    height, width = depth.shape
    for k in range(len(starts) - 1):
        c0, c1, c2 = centres[k, 0], centres[k, 1], centres[k, 2]
        for i in range(starts[k], starts[k + 1]):
            z = middle
            x = -1
            y = -1
            # The depth a ray meets depends on where it meets it: a few rounds settle it.
            for _ in range(3):
                a = 1.0 - c2 / z
                x = int(np.floor((u[i] - cx) * a + cx + fx * c0 / z + 0.5))
                y = int(np.floor((v[i] - cy) * a + cy + fy * c1 / z + 0.5))
                if x < 0 or x >= width or y < 0 or y >= height:
                    x = -1
                    break
                if np.isnan(depth[y, x]):
                    break
                z = depth[y, x]
            if x >= 0:
                image[y, x] += 1

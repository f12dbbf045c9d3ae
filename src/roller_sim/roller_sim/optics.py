"""Light, coating and the maps that the renderer reads."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from . import _relief_kernels as kernels
from .cell_settings import LightSettings
from .relief import F32, F64, HeightMap

#: Depths the light is fitted over, mm.
_Z_MID, _Z_HALF = 45.0, 2.5
_R_SQ_UNIT = 200.0
#: Distance of the dome's light, mm: from there a place in the image makes no difference.
_FAR_MM = 1e9
#: Radius of the LED ring, and how far it lies before the lens.
RING_RADIUS_MM, RING_Z_MM = 20.0, 8.0


@dataclass(frozen=True)
class Mix:
    """What light is made of; strengths count at the plate's middle."""

    #: Light scattered in the roller, from the dome above.
    ambient: float
    #: Matt and semi-specular part of the directed light.
    diffuse: float
    specular: float
    #: Width of the lobe, as a slope.
    lobe_slope: float

    @property
    def total(self) -> float:
        """All of it."""
        return self.ambient + self.diffuse + self.specular


_USUAL = Mix(1.0, 0.5, 0.15, 0.6)
#: By kind of light.
MIXES = {"ring": _USUAL, "dome": _USUAL, "strong": Mix(0.3, 0.5, 0.35, 0.3)}
#: Squares of the coarse map, how far from relief they count as near it, and what counts as level.
_COARSE_MM, _NEAR_MM, _LEVEL_MM = 0.25, 0.5, 2e-4


def ring_field(x: F64, y: F64, z: F64) -> tuple[F64, F64, F64]:
    """Irradiance vector of the LED ring: ring average of (L - P) / |L - P|³.

    A matt surface of normal n receives n · G, so near field and fall-off with distance are in G.

    Parameters
    ----------
    x, y, z : ndarray of float64
        Points in the camera frame, mm.

    Returns
    -------
    tuple of ndarray
        Gx, Gy, Gz in mm⁻².
    """
    total = np.zeros((3, *np.broadcast(x, y, z).shape))
    angles = np.arange(64) * (2 * np.pi / 64)
    for angle in angles:
        d = np.stack(
            np.broadcast_arrays(
                RING_RADIUS_MM * np.cos(angle) - x,
                RING_RADIUS_MM * np.sin(angle) - y,
                RING_Z_MM - z,
            )
        )
        total += d / np.sum(d * d, axis=0) ** 1.5
    total /= len(angles)
    return total[0], total[1], total[2]


def light_vector(light: LightSettings, radius_mm: float) -> F32:
    """Coefficients of the shading kernel.

    The ring's field is symmetric about the axis: G = (-x·A, -y·A, -B) with A and B smooth
    functions of r² and z, kept as polynomials. Scaled so that a flat plate at the image's middle
    receives `diffuse` and `specular` from the ring. The dome's field is the same everywhere, and
    its lobe stands about the plate's normal.

    Parameters
    ----------
    light : LightSettings
        The light.
    radius_mm : float
        Largest distance from the axis the camera sees, mm.

    Returns
    -------
    ndarray of float32, shape (24,)
        As read by ``_render_kernels._shade_row``.
    """
    r = np.linspace(0.05, 1.0, 24) * radius_mm
    z = _Z_MID + _Z_HALF * np.linspace(-1, 1, 9)
    rr, zz = (a.ravel() for a in np.meshgrid(r, z))
    gx, _, gz = ring_field(rr, np.zeros_like(rr), zz)
    middle = -float(ring_field(np.zeros(1), np.zeros(1), np.full(1, _Z_MID))[2][0])
    rho, zeta = rr**2 / _R_SQ_UNIT, (zz - _Z_MID) / _Z_HALF
    basis = np.stack([rho**0, rho, rho**2, rho**3, zeta, zeta * rho, zeta * rho**2], axis=1)
    side = np.linalg.lstsq(basis, -gx / rr / middle, rcond=None)[0]
    front = np.linalg.lstsq(basis, -gz / middle, rcond=None)[0]
    # Normals' slopes seen from the surface: half-way between lens and ring.
    alpha, half_way = RING_RADIUS_MM / (2 * (_Z_MID - RING_Z_MM / 2)), RING_Z_MM / 2
    if light.kind == "dome":
        side, front, alpha, half_way = np.zeros(len(side)), np.eye(len(front))[0], 0.0, -_FAR_MM
    mix = MIXES[light.kind]
    inv_m2 = 1.0 / mix.lobe_slope**2
    at_rest = 1.0 / (1.0 + alpha**2 * inv_m2) ** 2
    out = [mix.ambient, mix.diffuse, mix.specular / at_rest, inv_m2, alpha**2]
    out += [half_way, _Z_MID, 1.0 / _Z_HALF, 1.0 / _R_SQ_UNIT]
    out += [*side, *front, 0.01 * mix.total]
    return np.array(out, np.float32)


def lit_level(xn: F32, yn: F32, height_mm: float, light: F32) -> F64:
    """Log intensity of level plate without a coating, as ``_render_kernels._shade_row`` has it.

    Parameters
    ----------
    xn, yn : ndarray of float32, shape (h, w)
        x/z and y/z of each pixel's ray.
    height_mm : float
        Camera over the plate's face, mm.
    light : ndarray of float32, shape (24,)
        See `light_vector`.

    Returns
    -------
    ndarray of float64, shape (h, w)
    """
    v = light.astype(np.float64)
    ambient, diffuse, specular, inv_m2, alpha2, half_way, z_mid, inv_z, inv_r2 = v[:9]
    square = (xn.astype(np.float64) ** 2 + yn.astype(np.float64) ** 2) * height_mm**2
    rho, dz = square * inv_r2, (height_mm - z_mid) * inv_z
    front = np.polyval(v[19:15:-1], rho) + dz * np.polyval(v[22:19:-1], rho)
    e_sq = square / (height_mm - half_way) ** 2
    a = 1 + (e_sq + alpha2) * inv_m2
    lobe = a / (a**2 - 4 * e_sq * alpha2 * inv_m2**2) ** 1.5
    shade = ambient + diffuse * np.maximum(front, 0) + specular * lobe
    return np.asarray(np.log(np.maximum(shade, v[23])))


def speckle(shape: tuple[int, int], step_mm: float, light: LightSettings, seed: int) -> F32:
    """Log reflectance of the coating: smooth noise, zero mean, of the RMS and length set.

    Parameters
    ----------
    shape : tuple of int
        (ny, nx).
    step_mm : float
        Grid step.
    light : LightSettings
        `speckle` (RMS) and `speckle_mm` (where the correlation has fallen to 1/e).
    seed : int
        Seed.
    """
    if light.speckle == 0:
        return np.zeros(shape, np.float32)
    rng = np.random.default_rng([seed, 7])
    noise = rng.standard_normal(shape, dtype=np.float32)
    # White noise blurred by sigma has the correlation exp(-d²/4σ²).
    sigma = max(light.speckle_mm / 2 / step_mm, 0.3)
    noise = cv2.GaussianBlur(noise, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
    noise *= light.speckle / float(noise.std())
    return np.asarray(np.log1p(np.maximum(noise, -0.9)), np.float32)


def _relief_near(height: F32, n: int) -> npt.NDArray[np.uint8]:
    """Where squares of n × n points, or any close by, are not level."""
    rows = np.arange(0, height.shape[0], n)
    columns = np.arange(0, height.shape[1], n)
    high = np.maximum.reduceat(np.maximum.reduceat(height, rows, 0), columns, 1)
    low = np.minimum.reduceat(np.minimum.reduceat(height, rows, 0), columns, 1)
    uneven = (high - low > _LEVEL_MM).astype(np.uint8)
    # A ray that is followed to the plate's face passes raised relief a little aside.
    reach = int(np.ceil(_NEAR_MM / _COARSE_MM))
    size = 2 * reach + 1
    return np.asarray(cv2.dilate(uneven, np.ones((size, size), np.uint8)), np.uint8)


@dataclass(frozen=True)
class SurfaceMaps:
    """What is fixed to the surface, interleaved for the renderer."""

    #: Skin height in mm, its slopes along x and y, log reflectance. Shape (ny, nx, 4).
    values: F32
    #: x, y of the first point and the step, mm. Shape (3,).
    origin: F64
    #: A coarse map: 1 where the surface is not level, or that is near. Shape (my, mx).
    active: npt.NDArray[np.uint8]
    #: The same for the coarse map. Shape (3,).
    active_origin: F64

    @classmethod
    def build(cls, skin: HeightMap, light: LightSettings, seed: int) -> SurfaceMaps:
        """Slopes and coating for a skin."""
        height = skin.height * np.float32(1e3)
        step = skin.step * 1e3
        values = np.zeros((*height.shape, 4), np.float32)
        kernels._fill_slopes(height, np.float32(2 * step), values)
        if light.speckle:  # zeros that nobody writes take no memory's time
            values[..., 3] = speckle(height.shape, step, light, seed)
        origin = np.array([skin.x0 * 1e3, skin.y0 * 1e3, step])
        n = max(round(_COARSE_MM / step), 1)
        coarse = np.array([origin[0], origin[1], n * step])
        return cls(values, origin, _relief_near(height, n), coarse)

    @property
    def flat(self) -> F32:
        """The values in one dimension."""
        return self.values.reshape(-1)

    @property
    def shape(self) -> tuple[int, int]:
        """(ny, nx)."""
        return self.values.shape[0], self.values.shape[1]


def to_grey(log_intensity: F32, light: LightSettings) -> npt.NDArray[np.uint8]:
    """An 8-bit picture for people: the flat plate's middle at 140."""
    scale = 140.0 / MIXES[light.kind].total
    return np.clip(np.exp(log_intensity) * scale, 0, 255).astype(np.uint8)

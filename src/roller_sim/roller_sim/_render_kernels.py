"""Inner loops of the renderer: what each pixel of a row sees, and how bright it is.

Lengths are in millimetres. A row is rendered in two passes: the first follows each pixel's ray to
the skin and gathers slopes and coating from the map that is fixed to the surface; the second,
free of gathers, turns them into log intensity.
"""

from __future__ import annotations

import math

import numba
import numpy as np

#: Rays are followed until the depth moves by less than this, mm. Newton's next step would be far
#: smaller, and slopes and coating are those of a point at most a third of it aside.
_TOLERANCE = 4e-3
_MAX_STEPS = 12
#: Newton's divisor 1 - slope·ray is kept above this, which only damps very steep walls.
_MIN_DIVISOR = 0.25
_LN2 = math.log(2.0)
_C0 = 1.00001097778087
_C1 = -0.4998540725004834
_C2 = 0.3323506614400853
_C3 = -0.25479230405968634
_C4 = 0.2224167707367713
_C5 = -0.14168885275695892


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _fast_log(x):  # type: ignore[no-untyped-def]
    """Natural logarithm of a positive float32, within 2e-6: exponent bits and a polynomial."""
    # As float32 that is made here: kept in the module, the loop would load them anew each time.
    one, ln2 = np.float32(1.0), np.float32(_LN2)
    c0, c1, c2 = np.float32(_C0), np.float32(_C1), np.float32(_C2)
    c3, c4, c5 = np.float32(_C3), np.float32(_C4), np.float32(_C5)
    bits = np.float32(x).view(np.int32)
    exponent = (bits - np.int32(0x3F3504F3)) >> np.int32(23)
    s = np.int32(bits - (exponent << np.int32(23))).view(np.float32) - one
    poly = c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))))
    return s * poly + np.float32(exponent) * ln2


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy", fastmath=True)
def _turn(x, radius, half, arc_half):  # type: ignore[no-untyped-def]
    """How much further than x the free coating has turned: arc from the patch border less chord."""
    turned = radius * (np.float32(math.asin(abs(x) / radius)) - arc_half) - (abs(x) - half)
    return turned if x > 0 else -turned


# `forceinline`: where it was called, the process that compiles it and those that load it from the
# cache would run copies of it that round otherwise.
@numba.njit(cache=True, nogil=True, forceinline=True, error_model="numpy", fastmath=True)
def _trace_row(xn, yn, flat, shape, camera, roller, origin, z, sx, sy, coat):  # type: ignore[no-untyped-def]
    """Follow one row's rays to the skin, from the depths found last.

    Parameters
    ----------
    xn, yn : ndarray of float32, shape (w,)
        Ray directions x/z and y/z.
    flat : ndarray of float32, shape (ny * nx * 4,)
        Height, its slopes along x and y, and log reflectance of the coating, point by point.
    shape : tuple of int
        (ny, nx) of the map.
    camera : ndarray of float64, shape (3,)
        Camera x, y over the plate and height above its face.
    roller : ndarray of float64, shape (4,)
        Radius, half length of the nominal contact patch, blend width at its border; angle (rad)
        the half length is seen at from the axis.
    origin : ndarray of float64, shape (3,)
        Map origin x, y and step.
    z : ndarray of float32, shape (w,)
        Depth: first guess on entry, result on return.
    sx, sy, coat : ndarray of float32, shape (w,)
        Results: slopes dz/dx, dz/dy of the skin in the camera frame; log reflectance.
    """
    inv = np.float32(1.0 / origin[2])
    fx0 = np.float32((camera[0] - origin[0]) / origin[2])
    fy0 = np.float32((camera[1] - origin[1]) / origin[2])
    last_x = np.float32(shape[1] - 1.01)
    last_y = np.float32(shape[0] - 1.01)
    stride = np.uint64(shape[1] * 4)
    four = np.uint64(4)
    i1 = np.uint64(1)
    i2 = np.uint64(2)
    i3 = np.uint64(3)
    zero, half_one, one = np.float32(0.0), np.float32(0.5), np.float32(1.0)
    tolerance, least = np.float32(_TOLERANCE), np.float32(_MIN_DIVISOR)
    cz = np.float32(camera[2])
    radius = np.float32(roller[0])
    r2 = radius * radius
    half = np.float32(roller[1])
    arc_half = np.float32(roller[3])
    k = np.float32(roller[2])
    for u in range(len(z)):
        xr = xn[u]
        yr = yn[u]
        zi = z[u]
        for _ in range(_MAX_STEPS):
            x = xr * zi
            px = min(max(fx0 + x * inv, zero), last_x)
            py = min(max(fy0 - yr * zi * inv, zero), last_y)
            ix = np.int32(px)
            iy = np.int32(py)
            fx = px - np.float32(ix)
            fy = py - np.float32(iy)
            w11 = fx * fy
            w10 = fy - w11
            w01 = fx - w11
            w00 = one - fx - w10
            b = np.uint64(iy) * stride + np.uint64(ix) * four
            c = b + four
            d = b + stride
            e = d + four
            h = w00 * flat[b] + w01 * flat[c] + w10 * flat[d] + w11 * flat[e]
            gx = w00 * flat[b + i1] + w01 * flat[c + i1] + w10 * flat[d + i1] + w11 * flat[e + i1]
            gy = w00 * flat[b + i2] + w01 * flat[c + i2] + w10 * flat[d + i2] + w11 * flat[e + i2]
            t = w00 * flat[b + i3] + w01 * flat[c + i3] + w10 * flat[d + i3] + w11 * flat[e + i3]
            s = cz - h
            slope_x = -gx
            slope_y = gy
            free_sq = r2 - x * x
            if (s + k) * (s + k) > free_sq:
                # Smooth minimum of contact face and free cylinder, exact beyond +-k.
                free = np.float32(math.sqrt(free_sq))
                part = min(max(half_one + half_one * (free - s) / k, zero), one)
                if abs(x) > half and part < one:
                    # Off the surface the coating turns with the roller: find what rolled there.
                    px += (one - part) * _turn(x, radius, half, arc_half) * inv
                    px = min(max(px, zero), last_x)
                    ix = np.int32(px)
                    fx = px - np.float32(ix)
                    b = np.uint64(iy) * stride + np.uint64(ix) * four + i3
                    low = flat[b] + fx * (flat[b + four] - flat[b])
                    b += stride
                    t = low + fy * (flat[b] + fx * (flat[b + four] - flat[b]) - low)
                s = part * s + (one - part) * free - k * part * (one - part)
                slope_x = part * slope_x - (one - part) * x / free
                slope_y = part * slope_y
            step = (zi - s) / max(one - slope_x * xr - slope_y * yr, least)
            zi -= step
            if abs(step) < tolerance:
                break
        z[u] = zi
        sx[u] = slope_x
        sy[u] = slope_y
        coat[u] = t


@numba.njit(cache=True, nogil=True, forceinline=True, error_model="numpy", fastmath=True)
def _see_level_row(xn, yn, flat, shape, camera, origin, z, sx, sy, coat):  # type: ignore[no-untyped-def]
    """What `_trace_row` finds where all of a row touches level plate, of height 0."""
    inv = np.float32(1.0 / origin[2])
    fx0 = np.float32((camera[0] - origin[0]) / origin[2])
    fy0 = np.float32((camera[1] - origin[1]) / origin[2])
    last_x = np.float32(shape[1] - 1.01)
    last_y = np.float32(shape[0] - 1.01)
    stride = np.uint64(shape[1] * 4)
    four = np.uint64(4)
    zero = np.float32(0.0)
    cz = np.float32(camera[2])
    for u in range(len(z)):
        px = min(max(fx0 + xn[u] * cz * inv, zero), last_x)
        py = min(max(fy0 - yn[u] * cz * inv, zero), last_y)
        ix = np.int32(px)
        iy = np.int32(py)
        fx = px - np.float32(ix)
        b = np.uint64(iy) * stride + np.uint64(ix) * four + np.uint64(3)
        low = flat[b] + fx * (flat[b + four] - flat[b])
        b += stride
        high = flat[b] + fx * (flat[b + four] - flat[b])
        coat[u] = low + (py - np.float32(iy)) * (high - low)
    z[:], sx[:], sy[:] = cz, zero, zero


@numba.njit(cache=True, nogil=True, forceinline=True, error_model="numpy", fastmath=True)
def _shade_row(xn, yn, z, sx, sy, coat, light, out):  # type: ignore[no-untyped-def]
    """Log intensity of one row under the ring light.

    Parameters
    ----------
    xn, yn, z, sx, sy, coat : ndarray of float32, shape (w,)
        Rays and what `_trace_row` found.
    light : ndarray of float32, shape (24,)
        As made by `roller_sim.optics.light_vector`.
    out : ndarray of float32, shape (w,)
        Result: log intensity.
    """
    ambient, diffuse, specular = light[0], light[1], light[2]
    inv_m2, alpha2, half_ring_z = light[3], light[4], light[5]
    z_mid, inv_z, inv_r2 = light[6], light[7], light[8]
    a0, a1, a2, a3 = light[9], light[10], light[11], light[12]
    d0, d1, d2 = light[13], light[14], light[15]
    b0, b1, b2, b3 = light[16], light[17], light[18], light[19]
    e0, e1, e2 = light[20], light[21], light[22]
    floor, zero = light[23], np.float32(0.0)
    half, one, four = np.float32(0.5), np.float32(1.0), np.float32(4.0)
    for u in range(len(out)):
        zu = z[u]
        x = xn[u] * zu
        y = yn[u] * zu
        p = sx[u]
        q = sy[u]
        rho = (x * x + y * y) * inv_r2
        dz = (zu - z_mid) * inv_z
        side = a0 + rho * (a1 + rho * (a2 + rho * a3)) + dz * (d0 + rho * (d1 + rho * d2))
        front = b0 + rho * (b1 + rho * (b2 + rho * b3)) + dz * (e0 + rho * (e1 + rho * e2))
        upright = one / np.float32(math.sqrt(one + p * p + q * q))
        lambert = (front - (p * x + q * y) * side) * upright
        # Ring-averaged lobe about the slope that mirrors the light into the lens.
        facing = one / (zu - half_ring_z)
        ex = p + x * facing
        ey = q + y * facing
        e_sq = ex * ex + ey * ey
        a = one + (e_sq + alpha2) * inv_m2
        b_sq = four * e_sq * alpha2 * inv_m2 * inv_m2
        g = a * a - b_sq
        lobe = a / (g * np.float32(math.sqrt(g)))
        # Scattered light comes from the dome above the skin: half of it reaches an upright wall.
        scattered = ambient * (half + half * upright)
        shade = scattered + diffuse * max(lambert, zero) + specular * lobe
        out[u] = _fast_log(max(shade, floor)) + coat[u]

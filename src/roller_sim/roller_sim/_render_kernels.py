"""Inner loops of the renderer: what each pixel of a row sees, and how bright it is.

Lengths are in millimetres. A row is rendered in two passes: the first follows each pixel's ray to
the skin and gathers slopes and coating from the map that is fixed to the surface; the second,
free of gathers, turns them into log intensity.

Nothing is allocated: numba counts no references (`_nrt`), which for a row of a few hundred pixels
took a third of the time.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from roller_core import numba_start  # noqa: F401 (before a kernel runs)

#: Rays are followed until the depth moves by less than this, mm. Newton's next step would be far
#: smaller, and slopes and coating are those of a point at most a third of it aside.
_TOLERANCE = 4e-3
_MAX_STEPS = 12
#: Newton's divisor 1 - slope·ray is kept above this, which only damps very steep walls.
_MIN_DIVISOR = 0.25
#: Least square of a half chord of the roller, mm².
_EDGE_MM2 = 0.01
#: Coefficients of x³ … x⁹ of the arc sine: within 1e-6 up to a sine of 0.3, 1e-4 up to 0.6.
_ARC_SINE = (1 / 6, 3 / 40, 15 / 336, 105 / 3456)
_LN2 = math.log(2.0)
_C0 = 1.00001097778087
_C1 = -0.4998540725004834
_C2 = 0.3323506614400853
_C3 = -0.25479230405968634
_C4 = 0.2224167707367713
_C5 = -0.14168885275695892


@numba.njit(cache=True, nogil=True, _nrt=False, inline="always", error_model="numpy")
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


def trace_scratch(width: int) -> tuple[np.ndarray, ...]:
    """Buffers of `_trace_row` and `_see_level_row`, for rows of up to `width` pixels."""
    # Each by itself: of rows of one array the loops over them are four times slower.
    kinds = [np.int32] * 2 + [np.float32] * 12
    return tuple(np.empty(width, kind) for kind in kinds)


# `forceinline`: where it was called, the process that compiles it and those that load it from the
# cache would run copies of it that round otherwise.
@numba.njit(
    cache=True, nogil=True, _nrt=False, forceinline=True, error_model="numpy", fastmath=True
)
def _trace_row(xn, yn, flat, shape, camera, roller, origin, scratch, z, sx, sy, coat):  # type: ignore[no-untyped-def]
    """Follow one row's rays to the skin, from the depths found last.

    By Newton's method, a step for all pixels at once: its loops become vector instructions, but
    for the look-up. After the first most rays have moved little enough; those that haven't are
    put side by side for the next.

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
    scratch : tuple of ndarray
        From `trace_scratch`.
    z : ndarray of float32, shape (w,)
        Depth: first guess on entry, result on return.
    sx, sy, coat : ndarray of float32, shape (w,)
        Results: slopes dz/dx, dz/dy of the skin in the camera frame; log reflectance.
    """
    pixel, place, px, fx, fy, height, step, rest = scratch[:8]
    half, tolerance = np.float32(roller[1]), np.float32(_TOLERANCE)
    # Rays of a row lie from left to right, at depths that differ little.
    turned = max(abs(xn[0]), abs(xn[-1])) * np.float32(roller[0]) > half
    ray_x, ray_y, depth, slope_x, slope_y, seen = xn, yn, z, sx, sy, coat
    for again in range(_MAX_STEPS):
        _find_places(ray_x, ray_y, shape, camera, origin, depth, place, px, fx, fy)
        _look_up(flat, shape, place, fx, fy, height, slope_x, slope_y, seen)
        _step(ray_x, ray_y, camera, roller, height, depth, slope_x, slope_y, step, rest)
        count = len(depth)
        if turned:
            _turn_places(ray_x, shape, roller, origin, depth, step, rest, px, place, fx)
            _look_up_coat(flat, shape, place, fx, fy, seen)
        if again:
            for i in range(count):
                u = pixel[i]
                z[u], sx[u], sy[u], coat[u] = depth[i], slope_x[i], slope_y[i], seen[i]
        else:
            for i in range(count):
                pixel[i] = i
        left = 0
        for i in range(count):
            pixel[left] = pixel[i]
            left += abs(step[i]) >= tolerance
        if left == 0:
            break
        ray_x, ray_y, depth, slope_x, slope_y, seen = (
            scratch[8][:left], scratch[9][:left], scratch[10][:left], scratch[11][:left],
            scratch[12][:left], scratch[13][:left],
        )  # fmt: skip
        for i in range(left):
            u = pixel[i]
            ray_x[i], ray_y[i], depth[i] = xn[u], yn[u], z[u]


@numba.njit(
    cache=True, nogil=True, _nrt=False, forceinline=True, error_model="numpy", fastmath=True
)
def _expect_row(xn, yn, sx, sy, moved, z):  # type: ignore[no-untyped-def]
    """Depths after the camera has moved along x by `moved` over the slopes found last."""
    one, least, dx = np.float32(1.0), np.float32(_MIN_DIVISOR), np.float32(moved)
    for u in range(len(z)):
        divisor = one - sx[u] * xn[u] - sy[u] * yn[u]
        divisor = divisor if divisor > least else least
        z[u] += sx[u] * dx / divisor


@numba.njit(
    cache=True, nogil=True, _nrt=False, forceinline=True, error_model="numpy", fastmath=True
)
def _find_places(xn, yn, shape, camera, origin, z, place, px, fx, fy):  # type: ignore[no-untyped-def]
    """Where rays of depth z come down: column, point of the map before it, and how far beyond."""
    inv = np.float32(1.0 / origin[2])
    fx0 = np.float32((camera[0] - origin[0]) / origin[2])
    fy0 = np.float32((camera[1] - origin[1]) / origin[2])
    last_x, last_y = np.float32(shape[1] - 1.01), np.float32(shape[0] - 1.01)
    zero, stride = np.float32(0.0), np.int32(shape[1] * 4)
    for u in range(len(z)):
        # Not min and max, which ask for NaN: so this becomes vector instructions.
        right = fx0 + xn[u] * z[u] * inv
        right = right if right > zero else zero
        right = right if right < last_x else last_x
        down = fy0 - yn[u] * z[u] * inv
        down = down if down > zero else zero
        down = down if down < last_y else last_y
        column, row = np.int32(right), np.int32(down)
        px[u], fx[u], fy[u] = right, right - np.float32(column), down - np.float32(row)
        place[u] = row * stride + column * np.int32(4)


@numba.njit(
    cache=True, nogil=True, _nrt=False, forceinline=True, error_model="numpy", fastmath=True
)
def _look_up(flat, shape, place, fx, fy, height, along_x, along_y, coat):  # type: ignore[no-untyped-def]
    """The map's values between four points."""
    one, stride, four = np.float32(1.0), np.uint64(shape[1] * 4), np.uint64(4)
    i1, i2, i3 = np.uint64(1), np.uint64(2), np.uint64(3)
    for u in range(len(coat)):
        b = np.uint64(place[u])
        c, d = b + four, b + stride
        e = d + four
        w11 = fx[u] * fy[u]
        w10 = fy[u] - w11
        w01 = fx[u] - w11
        w00 = one - fx[u] - w10
        height[u] = w00 * flat[b] + w01 * flat[c] + w10 * flat[d] + w11 * flat[e]
        along_x[u] = (
            w00 * flat[b + i1] + w01 * flat[c + i1] + w10 * flat[d + i1] + w11 * flat[e + i1]
        )
        along_y[u] = (
            w00 * flat[b + i2] + w01 * flat[c + i2] + w10 * flat[d + i2] + w11 * flat[e + i2]
        )
        coat[u] = w00 * flat[b + i3] + w01 * flat[c + i3] + w10 * flat[d + i3] + w11 * flat[e + i3]


@numba.njit(
    cache=True, nogil=True, _nrt=False, forceinline=True, error_model="numpy", fastmath=True
)
def _step(xn, yn, camera, roller, height, z, sx, sy, step, rest):  # type: ignore[no-untyped-def]
    """One step of Newton's towards the skin.

    `sx` and `sy` are the map's slopes and become those of the skin in the camera frame; `rest` is
    the share of the free cylinder in it.
    """
    zero, half, one = np.float32(0.0), np.float32(0.5), np.float32(1.0)
    cz, least = np.float32(camera[2]), np.float32(_MIN_DIVISOR)
    r2, k = np.float32(roller[0] ** 2), np.float32(roller[2])
    half_by_k, edge = np.float32(0.5 / roller[2]), np.float32(_EDGE_MM2)
    for u in range(len(z)):
        # Smooth minimum of contact face and free cylinder, exact beyond +-k.
        x = xn[u] * z[u]
        square = r2 - x * x
        # A very wide view looks past the roller.
        square = square if square > edge else edge
        face, free = cz - height[u], np.float32(math.sqrt(square))
        part = half + (free - face) * half_by_k
        part = part if part > zero else zero
        part = part if part < one else one
        other = one - part
        slope_x = -part * sx[u] - other * x / free
        slope_y = part * sy[u]
        divisor = one - slope_x * xn[u] - slope_y * yn[u]
        divisor = divisor if divisor > least else least
        moved = (z[u] - (part * face + other * free - k * part * other)) / divisor
        z[u] -= moved
        sx[u], sy[u], step[u], rest[u] = slope_x, slope_y, moved, other


@numba.njit(
    cache=True, nogil=True, _nrt=False, forceinline=True, error_model="numpy", fastmath=True
)
def _turn_places(xn, shape, roller, origin, z, step, rest, px, place, fx):  # type: ignore[no-untyped-def]
    """Move places to where the coating that is seen there rolled.

    Off the surface it turns with the roller: further than x by the arc from the patch's border,
    less the chord. `px` are the columns under the rays before the last step.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    radius, half = np.float32(roller[0]), np.float32(roller[1])
    arc_half, inv = np.float32(roller[3]), np.float32(1.0 / origin[2])
    last_x = np.float32(shape[1] - 1.01)
    # Of the arc sine, whose call would keep the loop from becoming vector instructions.
    c3, c5 = np.float32(_ARC_SINE[0]), np.float32(_ARC_SINE[1])
    c7, c9 = np.float32(_ARC_SINE[2]), np.float32(_ARC_SINE[3])
    for u in range(len(z)):
        x = xn[u] * (z[u] + step[u])
        out = abs(x)
        sine = out / radius
        square = sine * sine
        arc = sine * (one + square * (c3 + square * (c5 + square * (c7 + square * c9))))
        extra = radius * (arc - arc_half) - (out - half)
        extra = extra if out > half else zero
        extra = extra if x > zero else -extra
        right = px[u] + rest[u] * extra * inv
        right = right if right > zero else zero
        right = right if right < last_x else last_x
        column = np.int32(right)
        fx[u] = right - np.float32(column)
        place[u] += (column - np.int32(px[u])) * np.int32(4)


@numba.njit(
    cache=True, nogil=True, _nrt=False, forceinline=True, error_model="numpy", fastmath=True
)
def _look_up_coat(flat, shape, place, fx, fy, coat):  # type: ignore[no-untyped-def]
    """The map's log reflectance between four points."""
    stride, four, three = np.uint64(shape[1] * 4), np.uint64(4), np.uint64(3)
    for u in range(len(coat)):
        b = np.uint64(place[u]) + three
        low = flat[b] + fx[u] * (flat[b + four] - flat[b])
        b += stride
        high = flat[b] + fx[u] * (flat[b + four] - flat[b])
        coat[u] = low + fy[u] * (high - low)


@numba.njit(
    cache=True, nogil=True, _nrt=False, forceinline=True, error_model="numpy", fastmath=True
)
def _see_level_row(xn, yn, flat, shape, camera, origin, scratch, z, coat):  # type: ignore[no-untyped-def]
    """What `_trace_row` finds where all of a row touches level plate, of height 0."""
    place, px, fx, fy = scratch[1:5]
    z[:] = np.float32(camera[2])
    _find_places(xn, yn, shape, camera, origin, z, place, px, fx, fy)
    _look_up_coat(flat, shape, place, fx, fy, coat)


@numba.njit(
    cache=True, nogil=True, _nrt=False, forceinline=True, error_model="numpy", fastmath=True
)
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


@numba.njit(
    cache=True, nogil=True, _nrt=False, forceinline=True, error_model="numpy", fastmath=True
)
def _shade_level_row(lit, rise, moved, coat, out):  # type: ignore[no-untyped-def]
    """What `_shade_row` finds on level plate, of height 0.

    `lit` is its log intensity without a coating at one height of the camera, `rise` by how much
    that grows by mm, and `moved` how much higher the camera is.
    """
    up = np.float32(moved)
    for u in range(len(out)):
        out[u] = lit[u] + up * rise[u] + coat[u]

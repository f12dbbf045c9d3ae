"""Nominal form: none, plane, cylinder or polynomial, fitted robustly to the scan itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from roller_core.transforms import F64
from roller_inspect.height_map.height_map import Bools, HeightMap

from .reference import Alignment, Comparison, ReferenceError, rms_robust

Form = Literal["none", "plane", "cylinder", "polynomial2", "polynomial3", "polynomial4"]
_ORDERS = {"none": 0, "plane": 1, "polynomial2": 2, "polynomial3": 3, "polynomial4": 4}
#: Tukey's biweight: 95 % efficient for normal errors.
_TUKEY = 4.685
_ROUNDS = 12
#: Cells that a fit uses at most, evenly spread.
_MOST_CELLS = 20_000
#: Fewest cells a coefficient.
_CELLS_EACH = 10

Model = Callable[[F64, F64], F64]


class NominalReference:
    """A form fitted to the measured cells, Tukey's weights, findings left out.

    Parameters
    ----------
    form : str
        ``none`` (the robot's nominal surface: height 0), ``plane``, ``cylinder`` or
        ``polynomial2`` to ``polynomial4``.
    """

    name = "nominal"
    models_part = False

    def __init__(self, form: Form = "plane") -> None:
        self.form = form

    def compare(self, height_map: HeightMap, masked: Bools | None = None) -> Comparison:
        """See `Reference`."""
        used = height_map.measured(masked)
        rows, columns = np.nonzero(used)
        stride = max(1, len(rows) // _MOST_CELLS)
        rows, columns = rows[::stride], columns[::stride]
        x, y = height_map.x_m[columns], height_map.y_m[rows]
        z = height_map.height_m[rows, columns].astype(np.float64)
        model = self._fit(x, y, z)
        deviation = height_map.height_m - model(height_map.x_m[None, :], height_map.y_m[:, None])
        residual = deviation[used]
        sigma = rms_robust(residual) / np.sqrt(max(len(rows) / 100.0, 1.0))
        return Comparison(
            deviation.astype(np.float32),
            np.full(height_map.shape, sigma, np.float32),
            Alignment("nominal", np.eye(4), (), rms_robust(residual), int(used.sum())),
            by_pose=self.form == "none",
        )

    def _fit(self, x: F64, y: F64, z: F64) -> Model:
        if self.form == "none":
            return lambda px, py: np.zeros(np.broadcast(px, py).shape)
        if self.form == "cylinder":
            return fit_cylinder(x, y, z)
        return fit_polynomial(x, y, z, _ORDERS[self.form])


def fit_polynomial(x: F64, y: F64, z: F64, order: int) -> Model:
    """Robust polynomial of a total order.

    Parameters
    ----------
    x, y, z : ndarray of float64, shape (n,)
        Points, metres.
    order : int
        Total order, 1: plane.

    Raises
    ------
    ReferenceError
        If there are too few points, or all on a line.
    """
    powers = [(i, j) for i in range(order + 1) for j in range(order + 1 - i)]
    if len(z) < _CELLS_EACH * len(powers):
        raise ReferenceError(
            f"reference nominal: {len(z)} measured cells are too few for a polynomial of order "
            f"{order}; the scan has too little texture"
        )
    cx, cy = float(x.mean()), float(y.mean())
    scale = float(max(np.ptp(x), np.ptp(y), 1e-9)) / 2

    def basis(px: F64, py: F64) -> list[F64]:
        u, v = (px - cx) / scale, (py - cy) / scale
        return [u**i * v**j for i, j in powers]

    columns = np.column_stack(basis(x, y))
    low = np.linalg.svd(columns[:: max(1, len(columns) // 2000)], compute_uv=False)
    if low[-1] < 1e-6 * low[0]:
        raise ReferenceError("reference nominal: the measured cells lie on a line; no form fits")
    found = np.zeros(len(powers))
    found[0] = np.median(z)
    # What stands out of a level surface from the start doesn't tilt the form.
    weight = tukey(z - found[0])
    for _ in range(_ROUNDS):
        weighted = columns.T * weight
        found[:] = np.linalg.solve(weighted @ columns, weighted @ z)
        weight = tukey(z - columns @ found)
    return lambda px, py: sum(
        (c * b for c, b in zip(found, basis(px, py), strict=True)),
        start=np.zeros(np.broadcast(px, py).shape),
    )


def fit_cylinder(x: F64, y: F64, z: F64) -> Model:
    """Robust circular cylinder whose axis lies roughly in the map's plane.

    Raises
    ------
    ReferenceError
        If there are too few points, or they show no bend.
    """
    start = fit_polynomial(x, y, z, 2)
    cx, cy = float(x.mean()), float(y.mean())
    scale = float(max(np.ptp(x), np.ptp(y), 1e-9)) / 2
    # Curvatures of the polynomial: the axis lies where it bends least.
    e = scale / 2
    at = [start(np.array(cx + i * e), np.array(cy + j * e)) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    f = np.array(at, np.float64).reshape(3, 3)
    hessian = (
        np.array(
            [
                [f[2, 1] - 2 * f[1, 1] + f[0, 1], (f[2, 2] - f[2, 0] - f[0, 2] + f[0, 0]) / 4],
                [(f[2, 2] - f[2, 0] - f[0, 2] + f[0, 0]) / 4, f[1, 2] - 2 * f[1, 1] + f[1, 0]],
            ]
        )
        / e**2
    )
    values, vectors = np.linalg.eigh(hessian)
    main = int(np.argmax(np.abs(values)))
    if abs(values[main]) < 1e-3:
        raise ReferenceError("reference nominal: the surface doesn't bend; use a plane")
    across = vectors[:, main]
    angle = float(np.arctan2(across[1], across[0]))
    slope = np.array([(f[2, 1] - f[0, 1]) / (2 * e), (f[1, 2] - f[1, 0]) / (2 * e)])
    # Curvature, angle of the direction across the axis, slopes along and across, height.
    guess = np.array(
        [values[main], angle, slope @ [-across[1], across[0]], slope @ across, f[1, 1]]
    )

    def height(p: F64, px: F64, py: F64) -> F64:
        k, phi, tilt, lean, top = p
        dx, dy = px - cx, py - cy
        u = dx * np.cos(phi) + dy * np.sin(phi)
        v = -dx * np.sin(phi) + dy * np.cos(phi)
        # The circle through (0, 0) with slope `lean` and curvature k, free of a pole at k = 0.
        c = 1 / np.sqrt(1 + lean**2)
        root = np.sqrt(np.maximum(c**2 - 2 * k * c * lean * u - (k * u) ** 2, 1e-9))
        bend = (k * u**2 + 2 * c * lean * u) / (c + root)
        return np.asarray(top + tilt * v + bend)

    size = np.array([abs(guess[0]) or 1.0, 0.1, 0.1, 0.1, 1e-4])
    weight, found = np.ones(len(z)), guess
    for _ in range(_ROUNDS // 2):
        w = np.sqrt(weight)
        solved = least_squares(
            lambda p, w=w: w * (height(p, x, y) - z), found, x_scale=size, max_nfev=50
        )
        found = solved.x
        weight = tukey(z - height(found, x, y))
    return lambda px, py: height(found, px, py)


def tukey(residual: npt.NDArray[np.float64], least: float = 0.0) -> F64:
    """Tukey's weights, by the residuals' own robust spread, or a larger one that is given."""
    spread = max(rms_robust(residual), least, 1e-7)
    return np.asarray(np.clip(1 - (residual / (_TUKEY * spread)) ** 2, 0.0, None) ** 2)

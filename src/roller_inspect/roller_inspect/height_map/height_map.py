"""Heights over a grid, each with its standard uncertainty and where it comes from."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from roller_core.errors import RollerError
from roller_core.transforms import F64

F32 = npt.NDArray[np.float32]
U8 = npt.NDArray[np.uint8]
Bools = npt.NDArray[np.bool_]

#: States of a cell: outside what was scanned; not measured, so its height is a guess or missing;
#: continued from measured cells beside it; measured.
OUTSIDE, UNMEASURED, CONTINUED, MEASURED = 0, 1, 2, 3

#: Dimensions and types of its arrays.
_ARRAYS = {
    "x_m": (1, np.float64), "y_m": (1, np.float64), "height_m": (2, np.float32),
    "sigma_m": (2, np.float32), "state": (2, np.uint8), "points": (2, np.uint16),
    "base_from_map": (2, np.float64),
}  # fmt: skip


def centres(first: int, count: int, step_m: float) -> F64:
    """Centres of cells from a number on, metres."""
    return np.asarray((first + np.arange(count) + 0.5) * step_m, np.float64)


class HeightMapError(RollerError):
    """A file that is no height map, or maps that don't fit each other."""


@dataclass(frozen=True)
class HeightMap:
    """Heights over a regular grid."""

    #: Centres of the cells, metres, in the map's frame; steps are equal. Shapes (nx,), (ny,).
    x_m: F64
    y_m: F64
    #: Metres along the map's z, the outward normal; NaN where there is none. Shape (ny, nx).
    height_m: F32
    #: Standard uncertainty of a cell's height, metres; NaN where there is no height. Shape
    #: (ny, nx).
    sigma_m: F32
    #: `OUTSIDE`, `UNMEASURED`, `CONTINUED` or `MEASURED`. Shape (ny, nx).
    state: U8
    #: Measured points in the cell. Shape (ny, nx).
    points: npt.NDArray[np.uint16]
    #: A cell at (x, y, height) lies at ``base_from_map @ [x, y, height, 1]``, metres. Shape (4, 4).
    base_from_map: F64

    @property
    def shape(self) -> tuple[int, int]:
        """Cells along y and x."""
        return self.height_m.shape  # type: ignore[return-value]

    @property
    def step_m(self) -> float:
        """Edge of a cell."""
        for axis in (self.x_m, self.y_m):
            if len(axis) > 1:
                return float(axis[-1] - axis[0]) / (len(axis) - 1)
        return float("nan")

    @property
    def known(self) -> Bools:
        """Cells whose height may be used: measured or continued."""
        return np.asarray(self.state >= CONTINUED)

    def measured(self, masked: Bools | None = None) -> Bools:
        """Cells that were measured and have a height, without those that are masked."""
        used = (self.state == MEASURED) & np.isfinite(self.height_m)
        return used if masked is None else used & ~masked

    def in_base(self, x_m: npt.ArrayLike, y_m: npt.ArrayLike, height_m: npt.ArrayLike) -> F64:
        """Points of the map's frame in base, shape (..., 3), metres."""
        local = np.stack(np.broadcast_arrays(x_m, y_m, height_m), axis=-1).astype(np.float64)
        return np.asarray(local @ self.base_from_map[:3, :3].T + self.base_from_map[:3, 3])

    def cropped(self, x: slice, y: slice) -> HeightMap:
        """The part of some columns and rows."""
        return HeightMap(
            self.x_m[x],
            self.y_m[y],
            self.height_m[y, x],
            self.sigma_m[y, x],
            self.state[y, x],
            self.points[y, x],
            self.base_from_map,
        )

    def save(self, path: Path) -> None:
        """Write `height_map.npz`."""
        np.savez_compressed(path, **vars(self))

    @classmethod
    def load(cls, path: Path) -> HeightMap:
        """Read a `height_map.npz`; `points` may be missing.

        Raises
        ------
        HeightMapError
            If it can't be read or its arrays don't fit each other.
        """
        try:
            with np.load(path, allow_pickle=False) as file:
                found = {name: file[name] for name in file.files}
        except OSError as error:
            raise HeightMapError(f"{path}: no height map can be read ({error})") from error
        except (ValueError, EOFError, zipfile.BadZipFile) as error:
            # What numpy says of these names ways to open a file that may do harm.
            raise HeightMapError(f"{path}: no height map can be read: no NumPy archive") from error
        if "state" in found:
            found.setdefault("points", found["state"] == MEASURED)
        for name, (dimensions, _) in _ARRAYS.items():
            if name not in found or found[name].ndim != dimensions:
                raise HeightMapError(f"{path}: no height map: '{name}' is missing or misshapen")
        shape = (len(found["y_m"]), len(found["x_m"]))
        grids = [found[name] for name in ("height_m", "sigma_m", "state", "points")]
        if any(grid.shape != shape for grid in grids) or min(shape) < 1:
            raise HeightMapError(f"{path}: no height map: its grids are not {shape} cells")
        if found["base_from_map"].shape != (4, 4):
            raise HeightMapError(f"{path}: no height map: 'base_from_map' is not 4×4")
        return cls(**{name: found[name].astype(kind) for name, (_, kind) in _ARRAYS.items()})

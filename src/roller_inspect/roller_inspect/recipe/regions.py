"""Regions of a part, as a recipe names them."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from roller_core.settings import Settings

Mask = npt.NDArray[np.bool_]

#: No robot's part is larger or farther away, m: a number beyond is in another unit.
FARTHEST_M = 5.0


class Region(Settings):
    """A box, polygon or circle in the recipe's frame, metres; one of the three."""

    box_m: tuple[float, float, float, float] | None = Field(
        None, description="Lowest x, lowest y, highest x, highest y."
    )
    polygon_m: tuple[tuple[float, float], ...] | None = Field(
        None, description="Corners x, y in order; at least three."
    )
    circle_m: tuple[float, float, float] | None = Field(None, description="Middle x, y and radius.")

    @model_validator(mode="after")
    def _check(self) -> Region:
        given = [f for f in (self.box_m, self.polygon_m, self.circle_m) if f is not None]
        if len(given) != 1:
            raise ValueError("a region is one of box_m, polygon_m and circle_m")
        if self.box_m and not (self.box_m[0] < self.box_m[2] and self.box_m[1] < self.box_m[3]):
            raise ValueError("box_m is lowest x, lowest y, highest x, highest y")
        if self.polygon_m is not None and len(self.polygon_m) < 3:
            raise ValueError("polygon_m needs three corners or more")
        if self.circle_m and self.circle_m[2] <= 0:
            raise ValueError("circle_m is middle x, y and a radius above 0")
        farthest = float(np.abs(self.outline()).max())
        if not farthest <= FARTHEST_M:
            raise ValueError(f"it reaches to {farthest:g} m; recipes are in metres")
        if self.polygon_m is not None and _crosses(self.outline()):
            raise ValueError("polygon_m crosses itself: give its corners in order")
        if self.area_m2 < 5e-13:
            raise ValueError("its corners lie on a line")
        return self

    def outline(self) -> npt.NDArray[np.float64]:
        """Corners in the recipe's frame, shape (n, 2), metres; of a circle 64."""
        if self.box_m is not None:
            x0, y0, x1, y1 = self.box_m
            return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
        if self.polygon_m is not None:
            return np.array(self.polygon_m)
        assert self.circle_m is not None
        x, y, r = self.circle_m
        a = np.linspace(0, 2 * np.pi, 64, endpoint=False)
        return np.stack([x + r * np.cos(a), y + r * np.sin(a)], axis=-1)

    @property
    def area_m2(self) -> float:
        """Of the region, whatever of it a scan reached."""
        if self.circle_m is not None:
            return math.pi * self.circle_m[2] ** 2
        corners = self.outline()
        x, y = (corners - corners[0]).T
        return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2

    def contains(self, x: npt.ArrayLike, y: npt.ArrayLike) -> Mask:
        """Which places of the recipe's frame, metres, lie inside."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        if self.box_m is not None:
            x0, y0, x1, y1 = self.box_m
            return np.asarray((x >= x0) & (x <= x1) & (y >= y0) & (y <= y1))
        if self.circle_m is not None:
            cx, cy, r = self.circle_m
            return np.asarray(np.hypot(x - cx, y - cy) <= r)
        return in_polygon(self.outline(), x, y)


def in_polygon(corners: npt.NDArray[np.float64], x: npt.ArrayLike, y: npt.ArrayLike) -> Mask:
    """Which places lie in a polygon with these corners, shape (n, 2)."""
    x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
    inside = np.zeros(x.shape, bool)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y0 != y1:  # a line to the right crosses an odd number of sides
            inside ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return inside


def _crosses(corners: npt.NDArray[np.float64]) -> bool:
    """Whether an edge of a polygon crosses another one."""
    starts, ends = corners, np.roll(corners, -1, axis=0)
    for start, end in zip(starts, ends, strict=True):
        # Edges whose ends lie on either side of this one, and on either side of which its ends lie.
        over = _side(start, end, starts) * _side(start, end, ends) < 0
        a, b = starts[over], ends[over]
        if (_side(a, b, start) * _side(a, b, end) < 0).any():
            return True
    return False


def _side(
    start: npt.NDArray[np.float64], end: npt.NDArray[np.float64], place: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """On which side of edges places lie, 1 or -1; 0 on them, but for rounding."""
    along, away = end - start, place - start
    turn = along[..., 0] * away[..., 1] - along[..., 1] * away[..., 0]
    size = np.abs(along).max(axis=-1) * np.abs(away).max(axis=-1)
    return np.where(np.abs(turn) > 1e-9 * size, np.sign(turn), 0.0)

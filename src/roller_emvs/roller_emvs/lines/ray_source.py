"""Rays that lines are fitted to: in an array, or made anew each time they are needed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from roller_emvs.evidence.field import ground
from roller_emvs.rays import F32

from . import _kernels as kernels

I32 = npt.NDArray[np.int32]


class RaySource(Protocol):
    """Rays of one polarity: x, y on the plane of offset 0, px, and slopes, px by offset."""

    def ground(self, surface: F32) -> tuple[I32, I32]:
        """Pixel in which each ray meets a surface, and how many meet each; see `field.ground`."""

    def by_pixel(self, pixel: I32, place: I32, out: F32) -> None:
        """Write rays in the order of their pixels.

        Parameters
        ----------
        pixel : ndarray of int32, shape (n,)
            As `ground` gave them.
        place : ndarray of int32, shape (pixels + 1,)
            Where each pixel's rays begin in `out`, below 0 for none; it is used up.
        out : ndarray of float32, shape (m, 4)
            Takes them.
        """

    def array(self) -> F32:
        """All of them, float32, shape (n, 4)."""


@dataclass(frozen=True)
class RayArray:
    """A `RaySource` of an array, float32, shape (n, 4)."""

    rays: F32

    def ground(self, surface: F32) -> tuple[I32, I32]:
        """See `RaySource`."""
        return ground(self.rays, surface)

    def by_pixel(self, pixel: I32, place: I32, out: F32) -> None:
        """See `RaySource`."""
        kernels._by_pixel(self.rays, pixel, place, out)

    def array(self) -> F32:
        """See `RaySource`."""
        return self.rays

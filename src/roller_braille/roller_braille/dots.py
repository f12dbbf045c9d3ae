"""Finding what may be dots in the mosaic: spots of events with little around them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from .kinds import Kind
from .reader_settings import Spacing
from .strip import PX_M, Strip
from .warp import F32, F64

#: Pixel in which dots are searched.
_COARSE_M = 0.00018
#: Radii, in dots' base radii, of what counts as the dot; beyond lies what should be empty.
SPOT = 1.25
_RIM = 1.35
#: A spot must stand out from what chance gives by so many times the root of what lies around.
CHANCE = 6.0
#: Events, above those around it, that a spot needs.
LEAST_VOTES = 40.0


@dataclass(frozen=True)
class Dots:
    """Spots found, in order of travel."""

    #: Place: travel along the roll and place down the image, metres. Shape (n,).
    along: F64
    down: F64
    #: Events in the spot above those around it. Shape (n,).
    votes: F64

    @classmethod
    def none(cls) -> Dots:
        """No spots."""
        return cls(np.empty(0), np.empty(0), np.empty(0))

    def __len__(self) -> int:
        return len(self.along)

    def where(self, keep: npt.NDArray[Any]) -> Dots:
        """Those that a mask or index picks."""
        return Dots(self.along[keep], self.down[keep], self.votes[keep])

    def joined(self, other: Dots) -> Dots:
        """These and others, in order of travel."""
        along = np.concatenate([self.along, other.along])
        order = np.argsort(along, kind="stable")
        return Dots(
            along[order],
            np.concatenate([self.down, other.down])[order],
            np.concatenate([self.votes, other.votes])[order],
        )


def _disc(radius_px: float) -> F32:
    n = int(np.ceil(radius_px))
    y, x = np.mgrid[-n : n + 1, -n : n + 1]
    return np.clip(radius_px + 0.5 - np.hypot(x, y), 0.0, 1.0).astype(np.float32)


def _one_each(found: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Rows and columns of the first of the pixels that touch, of each spot."""
    # Where nothing lies around, a spot's events are as many from several places.
    labels = cv2.connectedComponents(found.astype(np.uint8))[1]
    r, c = np.nonzero(found)
    first = np.unique(labels[r, c], return_index=True)[1]
    return r[first], c[first]


class DotFinder:
    """Searches a strip for spots the size of dots.

    Parameters
    ----------
    spacing : Spacing
        Pitch and diameter of dots.
    """

    def __init__(self, spacing: Spacing) -> None:
        self._factor = max(round(_COARSE_M / PX_M), 1)
        px = self._factor * PX_M
        inner = spacing.dot_diameter_m / 2 * SPOT
        rim = spacing.dot_diameter_m / 2 * _RIM
        outer = max(spacing.dot_pitch_m - inner, rim + px)
        self._spot = _disc(inner / px)
        ring = _disc(outer / px)
        middle = len(ring) // 2
        hole = _disc(rim / px)
        reach = len(hole) // 2
        ring[middle - reach : middle + reach + 1, middle - reach : middle + reach + 1] -= hole
        self._area_px = float(self._spot.sum()) * self._factor**2
        self._ring = ring * (self._spot.sum() / ring.sum())
        self._apart = 2 * int(spacing.dot_pitch_m / 2 / px) + 1
        #: What a search needs to know on either side, columns.
        self.margin = self._factor * (middle + self._apart)

    def look_at_coating(self, strip: Strip, a: int, b: int, settled: bool) -> bool:
        """Learn from columns a to b (b excluded) what the coating is; see `Strip.learn_coating`."""
        return strip.learn_coating(a, b, self._area_px, LEAST_VOTES, settled)

    def find(self, strip: Strip, a: int, b: int, kind: Kind, learn: bool = True) -> Dots:
        """Spots whose middle lies in columns a to b (b excluded).

        Parameters
        ----------
        strip : Strip
            The mosaic.
        a, b : int
            Columns.
        kind : Kind
            Events to look at.
        learn : bool
            Whether the background is taken from these columns too.
        """
        if b <= a:
            return Dots.none()
        f = self._factor
        # Coarse pixels keep their place on the surface, whatever part is searched.
        lo, hi = (a - self.margin) // f * f, -(-(b + self.margin) // f) * f
        fine = strip.image(lo, hi, kind)
        if learn:
            strip.learn_background(a, b, kind)
        rows = fine.shape[0] // f
        coarse = cv2.resize(fine[: rows * f], ((hi - lo) // f, rows), interpolation=cv2.INTER_AREA)
        coarse *= np.float32(f * f)
        if coarse.sum() < LEAST_VOTES:  # all of them are no dot
            return Dots.none()
        spots = cv2.filter2D(coarse, -1, self._spot, borderType=cv2.BORDER_CONSTANT)
        around = cv2.filter2D(coarse, -1, self._ring, borderType=cv2.BORDER_CONSTANT)
        votes = spots - around
        size = (self._apart, self._apart)
        peak = cv2.dilate(votes, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, size))
        # Chance varies as the root of what is counted.
        gain = strip.exposure.gain(lo, hi).reshape(-1, f).mean(axis=1)
        coating = 0.0 if kind is Kind.BOTH else strip.coating(self._area_px)
        least = LEAST_VOTES + CHANCE * np.hypot(np.sqrt(np.maximum(around, 0.0)), coating)
        least *= gain  # what was seen shortly is made up, and its chance variation with it
        found = (votes >= peak) & (votes >= least)
        r, c = _one_each(found)
        inside = (c * f + lo >= a) & (c * f + lo < b)
        r, c = r[inside], c[inside]
        if not len(r):
            return Dots.none()
        x, y = self._centroids(coarse, r, c)
        along = (lo + (x + 0.5) * f) * strip.px_m
        down = strip.top_m + (y + 0.5) * f * strip.px_m
        order = np.argsort(along, kind="stable")
        return Dots(along[order], down[order], votes[r, c].astype(np.float64)[order])

    def _centroids(self, coarse: F32, r: npt.NDArray[Any], c: npt.NDArray[Any]) -> tuple[F64, F64]:
        n = len(self._spot) // 2
        dy, dx = np.mgrid[-n : n + 1, -n : n + 1]
        rows = np.clip(r[:, None, None] + dy, 0, coarse.shape[0] - 1)
        columns = np.clip(c[:, None, None] + dx, 0, coarse.shape[1] - 1)
        w = coarse[rows, columns].astype(np.float64) * self._spot
        total = np.maximum(w.sum(axis=(1, 2)), 1e-9)
        return (
            c + (w * dx).sum(axis=(1, 2)) / total,
            r + (w * dy).sum(axis=(1, 2)) / total,
        )

"""Which dots of a cell are raised.

A raised dot has events on all its sides, about as many as the dots of its line have; their
logarithms are spread about a typical one's. An empty place has next to none. What lies between is
neither, a worn dot or other relief, and is not guessed. Beside that stands what the paper does: the
circles found in the cleaned image, without which a cell is none of Braille.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from .circles import CircleFinder
from .dots import SPOT
from .reader_settings import Spacing
from .strip import PX_M
from .warp import F32, F64

# Tuned on the virtual cell at contrasts of 61 to 100 % of the default, and on synthetic plates with
# worn, broken and misplaced dots.
#: Share of a typical dot's events that any dot has, and share of the faintest dot's that may be
#: left of a worn one: with less than both a place is empty, surely so with half of that.
LEAST_SHARE, _LEFT = 0.3, 0.6
#: Events by those of the line's faintest dot at which a spot is no dot, and surely one.
_NO_DOT, _DOT = 0.75, 1.0
#: Most of what lies beside a cell's dots that may lie in one place.
_IN_ONE_PLACE = 0.5
#: What a dot's weakest side has by what the line's less complete dots have there: half a dot, and
#: surely a whole one.
_HALF, _WHOLE = 0.4, 0.7
#: A side of a typical dot with less than this share of its events says nothing.
_TELLING = 0.3
#: How far off its node a dot may lie, and where it is none of the cell's, metres: of the
#: virtual cell's dots at 70 % contrast one in a hundred lies further off than the first.
IN_PLACE_M, ASTRAY_M = 2e-4, 3.2e-4


def certainty(value: npt.ArrayLike, none: float, full: float) -> F64:
    """0 at one limit, 1 at the other, straight in between and level beyond."""
    return np.asarray(np.clip((np.asarray(value) - none) / (full - none), 0.0, 1.0))


@dataclass(frozen=True)
class Energies:
    """Events above the background at the six nodes of a cell."""

    #: All of the spot. Shape (6,).
    whole: F64
    #: Its half further along the roll, and that behind; its lower half, and its upper. Shape
    #: (6, 4).
    halves: F64
    #: All of the cell's tile: from half way to the cell before to half way to the next, and from
    #: half way to the line above to half way to the one below.
    total: float
    #: Events that a spot holds without a dot.
    background: float
    #: How far off its node the dot lies that was found there, metres. Shape (6,).
    off_m: F64 = field(default_factory=lambda: np.zeros(6))


@dataclass(frozen=True)
class Reference:
    """What a raised dot of a line has."""

    #: Events of a typical dot.
    whole: float
    #: Those of the faintest dot that the line may have, by the spread of its dots.
    faintest: float
    #: What a dot's halves (see `Energies`) hold of its events. Shape (4,).
    shares: F64
    #: Completeness of a dot that is less complete than most, see `completeness`.
    complete: float
    #: How sure it is, 0 to 1, that the faintest dot of the line stands out of noise. Where it might
    #: not, a place without events may hold a dot.
    visible: float

    @property
    def trace(self) -> float:
        """Events from which on a place is not empty."""
        return min(LEAST_SHARE * self.whole, _LEFT * self.faintest)


@dataclass(frozen=True)
class Reading:
    """Which dots of a cell are raised, by node: the first column from the top, then the second."""

    #: More likely raised than not. Shape (6,).
    raised: npt.NDArray[np.bool_]
    #: How sure, 0 to 1. Shape (6,).
    confidence: F64
    #: Share of the tile's events that lie within raised dots.
    explained: float
    #: Events of the tile, in those of a dot.
    filled: float
    #: Raised dots at which a circle was found.
    circles: int


class Recogniser:
    """Reads single cells.

    Parameters
    ----------
    spacing : Spacing
        Pitches and diameter of dots.
    """

    def __init__(self, spacing: Spacing) -> None:
        spot = spacing.dot_diameter_m / 2 / PX_M * SPOT
        n = int(np.ceil(spot))
        y, x = np.mgrid[-n : n + 1, -n : n + 1]
        inside = np.hypot(x, y) <= spot
        halves = np.stack([x > 0, x < 0, y > 0, y < 0]) + 0.5 * np.stack(
            [x == 0, x == 0, y == 0, y == 0]
        )
        self._n = n
        #: Columns and rows to cut out around nodes, so that their spots lie within.
        self.reach = n + 1
        #: Columns and rows to cut out around nodes, so that a cell's tile lies within.
        between = spacing.cell_pitch_m - spacing.dot_pitch_m
        between_lines = spacing.line_pitch_m - 2 * spacing.dot_pitch_m
        self.margin = int(np.ceil(max(between, between_lines) / PX_M))
        self._masks = (halves * inside).astype(np.float32)
        self.area = float(inside.sum())
        self._circles = CircleFinder(spacing, PX_M)

    def measure(self, image: F32, at: F64, tile: F64, level: float) -> Energies:
        """Count events at the nodes of a cell.

        Parameters
        ----------
        image : ndarray of float32
            Part of the mosaic around the cell.
        at : ndarray, shape (6, 2)
            Nodes: column and row in `image`.
        tile : ndarray, shape (4, 2)
            Corners of the cell's tile: column and row in `image`.
        level : float
            Events a pixel of the background.
        """
        inside = np.zeros(image.shape, np.uint8)
        # Filling takes in its edge: half a pixel less all around.
        middle = tile.mean(axis=0)
        corners = np.round(tile - 0.5 - 0.5 * np.sign(tile - middle)).astype(np.int32)
        cv2.fillConvexPoly(inside, corners, 1)
        halves = self.halves(image, at, level)
        total = float((image * inside).sum()) - level * float(inside.sum())
        return Energies(halves[:, :2].sum(axis=1), halves, total, level * self.area)

    def halves(self, image: F32, at: F64, level: float) -> F64:
        """Events above the background in the halves of spots, shape (n, 4); see `measure`."""
        n = self._n
        padded = cv2.copyMakeBorder(image, n, n, n, n, cv2.BORDER_CONSTANT)
        out = np.zeros((len(at), len(self._masks)))
        for i, (c, r) in enumerate(np.floor(at + 0.5).astype(int)):
            if 0 <= c < image.shape[1] and 0 <= r < image.shape[0]:
                window = padded[r : r + 2 * n + 1, c : c + 2 * n + 1]
                out[i] = (self._masks * window).sum(axis=(1, 2))
        return out - level * self._masks.sum(axis=(1, 2))

    def read(self, image: F32, at: F64, energies: Energies, reference: Reference) -> Reading:
        """Find which dots are raised.

        Parameters
        ----------
        image, at
            See `measure`.
        energies : Energies
            What `measure` found.
        reference : Reference
            What raised dots of this line have.
        """
        # What lies about between dots may lie on an empty place as well.
        found = float(energies.whole[energies.whole > reference.trace].sum())
        astray = _IN_ONE_PLACE * max(energies.total - found, 0.0)
        shares = energies.halves / np.maximum(energies.whole, 1e-9)[:, None]
        faintest = max(reference.faintest, LEAST_SHARE * reference.whole, astray)
        dot = certainty(energies.whole / faintest, _NO_DOT, _DOT)
        complete = completeness(shares, reference.shares) / reference.complete
        dot = dot * certainty(complete, _HALF, _WHOLE)
        empty = certainty(energies.whole, reference.trace, reference.trace / 2)
        raised = dot > empty
        in_place = certainty(energies.off_m, ASTRAY_M, IN_PLACE_M)
        confidence = np.where(raised, dot * in_place, (empty - dot) * reference.visible)
        # A cell of which not even half the dots show as circles is too faint to be sure of.
        circles = self._circles.find(image, at, 4.0 * reference.whole / self.area)
        if raised.any():
            confidence = confidence * min(2.0 * float(circles[raised].mean()), 1.0)
        held = float(np.maximum(energies.whole, 0.0)[raised].sum())
        return Reading(
            raised,
            confidence,
            share(held, energies.total),
            energies.total / reference.whole,
            int(circles[raised].sum()),
        )


def completeness(shares: F64, expected: F64) -> F64:
    """What the weakest side of dots has of what it should, shape (n,).

    Parameters
    ----------
    shares : ndarray, shape (n, 4)
        What the halves of dots hold of their events.
    expected : ndarray, shape (4,)
        What they hold of a typical dot's; a side that has few events at all says nothing.
    """
    telling = expected >= _TELLING
    return np.asarray(np.where(telling, shares / expected, 1.0).min(axis=1))


def share(held: float, total: float) -> float:
    """What dots hold of all events, 0 to 1.

    Dots that hold far more than there is stand on a background taken for higher than it is: then
    nothing is known, which counts as 0.
    """
    return min(held / total, 1.0) if total > held / 2 and total > 0 else 0.0

"""Telling which dots of a cell are raised.

A cell's part of the mosaic is cleaned (bilateral filter, CLAHE, threshold, opening, closing), cut
into six squares and each searched for a circle, as the paper does. Beside that stands the evidence
of the events themselves: how many lie within a dot's place, and whether all its sides have them,
both against what the dots of the same line have. A dot is raised or not only where these agree.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from .dots import SPOT
from .reader_settings import BrailleSettings
from .warp import F32, F64

#: Share of a dot's events at which a place is certainly empty, and at which it certainly is not, at
#: least; with dots that are alike, it is this share of a weak one.
EMPTY, FILLED, _OF_WEAK = 0.1, 0.3, 0.75
#: How much more that has to be, for the share of events that lies between dots.
_OF_SMEAR = 1.5
#: Completeness at which a dot is certainly complete (within limits, that share of a less complete
#: one of its line), and the part of it at which it certainly is broken.
_COMPLETE, _BROKEN = (0.25, 0.6), 0.35
_TELLING = 0.3
#: Strength of a line's weak dots, against typical ones, at which dots differ much, and are alike.
_UNLIKE, _ALIKE = 0.4, 0.7
#: Events over the background, in units of their chance variation, that are noise and something.
_NOISE, _SOMETHING = 3.0, 8.0
#: Share of a typical dot's events that is next to nothing, and that may be a very faint dot.
_TRACE, _SLIGHT = 0.04, 0.12
#: How far off its node a dot may lie, and where it is none of the cell's.
_IN_PLACE_M, _ASTRAY_M = 2e-4, 3.2e-4
#: Share of a typical dot's events that may be left by others, and that of a worn dot.
_LEFT_OVER, _WORN = 0.15, 0.3
#: Evidence at which a dot is as likely raised as not, and that of a sure one.
_EVEN, _SURE = 0.5, 1.0


@dataclass(frozen=True)
class Energies:
    """Events above the background at the six nodes of a cell.

    Attributes
    ----------
    whole : ndarray, shape (6,)
        All of the spot.
    halves : ndarray, shape (6, 4)
        Its half further along the roll, and that behind; its lower half, and its upper.
    total : float
        All of the cell's tile: from half way to the cell before to half way to the next, and from
        half way to the line above to half way to the one below.
    background : float
        Events that a spot holds without a dot.
    off_m : ndarray, shape (6,)
        How far off its node the dot lies that was found there, metres.
    """

    whole: F64
    halves: F64
    total: float
    background: float
    off_m: F64 = field(default_factory=lambda: np.zeros(6))


@dataclass(frozen=True)
class Reference:
    """What a raised dot of a line has.

    Attributes
    ----------
    whole : float
        Events of a typical dot.
    weak : float
        Those of a weak one, as a share of that.
    shares : ndarray, shape (4,)
        What a dot's halves (see `Energies`) hold of its events.
    complete : float
        Completeness of a dot that is less complete than most, see `completeness`.
    visible : float
        How sure it is, 0 to 1, that the faintest dot of the line would be told from noise. Where
        it might not, a place without events may hold a dot.
    """

    whole: float
    weak: float
    shares: F64
    complete: float
    visible: float


@dataclass(frozen=True)
class Reading:
    """Which dots of a cell are raised, by node: the first column from the top, then the second.

    Attributes
    ----------
    raised : ndarray of bool, shape (6,)
        More likely raised than not.
    confidence : ndarray, shape (6,)
        How sure, 0 to 1.
    explained : float
        Share of the tile's events that lie within raised dots.
    filled : float
        Events of the tile, in those of a dot.
    circles : int
        Raised dots at which a circle was found.
    """

    raised: npt.NDArray[np.bool_]
    confidence: F64
    explained: float
    filled: float
    circles: int


class Recogniser:
    """Reads single cells.

    Parameters
    ----------
    settings : BrailleSettings
        Filters, thresholds, weights.
    """

    def __init__(self, settings: BrailleSettings) -> None:
        self._settings = settings
        s = settings.spacing
        px = settings.strip_px_m
        self._px = px
        self._radius_px = s.dot_diameter_m / 2 / px
        spot = self._radius_px * SPOT
        n = int(np.ceil(spot))
        y, x = np.mgrid[-n : n + 1, -n : n + 1]
        inside = np.hypot(x, y) <= spot
        halves = np.stack([x > 0, x < 0, y > 0, y < 0]) + 0.5 * np.stack(
            [x == 0, x == 0, y == 0, y == 0]
        )
        self._reach = n
        #: Columns and rows to cut out around nodes, so that a cell's tile lies within.
        self.margin = int(
            np.ceil(max(s.cell_pitch_m - s.dot_pitch_m, s.line_pitch_m - 2 * s.dot_pitch_m) / px)
        )
        self._masks = (halves * inside).astype(np.float32)
        self.area = float(inside.sum())
        self._square = round(s.dot_pitch_m / px)
        size = settings.morphology_px
        self._element = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
        self._clahe = cv2.createCLAHE(
            settings.clahe_clip, (settings.clahe_tiles, settings.clahe_tiles)
        )

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
        n = self._reach
        padded = cv2.copyMakeBorder(image, n, n, n, n, cv2.BORDER_CONSTANT)
        out = np.zeros((len(at), len(self._masks)))
        for i, (c, r) in enumerate(np.floor(at + 0.5).astype(int)):
            if 0 <= c < image.shape[1] and 0 <= r < image.shape[0]:
                window = padded[r : r + 2 * n + 1, c : c + 2 * n + 1]
                out[i] = (self._masks * window).sum(axis=(1, 2))
        return out - level * self._masks.sum(axis=(1, 2))

    def read(self, image: F32, at: F64, energies: Energies, reference: Reference) -> Reading:
        """Tell which dots are raised.

        Parameters
        ----------
        image, at
            See `measure`.
        energies : Energies
            What `measure` found.
        reference : Reference
            What raised dots of this line have.
        """
        whole = np.clip(energies.whole / reference.whole, 0.0, None)
        shares = energies.halves / np.maximum(energies.whole, 1e-9)[:, None]
        enough = float(np.clip(_OF_WEAK * reference.complete, *_COMPLETE))
        broken = enough * _BROKEN
        complete = completeness(shares, reference.shares)
        complete = np.clip((complete - broken) / (enough - broken), 0.0, 1.0)
        # Where all dots are alike, half of one is none; where they differ, it may be a weak one.
        # And what lies about between dots may lie on an empty place as well.
        found = energies.whole[whole > EMPTY].sum()
        smear = 1.0 - share(float(found), energies.total)
        least = min(FILLED + _OF_SMEAR * smear, _OF_WEAK)
        full = np.clip(_OF_WEAK * reference.weak, least, _OF_WEAK)
        filled = np.clip((whole - EMPTY) / (full - EMPTY), 0.0, 1.0)
        circles = self._circles(image, at, reference)
        w = self._settings.hough_weight
        evidence = filled * ((1 - w) * complete + w * circles)
        sure = np.clip((evidence - _EVEN) / (_SURE - _EVEN), 0.0, 1.0)
        placed = np.clip((_ASTRAY_M - energies.off_m) / (_ASTRAY_M - _IN_PLACE_M), 0.0, 1.0)
        # Where dots differ much, one may be hardly there: a place is empty that holds but noise, or
        # next to nothing.
        odds = energies.whole / np.sqrt(energies.background + 1.0)
        noise = np.clip((_SOMETHING - odds) / (_SOMETHING - _NOISE), 0.0, 1.0)
        alike = np.clip((reference.weak - _UNLIKE) / (_ALIKE - _UNLIKE), 0.0, 1.0)
        trace = np.clip((_SLIGHT - whole) / (_SLIGHT - _TRACE), 0.0, 1.0)
        empty = np.minimum(1.0 - filled, np.maximum(np.maximum(noise, trace), alike))
        # Part of a dot is neither: a worn dot perhaps.
        empty = np.minimum(empty, np.clip((_WORN - whole) / (_WORN - _LEFT_OVER), 0.0, 1.0))
        raised = sure > empty
        confidence = np.where(raised, (sure - empty) * placed, (empty - sure) * reference.visible)
        # A cell in which hardly a circle shows is too faint to be sure of its empty places either.
        shown = 2 * circles[raised].sum() / max(raised.sum(), 1)
        confidence = confidence * (min(shown, 1.0) if raised.any() else 1.0)
        held = float(np.maximum(energies.whole, 0.0)[raised].sum())
        return Reading(
            raised,
            confidence,
            share(held, energies.total),
            energies.total / reference.whole,
            int(circles[raised].sum()),
        )

    def clean(self, image: F32, reference: Reference) -> npt.NDArray[np.uint8]:
        """The paper's preprocessing: uint8 image of 0 and 255, shape as `image`."""
        s = self._settings
        full = 4.0 * reference.whole / self.area
        grey = np.clip(image * (255.0 / max(full, 1e-9)), 0, 255).astype(np.uint8)
        if s.bilateral_px > 1:
            grey = cv2.bilateralFilter(grey, s.bilateral_px, s.bilateral_sigma, s.bilateral_px)
        if s.clahe_clip > 0:
            grey = self._clahe.apply(grey)
        binary = cv2.threshold(grey, 255 * s.threshold, 255, cv2.THRESH_BINARY)[1]
        if s.morphology_px > 1:
            binary = cv2.morphologyEx(binary, cv2.MORPH_CLOSE, self._element)
            binary = cv2.morphologyEx(binary, cv2.MORPH_OPEN, self._element)
        return np.asarray(binary, np.uint8)

    def _circles(self, image: F32, at: F64, reference: Reference) -> F64:
        """Whether a circle the size of a dot is found in each of the six squares."""
        s = self._settings
        half = self._square // 2
        binary = self.clean(image, reference)
        padded = cv2.copyMakeBorder(binary, half, half, half, half, cv2.BORDER_CONSTANT)
        low = self._radius_px * (1 - s.hough_radius_tolerance)
        high = self._radius_px * (1 + s.hough_radius_tolerance)
        found = np.zeros(len(at))
        for i, (c, r) in enumerate(np.floor(at + 0.5).astype(int)):
            if not (0 <= c < image.shape[1] and 0 <= r < image.shape[0]):
                continue
            square = np.ascontiguousarray(padded[r : r + 2 * half + 1, c : c + 2 * half + 1])
            if not square.any():
                continue
            circles = cv2.HoughCircles(
                square, cv2.HOUGH_GRADIENT, 1, minDist=4 * half, param1=200,
                param2=s.hough_votes, minRadius=int(low), maxRadius=int(np.ceil(high)),
            )  # fmt: skip
            if circles is not None:
                x, y, _ = circles[0, 0]
                found[i] = float(np.hypot(x - half, y - half) <= half / 2)
        return found


def completeness(shares: F64, expected: F64) -> F64:
    """What the weakest side of dots has of what it should, shape (n,).

    Parameters
    ----------
    shares : ndarray, shape (n, 4)
        What the halves of dots hold of their events.
    expected : ndarray, shape (4,)
        What they hold of a typical dot's; a side that has few events at all tells nothing.
    """
    telling = expected >= _TELLING
    return np.asarray(np.where(telling, shares / expected, 1.0).min(axis=1))


def share(held: float, total: float) -> float:
    """What dots hold of all events, 0 to 1.

    Dots that hold far more than there is stand on a background taken for higher than it is: then
    nothing is known, which counts as 0.
    """
    return min(held / total, 1.0) if total > held / 2 and total > 0 else 0.0

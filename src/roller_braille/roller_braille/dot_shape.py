"""What a dot of a line looks like on a printed coating, and which places look like it.

A coating's spots leave as many ON as OFF events, a dot's flanks more of the one here and of the
other there, in a pattern that the light gives all dots of a line alike. The mean of the dots that
were found is that pattern. How much of it a place holds is told apart from the coating far better
than how many events of one kind it has: all of the pattern counts, with its sign, and of what
chance adds, most cancels.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from . import _kernels as kernels
from .dots import Dots
from .reader_settings import Spacing
from .recognise import ASTRAY_M, IN_PLACE_M, Reading, certainty, share
from .strip import Strip, net_around
from .warp import F32, F64

#: Pixels of the mosaic that make up one of a pattern's, along and down.
_FACTOR = 4
#: Dots that the pattern is the mean of, and the fewest.
_MOST_DOTS, _LEAST_DOTS = 24, 3
#: How far from a dot's place the middle of its pattern may lie, by the pitch of dots; and a dot's
#: pattern from where it was found or the lattice has it, at most and usually, in its pixels.
_ASIDE, _SHIFT, _AWAY = 0.35, 2, 0.5
#: Share of a typical dot's pattern that one needs to have a part in the mean; how many times the
#: first dots are laid over each other.
_PART, _ROUNDS = 0.5, 2
#: Share of a pattern's squares that is no chance at the least.
_SURE = 0.3
#: Share of a dot's events that an empty place may show of something else, and at which it isn't
#: known for empty.
_ELSE = (1.0, 0.5)
#: Cells over which is looked how much chance holds of the pattern, and the share of their places
#: where no relief is taken to be; how far chance lies off there, by its spread.
_CELLS, _LEVEL, _LEVEL_WITHIN = 12, 0.25, 0.319
#: Share of the pattern up to which a place is empty and from which on it is a dot, at least, and by
#: the spread of what chance holds of it.
_EMPTY, _DOT = (0.25, 2.0), (0.56, 5.0)
#: Share of what a place shows that the pattern makes up at which it is something else, and at which
#: it is a dot.
_ALIKE = (0.15, 0.35)
#: Times what a quiet place shows up to which an empty one shows nothing.
_QUIET = 3.0


@dataclass(eq=False)
class _Dot:
    """A spot that was found, and what lies around it."""

    along: float
    down: float
    votes: float
    #: ON less OFF events in a pattern's pixels. Shape (n, n).
    patch: F32
    #: Where the pattern lies best, from the spot's place, in its pixels: down and along; the same
    #: along and down, between the pixels; and how much of it is there.
    top: int = 0
    left: int = 0
    off: tuple[float, float] = (0.0, 0.0)
    held: float = 1.0


class DotShape:
    """The pattern of a line's dots, learnt as they come.

    Parameters
    ----------
    spacing : Spacing
        Pitch of dots.
    px_m : float
        Pixel of the mosaic, metres.
    """

    def __init__(self, spacing: Spacing, px_m: float) -> None:
        self._px_m, pitch_px = px_m, spacing.dot_pitch_m / px_m
        #: Pixels of a pattern, along and down; of what is cut out to look for it.
        self._size = int(pitch_px // _FACTOR)
        self._aside = int(np.ceil(_ASIDE * pitch_px / _FACTOR))
        self._wide = self._size + 2 * (self._aside + _SHIFT)
        #: Columns and rows to cut out around dots.
        self.reach = _FACTOR * self._wide // 2 + 1
        self._found: deque[_Dot] = deque(maxlen=_MOST_DOTS)
        self._added = 0
        # First row and column of the pattern in what is cut out.
        self._row = self._column = self._aside + _SHIFT
        self._spreads: deque[float] = deque(maxlen=_CELLS)
        self._levels: deque[float] = deque(maxlen=_CELLS)

    @property
    def dots(self) -> Dots:
        """Dots that look like the others, where the pattern lies best."""
        px_m = _FACTOR * self._px_m
        own = [dot for dot in self._found if dot.held >= _PART]
        along = np.array([dot.along + dot.off[0] * px_m for dot in own])
        down = np.array([dot.down + dot.off[1] * px_m for dot in own])
        return Dots(along, down, np.array([dot.votes for dot in own]))

    def add(self, net: F32, at: F64, dots: Dots) -> None:
        """Take spots that were found.

        Parameters
        ----------
        net : ndarray of float32
            ON less OFF events.
        at : ndarray, shape (n, 2)
            Column and row of the spots in it.
        dots : Dots
            The spots.
        """
        fields = (values.tolist() for values in (dots.along, dots.down, dots.votes))
        new = [_Dot(*field) for field in zip(*fields, self._cut(net, at), strict=True)]
        self._found += new
        self._added += len(new)
        if len(self._found) < _LEAST_DOTS:
            return
        # As long as they are few, each says more about the others.
        few = self._added <= _MOST_DOTS
        for _ in range(_ROUNDS if few else 1):
            if few:
                self._centre()
            for dot in list(self._found) if few else new:
                others = [other for other in self._found if other is not dot]
                self._align(dot, others)

    def read(self, net: F32, at: F64, begin: float, end: float) -> Reading | None:
        """Find which dots of a cell are raised.

        Parameters
        ----------
        net, at
            See `add`; of its six nodes.
        begin, end : float
            Travel at which its tile begins and ends, metres: what a dot looks like is taken from
            those of other cells.

        Returns
        -------
        Reading or None
            None where too few dots are known.
        """
        dots = [d for d in self._found if d.held >= _PART and not begin <= d.along < end]
        if len(dots) < _LEAST_DOTS:
            return None
        pattern, whole = self._pattern(dots)
        if whole <= 0:
            return None
        self._look_around(net, pattern, whole)
        if not self._spreads:
            return None
        spread, level = (
            float(np.quantile(values, _LEVEL)) for values in (self._spreads, self._levels)
        )
        empty, dot = (max(least, times * spread) for least, times in (_EMPTY, _DOT))
        patches = self._cut(net, at)
        # The cell as a whole may lie a little off its nodes.
        near = [self._crop(patch, _SHIFT) for patch in patches]
        held = np.stack([cv2.matchTemplate(part, pattern, cv2.TM_CCORR) for part in near]) / whole
        away = np.arange(-_SHIFT, _SHIFT + 1) / _AWAY
        likely = (np.maximum(held, 0.0) ** 2).sum(axis=0) / max(spread, 0.02) ** 2
        top, left, off = _peak(likely - away**2 - away[:, None] ** 2)
        if held[:, top, left].max() < dot:
            # Without a dot there is nothing to tell it by.
            top = left = _SHIFT
        held = held[:, top, left].astype(np.float64)
        windows = np.stack([part[top:, left:] for part in near])[:, : self._size, : self._size]
        certain = (held - empty) / (dot - empty)
        raised = certain > 0.5
        confidence = np.clip(np.abs(2 * certain - 1), 0.0, 1.0)
        energy = (windows.astype(np.float64) ** 2).sum(axis=(1, 2)) / whole
        level /= whole
        own = np.maximum(energy - level, held**2)
        alike = held**2 / np.maximum(own, 1e-9)
        off_m = float(np.hypot(*off)) * _FACTOR * self._px_m
        in_place = float(certainty(off_m, ASTRAY_M, IN_PLACE_M))
        confidence[raised] *= certainty(alike[raised], *_ALIKE) * in_place
        beside = np.maximum(energy - _QUIET * level, 0.0)
        confidence[~raised] *= certainty(beside[~raised], *_ELSE)
        explained, rest = float(own[raised].sum()), float(beside[~raised].sum())
        return Reading(
            raised,
            confidence,
            share(explained, explained + rest),
            explained + rest,
            int(raised.sum()),
        )

    def _centre(self) -> None:
        """See where most of what dots have in common lies."""
        n, more = self._size, self._aside
        dots = np.stack([np.roll(d.patch, (-d.top, -d.left), (0, 1)) for d in self._found])
        inner = medians(dots)[_SHIFT:-_SHIFT, _SHIFT:-_SHIFT]
        energy = cv2.boxFilter(inner * inner, -1, (n, n), anchor=(0, 0), normalize=False)
        last = 2 * more + 1
        place = np.unravel_index(int(np.argmax(energy[:last, :last])), (last, last))
        self._row, self._column = (int(k) + _SHIFT for k in place)

    def _pattern(self, dots: list[_Dot]) -> tuple[F32, float]:
        """What dots have in common, and its sum of squares without chance."""
        crops = np.stack([self._crop(dot.patch, 0, dot.top, dot.left) for dot in dots])
        median = medians(crops)
        held = (crops * median).sum(axis=(1, 2))
        usual = float(medians(held[:, None, None])[0, 0])
        own = crops[held >= min(_PART * usual, usual)]
        n, total = len(own), own.sum(axis=0)
        squares = float((total**2).sum())
        # Of pairs, as a dot's own chance would make the pattern larger than what others have of it.
        pairs = (squares - float((own**2).sum())) / max(n * (n - 1), 1)
        return np.asarray(total / n, np.float32), max(pairs, _SURE * squares / n**2)

    def _align(self, dot: _Dot, others: list[_Dot]) -> None:
        """Find where the pattern of others lies best around a spot."""
        pattern, whole = self._pattern(others)
        held = cv2.matchTemplate(self._crop(dot.patch, _SHIFT), pattern, cv2.TM_CCORR)
        top, left, off = _peak(held)
        dot.top, dot.left = top - _SHIFT, left - _SHIFT
        dot.off = float(off[0]), float(off[1])
        dot.held = float(held[top, left]) / max(whole, 1e-9)

    def _crop(self, patch: F32, more: int, top: int = 0, left: int = 0) -> F32:
        """The part of a patch where the pattern lies, moved, and some pixels more on all sides."""
        n, row, column = self._size + more, self._row + top, self._column + left
        return np.ascontiguousarray(patch[row - more : row + n, column - more : column + n])

    def _look_around(self, net: F32, pattern: F32, whole: float) -> None:
        """See how much chance holds of the pattern around a cell."""
        n = self._size
        rows, columns = (size // _FACTOR for size in net.shape)
        if min(rows, columns) <= n:
            return
        part = net[: rows * _FACTOR, : columns * _FACTOR]
        coarse = cv2.resize(part, (columns, rows), interpolation=cv2.INTER_AREA)
        held = cv2.matchTemplate(coarse, pattern, cv2.TM_CCORR) / whole
        self._spreads.append(float(np.quantile(np.abs(held), _LEVEL)) / _LEVEL_WITHIN)
        energy = cv2.boxFilter(coarse * coarse, -1, (n, n), anchor=(0, 0), normalize=False)
        inside = energy[: held.shape[0], : held.shape[1]]
        self._levels.append(float(np.quantile(inside, _LEVEL)))

    def _cut(self, net: F32, at: F64) -> F32:
        """Parts of an image around places, in a pattern's pixels, shape (k, n, n)."""
        n = _FACTOR * self._wide
        if not net.size:
            return np.zeros((len(at), self._wide, self._wide), np.float32)
        padded = cv2.copyMakeBorder(net, n, n, n, n, cv2.BORDER_CONSTANT)
        out = np.zeros((len(at), self._wide, self._wide), np.float32)
        for i, (c, r) in enumerate(np.floor(at + n / 2 + 0.5).astype(int)):
            part = padded[max(r, 0) : r + n, max(c, 0) : c + n]
            if part.shape == (n, n):
                size = (self._wide, self._wide)
                out[i] = cv2.resize(part, size, interpolation=cv2.INTER_AREA)
        return out


def medians(patches: F32) -> F32:
    """Median of each pixel of some patches, float32, shape (k, rows, columns)."""
    out = np.empty(patches.shape[1:], np.float32)
    kernels._medians(patches, np.empty(len(patches), np.float32), out)
    return out


def alike(strip: Strip, spacing: Spacing, dots: Dots) -> Dots:
    """Of spots on a printed coating those that look alike, where they do, in order of travel."""
    shape = DotShape(spacing, strip.px_m)
    places = np.stack([dots.along, dots.down], -1)
    shape.add(*net_around(strip, places, shape.reach), dots)
    laid = shape.dots
    return laid.where(np.argsort(laid.along, kind="stable"))


def _peak(held: npt.NDArray[Any]) -> tuple[int, int, F64]:
    """Row and column of the largest value, and how far off the middle it lies: along, down."""
    top, left = np.unravel_index(int(np.argmax(held)), held.shape)
    row, column = int(top), int(left)
    middle = len(held) // 2
    off = np.array([column - middle, row - middle], np.float64)
    for axis, line in enumerate((held[row], held[:, column])):
        k = (column, row)[axis]
        if 0 < k < len(line) - 1:
            a, b, c = line[k - 1 : k + 2].astype(np.float64)
            curve = a - 2 * b + c
            off[axis] += 0.5 * (a - c) / curve if curve < 0 else 0.0
    return row, column, off

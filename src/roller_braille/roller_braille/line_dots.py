"""The dots of one line: where they lie against its lattice, and what one looks like."""

from __future__ import annotations

import numpy as np

from .dots import Dots
from .lattice import REACH, Lattice
from .lattice_search import are_strong
from .recognise import LEAST_SHARE, Reference, certainty, completeness
from .warp import F64

#: Cells around one whose dots tell what a dot looks like there, and the least number of dots.
_NEAR_CELLS = 4
_LEAST_DOTS = 4
#: Strength of a typical dot among them: pixels that fire for the first time can make some strong.
_TYPICAL = 0.35
#: Share of a spot's events that what lies around it must leave it, or it is no dot.
_ALONE = 0.5
#: Spread of the logarithms of dots' strengths where nothing is known, and the dots that this counts
#: for; how many times the spread the faintest dot lies below a typical one.
_USUAL, _USUAL_DOTS, _FAINTEST = 0.35, 4, 2.6
#: Strength, against the least that is found, at which the faintest dot is lost, and surely seen.
_HIDDEN, _VISIBLE = 1.0, 2.0
#: Share of dots that are less complete than most, and the least that these are taken for.
_LESS, _LEAST_COMPLETE = 0.1, 0.6
#: A side of a dot is taken to hold at least this share of its events.
_LEAST_SHARE = 0.2


class LineDots:
    """Spots found in the band of a line, with the events of their halves."""

    def __init__(self) -> None:
        self._dots = Dots.none()
        self._halves: F64 = np.empty((0, 4))

    def add(self, dots: Dots, halves: F64) -> None:
        """Take spots, with the events in their halves, shape (n, 4), as `Recogniser.halves`."""
        self._dots = Dots(
            np.append(self._dots.along, dots.along),
            np.append(self._dots.down, dots.down),
            np.append(self._dots.votes, dots.votes),
        )
        self._halves = np.concatenate([self._halves, halves])

    def forget_before(self, along: float) -> None:
        """Leave out those before a place along the roll."""
        recent = self._dots.along >= along
        self._dots, self._halves = self._dots.where(recent), self._halves[recent]

    def before(self, along: float) -> Dots:
        """Those before a place along the roll that are no outliers."""
        dots = self._solid()
        return dots.where(dots.along < along)

    def _solid(self) -> Dots:
        """Those that are no outliers."""
        dots = self._dots
        return dots.where(are_strong(dots.votes)) if len(dots) else dots

    def above(self, lattice: Lattice, votes: float) -> bool:
        """Whether a dot of so many events lies on cell 0 a row above its upper row."""
        upper = lattice.shifted(0.0, -lattice.dot_down)
        on, index = upper.assign(self._dots)
        here = on & (index[:, 0] == 0) & (index[:, 2] == 0)
        return bool((here & (self._dots.votes >= max(votes, 1.0))).any())

    def shift(self, lattice: Lattice) -> F64:
        """How far the dots of cell 0 lie off their nodes, (along, down), metres."""
        dots = self._solid()
        on, index = lattice.assign(dots)
        here = on & (index[:, 0] == 0)
        if not here.any():
            return np.zeros(2)
        nodes = lattice.nodes(0)[index[here, 1] * 3 + index[here, 2]]
        off = np.stack([dots.along[here], dots.down[here]], -1) - nodes
        # One more dot that lies on its node, so that a single one is not all.
        return np.asarray(off.sum(axis=0) / (len(off) + 1))

    def own_shifts(self, nodes: F64, pitch_m: float) -> F64:
        """How far dots found at nodes lie off them, metres, shape (6, 2); 0 where none was."""
        out = np.zeros_like(nodes)
        dots = self._solid()
        for i, node in enumerate(nodes):
            off = np.stack([dots.along, dots.down], -1) - node
            away = np.hypot(off[:, 0], off[:, 1])
            if len(away) and away.min() < REACH * pitch_m:
                out[i] = off[int(np.argmin(away))]
        return out

    def reference(self, lattice: Lattice, least: float) -> Reference | None:
        """What a dot looks like around cell 0; None when there are none of at least some events."""
        on, _ = lattice.assign(self._dots)
        on &= self._dots.votes >= _ALONE * self._halves[:, :2].sum(axis=1)
        if not on.any():
            return None
        halves = self._halves[on]
        cells = np.abs((self._dots.along[on] - lattice.centre(0)[0]) / lattice.cell)
        near = cells <= _NEAR_CELLS
        if near.sum() < _LEAST_DOTS:
            near = np.isin(np.arange(len(cells)), np.argsort(cells, kind="stable")[:_LEAST_DOTS])
        wholes = halves[near, :2].sum(axis=1)
        dots = are_strong(wholes)
        at, wholes = np.flatnonzero(near)[dots], wholes[dots]
        if not len(wholes):
            return None
        whole = float(np.quantile(wholes, _TYPICAL))
        if whole < least:
            return None
        dots = wholes >= LEAST_SHARE * whole
        at, wholes = at[dots], wholes[dots]
        # Spread of the logarithms, drawn to what is usual where there are few dots.
        n = len(wholes)
        spread = np.sqrt((n * np.var(np.log(wholes)) + _USUAL_DOTS * _USUAL**2) / (n + _USUAL_DOTS))
        faintest = whole * float(np.exp(-_FAINTEST * spread))
        visible = float(certainty(faintest / least, _HIDDEN, _VISIBLE))
        own = halves[at] / np.maximum(wholes, 1e-9)[:, None]
        shares = np.maximum(np.median(own, axis=0), _LEAST_SHARE)
        complete = max(float(np.quantile(completeness(own, shares), _LESS)), _LEAST_COMPLETE)
        return Reference(whole, faintest, shares, complete, visible)

"""Contrast maximisation: by how much the travel in the image differs from the poses'.

The camera passes a point of the surface at X from places C, and sees it at u, which says that it
lies Z (u - c_x) / F ahead. If the poses' speed or the depth is off, that is too far or too near by
one factor, and the warped events of a point smear over the width of the view times its error. The
factor at which the image of warped events is sharpest, with the largest sum of squares, is what the
events say (Gallego, Rebecq and Scaramuzza 2018).

Which of the two is wrong can't be seen from it. The travel is scaled, not the depth: an error
of 1 mm in depth then leaves all distances 2 % too long or short, which the lattice follows, and one
of 10 % in speed leaves none.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from roller_core.events import EventArray

from . import _kernels as kernels
from .reader_settings import BrailleSettings
from .warp import F32, F64, OUTSIDE, Knots

#: Travel over which batches are held back, over which events are looked at, how often, and that is
#: needed to see a smear at all.
_HOLD_M, _WINDOW_M, _LOOK_M, _LEAST_TRAVEL_M = 0.02, 0.015, 0.005, 0.008
#: OFF events of a batch and of all that are looked at, and the fewest that will do. The trail
#: behind a dot, which isn't fixed to the surface, is mostly ON.
_BATCH_EVENTS, _MOST_EVENTS, _LEAST_EVENTS = 2000, 10_000, 1000
#: Steps of the search, and pixels of its images.
_COARSE, _WIDE, _NEAR = 0.02, np.linspace(-0.03, 0.03, 13), np.linspace(-0.015, 0.015, 7)
_COARSE_PX_M, _PX_M = 0.00024, 0.00012
#: How much sharper the image must be than at most factors: noise alone is as sharp at any. Tuned
#: on the virtual cell.
_LEAST_RATIO = 1.15
#: Errors up to this blur a dot by less than a quarter of its size and are left: what the light does
#: to the motion of edges is as large.
_LEAST_ERROR = 0.015
#: Share of a change that is followed at a time.
_FOLLOW = 0.25


@dataclass(frozen=True)
class Sample:
    """Warped events of a batch: metres, all float64 of shape (n,)."""

    #: Place of the camera along the roll.
    along: F64
    #: Place of the event from there.
    offset: F64
    #: Place of the event down the image.
    down: F64


def warp_sample(events: EventArray, table: F32, knots: Knots) -> Sample:
    """Warp chosen events of a batch.

    Parameters
    ----------
    events : EventArray
        In order of time.
    table : ndarray of float32, shape (height, width, 2)
        Ideal pixels; those left out have a u of `OUTSIDE`.
    knots : Knots
        Maps, in the poses' scale.
    """
    fields = np.empty((3, len(events)))
    # Within half a millisecond the maps differ by the camera's travel alone, next to nothing else.
    n = kernels._sample(
        events.x, events.y, events.t_ns, table, OUTSIDE / 10, knots.times_ns, knots.maps,
        knots.along, *fields,
    )  # fmt: skip
    return Sample(*fields[:, :n])


def contrasts(sample: Sample, scales: F64, px_m: float) -> F64:
    """Sum of squares of the image of warped events at scales of the offset.

    Parameters
    ----------
    sample : Sample
        At least one event.
    scales : ndarray of float64, shape (k,)
        Factors.
    px_m : float
        Pixel of the image, metres.

    Returns
    -------
    ndarray of float64, shape (k,)
    """
    first, shape = _grid(sample, scales, px_m)
    out = np.empty(len(scales))
    kernels._contrasts(
        sample.along, sample.offset, sample.down, scales, px_m, first, np.empty(shape), out
    )
    return out


def _grid(sample: Sample, scales: F64, px_m: float) -> tuple[F64, tuple[int, int]]:
    """Place of the image's first pixel, and its rows and columns: room for all events."""
    ends = sample.along + np.multiply.outer([scales.min(), scales.max()], sample.offset)
    first = np.array([ends.min(), sample.down.min()]) - px_m
    columns, rows = (np.array([ends.max(), sample.down.max()]) - first) / px_m + 3
    return first, (int(rows), int(columns))


@dataclass(frozen=True)
class MappedBatch:
    """Events with the maps to warp them by."""

    events: EventArray
    knots: Knots


class TravelScale:
    """Finds, over a pass, the factor between the poses' travel and the one that the events show.

    Batches are held back until the factor is known, `_HOLD_M` of travel at most: on a bare plate
    there is nothing to see it by, and nothing that would be smeared. Once found it is followed
    slowly; where it turns out to be far off, it is found anew.
    """

    def __init__(self, settings: BrailleSettings) -> None:
        self._most = settings.max_scale_error
        self._held: deque[MappedBatch] = deque()
        self._samples: deque[Sample] = deque()
        self._looked = -np.inf
        self._poses: list[float] = []
        self._events: list[float] = []
        #: The poses' travel by the events'; None while it isn't known.
        self.scale: float | None = None if self._most else 1.0

    def add(self, batch: MappedBatch, table: F32) -> list[MappedBatch]:
        """Take a batch; those that are no longer held back, in order, in the events' scale.

        Parameters
        ----------
        batch : MappedBatch
            Maps in the poses' scale.
        table : ndarray of float32, shape (height, width, 2)
            See `warp.vote`.
        """
        self._held.append(batch)
        if self._most:
            self._look(batch, table)
        if self.scale is not None:
            return self.release()
        out = []
        newest = float(batch.knots.along[-1])
        while self._held and newest - float(self._held[0].knots.along[0]) > _HOLD_M:
            out.append(self._scaled(self._held.popleft()))
        return out

    def release(self) -> list[MappedBatch]:
        """All batches held back: the factor was found, or no more will come."""
        out = [self._scaled(batch) for batch in self._held]
        self._held.clear()
        return out

    def in_poses_scale(self, along: F64) -> F64:
        """Places along the roll as poses have them, metres, from those as the events have them."""
        if not self._poses:
            return along
        poses, events = np.array(self._poses), np.array(self._events)
        before, after = along - events[0], along - events[-1]
        inside = np.interp(along, events, poses)
        scale = self._applied
        out = np.where(before < 0, poses[0] + scale * before, inside)
        return np.asarray(np.where(after > 0, poses[-1] + scale * after, out))

    def forget_before(self, along_m: float) -> None:
        """Places before this one, as the events have them, won't be asked for any more."""
        gone = bisect_right(self._events, along_m) - 1
        if gone > 0:
            del self._poses[:gone], self._events[:gone]

    @property
    def _applied(self) -> float:
        if self.scale is None or abs(self.scale - 1) < _LEAST_ERROR:
            return 1.0
        return self.scale

    def _scaled(self, batch: MappedBatch) -> MappedBatch:
        knots, scale = batch.knots, self._applied
        if not self._poses:
            self._poses.append(float(knots.along[0]))
            self._events.append(float(knots.along[0]))
        along = self._events[-1] + (knots.along - self._poses[-1]) / scale
        # What a vibration moves back is no travel.
        if knots.along[-1] > self._poses[-1]:
            self._poses.append(float(knots.along[-1]))
            self._events.append(float(along[-1]))
        maps = knots.maps.copy()
        maps[:, 0] += (along - knots.along)[:, None] * maps[:, 2]
        return replace(batch, knots=replace(knots, maps=maps, along=along))

    def _look(self, batch: MappedBatch, table: F32) -> None:
        """Search for the factor, or follow it."""
        off = np.flatnonzero(batch.events.p == 0)
        chosen = batch.events[off[:: max(1, -(-len(off) // _BATCH_EVENTS))]]
        self._samples.append(warp_sample(chosen, table, batch.knots))
        newest = float(batch.knots.along[-1])
        while len(self._samples) > 1 and (
            newest - float(self._samples[0].along.max(initial=-np.inf)) > _WINDOW_M
        ):
            self._samples.popleft()
        if newest - self._looked < _LOOK_M:
            return
        self._looked = newest
        parts = list(self._samples)
        along, offset, down = (
            np.concatenate([getattr(s, name) for s in parts])
            for name in ("along", "offset", "down")
        )
        if len(along) < _LEAST_EVENTS or newest - along.min() < _LEAST_TRAVEL_M:
            return
        step = -(-len(along) // _MOST_EVENTS)
        sample = Sample(*(np.ascontiguousarray(a[::step]) for a in (along, offset, down)))
        if self.scale is None or (near := _peak(sample, self.scale, _NEAR)) is None:
            # Not near what it was thought to be: found anew. While the robot speeds up, stamps of
            # poses that are a little off look like another speed.
            self._find(sample)
            return
        most = self._most
        followed = self.scale + _FOLLOW * (near - self.scale)
        self.scale = float(np.clip(followed, 1 - most, 1 + most))

    def _find(self, sample: Sample) -> None:
        count = 2 * int(np.ceil(self._most / _COARSE)) + 1
        scales = np.linspace(1 - self._most, 1 + self._most, count)
        sharp = contrasts(sample, scales, _COARSE_PX_M)
        best = int(np.argmax(sharp))
        if sharp[best] < _LEAST_RATIO * np.median(sharp):
            return
        near = _peak(sample, float(scales[best]), _WIDE)
        if near is not None and abs(near - 1) < self._most:
            self.scale = near


def _peak(sample: Sample, middle: float, steps: F64) -> float | None:
    """The scale at which the image is sharpest, around a scale; None if that is at the end."""
    scales = middle + steps
    sharp = contrasts(sample, scales, _PX_M)
    k = int(np.argmax(sharp))
    if k in (0, len(scales) - 1):
        return None
    a, b, c = sharp[k - 1 : k + 2]
    curve = a - 2 * b + c
    shift = 0.5 * (a - c) / curve if curve < 0 else 0.0
    return float(scales[k] + shift * (steps[1] - steps[0]))

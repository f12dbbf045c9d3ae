"""Walls of equal steps under a printed skin, from the profile along the roll.

There edges lie everywhere, on treads too, and lines on slopes tell no walls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64

#: Bins along the roll, and rows across it, m; fewest points of a bin that tell its height, and the
#: share of the points beside a bin in the middle that those to either side of it are at least.
_BIN_M, _ROW_M, _LEAST, _AROUND, _SHARE = 5e-5, 5e-4, 3, 20, 0.5
#: By so much less sure than most a depth may be.
_SURE = 2.0
#: Turns of the steps against the roll that are tried, rad.
_TURNS = np.radians(np.linspace(-3.0, 3.0, 61))
#: Distance over which a wall climbs, by the steps' height; how much of a step it climbs there at
#: least, as the skin rounds it off, and more than the treads beside it; bins of which the mean is
#: taken. On the virtual cell's stairs at 0.5 m/s 0.4 and 0.09.
_LENGTH, _CLIMB, _MORE, _MEAN = 2.0, 0.3, 0.07, 5
#: Scatter of heights, in steps, from which on a bin tells none; share of the rows that lie lower
#: than those which the others are compared with.
_SCATTER, _MOST = 0.3, 0.8
#: What is further from its neighbours than so many times what walls mostly are is none of them.
_ALONE = 4.0
#: Share of the way between walls, to each side of its middle, on which a tread is level.
_TREAD = 0.2
#: Share of the row that goes most with all, from which on one is of the steps too.
_ALIKE = 0.7
#: How much of the plate before and after the steps is looked at too, m.
_AROUND_M = 4e-3
#: Rows by which what is of the steps is narrowed at each end: the skin rounds off their sides.
_SIDES = 1


@dataclass(frozen=True)
class PrintedSteps:
    """Walls of steps, in the frame of the depths."""

    #: Across the walls is `turn[0] * x + turn[1] * y`, metres. Shape (2,).
    turn: F64
    #: Where each wall's middle lies across, metres, and 1 where it goes up along the roll, -1 where
    #: down. Shape (walls,).
    at_m: F64
    change: F64
    #: Height of the treads before, between and after them, in steps: from each to the next by one,
    #: or by more where a wall between wasn't found. Shape (walls + 1,).
    tread: F64
    #: Height of a step, by the treads, metres; NaN: not told.
    step_m: float
    #: The steps reach from here to there across the roll, metres.
    reach_m: tuple[float, float]

    @property
    def middle(self) -> F64:
        """Height of each wall's middle, in steps, shape (walls,), from the foot of the first."""
        return np.asarray(self.tread[:-1] + 0.5 * np.diff(self.tread))

    def places(self, points: F64) -> tuple[F64, npt.NDArray[np.bool_]]:
        """Where points lie across the walls, and whether they lie on the steps at all."""
        low, high = self.reach_m
        on = (points[:, 1] >= low) & (points[:, 1] <= high)
        return points[:, :2] @ self.turn, on


def find_printed_steps(places: F64, sigma_m: F64, step_m: float) -> PrintedSteps | None:
    """The walls, from the profile along the roll; None where nothing of it stands out.

    Parameters
    ----------
    places : ndarray of float64, shape (n, 3)
        Depths of neighbourhoods: along the roll, across, and towards the camera, metres.
    sigma_m : ndarray of float64, shape (n,)
        Their uncertainty, metres; what lies at a pass's ends, seen under few angles, doesn't count.
    step_m : float
        Height of a step as given; walls of one from half as high on to twice as high are found.
    """
    x, y, height = places[sigma_m <= _SURE * np.median(sigma_m)].T
    on = _of_steps(x, y, height, step_m)
    if on is None:
        return None
    x, y, height = x[on], y[on], height[on]
    length = max(2, round(_LENGTH * step_m / _BIN_M))
    sharpest, best = -1.0, 0.0
    for turn in _TURNS:
        _, profile = _profile(x * np.cos(turn) + y * np.sin(turn), height)
        sharp = float(np.sum((profile[length:] - profile[:-length]) ** 2))
        if sharp > sharpest:
            sharpest, best = sharp, float(turn)
    turned = np.array([np.cos(best), np.sin(best)])
    begin_m, profile = _profile(x * turned[0] + y * turned[1], height)
    at, change = _walls(profile, length, step_m)
    tread, fitted_m = _treads(profile, at, change)
    reach = float(y.min()), float(y.max())
    return PrintedSteps(turned, begin_m + at * _BIN_M, change, tread, fitted_m, reach)


def _of_steps(x: F64, y: F64, height: F64, step_m: float) -> npt.NDArray[np.bool_] | None:
    """Which points lie in the rows that hold the steps, and near them along the roll.

    Beside them is the plate; None where nothing rises from it.
    """
    row, column = (np.floor((v - v.min()) / _ROW_M).astype(np.int64) for v in (y, x))
    shape = int(row.max()) + 1, int(column.max()) + 1
    key = row * shape[1] + column
    count = np.bincount(key, minlength=shape[0] * shape[1]).reshape(shape)
    total = np.bincount(key, height, minlength=shape[0] * shape[1]).reshape(shape)
    square = np.bincount(key, height**2, minlength=shape[0] * shape[1]).reshape(shape)
    mean = total / np.maximum(count, 1)
    scatter = np.sqrt(np.maximum(square / np.maximum(count, 1) - mean**2, 0.0))
    count = np.where(count >= _SHARE * np.median(count), count, 0)
    sure = (count >= _LEAST) & (np.median(scatter, axis=0) < _SCATTER * step_m)
    if not sure.any():
        return None
    high = np.where(sure, mean - np.median(mean[sure]), 0.0)
    # The steps may be in few rows; in those they lift the same columns.
    most = (high**2).sum(axis=1)
    model = high[most >= np.quantile(most, _MOST)].mean(axis=0)
    alike = high @ model
    rows = np.flatnonzero(alike >= _ALIKE * alike.max())
    columns = np.flatnonzero(np.abs(model) > 0.5 * step_m)
    if not len(columns):
        return None
    around = round(_AROUND_M / _ROW_M)
    on = (row >= rows[0] + _SIDES) & (row <= rows[-1] - _SIDES)
    on &= (column >= columns[0] - around) & (column <= columns[-1] + around)
    return on if on.any() else None


def _profile(across: F64, height: F64) -> tuple[float, F64]:
    """Where the profile's first bin has its middle, and the mean height of each, metres.

    Where points are few, as at the ends of a pass, those beside say it.
    """
    begin = float(across.min())
    bins = ((across - begin) / _BIN_M).astype(np.int64)
    count = np.bincount(bins)
    means = np.convolve(count, np.ones(_AROUND) / _AROUND)
    beside = np.minimum(means[: len(count)], means[_AROUND - 1 :])  # before, and after
    sure = np.flatnonzero((count >= _LEAST) & (beside >= _SHARE * np.median(beside)))
    if not len(sure):
        return begin, np.zeros(len(count))
    mean = np.bincount(bins, height)[sure] / count[sure]
    return begin + 0.5 * _BIN_M, np.interp(np.arange(len(count)), sure, mean)


def _walls(profile: F64, length: int, step_m: float) -> tuple[F64, F64]:
    """Bins in which walls have their middle, and 1 or -1 for those that go up or down."""
    from scipy.signal import find_peaks  # with scipy.stats, a second and a half to load

    half = length // 2
    if len(profile) <= 2 * half:
        return np.empty(0), np.empty(0)
    climb = np.zeros_like(profile)
    climb[half:-half] = profile[2 * half :] - profile[: -2 * half]
    climb = np.convolve(climb, np.ones(_MEAN) / _MEAN, mode="same")
    found = []
    for way in (1.0, -1.0):
        peaks, _ = find_peaks(way * climb, height=_CLIMB * step_m, prominence=_MORE * step_m)
        found += [(float(k), way) for k in peaks]
    at, change = np.array(sorted(found)).reshape(-1, 2).T
    if len(at) < 2:
        return at, change
    # Steps lie about as far apart: what is far from the others is none.
    gaps = np.diff(at)
    group = np.concatenate([[0], np.cumsum(gaps > _ALONE * np.median(gaps))])
    own = group == np.bincount(group).argmax()
    return at[own], change[own]


def _treads(profile: F64, at: F64, change: F64) -> tuple[F64, float]:
    """Treads before, between and after walls, in steps, and a step's height; see `PrintedSteps`."""
    if len(at) < 2:
        return np.concatenate([[0.0], np.cumsum(change)]), float("nan")
    gap = np.diff(at)
    middle = np.concatenate([[at[0] - 0.5 * gap[0]], at[:-1] + 0.5 * gap, [at[-1] + 0.5 * gap[-1]]])
    half = _TREAD * np.concatenate([gap[:1], gap, gap[-1:]])
    first = np.clip(np.rint(middle - half).astype(int), 0, len(profile) - 1)
    last = np.clip(np.rint(middle + half).astype(int), first, len(profile) - 1)
    heights = [np.median(profile[a : b + 1]) for a, b in zip(first, last, strict=True)]
    climb = change * np.diff(heights)
    steps = change * np.maximum(1.0, np.rint(climb / np.median(climb)))
    tread = np.concatenate([[0.0], np.cumsum(steps)])
    return tread, float(np.polyfit(tread, heights, 1)[0])

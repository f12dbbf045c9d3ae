"""Walls of steps among lines: where they are, how high a step is, what shows where on a wall."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64

I64 = npt.NDArray[np.int64]

#: Fewest walls of steps.
LEAST_WALLS = 2
#: Bins in which walls are found, m; the root of a wall's count stands out by this share of the
#: fullest one's; no two are nearer than this, in bins.
_BIN_M, _WALL_SHARE, _WALL_BINS = 5e-5, 0.3, 6
#: Peaks nearer than this share of a long gap between them are of one wall, if both rise or both
#: fall, and which quantile of the gaps is a long one.
_SAME_WALL, _LONG_GAP = 0.5, 0.8
#: Length of a wall along the roll, by the steps' height: of one hardly less steep than 1, and at
#: most.
_WALL, _LONGEST_WALL = 1.25, 2.0
#: Empty bins after the last line, so that a wall there is a peak.
_AFTER = np.zeros(_WALL_BINS)
#: Uncertainty of lines that count in full when walls are found, m; or that of the surest
#: quarter.
_SURE_M = 1.5e-5
#: Turns of the steps against the roll that are tried, rad.
_TURNS = np.radians(np.linspace(-3.0, 3.0, 61))
#: Lines of a polarity on a wall, at least, to tell its height.
_LEAST_ON_WALL = 20
#: Distance of the polarities of a wall from which on one is of its foot, the other of its top, m;
#: where those lie from its middle, by the steps' height.
_APART_M, _FOOT = 1e-4, 0.4
#: Share of that distance at which a polarity that shows alone lies.
_ALONE = 0.6
#: Of the heights of a polarity on walls, in steps: what they scatter by, by how much those of walls
#: that rise, or fall, may lie apart from the others, and squares of the scatter that one counts at
#: most.
_SCATTER, _KIND, _MOST_OFF = 0.2, 0.6, 9.0
#: Where all of them lie together is held by next to nothing.
_ANYWHERE = 1e-6
#: Slope below which a wall seems level, and which way it slopes is chance.
_LEVEL = 0.1
#: So many steps from a wall that goes up to the next that goes down one between wasn't seen.
_UNSEEN = 0.75


def rising_walls(
    wall: I64, polarity: I64, height: F64, slope: F64, count: int, step_m: float
) -> tuple[npt.NDArray[np.bool_], float]:
    """Which walls go up along the roll, shape (count,), and how badly their heights fit.

    The latter is in squares of scatters; below 0 where heights fit and slopes tell the same.

    Walls are a step high, up or down: of all ways to go the one that fits the walls' heights best,
    where each polarity may lie higher or lower on walls that rise, and on those that fall, by where
    on a wall it arises and by its drift. This may be so large that it turns slopes over, or makes
    all alike; they only say where to begin, and decide where heights don't tell.
    """
    slopes = np.array([np.median(slope[wall == k]) for k in range(count)])
    found = [
        (k, p, float(np.median(height[own])) / step_m)
        for k in range(count)
        for p in (0, 1)
        if (own := (wall == k) & (polarity == p)).sum() >= _LEAST_ON_WALL
    ]
    if not found:
        return slopes > 0, 0.0
    at, kinds, heights = (np.array(part) for part in zip(*found, strict=True))
    shown = np.clip(slopes / _LEVEL, -1.0, 1.0)

    def misfits(ways: npt.NDArray[np.bool_]) -> F64:
        """How badly the heights fit each way to go; shape (ways, count)."""
        change = np.where(ways, 1.0, -1.0)
        rest = heights - (np.cumsum(change, axis=1) - 0.5 * change)[:, at]
        kind = 2 * kinds + ~ways[:, at]
        # What all lie off by, and each kind apart from the others: least squares with a prior.
        of_kind = kind[..., None] == np.arange(4)
        n, sums = of_kind.sum(axis=1), (rest[..., None] * of_kind).sum(axis=1)
        held = n + (_SCATTER / _KIND) ** 2
        common = (sums * (1 - n / held)).sum(axis=1)
        common /= (n * (1 - n / held)).sum(axis=1) + _ANYWHERE
        apart = (sums - n * common[:, None]) / held
        off = (rest - common[:, None] - np.take_along_axis(apart, kind, axis=1)) / _SCATTER
        told = np.sum((apart / _KIND) ** 2, axis=1) - change @ shown
        return np.asarray(np.sum(np.minimum(off**2, _MOST_OFF), axis=1) + told, np.float64)

    # The direction of one run of walls changes at a time.
    runs = list(itertools.combinations(range(count + 1), 2))
    turned = np.zeros((len(runs), count), np.bool_)
    for run, (first, last) in zip(turned, runs, strict=True):
        run[first:last] = True
    best, least = slopes > 0, np.inf
    for begin in (slopes > 0, np.ones(count, np.bool_)):
        rising, cost = begin, misfits(begin[None])[0]
        while True:
            ways = rising ^ turned
            costs = misfits(ways)
            if costs.min() >= cost:
                break
            rising, cost = ways[costs.argmin()], costs.min()
        if cost < least:
            best, least = rising, cost
    return best, float(least)


def parts_by_kind(across: F64, wall: I64, kind: I64, rising: npt.NDArray[np.bool_]) -> F64:
    """How far over its wall's middle each kind lies, in steps, shape (4,).

    A wall's foot and its top show in a polarity each: which comes first along the roll says which
    is which. A polarity that shows alone comes first: a pixel's dead time hides the other. Where
    neither comes first, both show both.
    """
    first = []
    for falling in (0, 1):
        gaps = []
        for w in np.flatnonzero(rising != bool(falling)):
            off, on = (across[(wall == w) & (kind == 2 * p + falling)] for p in (0, 1))
            if min(len(off), len(on)) >= _LEAST_ON_WALL:
                gaps.append(np.median(on) - np.median(off))
        off, on = (((kind == 2 * p + falling) & (wall >= 0)).sum() for p in (0, 1))
        alone = _ALONE if off >= on else -_ALONE
        first.append(np.clip(np.median(gaps) / _APART_M, -1.0, 1.0) if gaps else alone)
    up, down = first
    return _FOOT * np.array([-up, down, up, -down])


def nearest_wall(across: F64, at_m: F64) -> tuple[I64, F64]:
    """Number of the wall nearest to each place across the walls, and how far from it that is, m.

    Parameters
    ----------
    across : ndarray of float64, shape (n,)
        Places, metres.
    at_m : ndarray of float64, shape (walls,)
        Where the walls are, metres.
    """
    away = across[:, None] - at_m
    wall = np.abs(away).argmin(axis=1)
    return wall, away[np.arange(len(across)), wall]


def wall_levels(heights: F64, change: F64) -> F64:
    """Height of each wall's middle, in steps, shape (n,): counted, with walls that weren't seen.

    Parameters
    ----------
    heights : ndarray of float64, shape (n,)
        As measured, in steps; NaN where a wall has none.
    change : ndarray of float64, shape (n,)
        1 where a wall goes up along the roll, -1 where down.
    """
    levels = [0.5 * change[0]]
    for k, climb in enumerate(np.nan_to_num(np.diff(heights)), 1):
        if change[k] == change[k - 1]:
            by = change[k] * max(1.0, np.rint(change[k] * climb))
        else:  # drift lifts walls that go up apart from those that go down
            by = np.rint(climb) if abs(climb) > _UNSEEN else 0.0
        levels.append(levels[-1] + by)
    return np.asarray(levels)


def steps_apart(middle: F64, change: F64) -> int:
    """How many steps most walls lie above the one before, where both rise or both fall.

    More than one, and it is rather the steps that are higher than thought.

    Parameters
    ----------
    middle, change : ndarray of float64, shape (n,)
        See `wall_levels`: what it gives, and what it takes.
    """
    between = np.abs(np.diff(middle))[change[1:] == change[:-1]]
    return int(np.median(between)) if len(between) > 1 else 1


def step_height(wall: I64, kind: I64, height: F64, middle: F64) -> float:
    """Height of a step: the median over pairs of walls of one polarity, both rising or falling.

    NaN if no two walls are alike.
    """
    pairs = []
    for k in range(4):
        own = [(w, (wall == w) & (kind == k)) for w in range(len(middle))]
        found = [(middle[w], np.median(height[on])) for w, on in own if on.sum() >= _LEAST_ON_WALL]
        for (low, at_low), (high, at_high) in itertools.combinations(found, 2):
            if high != low:
                pairs.append((at_high - at_low) / (high - low))
    return float(np.median(pairs)) if pairs else float("nan")


def find_walls(x: F64, y: F64, slope: F64, sigma_m: F64, step_m: float) -> tuple[I64, int, F64]:
    """Number of the wall that each line is of, from the first on (-1: none), and how many.

    And where lines lie across the walls, metres.
    """
    sure_m = max(_SURE_M, float(np.quantile(sigma_m, 0.25)))
    weight = np.minimum(1.0, (sure_m / sigma_m) ** 2)
    from scipy.signal import find_peaks  # with scipy.stats, a second and a half to load

    y = y - np.median(y)
    sharpest = -1.0
    across: F64 = x
    smooth: F64 = np.empty(0)
    for turn in _TURNS:
        turned = x * np.cos(turn) + y * np.sin(turn)
        turned -= turned.min() - _WALL_BINS * _BIN_M
        binned = np.append(np.bincount((turned / _BIN_M).astype(int), weight), _AFTER)
        counts = np.asarray(np.convolve(binned, np.ones(3), mode="same"), np.float64)
        sharp = float((counts**2).sum())
        if sharp > sharpest:
            sharpest, across, smooth = sharp, turned, counts
    # Walls are where lines gather, more on some than on others.
    smooth = np.sqrt(smooth)
    least = _WALL_SHARE * np.sort(smooth)[-3 * LEAST_WALLS :].mean()
    # A wall's foot and its top are one wall.
    width = max(_WALL_BINS, round(_WALL * step_m / _BIN_M))
    peaks, _ = find_peaks(smooth, prominence=least, distance=width)
    wall = np.full(len(x), -1, np.int64)
    if not len(peaks):
        return wall, 0, across
    # The peak may be of its foot alone, or of its top: the other is a wall's length from there.
    away = np.abs(across[:, None] - (peaks + 0.5) * _BIN_M)
    near = (away < max(0.5 * width * _BIN_M, _WALL * step_m)) & (away == away.min(axis=1)[:, None])
    rising = np.array([np.median(slope[own]) > 0 if own.any() else False for own in near.T])
    # Equal steps are as long as each other: what is much nearer is the same wall's other edge, if
    # the wall is as steep as any.
    gaps = np.diff(peaks)
    same = _SAME_WALL * np.quantile(gaps, _LONG_GAP) if len(gaps) else 0.0
    apart = gaps > min(same, _LONGEST_WALL * step_m / _BIN_M)
    number = np.concatenate([[0], np.cumsum(apart | (rising[1:] != rising[:-1]))]).astype(np.int64)
    for k, own in zip(number, near.T, strict=True):
        wall[own] = k
    return wall, int(number[-1]) + 1, across

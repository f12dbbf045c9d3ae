"""Golden reference: taught from scans of good parts."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from scipy import ndimage

from roller_core.transforms import F64
from roller_inspect.height_map.height_map import (
    CONTINUED,
    F32,
    MEASURED,
    OUTSIDE,
    Bools,
    HeightMap,
    centres,
)

from .field import Field, compare_field
from .reference import Comparison, ReferenceError

GOLDEN_FILE = "golden.npz"
#: Frames of scans of one part differ by less than this, m and rad.
_SAME_FRAME = 1e-9
#: Maps whose heights are so near, m, are of one scan: two scans differ by micrometres.
_SAME_SCAN_M = 1e-8
#: Fewest scans that show what good parts differ by.
_ENOUGH = 3
#: Share of the scans that must know a cell.
_LEAST_SHARE = 0.5
#: Standard uncertainty of the mean of few scans isn't below this, m.
_LEAST_SIGMA_M = 3e-6
#: What makes the median deviation of so many scans a standard deviation without bias (Croux and
#: Rousseeuw, Time-efficient algorithms for two highly robust estimators of scale, 1992).
_FEW = {2: 1.196, 3: 1.495, 4: 1.363, 5: 1.206, 6: 1.2, 7: 1.14, 8: 1.129, 9: 1.107}
#: Few scans that agree in a cell by chance say little: what is around, within a Gaussian of this
#: standard deviation, m, counts as so many scans more.
_AROUND_M, _AROUND_SCANS = 3e-4, 8
#: A scan that differs by this over so wide a place, m, of this area, m², isn't like the others.
_ODD_M, _ODD_WIDE_M, _ODD_AREA_M2 = 1e-4, 5e-4, 3e-7


@dataclass(frozen=True)
class GoldenReference:
    """Good parts as the reference; what differs from them is missing or extra material."""

    name = "golden"
    models_part = True

    #: Centres of the cells, metres. Shapes (nx,), (ny,).
    x_m: F64
    y_m: F64
    #: Median of the scans; NaN where less than half of them know it. Shape (ny, nx).
    height_m: F32
    #: Their robust standard deviation, of few scans together with what is around; with one scan its
    #: own uncertainty. Shape (ny, nx).
    spread_m: F32
    #: Share of the scans that measured the cell. Shape (ny, nx).
    coverage: F32
    #: How many.
    scans: int
    #: Frame. Shape (4, 4).
    base_from_map: F64

    def save(self, folder: Path) -> None:
        """Write `golden.npz` into a folder."""
        np.savez_compressed(folder / GOLDEN_FILE, **{n: getattr(self, n) for n in _NAMES})

    @classmethod
    def load(cls, folder: Path) -> GoldenReference:
        """Read `golden.npz` of a folder.

        Raises
        ------
        ReferenceError
            If it isn't there or can't be read.
        """
        path = folder / GOLDEN_FILE
        if not path.is_file():
            raise ReferenceError(f"reference golden: {folder} has no {GOLDEN_FILE}; teach one")
        try:
            with np.load(path, allow_pickle=False) as file:
                found = {name: file[name] for name in _NAMES}
        except OSError as error:
            raise ReferenceError(f"reference golden: {path} can't be read ({error})") from error
        except (ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            # What numpy says of these names ways to open a file that may do harm.
            raise ReferenceError(f"reference golden: {path}: isn't what teach writes") from error
        shape = (len(found["y_m"]), len(found["x_m"]))
        if any(found[n].shape != shape for n in ("height_m", "spread_m", "coverage")):
            raise ReferenceError(f"reference golden: {path}: its grids don't fit each other")
        return cls(**{**found, "scans": int(found["scans"])})

    def compare(self, height_map: HeightMap, masked: Bools | None = None) -> Comparison:
        """See `Reference`.

        Raises
        ------
        ReferenceError
            If it was taught in another frame, or doesn't fit the map.
        """
        if np.abs(self.base_from_map - height_map.base_from_map).max() > _SAME_FRAME:
            raise ReferenceError(
                "reference golden: it was taught in another frame than this scan's"
            )
        # The spread of good parts bounds what is a deviation at all: this scan's, and the median's
        # of so many. What is usual of it shows in this scan's own scatter already.
        spread2 = np.square(self.spread_m)
        usual2 = np.nanmedian(spread2) if np.isfinite(spread2).any() else 0.0
        sigma = np.sqrt(np.maximum(spread2 - usual2, 0) + spread2 / self.scans)
        sigma = np.maximum(sigma, _LEAST_SIGMA_M).astype(np.float32)
        field = Field(self.x_m, self.y_m, self.height_m, sigma)
        return compare_field(field, height_map, self.name, masked)


_NAMES = [field.name for field in fields(GoldenReference)]


def teach(
    maps: Sequence[HeightMap], warn: Callable[[str], None] = lambda text: None
) -> GoldenReference:
    """Learn what good parts look like.

    Parameters
    ----------
    maps : sequence of HeightMap
        Of good parts in the same place; each is aligned to the first.
    warn : callable, optional
        Called with a line for each scan that differs from the others somewhere, and where there
        are too few.

    Raises
    ------
    ReferenceError
        Without a map, if one is there twice or isn't of the same part in the same place, or if two
        are all and differ: which is good can't be told.
    """
    if not maps:
        raise ReferenceError("reference golden: there is no scan to teach from")
    for number, each in enumerate(maps, 1):
        for earlier, other in enumerate(maps[: number - 1], 1):
            if _same(each, other):
                raise ReferenceError(
                    f"reference golden: scans {earlier} and {number} are the same; what good parts "
                    "differ by shows in scans of their own"
                )
    if len(maps) < _ENOUGH:
        warn(f"what good parts differ by shows in {_ENOUGH} scans or more, not in {len(maps)}")
    first = max(maps, key=lambda m: int(m.known.sum()))
    step = first.step_m
    i0, j0 = round(first.x_m[0] / step - 0.5), round(first.y_m[0] / step - 0.5)
    x, y = centres(i0, len(first.x_m), step), centres(j0, len(first.y_m), step)
    target = _field(first)
    heights, measured = [], []
    for number, each in enumerate(maps, 1):
        if np.abs(each.base_from_map - first.base_from_map).max() > _SAME_FRAME:
            raise ReferenceError(
                f"reference golden: scan {number} has another frame than the others; was the part "
                "moved?"
            )
        moved = each
        if each is not first:
            # The scan as it would be if its part lay where the first one's does.
            correction = compare_field(target, each, "golden").alignment.correction
            moved = _aligned(each, correction)
        places = np.meshgrid(x, y)
        heights.append(_field(moved).sample(*places)[0].astype(np.float32))
        measured.append(_measured_at(moved, *places))
    stack = np.stack(heights)
    share = np.isfinite(stack).mean(axis=0)
    some = share >= _LEAST_SHARE
    height = np.full(first.shape, np.nan, np.float32)
    spread = np.full(first.shape, np.nan, np.float32)
    height[some] = np.nanmedian(stack[:, some], axis=0)
    for number, each in enumerate(stack, 1):
        # The median of two lies half way.
        if odd := _odd((each - height) * (2 if len(maps) == 2 else 1), first):
            text = f"scan {number} of {len(maps)} differs from the rest {odd}"
            if len(maps) == 2:
                raise ReferenceError(
                    f"reference golden: {text}; which is good? teach three or more"
                )
            warn(f"{text}: is it a good part? the median of all counts")
    if len(maps) > 1:
        deviation = np.nanmedian(np.abs(stack[:, some] - height[some]), axis=0)
        spread[some] = 1.4826 * _FEW.get(len(maps), 1.0) * deviation
        spread = _steadied(spread, len(maps), step)
    else:
        spread[some] = first.sigma_m[some]
    coverage = np.stack(measured).mean(axis=0).astype(np.float32)
    return GoldenReference(x, y, height, spread, coverage, len(maps), first.base_from_map)


def _steadied(spread: F32, scans: int, step_m: float) -> F32:
    """Standard deviations of few scans each, drawn towards those around (pooled variances)."""
    known = np.isfinite(spread)
    sums, share = (
        ndimage.gaussian_filter(values.astype(np.float32), _AROUND_M / step_m, mode="constant")
        for values in (np.where(known, np.square(spread), 0), known)
    )
    around = sums / np.maximum(share, np.float32(1e-6))
    pooled = ((scans - 1) * np.square(spread) + _AROUND_SCANS * around) / (
        scans - 1 + _AROUND_SCANS
    )
    return np.asarray(np.sqrt(pooled), np.float32)


def _same(one: HeightMap, other: HeightMap) -> bool:
    """Whether two maps are of the same scan."""
    return one.shape == other.shape and bool(
        np.allclose(one.height_m, other.height_m, rtol=0.0, atol=_SAME_SCAN_M, equal_nan=True)
    )


def _odd(away: F32, height_map: HeightMap) -> str:
    """Where a scan lies off the others' median, in words; empty: nowhere."""
    step = height_map.step_m
    mean = ndimage.uniform_filter(np.nan_to_num(away), max(1, round(_ODD_WIDE_M / step)))
    far = np.abs(mean) > _ODD_M
    labels, count = ndimage.label(far)
    if not count:
        return ""
    area = np.bincount(labels[far], minlength=count + 1)
    largest = labels == np.argmax(area)
    if area.max() * step**2 < _ODD_AREA_M2:
        return ""
    row, column = (int(np.mean(axis)) for axis in np.nonzero(largest))
    x, y, _ = height_map.in_base(height_map.x_m[column], height_map.y_m[row], 0.0) * 1e3
    most = float(np.abs(mean[largest]).max())
    return f"by {most * 1e6:.0f} µm around x {x:.1f}, y {y:.1f} mm"


def _field(height_map: HeightMap) -> Field:
    known = height_map.known
    return Field(
        height_map.x_m,
        height_map.y_m,
        np.where(known, height_map.height_m, np.nan).astype(np.float32),
        np.where(known, height_map.sigma_m, np.nan).astype(np.float32),
    )


def _measured_at(height_map: HeightMap, x: F64, y: F64) -> Bools:
    """Where the map was measured, by the nearest of the cells around."""
    measured = (height_map.state == MEASURED).astype(np.float32)
    field = Field(height_map.x_m, height_map.y_m, measured, measured)
    return np.asarray(np.nan_to_num(field.sample(x, y)[0]) > 0.5)


def _aligned(height_map: HeightMap, correction: F64) -> HeightMap:
    """A map moved back by a small motion in base, on its own grid."""
    base = height_map.base_from_map
    local = np.linalg.inv(base) @ correction @ base
    x, y = np.meshgrid(height_map.x_m, height_map.y_m)
    # Where the reference's (x, y) lies in the map, and what the motion added to its height.
    at_x = x + local[0, 1] * y + local[0, 3]
    at_y = y + local[1, 0] * x + local[1, 3]
    height, sigma = _field(height_map).sample(at_x, at_y)
    height = height - (local[2, 0] * x + local[2, 1] * y + local[2, 3])
    state = np.where(np.isfinite(height), CONTINUED, OUTSIDE).astype(np.uint8)
    state[_measured_at(height_map, at_x, at_y)] = MEASURED
    return replace(
        height_map,
        height_m=height.astype(np.float32),
        sigma_m=sigma.astype(np.float32),
        state=state,
    )

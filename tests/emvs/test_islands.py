"""Few, weak cells far above or below what is around them are no surface."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from roller_emvs.evidence import _peak_kernels
from roller_emvs.evidence.islands import without_islands
from roller_emvs.evidence.sweep import Depths

#: A cell is 0.17 mm; offsets are in metres.
FIELD: Any = SimpleNamespace(slope_per_px=1 / 43e-6)
ISLAND = np.s_[10:13, 20:23]


def depths(height_m: float, sure: float, around: float = 0.5) -> Depths:
    """A surface of confidence 0.5, on a slope, in the middle of which some cells are elsewhere."""
    offset = np.tile(np.linspace(0, 1e-3, 40), (24, 1)).astype(np.float32)
    confidence = np.full(offset.shape, around, np.float32)
    if not around:
        offset[:] = np.nan
    offset[ISLAND], confidence[ISLAND] = height_m, sure
    nothing = np.zeros_like(offset)
    return Depths(offset, confidence, *[nothing] * 4)


def test_a_weak_island_goes() -> None:
    for height in (-2e-3, 2.5e-3):
        found = without_islands(FIELD, depths(height, 0.15))
        gone = np.isnan(found.offset)
        assert gone[ISLAND].all()
        assert gone.sum() == 9


def test_what_may_be_relief_stays() -> None:
    for given in (
        depths(2.5e-3, 0.4),  # as sure as what is around
        depths(1e-3, 0.1),  # a step that a skin can follow
        depths(2.5e-3, 0.1, around=0.0),  # nothing else was seen
    ):
        found = without_islands(FIELD, given)
        np.testing.assert_array_equal(found.offset, given.offset)


def test_the_fringe_of_an_edge_goes_where_depths_were_searched_for_everywhere() -> None:
    """Sure, but of a hundredth of the evidence of the edge beside it."""
    given = depths(2.5e-3, 0.5)
    measure = np.full(given.offset.shape, 100.0, np.float32)
    measure[ISLAND] = 1.0
    faint = replace(given, focus_measure=measure)
    assert np.isnan(without_islands(FIELD, faint, everywhere=True).offset[ISLAND]).all()
    np.testing.assert_array_equal(without_islands(FIELD, faint).offset, given.offset)
    # As much as what is around, if only in one cell, is an edge of its own; so is what lies alone.
    measure[11, 21] = 100.0
    for kept in (faint, replace(depths(2.5e-3, 0.5, around=0.0), focus_measure=measure / 100)):
        found = without_islands(FIELD, kept, everywhere=True)
        np.testing.assert_array_equal(found.offset, kept.offset)


def test_heights_are_whole_numbers_within_sixteen_bits() -> None:
    offset = np.array([[0.0, 0.0126, -0.0124, np.nan], [9.0, -9.0, np.nan, 1.0]], np.float32)
    heights = np.empty(offset.shape, np.int16)
    assert _peak_kernels._heights(offset, 1000.0, -32768, heights)
    known = np.isfinite(offset)
    expected = np.clip(np.rint(np.where(known, offset, 0) * 1000), -32000, 32000)
    np.testing.assert_array_equal(heights, np.where(known, expected, -32768))
    assert not _peak_kernels._heights(np.full_like(offset, np.nan), 1.0, -32768, heights)

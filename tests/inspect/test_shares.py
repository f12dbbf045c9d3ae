"""What a long scan's coarse map says of how much was measured."""

from dataclasses import replace

import numpy as np
import pytest

from roller_inspect.covered_area import coverage_of_area
from roller_inspect.height_map import CONTINUED, MEASURED, UNMEASURED, HeightMap
from roller_inspect.height_map.coverage import Coverage, coverage_of, textured
from roller_inspect.height_map.height_map import centres
from roller_inspect.pieces import Found, Piece, Whole
from roller_inspect.recipe import Recipe
from roller_inspect.references import NominalReference
from roller_inspect.surface_inspector import SurfaceInspector

from .analytic_surface import flat, scan


def shares(coverage: Coverage) -> list[float]:
    return [coverage.measured, coverage.continued, coverage.unmeasured, coverage.scanned]


@pytest.mark.parametrize("per_mm2", [70.0, 25.0, 12.0])
def test_coverage_does_not_depend_on_how_coarse_a_scan_is_kept(per_mm2: float) -> None:
    """Of all, and of regions; half of a cell's cells measured, or hardly any."""
    hole = (0.03, 0.034)
    patches = scan(
        flat, length_m=0.1, per_mm2=per_mm2, keep=lambda x, y: (x < hole[0]) | (x > hole[1])
    )
    regions = {
        "hole": {"box_m": [0.03, -0.004, 0.034, 0.004]},
        "end": {"box_m": [0.095, -0.004, 0.105, 0.004]},
        "part": {"box_m": [0.02, -0.004, 0.05, 0.004]},
    }
    recipes = [
        Recipe.create({"regions": regions, **more})
        for more in ({}, {"exclude": ["hole"]}, *({"inspect": [name]} for name in regions))
    ]
    found = []
    for most in (10**6, 40_000, 10_000):
        settings = recipes[0].settings.changed({"height_map.max_cells": most})
        inspector = SurfaceInspector(settings, NominalReference("plane"))
        for patch in patches:
            inspector.add(patch)
        found.append(inspector.finish())
    steps = [f.height_map.step_m for f in found if f.height_map is not None]
    np.testing.assert_allclose(steps, [1e-4, 2e-4, 4e-4])
    for recipe in recipes:
        fine, *coarse = (coverage_of_area(recipe, f)[0] for f in found)
        for other in coarse:
            np.testing.assert_allclose(shares(other), shares(fine), atol=0.012)
            assert other.area_m2 == pytest.approx(fine.area_m2, rel=0.01)
            assert textured(other, recipe.grid_m) == textured(fine, recipe.grid_m)
    fine, *coarse = (f.coverage for f in found)
    for other in coarse:
        np.testing.assert_allclose(shares(other), shares(fine), atol=1e-3)
        assert other.points_per_mm2 == pytest.approx(fine.points_per_mm2, rel=0.02)


def test_pieces_that_share_cells_add_up_and_where_they_overlap_one_counts() -> None:
    """Pieces of 27 columns, on cells of two and four; what was compared with nothing is bare."""
    state = np.random.default_rng(2).choice(
        np.array([UNMEASURED, CONTINUED, MEASURED], np.uint8), (30, 108), p=[0.2, 0.5, 0.3]
    )
    deviation = np.zeros(state.shape, np.float32)
    deviation[:, 90:] = np.nan
    nothing = np.zeros(state.shape, np.float32)
    whole = HeightMap(
        centres(3, 108, 1e-4), centres(-15, 30, 1e-4), nothing, nothing, state,
        (state == MEASURED).astype(np.uint16), np.eye(4),
    )  # fmt: skip
    expected = np.where((state != UNMEASURED) & np.isnan(deviation), UNMEASURED, state)
    counts = np.bincount(expected.ravel(), minlength=4) / expected.size
    for most, factor in ((10**6, 1), (1000, 2), (300, 4)):
        kept = Whole(most)
        for first in (0, 27, 54, 81, 27):
            columns = slice(first, first + 27)
            part = whole.cropped(columns, slice(None))
            kept.add(Piece(part, deviation[:, columns]))
        piece = kept.piece
        assert piece is not None
        assert piece.height_map.step_m == pytest.approx(factor * 1e-4)
        assert (piece.shares is None) == (factor == 1)
        if piece.shares is not None:
            assert piece.shares.sum(axis=0).max() <= 1.0 + 1e-3
        seen = coverage_of(piece.height_map, shares=piece.shares)
        found = Found(piece.height_map, piece.deviation_m, (), None, seen, (), (), piece.shares)
        for recipe in (Recipe.create({}), Recipe.create({"edge_exclusion_m": 0.0})):
            coverage, _ = coverage_of_area(recipe, found)
            assert coverage.measured == pytest.approx(counts[MEASURED], abs=0.01)
            assert coverage.unmeasured == pytest.approx(counts[UNMEASURED], abs=0.01)
            # A scan's texture is what it is wherever its reference ends.
            assert coverage.texture == pytest.approx((state == MEASURED).mean(), abs=0.01)
        # Where nothing was compared the reference is at fault, not the scan.
        bare = replace(found, deviation_m=np.full(piece.height_map.shape, np.nan, np.float32))
        if factor == 1:
            none = coverage_of_area(Recipe.create({}), bare)[0]
            assert none.unmeasured == pytest.approx((state == UNMEASURED).mean())

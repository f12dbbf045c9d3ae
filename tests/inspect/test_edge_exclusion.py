"""The edge of a scan that findings aren't looked for in."""

import numpy as np
import pytest

from roller_inspect.findings.cues import inspectable

from .analytic_surface import flat, scan
from .inspecting import finished, inspect


@pytest.mark.parametrize("edge_m", [0.0, 5e-4, 1e-3, 2e-3])
def test_it_is_as_wide_as_was_asked(edge_m: float) -> None:
    """All around: beyond the ends of the map, too, nothing is known."""
    grid = finished(inspect(scan(flat), reference="self")[1]).found.height_map
    rows, columns = np.nonzero(inspectable(grid, edge_m))
    known = [np.flatnonzero(grid.known.any(axis=axis))[[0, -1]] for axis in (1, 0)]
    for found, (first, last) in zip((rows, columns), known, strict=True):
        left = np.array([found.min() - first, last - found.max()]) * grid.step_m
        assert left == pytest.approx(edge_m, abs=1.6e-4)

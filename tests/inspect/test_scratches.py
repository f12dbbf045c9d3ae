"""What tells a scratch from a dent: its form, less what narrow things are widened by."""

import numpy as np
import pytest

from roller_core.transforms import F64

from .analytic_surface import Surface, scan
from .inspecting import finished, inspect


def hollow(length_m: float, width_m: float, turned_rad: float = 0.5) -> Surface:
    """150 µm deep, as long and as wide where a fifth of that is reached."""

    def height(x: F64, y: F64) -> F64:
        c, s = np.cos(turned_rad), np.sin(turned_rad)
        along, across = c * (x - 0.015) + s * y, c * y - s * (x - 0.015)
        end = np.maximum(np.abs(along) - (length_m - width_m) / 2, 0.0)
        fifth = width_m / 2 / np.sqrt(np.log(5.0))
        return -1.5e-4 * np.exp(-((np.hypot(end, across) / fifth) ** 2))

    return height


@pytest.mark.parametrize(
    ("length_mm", "width_mm", "kind"),
    [
        # A scratch of 4 × 1 mm and narrower is seen as 4 × 1.4 mm.
        (4.0, 1.1, "scratch"),
        (4.0, 1.35, "scratch"),
        (8.0, 2.0, "scratch"),
        (4.0, 2.0, "dent"),
        (2.6, 1.5, "dent"),
        (1.3, 1.1, "dent"),
        (3.0, 3.0, "dent"),
    ],
)
def test_kinds_of_hollows(length_mm: float, width_mm: float, kind: str) -> None:
    surface = hollow(length_mm * 1e-3, width_mm * 1e-3)
    part = finished(inspect(scan(surface, noise_m=5e-6))[1])
    (found,) = part.found.findings
    assert found.kind == kind, (found.length_m, found.width_m)
    # As measured: what it is widened by stays in the figures.
    assert found.width_m == pytest.approx(width_mm * 1e-3, abs=4e-4)

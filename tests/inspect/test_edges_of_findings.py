"""What lies beside a finding and is less than sure is that one's edge, no finding."""

from dataclasses import replace

import numpy as np
import pytest

from roller_emvs.patch import Patch

from .analytic_surface import scan
from .inspecting import finished, inspect


@pytest.mark.parametrize(
    ("depth_m", "away_m", "claimed_m", "kinds"),
    [
        (3e-4, 0.0, 1.5e-5, ["dent", "raised"]),
        (3e-4, 0.0, 8e-5, ["dent"]),
        (3e-4, 1e-3, 8e-5, ["dent", "raised"]),
        (1.2e-4, 0.0, 8e-5, ["dent"]),
        (5e-5, 0.0, 8e-5, ["dent", "raised"]),
    ],
    ids=[
        "surer than it is high", "the edge of a deep one", "away from it", "of a deeper one",
        "beside a shallow one",
    ],
)  # fmt: skip
def test_an_unsure_rise_is_none_beside_what_is_deeper(
    depth_m: float, away_m: float, claimed_m: float, kinds: list[str]
) -> None:
    middle = 0.0158 + away_m

    def surface(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        inside = (np.abs(x - 0.014) < 1.3e-3) & (np.abs(y) < 1.3e-3)
        lip = (np.abs(x - middle) < 4e-4) & (np.abs(y) < 8e-4)
        return np.where(lip, 7e-5, np.where(inside, -depth_m, 0.0))

    def unsure(patch: Patch) -> Patch:
        x, y = patch.points[:, 0], patch.points[:, 1]
        lip = (np.abs(x - middle) < 6e-4) & (np.abs(y) < 1e-3)
        return replace(patch, sigma=np.where(lip, claimed_m, patch.sigma).astype(np.float32))

    part = finished(inspect([unsure(patch) for patch in scan(surface)])[1])
    assert sorted(f.kind for f in part.found.findings) == kinds

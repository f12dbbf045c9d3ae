"""Findings that go on beyond the border of what was searched: their sizes are lower bounds."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from roller_core.transforms import F64
from roller_inspect.inspect_stage import Inspected
from roller_inspect.recipe import Recipe
from roller_inspect.report.document import Scan, inspection_document
from roller_inspect.results.inspection_files import write_inspection

from .analytic_surface import dent, scan
from .inspecting import finished, inspect

SIZES = {"length_m", "width_m", "area_m2", "volume_m3"}
#: The scan's border is at 6 mm; 1 mm of it isn't searched.
BESIDE, CUT, BEYOND = (0.015, 0.0025), (0.015, 0.0046), (0.015, 0.0058)


def part(at: tuple[float, float], seed: int = 0, **recipe: Any) -> Inspected:
    points = scan(dent(at, 2e-3, 3e-4), noise_m=1e-5, seed=seed)
    return finished(inspect(points, **{"reference": "self"} | recipe)[1])


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_sizes_of_a_cut_finding_are_lower_bounds(seed: int) -> None:
    (cut,) = part(CUT, seed).judgement.findings
    assert set(cut.finding.at_least) == SIZES
    (beyond,) = part(BEYOND, seed).judgement.findings
    assert set(beyond.finding.at_least) == SIZES | {"depth_m"}
    (whole,) = part(BESIDE, seed).judgement.findings
    assert whole.finding.at_least == ()


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize(
    ("tolerance", "verdict"),
    [
        # The seen part is 3 by 2.3 mm or so.
        ({"length_m": 6e-3}, "inconclusive"),
        ({"area_m2": 3e-5}, "inconclusive"),
        ({"length_m": 1e-3}, "nonconform"),
        ({"depth_m": 5e-4}, "conform"),
        ({"depth_m": 5e-4, "width_m": 6e-3}, "inconclusive"),
        ({"depth_m": 1e-4, "width_m": 6e-3}, "nonconform"),
    ],
)
@pytest.mark.parametrize("decision", ["iso_14253_1", "simple_acceptance"])
def test_what_of_it_was_seen_may_fail_and_never_passes(
    tolerance: dict[str, float], verdict: str, decision: str, seed: int
) -> None:
    found = part(CUT, seed, tolerances=[tolerance], decision=decision).judgement
    assert found.verdict == verdict, found.reason
    said = "1 finding goes on beyond what was searched" in found.reason
    assert said == (verdict == "inconclusive")


def test_a_whole_one_within_its_sizes_passes() -> None:
    found = part(BESIDE, tolerances=[{"length_m": 6e-3, "area_m2": 3e-5}]).judgement
    assert found.verdict == "conform", found.reason


def test_where_all_is_searched_the_scans_end_cuts() -> None:
    found = part((0.015, 0.005), edge_exclusion_m=0.0, tolerances=[{"area_m2": 3e-5}]).judgement
    assert [j.verdict for j in found.findings] == ["inconclusive"]


def test_one_at_the_scans_start_is_cut_too() -> None:
    (cut,) = part((0.0018, 0.0)).judgement.findings
    assert set(cut.finding.at_least) >= SIZES


def test_a_long_one_in_a_long_scan_is_whole() -> None:
    """Pieces of a scan have borders of their own."""

    def groove(x: F64, y: F64) -> F64:
        across = np.clip(1 - (y / 1e-3) ** 2, 0, None)
        return -2e-4 * across * ((x > 0.03) & (x < 0.05))

    points = scan(groove, length_m=0.08, noise_m=1e-5)
    (found,) = finished(inspect(points)[1]).judgement.findings
    assert found.finding.at_least == ()


def test_files_say_so(tmp_path: Path) -> None:
    recipe = {"reference": "self", "tolerances": [{"area_m2": 3e-5}], "least_coverage": 0.5}
    one = part(CUT, **recipe)
    document = inspection_document(one, Recipe.create(recipe), Scan())
    (found,) = document["findings"]
    assert set(found["at_least"]) == SIZES
    assert "goes on beyond what was searched" in found["limit"]
    write_inspection(tmp_path, document, one.found, 1e-4)
    page = (tmp_path / "inspection.html").read_text(encoding="utf-8")
    assert page.count("≥ ") == len(SIZES)
    assert "goes on beyond what was searched" in page
    head, row = (tmp_path / "findings.csv").read_text(encoding="utf-8").splitlines()
    assert head.endswith(",at_least")
    assert "area_m2" in row.rsplit(",", 1)[1]

"""Recipes: what they hold, what they refuse, and what they decide."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roller_inspect.covered_area import coverage_of_area
from roller_inspect.height_map import CONTINUED, MEASURED, OUTSIDE, UNMEASURED, HeightMap
from roller_inspect.height_map.coverage import Coverage, coverage_of
from roller_inspect.judgement import judge, with_faults
from roller_inspect.pieces import Found
from roller_inspect.recipe import Recipe, RecipeError, Region, decide, load_recipe, part_verdict

WRONG = {
    "regions: {a: {box_m: [1, 2]}}": "'regions.a.box_m.2'",
    "regions: {a: {box_m: [1, 0, 0, 1]}}": "lowest x",
    "regions: {a: {}}": "one of box_m",
    "regions: {a: {box_m: [0, -2, 10, 2]}}": "it reaches to 10 m; recipes are in metres",
    "tolerances: [{region: b, depth_m: 1.0e-4}]": "names 'b', which is not there (regions: none)",
    "inspect: [rim]": "'inspect' names 'rim'",
    "tolerances: [{kind: hole, depth_m: 1.0e-4}]": "'tolerances.0.kind' = 'hole'",
    "tolerances: [{kind: dent}]": "a tolerance limits one of depth_m",
    "tolerance: []": "unknown entry 'tolerance'; is it 'tolerances'?",
    "- 1": "expected entries",
    "least_coverage: 2": "'least_coverage' = 2",
    "least_coverage: yes": "'least_coverage' = True: a number is expected, not yes or no",
    "lines: {a: [[0, no], [1, 1]]}": "'lines' = {'a': [[0, False], [1, 1]]}: a number is expected",
    "schema: v9": "'schema' is 'v9'",
    "measures: [{name: a, tool: tilt, of: b, datum: c}]": "'measures.0.datum' names 'c'",
    "measures: [{name: a, tool: width, of: b}]": "width is of a line",
    "{regions: {a: {circle_m: [0, 0, 0.01]}, c: {circle_m: [0, 0, 0.02]}}, "
    "measures: [{name: b, tool: depth, of: a, datum: c, high: 0.05}]}": "'measures.0.high' = 0.05: "
    "depth of 'a' is at most 0.01 m; limits are in m, m², m³ and rad",
    "{lines: {a: [[0, 0], [0.01, 0]]}, measures: [{name: b, tool: width, of: a, low: 1.5}]}": "'a' "
    "is at most 0.01 m",
    "regions: {a: {polygon_m: [[0, 0], [0.01, 0.01], [0.02, 0.02]]}}": "corners lie on a line",
    "regions: {a: {polygon_m: [[0, 0], [0.01, 0.01], [0.01, 0], [0, 0.01]]}}": "crosses itself",
    "regions: {a: {polygon_m: [[0, -0.1], [0.2, 0.3], [0.2, -0.1], [0, 0.1]]}}": "crosses itself",
    "lines: {a: [[0, 0], [0, 0]]}": "'lines.a' begins where it ends",
    "lines: {a: [[0, 0], [10, 0]]}": "recipes are in metres",
    "plate: {yaw_rad: 90}": "'plate.yaw_rad' = 90: at most 6.28",
    "plate: {origin_m: [0.1, 0.02, 0]}": "'plate' is of no use while 'frame' is base",
    "limits: {}\nlimits: {}": "line 2: 'limits' is there twice",
    "regions: {a: {circle_m: [0, 0, 1]}, a: {}}": "line 1: 'a' is there twice",
    "plate: {origin_m: [100, 20, 0]}": "over 5 m away; recipes are in metres",
    "tolerances: [{length_m: 3}]": "'tolerances.0.length_m' = 3: at most 0.1 is expected",
    "tolerances: [{area_m2: 0.5}]": "'tolerances.0.area_m2' = 0.5: at most 0.01 is expected",
    "{regions: {a: {circle_m: [0, 0, 0.01]}}, "
    "measures: [{name: b, tool: tilt, of: a, datum: a}]}": "a region is no datum of its own",
    "{regions: {a: {circle_m: [0, 0, 0.01]}}, measures: [{name: b, tool: roughness_sa, of: a}, "
    "{name: b, tool: roughness_sq, of: a}]}": "two 'measures' are called 'b'",
    "{regions: {a: {circle_m: [0, 0, 0.01]}, c: {circle_m: [0, 0, 0.02]}}, "
    "measures: [{name: b, tool: tilt, of: a, datum: c, high: 5}]}": "at most 1.57 rad",
    "{": "not a YAML file",
    "reference: silver:x": "'reference' = 'silver:x': is not one of self, nominal[:FORM], "
    "golden:DIR, cad:FILE",
    "reference: nominal:sphere": "'reference.form' = 'sphere': is not 'none', 'plane'",
    "reference: self:x": "it is given as self",
    "reference: 3": "'reference' = 3: is not one of self, ",
    "regions: {a: {box: [0, 0, 1, 1]}}": "unknown entry 'regions.a.box'; is it 'regions.a.box_m'?",
    "tolerances: [{colour: 1}]": "unknown entry 'tolerances.0.colour'; there are region, kind,",
    "tolerances: [{depth_m: 100}]": "'tolerances.0.depth_m' = 100: at most 0.01 is expected",
    "tolerances: {depth_m: 1.0e-4}": "'tolerances' = {'depth_m': 0.0001}: a list is expected",
    "limits: {depth_m: 5.0e-4}": "'limits.depth_m' is 0.0005, above the default tolerance",
    "{limits: {length_m: 2.0e-3}, tolerances: [{kind: scratch, length_m: 1.0e-3}]}": "never found",
    "limits: {depth_m: 30}": "'limits.depth_m' = 30: at most 0.01 is expected",
    "grid_m: fine": "'grid_m' = 'fine': a number is expected",
    "plate: {origin_m: [0, 0]}": "'plate.origin_m.2' is missing",
    "lines: {a: [0, 0, 1, 1]}": "'lines.a' = [0, 0, 1, 1]: 2 values are expected, not 4",
    "measures: [{name: a}]": "'measures.0.tool' is missing",
    "inspect: face": "'inspect' = 'face': a list is expected",
}


KINDS = ("dent", "crater", "scratch", "raised", "missing", "extra")


@pytest.mark.parametrize("text", WRONG)
def test_what_is_wrong_is_named_in_one_line(text: str, tmp_path: Path) -> None:
    file = tmp_path / "recipe.yaml"
    file.write_text(text)
    with pytest.raises(RecipeError) as caught:
        load_recipe(file)
    (line,) = str(caught.value).splitlines()
    assert str(file) in line
    assert WRONG[text] in line


def test_limits_below_the_tolerances_that_hold_are_fine(tmp_path: Path) -> None:
    file = tmp_path / "recipe.yaml"
    for text in (
        "limits: {depth_m: 9.0e-5}",
        "{limits: {depth_m: 5.0e-4}, tolerances: [{depth_m: 1.0e-3}]}",  # the default holds nowhere
        "limits: {depth_m: 1.5e-4}\ntolerances: ["
        + ", ".join(f"{{kind: {kind}, depth_m: 3.0e-4}}" for kind in KINDS)
        + "]",
        "tolerances: [{depth_m: 1.0e-5}]",  # tighter than what is found as a rule
    ):
        file.write_text(text)
        load_recipe(file)


def test_the_first_tolerance_that_fits_holds(tmp_path: Path) -> None:
    file = tmp_path / "recipe.yaml"
    file.write_text(
        "regions: {rim: {circle_m: [0, 0, 1.0e-2]}}\n"
        "tolerances:\n"
        "  - {region: rim, kind: dent, depth_m: 1.0e-5}\n"
        "  - {region: rim, depth_m: 2.0e-5}\n"
        "  - {kind: any, depth_m: 3.0e-5}\n"
    )
    recipe = load_recipe(file)
    depths = [recipe.tolerance(*case).depth_m for case in (
        ("dent", ("rim",)), ("raised", ("rim",)), ("dent", ()),
    )]  # fmt: skip
    assert depths == [1e-5, 2e-5, 3e-5]
    assert Recipe.create({}).tolerance("dent", ()).depth_m == 1e-4
    assert recipe.sha256() != Recipe.create({}).sha256() == load_recipe().sha256()
    for document in (recipe.in_force(), Recipe.create(recipe.in_force()).in_force()):
        depths = [entry["depth_m"] for entry in document["tolerances"]]
        assert depths[-1] == 100e-6
        assert len(depths) == len(recipe.tolerances) + 1


@given(st.floats(-2, 2), st.floats(0, 1), st.floats(0, 2))
def test_iso_14253(value: float, u: float, limit: float) -> None:
    verdict = decide(value, u, -limit, limit)
    expected = (
        "conform" if abs(value) + u <= limit
        else "nonconform" if abs(value) - u > limit
        else "inconclusive"
    )  # fmt: skip
    # Rounding decides where a figure lies on its limit to the last digit.
    if abs(abs(value) + u - limit) > 1e-12 and abs(abs(value) - u - limit) > 1e-12:
        assert verdict == expected
    assert decide(value, math.nan, -limit, limit) == "inconclusive"
    assert decide(math.nan, u, -limit, limit) == "unmeasured"
    simple = decide(value, u, -limit, limit, "simple_acceptance")
    assert simple == ("conform" if abs(value) <= limit else "nonconform")


def test_what_was_not_measured_is_never_conform() -> None:
    assert part_verdict(["conform"], measured_enough=True) == "conform"
    assert part_verdict(["conform", "nonconform"], measured_enough=True) == "nonconform"
    assert part_verdict(["conform", "inconclusive"], measured_enough=True) == "inconclusive"
    assert part_verdict([], measured_enough=True, doubts=True) == "inconclusive"
    assert part_verdict(["conform"], measured_enough=False) == "unmeasured"
    # Few points that all is continued from: whatever the grid.
    for measured, grid_m, verdict in ((0.1, 1e-4, "inconclusive"), (0.06, 5e-5, "conform")):
        few = Coverage(measured, 1 - measured, 0.0, 1e-4, 20.0)
        judged = judge(Recipe.create({"grid_m": grid_m}), (), few)
        assert judged.verdict == verdict
        assert ("texture" in judged.reason) == (verdict != "conform")
    assert with_faults(judged, [], lost=0.04) == judged
    for faults, lost, why in (
        ([], 0.3, "30% of the event packets were lost"),
        (["x"], 0.0, "faults"),
    ):
        doubtful = with_faults(judged, faults, lost)
        assert doubtful.verdict == "inconclusive"
        assert why in doubtful.reason


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_a_polygon_holds_what_its_triangles_hold(x: float, y: float) -> None:
    """An L; against half planes."""
    corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 0.0), (0.0, 0.0), (0.0, 1.0), (-1.0, 1.0)]
    region = Region.create({"polygon_m": corners})
    on_edge = any(abs(v - e) < 1e-9 for v in (x, y) for e in (-1.0, 0.0, 1.0))
    inside = abs(x) < 1 and abs(y) < 1 and not (x > 0 and y > 0)
    assert on_edge or bool(region.contains(x, y)) == inside


def test_coverage_is_that_of_the_regions_to_inspect() -> None:
    """A map of 10 × 10 mm, of which the right half is unmeasured; the plate lies askew."""
    axis = (np.arange(100) + 0.5) * 1e-4
    state = np.full((100, 100), MEASURED, np.uint8)
    state[:, 50:] = UNMEASURED
    state[:, 40:50] = CONTINUED
    state[:10] = OUTSIDE
    nothing = np.zeros((100, 100), np.float32)
    grid = HeightMap(axis, axis, nothing, nothing, state, nothing.astype(np.uint16), np.eye(4))
    seen = Found(grid, nothing, (), None, coverage_of(grid), ())

    def covered(**values: object) -> tuple[float, float, float]:
        regions = {
            "left": {"box_m": [0, 0.001, 0.005, 0.01]},
            "beyond": {"box_m": [0.005, 0.001, 0.015, 0.01]},
        }
        recipe = Recipe.create({"regions": regions, **values})
        found, _ = coverage_of_area(recipe, seen)
        return found.measured, found.continued, found.unmeasured

    assert covered() == pytest.approx((0.4, 0.1, 0.5))
    assert covered(inspect=["left"]) == pytest.approx((0.8, 0.2, 0.0), abs=1e-9)
    assert covered(inspect=["left", "beyond"])[2] == pytest.approx(2 / 3)
    assert covered(exclude=["beyond"])[2] == 0.0
    # The same part, lain elsewhere and turned by a right angle.
    plate = {"origin_m": [0.02, 0.0, 0.0], "yaw_rad": math.pi / 2}
    assert covered(frame="plate", plate=plate, inspect=["left"])[2] == 1.0


def test_every_region_and_all_that_is_inspected_is_measured_compared_and_searched() -> None:
    """A map of 20 × 20 mm that all is known of, but a circle of 1 mm."""
    axis = (np.arange(200) + 0.5) * 1e-4
    x, y = np.meshgrid(axis, axis)
    state = np.where(np.hypot(x - 0.01, y - 0.01) < 1e-3, UNMEASURED, MEASURED).astype(np.uint8)
    zero = np.zeros((200, 200), np.float32)
    grid = HeightMap(axis, axis, zero, zero, state, zero.astype(np.uint16), np.eye(4))
    regions = {
        "hole": {"circle_m": [0.01, 0.01, 8e-4]},
        "face": {"box_m": [0.002, 0.002, 0.018, 0.018]},
        "beyond": {"circle_m": [0.05, 0.0, 1e-3]},
        # Half of it lies beside the scan; smaller than a cell.
        "side": {"box_m": [0.004, -0.004, 0.008, 0.004]},
        "rest": {"box_m": [0.0, -0.004, 0.02, 0.0]},
        "speck": {"circle_m": [0.01, 0.01, 2e-5]},
    }

    def verdict(deviation: np.ndarray = zero, **values: object) -> str:
        recipe = Recipe.create({"regions": regions, **values})
        seen = Found(grid, deviation, (), None, coverage_of(grid), ())
        coverage, lacking = coverage_of_area(recipe, seen)
        judged = judge(recipe, (), coverage, lacking=lacking)
        return f"{judged.verdict}: {judged.reason}"

    strict = {"depth_m": 1e-5}
    assert verdict() == verdict(inspect=["face"]) == "conform: no findings"
    none = "unmeasured: 0.0% of region '{}' was measured"
    assert verdict(inspect=["face", "hole"]) == none.format("hole")
    nothing = "unmeasured: the scan reached nothing of region 'beyond'"
    assert verdict(inspect=["face", "beyond"]) == nothing
    # Wherever else is inspected.
    for more in ({}, {"inspect": ["face"]}):
        for name, reason in (
            ("hole", none.format("hole")),
            ("beyond", nothing),
            ("side", none.format("side").replace("0.0%", "50.0%")),
            ("speck", none.format("speck")),
        ):
            assert verdict(tolerances=[{"region": name, **strict}], **more) == reason
        kept = verdict(tolerances=[{"region": "side", **strict}], exclude=["rest"], **more)
        assert kept == "conform: no findings"
    half = np.where(x < 0.01, zero, np.float32(np.nan))
    assert "the reference goes over 50." in verdict(half)
    assert verdict(half).startswith("unmeasured: 49.")
    assert verdict(edge_exclusion_m=0.01) == (
        "unmeasured: 0.0% of it was searched: edges of 10 mm left out"
    )
